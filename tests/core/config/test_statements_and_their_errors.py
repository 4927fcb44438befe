"""An error that is stated belongs to its statement: it goes with it, and another file does not lose it."""

from pathlib import Path

import numpy as np
import pytest

from gateway.core.config.vehicle import Tire, choose_vehicle, parse_vehicle
from gateway.core.recording.recorded_file import open_recorded_file
from gateway.core.recording.run_description import RunDescription, TireIdentity
from gateway.core.session.program_arguments import chosen_vehicle
from gateway.core.session.recording_pass import open_recording
from gateway.core.session.session_opening import with_given_wear
from gateway.importing.import_map import parse_map
from gateway.importing.importer import import_file

WHEEL = '[[wheel]]\nposition = "FL"\nhub = 0\nwheel = 0\n'
TIRE = "[tire]\nradius_mm = 320\n"
RECORDED = TIRE + WHEEL + "[wheel.sensor]\nrate_std_percent = 1.0\ngain_std_percent = 4.0\n"
MAP = """
[sampling]
rate_hz = 3000.0
[axis.radial]
column = "r"
unit = "m/s2"
[sensor]
coupling = "DC"
[conditions]
position = "FL"
radius_mm = 320.0
"""


def sensor_of(text: str, recorded: str | None):
    vehicle = choose_vehicle(parse_vehicle(text, "given"), [recorded], "recording")
    assert vehicle is not None
    return vehicle.wheel_setups()[0].sensor


def test_errors_of_a_recordings_samples_remain_where_another_file_states_none() -> None:
    sensor = sensor_of(TIRE + WHEEL, RECORDED)
    assert (sensor.rate_std, sensor.gain_std) == pytest.approx((0.01, 0.04))


def test_errors_that_the_file_states_replace_those_of_the_recording() -> None:
    sensor = sensor_of(TIRE + WHEEL + "[wheel.sensor]\nrate_std_percent = 0.2\n", RECORDED)
    assert (sensor.rate_std, sensor.gain_std) == pytest.approx((0.002, 0.04))


def test_errors_of_another_wheels_samples_are_not_taken() -> None:
    other = RECORDED.replace("wheel = 0", "wheel = 3")
    assert sensor_of(TIRE + WHEEL, other).rate_std == pytest.approx(1e-4)


def test_a_recorded_configuration_with_faults_is_replaced_whole() -> None:
    assert sensor_of(TIRE + WHEEL, "[tire]\nradius_mm = -3\n" + WHEEL).rate_std == pytest.approx(1e-4)


def test_a_file_that_was_recorded_keeps_what_it_does_not_state_of_a_wheels_tire() -> None:
    text = "[tire]\nradius_mm = 320\nlinear_ring = true\ncontact_half_angle_deg = 12\ncontact_half_angle_std_deg = 2\n"
    for vehicle in (parse_vehicle(text + WHEEL, ""), parse_vehicle(parse_vehicle(text + WHEEL, "").to_toml(), "")):
        data = vehicle.wheel_setups()[0].tire
        assert data.is_linear_ring
        assert data.half_angle_std_rad == pytest.approx(np.radians(2.0))


@pytest.mark.parametrize(
    ("base", "own", "std_m"),
    [
        ("radius_mm = 320\nradius_std_mm = 0.3", "radius_mm = 310", 3.1e-3),
        ("radius_mm = 320\nradius_std_mm = 0.3", "radius_mm = 310\nradius_std_mm = 0.7", 0.7e-3),
        ("radius_mm = 320", "radius_std_mm = 0.7", 0.7e-3),
        ("radius_mm = 320\nradius_std_mm = 0.3", "pressure_kpa = 250", 0.3e-3),
    ],
)
def test_a_radius_of_its_own_has_an_error_of_its_own(base: str, own: str, std_m: float) -> None:
    vehicle = parse_vehicle(f"[tire]\n{base}\n{WHEEL}[wheel.tire]\n{own}\n", "")
    assert vehicle.wheel_setups()[0].radius_std_m == pytest.approx(std_m)


def test_a_number_of_another_reference_has_not_the_error_of_the_first() -> None:
    first = Tire.model_validate({"reference": {"Bs": 3e-3, "Bs_std": 1e-5, "Cw": 0.2, "Cw_std": 1e-4}})
    merged = first.overridden_by(Tire.model_validate({"reference": {"Bs": 4e-3}}))
    assert (merged.reference.Bs, merged.reference.Bs_std) == (4e-3, None)
    assert (merged.reference.Cw, merged.reference.Cw_std) == (0.2, 1e-4)


def test_a_wear_that_an_option_gives_has_the_usual_error() -> None:
    vehicle = parse_vehicle(TIRE + "wear_mm = 1\nwear_std_mm = 0.01\n" + WHEEL, "")
    given = with_given_wear(vehicle, RunDescription(tires={"FL": TireIdentity(wear_m=3e-3)}))
    assert given is not None
    tire = given.wheel_setups()[0].tire
    assert (tire.wear_m, tire.wear_std_m) == pytest.approx((3e-3, 2e-4))


def test_an_imported_rate_keeps_its_error_behind_every_vehicle_file(tmp_path: Path) -> None:
    signal, target = tmp_path / "run.csv", tmp_path / "run.mcap"
    time_s = np.arange(6000) / 3000.0
    np.savetxt(signal, 1000.0 + 10.0 * np.cos(50.0 * time_s), header="r", comments="", fmt="%.4f")
    import_file(signal, parse_map(MAP, ""), target)
    car = tmp_path / "car.toml"
    car.write_text(TIRE + WHEEL, encoding="utf-8")
    table = {"tire": {"radius_mm": 320.0}, "wheel": [{"position": "FL", "hub": 0, "wheel": 0}]}
    file = open_recorded_file(target)
    vehicles = [open_recording(file, config).vehicle for config in (car, parse_vehicle(TIRE + WHEEL, ""))]
    vehicles += [chosen_vehicle(config, [file.vehicle_toml], "") for config in (str(car), table)]
    for vehicle in vehicles:
        assert vehicle is not None
        assert vehicle.wheel_setups()[0].sensor.rate_std == pytest.approx(0.01)
