"""Discrepancy: kernels, covariance of the data, and amplitudes by restricted likelihood."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from gateway.closure.data.campaign_data import ORDERS, Campaign
from gateway.closure.effects.effect import RADIAL, GroupConditions
from gateway.closure.inference import criteria
from gateway.closure.inference.discrepancy import Applied, Discrepancy
from gateway.closure.inference.fit import Fit
from gateway.closure.inference.likelihood import ANGLES, FROM_FIELD, Whitened, as_complex
from gateway.types import FloatArray
from tests.closure.dense_covariance import covariance_of, joined, whitened
from tests.closure.planted_campaign import (
    ONE_SPEED,
    THREE_SPEEDS,
    TWO_SPEEDS,
    campaign_of,
    evaluated,
    fitted,
    started,
    with_blocks,
)


@cache
def two_speeds() -> tuple[Fit, Whitened, Discrepancy]:
    """Return the ring fitted at two speeds, which have a part in proportion to omega^2 and a constant one."""
    campaign = campaign_of(TWO_SPEEDS)
    fit, data = fitted(campaign)
    return fit, data, Discrepancy(campaign, data)


def some_amplitudes(discrepancy: Discrepancy) -> FloatArray:
    return np.random.default_rng(2).uniform(0.1, 4.0, discrepancy.shape)


def draw(power: float, length_rad: float, seed: int) -> FloatArray:
    """Return a random curve at ANGLES, smooth over a length, of this mean square."""
    away = 1.0 - np.cos(ANGLES[:, None] - ANGLES[None, :])
    values, vectors = np.linalg.eigh(power * np.exp(-away / length_rad**2))
    curve: FloatArray = vectors @ (
        np.sqrt(np.maximum(values, 0.0)) * np.random.default_rng(seed).normal(size=len(ANGLES))
    )
    return curve


def test_kernels_are_positive_semidefinite() -> None:
    _, _, discrepancy = two_speeds()
    for _, (_, _, index) in discrepancy.enumerate():
        assert len(index.kernels) == 2 * len(criteria.LENGTHS_RAD)
        for kernel in index.kernels:
            values = np.linalg.eigvalsh(kernel)
            assert values[0] > -1e-9 * values[-1]


def test_kernels_have_unit_power() -> None:
    _, _, discrepancy = two_speeds()
    power = np.where(np.arange(2 * ORDERS - 1) == 0, 1.0, 0.5)
    (_, (_, _, position)), *_ = discrepancy.enumerate()
    for kernel in position.kernels:
        # Orders beyond the last are folded back by the shortest length.
        assert float(power @ np.diagonal(kernel)) == pytest.approx(1.0, rel=0.02)


def without_high_orders(campaign: Campaign) -> Campaign:
    """Return the campaign without the orders that a slow sensor cannot carry in its first group."""
    first, *others = campaign.groups
    high = np.arange(ORDERS) > 70
    blocks = [replace(block, orders_mps2=np.where(high, np.nan, block.orders_mps2)) for block in first.blocks]
    return replace(campaign, groups=(replace(first, blocks=tuple(blocks)), *others))


@pytest.mark.parametrize("every_order", [True, False], ids=["all orders", "orders missing"])
@pytest.mark.parametrize("speeds", [ONE_SPEED, TWO_SPEEDS, THREE_SPEEDS], ids=["one", "two", "three"])
def test_products_equal_dense_covariance(speeds: tuple[GroupConditions, ...], every_order: bool) -> None:
    """One or two groups are inverted as a whole, three by way of what they share."""
    campaign = campaign_of(speeds) if every_order else without_high_orders(campaign_of(speeds))
    fit, data = started(campaign)
    discrepancy = Discrepancy(campaign, data)
    applied = discrepancy.applied(some_amplitudes(discrepancy))
    dense = covariance_of(applied, data)
    there = fit.under(applied)
    rows, residual = joined(data, fit.rows), joined(data, fit.residual)
    solved = np.linalg.solve(dense, np.concatenate([rows, residual]).T)
    scale = np.sqrt(np.diagonal(rows @ solved[:, :-1]))
    assert np.abs((there.information - rows @ solved[:, :-1]) / np.outer(scale, scale)).max() < 1e-6
    assert there.slope == pytest.approx(rows @ solved[:, -1], abs=1e-6 * np.abs(rows @ solved[:, -1]).max())
    assert there.residual_product == pytest.approx(float(residual[0] @ solved[:, -1]), rel=1e-6)
    assert applied.log_determinant == pytest.approx(np.linalg.slogdet(dense)[1], rel=1e-6)


def test_products_of_some_groups_leave_the_others_out() -> None:
    fit, _, discrepancy = two_speeds()
    there = fit.under(discrepancy.applied(some_amplitudes(discrepancy)))
    rows = fit.rows[1][:2]
    zeros = np.zeros_like(rows)
    assert there.cross_information([None, rows], 2) == pytest.approx(
        there.cross_information([zeros, rows], 2), rel=1e-12
    )
    assert there.cross([None, rows]) == pytest.approx(there.cross([zeros, rows]), rel=1e-12)


def test_products_move_with_the_parameters() -> None:
    fit, _, discrepancy = two_speeds()
    there = fit.under(discrepancy.applied(some_amplitudes(discrepancy)))
    moved = there.moved(there.step)
    afresh = replace(moved)
    assert moved.cost == pytest.approx(afresh.cost, rel=1e-9)
    assert moved.slope == pytest.approx(afresh.slope, abs=1e-9 * np.abs(there.slope).max())


def test_mean_equals_dense_regression() -> None:
    fit, data, discrepancy = two_speeds()
    applied = discrepancy.applied(some_amplitudes(discrepancy))
    dense = covariance_of(applied, data)
    residual = joined(data, fit.residual)[0]
    # What the groups' common discrepancy is expected to be in the whitened data.
    expected = covariance_of(applied, data, shared_only=True) @ np.linalg.solve(dense, residual)
    result = np.zeros_like(residual)
    width = sum(len(factor) for factor in data.factors[0])
    weighted = [rows[-1] for rows in fit.under(applied).weighted]
    for group, curves in enumerate(applied.mean(weighted)):
        result[group * width : (group + 1) * width] = whitened(data, group, curves)
    assert result == pytest.approx(expected, abs=1e-5 * np.abs(expected).max())


def restricted(fit: Fit, applied: Applied) -> float:
    """Return the restricted log likelihood of amplitudes at the fit's linear optimum."""
    there = fit.under(applied)
    there = there.moved(there.step)
    return -0.5 * (there.cost + applied.log_determinant + float(np.linalg.slogdet(there.precision)[1]))


def test_amplitude_steps_reach_a_stationary_point() -> None:
    bump = FROM_FIELD @ draw(9.0, 0.12, 4)
    campaign = with_blocks(
        campaign_of(ONE_SPEED),
        lambda _, orders: orders + (np.arange(3) == RADIAL)[:, None] * as_complex(bump),
    )
    fit, data = fitted(campaign)
    discrepancy = Discrepancy(campaign, data)
    applied = discrepancy.applied(discrepancy.start(fit.residual))
    first = restricted(fit, applied)
    for _ in range(60):
        there = fit.under(applied)
        there = there.moved(there.step)
        applied = applied.improved(there.weighted, there.precision)
    assert restricted(fit, applied) > first
    least = (criteria.LEAST_SHARE * discrepancy.reference_mps2) ** 2
    slopes = []
    for where in np.argwhere(applied.amplitudes > 1e3 * least):
        both = []
        for factor in (1.05, 1.0 / 1.05):
            amplitudes = applied.amplitudes.copy()
            amplitudes[tuple(where)] *= factor
            both.append(restricted(fit, discrepancy.applied(amplitudes)))
        slopes.append((both[0] - both[1]) / (2.0 * np.log(1.05)))
    assert len(slopes) > 0
    assert np.abs(slopes).max() < 0.05


@pytest.mark.parametrize("rms_mps2", [1.0, 10.0])
def test_planted_amplitude_is_recovered(rms_mps2: float) -> None:
    curve = FROM_FIELD @ draw(rms_mps2**2, 0.03, 7)
    campaign = with_blocks(
        campaign_of(ONE_SPEED),
        lambda _, orders: orders + (np.arange(3) == RADIAL)[:, None] * as_complex(curve),
    )
    evaluation, _ = evaluated(campaign)
    assert evaluation.fit.applied is not None
    power = dict.fromkeys(range(3), 0.0)
    for index, (_, axis, _) in evaluation.fit.applied.discrepancy.enumerate():
        power[axis] += float(evaluation.fit.applied.amplitudes[index, 0].sum())
    # Places near the contact and away from it are windows of unit mean square each, so their sum counts twice.
    assert 0.5 * rms_mps2**2 < power[RADIAL] < 4.0 * rms_mps2**2
    assert power[0] < 0.05 * rms_mps2**2


def test_undisturbed_ring_has_no_discrepancy() -> None:
    evaluation, data = evaluated(campaign_of(ONE_SPEED))
    assert evaluation.fit.applied is not None
    # The scatter of the mean waveform is 1.05 m/s^2.
    assert np.sqrt(evaluation.fit.applied.amplitudes[:, 0].sum(axis=1)).max() < 0.4
    assert evaluation.fit.misfit < 1.15 * data.size
