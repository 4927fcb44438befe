"""Contact-edge jitter: its size from the edges of single revolutions."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from gateway.core.reasons import Reason
from gateway.core.types import FloatArray
from gateway.diagnosis import criteria
from gateway.diagnosis.bayes.parameter_estimates import fitted_parameter, outside_range
from gateway.diagnosis.bayes.posterior import over
from gateway.diagnosis.data.campaign_data import Group
from gateway.diagnosis.effects.contact import CONTACT_EDGE_JITTER
from gateway.diagnosis.reasons import DiagnosisCode
from gateway.diagnosis.result import Finding, Fitted, Verdict

# Number of sizes over which likelihoods are summed.
_SIZES: Final = 160
# Values of a normal variate over which they are summed as well, and their weights.
_NORMAL: Final[FloatArray] = np.linspace(-4.0, 4.0, 41)
_WEIGHTS: Final[FloatArray] = np.exp(-0.5 * np.square(_NORMAL))
_LOG_WEIGHTS: Final[FloatArray] = np.log(_WEIGHTS / _WEIGHTS.sum())
# Folds from which the one of the largest scatter is left out of the evidence.
_MIN_FOLDS: Final = 3


@dataclass(frozen=True, slots=True)
class _Cause:
    """A cause of the scatter at the contact edges, with its evidence; as in `posterior.Weighed`."""

    names: frozenset[str]
    log_evidence: float
    objections: tuple[tuple[str, Reason], ...] = ()


def edge_findings(groups: Sequence[Group]) -> tuple[Finding, ...]:
    """Return the finding of contact-edge jitter; none without evidence."""
    measured = [group for group in groups if group.edges.freedom and group.edges.noise_rad2 > 0.0]
    if not measured:
        return ()
    weight = np.array([sum(group.edges.freedom) for group in measured])
    square = np.array([group.edges.scatter_rad2 * group.conditions.radius_m**2 for group in measured])
    std = np.array([_square_std(group) for group in measured])
    mean = float(weight @ square / weight.sum())
    mean_std = math.sqrt(float(np.square(weight * std).sum())) / float(weight.sum())
    name = CONTACT_EDGE_JITTER.name
    steady, common, separate = _log_evidences([_without_largest(group) for group in measured])
    reason = _objection(measured, mean)
    if reason is None and separate + math.log(criteria.STAND_IN_ODDS) > common:
        largest = measured[int(np.argmax(np.abs(square - mean) / std))]
        reason = Reason(DiagnosisCode.SIZE_DIFFERS_BETWEEN_RECORDINGS, recording=largest.label)
    odds = math.log(criteria.PRIOR_ODDS)
    causes = (
        _Cause(frozenset(), steady),
        _Cause(frozenset({name}), common + odds, () if reason is None else ((name, reason),)),
    )
    posterior = over({cause.names: cause for cause in causes})
    probability = posterior.probability([name])
    is_named = name in posterior.identified()
    if probability < criteria.LISTED and (reason is None or max(common, separate) < steady):
        return ()
    if reason is None and not is_named:
        reason = Reason(DiagnosisCode.PROBABILITY_TOO_LOW, probability=probability, needed=criteria.NAMED)
    return (
        Finding(
            name=name,
            verdict=Verdict.NAMED if is_named else Verdict.REFUSED,
            parameters=_parameters(measured, mean, mean_std),
            chi2=sum(group.edges.chi2 for group in measured),
            rms_mps2=math.sqrt(max(0.0, sum(group.edges.explained_m2ps4 for group in measured)) / len(measured)),
            reason=reason,
            summary=CONTACT_EDGE_JITTER.summary,
            equation=CONTACT_EDGE_JITTER.equation,
            lock="contact",
            probability=probability,
            log_odds=posterior.log_odds(name),
        ),
    )


def _without_largest(group: Group) -> Group:
    """Return a group without the fold of the largest scatter: a few turns in which the speed changed are no jitter."""
    edges = group.edges
    measured_folds = [fold for fold, freedom in enumerate(edges.freedom) if freedom > 0.0]
    if len(measured_folds) < _MIN_FOLDS:
        return group
    largest = max(measured_folds, key=lambda fold: edges.power_rad2[fold])
    remaining = [fold for fold in measured_folds if fold != largest]
    freedom, power = ([values[fold] for fold in remaining] for values in (edges.freedom, edges.power_rad2))
    return replace(group, edges=replace(edges, freedom=tuple(freedom), power_rad2=tuple(power)))


def _log_evidences(groups: Sequence[Group]) -> tuple[float, float, float]:
    """Return the log evidence of steady edges, of jitter alike in all groups, and of scatter free in each group.

    The order of magnitude of the jitter is not known. Between groups it differs by `criteria.EDGE_SPREAD`, that of
    another cause by `criteria.FREE_SIZE`. The noise is known to `criteria.DENSITY_ERROR`.
    """
    low = 0.01 * CONTACT_EDGE_JITTER.parameters[0].prior_std
    high = math.hypot(*(parameter.high for parameter in CONTACT_EDGE_JITTER.parameters))
    sizes = np.geomspace(low, high, _SIZES)
    steady = 0.0
    spread = np.zeros((2, _SIZES))
    for group in groups:
        steady += float(_log_likelihood(group, np.zeros(1))[0])
        for row, width in enumerate((criteria.EDGE_SPREAD, criteria.FREE_SIZE)):
            trial_sizes = sizes[:, None] * np.exp(width * _NORMAL)
            spread[row] += np.logaddexp.reduce(
                _log_likelihood(group, trial_sizes.ravel()).reshape(trial_sizes.shape) + _LOG_WEIGHTS, 1
            )
    common, separate = (float(np.logaddexp.reduce(by_size)) - math.log(_SIZES) for by_size in spread)
    return steady, common, separate


def _log_likelihood(group: Group, rms_m: FloatArray) -> FloatArray:
    """Return the log likelihood of a group's mean squares by jitter of these sizes, (n,)."""
    edges = group.edges
    noise = edges.noise_rad2 * np.exp(criteria.DENSITY_ERROR * _NORMAL)
    expected = noise + np.square(rms_m / group.conditions.radius_m)[:, None]
    total = sum(edges.freedom)
    mean = sum(f * p for f, p in zip(edges.freedom, edges.power_rad2, strict=True))
    terms = -0.5 * (total * np.log(expected) + mean / expected) + _LOG_WEIGHTS
    result: FloatArray = np.logaddexp.reduce(terms, axis=1)
    return result


def _square_std(group: Group) -> float:
    """Return the standard error of the mean square of b - a, m^2."""
    edges = group.edges
    total = edges.scatter_rad2 + edges.noise_rad2
    return total * math.sqrt(2.0 / sum(edges.freedom)) * group.conditions.radius_m**2


def _objection(groups: Sequence[Group], mean: float) -> Reason | None:
    """Return why the scatter at the edges is not that of moving edges; None if it may be."""
    explained = sum(group.edges.explained_m2ps4 for group in groups)
    remaining = sum(group.edges.left_m2ps4 for group in groups)
    if remaining > criteria.EDGE_SHAPE * explained > 0.0:
        return Reason(DiagnosisCode.LEAVES_RESIDUAL_AT_EDGES, residual_share=remaining / (remaining + explained))
    for parameter, value in zip(CONTACT_EDGE_JITTER.parameters, _sizes(groups, mean), strict=True):
        if value > parameter.high:
            return outside_range(parameter, value)
    return None


def _leading_share(groups: Sequence[Group]) -> tuple[float, float]:
    """Return the leading edge's share of the mean square, and its standard error."""
    share = np.array([group.edges.leading_share for group in groups])
    weight = np.array([group.edges.leading_share_std for group in groups]) ** -2.0
    return float(weight @ share / weight.sum()), float(weight.sum()) ** -0.5


def _sizes(groups: Sequence[Group], mean: float) -> tuple[float, float]:
    share, _ = _leading_share(groups)
    return math.sqrt(mean * share), math.sqrt(mean * (1.0 - share))


def _parameters(groups: Sequence[Group], mean: float, mean_std: float) -> dict[str, Fitted]:
    share, share_std = _leading_share(groups)
    fitted = {}
    shares = (share, 1.0 - share)
    for parameter, value, part in zip(CONTACT_EDGE_JITTER.parameters, _sizes(groups, mean), shares, strict=True):
        # Standard error of the square, share times mean.
        error = math.hypot(part * mean_std, mean * share_std)
        std = error / (2.0 * max(value, math.sqrt(error)))
        fitted[parameter.name] = fitted_parameter(parameter, value, std)
    return fitted
