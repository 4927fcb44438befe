"""Residual of the angle-locked signal: place, scaling with speed, and size."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from scipy.special import chdtrc

from gateway.closure.data.campaign_data import ORDERS, Campaign
from gateway.closure.effects.effect import CIRCUMFERENTIAL, LATERAL, RADIAL
from gateway.closure.inference.fit import Fit
from gateway.closure.inference.likelihood import Whitened
from gateway.closure.model.sensor_signal import THETA, orders_field
from gateway.closure.result import Scaling, ScalingStatus, Unexplained
from gateway.constants import AXIS_NAMES
from gateway.types import ComplexArray, FloatArray, IntArray

POWER_SHARE: Final = np.where(np.arange(ORDERS) == 0, 1.0, 0.5)
"""Mean square of a waveform by the squares of its orders' coefficients, (ORDERS,)."""
PLANE: Final = [CIRCUMFERENTIAL, RADIAL]
"""Axes of the wheel's plane, on which the ring's numbers rest."""
PARTS: Final = (PLANE, [LATERAL])
"""Axes whose evidence counts alike: one ring moves both of the wheel's plane, the lateral one has its own model."""
# Probability that noise alone in one band of one axis is reported as a residual.
_RARE: Final = 1e-6
BANDS: Final = (0, 1, 2, 3, 5, 8, 12, 18, 27, 40, 60, 85, ORDERS)
"""Bands of orders tested, each half again as wide as the one before."""
# Share of the power that the reported angle window holds, and the widest window reported.
_WINDOW_SHARE: Final = 0.7
_WIDEST_RAD: Final = 2.2
# Speeds must differ by this ratio for an exponent to be fitted.
_SPEED_RATIO: Final = 1.15
_HIGHEST_EXPONENT: Final = 4
# Standard error from which an exponent is uncertain.
_UNCERTAIN: Final = 0.5
# Share of the largest residual below which a band is not listed.
_NEGLIGIBLE: Final = 0.02
# Standard errors above which a residual is listed.
_SIGMAS: Final = 3.0


class ByPart(NamedTuple):
    """A figure of the wheel's plane and of the lateral axis."""

    plane: float = 1.0
    lateral: float = 1.0


@dataclass(frozen=True, slots=True)
class GroupResidual:
    """Mean residual of one group.

    Attributes:
        orders_mps2: (3, ORDERS) data less prediction, mean over blocks, without what it owes to the error of the
            contact's mean edge angles; 0 where nothing is known.
        variance: (3, ORDERS) of one real coefficient by noise and computation; 0 where unknown.
    """

    orders_mps2: ComplexArray
    variance: FloatArray

    def rms_mps2(self, first: int = 0, last: int = ORDERS) -> FloatArray:
        """Return the rms of the residual beyond noise over orders [first, last), (3,)."""
        result: FloatArray = np.sqrt(np.maximum(_excess(self)[:, first:last].sum(axis=1), 0.0))
        return result

    def noise_rms_mps2(self) -> FloatArray:
        """Return the rms of the noise over all orders, (3,)."""
        result: FloatArray = np.sqrt(self.variance.sum(axis=1))
        return result


def group_residuals(fit: Fit, data: Whitened) -> tuple[GroupResidual, ...]:
    """Return the mean residual of every group."""
    residuals = []
    for index, predicted in enumerate(fit.predicted):
        total = np.square(data.weights[index]).sum(axis=0)
        present = total > 0.0
        scale = np.where(present, 1.0 / np.where(present, total, 1.0), 0.0)
        by_edges = data.by_edges(index, fit.weighted[index][-1])
        mean = np.where(present, data.mean(index, data.orders[index]) - predicted - by_edges, 0.0)
        residuals.append(GroupResidual(mean, scale))
    return tuple(residuals)


def residual_ratio(fit: Fit, data: Whitened, axes: Sequence[int] = range(3)) -> float:
    """Return the mean square of what a fit leaves of some axes over that of the groups' means' noise, at least 1."""
    excess = noise = 0.0
    chosen = list(axes)
    for residual in group_residuals(fit, data):
        excess += float(np.square(residual.rms_mps2()[chosen]).sum())
        noise += float(residual.variance[chosen].sum())
    return 1.0 + excess / noise if noise > 0.0 else 1.0


def ratios_by_part(fit: Fit, data: Whitened) -> ByPart:
    """Return the same ratio of the wheel's plane and of the lateral axis."""
    return ByPart(*(residual_ratio(fit, data, axes) for axes in PARTS))


def left_shares(fit: Fit, data: Whitened) -> tuple[float, ...]:
    """Return for every group the rms of what a fit leaves beyond noise over that of the signal about its mean.

    Of the axes in the wheel's plane, on which the ring's numbers rest.
    """
    shares = []
    for index, residual in enumerate(group_residuals(fit, data)):
        mean = np.nan_to_num(data.mean(index, data.orders[index]))
        signal = (POWER_SHARE * np.abs(mean) ** 2)[PLANE, 1:].sum()
        remaining = np.square(residual.rms_mps2(1))[PLANE].sum()
        shares.append(math.sqrt(float(remaining / signal)) if signal > 0.0 else 0.0)
    return tuple(shares)


def _excess(residual: GroupResidual) -> FloatArray:
    """Return the mean square beyond noise of each order, (3, ORDERS)."""
    square = np.abs(residual.orders_mps2) ** 2
    result: FloatArray = POWER_SHARE * square - residual.variance
    return result


def unexplained(fit: Fit, data: Whitened) -> tuple[Unexplained, ...]:
    """Return the parts of the angle-locked residual above the noise, largest first."""
    campaign = fit.model.campaign
    residuals = group_residuals(fit, data)
    entries = []
    for axis in range(3):
        bands = [band for band in itertools.pairwise(BANDS) if _stands_out(residuals, axis, *band)]
        for first, last in joined(bands):
            entries.append(_described(campaign, residuals, axis, first, last))
    entries.sort(key=lambda entry: -entry.rms_mps2)
    largest = entries[0].rms_mps2 if entries else 0.0
    return tuple(e for e in entries if e.rms_mps2 > max(_NEGLIGIBLE * largest, _SIGMAS * e.std_mps2))


def _stands_out(residuals: Sequence[GroupResidual], axis: int, first: int, last: int) -> bool:
    statistic, freedom = 0.0, 0
    for residual in residuals:
        variance = residual.variance[axis, first:last]
        present = variance > 0.0
        power = np.abs(residual.orders_mps2[axis, first:last][present]) ** 2 / variance[present]
        statistic += float(power.sum())
        freedom += 2 * int(present.sum()) - int(first == 0 and present.any())
    return freedom > 0 and float(chdtrc(freedom, statistic)) < _RARE


def joined(bands: list[tuple[int, int]]) -> list[tuple[int, int]]:
    """Merge adjacent bands."""
    joined: list[tuple[int, int]] = []
    for first, last in bands:
        if joined and joined[-1][1] == first:
            joined[-1] = (joined[-1][0], last)
        else:
            joined.append((first, last))
    return joined


def _described(campaign: Campaign, residuals: Sequence[GroupResidual], axis: int, first: int, last: int) -> Unexplained:
    power = np.array([np.maximum(_excess(r)[axis, first:last], 0.0).sum() for r in residuals])
    error = np.array([_rms_error(r, axis, first, last) for r in residuals])
    rms = np.sqrt(power)
    largest = int(np.argmax(rms))
    size, std = float(rms[largest]), float(error[largest])
    if size < _SIGMAS * std:
        # If only the groups together show it, the mean square of all.
        size = math.sqrt(float(power.mean()))
        std = math.sqrt(float(np.square(rms * error).sum())) / max(len(rms) * size, 1e-300)
    low, high = _core_orders(residuals, axis, first, last)
    omegas = np.array([group.conditions.omega_radps for group in campaign.groups])
    hz = (low * float(omegas.min()) / (2.0 * math.pi), high * float(omegas.max()) / (2.0 * math.pi))
    states = np.array([group.state for group in campaign.groups])
    scaling = _scaling(omegas, states, rms, error)
    window = _window(residuals[largest], axis, first, last)
    return Unexplained(AXIS_NAMES[axis], "angle", (low, high), hz, window, scaling, size, std)


def _rms_error(residual: GroupResidual, axis: int, first: int, last: int) -> float:
    """Return the standard error of an rms."""
    variance = residual.variance[axis, first:last]
    square = np.abs(residual.orders_mps2[axis, first:last]) ** 2
    total = max(float(_excess(residual)[axis, first:last].sum()), float(variance.max(initial=0.0)), 1e-300)
    return 0.5 * math.sqrt(float((square * variance).sum())) / math.sqrt(total)


def _core_orders(residuals: Sequence[GroupResidual], axis: int, first: int, last: int) -> tuple[int, int]:
    """Return the orders that hold nearly all of the residual."""
    power = sum(np.maximum(_excess(r)[axis, first:last], 0.0) for r in residuals)
    share = np.cumsum(power) / max(float(np.sum(power)), 1e-300)
    low = first + int(np.searchsorted(share, 0.02))
    high = first + int(np.searchsorted(share, 0.98))
    return low, min(high, last - 1)


def _window(residual: GroupResidual, axis: int, first: int, last: int) -> tuple[float, float] | None:
    """Return the narrowest angle window with most of the residual; None if it is wide."""
    orders = np.zeros(ORDERS, dtype=np.complex128)
    orders[first:last] = residual.orders_mps2[axis, first:last]
    power = np.square(orders_field(orders))
    share = np.concatenate([[0.0], np.cumsum(np.concatenate([power, power]))]) / max(float(power.sum()), 1e-300)
    n = len(power)
    ends = np.searchsorted(share, share[:n] + _WINDOW_SHARE)
    widths = ends - np.arange(n)
    start = int(np.argmin(widths))
    step = 2.0 * math.pi / n
    if widths[start] * step > _WIDEST_RAD:
        return None
    return float(THETA[start]), float(THETA[start]) + float(widths[start]) * step


def _scaling(omegas: FloatArray, states: IntArray, rms: FloatArray, error: FloatArray) -> Scaling:
    """Return the growth of a size with speed at one load and pressure; speeds of different states say nothing."""
    if omegas.max() < _SPEED_RATIO * omegas.min():
        return Scaling(ScalingStatus.ONE_SPEED)
    if not _has_speeds(omegas, states):
        return Scaling(ScalingStatus.SPEED_WITH_LOAD)
    sure = rms > 3.0 * error
    if not _has_speeds(omegas[sure], states[sure]):
        return Scaling(ScalingStatus.TOO_WEAK)
    weight = rms[sure] / error[sure]
    slope, slope_error = _slope(np.log(omegas[sure]), np.log(rms[sure]), states[sure], weight)
    nearest = min(range(_HIGHEST_EXPONENT + 1), key=lambda power: abs(slope - power))
    if abs(slope - nearest) < max(0.35, 2.0 * slope_error) and slope_error < 0.5:
        return Scaling(ScalingStatus.KNOWN, float(nearest))
    if slope_error >= _UNCERTAIN:
        return Scaling(ScalingStatus.UNCERTAIN, slope, slope_error)
    return Scaling(ScalingStatus.KNOWN, slope)


def _has_speeds(omegas: FloatArray, states: IntArray) -> bool:
    """Return whether one state of the tire was driven at two speeds."""
    by_state = [omegas[states == state] for state in np.unique(states)]
    return any(len(speeds) > 1 and speeds.max() >= _SPEED_RATIO * speeds.min() for speeds in by_state)


def _slope(x: FloatArray, y: FloatArray, states: IntArray, weight: FloatArray) -> tuple[float, float]:
    """Return the slope within states and its standard error."""
    square = np.square(np.minimum(weight, 20.0))
    product = spread = 0.0
    for state in np.unique(states):
        inside = states == state
        away = x[inside] - float(square[inside] @ x[inside] / square[inside].sum())
        product += float(square[inside] @ (away * y[inside]))
        spread += float(square[inside] @ np.square(away))
    return product / spread, 1.0 / math.sqrt(spread)
