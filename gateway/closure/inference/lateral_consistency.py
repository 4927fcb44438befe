"""Consistency of the belt stiffnesses that several lateral effects imply."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Final

import numpy as np
from scipy.stats import chi2

from gateway.closure.effects.lateral_loads import STIFFNESSES, LateralLoad
from gateway.closure.inference.fit import Fit
from gateway.closure.model.closure_model import AngleEffect
from gateway.reasons import Code, Reason
from gateway.types import FloatArray, IntArray

# Error of a stiffness, as a logarithm, by the error of an effect's equation.
_TOLERANCE: Final = 0.15
_RARE: Final = 1e-4
# Information of the data relative to the prior below which a direction is not tested.
_LEAST_INFORMATION: Final = 0.01


def another_belt(fit: Fit, effect: AngleEffect, earlier: Iterable[AngleEffect], scale: float) -> Reason | None:
    """Return why an effect cannot be of the same tire as an earlier one; None when it can.

    Args:
        fit: with all of them in.
        effect: the effect that is judged.
        earlier: those that it is judged beside; what bends no belt sideways is passed over.
        scale: overdispersion.
    """
    if not isinstance(effect, LateralLoad):
        return None
    covariance = scale * fit.covariance()
    own = _stiffnesses(fit, effect)
    for other in earlier:
        if not isinstance(other, LateralLoad) or other.name == effect.name:
            continue
        places = np.concatenate([_stiffnesses(fit, other), own])
        values, spread = fit.vector[places], covariance[np.ix_(places, places)]
        if not agree(values, spread):
            return Reason(Code.ANOTHER_BELT, effect=other.name)
        # Tightened where the model is off, as the errors are widened.
        belt, odds = common(values, spread, math.sqrt(scale) * fit.prior_std[own])
        if odds < _RARE:
            return Reason(Code.NO_COMMON_BELT, effect=other.name, stiffnesses=_stiffness_ratios(belt))
    return None


def _stiffnesses(fit: Fit, effect: AngleEffect) -> IntArray:
    where = fit.model.layout.effect(effect.name)
    return np.arange(where.stop - len(STIFFNESSES), where.stop)


def _stiffness_ratios(belt: FloatArray) -> tuple[Reason, ...]:
    """Return a belt's stiffnesses over a car tire's."""
    names = [parameter.name.removesuffix("_ln") for parameter in STIFFNESSES]
    return tuple(
        Reason(Code.STIFFNESS_RATIO, name=name, ratio=math.exp(value))
        for name, value in zip(names, belt.tolist(), strict=True)
    )


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


def common(values: FloatArray, covariance: FloatArray, prior_std: FloatArray) -> tuple[FloatArray, float]:
    """Return the one set that two estimates of it make, (k,), and how rare data are that pull so far from the prior.

    Each estimate was held near a car tire's belt by a prior of its own: two that pull alike look moderate and are not.

    Args:
        values: (2 k,) the one's logarithms, then the other's.
        covariance: (2 k, 2 k) of both, each with a prior about 0 in it.
        prior_std: (k,) of those priors, of which one is to be left.
    """
    count = len(prior_std)
    both = np.vstack([np.eye(count), np.eye(count)])
    precision = np.linalg.inv(covariance)
    together: FloatArray = both.T @ precision @ both - np.diag(prior_std**-2.0)
    pull: FloatArray = both.T @ precision @ values
    # In units of the prior the pull of data with information `known` is normal with variance known + known^2.
    by_prior = prior_std[:, np.newaxis] * (together - np.diag(prior_std**-2.0)) * prior_std
    known, turned = np.linalg.eigh(by_prior)
    informed = known > _LEAST_INFORMATION
    statistic = float(np.sum(np.square(turned.T @ (prior_std * pull))[informed] / (known + known * known)[informed]))
    odds = float(chi2.sf(statistic, informed.sum())) if informed.any() else 1.0
    belt: FloatArray = np.linalg.inv(together) @ pull
    return belt, odds
