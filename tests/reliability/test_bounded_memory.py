"""What grows with the length of a recording stays small."""

from __future__ import annotations

import sys

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.records import ChunkIndex
from mcap.writer import Writer

from gateway.io.source import Chunk
from gateway.recording.chunk_index import PackedIndexes
from gateway.recording.writer import RecordingWriter

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


@settings(max_examples=30, deadline=None)
@given(st.lists(indexes(), max_size=20), st.integers(1, 80))
def test_packed_indexes_come_back_as_they_were(entries: list[ChunkIndex], times: int) -> None:
    packed = PackedIndexes("")
    for entry in entries * times:
        packed.append(entry)
    assert len(packed) == len(entries) * times
    assert list(packed) == entries * times


def test_an_hour_of_chunks_takes_little_memory() -> None:
    rng = np.random.default_rng(1)
    packed = PackedIndexes("")
    at = 0
    for number in range(36_000):
        size = 26_000 + int(rng.integers(0, 3000))
        offsets = {channel: at + size + 40 * channel for channel in range(1, 8)}
        now_ns = 1_700_000_000_000_000_000 + number * 100_000_000 + int(rng.integers(0, 1_000_000))
        packed.append(ChunkIndex(size, at, "", size - 60, now_ns + 99_000_000, 300, offsets, now_ns, size - 60))
        at += size + 300
    held = sum(map(sys.getsizeof, packed._packs)) + sys.getsizeof(packed._open)
    assert held < 2_000_000


def test_the_stock_reader_finds_every_chunk_by_the_index(tmp_path) -> None:
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


def test_mcap_still_keeps_its_indexes_where_they_are_replaced(tmp_path) -> None:
    # Should a later mcap rename the list, recording goes on but memory grows: then this must be looked at again.
    assert hasattr(Writer(str(tmp_path / "x.mcap")), "_Writer__chunk_indices")
