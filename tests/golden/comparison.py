"""Field-by-field comparison of results with stored ones: numbers within a tolerance, everything else exactly."""

import csv
import io
import json
import math
import re
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

# Solvers stop within their own tolerances, and another processor rounds differently. Where a number is known to a
# standard error, a small share of that is no difference; a standard error itself is known to fewer digits.
ABSOLUTE = 1e-9
# A chi-square is the difference of two of thousands.
ABSOLUTE_OF_CHI_SQUARE = 1e-5


class Tolerance(NamedTuple):
    """What counts as equal.

    Attributes:
        relative: of a number without a standard error.
        of_std: share of the standard error that stands beside a number.
        of_an_error: relative, of a standard error or a chi-square.
    """

    relative: float
    of_std: float
    of_an_error: float


OF_ESTIMATES = Tolerance(1e-5, 1e-3, 1e-4)
# A fit of many parameters multiplies what is rounded differently, most where it does not describe the data.
OF_A_DIAGNOSIS = Tolerance(5e-3, 1e-2, 1e-2)
# Its numbers are printed with three digits.
OF_A_REPORT = Tolerance(1e-2, 1e-2, 1e-2)

_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")


def differences(
    stored: Any, made: Any, path: str = "", *, texts: bool = True, tolerance: Tolerance = OF_ESTIMATES
) -> Iterator[str]:
    """Yield one line for each field that differs between two JSON-like values; without `texts`, wordings may differ."""
    if isinstance(stored, dict) and isinstance(made, dict):
        for key in stored.keys() | made.keys():
            where = f"{path}.{key}" if path else str(key)
            if key not in made:
                yield f"{where}: missing, was {_short(stored[key])}"
            elif key not in stored:
                yield f"{where}: new, {_short(made[key])}"
            elif _is_number(stored[key]) and _is_number(made[key]):
                if not _close(stored[key], made[key], key, _std_of(key, stored), tolerance):
                    yield f"{where}: {_short(made[key])}, was {_short(stored[key])}"
            else:
                yield from differences(stored[key], made[key], where, texts=texts, tolerance=tolerance)
    elif isinstance(stored, list) and isinstance(made, list):
        if len(stored) != len(made):
            yield f"{path}: {len(made)} entries, were {len(stored)}"
        for index, (before, after) in enumerate(zip(stored, made, strict=False)):
            yield from differences(before, after, f"{path}[{index}]", texts=texts, tolerance=tolerance)
    elif not texts and isinstance(stored, str) and isinstance(made, str):
        return
    elif _is_number(stored) and _is_number(made):
        if not _close(stored, made, "", 0.0, tolerance):
            yield f"{path}: {_short(made)}, was {_short(stored)}"
    elif type(stored) is not type(made) or stored != made:
        yield f"{path}: {_short(made)}, was {_short(stored)}"


def table(text: str) -> list[dict[str, Any]]:
    """Return a CSV table as rows; cells that are numbers become numbers."""
    return [{key: _number(cell) for key, cell in row.items()} for row in csv.DictReader(io.StringIO(text))]


def words_and_numbers(text: str) -> list[Any]:
    """Return a text as the sequence of its words and numbers, so that numbers are compared as numbers."""
    results: list[Any] = []
    end = 0
    for match in _NUMBER.finditer(text):
        results += text[end : match.start()].split()
        results.append(float(match.group()))
        end = match.end()
    return [*results, *text[end:].split()]


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _std_of(key: str, fields: Mapping[str, Any]) -> float:
    """Return the standard error that stands beside a number, 0 for none."""
    std = fields.get("std" if key == "value" else f"{key}_std")
    return float(std) if _is_number(std) and math.isfinite(std) else 0.0


def _close(stored: float, made: float, key: str, std: float, tolerance: Tolerance) -> bool:
    if math.isnan(stored) or math.isnan(made):
        return math.isnan(stored) and math.isnan(made)
    is_error = key == "chi2" or key == "std" or key.endswith("_std")
    absolute = ABSOLUTE_OF_CHI_SQUARE if key == "chi2" else max(ABSOLUTE, tolerance.of_std * std)
    relative = tolerance.of_an_error if is_error else 0.0 if std > 0.0 else tolerance.relative
    return math.isclose(stored, made, rel_tol=relative, abs_tol=absolute)


def _number(cell: str) -> Any:
    try:
        return float(cell)
    except (TypeError, ValueError):
        return cell


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 160 else f"{text[:120]} ... {text[-30:]}"
