"""Conditions of the test that the lines above the columns of a text file state."""

import re
from collections.abc import Sequence
from datetime import datetime
from typing import Final

_KG_N: Final = 9.80665
_TIRE: Final = re.compile(r"\b(?:LT|P|ST)?\d{3}/\d{2,3}\s?Z?[RBD-]\s?\d{2}(?:[.,]5)?C?\b")
_NUMBER: Final = r"[^\d\n+-]{0,20}?(?P<value>\d+(?:[.,]\d+)?)"
_BETWEEN: Final = r"[\s;,:\t\])\"]*"
_LOAD: Final = re.compile(
    rf"(?:\b|_)(?:(?:wheel|vertical|normal)?\s?load|radlast|last|fz)\b(?P<before>{_NUMBER}){_BETWEEN}(?P<unit>k?N\b|kg\b)?",
    re.IGNORECASE,
)
_PRESSURE: Final = re.compile(
    rf"(?:\b|_)(?:inflation|(?:tire|tyre)?\s?pressure|luftdruck|reifendruck|fülldruck)\b(?P<before>{_NUMBER}){_BETWEEN}"
    r"(?P<unit>kPa\b|bar\b|psi\b)?",
    re.IGNORECASE,
)
_UNIT: Final = re.compile(r"k?N\b|kg\b|kPa\b|bar\b|psi\b", re.IGNORECASE)
_LOADS_N: Final = {"n": 1.0, "kn": 1e3, "kg": _KG_N}
_PRESSURES_KPA: Final = {"kpa": 1.0, "bar": 100.0, "psi": 6.894757293168361}
_DATE: Final = re.compile(r"\b(\d{4})[-/.](\d{1,2})[-/.](\d{1,2})\b|\b(\d{1,2})\.(\d{1,2})\.(\d{4})\b")


def stated_conditions(lines: Sequence[str]) -> list[tuple[str, str, str]]:
    """Return tire, load, pressure and date as (key of an import map, its value in TOML, line), the first of each.

    A load or pressure counts only with its unit.
    """
    stated: dict[str, tuple[str, str, str]] = {}
    for number, line in enumerate(lines, 1):
        line_text = f"line {number}"
        if match := _TIRE.search(line):
            stated.setdefault("tire", ("tire", f'"{match[0]}"', line_text))
        for key, pattern, units in (("load_n", _LOAD, _LOADS_N), ("pressure_kpa", _PRESSURE, _PRESSURES_KPA)):
            if match := pattern.search(line):
                unit = match["unit"] or (_UNIT.search(match["before"]) or [""])[0]
                if unit.lower() in units:
                    value = float(match["value"].replace(",", ".")) * units[unit.lower()]
                    stated.setdefault(key, (key, f"{value:.6g}", line_text))
        if (match := _DATE.search(line)) and (day := _day(match)):
            stated.setdefault("date", ("date", day, line_text))
    return list(stated.values())


def _day(match: re.Match[str]) -> str | None:
    """Return a date as ISO, None where it is none; days before months where dots part them."""
    year, month, day = (match[1], match[2], match[3]) if match[1] else (match[6], match[5], match[4])
    try:
        return datetime(int(year), int(month), int(day)).date().isoformat()
    except ValueError:
        return None
