"""Scatter within a group: alignment of each revolution, outliers, and the covariance of the rest."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import convolve1d

from gateway.core.types import BoolArray, ComplexArray, FloatArray
from gateway.diagnosis.data.campaign_data import PROFILE_SIZE
from gateway.diagnosis.effects.angle_orders import ORDERS

# Number of revolutions from which the dependence on speed and its change is subtracted before scatter is measured.
_REGRESSED_FROM: Final = 12
# Relative change of speed per revolution that may be a timing error, and the window lengths for its smoothing.
_STEADY_CHANGE: Final = 1e-3
_SMOOTHING_LENGTHS: Final = (9, 17, 33)
_MAX_STD_RATIO: Final = 1.1
_ROUNDS: Final = 2
# Ratio of a deviation's power to the median above which a revolution is an outlier; rejected if outliers are rare.
_OUTLIER_RATIO: Final = 6.0
_MAX_OUTLIER_SHARE: Final = 0.1
_TRIMMED_FROM: Final = 6
# Degrees of freedom of a variance, reached by pooling neighbouring orders.
_FREEDOM: Final = 48
_MAX_HALF_WIDTH: Final = 12
# Weight of the neighbours' level for order 0, which is not pooled, in degrees of freedom.
_PRIOR_FREEDOM: Final = 2.0
# Width of the window in which the scatter's power is taken: narrow enough for a contact edge, and wide enough for some
# fifty degrees of freedom. Least power relative to the mean.
_PROFILE_RAD: Final = 0.04
_PROFILE_FREEDOM_RAD: Final = 0.4
_PROFILE_WIDEST_RAD: Final = 0.3
_LEAST_PROFILE: Final = 0.02
# Rounding of stored values, relative to the signal's root mean square.
_ROUNDING: Final = 1e-6
_ORDER: Final[FloatArray] = np.arange(ORDERS, dtype=np.float64)


@dataclass(frozen=True, slots=True)
class Settled:
    """Aligned revolutions of one group.

    Attributes:
        orders_mps2: (n, 3, ORDERS) rotated so that all contacts lie at the group's mean angle.
        shift_rad: (n,) rotation of each: its contact was early by this much on its angle grid.
        variance: (3, ORDERS) of one real coefficient of one revolution.
        profile: (3, PROFILE_SIZE) power of the scatter over the angle from -pi, mean 1.
        wild: (n,) outliers to reject.
    """

    orders_mps2: ComplexArray
    shift_rad: FloatArray
    variance: FloatArray
    profile: FloatArray
    wild: BoolArray


def settle(orders_mps2: NDArray[np.complexfloating], omega_radps: FloatArray, omega_dot_radps2: FloatArray) -> Settled:
    """Align the revolutions of one group and measure their scatter.

    The timing of the contacts jitters, and a mean over jittering revolutions is low-pass filtered. Every revolution is
    therefore rotated onto the group's mean first. The mean rotation is zero.

    Args:
        orders_mps2: (n, 3, ORDERS), n >= 2; NaN for absent axes and orders beyond the bandwidth.
        omega_radps: (n,).
        omega_dot_radps2: (n,).
    """
    orders = orders_mps2.astype(np.complex128)
    present: BoolArray = np.logical_and.reduce(np.isfinite(orders), axis=0)
    orders[:, ~present] = 0.0
    count = len(orders)
    rows = regressors(omega_radps, omega_dot_radps2)
    inliers = np.ones(count, dtype=bool)
    shift = np.zeros(count)
    for _ in range(_ROUNDS):
        fitted, _ = regress(orders, rows, inliers)
        weight = np.where(present, 1.0 / robust_variance(orders - fitted, inliers), 0.0)
        lead_rad = _leads(orders, fitted, weight)
        lead_rad -= np.median(lead_rad)
        shift += lead_rad
        orders *= np.exp(-1j * _ORDER * lead_rad[:, None, None])
        fitted, _ = regress(orders, rows, inliers)
        inliers = _inliers(orders - fitted, present, inliers)
    # The mean rotation is undone, so that the group's mean angle is unchanged.
    mean = float(shift[inliers].mean())
    shift -= mean
    orders *= np.exp(1j * _ORDER * mean)
    fitted, used = regress(orders, rows, inliers)
    variance = _variance((orders - fitted)[inliers], int(inliers.sum()) - used, present)
    floor = np.square(_ROUNDING * np.sqrt(np.square(np.abs(orders[inliers])).sum(axis=-1).mean(axis=0)))[:, None]
    variance = np.maximum(variance, floor)
    profile = _profile((orders - fitted)[inliers], int(inliers.sum()) - used)
    orders[:, ~present] = complex(np.nan, np.nan)
    return Settled(orders, shift, np.where(present, variance, np.nan), profile, ~inliers)


def _profile(residual: ComplexArray, freedom: int) -> FloatArray:
    """Return the power of the scatter over the angle, (3, PROFILE_SIZE), mean 1; smoother with fewer revolutions."""
    spectrum = np.zeros((len(residual), 3, PROFILE_SIZE), dtype=np.complex128)
    spectrum[..., :ORDERS] = residual * np.where(np.arange(ORDERS) % 2, -1.0, 1.0)
    # The grid carries products of two curves of 110 orders only folded; the fold is far below the profile's detail.
    field = np.fft.irfft(spectrum, n=2 * PROFILE_SIZE - 2, axis=-1)
    power = np.square(field).mean(axis=0)
    width_rad = min(max(_PROFILE_RAD, _PROFILE_FREEDOM_RAD / max(freedom, 1)), _PROFILE_WIDEST_RAD)
    order = np.arange(power.shape[-1] // 2 + 1)
    smooth = np.fft.irfft(np.fft.rfft(power) * np.exp(-0.5 * np.square(width_rad * order)), n=power.shape[-1])
    angle = np.arange(PROFILE_SIZE) * (power.shape[-1] / PROFILE_SIZE)
    result = np.stack([np.interp(angle, np.arange(len(row) + 1), np.append(row, row[0])) for row in smooth])
    mean = result.mean(axis=1, keepdims=True)
    return np.where(mean > 0.0, np.maximum(result, _LEAST_PROFILE * mean) / np.where(mean > 0.0, mean, 1.0), 1.0)


def regressors(omega_radps: FloatArray, omega_dot_radps2: FloatArray) -> FloatArray:
    """Return the regressors of a revolution's waveform, (n, k): omega^2 and, with many revolutions, 1 and domega/dt.

    The change of the measured speed between revolutions is mostly a timing error of the contacts. It follows whatever
    disturbs a contact, a tone for instance. Used unsmoothed, it would remove that disturbance or add one. Small
    changes are therefore smoothed over several revolutions.
    """
    square: FloatArray = np.square(omega_radps) / np.square(omega_radps).mean()
    if len(square) < _REGRESSED_FROM:
        return square[:, None]
    drift = omega_dot_radps2 / max(float(np.abs(omega_dot_radps2).max()), 1e-12)
    if float(np.std(omega_dot_radps2)) * 2.0 * np.pi / float(np.square(omega_radps).mean()) < _STEADY_CHANGE:
        drift = _running_mean(drift, _SMOOTHING_LENGTHS[0])
    timing_std = float(np.std(square - _running_mean(square, _SMOOTHING_LENGTHS[0])))
    if timing_std < 2.0 * _STEADY_CHANGE:
        # The longest window over which the speed changes by no more than its timing error.
        lengths = [
            n
            for n in _SMOOTHING_LENGTHS
            if n <= len(square) and np.std(square - _running_mean(square, n)) <= _MAX_STD_RATIO * timing_std
        ]
        square = _running_mean(square, lengths[-1])
    return np.column_stack((square, np.ones(len(square)), drift))


def _running_mean(values: FloatArray, length: int) -> FloatArray:
    """Return the running mean over `length` revolutions, a fitted line at the ends: a linear change is preserved.

    This is a Savitzky-Golay filter of order 1. `scipy.signal`, which has it, takes half a second to import.
    """
    result: FloatArray = convolve1d(values, np.full(length, 1.0 / length))
    half, index = length // 2, np.arange(length, dtype=np.float64)
    result[:half] = np.polyval(np.polyfit(index, values[:length], 1), index[:half])
    result[-half:] = np.polyval(np.polyfit(index, values[-length:], 1), index[-half:])
    return result


def regress(values: ComplexArray, rows: FloatArray, usual: BoolArray) -> tuple[ComplexArray, int]:
    """Return the predictions and the rank of a least-squares fit of rows (n, k) to the usual revolutions."""
    flat = values.reshape(len(values), -1)
    left_vectors, size, right_vectors = np.linalg.svd(rows[usual], full_matrices=False)
    is_significant = size > 1e-6 * size[0]
    inverse = (right_vectors[is_significant].T / size[is_significant]) @ left_vectors[:, is_significant].T
    fitted = rows @ (inverse @ flat[usual])
    result: ComplexArray = fitted.reshape(values.shape)
    return result, int(is_significant.sum())


def _leads(orders: ComplexArray, fitted: ComplexArray, weight: FloatArray) -> FloatArray:
    """Return the angle by which each revolution leads the fitted one, (n,), weighted least squares."""
    slope = 1j * _ORDER * fitted
    projection = (weight * (np.conj(slope) * (orders - fitted)).real).sum(axis=(1, 2))
    total = (weight * np.square(np.abs(slope))).sum(axis=(1, 2))
    lead_rad: FloatArray = np.divide(projection, total, out=np.zeros_like(projection), where=total > 0.0)
    return lead_rad


def robust_variance(residual: ComplexArray, usual: BoolArray) -> FloatArray:
    """Return the variance of one coefficient from the median power over revolutions, smoothed over orders."""
    power = np.median(np.square(np.abs(residual[usual])), axis=0) / (2.0 * np.log(2.0))
    smooth = _smoothed(power, _MAX_HALF_WIDTH)
    floor = 1e-12 * max(float(smooth.max()), 1e-30)
    result: FloatArray = np.maximum(smooth, floor)
    return result


def _inliers(residual: ComplexArray, present: BoolArray, previous: BoolArray) -> BoolArray:
    """Return the mask of revolutions that are no outliers; all revolutions if outliers are not rare."""
    count = len(residual)
    if count < _TRIMMED_FROM:
        return previous
    weight = np.where(present, 1.0 / robust_variance(residual, previous), 0.0)
    power = (weight * np.square(np.abs(residual))).sum(axis=(1, 2))
    inliers: BoolArray = power <= _OUTLIER_RATIO * np.median(power)
    return inliers if (~inliers).sum() <= max(1.0, _MAX_OUTLIER_SHARE * count) else np.ones(count, dtype=bool)


def _variance(residual: ComplexArray, freedom: int, present: BoolArray) -> FloatArray:
    freedom = max(freedom, 1)
    power = np.square(np.abs(residual)).sum(axis=0) / (2.0 * freedom)
    half = min(_MAX_HALF_WIDTH, max(0, int(np.ceil(0.5 * (_FREEDOM / (2.0 * freedom) - 1.0)))))
    variance = _smoothed(np.where(present, power, np.nan), half)
    # Order 0 has no sine term, and for white noise half the variance of the others.
    order_0_power = np.square(residual[..., 0].real).sum(axis=0)
    neighbour = np.nan_to_num(0.5 * variance[:, 1])
    variance[:, 0] = (order_0_power + _PRIOR_FREEDOM * neighbour) / (freedom + _PRIOR_FREEDOM)
    return variance


def _smoothed(power: FloatArray, half: int) -> FloatArray:
    """Return means over neighbouring orders from 1 on, narrower at low orders, which hold more than noise."""
    result = power.copy()
    if half == 0:
        return result
    valid = np.isfinite(power)
    filled = np.where(valid, power, 0.0)
    filled[:, 0], valid[:, 0] = 0.0, False
    sums = np.concatenate((np.zeros((len(power), 1)), np.cumsum(filled, axis=1)), axis=1)
    counts = np.concatenate((np.zeros((len(power), 1)), np.cumsum(valid, axis=1)), axis=1)
    order = np.arange(1, power.shape[1])
    reach = np.minimum(half, (order + 1) // 2)
    low, high = order - reach, np.minimum(order + reach + 1, power.shape[1])
    number = counts[:, high] - counts[:, low]
    total = sums[:, high] - sums[:, low]
    result[:, 1:] = np.divide(total, number, out=np.full_like(total, np.nan), where=valid[:, 1:] & (number > 0))
    return result
