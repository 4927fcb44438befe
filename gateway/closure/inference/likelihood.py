"""Likelihood: whitening by the measured scatter, misfit by fold, normal equations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from gateway.closure.data.campaign_data import Campaign, Group
from gateway.types import ComplexArray, FloatArray, IntArray

# Errors of resampling, rounding and the solver's grid beyond noise: a share of the order's own size and of the
# signal's. Because of them the held-out error of a recording without effects is slightly below the noise floor.
_OWN_SHARE: Final = 1e-4
_FLAT_SHARE: Final = 6e-6
# Number of orders over which the spectrum is smoothed before the share is applied.
_SMOOTHED: Final = 5


@dataclass(frozen=True, slots=True)
class Whitened:
    """A campaign's data with their weights.

    Attributes:
        orders: (blocks, 3, ORDERS) a group, NaN set to 0.
        weights: (blocks, 3, ORDERS) a group: 1 / standard deviation of a real coefficient, 0 for unused orders.
        variance: (blocks, 3, ORDERS) a group, without floor.
    """

    orders: tuple[ComplexArray, ...]
    weights: tuple[FloatArray, ...]
    variance: tuple[FloatArray, ...]

    def without(self, fold: int) -> Whitened:
        """Return the same data with one fold's weights at 0."""
        weights = []
        for weight in self.weights:
            kept = weight.copy()
            if fold < len(kept):
                kept[fold] = 0.0
            weights.append(kept)
        return Whitened(self.orders, tuple(weights), self.variance)

    def loosened(self, share: float) -> Whitened:
        """Return the same data as if every order were uncertain by this share of the signal, for a rough fit."""
        weights = []
        for orders, weight in zip(self.orders, self.weights, strict=True):
            error = share * np.abs(orders).max(axis=(1, 2), keepdims=True)
            weights.append(weight / np.sqrt(1.0 + np.square(weight * error)))
        return Whitened(self.orders, tuple(weights), self.variance)

    def doubting(self, errors: Sequence[Sequence[FloatArray]]) -> Whitened:
        """Return the same data with the errors of the effects' equations added to the uncertainty.

        Args:
            errors: for every effect the equation error in each group's orders, (3, ORDERS) each.
        """
        weights = []
        for index, weight in enumerate(self.weights):
            variance = np.zeros(weight.shape[1:])
            for sizes in errors:
                variance += np.square(_smooth(sizes[index]))
            weights.append(weight / np.sqrt(1.0 + np.square(weight) * variance))
        return Whitened(self.orders, tuple(weights), self.variance)

    @property
    def used(self) -> int:
        """Number of weighted real coefficients; order 0 has one, the others two."""
        return sum(int(2 * np.sum(weight > 0.0) - np.sum(weight[..., 0] > 0.0)) for weight in self.weights)

    @property
    def folds(self) -> int:
        """Most blocks of any group."""
        return max(len(weight) for weight in self.weights)


def whiten(campaign: Campaign, *, with_mean: bool, unseen: int | None = None) -> Whitened:
    """Return the campaign's data with weights.

    The variance of a block's mean is the scatter of revolutions over their number, times what neighbouring blocks
    differ by more than that (scatter that is not independent from revolution to revolution).

    Args:
        campaign: the data.
        with_mean: False leaves out order 0.
        unseen: fold that is not used for any weights, its own included.
    """
    orders, weights, variances = [], [], []
    for group in campaign.groups:
        data = np.stack([block.orders_mps2 for block in group.blocks])
        counts = np.array([block.count for block in group.blocks], dtype=np.float64)
        variance = group.variance[None] / counts[:, None, None] * _dependence(_seen(group, unseen))
        floor = _floor(_seen(group, unseen))
        known = np.isfinite(data) & np.isfinite(variance) & (variance + floor > 0.0)
        if not with_mean:
            # A tilt leaks the radial mean, which the model lacks, into the other axes.
            known[:, :, 0] = False
        weight = np.where(known, 1.0 / np.sqrt(np.where(known, variance + floor, 1.0)), 0.0)
        orders.append(np.where(known, data, 0.0))
        weights.append(weight)
        variances.append(np.where(known, variance, 0.0))
    return Whitened(tuple(orders), tuple(weights), tuple(variances))


def _seen(group: Group, unseen: int | None) -> Group:
    """Return the group without a block, if it has others."""
    blocks = tuple(block for place, block in enumerate(group.blocks) if place != unseen)
    return replace(group, blocks=blocks or group.blocks)


def _smooth(size: FloatArray) -> FloatArray:
    """Return the rms of neighbouring orders, (3, ORDERS)."""
    kernel = np.ones(_SMOOTHED) / _SMOOTHED
    return np.stack([np.sqrt(np.convolve(np.square(row), kernel, mode="same")) for row in size])


def _floor(group: Group) -> FloatArray:
    """Return the variance of the computational errors, (1, 3, ORDERS)."""
    conditions = group.conditions
    size = np.nan_to_num(np.abs(np.stack([block.orders_mps2 for block in group.blocks]))).mean(axis=0)
    smooth = _smooth(size)
    steady = conditions.radius_m * conditions.omega_radps**2
    result: FloatArray = (np.square(_OWN_SHARE * smooth) + (_FLAT_SHARE * steady) ** 2)[None]
    return result


def _dependence(group: Group) -> FloatArray:
    """Return the ratio of the scatter of blocks to that of independent revolutions, at least 1, (1, 3, 1)."""
    if len(group.blocks) < 3:
        return np.ones((1, 3, 1))
    data = np.stack([block.orders_mps2 for block in group.blocks])
    counts = np.array([block.count for block in group.blocks], dtype=np.float64)
    share = counts / counts.sum()
    mean = np.tensordot(share, data, axes=1)
    # Orders 2 and up: below, drifts of load and speed between blocks are real.
    between = np.abs(data - mean)[..., 2:] ** 2 * counts[:, None, None]
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = between.sum(axis=0) / (2.0 * (len(counts) - 1) * group.variance[:, 2:])
    result = np.ones(3)
    for axis in range(3):
        known = ratio[axis][np.isfinite(ratio[axis])]
        if len(known):
            result[axis] = max(1.0, float(np.median(known)))
    return result[None, :, None]


@dataclass(frozen=True, slots=True)
class Normal:
    """Normal equations by fold: H = sum J'WJ, b = J'Wr, c = r'Wr.

    Attributes:
        matrix: (K, P, P).
        gradient: (K, P).
        misfit: (K,).
    """

    matrix: FloatArray
    gradient: FloatArray
    misfit: FloatArray


def empty_normal(folds: int, size: int) -> Normal:
    """Return zeros to add to."""
    return Normal(np.zeros((folds, size, size)), np.zeros((folds, size)), np.zeros(folds))


def add_rows(normal: Normal, places: IntArray, rows: ComplexArray, residual: ComplexArray) -> None:
    """Add one group's whitened rows (blocks, k, 3, ORDERS) and residual (blocks, 3, ORDERS), in place."""
    there, left = as_real(rows), as_real(residual)
    blocks = np.arange(len(left))
    normal.matrix[np.ix_(blocks, places, places)] += there @ there.swapaxes(1, 2)
    normal.gradient[np.ix_(blocks, places)] += (there @ left[:, :, None])[..., 0]
    normal.misfit[blocks] += np.square(left).sum(axis=1)


def as_real(coefficients: ComplexArray) -> FloatArray:
    """Return the last two axes (3, ORDERS) of complex coefficients as one of real numbers, without a copy."""
    flat: FloatArray = np.ascontiguousarray(coefficients).reshape(*coefficients.shape[:-2], -1).view(np.float64)
    return flat
