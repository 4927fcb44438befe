"""Recordings read back unchanged, in every state of the file."""

import contextlib
import errno
import json
import os
import re
from collections.abc import Callable
from io import FileIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.exceptions import EndOfFile
from mcap.reader import make_reader
from mcap.records import Message
from mcap.stream_reader import StreamReader

from gateway.core.errors import RecordingError
from gateway.core.links.source import Chunk, LinkEvent, LinkEventKind, LinkItem
from gateway.core.recording import container
from gateway.core.recording.mcap_layout import MARKS_TOPIC, event_topic, raw_topic
from gateway.core.recording.reader import RecordingReader
from gateway.core.recording.schemas import TOPICS, schema_of
from gateway.core.recording.writer import RecordingWriter, whole_recording
from gateway.core.text.wording import text
from tests.core.recording import streams

LINK = "serial:/dev/ttyUSB0"


def some_items(count: int = 300) -> list[LinkItem]:
    rng = np.random.default_rng(3)
    items: list[LinkItem] = [*streams.chunks(rng, b"".join(streams.frames(rng, count)), LINK)]
    items[5:5] = streams.some_events(LINK)
    return items


LINKS = st.sampled_from(["a", "tcp:h:1", "ble:x/y"])
TIMES = st.integers(0, 2**62)
CHUNKS = st.builds(Chunk, LINKS, TIMES, st.binary(min_size=1, max_size=300))
EVENTS = st.builds(LinkEvent, LINKS, TIMES, st.sampled_from(LinkEventKind), st.text())
ITEMS = st.lists(CHUNKS | EVENTS, max_size=40)


@settings(max_examples=60)
@given(items=ITEMS)
def test_items_read_back_unchanged(tmp_path_factory: pytest.TempPathFactory, items: list[LinkItem]) -> None:
    path = tmp_path_factory.mktemp("any") / "r.mcap"
    streams.write(path, items)
    reader = RecordingReader(path)
    assert list(reader.items()) == items
    assert reader.damage is None
    assert list(reader.items()) == items, "a second pass must give the same"


def test_description_reads_back(tmp_path: Path) -> None:
    info = RecordingReader(streams.write(tmp_path / "r.mcap", some_items()).path).info
    assert info.finished
    assert info.start_ns == streams.START_NS
    assert info.sources == ("sim:test",)
    assert info.vehicle_toml == streams.TOML
    assert info.size_bytes == (tmp_path / "r.mcap").stat().st_size
    assert info.treadlink


def test_stock_reader_finds_bytes_topics_and_metadata(tmp_path: Path) -> None:
    items = some_items()
    path = streams.write(tmp_path / "r.mcap", items, topics=True).path
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        raw = b"".join(message.data for _, _, message in reader.iter_messages([raw_topic(LINK)], log_time_order=False))
        rows = [json.loads(message.data) for _, _, message in reader.iter_messages(["/wheel/FL/revolution"])]
        channels = {channel.topic: channel for channel in reader.get_summary().channels.values()}
        schemas = {schema.name: schema for schema in reader.get_summary().schemas.values()}
        names = [metadata.name for metadata in reader.iter_metadata()]
    assert raw == streams.link_bytes(items)
    assert rows[0] == {"index": 3, "speed_mps": 25.0, "Bs": 3e-3, "Bs_std": 1e-5}
    assert set(channels) == {
        raw_topic(LINK), event_topic(LINK), MARKS_TOPIC, "/wheel/FL/revolution", "/wheel/FL/waveform",
    }  # fmt: skip
    assert channels["/wheel/FL/revolution"].message_encoding == "json"
    assert schemas["treadlink.Revolution"].encoding == "jsonschema"
    assert json.loads(schemas["treadlink.Waveform"].data)["properties"]["theta_rad"]["type"] == "array"
    assert "treadlink" in names


def test_stock_stream_reader_reads_an_unfinished_file(tmp_path: Path) -> None:
    items = some_items()
    writer = streams.write(tmp_path / "r.mcap", items, finish=False)
    writer.tick(items[-1].host_ns + 10**9)
    got = []
    with writer.path.open("rb") as file, contextlib.suppress(EndOfFile):
        for record in StreamReader(file, validate_crcs=True).records:
            if isinstance(record, Message) and record.channel_id == 1:
                got.append(record.data)  # noqa: PERF401 - what came before the end counts
    assert b"".join(got) == streams.link_bytes(items)
    assert not RecordingReader(writer.path).info.finished
    assert streams.read(writer.path) == items
    writer.close()
    assert streams.read(writer.path) == items


def test_items_are_written_within_100_ms(tmp_path: Path) -> None:
    writer = RecordingWriter(tmp_path / "r.mcap", start_ns=0)
    items = [Chunk("a", number * 7_000_000, bytes([number % 256])) for number in range(1, 500)]
    for item in items:
        writer.write(item)
        on_disk = streams.read(writer.path)
        assert on_disk == items[: len(on_disk)]
        assert item.host_ns - (on_disk[-1].host_ns if on_disk else 0) <= 100_000_000
    writer.write(Chunk("a", items[-1].host_ns + 1, b"quiet"))
    writer.tick(items[-1].host_ns + 100_000_000)
    assert streams.read(writer.path)[-1] == Chunk("a", items[-1].host_ns + 1, b"quiet")
    writer.close()


def test_existing_file_is_not_overwritten(tmp_path: Path) -> None:
    path = tmp_path / "r.mcap"
    path.write_bytes(b"precious")
    with pytest.raises(RecordingError, match="already exists"):
        RecordingWriter(path, start_ns=0)
    assert path.read_bytes() == b"precious"


def test_folder_gets_names_from_the_start_time(tmp_path: Path) -> None:
    names = []
    for _ in range(3):
        writer = RecordingWriter(tmp_path, start_ns=streams.START_NS)
        writer.close()
        names.append(writer.path.name)
    stem = "treadlink-20241121T004640Z"
    assert names == [f"{stem}.mcap", f"{stem}-2.mcap", f"{stem}-3.mcap"]


def test_missing_folder_is_reported_with_a_remedy(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="does not exist") as caught:
        RecordingWriter(tmp_path / "gone" / "r.mcap", start_ns=0)
    assert "mkdir -p" in caught.value.remedy


def test_deleted_folder_is_reported(tmp_path: Path) -> None:
    (tmp_path / "d").mkdir()
    writer = RecordingWriter(tmp_path / "d" / "r.mcap", start_ns=0)
    writer.path.unlink()
    (tmp_path / "d").rmdir()
    with pytest.raises(RecordingError, match="deleted while it was written") as caught:
        writer.write(Chunk("a", 200_000_000, b"x"))
    assert caught.value.remedy
    with pytest.raises(RecordingError):
        writer.write(Chunk("a", 300_000_000, b"x"))
    writer.close()


def broken_off(
    path: Path, monkeypatch: pytest.MonkeyPatch, broken: Callable[[Any], object], message: str
) -> tuple[list[LinkItem], RecordingReader]:
    """Write on after a recording's file was replaced by a broken one; return what was written before, and the reader.

    The writer has named the file, the cause and a remedy, and takes nothing more.
    """
    items = some_items()
    writer = streams.write(path, items, finish=False)
    writer.tick(items[-1].host_ns + 10**9)
    stream = writer._output._stream  # the only place where a disk can be made full without root
    whole = stream._file
    monkeypatch.setattr(stream, "_file", broken(whole))
    later = [Chunk(LINK, items[-1].host_ns + 10**9 + number * 10**7, bytes(5000)) for number in range(50)]
    with pytest.raises(RecordingError, match=message) as caught:
        list(map(writer.write, later))
    assert str(writer.path) in str(caught.value)
    assert caught.value.remedy
    with pytest.raises(RecordingError):
        writer.write(items[0])
    writer.close()
    whole.close()
    return items, RecordingReader(writer.path)


@pytest.mark.parametrize("half_written", [0, 1, 40, 1000])
def test_full_disk_is_reported_and_file_valid(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, half_written: int
) -> None:
    class FullDisk:
        def __init__(self, file: object) -> None:
            self._file = file
            self._room = half_written

        def write(self, data: memoryview) -> int:
            if self._room == 0:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            written = self._file.write(data[: self._room])
            self._room = 0
            return written

        def __getattr__(self, name: str) -> object:
            return getattr(self._file, name)

    items, reader = broken_off(tmp_path / "r.mcap", monkeypatch, FullDisk, "disk full")
    assert list(reader.items()) == items
    assert reader.damage is None


def test_full_disk_leaves_nothing_of_a_copy_and_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class FullDisk(FileIO):
        def write(self, data: object) -> int:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(container, "FileIO", FullDisk)
    with (
        pytest.raises(RecordingError, match=r"disk full while writing .*copy\.mcap'; nothing is left of it"),
        whole_recording(RecordingWriter(tmp_path / "copy.mcap", start_ns=0, in_part=True)) as writer,
    ):
        list(map(writer.write, some_items()))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("number", [errno.ESTALE, errno.EIO, errno.ENODEV])
def test_folder_that_goes_away_is_reported_and_ends_the_recording(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int
) -> None:
    class Gone:
        """A file of a network folder: after it every call fails, also those that undo and close."""

        def __init__(self, file: object) -> None:
            self.closed = False
            self.fileno = file.fileno

        def fail(self, *_: object) -> int:
            raise OSError(number, os.strerror(number))

        write = truncate = seek = tell = flush = close = fail

    items, reader = broken_off(tmp_path / "r.mcap", monkeypatch, Gone, re.escape(os.strerror(number)))
    assert list(reader.items()) == items, "what was written before is there when the folder is back"


def test_folder_that_refuses_at_the_end_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    writer = streams.write(tmp_path / "r.mcap", some_items(), finish=False)
    stream = writer._output._stream

    class Late:
        def __init__(self, file: object) -> None:
            self._file = file

        def close(self) -> None:
            self._file.close()
            raise OSError(errno.EDQUOT, os.strerror(errno.EDQUOT))

        def __getattr__(self, name: str) -> object:
            return getattr(self._file, name)

    monkeypatch.setattr(stream, "_file", Late(stream._file))
    with pytest.raises(RecordingError, match=re.escape(str(tmp_path / "r.mcap"))):
        writer.close()


def test_truncated_file_yields_the_present_part(tmp_path: Path) -> None:
    items = some_items(120)
    path = streams.write(tmp_path / "r.mcap", items).path
    whole = path.read_bytes()
    data_end = whole.rindex(b"\x0f\x04" + bytes(11))
    cut_path = tmp_path / "cut.mcap"
    damaged = 0
    sizes = [*range(700, data_end, 97), *range(data_end - 300, data_end), *range(data_end, len(whole), 61)]
    for size in sizes:
        cut_path.write_bytes(whole[:size])
        reader = RecordingReader(cut_path)
        got = list(reader.items())
        assert got == items[: len(got)]
        assert not reader.info.finished
        damaged += reader.damage is not None
        if size >= data_end:
            assert got == items
    assert damaged > len(range(700, data_end, 97)) + 200


def test_flipped_bit_loses_one_chunk(tmp_path: Path) -> None:
    items = some_items(600)
    path = streams.write(tmp_path / "r.mcap", items).path
    data = bytearray(path.read_bytes())
    data[len(data) // 3] ^= 0x10
    path.write_bytes(data)
    reader = RecordingReader(path)
    got = list(reader.items())
    assert reader.damage is not None
    assert "treadlink repair" in text(reader.damage)
    assert len(items) * 0.6 < len(got) < len(items)
    assert all(item in items for item in got)


@pytest.mark.parametrize("content", [b"", b"hello", b"\x89MCAP", b"x" * 5000])
def test_other_files_are_rejected(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "r.mcap"
    path.write_bytes(content)
    with pytest.raises(RecordingError, match="is not a recording"):
        RecordingReader(path)


def test_dump_of_a_link_is_recorded_first(tmp_path: Path) -> None:
    path = tmp_path / "dump.bin"
    path.write_bytes(bytes(50) + b"".join(streams.frames(np.random.default_rng(1), 50)))
    with pytest.raises(RecordingError) as failure:
        RecordingReader(path)
    assert f"treadlink record 'replay:{path}?speed=max'" in str(failure.value.remedy)


def test_missing_recording_is_named(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"recording '.*nope\.mcap' does not exist"):
        RecordingReader(tmp_path / "nope.mcap")


def test_numbers_that_are_not_finite_are_left_out(tmp_path: Path) -> None:
    writer = RecordingWriter(tmp_path / "r.mcap", start_ns=0)
    row = {"index": np.int64(4), "speed_mps": float("nan"), "Bs": np.float64(2.0), "Bs_std": np.inf, "load_n": None}
    writer.write_topic("/wheel/FL/revolution", 1, row)
    wave = {"index": 4, "radial_mps2": np.array([1.0, np.nan])}
    writer.write_topic("/wheel/FL/waveform", 1, wave)
    writer.close()
    messages = {message.channel.topic: json.loads(message.data) for message in RecordingReader(writer.path).messages()}
    assert messages["/wheel/FL/revolution"] == {"index": 4, "Bs": 2.0}
    assert messages["/wheel/FL/waveform"] == {"index": 4, "radial_mps2": [1.0, None]}


def test_topics_take_text_that_utf8_cannot_encode(tmp_path: Path) -> None:
    writer = RecordingWriter(tmp_path / "r.mcap", start_ns=0)
    log = {"level": 2, "text": "Größe T\ud83d"}
    writer.write_topic("/log", 1, log)
    writer.close()
    assert [json.loads(message.data) for message in RecordingReader(writer.path).messages()] == [log]


def test_unknown_topics_and_missing_fields_are_errors(tmp_path: Path) -> None:
    writer = RecordingWriter(tmp_path / "r.mcap", start_ns=0)
    with pytest.raises(ValueError, match="no schema for topic '/wheel/FL/wear'"):
        writer.write_topic("/wheel/FL/wear", 0, {})
    with pytest.raises(ValueError, match="lacks index"):
        writer.write_topic("/wheel/FL/revolution", 0, {"speed_mps": 1.0})
    writer.close()


def test_schemas_use_plain_types_only() -> None:
    for topic in TOPICS:
        for name, field in topic.schema["properties"].items():
            inner = field["items"] if field["type"] == "array" else field
            assert inner["type"] in ("number", "integer", "string", "boolean", "object"), name
            assert field["description"]
        assert set(topic.required) <= set(topic.schema["properties"])
    assert schema_of("/link/serial:/dev/ttyUSB0/event").name == "treadlink.LinkEvent"
