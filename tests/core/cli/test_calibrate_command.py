"""Tests of `treadlink calibrate` with simulated recordings: load and wear, slip angle, and side force."""

import math
import tomllib
from pathlib import Path

import pytest

from gateway.core.config.vehicle import parse_vehicle
from gateway.core.errors import CalibrationError, ConfigError, RecordingError, TreadlinkError
from gateway.forces.lateral_belt import LateralSolution
from gateway.simulator.truth import WheelTruth
from tests.testkit.commands import invoked, run
from tests.testkit.simulated_wheel import last, simulated

LOAD_SCENARIO = "[[wheel]]\nposition = 'FL'\nwheel = 0\nload_n = {load}\npressure_kpa = {pressure}\n"
VEHICLE = "[tire]\nradius_mm = 320\nring_thickness_mm = 15\n{tables}\n[[wheel]]\nposition = 'FL'\nhub = 0\nwheel = 0\n"


@pytest.fixture(scope="module")
def load_recordings(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("loads")
    made = []
    for load, pressure in ((3000, 210), (4500, 210), (6000, 210), (4500, 190)):
        scenario, out = folder / f"{load}-{pressure}.toml", folder / f"{load}-{pressure}.mcap"
        scenario.write_text(LOAD_SCENARIO.format(load=load, pressure=pressure))
        run("simulate", scenario, "--out", out, "--duration", 8)
        made.append(out)
    return made


def test_calibration_gives_load_and_wear(load_recordings: list[Path], tmp_path: Path) -> None:
    out = tmp_path / "tire.toml"
    text = run("calibrate", *load_recordings, "--out", out)
    assert "left out" in text
    assert str(out) in text
    tire = tomllib.loads(out.read_text())["tire"]
    assert tire["load_calibration"]["relative_std_percent"] < 2.5
    assert tire["reference"]["Bs"] == pytest.approx(3.08e-3, rel=0.02)
    assert tire["reference"]["pressure_kpa"] == pytest.approx(210.0, rel=1e-3)
    vehicle = parse_vehicle(VEHICLE.format(tables=out.read_text().replace("[tire]", "")), "test")
    assert parse_vehicle(vehicle.to_toml(), "again") == vehicle
    (setup,) = vehicle.wheel_setups()
    results, _ = simulated(
        "[tire]\nwear_mm = 0.5", 10.0, setup, ("kinematic", "weak-form", "wear", "load"), "load_n = 5200"
    )
    result = last(results)
    assert result["load_by_angle_n"].value == pytest.approx(5200.0, rel=0.04)
    assert result["load_n"].value == pytest.approx(5200.0, rel=0.02)
    assert result["wear_mm"].value == pytest.approx(0.5, abs=0.15)


def test_tables_are_printed_without_out(load_recordings: list[Path]) -> None:
    text = run("calibrate", load_recordings[0], "--wheel", "FL")
    tables = tomllib.loads(text[text.index("\n[tire.") :])
    assert tables["tire"]["load_calibration"]["load_n"] == pytest.approx(3000.0, rel=0.02)
    assert "three recordings" in text
    assert "exponent 1.40 ± 0.15" in text
    assert "do not determine the exponent: its usual value counts as much" in text


def test_recording_given_twice_is_refused(load_recordings: list[Path], tmp_path: Path) -> None:
    copy = tmp_path / "copy.mcap"
    copy.write_bytes(load_recordings[0].read_bytes())
    for again, says in ((load_recordings[0], "given twice"), (copy, "copy of")):
        with pytest.raises(RecordingError, match=says):
            run("calibrate", "load", load_recordings[0], again, load_recordings[1])


def test_existing_file_is_kept_without_force(load_recordings: list[Path], tmp_path: Path) -> None:
    out = tmp_path / "tire.toml"
    out.write_text("mine")
    with pytest.raises(TreadlinkError, match="already exists"):
        run("calibrate", load_recordings[0], "--out", out)
    assert out.read_text() == "mine"
    run("calibrate", load_recordings[0], "--out", out, "--force")
    assert "load_calibration" in out.read_text()


def test_unknown_wheel_is_an_error(load_recordings: list[Path]) -> None:
    with pytest.raises(TreadlinkError, match="no wheel") as caught:
        run("calibrate", load_recordings[0], "--wheel", "RR")
    assert "RR" in caught.value.remedy


def test_inverted_calibration_range_is_a_fault() -> None:
    tables = """[tire.load_calibration]
load_n = 5000
half_angle_rad = 0.2
pressure_kpa = 210
angle_exponent = 1.4
pressure_exponent = 0.5
relative_std_percent = 2
half_angle_min_rad = 0.3
half_angle_max_rad = 0.1
pressure_min_kpa = 250
pressure_max_kpa = 190
"""
    with pytest.raises(ConfigError) as caught:
        parse_vehicle(VEHICLE.format(tables=tables), "car.toml")
    assert "tire.load_calibration.half_angle_min_rad" in str(caught.value)
    assert "tire.load_calibration.pressure_min_kpa" in str(caught.value)


SLIP_TABLES = "[tire]\nconicity_deg = 0.3\nring_nodes = 1440\n"
SLIP_SCENARIO = (
    SLIP_TABLES
    + "[[wheel]]\nposition = 'FL'\nwheel = 0\nload_n = 4000\nslip_angle_deg = {slip}\n"
    + "[wheel.motion]\ndirection = '{direction}'\n"
)
SLIP_RUN = "[[run]]\nrecording = '{name}.mcap'\nslip_deg = {slip}\ndirection = '{direction}'\n"
SLIP_RUNS = {"left": (1.0, "forward"), "zero": (0.0, "forward"), "right": (-1.0, "forward"), "back": (0.0, "reverse")}
SLIP_HEAD = "slip_std_deg = 0.01\nslip_zero_std_deg = 0.01\n"


@pytest.fixture(scope="module")
def slip_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a recording of each of RUNS and a runs file."""
    made = tmp_path_factory.mktemp("slips")
    for name, (slip, direction) in SLIP_RUNS.items():
        (made / f"{name}.toml").write_text(SLIP_SCENARIO.format(slip=slip, direction=direction))
        run("simulate", made / f"{name}.toml", "--out", made / f"{name}.mcap", "--duration", 4)
    text = "".join(SLIP_RUN.format(name=name, slip=slip, direction=way) for name, (slip, way) in SLIP_RUNS.items())
    (made / "runs.toml").write_text(SLIP_HEAD + text)
    return made


def test_calibration_gives_constant_slip(slip_folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "slip.toml"
    text = run("calibrate", "slip", slip_folder / "runs.toml", "--out", out)
    assert "chi-square" in text
    assert "degrees of freedom 1" in text
    result = tomllib.loads(out.read_text())["tire"]["slip_calibration"]
    wheel = "[tire]\nradius_mm = 320\n[[wheel]]\nposition = 'FL'\nhub = 0\nwheel = 0\nload_n = 4000\n"
    vehicle = parse_vehicle(wheel + out.read_text(), "test")
    assert parse_vehicle(vehicle.to_toml(), "again") == vehicle
    (setup,) = vehicle.wheel_setups()
    results, truth = simulated(
        SLIP_TABLES, 5.0, setup, ("kinematic", "slip-angle"), "load_n = 4000\nslip_angle_deg = 0.6"
    )
    estimates = {estimate.name: estimate for estimate in results[-1].estimates}
    mean = estimates["slip_angle_mean_rad"]
    assert abs(mean.value - math.radians(0.6)) < 3.0 * mean.std < math.radians(0.4)
    # Ply steer and conicity of the true shapes.
    zero, share = math.degrees(truth.ply_steer(1.0).first_half_rad), result["belt_share"]
    assert abs(result["zero_deg"] - zero) < 3.0 * result["zero_std_deg"]
    assert result["ply_steer_deg"] + result["conicity_deg"] == pytest.approx(result["zero_deg"], abs=1e-4)
    assert result["conicity_deg"] == pytest.approx(-0.025, abs=0.01)
    assert 0.19 < share < 0.24


def test_wrong_slip_angle_is_refused(slip_folder: Path) -> None:
    wrong = slip_folder / "wrong.toml"
    named = (("zero", 0.0), ("right", -1.0), ("left", 0.3))
    wrong.write_text(
        SLIP_HEAD + "".join(SLIP_RUN.format(name=name, slip=slip, direction="forward") for name, slip in named)
    )
    with pytest.raises(CalibrationError, match="contradict each other") as caught:
        run("calibrate", "slip", wrong)
    assert "slip_std_deg" in caught.value.remedy


def test_run_without_revolutions_is_refused(slip_folder: Path) -> None:
    short = slip_folder / "short.toml"
    back = SLIP_RUN.format(name="back", slip=0, direction="reverse")
    short.write_text(back + "to_s = 3.5\n" + back + "from_s = 3.5\n")
    with pytest.raises(CalibrationError, match=r"back.mcap from 3.5 s: \d of \d revolutions") as caught:
        run("calibrate", "slip", short)
    assert "from_s" in caught.value.remedy


def test_unknown_wheel_is_named(slip_folder: Path) -> None:
    other = slip_folder / "other.toml"
    names = ("zero", "left")
    other.write_text('wheel = "RR"\n' + "".join(SLIP_RUN.format(name=n, slip=0, direction="forward") for n in names))
    with pytest.raises(CalibrationError, match="no revolution of wheel RR") as caught:
        run("calibrate", "slip", other)
    assert "FL" in caught.value.remedy


def test_runs_with_common_revolutions_are_refused(slip_folder: Path) -> None:
    """Revolutions that count twice make the calibration look surer than it is."""
    zero = SLIP_RUN.format(name="zero", slip=0, direction="forward")
    twice = slip_folder / "twice.toml"
    twice.write_text(SLIP_HEAD + zero + "to_s = 2.0\n" + zero + "from_s = 1.9\n")
    with pytest.raises(ConfigError, match=r"run\[#2\].from_s: 1.9 found, allowed: .* that run\[#1\] does not have"):
        run("calibrate", "slip", twice)
    (slip_folder / "copy.mcap").write_bytes((slip_folder / "zero.mcap").read_bytes())
    twice.write_text(SLIP_HEAD + zero + SLIP_RUN.format(name="copy", slip=0, direction="forward"))
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
    result = invoked("calibrate", "--wheel", "FL", "missing.mcap")
    assert "missing.mcap" in str(result.exception)
    assert "load" in invoked("calibrate", "--help").output


FORCE_TABLES = "[tire]\nring_nodes = 1440\n"
SLIPS = "[[0, -1], [4, -1], [4.1, 0], [12.5, 0], [12.6, 1.5], [21, 1.5]]"
FORCE_SCENARIO = FORCE_TABLES + "[[wheel]]\nposition = 'FL'\nwheel = 0\nload_n = 4000\nslip_angle_deg = " + SLIPS + "\n"
WHEEL = "[tire]\nradius_mm = 320\n[[wheel]]\nposition = 'FL'\nhub = 0\nwheel = 0\nload_n = 4000\n"
FORCE_RUN = (
    "[[run]]\nrecording = 'sweep.mcap'\nside_force_n = {force}\naligning_moment_nm = {moment}\n"
    "from_s = {begin}\nto_s = {end}\n"
)
FORCE_PARTS = ((-1.0, 0.0, 3.7), (0.0, 4.2, 12.3), (1.5, 12.7, 21.0))


def cornering(truth: WheelTruth, slip_deg: float) -> LateralSolution:
    tire = truth.plan.tire
    pressure, load = truth.plan.pressure_pa.low, truth.plan.load_n.low
    return tire.solve_lateral(tire.solve(load, pressure, truth.omega_radps(1.0)), math.radians(slip_deg))


@pytest.fixture(scope="module")
def force_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a recording of three side forces."""
    made = tmp_path_factory.mktemp("forces")
    (made / "sweep.toml").write_text(FORCE_SCENARIO)
    run("simulate", made / "sweep.toml", "--out", made / "sweep.mcap", "--duration", 21)
    return made


def test_calibration_gives_force_and_moment(force_folder: Path, tmp_path: Path) -> None:
    (setup,) = parse_vehicle(WHEEL, "test").wheel_setups()
    _, truth = simulated(FORCE_TABLES, 0.5, setup, ("kinematic",), "load_n = 4000\nslip_angle_deg = 0.7")
    text = ""
    for slip, begin, end in FORCE_PARTS:
        true = cornering(truth, slip)
        text += FORCE_RUN.format(force=true.side_force_n, moment=true.aligning_moment_nm, begin=begin, end=end)
    (force_folder / "runs.toml").write_text(text)
    out = tmp_path / "force.toml"
    report = run("calibrate", "side-force", force_folder / "runs.toml", "--out", out)
    assert "N/mm" in report
    assert "N m/deg" in report
    vehicle = parse_vehicle(WHEEL + out.read_text(), "test")
    assert parse_vehicle(vehicle.to_toml(), "again") == vehicle
    (setup,) = vehicle.wheel_setups()
    names = ("kinematic", "longitudinal-force", "side-force", "friction")
    results, truth = simulated(FORCE_TABLES, 4.0, setup, names, "load_n = 4000\nslip_angle_deg = 0.7")
    actual = {estimate.name: estimate for estimate in results[-1].estimates}
    true = cornering(truth, 0.7)
    for name, value in (("side_force_n", true.side_force_n), ("aligning_moment_nm", true.aligning_moment_nm)):
        assert abs(actual[name].value - value) < 3.0 * actual[name].std
    assert actual["side_force_n"].std < 0.02 * 4000
    assert abs(actual["friction_used"].value - true.side_force_n / 4000) < 3.0 * actual["friction_used"].std


def test_equal_forces_are_refused(force_folder: Path) -> None:
    path = force_folder / "equal.toml"
    path.write_text("".join(FORCE_RUN.format(force=500, moment=0, begin=b, end=e) for _, b, e in FORCE_PARTS))
    result = invoked("calibrate", "side-force", path)
    assert isinstance(result.exception, CalibrationError) or "same in all runs" in result.output


def test_short_run_is_refused(force_folder: Path) -> None:
    path = force_folder / "short.toml"
    path.write_text("".join(FORCE_RUN.format(force=f, moment=0, begin=1e-3 * f, end=0.4 + 1e-3 * f) for f in (0, 500)))
    result = invoked("calibrate", "side-force", path)
    assert isinstance(result.exception, CalibrationError) or "are required" in result.output


def test_copy_of_a_recording_is_refused(force_folder: Path) -> None:
    (force_folder / "copy.mcap").write_bytes((force_folder / "sweep.mcap").read_bytes())
    path = force_folder / "copies.toml"
    texts = [FORCE_RUN.format(force=f, moment=0, begin=0.0, end=4.0) for f in (0, 500)]
    path.write_text(texts[0] + texts[1].replace("sweep", "copy"))
    result = invoked("calibrate", "side-force", path)
    assert isinstance(result.exception, RecordingError)
    assert "copy of" in str(result.exception)


def test_end_before_begin_is_a_fault(force_folder: Path) -> None:
    path = force_folder / "fault.toml"
    path.write_text("".join(FORCE_RUN.format(force=f, moment=0, begin=3.0, end=1.0) for f in (0, 500)))
    result = invoked("calibrate", "side-force", path)
    assert isinstance(result.exception, ConfigError) or "to_s" in result.output
