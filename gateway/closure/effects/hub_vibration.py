"""The unsprung mass bounces, and a sensor that turns with the wheel feels it from all sides."""

from __future__ import annotations

import math

import numpy as np

from gateway.closure.effects.base import (
    CIRCUMFERENTIAL,
    NOWHERE,
    RADIAL,
    Conditions,
    Parameter,
    StartModel,
)
from gateway.closure.effects.resonance_bell import bell, relative_speed
from gateway.types import FloatArray


class HubVibration:
    """Bounce of the hub, at the sum and the difference of its own and the wheel's frequency."""

    name = "hub vibration"
    summary = (
        "The unsprung mass bounces on the tire; the turning sensor feels it as sidebands, the bounce's frequency plus "
        "and minus the wheel's, alike on radial and circumferential axis and in quadrature."
    )
    equation = (
        "S(f) = (B(|f - wheel|) + B(f + wheel)) / 4 on radial and circumferential, "
        "B(f) = (rms v / 65 km/h)^2 2 / (pi width) / (1 + ((f^2 - centre^2) / (f width))^2)"
    )
    # Wheel hop lies at 8 to 20 Hz, its damping ratio at 0.05 to 0.4.
    parameters: tuple[Parameter, ...] = (
        Parameter("rms_mps2", "m/s^2", 0.01, 40.0, 5.0, 1e-4),
        Parameter("centre_hz", "Hz", 8.0, 20.0, 4.0, 1e-4, prior_mean=12.0),
        Parameter("width_hz", "Hz", 1.0, 16.0, 4.0, 1e-4, prior_mean=5.0),
    )
    seen_by = "radial and circumferential axis, in the spectrum of what the wheel does not repeat, below 50 Hz"
    confused_with = "road vibration, which is broad and on the lateral axis too; torsional ripple, a line at an order"
    already_in: frozenset[StartModel] = NOWHERE
    axes: tuple[int, ...] = (CIRCUMFERENTIAL, RADIAL)

    def starts(self, conditions: tuple[Conditions, ...]) -> tuple[tuple[float, ...], ...]:
        """Return bounces over the range that cars have."""
        return tuple((0.3, centre, 4.0) for centre in (9.0, 11.0, 13.5, 16.5, 19.0))

    def density(self, conditions: Conditions, frequency_hz: FloatArray, parameters: FloatArray) -> FloatArray:
        """Return what it adds, (3, m), (m/s^2)^2 per Hz, one-sided."""
        lower, upper = _sidebands(conditions, frequency_hz, parameters)
        result = np.zeros((3, len(frequency_hz)))
        result[[CIRCUMFERENTIAL, RADIAL]] = _power(conditions, parameters) * (lower[0] + upper[0])
        return result

    def density_derivative(
        self, conditions: Conditions, frequency_hz: FloatArray, parameters: FloatArray
    ) -> FloatArray:
        """Return d density / d parameters, (P, 3, m), analytic."""
        lower, upper = _sidebands(conditions, frequency_hz, parameters)
        power = _power(conditions, parameters)
        both = lower + upper
        per_rms = 0.5 * float(parameters[0]) * relative_speed(conditions) ** 2 * both[0]
        result = np.zeros((3, 3, len(frequency_hz)))
        for axis in self.axes:
            result[:, axis] = per_rms, power * both[1], power * both[2]
        return result

    def quadrature(self, conditions: Conditions, frequency_hz: FloatArray, parameters: FloatArray) -> FloatArray:
        """Return the imaginary part of what it adds to the cross density of radial and circumferential axis, (m,).

        E[X_radial conj(X_circumferential)] of Fourier transforms X with exp(-2 pi i f t): a force that stands still is
        felt in turn by the axes of a sensor that turns. Vertical or along the road, the magnitude is the same.
        """
        lower, upper = _sidebands(conditions, frequency_hz, parameters)
        result: FloatArray = _power(conditions, parameters) * (lower[0] - upper[0])
        return result


def _power(conditions: Conditions, parameters: FloatArray) -> float:
    return 0.25 * (float(parameters[0]) * relative_speed(conditions)) ** 2


def _sidebands(
    conditions: Conditions, frequency_hz: FloatArray, parameters: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return bell and derivatives, (3, m), seen above the wheel's frequency from it, and from below it."""
    wheel_hz = conditions.omega_radps / (2.0 * math.pi)
    centre, width = float(parameters[1]), float(parameters[2])
    return (
        np.stack(bell(np.abs(frequency_hz - wheel_hz), centre, width)),
        np.stack(bell(frequency_hz + wheel_hz, centre, width)),
    )


EFFECT = HubVibration()
