import importlib.metadata
import json
import os
import re
import shutil
import socket
import stat
import threading
from collections import namedtuple
from collections.abc import Iterator
from pathlib import Path

import pytest
from serial.tools import list_ports

from gateway.bench.commands import doctor_checks as checks
from gateway.bench.commands.doctor_checks import Check, Level
from gateway.core.clock import ManualClock
from gateway.core.links.source import open_source
from gateway.core.reasons import Reason
from gateway.core.recording.writer import RecordingWriter
from gateway.core.trust.reasons import TrustCode
from gateway.core.trust.turn_verdict import Gain, Verdict, Witness
from gateway.forces.shared_turn import contradiction_of
from gateway.importing.reference_topic import reference_topic
from tests.testkit.commands import invoked, run

Usage = namedtuple("Usage", "total used free")
GOOD = '[tire]\nradius_mm = 320\n[[wheel]]\nposition = "FL"\nhub = 0\nwheel = 0\nload_n = 4000\n'


@pytest.fixture
def device() -> Iterator[Path]:
    pty = pytest.importorskip("pty", reason="pseudo-terminals exist on POSIX only")
    main, other = pty.openpty()
    yield Path(os.ttyname(other))
    os.close(main)
    os.close(other)


def test_the_core_that_is_not_built_is_a_warning(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gateway.core.compiled.core", None)
    monkeypatch.delenv("TREADLINK_COMPILED", raising=False)
    (check,) = checks.check_core()
    assert check.level is Level.WARNING
    assert "C compiler" in check.remedy
    monkeypatch.setenv("TREADLINK_COMPILED", "0")
    (check,) = checks.check_core()
    assert (check.level, check.remedy) == (Level.OK, "")
    assert "TREADLINK_COMPILED" in check.text
    monkeypatch.setattr("gateway.core.compiled.core", object())
    (check,) = checks.check_core()
    assert check.level is Level.OK


def test_python_version() -> None:
    (good,) = checks.check_python((3, 11, 0))
    (old,) = checks.check_python((3, 10, 14))
    assert good.level is Level.OK
    assert old.level is Level.FAULT
    assert "3.11" in old.remedy


def test_missing_and_old_packages_are_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    real = importlib.metadata.version

    def version(name: str) -> str:
        if name in ("pyarrow", "mcap"):
            raise importlib.metadata.PackageNotFoundError(name)
        return "7.9.1" if name == "textual" else real(name)

    monkeypatch.setattr(importlib.metadata, "version", version)
    results = list(checks.check_packages())
    by_text = {check.text: check for check in results}
    assert by_text["pyarrow is missing"].level is Level.WARNING
    assert by_text["pyarrow is missing"].remedy.endswith("pip install 'treadlink[parquet]'")
    assert by_text["mcap is missing"].level is Level.FAULT
    assert by_text["mcap is missing"].remedy.endswith("pip install 'mcap>=1.5'")
    assert by_text["textual 7.9.1 is older than 8"].level is Level.FAULT
    assert not any(check.level is Level.OK for check in results)


def test_installed_packages_are_listed() -> None:
    (check,) = [check for check in checks.check_packages() if check.level is Level.OK]
    for name in ("numpy", "textual", "pyserial"):
        assert f"{name} {importlib.metadata.version(name)}" in check.text
    assert "pytest" not in check.text


def test_usable_device(device: Path) -> None:
    check = checks.check_device(device, "hub")
    assert check == Check("serial port", Level.OK, f"{device} (hub) can be read and written")


@pytest.mark.parametrize(("mode", "remedy"), [(0o620, "usermod -aG {group} $USER"), (0o600, "chmod a+rw")])
def test_device_without_permission(device: Path, monkeypatch: pytest.MonkeyPatch, mode: int, remedy: str) -> None:
    real = os.stat_result(device.stat())
    fields = list(real)
    fields[stat.ST_MODE] = stat.S_IFCHR | mode
    monkeypatch.setattr(os, "access", lambda *_: False)
    monkeypatch.setattr(Path, "stat", lambda *_, **__: os.stat_result(fields))
    monkeypatch.setattr(Path, "group", lambda _: "dialout")
    check = checks.check_device(device)
    assert check.level is Level.FAULT
    assert remedy.format(group="dialout") in check.remedy


def test_paths_that_are_not_devices(tmp_path: Path) -> None:
    if os.name != "posix":
        pytest.skip("device files exist on POSIX only")
    assert checks.check_device(tmp_path / "ttyUSB0").level is Level.FAULT
    (tmp_path / "file").touch()
    assert "not a serial port" in checks.check_device(tmp_path / "file").text


def test_unusable_ports_are_warnings(device: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    Port = namedtuple("Port", "device description")
    monkeypatch.setattr(list_ports, "comports", lambda: [Port(str(device), "n/a"), Port("/dev/none", "gone")])
    assert [check.level for check in checks.check_ports()] == [Level.WARNING, Level.OK]
    monkeypatch.setattr(list_ports, "comports", list)
    (check,) = checks.check_ports()
    assert "sim:demo" in check.remedy


@pytest.mark.parametrize(
    ("free_bytes", "level"), [(50_000_000, Level.FAULT), (500_000_000, Level.WARNING), (50_000_000_000, Level.OK)]
)
def test_disk_space(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, free_bytes: int, level: Level) -> None:
    monkeypatch.setattr(shutil, "disk_usage", lambda _: Usage(1e12, 0, free_bytes))
    (check,) = checks.check_disk(tmp_path / "not" / "yet" / "there")
    assert check.level is level
    assert f"{free_bytes / 1e9:.1f} GB free" in check.text


def test_unusable_recording_folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").touch()
    (check,) = checks.check_disk(tmp_path / "file")
    assert (check.level, check.text) == (Level.FAULT, f"{tmp_path / 'file'} is a file")
    monkeypatch.setattr(os, "access", lambda *_: False)
    (check,) = checks.check_disk(tmp_path)
    assert check.level is Level.FAULT


SIZE = os.terminal_size((120, 40))


@pytest.mark.parametrize(
    ("is_terminal", "size", "encoding", "term", "remedy"),
    [
        (True, SIZE, "utf-8", "xterm", ""),
        (False, SIZE, "utf-8", "xterm", "plain lines"),
        (True, os.terminal_size((60, 40)), "utf-8", "xterm", "80 x 24"),
        (True, SIZE, "ascii", "xterm", "UTF-8"),
        (True, SIZE, "utf-8", "dumb", "TERM"),
    ],
)
def test_terminal(is_terminal: bool, size: os.terminal_size, encoding: str, term: str, remedy: str) -> None:
    (check,) = checks.check_terminal(is_terminal, size, encoding, {"TERM": term})
    if term == "dumb" and os.name != "posix":
        pytest.skip("TERM says nothing there")
    assert check.level is (Level.WARNING if remedy else Level.OK)
    assert remedy in check.remedy


def test_configuration_faults_and_unknowns_are_reported(tmp_path: Path) -> None:
    path = tmp_path / "car.toml"
    path.write_text(GOOD, encoding="utf-8")
    results = list(checks.check_config(path))
    assert [check.level for check in results] == [Level.OK] * 3 + [Level.WARNING]
    assert "FL (hub 0, wheel 0)" in results[0].text
    assert re.fullmatch(r"not stated: bandwidth_hz, [^(]+\(FL\)", results[2].text)
    assert results[3].text.startswith("pressure of FL is unknown")
    stated = "sensor = { bandwidth_hz = 2000 }\n"
    path.write_text(GOOD + stated, encoding="utf-8")
    assert not any(check.text.startswith("not stated") for check in checks.check_config(path))
    path.write_text(GOOD.replace("320", "0.32").replace("4000", "4"), encoding="utf-8")
    results = list(checks.check_config(path))
    assert [check.level for check in results] == [Level.FAULT] * 2
    assert all(str(path) in check.text for check in results)


def test_errors_name_the_statement_to_make_better(tmp_path: Path) -> None:
    path = tmp_path / "car.toml"
    path.write_text(GOOD, encoding="utf-8")
    errors = {check.text.partition(" ±")[0]: check for check in checks.check_errors(path)}
    assert {check.name for check in errors.values()} == {"errors of FL"}
    assert {check.level for check in errors.values()} == {Level.OK}
    text = ", is the belt radius, not stated and assumed within 1 %; rolled over ten turns to 0.3 %, it would be"
    assert text in errors["speed"].text
    # A load that nobody weighed is the largest part of the numbers; once it is weighed, another one is.
    path.write_text(GOOD.replace("320", "320\npressure_kpa = 210"), encoding="utf-8")
    texts = {check.text.partition(" ±")[0]: check.text for check in checks.check_errors(path)}
    number = "bending stiffness number (Bs)"
    assert ", is the load, not stated and assumed within 10 %; weighed to 2 %" in texts[number]
    path.write_text(GOOD.replace("320", "320\npressure_kpa = 210") + "load_std_n = 20\n", encoding="utf-8")
    weighed = {check.text.partition(" ±")[0]: check.text for check in checks.check_errors(path)}
    assert "is the load, " not in weighed[number]


def test_errors_of_a_tire_that_cannot_be_are_a_warning(tmp_path: Path) -> None:
    path = tmp_path / "car.toml"
    path.write_text(GOOD.replace("4000", "40000").replace("320", "320\npressure_kpa = 100"), encoding="utf-8")
    (check,) = checks.check_errors(path)
    assert check.level is Level.WARNING
    assert check.text == "no tire with these numbers rolls under 40000 N at 100 kPa"
    path.write_text("no file", encoding="utf-8")
    assert list(checks.check_errors(path)) == []


def test_sources(device: Path, tmp_path: Path) -> None:
    clock = ManualClock()
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        (check,) = checks.check_source(f"tcp://127.0.0.1:{port}", clock)
        assert check.level is Level.OK
    (check,) = checks.check_source(f"tcp://127.0.0.1:{port}", clock)
    assert (check.level, "refused" in check.text) == (Level.FAULT, True)
    (check,) = checks.check_source(f"serial://{device}", clock)
    assert check.level is Level.OK
    (check,) = checks.check_source("serial:///dev/none", clock)
    assert "there is no /dev/none" in check.text
    (check,) = checks.check_source(f"replay:{tmp_path / 'none.mcap'}", clock)
    assert check.level is Level.FAULT
    (check,) = checks.check_source("pigeon:coop", clock)
    assert "unknown source" in check.text


@pytest.fixture
def quiet_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    """A machine on which only the arguments can be faulty."""
    monkeypatch.setattr(shutil, "disk_usage", lambda _: Usage(1e12, 0, 1e12))
    monkeypatch.setattr(list_ports, "comports", list)


@pytest.mark.usefixtures("quiet_machine")
def test_exit_code_and_text(tmp_path: Path) -> None:
    path = tmp_path / "car.toml"
    path.write_text(GOOD, encoding="utf-8")
    arguments = ["--config", str(path), "--recordings", str(tmp_path)]
    result = run("doctor", *arguments)
    assert result.splitlines()[-1].startswith("0 faults, ")
    path.write_text(GOOD.replace("320", "0.32").replace("4000", "4"), encoding="utf-8")
    result = invoked("doctor", *arguments)
    assert result.exit_code == 1
    assert result.output.count(f"-> Correct 2 faults in {path}.") == 1
    assert result.output.splitlines()[-1].startswith("2 faults, ")


@pytest.mark.usefixtures("quiet_machine")
def test_json(tmp_path: Path) -> None:
    result = invoked("doctor", "--json", "--recordings", tmp_path, "pigeon:coop")
    assert result.exit_code == 1
    rows = json.loads(result.output)
    assert all(set(row) == {"name", "level", "text", "remedy"} for row in rows)
    assert (rows[-1]["name"], rows[-1]["level"]) == ("source pigeon:coop", "fault")


def recorded(folder: Path, side: str, yaw: str) -> Path:
    """Return a recording of two wheels that drive at 54 km/h, the second one on a side, whatever its position says."""
    wheels = (f'[[wheel]]\nposition = "{name}"\nside = "{at}"\nwheel = {number}\nload_n = 4000\n[wheel.sensor]\n'
              "rate_hz = 4000\n" for number, (name, at) in enumerate((("FL", "left"), ("FR", side))))  # fmt: skip
    scenario, path = folder / "curve.toml", folder / "curve.mcap"
    motion = f"[motion]\nspeed_kmh = 54.0\nyaw_rate_degps = {yaw}\n"
    scenario.write_text(f'[scenario]\nname = "a curve"\nduration_s = 16.0\n{motion}{"".join(wheels)}', encoding="utf-8")
    run(f"record sim:{scenario}?speed=max --out {path}")
    return path


def axes_of(path: Path) -> dict[str, Check]:
    return {check.name: check for check in checks.check_lateral_axes(path, None)}


def test_one_recorded_curve_answers_whether_lateral_axes_point_to_the_left(tmp_path: Path) -> None:
    path = recorded(tmp_path, "right", "[[0, 0], [5, 0], [6, 9], [10, 9], [11, 0]]")
    axes = axes_of(path)
    assert axes.keys() == {"lateral axis of FL", "lateral axis of FR"}
    assert {check.level for check in axes.values()} == {Level.OK}
    assert all(check.text.startswith("points to the left, as curves show") for check in axes.values())
    assert "lateral axis of FL" in invoked("doctor", path, "--json").output


def test_straight_recording_leaves_lateral_axes_open_and_says_what_to_drive(tmp_path: Path) -> None:
    axes = axes_of(recorded(tmp_path, "right", "0"))
    assert {check.level for check in axes.values()} == {Level.WARNING}
    assert all("one curve" in check.remedy and "rig" not in check.remedy for check in axes.values())


@pytest.mark.parametrize("is_rig", [True, False])
def test_rig_is_told_to_steer_and_not_to_drive_a_curve(is_rig: bool, tmp_path: Path) -> None:
    source = open_source("sim:lab?speed=max&duration=5&seed=2", ManualClock(1_700_000_000_000_000_000))
    items = list(source.items(threading.Event()))
    writer = RecordingWriter(tmp_path / "rig.mcap", start_ns=items[0].host_ns, vehicle_toml=source.vehicle_toml)
    for step in range(50 * is_rig):
        payload = {"quantity": "load", "time_s": 0.1 * step, "value": 4000.0, "value_std": 40.0}
        writer.write_topic(reference_topic("W1", "load"), items[0].host_ns, payload)
    for item in items:
        writer.write(item)
    writer.close()
    (check,) = axes_of(tmp_path / "rig.mcap").values()
    # One wheel without a channel of a rig may be a car's.
    assert ("one curve" in check.remedy, "On a rig" in check.remedy) == (not is_rig, True)
    assert "lateral_is_left" in check.remedy


def test_doctor_names_wrong_axes_and_gains() -> None:
    gain = Gain(0.8, 0.03, 12)
    contradiction = contradiction_of(gain, Witness.TRACK)
    for verdict, levels in (
        (Verdict(sign=-1, reversed_by=Reason(TrustCode.TURNS_OPPOSITE, witness="course")), [Level.FAULT]),
        (Verdict(sign=1, gain=Gain(1.02, 0.03, 12), gain_by=Witness.YAW_RATE), [Level.OK]),
        (Verdict(sign=1, gain=gain, gain_by=Witness.TRACK, contradictions=(contradiction,)), [Level.OK, Level.FAULT]),
    ):
        results = list(checks.axis_checks("FL", verdict, is_stated=False, remedy=""))
        assert [check.level for check in results] == levels
    assert "0.80 ± 0.03 times" in results[0].text
    assert "0.80 ± 0.03 times" in results[1].text
