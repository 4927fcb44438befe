"""Every padded file of the public MCAP conformance set, built as the set describes them: their features and contents.

The set's files are built from six contents and all combinations of features; `pad` adds three bytes to the end of each
record outside chunks but messages, whose data reach to their end, and the footer, which is found from the file's end.
"""

import hashlib
import zlib
from collections.abc import Iterator
from itertools import product
from pathlib import Path
from typing import NamedTuple

import pytest
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Message,
    MessageIndex,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from gateway.core.recording.mcap_records import MAGIC, RECORD_HEAD
from gateway.core.recording.reader import RecordingReader

PADDING = b"\x01\xff\xff"
SCHEMA = Schema(id=1, name="Example", encoding="c", data=b"\x04\x05\x06")
CHANNEL = Channel(id=1, topic="example", message_encoding="a", metadata={"foo": "bar"}, schema_id=1)
SCHEMALESS = Channel(id=1, topic="example", message_encoding="a", metadata={"foo": "bar"}, schema_id=0)
ONE = Message(channel_id=1, sequence=10, publish_time=1, log_time=2, data=b"\x01\x02\x03")
TEN = [
    Message(channel_id=1, sequence=number, publish_time=time, log_time=time, data=b"\x01\x02\x03")
    for number, time in enumerate((0, 2, 1, 3, 3, 5, 4, 7, 8, 9))
]
CONTENTS: dict[str, list[McapRecord]] = {
    "NoData": [],
    "OneAttachment": [
        Attachment(
            log_time=2, create_time=1, name="myFile", media_type="application/octet-stream", data=b"\x01\x02\x03"
        )
    ],
    "OneMetadata": [Metadata(name="myMetadata", metadata={"foo": "bar"})],
    "OneMessage": [SCHEMA, CHANNEL, ONE],
    "OneSchemalessMessage": [SCHEMALESS, ONE],
    "TenMessages": [SCHEMA, CHANNEL, *TEN],
}
# SHA-256 of two files of the set, as its pointers to large files state them.
PUBLISHED = {
    "ch chx mx rch rsh st sum": "54f3c5a0ca350cd4cf6326992926f491178a46aa694686e3781aa19c4255fc88",
    "rch rsh st sum": "a586164671262b2b56b13ff15b5f340257c4c3d343e58b05f79b507de206833d",
}
# Features in the order of the set's names, and those without which others mean nothing.
FEATURES = ("ch", "mx", "st", "rsh", "rch", "ax", "mdx", "chx", "sum")
NEEDS_CHUNKS = {"mx", "chx"}


class Variant(NamedTuple):
    """One file of the set."""

    content: str
    features: frozenset[str]

    def __str__(self) -> str:
        return "-".join((self.content, *sorted(self.features | {"pad"})))


def variants() -> Iterator[Variant]:
    """Yield the padded files: a feature is used where the content has what it is about."""
    for content, records in CONTENTS.items():
        types = {type(record) for record in records}
        about = {
            "ch": Message in types,
            "mx": Message in types,
            "st": True,
            "rsh": Schema in types,
            "rch": Channel in types,
            "ax": Attachment in types,
            "mdx": Metadata in types,
            "chx": Message in types,
            "sum": True,
        }
        usable = [feature for feature in FEATURES if about[feature]]
        for uses in product((False, True), repeat=len(usable)):
            features = frozenset(feature for feature, use in zip(usable, uses, strict=True) if use)
            if not features & NEEDS_CHUNKS or "ch" in features:
                yield Variant(content, features)


def plain(record: McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    return bytes(builder.end())  # type: ignore[no-untyped-call]


def padded(record: McapRecord) -> bytes:
    data = plain(record)
    if isinstance(record, Message):
        return data
    opcode, length = RECORD_HEAD.unpack_from(data)
    return RECORD_HEAD.pack(opcode, length + len(PADDING)) + data[RECORD_HEAD.size :] + PADDING


def chunk_of(records: list[McapRecord]) -> tuple[Chunk, MessageIndex]:
    inner, entries = b"", []
    for record in records:
        if isinstance(record, Message):
            entries.append((record.log_time, len(inner)))
        inner += plain(record)
    times = [time for time, _ in entries]
    return Chunk(
        compression="",
        data=inner,
        message_start_time=min(times),
        message_end_time=max(times),
        uncompressed_crc=zlib.crc32(inner),
        uncompressed_size=len(inner),
    ), MessageIndex(channel_id=1, records=entries)


def conformance_file(variant: Variant) -> bytes:
    """Return the bytes of a padded file."""
    records, features = CONTENTS[variant.content], variant.features
    out = bytearray(MAGIC + padded(Header(profile="", library="")))
    indexes: dict[Opcode, list[McapRecord]] = {}
    if "ch" in features:
        chunk, index = chunk_of(records)
        # Nothing is added to a chunk: its records reach to its end.
        start, stored = len(out), plain(chunk)
        out += stored
        of_messages = padded(index) if "mx" in features else b""
        if "chx" in features:
            indexes[Opcode.CHUNK_INDEX] = [
                ChunkIndex(
                    chunk_length=len(stored),
                    chunk_start_offset=start,
                    compression="",
                    compressed_size=len(chunk.data),
                    message_end_time=chunk.message_end_time,
                    message_index_length=len(of_messages),
                    message_index_offsets={1: len(out)} if of_messages else {},
                    message_start_time=chunk.message_start_time,
                    uncompressed_size=len(chunk.data),
                )
            ]
        out += of_messages
    for record in records if "ch" not in features else ():
        offset, data = len(out), padded(record)
        out += data
        if isinstance(record, Attachment) and "ax" in features:
            of_attachment = AttachmentIndex(
                offset=offset,
                length=len(data),
                log_time=record.log_time,
                create_time=record.create_time,
                data_size=len(record.data),
                name=record.name,
                media_type=record.media_type,
            )
            indexes[Opcode.ATTACHMENT_INDEX] = [of_attachment]
        if isinstance(record, Metadata) and "mdx" in features:
            indexes[Opcode.METADATA_INDEX] = [MetadataIndex(offset=offset, length=len(data), name=record.name)]
    out += padded(DataEnd(data_section_crc=zlib.crc32(out)))
    return bytes(out) + _summary(records, features, indexes, bytes(out)) + MAGIC


def _summary(
    records: list[McapRecord], features: frozenset[str], indexes: dict[Opcode, list[McapRecord]], before: bytes
) -> bytes:
    groups: dict[Opcode, list[McapRecord]] = {}
    if "rsh" in features:
        groups[Opcode.SCHEMA] = [record for record in records if isinstance(record, Schema)]
    if "rch" in features:
        groups[Opcode.CHANNEL] = [record for record in records if isinstance(record, Channel)]
    if "st" in features:
        groups[Opcode.STATISTICS] = [_statistics(records, is_chunked="ch" in features)]
    groups |= indexes
    out, offsets = bytearray(), []
    for opcode, group in groups.items():
        start = len(before) + len(out)
        out += b"".join(map(padded, group))
        offsets.append(SummaryOffset(opcode, start, len(before) + len(out) - start))
    has_summary, offset_start = bool(out), 0
    if "sum" in features and offsets:
        offset_start = len(before) + len(out)
        out += b"".join(map(padded, offsets))
    footer = Footer(summary_start=len(before) if has_summary else 0, summary_offset_start=offset_start, summary_crc=0)
    # The checksum covers the footer up to itself, with its length.
    covered = bytes(out) + plain(footer)[: RECORD_HEAD.size + 16]
    footer.summary_crc = zlib.crc32(covered)
    return bytes(out) + plain(footer)


def _statistics(records: list[McapRecord], *, is_chunked: bool) -> Statistics:
    times = [record.log_time for record in records if isinstance(record, Message)]
    return Statistics(
        attachment_count=sum(isinstance(record, Attachment) for record in records),
        channel_count=sum(isinstance(record, Channel) for record in records),
        channel_message_counts={1: len(times)} if times else {},
        chunk_count=int(is_chunked),
        message_count=len(times),
        message_end_time=max(times, default=0),
        message_start_time=min(times, default=0),
        metadata_count=sum(isinstance(record, Metadata) for record in records),
        schema_count=sum(isinstance(record, Schema) for record in records),
    )


ALL = list(variants())


def test_the_files_are_those_of_the_set() -> None:
    assert len(ALL) == len(set(ALL)) == 220
    for features, digest in PUBLISHED.items():
        data = conformance_file(Variant("TenMessages", frozenset(features.split())))
        assert hashlib.sha256(data).hexdigest() == digest


@pytest.mark.parametrize("content", CONTENTS)
def test_every_padded_file_is_read_whole(tmp_path: Path, content: str) -> None:
    expected = [record for record in CONTENTS[content] if isinstance(record, Message)]
    path = tmp_path / "padded.mcap"
    for variant in ALL:
        if variant.content != content:
            continue
        path.write_bytes(conformance_file(variant))
        reader = RecordingReader(path)
        messages = list(reader.messages())
        assert reader.damage is None, str(variant)
        assert reader.info.finished, str(variant)
        assert [(message.sequence, message.log_time_ns, message.data) for message in messages] == [
            (message.sequence, message.log_time, message.data) for message in expected
        ], str(variant)
        assert reader.notes == [
            (record.name, record.metadata) for record in CONTENTS[content] if isinstance(record, Metadata)
        ], str(variant)
        if variant.features >= {"st", "sum"}:
            with path.open("rb") as file:
                summary = make_reader(file).get_summary()
            assert summary is not None
            assert summary.statistics is not None
            assert summary.statistics.message_count == len(expected), "the format's own library reads it as well"
