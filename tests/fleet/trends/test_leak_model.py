"""A leak that begins at a date has a true rate within a few recordings; refills and air that is let out are no leak."""

import math

import numpy as np
import pytest

from gateway.core.estimates.estimator import Status
from gateway.core.reasons import CoreCode
from gateway.fleet.reasons import FleetCode
from gateway.fleet.trends.fleet_analysis import analyse
from gateway.fleet.trends.leak_model import Leak, flow, newest_leak, straightened
from gateway.fleet.trends.refilled_pressure import scatter_of
from gateway.fleet.trends.tire_history import MONTH_NS
from gateway.fleet.trends.trend_result import Quantity
from tests.testkit.tire_histories import BEGIN_NS, history, number

COUNT = 60
DAYS_A_MONTH = 30.4375
STEP_DAYS = 0.02


def orifice(gauge_kpa: float) -> float:
    """Return the flow of air through a hole (gas dynamics, gamma 1.4), 1 where it is choked at 100 kPa absolute."""
    ratio = 101.325 / (gauge_kpa + 101.325)
    if ratio >= 1.0:
        return 0.0
    choked = math.sqrt(0.528282 ** (2 / 1.4) - 0.528282 ** (2.4 / 1.4))
    share = 1.0 if ratio < 0.528282 else math.sqrt(ratio ** (2 / 1.4) - ratio ** (2.4 / 1.4)) / choked
    return share * (gauge_kpa + 101.325) / 100.0


def drawn(seed: int, leaking: int, kpa_a_day: float, refills: int = 0, let_out_kpa: float = 0.0):
    """Return months, pressures and the true loss a month at the end; the last `leaking` ones are after the begin."""
    rng = np.random.default_rng(seed)
    days = np.sort(rng.uniform(0.0, 120.0, COUNT))
    begin = rng.uniform(days[-leaking - 1], days[-leaking]) if leaking else math.inf
    loss, noise = rng.uniform(0.0, 2.0) / DAYS_A_MONTH, rng.uniform(0.2, 1.0)
    pressure = rng.uniform(180.0, 300.0)
    hole = kpa_a_day / orifice(pressure)
    changes = [(day, rng.uniform(3.0, 30.0)) for day in rng.uniform(0.0, 120.0, refills)]
    changes += [(rng.uniform(20.0, 100.0), -let_out_kpa)] if let_out_kpa else []
    time, values = days[0], []
    for day in days:
        while time < day:
            step = min(STEP_DAYS, day - time)
            pressure -= step * (loss + (hole * orifice(pressure) if time >= begin else 0.0))
            pressure += sum(change for at, change in changes if time <= at < time + step)
            pressure, time = max(pressure, 0.0), time + step
        values.append(pressure)
    true_kpa = DAYS_A_MONTH * hole * orifice(pressure) if leaking else 0.0
    return days / DAYS_A_MONTH, np.array(values) + rng.normal(0.0, noise, COUNT), true_kpa


def found(seed: int, *arguments: float) -> tuple[Leak | None, float]:
    months, values, true_kpa = drawn(seed, *arguments)  # type: ignore[arg-type]
    return newest_leak(months, values, scatter_of(values)), true_kpa


def test_rates_of_leaks_are_true_and_most_have_one_soon():
    certain, pulls = [], []
    for seed in range(100):
        rng = np.random.default_rng(1000 + seed)
        leaking, kpa_a_day = int(rng.integers(2, 11)), float(10.0 ** rng.uniform(0.0, 1.3))
        leak, true_kpa = found(seed, leaking, kpa_a_day)
        if leaking >= 5:
            certain.append(leak is not None and leak.is_certain)
        if leak is not None and leak.is_certain:
            pulls.append(abs(leak.rate_kpa - true_kpa) / leak.rate_std_kpa)
    assert np.mean(certain) >= 0.9
    assert np.mean(np.array(pulls) > 3.5) <= 0.03


def test_refills_and_air_that_is_let_out_are_no_leak():
    for seed in range(60):
        assert found(seed, 0, 0.0, seed % 3, 20.0 * (seed % 4 == 0))[0] is None


def test_a_leak_is_straight_in_its_coordinate():
    pressure, values = 250.0, []
    for _ in range(1500):
        values.append(pressure)
        pressure -= 0.05 * float(flow(np.array([pressure]))[0]) / 100.0
    assert pressure > 50.0
    along = straightened(np.array(values[::100]), values[-1])
    slopes = np.diff(along)
    assert slopes == pytest.approx(np.full(len(slopes), slopes[-1]), rel=5e-3)


@pytest.mark.parametrize("is_stuck", [False, True])
@pytest.mark.parametrize("leaking", [4, 6, 10])
def test_trends_report_the_leak_once_with_its_date(leaking: int, is_stuck: bool):
    rng = np.random.default_rng(leaking)
    months, values, true_kpa = drawn(leaking, leaking, 5.0)
    tire = history(1, COUNT)
    degc = np.full(COUNT, 25.0) if is_stuck else tire.columns["temperature_degc"] + rng.normal(0.0, 0.1, COUNT)
    pressure_pa = 1e3 * ((values + 101.325) * (degc + 273.15) / 293.15 - 101.325)
    columns = {**tire.columns, "pressure_pa": pressure_pa, "temperature_degc": degc}
    for name in ("Bs", "Rs", "Ts"):
        columns[name] = tire.columns[name] * tire.columns["pressure_pa"] / pressure_pa
    leaky = tire.chosen(np.ones(COUNT, dtype=bool), 1)
    times_ns = (BEGIN_NS + np.round(months * MONTH_NS)).astype(np.int64)
    object.__setattr__(leaky, "columns", columns)
    object.__setattr__(leaky, "time_ns", times_ns)
    (result,) = analyse([leaky], recordings=COUNT).tires
    loss = number(result, Quantity.PRESSURE_LOSS)
    assert loss.status is Status.VALID
    assert abs(loss.value - true_kpa) < 3.5 * loss.std
    kinds = (FleetCode.TREND_LOSS_CHANGED, CoreCode.TREND_LEVEL_CHANGED, FleetCode.TREND_LOSES_PRESSURE)
    of_pressure = [
        finding
        for finding in result.findings
        if finding.code in kinds and dict(finding.values).get("name") in (None, "pressure_at_20_degc")
    ]
    assert [finding.code for finding in of_pressure] == [FleetCode.TREND_LOSS_CHANGED]
    assert of_pressure[0]["date"] == str(np.datetime64(int(times_ns[-leaking]), "ns").astype("datetime64[D]"))
    series = next(series for series in result.series if series.name == "pressure_at_20_degc")
    assert len(series.values) == len(series.expected) == COUNT
