"""The air in the tire resonates round its circumference."""

from __future__ import annotations

import numpy as np

from gateway.closure.effects.base import NOWHERE, RADIAL, Conditions, Parameter, StartModel
from gateway.closure.effects.resonance_bell import bell, relative_speed
from gateway.types import FloatArray


class CavityResonance:
    """A bell of noise at the frequency of sound once round the tire, whatever the speed."""

    name = "cavity resonance"
    summary = "The tire's air column resonates: narrow-band noise on the radial axis at a frequency of its own."
    equation = "S(f) = (rms v / 65 km/h)^2 2 / (pi width) / (1 + ((f^2 - centre^2) / (f width))^2), radial"
    # The speed of sound over a mean circumference of 1.4 to 2 m is 170 to 245 Hz; small and large tires lie beyond.
    parameters: tuple[Parameter, ...] = (
        Parameter("rms_mps2", "m/s^2", 0.01, 60.0, 10.0, 1e-4),
        Parameter("centre_hz", "Hz", 150.0, 300.0, 40.0, 1e-3, prior_mean=222.0),
        Parameter("width_hz", "Hz", 1.5, 25.0, 6.0, 1e-4, prior_mean=6.0),
    )
    seen_by = "radial axis, in the spectrum of what the wheel does not repeat, any speed; two speeds fix it to Hz"
    confused_with = (
        "an electrical tone, which is narrower and does not fade in and out; an order of the wheel, which moves with "
        "speed; a loose sensor, which resonates on every axis that is loose"
    )
    already_in: frozenset[StartModel] = NOWHERE
    axes: tuple[int, ...] = (RADIAL,)
    # Where car tires have it; at one speed nothing else tells it from another resonance.
    usual: tuple[str, float, float] = ("centre_hz", 180.0, 260.0)

    def starts(self, conditions: tuple[Conditions, ...]) -> tuple[tuple[float, ...], ...]:
        """Return narrow bells every few Hz, over the range that tires have."""
        return tuple((0.2, centre, 6.0) for centre in np.arange(153.0, 300.0, 6.0).tolist())

    def density(self, conditions: Conditions, frequency_hz: FloatArray, parameters: FloatArray) -> FloatArray:
        """Return what it adds, (3, m), (m/s^2)^2 per Hz, one-sided."""
        result = np.zeros((3, len(frequency_hz)))
        rms = float(parameters[0]) * relative_speed(conditions)
        result[RADIAL] = rms**2 * bell(frequency_hz, float(parameters[1]), float(parameters[2]))[0]
        return result

    def density_derivative(
        self, conditions: Conditions, frequency_hz: FloatArray, parameters: FloatArray
    ) -> FloatArray:
        """Return d density / d parameters, (P, 3, m), analytic."""
        result = np.zeros((3, 3, len(frequency_hz)))
        rms = float(parameters[0])
        shape, per_centre, per_width = bell(frequency_hz, float(parameters[1]), float(parameters[2]))
        rows = np.stack((2.0 * rms * shape, rms**2 * per_centre, rms**2 * per_width))
        result[:, RADIAL] = rows * relative_speed(conditions) ** 2
        return result

    def noise_band(self, parameters: FloatArray) -> tuple[float, float]:
        """Return the band (from, to), Hz, in which it must fade in and out as noise does, and a tone does not."""
        return float(parameters[1] - parameters[2]), float(parameters[1] + parameters[2])


EFFECT = CavityResonance()
