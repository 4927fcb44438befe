"""Data of the ring paper's figures: simulated tires of its Table 1, a noisy sensor, averages and estimates."""

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Final

import numpy as np

from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.estimates.estimator import AngleAverage, Revolution, TireConditions
from gateway.core.estimates.registry import make_estimator
from gateway.core.estimates.revolution_block import extended
from gateway.core.revolutions.angle_resampling import GRID_SIZE
from gateway.core.revolutions.contact_edges import find_contact_edges
from gateway.core.revolutions.order_spectrum import (
    ORDER_COUNT,
    coefficient_std,
    highest_order,
    order_coefficients,
    sample_std,
)
from gateway.core.revolutions.synchronous_average import RunningAverage
from gateway.core.ring_quantities import RING_NUMBERS
from gateway.core.types import FloatArray
from gateway.ring.reference_tire import TABLE_3_LOAD_N, TABLE_3_NUMBERS, TABLE_3_PRESSURE_PA
from gateway.ring.ring_series import signal_orders
from gateway.ring.rolling_ring import RingParameters, RingSolution, solve_rolling_ring

RADIUS_M: Final = 0.32
SPEED_KMH: Final = 65.0
OMEGA_RADPS: Final = SPEED_KMH / 3.6 / RADIUS_M
RATE_HZ: Final = 9600.0
REVOLUTIONS: Final = 50
NOISE_MG_PER_RTHZ: Final = 5.0
LOADS_N: Final = (2000.0, 5000.0, 8000.0)
PRESSURES_PA: Final = (1.7e5, 2.1e5, 2.5e5)
WEAR_MM: Final = (0.0, 2.9, 6.4)
# Belt and tread of the new tire; the paper does not state it.
RING_THICKNESS_MM: Final = 15.0
ESTIMATORS: Final = ("ring-paper", "weak-form")

_BASE: Final = RingParameters.from_numbers(*TABLE_3_NUMBERS, radius_m=RADIUS_M, pressure_pa=2.1e5)
_SAMPLES: Final = 2.0 * math.pi / OMEGA_RADPS * RATE_HZ


@dataclass(frozen=True, slots=True)
class Condition:
    """One tire under one condition, with its estimates.

    Attributes:
        wear_mm: reduction of the ring's thickness.
        ring: the true ring in equilibrium.
        average: average of the noisy revolutions.
        estimates: (4,) Bs, Cw, Rs, Ts by estimator; NaN where it gives none.
    """

    wear_mm: float
    ring: RingSolution
    average: AngleAverage
    estimates: Mapping[str, FloatArray]

    @property
    def half_angle_rad(self) -> float:
        """Contact half angle estimated from the signal."""
        return 0.5 * (self.average.trailing_edge_rad - self.average.leading_edge_rad)

    @property
    def truth(self) -> FloatArray:
        """The true numbers, (4,)."""
        return np.array(self.ring.numbers)


def paper_ring(wear_mm: float, pressure_pa: float) -> RingParameters:
    """Return the tire: EI is proportional to the thickness cubed, half of the sidewall stiffness to pressure."""
    sidewall = 0.5 + 0.5 * pressure_pa / 2.1e5
    return replace(
        _BASE,
        bending_stiffness_nm2=_BASE.bending_stiffness_nm2 * (1.0 - wear_mm / RING_THICKNESS_MM) ** 3,
        radial_stiffness_npm2=_BASE.radial_stiffness_npm2 * sidewall,
        tangential_stiffness_npm2=_BASE.tangential_stiffness_npm2 * sidewall,
    )


@lru_cache(maxsize=64)
def condition(wear_mm: float, pressure_pa: float, load_n: float) -> Condition:
    """Return one condition of `paper_ring`."""
    solved = solve_rolling_ring(paper_ring(wear_mm, pressure_pa), load_n, pressure_pa, OMEGA_RADPS, nodes=1440)
    seed = round(wear_mm * 10) * 10_000 + round(pressure_pa * 1e-4) * 100 + round(load_n * 1e-3)
    revolution, average = _averaged(solved, seed)
    conditions = TireConditions(RADIUS_M, load_n, pressure_pa)
    estimates = {}
    for name in ESTIMATORS:
        values = {e.name: e.value for e in make_estimator(name).update(revolution, average, conditions)}
        estimates[name] = np.array([values[number] for number in RING_NUMBERS])
    return Condition(wear_mm, solved, average, estimates)


def table_1() -> list[Condition]:
    """Return the 27 conditions of Table 1."""
    return [condition(*parameters) for parameters in itertools.product(WEAR_MM, PRESSURES_PA, LOADS_N)]


def new_tire() -> Condition:
    """Return the tire of Table 3: new, 5000 N, 2.1 bar."""
    return condition(0.0, TABLE_3_PRESSURE_PA, TABLE_3_LOAD_N)


def measured_orders(average: AngleAverage) -> FloatArray:
    """Return the cosine coefficients of s / Omega^2 about the contact centre, orders 1 to 60, m."""
    centre = 0.5 * (average.trailing_edge_rad + average.leading_edge_rad)
    centred = average.orders_mps2[1:] * np.exp(1j * np.arange(1, ORDER_COUNT) * centre)
    result: FloatArray = centred.real / average.omega_radps**2
    return result


def fitted_orders(tire: Condition) -> FloatArray:
    """Return the same coefficients by Eq. 27 with the numbers of Eq. 28, m."""
    return signal_orders(
        np.arange(1, ORDER_COUNT),
        tire.estimates["ring-paper"].tolist(),
        load_n=tire.ring.load_n,
        pressure_pa=tire.ring.pressure_pa,
        radius_m=RADIUS_M,
        half_angle_rad=tire.half_angle_rad,
    )


def _averaged(ring: RingSolution, seed: int) -> tuple[Revolution, AngleAverage]:
    """Return the last revolution and the average of REVOLUTIONS noisy ones."""
    clean = clean_wave(ring)
    # The grid is about as fine as the sampling, so its noise is that of the samples.
    noise = NOISE_MG_PER_RTHZ * 1e-3 * STANDARD_GRAVITY_MPS2 * math.sqrt(0.5 * RATE_HZ * GRID_SIZE / _SAMPLES)
    rng = np.random.default_rng(seed)
    running = RunningAverage(horizon_revolutions=REVOLUTIONS)
    for index in range(REVOLUTIONS):
        revolution = waveform_revolution(clean + noise * rng.standard_normal(GRID_SIZE), index)
        average = extended(running, revolution)
    return revolution, average


def clean_wave(ring: RingSolution) -> FloatArray:
    """Return the radial axis on the angle grid without gravity and noise, m/s^2."""
    count = min(GRID_SIZE // 2 + 1, len(ring.theta_rad) // 2)
    spectrum = np.zeros(GRID_SIZE // 2 + 1, np.complex128)
    spectrum[:count] = np.fft.rfft(ring.sensor.radial_m)[:count]
    spectrum[-1] = 0.0
    wave: FloatArray = OMEGA_RADPS**2 * np.fft.irfft(spectrum, n=GRID_SIZE) * (GRID_SIZE / len(ring.theta_rad))
    return wave


def quiet_average(ring: RingSolution) -> tuple[Revolution, AngleAverage]:
    """Return one revolution without noise and the average of it alone."""
    revolution = waveform_revolution(clean_wave(ring))
    return revolution, extended(RunningAverage(), revolution)


def waveform_revolution(
    wave_mps2: FloatArray, index: int = 0, *, samples: float = _SAMPLES, omega_radps: float = OMEGA_RADPS
) -> Revolution:
    """Return a revolution without faults from its normalised radial waveform on the angle grid, (n,).

    Args:
        wave_mps2: the waveform; other axes are absent.
        index: of the revolution.
        samples: per revolution.
        omega_radps: angular speed.
    """
    noise = coefficient_std(wave_mps2, samples)
    edges = find_contact_edges(wave_mps2, samples, noise)
    absent = np.full(GRID_SIZE, np.nan)
    order_max = highest_order(samples)
    return Revolution(
        index=index,
        start_s=index * 2.0 * math.pi / omega_radps,
        period_s=2.0 * math.pi / omega_radps,
        omega_radps=omega_radps,
        omega_dot_radps2=0.0,
        radial_mps2=wave_mps2,
        axes_mps2=np.stack([absent, absent, wave_mps2]),
        orders_mps2=order_coefficients(wave_mps2, order_max),
        order_max=order_max,
        leading_edge_rad=edges.leading_rad,
        trailing_edge_rad=edges.trailing_rad,
        leading_edge_std_rad=edges.leading_std_rad,
        trailing_edge_std_rad=edges.trailing_std_rad,
        noise_mps2=sample_std(noise, samples, GRID_SIZE),
        missing_fraction=0.0,
        saturated=False,
        ac_coupled=False,
    )
