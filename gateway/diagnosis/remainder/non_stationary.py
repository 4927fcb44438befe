"""Non-stationary residual: changes of the mean residual from block to block of a recording."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.special import fdtrc

from gateway.core.constants import AXIS_NAMES
from gateway.core.types import ComplexArray, FloatArray
from gateway.diagnosis import criteria
from gateway.diagnosis.angle.fit import Fit
from gateway.diagnosis.angle.likelihood import Whitened
from gateway.diagnosis.angle.residual import POWER_SHARE
from gateway.diagnosis.data.campaign_data import Group
from gateway.diagnosis.remainder.unexplained_orders import BANDS, core_orders, joined
from gateway.diagnosis.result import Scaling, ScalingStatus, Unexplained

SCALING: Final = Scaling(ScalingStatus.NON_STATIONARY)

# Degrees of freedom to which the scatter is known, and least revolutions of a block.
_FREEDOM: Final = 48
_LEAST_REVOLUTIONS: Final = 3


@dataclass(frozen=True, slots=True)
class _Change:
    """Change of the residual of one group.

    Attributes:
        power: (3, ORDERS) mean square deviation of the blocks from the group's mean, scatter included.
        scatter: (3, ORDERS) contribution of scatter to `power`.
        variance: (3, ORDERS) variance of `power` due to scatter.
        mean: (3, ORDERS) mean square of the group's mean residual.
        signal: (3, ORDERS) mean square of the signal.
        blocks: number of blocks compared.
    """

    power: FloatArray
    scatter: FloatArray
    variance: FloatArray
    mean: FloatArray
    signal: FloatArray
    blocks: int

    def size(self, axis: int, orders: slice) -> tuple[float, float]:
        """Return the rms beyond scatter and its standard error."""
        excess = float((self.power - self.scatter)[axis, orders].sum())
        if not excess > 0.0:
            return 0.0, 0.0
        rms = math.sqrt(excess)
        return rms, 0.5 * math.sqrt(float(self.variance[axis, orders].sum())) / rms

    def evident(self, axis: int, first: int, last: int) -> bool:
        """Return whether orders [first, last) change by far more than scatter explains."""
        orders = slice(first, last)
        rms, std = self.size(axis, orders)
        mean, signal = (math.sqrt(float(power[axis, orders].sum())) for power in (self.mean, self.signal))
        scatter = float(self.scatter[axis, orders].sum())
        ratio = float(self.power[axis, orders].sum()) / scatter if scatter > 0.0 else 0.0
        freedom = (self.blocks - 1) * (2 * (last - first) - (first == 0))
        is_rare = ratio > criteria.OVER_SCATTER and float(fdtrc(freedom, _FREEDOM, ratio)) < criteria.RARE_CHANGE
        return is_rare and rms > max(
            criteria.SIGMAS_LISTED * std, criteria.CHANGE_OF_RESIDUAL * mean, criteria.CHANGE_OF_SIGNAL * signal
        )


def changing(fit: Fit, data: Whitened) -> tuple[Unexplained, ...]:
    """Return the residuals that change during a recording by more than the model predicts, largest first."""
    campaign = fit.model.campaign
    predicted = fit.model.predict(fit.vector)
    changes = [
        _change(*arguments) for arguments in zip(campaign.groups, data.orders, data.weights, predicted, strict=True)
    ]
    entries = []
    for axis in range(3):
        measured = [change for change in changes if change is not None]
        bands = [band for band in itertools.pairwise(BANDS) if any(change.evident(axis, *band) for change in measured)]
        if bands:
            entries.append(_entry(campaign.groups, changes, axis, joined(bands)))
    largest = max((entry.rms_mps2 for entry in entries), default=0.0)
    entries.sort(key=lambda entry: -entry.rms_mps2)
    return tuple(entry for entry in entries if entry.rms_mps2 > criteria.CHANGE_OF_LARGEST * largest)


def beside_changes(unexplained: Sequence[Unexplained], changes: Sequence[Unexplained]) -> tuple[Unexplained, ...]:
    """Return the residuals without those at wheel orders of an axis that is already listed as non-stationary."""
    axes = {entry.axis for entry in changes}
    return tuple(entry for entry in unexplained if entry.lock_known or entry.axis not in axes)


def _change(group: Group, orders: ComplexArray, weights: FloatArray, predicted: ComplexArray) -> _Change | None:
    """Compare the blocks of one group; None for a single block or for blocks of too few revolutions."""
    counts = group.counts
    if len(counts) < 2 or counts.min() < _LEAST_REVOLUTIONS:
        return None
    weight = (counts / counts.sum())[:, None, None]
    # A residual proportional to the square of the speed, as most model errors are, is no change.
    squares = np.array([block.conditions.omega_radps**2 for block in group.blocks])
    scale = (squares / group.conditions.omega_radps**2)[:, None, None]
    present = (weights > 0.0).all(axis=0)
    residual = np.where(present, orders - predicted, 0.0)
    mean = (weight * scale * residual).sum(axis=0) / (weight * np.square(scale)).sum(axis=0)
    square_deviation = np.abs(residual - scale * mean) ** 2
    # Variance of one real coefficient of a block's mean. An order has two, which POWER_SHARE halves.
    noise = np.where(present, group.variance, 0.0) / counts[:, None, None]
    freedom_share = (len(counts) - 1) / len(counts)
    return _Change(
        power=POWER_SHARE * (weight * square_deviation).sum(axis=0),
        scatter=freedom_share * (weight * noise).sum(axis=0),
        variance=4.0 * (np.square(weight * POWER_SHARE) * square_deviation * noise).sum(axis=0),
        mean=POWER_SHARE * np.abs(mean) ** 2,
        signal=POWER_SHARE * np.square(np.where(present, np.abs(orders).mean(axis=0), 0.0)),
        blocks=len(counts),
    )


def _entry(
    groups: Sequence[Group], changes: Sequence[_Change | None], axis: int, bands: Sequence[tuple[int, int]]
) -> Unexplained:
    """Return one entry of an axis, with the size of the group where it is largest."""
    low, high = bands[0][0], bands[-1][1]
    orders = slice(low, high)
    sizes = [(0.0, 0.0) if group_change is None else group_change.size(axis, orders) for group_change in changes]
    largest = max(range(len(sizes)), key=lambda index: sizes[index][0])
    rms, std = sizes[largest]
    first, last = low, high - 1
    if (change := changes[largest]) is not None:
        power = np.maximum((change.power - change.scatter)[axis, orders], 0.0)
        first, last = core_orders(power, low)
    omegas = [group.conditions.omega_radps / (2.0 * math.pi) for group in groups]
    return Unexplained(
        AXIS_NAMES[axis],
        "angle",
        (first, last),
        (first * min(omegas), last * max(omegas)),
        None,
        SCALING,
        rms,
        std,
        changes=True,
        largest_in=groups[largest].label,
    )
