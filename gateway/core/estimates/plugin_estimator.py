"""Estimator of a plug-in, kept from ending a session."""

import logging
import math
import numbers
from collections.abc import Callable, Sequence
from itertools import islice
from typing import Final

from gateway.core.estimates.estimator import AngleAverage, Estimate, Estimator, Revolution, Status, TireConditions
from gateway.core.estimates.reasons import EstimateCode
from gateway.core.plugins import error_text, is_from_user, short_text
from gateway.core.reasons import Code, Reason, Value

_logger = logging.getLogger(__name__)

_MAX_REASONS: Final = 20
_MAX_DEPTH: Final = 4


class _RefusedFieldError(Exception):
    """A field of an estimate has a value that it cannot have."""

    def __init__(self, field: str, value: object) -> None:
        super().__init__(field)
        self.reason = Reason(EstimateCode.PLUGIN_FIELD_REFUSED, field=field, given=short_text(repr(value)))


class PluginEstimator:
    """Estimator of a plug-in. An error in it makes its estimates invalid and stops nothing else."""

    def __init__(self, name: str, make: Callable[[], Estimator], quantities: Sequence[str]) -> None:
        """Make the estimator `name` of a plug-in, which declares these quantities."""
        self.name = name
        self._make = make
        self._estimator: Estimator | None = None
        self._names = tuple(quantities)
        self.reset()

    def update(self, revolution: Revolution, average: AngleAverage, conditions: TireConditions) -> tuple[Estimate, ...]:
        """Return the plug-in's estimates; all that it declares, without values, when it fails."""
        if self._estimator is None:
            return self._failed(self._failure)
        try:
            return self._checked(self._estimator.update(revolution, average, conditions))
        except BaseException as error:  # code of others may raise anything, and must not end the session
            if is_from_user(error):
                raise
            _logger.warning("estimator %s failed", self.name, exc_info=True)
            return self._failed(Reason(EstimateCode.PLUGIN_FAILED, error=error_text(error)))

    def reset(self) -> None:
        """Forget everything; an estimator that cannot is replaced by a new one."""
        try:
            if self._estimator is not None:
                self._estimator.reset()
                return
        except BaseException as error:  # likewise
            if is_from_user(error):
                raise
            _logger.warning("estimator %s cannot be reset", self.name, exc_info=True)
            self._estimator = None
        try:
            self._estimator = self._make()
        except BaseException as error:  # likewise
            if is_from_user(error):
                raise
            _logger.warning("estimator %s cannot be made", self.name, exc_info=True)
            self._failure = Reason(EstimateCode.PLUGIN_FAILED, error=error_text(error))

    def _failed(self, reason: Reason) -> tuple[Estimate, ...]:
        return tuple(Estimate.invalid(name, reason) for name in self._names)

    def _checked(self, returned: object) -> tuple[Estimate, ...]:
        """Return what the plug-in returned as estimates that every reader can rely on.

        Raises:
            TypeError: these are no estimates, or others than it declares.
        """
        items = tuple(islice(returned, len(self._names) + 1))  # type: ignore[call-overload]  # raises TypeError itself
        if not all(isinstance(item, Estimate) for item in items):
            raise TypeError("update returns other things than estimates")
        names = [item.name for item in items]
        for name in names:
            if type(name) is not str or name not in self._names:
                raise TypeError(f"estimate that is not declared: {short_text(repr(name))}")
        if len(set(names)) < len(names):
            raise TypeError("two estimates have the same name")
        return tuple(_checked_estimate(item) for item in items)


def _checked_estimate(estimate: Estimate) -> Estimate:
    """Return an estimate with plain, finite numbers, or an invalid one that says which field is not."""
    try:
        if not isinstance(estimate.status, Status):
            raise _RefusedFieldError("status", estimate.status)
        reasons = _reasons(estimate.reasons)
        if estimate.status is Status.INVALID:
            return Estimate.invalid(estimate.name, *(reasons or (Reason(EstimateCode.PLUGIN_GAVE_NO_REASON),)))
        value, std = _number("value", estimate.value), _number("std", estimate.std)
        if not math.isfinite(value):
            raise _RefusedFieldError("value", estimate.value)
        if std < 0.0 or math.isinf(std):
            raise _RefusedFieldError("std", estimate.std)
        scatter_std = _number("scatter_std", estimate.scatter_std)
        if not (0.0 <= scatter_std <= std or (scatter_std == 0.0 and math.isnan(std))):
            raise _RefusedFieldError("scatter_std", estimate.scatter_std)
        return Estimate(estimate.name, value, std, estimate.status, reasons, scatter_std)
    except _RefusedFieldError as refused:
        return Estimate.invalid(estimate.name, refused.reason)


def _number(field: str, value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, numbers.Real):
        raise _RefusedFieldError(field, value)
    try:
        return float(value)
    except (OverflowError, ValueError) as error:
        raise _RefusedFieldError(field, value) from error


def _reasons(values: object) -> tuple[Reason, ...]:
    if not isinstance(values, tuple) or len(values) > _MAX_REASONS:
        raise _RefusedFieldError("reasons", values)
    return tuple(_reason(item, _MAX_DEPTH) for item in values)


def _reason(item: object, depth: int) -> Reason:
    if not isinstance(item, Reason) or not isinstance(item.code, Code):
        raise _RefusedFieldError("reasons", item)
    return Reason(item.code, **{name: _value(value, depth) for name, value in item.values})


def _value(value: object, depth: int) -> Value:
    if isinstance(value, str):
        return short_text(value)
    if depth > 0 and isinstance(value, Reason):
        return _reason(value, depth - 1)
    if depth > 0 and isinstance(value, tuple) and len(value) <= _MAX_REASONS:
        return tuple(_value(item, depth - 1) for item in value)
    return _number("reasons", value)
