"""What is known against estimates lowers their status: the only place that applies it, by what each rests on."""

import math
from collections.abc import Collection, Iterable
from functools import lru_cache
from typing import Final

from gateway.estimators.doubt_rules import EVERY_RULE, DoubtRule
from gateway.estimators.estimator import Estimate, Status, estimate_of
from gateway.estimators.signal_evidence import Evidence
from gateway.pipeline.sensor_limits import Doubt
from gateway.quantity import Basis
from gateway.quantity_catalogue import quantity_of
from gateway.reasons import Code, Reason

# Standard errors beyond what is possible from which a value is not one of its quantity: one in 160 by chance.
_BEYOND: Final = 2.5


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
        why = Reason(Code.EFFECTS_NOT_SUBTRACTED, why=uncorrected)
        estimates = provisional_where(estimates, Basis.WAVEFORM, why)
    if evidence.says_anything:
        estimates = tuple(evidence.qualified(estimate) for estimate in estimates)
    for doubt in doubts if DoubtRule.SENSOR_LIMITS in rules else ():
        estimates = provisional_where(estimates, *doubt)
    for name, value, _, _, _, _ in estimates if DoubtRule.POSSIBLE in rules else ():
        least, greatest = _range_of(name)
        # Hardly ever; not a number is not beyond them.
        if value < least or value > greatest:
            return tuple(map(_possible, estimates))
    return estimates


def provisional_where(
    estimates: Iterable[Estimate], basis: Basis, why: Reason, share: float = 0.0
) -> tuple[Estimate, ...]:
    """Return estimates of which those that rest on something are provisional at best, with the reason.

    Args:
        estimates: of one revolution.
        basis: on which an estimate rests.
        why: the reason.
        share: of its value, by which its error grows.
    """
    return tuple(
        provisional(estimate, why, share) if basis in quantity_of(estimate.name).rests_on else estimate
        for estimate in estimates
    )


def noted(estimates: tuple[Estimate, ...], names: Collection[str], note: Reason) -> tuple[Estimate, ...]:
    """Return estimates with a note on those of the names that are not invalid."""
    return tuple(
        [
            estimate_of((name, value, std, status, (*reasons, note), scatter_std))
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


def _possible(estimate: Estimate) -> Estimate:
    """Return an estimate, provisional at best where no tire, sensor or road can have its value."""
    if estimate.status is Status.INVALID:
        return estimate
    least, greatest = quantity_of(estimate.name).possible
    beyond = max(least - estimate.value, estimate.value - greatest)
    if not beyond > 0.0 or beyond <= _BEYOND * estimate.std:
        return estimate
    if not estimate.std > 0.0:
        return provisional(estimate, Reason(Code.NOT_POSSIBLE_AT_ALL))
    return provisional(estimate, Reason(Code.NOT_POSSIBLE, errors=beyond / estimate.std))


def provisional(estimate: Estimate, why: Reason, share: float = 0.0) -> Estimate:
    """Return an estimate that is provisional at best, with the reason, and a share of its value in its error."""
    status = Status.PROVISIONAL if estimate.status is Status.VALID else estimate.status
    if any(why in reason for reason in estimate.reasons):
        return estimate._replace(status=status)  # inherited from the estimate that this one is made of
    std = math.hypot(estimate.std, share * estimate.value) if share else estimate.std
    return estimate._replace(std=std, status=status, reasons=(*estimate.reasons, why))
