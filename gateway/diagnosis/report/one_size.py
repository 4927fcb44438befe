"""Effects judged by each recording alone, and by what is left where they act.

An effect has one size: fitted to each recording with everything free, or to each speed and load of a single one, its
sizes agree within their errors and a few percent of model; so do those of the halves of each recording. And it stands
out: what is left of a recording, on its axes and in its orders, is not larger than what it explains. Whatever stands in
for something that the catalogue lacks fails the one or the other.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.special import chdtrc

from gateway.core.reasons import Code, Reason
from gateway.core.types import FloatArray, IntArray
from gateway.diagnosis.angle.fit import Fit, FitFailedError, fit_model
from gateway.diagnosis.angle.likelihood import Whitened, as_real, whiten
from gateway.diagnosis.angle.remainder_freedom import remainder_covariance
from gateway.diagnosis.angle.residual import POWER_SHARE, group_residuals
from gateway.diagnosis.data.campaign_data import Remark
from gateway.diagnosis.effects.effect import SignalEffect
from gateway.diagnosis.model.closure_model import AngleEffect, ClosureModel
from gateway.diagnosis.reasons import DiagnosisCode
from gateway.diagnosis.report.effect_contribution import added_by
from gateway.diagnosis.result import Finding, Fitted, SingleSize, Verdict

_MODEL_SHARE: Final = 0.03
"""Share of a size by which an equation may err from recording to recording; with a tenth, potting passes."""
_AGREES: Final = 0.01
"""Probability of the chi-square of agreement below which sizes are not one: 71 true effects had 0.12 and more."""
_POWER: Final = 0.98
"""Share of an effect's power that its orders hold."""
_STRUCTURED: Final = 3.0
"""Rms of what is left of a recording over that of the noise from which it is something that the model lacks."""
_BURIED: Final = 2.0
"""Ratio of what is left to what an effect explains from which the effect may be a part of what the model lacks."""
# Steps of a fit to one recording from the sizes of all.
_STEPS: Final = 20


@dataclass(frozen=True)
class Alone:
    """A recording, or a speed and load of a single one, with its own fit of a set of effects."""

    label: Remark
    fit: Fit


def recordings_of(fit: Fit) -> dict[int, list[int]]:
    """Return the groups of each recording."""
    groups_of: dict[int, list[int]] = {}
    for index, group in enumerate(fit.model.campaign.groups):
        groups_of.setdefault(group.recording, []).append(index)
    return groups_of


def fitted_alone(fit: Fit) -> tuple[Alone, ...]:
    """Return the fit of each recording alone with the effects of a set, all parameters free.

    Of a single recording, that of each of its groups. Errors are by scatter, widened by what the fit leaves. A part
    that cannot be fitted alone is left out.
    """
    model, campaign = fit.model, fit.model.campaign
    parts: dict[Remark, list[int]] = {
        campaign.recordings[recording]: groups for recording, groups in recordings_of(fit).items()
    }
    if len(parts) < 2:
        parts = {group.label: [index] for index, group in enumerate(campaign.groups)}
    if len(parts) < 2:
        return ()
    single_fits = []
    for label, groups in parts.items():
        states = sorted({campaign.groups[index].state for index in groups})
        part = replace(
            campaign,
            groups=tuple(
                replace(campaign.groups[index], state=states.index(campaign.groups[index].state)) for index in groups
            ),
            states=len(states),
        )
        single = ClosureModel(part, model.core, model.effects)
        start, layout = np.zeros(single.layout.size), single.layout
        for number, state in enumerate(states):
            start[layout.state(number)] = fit.vector[model.layout.state(state)]
        for number, index in enumerate(groups):
            start[layout.centre(number)] = fit.vector[model.layout.centre(index)]
        start[layout.sensor] = fit.vector[model.layout.sensor]
        for effect in model.effects:
            start[layout.effect(effect.name)] = fit.vector[model.layout.effect(effect.name)]
        try:
            single_fits.append(Alone(label, fit_model(single, whiten(part, model.core), start, most_steps=_STEPS)))
        except (FitFailedError, np.linalg.LinAlgError):
            continue
    return tuple(single_fits)


def sizes_alone(alone: Sequence[Alone], effect: AngleEffect) -> tuple[SingleSize, ...]:
    """Return the sizes of an effect in each recording, with their errors, in the order of its parameters."""
    places = _sizes_of(effect)
    sizes = []
    for single in alone:
        values, variances = single.fit.parameters_of(effect.name)
        for index in places.tolist():
            parameter = effect.parameters[index]
            sizes.append(
                SingleSize(single.label, parameter.name, float(values[index]), math.sqrt(float(variances[index])))
            )
    return tuple(sizes)


def disagreement(alone: Sequence[Alone], effect: AngleEffect) -> tuple[float, int]:
    """Return the chi-square of the sizes of single recordings about their mean, and its degrees of freedom."""
    values, covariances = [], []
    for single in alone:
        indices = _places(single.fit, effect)
        values.append(single.fit.vector[indices])
        covariances.append(single.fit.covariance[np.ix_(indices, indices)])
    if len(alone) < 2 or not values[0].size:
        return 0.0, 0
    precisions = [np.linalg.inv(covariance) for covariance in covariances]
    mean = np.linalg.solve(sum(precisions), sum(p @ v for p, v in zip(precisions, values, strict=True)))
    model = np.diag(np.square(_MODEL_SHARE * mean) + 1e-300)
    precisions = [np.linalg.inv(covariance + model) for covariance in covariances]
    mean = np.linalg.solve(sum(precisions), sum(p @ v for p, v in zip(precisions, values, strict=True)))
    total = sum(float((v - mean) @ p @ (v - mean)) for p, v in zip(precisions, values, strict=True))
    return total, (len(alone) - 1) * values[0].size


def change_within(fit: Fit, data: Whitened, effect: AngleEffect) -> tuple[float, int]:
    """Return the chi-square of the changes of an effect's sizes within recordings, and its degrees of freedom.

    A change is that between the first and the last blocks of each recording, half of them each, by one linear step with
    tire, sensor and all effects free. What the model lacks is the same in both, so that errors are by scatter alone.
    """
    indices, total, freedom = _places(fit, effect), 0.0, 0
    for groups in recordings_of(fit).values():
        halved = [index for index in groups if len(data.counts[index]) > 1]
        if not halved or not indices.size:
            continue
        early, late = (_step_of_half(fit, data, halved, first=first) for first in (True, False))
        change = (late[0] - early[0])[indices]
        covariance = (early[1] + late[1])[np.ix_(indices, indices)]
        covariance += np.diag(2.0 * np.square(_MODEL_SHARE * fit.vector[indices]) + 1e-300)
        total += float(change @ np.linalg.solve(covariance, change))
        freedom += len(indices)
    return total, freedom


def _step_of_half(fit: Fit, data: Whitened, groups: Sequence[int], *, first: bool) -> tuple[FloatArray, FloatArray]:
    """Return the step to the optimum of the first or the last half of the blocks of groups, and its covariance."""
    size = len(fit.vector)
    gram, slope = np.zeros((size, size)), np.zeros(size)
    for index in groups:
        counts, half = data.counts[index], len(data.counts[index]) // 2
        chosen = slice(0, half) if first else slice(len(counts) - half, None)
        weights = counts[chosen] / counts[chosen].sum()
        deviations = (data.orders[index] - fit.model.predict_group(fit.vector, index))[chosen] * data.used[index]
        residual = as_real(np.tensordot(weights, deviations, axes=1))
        rows = fit.rows[index]
        share = counts[chosen].sum() / counts.sum()
        weighted = share * np.einsum("pan,anm->pam", rows, data.precisions[index], optimize=True).reshape(size, -1)
        gram += weighted @ rows.reshape(size, -1).T
        slope += weighted @ residual.reshape(-1)
    inverse = np.linalg.inv(gram + fit.prior_precision)
    covariance: FloatArray = inverse @ gram @ inverse
    return inverse @ slope, covariance


def of_one_size(findings: Sequence[Finding], fit: Fit, data: Whitened) -> list[Finding]:
    """Return findings with the sizes by recording; those without one size, or buried in what is left, are rejected.

    Args:
        findings: of effects.
        fit: of the best set.
        data: whitened.
    """
    effects = {effect.name: effect for effect in fit.model.effects}
    named = [f.name for f in findings if f.verdict is Verdict.NAMED and f.name in effects]
    if not named:
        return list(findings)
    single_fits = fitted_alone(fit)
    freedom = np.diagonal(remainder_covariance(fit, data))
    judged = []
    for finding in findings:
        if finding.name in named:
            effect = effects[finding.name]
            finding = replace(
                finding,
                single_sizes=sizes_alone(single_fits, effect),
                parameters=_with_remainder(finding.parameters, effect, freedom[fit.model.layout.effect(finding.name)]),
            )
            reason = (
                _disagreement_reason(disagreement(single_fits, effect), DiagnosisCode.SIZES_DIFFER)
                or _disagreement_reason(change_within(fit, data, effect), DiagnosisCode.SIZE_CHANGES)
                or _buried(fit, data, effect)
            )
            if reason is not None:
                finding = replace(finding, verdict=Verdict.REFUSED, reason=reason)
        judged.append(finding)
    return judged


def _with_remainder(parameters: Mapping[str, Fitted], effect: AngleEffect, freedom: FloatArray) -> dict[str, Fitted]:
    """Return an effect's parameters whose errors contain the variance `freedom` (p,) by what is left."""
    return {
        parameter.name: replace(fitted, std=math.hypot(fitted.std, math.sqrt(variance)) if not parameter.whole else 0.0)
        for parameter, fitted, variance in zip(effect.parameters, parameters.values(), freedom.tolist(), strict=True)
    }


def _disagreement_reason(disagreeing: tuple[float, int], code: Code) -> Reason | None:
    square, freedom = disagreeing
    if not freedom or float(chdtrc(freedom, square)) >= _AGREES:
        return None
    return Reason(code, chi2=square, freedom=freedom)


def _buried(fit: Fit, data: Whitened, effect: AngleEffect) -> Reason | None:
    """Return that more is left of a recording than an effect explains there, on its axes and in its orders."""
    residuals, added = group_residuals(fit, data), added_by(fit, effect)
    worst: tuple[float, float, float] = (0.0, 0.0, 0.0)
    for groups in recordings_of(fit).values():
        power = np.mean([POWER_SHARE * np.abs(added[index]) ** 2 for index in groups], axis=0)
        chosen = _strongest(power)
        explained = float(power[chosen].sum())
        remainder = float(np.mean([np.maximum(residuals[index].excess()[chosen].sum(), 0.0) for index in groups]))
        noise = float(np.mean([residuals[index].variance[chosen].sum() for index in groups]))
        if noise > 0.0 and remainder > _STRUCTURED**2 * noise and remainder > worst[0] ** 2 * explained:
            worst = math.sqrt(remainder / max(explained, 1e-300)), math.sqrt(explained), math.sqrt(remainder)
    ratio, size_mps2, left_mps2 = worst
    return (
        Reason(DiagnosisCode.SMALLER_THAN_LEFT, size_mps2=size_mps2, left_mps2=left_mps2) if ratio > _BURIED else None
    )


def _strongest(power: FloatArray) -> tuple[IntArray, IntArray]:
    """Return axes and orders of the largest powers (3, ORDERS) that together hold `_POWER` of it."""
    order = np.argsort(-power, axis=None)
    total = np.cumsum(power.ravel()[order])
    count = int(np.searchsorted(total, _POWER * total[-1])) + 1
    axes, orders = np.unravel_index(order[:count], power.shape)
    return axes, orders


def _places(fit: Fit, effect: AngleEffect) -> IntArray:
    """Return the places of an effect's sizes among the parameters of a fit."""
    places: IntArray = fit.model.layout.effect(effect.name).start + _sizes_of(effect)
    return places


def _sizes_of(effect: AngleEffect) -> IntArray:
    """Return the places of an effect's sizes among its parameters: those that do not shape it and are one value."""
    count = len(effect.parameters)
    if isinstance(effect, SignalEffect) and not effect.linear:
        count = effect.sizes
    return np.array(
        [
            index
            for index, parameter in enumerate(effect.parameters[:count])
            if not parameter.varies and not parameter.whole and not parameter.known
        ],
        dtype=np.intp,
    )
