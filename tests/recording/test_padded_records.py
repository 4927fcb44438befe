"""Records with fields of a later version of MCAP at their ends, which the format asks readers to skip."""

import struct
import zlib
from collections.abc import Callable
from pathlib import Path

import pytest
import zstandard
from click.testing import CliRunner
from mcap.opcode import Opcode

from gateway.cli import treadlink
from gateway.recording.mcap_records import CHUNK_HEAD, MAGIC, RECORD_HEAD, chunk_records, parse_chunk, parse_small, walk
from gateway.recording.reader import RecordingReader
from tests.testkit.campaign_recordings import write_recording

ADDED = bytes(range(1, 14))
# The data of a message reach to its end.
PADDED = [opcode for opcode in Opcode if opcode is not Opcode.MESSAGE]


@pytest.fixture(scope="module")
def original(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("padded") / "drive.mcap"
    return write_recording(path, "[sensor]\nrate_hz = 3200.0", duration_s=1.8)


def record(opcode: int, body: bytes) -> bytes:
    return RECORD_HEAD.pack(opcode, len(body)) + body


def rewritten(data: bytes, padded: Callable[[int], bool], compression: str = "") -> bytes:
    """Return a recording with bytes added to records of some types, also within chunks."""
    out = [MAGIC]
    for opcode, part in walk(memoryview(data)[len(MAGIC) : -len(MAGIC)]):
        body = bytes(part)
        if opcode == Opcode.CHUNK:
            chunk = parse_chunk(part)
            inner = b"".join(
                record(kind, bytes(content) + (ADDED if padded(kind) else b""))
                for kind, content in walk(chunk_records(chunk))
            )
            start_ns, end_ns = CHUNK_HEAD.unpack_from(part)[:2]
            stored = zstandard.compress(inner) if compression else inner
            head = CHUNK_HEAD.pack(start_ns, end_ns, len(inner), zlib.crc32(inner), len(compression))
            body = head + compression.encode() + struct.pack("<Q", len(stored)) + stored
        out.append(record(opcode, body + (ADDED if padded(opcode) else b"")))
    return b"".join((*out, MAGIC))


def read(path: Path) -> tuple[RecordingReader, list[object]]:
    reader = RecordingReader(path)
    return reader, list(reader.messages())


@pytest.mark.parametrize("compression", ["", "zstd"])
@pytest.mark.parametrize("opcode", [None, *PADDED])
def test_added_fields_are_skipped(original: Path, tmp_path: Path, opcode: Opcode | None, compression: str) -> None:
    path = tmp_path / "padded.mcap"
    path.write_bytes(
        rewritten(original.read_bytes(), PADDED.__contains__ if opcode is None else opcode.__eq__, compression)
    )
    reader, messages = read(path)
    expected, all_messages = read(original)
    assert reader.damage is None
    assert messages == all_messages
    assert reader.session == expected.session
    assert reader.info.finished
    assert reader.notes == expected.notes


def test_inspect_finds_no_damage(original: Path, tmp_path: Path) -> None:
    path = tmp_path / "padded.mcap"
    path.write_bytes(rewritten(original.read_bytes(), PADDED.__contains__))
    run = CliRunner().invoke(treadlink, ["inspect", str(path)])
    assert run.exit_code == 0, run.output
    assert "DAMAGED" not in run.output
    assert ", finished" in run.output


def test_every_type_of_record_is_parsed_with_added_bytes_and_not_without_its_end(original: Path) -> None:
    seen = set()
    for opcode, body in walk(memoryview(original.read_bytes())[len(MAGIC) : -len(MAGIC)]):
        if opcode in (Opcode.MESSAGE, Opcode.CHUNK, Opcode.ATTACHMENT):
            continue
        seen.add(opcode)
        longer = memoryview(bytes(body) + ADDED)
        assert parse_small(opcode, longer) == parse_small(opcode, body)
        with pytest.raises(ValueError, match="does not fill"):
            parse_small(opcode, longer, exact=True)
        with pytest.raises(ValueError, match="damaged"):
            parse_small(opcode, body[:-1])
    assert {Opcode.HEADER, Opcode.FOOTER, Opcode.STATISTICS, Opcode.METADATA, Opcode.DATA_END} <= seen


def test_cut_recording_with_added_fields_is_read_to_the_cut(original: Path, tmp_path: Path) -> None:
    path = tmp_path / "cut.mcap"
    data = rewritten(original.read_bytes(), PADDED.__contains__)
    path.write_bytes(data[: len(data) // 2])
    reader, messages = read(path)
    assert not reader.info.finished
    assert reader.damage is not None
    whole = read(original)[1]
    assert len(messages) > 0.3 * len(whole)
    assert messages == whole[: len(messages)] or messages[:-1] == whole[: len(messages) - 1]
