"""Streams made to be difficult, what either decoder makes of them, and a plain parser."""

import random
import zlib
from collections.abc import Iterator

from hypothesis import strategies as st

from firmware_protocol import wire
from firmware_protocol.block_decoder import BatchDecoder
from firmware_protocol.codec import encode_payload, encode_raw
from firmware_protocol.counters import LinkCounters
from firmware_protocol.decoder import FrameDecoder
from firmware_protocol.messages import Coupling, Environment, Frame, Hello, HubStatus, MessageType, SampleBlock
from firmware_protocol.signing import Gate

HELLO = Hello(1, 0, 1, 2, (1, 0, 0), 1, 9600.0, 7, Coupling.DC, 0.0, (1e3,) * 3, (0.1,) * 3, (0.0,) * 3, 32767)
STATUS = HubStatus(1, 50, 12.0, 1.0, -60, 1, 2, 3, 4)

U8 = st.integers(0, 255)
SOURCES = st.sampled_from([(0, 0), (0, 1), (0, 255), (9, 0)])
# A few counters near each other and near the wrap, so that duplicates, late frames, gaps and restarts all happen.
SEQS = st.sampled_from([0, 1, 2, 3, 4, 5, 70, 71, 2**31, 2**32 - 2, 2**32 - 1])
VERSIONS = st.sampled_from([wire.VERSION_BYTE] * 12 + [0x11, 0x1F, 0x20, 0x00])
FLAGS = st.sampled_from([0] * 10 + [1] * 4 + [2, 3, 0x80])
TAG = b"\xa5\x5a tag.."
FALSE_STARTS = st.sampled_from(
    [
        b"\xa5",
        b"\x5a",
        b"\xa5\x5a",
        b"\xa5\xa5\x5a",
        b"\xa5\x5a\x10\x02",
        b"\xa5\x5a\x00\x00\x05",
        b"\xa5\x5a\x10\x02\xe0",
    ]
)


@st.composite
def framed(draw: st.DrawFn, content: st.SearchStrategy[bytes]) -> bytes:
    """Any intact frame; payloads may hold whole frames, overlapping headers, or break their layout."""
    hub, wheel = draw(SOURCES)
    kind = draw(st.sampled_from(["samples"] * 4 + ["hello", "status", "environment", "log", "bad", "any"]))
    if kind == "samples":
        axes, n = draw(st.sampled_from([(7, 36), (7, 2), (4, 5), (1, 109)]))
        size = 2 * n * axes.bit_count()
        type_ = MessageType.SAMPLES
        payload = bytes((1, 0, 0, 0, axes, n)) + (draw(content) or b"\0").ljust(size, b"\x5a")[:size]
    elif kind == "hello":
        type_, payload = MessageType.HELLO, encode_payload(HELLO._replace(boot_count=draw(st.integers(1, 2))))
    elif kind == "status":
        type_, payload = MessageType.HUB_STATUS, encode_payload(STATUS)
    elif kind == "environment":
        type_, payload = MessageType.ENVIRONMENT, encode_payload(Environment(2e5, 20.0, 3.0))
    elif kind == "log":
        type_, payload = MessageType.LOG_TEXT, b"\1" + draw(content)[:223]
    elif kind == "bad":
        type_, payload = draw(st.sampled_from(MessageType)), draw(st.binary(max_size=8))
    else:
        type_, payload = draw(U8), draw(content)[:224]
    flags = draw(FLAGS)
    if flags & 1 and draw(st.integers(0, 3)):
        payload = payload[:216] + TAG
    return encode_raw(
        type_,
        payload,
        hub,
        wheel,
        draw(SEQS),
        draw(st.integers(0, 2**32 - 1)),
        version=draw(VERSIONS),
        flags=flags,
    )


@st.composite
def damaged(draw: st.DrawFn, content: st.SearchStrategy[bytes]) -> bytes:
    frame = bytearray(draw(framed(content)))
    position = draw(st.integers(0, len(frame) - 1))
    if draw(st.booleans()):
        frame[position] ^= draw(st.integers(1, 255))
    else:
        del frame[position : position + draw(st.integers(1, 60))]
    return bytes(frame)


def joined(pieces: st.SearchStrategy[bytes]) -> st.SearchStrategy[bytes]:
    return st.lists(pieces, max_size=6).map(b"".join)


PLAIN = st.binary(max_size=30) | FALSE_STARTS
NESTED = joined(PLAIN | framed(PLAIN))
PIECES = framed(NESTED) | framed(PLAIN) | damaged(NESTED) | PLAIN
STREAMS = st.lists(PIECES, max_size=12).map(b"".join) | st.lists(FALSE_STARTS, max_size=80).map(b"".join)
CUTS = st.lists(st.integers(0, 3000), max_size=8)


def comparable(frame: Frame) -> tuple[object, ...]:
    message = frame.message
    if isinstance(message, SampleBlock):
        return (*frame[:5], *message[:2], message.counts.shape, message.counts.tobytes())
    return (*frame[:5], message)


def pieces(data: bytes, cuts: list[int]) -> Iterator[bytes]:
    bounds = [0, *sorted(cut % (len(data) + 1) for cut in cuts), len(data)]
    for first, after in zip(bounds, bounds[1:], strict=False):
        yield data[first:after]


def streamed(data: bytes, cuts: list[int], gate: Gate | None = None) -> tuple[list[tuple[object, ...]], LinkCounters]:
    decoder = FrameDecoder(gate)
    frames = [frame for piece in pieces(data, cuts) for frame in decoder.feed(piece)]
    return [comparable(frame) for frame in [*frames, *decoder.finish()]], decoder.counters


def batched(
    data: bytes, cuts: list[int], block_bytes: int, gate: Gate | None = None
) -> tuple[list[tuple[object, ...]], LinkCounters]:
    decoder = BatchDecoder(block_bytes, gate)
    results: list[tuple[object, ...]] = []
    for piece in pieces(data, cuts):
        results += map(comparable, decoder.feed(piece).frames())
    return results + [comparable(frame) for frame in decoder.finish().frames()], decoder.counters


def intact_frames(data: bytes) -> tuple[list[tuple[int, int]], int, int]:
    """The rule of the specification in its own words: intact frames, CRC errors, truncated frames of a stream."""
    result, crc_errors, truncated, offset = [], 0, 0, 0
    while (offset := data.find(wire.SYNC, offset)) >= 0:
        length = data[offset + 4] if offset + 4 < len(data) else None
        if length is not None and length > 224:
            offset += 1
        elif length is None or offset + 20 + length > len(data):
            truncated += 1
            offset += 1
        elif zlib.crc32(data[offset : offset + 16 + length]) != int.from_bytes(
            data[offset + 16 + length : offset + 20 + length], "little"
        ):
            crc_errors += 1
            offset += 1
        else:
            result.append((offset, offset + 20 + length))
            offset += 20 + length
    return result, crc_errors, truncated


def long_stream(seed: int, frames: int, signed_share: float = 0.0) -> bytes:
    """Four wheels and their hub with every kind of damage, long enough for the vectorised paths."""
    rng = random.Random(seed)
    seqs: dict[int, int] = dict.fromkeys((0, 1, 2, 3, 255), rng.choice([0, 2**32 - 40]))
    sent: list[bytes] = []
    boot = 1
    for index in range(frames):
        wheel = index % 4
        step = rng.choices([1, rng.randrange(2, 80), rng.randrange(-70, 1)], [97, 2, 1])[0]
        type_, payload = MessageType.SAMPLES, bytes((0, 0, 0, 0, 7, 36)) + rng.randbytes(216)
        if rng.random() < 0.02:
            payload = bytes((0, 0, 0, 0, 7, 36)) + (rng.choice([b"\xa5\x5a", b"\xa5\x5a\x00\x00\x00\x00"]) * 108)[:216]
        if rng.random() < 0.02:
            wheel = rng.choice([wheel, 255])
            type_, payload = rng.choice(
                [
                    (MessageType.HELLO, encode_payload(HELLO._replace(boot_count=boot))),
                    (MessageType.HUB_STATUS, encode_payload(STATUS)),
                    (MessageType.ENVIRONMENT, encode_payload(Environment(None, None, None))),
                    (MessageType.LOG_TEXT, b"\2" + b"".join(sent[-1:])[:223]),
                    (77, b"unknown"),
                ]
            )
        if rng.random() < 0.001:
            boot, seqs = boot + 1, dict.fromkeys(seqs, 0)
        seqs[wheel] = (seqs[wheel] + step) % 2**32
        signed = signed_share > 0 and rng.random() < signed_share
        payload = payload[:216] + rng.randbytes(8) if signed else payload
        if signed and type_ == MessageType.SAMPLES:
            payload = bytes((0, 0, 0, 0, 7, 35)) + rng.randbytes(218)
        frame = bytearray(encode_raw(type_, payload, 0, wheel, seqs[wheel], index, flags=signed))
        if rng.random() < 0.02:
            frame[rng.randrange(len(frame))] ^= rng.randrange(1, 256)
        if rng.random() < 0.01:
            del frame[: rng.randrange(60)]
        sent.append(bytes(frame) + (rng.randbytes(rng.randrange(30)) if rng.random() < 0.01 else b""))
    return b"".join(sent)
