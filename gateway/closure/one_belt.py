"""A tire has one belt: what several lateral effects say of its stiffnesses must be one set, and a plausible one."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from gateway.closure.effects.lateral_load import STIFFNESSES, LateralLoad
from gateway.closure.fit import Fit
from gateway.closure.model import AngleEffect

FloatArray = NDArray[np.float64]

# What an effect's equation leaves may look like a stiffness as far off as this.
_TOLERANCE: Final = 0.15
_RARE: Final = 1e-4
# Errors beyond a plausible range that are forgiven.
_BEYOND: Final = 2.0


def another_belt(fit: Fit, effect: AngleEffect, earlier: Iterable[AngleEffect], scale: float) -> str:
    """Return why an effect cannot be of the same tire as an earlier one, in words; empty when it can.

    Args:
        fit: with all of them in.
        effect: the effect that is judged.
        earlier: those that it is judged beside; what bends no belt sideways is passed over.
        scale: overdispersion.
    """
    if not isinstance(effect, LateralLoad):
        return ""
    covariance = scale * fit.covariance()
    own = _stiffnesses(fit, effect)
    for other in earlier:
        if not isinstance(other, LateralLoad) or other.name == effect.name:
            continue
        places = np.concatenate([_stiffnesses(fit, other), own])
        values, spread = fit.vector[places], covariance[np.ix_(places, places)]
        if not agree(values, spread):
            return f"it would need another belt than {other.name}"
        # Each set was held near a car tire's by a prior of its own, tightened where the model is off; one belt has one.
        prior_std = math.sqrt(scale) * fit.prior_std[own]
        if reason := implausible_belt(*common(values, spread, prior_std)):
            return f"it would need another belt than {other.name}: one for both would have {reason}"
    return ""


def _stiffnesses(fit: Fit, effect: AngleEffect) -> NDArray[np.intp]:
    where = fit.model.layout.effect(effect.name)
    return np.arange(where.stop - len(STIFFNESSES), where.stop)


def agree(values: FloatArray, covariance: FloatArray) -> bool:
    """Return whether two sets of stiffnesses are one, within their errors and what equations are good to.

    Args:
        values: (2 k,) the one's logarithms, then the other's.
        covariance: (2 k, 2 k) of both.
    """
    count = len(values) // 2
    contrast = np.hstack([np.eye(count), -np.eye(count)])
    difference = contrast @ values
    spread = contrast @ (covariance + _TOLERANCE**2 * np.eye(2 * count)) @ contrast.T
    return float(chi2.sf(difference @ np.linalg.solve(spread, difference), count)) >= _RARE


def implausible_belt(belt: FloatArray, std: FloatArray) -> str:
    """Return which stiffness of a belt is not plausible, in words; empty when all are.

    Args:
        belt: (3,) logarithms.
        std: (3,) their standard errors.
    """
    for parameter, value, error in zip(STIFFNESSES, belt.tolist(), std.tolist(), strict=True):
        if not parameter.low - _BEYOND * error <= value <= parameter.high + _BEYOND * error:
            plausible = f"({parameter.low:.3g} to {parameter.high:.3g})"
            return f"{parameter.name} of {value:.2g}, which is not plausible {plausible}"
    return ""


def common(values: FloatArray, covariance: FloatArray, prior_std: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the one set that two estimates of it make, (k,), and its standard errors.

    Args:
        values: (2 k,) the one's, then the other's.
        covariance: (2 k, 2 k) of both, each with a prior about 0 in it.
        prior_std: (k,) of those priors, of which one is to be left.
    """
    count = len(prior_std)
    both = np.vstack([np.eye(count), np.eye(count)])
    precision = np.linalg.inv(covariance)
    together = np.linalg.inv(both.T @ precision @ both - np.diag(prior_std**-2.0))
    std = np.sqrt(np.diagonal(together))
    return together @ (both.T @ precision @ values), std
