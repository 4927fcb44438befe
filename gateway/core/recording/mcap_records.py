"""Parsers of MCAP records that check every field, for the reader and the repair."""

import struct
import zlib
from collections.abc import Iterator
from io import BytesIO
from typing import Any, Final, NamedTuple

from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile, McapError
from mcap.opcode import Opcode
from mcap.records import (
    AttachmentIndex,
    Channel,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    MessageIndex,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from gateway.core.recording.mcap_layout import MAX_RECORD_BYTES, ChannelInfo

MAGIC: Final = b"\x89MCAP0\r\n"
RECORD_HEAD: Final = struct.Struct("<BQ")
MESSAGE_HEAD: Final = struct.Struct("<HIQQ")
CHUNK_HEAD: Final = struct.Struct("<QQQII")
CHUNK_DATA_LENGTH: Final = struct.Struct("<Q")

NO_RECORD: Final = 0
"""Opcode that no record has: what `walk` yields for bytes that are none."""
# Its Python objects take some twenty times as much.
_MAX_SMALL_BYTES: Final = 1 << 20
_LENGTH: Final = struct.Struct("<I")
# Records without content, which a later version of MCAP might have, in one chunk.
_MAX_EMPTY_RECORDS: Final = 1024
_SMALL_RECORDS: Final[dict[int, Any]] = {
    Opcode.HEADER: Header,
    Opcode.FOOTER: Footer,
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.MESSAGE_INDEX: MessageIndex,
    Opcode.CHUNK_INDEX: ChunkIndex,
    Opcode.ATTACHMENT_INDEX: AttachmentIndex,
    Opcode.STATISTICS: Statistics,
    Opcode.METADATA: Metadata,
    Opcode.METADATA_INDEX: MetadataIndex,
    Opcode.SUMMARY_OFFSET: SummaryOffset,
    Opcode.DATA_END: DataEnd,
}


class ChunkParts(NamedTuple):
    """Fields of a chunk record.

    Attributes:
        end_time_ns: log time of its latest message.
        uncompressed_size: size of its records in bytes.
        crc: checksum of the uncompressed records, 0 when not given.
        compression: `zstd`, `lz4` or empty.
        data: the records as stored.
        data_offset: offset of `data` in the record's body.
    """

    end_time_ns: int
    uncompressed_size: int
    crc: int
    compression: str
    data: memoryview
    data_offset: int


class ChunkTooLargeError(ValueError):
    """A chunk that states more content than is read into memory.

    Attributes:
        size_bytes: stated size of its content.
    """

    def __init__(self, size_bytes: int) -> None:
        """Store the size."""
        super().__init__(f"a chunk of {size_bytes} bytes is too large")
        self.size_bytes = size_bytes


class MessageParts(NamedTuple):
    """Fields of a message record."""

    channel: int
    sequence: int
    log_time_ns: int
    publish_time_ns: int
    data: memoryview


def parse_chunk(body: memoryview, *, length: int | None = None) -> ChunkParts:
    """Parse the body of a chunk; `length` is the stated length when the body is cut off.

    Bytes after the records are fields of a later version of MCAP, which readers skip.

    Raises:
        ValueError: the fields contradict each other.
    """
    body_length = len(body) if length is None else length
    if len(body) < CHUNK_HEAD.size:
        raise ValueError("chunk too short")
    start_ns, end_ns, size, crc, name_length = CHUNK_HEAD.unpack_from(body)
    data_offset = CHUNK_HEAD.size + name_length + CHUNK_DATA_LENGTH.size
    if start_ns > end_ns or name_length > 4 or len(body) < data_offset:
        raise ValueError("chunk header is damaged")
    compression = bytes(body[CHUNK_HEAD.size : CHUNK_HEAD.size + name_length])
    (data_length,) = CHUNK_DATA_LENGTH.unpack_from(body, CHUNK_HEAD.size + name_length)
    if compression not in (b"", b"zstd", b"lz4") or data_offset + data_length > body_length:
        raise ValueError("chunk header is damaged")
    if not compression and size != data_length:
        raise ValueError("chunk sizes contradict each other")
    data = body[data_offset : data_offset + data_length]
    return ChunkParts(end_ns, size, crc, compression.decode(), data, data_offset)


def chunk_records(chunk: ChunkParts) -> memoryview:
    """Return a chunk's records, decompressed and checked against its CRC.

    Raises:
        ChunkTooLargeError: it contains more than is read into memory.
        ValueError: the chunk is damaged.
    """
    if chunk.uncompressed_size > MAX_RECORD_BYTES:
        raise ChunkTooLargeError(chunk.uncompressed_size)
    if chunk.compression == "zstd":
        data = _unzstd(chunk.data, chunk.uncompressed_size)
    elif chunk.compression == "lz4":
        data = _unlz4(chunk.data, chunk.uncompressed_size)
    else:
        data = chunk.data
    if len(data) != chunk.uncompressed_size or (chunk.crc and zlib.crc32(data) != chunk.crc):
        raise ValueError("a chunk's checksum is wrong")
    return data


def _unzstd(data: memoryview, size: int) -> memoryview:
    import zstandard

    try:
        # The size stated in the compressed data would be allocated regardless of the limit.
        content_size = zstandard.get_frame_parameters(data).content_size
        if content_size not in (size, zstandard.CONTENTSIZE_UNKNOWN):
            raise ValueError("a compressed chunk states two sizes")
        return memoryview(zstandard.decompress(data, max(size, 1)))
    except zstandard.ZstdError as error:
        raise ValueError("a compressed chunk is damaged") from error


def _unlz4(data: memoryview, size: int) -> memoryview:
    import lz4.frame  # type: ignore[import-untyped]

    try:
        return memoryview(lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size + 1))
    except RuntimeError as error:
        raise ValueError("a compressed chunk is damaged") from error


def walk(data: memoryview) -> Iterator[tuple[int, memoryview]]:
    """Yield (opcode, body) of the records in `data`, in order, and NO_RECORD with the rest where that is none."""
    position = 0
    end = len(data)
    empty = 0
    while position < end:
        record_start, opcode = position, NO_RECORD
        if position + RECORD_HEAD.size <= end:
            opcode, length = RECORD_HEAD.unpack_from(data, position)
            position += RECORD_HEAD.size
            empty += not length
        if opcode == NO_RECORD or length > end - position or empty > _MAX_EMPTY_RECORDS:
            yield NO_RECORD, data[record_start:]
            return
        yield opcode, data[position : position + length]
        position += length


def parse_message(body: memoryview) -> MessageParts:
    """Parse the body of a message.

    Raises:
        ValueError: the body is too short.
    """
    if len(body) < MESSAGE_HEAD.size:
        raise ValueError("message too short")
    channel, sequence, log_time_ns, publish_time_ns = MESSAGE_HEAD.unpack_from(body)
    return MessageParts(channel, sequence, log_time_ns, publish_time_ns, body[MESSAGE_HEAD.size :])


class _WholeFields(ReadDataStream):
    """Fields of a record; `mcap` takes what there is of a text that is cut off."""

    def read(self, length: int) -> bytes:
        data = super().read(length)
        if len(data) != length:
            raise EndOfFile
        return data


def parse_small(opcode: int, body: memoryview, *, exact: bool = False) -> Any:
    """Parse any record other than a message, chunk or attachment with `mcap`.

    Args:
        opcode: type of the record.
        body: its content. Bytes after the last field are fields of a later version of MCAP, which readers skip.
        exact: refuse such bytes, where nothing else says that this is a record.

    Raises:
        ValueError: the type is unknown, a field is damaged or cut off, or the record is very long.
    """
    kind = _SMALL_RECORDS.get(opcode)
    if kind is None:
        raise ValueError(f"unknown record type {opcode:#x}")
    if len(body) > _MAX_SMALL_BYTES:
        raise ValueError("record is too long")
    stream = _WholeFields(BytesIO(body))
    try:
        record = kind.read(stream)
    except (McapError, struct.error, ValueError, MemoryError, OverflowError) as error:
        raise ValueError("record is damaged") from error
    if exact and stream.count != len(body):
        raise ValueError("record does not fill its length")
    return record


def metadata_name(body: memoryview) -> str:
    """Return the name of a metadata record, whose entries are only counted: quicker by far than parsing them.

    Raises:
        ValueError: the body is that of no metadata record.
    """
    try:
        (size,) = _LENGTH.unpack_from(body)
        name = str(body[_LENGTH.size : _LENGTH.size + size], "utf-8")
        position = _LENGTH.size + size
        end = position + _LENGTH.size + _LENGTH.unpack_from(body, position)[0]
        position += _LENGTH.size
        texts = 0
        while position < end:
            position += _LENGTH.size + _LENGTH.unpack_from(body, position)[0]
            texts += 1
    except struct.error as error:
        raise ValueError("metadata are cut off") from error
    if position != end or texts % 2 or end > len(body) or len(body) > _MAX_SMALL_BYTES:
        raise ValueError("metadata do not fill their length")
    return name


def channel_info(channel: Channel) -> ChannelInfo:
    """Return the channel described by a channel record."""
    link = channel.metadata.get("link", "")
    if not link and channel.topic.startswith("/link/") and channel.topic.endswith("/raw"):
        link = channel.topic[len("/link/") : -len("/raw")]
    return ChannelInfo(channel.topic, channel.message_encoding, link)
