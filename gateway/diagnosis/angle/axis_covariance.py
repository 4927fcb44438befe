"""Covariance of the real coefficients of one axis in all groups of one state of the tire, and its inverse.

A group's coefficients are y_g = sum_p s_pg d_p + e_g: parts d_p of the discrepancy that the groups share, with
covariances P_p, and the group's own e_g with the scatter S_g and a share of the discrepancy's power.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import Final, Protocol

import numpy as np
from scipy.linalg import blas, lapack

from gateway.core.types import FloatArray, IntArray
from gateway.diagnosis import criteria
from gateway.diagnosis.angle.likelihood import REAL, batch_products

_JITTER: Final = 1e-10
# Size from which a matrix is factorised in two halves: LAPACK inverts triangles of this size at a third of the speed of
# its products.
_MAX_UNSPLIT_SIZE: Final = 300

Rows = Sequence[FloatArray | None]


@dataclass(frozen=True, slots=True)
class Scatter:
    """Scatter of one group's mean on one axis.

    Attributes:
        chosen: coefficients that are compared, (m,).
        factor: (m, REAL), whitens the coefficients.
        covariance: (m, m) of the chosen ones.
        log_determinant: of the covariance.
    """

    chosen: IntArray
    factor: FloatArray
    covariance: FloatArray
    log_determinant: float

    @classmethod
    def of(cls, factor: FloatArray) -> Scatter:
        """Return the scatter that a matrix (m, REAL) whitens: a lower triangle in the compared coefficients."""
        chosen = np.flatnonzero(factor.any(axis=0))
        triangle = factor[:, chosen]
        if not len(chosen):
            return cls(chosen, factor, triangle, 0.0)
        inverse, info = lapack.dtrtri(triangle, lower=1)
        if info:
            raise np.linalg.LinAlgError("the scatter is singular")
        spread = np.asarray(inverse, dtype=np.float64)
        log_determinant = -2.0 * float(np.log(np.diagonal(triangle)).sum())
        return cls(chosen, factor, spread @ spread.T, log_determinant)

    def thinned(self, share: float) -> Scatter:
        """Return the scatter of a mean over a share of the revolutions."""
        shift = len(self.chosen) * math.log(share)
        return Scatter(
            self.chosen, math.sqrt(share) * self.factor, self.covariance / share, self.log_determinant - shift
        )

    def placed(self, matrix: FloatArray) -> FloatArray:
        """Return a matrix (m, m) of the chosen coefficients as one of all, (REAL, REAL)."""
        if len(self.chosen) == REAL:
            return matrix
        result = np.zeros((REAL, REAL))
        result[np.ix_(self.chosen, self.chosen)] = matrix
        return result


@dataclass(frozen=True, slots=True)
class AxisGroups:
    """Groups of one state of the tire, on one axis.

    Attributes:
        groups: indices.
        scatters: of each group.
        scales: (parts, groups) size of each part of the discrepancy in each group.
        kernels: (kernels, REAL, REAL) of unit amplitude.
    """

    groups: tuple[int, ...]
    scatters: tuple[Scatter, ...]
    scales: FloatArray
    kernels: FloatArray

    @property
    def parts(self) -> int:
        """Number of parts: in proportion to omega^2, and constant."""
        return len(self.scales)

    def thinned(self, share: float) -> AxisGroups:
        """Return the same groups for data with a share of the revolutions."""
        return replace(self, scatters=tuple(scatter.thinned(share) for scatter in self.scatters))

    def combined(self, matrices: FloatArray) -> FloatArray:
        """Return the sum over kernels of amplitudes (kernels,) or more rows of them, (..., REAL, REAL)."""
        result: FloatArray = (matrices @ self.kernels.reshape(len(self.kernels), -1)).reshape(
            *matrices.shape[:-1], REAL, REAL
        )
        return result

    def seen(self, weighted: Sequence[FloatArray]) -> FloatArray:
        """Return rows (k, REAL) of each group as each part sees them, (parts, k, REAL)."""
        return np.asarray(np.tensordot(self.scales, np.stack(weighted), axes=1), dtype=np.float64)


class Inverse(Protocol):
    """Inverse C^-1 of the covariance of an axis with amplitudes.

    Attributes:
        log_determinant: of the covariance over that of the scatter.
        priors: covariance of each part of the discrepancy.
    """

    log_determinant: float
    priors: tuple[FloatArray, ...]

    def weighted(self, rows: Rows) -> list[FloatArray]:
        """Return C^-1 rows' of rows (k, REAL) in each group of the axis, (k, REAL) each; None stands for zeros."""
        ...

    def products(self, rows: Rows, batches: int) -> FloatArray:
        """Return rows C^-1 rows' within each of several equal batches of the rows, (batches, q, q)."""
        ...

    def inside(self, part: int) -> FloatArray:
        """Return C^-1 as one part of the discrepancy sees it, (REAL, REAL)."""
        ...


def inverse_of(axis_groups: AxisGroups, amplitudes: FloatArray) -> Inverse:
    """Return the inverse of an axis's covariance, by whichever of two equal ways inverts the smaller matrix.

    Args:
        axis_groups: scatter, scales and kernels.
        amplitudes: (parts, kernels) mean squares.

    Raises:
        LinAlgError: the covariance is singular.
    """
    covariances = axis_groups.combined(amplitudes[: axis_groups.parts])
    is_joint = len(axis_groups.groups) <= axis_groups.parts
    return _JointInverse(axis_groups, covariances) if is_joint else _PartwiseInverse(axis_groups, covariances)


def _unshared_covariance(axis_groups: AxisGroups, number: int, covariances: FloatArray) -> FloatArray:
    """Return the covariance of what one group does not share, (m, m)."""
    scatter = axis_groups.scatters[number]
    if len(axis_groups.groups) == 1:
        # What is a group's own is no different there from what it shares.
        return scatter.covariance
    unshared = np.tensordot(criteria.OWN_SHARE * np.square(axis_groups.scales[:, number]), covariances, axes=1)
    return np.asarray(scatter.covariance + _chosen(unshared, scatter.chosen, scatter.chosen), dtype=np.float64)


def _regularised(covariances: FloatArray) -> tuple[FloatArray, ...]:
    """Return the covariances (parts, REAL, REAL) with a diagonal by which their Cholesky factors exist."""
    regularised = []
    for matrix in covariances:
        prior = matrix.copy()
        prior[np.diag_indices(REAL)] += _JITTER * float(np.trace(prior)) / REAL
        regularised.append(prior)
    return tuple(regularised)


class _JointInverse:
    """Inverse of the covariance of all groups' coefficients as one matrix."""

    def __init__(self, axis_groups: AxisGroups, bare: FloatArray) -> None:
        self._axis_groups = axis_groups
        self.priors = _regularised(bare)
        scatters, scales = axis_groups.scatters, axis_groups.scales
        numbers = range(len(axis_groups.groups))
        ends = np.cumsum([0, *(len(scatter.chosen) for scatter in scatters)])
        slices = [slice(first, last) for first, last in pairwise(ends.tolist())]
        covariance = np.empty((ends[-1], ends[-1]))
        for first in numbers:
            for second in range(first + 1):
                # The lower triangle is enough for the factorisation.
                factors = scales[:, first] * scales[:, second]
                shared_prior = sum(factor * prior for factor, prior in zip(factors.tolist(), self.priors, strict=True))
                block = _chosen(np.asarray(shared_prior), scatters[first].chosen, scatters[second].chosen)
                if first == second:
                    block = block + _unshared_covariance(axis_groups, first, bare)
                covariance[slices[first], slices[second]] = block
        inverse, log_determinant = _inverse(covariance)
        self.log_determinant = log_determinant - sum(scatter.log_determinant for scatter in scatters)
        if len(inverse) < len(numbers) * REAL:
            chosen = np.concatenate([number * REAL + scatter.chosen for number, scatter in enumerate(scatters)])
            inverse, compared = np.zeros((len(numbers) * REAL, len(numbers) * REAL)), inverse
            inverse[np.ix_(chosen, chosen)] = compared
        self._inverse = inverse.reshape(len(numbers), REAL, len(numbers), REAL).transpose(0, 2, 1, 3)

    def weighted(self, rows: Rows) -> list[FloatArray]:
        size = next(len(row) for row in rows if row is not None)
        totals = []
        for blocks in self._inverse.transpose(1, 0, 2, 3):
            total = np.zeros((size, REAL))
            for row, block in zip(rows, blocks, strict=True):
                if row is not None:
                    total += row @ block
            totals.append(total)
        return totals

    def products(self, rows: Rows, batches: int) -> FloatArray:
        return batch_products(self.weighted(rows), rows, batches)

    def inside(self, part: int) -> FloatArray:
        scales = self._axis_groups.scales[part].tolist()
        groups = range(len(scales))
        return np.asarray(sum(scales[g] * scales[h] * self._inverse[g, h] for g in groups for h in groups))


class _PartwiseInverse:
    """Inverse by way of the coefficients that the groups share: C^-1 = G - G s (P^-1 + H)^-1 s' G.

    G is the inverse of the groups' own covariances, s the scales of the parts, and H = s' G s.
    """

    def __init__(self, axis_groups: AxisGroups, bare: FloatArray) -> None:
        self._axis_groups = axis_groups
        self.priors = _regularised(bare)
        parts = range(axis_groups.parts)
        self._lower = [_cholesky(prior) for prior in self.priors]
        self.log_determinant = 0.0
        self._unshared = []
        for number, scatter in enumerate(axis_groups.scatters):
            factor, log_determinant = inverse_factor(_unshared_covariance(axis_groups, number, bare))
            self._unshared.append(scatter.placed(factor.T @ factor))
            self.log_determinant += log_determinant - scatter.log_determinant
        # H and L' H of each pair of parts, with the Cholesky factor L of P.
        self._information: list[list[FloatArray]] = [[] for _ in parts]
        stacked = np.stack(self._unshared)
        for first in parts:
            for second in range(first + 1):
                scales = axis_groups.scales[first] * axis_groups.scales[second]
                self._information[first].append(np.tensordot(scales, stacked, axes=1))
        self._lower_information = np.empty((axis_groups.parts * REAL, axis_groups.parts * REAL))
        inner = np.empty_like(self._lower_information)
        for first in parts:
            for second in parts:
                block = self._lower_product(first, self._information[max(first, second)][min(first, second)])
                self._lower_information[_slice(first), _slice(second)] = block
                if second <= first:
                    # The lower triangle is enough for the factorisation.
                    inner[_slice(first), _slice(second)] = blas.dtrmm(1.0, self._lower[second], block, side=1, lower=1)
        inner[np.diag_indices(len(inner))] += 1.0
        self._factor, log_determinant = inverse_factor(inner)
        self.log_determinant += log_determinant

    def _lower_product(self, part: int, matrix: FloatArray) -> FloatArray:
        """Return L' times a symmetric matrix."""
        result: FloatArray = blas.dtrmm(1.0, self._lower[part], matrix.T, lower=1, trans_a=1)
        return result

    @cached_property
    def _solved_information(self) -> FloatArray:
        """Cholesky factor's inverse of I + L' H L, times L' H."""
        return lower_product(self._factor, self._lower_information)

    def weighted(self, rows: Rows) -> list[FloatArray]:
        unshared_rows = self._by_unshared(rows)
        solved = self._solved(unshared_rows) @ self._factor
        shared_rows = np.stack([solved[:, _slice(part)] @ lower.T for part, lower in enumerate(self._lower)])
        return [
            group_rows - np.tensordot(scales, shared_rows, axes=1) @ matrix
            for group_rows, scales, matrix in zip(
                unshared_rows, self._axis_groups.scales.T, self._unshared, strict=True
            )
        ]

    def products(self, rows: Rows, batches: int) -> FloatArray:
        unshared_rows = self._by_unshared(rows)
        solved = self._solved(unshared_rows).reshape(batches, -1, len(self._factor))
        return batch_products(unshared_rows, rows, batches) - solved @ solved.transpose(0, 2, 1)

    def _by_unshared(self, rows: Rows) -> list[FloatArray]:
        """Return rows G of each group."""
        size = next(len(row) for row in rows if row is not None)
        zeros = np.zeros((size, REAL))
        return [zeros if row is None else row @ matrix for row, matrix in zip(rows, self._unshared, strict=True)]

    def _solved(self, unshared_rows: Sequence[FloatArray]) -> FloatArray:
        """Return rows G s L times the inverse of the Cholesky factor of I + L' H L, (k, parts REAL)."""
        part_rows = self._axis_groups.seen(unshared_rows)
        scaled_rows = np.concatenate([part @ lower for part, lower in zip(part_rows, self._lower, strict=True)], axis=1)
        return np.asarray(scaled_rows @ self._factor.T)

    def inside(self, part: int) -> FloatArray:
        solved = self._solved_information[:, _slice(part)]
        return self._information[part][part] - solved.T @ solved


def inverse_factor(matrix: FloatArray) -> tuple[FloatArray, float]:
    """Return the inverse of a Cholesky factor, a lower triangle, and the logarithm of the matrix's determinant.

    Args:
        matrix: symmetric and positive definite; its lower triangle is read.

    Raises:
        LinAlgError: it is not positive definite.
    """
    size = len(matrix)
    if size == 0:
        return matrix, 0.0
    if size <= _MAX_UNSPLIT_SIZE:
        lower = _cholesky(matrix)
        inverse, _ = lapack.dtrtri(lower, lower=1)
        return inverse, 2.0 * float(np.log(np.diagonal(lower)).sum())
    half = size // 2
    result = np.zeros((size, size))
    result[:half, :half], first_log = inverse_factor(matrix[:half, :half])
    corner = matrix[half:, :half] @ result[:half, :half].T
    result[half:, half:], second_log = inverse_factor(matrix[half:, half:] - corner @ corner.T)
    result[half:, :half] = -result[half:, half:] @ (corner @ result[:half, :half])
    return result, first_log + second_log


def _inverse(matrix: FloatArray) -> tuple[FloatArray, float]:
    """Return the inverse of a matrix and the logarithm of its determinant; arguments as for `inverse_factor`."""
    if len(matrix) > _MAX_UNSPLIT_SIZE:
        # By the Schur complement of the first half.
        half = len(matrix) // 2
        lower_part = matrix[half:, :half]
        first_inverse, first_log = _inverse(matrix[:half, :half])
        gain = lower_part @ first_inverse
        second_inverse, second_log = _inverse(matrix[half:, half:] - gain @ lower_part.T)
        cross = second_inverse @ gain
        return np.block([[first_inverse + gain.T @ cross, -cross.T], [-cross, second_inverse]]), first_log + second_log
    if not len(matrix):
        return matrix, 0.0
    lower = _cholesky(matrix)
    log_determinant = 2.0 * float(np.log(np.diagonal(lower)).sum())
    inverse, _ = lapack.dpotri(lower, lower=1, overwrite_c=True)
    lower_part = np.tril(inverse)
    result: FloatArray = lower_part + lower_part.T
    result[np.diag_indices(len(result))] *= 0.5
    return result, log_determinant


def lower_product(lower: FloatArray, matrix: FloatArray) -> FloatArray:
    """Return a lower triangle times a matrix."""
    half = len(lower) // 2
    if len(lower) <= _MAX_UNSPLIT_SIZE:
        return lower @ matrix
    return np.concatenate([lower[:half, :half] @ matrix[:half], lower[half:] @ matrix])


def _cholesky(matrix: FloatArray) -> FloatArray:
    lower, info = lapack.dpotrf(matrix, lower=1)
    if info:
        raise np.linalg.LinAlgError("a covariance is not positive definite")
    return np.asarray(lower)


def _chosen(matrix: FloatArray, rows: IntArray, columns: IntArray) -> FloatArray:
    return matrix if len(rows) == len(columns) == REAL else matrix[np.ix_(rows, columns)]


def _slice(part: int) -> slice:
    return slice(part * REAL, (part + 1) * REAL)
