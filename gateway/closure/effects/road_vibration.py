"""The road's roughness shakes the sensor: broad, alike on its axes, more at speed."""

from __future__ import annotations

import math

import numpy as np

from gateway.closure.effects.base import (
    CIRCUMFERENTIAL,
    LATERAL,
    NOWHERE,
    RADIAL,
    Conditions,
    Parameter,
    StartModel,
)
from gateway.closure.effects.resonance_bell import relative_speed
from gateway.types import FloatArray


class RoadVibration:
    """Broadband shaking below a corner frequency."""

    name = "road vibration"
    summary = "The road's texture shakes the sensor with broadband noise below a corner, in proportion to the speed."
    equation = (
        "S(f) = (rms v / 65 km/h)^2 sin(pi / 2m) / (pi / 2m) / corner / (1 + (f / corner)^2m) on each axis, m roll-off"
    )
    # Sensors on inner liners read 0.1 to some 10 m/s^2 rms of road at 65 km/h; the tread and belt let through some
    # 100 Hz. A resonance's slope is m = 2, a single pole's m = 1.
    parameters: tuple[Parameter, ...] = (
        Parameter("rms_mps2", "m/s^2", 0.01, 60.0, 10.0, 1e-4),
        Parameter("corner_hz", "Hz", 60.0, 1000.0, 300.0, 1e-2, prior_mean=400.0),
        Parameter("roll_off", "", 0.8, 6.0, 1.0, 1e-4, prior_mean=2.0),
    )
    seen_by = "all axes, in the spectrum of what the wheel does not repeat; two speeds tell it from the sensor's noise"
    confused_with = (
        "sensor noise behind a low-pass, which does not grow with speed; jitter of the contact's edges, which sits "
        "where the waveform is steep and mostly on the radial axis"
    )
    already_in: frozenset[StartModel] = NOWHERE
    axes: tuple[int, ...] = (CIRCUMFERENTIAL, LATERAL, RADIAL)

    def starts(self, conditions: tuple[Conditions, ...]) -> tuple[tuple[float, ...], ...]:
        """Return small shaking below two corners."""
        return ((0.3, 150.0, 2.0), (0.3, 500.0, 2.0))

    def density(self, conditions: Conditions, frequency_hz: FloatArray, parameters: FloatArray) -> FloatArray:
        """Return what it adds, (3, m), (m/s^2)^2 per Hz, one-sided."""
        rms = float(parameters[0]) * relative_speed(conditions)
        shape = _shape(frequency_hz, float(parameters[1]), float(parameters[2]))[0]
        return np.tile(rms**2 * shape, (3, 1))

    def density_derivative(
        self, conditions: Conditions, frequency_hz: FloatArray, parameters: FloatArray
    ) -> FloatArray:
        """Return d density / d parameters, (P, 3, m), analytic."""
        speed = relative_speed(conditions)
        rms = float(parameters[0])
        shape, per_corner, per_roll_off = _shape(frequency_hz, float(parameters[1]), float(parameters[2]))
        rows = np.stack((2.0 * rms * shape, rms**2 * per_corner, rms**2 * per_roll_off)) * speed**2
        return np.repeat(rows[:, None], 3, axis=1)


def _shape(frequency_hz: FloatArray, corner_hz: float, roll_off: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the density of unit power and its derivatives with respect to corner and roll-off."""
    x = np.maximum(frequency_hz, 1e-9) / corner_hz
    power = x ** (2.0 * roll_off)
    fall = 1.0 / (1.0 + power)
    # The integral is finite above m = 1/2 only; below, the shape is normalised as at the last m where it is.
    m = max(roll_off, 0.51)
    turn = math.pi / (2.0 * m)
    level = math.sin(turn) / turn / corner_hz
    shape = level * fall
    per_corner = shape / corner_hz * (2.0 * roll_off * power * fall - 1.0)
    per_level = (1.0 - turn / math.tan(turn)) / m if roll_off > m - 1e-12 else 0.0
    per_roll_off = shape * (per_level - 2.0 * np.log(x) * power * fall)
    return shape, per_corner, per_roll_off


EFFECT = RoadVibration()
