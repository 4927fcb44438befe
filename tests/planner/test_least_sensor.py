"""The least sensor for the errors wanted: what is asked, the search, and that a plan of its result reaches them."""

import json
import math
from functools import partial
from statistics import median

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.core.errors import ConfigError
from gateway.planner import least_sensor
from gateway.planner.accelerometer import Accelerometer
from gateway.planner.commands.wanted_errors import parse_speeds_mps, parse_want
from gateway.planner.least_sensor import (
    NOISES_MG_RTHZ,
    LeastSensor,
    WorstError,
    better_statements,
    drives_of,
    largest_noise,
    least_sensors,
    reaching_parts,
)
from gateway.planner.planned_errors import driven
from gateway.planner.views.sensor_plan import parts_line
from gateway.planner.wants import Want
from gateway.simulator.scenario import load_scenario
from tests.testkit.commands import invoked

TRUTHS = {"speed_mps": 20.0, "wear_mm": 0.0, "Ts": 2.5, "Ts/Cw": 12.5, "contact_length_m": 0.15}


@pytest.mark.parametrize(
    ("text", "want"),
    [
        ("wear=0.5mm", Want("wear_mm", 0.5)),
        ("wear_mm=0.5 mm", Want("wear_mm", 0.5)),
        ("speed=0.36km/h", Want("speed_mps", 0.1)),
        ("contact_length=1mm", Want("contact_length_m", 1e-3)),
        ("Ts=4%", Want("Ts", 0.1)),
        ("Ts/Cw=0.2", Want("Ts/Cw", 0.2)),
    ],
)
def test_want(text, want):
    parsed = parse_want(text, TRUTHS)
    assert parsed.quantity == want.quantity
    assert parsed.error == pytest.approx(want.error)


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("wear", "wear=0.5mm"),
        ("wera=1mm", "Did you mean wear"),
        ("wear=1kg", "in mm"),
        ("wear=1", "has no unit Write wear=1mm"),
        ("wear=1%", "in mm"),  # its true value is 0
        ("Ts=0%", "above 0"),
        ("Ts=-1%", "wear=0.5mm"),
    ],
)
def test_fault_of_a_want_names_the_remedy(text, named):
    with pytest.raises(ConfigError) as raised:
        parse_want(text, TRUTHS)
    assert named in f"{raised.value} {raised.value.remedy}"


def test_speeds():
    assert [3.6 * speed for speed in parse_speeds_mps("60..120km/h")] == pytest.approx([60.0, 90.0, 120.0])
    assert [3.6 * speed for speed in parse_speeds_mps("80")] == pytest.approx([80.0])
    for text in ("120..60", "1..60", "60..900km/h", "60-120", "nan", ""):
        with pytest.raises(ConfigError, match="range of speeds"):
            parse_speeds_mps(text)


@given(st.floats(1e-3, 2000.0))
def test_search_gives_the_largest_noise_that_reaches_the_error(limit_mg_rthz: float):
    least = largest_noise(2000.0, lambda _, noise: (noise, WorstError("Ts", 20.0, noise, limit_mg_rthz)))
    fitting = [noise for noise in NOISES_MG_RTHZ if noise <= limit_mg_rthz]
    assert least.reached == bool(fitting)
    if fitting:
        assert least.noise_mg_rthz == least.range_g == least.worst.error == fitting[-1]


def test_sensor_that_is_given_reaches_the_error_and_a_noisier_one_does_not(monkeypatch):
    monkeypatch.setattr(least_sensor, "RATES_HZ", (4000.0,))
    monkeypatch.setattr(least_sensor, "NOISES_MG_RTHZ", (1.0, 15.0, 500.0))
    lab, speed_mps = load_scenario("lab"), 80.0 / 3.6
    want = Want("Bs/Cw", 4e-4)
    shares: list[float] = []
    (least,) = least_sensors(lab, [want], [speed_mps], revolutions=20, wheels=3, on_share=shares.append)
    assert least.reached
    assert shares[0] == 0.0
    assert shares == sorted(set(shares))
    assert shares[-1] < 1.0
    assert least.noise_mg_rthz == 15.0
    assert 0.0 < least.worst.minutes <= 20 * 2.0 * math.pi * 0.32 / speed_mps / 60.0
    errors = [printed(lab, least.range_g, noise, speed_mps) for noise in (15.0, 500.0)]
    assert errors[0] <= want.error < errors[1]


def test_parts_that_are_listed_reach_the_error_with_what_their_data_sheets_say():
    least = LeastSensor(2000.0, 100.0, 10.0, WorstError("Cw", 60.0 / 3.6, 3.6e-3, 3.9e-3))
    exact = Accelerometer(name="exact", range_g=200.0, rate_hz=3200.0, noise_mg_rthz=5.0)
    parts = [
        exact,
        exact.model_copy(update={"name": "unknown", "noise_mg_rthz": None}),
        exact.model_copy(update={"name": "zero", "zero_g_offset_g": 2.0}),
        exact.model_copy(update={"name": "slow", "rate_hz": 1600.0}),
    ]
    drive = drives_of(load_scenario("lab"), revolutions=20, wheels=1)
    found = reaching_parts(least, parts, [Want("Cw", 6e-3)], [60.0 / 3.6], 20, drive)
    assert parts_line(found).split(": ")[1] == "exact, unknown (noise unknown)"


def printed(scenario, range_g: float, noise_mg_rthz: float, speed_mps: float) -> float:
    sensor = Accelerometer(name="mine", range_g=range_g, rate_hz=4000.0, noise_mg_rthz=noise_mg_rthz)
    _, drives = driven(scenario, sensor, speed_mps, wheels=3, revolutions=20)
    return median(e.std for drive in drives for e in drive[19].estimates if e.name == "Bs/Cw")


def test_statements_are_made_better_until_the_error_is_printed(monkeypatch):
    monkeypatch.setattr(least_sensor, "RATES_HZ", (4000.0,))
    monkeypatch.setattr(least_sensor, "NOISES_MG_RTHZ", (1.0,))
    lab, speeds, want = load_scenario("lab"), [80.0 / 3.6], Want("wear_mm", 0.3)
    better, advice = better_statements(lab, [want], speeds, revolutions=50)
    assert [source.name for source in better] == ["temperature of the new tire"]
    promised = float(advice[0].rpartition("±")[2].removesuffix(" mm"))
    search = partial(least_sensors, lab, [want], speeds, revolutions=50, wheels=3)
    (as_is,), (made,) = search(), search(better=better)
    assert not as_is.reached
    assert made.reached
    assert made.worst.error == pytest.approx(promised, rel=0.1)
    assert better_statements(lab, [Want("wear_mm", 0.6)], speeds, revolutions=50) == ([], [])


def test_no_statement_makes_a_drive_without_a_revolution_better():
    lab, slow_mps = load_scenario("lab"), 5.0 / 3.6
    assert better_statements(lab, [Want("wear_mm", 0.5)], [slow_mps], revolutions=1) == ([], [])


def test_command_says_what_is_not_reached(tmp_path, monkeypatch):
    monkeypatch.setattr(least_sensor, "RATES_HZ", (2000.0,))
    out = tmp_path / "least.json"
    line = ["lab", "--want", "Ts=0.01%", "--at", "80", "--after", "10", "--wheels", "8", "--json", str(out)]
    done = invoked("plan", *line)
    assert done.exit_code == 1
    assert "not with any noise: Ts at 80 km/h" in done.output
    (row,) = json.loads(out.read_text())
    assert row["noise_mg_rthz"] is None
    assert row["worst"]["error"] > row["worst"]["wanted"]


def test_speed_is_refused_where_the_errors_wanted_have_their_own():
    done = invoked("plan", "lab", "--want", "Ts=5%", "--speed", "80")
    assert done.exit_code == 2
    assert "leave out --speed" in done.output
