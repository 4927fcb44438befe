"""Timing of a contact, to a few microseconds, by matching both edges with the running average.

A level crossing uses only the few samples near the level. Matching the whole edge with its average uses all of its
samples. The two edges are matched separately, because on a real road they jitter separately. The samples around a
contact are

    s(t) = gain T(theta) + offset + ramp theta + g cos(psi),  theta = Omega (t - centre) + Omega' (t - centre)^2 / 2

with the leading half of T shifted by one angle and the trailing half by another. Both shifts, gain, offset and ramp are
fitted by least squares; the latter absorb load, speed and the high-pass filter of an AC-coupled sensor.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gateway.core.compiled import core
from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.contacts.segmentation import refine_contact
from gateway.core.revolutions.angle_resampling import (
    BASIS,
    Phase,
    angle_grid,
    beside_gap,
    read_spline,
    spline_lines,
)
from gateway.core.revolutions.contact_edges import ContactEdges, find_contact_edges, smoothing_order
from gateway.core.types import BoolArray, ComplexArray, FloatArray

# The template extends this far beyond the edges, to include the full slope of the overshoots.
_MARGIN_RAD: Final = 0.35
# Least mean of the acceleration over its range: without a contact it is R omega^2, in the contact 0, at its edges up to
# twice R omega^2. Less is that of an AC-coupled sensor, from which no curvature follows.
_LEAST_STEADY_SHARE: Final = 0.25
# The samples must extend at least this far beyond either edge.
MIN_BEYOND_RAD: Final = 0.12
# Samples at either end of the data that are affected by the end condition of the interpolation.
_END_SAMPLES: Final = 4
_MIN_POINTS: Final = 16
# Error of either shift by white noise, over that with all samples, up to which samples around a gap show both edges;
# and the deviation from an exact solution that rounding makes.
_MAX_NOISE_RATIO: Final = 2.0
_SOLUTION_TOLERANCE: Final = 1e-6
# A contact that deviates from the average by more than these is rejected as damaged or not a contact: range of the
# gain, largest shift over the contact's width, largest rms residual over the template's span.
_GAIN_RANGE: Final = (0.6, 1.6)
_MAX_SHIFT_SHARE: Final = 0.3
_MAX_RESIDUAL_SHARE: Final = 0.2
# Distance of the half-level crossings over that of the edges.
HALF_LEVEL_SHARE: Final = 0.85
# The derivative keeps orders below this.
_DERIVATIVE_ORDERS: Final = 160
_UNKNOWN_COVARIANCES: Final = np.full((2, 2, 2), math.nan)


@dataclass(frozen=True, slots=True)
class _Region:
    """Points of a template, and the least-squares solution over them.

    Attributes:
        angles_rad: (m,) angles of the points.
        values: (m,) average over the square of its angular speed.
        model: (m, 5) derivative of `values` by shift of the leading half, of the trailing half, gain, offset and ramp.
        gravity_mps2: (m,) g cos(psi).
        rows: (5, m) matrix from the change of the samples to shifts, gain, offset and ramp.
        middle: number of points in the leading half.
        covariances_rad2: (orders, 2, 2, 2) covariance of the two shifts from the revolution-to-revolution scatter in
            the leading half, and from that in the trailing half, with scatter up to each order.
    """

    angles_rad: FloatArray
    values: FloatArray
    model: FloatArray
    gravity_mps2: FloatArray
    rows: FloatArray
    middle: int
    covariances_rad2: FloatArray


@dataclass(frozen=True, slots=True)
class ContactTemplate:
    """The contact region of a running average.

    Attributes:
        first: index of its first point on the angle grid.
        size: number of points of the grid.
        whole: all of its points.
        weights: (m, 5) smoothed form of the model, by which the samples are weighted.
        variance: (orders,) variance of one real order coefficient over the fourth power of the angular speed.
        edges: contact edges of the average.
        middle_rad: midway between the half-level crossings; the segmenter defines the contact centre this way.
        span: range of the smoothed values.
    """

    first: int
    size: int
    whole: _Region
    weights: FloatArray
    variance: FloatArray
    edges: ContactEdges
    middle_rad: float
    span: float

    def part(self, measured: BoolArray) -> _Region | None:
        """Return the region of the points that are measured, (m,); None where they do not show both edges."""
        region = self.whole
        if measured.all():
            return region
        low, high = self.edges.leading_rad - MIN_BEYOND_RAD, self.edges.trailing_rad + MIN_BEYOND_RAD
        points = np.flatnonzero(measured)
        angles = region.angles_rad[points]
        if len(points) < _MIN_POINTS or angles[0] > low or angles[-1] < high:
            return None
        part = _region(
            self.first + points,
            self.size,
            (angles, region.values[points], region.model[points], region.gravity_mps2[points]),
            self.weights[points],
            self.variance,
        )
        # Without the samples of an edge, its shift follows from the shape beside it, or from nothing.
        noise2 = np.square(part.rows[:2]).sum(axis=1)
        is_determined = np.allclose(part.rows @ part.model, np.eye(part.model.shape[1]), atol=_SOLUTION_TOLERANCE)
        shows_edges = (noise2 <= _MAX_NOISE_RATIO**2 * np.square(region.rows[:2]).sum(axis=1)).all()
        return part if is_determined and shows_edges else None


class ContactMatches(NamedTuple):
    """Contacts timed against a template.

    Attributes:
        shift_rad: (k, 2) angle by which the leading and the trailing edge come later than the passage says.
        residual: (k, 2) rms residual of the fit in the two halves, over the square of the angular speed.
        fits: (k,) False where the samples do not cover the contact or do not resemble the template.
        covariances_rad2: for each contact (2, 2, 2) covariance of the two shifts from the scatter in the leading half,
            and from that in the trailing half.
    """

    shift_rad: FloatArray
    residual: FloatArray
    fits: BoolArray
    covariances_rad2: list[FloatArray]


def contact_template(
    radial_mps2: FloatArray,
    omega_radps: float,
    samples_per_revolution: float,
    order_variance_mps4: FloatArray,
    scatter_mps2: FloatArray | None = None,
) -> ContactTemplate | None:
    """Extract the template from an average.

    Args:
        radial_mps2: (n,) averaged radial waveform on the angle grid, gravity removed.
        omega_radps: its angular speed.
        samples_per_revolution: time samples per revolution.
        order_variance_mps4: (61,) revolution-to-revolution variance of one real order coefficient, NaN where unknown;
            orders above the last known one are assumed to have its variance.
        scatter_mps2: (n,) standard deviation of the waveform from revolution to revolution; None when not known.

    Returns:
        the template; None when the average has no contact, or when the contact region wraps around.
    """
    edges = find_contact_edges(radial_mps2, samples_per_revolution, scatter_mps2=scatter_mps2)
    n = radial_mps2.shape[0]
    step = 2.0 * math.pi / n
    first = n // 2 + math.floor((edges.leading_rad - _MARGIN_RAD) / step) if edges.measured else -1
    last = n // 2 + math.ceil((edges.trailing_rad + _MARGIN_RAD) / step) if edges.measured else n
    mean = float(radial_mps2.mean())
    if first < 0 or last >= n or not mean > 0.0:
        return None
    contact = refine_contact(radial_mps2, 0.5 * n, HALF_LEVEL_SHARE * (edges.trailing_rad - edges.leading_rad) / step)
    if contact is None:
        return None
    part = slice(first, last + 1)
    angles = angle_grid(n)[part]
    relative = radial_mps2 / omega_radps**2
    smooth, smooth_slope, slope = _curves(relative, smoothing_order(samples_per_revolution))
    leading, trailing = angles < 0.0, angles >= 0.0
    values = relative[part]
    ones = np.ones(len(angles))
    model = np.stack([-slope[part] * leading, -slope[part] * trailing, values, ones, angles], axis=1)
    weights = np.stack(
        [
            -smooth_slope[part] * leading,
            -smooth_slope[part] * trailing,
            smooth[part] - smooth[part].mean(),
            ones,
            angles,
        ],
        axis=1,
    )
    has_steady_value = mean > _LEAST_STEADY_SHARE * float(np.ptp(radial_mps2))
    curvature = values * (omega_radps**2 / mean) if has_steady_value else ones
    orientation = np.cumsum(curvature) - 0.5 * curvature
    orientation -= orientation[n // 2 - first]
    gravity = STANDARD_GRAVITY_MPS2 * np.cos(orientation * step)
    variance = _extended_variance(order_variance_mps4, n // 2 + 1) / omega_radps**4
    return ContactTemplate(
        first=first,
        size=n,
        whole=_region(np.arange(first, last + 1), n, (angles, values, model, gravity), weights, variance),
        weights=weights,
        variance=variance,
        edges=edges,
        middle_rad=(contact.centre - 0.5 * n) * step,
        span=float(np.ptp(smooth[part])),
    )


class ContactSamples:
    """Samples around contacts, prepared for matching with a template."""

    def __init__(
        self,
        template: ContactTemplate,
        samples_mps2: Sequence[FloatArray],
        passages: Sequence[Phase],
        gaps: Sequence[Sequence[tuple[int, int]]],
    ) -> None:
        """Interpolate the samples.

        Args:
            template: from the running average.
            samples_mps2: for each contact (m,) radial axis around it, positive inward, uniform in time.
            passages: for each contact angle against sample position, 0 at the approximate centre; in positions of its
                samples.
            gaps: for each contact first and last (exclusive) position of those of its samples that were lost.
        """
        self._template = template
        self._coefficients = spline_lines(samples_mps2)
        self._gaps = gaps
        last = np.array([len(samples) - 1.0 for samples in samples_mps2])
        self._last = last
        angles, values = template.whole.angles_rad, np.array(passages)
        # Positions grow with the angle.
        end_positions = _sample_positions(angles[[0, -1]], values)
        is_whole = (end_positions[:, 0] >= _END_SAMPLES).all() and (end_positions[:, 1] < last - _END_SAMPLES).all()
        # Points of the template that the samples cover, gaps among them; None for all of them, as nearly always.
        self._covered: BoolArray | None = None
        if not is_whole or any(gaps):
            positions = _sample_positions(angles, values)
            self._covered = (positions >= _END_SAMPLES) & (positions < last[:, np.newaxis] - _END_SAMPLES)

    def _groups(self, passages: FloatArray) -> list[tuple[_Region, NDArray[np.intp]]]:
        """Return the contacts by the points of the template that their samples show."""
        template = self._template
        if self._covered is None:
            return [(template.whole, np.arange(len(passages)))]
        covered = self._covered
        if any(self._gaps):
            covered = covered.copy()
            positions = _sample_positions(template.whole.angles_rad, passages)
            for row, row_positions, gaps in zip(covered, positions, self._gaps, strict=True):
                for first, end in gaps:
                    row &= ~beside_gap(row_positions, first, end)
        groups: dict[bytes, list[int]] = {}
        for index, row in enumerate(covered):
            groups.setdefault(row.tobytes(), []).append(index)
        parts = ((template.part(covered[indices[0]]), np.array(indices)) for indices in groups.values())
        return [(part, indices) for part, indices in parts if part is not None]

    def match(self, passages: Sequence[Phase], rates_hz: Sequence[float]) -> ContactMatches:
        """Time the contacts.

        Args:
            passages: as in the constructor, or nearer to the contacts.
            rates_hz: sampling rate at each.
        """
        template, count = self._template, len(passages)
        values, rates = np.array(passages), np.array(rates_hz)
        # As `matched`, then the number of points of either half.
        result = np.empty((count, 7))
        result.fill(math.nan)
        fits = np.zeros(count, np.bool_)
        covariances = [_UNKNOWN_COVARIANCES] * count
        for region, indices in self._groups(values):
            selection = slice(None) if len(indices) == count else indices
            lines, last = self._coefficients[selection], self._last[selection]
            result[selection, :5] = matched(lines, last, values[selection], rates[selection], region)
            gain, remainder = 1.0 + result[selection, 2], result[selection, 3] + result[selection, 4]
            limit = len(region.angles_rad) * (_MAX_RESIDUAL_SHARE * template.span) ** 2
            fits[selection] = (_GAIN_RANGE[0] < gain) & (gain < _GAIN_RANGE[1]) & (remainder < limit)
            result[selection, 5:] = region.middle, len(region.angles_rad) - region.middle
            highest = np.minimum(np.ceil(math.pi / values[selection, 2]), len(region.covariances_rad2) - 1)
            for index, order in zip(indices.tolist(), highest.astype(np.int64).tolist(), strict=True):
                covariances[index] = region.covariances_rad2[order]
        return ContactMatches(result[:, :2], np.sqrt(result[:, 3:5] / result[:, 5:]), fits, covariances)

    @property
    def largest_shift_rad(self) -> float:
        """Largest shift of a contact that is one of the template's."""
        edges = self._template.edges
        return _MAX_SHIFT_SHARE * (edges.trailing_rad - edges.leading_rad)


def _matched_by_numpy(
    lines: FloatArray, last: FloatArray, passages: FloatArray, rates_hz: FloatArray, region: _Region
) -> FloatArray:
    """Return shift of either half, relative change of the gain, and squares left in either half of contacts, (k, 5).

    Args:
        lines: (k, length) spline coefficients of the samples around each.
        last: (k,) last sample of each.
        passages: (k, 4) angle against sample position, as `Phase`.
        rates_hz: (k,) sampling rates.
        region: of the template.
    """
    angles, rate, acceleration = region.angles_rad, passages[:, 2:3], passages[:, 3:]
    positions = _sample_positions(angles, passages)
    np.minimum(np.maximum(positions, 0.0, out=positions), last[:, np.newaxis], out=positions)
    change = read_spline(lines[:, np.newaxis], positions, 5)[:, 0]
    change -= region.gravity_mps2
    change /= np.square(rates_hz)[:, np.newaxis] * (rate * rate + (2.0 * acceleration) * angles)
    change -= region.values
    fitted = change @ region.rows.T
    change -= fitted @ region.model.T
    residual2 = np.square(change, out=change)
    result = np.empty((len(lines), 5))
    result[:, :2] = fitted[:, :2] / (1.0 + fitted[:, 2:3])
    result[:, 2] = fitted[:, 2]
    result[:, 3:] = np.add.reduceat(residual2, (0, region.middle), axis=1)
    return result


def _matched_by_core(
    lines: FloatArray, last: FloatArray, passages: FloatArray, rates_hz: FloatArray, region: _Region
) -> FloatArray:
    """As `_matched_by_numpy`."""
    assert core is not None
    result, change = np.empty((len(lines), 5)), np.empty(len(region.values))
    template = region.angles_rad, region.values, region.gravity_mps2, region.rows, region.model, region.middle
    core.match(lines, last, passages, rates_hz, BASIS[5], *template, change, result)
    return result


matched = _matched_by_numpy if core is None else _matched_by_core


def _sample_positions(angles_rad: FloatArray, passages: FloatArray) -> FloatArray:
    """Return the sample positions of angles on passages (k, 4), (k, m)."""
    start, rate, acceleration = passages[:, :1], passages[:, 2:3], passages[:, 3:]
    speed2 = rate * rate + (2.0 * acceleration) * angles_rad
    positions: FloatArray = start + 2.0 * angles_rad / (rate + np.sqrt(np.maximum(speed2, 0.0)))
    return positions


def template_shift(template: ContactTemplate, radial_mps2: FloatArray, omega_radps: float) -> FloatArray:
    """Return the angles by which the leading and the trailing half of another average are shifted, (2,) rad.

    Args:
        template: from the earlier average.
        radial_mps2: (n,) the other average, of the same tire.
        omega_radps: its angular speed.
    """
    region = template.whole
    part = slice(template.first, template.first + len(region.values))
    fitted = region.rows @ (radial_mps2[part] / omega_radps**2 - region.values)
    shift: FloatArray = fitted[:2] / (1.0 + fitted[2])
    return shift


def _region(
    grid_indices: NDArray[np.intp],
    n: int,
    points: tuple[FloatArray, FloatArray, FloatArray, FloatArray],
    weights: FloatArray,
    variance: FloatArray,
) -> _Region:
    """Solve the normal equations for points of the angle grid, (m,)."""
    angles, values, model, gravity = points
    rows: FloatArray = np.linalg.lstsq(weights.T @ model, weights.T, rcond=None)[0].astype(np.float64)
    padded = np.zeros((2, 2, n))
    padded[:, :, grid_indices] = np.stack([angles < 0.0, angles >= 0.0])[:, np.newaxis] * rows[:2]
    spectrum = np.fft.rfft(padded, axis=-1)
    # Cross spectra of the two shifts' rows in each half.
    power = (spectrum[:, :, np.newaxis] * spectrum[:, np.newaxis].conj()).real
    covariances = np.cumsum(power * variance, axis=-1)
    angles, values, model, gravity, rows = map(np.ascontiguousarray, (angles, values, model, gravity, rows))
    return _Region(
        angles, values, model, gravity, rows, int(np.searchsorted(angles, 0.0)), np.moveaxis(covariances, -1, 0).copy()
    )


def _extended_variance(variance: FloatArray, orders: int) -> FloatArray:
    """Return the variance of order coefficients 0 to `orders` - 1; order 0 is absorbed by the fitted offset."""
    finite = variance[np.isfinite(variance)]
    extended = np.full(orders, float(finite[-1]) if len(finite) else math.nan)
    count = min(orders, len(finite))
    extended[:count] = finite[:count]
    extended[0] = 0.0
    return extended


def _curves(waveform: FloatArray, width: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the smoothed waveform, its derivative by angle, and the derivative without smoothing, (n,) each."""
    n = waveform.shape[0]
    curves: FloatArray = np.fft.irfft(np.fft.rfft(waveform) * _curve_factors(n, width), n=n, axis=1)
    return curves[0], curves[1], curves[2]


@lru_cache(maxsize=32)
def _curve_factors(n: int, width: float) -> ComplexArray:
    """Return the factors of the orders of a waveform (n,) that give its curves, (3, n / 2 + 1)."""
    orders = np.arange(n // 2 + 1.0)
    gain = np.exp(-0.5 * (orders / width) ** 2)
    derivative = 1j * orders
    derivative[_DERIVATIVE_ORDERS:] = 0.0
    return np.stack([gain.astype(np.complex128), derivative * gain, derivative])
