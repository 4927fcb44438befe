"""Likelihood of the groups' means: scatter with its place on the belt, dependence of blocks, whitening."""

from dataclasses import replace

import numpy as np
import pytest

from gateway.core.types import FloatArray
from gateway.diagnosis.angle.likelihood import ANGLES, FROM_FIELD, TO_FIELD, as_complex, as_real, whiten
from gateway.diagnosis.data.campaign_data import PROFILE_SIZE, Campaign
from gateway.diagnosis.data.revolution_scatter import settle
from gateway.diagnosis.effects.angle_orders import ORDERS
from gateway.diagnosis.effects.effect import CIRCUMFERENTIAL, LATERAL, RADIAL
from gateway.diagnosis.model.exact_baseline import ExactCore
from gateway.diagnosis.model.series_baseline import SeriesCore
from tests.diagnosis.dense_covariance import whitened
from tests.diagnosis.planted_campaign import BLOCKS, ONE_SPEED, REVOLUTIONS, campaign_of, conditions, with_blocks

EDGE_RAD = 0.25
PROFILE_ANGLES: FloatArray = -np.pi + 2.0 * np.pi / PROFILE_SIZE * np.arange(PROFILE_SIZE)


def at_edges(angle_rad: FloatArray) -> FloatArray:
    """Return the power of a scatter twenty times larger at two contact edges, mean 1."""
    power = 1.0 + 19.0 * np.exp(-0.5 * np.square((np.abs(angle_rad) - EDGE_RAD) / 0.06))
    result: FloatArray = power / power.mean()
    return result


def with_profile(campaign: Campaign) -> Campaign:
    profile = np.ones((3, PROFILE_SIZE))
    profile[RADIAL] = at_edges(PROFILE_ANGLES)
    groups = tuple(replace(group, scatter_profile=profile) for group in campaign.groups)
    return replace(campaign, groups=groups)


def scatter(rng: np.random.Generator, count: int) -> FloatArray:
    """Return real coefficients of random curves with the power of `at_edges`, (count, REAL)."""
    flat = rng.normal(size=(count, 2 * ORDERS - 1)) @ TO_FIELD.T
    result: FloatArray = (flat * np.sqrt(at_edges(ANGLES))) @ FROM_FIELD.T
    return result


def test_real_and_complex_coefficients_are_inverse() -> None:
    real = np.random.default_rng(1).normal(size=(4, 2 * ORDERS - 1))
    assert as_real(as_complex(real)) == pytest.approx(real)
    theta = ANGLES[17]
    order = np.arange(ORDERS)
    curve = (as_complex(real)[0] * np.exp(1j * order * theta)).real.sum()
    assert (TO_FIELD @ real[0])[17] == pytest.approx(curve)


def test_whitened_scatter_with_a_place_is_white() -> None:
    data = whiten(with_profile(campaign_of(ONE_SPEED)), ExactCore())
    rng = np.random.default_rng(3)
    number = 4000
    values = np.zeros((number, 3, ORDERS), complex)
    total = REVOLUTIONS * BLOCKS
    values[:, RADIAL] = as_complex(scatter(rng, number)) / np.sqrt(total)
    values[:, CIRCUMFERENTIAL] = as_complex(rng.normal(size=(number, 2 * ORDERS - 1))) / np.sqrt(total)
    white = whitened(data, 0, as_real(values))
    covariance = white.T @ white / number
    expected = np.eye(len(covariance))
    # Sampling errors are 1/sqrt(4000); the dependence of the campaign's blocks is measured to some percent.
    assert np.abs(covariance - expected).max() < 0.25
    assert np.diagonal(covariance).mean() == pytest.approx(1.0, abs=0.1)


def test_precision_equals_product_of_whitened_rows() -> None:
    data = whiten(with_profile(campaign_of(ONE_SPEED)), ExactCore())
    rows = np.random.default_rng(5).normal(size=(4, 3, 2 * ORDERS - 1))
    white = whitened(data, 0, rows)
    (weighted,) = data.weighted([rows])
    expected = white @ white.T
    assert weighted.reshape(4, -1) @ rows.reshape(4, -1).T == pytest.approx(expected, rel=1e-9)


def test_edge_scatter_lowers_weight_at_the_edges_only() -> None:
    """A curve away from the edges is as visible as without the edges' scatter; one at them is hidden."""
    plain, placed = (
        whiten(item, ExactCore()) for item in (campaign_of(ONE_SPEED), with_profile(campaign_of(ONE_SPEED)))
    )

    def seen(where_rad: float) -> float:
        curve = np.exp(-0.5 * np.square((ANGLES - where_rad) / 0.08))
        values = np.zeros((3, ORDERS), complex)
        values[RADIAL] = as_complex(FROM_FIELD @ curve)
        there, current = (float(np.square(whitened(item, 0, as_real(values))).sum()) for item in (placed, plain))
        return there / current

    assert seen(EDGE_RAD) < 0.3
    assert seen(2.0) > 1.5


def test_scatter_profile_is_measured_from_revolutions() -> None:
    rng = np.random.default_rng(5)
    count = 80
    orders = np.zeros((count, 3, ORDERS), complex)
    for axis in (CIRCUMFERENTIAL, RADIAL):
        orders[:, axis] = 100.0 * as_complex(rng.normal(size=2 * ORDERS - 1))
    orders[:, RADIAL] += as_complex(scatter(rng, count))
    orders[:, CIRCUMFERENTIAL] += as_complex(rng.normal(size=(count, 2 * ORDERS - 1)))
    orders[:, LATERAL] = complex(np.nan, np.nan)
    result = settle(orders, np.full(count, 50.0), np.zeros(count)).profile
    assert result.shape == (3, PROFILE_SIZE)
    assert result.mean(axis=1) == pytest.approx(1.0, abs=0.02)
    truth = at_edges(PROFILE_ANGLES)
    assert np.corrcoef(result[RADIAL], truth)[0, 1] > 0.95
    near = np.abs(np.abs(PROFILE_ANGLES) - EDGE_RAD) < 0.03
    assert result[RADIAL][near].mean() == pytest.approx(truth[near].mean(), rel=0.3)
    assert result[CIRCUMFERENTIAL].max() < 1.5


@pytest.mark.parametrize(("share", "expected"), [(1.0, 1.0), (0.75, 0.75), (0.0, 0.5)])
def test_blocks_that_differ_less_have_smaller_errors(share: float, expected: float) -> None:
    """Errors of neighbouring revolutions that cancel make blocks scatter less than independent ones."""
    campaign = campaign_of(ONE_SPEED)
    (group,) = campaign.groups
    mean = np.mean([block.orders_mps2 for block in group.blocks], axis=0)
    alike = with_blocks(campaign, lambda _, orders: mean + np.sqrt(share) * (orders - mean))
    variance = whiten(alike, ExactCore()).weights[0][0, RADIAL, 40] ** -2.0
    # The measured scatter of these seeds is within 5 % of the stated one.
    assert variance * REVOLUTIONS == pytest.approx(expected, rel=0.1)


def test_absent_axes_and_orders_are_not_compared() -> None:
    campaign = with_blocks(campaign_of(ONE_SPEED), lambda _, orders: np.where(np.arange(ORDERS) < 60, orders, np.nan))
    data = whiten(campaign, ExactCore())
    assert [len(factor) for factor in data.factors[0]] == [119, 0, 119]
    assert data.size == 238
    assert whiten(campaign, SeriesCore()).size == 236
    assert not data.used[0][LATERAL].any()


def test_computation_error_bounds_the_weight() -> None:
    """Without noise a coefficient is still not known better than the resampling's error."""
    data = whiten(campaign_of((conditions(60.0),), noise_mps2=1e-9), ExactCore())
    assert 0.0 < data.weights[0].max() < 1e5
    assert data.weights[0][0, RADIAL, 100] > data.weights[0][0, RADIAL, 3]
