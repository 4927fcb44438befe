"""Error of an estimate by its own drift: an average is behind what it follows."""

from __future__ import annotations

import math
from collections import deque
from typing import Final

from gateway.estimators.estimator import Estimate, Status
from gateway.quantity_catalogue import CATALOGUE

# Lag of an average over its change within its memory. A mean of all is behind by half of a steady drift, an exponential
# one by all of it.
_LAG: Final = 0.7
_MEMORY: Final = {
    quantity.name: quantity.memory_revolutions
    for quantities in CATALOGUE.values()
    for quantity in quantities
    if quantity.memory_revolutions
}


class OwnDrift:
    """Follows the estimates of one estimator; deterministic, one revolution at a time."""

    def __init__(self, estimator: str) -> None:
        """Start without estimates."""
        self.applies = any(quantity.name in _MEMORY for quantity in CATALOGUE.get(estimator, ()))
        self.reset()

    def reset(self) -> None:
        """Forget everything, as after a change of tire."""
        self._valid: dict[str, deque[float]] = {}

    def widened(self, estimates: tuple[Estimate, ...]) -> tuple[Estimate, ...]:
        """Return the estimates of the next revolution, with the error by what they have changed in their memory.

        The change is counted from the oldest valid value within it.
        """
        return tuple(self._widened(estimate) if estimate.name in _MEMORY else estimate for estimate in estimates)

    def _widened(self, estimate: Estimate) -> Estimate:
        if estimate.status is not Status.VALID:
            return estimate
        values = self._valid.get(estimate.name)
        if values is None:
            values = self._valid[estimate.name] = deque(maxlen=_MEMORY[estimate.name])
        values.append(estimate.value)
        return estimate._replace(std=math.hypot(estimate.std, _LAG * (estimate.value - values[0])))
