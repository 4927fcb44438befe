"""Drift of the steady radial value over many recordings, parted into that of the gain and that of the zero.

mean(s) = G R Omega^2 + z. At one speed a recording gives the ratio G + z R / V^2 alone. Recordings at several speeds
part the two: r = G0 + G1 t + (z0 + z1 t) R / V^2.
"""

import math
from typing import NamedTuple

import numpy as np

from gateway.core.types import FloatArray
from gateway.fleet.trends.outlier_detection import find_outliers


class SteadyDrift(NamedTuple):
    """Changes from the first recording to the last, each with its standard error.

    Attributes:
        gain: of the gain, as a share.
        gain_std: of it.
        zero_mps2: of the zero.
        zero_std_mps2: of it.
        freedom: degrees of freedom of the errors.
    """

    gain: float
    gain_std: float
    zero_mps2: float
    zero_std_mps2: float
    freedom: int


def parted_drift(
    months: FloatArray, ratio: FloatArray, radius_m: FloatArray, speed_mps: FloatArray
) -> SteadyDrift | None:
    """Return the drifts of gain and zero; None where the recordings do not determine both.

    Args:
        months: (n,) times of the recordings.
        ratio: (n,) steady radial value over V^2 / R, NaN where unknown.
        radius_m: (n,) of the belt.
        speed_mps: (n,) mean speed V.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        lever = radius_m / speed_mps**2
    usable = np.isfinite(ratio) & np.isfinite(lever) & np.isfinite(months)
    if not usable.any():
        return None
    time, lever, values = months[usable], lever[usable], ratio[usable]
    span = float(np.ptp(time))
    share = (time - time.mean()) / span if span > 0.0 else time
    design = np.column_stack([np.ones(len(time)), share, lever, lever * share])
    fit = find_outliers(design, values, np.ones(len(time)), family=1).fit
    if fit is None:
        return None
    return SteadyDrift(float(fit.coefficients[1]), fit.std(1), float(fit.coefficients[3]), fit.std(3), fit.freedom)


def zero_of(ratio: float, radius_m: FloatArray, speed_mps: FloatArray) -> float:
    """Return the zero in m/s^2 that has the effect of a gain at the usual speed of the recordings."""
    squares = speed_mps**2 / radius_m
    return ratio * float(np.nanmedian(squares)) if np.isfinite(squares).any() else math.nan
