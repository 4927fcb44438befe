"""Reasons why a session or a recording has no result."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Final, NamedTuple

from gateway.core.estimates.results import WheelSnapshot
from gateway.core.reasons import CoreCode, Level, Notice, Reason
from gateway.core.session.reasons import SessionCode
from gateway.core.wheels.reasons import WheelCode

# A standing or slow wheel is worth a notice after this time of samples.
_LONG_S: Final = 6.0


class FrameCounts(NamedTuple):
    """Frames of one link.

    Attributes:
        accepted: intact frames that were used.
        refused: intact frames that were rejected because they were not verified.
    """

    accepted: int
    refused: int


def missing_frames(links: Mapping[str, FrameCounts]) -> tuple[Notice, ...]:
    """Return a warning for each link without a frame to use; one for all when there is no link."""
    if not links:
        return (_warning("", Reason(SessionCode.NO_FRAME_RECEIVED)),)
    empty = {link: counts for link, counts in links.items() if not counts.accepted}
    return tuple(
        _warning(
            link,
            Reason(SessionCode.ALL_FRAMES_REFUSED, count=counts.refused)
            if counts.refused
            else Reason(SessionCode.NO_FRAME_RECEIVED),
        )
        for link, counts in empty.items()
    )


def missing_revolutions(wheels: Sequence[WheelSnapshot], links: Mapping[str, FrameCounts]) -> tuple[Notice, ...]:
    """Return a warning for each wheel that sent samples, but completed no revolution at all or none in the end.

    Args:
        wheels: their last state.
        links: counts of their links; without frames there is nothing to say of wheels.
    """
    notices = tuple(
        _warning(wheel.position, reason)
        for wheel in wheels
        if (reason := wheel.missing or next(_no_revolution(wheel), None)) is not None
    )
    rolled = any(wheel.counters.revolutions for wheel in wheels)
    if not notices and not rolled and any(counts.accepted for counts in links.values()):
        return (_warning("", Reason(WheelCode.NO_SAMPLES)),)
    return notices


def long_missing(wheel: WheelSnapshot) -> Reason | None:
    """Return why a wheel has completed no revolution, after some seconds of samples; None where an alarm says so."""
    missing = wheel.missing
    if missing is None or next(_no_revolution(wheel), None) is not None:
        return None
    return missing if missing["duration_s"] >= _LONG_S else None  # type: ignore[operator]  # a number


def _no_revolution(wheel: WheelSnapshot) -> Iterator[Reason]:
    return (flag.reason for flag in wheel.flags if flag.reason.code is CoreCode.NO_REVOLUTION)


def _warning(subject: str, reason: Reason) -> Notice:
    return Notice(subject, reason, Level.WARNING)
