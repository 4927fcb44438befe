"""Link faults: composable, seeded transforms of chunks that count their effects."""

import zlib
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Final, NamedTuple

import numpy as np

from firmware_protocol import wire
from firmware_protocol.codec import decode_payload, encode_frame
from firmware_protocol.messages import (
    HUB_ITSELF,
    Frame,
    Hello,
    HubStatus,
    Message,
    MessageType,
    SampleBlock,
    TimeSync,
)
from gateway.core.errors import SourceError
from gateway.core.links.source import Chunk


class Piece(NamedTuple):
    """Consecutive bytes: one intact frame, or bytes outside frames.

    Attributes:
        data: the bytes.
        whole: whether they are an intact frame.
    """

    data: bytes
    whole: bool


def frame_pieces(chunks: Iterable[Chunk]) -> Iterator[tuple[str, int, list[Piece]]]:
    """Yield (link, time, pieces) per chunk; a frame belongs to the chunk that completes it. No byte is lost.

    Chunks without bytes, of which a fault has taken all, are yielded without pieces.
    """
    tails: dict[str, bytes] = {}
    times: dict[str, int] = {}
    for chunk in chunks:
        pieces, tails[chunk.link] = cut(tails.get(chunk.link, b"") + chunk.data)
        times[chunk.link] = chunk.host_ns
        if pieces or not chunk.data:
            yield chunk.link, chunk.host_ns, pieces
    for link, tail in tails.items():
        if tail:
            yield link, times[link], [Piece(tail, False)]


def cut(data: bytes) -> tuple[list[Piece], bytes]:
    """Return the pieces of `data`, and the bytes at its end that may begin a frame."""
    pieces: list[Piece] = []
    start = offset = 0
    while (offset := data.find(wire.SYNC, offset)) >= 0:
        if offset + wire.LENGTH_KNOWN_BYTES > len(data):
            break
        length = data[offset + wire.LENGTH_OFFSET]
        end = offset + wire.OVERHEAD_BYTES + length
        if length > wire.MAX_PAYLOAD_BYTES:
            offset += 1
            continue
        if end > len(data):
            break
        if zlib.crc32(data[offset:end]) != wire.CRC_RESIDUE:
            offset += 1
            continue
        if offset > start:
            pieces.append(Piece(data[start:offset], False))
        pieces.append(Piece(data[offset:end], True))
        start = offset = end
    if offset < 0:
        offset = len(data) - 1 if data.endswith(wire.SYNC[:1]) else len(data)
        offset = max(offset, start)
    if offset > start:
        pieces.append(Piece(data[start:offset], False))
    return pieces, data[offset:]


_HEADER = wire.HEADER.head
_MASK = 0xFFFF_FFFF
# Time from power-up to the first frame. The tick of a block is that of its first sample, which may precede the
# previous frame.
_BOOT_US = 100_000


@dataclass(slots=True)
class _Life:
    """State of one hub's stream since its last start.

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
    uptime_us = (frame.tick_us - life.tick_zero_us) & _MASK
    message = frame.message
    if isinstance(message, SampleBlock):
        zero = life.sample_zero.setdefault(frame.wheel, message.first_sample)
        message = message._replace(first_sample=(message.first_sample - zero) & _MASK)
    elif isinstance(message, TimeSync):
        message = message._replace(hub_us=uptime_us)
    elif isinstance(message, HubStatus):
        message = message._replace(uptime_s=uptime_us // 1_000_000, frames_sent=sum(life.next_seq.values()))
    parts.append(_encoded(life, frame.type, frame.hub, frame.wheel, uptime_us, message))
    return parts


def _encoded(life: _Life, kind: int, hub: int, wheel: int, tick_us: int, message: Message) -> bytes:
    if isinstance(message, Hello):
        message = message._replace(boot_count=message.boot_count + life.boots)
    seq = life.next_seq.get(wheel, 0)
    life.next_seq[wheel] = seq + 1
    return encode_frame(Frame(kind, hub, wheel, seq, tick_us, message))


ChunkTransform = Callable[[Iterable[Chunk]], Iterator[Chunk]]


@dataclass(slots=True)
class FaultCounts:
    """Effects of a fault.

    Attributes:
        frames_seen: whole frames seen (frame faults).
        frames_hit: frames changed, dropped, doubled or moved.
        chunks_hit: chunks cut or delayed.
        bytes_changed: bytes with flipped bits.
        bytes_dropped: bytes removed.
        bytes_added: bytes inserted.
        reboots: restarts of a hub.
    """

    frames_seen: int = 0
    frames_hit: int = 0
    chunks_hit: int = 0
    bytes_changed: int = 0
    bytes_dropped: int = 0
    bytes_added: int = 0
    reboots: int = 0

    def as_dict(self) -> dict[str, int]:
        """Return every count by name."""
        return asdict(self)


@dataclass(slots=True)
class Fault:
    """A transform of chunks with its options and counts. Call it on chunks; use it once.

    Attributes:
        kind: name in FAULTS.
        options: every option, defaults filled in.
        counts: its effects so far.
    """

    kind: str
    options: Mapping[str, float]
    rng: np.random.Generator
    counts: FaultCounts = field(default_factory=FaultCounts)

    def __call__(self, chunks: Iterable[Chunk]) -> Iterator[Chunk]:
        """Return the chunks with the fault applied."""
        return FAULTS[self.kind].transform(self, chunks)

    def __str__(self) -> str:
        """Return the text that parses to this fault."""
        return f"{self.kind}:" + ",".join(f"{name}={value:g}" for name, value in self.options.items())


@dataclass(frozen=True, slots=True)
class Option:
    """A numeric option of a fault.

    Attributes:
        default: value when not given.
        low: smallest allowed.
        high: largest allowed.
        text: its meaning.
    """

    default: float
    low: float
    high: float
    text: str


@dataclass(frozen=True, slots=True)
class FaultKind:
    """An entry of the registry.

    Attributes:
        text: its effect, one line.
        options: its options.
        transform: applies it.
    """

    text: str
    options: Mapping[str, Option]
    transform: Callable[[Fault, Iterable[Chunk]], Iterator[Chunk]]


def _flip(fault: Fault, frame: bytes) -> list[bytes]:
    damaged = bytearray(frame)
    bits = fault.rng.choice(8 * len(frame), size=min(int(fault.options["bits"]), 8 * len(frame)), replace=False)
    for bit in bits.tolist():
        damaged[bit >> 3] ^= 1 << (bit & 7)
    fault.counts.bytes_changed += len({bit >> 3 for bit in bits.tolist()})
    return [bytes(damaged)]


def _drop(fault: Fault, frame: bytes) -> list[bytes]:
    lost = int(fault.options["bytes"])
    if lost == 0 or lost >= len(frame):
        fault.counts.bytes_dropped += len(frame)
        return []
    fault.counts.bytes_dropped += lost
    offset = int(fault.rng.integers(len(frame) - lost + 1))
    return [frame[:offset] + frame[offset + lost :]]


def _duplicate(fault: Fault, frame: bytes) -> list[bytes]:
    fault.counts.bytes_added += len(frame)
    return [frame, frame]


def _truncate(fault: Fault, frame: bytes) -> list[bytes]:
    length = int(fault.rng.integers(1, len(frame)))
    fault.counts.bytes_dropped += len(frame) - length
    return [frame[:length]]


def _insert(fault: Fault, frame: bytes) -> list[bytes]:
    junk = fault.rng.bytes(int(fault.options["bytes"]))
    fault.counts.bytes_added += len(junk)
    return [junk, frame]


def _per_frame(change: Callable[[Fault, bytes], list[bytes]]) -> Callable[[Fault, Iterable[Chunk]], Iterator[Chunk]]:
    """Return the transform that changes each whole frame with probability `rate`."""

    def transform(fault: Fault, chunks: Iterable[Chunk]) -> Iterator[Chunk]:
        for link, host_ns, pieces in frame_pieces(chunks):
            parts: list[bytes] = []
            for piece in pieces:
                if piece.whole and _hits(fault):
                    parts += change(fault, piece.data)
                else:
                    parts.append(piece.data)
            yield Chunk(link, host_ns, b"".join(parts))

    return transform


def _hits(fault: Fault) -> bool:
    """Draw whether this frame is hit, and count it."""
    fault.counts.frames_seen += 1
    hit = bool(fault.rng.random() < fault.options["rate"])
    fault.counts.frames_hit += hit
    return hit


def _reorder(fault: Fault, chunks: Iterable[Chunk]) -> Iterator[Chunk]:
    """Hold a frame back until `depth` further frames have passed."""
    depth = int(fault.options["depth"])
    delayed: list[tuple[int, Piece]] = []
    link, host_ns, frame_count = "", 0, 0
    for link, host_ns, pieces in frame_pieces(chunks):
        parts: list[bytes] = []
        for piece in pieces:
            if piece.whole and _hits(fault):
                delayed.append((frame_count + depth, piece))
                continue
            parts.append(piece.data)
            frame_count += piece.whole
            while delayed and delayed[0][0] <= frame_count:
                parts.append(delayed.pop(0)[1].data)
        yield Chunk(link, host_ns, b"".join(parts))
    if delayed:
        yield Chunk(link, host_ns, b"".join(piece.data for _, piece in delayed))


def _split(fault: Fault, chunks: Iterable[Chunk]) -> Iterator[Chunk]:
    """Cut chunks into pieces of at most `size` bytes, or at one random place with size 0."""
    size = int(fault.options["size"])
    for chunk in chunks:
        if len(chunk.data) < 2 or fault.rng.random() >= fault.options["rate"]:
            yield chunk
            continue
        fault.counts.chunks_hit += 1
        first = size or int(fault.rng.integers(1, len(chunk.data)))
        step = size or len(chunk.data)
        yield Chunk(chunk.link, chunk.host_ns, chunk.data[:first])
        for offset in range(first, len(chunk.data), step):
            yield Chunk(chunk.link, chunk.host_ns, chunk.data[offset : offset + step])


def _delay(fault: Fault, chunks: Iterable[Chunk]) -> Iterator[Chunk]:
    """Delay chunks by up to `ms`; later chunks wait, as in a queue."""
    free_ns = -(1 << 63)
    for chunk in chunks:
        host_ns = chunk.host_ns
        if chunk.data and fault.rng.random() < fault.options["rate"]:
            fault.counts.chunks_hit += 1
            host_ns += int(fault.rng.random() * fault.options["ms"] * 1e6)
        free_ns = max(free_ns, host_ns)
        yield Chunk(chunk.link, free_ns, chunk.data)


def _silence(fault: Fault, chunks: Iterable[Chunk]) -> Iterator[Chunk]:
    """Leave out the frames of one kind between two times, as if their sender had not made them."""
    part, wheel = int(fault.options["part"]), int(fault.options["wheel"])
    begin_ns: int | None = None
    unmade: Counter[tuple[str, int, int]] = Counter()
    for link, host_ns, pieces in frame_pieces(chunks):
        begin_ns = host_ns if begin_ns is None else begin_ns
        since_s = (host_ns - begin_ns) * 1e-9 - fault.options["at"]
        is_due = since_s >= 0.0 and (fault.options["for"] == 0.0 or since_s < fault.options["for"])
        parts: list[bytes] = []
        for piece in pieces:
            if not piece.whole:
                parts.append(piece.data)
                continue
            fault.counts.frames_seen += 1
            source = link, piece.data[wire.HUB_OFFSET], piece.data[wire.WHEEL_OFFSET]
            is_meant = part == 0 or wheel in (-1, source[2])
            if is_due and is_meant and not _SPEAKING[part](piece.data):
                fault.counts.frames_hit += 1
                fault.counts.bytes_dropped += len(piece.data)
                unmade[source] += 1
            else:
                parts.append(_renumbered(piece.data, unmade[source]))
        yield Chunk(link, host_ns, b"".join(parts))


def _renumbered(frame: bytes, unmade: int) -> bytes:
    """Return a frame with the counter of a sender that made fewer frames; a signed frame cannot be changed."""
    if not unmade or frame[wire.FLAGS_OFFSET] & wire.SIGNED_FLAG:
        return frame
    sync, version, kind, length, hub, wheel, flags, seq, tick = _HEADER.unpack_from(frame)
    header = _HEADER.pack(sync, version, kind, length, hub, wheel, flags, (seq - unmade) & _MASK, tick)
    body = header + frame[wire.HEADER_BYTES : -wire.CRC_BYTES]
    return body + zlib.crc32(body).to_bytes(wire.CRC_BYTES, "little")


# Frames that still come, by the part that is silent.
_SPEAKING: Final[tuple[Callable[[bytes], bool], ...]] = (
    lambda frame: False,  # noqa: ARG005 - nothing of a silent hub
    lambda frame: frame[wire.WHEEL_OFFSET] == HUB_ITSELF,
    lambda frame: frame[wire.TYPE_OFFSET] != MessageType.SAMPLES,
    lambda frame: frame[wire.TYPE_OFFSET] != MessageType.ENVIRONMENT,
)


def _reboot(fault: Fault, chunks: Iterable[Chunk]) -> Iterator[Chunk]:
    """Restart every hub: a silence, then its hellos with the next boot count, and counters, times and numbers from 0.

    Bytes that are no frame of this version are left as they are.
    """
    lives: dict[tuple[str, int], _Life] = {}
    begin_ns: int | None = None
    silent_until_ns = 0
    due_s, every_s = fault.options["at"], fault.options["every"]
    for link, host_ns, pieces in frame_pieces(chunks):
        begin_ns = host_ns if begin_ns is None else begin_ns
        if host_ns - begin_ns >= due_s * 1e9:
            fault.counts.reboots += 1
            silent_until_ns = host_ns + int(fault.options["gap"] * 1e9)
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
                fault.counts.bytes_dropped += len(piece.data)
            elif frame and life and life.boots:
                parts += _relived(life, frame)
            else:
                parts.append(piece.data)
        yield Chunk(link, host_ns, b"".join(parts))


_RATE: Final = {"rate": Option(0.01, 0.0, 1.0, "share of the frames")}
_CHUNK_RATE: Final = {"rate": Option(1.0, 0.0, 1.0, "share of the chunks")}

# Registry of faults by name.
FAULTS: Final[dict[str, FaultKind]] = {
    "flip": FaultKind(
        "Flip bits in frames.", {**_RATE, "bits": Option(1, 1, 1000, "bits flipped in a frame")}, _per_frame(_flip)
    ),
    "drop": FaultKind(
        "Lose frames, or bytes of frames.",
        {**_RATE, "bytes": Option(0, 0, 244, "consecutive bytes lost of a frame, 0 for all of it")},
        _per_frame(_drop),
    ),
    "duplicate": FaultKind("Deliver frames twice.", _RATE, _per_frame(_duplicate)),
    "reorder": FaultKind(
        "Deliver frames late.", {**_RATE, "depth": Option(3, 1, 1000, "frames that overtake it")}, _reorder
    ),
    "truncate": FaultKind("Cut frames off.", _RATE, _per_frame(_truncate)),
    "insert": FaultKind(
        "Put random bytes between frames.",
        {**_RATE, "bytes": Option(8, 1, 100_000, "bytes put in before a frame")},
        _per_frame(_insert),
    ),
    "split": FaultKind(
        "Cut chunks into pieces.",
        {**_CHUNK_RATE, "size": Option(0, 0, 100_000, "bytes a piece, 0 for one cut at random")},
        _split,
    ),
    "delay": FaultKind(
        "Deliver chunks late.", {**_CHUNK_RATE, "ms": Option(50, 0, 60_000, "at most so much later")}, _delay
    ),
    "reboot": FaultKind(
        "Let the hubs start again: a gap, then counters and times from 0.",
        {
            "at": Option(5, 0, 1e7, "s after the first chunk"),
            "every": Option(0, 0, 1e7, "repeat interval in s, 0 for once"),
            "gap": Option(1, 0, 1000, "s of silence"),
        },
        _reboot,
    ),
    "silence": FaultKind(
        "Let hubs, sensors or a part of their messages fall silent.",
        {
            "part": Option(2, 0, 3, "0 hubs, 1 sensors, 2 samples, 3 environment"),
            "wheel": Option(-1, -1, 254, "number of the wheel, -1 for all; hubs have all of theirs"),
            "at": Option(5, 0, 1e7, "s after the first chunk"),
            "for": Option(0, 0, 1e7, "s, 0 for ever"),
        },
        _silence,
    ),
}


def parse_fault(text: str, seed: Sequence[int] | int = 1) -> Fault:
    """Return the fault of a text such as `flip:rate=0.01` or `drop:rate=0.01,bytes=3`.

    Args:
        text: kind and options.
        seed: of its random numbers; the same text and seed give the same faults.

    Raises:
        ValueError: an unknown kind or option, or a value out of range; the message states what is allowed.
    """
    name, _, options_text = text.strip().partition(":")
    kind = FAULTS.get(name)
    if kind is None:
        raise ValueError(f"one of {', '.join(FAULTS)}, as flip:rate=0.01")
    options = {key: option.default for key, option in kind.options.items()}
    for item in filter(None, (part.strip() for part in options_text.split(","))):
        key, _, value_text = item.partition("=")
        option = kind.options.get(key)
        if option is None:
            raise ValueError(f"{name} has the options {', '.join(kind.options)}, not '{key}'")
        try:
            value = float(value_text)
        except ValueError:
            value = float("nan")
        if not option.low <= value <= option.high:
            raise ValueError(f"{name}: {key} = {option.low:g} to {option.high:g} ({option.text}), not '{value_text}'")
        options[key] = value
    entropy = [seed] if isinstance(seed, int) else list(seed)
    return Fault(name, options, np.random.default_rng([*entropy, zlib.crc32(text.encode())]))


def parse_faults(texts: Iterable[str], seed: int = 1) -> list[Fault]:
    """Return the faults of several texts, each with its own random numbers.

    Raises:
        SourceError: a text is wrong.
    """
    faults = []
    for number, text in enumerate(texts):
        try:
            faults.append(parse_fault(text, (seed, number)))
        except ValueError as error:
            raise SourceError(f"fault '{text}' is invalid; allowed: {error}", describe_faults()) from error
    return faults


def apply_faults(
    faults: Iterable[ChunkTransform], chunks: Iterable[Chunk], *, tells_time: bool = False
) -> Iterator[Chunk]:
    """Return the chunks with every fault applied in turn.

    Args:
        faults: the faults.
        chunks: the chunks.
        tells_time: whether chunks of which faults have left no byte are returned too: time goes on in silence.
    """
    current = iter(chunks)
    for fault in faults:
        current = fault(current)
    return current if tells_time else (chunk for chunk in current if chunk.data)


def describe_faults() -> str:
    """Return one line per kind of fault, for the user."""
    return "\n  ".join(
        f"{name}:{','.join(f'{key}={option.default:g}' for key, option in kind.options.items())}  {kind.text}"
        for name, kind in FAULTS.items()
    )
