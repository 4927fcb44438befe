"""Recordings survive kills, power cuts, full disks, removed folders and clock steps."""

import shutil
import struct
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from gateway.core.clock import SystemClock
from gateway.core.links.source import Chunk
from gateway.core.recording.reader import RecordingReader
from gateway.core.recording.writer import RecordingWriter
from gateway.core.session.core import SessionCore
from gateway.core.session.reasons import SessionCode
from gateway.core.text.wording import text
from gateway.publishing.admission import MOST_CONNECTIONS
from gateway.upkeep.repair import repair_recording
from tests.reliability.sessions import TIMEOUT_S, Items, start
from tests.reliability.streams import link_bytes, simulated
from tools.mqtt_broker import free_port
from tools.reliability.kills import hub_bytes, kill_once

PAGE = 4096


@pytest.fixture(scope="module")
def recorded(lab, tmp_path_factory) -> tuple[Path, bytes]:
    path = tmp_path_factory.mktemp("whole") / "r.mcap"
    with_results = SessionCore(lab[1], recorder=RecordingWriter(path, start_ns=lab[0][0].host_ns))
    for item in lab[0]:
        with_results.take(item)
    with_results.finish()
    return path, link_bytes(lab[0])


@pytest.mark.parametrize("after_s", [0.08, 0.43, 0.9])
def test_killed_command_keeps_its_recording(tmp_path: Path, after_s: float) -> None:
    chunks, toml = hub_bytes(1.5)
    (tmp_path / "vehicle.toml").write_text(toml)
    killed = kill_once(tmp_path / "kill", chunks, after_s)
    assert killed.ours >= killed.safe
    assert killed.stock == killed.ours
    assert killed.repaired >= killed.ours


def test_power_cut_that_truncates(recorded, tmp_path: Path) -> None:
    path, sent = recorded
    whole = path.read_bytes()
    rng = np.random.default_rng(1)
    previous = -1
    for size in sorted(rng.integers(200, len(whole), 40).tolist()):
        cut = tmp_path / f"{size}.mcap"
        cut.write_bytes(whole[:size])
        reader = RecordingReader(cut)
        got = link_bytes(reader.items())
        assert sent.startswith(got)
        assert len(got) >= previous
        previous = len(got)
        assert reader.damage is None or "repair" in text(reader.damage)
    assert previous > 0.9 * len(sent)


@pytest.mark.parametrize("content", ["zeros", "noise", "older"])
def test_power_cut_that_tears_pages(recorded, tmp_path: Path, content: str) -> None:
    path, sent = recorded
    whole = path.read_bytes()
    rng = np.random.default_rng(2)
    for number in range(5):
        torn = bytearray(whole)
        # The last pages of the data were being written; some arrived, some did not. The summary behind them is told
        # by the footer: record head, summary's position, two more fields, and the magic.
        (summary,) = struct.unpack_from("<Q", whole, len(whole) - 8 - 20)
        first = summary // PAGE - 16
        for page in rng.choice(np.arange(first, first + 16), 5, replace=False).tolist():
            old = {"zeros": bytes(PAGE), "noise": rng.bytes(PAGE), "older": whole[:PAGE]}[content]
            torn[page * PAGE : (page + 1) * PAGE] = old
        target = tmp_path / f"{content}{number}.mcap"
        target.write_bytes(torn)
        reader = RecordingReader(target)
        got = [item for item in reader.items() if isinstance(item, Chunk)]
        begin = link_bytes(got)
        # Results take a part of every page.
        whole_part = int(0.8 * first * PAGE * len(sent) / len(whole))
        assert begin[:whole_part] == sent[:whole_part]
        assert reader.damage is not None
        fixed = tmp_path / f"{content}{number}.fixed.mcap"
        repair_recording(target, fixed)
        rescued = RecordingReader(fixed)
        assert len(link_bytes(rescued.items())) >= 0.8 * first * PAGE * len(sent) / len(whole)
        assert rescued.damage is None


LIMITED = """
import resource, sys
resource.setrlimit(resource.RLIMIT_FSIZE, (300_000, 300_000))
from gateway.core.cli import main
sys.argv = ["treadlink", *sys.argv[1:]]
main()
"""


@pytest.mark.parametrize("command", ["live", "record"])
def test_full_disk_stops_the_recording_only(tmp_path: Path, command: str) -> None:
    path = tmp_path / "r.mcap"
    options = ["--plain", "--record", str(path)] if command == "live" else ["--out", str(path)]
    done = subprocess.run(
        [sys.executable, "-c", LIMITED, command, "sim:lab?speed=max&duration=8", *options],
        capture_output=True, text=True, timeout=90, check=False,
    )  # fmt: skip
    printed = done.stdout + done.stderr
    assert "RECORDING STOPPED" in printed
    assert "INCOMPLETE" in printed
    assert "Traceback" not in printed
    assert done.returncode == 1
    assert path.stat().st_size <= 300_000
    if command == "live":
        assert sum(line.startswith("W1 ") for line in done.stdout.splitlines()) > 60, "the live view continues"
    got = link_bytes(RecordingReader(path).items())
    whole, _ = simulated("sim:lab?speed=max&duration=8")
    assert link_bytes(whole).startswith(got)
    assert len(got) > 150_000


CROWDED = LIMITED.replace("RLIMIT_FSIZE, (300_000, 300_000)", "RLIMIT_NOFILE, ({0}, {0})")
ATTACK = """
import itertools, resource, socket, sys, time
resource.setrlimit(resource.RLIMIT_NOFILE, (4000, 4000))
ports = [int(port) for port in sys.argv[1:]]
while any(socket.socket().connect_ex(("127.0.0.1", port)) for port in ports):
    time.sleep(0.05)
held = []
for number in itertools.count():
    held.append(socket.socket())
    held[-1].bind((f"127.0.0.{2 + number % 200}", 0))
    held[-1].setblocking(False)
    held[-1].connect_ex(("127.0.0.1", ports[number % len(ports)]))
    if number == 3000:
        print("held", flush=True)
    if number >= 3000:
        held.pop(0).close()
    if number % 50 == 0:
        time.sleep(0.02)
"""


@pytest.mark.parametrize(
    ("outputs", "descriptors"),
    [(["web"], 128), pytest.param(["web", "foxglove", "prometheus"], 1024, marks=pytest.mark.slow)],
)
def test_recording_goes_on_over_its_parts_while_strangers_hold_connections(
    tmp_path: Path, outputs: list[str], descriptors: int
) -> None:
    """From 200 addresses they take what they get; a listener bounds also those that it has not yet sent away."""
    ports = [free_port() for _ in outputs]
    arguments = ["live", "sim:lab?duration=5", "--plain", "--record", str(tmp_path / "r.mcap"), "--split", "1s"]
    for name, port in zip(outputs, ports, strict=True):
        arguments += ["--publish", f"{name}://127.0.0.1:{port}"]
    command = [sys.executable, "-c", CROWDED.format(descriptors), *arguments]
    attack = [sys.executable, "-c", ATTACK, *map(str, ports)]
    output = subprocess.PIPE
    with (
        subprocess.Popen(command, stdout=output, stderr=subprocess.STDOUT, text=True) as process,
        subprocess.Popen(attack, stdout=output) as stranger,
    ):
        assert stranger.stdout is not None
        assert stranger.stdout.readline() == b"held\n"
        threads = 0
        while process.poll() is None and len(list(tmp_path.iterdir())) < 4:
            with suppress(OSError):
                threads = max(threads, len(list(Path(f"/proc/{process.pid}/task").iterdir())))
        printed = process.communicate(timeout=60)[0]
        stranger.kill()
    assert process.returncode == 0, printed
    assert threads < 40 + MOST_CONNECTIONS * len(outputs)
    assert "Traceback" not in printed
    assert "Too many open files" not in printed
    parts = sorted(tmp_path.iterdir(), key=lambda path: path.stat().st_mtime_ns)
    assert len(parts) >= 4
    whole, _ = simulated("sim:lab?speed=max&duration=5")
    assert link_bytes([item for path in parts for item in RecordingReader(path).items()]) == link_bytes(whole)


def test_full_file_system(tmp_path: Path, lab) -> None:
    items, vehicle = lab
    folder = tmp_path / "small"
    folder.mkdir()
    mount = shutil.which("mount")
    mounted = (
        mount
        and not subprocess.run(
            [mount, "-t", "tmpfs", "-o", "size=200k", "tmpfs", str(folder)], capture_output=True, check=False
        ).returncode
    )
    if not mounted:
        pytest.skip("mounting a small file system needs root; the file size limit above covers the case")
    try:
        path = folder / "r.mcap"
        live = start(Items(items), vehicle, RecordingWriter(path, start_ns=items[0].host_ns))
        assert live.wait(TIMEOUT_S)
        snapshot = live.close()
        (reason,) = [n.reason for n in snapshot.notices if n.reason.code is SessionCode.RECORDING_STOPPED]
        assert "disk full" in str(reason["error"])
        assert "Free some space" in str(reason["remedy"])
        assert snapshot.wheels[0].counters.revolutions > 45
        got = link_bytes(RecordingReader(path).items())
        assert link_bytes(items).startswith(got)
        assert len(got) > 100_000
    finally:
        subprocess.run(["umount", str(folder)], check=True)


def test_removed_folder_stops_the_recording_only(tmp_path: Path, lab) -> None:
    items, vehicle = lab
    folder = tmp_path / "gone"
    folder.mkdir()
    writer = RecordingWriter(folder / "r.mcap", start_ns=items[0].host_ns)

    def vanish():
        for number, item in enumerate(items):
            if number == 100:
                shutil.rmtree(folder)
            yield item

    live = start(Items(vanish()), vehicle, writer)
    assert live.wait(TIMEOUT_S)
    snapshot = live.close()
    (reason,) = [n.reason for n in snapshot.notices if n.reason.code is SessionCode.RECORDING_STOPPED]
    assert "was deleted while it was written" in str(reason["error"])
    assert snapshot.wheels[0].counters.revolutions > 45


def test_clock_ignores_steps_of_the_system_clock(monkeypatch) -> None:
    clock = SystemClock()
    before = clock.now_ns()
    monkeypatch.setattr(time, "time_ns", lambda: 0)
    monkeypatch.setattr(time, "time", lambda: 0.0)
    assert 0 <= clock.now_ns() - before < 60_000_000_000


@pytest.mark.parametrize("step_s", [-3600.0, -0.5, 7200.0])
def test_jumping_arrival_times_lose_no_data(tmp_path: Path, lab, step_s: float) -> None:
    items, vehicle = lab
    middle = items[len(items) // 2].host_ns
    jumped = [
        Chunk(item.link, item.host_ns + (round(step_s * 1e9) if item.host_ns >= middle else 0), item.data)
        for item in items
        if isinstance(item, Chunk)
    ]
    path = tmp_path / "r.mcap"
    core = SessionCore(vehicle, recorder=RecordingWriter(path, start_ns=jumped[0].host_ns))
    results = [result for item in jumped for result in core.take(item)] + core.finish()
    steady = SessionCore(vehicle)
    expected = [result for item in items for result in steady.take(item)] + steady.finish()
    assert [r.revolution.start_s for r in results] == [r.revolution.start_s for r in expected]
    got = [item for item in RecordingReader(path).items() if isinstance(item, Chunk)]
    assert got == jumped
