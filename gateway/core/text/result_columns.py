"""Cells of results by column: fixed ones of the revolution, and the parts of each estimate."""

import json
from collections.abc import Iterable, Mapping, Sequence
from operator import attrgetter
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gateway.core.estimates.estimator import SOURCE_COLUMNS
from gateway.core.estimates.result_block import ResultBlock
from gateway.core.reasons import Reason
from gateway.core.table_columns import ESTIMATE_PARTS, RESULT_HEAD, RESULT_TAIL, Column
from gateway.core.text.numbers import distinct_name
from gateway.core.text.wording import joined
from gateway.core.types import FloatArray

Cells = NDArray[Any]
"""(k,) cells of a column: floats, NaN where unknown; times in ns, NaT likewise; integers; booleans; or objects, texts
and None where unknown."""

TAKEN: Final = frozenset((*RESULT_HEAD, *RESULT_TAIL))
"""Names that no estimate has in a table."""


class ResultColumns(NamedTuple):
    """Columns of k results.

    Attributes:
        fixed: by name, those of RESULT_HEAD and RESULT_TAIL.
        named: of each estimate, by its name in a table, then by its part as in ESTIMATE_PARTS.
    """

    fixed: dict[str, Cells]
    named: dict[str, dict[str, Cells]]


def result_columns(block: ResultBlock, recording: str = "") -> ResultColumns:
    """Return the columns of a block.

    Args:
        block: the results.
        recording: name of the recording as `storable`, for rows of several recordings in one table.
    """
    revolutions, conditions = block.revolutions, block.conditions
    host_ns = np.array([result.host_ns or _NOT_A_TIME for result in block.results], np.int64).view("M8[ns]")
    numbers = {
        **{name: _floats(map(attrgetter(path), revolutions)) for name, path in _OF_REVOLUTION.items()},
        **{name: _floats(map(attrgetter(path), conditions)) for name, path in _OF_CONDITIONS.items()},
    }
    for name, std in _ERRORS_OF_STATED.items():
        numbers[std][np.isnan(numbers[name])] = np.nan
    fixed: dict[str, Cells] = {
        "recording": _repeated(recording, len(block)),
        "position": _repeated(block.position, len(block)),
        "revolution": np.array(list(map(attrgetter("index"), revolutions)), np.int64),
        "device_end_s": numbers["device_start_s"] + _floats(map(attrgetter("period_s"), revolutions)),
        "host_utc": host_ns,
        "host_ns": host_ns,
        "acceleration_mps2": _floats(map(attrgetter("omega_dot_radps2"), revolutions)) * numbers["radius_m"],
        "saturated": np.array(list(map(attrgetter("saturated"), revolutions)), np.bool_),
        "ac_coupled": np.array(list(map(attrgetter("ac_coupled"), revolutions)), np.bool_),
        **{column: texts(entry.sources.get(column) for entry in conditions) for column in SOURCE_COLUMNS.values()},
        "faults": texts(joined(revolution.faults) for revolution in revolutions),
        "silent_before_s": _floats(map(attrgetter("silent_before_s"), block.results)),
        "alarms": texts(joined(alarm.reason for alarm in result.alarms) for result in block.results),
    }
    fixed = {key: fixed[key] if key in fixed else numbers[key] for key in (*RESULT_HEAD, *RESULT_TAIL)}
    status, reasons = texts(map(str, block.status)), _reason_texts(block.reasons)
    count = len(block.names)
    named = {
        distinct_name(name, TAKEN): dict(
            zip(
                ESTIMATE_PARTS,
                (
                    *(part[:, index] for part in (block.value, block.std, block.constant_std, block.scatter_std)),
                    status[index::count],
                    reasons[index::count],
                ),
                strict=True,
            )
        )
        for index, name in enumerate(block.names)
    }
    return ResultColumns(fixed, named)


# Columns of numbers by the attribute that they have.
_OF_REVOLUTION: Final = {"device_start_s": "start_s", "missing_fraction": "missing_fraction"}
_OF_CONDITIONS: Final = {
    "radius_m": "radius_m",
    "radius_std_m": "radius_std_m",
    "mounting_offset_m": "sensor_offset_m",
    "mounting_offset_std_m": "sensor_offset_std_m",
    "load_n": "load_n",
    "load_std_n": "load_std_n",
    "pressure_pa": "pressure_pa",
    "pressure_std_pa": "pressure_std_pa",
    "relative_rate_std": "claims.rate_std",
    "relative_gain_std": "gain_std",
    "temperature_degc": "temperature_degc",
}
_ERRORS_OF_STATED: Final = {"load_n": "load_std_n", "pressure_pa": "pressure_std_pa"}
_NOT_A_TIME: Final = int(np.datetime64("NaT", "ns").astype(np.int64))


def _floats(numbers: Iterable[float | None]) -> FloatArray:
    """Return numbers, (k,); NaN where they are not finite or None."""
    cells: FloatArray = np.array(list(numbers), np.float64)
    cells[~np.isfinite(cells)] = np.nan
    return cells


def texts(cells: Iterable[str | None]) -> Cells:
    """Return texts as cells."""
    return np.array(list(cells), np.object_)


def _repeated(cell: str, count: int) -> Cells:
    return np.full(count, cell, np.object_)


def _reason_texts(all_reasons: Sequence[tuple[Reason, ...]]) -> Cells:
    """Return the text of each tuple of reasons; one that several estimates share is made once."""
    distinct = {id(reasons): reasons for reasons in all_reasons}
    worded = {key: joined(reasons) for key, reasons in distinct.items()}
    return texts(worded[id(reasons)] for reasons in all_reasons)


def unknown(column: Column, count: int) -> Cells:
    """Return cells of a column of floats or texts that are all unknown, (count,)."""
    return np.full(count, np.nan) if column.kind is float else np.full(count, None, np.object_)


def values_of(cells: Cells) -> list[Any]:
    """Return cells as Python values, times as ns; None where unknown."""
    if cells.dtype.kind == "M":
        return [None if time_ns == _NOT_A_TIME else time_ns for time_ns in cells.view(np.int64).tolist()]
    values: list[Any] = cells.tolist()
    if cells.dtype.kind == "f" and np.isnan(cells).any():
        return [None if value != value else value for value in values]
    return values


def iso_utc(host_ns: int) -> str:
    """Return ns since the epoch as `2026-01-31T12:00:00.123456Z`."""
    return f"{np.datetime_as_string(np.datetime64(host_ns, 'ns'), unit='us')}Z"


def in_text(columns: Mapping[str, Cells]) -> dict[str, Cells]:
    """Return columns for a format in text, whose column of times in UTC is ISO 8601."""
    utc = np.datetime_as_string(columns["host_utc"], unit="us").tolist()
    return {**columns, "host_utc": texts(None if time == "NaT" else f"{time}Z" for time in utc)}


def estimate_cells(named: Mapping[str, Mapping[str, Cells]]) -> dict[str, Cells]:
    """Return the columns of estimates by their names in a table."""
    return {name + part: cells for name, parts in named.items() for part, cells in parts.items()}


def as_objects(named: Mapping[str, Mapping[str, Cells]], count: int) -> Cells:
    """Return estimates that have no columns as one column of JSON, (count,); None without any."""
    if not named:
        return np.full(count, None, np.object_)
    return texts(json.dumps(row, ensure_ascii=False, allow_nan=False) for row in rows_of(estimate_cells(named)))


def rows_of(columns: Mapping[str, Cells]) -> list[dict[str, Any]]:
    """Return columns as rows of Python values by name, unknown as None."""
    return [dict(zip(columns, row, strict=True)) for row in zip(*map(values_of, columns.values()), strict=True)]
