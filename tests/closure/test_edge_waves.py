"""Edge waves: order and slope that a sensor sees, recovery from data, and effects that are no waves."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from gateway.closure.effects.catalogue import catalogue
from gateway.closure.effects.effect import CIRCUMFERENTIAL, FIELD_SIZE, RADIAL, SignalEffect
from gateway.closure.effects.wave_packets import REFERENCE_MPS, sensor_view
from gateway.closure.inference.candidate_trial import refit, try_effect
from gateway.closure.inference.fit import FitFailedError, fit_model
from gateway.closure.inference.likelihood import whiten
from gateway.closure.model.baseline_registry import angle_effects
from gateway.closure.model.closure_model import ClosureModel
from gateway.closure.model.exact_baseline import ExactCore
from gateway.types import FloatArray
from tests.closure.belt_data import CONDITIONS, THETA, block_of
from tests.closure.test_belt_recovery import campaign

WAVES = "travelling edge waves"
OFFSET_M = 6e-3
NONE_AHEAD = (0.0, 0.0, 30.0, 0.25, 0.09)
TRAVELLING = (-0.012, 0.022, 94.0, 4.4, 0.002, 0.018, 52.0, 1.4, 67.0, -0.023, 0.022, 29.4, 0.24, 0.09)


def effect() -> SignalEffect:
    found = catalogue()[WAVES]
    assert isinstance(found, SignalEffect)
    return found


def wave_of(phase_speed_mps: float, side: int, pitch: int) -> tuple[FloatArray, FloatArray, int]:
    """Return a wave that a tread emits as traced at a point of the belt and at one just ahead of it.

    Every pitch that comes by sends out a crest from the contact; a point sees it when it arrives.

    Returns:
        the wave by the sensor's angle, its slope along the belt by the difference of two points, and the crests that
        come by in a revolution.
    """
    speed, radius = CONDITIONS.radius_m * CONDITIONS.omega_radps, CONDITIONS.radius_m
    turning = np.linspace(0.0, 2.0 * math.pi, 4001)[:-1]
    ahead = 1e-5

    def at(angle: FloatArray, time: FloatArray) -> FloatArray:
        # Distance from the contact by the angle on the road, in which a wave goes at c -+ V.
        distance = radius * side * angle
        over_ground = phase_speed_mps + side * speed
        left_at = time - distance / over_ground
        sent: FloatArray = np.cos(pitch * CONDITIONS.omega_radps * left_at)
        return sent

    # Side +1 travels behind the contact in the sense of rotation, -1 against it; angle 0 is the contact.
    angle = side * turning if side > 0 else turning - 2.0 * math.pi
    time = angle / CONDITIONS.omega_radps
    block, there = at(angle, time), at(angle + ahead, time)
    crests = int(np.sum((block > np.roll(block, 1)) & (block >= np.roll(block, -1))))
    return block, (there - block) / ahead, crests


@pytest.mark.parametrize("side", [-1, 1])
def test_order_and_slope_match_a_traced_wave(side: int) -> None:
    speed, pitch = CONDITIONS.radius_m * CONDITIONS.omega_radps, 60
    wave, slope_along, crests = wave_of(4.0 * speed, side, pitch)
    order = pitch / (1.0 + side / 4.0)
    assert crests == pytest.approx(order, abs=1.0)
    slope_seen = np.gradient(wave, 2.0 * math.pi / len(wave))
    share = float(slope_along[5:-5] @ slope_seen[5:-5]) / float(slope_seen[5:-5] @ slope_seen[5:-5])
    assert sensor_view(order, pitch, REFERENCE_MPS).share == pytest.approx(share, abs=0.01)
    assert share * side < 0.0


def test_order_follows_speed_at_constant_phase_speed() -> None:
    phase_speed = 70.0
    for side in (-1.0, 1.0):
        order = 67.0 / (1.0 + side * REFERENCE_MPS / phase_speed)
        for speed in (14.0, 26.0):
            true = 67.0 / (1.0 + side * speed / phase_speed)
            there = order * sensor_view(order, 67.0, speed).stretch
            # 30 % faster or slower: a power law, and faded in with the pitch.
            assert there == pytest.approx(true, rel=0.03)
            assert abs(there - order) > 0.5 * abs(true - order)


def test_stationary_wave_keeps_its_order() -> None:
    for speed in (8.0, 40.0):
        still = sensor_view(37.0, 0.0, speed)
        assert (still.stretch, still.share) == (1.0, 1.0)


def test_travelling_wave_reverses_the_circumferential_axis() -> None:
    block = block_of(offset_m=OFFSET_M)
    still = effect().contribution(block, np.array([0.0, 0.0, 90.0, 4.0, 0.02, 0.0, 52.0, 1.4, 0.0, *NONE_AHEAD]))
    values = np.array([0.0, 0.0, 90.0, 4.0, 0.02, 0.0, 52.0, 1.4, 67.0, *NONE_AHEAD])
    fast = replace(block, conditions=replace(block.conditions, omega_radps=REFERENCE_MPS / block.conditions.radius_m))
    ratio = (REFERENCE_MPS / (block.conditions.radius_m * block.conditions.omega_radps)) ** 2
    moved = effect().contribution(fast, values) / ratio
    assert moved[RADIAL] == pytest.approx(still[RADIAL], abs=1e-9)
    assert moved[CIRCUMFERENTIAL] == pytest.approx((1.0 - 67.0 / 52.0) * still[CIRCUMFERENTIAL], abs=1e-9)
    in_contact = np.abs(THETA) < 0.5 * block.trailing_edge_rad
    assert np.abs(moved[:, in_contact]).max() < 0.02 * np.abs(moved[:, ~in_contact]).max()
    assert moved.shape == (3, FIELD_SIZE)


def test_travelling_waves_and_a_packet_ahead_are_found() -> None:
    made = campaign(effect(), np.array(TRAVELLING), 21)
    data = whiten(made, with_mean=True)
    without = fit_model(ClosureModel(made, ExactCore()), data)
    trial = try_effect(without, data, effect(), range(len(data.orders)))
    assert trial is not None
    fit = refit(trial, data)
    assert fit.misfit < 1.15 * data.size


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("torsional ripple", (-0.0013, -0.0078, 12.0)),
        ("tread pitch", (0.002, -0.0009, 64.7, 0.2)),
        ("imbalance and hub motion", (8e-5, 1e-4, 0.0)),
    ],
)
def test_other_effects_are_not_better_explained_by_waves(name: str, values: tuple[float, ...]) -> None:
    true = angle_effects(catalogue())[name]
    made = campaign(true, np.array(values), 31)
    data = whiten(made, with_mean=True)
    without = fit_model(ClosureModel(made, ExactCore()), data)
    ours, theirs = (
        try_effect(without, data, effect(), range(len(data.orders))),
        try_effect(without, data, true, range(len(data.orders))),
    )
    assert theirs is not None
    right = refit(theirs, data)
    if ours is None:
        return
    try:
        wrong = refit(ours, data)
    except FitFailedError:
        return
    assert wrong.misfit > right.misfit + 100.0


@pytest.mark.parametrize(("order", "pitch"), [(0.0, 60.0), (-5.0, 60.0), (50.0, -40.0), (1e4, 130.0)])
def test_values_that_are_no_wave_stay_finite(order: float, pitch: float) -> None:
    parameters = np.array([0.1, 0.1, order, 1.0, 0.1, 0.1, order, 1.0, pitch, 0.1, 0.1, order, 0.2, 0.1])
    block = block_of(offset_m=OFFSET_M)
    assert np.isfinite(effect().contribution(block, parameters)).all()
    assert np.isfinite(effect().derivative(block, parameters)).all()
