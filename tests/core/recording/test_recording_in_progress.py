"""Recordings that are being written: recognised until their process ends, and what `kill -9` or a full disk leave."""

import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner
from mcap.reader import make_reader

from gateway.core.cli import treadlink
from gateway.core.errors import RecordingError
from gateway.core.links.source import Chunk
from gateway.core.recording.mcap_layout import raw_topic
from gateway.core.recording.reader import RecordingReader
from gateway.core.recording.writer import RecordingWriter
from gateway.upkeep.repair import repair_recording
from tests.testkit.commands import invoked

START_NS = 1_700_000_000_000_000_000
RECORDER = """
import sys
from gateway.core.links.source import Chunk
from gateway.core.recording.writer import RecordingWriter

writer = RecordingWriter(sys.argv[1], start_ns=1_700_000_000_000_000_000, sources=["test"])
for number in range(5):
    writer.write(Chunk("test:link", 1_700_000_000_000_000_000 + number * 200_000_000, bytes(250)))
print("written", flush=True)
sys.stdin.read()
"""


def printed(*words: str) -> tuple[int, str]:
    run = CliRunner().invoke(treadlink, words, catch_exceptions=False)
    return run.exit_code, run.output


def test_recording_of_another_process_is_in_progress_until_it_ends(tmp_path: Path) -> None:
    path = tmp_path / "r.mcap"
    recorder = subprocess.Popen(
        [sys.executable, "-c", RECORDER, str(path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert recorder.stdout is not None
    assert recorder.stdin is not None
    try:
        assert recorder.stdout.readline() == "written\n"
        _, inspected = printed("inspect", str(path))
        assert "BEING RECORDED" in inspected
        assert "interrupted" not in inspected
        assert "repair" not in inspected
        _, text = printed("inspect", "--json", str(path))
        assert json.loads(text.splitlines()[0])["in_progress"] is True
        for command in ("repair", "compact"):
            run = invoked(command, path)
            assert isinstance(run.exception, RecordingError)
            assert "being recorded" in str(run.exception)
            assert "repair`" not in run.exception.remedy
        assert len([item for item in RecordingReader(path).items() if isinstance(item, Chunk)]) == 5
        os.kill(recorder.pid, signal.SIGKILL)
        recorder.wait(10)
        _, inspected = printed("inspect", str(path))
        assert "recording was interrupted" in inspected
        assert printed("repair", str(path))[0] == 0
    finally:
        recorder.kill()
        recorder.wait(10)
        recorder.stdin.close()
        recorder.stdout.close()


def test_incomplete_end_of_a_recording_in_progress_is_no_damage(tmp_path: Path) -> None:
    path = tmp_path / "r.mcap"
    writer = RecordingWriter(path, start_ns=START_NS)
    for number in range(5):
        writer.write(Chunk("test:link", START_NS + number * 200_000_000, bytes(2500)))
    whole = path.read_bytes()
    os.truncate(path, len(whole) - 700)  # as the system has written a part of it only
    reader = RecordingReader(path)
    assert reader.info.in_progress
    assert [item for item in reader.items() if isinstance(item, Chunk)]
    assert reader.damage is None
    writer.close()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole[:-700])
    reader = RecordingReader(cut)
    list(reader.items())
    assert not reader.info.in_progress
    assert reader.damage is not None


def test_disk_that_is_full_at_the_start_leaves_no_empty_recording(tmp_path: Path) -> None:
    mount = shutil.which("mount")
    folder = tmp_path / "full"
    folder.mkdir()
    arguments = [str(mount), "-t", "tmpfs", "-o", "size=16k", "tmpfs", str(folder)]
    if mount is None or subprocess.run(arguments, capture_output=True, check=False).returncode:
        pytest.skip("mounting a small file system needs root")
    try:
        (folder / "other").write_bytes(bytes(8192))
        with pytest.raises(RecordingError, match="disk full"):
            RecordingWriter(folder / "r.mcap", start_ns=START_NS, vehicle_toml="x" * 40_000)
        assert not (folder / "r.mcap").exists()
    finally:
        subprocess.run(["umount", str(folder)], check=True)


MOST_LOST_NS = 300_000_000

PACED_RECORDER = """
import sys
from gateway.core.clock import SystemClock
from gateway.core.links.source import Chunk
from gateway.core.recording.writer import RecordingWriter

clock = SystemClock()
writer = RecordingWriter(sys.argv[1], start_ns=clock.now_ns(), vehicle_toml="x = 1", sources=["test"])
due_ns = clock.now_ns()
number = 0
while True:  # 1000 chunks of 250 bytes a second, until killed; each is printed after it was written
    due_ns += 1_000_000
    clock.sleep_until_ns(due_ns)
    chunk = Chunk("test:link", clock.now_ns(), number.to_bytes(4, "little") + bytes(246))
    writer.write(chunk)
    print(number, chunk.host_ns, flush=True)
    number += 1
"""


@pytest.mark.parametrize("kill_after", [150, 357, 811])
def test_kill_loses_at_most_the_last_moments(tmp_path: Path, kill_after: int) -> None:
    path = tmp_path / "r.mcap"
    process = subprocess.Popen([sys.executable, "-c", PACED_RECORDER, str(path)], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    printed = [process.stdout.readline() for _ in range(kill_after)]
    os.kill(process.pid, signal.SIGKILL)
    printed += process.stdout.readlines()
    process.stdout.close()
    assert process.wait(10) == -signal.SIGKILL
    last_number, last_ns = map(int, [line for line in printed if line.endswith("\n")][-1].split())

    reader = RecordingReader(path)
    chunks = [item for item in reader.items() if isinstance(item, Chunk)]
    assert not reader.info.finished
    assert [int.from_bytes(chunk.data[:4], "little") for chunk in chunks] == list(range(len(chunks)))
    assert last_ns - chunks[-1].host_ns <= MOST_LOST_NS
    assert len(chunks) >= last_number - 300

    repaired = tmp_path / "repaired.mcap"
    repair_recording(path, repaired)
    with repaired.open("rb") as file:
        messages = make_reader(file, validate_crcs=True).iter_messages([raw_topic("test:link")])
        stock = [message.data for _, _, message in messages]
    assert stock == [chunk.data for chunk in chunks]
    assert RecordingReader(repaired).vehicle_toml == "x = 1"
