"""Recordings that hold the same revolutions: their means differ by less than the noise of independent ones."""

from collections.abc import Sequence
from itertools import combinations
from typing import Final

import numpy as np

from gateway.core.types import ComplexArray, FloatArray
from gateway.diagnosis.data.campaign_data import Group
from gateway.diagnosis.data.condition_groups import SPEED_WIDTH

# Mean square of the difference over its expectation from which two means are of other revolutions. Those of a copy
# differ by rounding; of one that lacks a tenth of the revolutions by 0.05.
_MAX_NOISE_RATIO: Final = 0.05
_LEAST_COEFFICIENTS: Final = 100


def repeated_recordings(groups: Sequence[Group]) -> dict[int, int]:
    """Return the recordings whose revolutions an earlier one has too, by index, with that one.

    Args:
        groups: of all recordings of one wheel.
    """
    repeats: dict[int, int] = {}
    means = [_mean(group) for group in groups]
    for earlier, later in combinations(range(len(groups)), 2):
        first, second = groups[earlier], groups[later]
        if first.recording == second.recording or max(first.recording, second.recording) in repeats:
            continue
        if abs(np.log(first.conditions.omega_radps / second.conditions.omega_radps)) > SPEED_WIDTH:
            continue
        if _share_noise(means[earlier], means[later]):
            repeats[max(first.recording, second.recording)] = min(first.recording, second.recording)
    return repeats


def _mean(group: Group) -> tuple[ComplexArray, FloatArray]:
    """Return the mean of all revolutions and the variance of a coefficient of it, (3, ORDERS) each."""
    count = group.counts
    orders = np.stack([block.orders_mps2 for block in group.blocks])
    mean: ComplexArray = np.tensordot(count, orders, axes=1) / count.sum()
    return mean, group.variance / count.sum()


def _share_noise(first: tuple[ComplexArray, FloatArray], second: tuple[ComplexArray, FloatArray]) -> bool:
    expected = first[1] + second[1]
    comparable = np.isfinite(expected) & np.isfinite(first[0]) & np.isfinite(second[0]) & (expected > 0.0)
    if np.count_nonzero(comparable) < _LEAST_COEFFICIENTS:
        return False
    # Of two real coefficients each.
    ratio = np.square(np.abs(first[0] - second[0])[comparable]) / (2.0 * expected[comparable])
    return float(ratio.mean()) < _MAX_NOISE_RATIO
