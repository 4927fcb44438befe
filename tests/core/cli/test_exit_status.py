"""Exit status and message of every command, also without memory and on a loop of symbolic links."""

import csv
import errno
import io
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

from firmware_protocol.codec import encode_frame
from firmware_protocol.messages import Frame, MessageType, SampleBlock
from gateway.core.cli import COMMANDS, main, treadlink
from gateway.core.errors import TreadlinkError
from gateway.core.links.source import Chunk
from gateway.core.recording.writer import RecordingWriter
from gateway.simulator.scenario import load_scenario, vehicle_toml
from gateway.simulator.simulation import simulate
from tests.core.wheels.rolling_signals import SCALE_MPS2, hello
from tests.testkit.commands import invoked

START_NS = 1_700_000_000_000_000_000
TIMEOUT_S = 60
REQUIRE = """[tire]
radius_mm = 320.0
[security]
policy = "require"
[[wheel]]
position = "W1"
hub = 0
wheel = 0
sensor_id = "0000b001"
"""


def record(path: Path, *data: bytes) -> None:
    writer = RecordingWriter(path, start_ns=START_NS, vehicle_toml=vehicle_toml(load_scenario("lab")))
    for number, chunk in enumerate(data):
        writer.write(Chunk("serial:/dev/x", START_NS + number * 10_000_000, chunk))
    writer.close()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Recordings of a rolling wheel, a standing wheel, noise and nothing."""
    import numpy as np

    folder = tmp_path_factory.mktemp("status")
    rolling = [chunk.data for chunk in simulate(load_scenario("lab"), duration_s=1.0).chunks("x", 0)]
    record(folder / "rolling.mcap", *rolling)
    noise = np.random.default_rng(1).normal(0.0, 3.4, (19200, 1)) - 9.81
    counts = np.rint(noise / SCALE_MPS2).astype(np.int16)
    frames = [Frame(MessageType.HELLO, 0, 0, 0, 0, hello())]
    for number, index in enumerate(range(0, len(counts), 32)):
        block = SampleBlock(index, 0b100, counts[index : index + 32])
        frames.append(Frame(MessageType.SAMPLES, 0, 0, number + 1, round(index / 9600.0 * 1e6), block))
    record(folder / "standing.mcap", *map(encode_frame, frames))
    record(folder / "noise.mcap", np.random.default_rng(1).bytes(5000))
    record(folder / "empty.mcap")
    (folder / "damaged.mcap").write_bytes((folder / "rolling.mcap").read_bytes()[:-30_000])
    (folder / "require.toml").write_text(REQUIRE)
    (folder / "estimator.toml").write_text(
        '[tire]\nradius_mm = 320\n[tire.reference]\nestimator = "nosuch"\n'
        '[[wheel]]\nposition = "FL"\nhub = 0\nwheel = 0\n'
    )
    (folder / "keys").touch(0o600)
    return folder


def run(folder: Path, line: str) -> tuple[int, str]:
    """Return the exit status, an error that `main` explains counting as 1, and what was printed."""
    before = Path.cwd()
    os.chdir(folder)
    try:
        result = invoked(line)
    finally:
        os.chdir(before)
    return result.exit_code, result.output + str(result.exception or "")


@pytest.mark.parametrize(
    ("line", "status", "words"),
    [
        ("estimate rolling.mcap", 0, ""),
        ("estimate standing.mcap", 1, "the wheel stands still"),
        ("estimate rolling.mcap standing.mcap", 1, "the wheel stands still"),
        ("estimate noise.mcap", 1, "no frame was received"),
        ("estimate empty.mcap", 1, "no frame was received"),
        ("estimate damaged.mcap", 1, ""),
        ("estimate rolling.mcap --config require.toml --keys keys", 1, "frames were rejected"),
        ("replay rolling.mcap --speed max --plain", 0, ""),
        ("replay standing.mcap --speed max --plain", 1, "the wheel stands still"),
        ("replay noise.mcap --speed max --plain", 1, "no frame was received"),
        ("replay rolling.mcap --speed max --plain --config require.toml --keys keys", 1, "frames were rejected"),
        ("live replay:rolling.mcap?speed=max --plain", 0, ""),
        ("live replay:noise.mcap?speed=max --plain", 1, "no frame was received"),
        ("record replay:standing.mcap?speed=max --out a.mcap", 0, "the wheel stands still"),
        ("record replay:noise.mcap?speed=max --out b.mcap", 1, "no frame was received"),
        ("record serial:/nosuch/port --out c.mcap", 1, "there is no port"),
        ("inspect rolling.mcap", 0, ""),
        ("inspect noise.mcap --json", 1, ""),
        ("inspect empty.mcap", 1, ""),
        ("inspect damaged.mcap", 1, "DAMAGED"),
        ("inspect nosuch.mcap", 1, "nosuch.mcap"),
        ("repair rolling.mcap", 0, "nothing to repair"),
        ("diagnose noise.mcap", 1, ""),
        ("calibrate rolling.mcap", 1, "no wheel"),
        ("simulate nosuch --out d.mcap", 1, "nosuch"),
        ("simulate lab", 2, "--out"),
        ("protocol header", 0, "#"),
        ("figures --list", 0, "ring-fig"),
        ("keys list --keys keys", 0, "no keys"),
        ("command start tcp://127.0.0.1:1", 1, "cannot connect"),
        ("doctor --config nosuch.toml", 1, "nosuch.toml"),
        ("doctor --config estimator.toml", 1, "'nosuch' is not an estimator"),
        ("nosuch", 2, "nosuch"),
    ],
)
def test_status_says_whether_there_is_a_result(folder: Path, line: str, status: int, words: str) -> None:
    result, printed = run(folder, line)
    assert result == status, printed
    assert words in printed
    assert "Traceback" not in printed


@pytest.mark.parametrize("name", COMMANDS)
def test_wrong_option_is_a_wrong_command_line(folder: Path, name: str) -> None:
    assert run(folder, f"{name} --nosuch")[0] == 2


def test_json_lines_name_the_missing_revolutions(folder: Path, tmp_path: Path) -> None:
    run(folder, f"estimate standing.mcap --json {tmp_path}/a.jsonl --csv {tmp_path}/a.csv")
    (row,) = [json.loads(line) for line in (tmp_path / "a.jsonl").read_text().splitlines()]
    assert (row["recording"], row["position"], row["revolution"]) == ("standing.mcap", "W1", None)
    (reason,) = row["missing_reasons"]
    assert reason["code"] == "no_revolution"
    assert reason["values"]["why"][0]["code"] == "wheel_stands"
    assert list(csv.DictReader((tmp_path / "a.csv").open())) == []


def test_table_on_standard_output_is_alone_there(folder: Path) -> None:
    result = invoked(f"estimate {folder}/rolling.mcap --csv -")
    assert result.exit_code == 0
    rows = list(csv.DictReader(io.StringIO(result.stdout)))
    assert {row["position"] for row in rows} == {"W1"}
    assert "mean speed" in result.stderr
    assert not Path("-").exists()


@pytest.mark.parametrize("line", ["estimate rolling.mcap --json -", "protocol vectors"])
def test_closed_pipe_is_quiet(folder: Path, line: str) -> None:
    reader, writer = os.pipe()
    with subprocess.Popen(
        [sys.executable, "-m", "gateway.core.cli", *line.split()], cwd=folder, stdout=writer, stderr=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(map(os.path.abspath, sys.path))},
    ) as process:  # fmt: skip
        os.close(writer)
        os.close(reader)
        _, errors = process.communicate(timeout=TIMEOUT_S)
    assert process.returncode == 141
    assert b"Error" not in errors
    assert b"Broken" not in errors


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="the system has no /dev/full")
@pytest.mark.parametrize(
    "line", ["inspect rolling.mcap", "estimate rolling.mcap", "protocol vectors", "doctor --json", "--help"]
)
def test_refused_output_is_named_and_is_no_success(folder: Path, line: str) -> None:
    with Path("/dev/full").open("wb") as full:
        result = subprocess.run(
            [sys.executable, "-m", "gateway.core.cli", *line.split()], cwd=folder, stdout=full, stderr=subprocess.PIPE,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(map(os.path.abspath, sys.path))}, timeout=TIMEOUT_S,
            check=False,
        )  # fmt: skip
    assert result.returncode == 1
    assert b"cannot be written: No space left on device" in result.stderr
    assert b"Traceback" not in result.stderr


def test_every_command_is_in_the_table() -> None:
    """The page for users has a row for every command."""
    page = (Path(__file__).parents[3] / "docs" / "reference" / "exit-status.md").read_text("utf-8")
    missing = [name for name in COMMANDS if f"`{name}`" not in page]
    assert missing == []


MAPPED = "libgfortran-8f1e9814.so.5.0.0: failed to map segment from shared object"
SHORTAGES = {
    "array": MemoryError("Unable to allocate 9.00 GiB for an array with shape (1,)"),
    "library": ImportError(MAPPED),
    "library of numpy": ImportError(f"IMPORTANT\n\nOriginal error was: {MAPPED}\n"),
    "process": OSError(errno.ENOMEM, os.strerror(errno.ENOMEM)),
}


def ended(monkeypatch: pytest.MonkeyPatch, path: Path, error: Exception) -> pytest.ExceptionInfo[BaseException]:
    """Return how `treadlink repair` ends when its work fails with an error."""

    def fail(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr("gateway.upkeep.repair.repair_recording", fail)
    monkeypatch.setattr("gateway.core.cli.stop_signals.install", lambda: None)
    monkeypatch.setattr(sys, "argv", ["treadlink", "repair", str(path)])
    with pytest.raises(BaseException) as raised:
        main()
    return raised


@pytest.mark.parametrize("shortage", SHORTAGES)
def test_no_memory_is_a_message(monkeypatch, capsys, tmp_path, shortage):
    (tmp_path / "drive.mcap").touch()
    raised = ended(monkeypatch, tmp_path / "drive.mcap", SHORTAGES[shortage])
    assert isinstance(raised.value, SystemExit)
    assert raised.value.code == 1
    printed = capsys.readouterr().err
    assert "there is not enough memory" in printed
    assert "ulimit -v" in printed


def test_a_missing_module_remains_a_fault_of_the_program(monkeypatch, tmp_path):
    (tmp_path / "drive.mcap").touch()
    raised = ended(monkeypatch, tmp_path / "drive.mcap", ImportError("cannot import name 'x' from 'y'"))
    assert isinstance(raised.value, ImportError)


INPUTS = [
    "inspect {loop}",
    "estimate {loop}",
    "estimate {loop} {other}",
    "orders {loop}",
    "export {loop} {folder}/out.csv",
    "replay {loop} --plain",
    "repair {loop}",
    "compact {loop}",
    "diagnose {loop}",
    "diagnose {loop} {other}",
    "campaign {loop} --out {folder}/dataset",
    "import {loop} {folder}/out.mcap --map {other}",
    "plan {loop}",
    "plan lab --sensors {loop}",
    "doctor --config {loop}",
]
OUTPUTS = ["plan lab --sensor ADXL382 --json {loop} --force"]


@pytest.mark.parametrize("line", [*INPUTS, *OUTPUTS])
def test_loop_is_a_message(tmp_path: Path, line: str) -> None:
    for name in ("loop", "loop.svg"):
        (tmp_path / name).symlink_to(tmp_path / name)
    (tmp_path / "other").write_text("")
    words = line.format(loop=tmp_path / "loop", other=tmp_path / "other", folder=tmp_path)
    result = CliRunner().invoke(treadlink, words)
    assert result.exit_code == 1
    assert isinstance(result.exception, (SystemExit, TreadlinkError)), repr(result.exception)
    assert "loop" in f"{result.output}{result.exception}"
    assert (tmp_path / "loop").is_symlink()
