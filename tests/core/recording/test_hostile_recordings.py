"""Recordings that state or unpack to more than they should; memory is bounded."""

import struct
import tracemalloc
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import lz4.frame
import pytest
import zstandard

from gateway.core.config.vehicle import choose_vehicle
from gateway.core.errors import ConfigError, RecordingError
from gateway.core.links.reasons import LinkCode
from gateway.core.links.source import Chunk
from gateway.core.recording import inspection
from gateway.core.recording import reader as reading
from gateway.core.recording.inspection import inspect_recording
from gateway.core.recording.mcap_layout import MAX_RECORD_BYTES, RAW_ENCODING, SESSION_METADATA, seal
from gateway.core.recording.mcap_records import MAGIC, parse_small, walk
from gateway.core.recording.reader import RecordingReader
from gateway.core.recording.reasons import RecordingCode
from gateway.core.recording.writer import RecordingWriter
from gateway.upkeep import salvage
from gateway.upkeep.repair import repair_recording

NOW_NS = 1_700_000_000_000_000_000
MOST_BYTES = 96 << 20


def record(opcode: int, body: bytes) -> bytes:
    return struct.pack("<BQ", opcode, len(body)) + body


def text(value: str) -> bytes:
    return struct.pack("<I", len(value)) + value.encode()


def table(entries: dict[str, str]) -> bytes:
    body = b"".join(text(key) + text(value) for key, value in entries.items())
    return struct.pack("<I", len(body)) + body


def channel(number: int, topic: str, encoding: str, **entries: str) -> bytes:
    return record(4, struct.pack("<HH", number, 0) + text(topic) + text(encoding) + table(entries))


def message(number: int, data: bytes) -> bytes:
    return record(5, struct.pack("<HIQQ", number, 0, NOW_NS, NOW_NS) + data)


RAW = channel(1, "/link/a/raw", RAW_ENCODING, link="a")
COMPRESSORS: dict[str, Callable[[bytes], bytes]] = {
    "zstd": zstandard.compress,
    "lz4": lz4.frame.compress,
    "": lambda data: data,
}


def chunk(records: bytes, compression: str = "zstd", size: int | None = None) -> bytes:
    stored = COMPRESSORS[compression](records)
    stated = len(records) if size is None else size
    head = struct.pack("<QQQI", NOW_NS, NOW_NS, stated, zlib.crc32(records)) + text(compression)
    return record(6, head + struct.pack("<Q", len(stored)) + stored)


def write(path: Path, *records: bytes) -> Path:
    tail = record(0x0F, bytes(4)) + record(2, bytes(20)) + MAGIC
    path.write_bytes(MAGIC + record(1, text("treadlink") + text("x")) + b"".join(records) + tail)
    return path


@contextmanager
def bounded_memory() -> Iterator[None]:
    tracemalloc.start()
    try:
        yield
        assert tracemalloc.get_traced_memory()[1] < MOST_BYTES
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("compression", ["zstd", "lz4"])
def test_large_compressed_chunk_is_skipped_and_named(tmp_path: Path, compression: str) -> None:
    bomb = chunk(RAW + message(1, bytes(64 << 20)), compression)
    path = write(tmp_path / "r.mcap", bomb, chunk(RAW + message(1, b"after")))
    assert path.stat().st_size < 300_000
    with bounded_memory():
        reader = RecordingReader(path)
        assert [item.data for item in reader.items() if isinstance(item, Chunk)] == [b"after"]
        assert reader.damage is not None
        assert reader.damage.code is RecordingCode.RECORDING_RECORD_TOO_LARGE
        assert reader.damage["largest_bytes"] == MAX_RECORD_BYTES
        inspect_recording(path)
        repair_recording(path, tmp_path / "fixed.mcap")


@pytest.mark.parametrize("compression", ["zstd", "lz4", ""])
def test_largest_chunk_takes_bounded_memory(tmp_path: Path, compression: str) -> None:
    size = MAX_RECORD_BYTES - 1000
    path = write(tmp_path / "r.mcap", *[chunk(RAW + message(1, bytes(size)), compression)] * 3)
    with bounded_memory():
        taken = sum(len(item.data) for item in RecordingReader(path).items() if isinstance(item, Chunk))
        assert taken == 3 * size
        inspect_recording(path)
        repair_recording(path, tmp_path / "fixed.mcap")


@pytest.mark.parametrize("stated", [16, 1 << 20, 1 << 62])
def test_chunk_that_lies_about_its_size_is_damaged(tmp_path: Path, stated: int) -> None:
    path = write(tmp_path / "r.mcap", chunk(RAW + message(1, bytes(8 << 20)), size=stated))
    with bounded_memory():
        reader = RecordingReader(path)
        assert list(reader.items()) == []
        assert reader.damage is not None
        with pytest.raises(RecordingError):
            repair_recording(path, tmp_path / "fixed.mcap")


def test_channels_and_notes_without_end_take_bounded_memory(tmp_path: Path) -> None:
    names = [channel(number, f"/{number}" + "x" * 60_000, "json") for number in range(1, 200)]
    many = [channel(number, f"/link/{number}/raw", RAW_ENCODING, link=str(number)) for number in range(1, 1000)]
    notes = record(0x0C, text("x") + table({f"{number}": "" for number in range(10_000)}))
    path = write(tmp_path / "r.mcap", chunk(b"".join(names)), chunk(b"".join(many)), chunk(notes * 8))
    assert path.stat().st_size < 300_000
    with bounded_memory():
        reader = RecordingReader(path)
        assert list(reader.items()) == []
        assert reader.damage is not None
        assert len(reader.notes) < 8


@pytest.mark.parametrize("filler", [bytes(1 << 20), record(0x70, b"") * 100_000], ids=["zeros", "empty records"])
def test_what_is_no_record_ends_its_chunk_as_damage(
    tmp_path: Path, filler: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write(tmp_path / "r.mcap", chunk(RAW + message(1, b"before") + filler), chunk(message(1, b"after")))
    looked_at = 0

    def counted(data: memoryview) -> Iterator[tuple[int, memoryview]]:
        nonlocal looked_at
        for entry in walk(data):
            looked_at += 1
            yield entry

    monkeypatch.setattr(reading, "walk", counted)
    reader = RecordingReader(path)
    assert [item.data for item in reader.items() if isinstance(item, Chunk)] == [b"before", b"after"]
    assert reader.damage is not None
    assert reader.damage.code is LinkCode.RECORDING_RECORD_DAMAGED
    assert looked_at < 2000


def test_events_of_links_without_end_are_damage(tmp_path: Path) -> None:
    events = [message(3, f'{{"link": "l{number}", "kind": "lost", "text": ""}}'.encode()) for number in range(1000)]
    path = write(tmp_path / "r.mcap", chunk(channel(3, "/link/a/event", "json") + b"".join(events)))
    reader = RecordingReader(path)
    assert len({item.link for item in reader.items()}) == len(inspect_recording(path).events) == 256
    assert reader.damage is not None


def test_repair_does_not_parse_metadata_of_others(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    notes = record(0x0C, text("x") + table({f"{number}": "" for number in range(1000)}))
    path = write(tmp_path / "r.mcap", notes * 20, chunk(RAW + message(1, b"after")))
    parsed: list[int] = []

    def noted(opcode: int, body: memoryview, *, exact: bool = False) -> object:
        parsed.append(opcode)
        return parse_small(opcode, body, exact=exact)

    monkeypatch.setattr(salvage, "parse_small", noted)
    repair_recording(path, tmp_path / "fixed.mcap")
    assert 0x0C not in parsed
    items = list(RecordingReader(tmp_path / "fixed.mcap").items())
    assert [item.data for item in items if isinstance(item, Chunk)] == [b"after"]


def test_inspection_keeps_a_limited_number_of_events(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(inspection, "MAX_EVENTS", 100)
    mark = message(3, b'{"link": "", "kind": "mark", "text": "x"}')
    result = inspect_recording(write(tmp_path / "r.mcap", chunk(channel(3, "/marks", "json") + mark * 250)))
    assert (len(result.events), result.events_omitted) == (100, 150)


def test_unread_records_may_be_large(tmp_path: Path) -> None:
    attachment = record(9, bytes(MAX_RECORD_BYTES + 1))
    path = write(tmp_path / "r.mcap", attachment, chunk(RAW + message(1, b"after")))
    reader = RecordingReader(path)
    with bounded_memory():
        assert [item.data for item in reader.items() if isinstance(item, Chunk)] == [b"after"]
    assert reader.damage is None


def test_long_read_of_a_link_is_yielded_in_parts(tmp_path: Path) -> None:
    data = bytes(range(256)) * (3 << 12)
    items = list(RecordingReader(write(tmp_path / "r.mcap", chunk(RAW + message(1, data)))).items())
    assert [len(item.data) for item in items if isinstance(item, Chunk)] == [1 << 20] * 3
    assert b"".join(item.data for item in items if isinstance(item, Chunk)) == data


def test_short_message_in_a_sound_chunk_is_no_traceback(tmp_path: Path) -> None:
    path = write(tmp_path / "r.mcap", chunk(RAW + record(5, b"short") + message(1, b"after")))
    repair_recording(path, tmp_path / "fixed.mcap")
    items = list(RecordingReader(tmp_path / "fixed.mcap").items())
    assert [item.data for item in items if isinstance(item, Chunk)] == [b"after"]


@pytest.mark.parametrize("toml", ["a = " + "[" * 100_000, "a = " + "9" * 20_000, "[tire]\nradius_mm = 3"])
def test_bad_configuration_inside_a_recording_has_a_remedy(tmp_path: Path, toml: str) -> None:
    path = tmp_path / "r.mcap"
    RecordingWriter(path, start_ns=NOW_NS, vehicle_toml=toml, sources=["x"]).close()
    reader = RecordingReader(path)
    assert reader.vehicle_toml == toml
    with pytest.raises(ConfigError, match=r"r\.mcap: its configuration: ") as caught:
        choose_vehicle(None, [reader.vehicle_toml], str(path))
    assert "--config VEHICLE.toml" in caught.value.remedy


def test_huge_description_is_not_read(tmp_path: Path) -> None:
    entries = seal({"vehicle_toml": "#" * (4 << 20)})
    path = write(tmp_path / "r.mcap", record(0x0C, text(SESSION_METADATA) + table(entries)), chunk(RAW))
    assert RecordingReader(path).vehicle_toml is None
