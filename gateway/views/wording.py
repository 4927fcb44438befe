"""The text of every reason, in one table.

A template is a format string over the values of its reason. Values are in SI units; a unit after the format converts
and is printed: `{depth_m:.1f mm}` shows 0.008 as `8.0 mm`. A nested reason is replaced by its own text.
"""

from __future__ import annotations

import math
import string
from collections.abc import Iterable, Mapping
from typing import Any, Final

from gateway.constants import STANDARD_GRAVITY_MPS2
from gateway.reasons import Code, Reason, Value

TEMPLATES: Final[Mapping[Code, str]] = {
    # Revolutions
    Code.SAMPLES_LOST: "samples were lost on the link",
    # Estimates
    # Sensors
    # Wheels, links and alarms
    # Security
    # Files and configuration
}

# Printed unit: factor from SI.
_UNITS: Final = {
    "%": 100.0,
    "deg": math.degrees(1.0),
    "degC": 1.0,
    "g": 1.0 / STANDARD_GRAVITY_MPS2,
    "GHz": 1e-9,
    "Hz": 1.0,
    "kB": 1e-3,
    "kHz": 1e-3,
    "km/h": 3.6,
    "kPa": 1e-3,
    "m": 1.0,
    "m/s²": 1.0,
    "mm": 1e3,
    "ms": 1e3,
    "N": 1.0,
    "s": 1.0,
    "us": 1e6,
}


class _Template(string.Formatter):
    """`str.format` with units of display and nested reasons."""

    def format_field(self, value: Any, format_spec: str) -> str:
        if isinstance(value, Reason):
            return text(value)
        if isinstance(value, tuple):
            return ", ".join(self.format_field(item, format_spec) for item in value)
        number, _, unit = format_spec.partition(" ")
        if unit:
            return f"{format(value * _UNITS[unit], number)} {unit}"
        return format(value, format_spec)


_FORMATTER: Final = _Template()


def text(reason: Reason) -> str:
    """Return a reason as a phrase without a full stop."""
    return _FORMATTER.vformat(TEMPLATES[reason.code], (), dict(reason.values))


def joined(reasons: Iterable[Reason]) -> str:
    """Return several reasons as one text, each once; empty when there are none."""
    return "; ".join(dict.fromkeys(text(reason) for reason in reasons))


def as_json(reason: Reason) -> dict[str, Any]:
    """Return a reason as JSON: code, values (SI) and text."""
    values = {name: _plain(value) for name, value in reason.values}
    return {"code": str(reason.code), "values": values, "text": text(reason)}


def fields(code: Code) -> set[str]:
    """Return the names of the values that a code's template needs."""
    return {name for _, name, _, _ in string.Formatter().parse(TEMPLATES[code]) if name}


def _plain(value: Value) -> Any:
    if isinstance(value, Reason):
        return as_json(value)
    if isinstance(value, tuple):
        return [_plain(item) for item in value]
    return value
