"""Edge waves: the belt's dispersion as a sensor sees it, recovery from data, and effects that are no waves."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gateway.closure.effects.belt_dispersion import BlockTread, belt_wave
from gateway.closure.effects.catalogue import catalogue
from gateway.closure.effects.effect import CIRCUMFERENTIAL, FIELD_SIZE, RADIAL, SignalEffect
from gateway.closure.inference.candidate_trial import refit, shapes_of, try_effect
from gateway.closure.inference.fit import FitFailedError, fit_model
from gateway.closure.inference.likelihood import whiten
from gateway.closure.model.baseline_registry import angle_effects
from gateway.closure.model.closure_model import ClosureModel
from gateway.closure.model.exact_baseline import ExactCore
from tests.closure.belt_data import THETA, block_of
from tests.closure.test_belt_recovery import campaign, std_of_recovered

WAVES = "travelling edge waves"
OFFSET_M = 6e-3
NONE_AHEAD = (0.0, 0.0, 30.0, 0.25, 0.09, 0.0)
TREAD = (67.0, 1.9, 1200.0, 40.0, 5e-5)
TRAVELLING = (-0.012, 0.022, 0.002, 0.018, *TREAD, -0.023, 0.022, 29.4, 0.24, 0.09, -0.8)
# The car tire of tools/independent_tire: 6.8 N m^2 and 4.2 kN over 3.5 kg/m.
FINITE_ELEMENTS = BlockTread(67.0, 1.940, 1200.0, 17.1, 2.9e-5)


def effect() -> SignalEffect:
    found = catalogue()[WAVES]
    assert isinstance(found, SignalEffect)
    return found


@pytest.mark.parametrize(
    ("speed_kmh", "before", "after"),
    [(45.0, 81.2, 55.7), (75.0, 86.4, 52.4)],
)
def test_orders_match_a_belt_of_finite_elements(speed_kmh: float, before: float, after: float) -> None:
    """The lines of a belt with inertia and 67 blocks, docs/evidence/independent-tire.md."""
    orders = [belt_wave(FINITE_ELEMENTS, side, speed_kmh / 3.6 / 0.32, 0.32).order for side in (0, 1)]
    assert orders == pytest.approx([before, after], abs=0.3)


def test_wave_on_a_string_has_one_speed() -> None:
    tension, omega, radius = 5000.0, 50.0, 0.3
    string = BlockTread(67.0, 0.01, tension, 0.0, 0.0)
    # Rotation adds rho A V^2 to the tension.
    over_rolling = math.sqrt(tension / radius**2 + omega**2) / omega
    for side, sign in ((0, 1.0), (1, -1.0)):
        wave = belt_wave(string, side, omega, radius)
        assert wave.order == pytest.approx(67.0 / (1.0 - sign / over_rolling), rel=0.03)
        assert wave.share == pytest.approx(sign / over_rolling, rel=0.05)
        assert wave.share == pytest.approx(1.0 - 67.0 / wave.order)
        assert wave.decay_per_rad == 0.0


@pytest.mark.parametrize(("loss", "most"), [((40.0, 0.0), "after"), ((0.0, 1e-4), "before")])
def test_losses_make_both_waves_decay(loss: tuple[float, float], most: str) -> None:
    decays = [belt_wave(BlockTread(67.0, 1.9, 1200.0, *loss), side, 60.0, 0.32).decay_per_rad for side in (0, 1)]
    assert min(decays) > 0.0
    # Bending damping grows with the fourth power of the wave number, which is larger ahead.
    ratio = decays[0] / decays[1]
    assert ratio > 2.0 if most == "before" else ratio < 1.5


@pytest.mark.parametrize("side", [0, 1])
def test_wave_derivatives_match_differences(side: int) -> None:
    at, steps = np.array([67.0, 1.9, 1200.0, 40.0, 1e-4]), np.array([1e-3, 1e-4, 1e-1, 1e-2, 1e-8])
    wave = belt_wave(BlockTread(*at), side, 60.0, 0.32)
    for place, step in enumerate(steps):
        change = np.eye(5)[place] * step
        above, below = (belt_wave(BlockTread(*(at + way * change)), side, 60.0, 0.32) for way in (1.0, -1.0))
        for name, by in (("order", wave.order_by), ("decay_per_rad", wave.decay_by), ("share", wave.share_by)):
            numeric = (getattr(above, name) - getattr(below, name)) / (2.0 * step)
            assert by[place] == pytest.approx(numeric, rel=1e-4)


def test_travelling_wave_reverses_the_circumferential_axis() -> None:
    block = block_of(offset_m=OFFSET_M)
    conditions = block.conditions
    waves = [belt_wave(BlockTread(*TREAD), side, conditions.omega_radps, conditions.radius_m) for side in (0, 1)]
    made = effect().contribution(block, np.array([0.0, 0.0, 0.02, 0.0, *TREAD, *NONE_AHEAD]))
    locked = catalogue()["tire-locked edge waves"]
    assert isinstance(locked, SignalEffect)
    after = waves[1].order, waves[1].decay_per_rad
    still = locked.contribution(block, np.array([0.0, 0.0, 90.0, 4.0, 0.02, 0.0, *after]))
    assert made[RADIAL] == pytest.approx(still[RADIAL], abs=1e-9)
    assert made[CIRCUMFERENTIAL] == pytest.approx((1.0 - 67.0 / after[0]) * still[CIRCUMFERENTIAL], abs=1e-9)
    in_contact = np.abs(THETA) < 0.5 * block.trailing_edge_rad
    assert np.abs(made[:, in_contact]).max() < 0.02 * np.abs(made[:, ~in_contact]).max()
    assert made.shape == (3, FIELD_SIZE)


@pytest.mark.parametrize("speeds", [(65.0,), (45.0, 60.0, 75.0)])
def test_travelling_waves_and_a_packet_ahead_are_found(speeds: tuple[float, ...]) -> None:
    truth = np.array(TRAVELLING)
    std = std_of_recovered(effect(), truth, 21, speeds)
    # One speed leaves bending and tension to each other; several part them.
    if len(speeds) > 1:
        assert (std[4:7] < 0.03 * truth[4:7]).all()


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
    data = whiten(made, ExactCore())
    without = fit_model(ClosureModel(made, ExactCore()), data)
    shapes = shapes_of(without, range(len(data.orders)))
    ours, theirs = try_effect(without, effect(), shapes), try_effect(without, true, shapes)
    assert theirs is not None
    right = refit(theirs, data)
    if ours is None:
        return
    try:
        wrong = refit(ours, data)
    except FitFailedError:
        return
    assert wrong.misfit > right.misfit + 100.0


@pytest.mark.parametrize(
    "tread",
    [
        (0.0, 1.0, 1000.0, 0.0, 0.0),
        (-50.0, -1.0, -1000.0, -100.0, -1e-3),
        (300.0, 0.0, 0.0, 1e5, 0.1),
        (60.0, 1e3, 1e5, 0.0, 0.0),
    ],
)
def test_values_that_are_no_wave_stay_finite(tread: tuple[float, ...]) -> None:
    parameters = np.array([0.1, 0.1, 0.1, 0.1, *tread, 0.1, 0.1, 1e4, 0.2, 0.1, 0.0])
    block = block_of(offset_m=OFFSET_M)
    assert np.isfinite(effect().contribution(block, parameters)).all()
    assert np.isfinite(effect().derivative(block, parameters)).all()
