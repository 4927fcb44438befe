"""Error of an estimate by its own drift: an average is behind what it follows."""

import math
from collections import deque
from typing import Final

from gateway.estimators.estimator import Estimate, Status, estimate_of
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
