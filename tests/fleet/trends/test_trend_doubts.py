"""Trends follow what recordings say of themselves: status, alarms, changed statements, moved sensors."""

from dataclasses import replace

import numpy as np
import pytest

from gateway.core.estimates.estimator import Status
from gateway.core.quantity import Statement
from gateway.core.reasons import Code, Reason
from gateway.core.text.wording import text
from gateway.fleet.reasons import FleetCode
from gateway.fleet.trends.fleet_analysis import analyse
from gateway.fleet.trends.moved_tires import findings_of_moves
from gateway.fleet.trends.tire_history import MONTH_NS, TireHistory
from gateway.fleet.trends.trend_result import Quantity, TireTrend
from tests.testkit.tire_histories import BEGIN_NS, history, number

COUNT = 40
HALF = np.arange(COUNT) >= COUNT // 2


def trends_of(tire: TireHistory) -> tuple[TireTrend, ...]:
    return analyse([tire], recordings=COUNT).tires


def codes(tire: TireTrend) -> list[Code]:
    return [finding.code for finding in tire.findings]


def tire(**columns: np.ndarray) -> TireHistory:
    """Return 40 recordings of a tire with some other columns."""
    result = history(3, COUNT)
    return replace(result, columns={**result.columns, **columns})


def stated(result: TireHistory, statement: Statement, before: str, after: str) -> TireHistory:
    texts = tuple(after if late else before for late in HALF)
    return replace(result, stated={statement: texts})


@pytest.mark.parametrize(("doubtful", "status"), [(4, Status.VALID), (20, Status.PROVISIONAL)])
def test_provisional_values_make_a_provisional_trend(doubtful, status):
    doubts = ("contradicted",) * doubtful + ("",) * (COUNT - doubtful)
    (trends,) = trends_of(replace(tire(), doubts={"wear_mm": doubts, "estimated_load_n": doubts}))
    for quantity in (Quantity.WEAR_RATE, Quantity.WEAR_NOW, Quantity.LOAD, Quantity.LOAD_SCATTER):
        single = number(trends, quantity)
        assert single.status is status
        marks = [reason for reason in single.reasons if reason.code is FleetCode.TREND_PROVISIONAL]
        assert len(marks) == (status is Status.PROVISIONAL)
        assert all(mark["why"] == "contradicted" for mark in marks)
    assert number(trends, "Bs_rate").status is Status.VALID


def test_a_drift_of_provisional_values_is_no_finding():
    drifting = history(3, COUNT, stiffening=0.03)
    assert FleetCode.TREND_STIFFNESS_DRIFTS in codes(trends_of(drifting)[0])
    (trends,) = trends_of(replace(drifting, doubts={"Cw": ("clipped",) * COUNT}))
    assert number(trends, "Cw_rate").status is Status.PROVISIONAL
    assert codes(trends) == []


def test_alarms_rejected_revolutions_and_damage_are_findings():
    alarms = tuple((("steady value", "contradicted"),) if late else () for late in HALF)
    valid, damaged = np.where(HALF, 10.0, 90.0), np.zeros(COUNT)
    damaged[3] = 1.0
    result = tire(revolutions=np.full(COUNT, 100.0), revolutions_valid=valid, damaged=damaged)
    (single,) = trends_of(replace(result, alarms=alarms, faults=("the samples are lost",) * COUNT))
    assert codes(single) == [FleetCode.TREND_ALARMS, FleetCode.TREND_FEW_VALID, FleetCode.TREND_DAMAGED]
    assert [(finding["count"], finding["of"]) for finding in single.findings] == [(20, 40), (20, 40), (1, 40)]
    assert (single.findings[0]["name"], single.findings[1]["why"]) == ("steady value", "the samples are lost")


@pytest.mark.parametrize(
    ("statement", "before", "after"),
    [
        (Statement.LOAD, "4000", "5000"),
        (Statement.RADIUS, "0.32", "0.3"),
        (Statement.REFERENCE, '{"Bs": 1}', '{"Bs": 2}'),
        (Statement.THICKNESS, "0.015", "0.012"),
    ],
)
def test_a_changed_statement_is_no_new_tire_and_no_wear(statement, before, after):
    result = tire()
    fallen = replace(result, columns={**result.columns, "wear_mm": result.columns["wear_mm"] - 2.0 * HALF})
    assert len(trends_of(fallen)) == 2  # without a statement that explains it
    (single,) = trends_of(stated(fallen, statement, before, after))
    rate = number(single, Quantity.WEAR_RATE)
    assert rate.value == pytest.approx(0.05, abs=4.0 * rate.std)
    assert rate.std < 0.05
    assert FleetCode.TREND_STATED_LEVELS in [reason.code for reason in rate.reasons]
    assert codes(single) == [FleetCode.TREND_STATED_CHANGED]


def test_a_new_tire_beside_a_changed_statement_is_found():
    result = tire()
    wear = result.columns["wear_mm"] + 3.0 * HALF - 2.0 * (np.arange(COUNT) >= 30)
    changed = stated(replace(result, columns={**result.columns, "wear_mm": wear}), Statement.LOAD, "4000", "5000")
    assert [item.recordings for item in trends_of(changed)] == [30, 10]


def test_a_load_stated_for_each_recording_is_no_change():
    loads = tuple(f"{load:.6g}" for load in np.random.default_rng(1).normal(4000.0, 50.0, COUNT))
    (single,) = trends_of(replace(tire(), stated={Statement.LOAD: loads}))
    assert codes(single) == []
    assert number(single, Quantity.WEAR_RATE).status is Status.VALID


def test_bending_that_falls_by_the_measured_wear_is_no_drift():
    result = history(3, COUNT, wear_mm_per_1000km=0.16, softening=0.0, scatter=0.3)
    remainder = 1.0 - result.columns["wear_mm"] / 15.0
    worn = replace(result, columns={**result.columns, "Bs": result.columns["Bs"] * remainder**3})
    assert codes(trends_of(worn)[0]) == [FleetCode.TREND_STIFFNESS_DRIFTS]  # its thickness is not known
    reference = replace(worn, columns={**worn.columns, "ring_thickness_m": np.full(COUNT, 0.015)})
    (single,) = trends_of(reference)
    assert codes(single) == []
    rate = number(single, "Bs_rate")
    (note,) = [reason for reason in rate.reasons if reason.code is FleetCode.TREND_WEAR_SOFTENS]
    assert 100.0 * note["share"] == pytest.approx(rate.value, abs=0.3)
    hardened = replace(
        reference, columns={**reference.columns, "Bs": reference.columns["Bs"] * np.exp(0.04 * reference.months)}
    )
    assert codes(trends_of(hardened)[0]) == [FleetCode.TREND_STIFFNESS_DRIFTS]


def test_a_pressure_that_sticks_midway_is_left_out():
    result = history(3, COUNT, leak_pa=4000.0)
    stuck = np.where(HALF, 230e3, result.columns["pressure_pa"])
    (single,) = trends_of(replace(result, columns={**result.columns, "pressure_pa": stuck}))
    assert FleetCode.TREND_PRESSURE_STUCK in codes(single)
    loss = number(single, Quantity.PRESSURE_LOSS)
    assert (loss.count, loss.value) == (20, pytest.approx(4.0, abs=4.0 * loss.std))


def test_a_temperature_that_no_tire_has_is_left_out():
    hot = np.where(HALF, 200.0, history(3, COUNT).columns["temperature_degc"])
    (single,) = trends_of(tire(temperature_degc=hot))
    assert codes(single) == [FleetCode.TREND_TEMPERATURE_IMPOSSIBLE]
    assert single.findings[0]["count"] == 20
    assert number(single, Quantity.PRESSURE_LOSS).count == 20
    assert number(single, Quantity.WEAR_RATE).count == 20


def test_a_wheel_that_stands_is_said_to_stand():
    nothing = {name: np.full(COUNT, np.nan) for name in tire().columns}
    standing = {**nothing, "revolutions": np.zeros(COUNT), "pressure_measured": np.ones(COUNT)}
    (single,) = trends_of(replace(tire(), columns=standing))
    assert {reason.code for each in single.numbers for reason in each.reasons} == {FleetCode.TREND_NO_REVOLUTION}


def tire_at(position: str, sensor_id: str, begin_months: float, *, vehicle: str = "car", seed: int = 1) -> TireHistory:
    """Return three months of a tire at a wheel."""
    made = history(seed, 40, months=3.0, position=position, sensor_id=sensor_id, vehicle=vehicle)
    return replace(made, time_ns=made.time_ns + np.int64(round(begin_months * MONTH_NS)))


def test_two_sensors_that_change_wheels_are_one_finding() -> None:
    before = [tire_at("FL", "a1", 0.0), tire_at("FR", "a2", 0.0, seed=2)]
    after = [tire_at("FR", "a1", 3.1, seed=3), tire_at("FL", "a2", 3.2, seed=4), tire_at("RL", "a3", 0.0, seed=5)]
    trends = analyse([*before, *after], recordings=200)
    moved = [(tire.position, tire.sensor_id, tire.findings[0]) for tire in trends.tires if tire.findings]
    date = str(np.datetime64(BEGIN_NS + round(3.1 * MONTH_NS), "ns").astype("datetime64[D]"))
    (moved_tire,) = moved
    position, sensor, exchanged = moved_tire
    named = Reason(FleetCode.TREND_TIRES_EXCHANGED, origin="FL", target="FR", date=date, sensor="a1", other="a2")
    assert (position, sensor, exchanged.code) == ("FR", "a1", named.code)
    assert dict(exchanged.values).items() >= dict(named.values).items()
    # It changed wheels between the last recording at one and the first at the other.
    since_s, std_s = float(exchanged["since_s"]), float(exchanged["since_std_s"])
    assert abs(since_s - 1e-9 * (BEGIN_NS + 3.05 * MONTH_NS)) < 2.0 * std_s
    assert "a1" in text(exchanged)
    assert "a2" in text(exchanged)


def test_a_sensor_that_moves_alone_is_named() -> None:
    (moved,) = findings_of_moves([tire_at("FL", "a1", 0.0), tire_at("RL", "a1", 4.0), tire_at("RL", "a2", 0.0)]).items()
    assert moved[0] == ("car", "RL", "a1")
    assert [(reason.code, reason["origin"]) for reason in moved[1]] == [(FleetCode.TREND_TIRE_MOVED, "FL")]
    assert "RL" in text(moved[1][0])


def test_moves_at_other_times_or_vehicles_are_no_exchange() -> None:
    later = [tire_at("FL", "a1", 0.0), tire_at("FR", "a1", 3.1), tire_at("FR", "a2", 0.0), tire_at("FL", "a2", 9.0)]
    later[2] = replace(later[2], time_ns=later[2].time_ns + np.int64(round(5.0 * MONTH_NS)))
    other = [
        tire_at("FL", "a1", 0.0),
        tire_at("FR", "a1", 3.1),
        tire_at("FR", "a2", 0.0, vehicle="van"),
        tire_at("FL", "a2", 3.1, vehicle="van"),
    ]
    for histories in (later, other):
        codes = [reason.code for findings in findings_of_moves(histories).values() for reason in findings]
        assert codes == [FleetCode.TREND_TIRE_MOVED] * 2


def test_an_unknown_sensor_and_one_that_stays_have_no_finding() -> None:
    assert findings_of_moves([tire_at("FL", "a1", 0.0), tire_at("FR", "a2", 3.1)]) == {}
    assert findings_of_moves([tire_at("FL", "", 0.0), tire_at("FR", "", 3.1)]) == {}
