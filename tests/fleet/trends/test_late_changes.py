"""A change at the end of a history is found and followed; what does not change is left alone."""

import math
from dataclasses import replace

import numpy as np
import pytest

from gateway.core.estimates.estimator import Status
from gateway.core.reasons import Code, CoreCode
from gateway.core.text.wording import text
from gateway.core.types import FloatArray
from gateway.fleet.reasons import FleetCode
from gateway.fleet.trends.fleet_analysis import analyse
from gateway.fleet.trends.late_changes import find_shape
from gateway.fleet.trends.tire_history import TireHistory
from gateway.fleet.trends.trend_result import FleetTrends, Quantity, TireTrend, TrendNumber
from tests.testkit.tire_histories import history, number

COUNT = 60
CHANGES = {
    CoreCode.TREND_LEVEL_CHANGED,
    FleetCode.TREND_SLOPE_CHANGED,
    FleetCode.TREND_LOSS_CHANGED,
    FleetCode.TREND_WEAR_CHANGED,
    FleetCode.TREND_PASSED,
    FleetCode.TREND_PRESSURE_FELL,
}
# What the loss of pressure is found from.
OF_PRESSURE = ("pressure_pa", "pressure_measured", "temperature_degc")
NOTES = {FleetCode.TREND_NEWEST_LEFT, FleetCode.TREND_RATE_SINCE, FleetCode.TREND_NOW_SINCE}


def changed(tire: TireHistory, **columns: FloatArray) -> TireHistory:
    return replace(tire, columns={**tire.columns, **columns})


def trends_of(tire: TireHistory) -> FleetTrends:
    return analyse([tire], recordings=len(tire.recordings))


def findings(tire: TireTrend, code: Code) -> list[dict[str, object]]:
    return [dict(finding.values) for finding in tire.findings if finding.code is code]


def codes_of(item: TrendNumber) -> set[Code]:
    return {reason.code for reason in item.reasons}


def late(tire: TireHistory, months: float) -> FloatArray:
    """Return the months since this time before the end, 0 earlier."""
    return np.asarray(np.maximum(tire.months - (tire.months[-1] - months), 0.0))


def lower(tire: TireHistory, fall_pa: FloatArray) -> TireHistory:
    pressure = tire.columns["pressure_pa"] - fall_pa
    # Stiffnesses stay: Bs, Rs and Ts are those over the pressure.
    share = tire.columns["pressure_pa"] / pressure
    return changed(tire, pressure_pa=pressure, **{name: tire.columns[name] * share for name in ("Bs", "Rs", "Ts")})


def test_a_leak_that_begins_late_is_followed():
    # A nail: tight for most of the time, then 20 kPa a month in the last 15 % of it.
    tire = history(2, COUNT)
    trends = trends_of(lower(tire, 20e3 * late(tire, 1.2)))
    (single,) = trends.tires
    loss, now = number(single, Quantity.PRESSURE_LOSS), number(single, Quantity.PRESSURE_NOW)
    assert loss.value == pytest.approx(20.0, abs=3.0 * loss.std)
    assert loss.std < 3.0
    assert now.low < 196.0 < now.high
    (finding,) = findings(single, FleetCode.TREND_LOSS_CHANGED)
    assert finding["after_pa"] == pytest.approx(20e3, rel=0.15)
    assert finding["before_pa"] == pytest.approx(0.0, abs=300.0)
    assert finding["last"] == "car_0059.mcap"
    assert FleetCode.TREND_RATE_SINCE in codes_of(loss)
    assert FleetCode.TREND_NOW_SINCE in codes_of(now)
    assert not [outlier for outlier in trends.outliers if outlier.name == "pressure_at_20_degc"]


@pytest.mark.parametrize("rate_kpa", [4.0, 8.0])
def test_a_bend_is_no_refill(rate_kpa):
    tire = history(3, COUNT)
    (single,) = trends_of(lower(tire, 1e3 * rate_kpa * late(tire, 4.0))).tires
    loss = number(single, Quantity.PRESSURE_LOSS)
    assert FleetCode.TREND_STEPS not in codes_of(loss)
    assert (loss.status, loss.value) == (Status.VALID, pytest.approx(rate_kpa, abs=3.0 * loss.std))
    assert {FleetCode.TREND_LOSS_CHANGED, FleetCode.TREND_LOSES_PRESSURE} <= {
        finding.code for finding in single.findings
    }


def test_few_newest_recordings_make_provisional_numbers():
    tire = history(2, COUNT)
    (single,) = trends_of(lower(tire, 60e3 * late(tire, 0.6))).tires
    for quantity in (Quantity.PRESSURE_LOSS, Quantity.PRESSURE_NOW):
        assert number(single, quantity).status is Status.PROVISIONAL
    assert findings(single, FleetCode.TREND_LOSS_CHANGED)


@pytest.mark.parametrize("last", [2, 3])
def test_the_last_recordings_together_are_a_change(last):
    tire = history(4, COUNT)
    low = np.where(np.arange(COUNT) >= COUNT - last, 30e3, 0.0)
    trends = trends_of(lower(tire, low))
    (single,) = trends.tires
    (finding,) = findings(single, CoreCode.TREND_LEVEL_CHANGED)
    assert (finding["name"], finding["count"]) == ("pressure_at_20_degc", last)
    assert finding["change"] == pytest.approx(-30.0, abs=2.0)
    assert finding["first"] == f"car_{COUNT - last:04d}.mcap"
    now, loss = number(single, Quantity.PRESSURE_NOW), number(single, Quantity.PRESSURE_LOSS)
    assert (now.status, now.value) == (Status.PROVISIONAL, pytest.approx(190.0, abs=2.0))
    assert loss.status is Status.PROVISIONAL
    assert FleetCode.TREND_NEWEST_LEFT in codes_of(loss)


def test_a_last_recording_that_deviates_alone_is_an_outlier_and_said():
    tire = history(4, COUNT)
    trends = trends_of(lower(tire, np.where(np.arange(COUNT) == COUNT - 1, 30e3, 0.0)))
    (single,) = trends.tires
    assert not CHANGES & {finding.code for finding in single.findings}
    assert "pressure_at_20_degc" in {outlier.name for outlier in trends.outliers}
    now = number(single, Quantity.PRESSURE_NOW)
    assert now.status is Status.PROVISIONAL
    assert now.reasons[0].code is FleetCode.TREND_LAST_DEVIATES
    assert now.reasons[0]["deviation"] < -20.0


def test_a_refill_at_the_end_is_none():
    tire = history(4, COUNT)
    (single,) = trends_of(lower(tire, np.where(np.arange(COUNT) >= COUNT - 3, -20e3, 0.0))).tires
    assert not single.findings
    assert number(single, Quantity.PRESSURE_NOW).value == pytest.approx(240.0, abs=2.0)
    assert number(single, Quantity.PRESSURE_LOSS).status is Status.VALID


def test_recordings_in_a_row_that_deviate_are_a_finding():
    tire = history(5, COUNT)
    wrong = tire.columns["Bs"] * np.where((np.arange(COUNT) >= 30) & (np.arange(COUNT) < 33), 0.8, 1.0)
    trends = trends_of(changed(tire, Bs=wrong))
    (finding,) = findings(trends.tires[0], FleetCode.TREND_PASSED)
    assert (finding["name"], finding["count"]) == ("Bs", 3)
    assert (finding["first"], finding["last"]) == ("car_0030.mcap", "car_0032.mcap")
    assert {outlier.recording for outlier in trends.outliers} == {"car_0030.mcap", "car_0031.mcap", "car_0032.mcap"}


def test_wear_that_grows_at_the_end_is_followed():
    tire = history(6, COUNT)
    fast = tire.columns["wear_mm"] + 1.0 * late(tire, 1.5)
    (single,) = trends_of(changed(tire, wear_mm=fast)).tires  # no new tire
    now, rate = number(single, Quantity.WEAR_NOW), number(single, Quantity.WEAR_RATE)
    assert now.value == pytest.approx(0.05 * 9.6 + 1.5, abs=0.2)
    # 1 mm in a month of 1,200 km, on top of 0.05 mm in 1,000 km
    assert rate.value == pytest.approx(0.05 + 1.0 / 1.2, abs=3.0 * rate.std)
    (finding,) = findings(single, FleetCode.TREND_WEAR_CHANGED)
    assert finding["before_m"] == pytest.approx(5e-5, abs=3e-5)


@pytest.mark.parametrize(
    ("name", "factor"), [("samples_lost", 5000.0), ("noise_mps2", 6.0), ("gain", 1.05), ("mounting_offset_m", 4e-3)]
)
def test_a_sensor_that_fails_at_the_end_is_found(name, factor):
    tire = history(7, COUNT)
    is_late = late(tire, 1.5) > 0.0
    column = tire.columns[name]
    is_added = name in ("samples_lost", "mounting_offset_m")
    worse = column + np.where(is_late, factor, 0.0) if is_added else column * np.where(is_late, factor, 1.0)
    (single,) = trends_of(changed(tire, **{name: worse})).tires
    (finding,) = findings(single, CoreCode.TREND_LEVEL_CHANGED)
    assert finding["name"] == name
    assert abs(int(str(finding["count"])) - int(is_late.sum())) <= 1


def test_series_that_are_not_tested_keep_all_values():
    tire = history(8, COUNT)
    lost = tire.columns["samples_lost"] + np.where(np.isin(np.arange(COUNT), [10, 25, 40]), 15_000.0, 0.0)
    (single,) = trends_of(changed(tire, samples_lost=lost)).tires
    rate = number(single, "loss_rate")
    assert rate.count == COUNT
    assert FleetCode.TREND_OUTLIERS_LEFT_OUT not in codes_of(rate)


def test_a_noise_that_goes_with_the_speed_is_provisional():
    tire = history(count=100)
    speed = 10.0 + 30.0 * tire.months / tire.months[-1]
    noise = 0.05 * np.exp((speed / 30.0) ** 2)
    single = trends_of(changed(tire, speed_mean_mps=speed + 1e-3 * np.sin(np.arange(100)), noise_mps2=noise)).tires[0]
    rate = number(single, "noise_rate")
    if FleetCode.TREND_RATE_SINCE not in codes_of(rate):
        assert rate.status is Status.PROVISIONAL
        assert rate.reasons[0].code is FleetCode.TREND_SPEED_WITH_TIME


@pytest.mark.parametrize(("share", "first_rate", "second_rate"), [(0.25, 0.5, 0.5), (0.4, 0.2, 0.2), (0.5, 0.08, 0.24)])
def test_a_second_tire_that_lives_longer_is_found(share, first_rate, second_rate):
    tire = history(9, COUNT)
    begin = int(share * COUNT)
    km = tire.km - tire.km[0]
    worn = np.where(np.arange(COUNT) < begin, first_rate * km, second_rate * (km - km[begin])) * 1e-3
    noise = np.random.default_rng(9).normal(0.0, 0.05, COUNT)
    first, second = trends_of(changed(tire, wear_mm=worn + noise)).tires
    assert (first.recordings, second.recordings) == (begin, COUNT - begin)
    for item, rate in ((first, first_rate), (second, second_rate)):
        wear = number(item, Quantity.WEAR_RATE)
        assert wear.value == pytest.approx(rate, abs=4.0 * wear.std)


def test_faster_wear_is_no_second_tire():
    for seed in range(20):
        tire = history(seed, COUNT)
        bent = tire.columns["wear_mm"] + 0.8 * late(tire, 1.0 + 0.25 * seed)
        only = replace(tire, columns={"wear_mm": bent, "temperature_degc": tire.columns["temperature_degc"]})
        assert len(trends_of(only).tires) == 1


def test_a_puncture_within_hours_is_a_finding():
    tire = history(10, 12, months=0.01)
    (single,) = trends_of(lower(tire, 110e3 * tire.months / 0.01)).tires
    (finding,) = findings(single, FleetCode.TREND_PRESSURE_FELL)
    # At 20 degC; the tire is 10 K warmer.
    assert finding["fall_pa"] == pytest.approx(110e3 * 293.0 / 303.0, rel=0.03)
    assert number(single, Quantity.PRESSURE_LOSS).status is Status.INVALID


def test_frequent_refills_are_stated_as_a_limit():
    (single,) = trends_of(history(11, COUNT)).tires
    loss = number(single, Quantity.PRESSURE_LOSS)
    (limit,) = [reason for reason in loss.reasons if reason.code is FleetCode.TREND_REFILLS_OFTEN]
    # 3.5 times a scatter of 0.5 kPa in a week
    assert limit["hidden_pa"] == pytest.approx(8e3, abs=2e3)
    assert "refilled every week" in text(limit)


def test_intervals_of_the_newest_state_cover_it():
    covered = {Quantity.PRESSURE_LOSS: 0, Quantity.PRESSURE_NOW: 0}
    seeds = 40
    for seed in range(seeds):
        tire = history(200 + seed, COUNT)
        tire = replace(tire, columns={name: tire.columns[name] for name in OF_PRESSURE})
        begins = 1.5 + 0.05 * seed
        pressure_pa = tire.columns["pressure_pa"] - 6e3 * late(tire, begins)
        (single,) = trends_of(changed(tire, pressure_pa=pressure_pa)).tires
        truth = {Quantity.PRESSURE_LOSS: 6.0, Quantity.PRESSURE_NOW: 220.0 - 6.0 * begins}
        for quantity, value in truth.items():
            result = number(single, quantity)
            covered[quantity] += result.low <= value <= result.high
    assert min(covered.values()) >= 0.85 * seeds


def test_what_does_not_change_makes_no_finding():
    for seed in range(8):
        (single,) = trends_of(history(1000 + seed, 40)).tires
        assert not CHANGES & {finding.code for finding in single.findings}
        assert not NOTES & {reason.code for entry in single.numbers for reason in entry.reasons}


@pytest.mark.slow
def test_less_than_one_percent_of_tires_have_a_false_change():
    false, tires = 0, 200
    for seed in range(tires):
        (single,) = trends_of(history(2000 + seed, (20, 40, 100)[seed % 3])).tires
        false += bool(CHANGES & {finding.code for finding in single.findings})
    assert false <= 0.01 * tires


@pytest.mark.parametrize("scatter", ["normal", "heavy", "correlated", "with outliers"])
def test_false_changes_are_rare(scatter):
    # A tire has 12 series: one of 1,200 is 1 % of the tires.
    rng = np.random.default_rng(12)
    false, series = 0, 300
    for number_of in range(series):
        count = (20, 40, 80)[number_of % 3]
        time = np.sort(rng.uniform(0.0, 8.0, count))
        values = rng.standard_t(4.0, count) if scatter == "heavy" else rng.normal(0.0, 1.0, count)
        if scatter == "correlated":
            for index in range(1, count):
                values[index] += 0.4 * values[index - 1]
        if scatter == "with outliers":
            values[rng.choice(count, 2, replace=False)] += rng.choice([-20.0, 20.0], 2)
        design = np.column_stack([np.ones(count), time - time.mean()])
        false += find_shape(design, values, family=12).change is not None
    # 0.25 are expected. Tails are heavier, and neighbours more alike, than the test takes them to be.
    assert false <= (1 if scatter in ("normal", "with outliers") else 2)


def test_a_scatter_that_grows_is_no_change():
    rng = np.random.default_rng(13)
    time = np.linspace(0.0, 8.0, COUNT)
    design = np.column_stack([np.ones(COUNT), time - time.mean()])
    results = [find_shape(design, rng.normal(0.0, 0.2 + 0.2 * time), family=12).change for _ in range(100)]
    assert sum(change is not None for change in results) <= 2


def test_sizes_below_the_least_are_no_change():
    time = np.linspace(0.0, 8.0, COUNT)
    design = np.column_stack([np.ones(COUNT), time - time.mean()])
    bent = 0.01 * np.maximum(time - 6.0, 0.0) + np.random.default_rng(14).normal(0.0, 1e-4, COUNT)
    result = find_shape(design, bent, least_change=0.01).change
    assert result is not None
    assert (result.is_slope, time[result.begin]) == (True, pytest.approx(6.0, abs=0.3))
    assert find_shape(design, bent, least_change=0.05).change is None
    assert math.isfinite(result.column.sum())
