"""Conditions of the test that a file states: above the columns of a text, or in attributes."""

import re
from collections.abc import Mapping
from datetime import datetime
from typing import Final

from gateway.importing.column_names import AN_ERROR

_KG_N: Final = 9.80665
_TIRE: Final = re.compile(r"\b(?:LT|P|ST)?\d{3}/\d{2,3}\s?Z?[RBD-]\s?\d{2}(?:[.,]5)?C?\b")
_NUMBER: Final = r"[^\d\n+-]{0,20}?(?P<value>\d+(?:[.,]\d+)?)"
_SEPARATORS: Final = r"[\s;,:\t\])\"]*"
_LOAD: Final = re.compile(
    rf"(?:\b|_)(?:(?:wheel|vertical|normal)?\s?load|radlast|last|fz)\b(?P<before>{_NUMBER}){_SEPARATORS}(?P<unit>k?N\b|kg\b)?",
    re.IGNORECASE,
)
_PRESSURE: Final = re.compile(
    rf"(?:\b|_)(?:inflation|(?:tire|tyre)?\s?pressure|luftdruck|reifendruck|fülldruck)\b(?P<before>{_NUMBER}){_SEPARATORS}"
    r"(?P<unit>k?Pa\b|bar\b|psi\b)?",
    re.IGNORECASE,
)
_UNIT: Final = re.compile(r"\b(?:k?N|kg|k?Pa|bar|psi)\b", re.IGNORECASE)
_LOADS_N: Final = {"n": 1.0, "kn": 1e3, "kg": _KG_N}
_PRESSURES_KPA: Final = {"pa": 1e-3, "kpa": 1.0, "bar": 100.0, "psi": 6.894757293168361}
# With slashes, days and months look alike.
_DATE: Final = re.compile(
    r"\b(?P<year>\d{4})[-/.](?P<month>\d{1,2})[-/.](?P<day>\d{1,2})\b|"
    r"\b(?P<day_2>\d{1,2})(?P<mark>[./])(?P<month_2>\d{1,2})(?P=mark)(?P<year_2>\d{4})\b|"
    r"\b(?P<name>[A-Z][a-z]{2})[a-z]*\.?\s(?P<day_3>\d{1,2}),?\s(?P<year_3>\d{4})\b"
)
_CLOCK: Final = re.compile(r"^\W*(?:log|start)?\s*time\W+(\d{1,2}):(\d\d)(?::(\d\d))?\b\s*([ap])?", re.IGNORECASE)
_MONTHS: Final = ("Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec")


def conditions_in(attributes: Mapping[str, object], holder: str) -> list[tuple[str, str, str]]:
    """Return the conditions that the attributes of a file state, as `stated_conditions`."""
    texts = {f"{holder}@{key}": f"{key.replace('_', ' ')}: {value}"[:200] for key, value in attributes.items()}
    return stated_conditions(texts)


def stated_conditions(lines: Mapping[str, str]) -> list[tuple[str, str, str]]:
    """Return tire, load, pressure, date and time of day: (key of an import map, its value in TOML, place).

    The first of each. A load or pressure counts only with its unit.

    Args:
        lines: texts by their places.
    """
    conditions: dict[str, tuple[str, str, str]] = {}
    for line_text, line in lines.items():
        if match := _TIRE.search(line):
            conditions.setdefault("tire", ("tire", f'"{match[0]}"', line_text))
        for key, pattern, units in (("load_n", _LOAD, _LOADS_N), ("pressure_kpa", _PRESSURE, _PRESSURES_KPA)):
            if (match := pattern.search(line)) and not AN_ERROR.search(line[: match.end("before")]):
                unit = match["unit"] or (_UNIT.search(match["before"]) or [""])[0]
                if unit.lower() in units:
                    value = float(match["value"].replace(",", ".")) * units[unit.lower()]
                    conditions.setdefault(key, (key, f"{value:.6g}", line_text))
        if (match := _DATE.search(line)) and (day := _day(match)):
            is_ambiguous = match["mark"] == "/" and int(match["day_2"]) <= 12 and int(match["month_2"]) <= 12
            conditions.setdefault("date", ("date", day, f"{line_text}, day first" if is_ambiguous else line_text))
        if match := _CLOCK.search(line):
            hour = int(match[1]) if match[4] is None else int(match[1]) % 12 + 12 * (match[4] in "pP")
            conditions.setdefault("clock", ("clock", f"{hour:02}:{match[2]}:{match[3] or '00'}", line_text))
    return list(conditions.values())


def _day(match: re.Match[str]) -> str | None:
    """Return a date as ISO, None where it is none; days before months where both are possible."""
    year, day = (match["year"] or match["year_2"] or match["year_3"], match["day"] or match["day_2"] or match["day_3"])
    month = match["month"] or match["month_2"] or 0
    if match["name"]:
        month = _MONTHS.index(match["name"]) + 1 if match["name"] in _MONTHS else 0
    if match["mark"] == "/" and int(month) > 12:
        month, day = day, month
    try:
        return datetime(int(year), int(month), int(day)).date().isoformat()
    except ValueError:
        return None
