"""Three-axis signals of a tire with ply steer: exact ring, lateral belt, brush tread, tilted sensor and rough road.

The lateral shape comes from the belt's force balance. The only equation in common with the estimators is
a = Omega^2 d2y/dtheta2.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.interpolate import CubicSpline

from firmware_protocol.messages import Axis, Coupling, Hello
from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.estimates.results import RevolutionResult
from gateway.core.estimates.wheel_setup import WheelSetup
from gateway.core.types import FloatArray
from gateway.core.wheels.timebase import HostClock
from gateway.core.wheels.wheel_pipeline import WheelPipeline
from gateway.forces.lateral_belt import LateralBelt, LateralSolution, solve_lateral_belt
from gateway.ring.reference_tire import TABLE_3_NUMBERS
from gateway.ring.rolling_ring import RingParameters, RingSolution, solve_rolling_ring

RADIUS_M, REFERENCE_PRESSURE_PA = 0.32, 2.1e5
G = STANDARD_GRAVITY_MPS2
RANGE_MPS2 = 2000.0 * G
SCALE_MPS2 = RANGE_MPS2 / 32768.0


def car_ring(pressure_pa: float) -> RingParameters:
    """Return the ring paper's tire; half of the sidewall stiffness is structural, half is proportional to pressure."""
    nominal = RingParameters.from_numbers(*TABLE_3_NUMBERS, radius_m=RADIUS_M, pressure_pa=REFERENCE_PRESSURE_PA)
    share = 0.5 + 0.5 * pressure_pa / REFERENCE_PRESSURE_PA
    return RingParameters(
        radius_m=RADIUS_M,
        tension_width_m=nominal.tension_width_m,
        bending_stiffness_nm2=nominal.bending_stiffness_nm2,
        radial_stiffness_npm2=share * nominal.radial_stiffness_npm2,
        tangential_stiffness_npm2=share * nominal.tangential_stiffness_npm2,
    )


@lru_cache(maxsize=32)
def radial(load_n: float = 5000.0, pressure_pa: float = 2.1e5, offset_m: float = 0.0) -> RingSolution:
    return solve_rolling_ring(
        car_ring(pressure_pa), load_n, pressure_pa, 65.0 / 3.6 / RADIUS_M, nodes=1440, sensor_offset_m=offset_m
    )


@lru_cache(maxsize=64)
def lateral(ring: RingSolution, belt: LateralBelt = LateralBelt(), slip_rad: float = 0.0) -> LateralSolution:  # noqa: B008
    return solve_lateral_belt(ring, belt, slip_angle_rad=slip_rad)


@dataclass(frozen=True)
class Sensor:
    """Mounting of the sensor, its noise and the disturbances."""

    rate_hz: float = 9600.0
    noise_mg: float = 0.0
    roll_rad: float = 0.0
    yaw_rad: float = 0.0
    pitch_rad: float = 0.0
    lateral_offset_mps2: float = 0.0
    road_mps2: float = 0.0
    hub_mps2: float = 0.0
    camber_rad: float = 0.0
    seed: int = 1


def samples(
    ring: RingSolution,
    shapes: Sequence[tuple[int, LateralSolution]],
    sensor: Sensor,
    *,
    speed_kmh: float = 65.0,
    acceleration_mps2: float = 0.0,
) -> FloatArray:
    """Return (m, 3) circumferential, lateral, radial samples; `shapes` lists (revolutions, lateral shape) in order."""
    theta = np.append(ring.theta_rad, math.pi)

    def curve(values: FloatArray) -> CubicSpline:
        return CubicSpline(theta, np.append(values, values[0]), bc_type="periodic")

    revolutions = sum(count for count, _ in shapes)
    omega, omega_dot = speed_kmh / 3.6 / RADIUS_M, acceleration_mps2 / RADIUS_M
    end = 2 * math.pi * (revolutions + 0.5)
    duration = 2 * end / (omega + math.sqrt(omega**2 + 2 * omega_dot * end))
    t = np.arange(int(duration * sensor.rate_hz)) / sensor.rate_hz
    phase = omega * t + 0.5 * omega_dot * t**2 - 0.7 * math.pi
    speed = omega + omega_dot * t
    wrapped = (phase + math.pi) % (2 * math.pi) - math.pi
    turn = np.floor((phase + math.pi) / (2 * math.pi))
    felt = ring.sensor
    along = speed**2 * curve(felt.circumferential_m)(wrapped) + G * curve(felt.gravity_circumferential)(wrapped)
    along += omega_dot * curve(felt.spin_circumferential_m)(wrapped)
    up = speed**2 * curve(felt.radial_m)(wrapped) + G * curve(felt.gravity_radial)(wrapped)
    up += omega_dot * curve(felt.spin_radial_m)(wrapped)
    side = np.empty_like(t)
    done = -1.0
    for count, shape in shapes:
        mask = (turn > done) & (turn <= done + count + (shape is shapes[-1][1]))
        side[mask] = speed[mask] ** 2 * curve(shape.lateral_m)(wrapped[mask])
        done += count
    side += G * math.sin(sensor.camber_rad)
    return disturbed(np.stack([along, side, up], axis=1), sensor)


def disturbed(felt: FloatArray, sensor: Sensor) -> FloatArray:
    """Return (m, 3) samples of what a sensor feels: road and hub, its mounting, its offset and noise."""
    along, side, up = felt.T.copy()
    rng = np.random.default_rng(sensor.seed)
    for axis in (side, up):
        if sensor.road_mps2:
            axis += _band(rng, len(felt), sensor.rate_hz, 0.0, 500.0) * sensor.road_mps2
        if sensor.hub_mps2:
            axis += _band(rng, len(felt), sensor.rate_hz, 8.0, 16.0) * sensor.hub_mps2
    # The sensor is turned about the lateral axis first, then about the radial and about its circumferential one.
    along, up = (
        math.cos(sensor.pitch_rad) * along + math.sin(sensor.pitch_rad) * up,
        math.cos(sensor.pitch_rad) * up - math.sin(sensor.pitch_rad) * along,
    )
    along, side = (
        math.cos(sensor.yaw_rad) * along - math.sin(sensor.yaw_rad) * side,
        math.cos(sensor.yaw_rad) * side + math.sin(sensor.yaw_rad) * along,
    )
    side, up = (
        math.cos(sensor.roll_rad) * side + math.sin(sensor.roll_rad) * up,
        math.cos(sensor.roll_rad) * up - math.sin(sensor.roll_rad) * side,
    )
    axes = np.stack([along, side + sensor.lateral_offset_mps2, up], axis=1)
    return axes + rng.normal(0.0, 1.0, axes.shape) * sensor.noise_mg * 1e-3 * G * math.sqrt(sensor.rate_hz / 2)


def _band(rng: np.random.Generator, count: int, rate_hz: float, low_hz: float, high_hz: float) -> FloatArray:
    """Return noise of unit rms between two frequencies."""
    spectrum = rng.normal(size=count // 2 + 1) + 1j * rng.normal(size=count // 2 + 1)
    frequency = np.fft.rfftfreq(count, 1 / rate_hz)
    spectrum[(frequency < low_hz) | (frequency > high_hz)] = 0.0
    noise = np.fft.irfft(spectrum, n=count)
    return noise / noise.std()


def through_pipeline(
    values_mps2: FloatArray,
    sensor: Sensor,
    estimators: Sequence[str] = (),
    *,
    load_n: float = 5000.0,
    pressure_pa: float = 2.1e5,
    coupling: Coupling = Coupling.DC,
    axes: int = 0b111,
    position: str = "FL",
) -> list[RevolutionResult]:
    """Quantise to 16 bit over 2000 g and run the wheel's pipeline."""
    setup = WheelSetup(position, 0, 0, RADIUS_M, load_n=load_n, pressure_pa=pressure_pa)
    wheel = WheelPipeline(setup, tuple(estimators))
    scale = (SCALE_MPS2,) * 3
    wheel.hello(
        Hello(1, 0, 1, 1, (1, 0, 0), 1, sensor.rate_hz, axes, coupling, 0.0, (RANGE_MPS2,) * 3, scale, (0, 0, 0), 32767)
    )
    counts = np.round(values_mps2[:, [axis for axis in Axis if axes >> axis & 1]] / SCALE_MPS2).astype(np.int16)
    host = HostClock()
    block = 36
    for first in range(0, len(counts) - block + 1, 20 * block):
        piece = counts[first : first + 20 * block]
        piece = piece[: len(piece) // block * block]
        ticks = [round((first + i * block) / sensor.rate_hz * 1e6) for i in range(len(piece) // block)]
        host.stamp_all(np.array(ticks), np.full(len(ticks), 1_000_000_000 + 1000 * ticks[-1]))
        wheel.add(first, ticks, axes, piece, host)
    return wheel.finish(host)
