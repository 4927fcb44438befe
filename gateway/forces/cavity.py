"""Estimator of the gas in the tire from the resonance of its cavity.

One wave of sound round the tire resonates at f = c / L, with c = sqrt(gamma R T / M) and L the mean circumference of
the gas. Under load the resonance splits in two, because the contact narrows the cavity; seen from the sensor, which
turns with the gas, the contact turns, and the two lie at f +- (sqrt(fw^2 + s^2) - fw), with 2 s the split at standstill
and fw the wheel's frequency (two coupled modes, as Feng and Gu have them, seen from the tire). They are
not resolved; s is part of the error.
"""

import math
from typing import Final

from gateway.core.constants import ZERO_CELSIUS_K
from gateway.core.estimates.estimator import DETERMINED, AngleAverage, Estimate, Revolution, Status, TireConditions
from gateway.core.reasons import Reason
from gateway.forces.nonsynchronous import wheel_order
from gateway.forces.nonsynchronous_spectrum import spectral_lines
from gateway.forces.reasons import ForceCode
from gateway.forces.rolling_spectrum import SPECTRUM_S, RollingSpectrum

NAMES: Final = ("cavity_hz", "cavity_temperature_degc", "cavity_gas_ratio")

# Dry air: ratio of specific heats, gas constant over molar mass in J/(kg K).
_GAMMA: Final = 1.400
_AIR_JPKGK: Final = 8.314462618 / 0.0289652
# Half the split at standstill: splits of 2 to 14 Hz were measured at rated load (Choi and Bolton, INTER-NOISE 2020, 24
# tires: AIP Advances 2026).
_HALF_SPLIT_HZ: Final = 3.5
_HALF_SPLIT_STD_HZ: Final = 1.5
# Gas and inner liner differ by some kelvin: the belt is the source of heat, the rim is cooler.
_LINER_TO_GAS_STD_K: Final = 6.0
# Temperatures of air between whose resonances the line is searched, and cavities of which nothing is stated. Gases from
# carbon dioxide to air with a third of helium sound like air far below and above the temperatures of a tire.
_COLDEST_K, _WARMEST_K = 150.0, 600.0
_ANY_CAVITY_HZ: Final = (120.0, 320.0)
# Largest error of the length with which the line is still the cavity's and not just any.
_LENGTH_STDS: Final = 2.0


class CavityEstimator:
    """Frequency of the cavity, and from it the temperature of air, or the gas at the measured temperature."""

    name = "cavity"

    def __init__(self) -> None:
        """Start empty."""
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self._spectrum = RollingSpectrum()
        self._latest: tuple[Estimate, ...] = ()

    def update(self, revolution: Revolution, average: AngleAverage, conditions: TireConditions) -> tuple[Estimate, ...]:
        """Return cavity_hz, cavity_temperature_degc if the gas is air, and cavity_gas_ratio.

        The ratio is the measured gamma / M over that of air at the measured temperature: 1 for air, 1.03 for nitrogen.
        They are updated every four seconds of uninterrupted rolling. Never raises on values.
        """
        is_new, reason = self._spectrum.take(revolution, average)
        if is_new:
            self._latest = self._estimates(revolution.omega_radps / (2.0 * math.pi), conditions)
        if not self._latest:
            waiting = reason or Reason(ForceCode.NEEDS_UNINTERRUPTED_ROLLING, duration_s=SPECTRUM_S)
            return tuple(Estimate.invalid(name, waiting) for name in NAMES)
        return self._latest

    def _estimates(self, wheel_hz: float, conditions: TireConditions) -> tuple[Estimate, ...]:
        spectrum = self._spectrum.latest
        if spectrum is None:
            return ()
        length, length_std = conditions.tire.cavity_length_m, conditions.tire.cavity_length_std_m
        low, high = _ANY_CAVITY_HZ
        if length is not None:
            tolerance = _LENGTH_STDS * length_std / length
            low = _sound_mps(_COLDEST_K) / length * (1.0 - tolerance)
            high = _sound_mps(_WARMEST_K) / length * (1.0 + tolerance)
        lines = spectral_lines(spectrum, low, min(high, self._spectrum.highest_hz))
        if not lines:
            return tuple(Estimate.invalid(name, Reason(ForceCode.NO_LINE)) for name in NAMES)
        line = lines[0]
        doubts = wheel_order(line.frequency_hz, wheel_hz, spectrum.step_hz)
        # Which of the two is louder is not known: the one that is seen lies anywhere between them.
        half_width_hz = math.hypot(wheel_hz, math.hypot(_HALF_SPLIT_HZ, _HALF_SPLIT_STD_HZ)) - wheel_hz
        std = math.hypot(line.frequency_std_hz, half_width_hz / math.sqrt(3.0))
        status = Status.PROVISIONAL if doubts else Status.VALID
        frequency = Estimate(NAMES[0], line.frequency_hz, std, status, doubts)
        if length is None:
            missing = Reason(ForceCode.NEEDS_CAVITY_LENGTH)
            return (frequency, *(Estimate.invalid(name, missing) for name in NAMES[1:]))
        relative = 2.0 * math.hypot(std / line.frequency_hz, length_std / length)
        kelvin = (line.frequency_hz * length) ** 2 / (_GAMMA * _AIR_JPKGK)
        measured = conditions.temperature_degc
        if measured is None:
            temperature = Estimate(NAMES[1], kelvin - ZERO_CELSIUS_K, relative * kelvin, status, doubts)
            return (frequency, temperature, Estimate.invalid(NAMES[2], Reason(ForceCode.NEEDS_TEMPERATURE)))
        at_k = measured + ZERO_CELSIUS_K
        ratio = kelvin / at_k
        ratio_std = ratio * math.hypot(relative, _LINER_TO_GAS_STD_K / at_k)
        if abs(ratio - 1.0) > DETERMINED * ratio_std:
            status = Status.PROVISIONAL
            contradiction = Reason(
                ForceCode.CAVITY_CONTRADICTED, measured_degc=measured, found_degc=kelvin - ZERO_CELSIUS_K, ratio=ratio
            )
            # Another gas, or the line of something else: a motor, a road surface.
            doubts = (contradiction, *doubts)
        return (
            frequency._replace(status=status, reasons=doubts),
            Estimate(NAMES[1], kelvin - ZERO_CELSIUS_K, relative * kelvin, status, doubts),
            Estimate(NAMES[2], ratio, ratio_std, status, doubts),
        )


def _sound_mps(kelvin: float) -> float:
    """Return the speed of sound in air."""
    return math.sqrt(_GAMMA * _AIR_JPKGK * kelvin)
