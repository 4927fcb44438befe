"""A hub that starts again, made from the stream of one that did not."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field

from firmware_protocol import wire
from firmware_protocol.codec import decode_payload, encode_frame
from firmware_protocol.messages import Frame, Hello, HubStatus, Message, MessageType, SampleBlock, TimeSync
from gateway.io.source import Chunk
from gateway.simulator.frame_pieces import Piece, frame_pieces

_HEADER = struct.Struct(wire.HEADER_FORMAT)
_MASK = 0xFFFF_FFFF
# From power-up to the first frame; a block's stamp, its first sample, may lie a little before the frame ahead of it.
_BOOT_US = 100_000


@dataclass(slots=True)
class _Life:
    """What one hub's frames look like since its last start.

    Attributes:
        boots: restarts so far.
        tick_zero_us: time stamp that now counts as 0; None until the first frame after the restart.
        next_seq: counter of the next frame, per wheel number.
        sample_zero: running sample number that now counts as 0, per wheel number.
        hellos: last hello of each wheel.
    """

    boots: int = 0
    tick_zero_us: int | None = None
    next_seq: dict[int, int] = field(default_factory=dict)
    sample_zero: dict[int, int] = field(default_factory=dict)
    hellos: dict[int, Hello] = field(default_factory=dict)


def reboot(
    chunks: Iterable[Chunk],
    at_s: float,
    every_s: float,
    gap_s: float,
    counted: Callable[[], None],
    swallowed: Callable[[int], None],
) -> Iterator[Chunk]:
    """Yield the chunks with every hub starting again `at_s` after the first chunk, and every `every_s` after that.

    During the gap nothing comes; then every hub tells its hellos with the next boot count, and counters, time stamps
    and sample numbers begin at 0. Bytes that are no frame of this version are left as
    they are.

    Args:
        chunks: of one hub or more.
        at_s: time of the first restart.
        every_s: time from restart to restart, 0 for one only.
        gap_s: silence of a restart.
        counted: called at each restart.
        swallowed: called with the number of bytes that fell into a gap.
    """
    lives: dict[tuple[str, int], _Life] = {}
    begin_ns: int | None = None
    silent_until_ns = 0
    due_s = at_s
    for link, host_ns, pieces in frame_pieces(chunks):
        begin_ns = host_ns if begin_ns is None else begin_ns
        if host_ns - begin_ns >= due_s * 1e9:
            counted()
            silent_until_ns = host_ns + int(gap_s * 1e9)
            due_s = due_s + every_s if every_s > 0 else float("inf")
            for old in lives.values():
                old.boots += 1
                old.tick_zero_us = None
                old.next_seq.clear()
                old.sample_zero.clear()
        parts: list[bytes] = []
        for piece in pieces:
            frame = _frame(piece)
            life = lives.setdefault((link, frame.hub), _Life()) if frame else None
            if frame and life and isinstance(frame.message, Hello):
                life.hellos[frame.wheel] = frame.message
            if host_ns < silent_until_ns:
                swallowed(len(piece.data))
            elif frame and life and life.boots:
                parts += _relived(life, frame)
            else:
                parts.append(piece.data)
        if data := b"".join(parts):
            yield Chunk(link, host_ns, data)


def _frame(piece: Piece) -> Frame | None:
    """Return an intact frame of this protocol version, None for anything else."""
    if not piece.whole:
        return None
    _, version, kind, length, hub, wheel, _, seq, tick = _HEADER.unpack_from(piece.data)
    if version != wire.VERSION_BYTE:
        return None
    try:
        message = decode_payload(kind, piece.data[wire.HEADER_BYTES : wire.HEADER_BYTES + length])
    except ValueError:
        return None
    return Frame(kind, hub, wheel, seq, tick, message)


def _relived(life: _Life, frame: Frame) -> list[bytes]:
    """Return a frame of the hub's new life, after its hellos when it is the first."""
    parts: list[bytes] = []
    if life.tick_zero_us is None:
        life.tick_zero_us = (frame.tick_us - _BOOT_US) & _MASK
        for wheel, hello in sorted(life.hellos.items()):
            parts.append(_encoded(life, MessageType.HELLO, frame.hub, wheel, 0, hello))
    now = (frame.tick_us - life.tick_zero_us) & _MASK
    message = frame.message
    if isinstance(message, SampleBlock):
        zero = life.sample_zero.setdefault(frame.wheel, message.first_sample)
        message = message._replace(first_sample=(message.first_sample - zero) & _MASK)
    elif isinstance(message, TimeSync):
        message = message._replace(hub_us=now)
    elif isinstance(message, HubStatus):
        message = message._replace(uptime_s=now // 1_000_000, frames_sent=sum(life.next_seq.values()))
    parts.append(_encoded(life, frame.type, frame.hub, frame.wheel, now, message))
    return parts


def _encoded(life: _Life, kind: int, hub: int, wheel: int, tick_us: int, message: Message) -> bytes:
    if isinstance(message, Hello):
        message = message._replace(boot_count=message.boot_count + life.boots)
    seq = life.next_seq.get(wheel, 0)
    life.next_seq[wheel] = seq + 1
    return encode_frame(Frame(kind, hub, wheel, seq, tick_us, message))
