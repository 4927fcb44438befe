"""Timing of a contact, to a few microseconds, by matching both edges with the running average.

A level crossing uses only the few samples near the level. Matching the whole edge with its average uses all of its
samples. The two edges are matched separately, because on a real road they jitter separately. The samples around a
contact are

    s(t) = gain T(theta) + offset + ramp theta + g cos(psi),  theta = Omega (t - centre) + Omega' (t - centre)^2 / 2

with the leading half of T shifted by one angle and the trailing half by another. Both shifts, gain, offset and ramp are
fitted by least squares; the latter absorb load, speed and the high-pass filter of an AC-coupled sensor.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.ndimage import map_coordinates, spline_filter1d

from gateway.constants import STANDARD_GRAVITY_MPS2
from gateway.signal.angle_resampling import Phase, angle_grid
from gateway.signal.contact_edges import ContactEdges, find_contact_edges, smoothing_order
from gateway.signal.segmentation import refine_contact
from gateway.types import FloatArray

# The template extends this far beyond the edges, to include the full slope of the overshoots.
_BEYOND_RAD: Final = 0.35
# The samples must extend at least this far beyond either edge.
_MIN_BEYOND_RAD: Final = 0.12
# Samples at either end of the data that are affected by the end condition of the interpolation.
_END_SAMPLES: Final = 4
_ITERATIONS: Final = 2
_MIN_POINTS: Final = 16
# A contact that deviates from the average by more than these is rejected as damaged or not a contact: range of the
# gain, largest shift over the contact's width, largest rms residual over the template's span.
_GAIN_RANGE: Final = (0.6, 1.6)
_MAX_SHIFT_SHARE: Final = 0.3
_MAX_RESIDUAL_SHARE: Final = 0.2
# Distance of the half-level crossings over that of the edges.
_HALF_LEVEL_SHARE: Final = 0.85
# The derivative keeps orders below this.
_DERIVATIVE_ORDERS: Final = 160


@dataclass(frozen=True, slots=True)
class _Fit:
    """Least-squares solution over some of the template's points.

    Attributes:
        rows: (5, m) matrix from the change of the samples to shifts, gain, offset and ramp.
        power: (2, 2, 2, orders) cross spectra of the two shifts' rows in the leading and in the trailing half.
    """

    rows: FloatArray
    power: FloatArray


@dataclass(frozen=True, slots=True)
class ContactTemplate:
    """The contact region of a running average.

    Attributes:
        first: index of its first point on the angle grid.
        angles_rad: (m,) angles of its points.
        values: (m,) average over the square of its angular speed.
        model: (m, 5) derivative of `values` by shift of the leading half, of the trailing half, gain, offset and ramp.
        weights: (m, 5) smoothed form of `model`, by which the samples are weighted.
        fit: solution over all points.
        gravity_mps2: (m,) g cos(psi).
        edges: contact edges of the average.
        middle_rad: midway between the half-level crossings; the segmenter defines the contact centre this way.
        span: range of the smoothed `values`.
    """

    first: int
    angles_rad: FloatArray
    values: FloatArray
    model: FloatArray
    weights: FloatArray
    fit: _Fit
    gravity_mps2: FloatArray
    edges: ContactEdges
    middle_rad: float
    span: float


@dataclass(frozen=True, slots=True)
class ContactMatch:
    """A contact timed against a template.

    Attributes:
        leading: sample position of the template's angle 0 according to the leading edge.
        trailing: likewise according to the trailing edge.
        covariances: (2, 2, 2) covariance of the two in samples^2, from the revolution-to-revolution scatter in the
            leading half of the contact region, and from that in the trailing half.
        rate: rad/sample at the contact.
        residual_mps2: (2,) rms residual of the fit in the two halves.
    """

    leading: float
    trailing: float
    covariances: FloatArray
    rate: float
    residual_mps2: FloatArray


def contact_template(
    radial_mps2: FloatArray,
    omega_radps: float,
    samples_per_revolution: float,
    scatter_mps2: FloatArray | None = None,
) -> ContactTemplate | None:
    """Extract the template from an average.

    Args:
        radial_mps2: (n,) averaged radial waveform on the angle grid, gravity removed.
        omega_radps: its angular speed.
        samples_per_revolution: time samples per revolution.
        scatter_mps2: (n,) standard deviation of the waveform from revolution to revolution; None when not known.

    Returns:
        the template; None when the average has no contact, or when the contact region wraps around.
    """
    edges = find_contact_edges(radial_mps2, samples_per_revolution, scatter_mps2=scatter_mps2)
    n = radial_mps2.shape[0]
    step = 2.0 * math.pi / n
    first = n // 2 + math.floor((edges.leading_rad - _BEYOND_RAD) / step) if edges.found else -1
    last = n // 2 + math.ceil((edges.trailing_rad + _BEYOND_RAD) / step) if edges.found else n
    mean = float(radial_mps2.mean())
    if first < 0 or last >= n or not mean > 0.0:
        return None
    contact = refine_contact(radial_mps2, 0.5 * n, _HALF_LEVEL_SHARE * (edges.trailing_rad - edges.leading_rad) / step)
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
    curvature = values * (omega_radps**2 / mean)
    turn = np.cumsum(curvature) - 0.5 * curvature
    turn -= turn[n // 2 - first]
    return ContactTemplate(
        first=first,
        angles_rad=angles,
        values=values,
        model=model,
        weights=weights,
        fit=_fit(model, weights, angles, first, n),
        gravity_mps2=STANDARD_GRAVITY_MPS2 * np.cos(turn * step),
        edges=edges,
        middle_rad=(contact.centre - 0.5 * n) * step,
        span=float(np.ptp(smooth[part])),
    )


def match_contact(
    template: ContactTemplate,
    samples_mps2: FloatArray,
    passage: Phase,
    rate_hz: float,
    order_variance_mps4: FloatArray,
    n: int,
) -> ContactMatch | None:
    """Time one contact.

    Args:
        template: from the running average.
        samples_mps2: (m,) radial axis around the contact, positive inward, uniform in time.
        passage: angle against sample position, 0 at the approximate centre; in positions of `samples_mps2`.
        rate_hz: sampling rate.
        order_variance_mps4: (61,) revolution-to-revolution variance of one real order coefficient, NaN where unknown;
            orders above the last known one are assumed to have its variance.
        n: size of the angle grid.

    Returns:
        the match; None when the samples do not cover the contact or do not resemble the template.
    """
    where = passage.positions(template.angles_rad)
    begin, end = np.searchsorted(where, (_END_SAMPLES, len(samples_mps2) - 1 - _END_SAMPLES)).tolist()
    part = slice(begin, end)
    angles, where = template.angles_rad[part], where[part]
    low, high = template.edges.leading_rad - _MIN_BEYOND_RAD, template.edges.trailing_rad + _MIN_BEYOND_RAD
    if end - begin < _MIN_POINTS or angles[0] > low or angles[-1] < high:
        return None
    model, values, fit = template.model[part], template.values[part], template.fit
    if end - begin < len(template.values):
        fit = _fit(model, template.weights[part], angles, template.first + begin, n)
    coefficients = spline_filter1d(samples_mps2, order=5, mode="mirror")
    scale = 1.0 / (passage.rate * rate_hz) ** 2
    factor = scale / (1.0 + (2.0 * passage.acceleration / passage.rate**2) * angles)
    level = template.gravity_mps2[part] * factor + values
    common, shift = 0.0, np.zeros(2)
    for _ in range(_ITERATIONS):
        moved = where + common / passage.rate
        read = map_coordinates(coefficients, moved[np.newaxis], order=5, mode="mirror", prefilter=False)
        change = read * factor - level
        fitted = fit.rows @ change
        gain = 1.0 + float(fitted[2])
        if not _GAIN_RANGE[0] < gain < _GAIN_RANGE[1]:
            return None
        shift = common + fitted[:2] / gain
        common = 0.5 * float(shift[0] + shift[1])
    residual2 = np.square(change - model @ fitted)
    width = template.edges.trailing_rad - template.edges.leading_rad
    misfit = math.sqrt(float(residual2.mean()))
    if not (np.abs(shift).max() < _MAX_SHIFT_SHARE * width and misfit < _MAX_RESIDUAL_SHARE * template.span):
        return None
    middle = int(np.searchsorted(angles, 0.0))
    residual = np.sqrt([residual2[:middle].mean(), residual2[middle:].mean()]) / scale
    orders = min(fit.power.shape[-1], math.ceil(math.pi / passage.rate) + 1)
    variances = _extended_variance(order_variance_mps4, orders)
    covariances = fit.power[..., : len(variances)] @ variances * (scale / passage.rate) ** 2
    leading, trailing = (passage.start + shift / passage.rate).tolist()
    return ContactMatch(leading, trailing, covariances, passage.rate, residual)


def template_shift(template: ContactTemplate, radial_mps2: FloatArray, omega_radps: float) -> FloatArray:
    """Return the angles by which the leading and the trailing half of another average are shifted, (2,) rad.

    Args:
        template: from the earlier average.
        radial_mps2: (n,) the other average, of the same tire.
        omega_radps: its angular speed.
    """
    part = slice(template.first, template.first + len(template.values))
    fitted = template.fit.rows @ (radial_mps2[part] / omega_radps**2 - template.values)
    shift: FloatArray = fitted[:2] / (1.0 + fitted[2])
    return shift


def _fit(model: FloatArray, weights: FloatArray, angles: FloatArray, first: int, n: int) -> _Fit:
    """Solve the normal equations for consecutive points, starting at index `first` of the angle grid."""
    rows: FloatArray = np.linalg.lstsq(weights.T @ model, weights.T, rcond=None)[0].astype(np.float64)
    padded = np.zeros((2, 2, n))
    padded[:, :, first : first + len(angles)] = np.stack([angles < 0.0, angles >= 0.0])[:, np.newaxis] * rows[:2]
    spectrum = np.fft.rfft(padded, axis=-1)
    power = (spectrum[:, :, np.newaxis] * spectrum[:, np.newaxis].conj()).real
    return _Fit(rows, power)


def _extended_variance(variance: FloatArray, orders: int) -> FloatArray:
    """Return the variance of order coefficients 0 to `orders` - 1; order 0 is absorbed by the fitted offset."""
    known = variance[np.isfinite(variance)]
    extended = np.full(orders, float(known[-1]) if len(known) else math.nan)
    count = min(orders, len(known))
    extended[:count] = known[:count]
    extended[0] = 0.0
    return extended


def _curves(waveform: FloatArray, width: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the smoothed waveform, its derivative by angle, and the derivative without smoothing, (n,) each."""
    n = waveform.shape[0]
    orders = np.arange(n // 2 + 1.0)
    gain = np.exp(-0.5 * (orders / width) ** 2)
    spectrum = np.fft.rfft(waveform)
    turned = spectrum * (1j * orders)
    turned[_DERIVATIVE_ORDERS:] = 0.0
    curves: FloatArray = np.fft.irfft(np.stack([spectrum * gain, turned * gain, turned]), n=n, axis=1)
    return curves[0], curves[1], curves[2]
