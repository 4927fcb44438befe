"""Field-by-field comparison of results with stored ones: numbers within a tolerance, everything else exactly."""

from __future__ import annotations

import csv
import io
import json
import math
import re
from collections.abc import Iterator
from typing import Any

# Solvers stop within their own tolerances, and another BLAS rounds differently.
RELATIVE = 1e-6
# A fit of many parameters multiplies what another processor rounds differently: numbers of a diagnosis differ by up to
# 2e-5 between two kinds.
RELATIVE_OF_A_DIAGNOSIS = 2e-4
ABSOLUTE = 1e-9
# A chi-square is the difference of two of thousands.
ABSOLUTE_OF_CHI_SQUARE = 1e-5

_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")


def differences(
    stored: Any, made: Any, place: str = "", *, texts: bool = True, relative: float = RELATIVE
) -> Iterator[str]:
    """Yield one line for each field that differs between two JSON-like values; without `texts`, wordings may differ."""
    if isinstance(stored, dict) and isinstance(made, dict):
        for key in stored.keys() | made.keys():
            where = f"{place}.{key}" if place else str(key)
            if key not in made:
                yield f"{where}: missing, was {_short(stored[key])}"
            elif key not in stored:
                yield f"{where}: new, {_short(made[key])}"
            else:
                yield from differences(stored[key], made[key], where, texts=texts, relative=relative)
    elif isinstance(stored, list) and isinstance(made, list):
        if len(stored) != len(made):
            yield f"{place}: {len(made)} entries, were {len(stored)}"
        for index, (before, after) in enumerate(zip(stored, made, strict=False)):
            yield from differences(before, after, f"{place}[{index}]", texts=texts, relative=relative)
    elif not texts and isinstance(stored, str) and isinstance(made, str):
        return
    elif not _equal(stored, made, relative, ABSOLUTE_OF_CHI_SQUARE if place.endswith("chi2") else ABSOLUTE):
        yield f"{place}: {_short(made)}, was {_short(stored)}"


def table(text: str) -> list[dict[str, Any]]:
    """Return a CSV table as rows; cells that are numbers become numbers."""
    return [{key: _number(cell) for key, cell in row.items()} for row in csv.DictReader(io.StringIO(text))]


def words_and_numbers(text: str) -> list[Any]:
    """Return a text as the sequence of its words and numbers, so that numbers are compared as numbers."""
    found: list[Any] = []
    end = 0
    for match in _NUMBER.finditer(text):
        found += text[end : match.start()].split()
        found.append(float(match.group()))
        end = match.end()
    return [*found, *text[end:].split()]


def _equal(stored: Any, made: Any, relative: float, absolute: float) -> bool:
    numbers = isinstance(stored, int | float) and isinstance(made, int | float)
    if numbers and not isinstance(stored, bool) and not isinstance(made, bool):
        both_nan = math.isnan(stored) and math.isnan(made)
        return both_nan or math.isclose(stored, made, rel_tol=relative, abs_tol=absolute)
    return type(stored) is type(made) and stored == made


def _number(cell: str) -> Any:
    try:
        return float(cell)
    except (TypeError, ValueError):
        return cell


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 160 else f"{text[:120]} ... {text[-30:]}"
