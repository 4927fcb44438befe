"""What is known of a sensor itself: its band, AC corner and amplitude steps, and what they bias.

Beyond the limits a number is biased by more than a percent on simulated drives. Its error then contains the size of the
bias, by what causes it:

- A band of corner w smears a contact edge over the time 1 / w, in which the wheel turns by Omega / w, of the angle of
  contact.
- An AC coupling of corner c passes the share 1 / (1 - i c / n) of order n, which is undone: of order 1, the slowest,
  the corner's tolerance times c / sqrt(1 + c^2) remains, c in units of the wheel's frequency.
- Steps that no noise blurs leave step / sqrt(12) in every sample, of the little that the signal varies away from the
  contact, on which Ts rests.
- A value held over h samples is a band of 0.44 / h of the sampling rate, where such a hold passes half the power.
"""

import math
from collections.abc import Iterator
from statistics import median
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_protocol.messages import Axis, Hello
from gateway.core.estimates.estimator import Revolution
from gateway.core.estimates.sensor_claims import CORNER_TOLERANCE
from gateway.core.quantity import Basis
from gateway.core.reasons import Reason
from gateway.core.trust.reasons import TrustCode

# Of the wheel's frequency: two poles at 60 lengthen the contact by 2 %; a corner at 0.12 that is not undone raises Ts
# by 2 %.
_MIN_BAND_RATIO: Final = 60.0
_MAX_CORNER_RATIO: Final = 0.1
# Steps over the noise beneath them, which blurs those that are smaller.
_STEP_NOISE_RATIO: Final = 2.0
# Steps of 0.5 % of R Omega^2 raise Ts by 17 %, as those of 0.1 % by its own error.
_MIN_STEP_SHARE: Final = 1e-3
# Frequency where a hold passes half the power, times its duration.
_HOLD_BANDWIDTH: Final = 0.443
# Steps of a change that the converter alone does not make, and such changes of a revolution that show a hold.
_CHANGE_STEPS: Final = 4.0
_MIN_CHANGES: Final = 6
# Revolutions that are looked at for steps.
_EXAMINED_REVOLUTIONS: Final = 8
# Of the gaps between values: samples of a fast edge lie many steps apart, those away from the contact one.
_SMALL_GAPS: Final = 0.1
# Of the gaps below one and a half steps, those of one step: within a count, as a step need not be a whole number.
_ONE_STEP_SHARE: Final = 0.5


class Doubt(NamedTuple):
    """A reason against every estimate that rests on a basis.

    Attributes:
        basis: on which an estimate rests; None for every one.
        reason: what is against it.
        share: of its value by which it may be biased, a part of its error.
    """

    basis: Basis | None
    reason: Reason
    share: float = 0.0


def narrow_band(bandwidth_hz: float | None, wheel_hz: float) -> Reason | None:
    """Return why a band is too narrow, None where it is not or is not known; `wheel_hz` is positive."""
    if bandwidth_hz is None or bandwidth_hz >= _MIN_BAND_RATIO * wheel_hz:
        return None
    return Reason(TrustCode.SENSOR_BAND, ratio=bandwidth_hz / wheel_hz)


def high_corner(highpass_hz: float | None, wheel_hz: float) -> Reason | None:
    """Return why the corner of an AC coupling is too high, None where it is not or is not known."""
    if highpass_hz is None or highpass_hz <= _MAX_CORNER_RATIO * wheel_hz:
        return None
    return Reason(TrustCode.SENSOR_AC_CORNER, ratio=highpass_hz / wheel_hz)


def coarse_steps(step_mps2: float, noise_mps2: float) -> Reason | None:
    """Return why steps are too coarse, None where noise of this standard deviation blurs them."""
    return Reason(TrustCode.SENSOR_STEPS, step_mps2=step_mps2) if step_mps2 > _STEP_NOISE_RATIO * noise_mps2 else None


def step_counts(counts: NDArray[np.int16]) -> float:
    """Return the step of samples in counts, which may be of a coarser sensor; 1 where none shows.

    The smallest gaps between the values of a coarse sensor are all one step; those of a fine one are of every size.
    Steps of floating point grow with the value: those of the larger half of the values count, about the steady one.
    """
    values = np.unique(counts[np.abs(counts) >= np.median(np.abs(counts))])
    if len(values) < 2:
        values = np.unique(counts)
    gaps = np.diff(values.astype(np.float64))
    if not len(gaps):
        return 1.0
    step = float(np.quantile(gaps, _SMALL_GAPS, method="lower"))
    small_gaps = gaps[gaps < 1.5 * step]
    step_share = np.mean(np.abs(small_gaps - step) <= 1.0)
    return step if step_share >= _ONE_STEP_SHARE else 1.0


def held_samples(counts: NDArray[np.int16], step: float) -> float:
    """Return over how many samples a value is held, as by a hub that polls a slower sensor; 1 where none shows.

    A coarse sensor rests between steps too, but not while its values change by several steps from sample to sample.

    Args:
        counts: (n,) samples.
        step: of the values, in counts.
    """
    changes = np.diff(counts.astype(np.int32))
    changed = np.flatnonzero(changes)
    durations = np.diff(changed)[np.abs(changes[changed[:-1]]) > _CHANGE_STEPS * step]
    return float(np.median(durations)) if len(durations) >= _MIN_CHANGES else 1.0


class SensorLimits:
    """Limits of one sensor."""

    def __init__(self, hello: Hello, bandwidth_hz: float | None, *, ac_coupled: bool) -> None:
        """Take what the hub and the configuration state."""
        self._bandwidth_hz = bandwidth_hz
        self._hold_samples: list[float] = []
        self._highpass_hz = hello.highpass_hz if ac_coupled and hello.highpass_hz > 0.0 else None
        self._count_mps2 = abs(hello.scale_mps2[Axis.RADIAL])
        self._steps: list[float] = []
        self._step_mps2 = 0.0
        # Of the latest revolution whose contacts were seen; without one the bias by a band has no size yet.
        self._contact_rad = math.inf

    def doubts(self, revolution: Revolution, counts: NDArray[np.int16], radius_m: float) -> Iterator[Doubt]:
        """Yield what they bias of a revolution, and why; `counts` are its samples of the radial axis."""
        if not revolution.omega_radps > 0.0:
            return
        wheel_hz = revolution.omega_radps / (2.0 * math.pi)
        if len(self._steps) < _EXAMINED_REVOLUTIONS:
            step = step_counts(counts)
            self._steps.append(step)
            self._hold_samples.append(held_samples(counts, step))
            self._step_mps2 = self._count_mps2 * median(self._steps)
        hold_samples, bandwidth_hz = median(self._hold_samples), self._bandwidth_hz
        if hold_samples > 1.0:
            bandwidth_hz = min(bandwidth_hz or math.inf, _HOLD_BANDWIDTH * revolution.rate_hz / hold_samples)
        if (band := narrow_band(bandwidth_hz, wheel_hz)) is not None:
            assert bandwidth_hz is not None
            if hold_samples > 1.0:
                band = Reason(TrustCode.SAMPLES_HELD, count=hold_samples, ratio=bandwidth_hz / wheel_hz)
            contact_rad = revolution.trailing_edge_rad - revolution.leading_edge_rad
            if math.isfinite(contact_rad):
                self._contact_rad = contact_rad
            yield Doubt(Basis.SAMPLES, band, wheel_hz / (bandwidth_hz * self._contact_rad))
        if (corner := high_corner(self._highpass_hz, wheel_hz)) is not None:
            assert self._highpass_hz is not None
            share = CORNER_TOLERANCE * self._highpass_hz / math.hypot(self._highpass_hz, wheel_hz)
            yield Doubt(Basis.COUPLING, corner, share)
        step_mps2 = self._step_mps2
        if step_mps2 > _MIN_STEP_SHARE * radius_m * revolution.omega_radps**2:
            # Of a sample: on the angle grid, more samples than its points are averaged.
            samples = revolution.rate_hz * revolution.period_s / revolution.turns
            noise_mps2 = revolution.noise_mps2 * math.sqrt(max(samples / len(revolution.radial_mps2), 1.0))
            noise_floor_mps2 = math.sqrt(max(noise_mps2**2 - step_mps2**2 / 12.0, 0.0))
            if (steps := coarse_steps(step_mps2, noise_floor_mps2)) is not None:
                yield Doubt(Basis.WAVEFORM, steps, step_mps2 / math.sqrt(12.0) / _variation_mps2(revolution))


def _variation_mps2(revolution: Revolution) -> float:
    """Return the standard deviation of the signal in the half of the revolution that is away from the contact."""
    n = len(revolution.radial_mps2)
    far_samples = np.concatenate([revolution.radial_mps2[: n // 4], revolution.radial_mps2[-(n // 4) :]])
    return max(float(far_samples.std()), 1e-9)
