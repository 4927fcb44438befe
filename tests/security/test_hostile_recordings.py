"""Malicious recordings: refused, escaped or read as far as possible, in bounded memory."""

import json
import tracemalloc
from pathlib import Path

import lz4.frame
import pytest
import zstandard
from mcap.writer import Writer

from firmware_protocol.codec import encode_raw
from gateway.core.errors import ConfigError
from gateway.core.links.source import Chunk
from gateway.core.recording.mcap_layout import CHANNEL_METADATA, RAW_ENCODING, SESSION_METADATA, seal
from gateway.core.recording.mcap_records import CHUNK_HEAD, MAGIC, RECORD_HEAD
from gateway.core.recording.reader import RecordingReader
from gateway.core.session.recording_pass import OpenedRecording, RecordingPass
from gateway.upkeep.compact import compact_recording
from gateway.upkeep.repair import repair_recording
from tests.testkit.commands import program

ESCAPE = "\x1b]0;owned\x07\x1b[2J\x9b31m<script>alert(1)</script>"
FRAME = encode_raw(6, b"\1" + b"\x1b[2Jlog", 0, 255, 0, 0)


def recording(
    path: Path,
    *,
    link: str = "sim:x",
    session: dict[str, str] | None = None,
    events: tuple[bytes, ...] = (),
    times: tuple[int, ...] = (1, 2),
    sealed: tuple[dict[str, str], ...] = (),
) -> Path:
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start("treadlink", "hostile")
        writer.add_metadata(SESSION_METADATA, seal(session or {}))
        for entries in sealed:
            writer.add_metadata(CHANNEL_METADATA, seal(entries))
        schema = writer.register_schema("x", "text/plain", b"x")
        raw = writer.register_channel(f"/link/{link}/raw", RAW_ENCODING, schema, {"link": link})
        event = writer.register_channel(f"/link/{link}/event", "json", schema, {"link": link})
        for data in events:
            writer.add_message(event, 1, data, 1)
        for sequence, time in enumerate(times):
            writer.add_message(raw, time, FRAME, time, sequence)
        writer.finish()
    return path


@pytest.mark.parametrize("command", ["inspect", "estimate", "replay", "repair"])
def test_names_cannot_control_the_terminal(tmp_path: Path, command: str) -> None:
    session = {"treadlink": ESCAPE, "sources": json.dumps([ESCAPE]), "start_ns": "5"}
    event = json.dumps({"link": ESCAPE, "kind": "lost", "text": ESCAPE}).encode()
    path = recording(tmp_path / "x.mcap", link=ESCAPE, session=session, events=(event,))
    more = ["--plain", "--speed", "max"] if command == "replay" else []
    done = program(command, path, *more)
    printed = done.stdout + done.stderr
    assert "Traceback" not in printed
    assert not {character for character in printed if not character.isprintable() and character not in "\n\r"}
    assert "owned" in printed or command == "repair"


def test_configured_names_cannot_control_the_terminal(tmp_path: Path) -> None:
    toml = '[vehicle]\n"\\u001b[2J\\u009b31m" = "\\u001b]0;x\\u0007"\n'
    path = recording(tmp_path / "x.mcap", session={"vehicle_toml": toml})
    done = program("estimate", path)
    assert done.status == 1
    assert "Traceback" not in done.stderr
    assert not {character for character in done.stderr if not character.isprintable() and character != "\n"}


def test_paths_in_a_recording_write_nothing(tmp_path: Path) -> None:
    inside = tmp_path / "a" / "b"
    inside.mkdir(parents=True)
    name = "../../../escaped"
    session = {"sources": json.dumps([name]), "treadlink": name}
    path = recording(inside / "x.mcap", link=name, session=session)
    compact_recording(path, inside / "compact.mcap")
    path.write_bytes(path.read_bytes()[:-40])
    repair_recording(path, inside / "repaired.mcap")
    list(RecordingReader(inside / "repaired.mcap").items())
    program("estimate", "x.mcap", "--csv", "out.csv", folder=inside)
    everything = {str(result.relative_to(tmp_path)) for result in tmp_path.rglob("*") if result.is_file()}
    assert everything == {"a/b/x.mcap", "a/b/compact.mcap", "a/b/repaired.mcap", "a/b/out.csv"}


DEEP = b"[" * 200_000


@pytest.mark.parametrize(
    "event",
    [
        DEEP,
        b'{"link":"a","kind":"lost","text":' + DEEP,
        b'{"link":"a","kind":"lost","text":"x","rssi_dbm":Infinity}',
        b'{"link":"a","kind":"lost","text":"x","rssi_dbm":1e999}',
        b'{"link":"a","kind":"lost","text":"x","rssi_dbm":' + b"9" * 10_000 + b"}",
        b'{"link":"a","kind":{},"text":"x"}',
        b'{"link":"a","kind":"lost","text":"x","details":7}',
        b'{"link":"a","kind":"lost","text":"x","details":[{"code":[],"values":{}}]}',
        b'{"link":"a","kind":"lost","text":"x","details":[{"code":"mtu","values":[]}]}',
        b"[]",
        b"null",
        b"\xff\xfe",
        b"",
    ],
    ids=range(13),
)
def test_invalid_events_are_left_out(tmp_path: Path, event: bytes) -> None:
    path = recording(tmp_path / "x.mcap", events=(event,))
    items = list(RecordingReader(path).items())
    assert [item.data for item in items if isinstance(item, Chunk)] == [FRAME, FRAME]
    assert len(items) == 2


@pytest.mark.parametrize(
    "detail",
    [b'{"code":"unknown","values":{}}', b'{"code":"mtu","values":{"mtu":"x"}}', b'{"code":"mtu","values":{}}'],
    ids=range(3),
)
def test_unknown_event_details_are_left_out(tmp_path: Path, detail: bytes) -> None:
    path = recording(
        tmp_path / "x.mcap", events=(b'{"link":"a","kind":"lost","text":"x","details":[' + detail + b"]}",)
    )
    read = next(iter(RecordingReader(path).items()))
    assert (read.text, read.details) == ("x", ())


def test_event_text_of_another_type_is_text(tmp_path: Path) -> None:
    path = recording(tmp_path / "x.mcap", events=(b'{"link":7,"kind":"lost","text":{"a":1}}',))
    event = next(iter(RecordingReader(path).items()))
    assert isinstance(event.link, str)
    assert isinstance(event.text, str)


@pytest.mark.parametrize(
    "session",
    [{"sources": "[" * 200_000}, {"start_ns": "9" * 10_000}, {"start_ns": "\u0664\u0662"}, {"sources": "7"}, {}],
    ids=range(5),
)
def test_invalid_descriptions_are_left_out(tmp_path: Path, session: dict[str, str]) -> None:
    reader = RecordingReader(recording(tmp_path / "x.mcap", session=session))
    assert reader.info.sources == ()
    assert len(list(reader.items())) == 2
    assert program("inspect", reader.info.path).status in (0, 1)  # 1: no frames


@pytest.mark.parametrize(
    "entries", [{}, {"id": "1"}, {"id": "x", "topic": "", "encoding": "", "link": ""}, {"id": "9" * 9999}], ids=range(4)
)
def test_empty_declarations_are_left_out(tmp_path: Path, entries: dict[str, str]) -> None:
    reader = RecordingReader(recording(tmp_path / "x.mcap", sealed=(entries,)))
    assert len(list(reader.items())) == 2


def test_extreme_times_are_harmless(tmp_path: Path) -> None:
    path = recording(tmp_path / "x.mcap", times=(0, 2**64 - 1, 5, 2**63, 2**63 - 1))
    batch = RecordingPass(OpenedRecording(RecordingReader(path)))
    list(batch)
    (counters,) = batch.links.values()
    assert counters.intact == 5
    for command in (["inspect"], ["estimate"], ["replay", "--plain", "--speed", "max"]):
        done = program(command[0], path, *command[1:])
        assert "Traceback" not in done.stderr, done.stderr
        assert done.status in (0, 1), done.stderr  # 1: no revolutions


def test_recorded_configuration_is_validated(tmp_path: Path) -> None:
    from gateway.core.config.vehicle import parse_vehicle

    with pytest.raises(ConfigError):
        parse_vehicle('[[wheel]]\nposition="../../x"\nhub=0\nwheel=0\n[tire]\nradius_mm=300.0\n', "recording")


BOMB_BYTES = 1 << 30


def bombs() -> dict[str, bytes]:
    """Chunks of a few kB that swell to a GiB, whatever they state."""
    frames = zstandard.ZstdCompressor(level=3).compressobj()
    unstated = b"".join(frames.compress(bytes(1 << 24)) for _ in range(BOMB_BYTES >> 24)) + frames.flush()
    block = lz4.frame.LZ4FrameCompressor()
    swollen = block.begin() + b"".join(block.compress(bytes(1 << 24)) for _ in range(8)) + block.flush()
    return {"zstd": unstated, "lz4": swollen}


@pytest.mark.parametrize("compression", ["zstd", "lz4"])
@pytest.mark.parametrize("stated", [100, 1 << 20])
def test_decompression_bombs_need_little_memory(tmp_path: Path, compression: str, stated: int) -> None:
    data = bombs()[compression]
    name = compression.encode()
    body = CHUNK_HEAD.pack(0, 1, stated, 0, len(name)) + name + len(data).to_bytes(8, "little") + data
    path = tmp_path / "bomb.mcap"
    header = b"\x01" + (8).to_bytes(8, "little") + bytes(8)
    path.write_bytes(MAGIC + header + RECORD_HEAD.pack(6, len(body)) + body)
    tracemalloc.start()
    reader = RecordingReader(path)
    assert list(reader.items()) == []
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert reader.damage is not None
    assert peak < 4 * len(data) + 8 * stated + (1 << 20)
