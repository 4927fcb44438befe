"""Judgement of a diagnosis against the opened label."""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Final

from gateway.diagnosis.spectrum.nonsynchronous_diagnosis import UNKNOWN


class Outcome(StrEnum):
    """Outcome of a case; the first four are correct."""

    EXACT = "exactly right"
    CANNOT_TELL = "indistinguishable, rightly"
    NOTHING = "nothing, rightly"
    LEFT = "unexplained, rightly"
    MISSED = "missed"
    UNSURE = "indistinguishable, needlessly"
    WRONG = "wrong name"
    FALSE_ALARM = "false alarm"
    FAILED = "failed"

    @property
    def right(self) -> bool:
        """Whether the diagnosis is correct as far as the data allow."""
        return self in (Outcome.EXACT, Outcome.CANNOT_TELL, Outcome.NOTHING, Outcome.LEFT)


CANNOT_TELL: Final[Mapping[frozenset[str], str]] = {
    frozenset(("rolling radius", "sample clock error")): "the same factor on every waveform when no clock is compared",
    frozenset(("rolling radius", "gain")): "alike but for gravity and the circumferential axis, which are small",
    frozenset(("sample clock error", "gain")): "likewise",
    frozenset(("sensor nonlinearity", "gain")): "over the speeds driven square and cube make a gain, a small one alike",
    frozenset(("sensor nonlinearity", "rolling radius")): "likewise",
    frozenset(("sensor nonlinearity", "sample clock error")): "likewise",
    frozenset(("run-out", "gain")): "a sensor always rides on the same spot: its radius is the tire's, to it",
    frozenset(("run-out", "rolling radius")): "likewise",
    frozenset(("run-out", "sample clock error")): "likewise",
    frozenset(("gain", "belt extension")): "an extensible belt's mean is short of R omega^2, by little else",
    frozenset(("rolling radius", "belt extension")): "likewise",
    frozenset(("sample clock error", "belt extension")): "likewise",
    frozenset(("structural damping", "tread damping (shifted pressure)")): "both turn the contact; small ones alike",
    frozenset(("structural damping", "contact asymmetry")): "likewise",
    frozenset(("tread damping (shifted pressure)", "contact asymmetry")): "likewise",
    frozenset(("bending damping", "tread damping (shifted pressure)")): "both delay the belt at the edges when small",
    frozenset(("conicity", "carcass compliance")): "a side force either way; loads tell, when it is large",
    frozenset(("roll tilt", "conicity")): "likewise when small",
    frozenset(("zero-g offset", "camber")): "a constant of the lateral axis, at any speed, load and direction",
}
"""Pairs that this campaign cannot separate at every size, with the reason. Only these count as correct when open."""

# The paper's model lacks these whatever the case is; they are always to be found.
ALWAYS: Final[Mapping[str, frozenset[str]]] = {
    "paper": frozenset(
        ("gravity", "belt kinematics (n^2-1)", "pressure shape", "geometric tension loss", "speed drift")
    ),
    "exact": frozenset(),
}

# Speed drift is in every run, but not always large enough to be seen.
REQUIRED: Final = frozenset().union(*ALWAYS.values()) - {"speed drift"}


@dataclass(frozen=True, slots=True)
class Judgement:
    """Judgement of a case.

    Attributes:
        outcome: of the case.
        named: effects that the diagnosis named.
        open: sets of names left open.
    """

    outcome: Outcome
    named: tuple[str, ...]
    open: tuple[frozenset[str], ...]


def table_alike(true: str, other: str) -> bool:
    """Return whether the table above allows an effect to be left open beside another."""
    return frozenset((true, other)) in CANNOT_TELL


def judge(
    result: Mapping[str, Any],
    label: Mapping[str, Any],
    alike: Callable[[str, str], bool] = table_alike,
    also: Collection[str] = (),
) -> Judgement:
    """Return the judgement of a diagnosis against the label.

    Args:
        result: `effects` with name, verdict and rivals, and `unexplained`.
        label: the truth.
        alike: whether the data leave a true effect open beside another.
        also: effects of the catalogue that a thing outside it brings along.
    """
    effects = result["effects"]
    named = tuple(entry["name"] for entry in effects if entry["verdict"] == "named")
    left_open = tuple(
        dict.fromkeys(
            frozenset((entry["name"], *entry["rivals"])) for entry in effects if entry["verdict"] == "indistinguishable"
        )
    )
    always = ALWAYS[label.get("model", "exact")]
    return Judgement(
        _outcome(label, set(named) - set(also), left_open, bool(result["unexplained"]), always | set(also), alike),
        named,
        left_open,
    )


def _outcome(
    label: Mapping[str, Any],
    named: set[str],
    left_open: tuple[frozenset[str], ...],
    unexplained: bool,
    always: frozenset[str] | set[str],
    alike: Callable[[str, str], bool],
) -> Outcome:
    drawn = set(label["truth"])
    truth = drawn | always
    wanted = drawn | (always & REQUIRED)
    if named - truth:
        return Outcome.WRONG if drawn or label["outside"] else Outcome.FALSE_ALARM
    pending, excused = wanted - named, True
    for group in left_open:
        hit = group & pending
        if not hit:
            # What is not in the catalogue is among the explanations.
            if not group & truth and not (label["outside"] and UNKNOWN in group):
                return Outcome.WRONG if drawn or label["outside"] else Outcome.FALSE_ALARM
            continue
        first = min(hit)
        pending = pending - {first}
        excused = excused and all(alike(first, other) for other in group - {first})
    if pending:
        return Outcome.MISSED
    if not excused:
        return Outcome.UNSURE
    if label["outside"]:
        return Outcome.LEFT if unexplained else Outcome.MISSED
    if any(group & wanted for group in left_open):
        return Outcome.CANNOT_TELL
    return Outcome.EXACT if drawn else Outcome.NOTHING
