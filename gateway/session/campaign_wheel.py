"""Which wheel a campaign is of; where there is none, what the recordings hold instead."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

from gateway.errors import RecordingError
from gateway.recording.inspection import inspect_recording
from gateway.session.campaign_recording import ReadOrder, RecordingRead

# Within so much even a wheel at walking speed turns more than once.
_LONG_S: Final = 5.0


def the_wheel(orders: Sequence[ReadOrder], reads: Sequence[RecordingRead], wheel: str | None) -> str:
    """Return the position of the wheel: the one that was chosen, or the only one.

    Raises:
        RecordingError: there is no revolution, none of the chosen wheel, or there are several wheels.
    """
    seen = list(dict.fromkeys(name for read in reads for name in read.wheels))
    if not seen:
        raise _no_revolution(orders, reads)
    if wheel is None:
        if len(seen) > 1:
            raise RecordingError(
                f"the recordings are of several wheels: {', '.join(seen)}", f"Choose one: --wheel {seen[0]}."
            )
        return seen[0]
    for order, read in zip(orders, reads, strict=True):
        if wheel not in read.wheels:
            raise _not_there(order, read, reads, wheel)
    return wheel


def _not_there(order: ReadOrder, read: RecordingRead, reads: Sequence[RecordingRead], wheel: str) -> RecordingError:
    shared = [name for name in read.wheels if all(name in other.wheels for other in reads)]
    choices = [f"Choose another wheel: {' or '.join(f'--wheel {name}' for name in shared)}."] if shared else []
    if any(wheel in other.wheels for other in reads):
        choices.append("Or leave this recording out." if choices else "Leave this recording out.")
    elif not choices:
        choices.append("Give recordings of one wheel.")
    held = f"it holds {', '.join(read.wheels)}" if read.wheels else "it holds none at all"
    told = "; ".join((f"'{order.path}' holds no revolution of wheel {wheel}; {held}", *read.notes))
    return RecordingError(told, " ".join(choices))


def _no_revolution(orders: Sequence[ReadOrder], reads: Sequence[RecordingRead]) -> RecordingError:
    found = [_samples_s(order.path) for order in orders]
    texts = [
        "; ".join((f"no whole revolution in '{order.path}': {_samples_text(seconds)}", *read.notes))
        for order, read, seconds in zip(orders, reads, found, strict=True)
    ]
    if not any(found):
        remedy = "`treadlink inspect` shows what was recorded."
    elif max(seconds or 0.0 for seconds in found) < _LONG_S:
        remedy = "Record longer: half a minute of rolling at a steady speed is enough."
    else:
        remedy = "Did the wheel roll? `treadlink inspect` shows what was recorded."
    return RecordingError("\n".join(texts), remedy)


def _samples_text(seconds: float | None) -> str:
    if seconds is None:
        return "samples, but no hello that tells their rate"
    return f"{seconds:.1f} s of samples" if seconds else "no sample"


def _samples_s(path: Path) -> float | None:
    """Return the seconds of samples of the wheel that has the most; None where their rate is unknown."""
    wheels = [wheel for link in inspect_recording(path).links.values() for wheel in link.wheels.values()]
    known = [wheel.samples / wheel.hello.rate_hz for wheel in wheels if wheel.samples and wheel.hello is not None]
    return max(known) if known else None if any(wheel.samples for wheel in wheels) else 0.0
