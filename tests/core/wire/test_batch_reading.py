"""Batch decoder: outputs other than frames, and ways to feed it."""

import numpy as np
import pytest

from firmware_protocol import wire
from firmware_protocol.block_decoder import BatchDecoder
from firmware_protocol.codec import encode_raw
from firmware_protocol.decoder import FrameDecoder
from firmware_protocol.messages import MessageType, SampleBlock
from tests.core.wire.stream_data import comparable, long_stream, streamed


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
    results: list[int] = []
    for start in range(0, len(data), 3000):
        results += batch.feed(data[start : start + 3000]).end_offset.tolist()
    assert results == expected


def test_blocks_can_be_read_in_place() -> None:
    data = long_stream(3, 300)
    batch = BatchDecoder(4096)
    results: list[tuple[object, ...]] = []
    for start in range(0, len(data), 4096):
        room = batch.writable()
        piece = data[start : start + len(room)]
        room[: len(piece)] = piece
        results += map(comparable, batch.commit(len(piece)).frames())
    results += map(comparable, batch.finish().frames())
    assert (results, batch.counters) == streamed(data, [])


@pytest.mark.parametrize("kind", [bytes, bytearray, memoryview])
def test_any_bytes_like_object_is_accepted(kind: type) -> None:
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
