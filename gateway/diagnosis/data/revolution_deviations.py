"""Deviations of single revolutions from the mean of their group, on the time axis."""

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import convolve1d, map_coordinates, spline_filter1d

from gateway.core.revolutions.angle_resampling import angle_grid
from gateway.core.types import BoolArray, FloatArray
from gateway.diagnosis.data.campaign_data import AngleScatter
from gateway.diagnosis.data.revolution_scatter import regress, regressors
from gateway.diagnosis.effects.effect import RADIAL

HIGHEST_RATE_HZ: Final = 4000.0
# The bandwidth of sampling and angle grid, 0.28 of their rate, equals the filter's pass band, 0.45 of its own rate.
_BAND_RATIO: Final = 0.62
# The uniform grid before decimation is finer than the angle grid, so that nothing aliases into the band.
_OVERSAMPLING: Final = 1.25
_TAPS: Final = 32
_EDGE_SAMPLES: Final = 16
_SPLINE: Final = 5
CELLS: Final = 64
"""Angles of a profile: 0.1 rad each, the width of a burst that a wheel's turn smears."""

# Fewer revolutions do not show what is rare.
_MIN_REVOLUTIONS: Final = 12
# Share of the revolutions that is left out of a cell: those of the largest power.
_TRIMMED_SHARE: Final = 0.05
# Share of the largest powers, burst excepted, below which a cell of a clipped signal has next to no scatter: noise is
# never so uneven, whereas the end of the range leaves a fraction of a count.
_FLAT_SHARE: Final = 0.01
_LARGE_QUANTILE: Final = 0.95


def angle_scatter(
    residuals: FloatArray, present: BoolArray, index: NDArray[np.integer], *, clipped: bool = False
) -> AngleScatter | None:
    """Return the power of deviations by angle; None for too few revolutions.

    Args:
        residuals: (n, 3, grid) deviations of revolutions from their mean, in order of time, theta from -pi.
        present: (3,) axes.
        index: (n,) running numbers of the revolutions.
        clipped: whether the radial axis reaches the end of its range in some of them.
    """
    count = len(residuals)
    if count < _MIN_REVOLUTIONS:
        return None
    parts = residuals.reshape(count, 3, CELLS, -1)
    cells = np.square(parts).mean(axis=-1)
    at_limit = np.zeros((3, CELLS), dtype=bool)
    if clipped:
        mean = cells[:, RADIAL].mean(axis=0)
        at_limit[RADIAL] = mean < _FLAT_SHARE * np.quantile(mean, _LARGE_QUANTILE)
    # The scatter of a cell's power from turn to turn, in the median cell, which holds noise.
    relative = cells.std(axis=0) / np.maximum(cells.mean(axis=0), 1e-30)
    spread = np.array([np.median(relative[axis, ~at_limit[axis]]) for axis in range(3)])
    # The largest of every cell are left out: a few turns in which the speed or the load changed are no scatter.
    untrimmed_cells = _untrimmed(cells)
    power = np.where(untrimmed_cells, cells, 0.0).sum(axis=0) / untrimmed_cells.sum(axis=0)
    # The turn in which a load or a gain steps is no scatter either.
    changes = np.diff(parts, axis=0)
    steps = 0.5 * np.square(changes, out=changes).mean(axis=-1)
    untrimmed_steps = _untrimmed(steps)
    successive = np.where(untrimmed_steps, steps, 0.0).sum(axis=0) / untrimmed_steps.sum(axis=0)
    sign = np.where(np.asarray(index) % 2, -1.0, 1.0)
    swing = np.tensordot(sign - sign.mean(), np.where(untrimmed_cells[..., None], parts, 0.0), axes=1) / np.sqrt(count)
    alternating = np.square(swing).reshape(3, CELLS, -1).mean(axis=-1)
    freedom = np.where(present, 1.0 / np.square(np.maximum(spread, 1e-3)), 0.0)
    # Noise is what most of a turn holds.
    freedom[at_limit.mean(axis=1) > 0.5] = 0.0
    return AngleScatter(power, successive, alternating, freedom, count, at_limit)


def _untrimmed(powers: FloatArray) -> BoolArray:
    """Return which of (n, 3, cells) powers are not among the largest of their cell."""
    count = len(powers)
    untrimmed: BoolArray = powers <= np.sort(powers, axis=0)[count - 1 - max(1, round(_TRIMMED_SHARE * count))]
    return untrimmed


def deviation_rate_hz(rate_hz: float, grid_rate_hz: float) -> float:
    """Return the sampling rate of deviations: 4 kHz, or less if the sampling or the angle grid limit the bandwidth."""
    return min(HIGHEST_RATE_HZ, _BAND_RATIO * rate_hz, _BAND_RATIO * grid_rate_hz)


@dataclass(frozen=True, slots=True)
class Deviations:
    """Deviations of single revolutions from the mean of their group.

    Attributes:
        runs: a (3, k) float32 array on the time axis for each uninterrupted run of revolutions; none for too few.
        by_angle: their power by angle; None likewise.
    """

    runs: tuple[FloatArray, ...] = ()
    by_angle: AngleScatter | None = None


def deviations(
    waveforms_mps2: NDArray[np.float32],
    *,
    index: NDArray[np.integer],
    shift_rad: FloatArray,
    period_s: FloatArray,
    omega_radps: FloatArray,
    omega_dot_radps2: FloatArray,
    rate_hz: float,
    clipped: bool = False,
) -> Deviations:
    """Return the revolutions minus their mean as predicted at their speed.

    The power is corrected for the degrees of freedom of the mean: it is that of the deviation from the true mean.

    Args:
        waveforms_mps2: (n, 3, grid) in time order; NaN rows for absent axes.
        index: (n,) running numbers; a run ends where they are not consecutive.
        shift_rad: (n,) rotation of each, as in `Settled`.
        period_s: (n,).
        omega_radps: (n,).
        omega_dot_radps2: (n,).
        rate_hz: sampling rate of the result, from `deviation_rate_hz`; the response is flat to 0.4 of it.
        clipped: whether the radial axis reaches the end of its range in some of them.
    """
    count, _, grid = waveforms_mps2.shape
    if count < 2:
        return Deviations()
    spectra = np.fft.rfft(waveforms_mps2.astype(np.float64), axis=-1)
    spectra *= np.exp(-1j * np.arange(grid // 2 + 1) * shift_rad[:, None, None])
    present: BoolArray = np.logical_and.reduce(np.isfinite(spectra), axis=(0, 2))
    spectra[:, ~present] = 0.0
    fitted, used = regress(spectra, regressors(omega_radps, omega_dot_radps2), np.ones(count, dtype=bool))
    if count <= used:
        return Deviations()
    residuals = np.fft.irfft(spectra - fitted, n=grid, axis=-1) * math.sqrt(count / (count - used))
    by_angle = angle_scatter(residuals, present, index, clipped=clipped)
    # From theta in [-pi, pi) to the time since the contact: the second half of the grid comes first.
    residuals = np.roll(residuals, -(grid // 2), axis=-1)
    breaks = [0, *(np.flatnonzero(np.diff(index) != 1) + 1).tolist(), count]
    runs = []
    for begin, end in pairwise(breaks):
        part = slice(begin, end)
        times = _times(period_s[part], omega_radps[part], omega_dot_radps2[part], grid)
        run = _resampled(times, residuals[part].transpose(1, 0, 2).reshape(3, -1), rate_hz, present)
        if run is not None:
            runs.append(run)
    return Deviations(tuple(runs), by_angle)


def _times(period_s: FloatArray, omega_radps: FloatArray, omega_dot_radps2: FloatArray, grid: int) -> FloatArray:
    """Return the times of all grid points of consecutive revolutions, constant acceleration within each."""
    angle_rad = angle_grid(grid)
    start = -0.5 * omega_dot_radps2 * np.square(0.5 * period_s)
    rolled_rad = angle_rad - start[:, None]
    omega, drift = omega_radps[:, None], omega_dot_radps2[:, None]
    speed = np.sqrt(np.maximum(np.square(omega) + 2.0 * drift * rolled_rad, 1e-12))
    begin = np.concatenate(([0.0], np.cumsum(period_s)[:-1]))
    times: FloatArray = (begin + 0.5 * period_s)[:, None] + 2.0 * rolled_rad / (omega + speed)
    return times.ravel()


def _resampled(times: FloatArray, values: FloatArray, rate_hz: float, present: BoolArray) -> FloatArray | None:
    """Return values (3, m) at almost uniform times as (3, k) float32 at `rate_hz`, low-pass filtered for that rate."""
    input_hz = (len(times) - 1) / (times[-1] - times[0])
    decimation = max(1, math.ceil(_OVERSAMPLING * input_hz / rate_hz))
    uniform_s = np.arange(times[0], times[-1], 1.0 / (decimation * rate_hz))
    if len(uniform_s) < (2 * _EDGE_SAMPLES + 4) * decimation:
        return None
    places = np.interp(uniform_s, times, np.arange(len(times), dtype=np.float64))[None]
    taps = _low_pass(_TAPS * decimation + 1, 0.45 / decimation)
    length = len(range(0, len(uniform_s), decimation)) - 2 * _EDGE_SAMPLES
    result = np.full((3, length), np.nan, dtype=np.float32)
    for axis in np.flatnonzero(present):
        spline = spline_filter1d(values[axis], order=_SPLINE, mode="mirror")
        fine = map_coordinates(spline, places, order=_SPLINE, mode="mirror", prefilter=False)
        result[axis] = convolve1d(fine, taps, mode="mirror")[::decimation][_EDGE_SAMPLES : _EDGE_SAMPLES + length]
    return result  # type: ignore[return-value]  # float32 halves the memory and is precise enough


def _low_pass(taps: int, cutoff: float) -> FloatArray:
    """Return a low-pass filter of odd length, cutoff in cycles per sample: a sinc under a Hamming window."""
    offset = np.arange(taps) - taps // 2
    response: FloatArray = np.sinc(2.0 * cutoff * offset) * np.hamming(taps)
    normal: FloatArray = response / response.sum()
    return normal
