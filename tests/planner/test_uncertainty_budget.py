"""Budgets of standard errors: the parts, and that a promised gain is what comes when the statement is made."""

import json
import math
from dataclasses import replace
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner

import gateway
from gateway.core.cli import treadlink
from gateway.core.config.vehicle import parse_vehicle
from gateway.core.estimates.wheel_setup import WheelSetup
from gateway.planner.uncertainty_budget import REVOLUTIONS, SOURCES, Budget, budgets
from tests.testkit.simulated_wheel import last, simulated

VEHICLE = """[tire]
radius_mm = 320
radius_std_mm = {radius}
pressure_kpa = 210
pressure_std_kpa = {pressure}
ring_thickness_mm = 15
ring_thickness_std_mm = 0.5
[tire.reference]
Bs = 3.08e-3
Bs_std = 1e-5
pressure_kpa = 210
temperature_degc = 25
[[wheel]]
position = "FL"
hub = 0
wheel = 0
load_n = 5000
load_std_n = {load}
[wheel.mounting]
offset_mm = 0
offset_std_mm = {depth}
[wheel.sensor]
rate_std_percent = {rate}
lateral_gain_std_percent = {lateral}
"""
ESTIMATORS = ("kinematic", "distance", "self-calibration", "weak-form", "wear", "ply-steer")
CAREFUL = {"radius": 0.5, "pressure": 1, "load": 50, "depth": 0.1, "rate": 1e-3, "lateral": 1}
SIGNAL = "[sensor]\nrange_g = 1000\n[tire]\ncord_angle_deg = 22\nply_separation_mm = 1.5\n"
SECONDS = 9.0


def setup_of(**stds: float) -> WheelSetup:
    return parse_vehicle(VEHICLE.format(**CAREFUL | stds), "").wheel_setups()[0]


def budgets_of(setup: WheelSetup) -> dict[str, Budget]:
    results = simulated(SIGNAL, SECONDS, setup, ESTIMATORS)[0]
    return {budget.estimate.name: budget for budget in budgets(setup, results[-REVOLUTIONS:])}


@pytest.mark.parametrize(
    ("name", "source", "careless"),
    [
        ("wear_mm", "load", {"load": 500}),
        ("Cw", "pressure", {"pressure": 15}),
        ("speed_mps", "belt radius", {"radius": 6}),
        ("angular_speed_radps", "sampling rate", {"rate": 1}),
        ("ply_steer_contact_line_rad", "lateral gain", {"lateral": 8}),
    ],
)
def test_a_promised_gain_is_what_comes_when_the_statement_is_made(name: str, source: str, careless) -> None:
    setup = setup_of(**careless)
    budget = budgets_of(setup)[name]
    promise = budget.promise
    assert promise is not None
    assert promise.source.name == source
    better = promise.source.with_error(setup, promise.source.better)
    came = last(simulated(SIGNAL, SECONDS, better, ESTIMATORS)[0])[name]
    before = last(simulated(SIGNAL, SECONDS, setup, ESTIMATORS)[0])[name]
    assert promise.std == pytest.approx(came.std, rel=0.05)
    assert came.std < 0.7 * before.std


def test_parts_make_up_the_error() -> None:
    made = budgets_of(setup_of(load=500))
    for budget in made.values():
        whole = math.hypot(budget.scatter_std, budget.model_std, *budget.parts.values())
        assert whole >= 0.999 * budget.estimate.std
    wear = made["wear_mm"]
    # A third of the load's error is that of the thickness.
    assert wear.parts["load"] == pytest.approx(15.0 * 0.1 / 3.0, rel=0.2)
    assert wear.advice.startswith("wear ±0.5")
    assert " is the load, stated to 10 %; weighed to 2 %, it would be ±0.1" in wear.advice


def test_every_source_reads_what_it_sets() -> None:
    setup = setup_of()
    for source in SOURCES:
        if source.stated(setup) is not None:
            assert source.stated(source.with_error(setup, 0.0123)) == pytest.approx(0.0123), source.name


def test_budgets_of_file_program_and_page_agree(tmp_path: Path) -> None:
    recording, target, table, page = (tmp_path / name for name in ("lab.mcap", "b.json", "lab.parquet", "lab.html"))
    assert CliRunner().invoke(treadlink, ["simulate", "lab", "--duration", "6", "--out", str(recording)]).exit_code == 0
    options = ["--uncertainty-budget", str(target), "--parquet", str(table), "--html", str(page)]
    result = CliRunner().invoke(treadlink, ["estimate", str(recording), *options])
    assert result.exit_code == 0, result.output
    assert "uncertainty budget" in result.output
    entries = json.loads(target.read_text(encoding="utf-8"))
    metadata = pq.read_metadata(table).metadata
    assert json.loads(metadata[b"treadlink.uncertainty_budget"]) == entries
    by_name = {entry["quantity"]: entry for entry in entries}
    opened = gateway.open(recording)
    estimates = {name: opened.estimates().select(name) for name in by_name}
    made = {budget.estimate.name: budget for budget in opened.uncertainty_budget()["W1"]}
    for name, entry in by_name.items():
        # What was printed, also of a distance, which is that of the whole recording.
        assert entry["std"] == pytest.approx(estimates[name].std[-1])
        assert made[name].all_parts() == pytest.approx(entry["parts"])
    for name, largest in (("speed_mps", "belt radius"), ("distance_m", "belt radius")):
        assert by_name[name]["parts"][largest] > 0.9 * by_name[name]["std"]
        assert by_name[name]["better"]["statement"] == largest
    advice = made["wear_mm"].advice
    assert "temperature of the new tire, not stated and assumed within 15 K; measured to 2 K, it would" in advice
    html = page.read_text(encoding="utf-8")
    assert advice in html
    assert ", most from belt radius</small>" in html


def test_a_depth_that_is_not_stated_is_named_and_brings_what_is_promised() -> None:
    # Without the circumferential axis nothing measures it.
    radial = SIGNAL.replace("range_g = 1000", 'range_g = 1000\naxes = ["radial"]')
    unstated = VEHICLE.format(**CAREFUL).replace("[wheel.mounting]\noffset_mm = 0\noffset_std_mm = 0.1\n", "")
    setup = parse_vehicle(unstated, "").wheel_setups()[0]
    assert setup.sensor.offset_m is None
    results = simulated(radial, SECONDS, setup, ESTIMATORS)[0]
    budget = next(each for each in budgets(setup, results[-REVOLUTIONS:]) if each.estimate.name == "Cw")
    promise = budget.promise
    assert promise is not None
    assert promise.source.name == "depth of the sensor"
    assert "not stated and assumed within 0.005 m" in budget.advice
    better = promise.source.with_error(setup, promise.source.better)
    assert promise.std == pytest.approx(last(simulated(radial, SECONDS, better, ESTIMATORS)[0])["Cw"].std, rel=0.05)


def test_summary_names_the_largest_part_where_nothing_is_to_be_stated_better() -> None:
    length = budgets_of(setup_of(radius=0.5))["contact_length_m"]
    assert length.advice == ""
    assert length.summary.startswith("contact length ±")
    assert length.summary.endswith(", is the model")


def test_temperature_of_the_new_tire_brings_what_is_promised() -> None:
    setup = parse_vehicle(VEHICLE.format(**CAREFUL).replace("temperature_degc = 25\n", ""), "").wheel_setups()[0]
    promise = budgets_of(setup)["wear_mm"].promise
    assert promise is not None
    assert promise.source.is_assumed
    assert promise.std == pytest.approx(budgets_of(setup_of())["wear_mm"].estimate.std, rel=0.05)


def test_an_error_that_nobody_stated_is_called_assumed() -> None:
    unstated = VEHICLE.format(**CAREFUL).replace("radius_std_mm = 0.5\n", "").replace("rate_std_percent = 0.001\n", "")
    setup = parse_vehicle(unstated, "").wheel_setups()[0]
    for chosen, words in ((setup, "not stated and assumed within 1 %"), (setup_of(radius=3.2), "stated to 1 %")):
        results = simulated(SIGNAL, 1.0, chosen, ("kinematic",))[0]
        speed = next(budget for budget in budgets(chosen, results) if budget.estimate.name == "speed_mps")
        assert f"is the belt radius, {words}; rolled over ten turns" in speed.advice


def test_what_a_vehicle_file_leaves_open_has_the_name_of_a_source() -> None:
    names = {source.name for source in SOURCES}
    (stated,) = parse_vehicle(VEHICLE.format(**CAREFUL), "").wheel_setups()
    lines = VEHICLE.format(**CAREFUL).splitlines()
    (bare,) = parse_vehicle("\n".join(line for line in lines if "_std_" not in line), "").wheel_setups()
    assert bare.assumed_errors <= names
    assert bare.assumed_errors - stated.assumed_errors == {
        "load", "pressure", "belt radius", "sensor depth", "sampling rate", "lateral gain"
    }  # fmt: skip


def test_an_error_that_earlier_revolutions_had_made_smaller_has_no_budget() -> None:
    setup = setup_of(load=500)
    results = simulated(SIGNAL, SECONDS, setup, ESTIMATORS)[0]
    *earlier, latest = results[-REVOLUTIONS:]
    halves = tuple(of._replace(std=0.5 * of.std) if of.name == "Cw" else of for of in latest.estimates)
    made = {of.estimate.name: of for of in budgets(setup, [*earlier, replace(latest, estimates=halves)])}
    assert "Cw" not in made
    assert "wear_mm" in made
    for budget in made.values():
        assert budget.promise is None or budget.promise.std > 0.0
