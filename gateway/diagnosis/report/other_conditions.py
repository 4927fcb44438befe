"""Effects judged on recordings that they have not seen.

This rests on the linearised fits of the model without and with the effect: the tire's own parameters and the contact's
centre of a recording are always fitted to it anew, the effect's are those of the other recordings.
"""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from gateway.core.constants import AXIS_NAMES
from gateway.core.reasons import Reason
from gateway.core.types import ComplexArray, FloatArray, IntArray
from gateway.diagnosis.angle.fit import Fit
from gateway.diagnosis.angle.likelihood import Whitened, as_complex
from gateway.diagnosis.angle.residual import POWER_SHARE, group_residuals
from gateway.diagnosis.data.condition_groups import has_other_conditions
from gateway.diagnosis.effects.angle_orders import ORDERS
from gateway.diagnosis.effects.effect import SignalEffect
from gateway.diagnosis.reasons import DiagnosisCode
from gateway.diagnosis.report.findings import sizes_of
from gateway.diagnosis.report.one_size import recordings_of
from gateway.diagnosis.result import Finding, Fitted, UnseenError, Verdict

RISE: Final = 1.02
"""Ratio by which the error of an axis may rise on a recording that the effect has not seen: what noise alone makes."""
FALL: Final = 0.6
"""Share of the power beyond noise that may be left of such a recording on one axis at least."""
TESTABLE: Final = 1.3
"""Power over that of the noise from which an axis of a recording tests an effect: noise alone reaches 1.2."""
SEEN: Final = 3.0
"""Power of an effect over what noise alone changes of it, from which an axis of a recording tests it: noise of three
standard deviations would hide it."""
CHANCE: Final = 2.0
"""Standard deviations of the noise that a share of power is given."""


def unseen_errors(before: Fit, after: Fit, data: Whitened, effect: SignalEffect) -> tuple[UnseenError, ...]:
    """Return the error of each recording without the effect, and with the effect that the others determine.

    Args:
        before: fit of the model without the effect.
        after: with it.
        data: whitened.
        effect: the effect.
    """
    indices = after.model.layout.effect(effect.name)
    errors = []
    recordings = recordings_of(after)
    for recording, groups in recordings.items():
        others = [index for index in range(len(data.orders)) if index not in groups]
        if not others or not has_other_conditions(after.model.campaign.groups, recording):
            continue
        free = np.concatenate([_own_parameters(after, others), np.arange(indices.start, indices.stop)])
        change = _step(after, data, others, free)
        effect_change = np.zeros_like(change)
        effect_change[indices] = change[indices]
        with_effect = after.moved(effect_change)
        remaining = [_own_residuals(fit, data, groups) for fit in (before, with_effect)]
        contribution = remaining[0] - remaining[1]
        noise = _noise(data, groups)
        square = [_mean_square(orders) for orders in (*remaining, contribution)]
        # The difference of |r|^2 and |r - s|^2 has the noise's share 2 Re r* s: a real coefficient has half of it each.
        fall_variance = (np.where(np.arange(ORDERS), 2.0, 4.0) * POWER_SHARE * np.abs(contribution) ** 2 * noise).sum(
            axis=(0, 2)
        ) / len(groups) ** 2
        count = (np.where(np.arange(ORDERS), 2, 1) * (noise > 0.0)).sum(axis=(0, 2))
        rms = np.sqrt(noise.sum(axis=2).mean(axis=0))
        for axis, name in enumerate(AXIS_NAMES):
            if rms[axis] > 0.0:
                errors.append(
                    UnseenError(
                        recording,
                        name,
                        math.sqrt(float(square[0][axis])),
                        math.sqrt(float(square[1][axis])),
                        float(rms[axis]),
                        math.sqrt(float(square[2][axis])),
                        math.sqrt(float(fall_variance[axis])),
                        int(count[axis]),
                    )
                )
    return tuple(errors)


def _own_residuals(fit: Fit, data: Whitened, groups: Sequence[int]) -> ComplexArray:
    """Return what is left of these groups, (groups, 3, ORDERS), their own parameters fitted to them."""
    updated = fit.moved(_step(fit, data, groups, _own_parameters(fit, groups)))
    return np.stack([as_complex(updated.residual[index]) * data.used[index] for index in groups])


def _mean_square(orders: ComplexArray) -> FloatArray:
    """Return the mean square of waveforms (groups, 3, ORDERS) over the groups, (3,)."""
    result: FloatArray = (POWER_SHARE * np.abs(orders) ** 2).sum(axis=2).mean(axis=0)
    return result


def _noise(data: Whitened, groups: Sequence[int]) -> FloatArray:
    """Return the mean square of the noise of each order of these groups' means, (groups, 3, ORDERS)."""
    result = np.zeros((len(groups), *data.used[0].shape))
    for number, index in enumerate(groups):
        square = np.square(data.weights[index]).sum(axis=0)
        present = square > 0.0
        result[number][present] = 1.0 / square[present]
    return result


def _own_parameters(fit: Fit, groups: Collection[int]) -> IntArray:
    """Return the places of the tire's own parameters and the contact's centres in these groups."""
    layout = fit.model.layout
    states = sorted({fit.model.campaign.groups[index].state for index in groups})
    places = [np.arange(layout.state(state).start, layout.state(state).stop) for state in states]
    return np.concatenate([*places, np.array([layout.centre(index) for index in groups], dtype=np.intp)])


def _step(fit: Fit, data: Whitened, groups: Sequence[int], free: IntArray) -> FloatArray:
    """Return the change of all parameters by the data of these groups, (P,).

    By the scatter alone, widened by the misfit.
    """
    size = len(free)
    gram, slope, misfit, count = np.zeros((size, size)), np.zeros(size), 0.0, 0
    for index in groups:
        rows = fit.rows[index][free]
        weighted = np.matmul(rows.swapaxes(0, 1), data.precisions[index]).swapaxes(0, 1).reshape(size, -1)
        residual = fit.residual[index]
        gram += weighted @ rows.reshape(size, -1).T
        slope += weighted @ residual.reshape(-1)
        misfit += float(np.einsum("an,anm,am->", residual, data.precisions[index], residual))
        count += sum(len(factor) for factor in data.factors[index])
    prior = fit.prior_precision[np.ix_(free, free)]
    deviation = (fit.vector - fit.prior_mean)[free]
    scale = 1.0
    for _ in range(2):
        covariance: FloatArray = np.asarray(np.linalg.inv(gram / scale + prior), dtype=np.float64)
        change = covariance @ (slope / scale - prior @ deviation)
        remaining_misfit = misfit - 2.0 * float(change @ slope) + float(change @ gram @ change)
        scale = max(1.0, remaining_misfit / max(1, count - size))
    full_change = np.zeros(len(fit.vector))
    full_change[free] = change
    return full_change


def judged_elsewhere(
    findings: Sequence[Finding], fit: Fit, without: Mapping[str, Fit], data: Whitened
) -> list[Finding]:
    """Reject identified effects that need recordings of other conditions, if these contradict them or none can test.

    The error of a size that stays contains what is left: an equation of first order may owe all of it.

    Args:
        findings: of effects.
        fit: of the best set.
        without: fit of the best set without each effect, by name.
        data: whitened.
    """
    judged = []
    for finding in findings:
        effect = next((effect for effect in fit.model.effects if effect.name == finding.name), None)
        if isinstance(effect, SignalEffect) and effect.needs_other_conditions and finding.verdict is Verdict.NAMED:
            unseen = unseen_errors(without[effect.name], fit, data, effect)
            reasons = reasons_against(fit.model.campaign.recordings, unseen)
            finding = (
                replace(finding, verdict=Verdict.REFUSED, reason=reasons[0])
                if reasons
                else replace(finding, parameters=_beside_residual(finding.parameters, effect, fit, data))
            )
        judged.append(finding)
    return judged


def _beside_residual(
    parameters: Mapping[str, Fitted], effect: SignalEffect, fit: Fit, data: Whitened
) -> dict[str, Fitted]:
    """Return parameters whose sizes have the share in their errors that is left of the effect's axes beyond noise."""
    axes = list(effect.axes)
    size_mps2 = float(np.linalg.norm(sizes_of(fit, effect)[axes]))
    if not size_mps2 > 0.0:
        # Without a size there is nothing of which the residual could be a share.
        return dict(parameters)
    residuals = [np.square(residual.rms_mps2()[axes]).sum() for residual in group_residuals(fit, data)]
    share = math.sqrt(float(np.mean(residuals))) / size_mps2
    sizes = {parameter.name for parameter in effect.parameters[: effect.sizes]}
    return {
        name: replace(fitted, std=math.hypot(fitted.std, share * fitted.value)) if name in sizes else fitted
        for name, fitted in parameters.items()
    }


def reasons_against(recordings: Sequence[str], unseen: Sequence[UnseenError]) -> list[Reason]:
    """Return why recordings that the effect has not seen speak against it, or that none can test it."""
    for error in unseen:
        if error.after_mps2 > RISE * max(error.before_mps2, error.noise_mps2):
            return [_unseen_reason(recordings, error)]
    # Where hardly more than noise is left, and less of the law, there is nothing to fall.
    above = [error for error in unseen if _is_above(error) or error.contribution_mps2**2 > SEEN * error.fall_std > 0.0]
    if not above:
        return [Reason(DiagnosisCode.UNTESTED_ELSEWHERE)]
    for recording in dict.fromkeys(error.recording for error in above):
        of_recording = [error for error in above if error.recording == recording]
        if min(_excess_left(error) for error in of_recording) > FALL:
            return [_unseen_reason(recordings, min(of_recording, key=_excess_left))]
    return []


def _is_above(error: UnseenError) -> bool:
    """Return whether more than noise is left without the effect."""
    return error.before_mps2**2 > TESTABLE * error.noise_mps2**2


def _excess_left(error: UnseenError) -> float:
    """Return the share that an effect leaves of the larger of two powers: that surely beyond noise, and its own."""
    noise, fall = error.noise_mps2**2, error.before_mps2**2 - error.after_mps2**2
    # The power beyond noise is not known better than the power of the noise, which may hide it where coefficients are
    # few; half of the least power that tests an effect is then the measure.
    excess = error.before_mps2**2 - noise - CHANCE * math.sqrt(2.0 / error.coefficients) * noise
    least_power = 0.5 * (TESTABLE - 1.0) * noise if _is_above(error) else 0.0
    return 1.0 - fall / max(excess, error.contribution_mps2**2, least_power)


def _unseen_reason(recordings: Sequence[str], error: UnseenError) -> Reason:
    return Reason(
        DiagnosisCode.FAILS_UNSEEN,
        recording=recordings[error.recording],
        axis=error.axis,
        before_mps2=error.before_mps2,
        after_mps2=error.after_mps2,
    )
