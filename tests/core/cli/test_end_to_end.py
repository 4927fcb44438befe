"""End-to-end tests of the command with files, real processes and pseudo-terminals."""

import csv
import json
import os
import signal
import subprocess
import sys
import threading
import tty
from pathlib import Path

import pytest
from click.testing import CliRunner

from gateway.core.cli import COMMANDS
from gateway.core.cli import treadlink as command
from gateway.core.errors import RecordingError, TreadlinkError
from gateway.core.links.source import Chunk
from gateway.core.recording.reader import RecordingReader
from gateway.simulator.link_faults import parse_faults
from gateway.simulator.scenario import load_scenario, vehicle_toml
from gateway.simulator.simulation import simulate
from tests.testkit.commands import invoked, program, run

TIMEOUT_S = 90


def treadlink(*arguments, cwd=None, check=True):
    done = subprocess.run(
        [sys.executable, "-m", "gateway.core.cli", *map(str, arguments)],
        capture_output=True, text=True, cwd=cwd, timeout=TIMEOUT_S, check=False,
    )  # fmt: skip
    if check:
        assert done.returncode == 0, done.stderr + done.stdout
    return done


def rows_of(path):
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    for row in rows:
        row.pop("recording")
    return sorted(rows, key=lambda row: (row["position"], int(row["revolution"])))


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """A recording of the simulator by `treadlink live`, and its output."""
    path = tmp_path_factory.mktemp("cli") / "lab.mcap"
    done = treadlink("live", "sim:lab?speed=max&duration=8", "--plain", "--record", path)
    return path, done.stdout


def test_live_prints_revolutions_and_a_summary(recording):
    path, printed = recording
    assert "km/h" in next(line for line in printed.splitlines() if not line.startswith("#"))
    assert "revolutions" in printed
    assert f"recording: {path}" in printed
    assert f"treadlink replay {path}" in printed
    assert "Cw" in printed


def test_replay_prints_the_same_lines(recording):
    path, printed = recording
    again = run("replay", path, "--speed", "max", "--plain")

    def of_wheels(text):
        return [line for line in text.splitlines() if line.startswith("W1 ") and "±" in line]

    assert of_wheels(again) == of_wheels(printed)
    assert len(of_wheels(again)) > 40


def test_estimate_writes_reproducible_tables(recording, tmp_path):
    path, _ = recording
    run("estimate", path, "--csv", tmp_path / "a.csv", "--json", tmp_path / "a.jsonl", "--parquet", tmp_path / "a.pq")
    treadlink("estimate", path, "--csv", tmp_path / "b.csv")
    rows = rows_of(tmp_path / "a.csv")
    assert rows == rows_of(tmp_path / "b.csv")
    assert len(rows) > 40
    assert abs(float(rows[-1]["speed_mps"]) * 3.6 - 65.0) < 0.1
    assert float(rows[-1]["speed_mps_std"]) > 0
    lines = (tmp_path / "a.jsonl").read_text().splitlines()
    assert len(lines) == len(rows)
    assert json.loads(lines[0])["position"] == rows[0]["position"]
    again = program("estimate", path, "--csv", tmp_path / "a.csv")
    assert again.status == 1
    assert "--force" in again.stderr


class Hub:
    """A simulated hub on a real pseudo-terminal."""

    def __init__(self, scenario, duration_s, faults=(), seed=2):
        self.master, self.slave = os.openpty()
        tty.setraw(self.slave)
        self.port = os.ttyname(self.slave)
        self.faults = tuple(parse_faults(faults, seed))
        self.simulation = simulate(load_scenario(scenario), seed=seed, duration_s=duration_s, faults=self.faults)
        self.sent = b""

    def play(self):
        """Write all bytes, paced by the small buffer of the pseudo-terminal."""
        for chunk in self.simulation.chunks("pty", 0):
            self.sent += chunk.data
            view = memoryview(chunk.data)
            while view:
                view = view[os.write(self.master, view) :]

    def unplug(self):
        os.close(self.slave)
        os.close(self.master)


def test_bad_serial_link_loses_only_damaged_frames(tmp_path):
    hub = Hub("demo", 6.0, ["flip:rate=0.01", "drop:rate=0.01"])
    clean = b"".join(c.data for c in simulate(load_scenario("demo"), seed=2, duration_s=6.0).chunks("pty", 0))
    config = tmp_path / "vehicle.toml"
    config.write_text(vehicle_toml(load_scenario("demo")))
    process = subprocess.Popen(
        [
            sys.executable, "-m", "gateway.core.cli", "record", f"serial://{hub.port}?baudrate=921600",
            "--config", config, "--out", tmp_path / "pty.mcap",
        ],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    try:
        # The recorder says so when the port is open; before that the terminal would swallow bytes.
        assert any("connected" in line for line in iter(process.stderr.readline, ""))
        hub.play()
        # everything is in the recording when its last bytes are
        wait_until_recorded(tmp_path / "pty.mcap", len(hub.sent))
        process.send_signal(signal.SIGINT)
        printed, _ = process.communicate(timeout=TIMEOUT_S)
    finally:
        process.kill()
        hub.unplug()
    recorded = b"".join(item.data for item in RecordingReader(tmp_path / "pty.mcap").items() if isinstance(item, Chunk))
    assert recorded == hub.sent
    from firmware_protocol.decoder import FrameDecoder

    reference, decoder = FrameDecoder(), FrameDecoder()
    every = reference.feed(clean) + reference.finish()
    arrived = decoder.feed(recorded) + decoder.finish()
    flipped = sum(fault.counts.frames_hit for fault in hub.faults if fault.kind == "flip")
    dropped = sum(fault.counts.frames_hit for fault in hub.faults if fault.kind == "drop")
    assert flipped > 30
    assert dropped > 30
    keys = {(frame.hub, frame.wheel, frame.seq) for frame in every}
    got = {(frame.hub, frame.wheel, frame.seq) for frame in arrived}
    assert got <= keys
    assert len(keys) - len(got) == flipped + dropped
    # a loss is counted when a later frame of the same source shows it; at most the last of each can be missing
    assert flipped + dropped - 9 <= decoder.counters.lost <= flipped + dropped
    assert f"{decoder.counters.lost} lost" in printed


def wait_until_recorded(path: Path, size: int) -> None:
    """Wait for a limited time until the recording contains `size` link bytes."""
    ticker = threading.Event()
    for _ in range(TIMEOUT_S * 10):
        ticker.wait(0.1)
        if path.exists():
            held = sum(len(item.data) for item in RecordingReader(path).items() if isinstance(item, Chunk))
            if held >= size:
                return
    raise AssertionError(f"{path} never held {size} bytes")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("live", "sreial:///dev/ttyUSB0"), ("unknown source", "serial:")),
        (("live", "serial:///dev/ttyNOSUCH0", "--plain"), ("ttyNOSUCH0",)),
        (("live", "sim:nosuch"), ("nosuch", "demo")),
        (("replay", "nosuch.mcap"), ("nosuch.mcap",)),
        (("estimate", "nosuch.mcap"), ("nosuch.mcap", "Check the path")),
        (("live", "sim:demo", "--config", "nosuch.toml"), ("nosuch.toml",)),
        (("live", "sim:demo?speed=fast"), ("speed", "fast")),
    ],
)
def test_errors_name_the_cause_and_the_remedy(arguments, words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    error = CliRunner().invoke(command, arguments).exception
    assert isinstance(error, TreadlinkError)
    for word in words:
        assert word in f"{error}\n{error.remedy}"


@pytest.mark.parametrize(
    ("arguments", "likely"),
    [
        (("estimate", "day/mondya.mcap"), "day/monday.mcap"),
        (("estimate", "day/monday.mcpa"), "day/monday.mcap"),
        (("import", "day/run1.cvs", "--guess"), "day/run.csv"),
        (("live", "sim:demo", "--config", "day/cra.toml"), "day/car.toml"),
        (("campaign", "dya", "--out", "new.dataset"), "day"),
        (("trends", "fleet.datset"), "fleet.dataset"),
        (("live", "nmea:day/lgo.nmea"), "day/log.nmea"),
        (("estimate", "day/friday_at_noon.mcap"), None),
        (("estimate", "nosuch/monday.mcap"), None),
    ],
)
def test_a_file_of_a_similar_name_is_proposed(arguments, likely, tmp_path, monkeypatch):
    (tmp_path / "day").mkdir()
    (tmp_path / "fleet.dataset").mkdir()
    for name in ("monday.mcap", "monday.csv", "run.csv", "car.toml", "log.nmea"):
        (tmp_path / "day" / name).touch()
    monkeypatch.chdir(tmp_path)
    error = CliRunner().invoke(command, arguments).exception
    assert isinstance(error, TreadlinkError)
    assert "does not exist" in str(error) or "no such file" in str(error)
    assert error.remedy == "Check the path." + (f" Did you mean {Path(likely)}?" if likely else "")


def test_error_is_printed_without_a_traceback(tmp_path):
    done = treadlink("estimate", "nosuch.mcap", cwd=tmp_path, check=False)
    assert done.returncode == 1
    assert done.stderr.startswith("treadlink: ")
    assert "nosuch.mcap" in done.stderr
    assert done.stderr.splitlines()[-1].startswith("  Check the path")


def test_existing_recording_is_not_overwritten(recording, tmp_path):
    path, _ = recording
    before = path.read_bytes()
    done = invoked("live", "sim:lab?speed=max&duration=1", "--plain", "--record", path)
    assert isinstance(done.exception, RecordingError)
    assert "exists" in str(done.exception)
    assert path.read_bytes() == before


def test_every_command_has_help():
    for name in COMMANDS:
        done = run(name, "--help")
        assert "Usage" in done
        assert len(done) > 200


@pytest.mark.parametrize("group", ["calibrate", "command", "keys", "protocol"])
def test_summaries_of_subcommands_are_whole(group):
    _, _, commands = run(group, "--help").partition("Commands:")
    assert commands
    assert "..." not in commands


def test_configuration_of_the_dbc_has_its_own_default():
    help_text = " ".join(run("protocol", "dbc", "--help").split())
    assert "[default: FL, FR, RL, RR and four more]" in help_text


def test_interrupt_ends_a_live_session_with_its_summary(tmp_path):
    process = subprocess.Popen(
        [sys.executable, "-m", "gateway.core.cli", "live", "sim:lab", "--plain", "--record", tmp_path / "i.mcap"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    try:
        seen = 0
        for line in iter(process.stdout.readline, ""):
            seen += "±" in line
            if seen >= 5:
                break
        process.send_signal(signal.SIGINT)
        rest, errors = process.communicate(timeout=TIMEOUT_S)
    finally:
        process.kill()
    assert process.returncode == 0, errors
    assert "recording:" in rest
    assert RecordingReader(tmp_path / "i.mcap").info.finished
