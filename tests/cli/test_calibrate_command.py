"""Tests of `treadlink calibrate` with simulated recordings."""

import tomllib
from pathlib import Path

import pytest

from gateway.config.vehicle import parse_vehicle
from gateway.errors import ConfigError, RecordingError, TreadlinkError
from tests.testkit.commands import run
from tests.testkit.simulated_wheel import last, simulated

SCENARIO = "[[wheel]]\nposition = 'FL'\nwheel = 0\nload_n = {load}\npressure_kpa = {pressure}\n"
VEHICLE = "[tire]\nradius_mm = 320\nring_thickness_mm = 15\n{tables}\n[[wheel]]\nposition = 'FL'\nhub = 0\nwheel = 0\n"


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("loads")
    made = []
    for load, pressure in ((3000, 210), (4500, 210), (6000, 210), (4500, 190)):
        scenario, out = folder / f"{load}-{pressure}.toml", folder / f"{load}-{pressure}.mcap"
        scenario.write_text(SCENARIO.format(load=load, pressure=pressure))
        run("simulate", scenario, "--out", out, "--duration", 8)
        made.append(out)
    return made


def test_calibration_gives_load_and_wear(recordings: list[Path], tmp_path: Path) -> None:
    out = tmp_path / "tire.toml"
    text = run("calibrate", *recordings, "--out", out)
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


def test_tables_are_printed_without_out(recordings: list[Path]) -> None:
    text = run("calibrate", recordings[0], "--wheel", "FL")
    assert "[tire.load_calibration]" in text
    assert "three recordings" in text
    assert "exponent 1.40 ± 0.15" in text
    assert "do not determine the exponent: its usual value counts as much" in text


def test_recording_given_twice_is_refused(recordings: list[Path], tmp_path: Path) -> None:
    copy = tmp_path / "copy.mcap"
    copy.write_bytes(recordings[0].read_bytes())
    for again, says in ((recordings[0], "given twice"), (copy, "copy of")):
        with pytest.raises(RecordingError, match=says):
            run("calibrate", "load", recordings[0], again, recordings[1])


def test_existing_file_is_kept_without_force(recordings: list[Path], tmp_path: Path) -> None:
    out = tmp_path / "tire.toml"
    out.write_text("mine")
    with pytest.raises(TreadlinkError, match="already exists"):
        run("calibrate", recordings[0], "--out", out)
    assert out.read_text() == "mine"
    run("calibrate", recordings[0], "--out", out, "--force")
    assert "load_calibration" in out.read_text()


def test_unknown_wheel_is_an_error(recordings: list[Path]) -> None:
    with pytest.raises(TreadlinkError, match="no wheel") as caught:
        run("calibrate", recordings[0], "--wheel", "RR")
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
