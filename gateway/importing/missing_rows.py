"""Rows that a file leaves out, as steps of its time column show: gaps between the samples."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from firmware_protocol.wire import MAX_RATE_HZ
from gateway.core.errors import ImportDataError
from gateway.core.types import FloatArray, IntArray
from gateway.importing.columns import Block, BlockReader, FileFacts
from gateway.importing.import_map import TIME_UNITS_S, Sampling
from gateway.importing.time_column import MAX_SOURCE_HZ, MAX_TIME_S, ROUNDING_TOLERANCE, decimal_grid, line_through
from gateway.importing.time_counter import TimeCounter

# Share of a sample interval by which a step may differ from a whole number of them.
TOLERANCE: Final = 0.1
# Share of a sample interval by which a step without a missing row may differ from the median.
_WHOLE_STEP: Final = 0.5
# Share of a sample interval; in coarser times a missing sample looks like rounding.
_FINEST_GRID: Final = 0.02
# A longer interruption is a new measurement.
_LONGEST_S: Final = 10.0
# Rows inserted into one block: the longest interruption at the protocol's highest rate. Bounds the memory.
MAX_INSERTED_ROWS: Final = int(_LONGEST_S * MAX_RATE_HZ)
_LEARNED_ROWS: Final = 2000


class GapFilledColumns:
    """Columns of a file with an empty row for each sample that its time column skips.

    Attributes:
        left_out: number of rows inserted in the current pass.
    """

    def __init__(self, path: Path, reader: BlockReader, sampling: Sampling) -> None:
        """Read from another reader of the file `path`; without a time column all rows pass unchanged."""
        self.left_out = 0
        self._path = path
        self._reader = reader
        self._column = sampling.time_column
        self._unit_s = TIME_UNITS_S[sampling.time_unit]

    @property
    def facts(self) -> FileFacts:
        """Statements of the file about its columns."""
        return self._reader.facts

    @property
    def unreadable(self) -> int:
        """Number of cells of the current pass that are no numbers, taken for missing values."""
        return getattr(self._reader, "unreadable", 0)

    def close(self) -> None:
        """Release the file."""
        self._reader.close()

    def blocks(self, names: Sequence[str]) -> Iterator[Block]:
        """Yield the named columns from the first row on.

        Raises:
            ImportDataError: as the reader; or the gaps of a block would take more than MAX_INSERTED_ROWS.
        """
        self.left_out = 0
        if self._column is None or self._column not in names:
            yield from self._reader.blocks(names)
            return
        time_index = list(names).index(self._column)
        interval, last, counter = 0.0, np.nan, TimeCounter()
        for number, block in enumerate(self._reader.blocks(names)):
            times = counter.look(block.values[:, time_index])
            if counter.restarts:
                # The values may be those of the reader itself.
                values = block.values.copy()
                values[:, time_index] = times
                block = replace(block, values=values)
            # The check of the values rejects such a time; here, its differences would overflow.
            times = np.where(np.abs(times) <= MAX_TIME_S / self._unit_s, times, np.nan)
            if number == 0:
                interval = _interval(times)
                if interval * self._unit_s < 1.0 / MAX_SOURCE_HZ:
                    interval = 0.0
            missing = self._missing(np.concatenate(([last], times)), interval)
            if int(missing.sum()) > MAX_INSERTED_ROWS:
                raise self._too_many(block, missing, interval)
            if len(times):
                last = float(times[-1])
            yield self._filled(block, missing)

    def _missing(self, times: FloatArray, interval: float) -> IntArray:
        """Return (n - 1,) number of rows that are left out before each row."""
        if not interval > 0.0:
            return np.zeros(len(times) - 1, dtype=np.intp)
        steps = np.diff(times) / interval
        # A step to or from a row without a time compares as false.
        counts = np.rint(np.where(np.isfinite(steps), steps, 1.0))
        regular = np.abs(steps - counts) <= TOLERANCE
        # A step over two behind a repeated time is a late stamp: no sample is missing.
        counts[1:][(counts[:-1] == 0.0) & (counts[1:] == 2.0)] = 1.0
        limit = _LONGEST_S / (interval * self._unit_s)
        missing: IntArray = np.where(regular & (counts >= 2.0) & (counts <= limit), counts - 1.0, 0.0).astype(np.intp)
        return missing

    def _too_many(self, block: Block, missing: IntArray, interval: float) -> ImportDataError:
        row, total = int(np.argmax(missing)), int(missing.sum())
        gaps = int(np.count_nonzero(missing))
        step_s = float(missing[row] + 1) * interval * self._unit_s
        gaps_note = f", and {gaps} such gaps together skip {total}" if gaps > 1 else ""
        return ImportDataError(
            f"{self._path}: {block.where(row)}: the time steps by {step_s:.6g} s, which skips {missing[row]} samples"
            f"{gaps_note}; allowed within {len(missing)} rows: {MAX_INSERTED_ROWS}",
            "Correct the times there. If samples are missing, cut the file at the gap. If no sample is missing, state "
            "rate_hz instead of time_column.",
        )

    def _filled(self, block: Block, missing: IntArray) -> Block:
        offset = self.left_out
        total = int(missing.sum())
        self.left_out += total
        if not total:
            return Block(block.first_row + offset, block.values, block.where, block.progress)
        places = np.arange(len(missing)) + np.cumsum(missing)
        values = np.full((len(missing) + total, block.values.shape[1]), np.nan)
        values[places] = block.values

        def where(row: int) -> str:
            return block.where(min(int(np.searchsorted(places, row)), len(places) - 1))

        return Block(block.first_row + offset, values, where, block.progress)


def _interval(times: FloatArray) -> float:
    """Return the sample interval in the column's unit, 0 when the times are too coarse to show a missing sample."""
    timed_rows = np.flatnonzero(np.isfinite(times))[:_LEARNED_ROWS]
    if len(timed_rows) < 3:
        return 0.0
    rows, steps = np.diff(timed_rows), np.diff(times[timed_rows])
    interval = float(np.median(steps / rows))
    # The median of rounded steps is a multiple of the rounding. Their mean is not; a step that skips rows is left out.
    is_regular = np.abs(steps / rows - interval) <= _WHOLE_STEP * interval
    if is_regular.any():
        interval = float(steps[is_regular].sum() / rows[is_regular].sum())
    grid = decimal_grid(times[timed_rows])
    is_coarse = grid is not None and grid > _FINEST_GRID * interval and _is_rounded(times[timed_rows], timed_rows, grid)
    return 0.0 if is_coarse else interval


def _is_rounded(times: FloatArray, rows: IntArray, grid: float) -> bool:
    """Return whether times are even ones, rounded to a grid; else they are exact, and some skip samples."""
    mantissa = grid / 10.0 ** np.floor(np.log10(grid * (1.0 + 1e-9)))
    return min(abs(mantissa - digit) for digit in (1.0, 2.0, 5.0)) < 1e-6 and (
        line_through(rows.astype(np.float64), times)[1] <= ROUNDING_TOLERANCE * grid
    )
