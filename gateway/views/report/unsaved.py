"""Why effects that were found are not in the file that estimators read, in words."""

from __future__ import annotations

from typing import Final, NamedTuple

from gateway.closure.diagnosis import Diagnosis
from gateway.views.report.rows import listed, printed, undecided_sets

MEASURED: Final = frozenset({"ply steer", "conicity", "carcass compliance"})
"""What estimators of the lateral axis are there to measure; it stays in the signal."""


class Unsaved(NamedTuple):
    """Why no file is written, and what to do about it."""

    reason: str
    remedy: str


def why_unsaved(diagnosis: Diagnosis) -> Unsaved:
    """Return why a diagnosis has nothing that `live` and `estimate` could take off."""
    if not diagnosis.named:
        undecided = undecided_sets(diagnosis)
        if not undecided:
            return Unsaved(
                "no effect was named",
                "live and estimate need no correction for what was not found; more speeds or loads may tell more.",
            )
        first = undecided[0]
        if not first.rivals:
            return Unsaved(f"{printed(first.name)} is not certain", _sentence(first.decide_with))
        names = listed((first.name, *first.rivals))
        return Unsaved(f"{names} cannot be told apart, so none is named", _sentence(first.decide_with))
    usable = [name for name in _in_waveform(diagnosis) if name not in MEASURED]
    if usable:
        return Unsaved(
            f"without {listed(usable)} the ring does not stand at the parameters found, so there is nothing to take "
            f"{'it' if len(usable) == 1 else 'them'} off from",
            "Check belt radius, load and pressure in the configuration; then the report's unexplained part.",
        )
    kept = "; ".join(_left_out(diagnosis))
    return Unsaved(f"nothing was named that could be taken off: {kept}", "live and estimate need no correction then.")


def saved_text(diagnosis: Diagnosis) -> str:
    """Return which effects the saved file holds, and which named ones it does not, and why."""
    held = ", ".join(effect.name for effect in diagnosis.correction.effects) if diagnosis.correction else ""
    return "; ".join([held, *_left_out(diagnosis)])


def _left_out(diagnosis: Diagnosis) -> list[str]:
    waveform = _in_waveform(diagnosis)
    measured = [name for name in waveform if name in MEASURED]
    scattered = [finding.name for finding in diagnosis.named if finding.name not in waveform]
    reasons = []
    if measured:
        reasons.append(f"{listed(measured)} {_is(measured)} left for the estimators to measure")
    if scattered:
        reasons.append(f"{listed(scattered)} {_is(scattered)} not the same in every revolution")
    return reasons


def _in_waveform(diagnosis: Diagnosis) -> list[str]:
    return [finding.name for finding in diagnosis.named if finding.lock == "angle"]


def _is(names: list[str]) -> str:
    return "is" if len(names) == 1 else "are"


def _sentence(words: str) -> str:
    if not words:
        return "Record at another speed, load or pressure."
    words = printed(words)
    return f"{words[0].upper()}{words[1:].rstrip('.')}."
