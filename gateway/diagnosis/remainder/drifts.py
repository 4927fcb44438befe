"""Drifts: the quantity of the model that changes from block to block of a recording, named with its size per minute."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from gateway.core.types import ComplexArray, FloatArray
from gateway.diagnosis import criteria
from gateway.diagnosis.angle.fit import Fit
from gateway.diagnosis.angle.likelihood import Whitened, as_complex
from gateway.diagnosis.effects.effect import Parameter, SignalEffect
from gateway.diagnosis.model.closure_model import AngleEffect, ClosureModel
from gateway.diagnosis.model.tire_state import slopes
from gateway.diagnosis.result import Drift, Finding, Fitted

LOAD_AND_PRESSURE: Final = ("load", "pressure")

# Sizes of the random walk over which evidence is summed, as shares of the prior of a parameter.
_WALKS: Final = np.geomspace(1e-4, 0.3, 12)
# Prior of the logarithm of a number of the tire, of load and of pressure.
_LOG_STD: Final = 0.3
_LEAST_BLOCKS: Final = 3
_MINUTE_S: Final = 60.0
_PERCENT: Final = 100.0


class _Candidate(NamedTuple):
    """A quantity that may drift: k parameters that wander together.

    Attributes:
        name: of the effect, of the number of the tire, or load or pressure.
        parameters: (k,) what wanders.
        values: (k,) its value in the fit.
        rows: (k, 3, ORDERS) derivatives in each group.
    """

    name: str
    parameters: tuple[Parameter, ...]
    values: FloatArray
    rows: tuple[ComplexArray, ...]


class _Walk(NamedTuple):
    """A quantity that wanders: evidence against a steady one, chi-square that it takes away, (k, blocks) of each group.

    Covariances are (blocks k, blocks k), blocks outermost.
    """

    candidate: _Candidate
    log_evidence: float
    removed: float
    means: tuple[FloatArray, ...]
    covariances: tuple[FloatArray, ...]


def drifts_of(fit: Fit, data: Whitened, effects: Sequence[AngleEffect]) -> tuple[Drift, ...]:
    """Return what drifts in each group, the quantities that explain it as well beside it; none if nothing explains it.

    Blocks deviate from the mean of their group by the derivatives times parameters that walk at random in the order
    of time, and by the contact's centre, which is free in each block. The evidence is summed over sizes of the walk.

    Args:
        fit: of the best set.
        data: whitened.
        effects: candidates of the catalogue.
    """
    groups = fit.model.campaign.groups
    indices = [index for index, group in enumerate(groups) if len(group.blocks) >= _LEAST_BLOCKS]
    if not indices:
        return ()
    predicted = fit.model.predict(fit.vector)
    residuals: dict[int, ComplexArray] = {}
    excess = 0.0
    for index in indices:
        share = data.counts[index] / data.counts[index].sum()
        residual = data.orders[index] - predicted[index]
        residuals[index] = residual - np.tensordot(share, residual, axes=1)
        weighted = np.abs(data.weights[index] * residuals[index]) ** 2
        # A complex coefficient has two real ones; the mean takes one of the blocks.
        excess += float(weighted.sum()) - 2.0 * (len(share) - 1) * float((data.weights[index][0] > 0.0).sum())
    trials = [_walk(fit, data, candidate, residuals) for candidate in _candidates(fit, effects)]
    walks = sorted((walk for walk in trials if walk is not None), key=lambda walk: -walk.log_evidence)
    # As for a law: it takes half of the power beyond noise away, and its evidence outweighs the number of candidates.
    threshold = math.log(max(len(walks), 1)) - math.log1p(-criteria.NAMED) + math.log(criteria.NAMED)
    if not walks or walks[0].log_evidence < threshold or walks[0].removed < criteria.FAR_LESS * excess:
        return ()
    strongest = walks[0]
    rivals = tuple(walk.candidate.name for walk in walks[1:] if walk.log_evidence > strongest.log_evidence - threshold)
    return tuple(
        _drift(fit, index, strongest, number, parameter, rivals)
        for number, index in enumerate(indices)
        for parameter in range(len(strongest.candidate.parameters))
        if _is_evident(strongest, number, parameter)
    )


def with_drifts(findings: Sequence[Finding], drifts: Sequence[Drift]) -> list[Finding]:
    """Return findings in whose errors a parameter that drifts has its change: it is one value for all recordings."""
    updated = []
    for finding in findings:
        # The standard deviation of values that are even between beginning and end, in the group of the largest change.
        spreads = {
            key: max(
                (
                    abs(drift.end.value - drift.begin.value) / math.sqrt(12.0)
                    for drift in drifts
                    if (drift.name, drift.parameter) == (finding.name, key)
                ),
                default=0.0,
            )
            for key in finding.parameters
        }
        widened = {
            key: replace(fitted, std=math.hypot(fitted.std, spreads[key])) for key, fitted in finding.parameters.items()
        }
        updated.append(replace(finding, parameters=widened))
    return updated


def _candidates(fit: Fit, effects: Sequence[AngleEffect]) -> Iterator[_Candidate]:
    """Yield load, pressure, each number of the tire, the effects of the fit and the signal effects of the catalogue."""
    model, layout = fit.model, fit.model.layout
    names, groups = model.core.names, model.campaign.groups
    rows = [as_complex(group_rows) for group_rows in fit.rows]
    states = [group_rows[layout.state(group.state)] for group_rows, group in zip(rows, groups, strict=True)]
    directions = dict(zip(LOAD_AND_PRESSURE, slopes(names), strict=True))
    directions |= {name: np.eye(len(names))[index] for index, name in enumerate(names)}
    for name, direction in directions.items():
        parameter = Parameter(name, "", -1.0, 1.0, _LOG_STD, 1e-4, factor=_PERCENT, display_unit="%")
        derivatives = tuple(np.tensordot(direction, state, axes=1)[None] for state in states)
        yield _Candidate(name, (parameter,), np.zeros(1), derivatives)
    for effect in model.effects:
        columns = layout.effect(effect.name)
        yield _Candidate(
            effect.name, effect.parameters, fit.vector[columns], tuple(group_rows[columns] for group_rows in rows)
        )
    present = {effect.name for effect in model.effects}
    for effect in effects:
        if isinstance(effect, SignalEffect) and effect.name not in present:
            extended = ClosureModel(model.campaign, model.core, (*model.effects, effect))
            vector = layout.moved(fit.vector, extended.layout)
            values = np.array([parameter.prior_mean for parameter in effect.parameters])
            vector[extended.layout.effect(effect.name)] = values
            effect_rows = tuple(
                extended.group_derivatives(vector, index, effect.name, model.shape(fit.vector, index))[2]
                for index in range(len(groups))
            )
            yield _Candidate(effect.name, effect.parameters, values, effect_rows)


def _walk(fit: Fit, data: Whitened, candidate: _Candidate, residuals: dict[int, ComplexArray]) -> _Walk | None:
    """Return the walk of a candidate; None where the data do not contain it."""
    prior = np.array([parameter.prior_std for parameter in candidate.parameters])
    precisions, gradients, kernels = [], [], []
    for index, residual in residuals.items():
        centre = as_complex(fit.rows[index][fit.model.layout.centre(index)])
        rows = np.concatenate([candidate.rows[index] * prior[:, None, None], centre[None]])
        information, slope = _information(rows, residual, data.weights[index])
        share = data.counts[index] / data.counts[index].sum()
        blocks = len(share)
        about_mean = np.eye(blocks) - share
        steps = np.minimum.outer(np.arange(1.0, blocks + 1.0), np.arange(1.0, blocks + 1.0)) / blocks
        kernels.append(np.kron(about_mean @ steps @ about_mean.T, np.eye(len(prior))))
        size = blocks * len(prior)
        dense = np.zeros((blocks, len(prior), blocks, len(prior)))
        dense[np.arange(blocks), :, np.arange(blocks)] = information
        precisions.append(dense.reshape(size, size))
        gradients.append(slope.ravel())
    if not any(precision.any() for precision in precisions):
        return None
    solved = [
        [_evidence(walk**2 * kernel, *system) for kernel, *system in zip(kernels, precisions, gradients, strict=True)]
        for walk in _WALKS
    ]
    evidence = np.array([sum(part[0] for part in parts) for parts in solved])
    solutions = solved[int(np.argmax(evidence))]
    blocks_first = [solution[1].reshape(-1, len(prior)) for solution in solutions]
    removed = sum(
        float(2.0 * slope @ solution[1] - solution[1] @ precision @ solution[1])
        for solution, precision, slope in zip(solutions, precisions, gradients, strict=True)
    )
    scales = [np.tile(prior, len(mean)) for mean in blocks_first]
    return _Walk(
        candidate,
        float(np.logaddexp.reduce(evidence)) - math.log(len(_WALKS)),
        removed,
        tuple((mean * prior).T for mean in blocks_first),
        tuple(solution[2] * np.outer(scale, scale) for solution, scale in zip(solutions, scales, strict=True)),
    )


def _information(rows: ComplexArray, residual: ComplexArray, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return information (blocks, k, k) and slope (blocks, k) of the rows but the last, which is free in each block."""
    weighted = rows[None] * weights[:, None]
    gram = np.einsum("bpan,bqan->bpq", weighted.conj(), weighted).real
    moments = np.einsum("bpan,ban->bp", weighted.conj(), residual * weights).real
    pivot = np.maximum(gram[:, -1, -1], 1e-30)
    cross = gram[:, :-1, -1]
    information: FloatArray = gram[:, :-1, :-1] - cross[:, :, None] * cross[:, None] / pivot[:, None, None]
    return information, moments[:, :-1] - cross * (moments[:, -1] / pivot)[:, None]


def _evidence(covariance: FloatArray, precision: FloatArray, slope: FloatArray) -> tuple[float, FloatArray, FloatArray]:
    """Return the log evidence of deviations of this prior covariance against none, their mean and their covariance."""
    matrix = np.eye(len(slope)) + covariance @ precision
    posterior: FloatArray = np.asarray(np.linalg.solve(matrix, covariance), dtype=np.float64)
    mean: FloatArray = posterior @ slope
    return 0.5 * float(slope @ mean) - 0.5 * float(np.linalg.slogdet(matrix)[1]), mean, posterior


def _ends(walk: _Walk, number: int, parameter: int) -> tuple[FloatArray, FloatArray]:
    """Return the deviations at beginning and end, (2,), and their covariance, (2, 2)."""
    mean, covariance = walk.means[number], walk.covariances[number]
    size = len(mean)
    places = [parameter, parameter + size * (mean.shape[1] - 1)]
    return mean[parameter, [0, -1]], covariance[np.ix_(places, places)]


def _change(walk: _Walk, number: int, parameter: int) -> tuple[float, float]:
    """Return the change from beginning to end, and its standard error."""
    (begin, end), covariance = _ends(walk, number, parameter)
    variance = covariance[0, 0] + covariance[1, 1] - 2.0 * covariance[0, 1]
    return float(end - begin), math.sqrt(max(float(variance), 0.0))


def _is_evident(walk: _Walk, number: int, parameter: int) -> bool:
    change, std = _change(walk, number, parameter)
    return abs(change) > criteria.SIGMAS_LISTED * std > 0.0


def _drift(fit: Fit, index: int, walk: _Walk, number: int, parameter: int, rivals: tuple[str, ...]) -> Drift:
    """Return the drift of one parameter in one group."""
    quantity, group = walk.candidate.parameters[parameter], fit.model.campaign.groups[index]
    minutes = (group.blocks[-1].conditions.time_s - group.blocks[0].conditions.time_s) / _MINUTE_S
    change, std = _change(walk, number, parameter)
    ends, covariance = _ends(walk, number, parameter)
    rate = (change / minutes, std / minutes) if minutes > 0.0 else (math.nan, math.nan)
    begin, end = (
        replace(
            _fitted(
                quantity,
                float(walk.candidate.values[parameter] + ends[side]),
                math.sqrt(max(float(covariance[side, side]), 0.0)),
            ),
            inverse_display=quantity.inverse_display,
        )
        for side in (0, 1)
    )
    # A parameter shown as its inverse has no rate in that unit: the rate is that of the parameter itself.
    return Drift(walk.candidate.name, quantity.name, group.label, _fitted(quantity, *rate), begin, end, rivals)


def _fitted(parameter: Parameter, value: float, std: float) -> Fitted:
    return Fitted(value, std, parameter.unit, parameter.factor, parameter.display_unit)
