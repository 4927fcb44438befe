"""Values of a table in SI: the unit at the end of a key is a user's, that of the program's field the SI's."""

import math
import re
from typing import Any, Final, NamedTuple

from gateway.core.config.validation import Section

_DEG_RAD: Final = math.radians(1.0)
# Unit of a key -> unit of the field, and the factor to it as numerator and denominator.
_UNITS: Final = {
    "per_deg": ("prad", 1.0, _DEG_RAD),
    "deg": ("rad", _DEG_RAD, 1.0),
    "gpa": ("pa", 1e9, 1.0),
    "kpa": ("pa", 1e3, 1.0),
    "mm": ("m", 1e-3, 1.0),
    "percent": ("", 1e-2, 1.0),
    "percent_per_k": ("per_k", 1e-2, 1.0),
    "rad": ("rad", 1.0, 1.0),
}
_KEY: Final = re.compile(rf"(.+?)(?:_(min|max))?_({'|'.join(_UNITS)})")


class _Field(NamedTuple):
    """Field of a key, the end of its range or None, and the factor to it."""

    name: str
    end: int | None = None
    numerator: float = 1.0
    denominator: float = 1.0


def _field_of(key: str) -> _Field:
    match = _KEY.fullmatch(key)
    if match is None:
        return _Field(key)
    name, end, unit = match.groups()
    si_unit, *factor = _UNITS[unit]
    parts = (name, "range" if end else "", si_unit)
    return _Field("_".join(filter(None, parts)), {"min": 0, "max": 1}.get(end), *factor)


def si_values(table: Section) -> dict[str, Any]:
    """Return what a table states in SI, by field; lowest and highest value of a range are one field."""
    values: dict[str, Any] = {}
    for key, entry in table:
        name, end, numerator, denominator = _field_of(key)
        value = entry * numerator / denominator if isinstance(entry, float) else entry
        values[name] = value if end is None else (*values.get(name, ()), value)
    return values


def table_values(table: type[Section], fields: object) -> dict[str, Any]:
    """Return the values of an object's fields by the keys of a table, with six digits; without those that are None."""
    values: dict[str, Any] = {}
    for key in table.model_fields:
        name, end, numerator, denominator = _field_of(key)
        value = getattr(fields, name)
        if end is not None:
            value = value[end]
        if value is not None:
            values[key] = rounded(value * denominator / numerator) if isinstance(value, float) else value
    return values


def rounded(value: float) -> float:
    """Return a value with six digits, as tables for the configuration have them."""
    return float(f"{value:.6g}")
