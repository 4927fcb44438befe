"""Causes are found before their consequences, each once: leaks, refills and sensors whose steady value drifts."""

from dataclasses import replace

import numpy as np
import pytest

from gateway.core.reasons import Code, CoreCode, Reason
from gateway.core.text.wording import text
from gateway.fleet.reasons import FleetCode
from gateway.fleet.trends.causes import Change, Finding, with_causes
from gateway.fleet.trends.fleet_analysis import analyse
from gateway.fleet.trends.regression import fit
from gateway.fleet.trends.steady_value import parted_drift
from gateway.fleet.trends.tire_history import TireHistory
from tests.testkit.tire_histories import history

RADIUS_M = 0.32
UNPARTED = "needs two speeds: gain and zero-g offset are not separated yet"


def findings_of(tire: TireHistory) -> dict[Code, Reason]:
    (trend,) = analyse([tire], recordings=len(tire.recordings)).tires
    assert len({finding.code for finding in trend.findings}) == len(trend.findings)
    return {finding.code: finding for finding in trend.findings}


def with_steady_value(speed_mps: np.ndarray, gain: np.ndarray, zero_mps2: np.ndarray) -> TireHistory:
    """Return a tire whose recordings do not part gain and zero, as each has one speed."""
    tire = history()
    rng = np.random.default_rng(3)
    ratio = gain + zero_mps2 * RADIUS_M / speed_mps**2 + rng.normal(0.0, 5e-4, len(gain))
    columns = {
        "gain": ratio,
        "gain_std": np.full(len(gain), 0.015),
        "speed_mean_mps": speed_mps,
        "stated_radius_m": np.full(len(gain), RADIUS_M),
        "noise_mps2": tire.columns["noise_mps2"] / tire.columns["speed_mean_mps"] * speed_mps,
    }
    alarms = tuple((("steady value", "a gain of 1.19 would fit"),) if ratio[i] > 1.05 else () for i in range(len(gain)))
    return replace(tire, columns={**tire.columns, **columns}, doubts={"gain": (UNPARTED,) * len(gain)}, alarms=alarms)


@pytest.mark.parametrize(("gain", "zero_mps2"), [(0.19, 0.0), (0.0, 15.0), (0.05, -12.0)])
def test_recordings_at_several_speeds_part_gain_and_zero(gain, zero_mps2):
    share = np.linspace(0.0, 1.0, 100)
    speed = np.random.default_rng(5).uniform(8.0, 30.0, 100)
    findings = findings_of(with_steady_value(speed, 1.0 + gain * share, zero_mps2 * share))
    expected = ({CoreCode.TREND_SENSOR_GAIN} if gain else set()) | (
        {CoreCode.TREND_SENSOR_ZERO} if zero_mps2 else set()
    )
    assert set(findings) == expected
    if gain:
        assert findings[CoreCode.TREND_SENSOR_GAIN]["share"] == pytest.approx(gain, abs=0.005)
    if zero_mps2:
        assert findings[CoreCode.TREND_SENSOR_ZERO]["change_mps2"] == pytest.approx(zero_mps2, abs=2.0)


@pytest.mark.parametrize(("begin", "grows", "count"), [(46, True, 1), (46, False, 2), (36, True, 2)])
def test_what_follows_from_a_leak_may_show_later(begin, grows, count):
    leak = Finding(Reason(FleetCode.TREND_LOSES_PRESSURE), "pressure_at_20_degc", Change(40, -0.2, grows=grows))
    softer = Finding(Reason(CoreCode.TREND_LEVEL_CHANGED, name="Ts"), "Ts", Change(begin, -0.08, 0.01))
    assert len(with_causes([leak, softer], {})) == count


@pytest.mark.parametrize(("gain", "zero_mps2", "name"), [(-0.03, 0.0, "gain"), (0.0, 14.0, "zero_g_offset_mps2")])
def test_recordings_at_several_speeds_part_a_step_of_gain_and_zero_and_date_it(gain, zero_mps2, name):
    since = (np.arange(100) >= 62).astype(float)
    speed = np.random.default_rng(15).uniform(8.0, 30.0, 100)
    tire = with_steady_value(speed, 1.0 + gain * since, zero_mps2 * since)
    (finding,) = findings_of(tire).values()
    assert (finding.code, finding["name"]) == (CoreCode.TREND_LEVEL_CHANGED, name)
    assert finding["change"] == pytest.approx(100.0 * gain or zero_mps2, abs=4.0 * finding["std"])
    assert abs(finding["count"] - 38) <= 2
    assert finding["since_s"] == pytest.approx(1e-9 * tire.time_ns[62], abs=2.0 * finding["since_std_s"])


def test_what_explains_the_steady_value_alone_is_known_better_than_both():
    rng = np.random.default_rng(16)
    months, speed = np.linspace(0.0, 4.0, 60), rng.uniform(12.0, 30.0, 60)
    right = 0
    for seed in range(20):
        noise = np.random.default_rng([16, seed]).normal(0.0, 1e-3, 60)
        ratio = 1.0 + 8.0 * months / 4.0 * RADIUS_M / speed**2 + noise
        parted = parted_drift(months, ratio, np.full(60, RADIUS_M), speed)
        assert parted is not None
        assert abs(parted.gain) < 4.0 * parted.gain_std or parted.gain == 0.0
        right += parted.gain == 0.0 and abs(parted.zero_mps2 - 8.0) < 3.5 * parted.zero_std_mps2 < 3.0
    assert right >= 16


def test_at_one_speed_gain_or_zero_is_said():
    share = np.linspace(0.0, 1.0, 100)
    findings = findings_of(with_steady_value(np.full(100, 20.0), 1.0 + 0.19 * share, np.zeros(100)))
    assert set(findings) == {FleetCode.TREND_SENSOR_STEADY}
    steady = findings[FleetCode.TREND_SENSOR_STEADY]
    assert steady["share"] == pytest.approx(0.19, abs=0.005)
    zero_mps2 = 0.19 * 20.0**2 / RADIUS_M
    assert abs(steady["change_mps2"] - zero_mps2) < 4.0 * steady["zero_std_mps2"] < 0.1 * zero_mps2


def test_step_at_one_speed_has_its_date():
    tire = with_steady_value(np.full(100, 20.0), 1.0 - 0.03 * (np.arange(100) >= 62), np.zeros(100))
    steady = findings_of(tire)[FleetCode.TREND_SENSOR_STEADY]
    assert steady["since_s"] == pytest.approx(1e-9 * tire.time_ns[62], abs=2.0 * steady["since_std_s"])


def test_a_steady_sensor_has_no_finding():
    speed = np.random.default_rng(6).uniform(8.0, 30.0, 100)
    assert findings_of(with_steady_value(speed, np.ones(100), np.full(100, 4.0))) == {}


def test_no_drifts_are_parted_at_one_speed():
    months = np.linspace(0.0, 8.0, 40)
    assert parted_drift(months, 1.0 + 0.01 * months, np.full(40, RADIUS_M), np.full(40, 20.0)) is None


def test_a_fast_leak_is_one_finding_with_what_follows_from_it():
    # 5 kPa a day in the last eight recordings, a day apart: the contact grows by the square root of the pressure.
    tire = history()
    days = np.maximum(np.arange(100) - 92, 0.0)
    time_ns = tire.time_ns.copy()
    time_ns[92:] = time_ns[92] + np.arange(8) * 86_400 * 10**9
    columns = dict(tire.columns)
    columns["pressure_pa"] = columns["pressure_pa"] - 5000.0 * days
    longer = (tire.columns["pressure_pa"] / columns["pressure_pa"]) ** 0.5
    columns["contact_length_m"] = columns["contact_length_m"] * longer
    columns["Rs"] = columns["Rs"] * longer**1.5
    findings = findings_of(replace(tire, columns=columns, time_ns=time_ns))
    assert set(findings) == {FleetCode.TREND_LOSS_CHANGED}
    leak = findings[FleetCode.TREND_LOSS_CHANGED]
    assert leak["after_pa"] == pytest.approx(5000.0 * 365.25 / 12.0, rel=0.1)
    assert "contact_length_m" in leak["consequences"]
    assert "this also changes" in text(leak)
    assert "contact length" in text(leak)


def test_consequences_of_a_refill_are_no_finding():
    changed = Reason(CoreCode.TREND_LEVEL_CHANGED)
    onsets = {"pressure_at_20_degc": [Change(40)]}
    findings = [
        Finding(changed, name, Change(position)) for name, position in (("Rs", 41), ("Rs", 60), ("wear_mm", 40))
    ]
    # Tread depth does not follow the pressure, and what begins later is another change.
    assert with_causes(findings, onsets) == [changed, changed]


def test_a_finding_is_named_with_the_cause_that_it_follows():
    # A leak lengthens the contact; later another load does, and changes a number.
    longer = [Reason(CoreCode.TREND_CONTACT_CHANGED, date=date) for date in ("May", "July")]
    leaks, narrower = Reason(CoreCode.TREND_LEVEL_CHANGED), Reason(CoreCode.TREND_LEVEL_CHANGED)
    findings = [
        Finding(leaks, "pressure_at_20_degc", Change(30, -0.1, 0.01)),
        Finding(longer[0], "contact_length_m", Change(30, 0.05, 0.01)),
        Finding(longer[1], "contact_length_m", Change(60, 0.1, 0.01)),
        Finding(narrower, "Cw", Change(60, -0.1, 0.01)),
    ]
    leak, load = with_causes(findings, {})
    assert leak["consequences"] == ("contact_length_m",)
    assert (load["date"], load["consequences"]) == ("July", ("Cw",))


@pytest.mark.parametrize("share", [0.04, 0.5])
def test_a_refill_explains_what_follows_from_its_size(share):
    # From 200 to 214 kPa; a belt that gets stiffer by half with it has another cause.
    tire = history()
    after = np.arange(100) >= 60
    columns = {
        **tire.columns,
        "pressure_pa": tire.columns["pressure_pa"] + 14e3 * after,
        "contact_length_m": tire.columns["contact_length_m"] * np.where(after, 1.0 - share, 1.0),
    }
    findings = findings_of(replace(tire, columns=columns))
    names = {finding["name"] for finding in findings.values()}
    assert names == (set() if share < 0.1 else {"contact_length_m"})


@pytest.mark.parametrize("is_calibrated", [False, True])
def test_another_load_is_one_finding(is_calibrated):
    # The simulator's tire at 4600 N in place of the 4000 N that are stated, at the same pressure: estimated means.
    ratios = {
        "contact_length_m": 0.14525 / 0.13154,
        "contact_fraction": 0.07224 / 0.06542,
        "Bs": 0.00268 / 0.00308,
        "Cw": 0.16972 / 0.19524,
        "Rs": 2.58382 / 2.97031,
        "Ts": 2.16722 / 2.49783,
    }
    tire = history()
    after = np.arange(100) >= 60
    tire.columns["contact_fraction"] = tire.columns["contact_length_m"] / (2.0 * np.pi * RADIUS_M)
    columns = {**tire.columns}
    for name, ratio in ratios.items():
        columns[name] = columns[name] * np.where(after, ratio, 1.0)
    if is_calibrated:
        columns["estimated_load_n"] = columns["estimated_load_n"] * np.where(after, 1.15, 1.0)
    else:
        columns["estimated_load_n"] = np.full(100, np.nan)
    findings = findings_of(replace(tire, columns=columns))
    code = CoreCode.TREND_LEVEL_CHANGED if is_calibrated else CoreCode.TREND_CONTACT_CHANGED
    assert set(findings) == {code}
    others = {"Bs", "Cw", "Rs", "Ts", "contact_fraction"}
    assert set(findings[code]["consequences"]) == others | ({"contact_length_m"} if is_calibrated else set())
    if not is_calibrated:
        assert findings[code]["change"] == pytest.approx(12.5, abs=1.0)
        assert "by the load or the stiffness" in text(findings[code])


def test_a_stiffness_that_changes_more_than_the_contact_is_a_finding_of_its_own():
    tire = history()
    after = np.arange(100) >= 60
    columns = {
        **tire.columns,
        "contact_length_m": tire.columns["contact_length_m"] * np.where(after, 1.06, 1.0),
        "Cw": tire.columns["Cw"] * np.where(after, 0.6, 1.0),
    }
    columns["estimated_load_n"] = np.full(100, np.nan)
    findings = findings_of(replace(tire, columns=columns))
    assert {finding["name"] for finding in findings.values()} == {"contact_length_m", "Cw"}


@pytest.mark.parametrize(("gain", "name"), [(0.004, "Cw"), (0.03, "gain")])
def test_a_change_too_small_for_a_finding_hides_none(gain, name):
    tire = history()
    after = np.arange(100) >= 60
    columns = {
        **tire.columns,
        "gain": tire.columns["gain"] + gain * after,
        "Cw": tire.columns["Cw"] * np.where(after, 1.2, 1.0),
    }
    changed = findings_of(replace(tire, columns=columns))[CoreCode.TREND_LEVEL_CHANGED]
    assert changed["name"] == name
    assert ("Cw" in dict(changed.values).get("consequences", ())) == (name == "gain")


def test_a_doubted_change_hides_none():
    # Of a load that is in doubt nothing is said; the belt's stiffness is not.
    tire = history()
    after = np.arange(100) >= 60
    columns = {
        **tire.columns,
        "estimated_load_n": tire.columns["estimated_load_n"] + 600.0 * after,
        "Cw": tire.columns["Cw"] * np.where(after, 1.2, 1.0),
    }
    doubts = {"estimated_load_n": ("the load is outside the calibration",) * 100}
    findings = findings_of(replace(tire, columns=columns, doubts=doubts))
    assert set(findings) == {CoreCode.TREND_LEVEL_CHANGED}
    assert findings[CoreCode.TREND_LEVEL_CHANGED]["name"] == "Cw"


def test_numbers_of_the_sensor_are_no_consequences_of_the_pressure():
    noise = Reason(FleetCode.TREND_SENSOR_NOISE, factor=6.0)
    leak = Reason(FleetCode.TREND_LOSES_PRESSURE, loss_pa=3e3, std_pa=100.0)
    findings = [Finding(leak, "pressure_at_20_degc"), Finding(noise, "noise_mps2")]
    assert with_causes(findings, {}) == [leak, noise]


def test_noise_that_grows_evenly_to_six_times_is_found():
    # Its logarithm is bent, which leaves residuals that follow each other beside a line.
    tire = history(count=60)
    growth = 1.0 + 5.0 * tire.months / tire.months[-1]
    columns = {**tire.columns, "noise_mps2": tire.columns["noise_mps2"] * growth}
    findings = findings_of(replace(tire, columns=columns))
    assert set(findings) == {FleetCode.TREND_SENSOR_NOISE}
    assert findings[FleetCode.TREND_SENSOR_NOISE]["factor"] == pytest.approx(6.0, rel=0.35)


def test_a_bend_is_no_autocorrelation():
    time = np.linspace(0.0, 1.0, 60)
    values = np.log(1.0 + 5.0 * time) + np.random.default_rng(7).normal(0.0, 0.05, 60)
    line = fit(np.column_stack([np.ones(60), time - 0.5]), values, np.ones(60), np.ones(60, dtype=bool))
    assert line is not None
    assert 0.0 < line.std(1) < 0.25 * line.coefficients[1]
