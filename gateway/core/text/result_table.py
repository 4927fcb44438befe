"""Results as tables: one row per revolution and wheel, streamed, with units in the column names."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping
from contextlib import suppress
from enum import StrEnum
from pathlib import Path
from typing import IO, Final

import numpy as np

from gateway.core.estimates.result_block import ResultBlock
from gateway.core.estimates.results import AlarmRecord
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
from gateway.core.text.numbers import RENAMED
from gateway.core.text.output_file import OutputFile, WholeOutput
from gateway.core.text.result_columns import (
    ResultColumns,
    as_objects,
    estimate_cells,
    in_text,
    result_columns,
    rows_of,
    unknown,
)
from gateway.core.text.table_sinks import ColumnSink, CsvSink, MetadataSink, ParquetSink, require_pyarrow
from gateway.core.text.text import json_text
from gateway.core.text.wording import as_json

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
    makers: dict[TableFormat, Callable[[IO[bytes]], ColumnSink]] = {
        TableFormat.CSV: CsvSink,
        TableFormat.PARQUET: ParquetSink,
        TableFormat.METADATA: MetadataSink,
    }
    return _Columns(output, coverage_factor, makers[table_format](output.file))


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


class ResultTable(WholeOutput):
    """File of rows, of which none is kept; with expanded uncertainties where there is a coverage factor.

    All methods raise OutputError when the file cannot be written any more.
    """

    def __init__(self, output: OutputFile, coverage_factor: float | None) -> None:
        self._output = output
        self._coverage_factor = coverage_factor

    @abstractmethod
    def write(self, block: ResultBlock, recording: str = "") -> None:
        """Add rows; `recording` distinguishes those of several recordings in one table."""

    def write_missing(self, position: str, reason: Reason, recording: str = "") -> None:
        """Note that a wheel completed no revolution; only JSON lines have a place for it."""
        del position, reason, recording

    def write_alarm(self, alarm: AlarmRecord, recording: str = "") -> None:
        """Note an alarm of the whole recording; only JSON lines have a place for it."""
        del alarm, recording

    def repeat(self, metadata: Mapping[str, str]) -> None:
        """Take metadata of another output; only Parquet has a place for it."""
        del metadata

    def discard(self) -> None:
        """Leave no file."""
        self._output.discard()

    def _columns(self, block: ResultBlock, recording: str) -> ResultColumns:
        fixed, named = columns = result_columns(block, recording)
        factor = self._coverage_factor
        if factor is not None:
            fixed[COVERAGE.name] = np.full(len(block), factor)
            for parts in named.values():
                parts[EXPANDED.name] = factor * parts["_std"]
        return columns


class _JsonLines(ResultTable):
    """One JSON object a line: keys as the columns of the other formats, and reasons as lists; unknown is null."""

    def write(self, block: ResultBlock, recording: str = "") -> None:
        fixed, named = self._columns(block, recording)
        columns = {key: fixed[key] for key in RESULT_HEAD} | estimate_cells(named)
        columns |= {key: cells for key, cells in fixed.items() if key not in RESULT_HEAD}
        for row, result in zip(rows_of(in_text(columns)), block.results, strict=True):
            row["fault_reasons"] = [as_json(fault) for fault in result.revolution.faults]
            row["alarm_reasons"] = [{"name": str(alarm.name), **as_json(alarm.reason)} for alarm in result.alarms]
            for name, estimate in zip(named, result.estimates, strict=True):
                row[f"{name}_reasons"] = [as_json(reason) for reason in estimate.reasons]
            self._emit(row)

    def write_missing(self, position: str, reason: Reason, recording: str = "") -> None:
        row: dict[str, object] = dict.fromkeys((*RESULT_HEAD, *RESULT_TAIL))
        self._emit(row | {"recording": recording, "position": position, "missing_reasons": [as_json(reason)]})

    def write_alarm(self, alarm: AlarmRecord, recording: str = "") -> None:
        row: dict[str, object] = dict.fromkeys((*RESULT_HEAD, *RESULT_TAIL))
        self._emit(row | {"recording": recording, "position": alarm.position, "alarm_record": alarm_fields(alarm)})

    def close(self) -> None:
        self._output.close()

    def _emit(self, row: dict[str, object]) -> None:
        with self._output.explained():
            self._output.file.write(json_text(row).encode() + b"\n")


class _Columns(ResultTable):
    """Holds the first rows to learn the names of the estimates, then streams under fixed columns."""

    def __init__(self, output: OutputFile, coverage_factor: float | None, sink: ColumnSink) -> None:
        super().__init__(output, coverage_factor)
        self._sink = sink
        self._names: dict[str, None] = {}
        self._buffered: list[ResultColumns] | None = []
        self._buffered_rows = 0
        is_expanded = coverage_factor is not None
        self._parts = (*ESTIMATE_PARTS.values(), EXPANDED) if is_expanded else tuple(ESTIMATE_PARTS.values())
        self._tail = (*RESULT_TAIL.values(), COVERAGE) if is_expanded else tuple(RESULT_TAIL.values())
        self._closed = False

    def write(self, block: ResultBlock, recording: str = "") -> None:
        columns = self._columns(block, recording)
        with self._output.explained():
            if self._buffered is None:
                self._emit(columns)
                return
            self._names.update(dict.fromkeys(columns.named))
            self._buffered.append(columns)
            self._buffered_rows += len(block)
            if self._buffered_rows >= COLUMNS_FIXED_AFTER_ROWS:
                self._release()

    def repeat(self, metadata: Mapping[str, str]) -> None:
        with self._output.explained():
            self._release()
            if isinstance(self._sink, ParquetSink):
                self._sink.repeat(metadata)

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
        buffered, self._buffered = self._buffered, None
        if buffered is None:
            return
        estimate_heads = (
            column
            for name in self._names
            for column in estimate_columns(name, quantity_of(name.removeprefix(RENAMED)).description, self._parts)
        )
        self._sink.begin([*RESULT_HEAD.values(), *estimate_heads, *self._tail, OTHER], conventions(self._names))
        for columns in buffered:
            self._emit(columns)

    def _emit(self, columns: ResultColumns) -> None:
        fixed, named = columns
        count = len(fixed["revolution"])
        cells = {key: fixed[key] for key in RESULT_HEAD}
        missing = {part.name: unknown(part, count) for part in self._parts}
        cells |= estimate_cells({name: named.get(name, missing) for name in self._names})
        cells |= {column.name: fixed[column.name] for column in self._tail}
        unlisted = {name: parts for name, parts in named.items() if name not in self._names}
        cells[OTHER.name] = as_objects(unlisted, count)
        self._sink.rows(cells)
