"""The text of reasons, from the templates in `gateway.core.reasons`."""

import math
import string
from collections.abc import Iterable
from datetime import UTC, datetime
from functools import lru_cache
from typing import Any, Final

from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.feature import Registry, added, object_of
from gateway.core.reasons import Code, Level, Notice, Reason, Value
from gateway.core.shown_units import ShownUnits, conversion, shown_units
from gateway.core.text.probabilities import probability_text
from gateway.core.text.rounding import round_to_error
from gateway.core.text.text import escaped

# Printed unit: factor from SI.
_UNITS: Final = {
    "%": 100.0,
    "days": 1.0 / 86_400.0,
    "deg": math.degrees(1.0),
    "degC": 1.0,
    "K": 1.0,
    "h": 1.0 / 3_600.0,
    "g": 1.0 / STANDARD_GRAVITY_MPS2,
    "GB": 1e-9,
    "GHz": 1e-9,
    "Hz": 1.0,
    "kB": 1e-3,
    "kHz": 1e-3,
    "km": 1e-3,
    "km/h": 3.6,
    "kPa": 1e-3,
    "m": 1.0,
    "m/s²": 1.0,
    "MB": 1e-6,
    "min": 1.0 / 60.0,
    "mm": 1e3,
    "ms": 1e3,
    "ppm": 1e6,
    "rad/s": 1.0,
    "N": 1.0,
    "s": 1.0,
    "us": 1e6,
}


# A standard error of more times the value says no more about it.
_MOST_TIMES: Final = 10.0


def _unsigned_zero(number: str) -> str:
    """Return a printed number without the sign of a zero."""
    return number[1:] if number.startswith("-") and not any(digit in number for digit in "123456789n") else number


def _utc(time_s: float) -> str:
    """Return a time, s since the epoch, as a date; in seconds where no calendar has it."""
    try:
        return f"{datetime.fromtimestamp(time_s, UTC):%Y-%m-%d %H:%M:%S}"
    except (OverflowError, ValueError, OSError):
        return f"{time_s:.0f} s since 1970"


def _with_error(value: float, spec: str) -> str:
    """Return a value rounded to its error, with its unit.

    Args:
        value: in SI, or in the printed unit after `of`.
        spec: error and unit as in `0.5 mm` or `0.5 of mm`; `±{std_m} mm` in a template.
    """
    error, _, unit = spec.partition(" ")
    factor = 1.0 if unit.startswith("of ") else _UNITS[unit]
    symbol, scale, *_ = conversion(unit.removeprefix("of "), shown_units())
    return f"{round_to_error(value * factor * scale, float(error) * factor * scale).joined()} {symbol}".rstrip()


class _Template(string.Formatter):
    """`str.format` with units of display and nested reasons."""

    def format_field(self, value: Any, format_spec: str) -> str:
        if isinstance(value, Reason):
            return text(value)
        if isinstance(value, tuple):
            return ", ".join(self.format_field(item, format_spec) for item in value)
        if format_spec == "probability":
            return probability_text(value, ".2g")
        if format_spec == "utc":
            return _utc(value)
        if format_spec == "series":
            # Sentences are about the value itself, not its logarithm.
            label: str = object_of(added(Registry.PARTS)["label of a series"])(str(value))
            return label.removeprefix("ln ")
        if format_spec == "times":
            return f"more than {_MOST_TIMES:g} times" if value > _MOST_TIMES else f"{value:.2g} times"
        if format_spec == "later":
            return "earlier" if value < 0.0 else "later"
        if format_spec.startswith("size "):
            return _with_unit(abs(value), format_spec.removeprefix("size "))
        if format_spec == " ":
            return f" {value}" if value else ""
        if isinstance(value, str) and not value.isprintable():
            # Text from a hub, a file or an error stays on its line and cannot control the terminal.
            value = escaped(value)
        if format_spec.startswith("±"):
            return _with_error(float(value), format_spec.removeprefix("±"))
        return _with_unit(value, format_spec)


_FORMATTER: Final = _Template()


def _with_unit(value: Any, format_spec: str) -> str:
    """Return a value by a specification such as `.1f mm`, in the unit that is shown in its place."""
    number, _, unit = format_spec.partition(" ")
    if unit:
        symbol, factor, offset, decimals = conversion(unit, shown_units())
        if decimals and number.endswith("f"):
            number = f".{int(number[1:-1]) + decimals}f"
        value, unit = value * _UNITS[unit] * factor + offset, symbol
    formatted = format(value, number)
    if number.endswith("g") and "e+0" in formatted:
        # Few digits of a large number: 20, not 2e+01.
        formatted = f"{float(formatted):.0f}"
    if unit:
        return f"{_unsigned_zero(formatted)} {unit}"
    if format_spec.endswith("%"):
        formatted = f"{formatted[:-1]} %"
    return _unsigned_zero(formatted) if isinstance(value, float) else formatted


def text(reason: Reason) -> str:
    """Return a reason as a phrase without a full stop, in the units that are shown now."""
    return _text(reason, shown_units())


@lru_cache(maxsize=1024)
def _text(reason: Reason, units: ShownUnits) -> str:  # noqa: ARG001 - the texts of each are kept apart
    values = dict(reason.values)
    try:
        worded = {
            name: _FORMATTER.vformat(templates[str(values[name])], (), values)
            for name, templates in reason.code.words.items()
            if str(values[name]) in templates
        }
        sentence = _FORMATTER.vformat(reason.code.text_template, (), {**values, **worded})
        if "consequences" in values:
            sentence += _FORMATTER.vformat("; this also changes {consequences:series}", (), values)
        if "also_at" in values:
            sentence += f"; likewise at {values['also_at']}"
        return sentence
    except (LookupError, TypeError, ValueError):  # a plug-in may give a code with values that are not the code's
        return str(reason.code)


def joined(reasons: Iterable[Reason]) -> str:
    """Return several reasons as one text, each once; empty when there are none."""
    return "; ".join(dict.fromkeys(text(reason) for reason in reasons))


def notice_text(notice: Notice) -> str:
    """Return a notice as one line: its subject, then its reason; a matter of security is marked as such."""
    line = f"{escaped(notice.subject)}: {text(notice.reason)}" if notice.subject else text(notice.reason)
    return f"SECURITY: {line}" if notice.level is Level.SECURITY else line


def as_json(reason: Reason) -> dict[str, Any]:
    """Return a reason as JSON: code, values (SI) and text."""
    values = {name: _plain(value) for name, value in reason.values}
    return {"code": str(reason.code), "values": values, "text": text(reason)}


def fields(code: Code) -> set[str]:
    """Return the names of the values that a code's templates need, also within the form of another value."""
    templates = (code.text_template, *(template for kinds in code.words.values() for template in kinds.values()))
    parts = [part for template in templates for part in string.Formatter().parse(template)]
    parts += [inner for _, _, form, _ in parts if form for inner in string.Formatter().parse(form)]
    return {name for _, name, _, _ in parts if name}


def _plain(value: Value) -> Any:
    if isinstance(value, Reason):
        return as_json(value)
    if isinstance(value, tuple):
        return [_plain(item) for item in value]
    # JSON has no number for what is not finite.
    return None if isinstance(value, float) and not math.isfinite(value) else value
