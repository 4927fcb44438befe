"""Compaction and repair: every message is kept and verified, and hostile compressed chunks are rejected."""

import struct
import subprocess
import sys
from pathlib import Path

import lz4.frame
import numpy as np
import pytest
import zstandard
from mcap.writer import CompressionType, Writer

from gateway.core.errors import RecordingError
from gateway.core.links.source import LinkItem
from gateway.core.recording.mcap_records import ChunkParts, chunk_records
from gateway.core.recording.reader import RecordingReader
from gateway.upkeep import compact as compact_module
from gateway.upkeep.compact import compact_recording
from tests.core.recording import streams
from tests.testkit.commands import invoked, run


def recording(path: Path, count: int = 1500) -> list[LinkItem]:
    rng = np.random.default_rng(20)
    frames = streams.frames(rng, count)
    items: list[LinkItem] = [*streams.chunks(rng, b"".join(frames), "serial:/dev/ttyUSB0")]
    items[7:7] = streams.some_events("serial:/dev/ttyUSB0")
    streams.write(path, items, topics=True)
    return items


def test_items_topics_and_description_stay_the_same(tmp_path: Path) -> None:
    items = recording(tmp_path / "r.mcap")
    report = compact_recording(tmp_path / "r.mcap", tmp_path / "c.mcap")
    before, after = RecordingReader(tmp_path / "r.mcap"), RecordingReader(tmp_path / "c.mcap")
    assert list(after.items()) == items
    assert list(after.messages()) == list(before.messages())
    assert after.info.finished
    assert after.session == before.session
    assert report.bytes_after == (tmp_path / "c.mcap").stat().st_size < report.bytes_before


def test_in_place_replaces_in_one_step(tmp_path: Path) -> None:
    items = recording(tmp_path / "r.mcap")
    before = (tmp_path / "r.mcap").stat().st_size
    report = compact_recording(tmp_path / "r.mcap", tmp_path / "temporary.mcap", replace=True)
    assert report.target == tmp_path / "r.mcap"
    assert (tmp_path / "r.mcap").stat().st_size < before
    assert streams.read(tmp_path / "r.mcap") == items
    assert [path.name for path in tmp_path.iterdir()] == ["r.mcap"]


def test_compacting_twice_changes_nothing(tmp_path: Path) -> None:
    items = recording(tmp_path / "r.mcap")
    compact_recording(tmp_path / "r.mcap", tmp_path / "c.mcap")
    compact_recording(tmp_path / "c.mcap", tmp_path / "cc.mcap")
    assert streams.read(tmp_path / "cc.mcap") == items


@pytest.mark.parametrize("how", ["unfinished", "damaged", "exists"])
def test_failed_compaction_leaves_the_recording(tmp_path: Path, how: str) -> None:
    path, target = tmp_path / "r.mcap", tmp_path / "c.mcap"
    recording(path)
    data = bytearray(path.read_bytes())
    if how == "unfinished":
        data = data[:-20]
    elif how == "damaged":
        data[len(data) // 2] ^= 1
    else:
        target.write_bytes(b"precious")
    path.write_bytes(data)
    with pytest.raises(
        RecordingError, match={"unfinished": "not finished", "damaged": "is damaged"}.get(how, "exists")
    ):
        compact_recording(path, target, replace=True)
    assert path.read_bytes() == bytes(data)
    assert target.exists() == (how == "exists")


def test_differing_copy_is_deleted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    recording(tmp_path / "r.mcap")
    original = compact_module.McapOutput.add_message

    def forgetful(self: object, channel: int, log_time_ns: int, data: bytes, sequence: int | None = None) -> None:
        if sequence != 77:
            original(self, channel, log_time_ns, data, sequence)

    monkeypatch.setattr(compact_module.McapOutput, "add_message", forgetful)
    with pytest.raises(RecordingError, match="differs in message"):
        compact_recording(tmp_path / "r.mcap", tmp_path / "c.mcap", replace=True)
    assert [path.name for path in tmp_path.iterdir()] == ["r.mcap"]


def chunk(compression: str, data: bytes, size: int) -> ChunkParts:
    return ChunkParts(0, size, 0, compression, memoryview(data), 0)


def test_chunk_larger_than_stated_is_rejected() -> None:
    bomb = bytes(50_000_000)
    with pytest.raises(ValueError, match="two sizes"):
        chunk_records(chunk("zstd", zstandard.compress(bomb), 1000))
    stream = zstandard.ZstdCompressor(write_content_size=False).compressobj()
    silent = stream.compress(bomb) + stream.flush()
    with pytest.raises(ValueError, match="damaged|checksum"):
        chunk_records(chunk("zstd", silent, 1000))
    with pytest.raises(ValueError, match="checksum"):
        chunk_records(chunk("lz4", lz4.frame.compress(bomb), 1000))
    for compression in ("zstd", "lz4"):
        with pytest.raises(ValueError, match="damaged"):
            chunk_records(chunk(compression, b"not compressed at all", 1000))


@pytest.mark.parametrize("length", [1 << 29, 1 << 40, (1 << 64) - 1])
def test_huge_length_is_damage(tmp_path: Path, length: int) -> None:
    path = tmp_path / "r.mcap"
    items = recording(path, 50)
    data = path.read_bytes()
    end = data.rindex(b"\x0f\x04" + bytes(11))
    path.write_bytes(data[:end] + struct.pack("<BQ", 6, length) + data[end:])
    reader = RecordingReader(path)
    assert list(reader.items()) == items
    assert reader.damage is not None


@pytest.mark.parametrize("compression", [CompressionType.LZ4, CompressionType.ZSTD, CompressionType.NONE])
def test_files_rewritten_by_other_programs_are_read(tmp_path: Path, compression: CompressionType) -> None:
    """The `mcap` tools may compress or reorder; channels are then identified by topic."""
    items = recording(tmp_path / "r.mcap", 200)
    with (tmp_path / "other.mcap").open("wb") as file:
        writer = Writer(file, compression=compression)
        writer.start()
        numbers: dict[str, int] = {}
        for message in RecordingReader(tmp_path / "r.mcap").messages():
            topic = message.channel.topic
            if topic not in numbers:
                schema = writer.register_schema("x", "jsonschema", b"{}")
                numbers[topic] = writer.register_channel(topic, message.channel.encoding, schema)
            writer.add_message(numbers[topic], message.log_time_ns, message.data, message.log_time_ns)
        writer.finish()
    assert streams.read(tmp_path / "other.mcap") == items


@pytest.fixture
def recorded_file(tmp_path: Path) -> tuple[Path, list[LinkItem]]:
    rng = np.random.default_rng(30)
    items: list[LinkItem] = [*streams.chunks(rng, b"".join(streams.frames(rng, 400)), "serial:/dev/ttyUSB0")]
    return streams.write(tmp_path / "drive.mcap", items).path, items


def test_repair_of_a_cut_file_is_reported(recorded_file: tuple[Path, list[LinkItem]]) -> None:
    path, items = recorded_file
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 3 // 4])
    before = path.read_bytes()
    output = run("repair", str(path))
    assert "drive.repaired.mcap" in output
    assert "recovered:" in output
    assert "missing:" in output
    assert "looking" not in output, "a progress bar belongs on a terminal only"
    assert path.read_bytes() == before
    got = streams.link_bytes(streams.read(path.with_name("drive.repaired.mcap")))
    assert streams.link_bytes(items).startswith(got)
    assert len(got) > 60_000


def test_repair_loads_no_scipy(recorded_file: tuple[Path, list[LinkItem]]) -> None:
    """Loaded for the report, it could fail for want of memory after the file is written."""
    path, _ = recorded_file
    path.write_bytes(path.read_bytes()[:-10])
    code = (
        "import sys; from gateway.core.cli import treadlink; "
        "treadlink(['repair', sys.argv[1]], standalone_mode=False); print('scipy' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code, str(path)], capture_output=True, text=True, check=True)
    assert "recovered:" in done.stdout
    assert done.stdout.splitlines()[-1] == "False"


def test_undamaged_file_is_not_repaired(recorded_file: tuple[Path, list[LinkItem]]) -> None:
    path, items = recorded_file
    assert "nothing to repair" in run("repair", str(path))
    assert [entry.name for entry in path.parent.iterdir()] == ["drive.mcap"]
    run("repair", "--force", "--out", str(path.with_name("copy.mcap")), str(path))
    assert streams.read(path.with_name("copy.mcap")) == items


def test_earlier_repair_is_not_overwritten(recorded_file: tuple[Path, list[LinkItem]]) -> None:
    path, _ = recorded_file
    path.write_bytes(path.read_bytes()[:-10])
    path.with_name("drive.repaired.mcap").write_bytes(b"precious")
    with pytest.raises(RecordingError, match="already exists") as caught:
        run("repair", str(path))
    assert "--out" in caught.value.remedy
    assert path.with_name("drive.repaired.mcap").read_bytes() == b"precious"


def test_compact_beside_and_in_place(recorded_file: tuple[Path, list[LinkItem]]) -> None:
    path, items = recorded_file
    assert "messages verified" in run("compact", str(path))
    small = path.with_name("drive.compact.mcap")
    assert streams.read(small) == items
    assert small.stat().st_size < path.stat().st_size
    run("compact", "--in-place", str(path))
    small.unlink()
    assert [entry.name for entry in path.parent.iterdir()] == ["drive.mcap"]
    assert streams.read(path) == items


def test_in_place_compresses_what_a_link_leads_to_and_keeps_its_permissions(
    recorded_file: tuple[Path, list[LinkItem]], tmp_path: Path
) -> None:
    path, items = recorded_file
    path.chmod(0o640)
    before, link = path.stat().st_size, tmp_path / "links" / "r.mcap"
    link.parent.mkdir()
    link.symlink_to(path)
    run("compact", "--in-place", str(link))
    assert link.is_symlink()
    assert [entry.name for entry in link.parent.iterdir()] == ["r.mcap"]
    assert path.stat().st_size < before
    assert path.stat().st_mode & 0o777 == 0o640
    assert streams.read(path) == items


def test_out_requires_a_single_recording(recorded_file: tuple[Path, list[LinkItem]]) -> None:
    path = str(recorded_file[0])
    result = invoked("compact", "--out", "x.mcap", path, path)
    assert result.exit_code == 2
    assert "single recording" in result.output


@pytest.mark.parametrize("command", ["repair", "compact"])
def test_missing_file_is_named(tmp_path: Path, command: str) -> None:
    with pytest.raises(RecordingError, match=r"recording '.*gone\.mcap' does not exist"):
        run(command, str(tmp_path / "gone.mcap"))
