import itertools
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.revolutions.angle_resampling import angle_grid, fit_phase
from gateway.core.revolutions.contact_edges import EDGE_MODEL_STD_RAD, contact_interior, find_contact_edges
from gateway.core.revolutions.edge_distance import EdgePlace, edge_among_waves, edge_distance, model_std_rad
from tests.testkit.exact_ring import BASE_RING, omega_at, on_grid, sampled, solution
from tests.testkit.single_revolution import normalise_radial, resample_revolution

MEASURED = Path(__file__).parents[3] / ".." / "shared" / "measured" / "innerliner_drum_80kmh.csv"


def clean_wave(load_n: float = 5000.0, **others: object) -> np.ndarray:
    return omega_at(65.0) ** 2 * on_grid(solution(load_n, **others).sensor.radial_m)


@pytest.mark.parametrize("load_n", [2000.0, 5000.0, 8000.0])
@pytest.mark.parametrize("pressure_pa", [1.7e5, 2.5e5])
def test_edges_match_exact_ring(load_n: float, pressure_pa: float) -> None:
    truth = solution(load_n, pressure_pa)
    edges = find_contact_edges(clean_wave(load_n, pressure_pa=pressure_pa), 1069.0)
    assert edges.measured
    # Ring and tread as in the paper: well inside the standard deviation for unknown treads.
    assert edges.leading_rad == pytest.approx(truth.leading_edge_rad, abs=0.8 * EDGE_MODEL_STD_RAD)
    assert edges.trailing_rad == pytest.approx(truth.trailing_edge_rad, abs=0.8 * EDGE_MODEL_STD_RAD)
    assert edges.trailing_std_rad >= EDGE_MODEL_STD_RAD
    assert edges.baseline_mps2 == pytest.approx(omega_at(65.0) ** 2 * 0.32, rel=0.02)


@pytest.mark.parametrize("tread", [2e7, 2e8])
@pytest.mark.parametrize("load_n", [3500.0, 8000.0])
def test_edge_error_covers_unknown_tread(tread: float, load_n: float) -> None:
    ring = replace(BASE_RING, tread_stiffness_npm2=tread)
    truth = solution(load_n, ring=ring)
    edges = find_contact_edges(clean_wave(load_n, ring=ring), 1069.0)
    assert edges.trailing_rad == pytest.approx(truth.trailing_edge_rad, abs=2.0 * edges.trailing_std_rad)
    assert edges.trailing_std_rad < 1.75 * EDGE_MODEL_STD_RAD


def test_damped_tread_shifts_edges() -> None:
    ring = replace(BASE_RING, tread_damping_nspm2=2e4)
    truth = solution(ring=ring)
    edges = find_contact_edges(clean_wave(ring=ring), 1069.0)
    assert truth.contact_centre_rad < -0.002
    assert edges.leading_rad == pytest.approx(truth.leading_edge_rad, abs=1.5 * EDGE_MODEL_STD_RAD)
    assert edges.trailing_rad == pytest.approx(truth.trailing_edge_rad, abs=1.5 * EDGE_MODEL_STD_RAD)


@settings(max_examples=25)
@given(constant=st.floats(-5e3, 5e3), gain=st.floats(0.01, 100.0))
def test_edges_ignore_coupling_and_gain(constant: float, gain: float) -> None:
    wave = clean_wave()
    reference = find_contact_edges(wave, 1069.0, 0.1)
    edges = find_contact_edges(gain * wave + constant, 1069.0, 0.1 * gain)
    assert edges.leading_rad == pytest.approx(reference.leading_rad, abs=1e-6)
    assert edges.trailing_rad == pytest.approx(reference.trailing_rad, abs=1e-6)
    assert edges.contrast == pytest.approx(reference.contrast, rel=1e-6)


def test_reversed_waveform_swaps_edges() -> None:
    wave = clean_wave(ring=replace(BASE_RING, tread_damping_nspm2=2e4))
    forward = find_contact_edges(wave, 1069.0, 0.1)
    mirrored = find_contact_edges(np.roll(wave[::-1], 1), 1069.0, 0.1)
    assert mirrored.leading_rad == pytest.approx(-forward.trailing_rad, abs=1e-9)
    assert mirrored.trailing_rad == pytest.approx(-forward.leading_rad, abs=1e-9)


@settings(max_examples=20)
@given(shift=st.floats(-0.08, 0.08))
def test_edges_follow_contact_centre(shift: float) -> None:
    spectrum = np.fft.rfft(clean_wave())
    spectrum *= np.exp(-1j * np.arange(513) * shift)
    wave = np.fft.irfft(spectrum, n=1024)
    reference = find_contact_edges(clean_wave(), 1069.0, 0.1)
    edges = find_contact_edges(wave, 1069.0, 0.1)
    assert edges.leading_rad == pytest.approx(reference.leading_rad + shift, abs=5e-4)
    assert edges.trailing_rad == pytest.approx(reference.trailing_rad + shift, abs=5e-4)


@pytest.mark.parametrize(
    ("rate_hz", "speed_kmh", "noise_mps2"),
    [
        (9600.0, 65.0, 3.4),  # 5 mg/rtHz
        (9600.0, 10.0, 3.4),
        (2000.0, 65.0, 1.55),
        (2000.0, 120.0, 1.55),
        (2000.0, 250.0, 1.55),
        (25600.0, 80.0, 16.6),  # 15 mg/rtHz
    ],
)
@pytest.mark.parametrize("ac_coupled", [False, True])
def test_edges_from_time_samples(rate_hz: float, speed_kmh: float, noise_mps2: float, ac_coupled: bool) -> None:
    truth = solution()
    errors = []
    for seed in range(6):
        samples, contacts = sampled(truth, rate_hz, speed_kmh, noise_mps2=noise_mps2, seed=seed)
        radial = samples[:, 1:] - (samples[:, 1:].mean() if ac_coupled else 0.0)
        phase = fit_phase(contacts[1], contacts[2], contacts[0])
        wave = normalise_radial(resample_revolution(radial, phase)[0], phase, ac_coupled=ac_coupled).radial_mps2
        edges = find_contact_edges(wave, phase.samples)
        assert edges.measured, edges.reason
        for result, true, std in (
            (edges.leading_rad, truth.leading_edge_rad, edges.leading_std_rad),
            (edges.trailing_rad, truth.trailing_edge_rad, edges.trailing_std_rad),
        ):
            errors.append((result - true) / std)
    assert float(np.sqrt(np.mean(np.square(errors)))) < 1.5
    assert float(np.abs(errors).max()) < 4.0


@pytest.mark.parametrize(("speed_kmh", "noise_mps2"), [(65.0, 10.0), (20.0, 5.0)])
def test_edge_noise_error_matches_scatter(speed_kmh: float, noise_mps2: float) -> None:
    rng = np.random.default_rng(11)
    wave = (omega_at(speed_kmh) / omega_at(65.0)) ** 2 * clean_wave()
    results = [find_contact_edges(wave + rng.normal(size=1024) * noise_mps2, 1024.0) for _ in range(300)]
    scatter = np.std([edges.leading_rad for edges in results])
    stated = np.mean([edges.leading_noise_std_rad for edges in results])
    # Noise of the steepest slope and of the shape next to it are added as if they were independent, and where the edges
    # of both smoothings differ by noise, the stronger smoothing counts.
    assert 0.9 * scatter < stated < 1.75 * scatter


def test_coarse_sampling_increases_edge_error() -> None:
    widths = [15.0, 20.0, 30.0, 40.0]
    spreads = [model_std_rad(width) for width in widths]
    assert spreads == sorted(spreads, reverse=True)


@pytest.mark.parametrize("kind", ["flat", "noise", "nan", "bump", "tone"])
def test_missing_contact_is_reported(kind: str) -> None:
    theta = angle_grid(1024)
    wave = {
        "flat": np.full(1024, 12.0),
        "noise": np.random.default_rng(1).normal(size=1024),
        "nan": np.where(theta > 1.0, np.nan, clean_wave()),
        "bump": np.exp(-((theta / 0.2) ** 2)),
        "tone": np.cos(theta),
    }[kind]
    edges = find_contact_edges(wave, 1024.0)
    assert not edges.measured
    assert edges.reason
    assert math.isnan(edges.leading_rad)
    assert math.isnan(edges.trailing_std_rad)
    assert contact_interior(wave, 1024.0) is None


def test_edges_of_measured_tire() -> None:
    if not MEASURED.exists():
        pytest.skip("the measured recording is not kept with the project")
    radial = np.loadtxt(MEASURED, delimiter=",", skiprows=1)[:, 3] * STANDARD_GRAVITY_MPS2
    # Contact centres midway between the half-level crossings, read from the recording.
    contacts = [2528.5, 4803.5, 7076.5, 9344.5, 11610.5]
    halves = []
    for start, end in itertools.pairwise(contacts):
        phase = fit_phase(start, end)
        wave = normalise_radial(resample_revolution(radial[:, np.newaxis], phase)[0], phase, ac_coupled=True)
        edges = find_contact_edges(wave.radial_mps2, phase.samples)
        assert edges.measured
        # 152.7 g from contact to baseline, read from the recording by hand.
        assert edges.baseline_mps2 - edges.plateau_mps2 == pytest.approx(152.7 * STANDARD_GRAVITY_MPS2, rel=0.03)
        halves.append(0.5 * (edges.trailing_rad - edges.leading_rad))
    # The half-level crossings are 20.9 degrees apart; the edges lie outside them.
    assert all(math.radians(20.9) / 2.0 < half < math.radians(20.9) / 2.0 + 0.05 for half in halves)
    # In one revolution the leading edge comes late, and waves of the belt distort it.
    assert np.std(halves) < 0.012


@pytest.mark.parametrize("load_n", [500.0, 1000.0])
def test_edges_of_a_light_load_are_within_their_error(load_n: float) -> None:
    truth = solution(load_n)
    edges = find_contact_edges(clean_wave(load_n), 1069.0)
    assert edges.trailing_rad == pytest.approx(truth.trailing_edge_rad, abs=2.0 * edges.trailing_std_rad)


@pytest.mark.parametrize("tread_mpa", [15.0, 400.0])
def test_edges_follow_soft_and_stiff_treads(tread_mpa: float) -> None:
    ring = replace(BASE_RING, tread_stiffness_npm2=1e6 * tread_mpa)
    truth = solution(ring=ring)
    edges = find_contact_edges(clean_wave(ring=ring), 1069.0)
    assert edges.trailing_rad == pytest.approx(truth.trailing_edge_rad, abs=2.0 * edges.trailing_std_rad)


def test_waves_of_the_free_belt_widen_the_edge_error() -> None:
    wave = clean_wave()
    beyond = np.maximum(np.abs(angle_grid(1024)) - 0.3, 0.0)
    waves = 0.12 * wave.mean() * np.exp(-beyond / 0.9) * np.cos(40.0 * angle_grid(1024)) * (beyond > 0.0)
    smooth, wavy = find_contact_edges(wave, 1069.0), find_contact_edges(wave + waves, 1069.0)
    truth = solution()
    assert wavy.trailing_std_rad > 2.0 * smooth.trailing_std_rad
    assert wavy.trailing_rad == pytest.approx(truth.trailing_edge_rad, abs=2.0 * wavy.trailing_std_rad)


@pytest.mark.parametrize("phase_rad", np.arange(0.0, 6.0, 1.0))
@pytest.mark.parametrize("order", [55.0, 67.0, 81.0])
def test_waves_in_the_contact_do_not_move_the_edges(order: float, phase_rad: float) -> None:
    wave, truth, theta = clean_wave(), solution(), angle_grid(1024)
    inside = (theta > truth.leading_edge_rad) & (theta < truth.trailing_edge_rad)
    spectrum = np.fft.rfft(np.where(inside, np.cos(order * theta + phase_rad), 0.0))
    swinging = np.fft.irfft(spectrum * np.exp(-0.5 * (np.arange(513) / 80.0) ** 2), n=1024)
    edges = find_contact_edges(wave + 0.1 * wave.mean() * swinging, 1069.0)
    # A single smoothing to 40 orders is up to half of the half angle off, with stated errors of 0.004 rad.
    assert abs(edges.leading_rad - truth.leading_edge_rad) < min(3.0 * edges.leading_std_rad, 0.03)
    assert abs(edges.trailing_rad - truth.trailing_edge_rad) < min(3.0 * edges.trailing_std_rad, 0.03)


def test_edges_that_differ_by_smoothing_are_less_certain() -> None:
    usual, near, far = (EdgePlace(40.0, 0.2 + shift, 0.0, model_std_rad(40.0)) for shift in (0.0, 0.003, 0.05))
    stronger = [EdgePlace(width, 0.2, 0.0, model_std_rad(width)) for width in (20.0, 15.0)]
    same, close, moved = (edge_among_waves([position, *stronger], 0.0) for position in (usual, near, far))
    assert same.model_std_rad == pytest.approx(usual.model_std_rad, rel=1e-9)
    assert close.angle_rad == pytest.approx(near.angle_rad, abs=1e-4)
    assert close.model_std_rad < 1.1 * usual.model_std_rad
    assert moved.angle_rad == pytest.approx(0.2, abs=1e-3)
    assert moved.model_std_rad > 2.0 * usual.model_std_rad
    rippled = edge_among_waves([near, *stronger], 0.02)
    assert rippled.angle_rad == pytest.approx(0.2, abs=1e-4)


def test_noisy_shape_counts_less() -> None:
    usual = np.array([0.213, 0.079, 0.110, 0.056])
    odd = usual + 0.02
    clear, noisy = (edge_distance(40.0, odd, np.full(4, noise)) for noise in (1e-6, 1.0))
    mean = edge_distance(40.0, usual, np.full(4, 1e-6))
    assert abs(clear.distance_rad - mean.distance_rad) > 0.01
    assert noisy.distance_rad == pytest.approx(mean.distance_rad, abs=1e-3)
    assert noisy.model_std_rad > 2.0 * clear.model_std_rad
    missing = edge_distance(40.0, np.full(4, math.inf), np.full(4, math.inf))
    assert missing.distance_rad == pytest.approx(noisy.distance_rad, abs=1e-3)


def test_average_of_two_loads_widens_the_edge_error() -> None:
    light, heavy = clean_wave(4000.0), clean_wave(6000.0)
    average, scatter = 0.5 * (light + heavy), 0.5 * np.abs(heavy - light)
    plain = find_contact_edges(average, 1069.0)
    smeared = find_contact_edges(average, 1069.0, scatter_mps2=scatter)
    between = 0.5 * (solution(4000.0).trailing_edge_rad + solution(6000.0).trailing_edge_rad)
    assert smeared.trailing_std_rad > 2.0 * plain.trailing_std_rad
    assert abs(smeared.trailing_rad - between) < 2.0 * smeared.trailing_std_rad
