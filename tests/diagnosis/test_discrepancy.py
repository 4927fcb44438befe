"""Discrepancy: kernels, covariance, amplitudes by restricted likelihood, and what is concentrated at one order."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from gateway.core.types import FloatArray
from gateway.diagnosis import criteria
from gateway.diagnosis.angle.discrepancy import Applied, Discrepancy
from gateway.diagnosis.angle.discrepancy_kernels import (
    FROM_PLACES,
    PLACES,
    Burst,
    Concentration,
    OrderBand,
    OrderLine,
    concentrations,
    kernel,
)
from gateway.diagnosis.angle.fit import Fit
from gateway.diagnosis.angle.likelihood import ANGLES, FROM_FIELD, Whitened, as_complex, whiten
from gateway.diagnosis.angle.set_evidence import log_evidence
from gateway.diagnosis.data.campaign_data import Campaign
from gateway.diagnosis.effects.angle_orders import ORDERS
from gateway.diagnosis.effects.effect import RADIAL, BaselineModel, GroupConditions
from gateway.diagnosis.model.baseline_registry import make_core
from gateway.diagnosis.search.discrepancy_concentration import most_evident
from gateway.diagnosis.search.set_search import SetSearch
from tests.diagnosis.dense_covariance import covariance_of, joined, whitened
from tests.diagnosis.planted_campaign import (
    ALL_AXES,
    ONE_SPEED,
    THREE_SPEEDS,
    TWO_SPEEDS,
    Plant,
    among,
    campaign_of,
    evaluated,
    fitted,
    searched,
    started,
    wave,
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
    for _, index in discrepancy.axes:
        assert len(index.kernels) == 2 * len(criteria.LENGTHS_RAD)
        for matrix in index.kernels:
            values = np.linalg.eigvalsh(matrix)
            assert values[0] > -1e-9 * values[-1]


def test_kernels_have_unit_power() -> None:
    _, _, discrepancy = two_speeds()
    power = np.where(np.arange(2 * ORDERS - 1) == 0, 1.0, 0.5)
    (_, position), *_ = discrepancy.axes
    for matrix in position.kernels:
        # Orders beyond the last are folded back by the shortest length.
        assert float(power @ np.diagonal(matrix)) == pytest.approx(1.0, rel=0.02)


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
        campaign_of(ONE_SPEED), lambda _, orders: orders + (np.arange(3) == RADIAL)[:, None] * as_complex(bump)
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


def test_limit_of_steps_that_shrink_by_a_ratio() -> None:
    _, _, discrepancy = two_speeds()
    target, ratio = some_amplitudes(discrepancy), 0.5
    first, second, third = (target * np.exp(2.0 * ratio**step) for step in range(3))
    assert discrepancy.applied(third).limit(first, second).amplitudes == pytest.approx(target, rel=1e-9)
    # Steps that do not shrink have no limit: four more are taken.
    assert discrepancy.applied(4.0 * target).limit(target, 2.0 * target).amplitudes == pytest.approx(64.0 * target)


@pytest.mark.parametrize("rms_mps2", [1.0, 10.0])
def test_planted_amplitude_is_recovered(rms_mps2: float) -> None:
    curve = FROM_FIELD @ draw(rms_mps2**2, 0.03, 7)
    campaign = with_blocks(
        campaign_of(ONE_SPEED), lambda _, orders: orders + (np.arange(3) == RADIAL)[:, None] * as_complex(curve)
    )
    evaluation, _ = evaluated(campaign)
    assert evaluation.fit.applied is not None
    power = dict.fromkeys(range(3), 0.0)
    for index, (axis, _) in enumerate(evaluation.fit.applied.discrepancy.axes):
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


def tone(size_mps2: float, order: int) -> Plant:
    """Return a pole wheel's tone on every axis, of the same size at every speed."""
    phases = np.array([0.3, 1.9, -2.2])[:, None]
    return wave(ALL_AXES, lambda theta: size_mps2 * np.cos(order * theta + phases))


def ringing(size_mps2: float, at_rad: float) -> Plant:
    """Return short ringing at one place, on the radial axis."""

    def of(theta: FloatArray) -> FloatArray:
        away = theta - at_rad
        return np.asarray(size_mps2 * np.exp(-0.5 * np.square(away / 0.12)) * np.sin(55.0 * away))

    return wave(RADIAL, of)


def short_waves(size_mps2: float, seed: int) -> Plant:
    """Return waves of orders 88 to 106 all around, on the radial axis: no packet, no line."""
    phases = np.random.default_rng(seed).uniform(0.0, 2.0 * math.pi, 19)[:, None]

    return wave(RADIAL, lambda theta: size_mps2 * np.cos(np.arange(88, 107)[:, None] * theta + phases).sum(axis=0))


@cache
def noisy() -> Campaign:
    return campaign_of(ONE_SPEED, axes=ALL_AXES)


def test_tone_of_one_order_is_no_ripple() -> None:
    campaign = campaign_of(TWO_SPEEDS, tone(1.0, 31))
    posterior, search = searched(campaign, among("torsional ripple"))
    assert search.discrepancy.concentrations == (OrderLine(31),)
    assert posterior.probability(["torsional ripple"]) < 0.05
    # The tone has the same size at both speeds.
    applied = posterior.best.fit.applied
    assert applied is not None
    sizes = np.sqrt(applied.amplitudes[:, :, -1])
    assert sizes[:, 1] == pytest.approx(1.0, rel=0.4)
    assert np.all(sizes[:, 0] < 0.2 * sizes[:, 1])


def test_ringing_at_one_place_is_no_tread_pitch() -> None:
    campaign = campaign_of(ONE_SPEED, ringing(5.0, 1.2))
    posterior, search = searched(campaign, among("tread pitch"))
    first = search.discrepancy.concentrations[0]
    assert isinstance(first, Burst)
    assert PLACES[first.place] == pytest.approx(1.2, abs=0.12)
    assert posterior.probability(["tread pitch"]) < 0.05


@pytest.mark.parametrize("seed", [1, 3])
def test_waves_of_a_band_of_orders_are_no_edge_waves(seed: int) -> None:
    campaign = campaign_of(ONE_SPEED, short_waves(0.5, seed))
    posterior, search = searched(campaign, among("tire-locked edge waves", "tread pitch"))
    assert search.discrepancy.concentrations == (OrderBand(85, 110),)
    assert posterior.identified() == ()


@pytest.mark.parametrize(("ahead", "caller"), [(20.0, frozenset()), (1e5, frozenset(["tread pitch"]))])
def test_set_that_can_do_without_an_effect_calls_first(ahead: float, caller: frozenset[str]) -> None:
    campaign, effects = campaign_of(ONE_SPEED, short_waves(0.5, 1)), among("tread pitch")
    core = make_core(BaselineModel.EXACT)
    data = whiten(campaign, core)
    search = SetSearch(campaign, core, data, effects, Discrepancy(campaign, data))
    for item in ((), tuple(effects.values())):
        evaluation, _ = evaluated(campaign, *item)
        search.evaluations[evaluation.names] = evaluation
    bare = search.evaluations[frozenset()]
    imitating = replace(search.evaluations[frozenset(effects)], log_evidence=bare.log_evidence + ahead)
    search.evaluations[imitating.names] = imitating
    assert search.best is imitating
    called = search.called_for()
    assert called is not None
    evaluation, evident = called
    assert evaluation.names == caller
    assert evident.concentration == OrderBand(85, 110)


def test_noise_is_not_concentrated() -> None:
    result, data = evaluated(noisy())
    assert most_evident(result.fit, data) is None


def test_gain_is_that_of_the_evidence() -> None:
    campaign = campaign_of(ONE_SPEED, tone(1.0, 31))
    result, data = evaluated(campaign)
    evident = most_evident(result.fit, data)
    assert evident is not None
    applied = result.fit.applied
    assert applied is not None
    more = applied.discrepancy.concentrated(evident.concentration)
    amplitudes = np.concatenate([applied.amplitudes, evident.amplitudes[:, :, None]], axis=2)
    after = result.fit.under(more.applied(amplitudes))
    assert log_evidence(after.moved(after.step)) - result.log_evidence == pytest.approx(evident.gain, rel=0.02)


@pytest.mark.parametrize("item", [OrderLine(7), OrderBand(60, 84), Burst(80, 0.1, 0.03), Burst(6, 0.3, 0.12)])
def test_kernel_has_unit_variance_at_its_centre(item: Concentration) -> None:
    to_places = 2.0 * len(FROM_PLACES) * FROM_PLACES.T / np.where(np.arange(len(FROM_PLACES)) == 0, 1.0, 2.0)
    variance = np.diagonal(to_places @ kernel(item) @ to_places.T)
    if isinstance(item, Burst):
        assert abs(int(np.argmax(variance)) - item.place) <= 1
        away = np.abs(np.mod(PLACES - PLACES[item.place] + math.pi, 2.0 * math.pi) - math.pi)
        assert np.all(variance[away > 4.0 * item.width_rad] < 1e-3)
    assert variance.max() == pytest.approx(1.0, rel=0.01)


def test_kernel_of_blows_holds_ringing_beyond_the_orders_compared() -> None:
    """Cut off at the highest order, such ringing goes on all around the wheel."""
    single = Burst(296, 0.1, criteria.BLOW_RAD)
    angle = np.linspace(-math.pi, math.pi, 20_000, endpoint=False)
    after = angle - PLACES[single.place]
    curve = np.where(after > 0.0, np.exp(-after / 0.05) * np.sin(136.0 * after), 0.0)
    cut = np.fft.rfft(curve)[: len(FROM_PLACES) // 2 + 1] * np.exp(1j * math.pi * np.arange(len(FROM_PLACES) // 2 + 1))
    cut[0] *= 0.5
    coefficients = np.concatenate([cut.real, cut[1:].imag]) * 2.0 / len(angle)
    values, vectors = np.linalg.eigh(kernel(single))
    outside = vectors[:, values < 1e-3 * values[-1]]
    assert np.linalg.norm(outside.T @ coefficients) < 0.01 * np.linalg.norm(coefficients)


def test_concentrations_cover_the_revolution() -> None:
    places = {PLACES[concentration.place] for concentration in concentrations() if isinstance(concentration, Burst)}
    gaps = np.diff(np.sort([*places, min(places) + 2.0 * math.pi]))
    assert gaps.max() < 0.12
    assert {concentration.order for concentration in concentrations() if isinstance(concentration, OrderLine)} == set(
        range(1, 111)
    )
