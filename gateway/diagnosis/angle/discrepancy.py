"""Discrepancy: the part of the waveforms that no effect explains, a Gaussian process over the belt's angle.

For every axis it is a sum of zero-mean processes, near the contact and away from it, of three lengths each, and of the
orders, bands of orders and places at which it is concentrated. Recordings of one state of the tire share them: a part
in proportion to omega^2 and, where the speeds differ, one that is the same at all speeds. A share of their power is
each recording's own, as nature keeps no such law strictly.
Kennedy and O'Hagan (2001), Bayesian calibration of computer models.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np

from gateway.core.types import FloatArray
from gateway.diagnosis import criteria
from gateway.diagnosis.angle.axis_covariance import AxisGroups, Inverse, Rows, Scatter, inverse_of
from gateway.diagnosis.angle.discrepancy_kernels import Concentration, kernel, smooth_kernels
from gateway.diagnosis.angle.likelihood import REAL, Whitened
from gateway.diagnosis.data.campaign_data import Campaign

_AXES: Final = 3
# Ratio of two steps of an amplitude beyond which their limit is not known.
_LARGEST_RATIO: Final = 0.8


class Discrepancy:
    """Axes and kernels of the discrepancy of a campaign; amplitudes are kept apart.

    Amplitudes are mean squares, (m/s^2)^2, an array (axes of states, parts, kernels). One without a second part
    ignores it.

    Attributes:
        axes: index of the axis and groups, for every axis of a state.
        concentrations: orders, bands and places.
        reference_mps2: mean of R omega^2.
        shape: of amplitudes.
    """

    def __init__(
        self,
        campaign: Campaign,
        data: Whitened,
        concentrations: Sequence[Concentration] = (),
    ) -> None:
        """Prepare the axes of every state of a campaign.

        Args:
            campaign: conditions.
            data: whitened.
            concentrations: orders, bands and places.
        """
        self.concentrations = tuple(concentrations)
        self.reference_mps2 = float(
            np.mean([group.conditions.radius_m * group.conditions.omega_radps**2 for group in campaign.groups])
        )
        self.axes: list[tuple[int, AxisGroups]] = []
        for state in range(campaign.states):
            groups = tuple(index for index, group in enumerate(campaign.groups) if group.state == state)
            if not groups:
                continue
            angle = float(np.mean([campaign.groups[index].half_angle_rad for index in groups]))
            kernels = smooth_kernels(round(angle, 3), criteria.LENGTHS_RAD)
            if concentrations:
                kernels = np.concatenate([kernels, [kernel(concentration) for concentration in concentrations]])
            omega = np.array([campaign.groups[index].conditions.omega_radps for index in groups])
            scales = [np.square(omega) / float(np.square(omega).mean())]
            if omega.max() > criteria.SPEEDS_APART * omega.min():
                scales.append(np.ones(len(groups)))
            for axis in range(_AXES):
                factors = tuple(data.factors[index][axis] for index in groups)
                if not any(len(factor) for factor in factors):
                    continue
                axis_groups = AxisGroups(groups, tuple(map(Scatter.of, factors)), np.stack(scales), kernels)
                self.axes.append((axis, axis_groups))
        self.shape = len(self.axes), 2, 2 * len(criteria.LENGTHS_RAD) + len(concentrations)

    def start(self, residual: Sequence[FloatArray]) -> FloatArray:
        """Return amplitudes to start from: every axis of a state shares its residual's power beyond the scatter.

        Args:
            residual: real coefficients of each group, (3, REAL).
        """
        amplitudes = np.empty(self.shape)
        floor = (criteria.START_SHARE * self.reference_mps2) ** 2
        for number, (axis, axis_groups) in enumerate(self.axes):
            powers = [0.0]
            for index, scatter in zip(axis_groups.groups, axis_groups.scatters, strict=True):
                whitened = scatter.factor @ residual[index][axis]
                # Whitened power beyond its expectation, in units of the smallest errors.
                excess = max(0.0, float(whitened @ whitened) - len(whitened))
                powers.append(excess / max(float(np.square(scatter.factor).sum()), 1e-300))
            amplitudes[number] = max(max(powers), floor)
        return amplitudes

    def applied(self, amplitudes: FloatArray) -> Applied:
        """Return the discrepancy with its amplitudes.

        Raises:
            LinAlgError: the covariance cannot be inverted.
        """
        applied = Applied(self, amplitudes)
        # What has no inverse fails here.
        _ = applied.log_determinants
        return applied

    def thinned(self, share: float) -> Discrepancy:
        """Return the same discrepancy for data with a share of the revolutions."""
        thinned = copy(self)
        thinned.axes = [(axis, axis_groups.thinned(share)) for axis, axis_groups in self.axes]
        return thinned

    def concentrated(self, also: Concentration) -> Discrepancy:
        """Return the discrepancy with one more concentration, whose amplitudes are the last."""
        extended = copy(self)
        extended.concentrations = (*self.concentrations, also)
        added = kernel(also)[None]
        extended.axes = [
            (axis, replace(axis_groups, kernels=np.concatenate([axis_groups.kernels, added])))
            for axis, axis_groups in self.axes
        ]
        extended.shape = self.shape[0], self.shape[1], self.shape[2] + 1
        return extended


@dataclass(frozen=True)
class Applied:
    """A discrepancy with its amplitudes.

    Attributes:
        discrepancy: axes of states, and kernels.
        amplitudes: (axes of states, parts, kernels).
    """

    discrepancy: Discrepancy
    amplitudes: FloatArray

    @cached_property
    def inverses(self) -> tuple[Inverse, ...]:
        """Of the covariance of each axis of a state, up to ten megabytes each."""
        groups = (axis_groups for _, axis_groups in self.discrepancy.axes)
        return tuple(inverse_of(*of_axis) for of_axis in zip(groups, self.amplitudes, strict=True))

    def release(self) -> None:
        """Release the memory of the inverses; they are worked out again where they are needed."""
        self.__dict__.pop("inverses", None)

    @cached_property
    def log_determinants(self) -> FloatArray:
        """Logarithm of the determinant of each axis' covariance over that of the scatter, (3,)."""
        result = np.zeros(_AXES)
        for (axis, _), inverse in zip(self.discrepancy.axes, self.inverses, strict=True):
            result[axis] += inverse.log_determinant
        return result

    @property
    def log_determinant(self) -> float:
        """Their sum over the axes."""
        return float(self.log_determinants.sum())

    def weighted(self, rows: Rows) -> list[FloatArray]:
        """Return C^-1 rows' for the data's covariance C, (k, 3, REAL) of each group.

        Args:
            rows: real coefficients, (k, 3, REAL) of each group; None stands for zeros.
        """
        size = next(len(row) for row in rows if row is not None)
        results = [np.zeros((size, _AXES, REAL)) for _ in rows]
        for (axis, axis_groups), inverse in zip(self.discrepancy.axes, self.inverses, strict=True):
            axis_rows = _rows_of(rows, axis_groups, axis)
            if axis_rows is not None:
                for index, weighted in zip(axis_groups.groups, inverse.weighted(axis_rows), strict=True):
                    results[index][:, axis] = weighted
        return results

    def products(self, rows: Rows, batches: int) -> FloatArray:
        """Return rows C^-1 rows' within equal batches of rows as for `weighted`, (batches, k, k)."""
        size = next(len(row) for row in rows if row is not None) // batches
        total = np.zeros((batches, size, size))
        for (axis, axis_groups), inverse in zip(self.discrepancy.axes, self.inverses, strict=True):
            axis_rows = _rows_of(rows, axis_groups, axis)
            if axis_rows is not None:
                total += inverse.products(axis_rows, batches)
        return total

    def mean(self, weighted: Sequence[FloatArray]) -> list[FloatArray]:
        """Return the posterior mean of the discrepancy in every group, real coefficients (3, REAL) each.

        Args:
            weighted: C^-1 times the residual, (3, REAL) of each group.
        """
        means = [np.zeros((_AXES, REAL)) for _ in weighted]
        for (axis, axis_groups), inverse in zip(self.discrepancy.axes, self.inverses, strict=True):
            part_rows = axis_groups.seen([weighted[index][axis][None] for index in axis_groups.groups])
            coefficients = np.stack([prior @ part[0] for prior, part in zip(inverse.priors, part_rows, strict=True)])
            for index, scales in zip(axis_groups.groups, axis_groups.scales.T, strict=True):
                means[index][axis] = scales @ coefficients
        return means

    def improved(self, weighted: Sequence[FloatArray], precision: FloatArray) -> Applied:
        """Return the discrepancy with better amplitudes: one step of restricted maximum likelihood.

        The step a <- a (alpha' K alpha) / trace ends where the likelihood is stationary (MacKay's fixed point).

        Args:
            weighted: C^-1 times the derivatives and the residual at the parameters of the fit, (p + 1, 3, REAL) of each
                group.
            precision: (p, p) inverse of the parameters' posterior covariance.
        """
        amplitudes = self.amplitudes.copy()
        answers = self.answers(weighted, precision)
        for number, ((_, axis_groups), parts) in enumerate(zip(self.discrepancy.axes, answers, strict=True)):
            kernels = axis_groups.kernels.reshape(len(axis_groups.kernels), -1)
            for part, (answer, information) in enumerate(parts):
                squares = kernels @ np.outer(answer, answer).ravel()
                trace = kernels @ information.ravel()
                ratio = np.clip(squares / np.where(trace > 0.0, trace, 1.0), 1e-6, 1e6)
                amplitudes[number, part] *= np.where(trace > 0.0, ratio, 1.0)
        return self._with(amplitudes)

    def limit(self, first: FloatArray, second: FloatArray) -> Applied:
        """Return the discrepancy at the limit of steps from two earlier amplitudes to these (Aitken's delta-squared).

        The logarithm of an amplitude steps by less each time, in a ratio that counts as at most _LARGEST_RATIO.
        """
        earlier, last = np.log(second / first), np.log(self.amplitudes / second)
        ratio = np.clip(np.divide(last, earlier, out=np.zeros_like(last), where=earlier != 0.0), 0.0, _LARGEST_RATIO)
        return self._with(self.amplitudes * np.clip(np.exp(last * ratio / (1.0 - ratio)), 1e-6, 1e6))

    def _with(self, amplitudes: FloatArray) -> Applied:
        """Return the discrepancy with these amplitudes; axes on which none differs keep their inverse.

        Those at their lower limit mostly stay there.
        """
        floor = (criteria.LEAST_SHARE * self.discrepancy.reference_mps2) ** 2
        applied = Applied(self.discrepancy, np.maximum(amplitudes, floor))
        applied.__dict__["inverses"] = tuple(
            inverse if np.array_equal(new, old) else inverse_of(axis_groups, new)
            for (_, axis_groups), inverse, new, old in zip(
                self.discrepancy.axes, self.inverses, applied.amplitudes, self.amplitudes, strict=True
            )
        )
        return applied

    def answers(
        self, weighted: Sequence[FloatArray], precision: FloatArray
    ) -> list[list[tuple[FloatArray, FloatArray]]]:
        """Return C^-1 r and C^-1 as each part of each axis of a state sees them, what is fitted left out.

        Args:
            weighted: as for `improved`.
            precision: (p, p) inverse of the parameters' posterior covariance.

        Returns:
            for every axis of a state and part, (REAL,) and (REAL, REAL).
        """
        covariance = np.linalg.inv(precision)
        by_axis = []
        for number, (axis, axis_groups) in enumerate(self.discrepancy.axes):
            parts = []
            for part, part_rows in enumerate(
                axis_groups.seen([weighted[index][:, axis] for index in axis_groups.groups])
            ):
                rows, answer = part_rows[:-1], part_rows[-1]
                parts.append((answer, self.inverses[number].inside(part) - rows.T @ (covariance @ rows)))
            by_axis.append(parts)
        return by_axis


def _rows_of(rows: Rows, axis_groups: AxisGroups, axis: int) -> list[FloatArray | None] | None:
    """Return the rows (k, REAL) of an axis's groups, None for zeros; None if no group of it has any."""
    axis_rows = [
        None if (row := rows[index]) is None or not row[:, axis].any() else row[:, axis] for index in axis_groups.groups
    ]
    return None if all(row is None for row in axis_rows) else axis_rows
