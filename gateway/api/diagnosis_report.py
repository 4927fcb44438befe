"""Diagnosis of recordings for programs: the result with its report as text, JSON and HTML."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from html import escape
from pathlib import Path
from typing import Any, Literal

from gateway.api.recording_access import Recording
from gateway.core.errors import TreadlinkError
from gateway.core.recording.file_content import check_distinct
from gateway.core.session.program_arguments import Config, PathLike, chosen_vehicle
from gateway.core.worker_pool import Workers
from gateway.diagnosis.campaign import reading_orders
from gateway.diagnosis.campaign_diagnosis import diagnose_recordings
from gateway.diagnosis.effects.effect import BaselineModel
from gateway.diagnosis.result import Diagnosis, Finding, Fitted, Unexplained
from gateway.diagnosis.saved_effects import save_effects
from gateway.diagnosis.views.diagnosis_json import diagnosis_json, write_json
from gateway.diagnosis.views.html import diagnosis_html, write_html
from gateway.diagnosis.views.phrases import effect_title
from gateway.diagnosis.views.terminal import closure_summary_lines

Model = Literal["exact", "paper"]
DiagnosisProgress = Callable[[float, str], None]


def diagnose(
    recordings: PathLike | Recording | Sequence[PathLike | Recording],
    *,
    config: Config | None = None,
    wheel: str | None = None,
    model: Model = "exact",
    reverse: Collection[PathLike | Recording] = (),
    empirical: bool = False,
    folds: int = 5,
    jobs: int = 1,
    keys: PathLike | None = None,
    budget_s: float | None = None,
    progress: DiagnosisProgress | None = None,
) -> DiagnosisReport:
    """Identify the physical effects that the model of one wheel lacks, as `treadlink diagnose`.

    Args:
        recordings: files, or recordings opened from files.
        config: vehicle configuration for all of them; None for the one in each recording.
        wheel: position; None when the recordings contain one wheel only.
        model: baseline model: `exact` ring, corrected `series` solution, or the ring `paper`'s as printed.
        reverse: those of `recordings` made rolling backwards, or with the tire reversed on its rim.
        empirical: also fit the unexplained residual empirically.
        folds: blocks of cross-validation, 2 to 20.
        jobs: maximum number of processes.
        keys: file with the keys of signed frames; None for the key file of `treadlink keys`.
        budget_s: time for reading and the search for effects; None sets no limit. The first fit and the errors on
            held-out revolutions are computed in any case; a note says how long each took.
        progress: called with the share done, 0 to 1, and the present step.

    Raises:
        TreadlinkError: a recording cannot be read, is given twice or as a copy, or contains nothing usable; several
            wheels and none chosen.
        ValueError: no such model, too few or too many folds, or no process.
    """
    chosen = BaselineModel(model)
    if not 2 <= folds <= 20:
        raise ValueError(f"folds must be 2 to 20, not {folds}")
    if jobs < 1:
        raise ValueError(f"jobs must be at least 1, not {jobs}")
    sources = [recordings] if isinstance(recordings, str | Path | Recording) else list(recordings)
    paths = [_path(recording) for recording in sources]
    check_distinct(paths)
    if not paths:
        raise TreadlinkError("there is no recording to diagnose", "Give at least one.")
    with Workers(jobs - 1) as workers:
        orders = reading_orders(
            paths,
            vehicle=chosen_vehicle(config, (), ""),
            wheel=wheel,
            folds=folds,
            reverse=[_path(recording) for recording in reverse],
            key_file=None if keys is None else Path(keys),
        )
        diagnosis = diagnose_recordings(
            orders, model=chosen, empirical=empirical, workers=workers, budget_s=budget_s, on_progress=progress
        )
    return DiagnosisReport(diagnosis)


def _path(recording: PathLike | Recording) -> Path:
    if not isinstance(recording, Recording):
        return Path(recording)
    if not recording.path.exists():
        raise TreadlinkError(
            f"'{recording.name}' is not in a file", "Write it: gateway.simulate(..., out='FILE.mcap')."
        )
    return recording.path


class DiagnosisReport:
    """A finished diagnosis of one wheel.

    Attributes:
        result: every figure of the report.
    """

    def __init__(self, result: Diagnosis) -> None:
        """Take a finished diagnosis."""
        self.result = result

    @property
    def wheel(self) -> str:
        """Position of the wheel."""
        return self.result.wheel

    @property
    def effects(self) -> tuple[Finding, ...]:
        """Effects that were identified: the model lacks them."""
        return self.result.named

    @property
    def unexplained(self) -> tuple[Unexplained, ...]:
        """What no effect of the catalogue explains, largest first."""
        return self.result.unexplained

    @property
    def estimates_before(self) -> dict[str, Fitted]:
        """Estimates of the baseline model, by name."""
        return dict(self.result.estimates_before)

    @property
    def estimates_after(self) -> dict[str, Fitted]:
        """Estimates with the identified effects, by name."""
        return dict(self.result.estimates_after)

    @property
    def held_out_rms_mps2(self) -> tuple[float, float]:
        """Error on revolutions that no fit used, before and after the effects were added, m/s^2."""
        return self.result.held_out.rms_before_mps2, self.result.held_out.rms_after_mps2

    @property
    def noise_floor_mps2(self) -> float:
        """Held-out error that a right model would have, m/s^2."""
        return self.result.noise_floor_mps2

    def summary(self) -> str:
        """Return what `treadlink diagnose` prints."""
        return "\n".join(closure_summary_lines(self.result))

    def to_dict(self) -> dict[str, Any]:
        """Return the content of the JSON file."""
        return diagnosis_json(self.result)

    def report_html(self, path: PathLike | None = None, *, force: bool = False) -> str:
        """Return the report with figures as one self-contained HTML page, and write it to a file if one is given.

        Args:
            path: new file.
            force: overwrite an existing one.

        Raises:
            OutputError: a package is missing, the file exists, or it cannot be written.
        """
        if path is not None:
            write_html(self.result, Path(path), force=force)
            return Path(path).read_text(encoding="utf-8")
        return diagnosis_html(self.result)

    def report_json(self, path: PathLike, *, force: bool = False) -> None:
        """Write all results to a JSON file; arguments and errors as for `report_html`."""
        write_json(self.result, Path(path), force=force)

    def save_effects(self, path: PathLike, *, force: bool = False) -> None:
        """Write the identified effects to a file, for `effects` of `open` and `live`.

        Raises:
            TreadlinkError: no effect was identified, or the baseline model is not the exact one.
            OutputError: the file exists, or cannot be written.
        """
        save_effects(self.result, Path(path), force=force)

    def __repr__(self) -> str:
        before, after = self.held_out_rms_mps2
        effects = ", ".join(effect_title(finding.name) for finding in self.effects) or "nothing"
        return (
            f"<DiagnosisReport of {self.wheel}: identified {effects}; held-out rms {before:.2f} -> {after:.2f} m/s^2, "
            f"noise floor {self.noise_floor_mps2:.2f} m/s^2>"
        )

    def _repr_html_(self) -> str:
        return f"<pre>{escape(self.summary())}</pre>"
