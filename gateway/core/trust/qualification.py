"""What is known against estimates lowers their status: the only place that applies it, by what each rests on."""

import math
from collections import deque
from collections.abc import Iterable, Sequence
from functools import lru_cache
from typing import Final

from gateway.core.estimates.doubt_rules import EVERY_RULE, DoubtRule
from gateway.core.estimates.estimator import Estimate, Revolution, Status, estimate_of
from gateway.core.estimates.wheel_setup import WheelSetup
from gateway.core.quantity import Basis
from gateway.core.quantity_catalogue import quantities_of, quantity_of
from gateway.core.reasons import Reason
from gateway.core.trust.lost_revolutions import SteadyStatus
from gateway.core.trust.reasons import TrustCode
from gateway.core.trust.sensor_limits import Doubt
from gateway.core.trust.signal_evidence import Contradiction, Evidence, Subject

# Standard errors beyond what is possible from which a value is not one of its quantity. Many a true value is zero, and
# one in 160 is so far below it by chance. None is at another limit.
_ZERO_TOLERANCE: Final = 2.5
_LIMIT_TOLERANCE: Final = 1.0
# Statements that scale all numbers of the ring, and that no signal contradicts.
_SCALINGS: Final = (Basis.LOAD, Basis.PRESSURE)
# Lag of an average over its change within its memory. A mean of all is behind by half of a steady drift, an exponential
# one by all of it.
_LAG: Final = 0.7
_SIGN_UNVERIFIED: Final = Reason(TrustCode.LATERAL_SIGN_UNVERIFIED)


class Qualification:
    """Qualifies the estimates of one estimator of a wheel; deterministic, one revolution at a time."""

    def __init__(self, estimator: str, setup: WheelSetup) -> None:
        """Start without revolutions."""
        self._rules = setup.rules
        quantities = () if setup.sensor.lateral_is_left else quantities_of(estimator)
        # Quantities whose sign nobody can know.
        self._signed_names = frozenset(quantity.name for quantity in quantities if Basis.SIGN in quantity.rests_on)
        self._drift = OwnDrift(estimator)
        self._follows_drift = self._drift.applies and DoubtRule.OWN_DRIFT in setup.rules
        self._status = SteadyStatus(estimator)

    def reset(self) -> None:
        """Forget everything, as after a change of tire."""
        self._drift.reset()
        self._status.reset()

    def of_block(
        self,
        estimates: Iterable[tuple[Estimate, ...]],
        revolutions: Sequence[Revolution],
        evidences: Sequence[Evidence],
        doubts: Sequence[Sequence[Doubt]],
        streaks: Sequence[float],
    ) -> list[tuple[Estimate, ...]]:
        """Return the estimates of consecutive revolutions, of the status and the error that all that is known leaves.

        Args:
            estimates: of each revolution.
            revolutions: in order.
            evidences: of the signal on what is stated, at each.
            doubts: about the sensor in each.
            streaks: of each, as `LossStreak.take` returns it.
        """
        finals = []
        for index, raw in enumerate(estimates):
            final = qualified(raw, evidences[index], doubts[index], revolutions[index].uncorrected, self._rules)
            if self._signed_names:
                final = _with_sign_note(final, self._signed_names)
            if self._follows_drift:
                final = self._drift.widened(final)
            finals.append(self._status.steadied(final, streaks[index]))
        return finals


class OwnDrift:
    """Error of the estimates of one estimator by their own drift: an average is behind what it follows."""

    def __init__(self, estimator: str) -> None:
        """Start without estimates."""
        self._memory = {
            quantity.name: quantity.memory_revolutions
            for quantity in quantities_of(estimator)
            if quantity.memory_revolutions
        }
        self.applies = bool(self._memory)
        self.reset()

    def reset(self) -> None:
        """Forget everything, as after a change of tire."""
        self._valid: dict[str, deque[float]] = {name: deque(maxlen=count) for name, count in self._memory.items()}

    def widened(self, estimates: tuple[Estimate, ...]) -> tuple[Estimate, ...]:
        """Return the estimates of the next revolution, with the error by what they have changed in their memory.

        The change is counted from the oldest valid value within it.
        """
        valid, hypot = self._valid, math.hypot
        widened = list(estimates)
        for index, (name, value, std, status, reasons, scatter_std) in enumerate(estimates):
            if status is Status.VALID and name in valid:
                values = valid[name]
                values.append(value)
                std_with_lag = hypot(std, _LAG * (value - values[0]))
                widened[index] = estimate_of((name, value, std_with_lag, status, reasons, scatter_std))
        return tuple(widened)


def qualified(
    estimates: tuple[Estimate, ...],
    evidence: Evidence,
    doubts: Iterable[Doubt],
    uncorrected: Reason | None,
    rules: frozenset[DoubtRule] = EVERY_RULE,
) -> tuple[Estimate, ...]:
    """Return the estimates of an estimator, of the status that all that is known leaves them.

    Args:
        estimates: of one revolution.
        evidence: of the signal on what is stated.
        doubts: about the sensor.
        uncorrected: why known effects were not subtracted; None where they were, or where none is known.
        rules: those that apply.
    """
    if uncorrected is not None:
        reason = Reason(TrustCode.EFFECTS_NOT_SUBTRACTED, why=uncorrected)
        estimates = provisional_where(estimates, Basis.WAVEFORM, reason)
    if evidence.says_anything:
        estimates = tuple(evidence.qualified(estimate) for estimate in estimates)
    for doubt in doubts if DoubtRule.SENSOR_LIMITS in rules else ():
        estimates = provisional_where(estimates, *doubt)
    for name, value, _, _, _, _ in estimates if DoubtRule.POSSIBLE in rules else ():
        minimum, maximum = _range_of(name)
        # Hardly ever; not a number is not beyond them.
        if value < minimum or value > maximum:
            return _check_plausibility(estimates)
    return estimates


def provisional_where(
    estimates: Iterable[Estimate], basis: Basis | None, why: Reason, share: float = 0.0
) -> tuple[Estimate, ...]:
    """Return estimates of which those that rest on something are provisional at best, with the reason.

    Args:
        estimates: of one revolution.
        basis: on which an estimate rests; None for every one.
        why: the reason.
        share: of its value, by which its error grows.
    """
    return tuple(
        provisional(estimate, why, share) if basis is None or basis in quantity_of(estimate.name).rests_on else estimate
        for estimate in estimates
    )


def verified(estimates: Iterable[Estimate]) -> tuple[Estimate, ...]:
    """Return estimates without the note that their sign is not verified."""
    return tuple(
        estimate._replace(reasons=tuple(reason for reason in estimate.reasons if reason != _SIGN_UNVERIFIED))
        if _SIGN_UNVERIFIED in estimate.reasons
        else estimate
        for estimate in estimates
    )


def _with_sign_note(estimates: tuple[Estimate, ...], names: frozenset[str]) -> tuple[Estimate, ...]:
    """Return estimates with the note that the sign of those of the names is not verified, if they are not invalid."""
    return tuple(
        [
            estimate_of((name, value, std, status, (*reasons, _SIGN_UNVERIFIED), scatter_std))
            if name in names and status is not Status.INVALID
            else estimate
            for estimate in estimates
            for name, value, std, status, reasons, scatter_std in (estimate,)
        ]
    )


@lru_cache(maxsize=1024)
def _range_of(name: str) -> tuple[float, float]:
    """Return the least and the greatest possible value of a quantity."""
    return quantity_of(name).possible


def _check_plausibility(estimates: tuple[Estimate, ...]) -> tuple[Estimate, ...]:
    """Return estimates, provisional at best where no tire, sensor or road can have their values.

    Load or pressure that are wrong explain numbers that no tire has, and change all that they scale. What they do not
    scale is of a signal that no belt has, on whose shape the others rest as well.
    """
    causes: list[Contradiction] = []
    marked: list[Estimate] = []
    waveform_reason: Reason | None = None
    for estimate in estimates:
        reason = _impossible(estimate)
        marked.append(estimate if reason is None else provisional(estimate, reason))
        powers = quantity_of(estimate.name).powers
        if reason is not None and not powers and Basis.WAVEFORM in quantity_of(estimate.name).rests_on:
            waveform_reason = reason
        if reason is not None and any(cause in powers for cause in _SCALINGS):
            minimum, maximum = _range_of(estimate.name)
            limit = min(max(estimate.value, minimum), maximum)
            ratio = limit / estimate.value if estimate.value else 0.0
            ratios = {cause: ratio ** (1.0 / powers[cause]) for cause in _SCALINGS if ratio > 0.0 and cause in powers}
            causes.append(Contradiction(Subject.CONDITIONS, reason, ratios))
    if waveform_reason is not None:
        marked = [*provisional_where(marked, Basis.WAVEFORM, waveform_reason)]
    if not causes:
        return tuple(marked)
    evidence = Evidence.of_contradictions(tuple(causes))
    return tuple(
        estimate if estimate.reasons and _impossible(estimate) else evidence.qualified(estimate) for estimate in marked
    )


def _impossible(estimate: Estimate) -> Reason | None:
    """Return that no tire, sensor or road can have the value of an estimate; None where one can."""
    if estimate.status is Status.INVALID:
        return None
    minimum, maximum = _range_of(estimate.name)
    is_below = estimate.value < minimum
    excess, limit = (minimum - estimate.value, minimum) if is_below else (estimate.value - maximum, maximum)
    if not excess > 0.0 or excess <= (_LIMIT_TOLERANCE if limit else _ZERO_TOLERANCE) * estimate.std:
        return None
    quantity = quantity_of(estimate.name)
    return Reason(TrustCode.NOT_POSSIBLE, quantity=quantity.label or quantity.name)


def provisional(estimate: Estimate, why: Reason, share: float = 0.0) -> Estimate:
    """Return an estimate that is provisional at best, with the reason, and a share of its value in its error."""
    status = Status.PROVISIONAL if estimate.status is Status.VALID else estimate.status
    if any(why in reason for reason in estimate.reasons):
        return estimate._replace(status=status)  # inherited from the estimate that this one is made of
    std = math.hypot(estimate.std, share * estimate.value) if share else estimate.std
    return estimate._replace(std=std, status=status, reasons=(*estimate.reasons, why))
