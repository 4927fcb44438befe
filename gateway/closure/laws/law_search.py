"""Search for a law where something angle-locked is unexplained: scan, finite fits, and the conditions of a name.

A law is certain only if

1. its evidence, divided by the rms that it leaves over that of the noise, exceeds the price of the library and of a
   stand-in by ln 99;
2. it explains half of the power beyond noise that was left;
3. on recordings of another speed, load or pressure the error falls with the law that the others determine, and rises on
   no axis;
4. the sizes that single recordings give agree;
5. its values are possible, and no other law has nearly the same evidence.

One that fails any but the first, and explains a quarter, is a clue. A law that no recording can test is a clue too.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from gateway.closure.effects.effect import BaselineModel
from gateway.closure.inference import criteria
from gateway.closure.inference.effect_contribution import added_by
from gateway.closure.inference.fit import Fit, FitFailedError, fit_model
from gateway.closure.inference.hold_out import hold_out
from gateway.closure.inference.likelihood import Whitened
from gateway.closure.inference.posterior import Posterior
from gateway.closure.inference.residual import POWER_SHARE, group_residuals, residual_ratio
from gateway.closure.inference.set_evidence import Evaluated, evaluate, log_evidence
from gateway.closure.laws.law import Law
from gateway.closure.laws.library import library
from gateway.closure.laws.profile_scan import ProfileScan, Promise
from gateway.closure.laws.unseen_recordings import single_sizes, unseen_errors
from gateway.closure.model.baseline import NoShapeError
from gateway.closure.model.closure_model import ClosureModel
from gateway.closure.model.sensor_signal import THETA, orders_field
from gateway.closure.result import Fitted, HeldOut, LawCurves, LawSize, UnseenError
from gateway.closure.result import Law as ProposedLaw
from gateway.constants import AXIS_NAMES
from gateway.reasons import Code, Reason
from gateway.types import FloatArray

LEAST_SHARE: Final = 0.5
"""Share of the power left beyond noise that a law must explain."""
CLUE_SHARE: Final = 0.25
"""Share that a clue must explain."""
RISE: Final = 1.02
"""Ratio by which the error of an axis may rise on a recording that the law has not seen: what noise alone makes."""
FALL: Final = 0.6
"""Share of the power beyond noise that may be left of such a recording on one axis at least."""
TESTABLE: Final = 1.3
"""Power over that of the noise from which an axis of a recording tests a law: noise alone reaches 1.2."""
SIZES_APART: Final = 0.1
"""Relative difference of sizes of single recordings, beyond two errors, at which a law is another thing: right ones
differ by 2 %, wrong ones by 17 % and more."""
RIVAL: Final = 5.0
"""Difference of log evidence below which another law explains the same as well."""

# Power beyond noise, over the noise's, below which nothing is worth a law.
_LEAST_LEFT: Final = 0.05
# Places that the evidence has not paid for: narrow peaks in the widths.
_CHOICES: Final = 10.0
_FITTED: Final = 3
_WORTH: Final = 0.5
# Rounds of a fit, each with the belt's response at the end of the one before, its steps, and the change of the tire's
# logarithms that is not worth another one.
_ROUNDS: Final = 3
_STEPS: Final = 8
_SETTLED: Final = 0.01
# A size whose error is a larger share of it says nothing.
_KNOWN_SIZE: Final = 0.3


@dataclass(frozen=True)
class _Tried:
    """A law in the model.

    Attributes:
        law: the law.
        set: the set with it, with its evidence.
        ratio: power that it leaves over that of the noise.
    """

    law: Law
    set: Evaluated
    ratio: float

    def gain(self, base: Evaluated) -> float:
        """Return the gain of log evidence, prior odds left out."""
        mine = self.set.log_evidence - self.set.log_prior_odds
        return mine - (base.log_evidence - base.log_prior_odds)


@dataclass(frozen=True)
class LawsFound:
    """What a search has found.

    Attributes:
        laws: a law or a clue; empty for nothing.
        fit: of the model with the law, None where none is certain.
    """

    laws: tuple[ProposedLaw, ...] = ()
    fit: Fit | None = None


def propose_laws(
    base: Evaluated,
    data: Whitened,
    expired: Callable[[], bool] = lambda: False,
    laws: Sequence[Law] | None = None,
) -> LawsFound:
    """Return the law for what a set leaves, or a clue to one, or nothing.

    Args:
        base: the best set of effects.
        data: whitened.
        expired: True when the time is over; what has been fitted by then is judged.
        laws: to try; None for the library.
    """
    before = residual_ratio(base.fit, data)
    if before - 1.0 < _LEAST_LEFT or base.fit.model.core.model is not BaselineModel.EXACT:
        return LawsFound()
    # The evidence of the posterior's sets is divided by what they leave; that of a law is not yet.
    base = replace(base, log_evidence=log_evidence(base.fit))
    tried = list(laws if laws is not None else library().values())
    try:
        promises = ProfileScan(base.fit).promises(tried)
    except (NoShapeError, np.linalg.LinAlgError):
        return LawsFound()
    price = math.log(len(tried) * _CHOICES) - math.log(criteria.STAND_IN_ODDS)
    worth = max(price, _WORTH * promises[0].gain) if promises else math.inf
    fitted: list[_Tried] = []
    for promise in promises[:_FITTED]:
        if promise.gain < worth or (fitted and expired()):
            break
        candidate = _fitted(base, data, promise)
        if candidate is not None:
            fitted.append(candidate)
    if not fitted:
        return LawsFound()
    best = max(fitted, key=lambda candidate: candidate.gain(base))
    return _judged(base, data, best, fitted, before, price)


def _fitted(base: Evaluated, data: Whitened, promise: Promise) -> _Tried | None:
    """Return a law fitted with everything else, None where that fails."""
    law, fit = promise.law, base.fit
    if fit.applied is None:
        return None
    model = ClosureModel(fit.model.campaign, fit.model.core, (*fit.model.effects, law))
    start = fit.model.layout.moved(fit.vector, model.layout)
    low = np.array([parameter.low for parameter in law.parameters])
    high = np.array([parameter.high for parameter in law.parameters])
    start[model.layout.effect(law.name)] = np.clip(promise.parameters, low, high)
    try:
        # Without the discrepancy, which stood for the law and would let the fit end beside it.
        states = model.layout.states
        for _ in range(_ROUNDS):
            first = fit_model(model, data, start, most_steps=_STEPS)
            apart = float(np.abs(first.vector - start)[states].max())
            start = first.vector
            if apart < _SETTLED:
                break
            law.renew()
        small = fit.applied.discrepancy.applied(criteria.SMALLER_DISCREPANCY * fit.applied.amplitudes)
        evaluated = evaluate(first, data, fit.applied.discrepancy, small)
    except (FitFailedError, NoShapeError, np.linalg.LinAlgError):
        return None
    return _Tried(law, evaluated, residual_ratio(evaluated.fit, data))


def _judged(
    base: Evaluated, data: Whitened, best: _Tried, fitted: Sequence[_Tried], before: float, price: float
) -> LawsFound:
    """Return the best law by what it is: certain, a clue, or nothing."""
    share = 1.0 - (best.ratio - 1.0) / (before - 1.0)
    log_odds = best.gain(base) / math.sqrt(best.ratio) - price
    if log_odds < -math.log(1.0 / criteria.NAMED - 1.0) or share < CLUE_SHARE:
        return LawsFound()
    fit = best.set.fit
    sizes = single_sizes(fit, data, best.law)
    unseen = unseen_errors(base.fit, fit, data, best.law)
    rivals = tuple(
        rival.law
        for rival in fitted
        if rival is not best and best.gain(base) - rival.gain(base) < RIVAL * math.sqrt(best.ratio)
    )
    reasons = [reason for name, reason in best.set.objections if name == best.law.name]
    if share < LEAST_SHARE:
        reasons.append(Reason(Code.LAW_LEAVES_MUCH, share=share))
    reasons += _against_unseen(fit.model.campaign.recordings, unseen)
    reasons += _against_sizes(fit.model.campaign.recordings, sizes)
    if rivals:
        reasons.append(Reason(Code.LAW_HAS_RIVALS, laws=tuple(rival.title for rival in rivals)))
    proposed = _told(base, data, best, sizes, tuple(dict.fromkeys(reasons)))
    proposed = replace(
        proposed, log_odds=log_odds, share=share, unseen=unseen, rivals=tuple(rival.name for rival in rivals)
    )
    if not proposed.certain:
        return LawsFound((proposed,))
    return LawsFound((replace(proposed, held_out=_held_out(base, best.set, data)),), fit)


def _against_unseen(recordings: Sequence[str], unseen: Sequence[UnseenError]) -> list[Reason]:
    """Return why recordings that the law has not seen speak against it, or that none can test it."""
    for error in unseen:
        if error.after_mps2 > RISE * max(error.before_mps2, error.noise_mps2):
            return [_unseen_reason(recordings, error)]
    # Where hardly more than noise is left there is nothing to fall.
    above = [error for error in unseen if error.before_mps2**2 > TESTABLE * error.noise_mps2**2]
    if not above:
        return [Reason(Code.LAW_UNTESTED)]
    for recording in dict.fromkeys(error.recording for error in above):
        of_recording = [error for error in above if error.recording == recording]
        if min(_excess_left(error) for error in of_recording) > FALL:
            return [_unseen_reason(recordings, min(of_recording, key=_excess_left))]
    return []


def _excess_left(error: UnseenError) -> float:
    """Return the share of the power beyond noise that a law leaves."""
    noise = error.noise_mps2**2
    return (error.after_mps2**2 - noise) / (error.before_mps2**2 - noise)


def _unseen_reason(recordings: Sequence[str], error: UnseenError) -> Reason:
    return Reason(
        Code.LAW_FAILS_UNSEEN,
        recording=recordings[error.recording],
        axis=error.axis,
        before_mps2=error.before_mps2,
        after_mps2=error.after_mps2,
    )


def _against_sizes(recordings: Sequence[str], sizes: Sequence[LawSize]) -> list[Reason]:
    """Return why the sizes of single recordings speak against a law."""
    determined = [size for size in sizes if size.std < _KNOWN_SIZE * abs(size.value)]
    if len(determined) < 2:
        return [Reason(Code.LAW_UNTESTED)]
    weights = np.array([size.std**-2.0 for size in determined])
    mean = float(weights @ [size.value for size in determined] / weights.sum())
    worst = max(determined, key=lambda size: abs(size.value - mean) - 2.0 * size.std)
    if abs(worst.value - mean) <= SIZES_APART * abs(mean) + 2.0 * worst.std:
        return []
    return [Reason(Code.LAW_SIZES_DIFFER, recording=recordings[worst.recording], ratio=worst.value / mean)]


def _told(
    base: Evaluated, data: Whitened, best: _Tried, sizes: Sequence[LawSize], reasons: tuple[Reason, ...]
) -> ProposedLaw:
    """Return the law with its parameters and its figure."""
    law, fit = best.law, best.set.fit
    where = fit.model.layout.effect(law.name)
    values = fit.vector[where]
    stds = np.sqrt(np.diagonal(fit.covariance)[where]) * _widening(sizes, law, values)
    stds[: law.sizes] = np.hypot(stds[: law.sizes], law.equation_share * np.abs(values[: law.sizes]))
    parameters = {
        parameter.name: Fitted(float(value), float(std), parameter.unit, parameter.factor, parameter.display_unit)
        for parameter, value, std in zip(law.parameters, values, stds, strict=True)
    }
    residuals, without = group_residuals(base.fit, data), added_by(fit, law)
    groups = fit.model.campaign.groups
    used = [axis for axis in law.axes if any(residual.variance[axis].any() for residual in residuals)]
    power = [float((POWER_SHARE * np.abs(orders[used]) ** 2).sum()) / max(len(used), 1) for orders in without]
    curves = tuple(
        LawCurves(
            group.label,
            THETA,
            orders_field(residual.orders_mps2),
            orders_field(np.where(residual.variance > 0.0, predicted - before, 0.0)),
        )
        for group, residual, predicted, before in zip(groups, residuals, fit.predicted, base.fit.predicted, strict=True)
    )
    return ProposedLaw(
        name=law.name,
        title=law.title,
        certain=not reasons,
        reasons=reasons,
        summary=law.summary,
        equation=law.equation,
        scaling=law.scaling,
        source=law.source,
        axes=tuple(AXIS_NAMES[axis] for axis in used),
        parameters=parameters,
        log_odds=math.nan,
        share=math.nan,
        rms_mps2=math.sqrt(float(np.mean(power))),
        sizes=tuple(sizes),
        curves=curves,
    )


def _widening(sizes: Sequence[LawSize], law: Law, values: FloatArray) -> float:
    """Return the ratio by which sizes of single recordings differ more than their errors, at least 1."""
    size = float(np.linalg.norm(values[: law.sizes]))
    determined = [law_size for law_size in sizes if law_size.std < _KNOWN_SIZE * abs(law_size.value)]
    if len(determined) < 2:
        return 1.0
    square = sum(((law_size.value - size) / law_size.std) ** 2 for law_size in determined) / (len(determined) - 1)
    return math.sqrt(max(1.0, square))


def _held_out(base: Evaluated, evaluated: Evaluated, data: Whitened) -> HeldOut:
    """Return the error on held-out revolutions without the law and with it."""
    without = replace(base, names=frozenset())
    pair = {evaluated.names: evaluated, without.names: without}
    masses = {evaluated.names: 1.0, without.names: 0.0}
    return hold_out(Posterior(pair, masses, masses, (evaluated,), (1.0,)), data).summary
