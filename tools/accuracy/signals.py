"""Samples in time of a wheel with known truth: the exact ring, gravity, disturbances, noise and 16 bit."""

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from accuracy.cases import RADIUS_M, Case
from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.types import FloatArray
from gateway.ring.rolling_ring import RingParameters, RingSolution, solve_rolling_ring
from gateway.ring.rolling_ring.sensor_waveform import angle_derivatives
from gateway.simulator.filters import lowpass, lowpass_noise_gain

RANGE_MPS2 = 2000.0 * STANDARD_GRAVITY_MPS2
ROAD_HZ = 500.0
HUB_HZ = (8.0, 16.0)
NODES = 2400
_FULL_SCALE = 32767
# Region around a jittering leading edge that moves with it.
_JITTER_REACH_RAD = 0.2


@lru_cache(maxsize=64)
def _solved(
    ring: RingParameters,
    load_n: float,
    pressure_pa: float,
    omega: float,
    offset_m: float,
    torque_nm: float | None,
    drum_m: float,
) -> RingSolution:
    return solve_rolling_ring(
        ring,
        load_n,
        pressure_pa,
        omega,
        nodes=NODES,
        sensor_offset_m=offset_m,
        axle_torque_nm=torque_nm,
        drum_radius_m=drum_m,
    )


def truth_of(case: Case) -> RingSolution:
    """Return the ring in equilibrium that the samples come from."""
    return _solved(
        case.ring, case.load_n, case.pressure_pa, case.omega_radps, case.offset_m, case.torque_nm, case.drum_m
    )


class Samples(NamedTuple):
    """Raw samples.

    Attributes:
        counts: (n, 3) circumferential, lateral, radial.
        range_mps2: what the largest count stands for.
    """

    counts: NDArray[np.int16]
    range_mps2: float


def samples_of(case: Case, revolutions: int, rng: np.random.Generator, *, noise: bool = True) -> Samples:
    """Return samples of at least `revolutions` whole revolutions.

    Args:
        case: the condition.
        revolutions: number of revolutions.
        rng: generator of phase, noise and disturbances.
        noise: False omits everything random except the phase of the sampling, and scales 16 bit to the signal: a sensor
            of +-2000 g without noise would read in steps of 0.6 m/s2, which do not average out.
    """
    ring = truth_of(case)
    omega, spin = case.omega_radps, case.acceleration_mps2 / RADIUS_M
    # Two additional revolutions: the first contact may be cut, and the last one needs samples around it.
    angle_end = 2.0 * math.pi * (revolutions + 2.2)
    duration = 2.0 * angle_end / (omega + math.sqrt(omega**2 + 2.0 * spin * angle_end))
    t = np.arange(math.ceil(duration * case.rate_hz)) / case.rate_hz
    phase = rng.uniform(0.0, 2.0 * math.pi) + omega * t + 0.5 * spin * t**2
    if noise and case.jitter_m:
        phase = _jittered(phase, ring, case.jitter_m / RADIUS_M, rng)
    position = np.mod(phase + math.pi, 2.0 * math.pi) - math.pi
    sensor = ring.sensor
    radial, along = sensor.radial_m, sensor.circumferential_m
    for waves in case.waves:
        wave = RADIUS_M * waves.radial(ring.theta_rad, ring.leading_edge_rad, ring.trailing_edge_rad)
        slope = angle_derivatives(wave.astype(np.complex128))[0].real
        radial, along = radial + wave, along - case.offset_m / RADIUS_M * slope
    shapes = (along, sensor.gravity_circumferential, sensor.spin_circumferential_m)
    shapes += (radial, sensor.gravity_radial, sensor.spin_radial_m)
    theta = np.append(ring.theta_rad, math.pi)
    table = np.stack(shapes, axis=1)
    curve = CubicSpline(theta, np.concatenate([table, table[:1]]), bc_type="periodic")(position)
    speed = omega + spin * t
    force = np.zeros((len(t), 3))
    for axis, first in ((0, 0), (2, 3)):
        force[:, axis] = speed**2 * curve[:, first] + STANDARD_GRAVITY_MPS2 * curve[:, first + 1]
        force[:, axis] += spin * curve[:, first + 2]
    if noise:
        force += _disturbances(case, curve, rng)
        density = case.noise_mg_rthz * 1e-3 * STANDARD_GRAVITY_MPS2
        force += rng.standard_normal(force.shape) * (density * math.sqrt(0.5 * case.rate_hz))
    full_scale = RANGE_MPS2 if noise else 1.05 * float(np.abs(force).max())
    counts = force * (_FULL_SCALE / full_scale)
    if not noise:
        counts += rng.uniform(-0.5, 0.5, counts.shape)
    return Samples(np.clip(np.rint(counts), -_FULL_SCALE, _FULL_SCALE).astype(np.int16), full_scale)


def _jittered(phase: FloatArray, ring: RingSolution, std_rad: float, rng: np.random.Generator) -> FloatArray:
    """Shift the region around the leading edge by a random angle in every revolution."""
    turn = np.floor((phase + math.pi) / (2.0 * math.pi)).astype(np.int64)
    shift = rng.normal(0.0, std_rad, int(turn[-1]) + 1)[turn]
    distance = np.mod(phase + math.pi, 2.0 * math.pi) - math.pi - ring.leading_edge_rad
    window = np.where(
        np.abs(distance) < _JITTER_REACH_RAD, np.cos(0.5 * math.pi * distance / _JITTER_REACH_RAD) ** 2, 0.0
    )
    result: FloatArray = phase + shift * window
    return result


def _disturbances(case: Case, curve: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Return the disturbances by road and hub, (n, 3)."""
    samples = len(curve)
    force = np.zeros((samples, 3))
    if case.road_rms_mps2:
        corner = min(ROAD_HZ, 0.45 * case.rate_hz)
        shaking = lowpass(corner, case.rate_hz)(rng.standard_normal((samples, 3)))
        force += shaking * (case.road_rms_mps2 / lowpass_noise_gain(corner, case.rate_hz))
    if case.hub_rms_mps2:
        # The whole wheel moves up and down; its direction in the sensor's axes is gravity's.
        spectrum = np.fft.rfft(rng.standard_normal(samples))
        frequency = np.fft.rfftfreq(samples, 1.0 / case.rate_hz)
        spectrum[(frequency < HUB_HZ[0]) | (frequency > HUB_HZ[1])] = 0.0
        heave = np.fft.irfft(spectrum, n=samples)
        heave *= case.hub_rms_mps2 / heave.std()
        force[:, 0] += heave * curve[:, 1]
        force[:, 2] += heave * curve[:, 4]
    return force
