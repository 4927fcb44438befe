"""Acceptance tests that a candidate effect must pass to be identified."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from scipy.stats import chi2

from gateway.closure.effects.effect import CIRCUMFERENTIAL, RADIAL, Parameter, SignalEffect
from gateway.closure.inference.fit import Fit
from gateway.closure.inference.likelihood import Whitened, as_real
from gateway.closure.model.closure_model import AngleEffect
from gateway.constants import AXIS_NAMES
from gateway.reasons import Code, Reason
from gateway.types import ComplexArray, FloatArray

Part = tuple[int, slice]
"""A group, and axes of it."""


# Reduction of the misfit that is no chance result among some hundred trials (a chi-square of one degree exceeds 25 once
# in two million), and the addition for each further parameter.
LEAST_EVIDENCE: Final = 25.0
PER_PARAMETER: Final = 3.0
# Relative difference of an effect's size between groups that is tolerated beyond its errors: its equation is a model.
_TOLERANCE: Final = 0.15
_RARE: Final = 1e-4
# Standard errors beyond a plausible range that are tolerated.
_BEYOND: Final = 2.0
# Residual where the effect acts, relative to what it explains, above which it stands in for another cause.
_LEFT_SHARE: Final = 0.25
# An axis with less than this share of the evidence on the main axis is not tested.
_MAIN_AXIS: Final = 0.3
# Weight of the residual on the whole of its axes, where as much may remain as it explains.
_HALF_SHARE: Final = 0.25
# Share of an effect's evidence that the orders hold in which it is judged.
_WHERE: Final = 0.9


def overdispersion(fit: Fit, data: Whitened) -> float:
    """Return the misfit per degree of freedom, at least 1: the factor by which evidence is overstated."""
    return max(1.0, fit.misfit / max(1, data.used - fit.model.layout.size))


def evidence_needed(effect: AngleEffect) -> float:
    """Return the smallest sufficient decrease of the misfit."""
    return LEAST_EVIDENCE + PER_PARAMETER * (len(effect.parameters) - 1)


def implausible(fit: Fit, effect: AngleEffect, scale: float, *, for_now: bool = False) -> Reason | None:
    """Return the parameter outside its plausible range, if any.

    Args:
        fit: with the effect in.
        effect: the effect.
        scale: overdispersion.
        for_now: True widens the range by its width on both sides: other effects may still be missing.
    """
    where = fit.model.layout.effect(effect.name)
    std = np.sqrt(np.diagonal(fit.covariance()))[where] * math.sqrt(scale)
    for parameter, value, error in zip(effect.parameters, fit.vector[where], std, strict=True):
        slack = _BEYOND * float(error) + (parameter.high - parameter.low if for_now else 0.0)
        if not parameter.low - slack <= value <= parameter.high + slack:
            return outside_range(parameter, float(value))
    return effect.reason_against(fit.vector[where], std)


def outside_range(parameter: Parameter, value: float) -> Reason:
    """Return the reason to reject a value outside a parameter's plausible range; numbers are in the display unit."""
    return Reason(
        Code.IMPLAUSIBLE_PARAMETER,
        parameter=parameter.name,
        value=value * parameter.factor,
        low=parameter.low * parameter.factor,
        high=parameter.high * parameter.factor,
        unit=parameter.display_unit or parameter.unit,
    )


def uneven(fit: Fit, effect: AngleEffect, scale: float) -> Reason | None:
    """Return the group in which the size of an effect differs most; None if it is the same in all."""
    groups = [(group.label, [(index, slice(None))]) for index, group in enumerate(fit.model.campaign.groups)]
    found = _odd_one(fit, effect, scale, groups)
    return Reason(Code.SIZE_DIFFERS_BETWEEN_RECORDINGS, recording=found) if found else None


def lopsided(fit: Fit, effect: AngleEffect, scale: float) -> Reason | None:
    """Return the axis on which the size of an effect differs most; None if it is the same on all.

    It applies to the final model, since missing effects distort one axis more than another.
    """
    groups = range(len(fit.model.campaign.groups))
    # Other axes are affected only through other effects, and are tested with those.
    own = effect.axes if isinstance(effect, SignalEffect) else (CIRCUMFERENTIAL, RADIAL)
    axes = [(AXIS_NAMES[axis], [(index, slice(axis, axis + 1)) for index in groups]) for axis in own]
    found = _odd_one(fit, effect, scale, axes)
    return Reason(Code.SIZE_DIFFERS_BETWEEN_AXES, axis=found) if found else None


def _odd_one(fit: Fit, effect: AngleEffect, scale: float, parts: Sequence[tuple[str, list[Part]]]) -> str:
    """Return the part of the data whose size of the effect differs most, where sizes differ; else ""."""
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
    """Return the size of each parameter, common to all of one unit, since a rotation mixes cosine and sine."""
    units = [parameter.unit for parameter in effect.parameters]
    return np.array(
        [math.hypot(*(v for v, u in zip(values.tolist(), units, strict=True) if u == unit)) for unit in units]
    )


def _verdict(values: FloatArray, spread: FloatArray, labels: list[str]) -> str:
    """Return the part whose parameters (G, p) deviate most, given the joint covariance; "" if all agree."""
    count, own = values.shape
    contrast = np.kron(np.eye(count)[1:] - np.eye(count)[0], np.eye(own))
    difference = contrast @ values.reshape(-1)
    statistic = float(difference @ np.linalg.solve(contrast @ spread @ contrast.T, difference))
    if chi2.sf(statistic, len(difference)) >= _RARE:
        return ""
    std = np.sqrt(np.diagonal(spread)).reshape(count, own)
    worst = int(np.argmax(np.max(np.abs(values) / std, axis=1)))
    return labels[worst]


def useless(effect: AngleEffect, fall: float, gain: FloatArray, scale: float) -> Reason | None:
    """Return why an effect is redundant given the others; None if it is needed.

    Args:
        effect: the effect.
        fall: decrease of the misfit due to it.
        gain: (K,) decrease of the held-out misfit of each fold.
        scale: overdispersion.
    """
    if fall < evidence_needed(effect) * scale:
        return Reason(Code.TOO_SMALL_BESIDE_OTHERS)
    return None if float(gain.sum()) > spread(gain) else Reason(Code.NOT_NEEDED)


def spread(gain: FloatArray) -> float:
    """Return the standard error of a sum over folds (K,); folds with value 0 are ignored."""
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
        # Summed over blocks: repeating parts add up, noise does not.
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
    # Also over all orders of its axes: an effect that explains the smaller part of the residual is not the cause.
    power = gained.sum(axis=1)
    acts = power > _MAIN_AXIS * power.max()
    on_axes = max(0.0, float((left - expected)[acts].sum())) / max(float(gained[acts].sum()), 1e-300)
    explained = float(gained.reshape(-1)[inside].sum())
    return explained, max(0.0, float(beyond), _HALF_SHARE * on_axes * explained)


def of_known_size(effect: AngleEffect) -> bool:
    """Return whether physics fixes the size of an effect, so that it cannot stand in for another."""
    return all(parameter.known for parameter in effect.parameters)


def stands_in(effect: AngleEffect, explained: float, left: float) -> Reason | None:
    """Return why an effect represents another cause; None if it does not."""
    if of_known_size(effect):
        return None
    if left <= _LEFT_SHARE * explained or left <= LEAST_EVIDENCE:
        return None
    return Reason(Code.LEAVES_RESIDUAL, residual_share=left / (left + explained))
