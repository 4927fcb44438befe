"""Blocks of the exact ring for tests of effects, and averaged revolutions of a simulated wheel."""

import math
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.estimates.estimator import Revolution
from gateway.core.estimates.wheel_setup import WheelSetup
from gateway.core.types import FloatArray
from gateway.diagnosis.effects.effect import (
    CIRCUMFERENTIAL,
    FIELD_SIZE,
    LATERAL,
    RADIAL,
    GroupConditions,
    ModelledBlock,
)
from gateway.ring.reference_tire import TABLE_3_NUMBERS
from gateway.ring.rolling_ring import LoadedBelt, RingParameters, RingSolution, loaded_belt, solve_rolling_ring
from gateway.ring.rolling_ring.sensor_waveform import SensorWaveform
from tests.testkit.exact_ring import on_grid
from tests.testkit.simulated_wheel import simulated

RADIUS_M = 0.32
PRESSURE_PA = 2.1e5
LOAD_N = 5000.0
OMEGA = 65.0 / 3.6 / RADIUS_M
THETA = -math.pi + (2.0 * math.pi / FIELD_SIZE) * np.arange(FIELD_SIZE)
CONDITIONS = GroupConditions(
    omega_radps=OMEGA,
    omega_dot_radps2=0.0,
    radius_m=RADIUS_M,
    load_n=LOAD_N,
    pressure_pa=PRESSURE_PA,
    temperature_degc=25.0,
    reference_degc=25.0,
    rate_hz=9600.0,
    time_s=0.0,
)
# The simulator's tire has an extensible belt.
EXTENSION_N = 5e6
TIRE = RingParameters.from_numbers(
    *TABLE_3_NUMBERS,
    radius_m=RADIUS_M,
    pressure_pa=PRESSURE_PA,
    mass_kgpm=3.5,
    extension_stiffness_n=EXTENSION_N,
    tread_stiffness_npm2=7e7,
)
SETUP = WheelSetup("FL", 0, 0, RADIUS_M, load_n=LOAD_N, pressure_pa=PRESSURE_PA)


@lru_cache(maxsize=8)
def _solved(offset_m: float, nodes: int) -> tuple[RingSolution, LoadedBelt]:
    """Return a ring and its belt, which is one object because effects remember their answers by belt."""
    ring = solve_rolling_ring(TIRE, LOAD_N, PRESSURE_PA, OMEGA, nodes=nodes, sensor_offset_m=offset_m)
    return ring, loaded_belt(ring)


def block_of(
    conditions: GroupConditions = CONDITIONS, *, offset_m: float = 0.0, as_paper: bool = False, nodes: int = 720
) -> ModelledBlock:
    """Return a block of the exact ring; with `as_paper`, without mean, gravity and spin."""
    ring, belt = _solved(offset_m, nodes)
    shape = SensorWaveform(*(on_grid(values, FIELD_SIZE) for values in ring.sensor))
    square = conditions.omega_radps**2
    signal = np.zeros((3, FIELD_SIZE))
    if as_paper:
        nothing = np.zeros(FIELD_SIZE)
        shape = SensorWaveform(shape.radial_m - shape.radial_m.mean(), *(nothing,) * 5)
        signal[RADIAL] = square * shape.radial_m
    else:
        signal[RADIAL] = square * shape.radial_m + STANDARD_GRAVITY_MPS2 * shape.gravity_radial
        along = square * shape.circumferential_m + STANDARD_GRAVITY_MPS2 * shape.gravity_circumferential
        signal[CIRCUMFERENTIAL] = along
        signal[LATERAL] = 0.02 * square * RADIUS_M * np.sin(2.0 * THETA) * np.exp(-np.square(THETA / 0.5))
    edges = ring.leading_edge_rad, ring.trailing_edge_rad
    return ModelledBlock(conditions, THETA, signal, shape, *edges, belt)


def rolling_at(speed_kmh: float) -> GroupConditions:
    return replace(CONDITIONS, omega_radps=speed_kmh / 3.6 / RADIUS_M)


def limited(field: FloatArray) -> FloatArray:
    """Return curves (..., n) on the model's grid, limited to the compared orders."""
    spectrum = np.fft.rfft(field, axis=-1)[..., : FIELD_SIZE // 2 + 1]
    spectrum[..., 111:] = 0.0
    result: FloatArray = np.fft.irfft(spectrum, n=FIELD_SIZE, axis=-1) * (FIELD_SIZE / field.shape[-1])
    return result


def revolutions(
    wheel: str = "", *, speed: str = "65.0", offset_mm: float = 0.0, duration_s: float = 6.0
) -> tuple[Revolution, ...]:
    """Return the pipeline's revolutions of a noiseless simulated wheel after settling."""
    sensor = f"[sensor]\nnoise_mg_rthz = 0.0\nrange_g = 1000.0\noffset_mm = {offset_mm}"
    tables = f"[motion]\nspeed_kmh = {speed}\n{sensor}"
    results, _ = simulated(tables, duration_s, SETUP, ("kinematic",), f"phase_deg = 170.0\n{wheel}")
    return tuple(result.revolution for result in results[15:])


class Scaled(NamedTuple):
    """Mean of revolutions, each scaled with omega^2 to 65 km/h.

    Attributes:
        axes_mps2: (3, FIELD_SIZE).
        gravity: what gravity was multiplied with, in the mean.
        omega_dot_radps2: what the acceleration became.
    """

    axes_mps2: FloatArray
    gravity: float
    omega_dot_radps2: float


def averaged(wheel: str = "", *, speed: str = "65.0", offset_mm: float = 0.0, duration_s: float = 6.0) -> Scaled:
    """Return the mean of a simulated wheel's revolutions on the model's grid."""
    those = revolutions(wheel, speed=speed, offset_mm=offset_mm, duration_s=duration_s)
    scale = np.array([(OMEGA / revolution.omega_radps) ** 2 for revolution in those])
    axes = np.mean([s * revolution.axes_mps2 for s, revolution in zip(scale, those, strict=True)], axis=0)
    change = np.mean([s * revolution.omega_dot_radps2 for s, revolution in zip(scale, those, strict=True)])
    return Scaled(limited(axes), float(scale.mean()), float(change))
