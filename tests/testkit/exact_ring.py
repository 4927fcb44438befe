"""Sensor signals of the geometrically exact ring, computed without the signal path that the tests check."""

import math
from functools import lru_cache

import numpy as np
from scipy.interpolate import CubicSpline

from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.types import FloatArray
from gateway.ring.reference_tire import TABLE_3_NUMBERS
from gateway.ring.rolling_ring import RingParameters, RingSolution, solve_rolling_ring

RADIUS_M = 0.32
PRESSURE_PA = 2.1e5
BASE_RING = RingParameters.from_numbers(*TABLE_3_NUMBERS, radius_m=RADIUS_M, pressure_pa=PRESSURE_PA)


def omega_at(speed_kmh: float) -> float:
    return speed_kmh / 3.6 / RADIUS_M


@lru_cache(maxsize=64)
def solution(
    load_n: float = 5000.0,
    pressure_pa: float = PRESSURE_PA,
    ring: RingParameters = BASE_RING,
    drum_radius_m: float = math.inf,
) -> RingSolution:
    """Solve at 65 km/h; the shape is the same at every speed."""
    return solve_rolling_ring(ring, load_n, pressure_pa, omega_at(65.0), nodes=1440, drum_radius_m=drum_radius_m)


def on_grid(values: FloatArray, n: int = 1024) -> FloatArray:
    """Resample a periodic curve on n points, band-limited."""
    spectrum = np.fft.rfft(values)[: n // 2 + 1]
    spectrum[-1] = 0.0
    return np.fft.irfft(spectrum, n=n) * (n / len(values))


def cosine_orders(values: FloatArray, count: int = 60) -> FloatArray:
    """Return cosine coefficients of orders 1 to count of a curve over theta = -pi + 2 pi i / N."""
    theta = -math.pi + 2.0 * math.pi / len(values) * np.arange(len(values))
    return np.array([2.0 / len(values) * float(values @ np.cos(n * theta)) for n in range(1, count + 1)])


def sampled(
    ring: RingSolution,
    rate_hz: float,
    speed_kmh: float,
    *,
    revolutions: int = 3,
    acceleration_mps2: float = 0.0,
    gravity_mps2: float = STANDARD_GRAVITY_MPS2,
    noise_mps2: float = 0.0,
    seed: int = 1,
) -> tuple[FloatArray, FloatArray]:
    """Return samples in time (m, 2) circumferential and radial, and the contact centres' sample positions.

    The first contact centre lies at 40.37 samples; `speed_kmh` holds there.
    """
    theta = np.append(ring.theta_rad, math.pi)

    def curve(values: FloatArray) -> CubicSpline:
        return CubicSpline(theta, np.append(values, values[0]), bc_type="periodic")

    start = 40.37 / rate_hz
    omega, omega_dot = omega_at(speed_kmh), acceleration_mps2 / RADIUS_M
    angles = 2.0 * math.pi * np.arange(revolutions + 1)
    times = start + 2.0 * angles / (omega + np.sqrt(omega**2 + 2.0 * omega_dot * angles))
    t = np.arange(int(times[-1] * rate_hz) + 60) / rate_hz - start
    phase = omega * t + 0.5 * omega_dot * t**2
    speed = omega + omega_dot * t
    wrapped = (phase + math.pi) % (2.0 * math.pi) - math.pi
    sensor = ring.sensor
    channels = [
        speed**2 * curve(shape)(wrapped) + gravity_mps2 * curve(weight)(wrapped) + omega_dot * curve(spin)(wrapped)
        for shape, weight, spin in (
            (sensor.circumferential_m, sensor.gravity_circumferential, sensor.spin_circumferential_m),
            (sensor.radial_m, sensor.gravity_radial, sensor.spin_radial_m),
        )
    ]
    samples = np.stack(channels, axis=1)
    samples += np.random.default_rng(seed).normal(0.0, 1.0, samples.shape) * noise_mps2
    return samples, times * rate_hz
