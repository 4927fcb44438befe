"""Findings from a posterior: every effect with evidence, its figures, its rivals and the recording that decides."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from gateway.core.reasons import Reason
from gateway.core.types import FloatArray
from gateway.diagnosis import criteria
from gateway.diagnosis.angle.fit import Fit
from gateway.diagnosis.angle.likelihood import Whitened
from gateway.diagnosis.angle.number_estimates import before_and_after, estimates_of
from gateway.diagnosis.angle.residual import POWER_SHARE, group_residuals
from gateway.diagnosis.angle.set_evidence import Evaluated
from gateway.diagnosis.bayes.parameter_estimates import parameters_over_sets
from gateway.diagnosis.bayes.verdicts import Judgement, judgements
from gateway.diagnosis.data.side_information import CLOCK
from gateway.diagnosis.model.closure_model import AngleEffect
from gateway.diagnosis.reasons import DiagnosisCode
from gateway.diagnosis.report.effect_contribution import added_by
from gateway.diagnosis.report.experiment_design import deciding_recording
from gateway.diagnosis.result import Finding, Fitted, Verdict
from gateway.diagnosis.search.tempered_posterior import Posterior


def findings_of(
    posterior: Posterior, effects: Mapping[str, AngleEffect], rms_of: Mapping[frozenset[str], float]
) -> list[Finding]:
    """Return the finding of every effect with evidence, most probable first.

    Args:
        posterior: over sets of effects.
        effects: candidates by name.
        rms_of: held-out rms of sets of effects.
    """
    return [_finding(posterior, judgement, effects, rms_of) for judgement in judgements(posterior)]


def apart_from(findings: Sequence[Finding], other: Mapping[str, FloatArray]) -> list[Finding]:
    """Return findings whose parameters' errors contain the distance to those of a better model on the same data.

    Args:
        findings: of effects.
        other: parameters of each effect by name, (K,); findings of others stay.
    """
    return [
        replace(finding, parameters=_with_distance(finding.parameters, other[finding.name]))
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
        unconfirmed = [(name, absent[name]) for name in (finding.name, *finding.rivals) if name in absent]
        if unconfirmed and finding.verdict is not Verdict.REFUSED:
            name, chi2 = unconfirmed[0]
            reason = Reason(DiagnosisCode.NOT_ON_EXACT_RING, effect=name, errors=math.sqrt(chi2))
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
            # NaN, where the ring has no solution without the effect, is not smaller.
            if bool((sizes <= remaining_mps2).all()):
                axis = int(np.argmax(sizes))
                reason = Reason(
                    DiagnosisCode.SMALLER_THAN_LEFT, size_mps2=float(sizes[axis]), left_mps2=float(remaining_mps2[axis])
                )
                finding = replace(finding, verdict=Verdict.REFUSED, reason=reason)
        judged.append(finding)
    return judged


def of_common_size(findings: Sequence[Finding]) -> list[Finding]:
    """Reject identified effects whose size in all recordings together is not the mean of those in each alone.

    Such an effect is there only between recordings: it stands for how their signals depend on speed or load. Of 94 in
    blind cases, the right ones are at most one error away, a false one 3.3.
    """
    judged = []
    for finding in findings:
        if finding.verdict is Verdict.NAMED and (errors := _from_single(finding)):
            largest_error = max(errors)
            if len(errors) * math.erfc(largest_error / math.sqrt(2.0)) < 1.0 - criteria.NAMED:
                reason = Reason(DiagnosisCode.SIZES_DIFFER, chi2=largest_error**2, freedom=1)
                finding = replace(finding, verdict=Verdict.REFUSED, reason=reason)
        judged.append(finding)
    return judged


def _from_single(finding: Finding) -> list[float]:
    """Return the errors by which each size is away from the mean of those of single recordings."""
    single_of: dict[str, list[tuple[float, float]]] = {}
    for single in finding.single_sizes:
        single_of.setdefault(single.parameter, []).append((single.value, single.std**-2.0 if single.std else 0.0))
    errors = []
    for name, singles in single_of.items():
        precision, size = sum(weight for _, weight in singles), finding.parameters[name]
        if precision > 0.0:
            mean = sum(value * weight for value, weight in singles) / precision
            std = math.hypot(precision**-0.5, size.std, criteria.SIZE_SHARE * size.value)
            errors.append(abs(mean - size.value) / std)
    return errors


def _with_distance(parameters: Mapping[str, Fitted], references: FloatArray) -> dict[str, Fitted]:
    return {
        name: replace(fitted, std=math.hypot(fitted.std, fitted.value - reference))
        for (name, fitted), reference in zip(parameters.items(), references.tolist(), strict=True)
    }


def _finding(
    posterior: Posterior,
    judgement: Judgement[Evaluated],
    effects: Mapping[str, AngleEffect],
    rms_of: Mapping[frozenset[str], float],
) -> Finding:
    name, inside, rivals = judgement.name, judgement.inside, judgement.rivals
    considered = posterior.considered if judgement.possible else ()
    effect = next(effect for effect in inside.fit.model.effects if effect.name == name)
    finding = Finding(
        name=name,
        verdict=judgement.verdict,
        parameters=parameters_over_sets(
            effect.parameters,
            inside.fit.parameters_of(name),
            [(entry.fit.parameters_of(name), weight) for entry, weight in considered if name in entry.names],
            max(group.conditions.gain_std for group in inside.fit.model.campaign.groups),
        ),
        chi2=math.nan,
        rms_mps2=float(np.max(sizes_of(inside.fit, effect))),
        rivals=rivals,
        decide_with=_decide(inside.fit, effect, rivals, effects) if rivals else None,
        reason=judgement.reason,
        summary=effect.summary,
        equation=effect.equation,
        probability=0.0,
    )
    if not judgement.possible:
        return finding
    without = posterior.every.get(inside.names - {name}) or posterior.without(name)
    before, _ = estimates_of([(without.fit, 1.0)])
    after, _ = estimates_of([(inside.fit, 1.0)])
    return replace(
        finding,
        chi2=without.fit.misfit - inside.fit.misfit,
        rms_before_mps2=rms_of.get(without.names, math.nan),
        rms_after_mps2=rms_of.get(inside.names, math.nan),
        estimates=before_and_after(before, after),
        probability=posterior.probability([name]),
        log_odds=posterior.log_odds(name),
    )


def _decide(
    fit: Fit, effect: AngleEffect, rivals: tuple[str, ...], effects: Mapping[str, AngleEffect]
) -> Reason | None:
    """Return the recording that would distinguish an effect from a rival, preferably from the clock.

    The clock needs no fit: a recording with the host's time measures it independently of other effects.
    """
    rival = CLOCK if CLOCK in rivals else rivals[0]
    recording = deciding_recording(fit, effect, effects[rival])
    return Reason(DiagnosisCode.DECIDES_AGAINST, effect=rival, recording=recording) if len(rivals) > 1 else recording


def sizes_of(fit: Fit, effect: AngleEffect) -> FloatArray:
    """Return the rms of an effect's contribution to each axis over the groups, (3,)."""
    squares = [(POWER_SHARE * np.abs(added) ** 2).sum(axis=1) for added in added_by(fit, effect)]
    result: FloatArray = np.sqrt(np.mean(squares, axis=0))
    return result
