"""The example package of plug-ins, installed and used; packages that do not fit are refused with the reason."""

import json
import os
import re
import shutil
import signal
import socket
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from firmware_protocol import wire

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "examples" / "plugin"
BAD = {
    "treadlink.sources": {"sim": "bad_plugin:KIND", "late": "bad_plugin:missing", "gone": "bad_plugin.leaving:KIND"},
    "treadlink.estimators": {
        "shape": "bad_plugin:Shape",
        "torn": "bad_plugin.torn:Anything",
        "leaving": "bad_plugin.leaving:Anything",
        "raising": "bad_plugin:Raising",
        "other": "bad_plugin:Raising",
        "greedy": "bad_plugin:Greedy",
        "undeclared": "bad_plugin:Undeclared",
    },
    "treadlink.effects": {"gravity": "bad_plugin:EFFECTS", "number": "bad_plugin:NUMBER"},
    "treadlink.importers": {"csv": "bad_plugin:Shape", "wavy": "bad_plugin:Shape"},
    "treadlink.sinks": {"mqtt": "bad_plugin:KIND", "thing": "bad_plugin:KIND"},
}
BAD_MODULE = """
from gateway.diagnosis.effects.wheel_motion import Gravity
from gateway.core.quantity import Quantity

KIND = object()
NUMBER = 7
EFFECTS = (Gravity(),)


class Shape:
    name = "shape"


class Raising:
    name = "raising"
    quantities = (Quantity("share_of_nothing", "1 / 0"),)

    def update(self, revolution, average, conditions):
        raise ZeroDivisionError(f"of the plug-in \x1b[31m {revolution.index}")

    def reset(self):
        pass


class Greedy(Raising):
    name = "greedy"
    quantities = (Quantity("mine", "free"), Quantity("rotation_rpm", "taken"))


class Undeclared(Raising):
    name = "undeclared"
    quantities = ()
"""


@pytest.fixture(scope="module")
def example(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Install the example package into a folder of its own."""
    folder = tmp_path_factory.mktemp("site")
    source = tmp_path_factory.mktemp("source") / "plugin"
    shutil.copytree(EXAMPLE, source)
    options = ["--quiet", "--no-deps", "--no-build-isolation", "--no-index", "--disable-pip-version-check"]
    subprocess.run(
        [sys.executable, "-m", "pip", "install", *options, "--target", str(folder), str(source)], check=True, cwd=folder
    )
    return folder


@pytest.fixture(scope="module")
def bad(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Make a folder with an installed package whose plug-ins do not fit."""
    folder = tmp_path_factory.mktemp("bad")
    package, info = folder / "bad_plugin", folder / "bad_plugin-9.dist-info"
    package.mkdir()
    info.mkdir()
    (package / "__init__.py").write_text(BAD_MODULE)
    (package / "torn.py").write_text("import a_package_that_is_not_installed\n")
    (package / "leaving.py").write_text("raise SystemExit(0)\n")
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: bad-plugin\nVersion: 9\n")
    lines = []
    for group, names in BAD.items():
        lines += [f"[{group}]", *(f"{name} = {target}" for name, target in names.items())]
    (info / "entry_points.txt").write_text("\n".join(lines) + "\n")
    return folder


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("lab") / "lab.mcap"
    treadlink("simulate", "lab", "--duration", "2", "--out", str(path), folders=())
    return path


def environment(*folders: Path) -> dict[str, str]:
    return os.environ | {"PYTHONPATH": os.pathsep.join(map(str, (*folders, ROOT)))}


def treadlink(*arguments: str, folders: tuple[Path, ...], check: bool = True) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "gateway.core.cli", *arguments]
    done = subprocess.run(command, capture_output=True, text=True, env=environment(*folders), check=False)
    assert not check or done.returncode == 0, done.stderr
    return done


def plugin_checks(*folders: Path) -> dict[str, tuple[str, str]]:
    done = treadlink("doctor", "--json", folders=folders, check=False)
    checks = json.loads(done.stdout)
    return {c["name"]: (c["level"], c["text"]) for c in checks if c["name"].startswith("plug-in")}


@pytest.mark.parametrize("command", ["record", "live"])
def test_estimator_that_raises_is_told_once_counted_and_escaped(bad: Path, tmp_path: Path, command: str) -> None:
    """Its message has a number of its own and a code of a terminal each time."""
    out = ["--out", str(tmp_path / "r.mcap")] if command == "record" else ["--plain"]
    source = "sim:lab?speed=max&duration=4"
    done = treadlink(command, source, "--estimator", "raising", "--estimator", "kinematic", *out, folders=(bad,))
    printed = done.stdout + done.stderr
    assert "\x1b" not in printed
    assert done.stderr.count("Traceback") == 1
    assert done.stderr.count("estimator raising failed") == 2
    assert "estimator raising failed (10 times)" in done.stderr
    assert len(done.stderr) < 4000
    assert "ZeroDivisionError: of the plug-in" in printed


def test_doctor_lists_plugins(example: Path) -> None:
    assert plugin_checks(example) == {
        "plug-in udp": ("ok", "sources of treadlink-example 0.1.0"),
        "plug-in rotation": ("ok", "estimators of treadlink-example 0.1.0"),
        "plug-in cross-axis": ("ok", "effects of treadlink-example 0.1.0"),
        "plug-in acc": ("ok", "importers of treadlink-example 0.1.0"),
        "plug-in graphite": ("ok", "sinks of treadlink-example 0.1.0"),
    }


def test_doctor_refuses_what_does_not_fit(bad: Path) -> None:
    result = plugin_checks(bad)
    assert result.pop("plug-in raising") == ("ok", "estimators of bad-plugin 9")
    assert {level for level, _ in result.values()} == {"fault"}
    reasons = {name.removeprefix("plug-in "): text.partition("refused: ")[2] for name, (_, text) in result.items()}
    assert reasons.pop("late").startswith("it cannot be imported: AttributeError")
    assert reasons.pop("torn").startswith("it cannot be imported: ModuleNotFoundError")
    assert reasons.pop("leaving") == reasons.pop("gone") == "it cannot be imported: SystemExit: 0"
    assert reasons == {
        "sim": "treadlink has this name already",
        "shape": "it lacks update, reset",
        "other": "it states another name, raising",
        "greedy": "kinematic has its quantity rotation_rpm already",
        "undeclared": "it is not an estimator with a tuple `quantities` of `Quantity`",
        "gravity": "treadlink has an effect of this name or rank already: gravity, rank 140",
        "number": "it is not a sequence of gateway.diagnosis.effects.effect.Effect",
        "csv": "treadlink has this name already",
        "wavy": "it lacks blocks, sample, close",
        "mqtt": "treadlink has this name already",
        "thing": "it is not a gateway.publishing.sink.SinkKind",
    }


def test_two_packages_of_one_name_are_both_refused(example: Path, bad: Path, tmp_path: Path) -> None:
    copy = tmp_path / "again"
    shutil.copytree(bad, copy)
    points = copy / "bad_plugin-9.dist-info" / "entry_points.txt"
    points.write_text("[treadlink.estimators]\nrotation = bad_plugin:Raising\n")
    result = plugin_checks(example, copy)
    assert "plug-in rotation" in result
    assert "has this name already" in result["plug-in rotation"][1]


def test_estimator_of_a_plugin_is_in_the_table(example: Path, recording: Path, tmp_path: Path) -> None:
    table = tmp_path / "table.csv"
    treadlink("estimate", str(recording), "--estimator", "rotation", "--csv", str(table), folders=(example,))
    header, *rows = table.read_text().splitlines()
    columns = header.split(",")
    index = columns.index("wheel_hz")
    values = [float(row.split(",")[index]) for row in rows]
    # 65 km/h on a radius of 0.32 m
    assert values[-1] == pytest.approx(65 / 3.6 / 0.32 / 6.2832, rel=0.05)


def test_failing_estimator_stops_nothing_else(bad: Path, recording: Path, tmp_path: Path) -> None:
    table = tmp_path / "table.jsonl"
    options = ("--estimator", "raising", "--estimator", "kinematic", "--json", str(table))
    treadlink("estimate", str(recording), *options, folders=(bad,))
    rows = [json.loads(line) for line in table.read_text().splitlines()]
    assert rows[-1]["speed_mps_status"] == "valid"
    assert rows[-1]["share_of_nothing_status"] == "invalid"
    assert rows[-1]["share_of_nothing_reasons"][0]["values"]["error"].startswith("ZeroDivisionError: of the plug-in ")


def test_refused_plugin_that_is_asked_for_is_an_error(bad: Path, tmp_path: Path) -> None:
    done = treadlink("live", "late:x", "--plain", folders=(bad,), check=False)
    assert done.returncode == 1
    assert "plug-in 'late' of package 'bad-plugin' cannot be used" in done.stderr
    assert "doctor" in done.stderr


def test_estimator_that_takes_a_quantity_of_another_is_an_error(bad: Path, recording: Path) -> None:
    done = treadlink("estimate", str(recording), "--estimator", "greedy", folders=(bad,), check=False)
    assert done.returncode == 1
    assert "plug-in 'greedy' of package 'bad-plugin' cannot be used (name rotation_rpm, by kinematic)" in done.stderr


@pytest.mark.parametrize(
    ("name", "options"), [("gone", ("gone:x",)), ("leaving", ("sim:lab", "--estimator", "leaving"))]
)
def test_plugin_that_ends_the_program_on_import_is_an_error(bad: Path, name: str, options: tuple[str, ...]) -> None:
    done = treadlink("live", *options, "--plain", folders=(bad,), check=False)
    assert done.returncode == 1
    assert f"plug-in '{name}' of package 'bad-plugin' cannot be used" in done.stderr


def test_effect_of_a_plugin_is_in_the_catalogue(example: Path, bad: Path) -> None:
    done = treadlink("diagnose", "--list-effects", "cross-axis", folders=(example, bad))
    assert "cross-axis sensitivity" in done.stdout
    assert "a_circumferential + s a_lateral" in done.stdout


def test_source_of_a_plugin_delivers_frames(example: Path, tmp_path: Path) -> None:
    link = tmp_path / "lab.bin"
    treadlink("simulate", "lab", "--duration", "3", "--out", str(link), folders=())
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    uri = f"udp:127.0.0.1:{port}"
    command = [sys.executable, "-m", "gateway.core.cli", "live", uri, "--plain"]
    streams = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT}
    with subprocess.Popen(command, text=True, env=environment(example), **streams) as process:
        assert process.stdout is not None
        assert any("connected" in line for line in process.stdout)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            for frame in frames_of(link.read_bytes(), 200):
                sender.sendto(frame, ("127.0.0.1", port))
        assert any(re.match(r"hub0\.wheel0 +3 ", line) for line in process.stdout)
        process.send_signal(signal.SIGINT)
        rest = process.stdout.read()
    counted = re.search(rf"{uri}: (\d+) frames, (\d+) lost", rest)
    assert counted is not None
    # A busy computer may drop datagrams; they are counted.
    assert int(counted[1]) > 100
    assert int(counted[1]) + int(counted[2]) <= 200


MAP = """
[sampling]
time_column = "time"
time_unit = "s"
[axis.radial]
column = "channel 1"
unit = "mg"
[sensor]
coupling = "DC"
[conditions]
radius_mm = 300.0
"""


def test_importer_of_a_plugin_reads_its_files(example: Path, tmp_path: Path) -> None:
    rate_hz, turns_per_s = 9600, 9.0
    angle_rad = 2 * np.pi * turns_per_s * np.arange(3 * rate_hz) / rate_hz
    counts = np.round(95_000 * np.minimum(1.0, np.abs((angle_rad % (2 * np.pi)) / np.pi - 1.0) * 8)).astype("<i4")
    (tmp_path / "run.acc").write_bytes(struct.pack("<4sII", b"ACC1", rate_hz, 1) + counts.tobytes())
    (tmp_path / "run.toml").write_text(MAP)
    out = tmp_path / "run.mcap"
    arguments = ("import", str(tmp_path / "run.acc"), "--map", str(tmp_path / "run.toml"), "--out", str(out))
    assert treadlink(*arguments, folders=(), check=False).returncode == 1
    done = treadlink(*arguments, folders=(example,))
    assert f"{len(counts)} samples, 3 s at 9600 Hz" in done.stdout
    assert "0.00 to    931.63" in done.stdout


def test_live_output_of_a_plugin_gets_estimates(example: Path, recording: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        uri = f"graphite:127.0.0.1:{server.getsockname()[1]}?prefix=car"
        command = [sys.executable, "-m", "gateway.core.cli", "replay", str(recording), "--speed", "max", "--plain"]
        with subprocess.Popen(
            [*command, "--publish", uri], env=environment(example), stdout=subprocess.DEVNULL
        ) as process:
            connection, _ = server.accept()
            with connection, connection.makefile() as lines:
                received = lines.readlines()
        assert process.returncode == 0
    speeds = [line.split() for line in received if line.startswith("car.W1.speed_mps ")]
    assert len(speeds) >= 10
    assert float(speeds[-1][1]) == pytest.approx(65 / 3.6, rel=0.01)
    assert int(speeds[-1][2]) > 1_700_000_000


def frames_of(data: bytes, count: int) -> list[bytes]:
    frames, position = [], 0
    for _ in range(count):
        end = position + wire.OVERHEAD_BYTES + data[position + wire.LENGTH_OFFSET]
        frames.append(data[position:end])
        position = end
    return frames
