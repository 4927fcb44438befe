"""Effects of the stage BELT and run-out against the simulator, and the geometry of the belt that they use."""

import math
from dataclasses import replace

import numpy as np
import pytest

from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.types import FloatArray
from gateway.diagnosis.effects.belt_geometry import (
    from_mid_revolution,
    gravity_projections,
    inclination,
    relative_offset,
    slopes,
    spin_projections,
)
from gateway.diagnosis.effects.catalogue import candidates, catalogue
from gateway.diagnosis.effects.effect import CIRCUMFERENTIAL, RADIAL, BaselineModel, ModelledBlock, RingEffect
from gateway.diagnosis.effects.ring_options import RingOptions
from gateway.diagnosis.model.exact_baseline import ExactCore
from gateway.diagnosis.model.sensor_signal import base_signal
from tests.diagnosis.belt_data import (
    CONDITIONS,
    EXTENSION_N,
    OMEGA,
    RADIUS_M,
    THETA,
    averaged,
    block_of,
    limited,
    rolling_at,
)
from tests.diagnosis.sensor_data import effect_of, rms

MIRRORED = {"tread pitch": (0.01, -0.02, 71.3, 0.3), "imbalance and hub motion": (1e-3, -5e-4, 0.0)}


def unlike(simulated: FloatArray, ours: FloatArray, block: ModelledBlock, axes: tuple[int, ...] = (0, 2)) -> float:
    """Return the relative difference of a simulated change and ours, apart from a shift of the whole waveform."""
    rows = list(axes)
    remainder = (limited(simulated) - limited(ours))[rows].reshape(-1)
    slope = limited(slopes(block.signal_mps2)[0])[rows].reshape(-1)
    remainder = remainder - slope * float(remainder @ slope) / float(slope @ slope)
    return rms(remainder) / rms(limited(simulated)[rows])


def test_corrected_models_contain_gravity_and_acceleration() -> None:
    in_every_model = {"gravity", "speed drift"}
    assert in_every_model <= set(candidates(BaselineModel.PAPER))
    exact = set(candidates(BaselineModel.EXACT))
    assert not in_every_model & exact
    assert {"torsional ripple", "tread pitch"} <= exact
    assert "run-out" not in candidates(BaselineModel.PAPER)


def test_inclination_from_curvature_matches_the_solver() -> None:
    solved, paper = block_of(), block_of(as_paper=True)
    psi = inclination(paper)
    assert np.abs(psi[np.abs(THETA) < 0.1]).max() < 0.02
    assert gravity_projections(paper) == pytest.approx(gravity_projections(solved), abs=4e-3)
    assert spin_projections(paper) == pytest.approx(spin_projections(solved), abs=4e-3 * RADIUS_M)


@pytest.mark.parametrize("offset_m", [3e-3, 8e-3, -4e-3])
def test_offset_is_estimated_from_the_circumferential_axis(offset_m: float) -> None:
    assert relative_offset(block_of(offset_m=offset_m)) == pytest.approx(offset_m / RADIUS_M, rel=0.02)
    assert relative_offset(block_of()) == 0.0


def test_acceleration_sawtooth_jumps_in_the_contact() -> None:
    since = from_mid_revolution(THETA)
    middle = len(THETA) // 2
    assert since[middle - 1] == pytest.approx(math.pi, abs=0.02)
    assert since[middle] == pytest.approx(-math.pi)
    assert since[0] == pytest.approx(0.0)


def test_gravity_matches_the_simulator_at_low_speed() -> None:
    slow, fast = averaged(speed="40.0"), averaged(speed="100.0")
    difference = (slow.axes_mps2 - fast.axes_mps2) / (slow.gravity - fast.gravity)
    ours = effect_of("gravity").contribution(block_of(as_paper=True), np.ones(1))
    assert unlike(difference, ours, block_of()) < 0.02


@pytest.mark.parametrize("as_paper", [True, False])
def test_angular_acceleration_matches_the_simulator(as_paper: bool) -> None:
    gaining = averaged(speed="[[0, 50], [10, 80]]", duration_s=10.0)
    losing = averaged(speed="[[0, 80], [10, 50]]", duration_s=10.0)
    assert gaining.omega_dot_radps2 > 2.0 > -2.0 > losing.omega_dot_radps2
    difference = 0.5 * (gaining.axes_mps2 - losing.axes_mps2)
    weight = 0.5 * (gaining.gravity - losing.gravity) * STANDARD_GRAVITY_MPS2
    difference[[CIRCUMFERENTIAL, RADIAL]] -= weight * gravity_projections(block_of())
    change = 0.5 * (gaining.omega_dot_radps2 - losing.omega_dot_radps2)
    block = block_of(replace(CONDITIONS, omega_dot_radps2=change), as_paper=as_paper)
    ours = effect_of("speed drift").contribution(block, np.ones(1))
    assert unlike(difference, ours, block_of()) < 0.06


@pytest.mark.parametrize(("order", "phase_deg"), [(1, 70.0), (2, 0.0), (2, 70.0), (3, 200.0), (12, 70.0)])
def test_ripple_matches_the_simulator(order: int, phase_deg: float) -> None:
    share, phase = 0.005, math.radians(phase_deg)
    table = f"[wheel.vibration]\nripple_percent = 0.5\nripple_order = {order}.0\nripple_deg = {phase_deg}"
    # The scenario's angle is that without ripple; ours begins at the contact.
    begin = 0.0
    for _ in range(30):
        begin = -share / order * math.sin(order * begin + phase)
    position = phase + order * begin
    parameters = np.array([share * math.cos(position), -share * math.sin(position), order])
    ours = effect_of("torsional ripple").contribution(block_of(), parameters)
    assert unlike(averaged(table).axes_mps2 - averaged().axes_mps2, ours, block_of()) < 0.02


def test_ripple_of_two_percent_is_nonlinear_and_accurate() -> None:
    effect, block = effect_of("torsional ripple"), block_of()
    table = "[wheel.vibration]\nripple_percent = 2.0\nripple_order = 1.0"
    change = averaged(table).axes_mps2 - averaged().axes_mps2
    linear = effect.derivative(block, np.array([0.0, 0.0, 1.0]))[0] * 0.02
    exact = unlike(change, effect.contribution(block, np.array([0.02, 0.0, 1.0])), block)
    assert exact < 0.006
    assert unlike(change, linear, block) > 2.0 * exact


@pytest.mark.parametrize("speed", ["65.0", "40.0"])
def test_imbalance_matches_the_simulator_at_any_speed(speed: str) -> None:
    table = "[wheel.vibration]\nimbalance_mps2 = 12.0\nimbalance_deg = 40.0"
    size, phase = 12.0 / OMEGA**2, math.radians(40.0)
    conditions = rolling_at(float(speed))
    ours = effect_of("imbalance and hub motion").contribution(
        block_of(conditions), np.array([size * math.cos(phase), -size * math.sin(phase), 0.0])
    )
    change = averaged(table, speed=speed).axes_mps2 - averaged(speed=speed).axes_mps2
    assert unlike(change, ours * (OMEGA / conditions.omega_radps) ** 2, block_of()) < 0.03


@pytest.mark.parametrize("offset_mm", [0.0, 8.0])
def test_edge_waves_match_the_simulator(offset_mm: float) -> None:
    table = (
        "[wheel.edge_waves]\namplitude_percent = 2.0\norder_before = 33.0\norder_after = 46.0\n"
        "decay_rad = 0.8\nphase_deg = 30.0"
    )
    cosine, sine = 0.02 * math.cos(math.radians(30.0)), -0.02 * math.sin(math.radians(30.0))
    block = block_of(offset_m=1e-3 * offset_mm)
    parameters = np.array([cosine, sine, 33.0, 1.25, cosine, sine, 46.0, 1.25])
    change = averaged(table, offset_mm=offset_mm).axes_mps2 - averaged(offset_mm=offset_mm).axes_mps2
    assert unlike(change, effect_of("tire-locked edge waves").contribution(block, parameters), block) < 0.03


@pytest.mark.parametrize("offset_mm", [0.0, 8.0])
def test_tread_pitch_matches_the_simulator(offset_mm: float) -> None:
    table = "[wheel.tread_pitch]\namplitude_percent = 1.0\nblocks = 70.0\nreach_rad = 0.3\nphase_deg = 50.0"
    cosine, sine = 0.01 * math.cos(math.radians(50.0)), -0.01 * math.sin(math.radians(50.0))
    block = block_of(offset_m=1e-3 * offset_mm)
    change = averaged(table, offset_mm=offset_mm).axes_mps2 - averaged(offset_mm=offset_mm).axes_mps2
    ours = effect_of("tread pitch").contribution(block, np.array([cosine, sine, 70.0, 0.3]))
    assert unlike(change, ours, block) < 0.04


def test_pattern_and_heavy_spot_are_mirrored_in_reverse() -> None:
    mirrored = np.roll(THETA[::-1], 1)
    assert mirrored[1:] == pytest.approx(-THETA[1:])
    for name, parameters in MIRRORED.items():
        effect, values = effect_of(name), np.array(parameters)
        ahead = effect.contribution(block_of(), values)[RADIAL]
        back = effect.contribution(block_of(replace(CONDITIONS, reverse=True)), values)[RADIAL]
        assert back == pytest.approx(np.roll(ahead[::-1], 1), abs=2e-3 * np.abs(ahead).max())
        assert rms(back - ahead) > 0.1 * rms(ahead)


@pytest.mark.parametrize(("height_mm", "high_spot_deg"), [(0.5, 0.0), (0.5, 90.0), (1.5, 200.0)])
def test_run_out_matches_the_simulator(height_mm: float, high_spot_deg: float) -> None:
    height, angle = 1e-3 * height_mm, math.radians(high_spot_deg)
    effect = catalogue()["run-out"]
    assert isinstance(effect, RingEffect)
    core, plain = ExactCore(), RingOptions(extension_stiffness_n=EXTENSION_N)
    core.refine(np.zeros(5), CONDITIONS, plain)
    parameters = np.array([height * math.cos(angle), -height * math.sin(angle)])
    assert effect.options(plain, np.zeros(2), CONDITIONS) == plain

    def signal(options: RingOptions) -> FloatArray:
        return base_signal(core, core.shape(np.zeros(5), CONDITIONS, options, 0.24), CONDITIONS).signal_mps2

    ours = signal(effect.options(plain, parameters, CONDITIONS)) - signal(plain)
    table = f"[wheel.tire]\nrunout_mm = {height_mm}\nrunout_deg = {high_spot_deg}"
    change = averaged(table).axes_mps2 - averaged().axes_mps2
    assert unlike(change, ours, block_of(), axes=(RADIAL,)) < 0.05
    reverse = effect.options(plain, parameters, replace(CONDITIONS, reverse=True))
    assert reverse.runout_sine_m == -effect.options(plain, parameters, CONDITIONS).runout_sine_m
