"""Findings from a posterior: every effect with evidence, its figures, its rivals and the recording that decides."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from gateway.closure import criteria
from gateway.closure.angle.fit import Fit
from gateway.closure.angle.likelihood import Whitened
from gateway.closure.angle.number_estimates import before_and_after, estimates_of
from gateway.closure.angle.residual import POWER_SHARE, group_residuals
from gateway.closure.angle.set_evidence import Evaluated
from gateway.closure.bayes.parameter_estimates import fitted_parameter, over_sets
from gateway.closure.data.side_information import CLOCK
from gateway.closure.model.closure_model import AngleEffect
from gateway.closure.report.effect_contribution import added_by
from gateway.closure.report.experiment_design import deciding_recording
from gateway.closure.result import Finding, Fitted, Verdict
from gateway.closure.search.tempered_posterior import Posterior
from gateway.reasons import Code, Reason
from gateway.types import FloatArray

# Impossible effects listed.
_MOST_LISTED: Final = 4


def findings_of(
    posterior: Posterior, effects: Mapping[str, AngleEffect], rms_of: Mapping[frozenset[str], float]
) -> list[Finding]:
    """Return the finding of every effect with evidence, most probable first.

    Args:
        posterior: over sets of effects.
        effects: candidates by name.
        rms_of: held-out rms of sets of effects.
    """
    findings = [_finding(posterior, name, Verdict.NAMED, rms_of) for name in posterior.identified()]
    seen = set(posterior.identified())
    for group in posterior.alternatives():
        for name in group:
            rivals = tuple(other for other in group if other != name)
            finding = _finding(
                posterior, name, Verdict.INDISTINGUISHABLE, rms_of, rivals, _decide(posterior, name, rivals, effects)
            )
            findings.append(finding)
        seen |= set(group)
    for name in posterior.names:
        probability = posterior.probability([name])
        if name not in seen and probability >= criteria.LISTED:
            reason = Reason(Code.PROBABILITY_TOO_LOW, probability=probability, needed=criteria.NAMED)
            findings.append(_finding(posterior, name, Verdict.REFUSED, rms_of, reason=reason))
            seen.add(name)
    findings += _impossible(posterior, seen)
    return findings


def apart_from(findings: Sequence[Finding], other: Mapping[str, FloatArray]) -> list[Finding]:
    """Return findings whose parameters' errors contain the distance to those of a better model on the same data.

    Args:
        findings: of effects.
        other: parameters of each effect by name, (K,); findings of others stay.
    """
    return [
        replace(finding, parameters=_apart(finding.parameters, other[finding.name]))
        if finding.name in other
        else finding
        for finding in findings
    ]


def confirmed(findings: Sequence[Finding], absent: Mapping[str, float]) -> list[Finding]:
    """Reject effects that a better model on the same data has at nothing, and what is open with them.

    Args:
        findings: of effects.
        absent: chi-square against nothing of the sizes of such effects, by name.
    """
    judged = []
    for finding in findings:
        against = [(name, absent[name]) for name in (finding.name, *finding.rivals) if name in absent]
        if against and finding.verdict is not Verdict.REFUSED:
            name, chi2 = against[0]
            reason = Reason(Code.NOT_ON_EXACT_RING, effect=name, errors=math.sqrt(chi2))
            finding = replace(finding, verdict=Verdict.REFUSED, rivals=(), decide_with=None, reason=reason)
        judged.append(finding)
    return judged


def beside_more(findings: Sequence[Finding], fit: Fit, data: Whitened) -> list[Finding]:
    """Reject identified effects that are smaller than what is left on every axis on which they act.

    An equation that is off by as much as is left makes any small effect certain. Only where much is left: near the
    noise, an effect may be as small as the data can show.

    Args:
        findings: of effects.
        fit: of the best set.
        data: whitened.
    """
    residuals = group_residuals(fit, data)
    remaining_mps2 = np.sqrt(np.mean([np.square(residual.rms_mps2()) for residual in residuals], axis=0))
    noise = np.sqrt(np.mean([np.square(residual.noise_rms_mps2()) for residual in residuals], axis=0))
    if not (np.hypot(remaining_mps2, noise) > criteria.TEMPERED * noise).any():
        return list(findings)
    judged = []
    for finding in findings:
        effect = next((effect for effect in fit.model.effects if effect.name == finding.name), None)
        if effect is not None and finding.verdict is Verdict.NAMED:
            sizes = sizes_of(fit, effect)
            if bool((sizes <= remaining_mps2)[sizes > 0.0].all()):
                axis = int(np.argmax(sizes))
                reason = Reason(
                    Code.SMALLER_THAN_LEFT, size_mps2=float(sizes[axis]), left_mps2=float(remaining_mps2[axis])
                )
                finding = replace(finding, verdict=Verdict.REFUSED, reason=reason)
        judged.append(finding)
    return judged


def _apart(parameters: Mapping[str, Fitted], other: FloatArray) -> dict[str, Fitted]:
    return {
        name: replace(fitted, std=math.hypot(fitted.std, fitted.value - there))
        for (name, fitted), there in zip(parameters.items(), other.tolist(), strict=True)
    }


def _impossible(posterior: Posterior, seen: set[str]) -> list[Finding]:
    """Return the effects that would be in the best set if their values were possible."""
    findings: list[Finding] = []
    better = sorted(
        (evaluated for evaluated in posterior.every.values() if evaluated.objections),
        key=lambda evaluated: (-evaluated.log_evidence, sorted(evaluated.names)),
    )
    for evaluated in better:
        if evaluated.log_evidence < posterior.best.log_evidence or len(findings) >= _MOST_LISTED:
            break
        for name, reason in evaluated.objections:
            if name not in seen:
                seen.add(name)
                findings.append(_of_set(evaluated, name, Verdict.REFUSED, reason=reason, probability=0.0))
    return findings


def _finding(
    posterior: Posterior,
    name: str,
    verdict: Verdict,
    rms_of: Mapping[frozenset[str], float],
    rivals: tuple[str, ...] = (),
    decide_with: Reason | None = None,
    reason: Reason | None = None,
) -> Finding:
    inside = posterior.with_effect(name)
    without = posterior.every.get(inside.names - {name}) or posterior.without(name)
    before, _ = estimates_of([(without.fit, 1.0)])
    after, _ = estimates_of([(inside.fit, 1.0)])
    return _of_set(
        inside,
        name,
        verdict,
        chi2=without.fit.misfit - inside.fit.misfit,
        rms_before=rms_of.get(without.names, math.nan),
        rms_after=rms_of.get(inside.names, math.nan),
        estimates=before_and_after(before, after),
        rivals=rivals,
        decide_with=decide_with,
        reason=reason,
        probability=posterior.probability([name]),
        log_odds=posterior.log_odds(name),
        others=[(other, weight) for other, weight in posterior.considered if name in other.names],
    )


def _of_set(
    evaluated: Evaluated,
    name: str,
    verdict: Verdict,
    *,
    others: Sequence[tuple[Evaluated, float]] = (),
    chi2: float = math.nan,
    rms_before: float = math.nan,
    rms_after: float = math.nan,
    estimates: Mapping[str, tuple[Fitted, Fitted]] | None = None,
    rivals: tuple[str, ...] = (),
    decide_with: Reason | None = None,
    reason: Reason | None = None,
    probability: float = math.nan,
    log_odds: float = math.nan,
) -> Finding:
    effect = next(effect for effect in evaluated.fit.model.effects if effect.name == name)
    return Finding(
        name=name,
        verdict=verdict,
        parameters=_parameters(evaluated, effect, others),
        chi2=chi2,
        rms_mps2=float(np.max(sizes_of(evaluated.fit, effect))),
        rms_before_mps2=rms_before,
        rms_after_mps2=rms_after,
        estimates=estimates or {},
        rivals=rivals,
        decide_with=decide_with,
        reason=reason,
        summary=effect.summary,
        equation=effect.equation,
        probability=probability,
        log_odds=log_odds,
    )


def _decide(
    posterior: Posterior, name: str, rivals: tuple[str, ...], effects: Mapping[str, AngleEffect]
) -> Reason | None:
    """Return the recording that would distinguish an effect from a rival, preferably from the clock.

    The clock needs no fit: a recording with the host's time measures it independently of other effects.
    """
    rival = CLOCK if CLOCK in rivals else rivals[0]
    inside = posterior.with_effect(name)
    effect = next(effect for effect in inside.fit.model.effects if effect.name == name)
    recording = deciding_recording(inside.fit, effect, effects[rival])
    return Reason(Code.DECIDES_AGAINST, effect=rival, recording=recording) if len(rivals) > 1 else recording


def _parameters(
    evaluated: Evaluated, effect: AngleEffect, others: Sequence[tuple[Evaluated, float]]
) -> dict[str, Fitted]:
    """Return the parameters of an effect in one set, their errors over all sets that matter."""
    values_and_variances = _of_effect(evaluated, effect.name)
    variances = over_sets(values_and_variances, [(_of_effect(other, effect.name), weight) for other, weight in others])
    gain_std = max(group.conditions.gain_std for group in evaluated.fit.model.campaign.groups)
    return {
        parameter.name: fitted_parameter(parameter, float(value), math.sqrt(max(float(variance), 0.0)), gain_std)
        for parameter, value, variance in zip(effect.parameters, values_and_variances[0], variances, strict=True)
    }


def _of_effect(evaluated: Evaluated, name: str) -> tuple[FloatArray, FloatArray]:
    where = evaluated.fit.model.layout.effect(name)
    return evaluated.fit.vector[where], np.diagonal(evaluated.fit.covariance)[where]


def sizes_of(fit: Fit, effect: AngleEffect) -> FloatArray:
    """Return the rms of an effect's contribution to each axis over the groups, (3,)."""
    squares = [(POWER_SHARE * np.abs(added) ** 2).sum(axis=1) for added in added_by(fit, effect)]
    result: FloatArray = np.sqrt(np.mean(squares, axis=0))
    return result
