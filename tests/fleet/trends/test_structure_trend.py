"""A local change that grows is seen in the waveform far from the contact; load, speed and wear are none."""

from dataclasses import replace

import numpy as np
import pytest

from gateway.core.text.wording import text
from gateway.fleet.reasons import FleetCode
from gateway.fleet.trends.fleet_analysis import analyse
from gateway.fleet.trends.structure_trend import FIRST_ORDER, LAST_ORDER, StructureChange, structure_changes
from gateway.fleet.trends.tire_history import TireHistory
from tests.testkit.tire_histories import history

COUNT = 60
ORDERS = np.arange(FIRST_ORDER, LAST_ORDER + 1)


def with_waves(
    seed: int, size: float, course: np.ndarray, *, place_rad: float = 2.0, count: int = COUNT
) -> TireHistory:
    """Return a tire whose waveform turns with the speed and the load, with a packet that follows a course."""
    rng = np.random.default_rng(seed)
    tire = history(seed, count, months=4.0)
    speed = rng.uniform(12.0, 24.0, count)
    fixed = 2e-3 * (rng.normal(size=len(ORDERS)) + 1j * rng.normal(size=len(ORDERS)))
    load = 1e-3 * (rng.normal(size=len(ORDERS)) + 1j * rng.normal(size=len(ORDERS)))
    contact = tire.column("contact_length_m")
    orders = fixed * np.exp(0.02j * speed[:, None] * rng.normal(size=len(ORDERS)))
    orders = orders + load * ((contact - contact.mean()) / contact.std())[:, None]
    packet = size / np.sqrt(len(ORDERS)) * np.exp(1j * ORDERS * place_rad)
    orders = orders + packet * course[:, None]
    orders = orders + 4e-4 * (rng.normal(size=orders.shape) + 1j * rng.normal(size=orders.shape))
    parts = np.stack([orders.real, orders.imag], axis=2).reshape(count, -1)
    return replace(tire, columns={**tire.columns, "average_orders": parts, "speed_mean_mps": speed})


def structure_change(tire: TireHistory) -> StructureChange | None:
    return structure_changes([tire])[0]


GROWING = np.linspace(0.0, 1.0, COUNT)
SUDDEN = (np.arange(COUNT) >= 36).astype(float)


@pytest.mark.parametrize(("course", "is_sudden"), [(GROWING, False), (SUDDEN, True)])
def test_change_is_seen_with_its_size_place_and_course(course, is_sudden):
    change = structure_change(with_waves(1, 0.02, course))
    assert change is not None
    assert change.is_sudden is is_sudden
    assert change.share == pytest.approx(0.02 / np.sqrt(2.0), rel=0.3)
    assert abs(change.begin - (36 if is_sudden else 0)) <= 6


def test_tires_that_do_not_change_have_no_finding():
    assert [seed for seed in range(20) if structure_change(with_waves(seed, 0.0, GROWING)) is not None] == []


def test_change_that_is_the_conditions_own_is_none():
    tire = with_waves(3, 0.0, GROWING)
    months = np.sort(tire.column("contact_length_m"))
    parts = tire.columns["average_orders"][np.argsort(tire.column("contact_length_m"))]
    changed = {**tire.columns, "contact_length_m": months, "average_orders": parts}
    assert structure_change(replace(tire, columns=changed)) is None


def test_growth_that_all_wheels_have_is_no_change_of_one():
    worn = [with_waves(seed, 0.02, GROWING) for seed in range(4)]
    local = with_waves(9, 0.02, GROWING, place_rad=-2.0).columns["average_orders"]
    fixed = with_waves(9, 0.0, GROWING).columns["average_orders"]
    parts = worn[3].columns["average_orders"] + local - fixed
    bad = replace(worn[3], columns={**worn[3].columns, "average_orders": parts})
    assert None not in [structure_change(tire) for tire in worn]
    assert structure_changes(worn) == [None] * 4
    *healthy, change = structure_changes([*worn[:3], bad])
    assert healthy == [None] * 3
    assert change is not None
    assert change.share == pytest.approx(0.02 / np.sqrt(2.0), rel=0.3)


def test_few_or_missing_waveforms_say_nothing():
    assert structure_change(history(1, COUNT)) is None
    few = with_waves(1, 0.05, GROWING[:15], count=15)
    assert structure_change(few) is None
    gone = with_waves(1, 0.05, GROWING)
    gone.columns["average_orders"][10:] = np.nan
    assert structure_change(gone) is None


def test_finding_names_neither_kind_nor_place():
    (trend,) = analyse([with_waves(1, 0.02, GROWING)], recordings=COUNT).tires
    (finding,) = [reason for reason in trend.findings if reason.code is FleetCode.TREND_STRUCTURE_CHANGED]
    said = text(finding)
    assert "grows since" in said
    assert "where, is not known" in said
    assert "deg" not in said
