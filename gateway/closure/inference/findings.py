"""Findings from a selection: every effect with evidence, with its figures and confounders."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from gateway.closure.data.side_information import CLOCK
from gateway.closure.effects.effect import Parameter
from gateway.closure.inference import acceptance_tests as acceptance
from gateway.closure.inference.ablation import added_by
from gateway.closure.inference.candidate_selection import Step
from gateway.closure.inference.confounders import rivals_of
from gateway.closure.inference.experiment_design import deciding_recording
from gateway.closure.inference.fit import Fit, held_out_residuals
from gateway.closure.inference.forward_selection import Selection
from gateway.closure.inference.likelihood import Whitened
from gateway.closure.inference.number_estimates import before_and_after, estimates_of
from gateway.closure.inference.residual import POWER_SHARE
from gateway.closure.model.closure_model import AngleEffect
from gateway.closure.result import Finding, Fitted, Verdict
from gateway.reasons import Code, Reason
from gateway.types import FloatArray


def refused(step: Step, fit: Fit, reason: Reason) -> Finding:
    """Return the finding of an effect that was added and then removed."""
    return Finding(
        name=step.effect.name,
        verdict=Verdict.REFUSED,
        parameters=_parameters(fit, step.effect),
        chi2=step.fall,
        held_out_gain=float(step.gain.sum()),
        held_out_std=_spread(step.gain),
        rms_mps2=_size(fit, step.effect),
        reason=reason,
        summary=step.effect.summary,
        equation=step.effect.equation,
    )


def findings_of(
    selection: Selection, data: Whitened, effects: Mapping[str, AngleEffect]
) -> tuple[list[Finding], list[tuple[Fit, ...]]]:
    """Return the finding of every effect with evidence, and for every undecided one the fits of its confounders."""
    found, undecided = [], []
    final = selection.final
    for step in selection.steps:
        fits = rivals_of(final, step.effect, effects, data)
        rivals = tuple(fits)
        if fits:
            undecided.append(tuple(fits.values()))
        found.append(_added(final, step, data, rivals, _decide_with(final, step.effect, rivals, effects, data)))
    for name, (reason, fall, gain, fit) in selection.refused.items():
        found.append(
            Finding(
                name=name,
                verdict=Verdict.REFUSED,
                parameters=_parameters(fit, effects[name]),
                chi2=fall,
                held_out_gain=float(gain.sum()),
                held_out_std=_spread(gain),
                rms_mps2=_size(fit, effects[name]),
                reason=reason,
                summary=effects[name].summary,
                equation=effects[name].equation,
            )
        )
    return found, undecided


def _decide_with(
    final: Fit, effect: AngleEffect, rivals: tuple[str, ...], effects: Mapping[str, AngleEffect], data: Whitened
) -> Reason | None:
    """Return the recording that would distinguish an effect from a confounder, preferably from the clock.

    The clock needs no fit: a recording with the host's time measures it independently of other effects.
    """
    if not rivals:
        return None
    rival = CLOCK if CLOCK in rivals else rivals[0]
    recording = deciding_recording(final, effect, effects[rival], data)
    return Reason(Code.DECIDES_AGAINST, effect=rival, recording=recording) if len(rivals) > 1 else recording


def _added(final: Fit, step: Step, data: Whitened, rivals: tuple[str, ...], decide_with: Reason | None) -> Finding:
    before, _ = estimates_of(step.before, data)
    after, _ = estimates_of(step.after, data)
    return Finding(
        name=step.effect.name,
        verdict=Verdict.INDISTINGUISHABLE if rivals else Verdict.NAMED,
        parameters=_parameters(final, step.effect),
        chi2=step.fall,
        held_out_gain=float(step.gain.sum()),
        held_out_std=_spread(step.gain),
        rms_mps2=_size(final, step.effect),
        rms_before_mps2=_rms(step.before),
        rms_after_mps2=_rms(step.after),
        estimates=before_and_after(before, after),
        rivals=rivals,
        decide_with=decide_with,
        summary=step.effect.summary,
        equation=step.effect.equation,
    )


def _spread(gain: FloatArray) -> float:
    """Return the standard error of a sum over folds; NaN for a single fold."""
    return acceptance.spread(gain) if np.count_nonzero(gain) > 1 else float("nan")


def _parameters(fit: Fit, effect: AngleEffect) -> dict[str, Fitted]:
    where = fit.model.layout.effect(effect.name)
    std = np.sqrt(np.diagonal(fit.covariance()))[where]
    found = {}
    for parameter, value, error in zip(effect.parameters, fit.vector[where], std, strict=True):
        found[parameter.name] = fitted_parameter(parameter, float(value), float(error))
    return found


def fitted_parameter(parameter: Parameter, value: float, std: float) -> Fitted:
    """Return a parameter's value in SI, with its display unit."""
    shown = parameter.factor, parameter.display_unit, parameter.inverse_display
    # A whole number is tried, not fitted: it has no error.
    return Fitted(value, 0.0 if parameter.whole else std, parameter.unit, *shown)


def _size(fit: Fit, effect: AngleEffect) -> float:
    """Return the rms of an effect's contribution over the groups, on the axis where it is largest."""
    every = added_by(fit, effect)
    total = sum(np.asarray((POWER_SHARE * np.abs(added[0]) ** 2).sum(axis=1)) for added in every)
    return math.sqrt(float(np.max(total)) / len(every))


def _rms(fit: Fit) -> float:
    """Return the rms of a fit's error on held-out folds."""
    total, count = 0.0, 0
    for error, rows in zip(held_out_residuals(fit), fit.rows, strict=True):
        total += float((POWER_SHARE * np.abs(error) ** 2).sum())
        count += int((rows.weight > 0.0).any(axis=2).sum())
    return math.sqrt(total / max(count, 1))
