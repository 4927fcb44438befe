"""A recording in several files: no frame is lost, torn or in two of them, and only the last ones are kept."""

import os
import threading
from contextlib import suppress
from pathlib import Path

import pytest
from click.testing import CliRunner

from firmware_protocol.codec import encode_frame
from firmware_protocol.decoder import FrameDecoder
from firmware_protocol.messages import Frame, Hello, MessageType, SampleBlock
from gateway.core.cli import treadlink
from gateway.core.clock import ManualClock
from gateway.core.errors import RecordingError
from gateway.core.links.source import BusFrames, Chunk, open_source
from gateway.core.recording.reader import RecordingReader
from gateway.core.recording.split_writer import Split, SplitWriter
from gateway.core.recording.writer import RecordingWriter
from tests.core.recording.streams import hello
from tests.testkit.commands import invoked

S = 1_000_000_000
START_NS = 1_700_000_000_000_000_000


def opened(target: Path, start_ns: int) -> RecordingWriter:
    return RecordingWriter(target, start_ns=start_ns, sources=["test"], vehicle_toml="x = 1")


def chunks_of(scenario: str) -> list[Chunk]:
    source = open_source(scenario, ManualClock(START_NS))
    return [item for item in source.items(threading.Event()) if isinstance(item, Chunk)]


def odd_pieces(chunks: list[Chunk], size: int) -> list[Chunk]:
    """Return the same bytes in pieces that do not end where frames do."""
    data = b"".join(chunk.data for chunk in chunks)
    length_ns = chunks[-1].host_ns - START_NS
    return [
        Chunk(chunks[0].link, START_NS + length_ns * start // len(data), data[start : start + size])
        for start in range(0, len(data), size)
    ]


def written(folder: Path, items: list[Chunk], split: Split) -> list[Path]:
    writer = SplitWriter(opened, folder, START_NS, split)
    for item in items:
        writer.write(item)
        writer.tick(item.host_ns)
    assert writer.items == len(items)
    writer.close()
    writer.close()
    return sorted(folder.iterdir())


@pytest.mark.parametrize("scenario", ["sim:lab?speed=max&duration=14&seed=4", "sim:demo?speed=max&duration=14&seed=4"])
@pytest.mark.parametrize("size", [97, 1009])
def test_every_frame_is_whole_in_one_file_and_each_begins_with_hello(tmp_path: Path, scenario: str, size: int) -> None:
    items = odd_pieces(chunks_of(scenario), size)
    paths = written(tmp_path, items, Split(duration_ns=4 * S))
    assert len(paths) >= 3
    whole = FrameDecoder()
    expected = [frame for item in items for frame in whole.feed(item.data)]
    frames = []
    for path in paths:
        reader, decoder = RecordingReader(path), FrameDecoder()
        assert reader.info.vehicle_toml == "x = 1"
        reference = set()
        for item in reader.items():
            for frame in decoder.feed(item.data):
                frames.append(frame)
                if isinstance(frame.message, Hello):
                    reference.add(frame.wheel)
                if isinstance(frame.message, SampleBlock):
                    assert frame.wheel in reference, "samples before what they need"
        decoder.finish()
        assert (decoder.counters.lost, decoder.counters.crc_errors, decoder.counters.noise_bytes) == (0, 0, 0)
        assert reader.damage is None
    assert [(frame.wheel, frame.type, frame.seq) for frame in frames] == [
        (frame.wheel, frame.type, frame.seq) for frame in expected
    ]


def test_links_without_hello_go_on_at_a_chunk(tmp_path: Path) -> None:
    writer = SplitWriter(opened, tmp_path / "r.mcap", START_NS, Split(duration_ns=10 * S))
    for second in range(40):
        writer.write(Chunk("serial:silent", START_NS + second * S, bytes([second])))
        writer.write(BusFrames("can:bus", START_NS + second * S, b""))
    writer.close()
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == ["r-2.mcap", "r-3.mcap", "r-4.mcap", "r.mcap"] or names == ["r-2.mcap", "r-3.mcap", "r.mcap"]
    remaining = [item for name in ("r.mcap", *sorted(names)[:-1]) for item in RecordingReader(tmp_path / name).items()]
    bytes_of = [item.data for item in remaining if isinstance(item, Chunk) and item.link == "serial:silent"]
    assert bytes_of == [bytes([second]) for second in range(40)]


@pytest.mark.parametrize(("wheels", "apart_ms"), [(8, 250), (2, 1000), (4, 50)])
def test_hellos_at_any_distance_begin_a_file_soon(tmp_path: Path, wheels: int, apart_ms: int) -> None:
    frames = [
        (round_ms + apart_ms * wheel, Frame(MessageType.HELLO, 0, wheel, round_ms // 2000, 0, hello(wheel)))
        for round_ms in range(0, 20_000, 2000)
        for wheel in range(wheels)
    ]
    for due_ms in (4000, 4070, 4500):
        folder = tmp_path / str(due_ms)
        folder.mkdir()
        items = [Chunk("link", START_NS + ms * S // 1000, encode_frame(frame)) for ms, frame in frames]
        paths = written(folder, items, Split(duration_ns=due_ms * S // 1000))
        starts_ns = [next(RecordingReader(path).items()).host_ns for path in paths[:2]]
        assert starts_ns[1] - starts_ns[0] <= (due_ms + 4000) * S // 1000
        (first, *_) = FrameDecoder().feed(next(RecordingReader(paths[1]).items()).data)
        assert apart_ms >= 250 or first.wheel == 0, "HELLOs that follow each other are in one file"


@pytest.mark.parametrize("ahead_s", [-100_000_000, 100_000_000])
def test_recorded_times_are_split_by_themselves(tmp_path: Path, ahead_s: int) -> None:
    """A recording that is replayed has times of its own, far from those of the session."""
    begin_s = START_NS // S + ahead_s
    writer = SplitWriter(opened, tmp_path / "r.mcap", START_NS, Split(duration_ns=10 * S))
    for second in range(35):
        writer.write(BusFrames("can:bus", (begin_s + second) * S, b""))
    writer.close()
    counts = [sum(1 for _ in RecordingReader(path).items()) for path in sorted(tmp_path.iterdir())]
    assert counts == [10, 10, 5, 10]  # r-2, r-3, r-4, r


def test_oldest_files_of_the_session_are_removed_and_others_stay(tmp_path: Path) -> None:
    other = tmp_path / "another.mcap"
    other.write_bytes(b"of another session")
    items = chunks_of("sim:lab?speed=max&duration=30&seed=4")
    paths = written(tmp_path, items, Split(duration_ns=3 * S, keep=3))
    assert other in paths
    assert len(paths) == 4
    last = [item for path in paths[1:] if path != other for item in RecordingReader(path).items()]
    assert items[-1] in last
    assert items[0] not in last


def test_size_limits_each_file(tmp_path: Path) -> None:
    items = chunks_of("sim:lab?speed=max&duration=30&seed=4")
    paths = written(tmp_path, items, Split(size_bytes=200_000))
    per_second = sum(len(item.data) for item in items) / 30
    assert len(paths) > 3
    for path in paths[:-1]:
        assert 200_000 <= path.stat().st_size <= 200_000 + 4 * per_second + 100_000


def test_record_command_splits(tmp_path: Path) -> None:
    words = ["record", "sim:lab?speed=max&duration=20&seed=1", "--out", str(tmp_path), "--split", "5s", "--keep", "2"]
    run = CliRunner().invoke(treadlink, words, catch_exceptions=False)
    assert run.exit_code == 0, run.output
    assert "files, this is the last" in run.output
    assert len(list(tmp_path.iterdir())) == 2
    for limit in ("5", "0.5s", "10kB", "-1s", "nans"):
        assert invoked(*words[:5], limit).exit_code == 2
    assert invoked(*words[:4], "--keep", "2").exit_code == 2


def test_a_next_file_that_cannot_be_opened_is_tried_again_and_nothing_is_lost(tmp_path: Path) -> None:
    items = odd_pieces(chunks_of("sim:lab?speed=max&duration=14&seed=4"), 1009)
    refused_until_ns = START_NS + 7 * S
    refusals = []

    def opened_later(target: Path, start_ns: int) -> RecordingWriter:
        if START_NS < start_ns < refused_until_ns:
            raise RecordingError(f"cannot create '{target}': too many open files", "Close some.")
        return opened(target, start_ns)

    writer = SplitWriter(opened_later, tmp_path, START_NS, Split(duration_ns=2 * S))
    for item in items:
        writer.write(item)
        refusals.append(writer.refusal)
    writer.close()
    assert any("too many open files" in refusal for refusal in refusals)
    assert refusals[-1] == ""
    assert writer.parts > 2
    parts = [item for path in sorted(tmp_path.iterdir()) for item in RecordingReader(path).items()]
    assert b"".join(part.data for part in parts if isinstance(part, Chunk)) == b"".join(item.data for item in items)


def test_descriptors_of_the_next_file_are_reserved(tmp_path: Path) -> None:
    """Whoever takes all descriptors, the recording opens its next file."""
    resource = pytest.importorskip("resource")
    before = resource.getrlimit(resource.RLIMIT_NOFILE)
    items = chunks_of("sim:lab?speed=max&duration=6&seed=4")
    writer = SplitWriter(opened, tmp_path, START_NS, Split(duration_ns=2 * S))
    held = []
    resource.setrlimit(resource.RLIMIT_NOFILE, (min(256, before[0]), before[1]))
    try:
        with suppress(OSError):
            while True:
                held.append(os.open(os.devnull, os.O_RDONLY))
        assert held, "no descriptor is left"
        for item in items:
            writer.write(item)
    finally:
        for descriptor in held:
            os.close(descriptor)
        resource.setrlimit(resource.RLIMIT_NOFILE, before)
    writer.close()
    assert writer.refusal == ""
    assert writer.parts >= 2
