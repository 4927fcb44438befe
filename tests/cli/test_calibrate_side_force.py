"""Tests of `treadlink calibrate side-force` with simulated recordings."""

import math
from pathlib import Path

import pytest
from click.testing import CliRunner

from gateway.cli import treadlink
from gateway.config.vehicle import parse_vehicle
from gateway.errors import CalibrationError, ConfigError, RecordingError
from gateway.physics.lateral_belt import LateralSolution
from gateway.simulator.truth import WheelTruth
from tests.testkit.commands import run
from tests.testkit.simulated_wheel import simulated

TABLES = "[tire]\nring_nodes = 1440\n"
SLIPS = "[[0, -1], [4, -1], [4.1, 0], [8, 0], [8.1, 1.5], [12, 1.5]]"
SCENARIO = TABLES + "[[wheel]]\nposition = 'FL'\nwheel = 0\nload_n = 4000\nslip_angle_deg = " + SLIPS + "\n"
WHEEL = "[tire]\nradius_mm = 320\n[[wheel]]\nposition = 'FL'\nhub = 0\nwheel = 0\nload_n = 4000\n"
RUN = (
    "[[run]]\nrecording = 'sweep.mcap'\nside_force_n = {force}\naligning_moment_nm = {moment}\n"
    "from_s = {begin}\nto_s = {end}\n"
)
PARTS = ((-1.0, 0.0, 3.7), (0.0, 4.5, 7.7), (1.5, 8.5, 12.0))


def cornering(truth: WheelTruth, slip_deg: float) -> LateralSolution:
    tire = truth.plan.tire
    pressure, load = truth.plan.pressure_pa.low, truth.plan.load_n.low
    return tire.solve_lateral(tire.solve(load, pressure, truth.omega_radps(1.0)), math.radians(slip_deg))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a recording of three side forces."""
    made = tmp_path_factory.mktemp("forces")
    (made / "sweep.toml").write_text(SCENARIO)
    run("simulate", made / "sweep.toml", "--out", made / "sweep.mcap", "--duration", 12)
    return made


def test_calibration_gives_force_and_moment(folder: Path, tmp_path: Path) -> None:
    (setup,) = parse_vehicle(WHEEL, "test").wheel_setups()
    _, truth = simulated(TABLES, 0.5, setup, ("kinematic",), "load_n = 4000\nslip_angle_deg = 0.7")
    text = ""
    for slip, begin, end in PARTS:
        true = cornering(truth, slip)
        text += RUN.format(force=true.side_force_n, moment=true.aligning_moment_nm, begin=begin, end=end)
    (folder / "runs.toml").write_text(text)
    out = tmp_path / "force.toml"
    report = run("calibrate", "side-force", folder / "runs.toml", "--out", out)
    assert "N/mm" in report
    assert "N m/deg" in report
    vehicle = parse_vehicle(WHEEL + out.read_text(), "test")
    assert parse_vehicle(vehicle.to_toml(), "again") == vehicle
    (setup,) = vehicle.wheel_setups()
    names = ("kinematic", "longitudinal-force", "side-force", "friction")
    results, truth = simulated(TABLES, 4.0, setup, names, "load_n = 4000\nslip_angle_deg = 0.7")
    actual = {estimate.name: estimate for estimate in results[-1].estimates}
    true = cornering(truth, 0.7)
    for name, value in (("side_force_n", true.side_force_n), ("aligning_moment_nm", true.aligning_moment_nm)):
        assert abs(actual[name].value - value) < 3.0 * actual[name].std
    assert actual["side_force_n"].std < 0.02 * 4000
    assert abs(actual["friction_used"].value - true.side_force_n / 4000) < 3.0 * actual["friction_used"].std


def test_equal_forces_are_refused(folder: Path) -> None:
    path = folder / "equal.toml"
    path.write_text("".join(RUN.format(force=500, moment=0, begin=b, end=e) for _, b, e in PARTS))
    result = CliRunner().invoke(treadlink, ["calibrate", "side-force", str(path)])
    assert isinstance(result.exception, CalibrationError) or "same in all runs" in result.output


def test_short_run_is_refused(folder: Path) -> None:
    path = folder / "short.toml"
    path.write_text("".join(RUN.format(force=f, moment=0, begin=1e-3 * f, end=0.4 + 1e-3 * f) for f in (0, 500)))
    result = CliRunner().invoke(treadlink, ["calibrate", "side-force", str(path)])
    assert isinstance(result.exception, CalibrationError) or "are required" in result.output


def test_copy_of_a_recording_is_refused(folder: Path) -> None:
    (folder / "copy.mcap").write_bytes((folder / "sweep.mcap").read_bytes())
    path = folder / "copies.toml"
    texts = [RUN.format(force=f, moment=0, begin=0.0, end=4.0) for f in (0, 500)]
    path.write_text(texts[0] + texts[1].replace("sweep", "copy"))
    result = CliRunner().invoke(treadlink, ["calibrate", "side-force", str(path)])
    assert isinstance(result.exception, RecordingError)
    assert "copy of" in str(result.exception)


def test_end_before_begin_is_a_fault(folder: Path) -> None:
    path = folder / "fault.toml"
    path.write_text("".join(RUN.format(force=f, moment=0, begin=3.0, end=1.0) for f in (0, 500)))
    result = CliRunner().invoke(treadlink, ["calibrate", "side-force", str(path)])
    assert isinstance(result.exception, ConfigError) or "to_s" in result.output
