"""Status of estimates through revolutions that lost samples: a link that loses some says nothing about the tire."""

from __future__ import annotations

from collections import deque
from typing import Final, NamedTuple

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


class Loss(NamedTuple):
    """What a link has lost at a revolution.

    Attributes:
        streak: revolutions in a row that lost samples and have no other fault, this one included; 0 without loss.
        frequent: why what is measured in each revolution alone is provisional; None where loss is rare.
    """

    streak: int
    frequent: Reason | None


class LinkLoss:
    """Follows which revolutions of a wheel lost samples; deterministic, one revolution at a time."""

    def __init__(self) -> None:
        """Start without revolutions."""
        self.reset()

    def reset(self) -> None:
        """Forget everything, as after a change of tire."""
        self._recent: deque[bool] = deque(maxlen=_WINDOW)
        self._is_frequent = False
        self._streak = 0

    def take(self, revolution: Revolution) -> Loss:
        """Take the next revolution."""
        codes = [fault.code for fault in revolution.faults]
        is_lossy = not _LOSSES.isdisjoint(codes) and _OF_GAPS.issuperset(codes)
        self._streak = self._streak + 1 if is_lossy else 0
        self._recent.append(is_lossy)
        lossy = sum(self._recent)
        self._is_frequent = lossy >= (_RARE if self._is_frequent else _FREQUENT)
        frequent = Reason(Code.LOSS_FREQUENT, lossy=lossy, revolutions=len(self._recent)) if self._is_frequent else None
        return Loss(self._streak, frequent)


class SteadyStatus:
    """Keeps the status of one estimator's estimates through loss; deterministic, one revolution at a time.

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
        self._before: tuple[Estimate, ...] = ()
        self._lowered: frozenset[str] = frozenset()
        self._lowered_before: frozenset[str] = frozenset()

    def steadied(self, estimates: tuple[Estimate, ...], loss: Loss) -> tuple[Estimate, ...]:
        """Return the estimates of the next revolution with the status that they keep through loss."""
        if loss.streak:
            valid = {estimate.name: estimate for estimate in self._before if estimate.status is Status.VALID}
            estimates = tuple([self._held(estimate, valid, loss.streak) for estimate in estimates])
            lowered = frozenset(
                estimate.name
                for estimate in estimates
                if any(reason.code in _LOSSES for reason in estimate.reasons) and estimate.status is not Status.VALID
            )
            # Twice in a row: what one gap happens to hit is not what loss hits.
            self._lowered, self._lowered_before = lowered & self._lowered_before, lowered
        elif loss.frequent is not None and self._lowered:
            estimates = tuple(
                estimate._replace(status=Status.PROVISIONAL, reasons=(*estimate.reasons, loss.frequent))
                if estimate.status is Status.VALID and estimate.name in self._lowered
                else estimate
                for estimate in estimates
            )
        self._before = estimates
        return estimates

    def _held(self, estimate: Estimate, valid: dict[str, Estimate], streak: int) -> Estimate:
        before = valid.get(estimate.name)
        if before is None or estimate.status is not Status.PROVISIONAL:
            return estimate
        memory = self._memory.get(estimate.name) or _MEMORY_REVOLUTIONS
        others = {reason.code for reason in estimate.reasons} - {reason.code for reason in before.reasons}
        if others - {Code.REVOLUTION_NOT_USED} or streak > memory:
            return estimate
        return estimate._replace(std=max(estimate.std, before.std), status=Status.VALID)
