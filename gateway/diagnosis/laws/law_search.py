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

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from gateway.core.constants import AXIS_NAMES
from gateway.core.reasons import Code, Reason
from gateway.diagnosis import criteria
from gateway.diagnosis.angle.fit import Fit, FitFailedError
from gateway.diagnosis.angle.likelihood import Whitened
from gateway.diagnosis.angle.residual import POWER_SHARE, group_residuals, residual_ratio
from gateway.diagnosis.angle.set_evidence import Evaluated, evaluate, log_evidence
from gateway.diagnosis.bayes.parameter_estimates import fitted_parameter
from gateway.diagnosis.effects.angle_orders import THETA, orders_field
from gateway.diagnosis.effects.effect import BaselineModel, SignalEffect
from gateway.diagnosis.laws.library import library
from gateway.diagnosis.laws.unseen_recordings import reasons_against, single_sizes, unseen_errors, widening
from gateway.diagnosis.model.baseline import NoShapeError
from gateway.diagnosis.report.effect_contribution import added_by
from gateway.diagnosis.report.hold_out import hold_out
from gateway.diagnosis.result import HeldOut, LawCurves, LawSize
from gateway.diagnosis.result import Law as ProposedLaw
from gateway.diagnosis.search.profile_scan import ProfileScan, Promise, fitted_with
from gateway.diagnosis.search.tempered_posterior import Posterior

LEAST_SHARE: Final = 0.5
"""Share of the power left beyond noise that a law must explain."""
CLUE_SHARE: Final = 0.25
"""Share that a clue must explain."""
RIVAL: Final = 5.0
"""Difference of log evidence below which another law explains the same as well."""

# Places that the evidence has not paid for: narrow peaks in the widths.
_CHOICES: Final = 10.0
_FITTED: Final = 3
_WORTH: Final = 0.5


@dataclass(frozen=True)
class _Tried:
    """A law in the model.

    Attributes:
        law: the law.
        set: the set with it, with its evidence.
        ratio: power that it leaves over that of the noise.
    """

    law: SignalEffect
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
    laws: Sequence[SignalEffect] | None = None,
) -> LawsFound:
    """Return the law for what a set leaves, or a clue to one, or nothing.

    Args:
        base: the best set of effects.
        data: whitened.
        expired: True when the time is over; what has been fitted by then is judged.
        laws: to try; None for the library.
    """
    before = residual_ratio(base.fit, data)
    if before - 1.0 < criteria.WORTH_A_SCAN or base.fit.model.core.model is not BaselineModel.EXACT:
        return LawsFound()
    # The evidence of the posterior's sets is divided by what they leave; that of a law is not yet.
    base = replace(base, log_evidence=log_evidence(base.fit))
    tried = list(laws if laws is not None else library(without=base.names).values())
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
    applied = base.fit.applied
    fit = None if applied is None else fitted_with(promise, base.fit, data)
    if applied is None or fit is None:
        return None
    try:
        small = applied.discrepancy.applied(criteria.SMALLER_DISCREPANCY * applied.amplitudes)
        evaluated = evaluate(fit, data, applied.discrepancy, small)
    except (FitFailedError, np.linalg.LinAlgError):
        return None
    return _Tried(promise.effect, evaluated, residual_ratio(evaluated.fit, data))


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
    reasons += reasons_against(fit.model.campaign.recordings, unseen, sizes)
    if rivals:
        reasons.append(Reason(Code.LAW_HAS_RIVALS, laws=tuple(rival.title for rival in rivals)))
    proposed = _told(base, data, best, sizes, tuple(dict.fromkeys(reasons)))
    proposed = replace(
        proposed, log_odds=log_odds, share=share, unseen=unseen, rivals=tuple(rival.name for rival in rivals)
    )
    if not proposed.certain:
        return LawsFound((proposed,))
    return LawsFound((replace(proposed, held_out=_held_out(base, best.set, data)),), fit)


def _told(
    base: Evaluated, data: Whitened, best: _Tried, sizes: Sequence[LawSize], reasons: tuple[Reason, ...]
) -> ProposedLaw:
    """Return the law with its parameters and its figure."""
    law, fit = best.law, best.set.fit
    values, variances = fit.parameters_of(law.name)
    stds = np.sqrt(variances) * widening(sizes, law.sizes, values)
    parameters = {
        parameter.name: fitted_parameter(parameter, value, std)
        for parameter, value, std in zip(law.parameters, values.tolist(), stds.tolist(), strict=True)
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


def _held_out(base: Evaluated, evaluated: Evaluated, data: Whitened) -> HeldOut:
    """Return the error on held-out revolutions without the law and with it."""
    without = replace(base, names=frozenset())
    pair = {evaluated.names: evaluated, without.names: without}
    masses = {evaluated.names: 1.0, without.names: 0.0}
    return hold_out(Posterior(pair, masses, masses, (evaluated,), (1.0,)), data).summary
