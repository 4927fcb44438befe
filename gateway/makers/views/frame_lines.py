"""Frames as lines of text, for somebody who watches a firmware's bytes."""

from collections.abc import Iterable, Iterator
from typing import Final

from firmware_protocol.counters import LinkCounters
from firmware_protocol.messages import COMMANDS, HUB_ITSELF, Frame, LogText, Message, MessageType, SampleBlock
from gateway.core.text.text import escaped

_SHOWN_ROWS: Final = 2
_FAULTS: Final = {
    "crc_errors": "CRC wrong",
    "noise_bytes": "bytes outside frames",
    "bad_payload": "payload breaks its layout",
    "unknown_type": "unknown type",
    "other_major": "other major version",
    "newer_minor": "newer minor version",
    "unknown_flags": "unknown flags",
    "lost": "lost by seq",
    "duplicates": "repeated by seq",
    "reordered": "late by seq",
    "restarts": "seq starts anew",
}


class FrameLines:
    """Lines of one link: each frame, and between them what the decoder has counted since."""

    def __init__(self) -> None:
        self._begin_ns: int | None = None
        self._counted: dict[str, int] = dict.fromkeys(_FAULTS, 0)

    def lines(self, frames: Iterable[Frame], counters: LinkCounters, host_ns: int) -> Iterator[str]:
        """Yield the lines of frames that arrived together, then what was wrong with the bytes among them."""
        if self._begin_ns is None:
            self._begin_ns = host_ns
        at_s = (host_ns - self._begin_ns) * 1e-9
        for frame in frames:
            yield f"{at_s:10.3f}  {frame_line(frame)}"
        for name, description in _FAULTS.items():
            count = getattr(counters, name)
            if count != self._counted[name]:
                yield f"{at_s:10.3f}  ! {description}: {count - self._counted[name]:+d}"
                self._counted[name] = count


def frame_line(frame: Frame) -> str:
    """Return a frame as one line: source, type, counter, clock and content."""
    wheel = "hub" if frame.wheel == HUB_ITSELF else f"wheel {frame.wheel}"
    name = MessageType(frame.type).name + (" (a command)" if frame.type in COMMANDS else "")
    counted = f"seq {frame.seq:<10} tick_us {frame.tick_us:<10}"
    return f"hub {frame.hub} {wheel:8} {name:14} {counted}  {_content(frame.message)}"


def _content(message: Message) -> str:
    if isinstance(message, SampleBlock):
        rows = [" ".join(map(str, row)) for row in message.counts[:_SHOWN_ROWS].tolist()]
        ellipsis = " ..." if len(message.counts) > _SHOWN_ROWS else ""
        first, n = message.first_sample, len(message.counts)
        return f"first_sample {first} axes {message.axes} n {n}: {', '.join(rows)}{ellipsis}"
    if isinstance(message, LogText):
        return f"level {message.level}: {escaped(message.text)}"
    return " ".join(f"{name}={_value(value)}" for name, value in message._asdict().items())


def _value(value: object) -> str:
    if isinstance(value, tuple):
        return "(" + " ".join(map(_value, value)) + ")"
    if isinstance(value, float):
        return f"{value:g}"
    return str(value)
