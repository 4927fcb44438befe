"""Results as tables: one row per revolution and wheel, streamed, with units in the column names."""

from __future__ import annotations

import json
from abc import abstractmethod
from collections.abc import Callable
from contextlib import suppress
from enum import StrEnum
from pathlib import Path
from typing import IO, Final

import numpy as np

from gateway.core.estimates.estimator import Estimate
from gateway.core.estimates.results import AlarmRecord, RevolutionResult
from gateway.core.quantity_catalogue import quantity_of
from gateway.core.reasons import Reason
from gateway.core.table_columns import (
    COVERAGE,
    ESTIMATE_PARTS,
    EXPANDED,
    OTHER,
    RESULT_HEAD,
    RESULT_TAIL,
    conventions,
    estimate_columns,
)
from gateway.core.text.numbers import RENAMED, distinct_name, finite_or_none
from gateway.core.text.output_file import OutputFile, WholeOutput
from gateway.core.text.table_sinks import Cell, CsvSink, MetadataSink, ParquetSink, RowSink, require_pyarrow
from gateway.core.text.text import json_text
from gateway.core.text.wording import as_json, joined

_TAKEN: Final = frozenset((*RESULT_HEAD, *RESULT_TAIL))

COLUMNS_FIXED_AFTER_ROWS: Final = 256


class TableFormat(StrEnum):
    """Formats of a result file."""

    CSV = "csv"
    JSON = "json"
    PARQUET = "parquet"
    METADATA = "metadata"


def open_table(
    path: Path,
    table_format: TableFormat,
    *,
    force: bool = False,
    coverage_factor: float | None = None,
) -> ResultTable:
    """Open a result file.

    Args:
        path: the file; it is not overwritten unless `force`. `-` is standard output.
        table_format: CSV with a header line, JSON lines (one object a line), Parquet, or what the columns of any of
            these mean, without rows. Estimates of the first COLUMNS_FIXED_AFTER_ROWS rows get columns; later ones go
            into OTHER. JSON lines need none of this.
        force: overwrite an existing file.
        coverage_factor: of expanded uncertainties, which are written beside the standard errors; None for none.

    Raises:
        OutputError: the file exists, cannot be made, or Parquet's package is missing.
    """
    if table_format is TableFormat.PARQUET:
        require_pyarrow()
    output = OutputFile(path, force=force)
    if table_format is TableFormat.JSON:
        return _JsonLines(output, coverage_factor)
    makers: dict[TableFormat, Callable[[IO[bytes]], RowSink]] = {
        TableFormat.CSV: CsvSink,
        TableFormat.PARQUET: ParquetSink,
        TableFormat.METADATA: MetadataSink,
    }
    return _Columns(output, coverage_factor, makers[table_format](output.file))


def row_of(result: RevolutionResult, recording: str = "") -> tuple[dict[str, Cell], dict[str, dict[str, Cell]]]:
    """Return (fixed cells, cells of each estimate by name and part); None for unknown values."""
    revolution, conditions = result.revolution, result.conditions
    fixed: dict[str, Cell] = {
        "recording": recording,
        "position": result.position,
        "revolution": revolution.index,
        "device_start_s": revolution.start_s,
        "device_end_s": revolution.start_s + revolution.period_s,
        "host_utc": iso_utc(result.host_ns) if result.host_ns else None,
        "host_ns": result.host_ns or None,
        "acceleration_mps2": finite_or_none(revolution.omega_dot_radps2 * conditions.radius_m),
        "radius_m": conditions.radius_m,
        "radius_std_m": conditions.radius_std_m,
        "mounting_offset_m": conditions.sensor_offset_m,
        "mounting_offset_std_m": conditions.sensor_offset_std_m,
        "load_n": conditions.load_n,
        "load_std_n": None if conditions.load_n is None else conditions.load_std_n,
        "pressure_pa": conditions.pressure_pa,
        "pressure_std_pa": None if conditions.pressure_pa is None else conditions.pressure_std_pa,
        "relative_rate_std": conditions.claims.rate_std,
        "relative_gain_std": conditions.gain_std,
        "temperature_degc": conditions.temperature_degc,
        "missing_fraction": revolution.missing_fraction,
        "saturated": bool(revolution.saturated),
        "ac_coupled": bool(revolution.ac_coupled),
        "faults": joined(revolution.faults),
        "silent_before_s": result.silent_before_s,
        "alarms": joined(alarm.reason for alarm in result.alarms),
    }
    named = {distinct_name(estimate.name, _TAKEN): _parts(estimate) for estimate in result.estimates}
    return fixed, named


def _parts(estimate: Estimate) -> dict[str, Cell]:
    """Return the cells of ESTIMATE_PARTS, in their order."""
    _, value, std, status, reasons, scatter = estimate
    is_known = std - std == 0.0
    return {
        "": float(value) if value - value == 0.0 else None,
        "_std": float(std) if is_known else None,
        "_constant_std": estimate.constant_std if is_known else None,
        "_scatter_std": float(scatter) if is_known else None,
        "_status": status.value,
        "_reason": joined(reasons) if reasons else "",
    }


def alarm_fields(alarm: AlarmRecord) -> dict[str, object]:
    """Return the history of an alarm, times in s from the beginning of the recording."""
    return {
        "name": str(alarm.name),
        "count": alarm.count,
        "first_s": alarm.first_s,
        "last_s": alarm.last_s,
        "total_s": alarm.total_s,
        "standing_at_end": alarm.is_standing,
        **as_json(alarm.reason),
    }


def iso_utc(host_ns: int) -> str:
    """Return ns since the epoch as `2026-01-31T12:00:00.123456Z`."""
    return f"{np.datetime_as_string(np.datetime64(host_ns, 'ns'), unit='us')}Z"


class ResultTable(WholeOutput):
    """File of rows, of which none is kept; with expanded uncertainties where there is a coverage factor.

    All methods raise OutputError when the file cannot be written any more.
    """

    def __init__(self, output: OutputFile, coverage_factor: float | None) -> None:
        self._output = output
        self._coverage_factor = coverage_factor

    @abstractmethod
    def write(self, result: RevolutionResult, recording: str = "") -> None:
        """Add one row; `recording` distinguishes rows of several recordings in one table."""

    def write_missing(self, position: str, reason: Reason, recording: str = "") -> None:
        """Note that a wheel completed no revolution; only JSON lines have a place for it."""
        del position, reason, recording

    def write_alarm(self, alarm: AlarmRecord, recording: str = "") -> None:
        """Note an alarm of the whole recording; only JSON lines have a place for it."""
        del alarm, recording

    def discard(self) -> None:
        """Leave no file."""
        self._output.discard()

    def _row(self, result: RevolutionResult, recording: str) -> tuple[dict[str, Cell], dict[str, dict[str, Cell]]]:
        fixed, named = row_of(result, recording)
        factor = self._coverage_factor
        if factor is not None:
            fixed[COVERAGE.name] = factor
            for parts in named.values():
                std = parts["_std"]
                parts[EXPANDED.name] = factor * std if isinstance(std, float) else None
        return fixed, named


class _JsonLines(ResultTable):
    """One JSON object a line: keys as the columns of the other formats, and reasons as lists; unknown is null."""

    def write(self, result: RevolutionResult, recording: str = "") -> None:
        fixed, named = self._row(result, recording)
        row: dict[str, object] = {key: fixed[key] for key in RESULT_HEAD}
        for name, parts in named.items():
            row |= {name + part: cell for part, cell in parts.items()}
        row |= {key: cell for key, cell in fixed.items() if key not in RESULT_HEAD}
        row["fault_reasons"] = [as_json(fault) for fault in result.revolution.faults]
        row["alarm_reasons"] = [{"name": str(alarm.name), **as_json(alarm.reason)} for alarm in result.alarms]
        for estimate in result.estimates:
            row[f"{distinct_name(estimate.name, _TAKEN)}_reasons"] = [as_json(reason) for reason in estimate.reasons]
        self._put(row)

    def write_missing(self, position: str, reason: Reason, recording: str = "") -> None:
        row: dict[str, object] = dict.fromkeys((*RESULT_HEAD, *RESULT_TAIL))
        self._put(row | {"recording": recording, "position": position, "missing_reasons": [as_json(reason)]})

    def write_alarm(self, alarm: AlarmRecord, recording: str = "") -> None:
        row: dict[str, object] = dict.fromkeys((*RESULT_HEAD, *RESULT_TAIL))
        self._put(row | {"recording": recording, "position": alarm.position, "alarm_record": alarm_fields(alarm)})

    def close(self) -> None:
        self._output.close()

    def _put(self, row: dict[str, object]) -> None:
        with self._output.explained():
            self._output.file.write(json_text(row).encode() + b"\n")


class _Columns(ResultTable):
    """Buffers the first rows to learn the names of the estimates, then streams under fixed columns."""

    def __init__(self, output: OutputFile, coverage_factor: float | None, sink: RowSink) -> None:
        super().__init__(output, coverage_factor)
        self._sink = sink
        self._names: dict[str, None] = {}
        self._held: list[tuple[dict[str, Cell], dict[str, dict[str, Cell]]]] | None = []
        self._closed = False

    def write(self, result: RevolutionResult, recording: str = "") -> None:
        fixed, named = self._row(result, recording)
        with self._output.explained():
            if self._held is None:
                self._put(fixed, named)
                return
            self._names.update(dict.fromkeys(named))
            self._held.append((fixed, named))
            if len(self._held) >= COLUMNS_FIXED_AFTER_ROWS:
                self._release()

    def close(self) -> None:
        if self._closed:
            return
        self._closed = True
        try:
            with self._output.explained():
                self._release()
                self._sink.end()
            self._output.close()
        except BaseException:
            self.discard()
            raise

    def discard(self) -> None:
        with suppress(Exception):  # pyarrow would try to finish the file when it is collected
            self._sink.end()
        super().discard()

    def _release(self) -> None:
        held, self._held = self._held, None
        if held is None:
            return
        is_expanded = self._coverage_factor is not None
        of_each = (*ESTIMATE_PARTS.values(), EXPANDED) if is_expanded else ESTIMATE_PARTS.values()
        self._no_parts: dict[str, Cell] = dict.fromkeys(part.name for part in of_each)
        self._tail = (*RESULT_TAIL, COVERAGE.name) if is_expanded else tuple(RESULT_TAIL)
        parts = (
            column
            for name in self._names
            for column in estimate_columns(name, quantity_of(name.removeprefix(RENAMED)).description, of_each)
        )
        tail = (*RESULT_TAIL.values(), COVERAGE) if is_expanded else RESULT_TAIL.values()
        self._sink.begin([*RESULT_HEAD.values(), *parts, *tail, OTHER], conventions(self._names))
        for fixed, named in held:
            self._put(fixed, named)

    def _put(self, fixed: dict[str, Cell], named: dict[str, dict[str, Cell]]) -> None:
        late = {name + part: cell for name in named if name not in self._names for part, cell in named[name].items()}
        other = json.dumps(late, ensure_ascii=False, allow_nan=False) if late else None
        cells = [fixed[key] for key in RESULT_HEAD]
        for name in self._names:
            cells += named.get(name, self._no_parts).values()
        self._sink.row([*cells, *[fixed[key] for key in self._tail], other])
