"""Drift of the steady radial value over many recordings, parted into that of the gain and that of the zero.

mean(s) = G R Omega^2 + z. At one speed a recording gives the ratio G + z R / V^2 alone. Recordings at several speeds
part the two: r = G0 + G1 c + (z0 + z1 c) R / V^2, with the course c of the change: the time, or a step.
"""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from gateway.core.types import FloatArray
from gateway.fleet.trends.outlier_detection import find_outliers
from gateway.fleet.trends.regression import Fit

# Probability that a gain looks like a zero or a zero like a gain; errors within which a change is not needed.
_CHANCE: Final = 0.01
_NO_CHANGE: Final = 2.0


class SteadyDrift(NamedTuple):
    """Changes of gain (a share) and zero over all recordings, with standard errors; 0 for what is not needed.

    `begin` is the number of the step at which they change at once; None where they drift.
    """

    gain: float
    gain_std: float
    zero_mps2: float
    zero_std_mps2: float
    freedom: int
    begin: int | None = None


def parted_drift(
    months: FloatArray, ratio: FloatArray, radius_m: FloatArray, speed_mps: FloatArray, steps: Sequence[int] = ()
) -> SteadyDrift | None:
    """Return the drifts of gain and zero; None where the recordings do not determine both.

    Args:
        months: (n,) times of the recordings.
        ratio: (n,) steady radial value over V^2 / R, NaN where unknown.
        radius_m: (n,) of the belt.
        speed_mps: (n,) mean speed V.
        steps: indices of recordings at one of which both may change at once.
    """
    from scipy import stats

    with np.errstate(divide="ignore", invalid="ignore"):
        lever = radius_m / speed_mps**2
    usable = np.isfinite(ratio) & np.isfinite(lever) & np.isfinite(months)
    if not usable.any():
        return None
    time, lever, values = months[usable], lever[usable], ratio[usable]
    span = float(np.ptp(time))
    ramp = (time - time.mean()) / span if span > 0.0 else time
    courses = [ramp, *((np.flatnonzero(usable) >= step).astype(np.float64) for step in steps)]

    def fit_of(course: FloatArray, *changes: FloatArray) -> Fit | None:
        design = np.column_stack([np.ones(len(time)), lever, *(course * change for change in changes)])
        return find_outliers(design, values, np.ones(len(time)), family=1).fit

    ones = np.ones(len(time))
    fits = [(course, fit) for course in courses if (fit := fit_of(course, ones, lever)) is not None]
    if not fits:
        return None
    course, fit = min(fits, key=lambda item: float(np.median(np.abs(item[1].residuals))))
    step_number = next((number for number, step in enumerate(courses[1:]) if step is course), None)
    # Where one is needed beside the other, and the other is not, it explains the change alone.
    sizes, errors = np.abs(fit.coefficients[2:]), np.array([fit.std(2), fit.std(3)])
    is_alone = (sizes > stats.t.ppf(1.0 - 0.5 * _CHANCE, fit.freedom) * errors) & (sizes < _NO_CHANGE * errors)[::-1]
    single_fit = fit_of(course, ones if is_alone[0] else lever) if is_alone.any() else None
    if single_fit is None:
        sizes = fit.coefficients[2:]
        return SteadyDrift(float(sizes[0]), fit.std(2), float(sizes[1]), fit.std(3), fit.freedom, step_number)
    only, nothing = (float(single_fit.coefficients[2]), single_fit.std(2)), (0.0, 0.0)
    return SteadyDrift(*(only + nothing if is_alone[0] else nothing + only), single_fit.freedom, step_number)


def zero_of(ratio: float, radius_m: FloatArray, speed_mps: FloatArray) -> float:
    """Return the zero in m/s^2 that has the effect of a gain at the usual speed of the recordings."""
    squares = speed_mps**2 / radius_m
    return ratio * float(np.nanmedian(squares)) if np.isfinite(squares).any() else math.nan
