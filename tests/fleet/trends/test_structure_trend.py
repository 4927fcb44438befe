"""A local change that grows is seen in the waveform far from the contact; load, speed and wear are none."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from gateway.core.text.wording import text
from gateway.fleet.reasons import FleetCode
from gateway.fleet.trends.fleet_analysis import analyse
from gateway.fleet.trends.structure_trend import FIRST_ORDER, LAST_ORDER, StructureChange, structure_changes
from gateway.fleet.trends.tire_history import TireHistory
from gateway.ring.rolling_ring import Change, loaded_belt, local_response
from gateway.ring.rolling_ring.equilibrium import solve_rolling_ring
from tests.testkit.exact_ring import BASE_RING
from tests.testkit.tire_histories import history

COUNT = 60
ORDERS = np.arange(FIRST_ORDER, LAST_ORDER + 1)


def with_waves(
    seed: int, size: float, course: np.ndarray, *, place_rad: float = 2.0, count: int = COUNT, shape=None
) -> TireHistory:
    """Return a tire whose waveform turns with speed and load, with a packet, or a shape, that follows a course."""
    rng = np.random.default_rng(seed)
    tire = history(seed, count, months=4.0)
    speed = rng.uniform(12.0, 24.0, count)
    fixed = 2e-3 * (rng.normal(size=len(ORDERS)) + 1j * rng.normal(size=len(ORDERS)))
    load = 1e-3 * (rng.normal(size=len(ORDERS)) + 1j * rng.normal(size=len(ORDERS)))
    contact = tire.column("contact_length_m")
    orders = fixed * np.exp(0.02j * speed[:, None] * rng.normal(size=len(ORDERS)))
    orders = orders + load * ((contact - contact.mean()) / contact.std())[:, None]
    shape = np.exp(1j * ORDERS * place_rad) if shape is None else shape
    packet = size * shape / np.linalg.norm(shape)
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
    assert change.ahead_rad is not None
    low, high = change.ahead_rad
    assert low < 2.0 * np.pi - 2.0 < high


@cache
def ring_shapes(loss_s: float) -> np.ndarray:
    """Return (2, kinds, patterns, orders) what the ring answers to what varies around it, at orders n and -n."""
    solution = solve_rolling_ring(BASE_RING, 4500.0, 2.2e5, 60.0, nodes=480)
    kinds = (Change.BENDING, Change.TREAD_STIFFNESS, Change.MASS)
    curves = local_response(loaded_belt(solution), 60.0, loss_s, 0.003, kinds, PATTERNS)[0][:, :, 0]
    theta = 2.0 * np.pi * np.arange(480) / 480 - np.pi
    turning = curves * np.exp(-1j * PATTERNS[:, None] * theta)
    return np.stack([turning @ np.exp(1j * np.outer(theta, sign * ORDERS)) for sign in (1, -1)])


PATTERNS = np.arange(60)


@pytest.mark.parametrize("loss_s", [3e-6, 7.5e-5])
@pytest.mark.parametrize("kind", range(3))
def test_place_of_what_changes_on_the_ring_is_within_its_bounds(loss_s, kind):
    known = []
    for ahead_rad in np.arange(0.2, 6.2, 0.4):
        local = np.exp(-((0.06 * PATTERNS) ** 2) / 2.0 - 1j * PATTERNS * ahead_rad)
        positive, negative = ring_shapes(loss_s)[:, kind]
        change = structure_change(with_waves(1, 0.02, GROWING, shape=local @ positive + np.conj(local @ negative)))
        assert change is not None
        if change.ahead_rad is not None:
            known.append(round(ahead_rad, 1))
            low, high = change.ahead_rad
            assert low < ahead_rad < high
    assert {1.0, 1.4, 1.8} <= set(known)


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


@pytest.mark.parametrize("is_spread", [False, True])
def test_finding_names_no_kind_and_a_place_where_it_is_shown(is_spread):
    shape = sum(np.exp(1j * ORDERS * place_rad) for place_rad in ((-1.0, -2.0, 2.5) if is_spread else (-2.0,)))
    (trend,) = analyse([with_waves(1, 0.02, GROWING, shape=shape)], recordings=COUNT).tires
    (finding,) = [reason for reason in trend.findings if reason.code is FleetCode.TREND_STRUCTURE_CHANGED]
    said = text(finding)
    assert "grows since" in said
    assert ("where, is not known" in said) is is_spread
    assert ("inspect the tire 108 deg to 169 deg ahead of the sensor" in said) is not is_spread
