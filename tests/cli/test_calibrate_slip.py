"""Tests of `treadlink calibrate slip` with simulated recordings."""

import math
import tomllib
from pathlib import Path

import pytest
from click.testing import CliRunner

from gateway.cli import treadlink
from gateway.config.vehicle import parse_vehicle
from gateway.errors import CalibrationError, ConfigError, RecordingError
from tests.testkit.commands import run
from tests.testkit.simulated_wheel import simulated

TABLES = "[tire]\nconicity_deg = 0.3\nring_nodes = 1440\n"
SCENARIO = (
    TABLES
    + "[[wheel]]\nposition = 'FL'\nwheel = 0\nload_n = 4000\nslip_angle_deg = {slip}\n"
    + "[wheel.motion]\ndirection = '{direction}'\n"
)
RUN = "[[run]]\nrecording = '{name}.mcap'\nslip_deg = {slip}\ndirection = '{direction}'\n"
RUNS = {"left": (1.0, "forward"), "zero": (0.0, "forward"), "right": (-1.0, "forward"), "back": (0.0, "reverse")}
HEAD = "slip_std_deg = 0.01\nslip_zero_std_deg = 0.01\n"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a recording of each of RUNS and a runs file."""
    made = tmp_path_factory.mktemp("slips")
    for name, (slip, direction) in RUNS.items():
        (made / f"{name}.toml").write_text(SCENARIO.format(slip=slip, direction=direction))
        run("simulate", made / f"{name}.toml", "--out", made / f"{name}.mcap", "--duration", 4)
    text = "".join(RUN.format(name=name, slip=slip, direction=way) for name, (slip, way) in RUNS.items())
    (made / "runs.toml").write_text(HEAD + text)
    return made


def test_calibration_gives_constant_slip(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "slip.toml"
    text = run("calibrate", "slip", folder / "runs.toml", "--out", out)
    assert "chi-square" in text
    assert "degrees of freedom 1" in text
    result = tomllib.loads(out.read_text())["tire"]["slip_calibration"]
    wheel = "[tire]\nradius_mm = 320\n[[wheel]]\nposition = 'FL'\nhub = 0\nwheel = 0\nload_n = 4000\n"
    vehicle = parse_vehicle(wheel + out.read_text(), "test")
    assert parse_vehicle(vehicle.to_toml(), "again") == vehicle
    (setup,) = vehicle.wheel_setups()
    results, truth = simulated(TABLES, 5.0, setup, ("kinematic", "slip-angle"), "load_n = 4000\nslip_angle_deg = 0.6")
    estimates = {estimate.name: estimate for estimate in results[-1].estimates}
    mean = estimates["slip_angle_mean_rad"]
    assert abs(mean.value - math.radians(0.6)) < 3.0 * mean.std < math.radians(0.4)
    # Ply steer and conicity of the true shapes.
    zero, share = math.degrees(truth.ply_steer(1.0).first_half_rad), result["belt_share"]
    assert abs(result["zero_deg"] - zero) < 3.0 * result["zero_std_deg"]
    assert result["ply_steer_deg"] + result["conicity_deg"] == pytest.approx(result["zero_deg"], abs=1e-4)
    assert result["conicity_deg"] == pytest.approx(-0.025, abs=0.01)
    assert 0.19 < share < 0.24


def test_wrong_slip_angle_is_refused(folder: Path) -> None:
    wrong = folder / "wrong.toml"
    named = (("zero", 0.0), ("right", -1.0), ("left", 0.3))
    wrong.write_text(HEAD + "".join(RUN.format(name=name, slip=slip, direction="forward") for name, slip in named))
    with pytest.raises(CalibrationError, match="contradict each other") as caught:
        run("calibrate", "slip", wrong)
    assert "slip_std_deg" in caught.value.remedy


def test_run_without_revolutions_is_refused(folder: Path) -> None:
    short = folder / "short.toml"
    back = RUN.format(name="back", slip=0, direction="reverse")
    short.write_text(back + "to_s = 3.5\n" + back + "from_s = 3.5\n")
    with pytest.raises(CalibrationError, match=r"back.mcap from 3.5 s: \d of \d revolutions") as caught:
        run("calibrate", "slip", short)
    assert "from_s" in caught.value.remedy


def test_unknown_wheel_is_named(folder: Path) -> None:
    other = folder / "other.toml"
    names = ("zero", "left")
    other.write_text('wheel = "RR"\n' + "".join(RUN.format(name=n, slip=0, direction="forward") for n in names))
    with pytest.raises(CalibrationError, match="no revolution of wheel RR") as caught:
        run("calibrate", "slip", other)
    assert "FL" in caught.value.remedy


def test_runs_with_common_revolutions_are_refused(folder: Path) -> None:
    """Revolutions that count twice make the calibration look surer than it is."""
    zero = RUN.format(name="zero", slip=0, direction="forward")
    twice = folder / "twice.toml"
    twice.write_text(HEAD + zero + "to_s = 2.0\n" + zero + "from_s = 1.9\n")
    with pytest.raises(ConfigError, match=r"run\[#2\].from_s: 1.9 found, allowed: .* that run\[#1\] does not have"):
        run("calibrate", "slip", twice)
    (folder / "copy.mcap").write_bytes((folder / "zero.mcap").read_bytes())
    twice.write_text(HEAD + zero + RUN.format(name="copy", slip=0, direction="forward"))
    with pytest.raises(RecordingError, match="copy of"):
        run("calibrate", "slip", twice)


def test_faults_of_a_runs_file_name_their_keys(tmp_path: Path) -> None:
    runs = tmp_path / "runs.toml"
    runs.write_text(
        "[[run]]\nrecording = 'a.mcap'\nslip_degr = 1\n"
        "[[run]]\nrecording = 'b.mcap'\nslip_deg = 20\nfrom_s = 5\nto_s = 2\n"
    )
    with pytest.raises(ConfigError) as caught:
        run("calibrate", "slip", runs)
    for part in ("run[#1].slip_degr", "did you mean 'slip_deg'?", "run[#2].slip_deg: 20 found", "run[#2].to_s"):
        assert part in str(caught.value)


def test_recordings_without_a_name_calibrate_the_load() -> None:
    result = CliRunner().invoke(treadlink, ["calibrate", "--wheel", "FL", "missing.mcap"])
    assert "missing.mcap" in str(result.exception)
    assert "load" in CliRunner().invoke(treadlink, ["calibrate", "--help"]).output
