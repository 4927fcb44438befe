"""Unexplained orders of the mean waveforms: place, scaling with speed, and size."""

import itertools
import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from scipy.special import chdtrc

from gateway.core.constants import AXIS_NAMES
from gateway.core.types import FloatArray, IntArray
from gateway.diagnosis.angle.fit import Fit
from gateway.diagnosis.angle.likelihood import Whitened
from gateway.diagnosis.angle.residual import GroupResidual, group_residuals
from gateway.diagnosis.data.campaign_data import Campaign
from gateway.diagnosis.effects.angle_orders import ORDERS, THETA, orders_field
from gateway.diagnosis.result import Scaling, ScalingStatus, Unexplained

# Probability that noise alone in one band of one axis is reported as a residual.
_MAX_PROBABILITY: Final = 1e-6
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
_NEGLIGIBLE_SHARE: Final = 0.02
# Standard errors above which a residual is listed.
_SIGMAS: Final = 3.0


def unexplained(fit: Fit, data: Whitened) -> tuple[Unexplained, ...]:
    """Return the parts of the angle-locked residual above the noise, largest first."""
    campaign = fit.model.campaign
    residuals = group_residuals(fit, data)
    entries = []
    for axis in range(3):
        bands = [band for band in itertools.pairwise(BANDS) if _is_significant(residuals, axis, *band)]
        for first, last in joined(bands):
            entries.append(_entry(campaign, residuals, axis, first, last))
    entries.sort(key=lambda entry: -entry.rms_mps2)
    largest = entries[0].rms_mps2 if entries else 0.0
    return tuple(e for e in entries if e.rms_mps2 > max(_NEGLIGIBLE_SHARE * largest, _SIGMAS * e.std_mps2))


def _is_significant(residuals: Sequence[GroupResidual], axis: int, first: int, last: int) -> bool:
    statistic, freedom = 0.0, 0
    for residual in residuals:
        variance = residual.variance[axis, first:last]
        present = variance > 0.0
        power = np.abs(residual.orders_mps2[axis, first:last][present]) ** 2 / variance[present]
        statistic += float(power.sum())
        freedom += 2 * int(present.sum()) - int(first == 0 and present.any())
    return freedom > 0 and float(chdtrc(freedom, statistic)) < _MAX_PROBABILITY


def joined(bands: list[tuple[int, int]]) -> list[tuple[int, int]]:
    """Merge adjacent bands."""
    joined: list[tuple[int, int]] = []
    for first, last in bands:
        if joined and joined[-1][1] == first:
            joined[-1] = (joined[-1][0], last)
        else:
            joined.append((first, last))
    return joined


def _entry(campaign: Campaign, residuals: Sequence[GroupResidual], axis: int, first: int, last: int) -> Unexplained:
    power = np.array([np.maximum(r.excess()[axis, first:last], 0.0).sum() for r in residuals])
    error = np.array([_rms_error(r, axis, first, last) for r in residuals])
    rms = np.sqrt(power)
    largest = int(np.argmax(rms))
    size, std = float(rms[largest]), float(error[largest])
    if size < _SIGMAS * std:
        # If only the groups together show it, the mean square of all.
        size = math.sqrt(float(power.mean()))
        std = math.sqrt(float(np.square(rms * error).sum())) / max(len(rms) * size, 1e-300)
    low, high = core_orders(np.sum([np.maximum(r.excess()[axis, first:last], 0.0) for r in residuals], axis=0), first)
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
    total = max(float(residual.excess()[axis, first:last].sum()), float(variance.max(initial=0.0)), 1e-300)
    return 0.5 * math.sqrt(float((square * variance).sum())) / math.sqrt(total)


def core_orders(power: FloatArray, first: int) -> tuple[int, int]:
    """Return the lowest and the highest order that hold nearly all of the power of orders from the first one, (n,)."""
    fraction = np.cumsum(power) / max(float(power.sum()), 1e-300)
    low, high = np.searchsorted(fraction, [0.02, 0.98]).tolist()
    return first + low, first + min(high, len(power) - 1)


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
    is_certain = rms > 3.0 * error
    if not _has_speeds(omegas[is_certain], states[is_certain]):
        return Scaling(ScalingStatus.TOO_WEAK)
    weight = rms[is_certain] / error[is_certain]
    slope, slope_error = _slope(np.log(omegas[is_certain]), np.log(rms[is_certain]), states[is_certain], weight)
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
        in_state = states == state
        centred = x[in_state] - float(square[in_state] @ x[in_state] / square[in_state].sum())
        product += float(square[in_state] @ (centred * y[in_state]))
        spread += float(square[in_state] @ np.square(centred))
    return product / spread, 1.0 / math.sqrt(spread)
