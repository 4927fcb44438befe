"""Copies of recordings whose computer had a wrong time, with the right one."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Final

from gateway.core.errors import RecordingError
from gateway.core.links.source import Chunk, LinkEvent, LinkItem
from gateway.core.reasons import Reason
from gateway.core.recording.mcap_layout import MAX_TIME_NS
from gateway.core.recording.reader import REPAIR_REMEDY, RecordingReader
from gateway.core.recording.recorded_clock import RecordedClock, ahead_of_step_s
from gateway.core.recording.run_description import copy_notes
from gateway.core.recording.writer import RecordingWriter, whole_recording

# What is left of a step after the time was moved by it.
_NEGLIGIBLE_S: Final = 1e-3


def recorded_clock_error_s(path: Path) -> float | None:
    """Return what a recording says is to be added to its times, as `RecordedClock.ahead_s`.

    Raises:
        RecordingError: it cannot be read.
    """
    clock = RecordedClock()
    for item in RecordingReader(path).items():
        if not isinstance(item, Chunk):
            clock.take(item)
    return clock.ahead_s


def set_clock(
    path: Path, target: Path, ahead_s: float, on_position: Callable[[int, int], None] = lambda *_: None
) -> int:
    """Write a copy of a recording with `ahead_s` added to all its times; decoded topics are left out.

    The copy appears under its name when it is complete, or not at all.

    Args:
        path: a finished recording.
        target: must not exist yet.
        ahead_s: time to add in s.
        on_position: called with the bytes read, and their total.

    Returns:
        When the copy begins, in ns: an unknown start is the first item's time.

    Raises:
        RecordingError: the recording is unfinished or damaged, a time would lie outside 1970 to 2116, `target` exists,
            or the disk is full.
    """
    reader = RecordingReader(path)
    info, ahead_ns = reader.info, round(ahead_s * 1e9)
    if info.in_progress:
        raise RecordingError(f"'{path}' is being recorded", "Set its clock when its session has ended.")
    if not info.finished:
        raise RecordingError(f"'{path}' was not finished", REPAIR_REMEDY)

    def moved(host_ns: int) -> int:
        if not 0 <= host_ns + ahead_ns <= MAX_TIME_NS:
            raise RecordingError(
                f"{ahead_s:g} s would move '{path}' out of the years 1970 to 2116", "Give another time."
            )
        return host_ns + ahead_ns

    start_ns = moved(info.start_ns or next((item.host_ns for item in reader.items()), 0))
    part = RecordingWriter(
        target,
        start_ns=start_ns,
        vehicle_toml=info.vehicle_toml,
        sources=info.sources,
        dbc_text=info.dbc_text,
        run=info.run,
        in_part=True,
    )
    with whole_recording(part) as writer:
        is_empty = True
        for item in reader.items():
            on_position(reader.position, info.size_bytes)
            writer.write(_corrected(item, moved(item.host_ns), ahead_s))
            is_empty = False
        if is_empty and not info.treadlink:
            raise RecordingError(
                f"'{path}' has nothing of a hub, bus or receiver", "It is an MCAP file of another program."
            )
        if reader.damage is not None:
            raise RecordingError(f"'{path}' is damaged", REPAIR_REMEDY)
        copy_notes(path, target)
    return start_ns


def _corrected(item: LinkItem, host_ns: int, ahead_s: float) -> LinkItem:
    """Return an item at another time; what an event of a step adds to the times is what is left of it."""
    if not isinstance(item, LinkEvent):
        return replace(item, host_ns=host_ns)
    details = []
    for detail in item.details:
        before_s = ahead_of_step_s(detail)
        if before_s is not None:
            left_s = before_s - ahead_s
            ahead = {"ahead_s": 0.0 if abs(left_s) < _NEGLIGIBLE_S else left_s}
            detail = Reason(detail.code, **(dict(detail.values) | ahead))
        details.append(detail)
    return replace(item, host_ns=host_ns, details=tuple(details))
