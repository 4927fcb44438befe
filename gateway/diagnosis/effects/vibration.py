"""Vibration that is not locked to the wheel: road texture, wheel hop, resonance of the air cavity.

All three are power spectral densities. Excitation by the road is proportional to speed, as its slopes are passed
faster. That of a narrow resonance depends on the road's spectrum: its growth is a parameter.
"""

import math
from typing import Final

import numpy as np

from gateway.core.types import FloatArray
from gateway.diagnosis.effects.effect import (
    CIRCUMFERENTIAL,
    LATERAL,
    RADIAL,
    Confounder,
    GroupConditions,
    Parameter,
    SpectrumEffect,
)


class RoadVibration(SpectrumEffect):
    """Broadband vibration below a corner frequency."""

    name = "road vibration"
    rank = 370
    summary = "The road's texture shakes the sensor with broadband noise below a corner, in proportion to the speed."
    equation = (
        "S(f) = (rms v / 65 km/h)^2 sin(pi / 2m) / (pi / 2m) / corner / (1 + (f / corner)^(2m)) on each axis, "
        "m the roll-off"
    )
    source = "empirical low-pass spectrum of unit power"
    # Sensors on inner liners read 0.1 to some 10 m/s^2 rms of road at 65 km/h; the tread and belt let through some
    # 100 Hz. A resonance's slope is m = 2, a single pole's m = 1.
    parameters = (
        Parameter("rms_mps2", "m/s^2", 0.01, 60.0, 10.0, 1e-4),
        Parameter("corner_hz", "Hz", 60.0, 1000.0, 300.0, 1e-2, prior_mean=400.0),
        Parameter("roll_off", "", 0.8, 6.0, 1.0, 1e-4, prior_mean=2.0),
    )
    axes = (CIRCUMFERENTIAL, LATERAL, RADIAL)
    observed_in = "all axes, in the non-synchronous spectrum; two speeds separate it from the sensor's noise"
    confounders = (
        Confounder(("sensor noise behind a low-pass",), "it does not grow with speed"),
        Confounder(("contact edge scatter",), "it occurs where the waveform is steep and mostly on the radial axis"),
    )
    # Low vibration below two corners.
    start_values = ((0.3, 150.0, 2.0), (0.3, 500.0, 2.0))

    def density(self, conditions: GroupConditions, frequency_hz: FloatArray, parameters: FloatArray) -> FloatArray:
        """Return the one-sided density, (3, m), (m/s^2)^2 per Hz."""
        rms = float(parameters[0]) * conditions.relative_speed
        shape = _low_pass(frequency_hz, float(parameters[1]), float(parameters[2]))[0]
        return np.tile(rms**2 * shape, (3, 1))

    def density_derivative(
        self, conditions: GroupConditions, frequency_hz: FloatArray, parameters: FloatArray
    ) -> FloatArray:
        """Return d density / d parameters, (P, 3, m), analytic."""
        speed = conditions.relative_speed
        rms = float(parameters[0])
        shape, per_corner, per_roll_off = _low_pass(frequency_hz, float(parameters[1]), float(parameters[2]))
        rows = np.stack((2.0 * rms * shape, rms**2 * per_corner, rms**2 * per_roll_off)) * speed**2
        return np.repeat(rows[:, None], 3, axis=1)


class HubVibration(SpectrumEffect):
    """Wheel hop, at the sum and the difference of its own and the wheel's frequency."""

    name = "hub vibration"
    title = "wheel hop"
    rank = 380
    summary = (
        "The unsprung mass bounces on the tire; the rotating sensor reads sidebands, the bounce's frequency plus and "
        "minus the wheel's, alike on radial and circumferential axis and in quadrature."
    )
    equation = (
        "S(f) = (B(|f - wheel|) + B(f + wheel)) / 4 on radial and circumferential, "
        "B(f) = (rms v / 65 km/h)^2 2 / (pi width) / (1 + ((f^2 - centre^2) / (f width))^2)"
    )
    source = "two-pole resonance seen from a rotating frame"
    # Wheel hop lies at 8 to 20 Hz, its damping ratio at 0.05 to 0.4.
    parameters = (
        Parameter("rms_mps2", "m/s^2", 0.01, 40.0, 5.0, 1e-4),
        Parameter("centre_hz", "Hz", 8.0, 20.0, 4.0, 1e-4, prior_mean=12.0),
        Parameter("width_hz", "Hz", 1.0, 16.0, 4.0, 1e-4, prior_mean=5.0),
    )
    axes = (CIRCUMFERENTIAL, RADIAL)
    observed_in = "radial and circumferential axis, in the non-synchronous spectrum below 50 Hz"
    confounders = (
        Confounder(("road vibration",), "it is broadband and on the lateral axis too"),
        Confounder(("torsional ripple",), "it is a line at an order"),
    )
    start_values = tuple((0.3, centre, 4.0) for centre in (9.0, 11.0, 13.5, 16.5, 19.0))

    def density(self, conditions: GroupConditions, frequency_hz: FloatArray, parameters: FloatArray) -> FloatArray:
        """Return the one-sided density, (3, m), (m/s^2)^2 per Hz."""
        lower, upper = _sidebands(conditions, frequency_hz, parameters)
        result = np.zeros((3, len(frequency_hz)))
        result[[CIRCUMFERENTIAL, RADIAL]] = _sideband_power(conditions, parameters) * (lower[0] + upper[0])
        return result

    def density_derivative(
        self, conditions: GroupConditions, frequency_hz: FloatArray, parameters: FloatArray
    ) -> FloatArray:
        """Return d density / d parameters, (P, 3, m), analytic."""
        lower, upper = _sidebands(conditions, frequency_hz, parameters)
        power = _sideband_power(conditions, parameters)
        sidebands = lower + upper
        per_rms = 0.5 * float(parameters[0]) * conditions.relative_speed**2 * sidebands[0]
        result = np.zeros((3, 3, len(frequency_hz)))
        for axis in self.axes:
            result[:, axis] = per_rms, power * sidebands[1], power * sidebands[2]
        return result

    def quadrature(self, conditions: GroupConditions, frequency_hz: FloatArray, parameters: FloatArray) -> FloatArray:
        """Return the imaginary part of the cross density of radial and circumferential axis, (m,).

        E[X_radial conj(X_circumferential)] of Fourier transforms X with exp(-2 pi i f t): the axes of a rotating sensor
        read a force of fixed direction in turn. Vertical or along the road, the magnitude is the same.
        """
        lower, upper = _sidebands(conditions, frequency_hz, parameters)
        result: FloatArray = _sideband_power(conditions, parameters) * (lower[0] - upper[0])
        return result


class CavityResonance(SpectrumEffect):
    """Narrow-band noise at the frequency of sound once round the tire, independent of speed."""

    name = "cavity resonance"
    rank = 390
    summary = "The tire's air column resonates: narrow-band noise on the radial axis at a frequency of its own."
    equation = "S(f) = (rms (v / 65 km/h)^growth)^2 2 / (pi width) / (1 + ((f^2 - centre^2) / (f width))^2), radial"
    source = "two-pole resonance; growth (w - 1) / 2 on a road whose spectrum falls with w, ISO 8608"
    # The speed of sound over a mean circumference of 1.4 to 2 m is 170 to 245 Hz; small and large tires lie beyond.
    parameters = (
        Parameter("rms_mps2", "m/s^2", 0.01, 60.0, 10.0, 1e-4),
        Parameter("centre_hz", "Hz", 150.0, 300.0, 40.0, 1e-3, prior_mean=222.0),
        Parameter("width_hz", "Hz", 1.5, 25.0, 6.0, 1e-4, prior_mean=6.0),
        # Roads fall with w from 1.5 to 3.5. A band that does not grow at all is not of the road.
        Parameter("growth", "", 0.2, 1.6, 0.25, 1e-4, prior_mean=0.9),
    )
    axes = (RADIAL,)
    observed_in = "radial axis, in the non-synchronous spectrum, any speed; two speeds fix its frequency"
    confounders = (
        Confounder(("an electrical tone",), "it is narrower, and its envelope is steady"),
        Confounder(("an order of the wheel",), "it moves with speed"),
        Confounder(("mounting resonance",), "it resonates on every axis that is loose"),
    )
    # Narrow peaks every few Hz over the range of tires.
    start_values = tuple((0.2, centre, 6.0, 0.9) for centre in np.arange(153.0, 300.0, 6.0).tolist())

    def density(self, conditions: GroupConditions, frequency_hz: FloatArray, parameters: FloatArray) -> FloatArray:
        """Return the one-sided density, (3, m), (m/s^2)^2 per Hz."""
        result = np.zeros((3, len(frequency_hz)))
        rms = float(parameters[0]) * conditions.relative_speed ** float(parameters[3])
        result[RADIAL] = rms**2 * _resonance(frequency_hz, float(parameters[1]), float(parameters[2]))[0]
        return result

    def density_derivative(
        self, conditions: GroupConditions, frequency_hz: FloatArray, parameters: FloatArray
    ) -> FloatArray:
        """Return d density / d parameters, (P, 3, m), analytic."""
        result = np.zeros((4, 3, len(frequency_hz)))
        rms, speed = float(parameters[0]), conditions.relative_speed
        shape, per_centre, per_width = _resonance(frequency_hz, float(parameters[1]), float(parameters[2]))
        per_growth = 2.0 * math.log(speed) * rms**2 * shape
        rows = np.stack((2.0 * rms * shape, rms**2 * per_centre, rms**2 * per_width, per_growth))
        result[:, RADIAL] = rows * speed ** (2.0 * float(parameters[3]))
        return result

    def noise_band(self, parameters: FloatArray) -> tuple[float, float]:
        """Return the band (from, to), Hz, in which its envelope must vary as that of noise, unlike that of a tone."""
        return float(parameters[1] - parameters[2]), float(parameters[1] + parameters[2])


def _resonance(
    frequency_hz: FloatArray, centre_hz: float, width_hz: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the density of unit power behind a two-pole resonance, and its derivatives.

    B(f) = 2 / (pi width) / (1 + ((f^2 - centre^2) / (f width))^2), integral 1 over f > 0; 0 at f = 0.

    Args:
        frequency_hz: (m,) not negative.
        centre_hz: of the resonance.
        width_hz: between the points of half the power.

    Returns:
        density, d density / d centre, d density / d width; (m,) each, per Hz.
    """
    frequency = np.maximum(frequency_hz, 1e-9)
    detuning = (frequency - centre_hz * (centre_hz / frequency)) / width_hz
    attenuation = 1.0 / (1.0 + np.square(detuning))
    density = (2.0 / (math.pi * width_hz)) * attenuation
    per_centre = density * attenuation * detuning * (4.0 * centre_hz / width_hz) / frequency
    per_width = density / width_hz * (2.0 * attenuation * np.square(detuning) - 1.0)
    return density, per_centre, per_width


def _low_pass(frequency_hz: FloatArray, corner_hz: float, roll_off: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the density of unit power of road vibration, and its derivatives by corner and roll-off."""
    x = np.maximum(frequency_hz, 1e-9) / corner_hz
    power = x ** (2.0 * roll_off)
    attenuation = 1.0 / (1.0 + power)
    # The integral is finite above m = 1/2 only; below, the shape is normalised as at the last m where it is.
    m = max(roll_off, 0.51)
    angle_rad = math.pi / (2.0 * m)
    level = math.sin(angle_rad) / angle_rad / corner_hz
    shape = level * attenuation
    per_corner = shape / corner_hz * (2.0 * roll_off * power * attenuation - 1.0)
    per_level = (1.0 - angle_rad / math.tan(angle_rad)) / m if roll_off > m - 1e-12 else 0.0
    per_roll_off = shape * (per_level - 2.0 * np.log(x) * power * attenuation)
    return shape, per_corner, per_roll_off


def _sideband_power(conditions: GroupConditions, parameters: FloatArray) -> float:
    return 0.25 * (float(parameters[0]) * conditions.relative_speed) ** 2


def _sidebands(
    conditions: GroupConditions, frequency_hz: FloatArray, parameters: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return resonance and derivatives, (3, m), as seen above the wheel's frequency and below it."""
    wheel_hz = conditions.omega_radps / (2.0 * math.pi)
    centre, width = float(parameters[1]), float(parameters[2])
    return (
        np.stack(_resonance(np.abs(frequency_hz - wheel_hz), centre, width)),
        np.stack(_resonance(frequency_hz + wheel_hz, centre, width)),
    )


EFFECTS: Final = (RoadVibration(), HubVibration(), CavityResonance())
