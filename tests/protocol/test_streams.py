"""Streaming and batch decoder against a plain parser, and against each other, on streams made to be difficult."""

import random
import zlib
from collections.abc import Iterator
from unittest import mock

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from firmware_protocol import scan, wire
from firmware_protocol.batch import BatchDecoder
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
    place = draw(st.integers(0, len(frame) - 1))
    if draw(st.booleans()):
        frame[place] ^= draw(st.integers(1, 255))
    else:
        del frame[place : place + draw(st.integers(1, 60))]
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
    found: list[tuple[object, ...]] = []
    for piece in pieces(data, cuts):
        found += map(comparable, decoder.feed(piece).frames())
    return found + [comparable(frame) for frame in decoder.finish().frames()], decoder.counters


def intact_frames(data: bytes) -> tuple[list[tuple[int, int]], int, int]:
    """The rule of the specification in its own words: intact frames, CRC errors, truncated frames of a stream."""
    found, crc_errors, truncated, at = [], 0, 0, 0
    while (at := data.find(wire.SYNC, at)) >= 0:
        length = data[at + 4] if at + 4 < len(data) else None
        if length is not None and length > 224:
            at += 1
        elif length is None or at + 20 + length > len(data):
            truncated += 1
            at += 1
        elif zlib.crc32(data[at : at + 16 + length]) != int.from_bytes(
            data[at + 16 + length : at + 20 + length], "little"
        ):
            crc_errors += 1
            at += 1
        else:
            found.append((at, at + 20 + length))
            at += 20 + length
    return found, crc_errors, truncated


@given(STREAMS, CUTS)
@example(b"\xa5", [])
@example(b"\xa5\x5a\xe1\xe1\xe1", [1, 2, 3, 4])
def test_streaming_finds_what_the_rule_says_however_it_is_cut(data: bytes, cuts: list[int]) -> None:
    expected, crc_errors, truncated = intact_frames(data)
    frames, counters = streamed(data, cuts)
    assert counters.intact == len(expected)
    assert (counters.crc_errors, counters.truncated) == (crc_errors, truncated)
    assert counters.noise_bytes == len(data) - sum(end - start for start, end in expected)
    assert counters.frames == len(frames)
    assert (frames, counters) == streamed(data, list(range(len(data))))


@given(STREAMS, CUTS, CUTS, st.sampled_from([1, 100, 1 << 16]), st.booleans())
@settings(max_examples=500)
def test_batch_equals_streaming(
    data: bytes, cuts: list[int], batch_cuts: list[int], block_bytes: int, always_at_once: bool
) -> None:
    # In streams this short nearly every overlap is above the share at which the batch decoder falls back.
    with mock.patch.object(scan, "_DENSE", 1.0 if always_at_once else scan._DENSE):
        assert batched(data, batch_cuts, block_bytes) == streamed(data, cuts)


class Doorkeeper:
    """A gate with a memory: what it lets through depends on what came before."""

    def __init__(self) -> None:
        self.asked: list[bytes] = []

    def __call__(self, frame: bytes) -> bool:
        self.asked.append(frame)
        return zlib.crc32(b"".join(self.asked[-3:])) % 3 > 0


@given(STREAMS, CUTS, CUTS, st.sampled_from([1, 100, 1 << 16]))
@settings(max_examples=300)
def test_batch_equals_streaming_behind_a_gate(
    data: bytes, cuts: list[int], batch_cuts: list[int], block_bytes: int
) -> None:
    at_stream, at_batch = Doorkeeper(), Doorkeeper()
    frames, counters = streamed(data, cuts, at_stream)
    assert batched(data, batch_cuts, block_bytes, at_batch) == (frames, counters)
    assert at_stream.asked == at_batch.asked
    assert len(at_stream.asked) == counters.intact - counters.other_major


def test_what_a_gate_refuses_leaves_no_trace_in_the_counters() -> None:
    good = [encode_raw(6, b"\1own", 0, 1, seq, seq) for seq in range(4)]
    # Ahead of its time, of another start, and the same counter as a good one: each would cost good frames.
    evil = [encode_raw(6, b"\1evil", 0, 1, 2**31 - 2, 0), encode_raw(6, b"\1evil", 0, 1, 3, 0)]
    evil.append(encode_raw(1, encode_payload(HELLO._replace(boot_count=9)), 0, 1, 5, 0))
    data = b"".join([good[0], evil[0], good[1], evil[1], good[2], evil[2], good[3]])
    for frames, counters in (
        streamed(data, [], lambda frame: b"own" in frame),
        batched(data, [], 1 << 10, lambda frame: b"own" in frame),
    ):
        assert [frame[3] for frame in frames] == [0, 1, 2, 3]
        assert counters.refused == 3
        assert (counters.lost, counters.duplicates, counters.restarts, counters.reordered) == (0, 0, 0, 0)


def test_a_tag_without_room_is_no_sample_block() -> None:
    for length in range(9):
        for axes_n in (b"\x08\x01", b"\x07\x00"):
            data = encode_raw(2, (bytes(4) + axes_n + bytes(3))[:length], 0, 0, 0, 0, flags=1)
            assert batched(data * 2, [], 100) == streamed(data * 2, [])


@pytest.mark.parametrize("dense", [1.0, scan._DENSE])
@pytest.mark.parametrize("break_outer", [False, True])
def test_a_frame_that_begins_inside_another_and_ends_behind_it(dense: float, break_outer: bool) -> None:
    last = encode_raw(6, bytes(9), 0, 1, 0, 0)
    header = bytearray(encode_raw(6, bytes(4 + len(last)), 0, 5, 0, 0)[:16])
    outer = bytearray(encode_raw(6, b"\0" + header, 0, 0, 0, 0))
    crossing = bytes(header) + bytes(outer[-4:]) + last
    outer[16] ^= break_outer
    data = bytes(outer) + last + zlib.crc32(crossing).to_bytes(4, "little")
    with mock.patch.object(scan, "_DENSE", dense):
        frames, counters = batched(data, [], 1 << 10)
        assert (frames, counters) == streamed(data, [])
    assert [frame[2] for frame in frames] == ([5] if break_outer else [0, 1])
    assert counters.crc_errors == break_outer


@given(STREAMS, CUTS, st.sampled_from([0x5A, 0xA5, 0xFF]))
@example(b"\xa5\x5a\x00\xa5", [], 0x5A)
@example(b"\xa5\x5a\x10\x02", [], 0xFF)
def test_bytes_of_blocks_before_do_not_matter(data: bytes, cuts: list[int], filling: int) -> None:
    stream, batch = FrameDecoder(), BatchDecoder(4096)
    before = bytes([filling]) * 3000 + bytes(2)
    stream.feed(before)
    batch.feed(before)
    for piece in pieces(data, cuts):
        assert list(map(comparable, batch.feed(piece).frames())) == list(map(comparable, stream.feed(piece)))
        assert batch.counters == stream.counters
    assert list(map(comparable, batch.finish().frames())) == list(map(comparable, stream.finish()))
    assert batch.counters == stream.counters


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


@pytest.mark.parametrize("seed", range(12))
def test_batch_equals_streaming_on_long_streams(seed: int) -> None:
    data = long_stream(seed, 1500, signed_share=seed % 3 * 0.4)
    expected = streamed(data, [])
    assert expected[1].frames > 1000
    assert expected[1].crc_errors > 5
    rng = random.Random(seed)
    assert batched(data, [], 1 << 20) == expected
    assert batched(data, [rng.randrange(len(data)) for _ in range(9)], 1 << 12) == expected


@pytest.mark.parametrize(
    "unit",
    [
        b"\xa5\x5a",
        b"\xa5\x5a\x00\x00\x00",
        b"\xa5\x5a\x10\x02\xe0",
        b"\xa5\x5a\x00\x00" + bytes(16),
        b"\xa5",
        encode_raw(6, b"\0" + (b"\xa5\x5a\x00\x00\x00" * 44)[:200], 0, 0, 0, 0),
        encode_raw(6, b"\0" + encode_raw(6, b"\0" + encode_raw(3, bytes(8), 0, 0, 1, 1), 0, 0, 2, 2), 0, 0, 0, 0),
        encode_raw(200, b"", 3, 3, 0, 0),
    ],
    ids=["sync only", "linked", "longest", "empty", "half syncs", "headers inside", "frames inside", "unknown"],
)
def test_batch_equals_streaming_on_hostile_repetition(unit: bytes) -> None:
    data = (unit * 6000)[:20000]
    assert batched(data, [777, 4000], 1 << 14) == streamed(data, [5000])


def test_both_decoders_go_on_after_finish() -> None:
    first, second = long_stream(1, 60)[:-100], long_stream(2, 60)
    stream, batch = FrameDecoder(), BatchDecoder()
    for data in (first, second):
        expected = [comparable(frame) for frame in stream.feed(data) + stream.finish()]
        found = [comparable(frame) for part in (batch.feed, lambda _: batch.finish()) for frame in part(data).frames()]
        assert found == expected
    assert batch.counters == stream.counters


def test_sample_groups_hold_every_delivered_sample_per_wheel() -> None:
    data = long_stream(5, 800)
    batch = BatchDecoder().feed(data)
    frames = list(batch.frames())
    groups = batch.sample_groups()
    assert [group.wheel for group in groups] == [0, 1, 2, 3]
    assert sum(len(group.counts) for group in groups) == sum(frame.type == MessageType.SAMPLES for frame in frames)
    for group in groups:
        assert group.counts.dtype == np.int16
        assert group.counts.shape == (len(group.frame_index), 36, 3)
        for index, counts, first, tick in zip(
            group.frame_index, group.counts, group.first_sample, group.tick_us, strict=True
        ):
            frame = frames[index]
            assert isinstance(frame.message, SampleBlock)
            assert (frame.hub, frame.wheel, frame.tick_us) == (group.hub, group.wheel, tick)
            assert frame.message.first_sample == first
            assert np.array_equal(frame.message.counts, counts)


def test_groups_of_mixed_shapes_are_kept_apart() -> None:
    blocks = [(7, 36), (4, 109), (7, 10), (7, 36)]
    data = b"".join(
        encode_raw(2, bytes((seq, 0, 0, 0, axes, n)) + bytes(2 * n * axes.bit_count()), 1, 2, seq, seq)
        for seq, (axes, n) in enumerate(blocks)
    )
    groups = BatchDecoder().feed(data).sample_groups()
    assert {(group.axes, group.counts.shape[1]): group.first_sample.tolist() for group in groups} == {
        (7, 36): [0, 3],
        (4, 109): [1],
        (7, 10): [2],
    }


@pytest.mark.parametrize("block_bytes", [100, 1 << 16])
def test_end_offsets_are_places_in_the_whole_stream(block_bytes: int) -> None:
    data = long_stream(7, 200)
    expected = []
    decoder = FrameDecoder()
    for end in range(1, len(data) + 1):
        expected += [end] * len(decoder.feed(data[end - 1 : end]))
    batch = BatchDecoder(block_bytes)
    found: list[int] = []
    for start in range(0, len(data), 3000):
        found += batch.feed(data[start : start + 3000]).end_offset.tolist()
    assert found == expected


def test_blocks_can_be_read_in_place() -> None:
    data = long_stream(3, 300)
    batch = BatchDecoder(4096)
    found: list[tuple[object, ...]] = []
    for start in range(0, len(data), 4096):
        room = batch.writable()
        piece = data[start : start + len(room)]
        room[: len(piece)] = piece
        found += map(comparable, batch.commit(len(piece)).frames())
    found += map(comparable, batch.finish().frames())
    assert (found, batch.counters) == streamed(data, [])


@pytest.mark.parametrize("kind", [bytes, bytearray, memoryview])
def test_any_bytes_like_is_taken(kind: type) -> None:
    data = long_stream(4, 40)
    expected = streamed(data, [])[0]
    stream, batch = FrameDecoder(), BatchDecoder()
    halves = [kind(data[:1000]), kind(data[1000:])]
    assert [comparable(frame) for half in halves for frame in stream.feed(half)] == expected[: stream.counters.frames]
    assert [comparable(frame) for half in halves for frame in batch.feed(half).frames()] == expected[
        : stream.counters.frames
    ]


def test_memory_stays_bounded_by_one_frame() -> None:
    stream = FrameDecoder()
    for _ in range(100):
        stream.feed(b"\xa5\x5a\x10\x02\xe0" * 400)
        assert stream.pending_bytes < wire.MAX_FRAME_BYTES
    stream.feed(bytes(10000))
    assert stream.pending_bytes == 0
