"""The last minutes of every quantity of every wheel, for the trends of the console and the page."""

from __future__ import annotations

import math
from array import array
from collections import deque
from dataclasses import dataclass, field
from typing import Final, NamedTuple

from gateway.core.estimates.estimator import Estimate, Status
from gateway.core.estimates.results import RevolutionResult
from gateway.core.quantity_catalogue import quantity_of
from gateway.core.text.numbers import plain_name, split_name
from gateway.core.text.readout import vehicle_signal_names

SPAN_S: Final = 600
"""Time that is kept, with the last revolution of each second."""
_NAN: Final = math.nan
_STATUSES: Final = (Status.INVALID, Status.VALID, Status.PROVISIONAL)
_DESCRIPTIONS: Final = {
    "pressure_pa": "inflation pressure, measured or stated",
    "temperature_degc": "temperature at the sensor",
}


class TrendPoint(NamedTuple):
    """A quantity of the last revolution of a second.

    Attributes:
        at_s: the whole second since the epoch; of the recording in a replay.
        value: in the shown unit.
        std: one standard error in that unit, NaN when not known.
        status: valid or provisional; what is invalid is left out.
    """

    at_s: int
    value: float
    std: float
    status: Status


class TrendQuantity(NamedTuple):
    """A quantity that has a trend: its name as in `Estimate`, and how views call it."""

    name: str
    label: str
    unit: str
    description: str


class _Row(NamedTuple):
    at_s: int
    numbers: array[float]
    """Value and error of each column, single precision."""
    statuses: bytes


@dataclass(slots=True)
class _Wheel:
    rows: deque[_Row] = field(default_factory=deque)
    present: tuple[int, RevolutionResult] | None = None


class TrendHistory:
    """Keeps the last revolution of each second for SPAN_S; of one thread."""

    def __init__(self) -> None:
        """Start empty."""
        self._columns: dict[str, int] = {}
        self._wheels: dict[str, _Wheel] = {}

    def add(self, result: RevolutionResult) -> None:
        """Take a revolution; it replaces an earlier one of the same second."""
        wheel = self._wheels.setdefault(result.position, _Wheel())
        at_s = result.host_ns // 1_000_000_000
        if wheel.present is not None and wheel.present[0] != at_s:
            wheel.rows.append(self._row(*wheel.present))
            while wheel.rows and wheel.rows[0].at_s < at_s - SPAN_S:
                wheel.rows.popleft()
        wheel.present = at_s, result

    def quantities(self) -> list[TrendQuantity]:
        """Return the quantities that have been seen, in the order of the estimators."""
        for wheel in self._wheels.values():
            if wheel.present is not None:
                self._number(_estimates(wheel.present[1]))
        return [TrendQuantity(name, *_words(name)) for name in self._columns]

    def wheels(self) -> list[str]:
        """Return the positions of the wheels, in the order of their first revolutions."""
        return list(self._wheels)

    def points(self, position: str, name: str, since_s: int = 0) -> list[TrendPoint]:
        """Return a quantity of a wheel from a time on, in its shown unit; empty for what is not known."""
        wheel, column = self._wheels.get(position), self._columns.get(name)
        if wheel is None:
            return []
        _, factor, offset, _ = split_name(name)[1]
        points: list[TrendPoint] = []
        for row in reversed(wheel.rows):
            if row.at_s < since_s:
                break
            if column is not None and column < len(row.statuses) and row.statuses[column]:
                value, std = row.numbers[2 * column], row.numbers[2 * column + 1]
                points.append(
                    TrendPoint(row.at_s, value * factor + offset, std * factor, _STATUSES[row.statuses[column]])
                )
        points.reverse()
        if wheel.present is not None:
            at_s, result = wheel.present
            points += [
                TrendPoint(at_s, estimate.value * factor + offset, estimate.std * factor, estimate.status)
                for estimate in _estimates(result)
                if estimate.name == name and estimate.status is not Status.INVALID
            ]
        return points

    def _number(self, estimates: list[Estimate]) -> None:
        for estimate in estimates:
            self._columns.setdefault(estimate.name, len(self._columns))

    def _row(self, at_s: int, result: RevolutionResult) -> _Row:
        estimates = _estimates(result)
        self._number(estimates)
        numbers = array("f", [_NAN]) * (2 * len(self._columns))
        statuses = bytearray(len(self._columns))
        for estimate in estimates:
            column = self._columns[estimate.name]
            numbers[2 * column], numbers[2 * column + 1] = estimate.value, estimate.std
            statuses[column] = _STATUSES.index(estimate.status)
        return _Row(at_s, numbers, bytes(statuses))


def _estimates(result: RevolutionResult) -> list[Estimate]:
    """Return what a revolution has a trend of: its estimates and measured conditions, without ages of signals."""
    conditions = result.conditions
    measured = (
        ("pressure_pa", conditions.pressure_pa, conditions.pressure_std_pa or _NAN),
        ("temperature_degc", conditions.temperature_degc, _NAN),
    )
    return [
        *(estimate for estimate in result.estimates if not estimate.name.endswith("_age_s")),
        *(Estimate(name, value, std, Status.VALID) for name, value, std in measured if value is not None),
    ]


def _words(name: str) -> tuple[str, str, str]:
    label, unit = plain_name(name), split_name(name)[1]
    if name in vehicle_signal_names():
        return label, unit.symbol, "signal of the vehicle"
    return label, unit.symbol, _DESCRIPTIONS.get(name) or quantity_of(name).description
