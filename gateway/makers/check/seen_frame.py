"""An intact frame as the check sees it: its bytes, its place in the stream and its content."""

from typing import NamedTuple

from firmware_protocol import wire
from firmware_protocol.messages import HUB_ITSELF, Frame, Message

SourceKey = tuple[int, int]
"""Hub and wheel of a source."""


class SeenFrame(NamedTuple):
    """An intact frame of this major version.

    Attributes:
        at_byte: its place in the stream.
        host_s: its arrival, s since the first byte; None where arrival times are not known.
        data: its bytes.
        type: type byte.
        hub: number of the hub.
        wheel: number of the wheel, or HUB_ITSELF.
        flags: flag bits.
        seq: counter of the source.
        tick_us: the hub's clock.
        message: its content, None where this version cannot read it.
    """

    at_byte: int
    host_s: float | None
    data: bytes
    type: int
    hub: int
    wheel: int
    flags: int
    seq: int
    tick_us: int
    message: Message | None

    @property
    def source(self) -> SourceKey:
        """Its source."""
        return self.hub, self.wheel

    @property
    def payload(self) -> bytes:
        """Its payload, without a tag."""
        return self.data[wire.HEADER_BYTES : len(self.data) - wire.CRC_BYTES - self.tag_bytes]

    @property
    def tag_bytes(self) -> int:
        """Length of its tag."""
        return wire.TAG_BYTES if self.flags & wire.SIGNED_FLAG else 0

    @property
    def as_frame(self) -> Frame:
        """The frame with its content, which must be known."""
        assert self.message is not None
        return Frame(self.type, self.hub, self.wheel, self.seq, self.tick_us, self.message)


def source_name(source: SourceKey) -> str:
    """Return the name of a source without a vehicle's configuration."""
    hub, wheel = source
    return f"hub {hub}" if wheel == HUB_ITSELF else f"hub{hub}.wheel{wheel}"


def signed_step(before: int, after: int) -> int:
    """Return the step between two numbers of 32 bits that wrap."""
    return (after - before + 2**31) % 2**32 - 2**31
