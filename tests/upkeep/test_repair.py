"""A repaired recording lacks only the damaged frames and contains no wrong ones."""

import json
import os
import shutil
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader

from gateway.core.errors import RecordingError
from gateway.core.links.source import Chunk
from gateway.core.recording.mcap_layout import REPAIR_METADATA
from gateway.core.recording.reader import RecordingReader
from gateway.core.recording.writer import utc_text
from gateway.upkeep.compact import compact_recording
from gateway.upkeep.repair import needs_repair, repair_recording
from tests.core.recording import damage, streams
from tests.testkit.commands import run

# Opcode, length, channel, sequence number and two times.
HEADER_BYTES = 31
BEGIN = 200  # the header and the first metadata, which have tests of their own


def repaired(tmp_path: Path, file: bytes) -> Path:
    (tmp_path / "damaged.mcap").write_bytes(file)
    repair_recording(tmp_path / "damaged.mcap", tmp_path / "repaired.mcap")
    return tmp_path / "repaired.mcap"


def faults(recorded: damage.Recorded, touched: np.ndarray, path: Path) -> tuple[int, int]:
    """Return the numbers of undamaged frames that are missing and of frames never sent on their link."""
    got = damage.rescued(path)
    touched = with_headers(recorded, touched)
    gone = wrong = 0
    for link, frames in recorded.frames.items():
        # With one link its name may be lost.
        result = got.get(link, set()) if len(recorded.frames) > 1 else set().union(*got.values())
        gone += len({frame for frame, positions in frames if not touched[positions].any()} - result)
        # A frame that lost a few bytes may pass again where equal ones stand beside it; it is right then.
        wrong += len(result - {frame for frame, _ in frames})
    return gone, wrong


def with_headers(recorded: damage.Recorded, touched: np.ndarray) -> np.ndarray:
    """Return what may be lost: the touched bytes, and of messages whose headers are touched what these tell.

    The frame that goes on after the header is parted by its remains; with several links, the message has no link.
    """
    lost = touched.copy()
    for start, size in damage.payload_positions(recorded.file):
        if touched[start - HEADER_BYTES : start].any():
            lost[start : start + (1 if len(recorded.frames) == 1 else size)] = True
    return lost


def check(recorded: damage.Recorded, touched: np.ndarray, path: Path) -> None:
    assert faults(recorded, touched, path) == (0, 0)


def random_places(rng: np.random.Generator, size: int, count: int) -> list[tuple[int, int]]:
    return [(int(rng.integers(BEGIN, size)), int(np.exp(rng.uniform(0, np.log(5000))))) for _ in range(count)]


def trial(folder: Path, seed: list[int], links: int) -> tuple[int, int]:
    """Record, damage one to three places and repair, all drawn from the seed; return the numbers of wrong frames."""
    rng = np.random.default_rng(seed)
    recorded = damage.record(
        folder / "r.mcap",
        rng,
        count=200,
        links=links,
        largest=int(rng.choice([20, 64, 250, 600, 5000])),
        topics=bool(rng.integers(2)),
        finish=bool(rng.integers(2)),
    )
    places = random_places(rng, len(recorded.file), int(rng.integers(1, 4)))
    kind = rng.choice(["missing", "noise", "zeros"])
    if kind == "missing":
        file, touched = damage.cut(recorded.file, places)
    else:
        stuff = [(position, rng.bytes(size) if kind == "noise" else bytes(size)) for position, size in places]
        file, touched = damage.overwrite(recorded.file, stuff)
    return faults(recorded, touched, repaired(folder, file))


@pytest.mark.parametrize("links", [1, 2])
@pytest.mark.parametrize("seed", range(15))
def test_only_damaged_frames_are_lost(tmp_path: Path, links: int, seed: int) -> None:
    assert trial(tmp_path, [seed, links], links) == (0, 0)


@pytest.mark.slow
@pytest.mark.parametrize(("links", "most"), [(1, 0.03), (2, 0.03)])
def test_random_damage_loses_only_damaged_frames(tmp_path: Path, links: int, most: float) -> None:
    """The figures in docs/reference/recording-format.md: chance may hide a frame, but never add one."""
    count = 2000
    results = []
    for seed in range(count):
        folder = tmp_path / str(seed)
        folder.mkdir()
        results.append(trial(folder, [seed, links, 1], links))
        shutil.rmtree(folder)
    unlucky = [gone for gone, _ in results if gone]
    print(f"{links} links: {len(unlucky)} of {count} recordings lack frames that lost no byte: {unlucky}")
    assert not any(wrong for _, wrong in results)
    assert len(unlucky) <= most * count


def test_a_cut_header_costs_the_frame_across_it_at_most(tmp_path: Path) -> None:
    rng = np.random.default_rng(8)
    recorded = damage.record(tmp_path / "r.mcap", rng, count=120, links=1, largest=90, topics=False, finish=True)
    payloads = list(damage.payload_positions(recorded.file))
    for number, ((_, _), (start, _)) in enumerate(zip(payloads[20:80], payloads[21:81], strict=True)):
        head = start - 31
        begin, end = head + int(rng.integers(0, 31)), start
        end = int(rng.integers(begin + 1, start + 1))
        file, touched = damage.cut(recorded.file, [(begin, end - begin)])
        (tmp_path / str(number)).mkdir()
        path = repaired(tmp_path / str(number), file)
        check(recorded, touched, path)
        count = sum(map(len, damage.rescued(path).values()))
        assert count >= 119


@pytest.mark.parametrize("share", [0.02, 0.3, 0.7, 0.97])
@pytest.mark.parametrize("finish", [True, False])
def test_cut_off_file_keeps_the_part_before(tmp_path: Path, share: float, finish: bool) -> None:
    rng = np.random.default_rng(9)
    recorded = damage.record(tmp_path / "r.mcap", rng, count=300, links=1, largest=600, topics=True, finish=finish)
    size = int(len(recorded.file) * share)
    touched = np.arange(len(recorded.file)) >= size
    check(recorded, touched, repaired(tmp_path, recorded.file[:size]))


def test_complete_messages_keep_times_and_topics(tmp_path: Path) -> None:
    rng = np.random.default_rng(10)
    recorded = damage.record(tmp_path / "r.mcap", rng, count=300, links=1, largest=600, topics=True, finish=False)
    middle = len(recorded.file) // 2
    file, _ = damage.cut(recorded.file, [(middle, 1000)])
    reader = RecordingReader(repaired(tmp_path, file))
    items = list(reader.items())
    assert reader.damage is None
    assert reader.info.finished
    assert reader.vehicle_toml == streams.TOML
    assert reader.info.sources == ("sim:test",)
    remaining = [item for item in items if item in recorded.items]
    assert len(remaining) >= len(recorded.items) - 6
    assert [item for item in recorded.items if not isinstance(item, Chunk)] == [
        item for item in items if not isinstance(item, Chunk)
    ]
    times = [item.host_ns for item in items if isinstance(item, Chunk)]
    assert times == sorted(times)
    topics = {message.channel.topic for message in reader.messages()}
    assert {"/wheel/FL/revolution", "/wheel/FL/waveform"} <= topics
    assert dict(reader.notes)[REPAIR_METADATA]["torn_places"] == "1"


def test_stock_reader_opens_the_repaired_file(tmp_path: Path) -> None:
    rng = np.random.default_rng(11)
    recorded = damage.record(tmp_path / "r.mcap", rng, count=200, links=1, largest=600, topics=True, finish=False)
    file, _ = damage.cut(recorded.file, [(len(recorded.file) // 3, 77)])
    path = repaired(tmp_path, file)
    with path.open("rb") as opened:
        reader = make_reader(opened, validate_crcs=True)
        rows = [json.loads(message.data) for _, _, message in reader.iter_messages(["/wheel/FL/revolution"])]
        raw = b"".join(message.data for _, channel, message in reader.iter_messages() if channel.topic.endswith("/raw"))
    assert rows[0]["index"] == 3
    assert raw == streams.link_bytes(streams.read(path))


def test_destroyed_start_loses_only_itself(tmp_path: Path) -> None:
    rng = np.random.default_rng(12)
    recorded = damage.record(tmp_path / "r.mcap", rng, count=300, links=1, largest=600, topics=False, finish=True)
    file, touched = damage.overwrite(recorded.file, [(0, rng.bytes(3000))])
    path = repaired(tmp_path, file)
    check(recorded, touched, path)
    assert RecordingReader(path).vehicle_toml == streams.TOML, "the description stands at the end as well"


@pytest.mark.parametrize("ahead_s", [3600, -3600])
def test_clock_of_a_recording_with_a_lost_description_is_set_from_its_first_item(tmp_path: Path, ahead_s: int) -> None:
    rng = np.random.default_rng(12)
    recorded = damage.record(tmp_path / "r.mcap", rng, count=60, links=1, largest=600, topics=False, finish=False)
    path = repaired(tmp_path, damage.overwrite(recorded.file, [(0, rng.bytes(3000))])[0])
    assert RecordingReader(path).info.start_ns is None
    begin_ns = streams.read(path)[0].host_ns + ahead_s * 10**9
    output = run("set-clock", path, "--ahead", ahead_s, "--out", tmp_path / "dated.mcap")
    assert f"begins {utc_text(begin_ns)}" in output
    assert RecordingReader(tmp_path / "dated.mcap").info.start_ns == begin_ns


def test_bytes_are_found_without_declarations(tmp_path: Path) -> None:
    rng = np.random.default_rng(13)
    recorded = damage.record(tmp_path / "r.mcap", rng, count=300, links=1, largest=600, topics=False, finish=False)
    file, touched = damage.overwrite(recorded.file, [(0, rng.bytes(3000))])
    got = damage.rescued(repaired(tmp_path, file))
    want = damage.untouched(recorded, touched)["serial:/dev/tty0"]
    assert want
    assert want == set().union(*got.values())


def test_remains_of_an_older_recording_are_ignored(tmp_path: Path) -> None:
    """A disk may put blocks of a deleted file in place of missing bytes."""
    rng = np.random.default_rng(14)
    (tmp_path / "old").mkdir()
    old = damage.record(tmp_path / "old" / "r.mcap", rng, count=200, links=1, largest=600, topics=False, finish=True)
    year = 365 * 86_400 * 10**9
    new_frames = streams.frames(rng, 200)
    items = [
        Chunk(chunk.link, chunk.host_ns + year, chunk.data)
        for chunk in streams.chunks(rng, b"".join(new_frames), "serial:/dev/tty0")
    ]
    path = streams.write(tmp_path / "new.mcap", items).path
    file = path.read_bytes()
    stale = old.file[20_000:24_096]
    got = damage.rescued(repaired(tmp_path, file[:20_000] + stale + file[24_096:]))["serial:/dev/tty0"]
    assert len(got) > 175
    assert got <= set(new_frames), "frames of the older recording were taken in"


def test_damaged_first_time_does_not_affect_the_rest(tmp_path: Path) -> None:
    rng = np.random.default_rng(17)
    recorded = damage.record(tmp_path / "r.mcap", rng, count=300, links=1, largest=600, topics=False, finish=False)
    first = next(damage.payload_positions(recorded.file))[0]
    file, touched = damage.overwrite(recorded.file, [(first - 20, bytes(20))])
    (tmp_path / "damaged.mcap").write_bytes(file)
    report = repair_recording(tmp_path / "damaged.mcap", tmp_path / "repaired.mcap")
    check(recorded, touched, tmp_path / "repaired.mcap")
    assert report.losses.bytes_kept < 2000, "only the first message is torn"


def test_compressed_recording_keeps_complete_chunks(tmp_path: Path) -> None:
    rng = np.random.default_rng(15)
    recorded = damage.record(tmp_path / "r.mcap", rng, count=4000, links=1, largest=600, topics=False, finish=True)
    compact_recording(tmp_path / "r.mcap", tmp_path / "small.mcap")
    small = bytearray((tmp_path / "small.mcap").read_bytes())
    small[len(small) // 2] ^= 0xFF
    (tmp_path / "damaged.mcap").write_bytes(small)
    report = repair_recording(tmp_path / "damaged.mcap", tmp_path / "repaired.mcap")
    assert report.losses.compressed_chunks == 1
    got = damage.rescued(tmp_path / "repaired.mcap")["serial:/dev/tty0"]
    everything = {frame for frame, _ in recorded.frames["serial:/dev/tty0"]}
    assert got < everything
    assert len(got) > len(everything) / 2
    for size in (len(small) // 3, len(small) - 5000):
        (tmp_path / "damaged.mcap").write_bytes((tmp_path / "small.mcap").read_bytes()[:size])
        report = repair_recording(tmp_path / "damaged.mcap", tmp_path / f"repaired{size}.mcap")
        assert 0 < report.frames < len(everything)


def test_undamaged_recording_needs_no_repair(tmp_path: Path) -> None:
    items = streams.chunks(np.random.default_rng(1), b"".join(streams.frames(np.random.default_rng(1), 50)), "a")
    assert not needs_repair(streams.write(tmp_path / "r.mcap", items).path)
    unfinished = streams.write(tmp_path / "u.mcap", items, finish=False)
    unfinished.tick(items[-1].host_ns + 10**9)
    with pytest.raises(RecordingError, match="being recorded"):
        needs_repair(unfinished.path)
    # As a killed writer leaves it.
    unmarked = tmp_path / "left.mcap"
    unmarked.write_bytes(unfinished.path.read_bytes())
    assert needs_repair(unmarked)


def test_repair_never_overwrites(tmp_path: Path) -> None:
    path = streams.write(tmp_path / "r.mcap", [Chunk("a", 1, b"x")]).path
    (tmp_path / "there.mcap").write_bytes(b"precious")
    with pytest.raises(RecordingError, match="already exists"):
        repair_recording(path, tmp_path / "there.mcap")
    assert (tmp_path / "there.mcap").read_bytes() == b"precious"


@pytest.mark.parametrize("content", [b"", b"\x89MCAP0\r\n", bytes(5000), b"\x05" * 5000])
def test_file_without_messages_is_rejected(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "r.mcap").write_bytes(content)
    with pytest.raises(RecordingError, match=r"nothing in|is empty"):
        repair_recording(tmp_path / "r.mcap", tmp_path / "out.mcap")
    assert not (tmp_path / "out.mcap").exists()


def test_messages_with_equal_times_stay_separate(tmp_path: Path) -> None:
    """All messages of a recorded dump without a rate have the same time; sequence numbers must suffice."""
    rng = np.random.default_rng(16)
    frames = streams.frames(rng, 100)
    items = [Chunk("dump:x.bin", 0, chunk.data) for chunk in streams.chunks(rng, b"".join(frames), "x", largest=200)]
    path = streams.write(tmp_path / "r.mcap", items).path
    file = path.read_bytes()
    starts = [start for start, _ in damage.payload_positions(file)]
    cut, _ = damage.cut(file, [(starts[30] - 20, 15)])
    got = damage.rescued(repaired(tmp_path, cut))["dump:x.bin"]
    assert len(set(frames) - got) <= 1
    assert got <= set(frames)


def test_a_part_that_has_another_name_is_not_written_to(tmp_path: Path) -> None:
    """As after a kill between naming the result and removing the part, when the user has moved the result."""
    path = streams.write(tmp_path / "r.mcap", [Chunk("a", 1, b"x")]).path
    moved = tmp_path / "archive.mcap"
    moved.write_bytes(b"precious")
    os.link(moved, tmp_path / "out.mcap.part")
    repair_recording(path, tmp_path / "out.mcap")
    assert moved.read_bytes() == b"precious"
    assert (tmp_path / "out.mcap").read_bytes() != b"precious"
    assert not (tmp_path / "out.mcap.part").exists()


def test_a_result_takes_its_left_part_away(tmp_path: Path) -> None:
    path = streams.write(tmp_path / "r.mcap", [Chunk("a", 1, b"x")]).path
    repair_recording(path, tmp_path / "out.mcap")
    os.link(tmp_path / "out.mcap", tmp_path / "out.mcap.part")
    with pytest.raises(RecordingError, match="already exists"):
        repair_recording(path, tmp_path / "out.mcap")
    assert not (tmp_path / "out.mcap.part").exists()


def test_a_part_that_is_a_link_is_not_followed(tmp_path: Path) -> None:
    path = streams.write(tmp_path / "r.mcap", [Chunk("a", 1, b"x")]).path
    (tmp_path / "other").write_bytes(b"precious")
    (tmp_path / "out.mcap.part").symlink_to(tmp_path / "other")
    with pytest.raises(RecordingError, match=r"out\.mcap"):
        repair_recording(path, tmp_path / "out.mcap")
    assert (tmp_path / "other").read_bytes() == b"precious"
