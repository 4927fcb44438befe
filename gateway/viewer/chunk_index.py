"""Chunks of a recording by time, and a recording of which only some chunks are read."""

from __future__ import annotations

import os
import struct
from collections.abc import Generator, Iterator
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO, Final, NamedTuple

import numpy as np
from mcap.opcode import Opcode
from numpy.typing import NDArray

from gateway.core.recording.mcap_layout import (
    CHANNEL_METADATA,
    MAX_CHANNELS,
    ChannelInfo,
    RecordedMessage,
    declared_channel,
)
from gateway.core.recording.mcap_records import MAGIC, RECORD_HEAD, channel_info, parse_small, walk
from gateway.core.recording.reader import RecordingReader
from gateway.core.recording.regular_file import open_recording_file

_TIMES: Final = struct.Struct("<QQ")
_INDEX: Final = struct.Struct("<QQQQ")
_FOOTER: Final = struct.Struct("<QQI")
_LARGEST_SUMMARY_BYTES: Final = 1 << 28
_LARGEST_SMALL_BYTES: Final = 1 << 20
_LATEST_NS: Final = (1 << 62) - 1


class ChunkIndex(NamedTuple):
    """Chunks in the order of the file, those without a message left out.

    Attributes:
        channels: by number, as the file declares them outside its chunks.
        offset: (n,) begin of each in the file.
        length: (n,) bytes of each.
        begin_ns: (n,) time of its earliest message.
        end_ns: (n,) time of its latest message.
    """

    channels: dict[int, ChannelInfo]
    offset: NDArray[np.int64]
    length: NDArray[np.int64]
    begin_ns: NDArray[np.int64]
    end_ns: NDArray[np.int64]

    def between(self, begin_ns: int, end_ns: int) -> NDArray[np.intp]:
        """Return the chunks with messages from one time to another."""
        return np.flatnonzero((self.end_ns >= begin_ns) & (self.begin_ns <= end_ns))


def chunk_index(path: Path) -> ChunkIndex:
    """Return the chunks of a recording: by its own index, else by the heads of its records.

    Raises:
        RecordingError: the file cannot be read.
    """
    channels: dict[int, ChannelInfo] = {}
    with open_recording_file(path) as file:
        size = os.fstat(file.fileno()).st_size
        rows = list(_indexed(file, size, channels)) or list(_walked(file, size, channels))
    valid_rows = [row for row in rows if row[0] <= row[1] and 0 < row[1] <= _LATEST_NS and row[2] + row[3] <= size]
    begin_ns, end_ns, offset, length = np.array(valid_rows, np.int64).reshape(-1, 4).T
    return ChunkIndex(channels, offset, length, begin_ns, end_ns)


def _indexed(file: BinaryIO, size: int, channels: dict[int, ChannelInfo]) -> Iterator[tuple[int, ...]]:
    """Yield begin, end, offset and length of each chunk by the file's summary; nothing where it has none."""
    position = size - len(MAGIC) - _FOOTER.size
    file.seek(max(position - RECORD_HEAD.size, 0))
    head = file.read(RECORD_HEAD.size)
    if head != RECORD_HEAD.pack(Opcode.FOOTER, _FOOTER.size):
        return
    summary_offset, _, _ = _FOOTER.unpack(file.read(_FOOTER.size))
    if not summary_offset or not 0 < position - summary_offset <= _LARGEST_SUMMARY_BYTES:
        return
    file.seek(summary_offset)
    for opcode, body in walk(memoryview(file.read(position - RECORD_HEAD.size - summary_offset))):
        if opcode == Opcode.CHUNK_INDEX and len(body) >= _INDEX.size:
            yield _INDEX.unpack_from(body)
        elif opcode == Opcode.CHANNEL:
            _declare(opcode, body, channels)


def _walked(file: BinaryIO, size: int, channels: dict[int, ChannelInfo]) -> Iterator[tuple[int, ...]]:
    """Yield the same by the heads of the records, as of a recording that is not finished."""
    position = len(MAGIC)
    while position + RECORD_HEAD.size + _TIMES.size <= size:
        file.seek(position)
        opcode, length = RECORD_HEAD.unpack(file.read(RECORD_HEAD.size))
        end = position + RECORD_HEAD.size + length
        if opcode in (Opcode.DATA_END, 0) or opcode >= 0x80:
            return
        if opcode == Opcode.CHUNK:
            yield *_TIMES.unpack(file.read(_TIMES.size)), position, min(end, size) - position
        elif opcode in (Opcode.CHANNEL, Opcode.METADATA) and length <= _LARGEST_SMALL_BYTES:
            _declare(opcode, memoryview(file.read(length)), channels)
        position = end


def _declare(opcode: int, body: memoryview, channels: dict[int, ChannelInfo]) -> None:
    with suppress(ValueError):
        record = parse_small(opcode, body)
        declared: tuple[int, ChannelInfo] | None = None
        if opcode == Opcode.CHANNEL:
            declared = record.id, channel_info(record)
        elif record.name == CHANNEL_METADATA:
            declared = declared_channel(record.metadata)
        if declared is not None and len(channels) < MAX_CHANNELS:
            channels.setdefault(*declared)


class RecordedPart(RecordingReader):
    """Some chunks of a recording, read as a recording."""

    def __init__(self, path: Path, index: ChunkIndex, chosen: NDArray[np.intp]) -> None:
        """Choose chunks; errors as for the recording."""
        super().__init__(path)
        self._index, self._chosen = index, chosen

    def messages(self) -> Generator[RecordedMessage, None, None]:
        """Yield the messages of the chunks in file order."""
        self._forget_damage()
        self._channels, self._links = dict(self._index.channels), set()
        with open_recording_file(self.info.path) as file:
            for number in self._chosen.tolist():
                offset, length = int(self._index.offset[number]), int(self._index.length[number])
                self.position = file.seek(offset)
                for opcode, record_length, body in self._records(file, offset + length):
                    yield from self._record_messages(opcode, record_length, memoryview(body))
