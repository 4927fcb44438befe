"""Contact-edge jitter: its size from the edges of single revolutions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from gateway.closure.data.campaign_data import Group
from gateway.closure.effects.contact import CONTACT_EDGE_JITTER
from gateway.closure.inference.findings import fitted_parameter
from gateway.closure.inference.parameter_range import outside_range
from gateway.closure.result import Finding, Fitted, Verdict
from gateway.reasons import Code, Reason
from gateway.types import FloatArray

# Reduction of the deviance that is no chance result, as for angle-locked effects.
_LEAST_EVIDENCE: Final = 25.0
# Residual near the corrected edges, relative to what the correction removed, above which the cause is another.
_LEFT_SHARE: Final = 0.25
# Tolerated difference of one group's rms from that of all, beyond its errors: on a short contact one edge moves with
# the other.
_LARGEST_RATIO: Final = 2.5
_SIGMAS: Final = 3.0
# Relative residual of corrected edges: 2 to 7 % for jitter of millimetres.
_LEFT_OF_EDGES: Final = 0.1


def edge_findings(groups: Sequence[Group]) -> tuple[Finding, ...]:
    """Return the finding of contact-edge jitter; none without evidence."""
    seen = [group for group in groups if group.edges.freedom and group.edges.noise_rad2 > 0.0]
    if not seen:
        return ()
    gains = _gains(seen)
    chi2 = sum(group.edges.chi2 for group in seen)
    gain = float(gains.sum())
    spread = float(np.std(gains, ddof=1)) * math.sqrt(len(gains)) if len(gains) > 1 else math.inf
    if chi2 < _LEAST_EVIDENCE or gain <= _SIGMAS * spread:
        return ()
    weight = np.array([sum(group.edges.freedom) for group in seen])
    square = np.array([group.edges.scatter_rad2 * group.conditions.radius_m**2 for group in seen])
    std = np.array([_square_std(group) for group in seen])
    mean = float(weight @ square / weight.sum())
    mean_std = math.sqrt(float(np.square(weight * std).sum())) / float(weight.sum())
    reason = _objection(seen, square, std, mean)
    explained = sum(group.edges.explained_m2ps4 for group in seen)
    return (
        Finding(
            name=CONTACT_EDGE_JITTER.name,
            verdict=Verdict.REFUSED if reason else Verdict.NAMED,
            parameters=_parameters(seen, mean, mean_std),
            chi2=chi2,
            held_out_gain=gain,
            held_out_std=spread,
            rms_mps2=math.sqrt(max(0.0, explained) / len(seen)),
            reason=reason,
            summary=CONTACT_EDGE_JITTER.summary,
            equation=CONTACT_EDGE_JITTER.equation,
            lock="contact",
        ),
    )


def beside_edges(findings: Sequence[Finding], edges: Sequence[Finding]) -> tuple[Finding, ...]:
    """Return findings of the time-locked signal, rejected if the residual of moving edges may be as large.

    Args:
        findings: findings from deviations of revolutions with corrected edges.
        edges: result of `edge_findings`.
    """
    doubt = _LEFT_OF_EDGES * max((edge.rms_mps2 for edge in edges), default=0.0)
    reason = Reason(Code.SMALLER_THAN_EDGE_RESIDUAL)
    return tuple(
        replace(finding, verdict=Verdict.REFUSED, reason=reason, rivals=(), decide_with=None)
        if finding.verdict is not Verdict.REFUSED and finding.rms_mps2 < doubt
        else finding
        for finding in findings
    )


def _gains(groups: Sequence[Group]) -> FloatArray:
    """Return the reduction of each fold's deviance with the jitter fitted to the group's other folds."""
    folds = max(len(group.edges.freedom) for group in groups)
    gains = np.zeros(folds)
    for group in groups:
        edges = group.edges
        freedom, power = np.array(edges.freedom), np.array(edges.power_rad2)
        none = edges.deviances(0.0)
        for fold in range(len(freedom)):
            others = np.arange(len(freedom)) != fold
            known = float(freedom[others].sum())
            if known > 0.0:
                rest = max(0.0, float(freedom[others] @ power[others]) / known - edges.noise_rad2)
                gains[fold] += none[fold] - edges.deviances(rest)[fold]
    return gains[gains != 0.0] if gains.any() else gains


def _square_std(group: Group) -> float:
    """Return the standard error of the mean square of b - a, m^2."""
    edges = group.edges
    total = edges.scatter_rad2 + edges.noise_rad2
    return total * math.sqrt(2.0 / sum(edges.freedom)) * group.conditions.radius_m**2


def _objection(groups: Sequence[Group], square: FloatArray, std: FloatArray, mean: float) -> Reason | None:
    explained = sum(group.edges.explained_m2ps4 for group in groups)
    left = sum(group.edges.left_m2ps4 for group in groups)
    if left > _LEFT_SHARE * explained > 0.0:
        return Reason(Code.LEAVES_RESIDUAL_AT_EDGES, residual_share=left / (left + explained))
    for group, own, error in zip(groups, square.tolist(), std.tolist(), strict=True):
        if own + _SIGMAS * error < mean / _LARGEST_RATIO**2 or own - _SIGMAS * error > mean * _LARGEST_RATIO**2:
            return Reason(Code.SIZE_DIFFERS_BETWEEN_RECORDINGS, recording=group.label)
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
    found = {}
    shares = (share, 1.0 - share)
    for parameter, value, part in zip(CONTACT_EDGE_JITTER.parameters, _sizes(groups, mean), shares, strict=True):
        # Standard error of the square, share times mean.
        error = math.hypot(part * mean_std, mean * share_std)
        std = error / (2.0 * max(value, math.sqrt(error)))
        found[parameter.name] = fitted_parameter(parameter, value, std)
    return found
