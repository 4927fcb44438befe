"""Timing of the contact edges of each revolution, and revolutions with that jitter removed."""

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates, spline_filter1d

from gateway.core.types import ComplexArray, FloatArray, IntArray
from gateway.diagnosis.data.campaign_data import EdgeTiming
from gateway.diagnosis.data.condition_groups import folded
from gateway.diagnosis.data.revolution_orders import SIGNS, waveform_orders
from gateway.diagnosis.data.revolution_scatter import regress, regressors, robust_variance
from gateway.diagnosis.effects.angle_orders import ORDERS
from gateway.diagnosis.effects.contact import CONTACT_EDGE_JITTER, EDGE_REACH_RAD

TERMS: Final = 4
"""Parameters of one revolution: how early its leading and trailing edges are, and the growth away from the middle."""

_ROUNDS: Final = 4
# Revolutions, and pairs of neighbours among them, from which jitter can be evident. One outlier in three is no scatter.
_MIN_REVOLUTIONS: Final = 4
# Fewer revolutions cannot tell jitter from the edges' dependence on speed, unless the speed changes by less than this
# share from turn to turn.
_MIN_AT_CHANGING_SPEED: Final = 12
_STEADY: Final = 1e-3
# The same shapes are fitted away from the contact. This bounds the amplitude that all other causes produce. Causes
# fixed in space contribute more at some angles than at others.
_ELSEWHERE_RAD: Final = tuple(math.pi + offset_rad for offset_rad in (-1.0, -0.5, 0.0, 0.5, 1.0))
# Decrease of the deviance from which revolutions are corrected.
_EVIDENT_CHI2: Final = 25.0
# Share of independent values among squares of successive differences, since neighbours share a contact.
_INDEPENDENT: Final = 2.0 / 3.0
_POINTS: Final = 512
_FINER: Final = 2
_SPLINE: Final = 5
_BATCH_SIZE: Final = 128
_FIXED_POINT_ROUNDS: Final = 4
# Number of periods in the running mean that periods are compared with.
_MEAN_PERIODS: Final = 9
_THETA: Final[FloatArray] = -math.pi + (2.0 * math.pi / _POINTS) * np.arange(_POINTS, dtype=np.float64)
_ORDER: Final[FloatArray] = np.arange(ORDERS, dtype=np.float64)


@dataclass(frozen=True, slots=True)
class Edges:
    """Timing of the contact edges of each revolution, and its statistics.

    Attributes:
        early_rad: (n, TERMS) leading edge at the revolution's end, trailing edge at its beginning; shrunk by the share
            that is noise, 0 where the edges do not jitter.
        half_angle_rad: contact half angle.
        timing: jitter statistics of the group.
    """

    early_rad: FloatArray
    half_angle_rad: float
    timing: EdgeTiming

    @property
    def evident(self) -> bool:
        """Whether the edges jitter measurably."""
        return bool(self.early_rad.any())

    def errors_of_mean(self, mean_mps2: ComplexArray, index: IntArray) -> ComplexArray:
        """Return changes of the mean waveform by errors of its mean edge angles, (m, 3, ORDERS), NaN as given.

        The edges are corrected to their mean over n contacts, which differs from that of all contacts by 1 / sqrt(n) of
        their scatter. Each row is the change by one standard error, independent of the others.

        Args:
            mean_mps2: (3, ORDERS) mean of the corrected revolutions.
            index: (n,) running numbers of the revolutions.
        """
        adjacent = np.flatnonzero(np.diff(index) == 1)
        if len(adjacent) < _MIN_REVOLUTIONS or not self.evident:
            return np.empty((0, *mean_mps2.shape), dtype=np.complex128)
        # Both edges of one contact: the leading one ends a revolution, the trailing one begins the next.
        leading, trailing = slice(0, TERMS, 2), slice(1, TERMS, 2)
        contacts = np.empty((len(adjacent), TERMS))
        contacts[:, leading], contacts[:, trailing] = (
            self.early_rad[adjacent, leading],
            self.early_rad[adjacent + 1, trailing],
        )
        values, vectors = np.linalg.eigh(np.cov(contacts.T) / len(self.early_rad))
        present = np.isfinite(mean_mps2)
        shapes = _shapes(np.where(present, mean_mps2, 0.0), self.half_angle_rad)
        result: ComplexArray = np.tensordot((vectors * np.sqrt(np.maximum(values, 0.0))).T, shapes, axes=1)
        result[:, ~present] = complex(math.nan, math.nan)
        return result


def bent_back(waveforms: FloatArray, theta_rad: FloatArray, early_rad: FloatArray, half_angle_rad: float) -> FloatArray:
    """Return waveforms with both edges moved to their mean angles.

    Args:
        waveforms: (n, ..., points) on an even grid of one revolution.
        theta_rad: (points,) its angles.
        early_rad: (n, TERMS) how early leading and trailing edge came.
        half_angle_rad: of the contact.
    """
    points = len(theta_rad)
    contact = np.flatnonzero(np.abs(theta_rad) < half_angle_rad + 1.2 * EDGE_REACH_RAD)
    result = waveforms.copy()
    for revolution in np.flatnonzero(early_rad.any(axis=1)).tolist():
        # s(theta) = measured(phi) with phi + early window(phi) = theta.
        phi_rad = theta_rad[contact]
        for _ in range(_FIXED_POINT_ROUNDS):
            phi_rad = theta_rad[contact] - early_rad[revolution] @ CONTACT_EDGE_JITTER.windows(phi_rad, half_angle_rad)
        index = ((phi_rad - theta_rad[0]) * (_FINER * points / (2.0 * math.pi)))[None]
        fine = np.fft.irfft(_FINER * np.fft.rfft(waveforms[revolution].astype(np.float64)), n=_FINER * points)
        spline = spline_filter1d(fine.reshape(-1, _FINER * points), order=_SPLINE, mode="grid-wrap")
        rows = [map_coordinates(row, index, order=_SPLINE, mode="grid-wrap", prefilter=False) for row in spline]
        result[revolution][..., contact] = np.reshape(rows, (*result[revolution].shape[:-1], len(contact)))
    return result


def orders_bent_back(orders_mps2: ComplexArray, early_rad: FloatArray, half_angle_rad: float) -> ComplexArray:
    """Return order coefficients (n, 3, ORDERS) of `bent_back` waveforms; NaN stays."""
    present = np.isfinite(orders_mps2)
    result = orders_mps2.astype(np.complex128)
    for begin in range(0, len(orders_mps2), _BATCH_SIZE):
        part = slice(begin, begin + _BATCH_SIZE)
        bent = bent_back(_field(np.nan_to_num(orders_mps2[part])), _THETA, early_rad[part], half_angle_rad)
        result[part] = waveform_orders(bent)
    result[~present] = complex(math.nan, math.nan)
    return result


def compare_edges(
    orders_mps2: NDArray[np.complexfloating],
    *,
    index: IntArray,
    period_s: FloatArray,
    omega_radps: FloatArray,
    omega_dot_radps2: FloatArray,
    half_angle_rad: float,
    folds: int,
) -> Edges:
    """Return how early each revolution's edges came, on the pipeline's angles, and whether that exceeds noise.

    Let s be the mean waveform. If the edges of a contact come early by b (leading) and a (trailing), the waveform
    changes by b s'(theta) and a s'(theta) near them. The pipeline puts angle 0 at the contact's centre, between the
    edges, so only b - a is observable: in the leading edge of one revolution and the trailing edge of the next. The
    correlation with the periods shows which of the two edges moves.

    Args:
        orders_mps2: (n, 3, ORDERS) in time order; NaN for absent axes and orders beyond the bandwidth.
        index: (n,) running numbers of the revolutions.
        period_s: (n,).
        omega_radps: (n,).
        omega_dot_radps2: (n,).
        half_angle_rad: of the contact.
        folds: parts into which the revolutions are divided for the held-out gain.
    """
    count = len(orders_mps2)
    timing = EdgeTiming()
    nothing = Edges(np.zeros((count, TERMS)), half_angle_rad, timing)
    adjacent = np.flatnonzero(np.diff(index) == 1)
    if count < _MIN_REVOLUTIONS or len(adjacent) < _MIN_REVOLUTIONS or not 0.0 < half_angle_rad < 0.5 * math.pi:
        return nothing
    if count < _MIN_AT_CHANGING_SPEED and np.median(np.abs(np.diff(omega_radps))) > _STEADY * float(omega_radps.mean()):
        return nothing
    raw = orders_mps2.astype(np.complex128)
    present = np.isfinite(raw).all(axis=0)
    raw[:, ~present] = 0.0
    rows = regressors(omega_radps, omega_dot_radps2)
    inliers = np.ones(count, dtype=bool)
    early = np.zeros((count, TERMS))
    orders = raw
    noise = np.zeros((len(_ELSEWHERE_RAD), count, TERMS))
    for number in range(_ROUNDS):
        fitted, _ = regress(orders, rows, inliers)
        residuals = orders - fitted
        weight = np.where(present, 1.0 / robust_variance(residuals, inliers), 0.0)
        shapes = _shapes(orders.mean(axis=0), half_angle_rad)
        early = early + _amplitudes(residuals, shapes, weight)
        early -= early.mean(axis=0)
        if number in (0, _ROUNDS - 1):
            noise = np.stack([_amplitudes(cut, shapes, weight) for cut in _cut_elsewhere(residuals)])
            timing = _timing(early, noise, adjacent, folds, count)
            if timing.chi2 < _EVIDENT_CHI2:
                return replace(nothing, timing=timing)
        orders = orders_bent_back(raw, early, half_angle_rad)
    # By chance, some of the jitter goes with the regressors and was taken for a dependence on speed. Within a group the
    # waveform changes with omega^2 alone by more than that.
    steady, _ = regress(orders, rows[:, :1], inliers)
    trend, _ = regress(_amplitudes(orders - steady, shapes, weight).astype(np.complex128), rows, inliers)
    early = early + trend.real - trend.real.mean(axis=0)
    orders = orders_bent_back(raw, early, half_angle_rad)
    noise_power = np.square(noise).mean(axis=(0, 1))
    reliability = np.maximum(0.0, 1.0 - noise_power / np.square(early).mean(axis=0))
    share, share_std = _leading_share(early, noise, adjacent, period_s * omega_radps.mean())
    explained, remaining = _explained(raw, orders, rows, half_angle_rad)
    timing = replace(
        timing, leading_share=share, leading_share_std=share_std, explained_m2ps4=explained, left_m2ps4=remaining
    )
    return Edges(early * reliability, half_angle_rad, timing)


def _timing(early: FloatArray, noise: FloatArray, adjacent: IntArray, folds: int, count: int) -> EdgeTiming:
    """Return the mean square change of b - a from contact to contact, by fold."""
    length = early[adjacent, 0] - early[adjacent + 1, 1]
    noise_length = noise[:, adjacent, 0] - noise[:, adjacent + 1, 1]
    # Differences between successive contacts: a slow drift, as of the load, is not jitter.
    steps = np.flatnonzero(np.diff(adjacent) == 1)
    if len(steps) < _MIN_REVOLUTIONS // 2:
        return EdgeTiming()
    power = 0.5 * np.square(np.diff(length))[steps]
    noise_power = 0.5 * np.square(np.diff(noise_length, axis=1))[:, steps]
    fold_index = np.zeros(count, dtype=np.intp)
    parts = folded(count, folds)
    for fold, places in enumerate(parts):
        fold_index[places] = fold
    step_folds = fold_index[adjacent[steps]]
    counts = np.bincount(step_folds, minlength=len(parts)).astype(np.float64)
    mean = np.divide(np.bincount(step_folds, power, len(parts)), counts, out=np.zeros(len(parts)), where=counts > 0.0)
    return EdgeTiming(
        tuple((_INDEPENDENT * counts).tolist()), tuple(mean.tolist()), float(noise_power.mean(axis=1).max())
    )


def _shapes(mean: ComplexArray, half_angle_rad: float) -> ComplexArray:
    """Return the change of the waveform by an edge that comes 1 rad early, (2, 3, ORDERS)."""
    slope = _field(1j * _ORDER * mean)
    return waveform_orders(CONTACT_EDGE_JITTER.windows(_THETA, half_angle_rad)[:, None] * slope)


def _amplitudes(residuals: ComplexArray, shapes: ComplexArray, weight: FloatArray) -> FloatArray:
    """Return the amplitudes of both shapes in each revolution by weighted least squares, (n, 2)."""
    weighted = np.conj(shapes) * weight
    matrix = np.einsum("pan,qan->pq", weighted, shapes).real
    moments = np.einsum("pan,kan->kp", weighted, residuals).real
    result: FloatArray = moments @ np.linalg.pinv(matrix, hermitian=True)
    return result


def _cut_elsewhere(residuals: ComplexArray) -> list[ComplexArray]:
    """Return the residuals of revolutions (n, 3, ORDERS) as if their contacts were elsewhere, (n, 3, ORDERS) each.

    In time, a revolution runs from angle 0 through pi to 0. The last one lacks its end, which is taken from the first.
    """
    field = np.concatenate(
        [_field(residuals[begin : begin + _BATCH_SIZE]) for begin in range(0, len(residuals), _BATCH_SIZE)]
    )
    stream = np.roll(field, -(_POINTS // 2), axis=-1).transpose(1, 0, 2).reshape(3, -1)
    elsewhere = []
    for angle_rad in _ELSEWHERE_RAD:
        rolled = np.roll(stream, -round(angle_rad / (2.0 * math.pi) * _POINTS), axis=-1)
        cut = np.roll(rolled.reshape(3, -1, _POINTS).transpose(1, 0, 2), _POINTS // 2, axis=-1)
        elsewhere.append(waveform_orders(cut))
    return elsewhere


def _leading_share(
    early: FloatArray, noise: FloatArray, adjacent: IntArray, periods_rad: FloatArray
) -> tuple[float, float]:
    """Return the leading edge's share of the mean square of b - a, and its standard error.

    The pipeline's centre lies at a + w d with d = b - a. The leading edge therefore shows (1 - w) d and the trailing
    edge -w d. The period between two contacts is shorter by the amount that the later centre is early.
    """
    length = early[adjacent, 0] - early[adjacent + 1, 1]
    noise_length = noise[:, adjacent, 0] - noise[:, adjacent + 1, 1]
    noise_power = float(np.square(noise_length).mean())
    power = float(np.square(length).mean()) - noise_power
    if not power > 0.0:
        return 0.5, 0.5
    covariance = float((early[adjacent, 0] * length).mean()) - float((noise[:, adjacent, 0] * noise_length).mean())
    centre_weight = 1.0 - covariance / power
    error = math.sqrt(noise_power / power / len(length))
    # Revolution k lies between contacts k and k + 1. Their d are known if revolutions k - 1 and k + 1 are adjacent.
    lengths = np.full(len(early) + 1, math.nan)
    lengths[adjacent + 1] = length
    step, intervals_rad = lengths[1:-1] - lengths[:-2], periods_rad[:-1]
    used = np.flatnonzero(np.isfinite(step))
    if len(used) < _MIN_REVOLUTIONS:
        return 0.5, 0.5
    step, intervals_rad = _detrended(step[used]), _detrended(intervals_rad[used])
    denominator = float(step @ step) - 2.0 * noise_power * len(step)
    if not denominator > 0.0:
        return 0.5, 0.5
    slope = -float(step @ intervals_rad) / denominator
    residuals = intervals_rad + slope * step
    slope_std = math.sqrt(float(residuals @ residuals) / len(residuals) / denominator)
    # For the trailing edge a: Cov(centre, d) = w Var(d) - Var(a).
    share = 1.0 - (centre_weight - slope)
    return min(1.0, max(0.0, share)), math.hypot(error, slope_std)


def _detrended(values: FloatArray) -> FloatArray:
    """Return values minus their running mean."""
    padded = np.pad(values, _MEAN_PERIODS // 2, mode="reflect")
    result: FloatArray = values - np.convolve(padded, np.full(_MEAN_PERIODS, 1.0 / _MEAN_PERIODS), mode="valid")
    return result


def _explained(raw: ComplexArray, bent: ComplexArray, rows: FloatArray, half_angle_rad: float) -> tuple[float, float]:
    """Return the mean square over the revolution that the correction removes, and the mean square that remains."""
    inliers = np.ones(len(raw), dtype=bool)
    is_near = np.abs(_THETA) < half_angle_rad + EDGE_REACH_RAD
    is_far = np.abs(_THETA) > 2.0 * (half_angle_rad + EDGE_REACH_RAD)
    powers = []
    for orders in (raw, bent):
        fitted, _ = regress(orders, rows, inliers)
        square = np.zeros((3, _POINTS))
        for begin in range(0, len(orders), _BATCH_SIZE):
            square += np.square(_field((orders - fitted)[begin : begin + _BATCH_SIZE])).sum(axis=0)
        square /= len(orders)
        powers.append(is_near.mean() * float((square[:, is_near].mean(axis=1) - square[:, is_far].mean(axis=1)).sum()))
    return powers[0] - powers[1], max(0.0, powers[1])


def _field(orders: ComplexArray) -> FloatArray:
    """Return curves (..., points) of coefficients (..., ORDERS)."""
    spectrum = np.zeros((*orders.shape[:-1], _POINTS // 2 + 1), dtype=np.complex128)
    spectrum[..., :ORDERS] = orders * (SIGNS * (0.5 * _POINTS))
    spectrum[..., 0] *= 2.0
    field: FloatArray = np.fft.irfft(spectrum, n=_POINTS, axis=-1)
    return field
