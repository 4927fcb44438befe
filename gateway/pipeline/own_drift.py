"""Error of an estimate by its own drift: an average is behind what it follows."""

import math
from collections import deque
from typing import Final

from gateway.estimators.estimator import Estimate, Status
from gateway.quantity_catalogue import quantities_of

# Lag of an average over its change within its memory. A mean of all is behind by half of a steady drift, an exponential
# one by all of it.
_LAG: Final = 0.7


class OwnDrift:
    """Follows the estimates of one estimator; deterministic, one revolution at a time."""

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
        self._valid: dict[str, deque[float]] = {}

    def widened(self, estimates: tuple[Estimate, ...]) -> tuple[Estimate, ...]:
        """Return the estimates of the next revolution, with the error by what they have changed in their memory.

        The change is counted from the oldest valid value within it.
        """
        return tuple([self._widened(estimate) if estimate.name in self._memory else estimate for estimate in estimates])

    def _widened(self, estimate: Estimate) -> Estimate:
        name, value, std, status, reasons, scatter_std = estimate
        if status is not Status.VALID:
            return estimate
        values = self._valid.get(name)
        if values is None:
            values = self._valid[name] = deque(maxlen=self._memory[name])
        values.append(value)
        # Not by `_replace`, which takes four times as long.
        return Estimate(name, value, math.hypot(std, _LAG * (value - values[0])), status, reasons, scatter_std)
