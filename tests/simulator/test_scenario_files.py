"""Scenario files: the built-in ones, all faults listed together, and the vehicle file."""

from pathlib import Path

import numpy as np
import pytest

from gateway.core.config.vehicle import parse_vehicle
from gateway.core.errors import ConfigError, SourceError
from gateway.simulator.scenario import builtin_scenarios, load_scenario, parse_scenario, vehicle_toml

WHEEL = '[[wheel]]\nposition = "W"\nwheel = 0\n'


def test_built_in_scenarios_parse_and_have_descriptions() -> None:
    scenarios = builtin_scenarios()
    assert {"demo", "eq-27", "lab", "slalom", "standstill_restart", "town"} <= set(scenarios)
    for name, text in scenarios.items():
        assert load_scenario(name).wheel
        assert text.endswith((".", "coupled.")), name
    assert [wheel.position for wheel in load_scenario("demo").wheel] == ["FL", "FR", "RL", "RR"]


def test_town_block_has_four_corners_of_90_degrees() -> None:
    scenario = load_scenario("town")
    yaw = scenario.motion.yaw_rate_degps
    turned_deg = np.concatenate([[0.0], np.cumsum(0.5 * (yaw.values[1:] + yaw.values[:-1]) * np.diff(yaw.times_s))])
    assert turned_deg[4::4] == pytest.approx([90.0, 180.0, 270.0, 360.0], abs=0.5)
    # Left wheels lose in the corners what right ones gain.
    loads = [[wheel.load_n.at(time_s) for wheel in scenario.wheels()] for time_s in (5.0, 10.0)]
    change = np.sign(np.subtract(*reversed(loads))).tolist()
    assert change == [-1.0, 1.0, -1.0, 1.0]


@pytest.mark.parametrize("name", ["slalom", "town"])
def test_tires_slip_into_the_curve(name: str) -> None:
    scenario, times_s = load_scenario(name), np.linspace(0.0, 40.0, 400)
    yaw = scenario.motion.yaw_rate_degps.at_times(times_s)
    for wheel in scenario.wheels():
        # A positive slip angle pulls to the left, as a positive yaw rate turns.
        assert (wheel.slip_angle_deg.at_times(times_s) * yaw >= 0.0).all()


@pytest.mark.parametrize("name", ["demo", "eq-27", "lab", "slalom", "standstill_restart", "town"])
def test_vehicle_of_a_scenario_is_a_valid_configuration(name: str) -> None:
    scenario = load_scenario(name)
    vehicle = parse_vehicle(vehicle_toml(scenario), name)
    assert vehicle.name == scenario.scenario.name
    for setup, wheel in zip(vehicle.wheel_setups(), scenario.wheels(), strict=True):
        assert (setup.position, setup.hub, setup.wheel) == (wheel.position, wheel.hub, wheel.wheel)
        assert setup.radius_m == pytest.approx(wheel.tire.radius_mm * 1e-3)
        assert setup.load_n == pytest.approx(wheel.load_n.at(0.0))
        assert setup.pressure_pa == pytest.approx(wheel.pressure_kpa.at(0.0) * 1e3)


def test_wheels_inherit_unstated_values() -> None:
    text = f"""
[sensor]
rate_hz = 4800.0
range_g = 300.0
[motion]
speed_kmh = 50.0
{WHEEL}
[wheel.sensor]
range_g = 200.0
[[wheel]]
position = "X"
wheel = 1
[wheel.motion]
speed_kmh = [[0, 10], [5, 20]]
"""
    first, second = parse_scenario(text, "test").wheels()
    assert (first.sensor.rate_hz, first.sensor.range_g) == (4800.0, 200.0)
    assert (second.sensor.rate_hz, second.sensor.range_g) == (4800.0, 300.0)
    assert first.motion.speed_kmh.at(3.0) == 50.0
    assert second.motion.speed_kmh.at(3.0) == pytest.approx(16.0)


def test_faults_are_listed_with_key_value_range() -> None:
    text = Path(__file__).with_name("every_fault.toml").read_text()
    with pytest.raises(ConfigError) as caught:
        parse_scenario(text, "my.toml")
    message = str(caught.value)
    for expected in (
        "scenario.seed: -1 found",
        "flip: rate = 0 to 1",
        "motion.speed_kmh",
        "must end at the value it starts with",
        "tire.wear_mm: 14.0 found, allowed: up to 0.8 of ring_thickness_mm, 12",
        "tire.speling: 1 found, unknown key",
        "sensor.rate_hz: 100.0 found, allowed: a number from 2000 to 25600",
        "noise_mg_rthz: a list of 2 found",
        "the times do not increase",
        'pressure_kpa: "high" found',
        "hub[#2].hub: 3 found",
        "another wheel has the same",
        "drum_radius_mm: -100.0 found",
    ):
        assert expected in message, expected
    assert all(line.startswith("my.toml: ") for line in message.splitlines())
    assert "faults in my.toml" in caught.value.remedy


@pytest.mark.parametrize("value", ["[]", "[[0]]", "[1, 2]", "true", "[[0, 900000]]", "nan"])
def test_invalid_series_are_rejected(value: str) -> None:
    with pytest.raises(ConfigError, match="load_n"):
        parse_scenario(f"{WHEEL}load_n = {value}\n", "test")


@pytest.mark.parametrize(
    "text",
    [
        "wheel = 3",
        'wheel = ["a", "a"]',
        "[[wheel]]\nposition = [1]\n[[wheel]]\nposition = [1]\nhub = {a = 1}",
        "hub = 7",
    ],
)
def test_wrong_types_are_rejected(text: str) -> None:
    with pytest.raises(ConfigError, match=r"test: (wheel|hub)"):
        parse_scenario(text, "test")


def test_bandwidth_beyond_the_rate_is_rejected() -> None:
    text = f"[sensor]\nrate_hz = 2000.0\nbandwidth_hz = 950.0\n{WHEEL}"
    with pytest.raises(ConfigError, match=r"bandwidth_hz: 950.0 found, allowed: up to 0.45 of rate_hz, 900"):
        parse_scenario(text, "test")


def test_files_and_unknown_names(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(WHEEL)
    assert load_scenario(str(path)).wheel[0].position == "W"
    with pytest.raises(SourceError, match="no scenario 'dmo'") as caught:
        load_scenario("dmo")
    assert "did you mean demo" in caught.value.remedy
    with pytest.raises(SourceError, match="no scenario"):
        load_scenario(str(tmp_path / "absent.toml"))
    path.write_text("= 3")
    with pytest.raises(ConfigError, match="not valid TOML"):
        load_scenario(str(path))
