"""Consecutive revolutions as stacked arrays, computed once for all estimators."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from operator import attrgetter
from typing import Any, Final, NamedTuple, Self

import numpy as np

from gateway.core.estimates.estimator import AngleAverage, Estimate, Revolution, TireConditions
from gateway.core.revolutions.order_spectrum import ORDER_COUNT
from gateway.core.revolutions.synchronous_average import AverageSteps, OneAverage, RunningAverage
from gateway.core.types import ComplexArray, FloatArray

LEAST_MEASURED: Final = 0.5
"""Share of a revolution that must be measured where it is averaged: more of it than is filled."""


def measured_shares(revolutions: Sequence[Revolution]) -> list[float] | None:
    """Return the share of each revolution that was measured and not filled; None where all was, as nearly always."""
    missing = [revolution.missing_fraction for revolution in revolutions]
    # One with faults that stands for itself may have lost nearly all.
    return [max(1.0 - share, LEAST_MEASURED) for share in missing] if any(missing) else None


class RevolutionArrays:
    """Waveforms of k revolutions and what is common to several estimators of them.

    Attributes:
        revolutions: in order.
    """

    def __init__(self, revolutions: Sequence[Revolution]) -> None:
        self.revolutions = revolutions

    @classmethod
    def of_rows(
        cls,
        revolutions: Sequence[Revolution],
        axes_mps2: FloatArray,
        radial_mps2: FloatArray,
        orders_mps2: ComplexArray,
    ) -> Self:
        """Return revolutions whose waveforms are the rows of arrays."""
        arrays = cls(revolutions)
        arrays.axes_mps2, arrays.radial_mps2, arrays.orders_mps2 = axes_mps2, radial_mps2, orders_mps2
        return arrays

    def __len__(self) -> int:
        return len(self.revolutions)

    def part(self, rows: slice) -> Self:
        """Return some of the revolutions, without a copy."""
        if len(self.revolutions[rows]) == len(self):
            return self
        return self.of_rows(
            self.revolutions[rows], self.axes_mps2[rows], self.radial_mps2[rows], self.orders_mps2[rows]
        )

    @cached_property
    def axes_mps2(self) -> FloatArray:
        """(k, 3, n) as `Revolution.axes_mps2`."""
        return np.array([revolution.axes_mps2 for revolution in self.revolutions])

    @cached_property
    def radial_mps2(self) -> FloatArray:
        """(k, n) as `Revolution.radial_mps2`."""
        return np.array([revolution.radial_mps2 for revolution in self.revolutions])

    @cached_property
    def orders_mps2(self) -> ComplexArray:
        """(k, 61) as `Revolution.orders_mps2`."""
        return np.array([revolution.orders_mps2 for revolution in self.revolutions])

    @cached_property
    def means_mps2(self) -> FloatArray:
        """(k, 3) means of the axes; NaN for axes that are absent or not finite."""
        means: FloatArray = self.axes_mps2.mean(axis=2)
        return means

    @cached_property
    def in_plane_mps2(self) -> ComplexArray:
        """(k, 2, 61) Fourier sums of the circumferential and the radial axis times 2 / n; order 0 is twice the mean."""
        axes = self.axes_mps2
        spectra: ComplexArray = np.fft.rfft(axes[:, ::2], axis=2)[:, :, :ORDER_COUNT] * (2.0 / axes.shape[2])
        return spectra

    @cached_property
    def omega_radps(self) -> FloatArray:
        """(k,) mean angular speeds."""
        return np.array([revolution.omega_radps for revolution in self.revolutions])

    @cached_property
    def omega_dot_radps2(self) -> FloatArray:
        """(k,) angular accelerations."""
        return np.array([revolution.omega_dot_radps2 for revolution in self.revolutions])


class ConditionArrays(NamedTuple):
    """What of the conditions of k revolutions may differ from one to the next, (k,) each, as in `TireConditions`."""

    radius_m: FloatArray
    radius_std_m: FloatArray
    sensor_offset_m: FloatArray
    sensor_offset_std_m: FloatArray
    steady_std_mps2: FloatArray
    gain_std: FloatArray
    hub_mps2: FloatArray

    @classmethod
    def of(cls, conditions: Sequence[TireConditions]) -> Self:
        """Return the conditions as arrays."""
        return cls(*np.array(list(map(attrgetter(*cls._fields), conditions))).T)

    def rows(self, taken: slice) -> Self:
        """Return the conditions of some of the revolutions."""
        return type(self)(*(column[taken] for column in self))


@dataclass(frozen=True)
class RevolutionBlock:
    """Consecutive revolutions with the average and the conditions of each.

    Attributes:
        revolutions: in order.
        arrays: the same, stacked.
        averages: the running average after each.
        conditions: of each.
        shared: what the first of several estimators has computed for the others, by name.
    """

    revolutions: Sequence[Revolution]
    arrays: RevolutionArrays
    averages: AverageSteps
    conditions: Sequence[TireConditions]
    shared: dict[str, Any] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.revolutions)

    @cached_property
    def condition_arrays(self) -> ConditionArrays:
        """The conditions as arrays."""
        return ConditionArrays.of(self.conditions)


def one_revolution(revolution: Revolution, average: AngleAverage, conditions: TireConditions) -> RevolutionBlock:
    """Return a block of one revolution."""
    return RevolutionBlock([revolution], RevolutionArrays([revolution]), OneAverage(average), [conditions])


def extended(running: RunningAverage, revolution: Revolution) -> AngleAverage:
    """Return a running average after one more revolution; errors as those of `RunningAverage.update_block`."""
    return running.update_block(
        revolution.radial_mps2[np.newaxis],
        revolution.orders_mps2[np.newaxis],
        [revolution.omega_radps],
        edges_rad=[(revolution.leading_edge_rad, revolution.trailing_edge_rad)],
        edges_std_rad=[(revolution.leading_edge_std_rad, revolution.trailing_edge_std_rad)],
        noise_mps2=[revolution.noise_mps2],
    ).at(0)


class BlockEstimator(ABC):
    """An estimator that works on blocks; its `update` is a block of one.

    Attributes:
        name: in the registry.
    """

    name: str

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:  # noqa: B027 - nothing is forgotten where every revolution stands alone
        """Forget everything, as after a change of tire."""

    def update(self, revolution: Revolution, average: AngleAverage, conditions: TireConditions) -> tuple[Estimate, ...]:
        """Return this revolution's estimates; on bad data they are invalid with a reason, nothing is raised."""
        return self.update_block(one_revolution(revolution, average, conditions))[0]

    @abstractmethod
    def update_block(self, block: RevolutionBlock) -> list[tuple[Estimate, ...]]:
        """Return the estimates of every revolution, the same as those of single updates; nothing is raised."""


class RevolutionEstimator(BlockEstimator):
    """An estimator that takes the revolutions of a block one after the other."""

    def update_block(self, block: RevolutionBlock) -> list[tuple[Estimate, ...]]:
        """Return the estimates of every revolution, the same as those of single updates; nothing is raised."""
        return [self._estimates(block, index) for index in range(len(block))]

    @abstractmethod
    def _estimates(self, block: RevolutionBlock, index: int) -> tuple[Estimate, ...]:
        """Return the estimates of one revolution of a block."""
