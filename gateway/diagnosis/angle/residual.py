"""Residual of the angle-locked signal: what a fit leaves of each group's mean waveform, over noise and signal."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from gateway.core.types import ComplexArray, FloatArray
from gateway.diagnosis.angle.fit import Fit
from gateway.diagnosis.angle.likelihood import Whitened
from gateway.diagnosis.bayes.posterior import ByPart
from gateway.diagnosis.effects.angle_orders import ORDERS
from gateway.diagnosis.effects.effect import CIRCUMFERENTIAL, LATERAL, RADIAL

POWER_SHARE: Final = np.where(np.arange(ORDERS) == 0, 1.0, 0.5)
"""Mean square of a waveform by the squares of its orders' coefficients, (ORDERS,)."""
PLANE: Final = [CIRCUMFERENTIAL, RADIAL]
"""Axes of the wheel's plane, on which the ring's numbers rest."""
PARTS: Final = (PLANE, [LATERAL])
"""Axes whose evidence counts alike: one ring moves both of the wheel's plane, the lateral one has its own model."""


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

    def excess(self) -> FloatArray:
        """Return the mean square beyond noise of each order, (3, ORDERS)."""
        square = np.abs(self.orders_mps2) ** 2
        result: FloatArray = POWER_SHARE * square - self.variance
        return result

    def rms_mps2(self, first: int = 0, last: int = ORDERS) -> FloatArray:
        """Return the rms of the residual beyond noise over orders [first, last), (3,)."""
        result: FloatArray = np.sqrt(np.maximum(self.excess()[:, first:last].sum(axis=1), 0.0))
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
