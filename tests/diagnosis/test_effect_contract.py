"""Contract that every effect of the catalogue meets: text, ranges, start values, zero, axes, analytic derivatives."""

from dataclasses import replace

import numpy as np
import pytest

from gateway.core.types import FloatArray
from gateway.diagnosis.effects.catalogue import catalogue, group_of
from gateway.diagnosis.effects.contact import CONTACT_EDGE_JITTER
from gateway.diagnosis.effects.effect import (
    CIRCUMFERENTIAL,
    LATERAL,
    RADIAL,
    Effect,
    ModelledBlock,
    RingEffect,
    ScatterEffect,
    SignalEffect,
    SpectrumEffect,
)
from gateway.diagnosis.effects.ring_options import RingOptions
from tests.diagnosis.belt_data import CONDITIONS, THETA, block_of, rolling_at

ALL = catalogue()
RING = [name for name, effect in ALL.items() if isinstance(effect, RingEffect)]
SIGNAL = [name for name, effect in ALL.items() if isinstance(effect, SignalEffect)]
SPECTRUM = [name for name, effect in ALL.items() if isinstance(effect, SpectrumEffect)]
# A derivative follows its value on the fewest nodes that hold every pattern.
NODES = 360
SPEEDING_UP = block_of(replace(CONDITIONS, omega_dot_radps2=5.0, temperature_degc=50.0), nodes=NODES)
BLOCKS = (
    SPEEDING_UP,
    block_of(replace(CONDITIONS, omega_dot_radps2=-5.0, reverse=True), offset_m=8e-3, nodes=NODES),
    block_of(as_paper=True, nodes=NODES),
)
TWO_TEMPERATURES = (CONDITIONS, replace(CONDITIONS, temperature_degc=50.0))
FREQUENCY_HZ = np.linspace(0.0, 1200.0, 601)
# Clipping acts at levels below the peak of the signal only.
CLIPPING = {0.15: (1.0 / 920.0, 0.01), 0.6: (1.0 / 1150.0, 0.02), 0.85: (1.0 / 1250.0, 0.05)}


def values_of(effect: Effect, share: float) -> FloatArray:
    """Return parameters at a share of their plausible range within 1.5 prior standard deviations."""
    if effect.name == "clipping":
        return np.array(CLIPPING[share])
    low = np.array([max(p.low, p.prior_mean - 1.5 * p.prior_std) for p in effect.parameters])
    high = np.array([min(p.high, p.prior_mean + 1.5 * p.prior_std) for p in effect.parameters])
    return low + (high - low) * share


def slope(near: FloatArray, far: FloatArray, step: float) -> FloatArray:
    """Return the fourth-order derivative from differences over two and four steps."""
    return (8.0 * near - far) / (12.0 * step)


def in_range(effect: Effect, values: tuple[float, ...]) -> bool:
    return all(p.low <= value <= p.high for p, value in zip(effect.parameters, values, strict=True))


@pytest.mark.parametrize("name", ALL)
def test_description_is_complete(name: str) -> None:
    effect = ALL[name]
    assert effect.name == name
    assert isinstance(effect, RingEffect | SignalEffect | SpectrumEffect | ScatterEffect)
    for text in (effect.summary, effect.equation, effect.source, effect.observed_in, group_of(effect)):
        assert text.strip() == text != ""
    assert effect.summary.endswith(".")
    assert effect.axes
    assert set(effect.axes) <= {CIRCUMFERENTIAL, LATERAL, RADIAL}
    assert type(effect).__doc__


@pytest.mark.parametrize("name", ALL)
def test_confounders_are_effects_or_phrases(name: str) -> None:
    effect = ALL[name]
    assert effect.confounders
    titles = {other.title.lower() for other in ALL.values() if other.title}
    for confounder in effect.confounders:
        assert confounder.names
        # A display title in place of a key would be a broken reference.
        assert not {other.lower() for other in confounder.names} & titles - set(ALL)
        assert name not in confounder.names


@pytest.mark.parametrize("name", ALL)
def test_parameters_have_ranges_and_small_steps(name: str) -> None:
    effect = ALL[name]
    assert effect.parameters
    assert len({p.name for p in effect.parameters}) == len(effect.parameters)
    for parameter in effect.parameters:
        assert parameter.low < parameter.high
        assert parameter.prior_std > 0.0
        assert 0.0 < parameter.step < 0.1 * (parameter.high - parameter.low)


@pytest.mark.parametrize("name", [*RING, *SIGNAL, *SPECTRUM])
def test_start_values_are_plausible(name: str) -> None:
    effect = ALL[name]
    starts = effect.starts(TWO_TEMPERATURES)
    assert starts
    for start in starts:
        assert any(start)
        assert in_range(effect, start)
    for position, tried in effect.scan:
        assert all(in_range(effect, (*starts[0][:position], value, *starts[0][position + 1 :])) for value in tried)


@pytest.mark.parametrize("name", ALL)
def test_whole_numbers_are_tried_one_by_one(name: str) -> None:
    effect = ALL[name]
    for index, parameter in enumerate(effect.parameters):
        if parameter.whole:
            tried = [start[index] for start in effect.starts(TWO_TEMPERATURES)]
            assert tried == list(range(round(parameter.low), round(parameter.high) + 1))


@pytest.mark.parametrize("name", RING)
def test_ring_options_change_only_with_the_effect(name: str) -> None:
    effect = ALL[name]
    assert isinstance(effect, RingEffect)
    stated = RingOptions(damping_time_s=1e-4, drum_curvature_pm=0.3, sensor_offset_m=0.004, pressure_p2=-0.1)
    assert effect.options(stated, np.zeros(len(effect.parameters)), CONDITIONS) == stated
    for start in effect.starts((CONDITIONS,)):
        assert effect.options(stated, np.array(start), CONDITIONS) != stated


@pytest.mark.parametrize("name", SIGNAL)
def test_zero_parameters_add_nothing(name: str) -> None:
    effect = ALL[name]
    assert isinstance(effect, SignalEffect)
    block = block_of(replace(CONDITIONS, omega_dot_radps2=5.0), offset_m=5e-3, nodes=NODES)
    assert not effect.contribution(block, np.zeros(len(effect.parameters))).any()
    # A fit begins here: sizes are 0, shapes at their prior mean.
    prior = np.array([parameter.prior_mean for parameter in effect.parameters])
    assert np.isfinite(effect.derivative(block, prior)).all()


@pytest.mark.parametrize("name", SIGNAL)
def test_contribution_is_on_its_axes_only(name: str) -> None:
    effect = ALL[name]
    assert isinstance(effect, SignalEffect)
    block, values = SPEEDING_UP, values_of(effect, 0.6)
    added = effect.contribution(block, values)
    assert added.shape == block.signal_mps2.shape
    changed = set(np.flatnonzero(np.abs(added).max(axis=1) > 1e-9))
    assert changed
    assert changed <= set(effect.axes)
    if effect.linear:
        assert effect.contribution(block, 2.0 * values) == pytest.approx(2.0 * added, rel=1e-9, abs=1e-9)
        assert np.tensordot(values, effect.derivative(block, values), 1) == pytest.approx(added, abs=1e-9)


@pytest.mark.parametrize("share", CLIPPING)
@pytest.mark.parametrize("name", SIGNAL)
def test_signal_derivative_matches_differences(name: str, share: float) -> None:
    effect = ALL[name]
    assert isinstance(effect, SignalEffect)
    values = values_of(effect, share)
    for number, block in enumerate(BLOCKS):
        rows = effect.derivative(block, values)
        assert rows.shape == (len(values), *block.signal_mps2.shape)
        for row, parameter, unit in zip(rows, effect.parameters, np.eye(len(values)), strict=True):
            step = parameter.step * unit
            near, far = (difference(effect, block, values, factor * step) for factor in (1.0, 2.0))
            error = np.abs(row - slope(near, far, parameter.step)).max()
            assert error <= 1e-5 * max(np.abs(row).max(), 1.0), (number, parameter.name)


def difference(effect: SignalEffect, block: ModelledBlock, values: FloatArray, step: FloatArray) -> FloatArray:
    return effect.contribution(block, values + step) - effect.contribution(block, values - step)


@pytest.mark.parametrize("name", SPECTRUM)
def test_density_derivative_matches_differences(name: str) -> None:
    effect, conditions = ALL[name], rolling_at(80.0)
    assert isinstance(effect, SpectrumEffect)
    for start in effect.starts((conditions,))[:3]:
        values = np.array(start)
        density = effect.density(conditions, FREQUENCY_HZ, values)
        assert (density >= 0.0).all()
        assert set(np.flatnonzero(density.any(axis=1))) == set(effect.axes)
        rows = effect.density_derivative(conditions, FREQUENCY_HZ, values)
        for row, parameter, unit in zip(rows, effect.parameters, np.eye(len(values)), strict=True):
            near, far = (
                effect.density(conditions, FREQUENCY_HZ, values + factor * parameter.step * unit)
                - effect.density(conditions, FREQUENCY_HZ, values - factor * parameter.step * unit)
                for factor in (1.0, 2.0)
            )
            assert np.abs(row - slope(near, far, parameter.step)).max() <= 1e-5 * np.abs(row).max()


def test_windows_of_contact_edges_are_at_most_one() -> None:
    weights = CONTACT_EDGE_JITTER.windows(THETA, 0.24)
    assert weights.shape[1:] == THETA.shape
    assert weights.max() <= 1.0
    assert weights.any(axis=1).all()


def test_stages_follow_the_rank() -> None:
    stages = [effect.stage for effect in ALL.values() if isinstance(effect, SignalEffect)]
    assert stages == sorted(stages)
    assert [effect.rank for effect in ALL.values()] == sorted(effect.rank for effect in ALL.values())


def test_order_within_stage_follows_sensor() -> None:
    order = {name: index for index, name in enumerate(ALL)}
    # Ripple acts on the whole motion of the belt, but not on the constant of a camber angle.
    assert order["sample clock error"] < order["torsional ripple"] < order["camber"]
    assert order["yaw tilt"] < order["roll tilt"] < order["pitch tilt"]
    assert order["gain"] < order["zero-g offset"]
    assert order["clipping"] < order["anti-alias filter"] < order["AC coupling"]
