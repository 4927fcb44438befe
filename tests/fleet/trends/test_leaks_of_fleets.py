"""Printed rates of leaks are true on random fleets, whose generator does not know the model, and beside tight ones."""

import math

import numpy as np
import pytest

from gateway.core.estimates.estimator import Status
from gateway.fleet.reasons import FleetCode
from gateway.fleet.trends.fleet_analysis import analyse
from gateway.fleet.trends.neighbouring_wheels import without_common
from gateway.fleet.trends.tire_history import MONTH_NS, TireHistory
from gateway.fleet.trends.trend_result import Quantity
from gateway.fleet.trends.watched_series import SERIES
from tests.testkit.tire_histories import number
from tools.bench_leaks import counted

COUNT = 40
# Findings of a loss that has begun: with a rate, or before it has one.
FALLS = (
    FleetCode.TREND_LOSS_CHANGED,
    FleetCode.TREND_PRESSURE_FELL,
    SERIES["pressure_at_20_degc"].watch.level,
)
MONTH_DAYS = MONTH_NS / 86_400e9


def wheel(days, cold_kpa, *, position="FL", sensor="1", warm_k=None, degc=None, seed=0) -> TireHistory:
    """Return a wheel of a gas whose temperature deviates from 20 °C by `warm_k`; `degc` is what its sensor says."""
    rng = np.random.default_rng([seed, ord(sensor)])
    warm_k = rng.normal(0.0, 4.0, len(days)) if warm_k is None else warm_k
    gauge = (cold_kpa + 101.325) * (293.15 + warm_k) / 293.15 - 101.325 + rng.normal(0.0, 0.4, len(days))
    names = tuple(f"r{index}" for index in range(len(days)))
    columns = {
        "pressure_pa": 1e3 * np.maximum(gauge, 0.0),
        "temperature_degc": 20.0 + warm_k if degc is None else np.full(len(days), degc),
        "pressure_measured": np.ones(len(days)),
        "revolutions": np.full(len(days), 300.0),
    }
    times = np.round(np.asarray(days) / MONTH_DAYS * MONTH_NS).astype(np.int64)
    return TireHistory("van", position, sensor, names, names, times, 30.0 * np.asarray(days), True, columns, {})


def exponential(days, begin, kpa_a_day, start=230.0):
    """Return pressures that leak by choked flow at one temperature."""
    past = np.maximum(days - begin, 0.0)
    return (start + 101.325) * np.exp(-past * kpa_a_day / (start + 101.325)) - 101.325


def days_of(seed):
    return np.sort(np.random.default_rng(seed).uniform(0.0, 80.0, COUNT))


def loss_of(histories):
    tire = analyse(histories, recordings=COUNT).tires[0]
    return number(tire, Quantity.PRESSURE_LOSS), tire


@pytest.mark.parametrize("degc", [25.0, math.nan])
def test_leak_beside_tight_neighbours_has_a_rate_without_a_temperature(degc):
    days = days_of(3)
    warm = np.random.default_rng(5).normal(0.0, 6.0, COUNT)
    tight = np.full(COUNT, 225.0)
    begin = 0.5 * (days[-9] + days[-8])
    positions = ("FL", "FR", "RL", "RR")
    colds = (exponential(days, begin, 3.0), tight, tight + 5.0, tight - 4.0)
    wheels = [
        wheel(days, cold, position=position, sensor=str(index), warm_k=warm, degc=degc)
        for index, (position, cold) in enumerate(zip(positions, colds, strict=True))
    ]
    loss, tire = loss_of(wheels)
    true_kpa = 3.0 * MONTH_DAYS * (colds[0][-1] + 101.325) / 331.325
    assert loss.status is Status.VALID
    assert abs(loss.value - true_kpa) < 3.5 * loss.std < 0.35 * true_kpa
    assert [finding.code for finding in tire.findings][:1] == [FleetCode.TREND_LOSS_CHANGED]
    # Alone, the weather would hide it.
    alone, _ = loss_of(wheels[:1])
    assert alone.status is Status.PROVISIONAL
    code = FleetCode.TREND_NOT_MEASURED if math.isnan(degc) else FleetCode.TREND_TEMPERATURE_STUCK
    assert code in {reason.code for reason in alone.reasons}


@pytest.mark.parametrize(("after", "kpa_a_day"), [(1, 4.0), (2, 1.5), (3, 1.5)])
def test_rate_before_a_visible_fall_is_not_valid(after, kpa_a_day):
    days = np.arange(COUNT) * 2.0
    loss, _ = loss_of([wheel(days, exponential(days, days[-after - 1] + 0.5, kpa_a_day))])
    assert loss.status is not Status.VALID or abs(loss.value - kpa_a_day * MONTH_DAYS) < 3.5 * loss.std
    if after == 1:
        (why,) = [reason for reason in loss.reasons if reason.code is FleetCode.TREND_NEWEST_FALL]
        assert why["count"] == 1
    assert loss_of([wheel(days, np.full(COUNT, 230.0))])[0].status is Status.VALID


def test_leak_from_the_first_recording_on_has_the_rate_of_now():
    days = days_of(8)
    cold = exponential(days, -1.0, 2.0, 260.0)
    loss, _ = loss_of([wheel(days, cold)])
    assert loss.status is Status.VALID
    assert loss.value == pytest.approx(2.0 * MONTH_DAYS * (cold[-1] + 101.325) / 361.325, rel=0.05)


def test_leak_that_was_mended_is_none_now():
    days = 2.0 * days_of(9)
    cold = np.where(days < days[20], exponential(days, -1.0, 1.5), 240.0 - 0.01 * (days - days[20]))
    loss, tire = loss_of([wheel(days, cold)])
    assert loss.status is Status.VALID
    assert abs(loss.value - 0.01 * MONTH_DAYS) < 3.5 * loss.std < 4.0
    assert FleetCode.TREND_LOSES_PRESSURE not in {finding.code for finding in tire.findings}


def test_weather_of_all_wheels_is_neither_leak_nor_refill():
    days = days_of(10)
    weather = 2.0 * np.sin(days / 4.0)
    tight = 230.0 - 0.5 * days / MONTH_DAYS
    wheels = [
        wheel(days, tight + weather + index, sensor=str(index), position=position)
        for index, position in enumerate(("FL", "FR", "RL", "RR"))
    ]
    loss, _ = loss_of(wheels)
    assert loss.status is Status.VALID
    assert abs(loss.value - 0.5) < 3.5 * loss.std
    assert loss.std < 1.5


def test_refill_of_all_wheels_is_no_ramp():
    days = np.arange(COUNT) * 2.0
    weather = 1.5 * np.sin(days / 3.0)
    rises = (6.0, 15.0, 16.0, 17.0)
    wheels = [
        wheel(days, 230.0 + weather + rise * (days > days[19]), sensor=str(index), position=position)
        for index, (rise, position) in enumerate(zip(rises, ("FL", "FR", "RL", "RR"), strict=True))
    ]
    colds = [230.0 + weather + rise * (days > days[19]) for rise in rises]
    shared = without_common(wheels, colds, [False] * 4)[0]
    assert shared.removed_kpa > 0.3
    changes = np.diff(shared.cold_kpa)
    assert changes[19] == pytest.approx(rises[0], abs=1.0)
    assert np.abs(np.delete(changes, 19)).max() < 1.2


@pytest.mark.parametrize("kpa_a_day", [3.0, 10.0])
@pytest.mark.parametrize("after", range(2, 9))
def test_fast_leak_of_the_last_recordings_has_a_true_rate_and_its_date(after, kpa_a_day):
    days = days_of(30 + after)
    begin = days[-after - 1] + 0.4 * (days[-after] - days[-after - 1])
    cold = exponential(days, begin, kpa_a_day)
    loss, tire = loss_of([wheel(days, cold, seed=after)])
    true_kpa = kpa_a_day * MONTH_DAYS * (cold[-1] + 101.325) / 331.325
    assert (loss.status is Status.VALID) == (after > 3)
    if loss.status is Status.VALID:
        assert abs(loss.value - true_kpa) < 3.5 * loss.std < 0.5 * true_kpa
        (finding,) = tire.findings
        day = (np.datetime64(str(finding["date"])) - np.datetime64("1970-01-01")).astype(int)
        assert int(begin) <= day <= math.ceil(days[-after])
    elif cold[-after:].max() < 227.0:
        (finding,) = tire.findings
        assert finding.code in FALLS
    assert FleetCode.TREND_STEPS not in {reason.code for reason in loss.reasons}


def test_drives_in_the_mountains_hide_no_fall_and_are_no_finding():
    days = days_of(12)
    high = 10.0 * np.isin(np.arange(COUNT), (6, 14, 15, 27, 34, 37))
    tight = np.full(COUNT, 230.0)
    fallen = tight - 6.0 * (np.arange(COUNT) == COUNT - 2) - 11.0 * (np.arange(COUNT) == COUNT - 1)
    wheels = [
        wheel(days, cold + high + index, sensor=str(index), position=position, seed=4)
        for index, (position, cold) in enumerate(
            zip(("FL", "FR", "RL", "RR"), (fallen, tight, tight, tight), strict=True)
        )
    ]
    first, *others = analyse(wheels, recordings=COUNT).tires
    (finding,) = first.findings
    assert finding.code in FALLS
    assert all(tire.findings == () for tire in others)


def test_pressure_that_rises_without_a_refill_has_no_valid_loss():
    days = np.arange(COUNT) * 2.0
    loss, _ = loss_of([wheel(days, 220.0 + 0.12 * days)])
    assert loss.status is Status.PROVISIONAL
    assert loss.reasons[0].code is FleetCode.TREND_PRESSURE_RISES


def test_rates_of_random_fleets_are_true():
    counts = counted(4)
    assert counts["leak: false rate"] == 0
    assert counts["leak: valid rate within ten recordings"] == counts["leak: fleets"]


@pytest.mark.slow
def test_rates_of_many_random_fleets_are_true():
    counts = counted(60)
    assert counts["leak: false rate"] <= math.ceil(0.005 * counts["leak: valid rate"])
    assert counts["tight: false rate"] <= 0.03 * counts["tight: valid rate"]
    assert counts["leak: valid rate within ten recordings"] >= 0.9 * counts["leak: fleets"]
