"""Statuses that do not flicker: of averages through loss, and of values that noise moves about a limit.

A link that loses samples is not the tire's, and a value that is determined now is so in the next revolution.
"""

import math
from typing import Final

from gateway.core.contacts.contact_timing import MOST_UNSEEN
from gateway.core.estimates.estimator import DETERMINED, OF_LOSS, Estimate, Revolution, Status
from gateway.core.estimates.reasons import EstimateCode
from gateway.core.quantity_catalogue import quantities_of
from gateway.core.reasons import Code, CoreCode
from gateway.core.trust.reasons import TrustCode

# They say what an error contains, and lower no status.
_NOTES: Final = frozenset(
    {
        TrustCode.HUB_MOVES,
        EstimateCode.LOADS_DISAGREE,
        EstimateCode.SCALE_BY_WIDTH,
        TrustCode.STEADY_VALUE_DISAGREES,
        EstimateCode.WEARS_DISAGREE,
        EstimateCode.WIDTH_DISAGREES,
    }
)
# Reasons by a limit of the standard error, and the standard errors by which a steady value moves about that limit: an
# average follows its own noise within its memory, most of which both values of a comparison share.
_NOT_DETERMINED: Final = frozenset(
    {
        CoreCode.NOT_DETERMINED,
        TrustCode.FORCE_NOT_DETERMINED,
        CoreCode.MODEL_ERROR_SHARE,
        CoreCode.CORRELATED,
    }
)
_CHANCE_ERRORS: Final = 0.5
# Of an average whose memory is not declared.
_MEMORY_REVOLUTIONS: Final = 50


class LossStreak:
    """Measures how long loss alone has kept revolutions out of averages; deterministic.

    An average over M revolutions spans M n of them where loss leaves one in n. So the length of a streak is the number
    of revolutions that would have come into the average meanwhile.
    """

    def __init__(self) -> None:
        """Start without revolutions."""
        self.reset()

    def reset(self) -> None:
        """Forget everything, as after a change of tire."""
        self._streak = self._averaged_count = 0
        # Mean distance of those that are averaged, up to the latest.
        self._distance = 1.0

    def take(self, revolution: Revolution) -> float:
        """Take the next revolution; return the streak's length with it, 0 where it has another fault or none."""
        if revolution.faults and all(fault.code in OF_LOSS for fault in revolution.faults):
            self._streak += 1
            return self._streak / self._distance
        if not revolution.faults:
            self._averaged_count += 1
            weight = 1.0 / min(self._averaged_count, _MEMORY_REVOLUTIONS)
            self._distance += weight * (self._streak + 1.0 - self._distance)
        self._streak = 0
        return 0.0


class SteadyStatus:
    """Keeps the statuses of one estimator steady; deterministic, one revolution at a time.

    An average stays valid through revolutions that only loss kept out of it, as long as its memory. What follows
    driving, such as the load by the contact angle, does so as long as the edges of an earlier contact. A value that was
    determined stays so until it is beyond the limit by more than chance. Every other reason lowers the status at once.
    """

    def __init__(self, estimator: str) -> None:
        """Start without revolutions."""
        self._memory = {
            quantity.name: quantity.memory_revolutions or (_MEMORY_REVOLUTIONS if quantity.is_steady else MOST_UNSEEN)
            for quantity in quantities_of(estimator)
        }
        self.reset()

    def reset(self) -> None:
        """Forget everything, as after a change of tire."""
        self._previous: tuple[Estimate, ...] = ()

    def steadied(self, estimates: tuple[Estimate, ...], streak: float) -> tuple[Estimate, ...]:
        """Return the estimates of the next revolution with the status that they keep.

        Args:
            estimates: of the revolution.
            streak: how long loss alone has kept revolutions out of averages, as `LossStreak.take` returns it.
        """
        # Most revolutions lower nothing.
        lowered = [
            index
            for index, (estimate, prior) in enumerate(zip(estimates, self._previous, strict=False))
            if estimate.status is Status.PROVISIONAL and prior.status is Status.VALID
        ]
        if lowered:
            steady = list(estimates)
            for index in lowered:
                steady[index] = self._restored(estimates[index], self._previous[index], streak)
            estimates = tuple(steady)
        self._previous = estimates
        return estimates

    def _restored(self, estimate: Estimate, prior: Estimate, streak: float) -> Estimate:
        codes = {reason.code for reason in estimate.reasons}
        near_limit = _limit_codes(estimate)
        other_codes = (
            codes - {reason.code for reason in prior.reasons} - near_limit - _NOTES - {EstimateCode.REVOLUTION_NOT_USED}
        )
        is_unused = EstimateCode.REVOLUTION_NOT_USED in codes
        # Without either, a reason that a valid value has as well lowers the status, by its size, or none is stated.
        if other_codes or estimate.name != prior.name or not (near_limit or is_unused):
            return estimate
        std = estimate.std
        if is_unused:
            if not 0.0 < streak <= self._memory.get(estimate.name, MOST_UNSEEN):
                return estimate
            std = max(std, prior.std)
        reasons = estimate.reasons
        if near_limit:
            reasons = tuple([reason for reason in reasons if reason.code not in near_limit])
        return estimate._replace(std=std, status=Status.VALID, reasons=reasons)


def _limit_codes(estimate: Estimate) -> frozenset[Code]:
    """Return the codes of the reasons that say that a value is not determined, where it nearly is."""
    for reason in estimate.reasons:
        if reason.code is CoreCode.NOT_DETERMINED:
            limit_ratio = DETERMINED * _number(reason["relative_error"])
        elif reason.code is TrustCode.FORCE_NOT_DETERMINED:
            by_value = DETERMINED * estimate.std / abs(estimate.value) if estimate.value else math.inf
            limit_ratio = min(_number(reason["share"]) / _number(reason["limit"]), by_value)
        else:
            continue
        return _NOT_DETERMINED if 1.0 <= limit_ratio <= DETERMINED / (DETERMINED - _CHANCE_ERRORS) else frozenset()
    return frozenset()


def _number(value: object) -> float:
    return value if isinstance(value, float) else math.nan
