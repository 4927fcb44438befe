"""What a wheel did and under which conditions, as text: from its row in the table of recordings."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Final

from gateway.core.estimates.estimator import Status
from gateway.core.text.numbers import MISSING, age, fixed, round_to_error, split_name
from gateway.core.text.table_sinks import Cell

Cells = Mapping[str, Cell]


def number(cells: Cells, name: str) -> float:
    """Return a cell as a number, NaN where it is empty."""
    value = cells.get(name)
    return float(value) if isinstance(value, int | float) else math.nan


def _condition(cells: Cells, name: str) -> str:
    """Return a condition with its error and unit."""
    unit = split_name(name)[1]
    stem, _, suffix = name.rpartition("_")
    value, std = (number(cells, column) for column in (name, f"{stem}_std_{suffix}"))
    text = round_to_error(unit.of(value), std * unit.factor).joined()
    return text if text == MISSING else f"{text} {unit.symbol}"


def _spread(cells: Cells, names: Sequence[str]) -> str:
    """Return the mean of a quantity with its least and its greatest value."""
    unit = split_name(names[0])[1]
    mean, lowest, highest = (fixed(unit.of(number(cells, name)), 1) for name in names)
    return mean if mean == MISSING else f"{mean} {unit.symbol}, {lowest} to {highest}"


def _speed(cells: Cells) -> str:
    """Return the mean speed with its span and the status of the speed; why is said where the speed stands."""
    speed, status = _spread(cells, _SPEEDS), cells.get("speed_status")
    if status in (None, Status.VALID):
        return speed
    return f"{speed} {status}" if speed == MISSING else f"{speed}; {status}"


def _revolutions(cells: Cells) -> str:
    count, valid = cells["revolutions"], cells["revolutions_valid"]
    return str(count) if count == valid else f"{count}, {valid} without a fault"


def _lost(cells: Cells) -> str:
    samples, lost = number(cells, "samples"), number(cells, "lost_while_heard")
    if not samples + lost > 0.0:
        return MISSING
    return f"{100.0 * lost / (samples + lost):.3g} %{_silence(cells, ', besides', ' of silence')}"


def _silence(cells: Cells, prefix: str, suffix: str = "") -> str:
    """Return the time for which the wheel was silent between two words, empty where it never was."""
    silent_s = number(cells, "silent_s")
    return f"{prefix} {age(silent_s)}{suffix}" if silent_s > 0.0 else ""


_SPEEDS: Final = tuple(f"speed_{part}_mps" for part in ("mean", "min", "max"))
_TEMPERATURES: Final = ("temperature_degc", "temperature_min_degc", "temperature_max_degc")

GLANCE: Final[tuple[tuple[str, Callable[[Cells], str]], ...]] = (
    ("revolutions", _revolutions),
    ("distance", lambda cells: str(cells.get("distance") or f"{fixed(number(cells, 'distance_m'), 1)} m")),
    ("speed, mean and span", lambda cells: _speed(cells) + _silence(cells, "; not measured for")),
    ("load, stated", lambda cells: _condition(cells, "load_n")),
    ("pressure", lambda cells: _condition(cells, "pressure_pa")),
    ("temperature, mean and span", lambda cells: _spread(cells, _TEMPERATURES)),
    ("belt radius", lambda cells: f"{_condition(cells, 'radius_m')} ({cells.get('radius_source') or 'stated'})"),
    ("samples lost", _lost),
)
"""Label of each line, and its text; MISSING for what is not known."""
