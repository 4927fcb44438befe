"""Tire states at similar loads and pressures."""

from dataclasses import replace

import numpy as np
import pytest

from gateway.diagnosis.data.campaign_data import Campaign
from gateway.diagnosis.data.condition_groups import tire_states, unlike_contacts
from gateway.diagnosis.effects.catalogue import candidates
from gateway.diagnosis.effects.effect import RADIAL, BaselineModel
from gateway.diagnosis.effects.ring_options import RingOptions
from gateway.diagnosis.model.baseline_registry import angle_effects, make_core
from gateway.diagnosis.model.closure_model import ClosureModel
from gateway.diagnosis.model.exact_baseline import ExactCore, ring_parameters
from gateway.diagnosis.model.tire_state import shift, slopes
from tests.diagnosis.planted_campaign import LOAD_N, PLANE, campaign_of, conditions, searched

NAMES = ExactCore.names
STEADY = conditions()


@pytest.mark.parametrize(("load", "pressure"), [(1.03, 1.0), (1.0, 1.009), (0.97, 0.995)])
def test_stiffnesses_are_independent_of_load_and_pressure(load: float, pressure: float) -> None:
    there = replace(STEADY, load_n=load * STEADY.load_n, pressure_pa=pressure * STEADY.pressure_pa)
    state = np.array([0.1, -0.2, 0.05, 0.3, -0.1])
    reference = ring_parameters(state, STEADY, RingOptions())
    ring = ring_parameters(state + shift(NAMES, there, STEADY), there, RingOptions())
    for name in ("bending_stiffness_nm2", "tension_width_m", "tread_stiffness_npm2"):
        assert getattr(ring, name) == pytest.approx(getattr(reference, name), rel=1e-12)
    grown = 1.0 + 0.5 * (pressure - 1.0)
    assert ring.radial_stiffness_npm2 == pytest.approx(grown * reference.radial_stiffness_npm2, rel=1e-12)
    assert ring.tangential_stiffness_npm2 == pytest.approx(grown * reference.tangential_stiffness_npm2, rel=1e-12)


def test_slopes_match_the_shift() -> None:
    step = 1e-6
    for slope, name in zip(slopes(NAMES), ("load_n", "pressure_pa"), strict=True):
        there = replace(STEADY, **{name: getattr(STEADY, name) * np.exp(step)})
        assert slope == pytest.approx(shift(NAMES, there, STEADY) / step, abs=1e-4)


def test_state_boundaries() -> None:
    load = np.array([4000.0, 4100.0, 4000.0, 4000.0])
    pressure = np.array([2.0e5, 2.0e5, 2.01e5, 2.04e5])
    assert tire_states(load, pressure, np.full(4, 0.2), np.ones(4, dtype=bool)).tolist() == [0, 0, 0, 1]


def one_state(campaign: Campaign) -> Campaign:
    return replace(campaign, groups=tuple(replace(group, state=0) for group in campaign.groups), states=1)


@pytest.mark.slow
def test_similar_loads_need_no_effect() -> None:
    """The ring of the test keeps its numbers at every load, which is what one tire does."""
    loads = (conditions(load_n=LOAD_N), conditions(load_n=1.02 * LOAD_N), conditions(load_n=0.98 * LOAD_N))
    campaign = one_state(campaign_of(loads, noise_mps2=1.0))
    posterior, search = searched(campaign, angle_effects(candidates(BaselineModel.EXACT)))
    assert posterior.identified() == ()
    assert posterior.best.names == frozenset()
    assert posterior.best.fit.misfit < 1.1 * search.data.size


def test_drifting_load_is_predicted_by_block() -> None:
    """A block's waveform follows its own load: the prediction by the group's mean is off by the drift."""
    current = conditions(load_n=LOAD_N)
    core = make_core(BaselineModel.EXACT)
    steady = campaign_of((current,), axes=PLANE)
    (group,) = steady.groups
    drifting = [
        replace(block, conditions=replace(current, load_n=LOAD_N * (1.0 + 0.004 * (number - 2))))
        for number, block in enumerate(group.blocks)
    ]
    model = ClosureModel(replace(steady, groups=(replace(group, blocks=tuple(drifting)),)), core)
    vector, _ = model.priors()
    predicted = model.predict_group(vector, 0)
    for number, block in enumerate(drifting):
        alone = replace(group, conditions=block.conditions, blocks=(block,))
        there = ClosureModel(replace(steady, groups=(group, alone)), core)
        position, _ = there.priors()
        exact = there.predict_group(position, 1)[0]
        change = np.abs(exact[RADIAL] - predicted[2, RADIAL]).max()
        assert np.abs(exact[RADIAL] - predicted[number, RADIAL]).max() < 0.05 * change + 1e-9


def test_contacts_that_differ_contradict_a_state() -> None:
    state = np.array([0, 0, 0, 1, 1])
    speed = np.array([50.0, 51.0, 80.0, 50.0, 50.0])
    # At 80 rad/s the edges may be elsewhere; 5 % are a load 7 % off.
    half = np.array([0.222, 0.272, 0.180, 0.300, 0.315])
    assert unlike_contacts(state, speed, half) == [(0, 1)]
    assert unlike_contacts(state, np.array([50.0, 80.0, 80.0, 50.0, 50.0]), half) == [(2, 1)]
    assert unlike_contacts(state[3:], speed[3:], half[3:]) == []
    assert unlike_contacts(state, speed, np.full(5, np.nan)) == []
