"""Planted trends of tires are found with errors that hold; what is not there is not found."""

import math
from dataclasses import replace

import numpy as np
import pytest

from gateway.core.estimates.estimator import Status
from gateway.core.reasons import Code, CoreCode
from gateway.fleet.reasons import FleetCode
from gateway.fleet.trends.fleet_analysis import analyse
from gateway.fleet.trends.tire_history import TireHistory
from gateway.fleet.trends.trend_result import FleetTrends, Quantity, TireTrend
from gateway.fleet.views.trend_terminal import trend_lines
from tests.testkit.tire_histories import history, number


def trends_of(*tires: TireHistory) -> FleetTrends:
    return analyse(tires, recordings=sum(len(tire.recordings) for tire in tires))


def codes(tire: TireTrend) -> set[Code]:
    return {finding.code for finding in tire.findings}


def changed(tire: TireHistory, name: str, values: np.ndarray) -> TireHistory:
    return replace(tire, columns={**tire.columns, name: values})


def only_wear(tire: TireHistory) -> TireHistory:
    names = ("wear_mm", "wear_mm_std", "temperature_degc")
    return replace(tire, columns={name: tire.columns[name] for name in names})


def test_planted_wear_is_found():
    # 0.5 mm in 10,000 km
    (tire,) = trends_of(history(wear_mm_per_1000km=0.05)).tires
    result = number(tire, Quantity.WEAR_RATE)
    assert result.status is Status.VALID
    assert result.unit == "mm/1000 km"
    assert result.value == pytest.approx(0.05, abs=3.0 * result.std)
    assert result.std < 0.01
    assert result.low < 0.05 < result.high
    assert result.count == 100
    now = number(tire, Quantity.WEAR_NOW)
    assert now.value == pytest.approx(0.05 * 9.6, abs=0.1)
    assert now.std > 0.25  # what all recordings share


def test_wear_intervals_cover_the_truth():
    tires = [only_wear(history(seed, 30, wear_mm_per_1000km=0.02)) for seed in range(60)]
    rates = [number(tire, Quantity.WEAR_RATE) for tire in trends_of(*tires).tires]
    assert len(rates) == 60
    assert sum(rate.low < 0.02 < rate.high for rate in rates) >= 53


def test_leak_is_separated_from_temperature():
    leaking, tight = trends_of(history(1, leak_pa=3000.0), history(2, vehicle="tight")).tires
    result = number(leaking, Quantity.PRESSURE_LOSS)
    assert result.unit == "kPa/month"
    assert result.value == pytest.approx(3.0, abs=3.0 * result.std)
    assert FleetCode.TREND_LOSES_PRESSURE in codes(leaking)
    assert codes(tight) == set()
    assert abs(number(tight, Quantity.PRESSURE_LOSS).value) < 3.0 * number(tight, Quantity.PRESSURE_LOSS).std + 1e-9


def test_refills_do_not_hide_a_leak():
    tire = history(leak_pa=4000.0)
    refilled = tire.columns["pressure_pa"] + 15e3 * (np.arange(100) >= 40) + 12e3 * (np.arange(100) >= 75)
    (result,) = trends_of(changed(tire, "pressure_pa", refilled)).tires
    loss = number(result, Quantity.PRESSURE_LOSS)
    assert loss.value == pytest.approx(4.0, abs=3.0 * loss.std)
    assert any(reason.code is FleetCode.TREND_STEPS and reason["count"] == 2 for reason in loss.reasons)


def test_a_leak_refilled_every_month_is_found():
    # A saw-tooth: no single step reduces its residual, and there are more than the greedy search adds.
    tire = history(count=240, months=16.0)
    lost = 9000.0 * (tire.months % 1.0)
    (result,) = trends_of(changed(tire, "pressure_pa", tire.columns["pressure_pa"] - lost)).tires
    loss = number(result, Quantity.PRESSURE_LOSS)
    assert loss.value == pytest.approx(9.0, abs=3.0 * loss.std)
    assert FleetCode.TREND_LOSES_PRESSURE in codes(result)
    assert any(reason.code is FleetCode.TREND_STEPS and reason["count"] == 15 for reason in loss.reasons)


def test_small_refills_do_not_hide_a_leak():
    # 2.8 kPa every month: less than a step of the line. Without its refills the tire seems tight.
    tire = history(count=150, months=12.0)
    lost = 2800.0 * (tire.months % 1.0)
    (result,) = trends_of(changed(tire, "pressure_pa", tire.columns["pressure_pa"] - lost)).tires
    loss = number(result, Quantity.PRESSURE_LOSS)
    assert loss.low < 2.8 < loss.high
    assert loss.low > 1.4
    # Sure of no more than what tight tires may lose.
    assert FleetCode.TREND_LOSES_PRESSURE not in codes(result)
    assert any(reason.code is FleetCode.TREND_REFILLS_HIDE for reason in loss.reasons)


def test_noise_of_a_tire_that_is_driven_faster_each_time_is_the_speeds():
    # The road's noise bends up with the speed, which hardly differs from the time.
    tire = history()
    speed = 10.0 + 30.0 * tire.months / tire.months[-1]
    noise = 0.05 * np.exp((speed / 30.0) ** 2)
    faster = changed(changed(tire, "speed_mean_mps", speed + 1e-3 * np.sin(np.arange(100))), "noise_mps2", noise)
    (result,) = trends_of(faster).tires
    assert FleetCode.TREND_SENSOR_NOISE not in codes(result)


def test_a_pressure_that_never_changes_shows_no_loss():
    tire = history()
    (result,) = trends_of(changed(tire, "pressure_pa", np.full(100, 220e3))).tires
    for quantity in (Quantity.PRESSURE_LOSS, Quantity.PRESSURE_NOW):
        assert number(result, quantity).status is Status.INVALID
        assert number(result, quantity).reasons[0].code is FleetCode.TREND_PRESSURE_CONSTANT


@pytest.mark.parametrize("leak_kpa", [0.0, 12.0])
def test_error_that_the_sensor_states_is_in_the_pressure_and_not_in_its_loss(leak_kpa):
    tire = history()
    leaking = tire.columns["pressure_pa"] - 1e3 * leak_kpa * np.maximum(np.arange(100) - 93, 0)
    tire = changed(tire, "pressure_pa", leaking)
    (plain,), (stated,) = (
        trends_of(each).tires for each in (tire, changed(tire, "pressure_std_pa", np.full(100, 1500.0)))
    )
    now, stated_now = (number(each, Quantity.PRESSURE_NOW) for each in (plain, stated))
    assert stated_now.std == pytest.approx(np.hypot(now.std, 1.5))
    assert number(stated, Quantity.PRESSURE_LOSS).std == number(plain, Quantity.PRESSURE_LOSS).std


def test_a_temperature_that_never_changes_makes_no_leak():
    tire = history()
    colder = 220e3 - 3000.0 * tire.months
    stuck = changed(changed(tire, "pressure_pa", colder), "temperature_degc", np.full(100, 25.0))
    (result,) = trends_of(stuck).tires
    loss = number(result, Quantity.PRESSURE_LOSS)
    assert loss.status is Status.PROVISIONAL
    assert loss.reasons[0].code is FleetCode.TREND_TEMPERATURE_STUCK
    assert FleetCode.TREND_LOSES_PRESSURE not in codes(result)


def test_a_distance_that_stands_still_is_said():
    tire = history()
    (result,) = trends_of(replace(tire, km=np.full(100, 20_000.0))).tires
    assert number(result, Quantity.WEAR_RATE).reasons[0].code is FleetCode.TREND_DISTANCE_CONSTANT


def test_stated_pressure_shows_no_loss():
    tire = history()
    (result,) = trends_of(changed(tire, "pressure_measured", np.zeros(100))).tires
    loss = number(result, Quantity.PRESSURE_LOSS)
    assert loss.status is Status.INVALID
    assert math.isnan(loss.value)
    assert loss.reasons[0].code is FleetCode.TREND_NOT_MEASURED


def test_stiffness_with_age_and_temperature():
    (tire,) = trends_of(history(stiffening=0.01, softening=0.006, wear_mm_per_1000km=0.0)).tires
    age, warmth = number(tire, "Cw_rate"), number(tire, "Bs_temperature")
    assert age.value == pytest.approx(1.0, abs=3.0 * age.std)
    assert warmth.value == pytest.approx(-0.6, abs=3.0 * warmth.std)
    assert FleetCode.TREND_STIFFNESS_DRIFTS in codes(tire)
    assert abs(number(tire, "Rs_rate").value) < 3.0 * number(tire, "Rs_rate").std


def test_constant_temperature_has_no_coefficient():
    tire = history()
    (result,) = trends_of(changed(tire, "temperature_degc", np.full(100, 30.0))).tires
    assert number(result, "Bs_temperature").reasons[0].code is FleetCode.TREND_TEMPERATURE_CONSTANT
    # What a season makes looks like a trend.
    assert number(result, "Bs_rate").status is Status.PROVISIONAL


def test_fall_of_wear_begins_a_new_tire():
    tire = history(wear_mm_per_1000km=0.3)
    fallen = tire.columns["wear_mm"] - 1.6 * (np.arange(100) >= 60)
    first, second = trends_of(changed(tire, "wear_mm", fallen)).tires
    assert (first.part, second.part) == (1, 2)
    assert (first.recordings, second.recordings) == (60, 40)
    for item in (first, second):
        rate = number(item, Quantity.WEAR_RATE)
        assert rate.value == pytest.approx(0.3, abs=4.0 * rate.std)


def test_noisy_sensor_is_found():
    noisy, fine = trends_of(history(1, noise_growth=0.1), history(2, vehicle="fine")).tires
    assert codes(noisy) == {FleetCode.TREND_SENSOR_NOISE}
    assert noisy.findings[0]["factor"] == pytest.approx(math.exp(0.8), rel=0.1)
    assert codes(fine) == set()


@pytest.mark.parametrize(
    ("name", "change", "code"),
    [
        ("samples_lost", 3000.0, FleetCode.TREND_SENSOR_LOSSES),
        ("samples_saturated", 600.0, FleetCode.TREND_SENSOR_CLIPS),
        ("mounting_offset_m", 0.004, FleetCode.TREND_SENSOR_MOVES),
        ("gain", 0.05, CoreCode.TREND_SENSOR_GAIN),
    ],
)
def test_degrading_sensor_is_found(name, change, code):
    tire = history()
    worse = tire.columns[name] + change * tire.months / tire.months[-1]
    (result,) = trends_of(changed(tire, name, worse)).tires
    assert codes(result) == {code}


def test_fast_wear_is_a_finding_of_the_fleet():
    fleet = [history(seed, vehicle=f"car {seed}", wear_mm_per_1000km=0.02) for seed in range(5)]
    *others, fast = trends_of(*fleet, history(9, vehicle="fast", wear_mm_per_1000km=0.08)).tires
    assert codes(fast) == {FleetCode.TREND_WEARS_FAST}
    assert all(not tire.findings for tire in others)


def test_load_is_measured_or_as_stated():
    (measured,) = trends_of(history()).tires
    load = number(measured, Quantity.LOAD)
    assert load.status is Status.VALID
    assert load.value == pytest.approx(4000.0, abs=2.0 * load.std)
    assert number(measured, Quantity.LOAD_SCATTER).value == pytest.approx(42.0, rel=0.3)
    tire = history()
    (stated,) = trends_of(changed(tire, "estimated_load_n", np.full(100, math.nan))).tires
    assert number(stated, Quantity.LOAD).status is Status.PROVISIONAL
    assert number(stated, Quantity.LOAD).reasons[0].code is FleetCode.TREND_LOAD_STATED
    assert number(stated, Quantity.LOAD_RATE).status is Status.INVALID


@pytest.mark.parametrize(("days", "known"), [(0.1, set()), (3.0, {Quantity.PRESSURE_LOSS}), (8.0, None)])
def test_a_rate_per_month_needs_days(days, known):
    tire = history(months=days * 12.0 / 365.25)
    (result,) = trends_of(tire).tires
    assert result.findings == ()
    monthly = {entry.quantity: entry for entry in result.numbers if entry.unit.endswith("/month")}
    rates = {quantity for quantity, item in monthly.items() if item.status is Status.VALID}
    if known is None:
        assert {"Bs_rate", "noise_rate", Quantity.PRESSURE_LOSS, Quantity.LOAD_RATE} <= rates
        return
    assert rates == known
    reason = monthly["Bs_rate"].reasons[0]
    assert (reason.code, reason["needed_s"]) == (FleetCode.TREND_SPAN_SHORT, pytest.approx(7.0 * 86_400.0))
    assert reason["span_s"] == pytest.approx(86_400.0 * days)
    assert number(result, Quantity.PRESSURE_NOW).status is Status.VALID
    assert number(result, "Bs_temperature").status is Status.VALID


def test_wear_per_1000_km_needs_a_distance():
    tire = history()
    near, far = (replace(tire, km=20_000.0 + reach_km * tire.months / 8.0) for reach_km in (2.0, 300.0))
    short, long = (trends_of(item).tires[0] for item in (near, far))
    rate = number(short, Quantity.WEAR_RATE)
    assert rate.status is Status.INVALID
    assert rate.reasons[0].code is FleetCode.TREND_DISTANCE_SHORT
    assert rate.reasons[0]["distance_m"] == pytest.approx(2000.0)
    assert number(short, Quantity.WEAR_NOW).status is Status.VALID
    assert number(long, Quantity.WEAR_RATE).status is Status.VALID


def test_recordings_of_unknown_tires_give_no_valid_number():
    tire = replace(history(leak_pa=4000.0, vehicle="unknown", sensor_id=""), is_identified=False)
    trends = trends_of(tire, replace(tire, position="FR"))
    for entry in trends.tires:
        assert not entry.is_identified
        assert entry.findings == ()
        for each in entry.numbers:
            assert each.status is not Status.VALID
            if each.status is Status.PROVISIONAL:
                assert each.reasons[0].code is FleetCode.TREND_TIRE_UNIDENTIFIED
    assert trends.pairs[0].numbers[0].status is Status.PROVISIONAL
    assert any("(not identified)" in line for line in trend_lines(trends, 120))


def test_asymmetry_of_left_and_right():
    left = history(1, position="FL")
    right = history(2, position="FR")
    right = changed(right, "ply_steer_contact_line_rad", right.columns["ply_steer_contact_line_rad"] - 2e-3)
    (pair,) = trends_of(left, right).pairs
    assert (pair.left, pair.right) == ("FL", "FR")
    steer, slip = pair.numbers
    assert steer.value == pytest.approx(math.degrees(2e-3), abs=3.0 * steer.std)
    assert slip.status is Status.INVALID


def test_recorded_distance_is_provisional():
    (tire,) = trends_of(history(has_odometer=False)).tires
    rate = number(tire, Quantity.WEAR_RATE)
    assert rate.status is Status.PROVISIONAL
    assert rate.reasons[0].code is FleetCode.TREND_RECORDED_DISTANCE


def test_few_recordings_determine_nothing():
    tire = history(count=4)
    (result,) = trends_of(tire).tires
    for entry in result.numbers:
        if entry.quantity != Quantity.LOAD:
            assert entry.status is Status.INVALID, entry
            assert entry.reasons


def test_reason_of_missing_values_is_passed_on():
    tire = history()
    (result,) = trends_of(tire).tires
    reason = number(result, "zero_rate").reasons[0]
    assert (reason.code, reason["why"]) == (FleetCode.TREND_NO_VALUES, "needs two speeds")


def test_outliers_are_named_with_their_recordings():
    tire = history()
    wrong = tire.columns["Bs"].copy()
    wrong[[20, 70]] *= 1.3
    trends = trends_of(changed(tire, "Bs", wrong))
    assert {outlier.recording for outlier in trends.outliers} == {"car_0020.mcap", "car_0070.mcap"}
    assert {outlier.name for outlier in trends.outliers} == {"Bs"}
    assert all(outlier.deviation > 5.0 for outlier in trends.outliers)
    rate = number(trends.tires[0], "Bs_rate")
    assert any(reason.code is FleetCode.TREND_OUTLIERS_LEFT_OUT for reason in rate.reasons)


def test_false_outliers_are_below_one_percent():
    fleets = [trends_of(*(history(10 * fleet + n, 100, vehicle=f"car {n}") for n in range(2))) for fleet in range(6)]
    recordings = sum(fleet.recordings for fleet in fleets)
    false = sum(len({outlier.path for outlier in fleet.outliers}) for fleet in fleets)
    assert recordings == 1200
    assert false / recordings <= 0.01
    assert sum(bool(fleet.outliers) for fleet in fleets) <= 1
    assert all(not tire.findings for fleet in fleets for tire in fleet.tires)


@pytest.mark.slow
def test_false_outliers_of_many_fleets():
    false, fleets = 0, 60
    for fleet in range(fleets):
        false += bool(trends_of(*(history(100 + 10 * fleet + n, 60, vehicle=f"car {n}") for n in range(4))).outliers)
    assert false <= 3  # 0.6 are expected
