"""Angular resampling: one revolution of samples on a uniform grid of the sensor's material angle.

The grid is theta_k = -pi + 2 pi k / n, 0 at the contact centre. A revolution runs from one contact centre to the next,
so theta in [0, pi) comes from its first half and theta in [-pi, 0) from its second half.

The interpolation is a B-spline through the samples: cubic where they are dense, quintic (within 2e-4 up to 0.18 and
3e-3 at 0.27 cycles per sample) where they are sparse. Where the sampling is much finer than the grid, a finer grid is
interpolated first and limited to the grid's band, so that noise above the band is removed and does not alias.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from copy import copy
from functools import cache, lru_cache
from typing import TYPE_CHECKING, Any, Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gateway.core.compiled import core
from gateway.core.types import BoolArray, FloatArray

if TYPE_CHECKING:
    from scipy.sparse import csr_array

GRID_SIZE: Final = 1024

# Samples per revolution from which a cubic spline suffices: its error at order 60 is (60 / (samples - 60))^4 = 1e-4.
_CUBIC_FROM_SAMPLES: Final = 640.0

# Samples on either side that keep the spline's end condition (it decays by 0.43 per sample) out of the revolution.
MARGIN_SAMPLES: Final = 16

# Samples on either side of a gap that the interpolation draws towards it: an error decays by 0.43 a sample.
_GAP_MARGIN_SAMPLES: Final = 3

# Neighbouring periods with a larger ratio indicate a stop, a missed contact or a gap, not an acceleration.
_MAX_PERIOD_RATIO: Final = 3.0

# Finest sampling, in samples per grid point, that is interpolated on the grid directly: content above the grid's band
# then aliases only into orders above a quarter of the grid size.
_MAX_DENSITY: Final = 1.5

# Samples by which a row of samples is continued by reflection: as many as the interpolation reads before the first, and
# enough behind the last that rows of different lengths get their own coefficients to the last bit.
LEFT_PAD: Final = 3
_RIGHT_PAD: Final = {3: 28, 5: 44}

# Rows of samples have lengths of multiples of this, so that the matrices that read them have few shapes.
_LENGTH_STEP: Final = 32

# Revolutions interpolated at once; more no longer fit into the processor's cache.
_BATCH_SIZE: Final = 8


class Phase(NamedTuple):
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

    def _speed(self, angles_rad: FloatArray) -> FloatArray:
        result: FloatArray = np.sqrt(self.rate**2 + 2.0 * self.acceleration * angles_rad)
        return result


@cache
def angle_grid(n: int = GRID_SIZE) -> FloatArray:
    """Return theta_k = -pi + 2 pi k / n, (n,), read-only."""
    grid: FloatArray = -math.pi + (2.0 * math.pi / n) * np.arange(n, dtype=np.float64)
    grid.setflags(write=False)
    return grid


@cache
def elapsed_angles(n: int = GRID_SIZE) -> FloatArray:
    """Return the angle since the revolution's start of every grid point: theta modulo 2 pi, (n,), read-only."""
    half = n // 2
    grid: FloatArray = (2.0 * math.pi / n) * np.roll(np.arange(n, dtype=np.float64), half)
    grid.setflags(write=False)
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
    acceleration, terms = 0.0, 0
    if previous is not None and _are_neighbours(start - previous, period):
        acceleration, terms = _acceleration(start - previous, period), 1
    if following is not None and _are_neighbours(period, following - end):
        acceleration, terms = acceleration + _acceleration(period, following - end), terms + 1
    acceleration /= terms or 1
    # The speed must stay positive over the whole revolution: |a| T < 2 * mean speed.
    limit = 3.6 * math.pi / period**2
    acceleration = min(max(acceleration, -limit), limit)
    return Phase(start, end, 2.0 * math.pi / period - 0.5 * acceleration * period, acceleration)


def _are_neighbours(before: float, after: float) -> bool:
    """Return whether two periods may be those of consecutive revolutions."""
    return before > 0.0 and after > 0.0 and before < _MAX_PERIOD_RATIO * after and after < _MAX_PERIOD_RATIO * before


def _acceleration(before: float, after: float) -> float:
    """Return the constant angular acceleration through (-before, -2 pi), (0, 0), (after, 2 pi)."""
    return 4.0 * math.pi * (1.0 / after - 1.0 / before) / (before + after)


def beside_gap(positions: FloatArray, first: float, end: float) -> BoolArray:
    """Return at which sample positions, of any shape, an interpolation rests on a gap.

    Args:
        positions: in samples.
        first: first lost sample, in the same positions.
        end: the last (exclusive).
    """
    # Between the last sample before the gap and the first behind it.
    inside: BoolArray = (positions > first - 1.0 - _GAP_MARGIN_SAMPLES) & (positions < end + _GAP_MARGIN_SAMPLES)
    return inside


def resample_revolutions(
    samples_mps2: Sequence[NDArray[Any]],
    phases: Sequence[Phase],
    n: int = GRID_SIZE,
    scale: Scale | None = None,
    out: FloatArray | None = None,
) -> FloatArray:
    """Resample revolutions on the angle grid, each as if it were alone.

    Args:
        samples_mps2: for each revolution (m, axes) samples uniform in time, m may differ; row i is sample position i.
            `MARGIN_SAMPLES` rows on either side of the revolution avoid an end effect.
        phases: phase of each, in positions of its rows.
        n: grid size, even.
        scale: converts the samples to accelerations, None when they are.
        out: C-contiguous array for the result, if there is one.

    Returns:
        (revolutions, axes, n). An axis with values that are not finite stays not finite.

    Raises:
        ValueError: the samples do not cover a revolution, or `n` is odd or below 8.
    """
    if n < 8 or n % 2:
        raise ValueError(f"the angle grid needs an even size of at least 8, not {n}")
    result = np.empty((len(phases), samples_mps2[0].shape[1], n)) if out is None else out
    # Revolutions of one spline order and one fineness of the grid are interpolated together.
    groups: dict[tuple[Literal[3, 5], int], list[int]] = {}
    for row, (samples, phase) in enumerate(zip(samples_mps2, phases, strict=True)):
        rows = samples.shape[0]
        if phase.start < 0.0 or phase.end > rows - 1 or rows < 6:
            raise ValueError(f"{rows} samples do not cover a revolution from {phase.start:.1f} to {phase.end:.1f}")
        period = phase.end - phase.start
        order: Literal[3, 5] = 3 if period >= _CUBIC_FROM_SAMPLES else 5
        groups.setdefault((order, max(1, math.ceil(period / (_MAX_DENSITY * n)))), []).append(row)
    for (order, density), members in groups.items():
        batch_size = max(1, _BATCH_SIZE // density)
        for begin in range(0, len(members), batch_size):
            part = members[begin : begin + batch_size]
            # A slice is written to without a copy.
            is_contiguous = part[-1] - part[0] == len(part) - 1
            rows = result[part[0] : part[-1] + 1] if is_contiguous else np.empty((len(part), *result.shape[1:]))
            _resample_group(
                [samples_mps2[row] for row in part], [phases[row] for row in part], order, density, scale, rows
            )
            if not is_contiguous:
                result[part] = rows
    return result


def _resample_group(
    samples_mps2: Sequence[NDArray[Any]],
    phases: Sequence[Phase],
    order: Literal[3, 5],
    density: int,
    scale: Scale | None,
    out: FloatArray,
) -> None:
    """Set (revolutions, axes, n) of revolutions that are interpolated in the same way."""
    firsts = [max(0, math.floor(phase.start) - MARGIN_SAMPLES) for phase in phases]
    parts = [
        samples[first : math.ceil(phase.end) + MARGIN_SAMPLES + 1]
        for samples, first, phase in zip(samples_mps2, firsts, phases, strict=True)
    ]
    index = np.array(
        [
            (phase.start - first, phase.end - first, phase.rate, phase.acceleration)
            for phase, first in zip(phases, firsts, strict=True)
        ]
    )
    n = out.shape[2]
    if density == 1:
        interpolated(parts, index, elapsed_angles(n), order, scale, out)
        return
    fine = np.empty((*out.shape[:2], n * density))
    interpolated(parts, index, elapsed_angles(n * density), order, scale, fine)
    # The inverse transform of the first n/2 + 1 bins is the fine curve without the orders above the grid's band.
    spectrum = np.fft.rfft(fine, axis=2)[:, :, : n // 2 + 1]
    spectrum[:, :, -1] = 0.0
    out[:] = np.fft.irfft(spectrum, n=n, axis=2)
    out /= density


def _interpolated_by_numpy(
    parts: Sequence[NDArray[Any]],
    phases: FloatArray,
    angles_rad: FloatArray,
    order: Literal[3, 5],
    scale: Scale | None,
    out: FloatArray,
) -> None:
    """Set (revolutions, axes, k), the samples of each revolution interpolated at angles.

    Args:
        parts: for each revolution (m, axes) samples.
        phases: (revolutions, 4) start, end, rate and acceleration of each, in positions of its samples.
        angles_rad: (k,) angles since the start.
        order: of the spline.
        scale: converts the samples to accelerations, None when they are.
        out: C-contiguous array for the result.
    """
    starts, ends, rates, accelerations = phases.T[:, :, np.newaxis]
    # 2 c / (b + sqrt(b^2 + 2 a c)) avoids cancellation and division by a vanishing acceleration.
    positions = (2.0 * accelerations) * angles_rad
    positions += rates * rates
    np.sqrt(positions, out=positions)
    positions += rates
    np.divide(2.0 * angles_rad, positions, out=positions)
    positions += starts
    np.maximum(positions, starts, out=positions)
    np.minimum(positions, ends, out=positions)
    out[:] = read_spline(spline_coefficients(parts, order, scale), positions, order)


def _interpolated_by_core(
    parts: Sequence[NDArray[Any]],
    phases: FloatArray,
    angles_rad: FloatArray,
    order: Literal[3, 5],
    scale: Scale | None,
    out: FloatArray,
) -> None:
    """As `_interpolated_by_numpy`."""
    assert core is not None
    axes = out.shape[1]
    lengths = [_line_length(len(part), order) for part in parts]
    lines = np.empty(max(lengths) * axes)
    offsets, factors = _scaling(order, scale, axes)
    for part, phase, length, row in zip(parts, phases, lengths, out, strict=True):
        core.resample(
            in_core(part),
            offsets,
            factors,
            core_filter(order, length),
            BASIS[order],
            angles_rad,
            phase,
            lines[: length * axes],
            row,
        )


interpolated = _interpolated_by_numpy if core is None else _interpolated_by_core


def in_core(samples: NDArray[Any]) -> NDArray[Any]:
    """Return samples of a type that the compiled core reads."""
    return samples if samples.dtype in (np.int16, np.float64) else samples.astype(np.float64)


def _scaling(order: Literal[3, 5], scale: Scale | None, axes: int) -> tuple[FloatArray, FloatArray]:
    """Return the offset and the factor of each axis, the gain of a spline's filter included, (axes,) each."""
    gain = _gain(order)
    if scale is None:
        return np.zeros(axes), np.full(axes, gain)
    return np.ascontiguousarray(scale.offset_counts, np.float64), gain * scale.mps2


class Scale(NamedTuple):
    """Conversion of counts to accelerations: (counts - offset_counts) mps2, (axes,) each."""

    offset_counts: FloatArray
    mps2: FloatArray


def spline_coefficients(parts: Sequence[NDArray[Any]], order: Literal[3, 5], scale: Scale | None = None) -> FloatArray:
    """Return the B-spline coefficients of stretches of samples, (parts, axes, length), at `LEFT_PAD` in each line.

    Each stretch is continued by reflection at both of its ends. The result does not depend on the other stretches.

    Args:
        parts: for each stretch (m, axes) samples, m may differ, at least `LEFT_PAD` + 1.
        order: of the spline.
        scale: converts the samples to accelerations, None when they are.
    """
    # Only without the compiled core; importing it takes longer than to start without it.
    from scipy.linalg.lapack import dpttrs

    length = _line_length(max(map(len, parts)), order)
    lines = np.empty((len(parts), parts[0].shape[1], length))
    for line, part in zip(lines, parts, strict=True):
        end = LEFT_PAD + len(part)
        line[:, LEFT_PAD:end] = part.T
        line[:, :LEFT_PAD] = line[:, 2 * LEFT_PAD : LEFT_PAD : -1]
        while end < length:
            added = min(length - end, len(part) - 1)
            line[:, end : end + added] = line[:, end - 2 : end - 2 - added : -1]
            end += added
    gain = _gain(order)
    if scale is None:
        lines *= gain
    else:
        lines -= scale.offset_counts[:, np.newaxis]
        lines *= gain * scale.mps2[:, np.newaxis]
    # The filter's equations have one unknown per sample and couple neighbours only; one after the other for each pole.
    right = lines.reshape(-1, length).T
    for diagonal, subdiagonal in _filter_factors(order, length):
        right[0] *= 0.5
        right[-1] *= 0.5
        right, _ = dpttrs(diagonal, subdiagonal, right, overwrite_b=True)
    coefficients: FloatArray = right.T.reshape(lines.shape)
    return coefficients


def _lines_by_numpy(samples: Sequence[FloatArray]) -> FloatArray:
    """Return the coefficients of quintic splines through (m,) samples each, (k, length), as `spline_coefficients`."""
    coefficients: FloatArray = spline_coefficients([line[:, np.newaxis] for line in samples], 5)[:, 0]
    return coefficients


def _lines_by_core(samples: Sequence[FloatArray]) -> FloatArray:
    """As `_lines_by_numpy`."""
    assert core is not None
    length = _line_length(max(map(len, samples)), 5)
    lines, (offset, factor), factors = np.empty((len(samples), length)), _scaling(5, None, 1), core_filter(5, length)
    for values, line in zip(samples, lines, strict=True):
        core.spline_lines(values, offset, factor, factors, line)
    return lines


spline_lines = _lines_by_numpy if core is None else _lines_by_core


def _line_length(rows: int, order: Literal[3, 5]) -> int:
    """Return the length of a line of coefficients of so many samples."""
    return -(-(LEFT_PAD + rows + _RIGHT_PAD[order]) // _LENGTH_STEP) * _LENGTH_STEP


def _gain(order: Literal[3, 5]) -> float:
    """Return the gain of a spline's filter, the product of the (1 - z)^2."""
    return math.prod((1.0 - pole) ** 2 for pole in _POLES[order])


@lru_cache(maxsize=128)
def _filter_factors(order: Literal[3, 5], length: int) -> list[tuple[FloatArray, FloatArray]]:
    """Return the factored equations of a spline's filter, for lines that are mirrored at both ends.

    For each pole z: -z c[i - 1] + (1 + z^2) c[i] - z c[i + 1] = (1 - z)^2 s[i], halved at both ends.
    """
    factors = []
    for pole in _POLES[order]:
        boundary, interior = 0.5 * (1.0 + pole * pole), 1.0 + pole * pole
        # The recursion settles on one number within some twenty rows.
        settled = [boundary, interior + pole * (-pole / boundary)]
        while settled[-1] != settled[-2] and len(settled) < length:
            settled.append(interior + pole * (-pole / settled[-1]))
        diagonal = np.full(length, settled[-1])
        diagonal[: len(settled)] = settled[:length]
        subdiagonal = -pole / diagonal[:-1]
        diagonal[-1] = boundary + pole * subdiagonal[-1]
        factors.append((diagonal, subdiagonal))
    return factors


@lru_cache(maxsize=128)
def core_filter(order: Literal[3, 5], length: int) -> FloatArray:
    """Return for each pole the inverse of the diagonal and what stands beside it, (poles, 2, length)."""
    return np.array([(1.0 / diagonal, [*subdiagonal, 0.0]) for diagonal, subdiagonal in _filter_factors(order, length)])


def read_spline(coefficients: FloatArray, positions: FloatArray, order: Literal[3, 5]) -> FloatArray:
    """Return the values of splines, (parts, axes, k).

    Args:
        coefficients: (parts, axes, length) from `spline_coefficients`.
        positions: (parts, k) in samples of each part, from 0 to its last sample.
        order: of the spline.
    """
    count, axes, length = coefficients.shape
    taps = order + 1
    left_taps = order // 2
    flat = positions.reshape(-1)
    base = np.floor(flat)
    powers = np.empty((taps, len(flat)))
    powers[0] = 1.0
    np.subtract(flat, base, out=powers[1])
    for power in range(2, taps):
        np.multiply(powers[power - 1], powers[1], out=powers[power])
    knots = base.astype(np.int32).reshape(count, -1)
    knots += (np.arange(count, dtype=np.int32) * length + (LEFT_PAD - left_taps))[:, np.newaxis]
    if axes == 1:
        # Long rows, added one after the other: the sum does not depend on the number of points.
        tap_indices = np.arange(taps)[:, np.newaxis] + knots.reshape(-1)
        parts = coefficients.reshape(-1).take(tap_indices)
        parts *= BASIS[order].T @ powers
        line: FloatArray = np.add.reduce(parts, axis=0)
        return line.reshape(count, 1, -1)
    # One sparse matrix reads several axes; for one it takes longer to make than it saves. Its indices are filled column
    # by column, many times faster than row by row.
    indices = np.empty((*knots.shape, taps), np.int32)
    for tap in range(taps):
        np.add(knots, tap, out=indices[:, :, tap])
    matrix = copy(_empty_matrix(len(flat), count * length))
    matrix.data = (powers.T @ BASIS[order]).reshape(-1)
    matrix.indices = indices.reshape(-1)
    matrix.indptr = _row_starts(len(flat), taps)
    values: FloatArray = matrix @ coefficients.transpose(0, 2, 1).reshape(count * length, axes)
    return values.reshape(count, -1, axes).transpose(0, 2, 1)


@lru_cache(maxsize=128)
def _empty_matrix(rows: int, columns: int) -> csr_array:
    """Return a matrix to copy and fill: to make one takes longer than to read a revolution with it."""
    from scipy.sparse import csr_array

    return csr_array((rows, columns))


@lru_cache(maxsize=32)
def _row_starts(rows: int, taps: int) -> NDArray[np.int32]:
    """Return the places at which the rows of a matrix of `taps` values a row begin, and the end, read-only."""
    starts = np.arange(0, taps * rows + 1, taps, dtype=np.int32)
    starts.setflags(write=False)
    return starts


def _basis(order: int) -> FloatArray:
    """Return the powers of the place between two samples in each of the B-spline's pieces, (order + 1, order + 1).

    Row p, column j: factor of t^p in the weight of coefficient j, from the lowest one that the place reads.
    """
    rows = np.zeros((order + 1, order + 1))
    for column in range(order + 1):
        # beta(x) = sum over k of (-1)^k binomial(order + 1, k) (x + (order + 1) / 2 - k)_+^order / order!
        for k in range(order - column + 1):
            shifted = order - column - k
            factor = (-1.0) ** k * math.comb(order + 1, k) / math.factorial(order)
            for power in range(order + 1):
                rows[power, column] += factor * math.comb(order, power) * float(shifted) ** (order - power)
    return rows


# Poles of the splines' filters inside the unit circle (Unser, Splines: a perfect fit, 1999, table 1).
_POLES: Final = {
    3: (math.sqrt(3.0) - 2.0,),
    5: (
        math.sqrt(67.5 - math.sqrt(4436.25)) + math.sqrt(26.25) - 6.5,
        math.sqrt(67.5 + math.sqrt(4436.25)) - math.sqrt(26.25) - 6.5,
    ),
}
# Powers of the place between two samples in each of the taps of a spline, by its order.
BASIS: Final = {order: _basis(order) for order in (3, 5)}
