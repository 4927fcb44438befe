"""Angular resampling: one revolution of samples on a uniform grid of the sensor's material angle.

The grid is theta_k = -pi + 2 pi k / n, 0 at the contact centre. A revolution runs from one contact centre to the next,
so theta in [0, pi) comes from its first half and theta in [-pi, 0) from its second half.

The interpolation is a B-spline through the samples: cubic where they are dense, quintic (within 2e-4 up to 0.18 and
3e-3 at 0.27 cycles per sample) where they are sparse. Where the sampling is much finer than the grid, a finer grid is
interpolated first and limited to the grid's band, so that noise above the band is removed and does not alias.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from scipy.ndimage import map_coordinates, spline_filter1d

from gateway.types import FloatArray

GRID_SIZE: Final = 1024

# Samples per revolution from which a cubic spline suffices: its error at order 60 is (60 / (samples - 60))^4 = 1e-4.
_CUBIC_FROM_SAMPLES: Final = 640.0

# Samples on either side that keep the spline's end condition (it decays by 0.43 per sample) out of the revolution.
MARGIN_SAMPLES: Final = 16

# Neighbouring periods with a larger ratio indicate a stop, a missed contact or a gap, not an acceleration.
_MAX_PERIOD_RATIO: Final = 3.0

# Finest sampling, in samples per grid point, that is interpolated on the grid directly: content above the grid's band
# then aliases only into orders above a quarter of the grid size.
_MAX_DENSITY: Final = 1.5


@dataclass(frozen=True, slots=True)
class Phase:
    """Angle against time over one revolution, at constant angular acceleration.

    theta(x) = rate (x - start) + acceleration (x - start)^2 / 2 with x in samples, 0 at `start` and 2 pi at `end`.

    Attributes:
        start: sample position of the first contact centre.
        end: sample position of the second.
        rate: rad/sample at `start`.
        acceleration: rad/sample^2.
    """

    start: float
    end: float
    rate: float
    acceleration: float

    @property
    def samples(self) -> float:
        """Length of the revolution in samples."""
        return self.end - self.start

    def positions(self, angles_rad: FloatArray) -> FloatArray:
        """Return the sample positions of angles in [0, 2 pi], same shape."""
        speed = self._speed(angles_rad)
        # 2 c / (b + sqrt(b^2 + 2 a c)) avoids cancellation and division by a vanishing acceleration.
        result: FloatArray = self.start + 2.0 * angles_rad / (self.rate + speed)
        return result

    def relative_speed(self, n: int = GRID_SIZE) -> FloatArray:
        """Return the speed on the angle grid over the revolution's mean speed, (n,)."""
        result: FloatArray = self._speed(elapsed_angles(n)) * (self.samples / (2.0 * math.pi))
        return result

    def _speed(self, angles_rad: FloatArray) -> FloatArray:
        result: FloatArray = np.sqrt(self.rate**2 + 2.0 * self.acceleration * angles_rad)
        return result


def angle_grid(n: int = GRID_SIZE) -> FloatArray:
    """Return theta_k = -pi + 2 pi k / n, (n,)."""
    grid: FloatArray = -math.pi + (2.0 * math.pi / n) * np.arange(n, dtype=np.float64)
    return grid


def elapsed_angles(n: int = GRID_SIZE) -> FloatArray:
    """Return the angle since the revolution's start of every grid point: theta modulo 2 pi, (n,)."""
    half = n // 2
    grid: FloatArray = (2.0 * math.pi / n) * np.roll(np.arange(n, dtype=np.float64), half)
    return grid


def fit_phase(start: float, end: float, previous: float | None = None, following: float | None = None) -> Phase:
    """Fit the phase of the revolution from `start` to `end`.

    Args:
        start: sample position of the revolution's first contact centre.
        end: sample position of its second.
        previous: contact centre before `start`, if the wheel rolled without interruption.
        following: contact centre after `end`, likewise; with both, the acceleration is that at mid revolution.

    Returns:
        The phase; with constant speed when neither neighbour is usable.

    Raises:
        ValueError: `end` is not after `start`, or either is not finite.
    """
    period = end - start
    if not (math.isfinite(period) and period > 0.0):
        raise ValueError(f"a revolution cannot run from sample {start} to {end}")
    accelerations = [
        # Constant angular acceleration through (-before, -2 pi), (0, 0), (after, 2 pi).
        4.0 * math.pi * (1.0 / after - 1.0 / before) / (before + after)
        for before, after in (
            (start - previous if previous is not None else math.nan, period),
            (period, following - end if following is not None else math.nan),
        )
        if before > 0.0 and after > 0.0 and 1.0 / _MAX_PERIOD_RATIO < before / after < _MAX_PERIOD_RATIO
    ]
    acceleration = sum(accelerations) / len(accelerations) if accelerations else 0.0
    # The speed must stay positive over the whole revolution: |a| T < 2 * mean speed.
    limit = 3.6 * math.pi / period**2
    acceleration = min(max(acceleration, -limit), limit)
    return Phase(start, end, 2.0 * math.pi / period - 0.5 * acceleration * period, acceleration)


def resample_revolution(samples_mps2: FloatArray, phase: Phase, n: int = GRID_SIZE) -> FloatArray:
    """Resample one revolution on the angle grid.

    Args:
        samples_mps2: (m, axes) samples uniform in time; row i is sample position i. `MARGIN_SAMPLES` rows on either
            side of the revolution avoid an end effect.
        phase: phase of the revolution, in positions of these rows.
        n: grid size, even.

    Returns:
        (axes, n) in the unit of the samples. An axis with values that are not finite stays not finite.

    Raises:
        ValueError: the samples do not cover the revolution, or `n` is odd or below 8.
    """
    if n < 8 or n % 2:
        raise ValueError(f"the angle grid needs an even size of at least 8, not {n}")
    rows = samples_mps2.shape[0]
    if phase.start < 0.0 or phase.end > rows - 1 or rows < 6:
        raise ValueError(f"{rows} samples do not cover a revolution from {phase.start:.1f} to {phase.end:.1f}")
    density = max(1, math.ceil(phase.samples / (_MAX_DENSITY * n)))
    positions = np.clip(phase.positions(elapsed_angles(n * density)), phase.start, phase.end)
    first = max(0, math.floor(phase.start) - MARGIN_SAMPLES)
    last = min(rows, math.ceil(phase.end) + MARGIN_SAMPLES + 1)
    # Axes first, so that filter and interpolation run along contiguous memory.
    samples = np.ascontiguousarray(samples_mps2[first:last].T, dtype=np.float64)
    order: Literal[3, 5] = 3 if phase.samples >= _CUBIC_FROM_SAMPLES else 5
    coefficients = spline_filter1d(samples, order=order, axis=1, mode="mirror")
    positions = (positions - first)[np.newaxis]
    fine = np.empty((samples.shape[0], n * density))
    for axis in range(samples.shape[0]):
        map_coordinates(coefficients[axis], positions, output=fine[axis], order=order, mode="mirror", prefilter=False)
    if density == 1:
        return fine
    # The inverse transform of the first n/2 + 1 bins is the fine curve without the orders above the grid's band.
    spectrum = np.fft.rfft(fine, axis=1)[:, : n // 2 + 1]
    spectrum[:, -1] = 0.0
    result: FloatArray = np.fft.irfft(spectrum, n=n, axis=1) / density
    return result
