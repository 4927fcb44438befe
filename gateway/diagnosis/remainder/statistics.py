"""Statistics of unexplained signals: growth of a size with speed, and levels that noise rarely exceeds."""

import math
from collections.abc import Sequence

import numpy as np

from gateway.diagnosis.result import Scaling, ScalingStatus


def held_scaling(speeds_mps: Sequence[float], values: Sequence[float], stds: Sequence[float]) -> tuple[float, float]:
    """Return the exponent of size against speed, and its standard error; NaN at one speed.

    Args:
        speeds_mps: of the groups.
        values: size in each group, positive.
        stds: standard error of each size.
    """
    if not speeds_mps:
        return float("nan"), float("nan")
    speed = np.log(speeds_mps)
    size = np.array(values)
    error = np.maximum(np.array(stds) / size, 0.02)
    weight = 1.0 / np.square(error)
    centred = speed - float(weight @ speed) / float(weight.sum())
    spread = float(weight @ np.square(centred))
    if np.ptp(speed) < 0.08 or spread <= 0.0:
        return float("nan"), float("nan")
    return float((weight * centred) @ np.log(size)) / spread, spread**-0.5


def scaling_of(exponent: float, unsure: float, *, several: bool) -> Scaling:
    """Return the growth with speed of an exponent and its standard error; NaN where only one speed shows it."""
    if not math.isfinite(exponent):
        return Scaling(ScalingStatus.SEEN_AT_ONE_SPEED if several else ScalingStatus.ONE_SPEED)
    if unsure > 0.5:
        return Scaling(ScalingStatus.UNCERTAIN, exponent, unsure)
    for integer in (0.0, 1.0, 2.0):
        if abs(exponent - integer) < 0.3 + unsure:
            return Scaling(ScalingStatus.KNOWN, integer)
    return Scaling(ScalingStatus.KNOWN, exponent)


def rare_ratio(freedom: float, quantile: float) -> float:
    """Return the level that a mean of exponential values exceeds as rarely as a normal value exceeds `quantile`.

    The mean is over `freedom` values of mean 1.
    """
    spread = 1.0 / (9.0 * freedom)
    return float((1.0 - spread + quantile * spread**0.5) ** 3)
