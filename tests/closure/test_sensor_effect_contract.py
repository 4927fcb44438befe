"""Effects of mounting, element, clock and electronics: derivatives, starts, order, and what they leave alone."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.closure.effects.base import (
    FIELD_SIZE,
    RADIAL,
    SignalEffect,
    Stage,
)
from gateway.closure.effects.catalogue import MODULES, catalogue
from tests.closure.sensor_data import CONDITIONS, NAMES, applied, effect_of, here_of


@pytest.mark.parametrize("name", NAMES)
def test_nothing_at_zero_parameters(name: str) -> None:
    effect, here = effect_of(name), here_of(65.0, 5.0)
    zero = np.zeros(len(effect.parameters))
    assert not effect.contribution(here, zero).any()
    assert np.isfinite(effect.derivative(here, zero)).all()


def values_of(effect: SignalEffect, draw: float) -> np.ndarray:
    """Return parameters within their ranges, away from where they are 0."""
    if effect.name == "clipping":
        return np.array([1.0 / (800.0 + 900.0 * draw), 0.002 + 0.05 * draw])
    low = [max(p.low, p.prior_mean - 1.5 * p.prior_std) for p in effect.parameters]
    high = [min(p.high, p.prior_mean + 1.5 * p.prior_std) for p in effect.parameters]
    return np.array([a + (b - a) * (0.02 + 0.96 * draw) for a, b in zip(low, high, strict=True)])


@settings(max_examples=12, deadline=None)
@given(draw=st.floats(0.0, 1.0), omega_dot=st.sampled_from([-9.0, 0.0, 9.0]), reverse=st.booleans())
@pytest.mark.parametrize("name", NAMES)
def test_derivatives_are_those_of_differences(name: str, draw: float, omega_dot: float, reverse: bool) -> None:
    effect, here = effect_of(name), here_of(65.0, omega_dot)
    here = replace(here, conditions=replace(here.conditions, temperature_degc=50.0, reverse=reverse))
    at = values_of(effect, draw)
    for place, parameter in enumerate(effect.parameters):
        if abs(at[place]) < 3.0 * parameter.step:
            at[place] += 5.0 * parameter.step
    rows = effect.derivative(here, at)
    assert rows.shape == (len(at), 3, FIELD_SIZE)
    for place, (row, parameter) in enumerate(zip(rows, effect.parameters, strict=True)):
        step = np.zeros(len(at))
        step[place] = parameter.step
        # Fourth-order differences.
        near = effect.contribution(here, at + step) - effect.contribution(here, at - step)
        far = effect.contribution(here, at + 2.0 * step) - effect.contribution(here, at - 2.0 * step)
        numeric = (8.0 * near - far) / (12.0 * parameter.step)
        assert np.abs(row - numeric).max() <= 1e-5 * max(np.abs(row).max(), 1.0)


@pytest.mark.parametrize("name", NAMES)
def test_they_act_where_they_say_and_start_within_range(name: str) -> None:
    effect, here = effect_of(name), here_of(65.0, 5.0)
    here = replace(here, conditions=replace(here.conditions, temperature_degc=50.0))
    starts = effect.starts((CONDITIONS, here.conditions))
    assert starts
    for start in starts:
        assert any(start)
        for value, parameter in zip(start, effect.parameters, strict=True):
            assert parameter.low <= value <= parameter.high
        change = effect.contribution(here, np.array(start))
        assert change.shape == here.signal_mps2.shape
        assert set(np.flatnonzero(np.abs(change).max(axis=1) > 1e-9)) <= set(effect.axes)
        if effect.linear:
            assert effect.contribution(here, 2.0 * np.array(start)) == pytest.approx(2.0 * change, rel=1e-12)
            assert np.tensordot(np.array(start), effect.derivative(here, np.array(start)), 1) == pytest.approx(change)


def test_an_ac_coupled_sensor_passes_no_constant() -> None:
    here = here_of()
    ac = replace(here, conditions=replace(here.conditions, ac_coupled=True))
    effect = effect_of("zero-g offset")
    values = np.array([1.0, 2.0, 3.0])
    assert not effect.contribution(ac, values).any()
    assert not effect.derivative(ac, values).any()
    passed = applied(here, AC_coupling=(0.3,)).signal_mps2
    assert np.abs(passed.mean(axis=1)).max() < 1e-9


def test_the_electronics_come_behind_the_element() -> None:
    order = {effect.name: at for at, effect in enumerate(catalogue().values())}
    assert order["roll tilt"] < order["pitch tilt"]
    assert order["gain"] < order["zero-g offset"]
    assert order["clipping"] < order["anti-alias filter"] < order["AC coupling"]
    assert len(MODULES) == len(catalogue())
    stages = [effect_of(name).stage for name in NAMES]
    assert stages == sorted(stages)
    assert effect_of("rolling radius").stage is Stage.BELT


def test_the_filter_leaves_its_delay_to_the_contacts_centre() -> None:
    here = here_of()
    effect = effect_of("anti-alias filter")
    before = np.fft.rfft(here.signal_mps2[RADIAL])[1:6]

    def turned(inverse_corner_s: float) -> np.ndarray:
        added = effect.contribution(here, np.array([inverse_corner_s]))[RADIAL]
        return np.angle(np.fft.rfft(here.signal_mps2[RADIAL] + added)[1:6] / before)

    order_hz = np.arange(1, 6) * here.conditions.omega_radps / (2.0 * math.pi)
    x = order_hz / 600.0
    # A delay would be sqrt(2) x; what is left of the phase begins with the cube.
    assert turned(1.0 / 600.0) == pytest.approx(-math.sqrt(2.0) / 3.0 * x**3, rel=0.05)
    assert turned(1.0 / 300.0) == pytest.approx(8.0 * turned(1.0 / 600.0), rel=0.2)
