"""Discrepancy concentrated at single orders and places."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from gateway.closure.data.campaign_data import Campaign
from gateway.closure.effects.effect import RADIAL, BaselineModel, GroupConditions
from gateway.closure.inference import criteria
from gateway.closure.inference.discrepancy import Discrepancy
from gateway.closure.inference.discrepancy_concentration import most_evident
from gateway.closure.inference.discrepancy_kernels import (
    FROM_PLACES,
    PLACES,
    Burst,
    Concentration,
    OrderBand,
    OrderLine,
    concentrations,
    kernel,
)
from gateway.closure.inference.likelihood import whiten
from gateway.closure.inference.set_evidence import log_evidence
from gateway.closure.inference.set_search import SetSearch
from gateway.closure.model.baseline_registry import make_core
from gateway.types import FloatArray
from tests.closure.planted_campaign import (
    ALL_AXES,
    ONE_SPEED,
    TWO_SPEEDS,
    Plant,
    among,
    campaign_of,
    evaluated,
    searched,
)


def tone(size_mps2: float, order: int) -> Plant:
    """Return a pole wheel's tone on every axis, of the same size at every speed."""
    phases = np.array([0.3, 1.9, -2.2])[:, None]

    def plant(signal: FloatArray, theta: FloatArray, conditions: GroupConditions) -> FloatArray:
        return signal + size_mps2 * np.cos(order * theta + phases)

    return plant


def ringing(size_mps2: float, at_rad: float) -> Plant:
    """Return short ringing at one place, on the radial axis."""

    def plant(signal: FloatArray, theta: FloatArray, conditions: GroupConditions) -> FloatArray:
        away = theta - at_rad
        read = signal.copy()
        read[RADIAL] += size_mps2 * np.exp(-0.5 * np.square(away / 0.12)) * np.sin(55.0 * away)
        return read

    return plant


def short_waves(size_mps2: float, seed: int) -> Plant:
    """Return waves of orders 88 to 106 all around, on the radial axis: no packet, no line."""
    phases = np.random.default_rng(seed).uniform(0.0, 2.0 * math.pi, 19)[:, None]

    def plant(signal: FloatArray, theta: FloatArray, conditions: GroupConditions) -> FloatArray:
        read = signal.copy()
        read[RADIAL] += size_mps2 * np.cos(np.arange(88, 107)[:, None] * theta + phases).sum(axis=0)
        return read

    return plant


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
