"""Effects file of a diagnosis."""

from pathlib import Path

from gateway.core.errors import TreadlinkError
from gateway.core.text.output_file import write_whole
from gateway.diagnosis.effects_file import effects_text
from gateway.diagnosis.result import Diagnosis
from gateway.diagnosis.views.phrases import why_unsaved


def save_effects(diagnosis: Diagnosis, path: Path, *, force: bool = False) -> None:
    """Write the identified effects to a file, for `effects` of `open` and `live`.

    Raises:
        TreadlinkError: no effect was identified, or the baseline model is not the exact one.
        OutputError: the file exists, or cannot be written.
    """
    if diagnosis.correction is None:
        reason, remedy = why_unsaved(diagnosis)
        raise TreadlinkError(f"'{path}' is not written: {reason}", remedy)
    write_whole(Path(path), effects_text(diagnosis.correction), force=force)
