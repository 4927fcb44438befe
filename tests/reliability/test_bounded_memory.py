"""Memory that grows with the length of a recording stays small."""

import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.records import ChunkIndex
from mcap.writer import Writer

from gateway.core.links.source import Chunk
from gateway.core.recording.container import _CHUNK_INDEXES, PackedIndexes
from gateway.core.recording.reader import RecordingReader
from gateway.core.recording.writer import RecordingWriter

U64 = st.integers(0, 2**63)


@st.composite
def indexes(draw: st.DrawFn) -> ChunkIndex:
    begin = draw(st.integers(0, 2**60))
    return ChunkIndex(
        message_start_time=draw(U64),
        message_end_time=draw(U64),
        chunk_start_offset=begin,
        chunk_length=draw(U64),
        message_index_offsets={
            channel: begin + draw(st.integers(0, 2**40)) for channel in draw(st.sets(st.integers(0, 65535), max_size=4))
        },
        message_index_length=draw(U64),
        compression="",
        compressed_size=draw(U64),
        uncompressed_size=draw(U64),
    )


@settings(max_examples=30)
@given(st.lists(indexes(), max_size=20), st.integers(1, 80))
def test_packed_indexes_are_lossless(entries: list[ChunkIndex], times: int) -> None:
    packed = PackedIndexes("")
    for entry in entries * times:
        packed.append(entry)
    assert len(packed) == len(entries) * times
    assert list(packed) == entries * times


def test_hour_of_chunks_takes_little_memory() -> None:
    rng = np.random.default_rng(1)
    packed = PackedIndexes("")
    position = 0
    for number in range(36_000):
        size = 26_000 + int(rng.integers(0, 3000))
        offsets = {channel: position + size + 40 * channel for channel in range(1, 8)}
        now_ns = 1_700_000_000_000_000_000 + number * 100_000_000 + int(rng.integers(0, 1_000_000))
        packed.append(ChunkIndex(size, position, "", size - 60, now_ns + 99_000_000, 300, offsets, now_ns, size - 60))
        position += size + 300
    held = sum(map(sys.getsizeof, packed._packs)) + sys.getsizeof(packed._open)
    assert held < 2_000_000


def test_chunk_indexes_of_mcap_are_replaced(tmp_path) -> None:
    """A private attribute of mcap: a version that renames it costs 25 MB per hour, and this test fails."""
    writer = RecordingWriter(tmp_path / "r.mcap", start_ns=0)
    for number in range(3):
        writer.write(Chunk("a:b", number * 200_000_000, b"bytes"))
    packed = getattr(writer._output._writer, _CHUNK_INDEXES, None)
    assert isinstance(packed, PackedIndexes), f"mcap.writer.Writer has no attribute {_CHUNK_INDEXES} that it uses"
    assert len(packed) >= 2
    writer.close()


def test_stock_reader_finds_every_chunk_by_index(tmp_path) -> None:
    path = tmp_path / "r.mcap"
    writer = RecordingWriter(path, start_ns=0)
    for number in range(2000):
        writer.write(Chunk("a:b" if number % 3 else "c:d", number * 60_000_000, b"%d" % number))
    writer.close()
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        assert summary.statistics.chunk_count == len(summary.chunk_indexes) > 900
        late = [message.data for _, _, message in reader.iter_messages(starting_at=1999 * 60_000_000)]
        assert late == [b"1999"]
        assert sum(1 for _ in reader.iter_messages(topics=["/link/c:d/raw"])) == 667


def test_mcap_still_has_the_replaced_index_list(tmp_path) -> None:
    # If a later mcap renames the list, recording still works but memory grows: the replacement must then be adapted.
    assert hasattr(Writer(str(tmp_path / "x.mcap")), "_Writer__chunk_indices")


@pytest.mark.parametrize("speed", [0.2, 1.0, 5.0, 1000.0])
@pytest.mark.parametrize("apart_s", [0, -3600, 3600])
@pytest.mark.parametrize("lag_s", [0, 100])
def test_chunks_are_a_tenth_of_a_second_long(tmp_path, speed, apart_s, lag_s) -> None:
    """Items at `speed` times the clock, their times offset, decoded topics late: still ten chunks per second."""
    begin_ns, second_ns = 1_700_000_000 * 10**9, 10**9
    writer = RecordingWriter(tmp_path / "r.mcap", start_ns=begin_ns)
    seconds, step_ns = 20.0, 20_000_000
    for number in range(round(seconds * second_ns / step_ns)):
        at_ns = begin_ns + number * step_ns
        writer.write(Chunk("a:b", at_ns, bytes(100)))
        writer.write_topic("/log", at_ns - lag_s * second_ns, {"level": "info", "text": "x"})
        writer.tick(begin_ns + apart_s * second_ns + round(number * step_ns / speed))
    clock_s = seconds / speed
    # A chunk ends by either time base; in step they agree, except for the 20 ms between polls.
    assert len(writer._output._writer._Writer__chunk_indices) <= 10.0 / 0.8 * max(seconds, clock_s) + 5
    writer.close()


def test_items_are_written_within_chunk_and_poll(tmp_path) -> None:
    """As in the recording thread: a poll every 20 ms, first waiting items, then the clock; arrivals in bursts."""
    rng = np.random.default_rng(1)
    writer = RecordingWriter(tmp_path / "r.mcap", start_ns=0)
    arrivals_ns = np.unique(np.cumsum(rng.choice([1_000_000, 15_000_000, 90_000_000, 400_000_000], 150)))
    waiting = [Chunk("a:b", int(position), bytes(50)) for position in arrivals_ns]
    taken: list[Chunk] = []
    last_poll_ns = int(arrivals_ns[-1]) + 200_000_000
    for now_ns in range(0, last_poll_ns, 20_000_000):
        while waiting and waiting[0].host_ns <= now_ns:
            taken.append(waiting.pop(0))
            writer.write(taken[-1])
        writer.tick(now_ns)
        held = sum(isinstance(item, Chunk) for item in RecordingReader(writer.path).items())
        assert all(now_ns - item.host_ns < 120_000_000 for item in taken[held:])
    assert held == len(arrivals_ns)
    writer.close()
