"""Accuracy of the ring paper's estimator and of the contact edges on the geometrically exact ring.

Prints the tables of docs/explanation/ring-paper-estimator.md. Run: python tools/bench_ring_paper.py
"""

import itertools
import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy.interpolate import CubicSpline

from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.estimates.estimator import Revolution, TireConditions
from gateway.core.estimates.revolution_block import extended
from gateway.core.revolutions import contact_edges as contact
from gateway.core.revolutions.angle_resampling import GRID_SIZE, fit_phase, resample_revolutions
from gateway.core.revolutions.order_spectrum import order_coefficients
from gateway.core.revolutions.speed_normalisation import normalise_revolutions
from gateway.core.revolutions.synchronous_average import RunningAverage
from gateway.core.ring_quantities import RING_NUMBERS
from gateway.core.types import FloatArray
from gateway.papers.ring_data import waveform_revolution
from gateway.papers.ring_paper import RingPaperEstimator, fit_ring_numbers
from gateway.ring.reference_tire import TABLE_3_NUMBERS
from gateway.ring.rolling_ring import RingParameters, RingSolution, solve_rolling_ring

RADIUS_M, SPEED_KMH, RATE_HZ = 0.32, 65.0, 9600.0
OMEGA = SPEED_KMH / 3.6 / RADIUS_M
BASE = RingParameters.from_numbers(*TABLE_3_NUMBERS, radius_m=RADIUS_M, pressure_pa=2.1e5)
LOADS_N, PRESSURES_PA, WEAR_MM = (2000.0, 5000.0, 8000.0), (1.7e5, 2.1e5, 2.5e5), (0.0, 2.9, 6.4)
ORDERS = np.arange(1.0, 61.0)
NOISE_MPS2 = 5e-3 * STANDARD_GRAVITY_MPS2 * math.sqrt(RATE_HZ / 2.0)  # 5 mg/rtHz


def ring_at(wear_mm: float, pressure_pa: float) -> RingParameters:
    """A 15 mm ring worn down: EI with its cube, sidewall half proportional to the pressure."""
    sidewall = 0.5 + 0.5 * pressure_pa / 2.1e5
    return replace(
        BASE,
        bending_stiffness_nm2=BASE.bending_stiffness_nm2 * ((15.0 - wear_mm) / 15.0) ** 3,
        radial_stiffness_npm2=BASE.radial_stiffness_npm2 * sidewall,
        tangential_stiffness_npm2=BASE.tangential_stiffness_npm2 * sidewall,
    )


def paper_grid() -> Iterator[RingSolution]:
    """The conditions of Table 1."""
    for wear, pressure, load in itertools.product(WEAR_MM, PRESSURES_PA, LOADS_N):
        yield solve_rolling_ring(ring_at(wear, pressure), load, pressure, OMEGA, nodes=1440)


def other_tires() -> Iterator[RingSolution]:
    """Treads, belts and sidewalls that the paper's grid does not have."""
    for load in (2000.0, 3500.0, 5000.0, 8000.0):
        for change in (
            {"tread_stiffness_npm2": 2e7},
            {"tread_stiffness_npm2": 2e8},
            {"tread_damping_nspm2": 2e4},
            {"foundation_damping_nspm2": 200.0},
            {"bending_stiffness_nm2": 2.0 * BASE.bending_stiffness_nm2},
            {"tension_width_m": 0.7 * BASE.tension_width_m},
            {"radial_stiffness_npm2": 1.5 * BASE.radial_stiffness_npm2},
            {"shear_stiffness_n": 2e5},
        ):
            yield solve_rolling_ring(replace(BASE, **change), load, 2.1e5, OMEGA, nodes=1440)
        yield solve_rolling_ring(BASE, load, 2.1e5, OMEGA, nodes=1440, sensor_offset_m=0.01)


def grid_wave(solution: RingSolution) -> FloatArray:
    spectrum = np.fft.rfft(solution.sensor.radial_m)[: GRID_SIZE // 2 + 1]
    spectrum[-1] = 0.0
    return OMEGA**2 * np.fft.irfft(spectrum, n=GRID_SIZE) * (GRID_SIZE / len(solution.sensor.radial_m))


def ratio_with_truth_given(solution: RingSolution) -> tuple[FloatArray, float]:
    """Return estimated over true numbers and the residual, with no noise and the true contact angle."""
    fit = fit_ring_numbers(
        ORDERS,
        order_coefficients(grid_wave(solution))[1:].real / OMEGA**2,
        np.full(60, np.nan),
        force_m=solution.load_n / (math.pi * solution.pressure_pa * RADIUS_M * solution.half_angle_rad),
        half_angle_rad=solution.half_angle_rad,
    )
    if fit is None:
        raise ValueError("the exact ring's orders cannot be fitted")
    return fit.numbers / np.array(solution.numbers), fit.residual_share


def sampled(solution: RingSolution, revolutions: int, seed: int) -> tuple[FloatArray, FloatArray]:
    """Return radial samples with gravity and noise, and the contact centres' sample positions."""
    theta = np.append(solution.theta_rad, math.pi)
    radial, _ = solution.sensor.specific_force(OMEGA)
    centres = 40.37 + 2.0 * math.pi / OMEGA * RATE_HZ * np.arange(revolutions + 1)
    angle = OMEGA / RATE_HZ * (np.arange(int(centres[-1]) + 60) - 40.37)
    curve = CubicSpline(theta, np.append(radial, radial[0]), bc_type="periodic")
    samples = curve((angle + math.pi) % (2.0 * math.pi) - math.pi)
    return samples + np.random.default_rng(seed).normal(size=len(samples)) * NOISE_MPS2, centres


def revolution_of(samples: FloatArray, start: float, end: float, previous: float) -> Revolution:
    phase = fit_phase(start, end, previous)
    (wave,) = normalise_revolutions(resample_revolutions([samples[:, np.newaxis]], [phase])[:, 0], [phase]).radial_mps2
    omega_radps = 2.0 * math.pi * RATE_HZ / phase.samples
    return waveform_revolution(wave, samples=phase.samples, omega_radps=omega_radps)


def print_model_error(solutions: list[RingSolution]) -> None:
    print("Estimated / true, no noise, true contact angle and load; new tire, 2.1 bar, orders 1-60")
    print(f"{'load N':>8}{'half rad':>10}" + "".join(f"{name:>8}" for name in RING_NUMBERS) + f"{'residual':>10}")
    ratios = []
    for solution in solutions:
        ratio, residual = ratio_with_truth_given(solution)
        ratios.append(ratio)
        if solution.pressure_pa == 2.1e5 and solution.ring == ring_at(0.0, 2.1e5):
            row = "".join(f"{value:8.2f}" for value in ratio)
            print(f"{solution.load_n:8.0f}{solution.half_angle_rad:10.4f}{row}{100 * residual:8.1f} %")
    rms = np.sqrt(np.mean(np.square(np.array(ratios) - 1.0), axis=0))
    print(
        f"rms error over the {len(ratios)} conditions of Table 1: " + " ".join(f"{100 * value:.0f} %" for value in rms)
    )


def print_whole_chain() -> None:
    print(f"\nWhole chain: {RATE_HZ:.0f} Hz, {SPEED_KMH:.0f} km/h, gravity, 5 mg/rtHz, average of 20 revolutions")
    print("load N    half/true  " + "".join(f"{name + ' /true (stated)':>22}" for name in RING_NUMBERS))
    for load in LOADS_N:
        solution = solve_rolling_ring(BASE, load, 2.1e5, OMEGA, nodes=1440)
        samples, centres = sampled(solution, 22, seed=1)
        average, estimator = RunningAverage(), RingPaperEstimator()
        for previous, start, end in zip(centres, centres[1:], centres[2:], strict=False):
            revolution = revolution_of(samples, start, end, previous)
            result = extended(average, revolution)
            estimates = estimator.update(revolution, result, TireConditions(RADIUS_M, load, 2.1e5))
        half = 0.5 * (result.trailing_edge_rad - result.leading_edge_rad) / solution.half_angle_rad
        row = "".join(
            f"{e.value / t:14.2f} ({e.std / t:.2f})" for e, t in zip(estimates, solution.numbers, strict=False)
        )
        print(f"{load:6.0f}{half:13.3f}  {row}")


def print_edge_errors(paper: list[RingSolution], others: list[RingSolution]) -> None:
    print("\nError of the contact edges, positive outward, mrad (mean and spread), against the smoothing in orders")
    print(f"{'orders':>8}{'Table 1 grid':>18}{'with other tires':>20}{'range':>16}{'stated':>10}")
    for width in (15.0, 20.0, 25.0, 30.0, 40.0):
        samples = width / 0.3  # as few as make the smoothing this wide
        errors, stated = [], 0.0
        for solution in [*paper, *others]:
            edges = contact.find_contact_edges(grid_wave(solution), samples, noise_coefficient_mps2=1e-6)
            errors.append(
                (solution.leading_edge_rad - edges.leading_rad, edges.trailing_rad - solution.trailing_edge_rad)
            )
            stated = edges.leading_std_rad
        mrad = 1e3 * np.array(errors)
        grid = mrad[: len(paper)]
        print(
            f"{width:8.0f}{grid.mean():12.1f} +-{grid.std():4.1f}{mrad.mean():14.1f} +-{mrad.std():4.1f}"
            f"{mrad.min():10.1f} ..{mrad.max():5.1f}{1e3 * stated:10.1f}"
        )


def main() -> None:
    paper, others = list(paper_grid()), list(other_tires())
    print_model_error(paper)
    print_whole_chain()
    print_edge_errors(paper, others)


if __name__ == "__main__":
    main()
