"""Vibration that tread blocks excite: against a belt of finite elements, the free belt's dispersion, and limits."""

import math
from functools import cache

import numpy as np
import pytest

from gateway.core.types import ComplexArray
from gateway.diagnosis.effects.belt_dispersion import BlockTread, belt_wave
from gateway.ring.reference_tire import TABLE_3_NUMBERS
from gateway.ring.rolling_ring import (
    RingParameters,
    RingSolution,
    TreadBlocks,
    block_response,
    loaded_belt,
    solve_rolling_ring,
)
from gateway.ring.rolling_ring.sensor_waveform import waveform_orders

RADIUS_M, PRESSURE_PA, MASS_KGPM, BLOCKS = 0.32, 2.1e5, 3.5, 67.0
OFFSET_M = 4e-3
EI = TABLE_3_NUMBERS[0] * RADIUS_M**4 * PRESSURE_PA
LOSSES = TreadBlocks(BLOCKS, MASS_KGPM, 1e-4 / EI, 0.0)
# Belts of 120 finite elements with 67 blocks of 5 %, integrated in time with 4096 steps a revolution by
# tools/independent_tire: load, N, and radial and circumferential orders of a sensor 4 mm deep, m/s^2.
FINITE_ELEMENTS = {
    60.0: (
        4047.4,
        {
            50: (-0.97 + 0.50j, -0.20 - 0.20j),
            53: (-1.51 + 3.15j, -0.90 - 0.47j),
            56: (0.50 - 1.24j, 0.39 - 0.05j),
            65: (-0.22 + 0.68j, -0.23 - 0.31j),
            71: (-0.70 + 1.57j, 0.26 + 0.10j),
            77: (-1.13 + 1.47j, 0.27 + 0.27j),
            83: (-5.14 + 0.35j, 0.05 + 1.24j),
        },
    ),
    75.0: (
        4047.6,
        {
            53: (1.64 - 3.02j, 0.82 + 0.28j),
            59: (2.13 - 0.50j, 0.16 - 0.16j),
            65: (4.22 + 0.61j, 0.02 + 0.24j),
            71: (5.49 + 2.03j, 0.16 - 0.42j),
            77: (4.59 + 3.13j, 0.40 - 0.50j),
            83: (2.21 + 4.55j, 1.01 - 0.42j),
            86: (-11.11 + 11.29j, 2.98 + 3.04j),
        },
    ),
}


@cache
def rolling(speed_kmh: float, load_n: float = 4047.4, nodes: int = 960, shear_n: float = math.inf) -> RingSolution:
    ring = RingParameters.from_numbers(
        *TABLE_3_NUMBERS, radius_m=RADIUS_M, pressure_pa=PRESSURE_PA, mass_kgpm=MASS_KGPM,
        extension_stiffness_n=2e7, foundation_damping_nspm2=60.0, bending_damping_nm2s=1e-4, shear_stiffness_n=shear_n,
    )  # fmt: skip
    omega = speed_kmh / 3.6 / RADIUS_M
    return solve_rolling_ring(ring, load_n, PRESSURE_PA, omega, nodes=nodes, sensor_offset_m=OFFSET_M)


def seen(solution: RingSolution, blocks: TreadBlocks, offset_m: float = OFFSET_M) -> ComplexArray:
    """Return what a unit of stiffness adds to both axes, m/s^2, as a complex curve (2, N)."""
    response = block_response(loaded_belt(solution), blocks, solution.omega_radps, offset_m)
    return solution.omega_radps**2 * response.signal * np.exp(-1j * blocks.count * solution.theta_rad)


@pytest.mark.parametrize("speed_kmh", FINITE_ELEMENTS)
def test_orders_are_those_of_a_belt_of_finite_elements(speed_kmh: float) -> None:
    """Nothing is fitted: every parameter is the other belt's own."""
    load_n, orders = FINITE_ELEMENTS[speed_kmh]
    solution = rolling(speed_kmh, load_n)
    steady = solution.omega_radps**2 * np.stack([solution.sensor.radial_m, solution.sensor.circumferential_m])
    result = waveform_orders(steady + (0.05 * seen(solution, LOSSES)).real, 110)[:, list(orders)]
    true, without = np.array(list(orders.values())).T, waveform_orders(steady, 110)[:, list(orders)]
    for axis, share in ((0, 0.04), (1, 0.05)):
        size = np.linalg.norm(true[axis])
        assert np.linalg.norm(result[axis] - true[axis]) < share * size
        assert np.linalg.norm(without[axis] - true[axis]) > 0.9 * size


def exponents(curve: ComplexArray, step_rad: float, count: int) -> ComplexArray:
    """Return the exponents of a sum of exponentials, (count,), by a matrix pencil."""
    size = len(curve) // 2
    hankel = np.lib.stride_tricks.sliding_window_view(curve, size)
    basis = np.linalg.svd(hankel.T, full_matrices=False)[0][:, :count]
    roots: ComplexArray = np.linalg.eigvals(np.linalg.lstsq(basis[:-1], basis[1:], rcond=None)[0])
    return np.log(roots) / step_rad


@pytest.mark.parametrize("speed_kmh", [45.0, 75.0])
def test_free_belt_has_the_waves_of_its_dispersion(speed_kmh: float) -> None:
    solution, losses_nm2s = rolling(speed_kmh), 3e-4
    lossy = TreadBlocks(BLOCKS, MASS_KGPM, losses_nm2s / EI, 0.0)
    theta = np.mod(solution.theta_rad, 2.0 * math.pi)
    along = np.argsort(theta)
    free = along[(theta[along] > 0.4) & (theta[along] < 2.0 * math.pi - 0.4)][::4]
    result = exponents(seen(solution, lossy, 0.0)[0][free], 4.0 * 2.0 * math.pi / len(theta), 4)
    tension = PRESSURE_PA * TABLE_3_NUMBERS[1] * RADIUS_M**2
    tread = BlockTread(BLOCKS, EI / MASS_KGPM, tension / MASS_KGPM, 60.0 / MASS_KGPM, losses_nm2s / MASS_KGPM)
    for side in (0, 1):
        wave = belt_wave(tread, side, solution.omega_radps, RADIUS_M)
        # The complex curve turns with minus the order; the wave ahead of the contact grows towards it.
        nearest = result[np.argmin(np.abs(result.imag + wave.order))]
        assert nearest.imag == pytest.approx(-wave.order, abs=0.2)
        assert abs(nearest.real) == pytest.approx(wave.decay_per_rad, rel=0.1)
        assert (nearest.real > 0.0) == (side == 0)


def test_response_does_not_depend_on_the_grid() -> None:
    coarse, fine = (seen(rolling(60.0, nodes=nodes), LOSSES) for nodes in (960, 1920))
    assert np.abs(coarse - fine[:, ::2]).max() < 0.02 * np.abs(fine).max()


def test_stiff_section_is_an_euler_belt() -> None:
    euler, shear = (seen(rolling(60.0, shear_n=shear_n), LOSSES) for shear_n in (math.inf, 1e9))
    assert np.abs(shear - euler).max() < 0.03 * np.abs(euler).max()


def test_largest_where_the_blocks_come_by_at_the_belts_frequency_on_its_tread() -> None:
    """The belt of 3.5 kg/m on 7e7 N/m^2 rings at 710 Hz, where 67 blocks come by at 77 km/h."""
    in_contact = np.abs(rolling(60.0).theta_rad) < 0.1
    sizes = []
    for speed_kmh in (30.0, 55.0, 77.0, 110.0):
        solution = rolling(speed_kmh)
        lossy = TreadBlocks(BLOCKS, MASS_KGPM, 2e-5, 2e-5)
        # Deflection: the acceleration over the square of the frequency.
        sizes.append(float(np.abs(seen(solution, lossy)[0][in_contact]).mean()) / solution.omega_radps**2)
    assert sizes[2] == max(sizes)
    assert sizes[2] > 3.0 * sizes[0]


@pytest.mark.parametrize(
    ("field", "step"), [("count", 1e-4), ("mass_kgpm", 1e-4), ("bending_time_s", 1e-9), ("tread_time_s", 1e-9)]
)
def test_derivatives_match_differences(field: str, step: float) -> None:
    belt, omega = loaded_belt(rolling(75.0)), rolling(75.0).omega_radps
    parameters = {"count": 67.3, "mass_kgpm": 3.8, "bending_time_s": 2e-5, "tread_time_s": 1e-5}
    above, below = (
        block_response(
            belt, TreadBlocks(**{**parameters, field: parameters[field] + way * step}), omega, OFFSET_M
        ).signal
        for way in (1.0, -1.0)
    )
    index = list(parameters).index(field)
    row = block_response(belt, TreadBlocks(**parameters), omega, OFFSET_M).by[index]
    assert np.abs(row - (above - below) / (2.0 * step)).max() < 1e-5 * np.abs(row).max()
