"""What of damaged and of later recordings is read: damage is stated in full, and longer records are no damage."""

import struct
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import zstandard
from mcap.opcode import Opcode

from gateway.core.errors import TreadlinkError
from gateway.core.links.reasons import LinkCode
from gateway.core.recording.mcap_layout import link_items
from gateway.core.recording.mcap_records import (
    CHUNK_HEAD,
    MAGIC,
    RECORD_HEAD,
    chunk_records,
    parse_chunk,
    parse_small,
    walk,
)
from gateway.core.recording.reader import RecordingReader
from gateway.core.text.wording import text
from tests.testkit.campaign_recordings import write_recording
from tests.testkit.commands import invoked, run


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    tables = "[sensor]\nrate_hz = 2000\n[motion]\nspeed_kmh = 80\n"
    return write_recording(tmp_path_factory.mktemp("whole") / "whole.mcap", tables, duration_s=12.0)


def changed(whole: Path, path: Path, start: int, size: int) -> Path:
    """Write a copy of a recording with some bytes set to zero."""
    content = bytearray(whole.read_bytes())
    content[start : start + size] = bytes(size)
    path.write_bytes(content)
    return path


def read(reader: RecordingReader) -> int:
    """Return the number of link items that a pass gives."""
    return sum(1 for message in reader.messages() for _ in link_items(message))


def test_the_rest_behind_a_gap_counts(whole: Path, tmp_path: Path) -> None:
    size = whole.stat().st_size
    reader = RecordingReader(changed(whole, tmp_path / "zeros.mcap", size // 4, 60_000))
    read(reader)
    damage = reader.damage
    assert damage is not None
    assert damage.code is LinkCode.RECORDING_PARTS_DAMAGED
    assert damage["at_byte"] <= size // 4
    assert damage["unread_bytes"] + damage["at_byte"] == pytest.approx(size, abs=2000)
    assert damage["size_bytes"] == size
    assert "treadlink repair" in text(damage)


def test_all_damaged_chunks_count(whole: Path, tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    content = bytearray(whole.read_bytes())
    for position in rng.integers(5_000, len(content) - 5_000, 40).tolist():
        content[position] ^= 1
    path = tmp_path / "flip.mcap"
    path.write_bytes(content)
    reader = RecordingReader(path)
    lost = 1.0 - read(reader) / read(RecordingReader(whole))
    assert reader.damage is not None
    assert reader.damage.code is LinkCode.RECORDING_PARTS_DAMAGED
    assert reader.damage["unread_bytes"] / len(content) == pytest.approx(lost, abs=0.1)


def test_a_pass_forgets_the_damage_of_the_one_before(whole: Path, tmp_path: Path) -> None:
    reader = RecordingReader(changed(whole, tmp_path / "zeros.mcap", whole.stat().st_size // 2, 60_000))
    read(reader)
    first = reader.damage
    read(reader)
    assert reader.damage == first


def test_one_damaged_part_keeps_its_own_words(whole: Path, tmp_path: Path) -> None:
    path = tmp_path / "cut.mcap"
    path.write_bytes(whole.read_bytes()[: whole.stat().st_size * 3 // 4])
    reader = RecordingReader(path)
    read(reader)
    assert reader.damage is not None
    assert reader.damage.code is LinkCode.RECORDING_CUT_OFF


def test_export_of_a_file_whose_readable_part_is_empty_names_the_damage(whole: Path, tmp_path: Path) -> None:
    path = changed(whole, tmp_path / "zeros.mcap", 3_000, 60_000)
    result = invoked("export", path, tmp_path / "out.csv")
    assert isinstance(result.exception, TreadlinkError)
    assert "bytes are not read" in str(result.exception)
    assert "treadlink repair" in result.exception.remedy


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


def read_padded(path: Path) -> tuple[RecordingReader, list[object]]:
    reader = RecordingReader(path)
    return reader, list(reader.messages())


@pytest.mark.parametrize("compression", ["", "zstd"])
@pytest.mark.parametrize("opcode", [None, *PADDED])
def test_added_fields_are_skipped(original: Path, tmp_path: Path, opcode: Opcode | None, compression: str) -> None:
    path = tmp_path / "padded.mcap"
    path.write_bytes(
        rewritten(original.read_bytes(), PADDED.__contains__ if opcode is None else opcode.__eq__, compression)
    )
    reader, messages = read_padded(path)
    expected, all_messages = read_padded(original)
    assert reader.damage is None
    assert messages == all_messages
    assert reader.session == expected.session
    assert reader.info.finished
    assert reader.notes == expected.notes


def test_inspect_finds_no_damage(original: Path, tmp_path: Path) -> None:
    path = tmp_path / "padded.mcap"
    path.write_bytes(rewritten(original.read_bytes(), PADDED.__contains__))
    printed = run("inspect", path)
    assert "DAMAGED" not in printed
    assert ", finished" in printed


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
    reader, messages = read_padded(path)
    assert not reader.info.finished
    assert reader.damage is not None
    whole = read_padded(original)[1]
    assert len(messages) > 0.3 * len(whole)
    assert messages == whole[: len(messages)] or messages[:-1] == whole[: len(messages) - 1]
