"""Estimator of the signal that is not locked to the wheel, such as road and cavity resonance."""

import math
from typing import Final

from gateway.core.estimates.estimator import AngleAverage, Estimate, Revolution, Status, TireConditions
from gateway.core.reasons import Reason
from gateway.forces.nonsynchronous_spectrum import Spectrum, spectral_lines
from gateway.forces.reasons import ForceCode
from gateway.forces.rolling_spectrum import BAND_HZ, SPECTRUM_S, RollingSpectrum

NAMES: Final = ("asynchronous_rms_mps2", "asynchronous_line_hz", "asynchronous_line_rms_mps2")

# Distance of a line from a multiple of the wheel's frequency, in steps of the spectrum, within which it may be a part
# of the wheel-locked signal that the average has not removed.
LOCKED_WITHIN_STEPS: Final = 0.6


class NonsynchronousEstimator:
    """Root mean square of the signal not locked to the wheel, frequency and rms of its strongest line."""

    name = "asynchronous"

    def __init__(self) -> None:
        """Start empty."""
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self._spectrum = RollingSpectrum()
        self._latest: tuple[Estimate, ...] = ()

    def update(
        self,
        revolution: Revolution,
        average: AngleAverage,
        conditions: TireConditions,  # noqa: ARG002 - part of the interface
    ) -> tuple[Estimate, ...]:
        """Return asynchronous_rms_mps2 (5 to 800 Hz, sensor noise included), asynchronous_line_hz and its rms.

        They are updated every four seconds of uninterrupted rolling. Never raises on values.
        """
        is_new, reason = self._spectrum.take(revolution, average)
        if is_new and self._spectrum.latest is not None:
            self._latest = _estimates(
                self._spectrum.latest, self._spectrum.highest_hz, revolution.omega_radps / (2.0 * math.pi)
            )
        if not self._latest:
            waiting = reason or Reason(ForceCode.NEEDS_UNINTERRUPTED_ROLLING, duration_s=SPECTRUM_S)
            return tuple(Estimate.invalid(name, waiting) for name in NAMES)
        return self._latest


def _estimates(spectrum: Spectrum, high_hz: float, wheel_hz: float) -> tuple[Estimate, ...]:
    """Return the estimates from a new spectrum."""
    rms, rms_std = spectrum.rms_mps2(BAND_HZ[0], high_hz)
    lines = spectral_lines(spectrum, BAND_HZ[0], high_hz)
    band = Reason(ForceCode.IN_BAND, low_hz=BAND_HZ[0], high_hz=float(high_hz))
    overall = Estimate(NAMES[0], rms, rms_std, Status.VALID, (band,))
    if not lines:
        return (overall, *(Estimate.invalid(name, Reason(ForceCode.NO_LINE)) for name in NAMES[1:]))
    line = lines[0]
    doubts = wheel_order(line.frequency_hz, wheel_hz, spectrum.step_hz)
    status = Status.PROVISIONAL if doubts else Status.VALID
    return (
        overall,
        Estimate(NAMES[1], line.frequency_hz, line.frequency_std_hz, status, doubts),
        Estimate(NAMES[2], line.rms_mps2, line.rms_std_mps2, status, doubts),
    )


def wheel_order(frequency_hz: float, wheel_hz: float, step_hz: float) -> tuple[Reason, ...]:
    """Return the order of the wheel that a line may be locked to; nothing when it is at none."""
    order = frequency_hz / wheel_hz
    if abs(order - round(order)) * wheel_hz < LOCKED_WITHIN_STEPS * step_hz:
        return (Reason(ForceCode.AT_WHEEL_ORDER, order=round(order)),)
    return ()
