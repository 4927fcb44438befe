"""Estimator of a plug-in, kept from ending a session."""

from __future__ import annotations

import logging
from collections.abc import Callable

from gateway.estimators.estimator import AngleAverage, Estimate, Estimator, Revolution, TireConditions
from gateway.reasons import Code, Reason

_logger = logging.getLogger(__name__)


class PluginEstimator:
    """Estimator of a plug-in. An error in it makes its estimates invalid and stops nothing else."""

    def __init__(self, name: str, make: Callable[[], Estimator]) -> None:
        """Make the estimator `name` of a plug-in."""
        self.name = name
        self._estimator = make()
        self._names: tuple[str, ...] = (name,)

    def update(self, revolution: Revolution, average: AngleAverage, conditions: TireConditions) -> tuple[Estimate, ...]:
        """Return the plug-in's estimates; those that it gave last, without values, when it fails."""
        try:
            found = tuple(self._estimator.update(revolution, average, conditions))
            if not all(isinstance(estimate, Estimate) for estimate in found):
                raise TypeError("update returns other things than estimates")
        except Exception as error:  # code of others may raise anything, and must not end the session
            _logger.warning("estimator %s failed", self.name, exc_info=True)
            failed = Reason(Code.PLUGIN_FAILED, error=f"{type(error).__name__}: {error}")
            return tuple(Estimate.invalid(name, failed) for name in self._names)
        self._names = tuple(estimate.name for estimate in found) or self._names
        return found

    def reset(self) -> None:
        """Forget everything."""
        self._estimator.reset()
