"""What a candidate must pass before it is called by its name."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from scipy.stats import chi2

from gateway.closure.effects.base import CIRCUMFERENTIAL, RADIAL, SignalEffect
from gateway.closure.fit import Fit
from gateway.closure.likelihood import Whitened, as_real
from gateway.closure.model import AngleEffect
from gateway.constants import AXIS_NAMES
from gateway.types import ComplexArray, FloatArray

Part = tuple[int, slice]
"""A group, and axes of it."""


# Fall of the misfit from which something is no chance find among some hundred trials (a chi-square of one degree
# exceeds 25 once in two million), and what every further parameter adds.
LEAST_EVIDENCE: Final = 25.0
PER_PARAMETER: Final = 3.0
# How far an effect's size may differ from group to group beyond its errors: its equation is a model as well.
_TOLERANCE: Final = 0.15
_RARE: Final = 1e-4
# Errors beyond a plausible range that are forgiven.
_BEYOND: Final = 2.0
# What is left where the effect acts, as a share of what it explains, from which it is a stand-in for something else.
_LEFT_SHARE: Final = 0.25
# An axis with less than this share of an effect's evidence on its main one does not judge it.
_MAIN_AXIS: Final = 0.3
# On the whole of its axes as much may be left as it explains: that counts as the share above where it acts.
_HALF_SHARE: Final = 0.25
# Share of an effect's evidence that the orders hold in which it is judged.
_WHERE: Final = 0.9


def overdispersion(fit: Fit, data: Whitened) -> float:
    """Return the misfit over its degrees of freedom, at least 1: by how much evidence is overstated."""
    return max(1.0, fit.misfit / max(1, data.used - fit.model.layout.size))


def evidence_needed(effect: AngleEffect) -> float:
    """Return the least fall of the misfit."""
    return LEAST_EVIDENCE + PER_PARAMETER * (len(effect.parameters) - 1)


def implausible(fit: Fit, effect: AngleEffect, scale: float, *, for_now: bool = False) -> str:
    """Return which parameter lies outside its plausible range, in words; empty when none does.

    Args:
        fit: with the effect in.
        effect: the effect.
        scale: overdispersion.
        for_now: True forgives as much again as the range is wide: other effects may still be missing.
    """
    where = fit.model.layout.effect(effect.name)
    std = np.sqrt(np.diagonal(fit.covariance()))[where] * math.sqrt(scale)
    for parameter, value, error in zip(effect.parameters, fit.vector[where], std, strict=True):
        slack = _BEYOND * float(error) + (parameter.high - parameter.low if for_now else 0.0)
        if not parameter.low - slack <= value <= parameter.high + slack:
            unit = parameter.display_unit or parameter.unit
            low, high = parameter.low * parameter.factor, parameter.high * parameter.factor
            return (
                f"{parameter.name} would be {value * parameter.factor:.3g} {unit}".rstrip()
                + f", which is not plausible ({low:.3g} to {high:.3g})"
            )
    return effect.reason_against(fit.vector[where], std)


def uneven(fit: Fit, effect: AngleEffect, scale: float) -> str:
    """Return how an effect fails to be the same in every group, in words; empty when it is."""
    groups = [(group.label, [(index, slice(None))]) for index, group in enumerate(fit.model.campaign.groups)]
    found = _odd_one(fit, effect, scale, groups)
    return f"it would have to be of another size in other recordings (most so in {found})" if found else ""


def lopsided(fit: Fit, effect: AngleEffect, scale: float) -> str:
    """Return how an effect fails to be the same on all of its axes, in words; empty when it is.

    To be asked at the end: what the model lacks elsewhere bends one axis more than another.
    """
    groups = range(len(fit.model.campaign.groups))
    # Others feel it only through what further effects make of it, and so answer to those.
    own = effect.axes if isinstance(effect, SignalEffect) else (CIRCUMFERENTIAL, RADIAL)
    axes = [(f"the {AXIS_NAMES[axis]} axis", [(index, slice(axis, axis + 1)) for index in groups]) for axis in own]
    found = _odd_one(fit, effect, scale, axes)
    return f"it would have to be of another size on other axes (most so on {found})" if found else ""


def _odd_one(fit: Fit, effect: AngleEffect, scale: float, parts: Sequence[tuple[str, list[Part]]]) -> str:
    """Return the part of the data that wants the effect most unlike the others, where they are not alike; else ""."""
    if len(parts) < 2:
        return ""
    where = fit.model.layout.effect(effect.name)
    size, own = fit.model.layout.size, where.stop - where.start
    total = size + own * (len(parts) - 1)
    matrix, gradient = np.zeros((total, total)), np.zeros(total)
    for number, (_, pieces) in enumerate(parts):
        for index, axes in pieces:
            rows = fit.rows[index]
            places = rows.places.copy()
            if number:
                inside = (places >= where.start) & (places < where.stop)
                places[inside] += size - where.start + own * (number - 1)
            flat = as_real(rows.rows[:, :, axes].swapaxes(0, 1))
            flat = flat.reshape(len(flat), -1)
            matrix[np.ix_(places, places)] += flat @ flat.T
            gradient[places] += flat @ as_real(rows.residual[:, axes]).reshape(-1)
    prior = np.concatenate([fit.prior_std, np.tile(fit.prior_std[where], len(parts) - 1)])
    mean = np.concatenate([fit.vector - fit.prior_mean, np.tile((fit.vector - fit.prior_mean)[where], len(parts) - 1)])
    try:
        covariance = np.linalg.inv(matrix + np.diag(prior**-2.0))
    except np.linalg.LinAlgError:
        return ""
    change = covariance @ (gradient - mean * prior**-2.0)
    each = np.concatenate([np.arange(where.start, where.stop), np.arange(size, total)])
    values = change[each].reshape(len(parts), own)
    spread = scale * covariance[np.ix_(each, each)]
    own_size = np.array([parameter.prior_std if parameter.varies else 0.0 for parameter in effect.parameters])
    tolerance = np.maximum(own_size, _TOLERANCE * _sizes(fit.vector[where], effect))
    spread = spread + np.diag(np.tile(np.square(tolerance), len(parts)))
    return _verdict(values, spread, [label for label, _ in parts])


def _sizes(values: FloatArray, effect: AngleEffect) -> FloatArray:
    """Return the size of each parameter: of all of its unit together, since cosine and sine turn into each other."""
    units = [parameter.unit for parameter in effect.parameters]
    return np.array(
        [math.hypot(*(v for v, u in zip(values.tolist(), units, strict=True) if u == unit)) for unit in units]
    )


def _verdict(values: FloatArray, spread: FloatArray, labels: list[str]) -> str:
    """Return the part with the most unlike parameters (G, p), given their joint covariance; "" where all are one."""
    count, own = values.shape
    contrast = np.kron(np.eye(count)[1:] - np.eye(count)[0], np.eye(own))
    difference = contrast @ values.reshape(-1)
    statistic = float(difference @ np.linalg.solve(contrast @ spread @ contrast.T, difference))
    if chi2.sf(statistic, len(difference)) >= _RARE:
        return ""
    std = np.sqrt(np.diagonal(spread)).reshape(count, own)
    worst = int(np.argmax(np.max(np.abs(values) / std, axis=1)))
    return labels[worst]


def useless(effect: AngleEffect, fall: float, gain: FloatArray, scale: float) -> str:
    """Return that an effect is not needed beside the others, in words; empty when it is.

    Args:
        effect: the effect.
        fall: of the misfit that it brings.
        gain: (K,) fall of each fold's held-out misfit.
        scale: overdispersion.
    """
    if fall < evidence_needed(effect) * scale:
        return "beside the others it is too small to be told from nothing"
    return "" if float(gain.sum()) > spread(gain) else "without it data held out are predicted as well"


def spread(gain: FloatArray) -> float:
    """Return the standard error of a sum over folds (K,); folds with 0 are not seen."""
    seen = gain[gain != 0.0]
    return float(np.std(seen, ddof=1)) * math.sqrt(len(seen)) if len(seen) > 1 else 0.0


def explained_and_left(fit: Fit, without: Sequence[ComplexArray], data: Whitened) -> tuple[float, float]:
    """Return the misfit an effect explains in the orders where it acts, and the misfit beyond noise left there.

    Args:
        fit: with the effect in.
        without: (blocks, 3, ORDERS) a group, predicted without it.
        data: whitened.
    """
    gained = np.zeros((3, data.weights[0].shape[2]))
    left = np.zeros_like(gained)
    expected = np.zeros_like(gained)
    for index, weight in enumerate(data.weights):
        orders = data.orders[index]
        # All blocks together: what repeats adds up, what is noise does not.
        share = np.square(weight)
        total = np.sqrt(share.sum(axis=0))
        mean_left = np.abs((share * (orders - fit.predicted[index])).sum(axis=0)) ** 2
        mean_before = np.abs((share * (orders - without[index])).sum(axis=0)) ** 2
        used = total > 0.0
        scale = np.where(used, 1.0 / np.where(used, total, 1.0) ** 2, 0.0)
        left += mean_left * scale
        gained += (mean_before - mean_left) * scale
        expected += 2.0 * used
    ranked = np.argsort(-gained, axis=None)
    flat = np.maximum(gained.reshape(-1)[ranked], 0.0)
    if not flat.sum() > 0.0:
        return 0.0, 0.0
    inside = ranked[: int(np.searchsorted(np.cumsum(flat), _WHERE * flat.sum())) + 1]
    beyond = (left - expected).reshape(-1)[inside].sum()
    # Also on the whole of its axes: what explains the smaller part of what stands out there is not what is wrong.
    power = gained.sum(axis=1)
    acts = power > _MAIN_AXIS * power.max()
    on_axes = max(0.0, float((left - expected)[acts].sum())) / max(float(gained[acts].sum()), 1e-300)
    explained = float(gained.reshape(-1)[inside].sum())
    return explained, max(0.0, float(beyond), _HALF_SHARE * on_axes * explained)


def of_known_size(effect: AngleEffect) -> bool:
    """Return whether physics says how large an effect is, so that it cannot stretch itself to stand in for another."""
    return all(parameter.known for parameter in effect.parameters)


def stands_in(effect: AngleEffect, explained: float, left: float) -> str:
    """Return why an effect is a stand-in for something else, in words; empty when it is not."""
    if of_known_size(effect):
        return ""
    if left <= _LEFT_SHARE * explained or left <= LEAST_EVIDENCE:
        return ""
    return f"it leaves {left / (left + explained):.0%} of what stands out where it acts: a stand-in for something else"
