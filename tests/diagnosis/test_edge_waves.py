"""Edge waves and excitation by tread blocks: recovery, mirror image in reverse, and rivals."""

import math
from dataclasses import astuple, replace

import numpy as np
import pytest

from gateway.core.types import FloatArray
from gateway.diagnosis.angle.candidate_trial import refit, shapes_of, try_effect
from gateway.diagnosis.angle.fit import FitFailedError, fit_model
from gateway.diagnosis.angle.likelihood import whiten
from gateway.diagnosis.effects.belt_dispersion import BlockTread, belt_wave, mass_of_wave
from gateway.diagnosis.effects.belt_waves import TravellingEdgeWaves
from gateway.diagnosis.effects.catalogue import candidates, catalogue
from gateway.diagnosis.effects.effect import (
    CIRCUMFERENTIAL,
    FIELD_SIZE,
    RADIAL,
    BaselineModel,
    ModelledBlock,
    SignalEffect,
)
from gateway.diagnosis.model.baseline_registry import angle_effects
from gateway.diagnosis.model.closure_model import ClosureModel
from gateway.diagnosis.model.exact_baseline import ExactCore
from tests.diagnosis.belt_data import CONDITIONS, block_of, limited
from tests.diagnosis.test_belt_recovery import campaign, std_of_recovered

WAVES = "travelling edge waves"
OFFSET_M = 6e-3
NONE_AHEAD = (0.0, 0.0, 30.0, 0.25, 0.09, 0.0)
TREAD = (67.0, 1.9, 1200.0, 40.0, 5e-5)
TRAVELLING = (-0.012, 0.022, 0.002, 0.018, 0.006, -0.004, *TREAD, -0.023, 0.022, 29.4, 0.24, 0.09, -0.8)
# The car tire of tools/independent_tire: 6.8 N m^2 and 4.2 kN over 3.5 kg/m.
FINITE_ELEMENTS = BlockTread(67.0, 1.940, 1200.0, 17.1, 2.9e-5)


def effect() -> SignalEffect:
    result = catalogue()[WAVES]
    assert isinstance(result, SignalEffect)
    return result


@pytest.mark.parametrize(("speed_kmh", "before", "after"), [(45.0, 81.2, 55.7), (75.0, 86.4, 52.4)])
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
        assert wave.shares[0] == pytest.approx(sign / over_rolling, rel=0.05)
        assert wave.shares[0] == pytest.approx(1.0 - 67.0 / wave.order)
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
    position, steps = np.array([67.0, 1.9, 1200.0, 40.0, 1e-4]), np.array([1e-3, 1e-4, 1e-1, 1e-2, 1e-8])
    wave = belt_wave(BlockTread(*position), side, 60.0, 0.32)
    for index, step in enumerate(steps):
        change = np.eye(5)[index] * step
        above, below = (belt_wave(BlockTread(*(position + way * change)), side, 60.0, 0.32) for way in (1.0, -1.0))
        for name in ("orders", "sizes", "shares"):
            numeric = (getattr(above, name) - getattr(below, name)) / (2.0 * step)
            by = getattr(wave, f"{name}_by")[:, index]
            assert np.abs(by - numeric).max() <= 1e-4 * np.abs(numeric).max()


@pytest.mark.parametrize("losses", [(0.0, 0.0), (300.0, 5e-5), (50.0, 5e-4), (0.0, 1e-3)])
@pytest.mark.parametrize("belt", [(40.0, 6.0, 600.0), (67.0, 1.9, 1200.0), (140.0, 0.2, 2500.0)])
@pytest.mark.parametrize("side", [0, 1])
def test_near_field_ends_within_a_wave(
    side: int, belt: tuple[float, float, float], losses: tuple[float, float]
) -> None:
    for omega in (20.0, 60.0, 110.0):
        wave = belt_wave(BlockTread(*belt, *losses), side, omega, 0.32)
        assert wave.orders[1].imag > wave.orders[0].imag
        # The deflection, acceleration over the order's square, has no slope along the belt at the edge.
        along = wave.sizes / np.square(wave.orders) * wave.shares * wave.orders
        assert abs(along.sum()) < 1e-9 * abs(along[0])


def forced_belt(tread: BlockTread, block: ModelledBlock, ahead: bool) -> FloatArray:
    """Return a sensor's reading of a belt on springs that blocks move in the contact, radial and circumferential.

    A closed beam under tension, on springs and dampers, rolls through a contact that moves it by cos(N Omega t). Forces
    there, at 4096 places a turn, follow from the beam's response to one of them: no wave number is solved for.

    Returns:
        Acceleration ahead of the contact or behind it, and that of the inclination times the sensor's depth, at the
        model's points (2, FIELD_SIZE), orders 2 to 110, in the belt's deflection times Omega^2.
    """
    conditions, points = block.conditions, 4096
    radius, omega = conditions.radius_m, conditions.omega_radps
    x = -math.pi + 2.0 * math.pi / points * np.arange(points)
    k = np.fft.fftfreq(points, 1.0 / points)
    w = (tread.blocks - k) * omega
    bending = tread.bending_m4ps2 - 1j * w * tread.bending_loss_m4ps
    stiffness = bending * (k / radius) ** 4 + (tread.tension_m2ps2 / radius**2 + omega**2) * k**2 + 1.8e5
    receptance = 1.0 / (stiffness - 1j * w * tread.sidewall_loss_ps - w * w)
    held = np.flatnonzero((x >= block.leading_edge_rad) & (x <= block.trailing_edge_rad))
    influence = np.fft.ifft(receptance)[(held[:, None] - held) % points]
    force = np.zeros(points, complex)
    force[held] = np.linalg.solve(influence, np.ones(len(held)))
    deflection = np.fft.fft(force) * receptance
    # The sensor's place on the belt is x = Omega t, so that a wave turns at the order k - N.
    moved = np.fft.ifft(np.stack([deflection, 1j * k * deflection]) * np.square(k - tread.blocks))
    seen = (moved * np.exp(-1j * tread.blocks * x)).real * (x < x[held[0]] if ahead else x > x[held[-1]])
    seen[1] *= -OFFSET_M / radius
    spectrum = np.fft.rfft(seen, axis=-1)[:, : FIELD_SIZE // 2 + 1]
    spectrum[:, :2] = spectrum[:, 111:] = 0.0
    return np.fft.irfft(spectrum, n=FIELD_SIZE, axis=-1) * (FIELD_SIZE / points)


@pytest.mark.parametrize(("place", "ahead", "harmonic"), [(0, True, 1), (2, False, 1), (4, False, 2)])
def test_waves_and_near_field_are_those_of_a_forced_belt(place: int, ahead: bool, harmonic: int) -> None:
    # With so much loss no wave comes round to the other edge.
    block, tread = block_of(offset_m=OFFSET_M), BlockTread(67.0, 1.9, 1200.0, 900.0, 5e-5)
    truth = forced_belt(replace(tread, blocks=harmonic * tread.blocks), block, ahead)
    parameters = np.zeros((2, len(TRAVELLING)))
    parameters[:, 6:11], parameters[:, 11:16] = astuple(tread), NONE_AHEAD[:5]
    parameters[:, place : place + 2] = np.eye(2)
    ours = np.stack([limited(effect().contribution(block, row))[[RADIAL, CIRCUMFERENTIAL]] for row in parameters])
    sizes = np.linalg.lstsq(ours[:, 0].T, truth[0], rcond=None)[0]
    # The beam lacks the curvature of the ring. Without the near field a tenth to a half would be left.
    error, size = (np.linalg.norm(item, axis=-1) for item in (np.tensordot(sizes, ours, 1) - truth, truth))
    assert (error < 0.06 * size).all()


@pytest.mark.parametrize("speeds", [(65.0,), (45.0, 60.0, 75.0)])
def test_travelling_waves_and_a_packet_ahead_are_found(speeds: tuple[float, ...]) -> None:
    truth = np.array(TRAVELLING)
    std = std_of_recovered(effect(), truth, 21, speeds)
    # One speed leaves bending and tension to each other; several part them.
    if len(speeds) > 1:
        assert (std[6:9] < 0.03 * truth[6:9]).all()


class ForcedBelt(TravellingEdgeWaves):
    """The effect as a belt on springs has it, moved by 2e-6 R at N and by 1e-6 R at 2N."""

    def contribution(self, block: ModelledBlock, parameters: FloatArray) -> FloatArray:
        tread = BlockTread(*parameters[6:11])
        waves = 2e-6 * (forced_belt(tread, block, True) + forced_belt(tread, block, False))
        waves += 1e-6 * forced_belt(replace(tread, blocks=2.0 * tread.blocks), block, False)
        result = block.zeros()
        result[[RADIAL, CIRCUMFERENTIAL]] = waves * block.conditions.radius_m * block.conditions.omega_radps**2
        return result


def test_tread_of_a_forced_belt_is_found() -> None:
    truth = np.array([*[0.01] * 6, 67.0, 1.9, 1200.0, 900.0, 5e-5, *NONE_AHEAD])
    made = campaign(ForcedBelt(), truth, 23, (45.0, 60.0, 75.0))
    data = whiten(made, ExactCore())
    without = fit_model(ClosureModel(made, ExactCore()), data)
    trial = try_effect(without, effect(), shapes_of(without, range(len(data.orders))))
    assert trial is not None
    fit = refit(trial, data)
    result = fit.vector[fit.model.layout.effect(WAVES)]
    assert result[6:9] == pytest.approx(truth[6:9], rel=0.03)
    assert result[9] == pytest.approx(truth[9], rel=0.15)
    assert fit.misfit < 0.15 * without.misfit


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
    parameters = np.array([*[0.1] * 6, *tread, 0.1, 0.1, 1e4, 0.2, 0.1, 0.0])
    block = block_of(offset_m=OFFSET_M)
    assert np.isfinite(effect().contribution(block, parameters)).all()
    assert np.isfinite(effect().derivative(block, parameters)).all()


NAME = "tread block excitation"
# Shares, blocks, mass, losses of belt and tread.
TRUTH = np.array([0.035, -0.02, 71.0, 4.6, 2.5e-5, 4e-5])


def tread_effect() -> SignalEffect:
    result = catalogue()[NAME]
    assert isinstance(result, SignalEffect)
    return result


@pytest.mark.parametrize("speeds", [(65.0,), (45.0, 75.0)])
def test_blocks_mass_and_losses_are_found(speeds: tuple[float, ...]) -> None:
    std = std_of_recovered(tread_effect(), TRUTH, 5, speeds)
    assert std[2] < 0.3
    assert std[3] < 0.05 * TRUTH[3]


def test_numbers_of_blocks_are_tried_with_the_mass_of_the_same_wave() -> None:
    start = (0.03, 0.03, 64.0, 6.8, 1e-4, 0.0)
    masses = [item[3] for item in tread_effect().nearer(0, start, (CONDITIONS,))]
    assert min(masses) < 0.7 * 6.8 < 1.4 * 6.8 < max(masses)
    results = {item[2]: item[3] for item in tread_effect().nearer(1, start, (CONDITIONS,))}
    assert set(results) >= {60.0, 64.0, 67.0, 70.0}
    assert results[60.0] > 1.5 * results[64.0] > 1.5 * results[67.0]
    assert results[67.0] == pytest.approx(3.7, rel=0.15)


def test_mass_of_a_wave_is_that_of_its_belt() -> None:
    bending, tension, mass, omega, radius = 6.8, 4200.0, 3.5, 52.0, 0.32
    wave = belt_wave(BlockTread(67.0, bending / mass, tension / mass, 0.0, 0.0), 0, omega, radius)
    # The dispersion has a sidewall of its own, of little weight.
    result = mass_of_wave(wave.order, 67.0, bending, tension, 1.8e5 * mass, omega, radius)
    assert result == pytest.approx(mass, rel=0.01)
    assert np.isnan(mass_of_wave(67.0, 67.0, bending, tension, 6e5, omega, radius))


def test_reverse_sees_the_mirror_image_of_the_pattern() -> None:
    forward, back = block_of(), block_of(replace(CONDITIONS, reverse=True))
    cosine, sine = (np.array([*pair, *TRUTH[2:]]) for pair in ((0.04, 0.0), (0.0, 0.04)))
    assert tread_effect().contribution(back, cosine) == pytest.approx(tread_effect().contribution(forward, cosine))
    assert tread_effect().contribution(back, sine) == pytest.approx(-tread_effect().contribution(forward, sine))


def test_sensor_on_the_middle_line_still_moves_along_the_belt() -> None:
    """The belt's vibration has a part along it, unlike the steady shape of an inextensible belt."""
    made = tread_effect().contribution(block_of(), TRUTH)
    assert 0.01 < np.linalg.norm(made[CIRCUMFERENTIAL]) / np.linalg.norm(made[RADIAL]) < 0.5


def test_model_without_a_belt_has_no_excitation() -> None:
    block = replace(block_of(), belt=None)
    assert not tread_effect().contribution(block, TRUTH).any()
    assert not tread_effect().derivative(block, TRUTH).any()
    assert NAME in candidates(BaselineModel.EXACT)
    assert NAME not in candidates(BaselineModel.PAPER)
