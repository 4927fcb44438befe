"""Streaming and batch decoder against a plain parser, and against each other, on streams made to be difficult."""

import random
import zlib
from unittest import mock

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from firmware_protocol import block_scan as scan
from firmware_protocol.block_decoder import BatchDecoder
from firmware_protocol.codec import encode_payload, encode_raw
from firmware_protocol.decoder import FrameDecoder
from tests.core.wire.stream_data import (
    CUTS,
    HELLO,
    STREAMS,
    batched,
    comparable,
    intact_frames,
    long_stream,
    pieces,
    streamed,
)


@given(STREAMS, CUTS)
@example(b"\xa5", [])
@example(b"\xa5\x5a\xe1\xe1\xe1", [1, 2, 3, 4])
def test_streaming_equals_the_framing_rule_for_any_split(data: bytes, cuts: list[int]) -> None:
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


def test_rejected_frames_do_not_touch_the_source_counters() -> None:
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


def test_frame_too_short_for_tag_is_rejected() -> None:
    for length in range(9):
        for axes_n in (b"\x08\x01", b"\x07\x00"):
            data = encode_raw(2, (bytes(4) + axes_n + bytes(3))[:length], 0, 0, 0, 0, flags=1)
            assert batched(data * 2, [], 100) == streamed(data * 2, [])


@pytest.mark.parametrize("dense", [1.0, scan._DENSE])
@pytest.mark.parametrize("break_outer", [False, True])
def test_overlapping_frames(dense: float, break_outer: bool) -> None:
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
def test_blocks_do_not_depend_on_earlier_bytes(data: bytes, cuts: list[int], filling: int) -> None:
    stream, batch = FrameDecoder(), BatchDecoder(4096)
    before = bytes([filling]) * 3000 + bytes(2)
    stream.feed(before)
    batch.feed(before)
    for piece in pieces(data, cuts):
        assert list(map(comparable, batch.feed(piece).frames())) == list(map(comparable, stream.feed(piece)))
        assert batch.counters == stream.counters
    assert list(map(comparable, batch.finish().frames())) == list(map(comparable, stream.finish()))
    assert batch.counters == stream.counters


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


def test_both_decoders_continue_after_finish() -> None:
    first, second = long_stream(1, 60)[:-100], long_stream(2, 60)
    stream, batch = FrameDecoder(), BatchDecoder()
    for data in (first, second):
        expected = [comparable(frame) for frame in stream.feed(data) + stream.finish()]
        results = [
            comparable(frame) for part in (batch.feed, lambda _: batch.finish()) for frame in part(data).frames()
        ]
        assert results == expected
    assert batch.counters == stream.counters
