"""Likelihood of the groups' mean waveforms: scatter of revolutions with its place on the belt, and whitening by it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
from scipy.linalg import cholesky, solve_triangular
from scipy.special import gammaincinv

from gateway.core.types import BoolArray, ComplexArray, FloatArray
from gateway.diagnosis import criteria
from gateway.diagnosis.data.campaign_data import PROFILE_SIZE, Campaign, Group
from gateway.diagnosis.effects.angle_orders import ORDERS
from gateway.diagnosis.model.baseline import Core

REAL: Final = 2 * ORDERS - 1
"""Real coefficients of one axis: the cosine terms of all orders, then the sine terms from order 1 on."""

# Errors of resampling, rounding and the solver's grid beyond noise: a share of the order's own size, and a thirtieth of
# it of R omega^2. Because of them the held-out error of a recording without effects is slightly below the noise floor.
_OWN_SHARE: Final = 3e-5
_FLAT_SHARE: Final = 1.0 / 30.0
# Number of orders over which the spectrum is smoothed before a share is applied.
_SMOOTHING_ORDERS: Final = 5
# Blocks from which their scatter is compared with that of revolutions, and the least ratio of the two.
_MIN_BLOCKS: Final = 3
_MIN_DEPENDENCE: Final = 0.5
_ORDER: Final[FloatArray] = np.arange(ORDERS, dtype=np.float64)

ANGLES: Final[FloatArray] = -np.pi + 2.0 * np.pi / REAL * np.arange(REAL, dtype=np.float64)
"""Angles of the grid on which a waveform of all orders is complete, (REAL,)."""


def _to_field() -> FloatArray:
    """Return the matrix from the real coefficients to the curve at ANGLES; a coefficient is c - i s."""
    phases_rad = np.outer(ANGLES, _ORDER)
    return np.asarray(np.hstack([np.cos(phases_rad), -np.sin(phases_rad[:, 1:])]), dtype=np.float64)


TO_FIELD: Final[FloatArray] = _to_field()
FROM_FIELD: Final[FloatArray] = np.asarray(np.linalg.inv(TO_FIELD), dtype=np.float64)


@dataclass(frozen=True)
class Whitened:
    """A campaign's data with their weights.

    Attributes:
        orders: (blocks, 3, ORDERS) of each group, NaN set to 0.
        counts: (blocks,) revolutions of each group's blocks.
        used: (3, ORDERS) of each group, the coefficients that are compared.
        factors: of each group for every axis the matrix (m, REAL) that whitens the error of the group's mean.
        weights: (blocks, 3, ORDERS) of each group, 1 / standard deviation of a real coefficient by the scatter, 0 for
            unused orders.
        edge_errors: (k, 3, REAL) of each group, changes by errors of its mean edge angles, one standard error each;
            part of what `factors` whiten, not of the weights.
    """

    orders: tuple[ComplexArray, ...]
    counts: tuple[FloatArray, ...]
    used: tuple[BoolArray, ...]
    factors: tuple[tuple[FloatArray, ...], ...]
    weights: tuple[FloatArray, ...]
    edge_errors: tuple[FloatArray, ...]

    @property
    def size(self) -> int:
        """Number of real coefficients compared."""
        return sum(len(factor) for group in self.factors for factor in group)

    @property
    def folds(self) -> int:
        """Most blocks of any group."""
        return max(len(counts) for counts in self.counts)

    @cached_property
    def precisions(self) -> tuple[FloatArray, ...]:
        """Inverse of the scatter's covariance of each group's coefficients, (3, REAL, REAL)."""
        return tuple(np.stack([factor.T @ factor for factor in group]) for group in self.factors)

    def weighted(self, rows: Sequence[FloatArray | None]) -> list[FloatArray]:
        """Return real coefficients (k, 3, REAL) of each group times the precision of the scatter, likewise.

        Args:
            rows: None stands for zeros.
        """
        size = next(len(row) for row in rows if row is not None)
        results = [np.zeros((size, 3, REAL)) for _ in rows]
        for result, row, precision in zip(results, rows, self.precisions, strict=True):
            for axis in range(3):
                # Most effects answer in the wheel's plane or across it.
                if row is not None and row[:, axis].any():
                    result[:, axis] = row[:, axis] @ precision[axis]
        return results

    def products(self, rows: Sequence[FloatArray | None], batches: int) -> FloatArray:
        """Return rows C^-1 rows' for the scatter C within equal batches of rows as for `weighted`, (batches, k, k)."""
        return batch_products(self.weighted(rows), rows, batches)

    def loosened(self, share: float) -> Whitened:
        """Return the same data as if every order were uncertain by this share of the signal, for a rough fit."""
        factors = []
        for orders, factor in zip(self.orders, self.factors, strict=True):
            error = share * float(np.abs(orders).max())
            loose_factors = []
            for axis_factor in factor:
                loose_factor = np.zeros_like(axis_factor)
                chosen = np.flatnonzero(axis_factor.any(axis=0))
                loose_factor[np.arange(len(axis_factor)), chosen] = 1.0 / error
                loose_factors.append(loose_factor)
            factors.append(tuple(loose_factors))
        return replace(self, factors=tuple(factors))

    def by_edges(self, group: int, weighted: FloatArray, share: float = 1.0) -> ComplexArray:
        """Return what a group's residual owes to the error of its mean edge angles, (3, ORDERS).

        Args:
            group: index.
            weighted: (3, REAL) C^-1 times the residual, C its covariance.
            share: of the revolutions whose mean the residual is.
        """
        errors = self.edge_errors[group]
        sizes = np.clip(np.einsum("kan,an->ka", errors, weighted) / share, -criteria.EDGE_SIGMAS, criteria.EDGE_SIGMAS)
        return as_complex(np.einsum("ka,kan->an", sizes, errors))

    def mean(self, group: int, values: ComplexArray) -> ComplexArray:
        """Return the mean (3, ORDERS) of the blocks' values (blocks, 3, ORDERS) over revolutions."""
        weights = self.counts[group] / self.counts[group].sum()
        result: ComplexArray = np.tensordot(weights, values, axes=1)
        return result


def batch_products(weighted: Sequence[FloatArray], rows: Sequence[FloatArray | None], batches: int) -> FloatArray:
    """Return the sum over groups of weighted rows (k, ...) times rows', within equal batches of them."""
    size = len(weighted[0]) // batches
    total = np.zeros((batches, size, size))
    for weighted_row, row in zip(weighted, rows, strict=True):
        if row is not None:
            total += weighted_row.reshape(batches, size, -1) @ row.reshape(batches, size, -1).transpose(0, 2, 1)
    return total


def as_real(coefficients: ComplexArray) -> FloatArray:
    """Return complex coefficients (..., ORDERS) as real ones, (..., REAL)."""
    result: FloatArray = np.concatenate([coefficients.real, coefficients.imag[..., 1:]], axis=-1)
    return result


def as_complex(real: FloatArray) -> ComplexArray:
    """Return real coefficients (..., REAL) as complex ones, (..., ORDERS)."""
    result = real[..., :ORDERS].astype(np.complex128)
    result[..., 1:] += 1j * real[..., ORDERS:]
    return result


def whiten(campaign: Campaign, core: Core) -> Whitened:
    """Return the campaign's data with weights.

    The covariance of a group's mean is the scatter of revolutions over their number, times what neighbouring blocks
    differ by more than that (scatter that is not independent from revolution to revolution). The scatter has a power
    over the orders and one over the angle: its covariance is D F D, with D the root of the power over the angle and F
    diagonal in the orders. Where the contact's edges jitter, the error of their mean angles is added, which changes the
    orders of all axes together. Axes are independent here: each has so large an error that their average has the true
    one.

    Args:
        campaign: the data.
        core: baseline model. Without a mean, order 0 is left out; the error of its equations is that of the data too.
    """
    orders, counts, used, factors, weights, edge_errors = [], [], [], [], [], []
    for group in campaign.groups:
        data = np.stack([block.orders_mps2 for block in group.blocks])
        count = group.counts
        present = np.isfinite(data).all(axis=0) & np.isfinite(group.variance)
        if not core.mean:
            # A tilt leaks the radial mean, which the model lacks, into the other axes.
            present[:, 0] = False
        variance = np.where(present, group.variance, 0.0) * _dependence(group)
        floor = _floor(group, math.hypot(_OWN_SHARE, core.equation_share))
        present &= variance + floor > 0.0
        orders.append(np.where(present, np.nan_to_num(data), 0.0))
        counts.append(count)
        used.append(present)
        errors = _edge_errors(group, present)
        factors.append(
            tuple(
                _factor(present[a], variance[a] / count.sum(), floor[a], _profile(group, a), errors[:, a])
                for a in range(3)
            )
        )
        spread = variance / count[:, None, None] + _floor(group, _OWN_SHARE)
        weights.append(np.where(present, 1.0 / np.sqrt(np.where(present, spread, 1.0)), 0.0))
        edge_errors.append(errors)
    return Whitened(tuple(orders), tuple(counts), tuple(used), tuple(factors), tuple(weights), tuple(edge_errors))


def _profile(group: Group, axis: int) -> FloatArray | None:
    return None if group.scatter_profile is None else group.scatter_profile[axis]


def _edge_errors(group: Group, present: BoolArray) -> FloatArray:
    """Return real coefficients of the errors of a group's mean by its mean edge angles, (k, 3, REAL)."""
    if group.edge_errors_mps2 is None:
        return np.zeros((0, 3, REAL))
    return math.sqrt(present.any(axis=1).sum()) * as_real(np.where(present, np.nan_to_num(group.edge_errors_mps2), 0.0))


def _factor(
    present: BoolArray, variance: FloatArray, floor: FloatArray, profile: FloatArray | None, errors: FloatArray
) -> FloatArray:
    """Return the whitening matrix of one axis, (m, REAL); `errors` (k, REAL) are one standard error each."""
    chosen = np.flatnonzero(np.concatenate([present, present[1:]]))
    if not len(chosen):
        return np.zeros((0, REAL))
    scatter_variance = np.concatenate([variance, variance[1:]])
    floor_variance = np.concatenate([floor, floor[1:]])
    result = np.zeros((len(chosen), REAL))
    if profile is None and not len(errors):
        result[np.arange(len(chosen)), chosen] = (scatter_variance + floor_variance)[chosen] ** -0.5
        return result
    covariance = np.diag(scatter_variance)
    if profile is not None:
        angle = -np.pi + 2.0 * np.pi / PROFILE_SIZE * np.arange(PROFILE_SIZE + 1)
        profile_root = np.interp(ANGLES, angle, np.sqrt(np.append(profile, profile[0])))
        root_matrix = FROM_FIELD @ (profile_root[:, None] * TO_FIELD)
        covariance = (root_matrix * scatter_variance) @ root_matrix.T
    covariance += np.diag(floor_variance) + errors.T @ errors
    lower = cholesky(covariance[np.ix_(chosen, chosen)], lower=True)
    result[:, chosen] = solve_triangular(lower, np.eye(len(chosen)), lower=True)
    return result


def _floor(group: Group, share: float) -> FloatArray:
    """Return the variance of errors that are a share of each order, (3, ORDERS)."""
    conditions = group.conditions
    size = np.nan_to_num(np.abs(np.stack([block.orders_mps2 for block in group.blocks]))).mean(axis=0)
    kernel = np.ones(_SMOOTHING_ORDERS) / _SMOOTHING_ORDERS
    smooth = np.stack([np.convolve(np.square(row), kernel, mode="same") for row in size])
    centripetal = conditions.radius_m * conditions.omega_radps**2
    result: FloatArray = share**2 * (smooth + (_FLAT_SHARE * centripetal) ** 2)
    return result


def _dependence(group: Group) -> FloatArray:
    """Return the ratio of the scatter of blocks to that of independent revolutions, (3, 1).

    Below 1 where errors of neighbouring revolutions cancel, as those of a contact's timing, which ends one revolution
    and begins the next.
    """
    if len(group.blocks) < _MIN_BLOCKS:
        return np.ones((3, 1))
    data = np.stack([block.orders_mps2 for block in group.blocks])
    counts = group.counts
    # Orders 2 and up in proportion to omega^2: what drifts of load and speed change is no scatter.
    omega_squared = np.array([block.conditions.omega_radps**2 for block in group.blocks])
    data = data * (group.conditions.omega_radps**2 / omega_squared)[:, None, None]
    mean = np.tensordot(counts / counts.sum(), data, axes=1)
    deviation_squares = np.abs(data - mean)[..., 2:] ** 2 * counts[:, None, None]
    freedom = 2 * (len(counts) - 1)
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = deviation_squares.sum(axis=0) / (freedom * group.variance[:, 2:])
    result = np.ones((3, 1))
    for axis in range(3):
        finite = ratio[axis][np.isfinite(ratio[axis])]
        if len(finite):
            # The median is robust; that of a chi-square is below its mean.
            expected = 2.0 * float(gammaincinv(0.5 * freedom, 0.5))
            result[axis] = max(_MIN_DEPENDENCE, float(np.median(finite)) * freedom / expected)
    return result
