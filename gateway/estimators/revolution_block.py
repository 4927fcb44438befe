"""Consecutive revolutions as stacked arrays, computed once for all estimators."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, Protocol, Self, runtime_checkable

import numpy as np
from scipy.fft import rfft  # several transforms at once, in half the time of numpy's

from gateway.estimators.estimator import AngleAverage, Estimate, Revolution, TireConditions
from gateway.signal.order_spectrum import ORDER_COUNT
from gateway.signal.synchronous_average import AverageSteps, OneAverage
from gateway.types import ComplexArray, FloatArray


class RevolutionArrays:
    """Axes of k revolutions and what is common to several estimators of them."""

    def __init__(self, revolutions: Sequence[Revolution]) -> None:
        self._revolutions = revolutions

    @cached_property
    def axes_mps2(self) -> FloatArray:
        """(k, 3, n) as `Revolution.axes_mps2`."""
        if len(self._revolutions) == 1:
            return self._revolutions[0].axes_mps2[np.newaxis]
        return np.stack([revolution.axes_mps2 for revolution in self._revolutions])

    @cached_property
    def means_mps2(self) -> FloatArray:
        """(k, 3) means of the axes; NaN for axes that are absent or not finite."""
        means: FloatArray = self.axes_mps2.mean(axis=2)
        return means

    @cached_property
    def in_plane_mps2(self) -> ComplexArray:
        """(k, 2, 61) Fourier sums of the circumferential and the radial axis times 2 / n; order 0 is twice the mean."""
        axes = self.axes_mps2
        spectra: ComplexArray = rfft(axes[:, ::2], axis=2)[:, :, :ORDER_COUNT] * (2.0 / axes.shape[2])
        return spectra

    @cached_property
    def omega_radps(self) -> FloatArray:
        """(k,) mean angular speeds."""
        return np.array([revolution.omega_radps for revolution in self._revolutions])

    @cached_property
    def omega_dot_radps2(self) -> FloatArray:
        """(k,) angular accelerations."""
        return np.array([revolution.omega_dot_radps2 for revolution in self._revolutions])


class ConditionArrays(NamedTuple):
    """What of the conditions of k revolutions may differ from one to the next, (k,) each, as in `TireConditions`."""

    radius_m: FloatArray
    radius_std_m: FloatArray
    sensor_offset_m: FloatArray
    sensor_offset_std_m: FloatArray
    steady_std_mps2: FloatArray
    gain_std: FloatArray

    @classmethod
    def of(cls, conditions: Sequence[TireConditions]) -> Self:
        """Return the conditions as arrays."""
        rows = [
            (at.radius_m, at.radius_std_m, at.sensor_offset_m, at.sensor_offset_std_m, at.steady_std_mps2, at.gain_std)
            for at in conditions
        ]
        return cls(*np.array(rows).T)

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
    """

    revolutions: Sequence[Revolution]
    arrays: RevolutionArrays
    averages: AverageSteps
    conditions: Sequence[TireConditions]

    def __len__(self) -> int:
        return len(self.revolutions)

    @cached_property
    def condition_arrays(self) -> ConditionArrays:
        """The conditions as arrays."""
        return ConditionArrays.of(self.conditions)


def one_revolution(revolution: Revolution, average: AngleAverage, conditions: TireConditions) -> RevolutionBlock:
    """Return a block of one revolution."""
    return RevolutionBlock([revolution], RevolutionArrays([revolution]), OneAverage(average), [conditions])


@runtime_checkable
class BlockEstimator(Protocol):
    """An estimator that works on blocks; its `update` is a block of one."""

    def update_block(self, block: RevolutionBlock) -> list[tuple[Estimate, ...]]:
        """Return the estimates of every revolution, the same as those of single updates; nothing is raised."""
        ...
