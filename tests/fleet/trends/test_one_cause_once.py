"""One cause is one finding, with size, date and error; what a sensor or a load does is neither wear nor a leak."""

from dataclasses import replace

import numpy as np
import pytest

from gateway.core.estimates.estimator import Status
from gateway.core.reasons import CoreCode, Reason
from gateway.core.text.wording import text
from gateway.fleet.reasons import FleetCode
from gateway.fleet.trends.causes import Change, Finding, with_causes
from gateway.fleet.trends.fleet_analysis import analyse
from gateway.fleet.trends.plausible_readings import plausible_readings
from gateway.fleet.trends.tire_history import MONTH_NS, TireHistory
from gateway.fleet.trends.tire_lines import PRESSURE
from gateway.fleet.trends.trend_result import FleetTrends, Quantity, TireTrend
from tests.testkit.tire_histories import history, number

COUNT = 60
LOSSES = {FleetCode.TREND_LOSES_PRESSURE: "loss", FleetCode.TREND_LOSS_CHANGED: "after"}
INDEX = np.arange(COUNT)


def tire_with(seed: int = 3, position: str = "FL", **columns) -> TireHistory:
    """Return a tire of sixty recordings with columns multiplied by factors."""
    tire = history(seed, COUNT, months=4.0, position=position, sensor_id=f"0000a0{position}")
    return replace(tire, columns={**tire.columns, **{name: tire.columns[name] * by for name, by in columns.items()}})


def trend_of(tire: TireHistory) -> TireTrend:
    return analyse([tire], recordings=COUNT).tires[0]


def fleet(seed: int) -> FleetTrends:
    """Return the trends of four healthy wheels of one vehicle."""
    positions = ("FL", "FR", "RL", "RR")
    wheels = [
        history(4 * seed + wheel, COUNT, months=4.0, position=position, sensor_id=f"0000c00{wheel}")
        for wheel, position in enumerate(positions)
    ]
    return analyse(wheels, recordings=4 * COUNT)


def test_step_of_the_load_is_told_once_and_is_no_wear():
    step = np.where(INDEX >= 37, 1.18, 1.0)
    tire = tire_with(estimated_load_n=step, contact_length_m=np.sqrt(step), Bs=step, Cw=step, Rs=step, Ts=step)
    tire.columns["wear_mm"] += 0.8 * (INDEX >= 37)
    trend = trend_of(tire)
    (finding,) = trend.findings
    assert (finding.code, finding["name"]) == (CoreCode.TREND_LEVEL_CHANGED, "estimated_load_n")
    assert finding["change"] == pytest.approx(720.0, abs=4.0 * finding["std"])
    assert finding["count"] == COUNT - 37
    rate, now = number(trend, Quantity.WEAR_RATE), number(trend, Quantity.WEAR_NOW)
    assert abs(rate.value - 0.05) < 3.5 * rate.std
    assert abs(now.value - 0.24) < 0.2


def test_load_of_the_vehicle_is_told_once():
    step = np.where(INDEX >= 37, 1.18, 1.0)
    loaded = {"estimated_load_n": step, "contact_length_m": np.sqrt(step), "Cw": step}
    wheels = [tire_with(seed, position, **loaded) for seed, position in enumerate(("FL", "FR", "RL", "RR"))]
    findings = [finding for tire in analyse(wheels, recordings=4 * COUNT).tires for finding in tire.findings]
    assert [finding["name"] for finding in findings] == ["estimated_load_n"]
    assert "likewise at FR, RL, RR" in text(findings[0])
    # A wheel where it changes at another time has a finding of its own.
    wheels[2] = tire_with(2, "RL")
    wheels[3] = tire_with(3, "RR", estimated_load_n=np.where(INDEX >= 15, 1.18, 1.0))
    tires = analyse(wheels, recordings=4 * COUNT).tires
    assert [len(tire.findings) for tire in tires] == [1, 0, 0, 1]


@pytest.mark.parametrize("is_measured", [True, False])
def test_contact_that_a_load_lengthens_at_several_wheels_is_told_once(is_measured):
    step = np.where(INDEX >= 37, 1.25, 1.0)
    wheels = [tire_with(seed, position, contact_length_m=step) for seed, position in enumerate(("FL", "FR", "RL"))]
    for wheel in wheels:
        wheel.columns["estimated_load_n"][:] = np.nan
        wheel.columns["pressure_measured"][:] = is_measured
    findings = [finding for tire in analyse(wheels, recordings=3 * COUNT).tires for finding in tire.findings]
    (said,) = [text(finding) for finding in findings]
    assert said.endswith("; likewise at FR, RL")
    assert ("a pressure that is not measured" in said) is not is_measured
    assert "by the load" in said


@pytest.mark.parametrize("begin", [22, 33, 41])
def test_step_of_a_load_that_persons_scatter_is_found_and_names_what_follows(begin):
    rng = np.random.default_rng(begin)
    load = 1.0 + 0.06 * rng.choice([0.0, 0.0, 1.0, 2.0], COUNT) + 0.13 * (begin <= INDEX)
    (finding,) = trend_of(tire_with(estimated_load_n=load, contact_length_m=np.sqrt(load), Cw=load)).findings
    assert (finding.code, finding["name"]) == (CoreCode.TREND_LEVEL_CHANGED, "estimated_load_n")
    assert finding["change"] == pytest.approx(520.0, abs=3.5 * finding["std"])
    assert abs(COUNT - finding["count"] - begin) <= 2
    assert "Cw" in finding["consequences"]


def test_what_drifts_with_a_load_that_also_steps_is_told_with_it():
    load = 1.0 + 0.14 * (INDEX >= 38) + 0.06 * INDEX / COUNT
    (finding,) = trend_of(tire_with(estimated_load_n=load, Bs=1 / load, Cw=1 / load, Rs=1 / load)).findings
    assert finding["name"] == "estimated_load_n"
    assert {"Bs", "Cw", "Rs"} <= set(finding["consequences"])


def test_noise_that_was_less_for_a_while_is_no_finding():
    noise = np.exp(-1.2 * np.minimum(INDEX, 20) / 20.0 + 1.2 * np.maximum(INDEX - 20, 0) / 39.0)
    assert trend_of(tire_with(noise_mps2=noise)).findings == ()


def test_noise_that_grows_is_told_by_its_present_size():
    growing = 1.0 + 9.0 * np.clip((INDEX - 36) / 23.0, 0.0, 1.0)
    (finding,) = trend_of(tire_with(noise_mps2=growing)).findings
    assert finding.code is FleetCode.TREND_SENSOR_NOISE
    assert finding["factor"] == pytest.approx(10.0, abs=max(3.5 * finding["std"], 1.5))


@pytest.mark.parametrize("seed", range(4))
def test_faster_wear_after_a_gap_is_told_once_with_the_rate_of_its_recordings(seed):
    tire = tire_with(seed)
    late = np.maximum(INDEX - 52, 0) * 50.0
    km = np.where(INDEX < 53, 50.0 * INDEX, 2800.0 + late)
    rng = np.random.default_rng([7, seed])
    wear = 0.12e-3 * km + 1.88e-3 * late * (INDEX >= 53) + rng.normal(0.0, 0.02, COUNT)
    tire = replace(tire, km=km, columns={**tire.columns, "wear_mm": wear})
    trend = trend_of(tire)
    wears = [item for item in trend.findings if dict(item.values).get("name", "wear_mm") == "wear_mm"]
    assert [item.code for item in wears] == [FleetCode.TREND_WEAR_CHANGED]
    rate = number(trend, Quantity.WEAR_RATE)
    assert rate.value == pytest.approx(2.0, abs=4.0 * rate.std)


def test_date_of_a_step_has_the_error_that_the_scatter_makes():
    errors = []
    for seed in range(12):
        begin = 20 + 2 * seed
        load = 1.0 + np.random.default_rng([9, seed]).normal(0.0, 0.05, COUNT) + 0.16 * (begin <= INDEX)
        tire = tire_with(seed, estimated_load_n=load)
        (finding,) = trend_of(tire).findings
        assert finding["name"] == "estimated_load_n"
        date = COUNT - finding["count"]
        apart_s = 1e-9 * float(tire.time_ns[date] - 0.5 * (tire.time_ns[begin] + tire.time_ns[begin - 1]))
        errors.append(apart_s / finding["since_std_s"])
    assert np.abs(errors).max() < 4.0
    assert 0.3 < np.sqrt(np.mean(np.square(errors))) < 1.8


def test_bending_stiffness_of_a_tire_that_suddenly_wears_is_the_wears():
    worn = 1.4 * np.clip((INDEX - 34) / 6.0, 0.0, 1.0)
    tire = tire_with(Bs=(1.0 - worn / 13.0) ** 3)
    tire.columns["wear_mm"] += worn
    tire.columns["ring_thickness_m"] = np.full(COUNT, 13e-3)
    assert not [finding for finding in trend_of(tire).findings if dict(finding.values).get("name") == "Bs"]


@pytest.mark.parametrize("seed", range(3))
def test_mountains_and_refills_of_all_wheels_make_no_loss(seed):
    rng = np.random.default_rng([31, seed])
    height_kpa = np.where(rng.random(COUNT) < 0.12, rng.uniform(5.0, 11.0, COUNT), 0.0)
    height_kpa[20:24] = 9.0
    wheels = with_losses([0.6, 1.1, 0.9, 1.5])
    for wheel in wheels:
        wheel.columns["pressure_pa"] += 1e3 * (height_kpa + 8.0 * (INDEX >= 26) + 6.0 * (INDEX >= 44))
    for tire in analyse(wheels, recordings=4 * COUNT).tires:
        # Stiffnesses of this tire do not know of the pressure.
        names = [dict(finding.values).get("name") for finding in tire.findings]
        assert all(name in ("Bs", "Rs", "Ts") for name in names)


def test_wear_is_fast_beside_the_spread_of_the_fleet():
    def with_rates(rates: list[float]) -> list[str]:
        wheels = [
            history(40 + wheel, COUNT, months=4.0, wear_mm_per_1000km=rate, position=position, sensor_id=f"e00{wheel}")
            for wheel, (position, rate) in enumerate(zip(("FL", "FR", "RL", "RR"), rates, strict=True))
        ]
        tires = analyse(wheels, recordings=4 * COUNT).tires
        return [tire.position for tire in tires if any(f.code is FleetCode.TREND_WEARS_FAST for f in tire.findings)]

    # Driven wheels wear faster than the others.
    assert with_rates([0.32, 0.29, 0.14, 0.12]) == []
    assert with_rates([0.13, 0.12, 0.14, 0.6]) == ["RR"]


def with_losses(losses_kpa: list[float]) -> list[TireHistory]:
    """Return the wheels of one vehicle that lose pressures a month."""
    wheels = []
    for wheel, loss_kpa in enumerate(losses_kpa):
        tire = history(70 + wheel, COUNT, months=4.0, position=("FL", "FR", "RL", "RR")[wheel], sensor_id=f"d00{wheel}")
        tire.columns["pressure_pa"] -= 1e3 * loss_kpa * tire.months
        wheels.append(tire)
    return wheels


@pytest.mark.parametrize(
    ("losses_kpa", "leaking"), [([3.1, 2.8, 3.4, 3.0], []), ([3.0, 2.9, 4.3, 3.1], []), ([1.4, 1.1, 4.2, 1.6], ["RL"])]
)
def test_a_loss_that_all_tires_have_is_permeation(losses_kpa, leaking):
    tires = analyse(with_losses(losses_kpa), recordings=4 * COUNT).tires
    assert [tire.position for tire in tires if tire.findings] == leaking
    for tire, loss_kpa in zip(tires, losses_kpa, strict=True):
        loss = number(tire, Quantity.PRESSURE_LOSS)
        assert loss.value == pytest.approx(loss_kpa, abs=3.5 * loss.std)


def test_wheels_beside_one_that_was_punctured_have_no_leak():
    tires = with_losses([3.0, 2.9, 3.2, 3.1])
    tires[2].columns["pressure_pa"] -= 4e4 * (np.arange(COUNT) >= COUNT - 3)
    trends = analyse(tires, recordings=4 * COUNT).tires
    assert [tire.position for tire in trends if tire.findings] == ["RL"]


def test_a_loss_that_becomes_slower_is_found_and_one_that_becomes_faster_has_one_error():
    months = np.concatenate([np.linspace(0.0, 2.8, 38), np.linspace(2.82, 3.6, 22)])
    found = []
    for before_kpa, bend_kpa in ((13.0, -4.5), (0.0, 8.0)):
        tire = history(2, COUNT, months=3.6)
        tire = replace(tire, time_ns=tire.time_ns[0] + (months * MONTH_NS).astype(np.int64))
        tire.columns["pressure_pa"] -= 1e3 * (before_kpa * months + bend_kpa * np.maximum(months - 2.8, 0.0))
        trend = trend_of(tire)
        (finding,) = (item for item in trend.findings if item.code in LOSSES)
        loss, name = number(trend, Quantity.PRESSURE_LOSS), LOSSES[finding.code]
        stated = finding[f"{name}_pa"], finding["std_pa" if name == "loss" else "after_std_pa"]
        assert stated == pytest.approx((1e3 * loss.value, 1e3 * loss.std))
        found.append((finding.code, round(finding["over_s"] / 86_400.0)))
    assert found[0] == (FleetCode.TREND_LOSES_PRESSURE, pytest.approx(110, abs=1))
    assert found[1][0] is FleetCode.TREND_LOSS_CHANGED


@pytest.mark.parametrize(("filled", "kpa"), [(3, 5.0), (6, 9.0)])
def test_a_tire_that_was_filled_up_in_its_first_recordings_has_no_new_loss(filled, kpa):
    tire = tire_with()
    tire.columns["pressure_pa"] += 1e3 * (kpa * (filled <= INDEX) - 1.2 * tire.months)
    assert trend_of(tire).findings == ()


def test_stuck_temperature_makes_no_drift_of_the_season():
    season = 1.0 - 0.02 * np.sin(np.linspace(0.0, 1.5, COUNT))
    tire = tire_with(Bs=season, Rs=season, Ts=season)
    tire.columns["temperature_degc"] = np.full(COUNT, 25.0)
    trend = trend_of(tire)
    assert not any(finding.code is FleetCode.TREND_STIFFNESS_DRIFTS for finding in trend.findings)
    assert number(trend, "Rs_rate").status is Status.PROVISIONAL


def test_readings_that_differ_by_rounding_are_stuck_and_leave_the_trend():
    tire = tire_with()
    tire.columns["pressure_pa"][22:34] = 212_000.0 + np.resize([0.0, 3e-11, -3e-11], 12)
    trend = trend_of(tire)
    assert {finding.code for finding in trend.findings} == {FleetCode.TREND_PRESSURE_STUCK}
    loss = number(trend, Quantity.PRESSURE_LOSS)
    assert abs(loss.value) < 3.5 * loss.std < 1.5


@pytest.mark.parametrize(
    "shape",
    [
        np.where(INDEX >= 30, 10.0, 1.0),
        np.where(INDEX >= 56, 10.0, 1.0),
        10.0 ** (INDEX / 59.0),
        10.0 ** ((INDEX / 59.0) ** 4),
        np.where((INDEX > 20) & (INDEX < 35), 10.0, 1.0),
        np.where((INDEX > 30) & (INDEX % 2 == 0), 10.0, 1.0),
    ],
)
def test_tenfold_noise_is_a_finding_whatever_its_shape(shape):
    findings = trend_of(tire_with(noise_mps2=shape)).findings
    assert findings
    assert all("noise" in text(finding) for finding in findings)


def test_step_of_the_gain_has_its_date_and_error():
    tire = tire_with(gain=np.where(INDEX >= 41, 0.98, 1.0))
    (finding,) = trend_of(tire).findings
    assert (finding.code, finding["name"]) == (CoreCode.TREND_LEVEL_CHANGED, "gain")
    assert finding["date"] == str(np.datetime64(int(tire.time_ns[41]), "ns").astype("datetime64[D]"))
    assert abs(finding["change"] + 2.0) < 4.0 * finding["std"] < 0.8


def test_less_noise_of_one_recording_is_no_outlier():
    quiet = np.ones(COUNT)
    quiet[17] = 0.4
    trends = analyse([tire_with(noise_mps2=quiet)], recordings=COUNT)
    assert not trends.outliers
    assert [entry.name for entry in analyse([tire_with(noise_mps2=1 / quiet)], recordings=COUNT).outliers]


@pytest.mark.parametrize("distance_km", [210.0, 600.0])
def test_fast_wear_over_a_short_distance_is_a_finding(distance_km):
    rng = np.random.default_rng(5)
    tire = history(6, 40, months=0.5)
    wear = np.linspace(0.0, 1.7, 40) + rng.normal(0.0, 0.06, 40)
    tire = replace(tire, km=9000.0 + np.linspace(0.0, distance_km, 40), columns={**tire.columns, "wear_mm": wear})
    (finding,) = analyse([tire], recordings=40).tires[0].findings
    assert finding.code is FleetCode.TREND_WEARS_SHORT
    assert abs(finding["wear_m"] - 1.7e-3) < 4.0 * finding["std_m"]
    assert finding["distance_m"] == pytest.approx(1e3 * distance_km, rel=0.01)


def test_contact_that_grows_in_a_cold_week_is_the_pressures():
    tire = tire_with()
    cold_k = 20.0 * np.maximum(INDEX - 47, 0) / 12.0
    tire.columns["temperature_degc"][:] -= cold_k  # type: ignore[index]
    tire.columns["pressure_pa"][:] -= 321e3 / 303.0 * cold_k  # type: ignore[index]
    tire.columns["contact_length_m"][:] *= (tire.columns["pressure_pa"] / 220e3) ** -0.6  # type: ignore[index]
    names = {dict(finding.values).get("name") for finding in trend_of(tire).findings}
    assert "contact_length_m" not in names


def test_refills_are_no_drift_of_what_follows_the_pressure():
    filled = 1.0 + 0.025 * sum((begin <= INDEX).astype(float) for begin in (8, 14, 20))
    tire = tire_with(Cw=filled**-0.8, Bs=1 / filled, Rs=1 / filled, Ts=1 / filled)
    tire.columns["pressure_pa"][:] += 220e3 * (filled - 1.0)  # type: ignore[index]
    assert trend_of(tire).findings == ()


def test_rubber_that_hardens_by_age_is_no_finding_and_faster_is():
    months = tire_with().months
    aged = {name: np.exp(0.015 * months) for name in ("Rs", "Ts")}
    assert trend_of(tire_with(**aged)).findings == ()
    softer = trend_of(tire_with(Rs=np.exp(-0.02 * months))).findings
    assert [(finding.code, finding["name"]) for finding in softer] == [(FleetCode.TREND_STIFFNESS_DRIFTS, "Rs")]


def test_what_bends_while_the_pressure_falls_all_the_time_follows_from_it():
    leak = Finding(Reason(FleetCode.TREND_LOSES_PRESSURE), PRESSURE, Change(None, -0.17, 0.01))
    contact = Finding(Reason(FleetCode.TREND_SLOPE_CHANGED), "contact_length_m", Change(16, 0.15, 0.02))
    (only,) = with_causes([leak, contact], {})
    assert only["consequences"] == ("contact_length_m",)


def test_equal_readings_of_a_coarse_sensor_are_not_stuck():
    tire = tire_with()
    degc = tire.columns["temperature_degc"]
    degc[20:24] = 30.0, 31.0, 33.0, 34.5  # type: ignore[index]
    for resolution_pa, count in ((2500.0, 0), (100.0, 1)):
        pressure_pa = resolution_pa * np.round(tire.columns["pressure_pa"] / resolution_pa)
        pressure_pa[20:24] = 230e3
        findings = plausible_readings(replace(tire, columns={**tire.columns, "pressure_pa": pressure_pa})).findings
        assert len(findings) == count


@pytest.mark.slow
def test_at_most_one_false_finding_on_fifty_healthy_fleets():
    assert sum(len(tire.findings) for seed in range(50) for tire in fleet(900 + seed).tires) <= 1
