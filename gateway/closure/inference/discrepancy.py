"""Discrepancy: the part of the waveforms that no effect explains, a Gaussian process over the belt's angle.

For every axis it is a sum of zero-mean processes, near the contact and away from it, of three lengths each, and of the
single orders and places at which it is concentrated. Recordings of one state of the tire share them: a part in
proportion to omega^2 and, where the speeds differ, one that is the same at all speeds. A share of their power is each
recording's own, as nature keeps no such law strictly.
Kennedy and O'Hagan (2001), Bayesian calibration of computer models.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.linalg import cho_solve, cholesky, solve_triangular

from gateway.closure.data.campaign_data import Campaign
from gateway.closure.inference import criteria
from gateway.closure.inference.discrepancy_kernels import Concentration, kernel, smooth_kernels
from gateway.closure.inference.likelihood import REAL, Whitened
from gateway.types import FloatArray

_JITTER: Final = 1e-10
_AXES: Final = 3


@dataclass(frozen=True, slots=True)
class _Place:
    """Groups of one state of the tire, on one axis.

    Attributes:
        groups: indices.
        columns: of each group, the columns of its whitened coefficients that belong to the axis.
        factors: of each group, (m, REAL).
        scales: (parts, groups) size of each part of the discrepancy in each group.
        kernels: (kernels, REAL, REAL) of unit amplitude.
    """

    groups: tuple[int, ...]
    columns: tuple[slice, ...]
    factors: tuple[FloatArray, ...]
    scales: FloatArray
    kernels: FloatArray

    @property
    def parts(self) -> int:
        """Number of parts: in proportion to omega^2, and constant."""
        return len(self.scales)


class Discrepancy:
    """Places and kernels of the discrepancy of a campaign; amplitudes are kept apart.

    Amplitudes are mean squares, (m/s^2)^2, an array (places, parts, kernels); a place without a second part ignores it.
    """

    def __init__(
        self,
        campaign: Campaign,
        data: Whitened,
        lengths_rad: Sequence[float] = criteria.LENGTHS_RAD,
        concentrations: Sequence[Concentration] = (),
    ) -> None:
        """Prepare the places of a campaign.

        Args:
            campaign: conditions.
            data: whitened.
            lengths_rad: correlation lengths.
            concentrations: single orders and places.
        """
        self.size = data.size
        self.concentrations = tuple(concentrations)
        self.reference_mps2 = float(
            np.mean([group.conditions.radius_m * group.conditions.omega_radps**2 for group in campaign.groups])
        )
        self._places: list[tuple[int, int, _Place]] = []
        ends = [np.cumsum([0, *(len(factor) for factor in factors)]) for factors in data.factors]
        for state in range(campaign.states):
            groups = tuple(index for index, group in enumerate(campaign.groups) if group.state == state)
            if not groups:
                continue
            angle = float(np.mean([campaign.groups[index].half_angle_rad for index in groups]))
            kernels = smooth_kernels(round(angle, 3), tuple(lengths_rad))
            if concentrations:
                kernels = np.concatenate([kernels, [kernel(one) for one in concentrations]])
            omega = np.array([campaign.groups[index].conditions.omega_radps for index in groups])
            scales = [np.square(omega) / float(np.square(omega).mean())]
            if omega.max() > criteria.SPEEDS_APART * omega.min():
                scales.append(np.ones(len(groups)))
            for axis in range(_AXES):
                factors = tuple(data.factors[index][axis] for index in groups)
                if not any(len(factor) for factor in factors):
                    continue
                columns = tuple(slice(int(ends[index][axis]), int(ends[index][axis + 1])) for index in groups)
                place = _Place(groups, columns, factors, np.stack(scales), kernels)
                self._places.append((state, axis, place))
        self.shape = len(self._places), 2, 2 * len(lengths_rad) + len(concentrations)

    def start(self, residual: Sequence[FloatArray]) -> FloatArray:
        """Return amplitudes to start from: every place shares its residual's power beyond the scatter.

        Args:
            residual: whitened, (m,) of each group.
        """
        amplitudes = np.empty(self.shape)
        least = (criteria.START_SHARE * self.reference_mps2) ** 2
        for at, (_, _, place) in self.enumerate():
            powers = [0.0]
            for index, columns, factor in zip(place.groups, place.columns, place.factors, strict=True):
                own = residual[index][columns]
                # Whitened power beyond its expectation, in units of the smallest errors.
                excess = max(0.0, float(own @ own) - len(own))
                powers.append(excess / max(float(np.square(factor).sum()), 1e-300))
            amplitudes[at] = max(max(powers), least)
        return amplitudes

    def applied(self, amplitudes: FloatArray) -> Applied:
        """Return the discrepancy with its amplitudes."""
        return Applied(self, amplitudes, tuple(_solved(place, amplitudes[at]) for at, (*_, place) in self.enumerate()))

    def thinned(self, share: float) -> Discrepancy:
        """Return the same discrepancy for data with a share of the revolutions."""
        thin = copy(self)
        thin._places = [
            (state, axis, replace(place, factors=tuple(math.sqrt(share) * factor for factor in place.factors)))
            for state, axis, place in self._places
        ]
        return thin

    def concentrated(self, also: Concentration) -> Discrepancy:
        """Return the discrepancy with one more concentration, whose amplitudes are the last."""
        more = copy(self)
        more.concentrations = (*self.concentrations, also)
        added = kernel(also)[None]
        more._places = [
            (state, axis, replace(place, kernels=np.concatenate([place.kernels, added])))
            for state, axis, place in self._places
        ]
        more.shape = self.shape[0], self.shape[1], self.shape[2] + 1
        return more

    def scales(self, state: int, axis: int, group: int) -> FloatArray:
        """Return the size of each part of the discrepancy in one group, (parts,)."""
        for of, along, place in self._places:
            if (of, along) == (state, axis):
                result: FloatArray = place.scales[:, place.groups.index(group)]
                return result
        raise KeyError(f"no discrepancy on axis {axis} of state {state}")

    def enumerate(self) -> list[tuple[int, tuple[int, int, _Place]]]:
        """Return every place with its index, state and axis."""
        return list(enumerate(self._places))


@dataclass(frozen=True, slots=True)
class _Solved:
    """A place with amplitudes.

    Attributes:
        covariance: posterior covariance of its coefficients.
        information: of its coefficients, (parts REAL, parts REAL).
        triangles: of each group the Cholesky factor (m, m) of the scatter and its own share, None where it has none.
        through: of each group the matrix (m, REAL) from whitened rows to what the coefficients see.
        log_determinant: of the covariance over that of the scatter.
    """

    covariance: FloatArray
    information: FloatArray
    triangles: tuple[FloatArray | None, ...]
    through: tuple[FloatArray, ...]
    log_determinant: float

    def inner(self, place: _Place, rows: Sequence[FloatArray], others: Sequence[FloatArray]) -> FloatArray:
        """Return the product of rows and others' under the scatter and the groups' own share, (p, q)."""
        total = np.zeros((len(rows[0]), len(others[0])))
        for index, columns, triangle in zip(place.groups, place.columns, self.triangles, strict=True):
            left, right = rows[index][:, columns], others[index][:, columns]
            if triangle is None:
                total += left @ right.T
                continue
            seen = solve_triangular(triangle, left.T, lower=True, check_finite=False)
            same = others is rows
            total += seen.T @ (seen if same else solve_triangular(triangle, right.T, lower=True, check_finite=False))
        return total


@dataclass(frozen=True, slots=True)
class Applied:
    """A discrepancy with its amplitudes.

    Attributes:
        discrepancy: places and kernels.
        amplitudes: (places, parts, kernels).
        solved: of each place.
    """

    discrepancy: Discrepancy
    amplitudes: FloatArray
    solved: tuple[_Solved, ...]

    @property
    def log_determinant(self) -> float:
        """Logarithm of the determinant of the data's covariance over that of the scatter."""
        return sum(place.log_determinant for place in self.solved)

    def gram(self, rows: Sequence[FloatArray], others: Sequence[FloatArray] | None = None) -> FloatArray:
        """Return rows C^-1 others' for the data's covariance C, (p, q).

        Args:
            rows: whitened by the scatter, (p, m) of each group.
            others: likewise, (q, m); None for `rows`.
        """
        pairs = rows if others is None else others
        total = np.zeros((len(rows[0]), len(pairs[0])))
        for (_, (_, _, place)), solved in zip(self.discrepancy.enumerate(), self.solved, strict=True):
            left = projected(place, solved, rows)
            right = left if others is None else projected(place, solved, pairs)
            total += solved.inner(place, rows, pairs) - left @ solved.covariance @ right.T
        return total

    def seen(self, rows: Sequence[FloatArray]) -> tuple[FloatArray, ...]:
        """Return rows (p, m) of each group as each place corrects for them, for `cross`."""
        return tuple(
            projected(place, solved, rows) @ solved.covariance
            for (_, (_, _, place)), solved in zip(self.discrepancy.enumerate(), self.solved, strict=True)
        )

    def cross(self, rows: Sequence[FloatArray], seen: Sequence[FloatArray], others: Sequence[FloatArray]) -> FloatArray:
        """Return `gram(rows, others)` where `seen` is known."""
        total = np.zeros((len(rows[0]), len(others[0])))
        for (_, (_, _, place)), solved, known in zip(self.discrepancy.enumerate(), self.solved, seen, strict=True):
            total += solved.inner(place, rows, others) - known @ projected(place, solved, others).T
        return total

    def mean(self, residual: Sequence[FloatArray]) -> list[tuple[int, int, FloatArray, FloatArray]]:
        """Return the posterior mean and covariance of the discrepancy for a residual (m,) of each group.

        Returns:
            for every place its state, its axis, the coefficients (parts, REAL) and their covariance.
        """
        found = []
        rows = [row[None] for row in residual]
        for (_, (state, axis, place)), solved in zip(self.discrepancy.enumerate(), self.solved, strict=True):
            coefficients = solved.covariance @ projected(place, solved, rows)[0]
            found.append((state, axis, coefficients.reshape(place.parts, REAL), solved.covariance))
        return found

    def improved(self, rows: Sequence[FloatArray], residual: Sequence[FloatArray], precision: FloatArray) -> Applied:
        """Return the discrepancy with better amplitudes: one step of restricted maximum likelihood.

        The step a <- a (alpha' K alpha) / trace ends where the likelihood is stationary (MacKay's fixed point).

        Args:
            rows: whitened derivatives (p, m) of each group.
            residual: whitened, (m,) of each group, at the parameters of the fit.
            precision: (p, p) inverse of the parameters' posterior covariance.
        """
        amplitudes = self.amplitudes.copy()
        least = (criteria.LEAST_SHARE * self.discrepancy.reference_mps2) ** 2
        answers = self.answers(rows, residual, precision)
        for (at, (_, _, place)), parts in zip(self.discrepancy.enumerate(), answers, strict=True):
            for part, (answer, information) in enumerate(parts):
                for number, matrix in enumerate(place.kernels):
                    trace = float(np.einsum("ij,ij->", information, matrix))
                    if trace > 0.0:
                        data = float(answer @ matrix @ answer)
                        amplitudes[at, part, number] *= min(max(data / trace, 1e-6), 1e6)
        return self.discrepancy.applied(np.maximum(amplitudes, least))

    def answers(
        self, rows: Sequence[FloatArray], residual: Sequence[FloatArray], precision: FloatArray
    ) -> list[list[tuple[FloatArray, FloatArray]]]:
        """Return C^-1 r and C^-1 as the coefficients of each part of each place see them, what is fitted left out.

        Args:
            rows: whitened derivatives (p, m) of each group.
            residual: whitened, (m,) of each group, at the parameters of the fit.
            precision: (p, p) inverse of the parameters' posterior covariance.

        Returns:
            for every place and part, (REAL,) and (REAL, REAL).
        """
        stacked = [np.concatenate([row, left[None]]) for row, left in zip(rows, residual, strict=True)]
        spread = np.linalg.inv(precision)
        found = []
        for (_, (_, _, place)), solved in zip(self.discrepancy.enumerate(), self.solved, strict=True):
            seen = projected(place, solved, stacked)
            through = seen - seen @ solved.covariance @ solved.information
            inside = solved.information - solved.information @ solved.covariance @ solved.information
            fitted = through[:-1].T @ spread
            parts = []
            for part in range(place.parts):
                own = slice(part * REAL, (part + 1) * REAL)
                parts.append((through[-1, own], inside[own, own] - fitted[own] @ through[:-1, own]))
            found.append(parts)
        return found


def plain_gram(rows: Sequence[FloatArray], others: Sequence[FloatArray]) -> FloatArray:
    """Return the sum over groups of rows (p, m) times others' (q, m), (p, q)."""
    total = np.zeros((len(rows[0]), len(others[0])))
    for row, other in zip(rows, others, strict=True):
        total += row @ other.T
    return total


def projected(place: _Place, solved: _Solved, rows: Sequence[FloatArray]) -> FloatArray:
    """Return whitened rows (p, m) of each group as the coefficients of a place see them, (p, parts REAL)."""
    seen = np.zeros((place.parts, len(rows[0]), REAL))
    for number, (index, columns, through) in enumerate(zip(place.groups, place.columns, solved.through, strict=True)):
        seen += place.scales[:, number, None, None] * (rows[index][:, columns] @ through)
    return np.concatenate(seen, axis=1)


def _solved(place: _Place, amplitudes: FloatArray) -> _Solved:
    size = place.parts * REAL
    priors = [np.tensordot(amplitudes[part], place.kernels, axes=1) for part in range(place.parts)]
    lower = np.zeros((size, size))
    for part, prior in enumerate(priors):
        own = slice(part * REAL, (part + 1) * REAL)
        lower[own, own] = cholesky(prior + np.eye(REAL) * (_JITTER * float(np.trace(prior)) / REAL), lower=True)
    information = np.zeros((place.parts, REAL, place.parts, REAL))
    triangles: list[FloatArray | None] = []
    through = []
    log_determinant = 0.0
    for number, factor in enumerate(place.factors):
        triangle, passed = None, factor
        if len(place.groups) > 1:
            # What the groups do not share. Where there is one group, it is no different from what they share.
            shared = sum(scale**2 * prior for scale, prior in zip(place.scales[:, number], priors, strict=True))
            spread = np.eye(len(factor)) + criteria.OWN_SHARE * (factor @ shared @ factor.T)
            triangle = cholesky(spread, lower=True, check_finite=False)
            passed = cho_solve((triangle, True), factor, check_finite=False)
            log_determinant += 2.0 * float(np.log(np.diagonal(triangle)).sum())
        triangles.append(triangle)
        through.append(passed)
        gram = factor.T @ passed
        scales = place.scales[:, number]
        information += np.multiply.outer(scales, np.multiply.outer(scales, gram)).transpose(0, 2, 1, 3)
    flat = information.reshape(size, size)
    inner = lower.T @ flat @ lower
    inner[np.diag_indices(size)] += 1.0
    chol = cholesky(inner, lower=True)
    half = solve_triangular(chol, lower.T, lower=True)
    log_determinant += 2.0 * float(np.log(np.diagonal(chol)).sum())
    return _Solved(half.T @ half, flat, tuple(triangles), tuple(through), log_determinant)
