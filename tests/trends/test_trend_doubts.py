"""Trends follow what recordings say of themselves: status, alarms, changed statements, readings that cannot be."""

from dataclasses import replace

import numpy as np
import pytest

from gateway.estimators.estimator import Status
from gateway.quantity import Statement
from gateway.reasons import Code
from gateway.trends.fleet_analysis import analyse
from gateway.trends.tire_history import TireHistory
from gateway.trends.trend_result import Quantity, TireTrend, TrendNumber
from tests.testkit.tire_histories import history

COUNT = 40
HALF = np.arange(COUNT) >= COUNT // 2


def trends_of(tire: TireHistory) -> tuple[TireTrend, ...]:
    return analyse([tire], recordings=COUNT).tires


def number(tire: TireTrend, quantity: str) -> TrendNumber:
    return next(one for one in tire.numbers if one.quantity == quantity)


def codes(tire: TireTrend) -> list[Code]:
    return [finding.code for finding in tire.findings]


def tire(**columns: np.ndarray) -> TireHistory:
    """Return 40 recordings of a tire with some other columns."""
    found = history(3, COUNT)
    return replace(found, columns={**found.columns, **columns})


def stated(found: TireHistory, statement: Statement, before: str, after: str) -> TireHistory:
    texts = tuple(after if late else before for late in HALF)
    return replace(found, stated={statement: texts})


@pytest.mark.parametrize(("doubtful", "status"), [(4, Status.VALID), (20, Status.PROVISIONAL)])
def test_provisional_values_make_a_provisional_trend(doubtful, status):
    doubts = ("contradicted",) * doubtful + ("",) * (COUNT - doubtful)
    (found,) = trends_of(replace(tire(), doubts={"wear_mm": doubts, "estimated_load_n": doubts}))
    for quantity in (Quantity.WEAR_RATE, Quantity.WEAR_NOW, Quantity.LOAD, Quantity.LOAD_SCATTER):
        one = number(found, quantity)
        assert one.status is status
        marks = [reason for reason in one.reasons if reason.code is Code.TREND_PROVISIONAL]
        assert len(marks) == (status is Status.PROVISIONAL)
        assert all(mark["why"] == "contradicted" for mark in marks)
    assert number(found, "Bs_rate").status is Status.VALID


def test_a_drift_of_provisional_values_is_no_finding():
    drifting = history(3, COUNT, stiffening=0.03)
    assert Code.TREND_STIFFNESS_DRIFTS in codes(trends_of(drifting)[0])
    (found,) = trends_of(replace(drifting, doubts={"Cw": ("clipped",) * COUNT}))
    assert number(found, "Cw_rate").status is Status.PROVISIONAL
    assert codes(found) == []


def test_alarms_rejected_revolutions_and_damage_are_findings():
    alarms = tuple((("steady value", "contradicted"),) if late else () for late in HALF)
    valid, damaged = np.where(HALF, 10.0, 90.0), np.zeros(COUNT)
    damaged[3] = 1.0
    found = tire(revolutions=np.full(COUNT, 100.0), revolutions_valid=valid, damaged=damaged)
    (one,) = trends_of(replace(found, alarms=alarms, faults=("the samples are lost",) * COUNT))
    assert codes(one) == [Code.TREND_ALARMS, Code.TREND_FEW_VALID, Code.TREND_DAMAGED]
    assert [(finding["count"], finding["of"]) for finding in one.findings] == [(20, 40), (20, 40), (1, 40)]
    assert (one.findings[0]["name"], one.findings[1]["why"]) == ("steady value", "the samples are lost")


@pytest.mark.parametrize(
    ("statement", "before", "after", "code"),
    [
        (Statement.LOAD, "4000", "5000", Code.TREND_STATED_LOAD),
        (Statement.RADIUS, "0.32", "0.3", Code.TREND_STATED_RADIUS),
        (Statement.REFERENCE, '{"Bs": 1}', '{"Bs": 2}', Code.TREND_STATED_REFERENCE),
        (Statement.THICKNESS, "0.015", "0.012", Code.TREND_STATED_THICKNESS),
    ],
)
def test_a_changed_statement_is_no_new_tire_and_no_wear(statement, before, after, code):
    found = tire()
    fallen = replace(found, columns={**found.columns, "wear_mm": found.columns["wear_mm"] - 2.0 * HALF})
    assert len(trends_of(fallen)) == 2  # without a statement that explains it
    (one,) = trends_of(stated(fallen, statement, before, after))
    rate = number(one, Quantity.WEAR_RATE)
    assert rate.value == pytest.approx(0.05, abs=4.0 * rate.std)
    assert rate.std < 0.05
    assert Code.TREND_STATED_LEVELS in [reason.code for reason in rate.reasons]
    assert codes(one) == [code]


def test_a_new_tire_beside_a_changed_statement_is_found():
    found = tire()
    wear = found.columns["wear_mm"] + 3.0 * HALF - 2.0 * (np.arange(COUNT) >= 30)
    changed = stated(replace(found, columns={**found.columns, "wear_mm": wear}), Statement.LOAD, "4000", "5000")
    assert [one.recordings for one in trends_of(changed)] == [30, 10]


def test_a_load_stated_for_each_recording_is_no_change():
    loads = tuple(f"{load:.6g}" for load in np.random.default_rng(1).normal(4000.0, 50.0, COUNT))
    (one,) = trends_of(replace(tire(), stated={Statement.LOAD: loads}))
    assert codes(one) == []
    assert number(one, Quantity.WEAR_RATE).status is Status.VALID


def test_bending_that_falls_by_the_measured_wear_is_no_drift():
    found = history(3, COUNT, wear_mm_per_1000km=0.16, softening=0.0, scatter=0.3)
    left = 1.0 - found.columns["wear_mm"] / 15.0
    worn = replace(found, columns={**found.columns, "Bs": found.columns["Bs"] * left**3})
    assert codes(trends_of(worn)[0]) == [Code.TREND_STIFFNESS_DRIFTS]  # its thickness is not known
    known = replace(worn, columns={**worn.columns, "ring_thickness_m": np.full(COUNT, 0.015)})
    (one,) = trends_of(known)
    assert codes(one) == []
    rate = number(one, "Bs_rate")
    (note,) = [reason for reason in rate.reasons if reason.code is Code.TREND_WEAR_SOFTENS]
    assert 100.0 * note["share"] == pytest.approx(rate.value, abs=0.3)
    hardened = replace(known, columns={**known.columns, "Bs": known.columns["Bs"] * np.exp(0.04 * known.months)})
    assert codes(trends_of(hardened)[0]) == [Code.TREND_STIFFNESS_DRIFTS]


def test_a_pressure_that_sticks_midway_is_left_out():
    found = history(3, COUNT, leak_pa=4000.0)
    stuck = np.where(HALF, 230e3, found.columns["pressure_pa"])
    (one,) = trends_of(replace(found, columns={**found.columns, "pressure_pa": stuck}))
    assert Code.TREND_PRESSURE_STUCK in codes(one)
    loss = number(one, Quantity.PRESSURE_LOSS)
    assert (loss.count, loss.value) == (20, pytest.approx(4.0, abs=4.0 * loss.std))


def test_a_temperature_that_no_tire_has_is_left_out():
    hot = np.where(HALF, 200.0, history(3, COUNT).columns["temperature_degc"])
    (one,) = trends_of(tire(temperature_degc=hot))
    assert codes(one) == [Code.TREND_TEMPERATURE_IMPOSSIBLE]
    assert one.findings[0]["count"] == 20
    assert number(one, Quantity.PRESSURE_LOSS).count == 20
    assert number(one, Quantity.WEAR_RATE).count == 20


def test_a_wheel_that_stands_is_said_to_stand():
    nothing = {name: np.full(COUNT, np.nan) for name in tire().columns}
    standing = {**nothing, "revolutions": np.zeros(COUNT), "pressure_measured": np.ones(COUNT)}
    (one,) = trends_of(replace(tire(), columns=standing))
    assert {reason.code for each in one.numbers for reason in each.reasons} == {Code.TREND_NO_REVOLUTION}
