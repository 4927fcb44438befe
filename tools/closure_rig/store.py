"""Cases on disk: recordings that two versions of the gateway share, and their sealed labels."""

import hashlib
import json
import os
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from closure_rig.plan import Planned, make, plan
from closure_rig.record import record
from closure_rig.seal import open_label, seal
from gateway import __version__


@dataclass(frozen=True, slots=True)
class Stored:
    """Recordings of a case.

    Attributes:
        planned: the case.
        folder: of its recordings and `declared.json`, which names them and those made in reverse.
    """

    planned: Planned
    folder: Path


class Store:
    """Folder of cases. A case is made when it is first needed, once for all versions."""

    def __init__(self, folder: Path, seed: int) -> None:
        """Open or create a folder of cases.

        Raises:
            ValueError: it holds the cases of another seed, or of another plan.
        """
        self._folder = folder
        self.cases = plan(seed)
        digest = hashlib.sha256(repr(self.cases).encode()).hexdigest()
        about = folder / "plan.json"
        if about.is_file():
            document = json.loads(about.read_text(encoding="utf-8"))
            if document["seed"] != seed:
                raise ValueError(
                    f"'{folder}' holds the cases of seed {document['seed']}, not {seed}: give another folder"
                )
            if document.get("digest") != digest:
                raise ValueError(f"'{folder}' holds the cases of another version of the rig: give another folder")
        else:
            (folder / "cases").mkdir(parents=True, exist_ok=True)
            (folder / "labels").mkdir(exist_ok=True)
            remaining = {"seed": seed, "digest": digest, "treadlink": __version__}
            about.write_text(json.dumps(remaining), encoding="utf-8")

    def get(self, planned: Planned) -> Stored:
        """Return a case, made if it is not there yet."""
        folder = self._folder / "cases" / planned.stem
        if not folder.is_dir():
            # Two versions may be run at a time. A case is the same whoever makes it; the first one stays.
            half = folder.with_name(f".{planned.stem}.{os.getpid()}")
            shutil.rmtree(half, ignore_errors=True)
            half.mkdir()
            case = make(planned)
            record(case, half)
            label = self._label(planned)
            fresh = label.with_suffix(f".{os.getpid()}")
            fresh.unlink(missing_ok=True)
            digest = seal(case.label, fresh)
            label.with_suffix(".sha256").write_text(digest, encoding="ascii")
            fresh.replace(label)
            try:
                half.rename(folder)
            except OSError:
                shutil.rmtree(half)
        return Stored(planned, folder)

    def open_label(self, planned: Planned, diagnosis: Path) -> dict[str, Any]:
        """Return a case's label once its diagnosis is in a file.

        Raises:
            FileNotFoundError: there is no diagnosis yet.
            SealBrokenError: the label was changed or exchanged.
        """
        label = self._label(planned)
        return open_label(label, label.with_suffix(".sha256").read_text(encoding="ascii"), diagnosis)

    def _label(self, planned: Planned) -> Path:
        return self._folder / "labels" / f"{planned.stem}.label"
