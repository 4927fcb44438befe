"""The disk of a recording: space and time left are said, and a disk that fills up is an alarm before it is full."""

import shutil
from collections import namedtuple
from pathlib import Path

import pytest
from click.testing import CliRunner

from gateway.core.cli import treadlink
from gateway.core.estimates.results import DiskRoom
from gateway.core.reasons import Reason
from gateway.core.recording.split_writer import Split, SplitWriter
from gateway.core.recording.writer import RecordingWriter
from gateway.core.session.alarms import AlarmName, disk_alarm
from gateway.core.session.disk_watch import DiskWatch, disk_notices
from gateway.core.session.reasons import SessionCode
from gateway.core.text.wording import text

S = 1_000_000_000
START_NS = 1_700_000_000_000_000_000
Usage = namedtuple("Usage", "total used free")


class Disk:
    """A recording and other programs on one disk."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, free: int, most: int | None = None) -> None:
        self.free, self.size, self.now_ns = free, 0, START_NS
        monkeypatch.setattr(shutil, "disk_usage", lambda _: Usage(free, 0, self.free))
        self.watch = DiskWatch(Path("/"), lambda: self.size, lambda: most)

    def run(self, seconds: int, recorded: int, others: int = 0) -> DiskRoom:
        for _ in range(seconds):
            self.now_ns += S
            self.size += recorded
            self.free -= recorded + others
            room = self.watch.room(self.now_ns)
        assert room is not None
        return room


def test_time_left_follows_the_recording_and_other_programs(monkeypatch: pytest.MonkeyPatch) -> None:
    disk = Disk(monkeypatch, 10**9)
    assert disk.run(5, 100_000) == DiskRoom(10**9 - 500_000, None), "too early to tell"
    room = disk.run(60, 100_000)
    assert room.left_s == pytest.approx(room.free_bytes / 1e5)
    room = disk.run(90, 100_000, 900_000)
    assert room.left_s == pytest.approx(room.free_bytes / 1e6)
    assert disk.run(90, 0).left_s is None


def test_recording_that_removes_its_old_files_does_not_fill_the_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    assert Disk(monkeypatch, 10**9, most=5 * 10**8).run(30, 100_000).left_s is None
    assert Disk(monkeypatch, 10**9, most=5 * 10**9).run(30, 100_000).left_s is not None
    assert Disk(monkeypatch, 10**9, most=5 * 10**8).run(30, 100_000, 1000).left_s is not None


def test_size_that_is_kept_follows_the_options(tmp_path: Path) -> None:
    def opened(target: Path, start_ns: int) -> RecordingWriter:
        return RecordingWriter(target, start_ns=start_ns)

    for split, most in ((Split(size_bytes=10**6, keep=3), 3 * 10**6), (Split(size_bytes=10**6), None)):
        writer = SplitWriter(opened, tmp_path, START_NS, split)
        assert writer.most_bytes() == most
        writer.close()


def test_alarm_comes_before_the_disk_is_full_and_stays_until_there_is_room() -> None:
    (alarm,) = disk_alarm(DiskRoom(10**8, 599.0))
    assert (alarm.name, alarm.reason.kind) == (AlarmName.DISK, (SessionCode.DISK_SPACE, "minutes"))
    assert text(alarm.reason) == "the disk has 100.0 MB left and is full in 10 min: free some space"
    standing = {(alarm.position, alarm.name): alarm.reason.code}
    assert list(disk_alarm(DiskRoom(10**8, 700.0), standing))
    assert not list(disk_alarm(DiskRoom(10**8, 700.0)))
    assert not list(disk_alarm(DiskRoom(10**8, 901.0), standing))
    assert list(disk_alarm(DiskRoom(10**7, None)))
    (refused,) = disk_alarm(DiskRoom(10**10, None, "cannot create 'b.mcap'"))
    assert refused.reason == Reason(SessionCode.RECORDING_PART_REFUSED, error="cannot create 'b.mcap'")
    assert not list(disk_alarm(None))


def test_space_and_time_are_said_once() -> None:
    rooms = [None, DiskRoom(10**10, None), DiskRoom(10**10, 7200.0), DiskRoom(10**10, 7100.0)]
    said = [n.reason["lasts"] for before, now in zip(rooms, rooms[1:], strict=False) for n in disk_notices(before, now)]
    assert said == ["unknown", "hours"]


def test_record_says_the_space_at_its_start(tmp_path: Path) -> None:
    words = ["record", "sim:lab?speed=max&duration=3&seed=1", "--out", str(tmp_path)]
    run = CliRunner().invoke(treadlink, words, catch_exceptions=False)
    assert "recording: the disk has" in run.output
