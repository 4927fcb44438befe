"""Status of averages through revolutions that loss kept out of them: a link that loses samples is not the tire's."""

from typing import Final

from gateway.estimators.estimator import OF_LOSS, Estimate, Revolution, Status
from gateway.pipeline.contact_timing import MOST_UNSEEN
from gateway.quantity_catalogue import quantities_of
from gateway.reasons import Code

# Of an average whose memory is not declared.
_MEMORY_REVOLUTIONS: Final = 50


class LossStreak:
    """Counts the revolutions in a row that loss alone keeps out of averages; deterministic."""

    def __init__(self) -> None:
        """Start without revolutions."""
        self.reset()

    def reset(self) -> None:
        """Forget everything, as after a change of tire."""
        self._count = 0

    def take(self, revolution: Revolution) -> int:
        """Take the next revolution; return the number up to it, 0 where it has another fault or none."""
        is_lossy = bool(revolution.faults) and all(fault.code in OF_LOSS for fault in revolution.faults)
        self._count = self._count + 1 if is_lossy else 0
        return self._count


class SteadyStatus:
    """Keeps the status of one estimator's averages through loss; deterministic, one revolution at a time.

    An average stays valid through revolutions that only loss kept out of it, as long as its memory. What follows
    driving, such as the load, does so as long as the edges of an earlier contact. Every other reason lowers the status
    at once.
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
        self._before: tuple[Estimate, ...] = ()

    def steadied(self, estimates: tuple[Estimate, ...], streak: int) -> tuple[Estimate, ...]:
        """Return the estimates of the next revolution with the status that they keep through loss.

        Args:
            estimates: of the revolution.
            streak: revolutions in a row that loss alone keeps out of averages, this one included.
        """
        if streak:
            valid = {estimate.name: estimate for estimate in self._before if estimate.status is Status.VALID}
            estimates = tuple([self._held(estimate, valid, streak) for estimate in estimates])
        self._before = estimates
        return estimates

    def _held(self, estimate: Estimate, valid: dict[str, Estimate], streak: int) -> Estimate:
        before = valid.get(estimate.name)
        if before is None or estimate.status is not Status.PROVISIONAL:
            return estimate
        memory = self._memory.get(estimate.name, MOST_UNSEEN)
        others = {reason.code for reason in estimate.reasons} - {reason.code for reason in before.reasons}
        if others - {Code.REVOLUTION_NOT_USED} or streak > memory:
            return estimate
        return estimate._replace(std=max(estimate.std, before.std), status=Status.VALID)
