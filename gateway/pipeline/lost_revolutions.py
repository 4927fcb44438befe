"""Status of estimates through revolutions that lost samples: a link that loses some says nothing about the tire."""

from __future__ import annotations

from collections import deque
from typing import Final

from gateway.estimators.estimator import Estimate, Revolution, Status
from gateway.quantity_catalogue import quantities_of
from gateway.reasons import Code, Reason

_LOSSES: Final = frozenset({Code.SAMPLES_LOST, Code.CONTACT_INTERPOLATED})
# What a gap at an edge of the contact makes of it.
_OF_GAPS: Final = _LOSSES | {Code.CONTACT_HAS_NO_SLOPE, Code.CONTACT_IN_NOISE}
# Two thresholds, so that a link near one of them does not change the status with every revolution.
_WINDOW: Final = 16
_FREQUENT: Final = 12
_RARE: Final = 8
# Of an average whose memory is not declared.
_MEMORY_REVOLUTIONS: Final = 50


class LostRevolutions:
    """Follows the estimates of one estimator; deterministic, one revolution at a time.

    An average stays valid through revolutions that only loss kept out of it, as long as its memory. What is measured
    in each revolution alone is provisional while loss is frequent, and not only in the revolutions that lost samples.
    Every other reason lowers the status at once.
    """

    def __init__(self, estimator: str) -> None:
        """Start without revolutions."""
        self._memory = {quantity.name: quantity.memory_revolutions for quantity in quantities_of(estimator)}
        self.reset()

    def reset(self) -> None:
        """Forget everything, as after a change of tire."""
        self._recent: deque[bool] = deque(maxlen=_WINDOW)
        self._is_frequent = False
        self._streak = 0
        self._valid: dict[str, Estimate] = {}
        self._lowered: frozenset[str] = frozenset()
        self._lowered_before: frozenset[str] = frozenset()

    def steadied(self, estimates: tuple[Estimate, ...], revolution: Revolution) -> tuple[Estimate, ...]:
        """Return the estimates of the next revolution with the status that they keep through loss."""
        codes = [fault.code for fault in revolution.faults]
        is_lossy = bool(codes) and not _LOSSES.isdisjoint(codes) and _OF_GAPS.issuperset(codes)
        self._recent.append(is_lossy)
        lossy = sum(self._recent)
        self._is_frequent = lossy >= (_RARE if self._is_frequent else _FREQUENT)
        if is_lossy:
            self._streak += 1
            estimates = tuple(map(self._held, estimates))
            lowered = frozenset(
                estimate.name
                for estimate in estimates
                if any(reason.code in _LOSSES for reason in estimate.reasons) and estimate.status is not Status.VALID
            )
            # Twice in a row: what one gap happens to hit is not what loss hits.
            self._lowered, self._lowered_before = lowered & self._lowered_before, lowered
        else:
            self._streak = 0
            if self._is_frequent and self._lowered:
                reason = Reason(Code.LOSS_FREQUENT, lossy=lossy, revolutions=len(self._recent))
                estimates = tuple([self._provisional(estimate, reason) for estimate in estimates])
        self._valid = {estimate.name: estimate for estimate in estimates if estimate.status is Status.VALID}
        return estimates

    def _held(self, estimate: Estimate) -> Estimate:
        before = self._valid.get(estimate.name)
        if before is None or estimate.status is not Status.PROVISIONAL:
            return estimate
        memory = self._memory.get(estimate.name) or _MEMORY_REVOLUTIONS
        codes = {reason.code for reason in estimate.reasons} - {reason.code for reason in before.reasons}
        if codes | {Code.REVOLUTION_NOT_USED} != {Code.REVOLUTION_NOT_USED} or self._streak > memory:
            return estimate
        return estimate._replace(std=max(estimate.std, before.std), status=Status.VALID)

    def _provisional(self, estimate: Estimate, reason: Reason) -> Estimate:
        if estimate.status is not Status.VALID or estimate.name not in self._lowered:
            return estimate
        return estimate._replace(status=Status.PROVISIONAL, reasons=(*estimate.reasons, reason))
