"""The index of a recording's chunks, kept small while it grows: ten chunks a second for as long as a recording runs."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from typing import Final

from mcap.records import ChunkIndex

_NUMBERS: Final = struct.Struct("<7QH")
_OFFSET: Final = struct.Struct("<HQ")
# Neighbouring entries are alike, so packs of them compress well; one pack is open.
_PACK_ENTRIES: Final = 512


class PackedIndexes:
    """A list of chunk indexes, appended to and gone through once; an entry takes some 45 bytes instead of 700."""

    def __init__(self, compression: str) -> None:
        """Make an empty list of chunks that are all compressed alike."""
        self._compression = compression
        self._packs: list[bytes] = []
        self._open = bytearray()
        self._count = 0

    def __len__(self) -> int:
        """Return the number of entries."""
        return self._count

    def append(self, index: ChunkIndex) -> None:
        """Append an entry."""
        self._open += _NUMBERS.pack(
            index.message_start_time,
            index.message_end_time,
            index.chunk_start_offset,
            index.chunk_length,
            index.message_index_length,
            index.compressed_size,
            index.uncompressed_size,
            len(index.message_index_offsets),
        )
        for channel, offset in index.message_index_offsets.items():
            # Relative to the chunk, so that neighbours look alike.
            self._open += _OFFSET.pack(channel, offset - index.chunk_start_offset)
        self._count += 1
        if self._count % _PACK_ENTRIES == 0:
            self._packs.append(zlib.compress(self._open, 6))
            self._open.clear()

    def __iter__(self) -> Iterator[ChunkIndex]:
        """Yield the entries in order."""
        for pack in self._packs:
            yield from self._entries(zlib.decompress(pack))
        yield from self._entries(bytes(self._open))

    def _entries(self, pack: bytes) -> Iterator[ChunkIndex]:
        at = 0
        while at < len(pack):
            start, end, begin, length, index_length, compressed, uncompressed, count = _NUMBERS.unpack_from(pack, at)
            at += _NUMBERS.size
            offsets = {}
            for _ in range(count):
                channel, offset = _OFFSET.unpack_from(pack, at)
                offsets[channel] = begin + offset
                at += _OFFSET.size
            yield ChunkIndex(
                message_start_time=start,
                message_end_time=end,
                chunk_start_offset=begin,
                chunk_length=length,
                message_index_offsets=offsets,
                message_index_length=index_length,
                compression=self._compression,
                compressed_size=compressed,
                uncompressed_size=uncompressed,
            )
