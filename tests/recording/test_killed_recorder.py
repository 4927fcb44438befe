"""`kill -9` of a recorder in real time loses at most 0.3 s."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from mcap.reader import make_reader

from gateway.io.source import Chunk
from gateway.recording.mcap_layout import raw_topic
from gateway.recording.reader import RecordingReader
from gateway.recording.repair import repair_recording

MOST_LOST_NS = 300_000_000

RECORDER = """
import sys
from gateway.clock import SystemClock
from gateway.io.source import Chunk
from gateway.recording.writer import RecordingWriter

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
    process = subprocess.Popen([sys.executable, "-c", RECORDER, str(path)], stdout=subprocess.PIPE, text=True)
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
