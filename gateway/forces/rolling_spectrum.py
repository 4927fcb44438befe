"""Running spectrum of what a revolution's radial axis differs from the average, over uninterrupted rolling."""

import math
from typing import Final

import numpy as np

from gateway.core.estimates.estimator import SETTLED_REVOLUTIONS, AngleAverage, Revolution, not_used
from gateway.core.estimates.reasons import EstimateCode
from gateway.core.reasons import CoreCode, Reason
from gateway.core.revolutions.angle_resampling import angle_grid
from gateway.core.revolutions.reasons import RevolutionCode
from gateway.core.revolutions.synchronous_average import DEFAULT_HORIZON_REVOLUTIONS
from gateway.core.types import FloatArray
from gateway.forces.nonsynchronous_spectrum import Spectrum, welch_spectrum

# The spectrum reaches 800 Hz in steps of 1 Hz. Cavity resonance lies at 190 to 250 Hz, the road below 500 Hz. The rate
# is much higher, so that noise above the band does not alias into it.
RATE_HZ: Final = 4000.0
SEGMENT: Final = 4000
BAND_HZ: Final = (5.0, 800.0)
SPECTRUM_S: Final = 4.0
"""Seconds of rolling per spectrum."""
# Weight of a new spectrum in the running mean.
_WEIGHT: Final = 0.25


class RollingSpectrum:
    """Spectrum over time of the signal that is not locked to the wheel, renewed every four seconds of rolling.

    Attributes:
        latest: running mean of the spectra; None before the first.
        highest_hz: frequency up to which it holds.
    """

    def __init__(self) -> None:
        """Start empty."""
        self.latest: Spectrum | None = None
        self.highest_hz = BAND_HZ[1]
        self._spectra = 0
        self._clear()

    def _clear(self) -> None:
        self._times: list[FloatArray] = []
        self._values: list[FloatArray] = []
        self._duration_s = 0.0
        self._next = -1

    def take(self, revolution: Revolution, average: AngleAverage) -> tuple[bool, Reason | None]:
        """Add a revolution; return whether the spectrum is a new one, and why the revolution cannot be used if so."""
        reason = _unusable(revolution, average)
        if reason is not None:
            self._clear()
            return False, reason
        if revolution.index != self._next or not revolution.follows:
            self._clear()
        self._add(revolution, average)
        is_new = False
        if self._duration_s >= SPECTRUM_S:
            is_new = self._renew()
            self._clear()
        self._next = revolution.index + 1
        return is_new, None

    def _add(self, revolution: Revolution, average: AngleAverage) -> None:
        """Add one revolution's difference from the average over time, decimated to what the spectrum needs."""
        # The average contains this revolution with this weight.
        weight = max(1.0 / average.count, 1.0 / DEFAULT_HORIZON_REVOLUTIONS)
        n = len(revolution.radial_mps2)
        difference = np.roll(revolution.radial_mps2 - average.radial_mps2, -(n // 2)) / (1.0 - weight)
        rate_hz = n / revolution.period_s
        block = 1 << max(0, min(4, math.floor(math.log2(max(rate_hz / RATE_HZ, 1.0)))))
        # Angle to time at constant acceleration about the middle of the revolution.
        middle = angle_grid(n)
        omega, drift = revolution.omega_radps, revolution.omega_dot_radps2
        start = -0.5 * drift * (0.5 * revolution.period_s) ** 2
        speed = np.sqrt(np.maximum(omega**2 + 2.0 * drift * (middle - start), 1e-12))
        time = self._duration_s + 0.5 * revolution.period_s + 2.0 * (middle - start) / (omega + speed)
        self._times.append(time.reshape(-1, block).mean(axis=1))
        self._values.append(difference.reshape(-1, block).mean(axis=1))
        self._duration_s += revolution.period_s

    def _renew(self) -> bool:
        """Update the spectrum; return whether there was enough signal for one."""
        times, values = np.concatenate(self._times), np.concatenate(self._values)
        regular_times = np.arange(times[0], times[-1], 1.0 / RATE_HZ)
        spectrum = welch_spectrum(np.interp(regular_times, times, values), RATE_HZ, SEGMENT)
        if spectrum is None:
            return False
        # Means over blocks and linear interpolation between them attenuate high frequencies; this is corrected.
        step_hz = len(times) / (times[-1] - times[0])
        density = spectrum.density_m2ps3 / np.sinc(np.minimum(spectrum.frequency_hz / step_hz, 0.6)) ** 6
        self._spectra += 1
        weight = max(1.0 / self._spectra, _WEIGHT)
        previous = density if self.latest is None else self.latest.density_m2ps3
        averages = spectrum.averages * min(self._spectra, 2.0 / _WEIGHT - 1.0)
        self.latest = Spectrum(spectrum.frequency_hz, previous + weight * (density - previous), averages)
        self.highest_hz = min(BAND_HZ[1], 0.4 * step_hz)
        return True


def _unusable(revolution: Revolution, average: AngleAverage) -> Reason | None:
    """Return why a revolution's difference from the average cannot be used; None when it can."""
    if revolution.faults:
        return not_used(revolution.faults)
    if revolution.missing_fraction:
        # Its gaps are filled with the shape of other revolutions, which differs from the average by nothing of its own.
        return not_used((Reason(EstimateCode.SAMPLES_LOST),))
    if average.effective_count < SETTLED_REVOLUTIONS:
        return Reason(CoreCode.NOT_SETTLED, revolutions=average.effective_count, needed=SETTLED_REVOLUTIONS)
    if not np.isfinite(revolution.radial_mps2 - average.radial_mps2).all():
        return Reason(RevolutionCode.AXIS_NOT_FINITE, axis="radial")
    return None
