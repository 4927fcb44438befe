"""Estimator of the signal that is not locked to the wheel, such as road and cavity resonance."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from gateway.estimators.determination import SETTLED_REVOLUTIONS
from gateway.estimators.estimator import AngleAverage, Estimate, Revolution, Status, TireConditions, not_used
from gateway.reasons import Code, Reason
from gateway.signal.angle_resampling import angle_grid
from gateway.signal.nonsynchronous_spectrum import Spectrum, spectral_lines, welch_spectrum
from gateway.signal.synchronous_average import DEFAULT_HORIZON_REVOLUTIONS
from gateway.types import FloatArray

NAMES: Final = ("asynchronous_rms_mps2", "asynchronous_line_hz", "asynchronous_line_rms_mps2")

# The spectrum reaches 800 Hz in steps of 1 Hz. Cavity resonance lies at 190 to 250 Hz, the road below 500 Hz. The rate
# is much higher, so that noise above the band does not alias into it.
RATE_HZ: Final = 4000.0
SEGMENT: Final = 4000
BAND_HZ: Final = (5.0, 800.0)
# Seconds of rolling per spectrum, and weight of a new spectrum in the running mean.
_SPECTRUM_S: Final = 4.0
_WEIGHT: Final = 0.25
# Distance of a line from a multiple of the wheel's frequency, in steps of the spectrum, within which it may be a part
# of the wheel-locked signal that the average has not removed.
_LOCKED_WITHIN_STEPS: Final = 0.6


class NonsynchronousEstimator:
    """Root mean square of the signal not locked to the wheel, frequency and rms of its strongest line."""

    def __init__(self) -> None:
        """Start empty."""
        self.reset()

    @property
    def name(self) -> str:
        """Name in the registry."""
        return "asynchronous"

    def reset(self) -> None:
        """Forget everything."""
        self._clear()
        self._spectrum: Spectrum | None = None
        self._spectra = 0
        self._found: tuple[Estimate, ...] = ()

    def _clear(self) -> None:
        self._times: list[FloatArray] = []
        self._values: list[FloatArray] = []
        self._duration_s = 0.0
        self._next = -1

    def update(
        self,
        revolution: Revolution,
        average: AngleAverage,
        conditions: TireConditions,  # noqa: ARG002 - part of the interface
    ) -> tuple[Estimate, ...]:
        """Return asynchronous_rms_mps2 (5 to 800 Hz, sensor noise included), asynchronous_line_hz and its rms.

        They are updated every four seconds of uninterrupted rolling. Never raises on values.
        """
        reason = _unusable(revolution, average)
        if reason is not None:
            self._clear()
        else:
            if revolution.index != self._next:
                self._clear()
            self._take(revolution, average)
            if self._duration_s >= _SPECTRUM_S:
                self._look(revolution.omega_radps / (2.0 * math.pi))
                self._clear()
            self._next = revolution.index + 1
        if not self._found:
            waiting = reason or Reason(Code.NEEDS_UNINTERRUPTED_ROLLING, duration_s=_SPECTRUM_S)
            return tuple(Estimate.invalid(name, waiting) for name in NAMES)
        return self._found

    def _take(self, revolution: Revolution, average: AngleAverage) -> None:
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

    def _look(self, wheel_hz: float) -> None:
        """Update the spectrum and the estimates from it."""
        times, values = np.concatenate(self._times), np.concatenate(self._values)
        even = np.arange(times[0], times[-1], 1.0 / RATE_HZ)
        fresh = welch_spectrum(np.interp(even, times, values), RATE_HZ, SEGMENT)
        if fresh is None:
            return
        # Means over blocks and linear interpolation between them attenuate high frequencies; this is corrected.
        step_hz = len(times) / (times[-1] - times[0])
        density = fresh.density_m2ps3 / np.sinc(np.minimum(fresh.frequency_hz / step_hz, 0.6)) ** 6
        self._spectra += 1
        share = max(1.0 / self._spectra, _WEIGHT)
        old = density if self._spectrum is None else self._spectrum.density_m2ps3
        averages = fresh.averages * min(self._spectra, 2.0 / _WEIGHT - 1.0)
        self._spectrum = Spectrum(fresh.frequency_hz, old + share * (density - old), averages)
        high = min(BAND_HZ[1], 0.4 * step_hz)
        rms, rms_std = self._spectrum.rms_mps2(BAND_HZ[0], high)
        lines = spectral_lines(self._spectrum, BAND_HZ[0], high)
        band = Reason(Code.IN_BAND, low_hz=BAND_HZ[0], high_hz=float(high))
        overall = Estimate(NAMES[0], rms, rms_std, Status.VALID, (band,))
        if not lines:
            self._found = (overall, *(Estimate.invalid(name, Reason(Code.NO_LINE)) for name in NAMES[1:]))
            return
        line = lines[0]
        order = line.frequency_hz / wheel_hz
        locked = abs(order - round(order)) * wheel_hz < _LOCKED_WITHIN_STEPS * self._spectrum.step_hz
        doubts = (Reason(Code.AT_WHEEL_ORDER, order=round(order)),) if locked else ()
        status = Status.PROVISIONAL if locked else Status.VALID
        self._found = (
            overall,
            Estimate(NAMES[1], line.frequency_hz, line.frequency_std_hz, status, doubts),
            Estimate(NAMES[2], line.rms_mps2, line.rms_std_mps2, status, doubts),
        )


def _unusable(revolution: Revolution, average: AngleAverage) -> Reason | None:
    """Return why a revolution's difference from the average cannot be used; None when it can."""
    if revolution.faults:
        return not_used(revolution.faults)
    if average.effective_count < SETTLED_REVOLUTIONS:
        return Reason(Code.NOT_SETTLED, revolutions=average.effective_count, needed=SETTLED_REVOLUTIONS)
    if not np.isfinite(revolution.radial_mps2 - average.radial_mps2).all():
        return Reason(Code.AXIS_NOT_FINITE, axis="radial")
    return None
