"""First pass over a measurement: every value is checked, and rate and ranges are measured, before writing."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from firmware_protocol.messages import Axis
from firmware_protocol.wire import MAX_RATE_HZ, MIN_RATE_HZ
from gateway.errors import ImportDataError
from gateway.importing.columns import Block, ColumnReader
from gateway.importing.import_map import TIME_UNITS_S, ImportMap
from gateway.types import FloatArray

# Share of a sample interval; a step that deviates by more may miss or repeat a sample.
_STEP_TOLERANCE: Final = 0.5
# Relative; the protocol has one rate for the whole file.
_RATE_TOLERANCE: Final = 1e-3
_MIN_ROWS_FOR_RATE: Final = 1000


@dataclass(frozen=True, slots=True)
class Scan:
    """Result of the first pass.

    Attributes:
        skipped: rows before the start stated in the map.
        samples: rows after it.
        rate_hz: sampling rate, stated or measured by the time column.
        jitter_s: largest deviation of a step of the time column from the sample interval, None without a time column.
        low_mps2: smallest value of each axis, in the protocol's direction.
        high_mps2: largest value of each axis.
    """

    skipped: int
    samples: int
    rate_hz: float
    jitter_s: float | None
    low_mps2: dict[Axis, float]
    high_mps2: dict[Axis, float]


def scan(
    path: Path, reader: ColumnReader, import_map: ImportMap, progress: Callable[[float], None] = lambda _: None
) -> Scan:
    """Read the whole file once.

    Raises:
        ImportDataError: there are no rows, a value is not finite, the times are not uniform, or the protocol does not
            support the rate.
    """
    if import_map.sampling.rate_hz is not None:
        check_rate(path, import_map.sampling.rate_hz)
    names = import_map.columns()
    axes = import_map.axis.present()
    use = [names.index(column.column) for column in axes.values()]
    factors = np.array([column.factor_mps2 for column in axes.values()])
    offsets = np.array([column.offset for column in axes.values()])
    low, high = np.full(len(axes), np.inf), np.full(len(axes), -np.inf)
    start = _Start(import_map, names)
    bad = _BadValues(path, names, len(names) - _sparse_columns(import_map))
    for block in reader.blocks(names):
        progress(block.progress)
        bad.look(block)
        if bad.count:
            continue
        start.look(path, block)
        kept = block.values[start.rows_to_skip(block) :, use]
        if len(kept):
            scaled = (kept - offsets) * factors
            low, high = np.minimum(low, scaled.min(axis=0)), np.maximum(high, scaled.max(axis=0))
    bad.refuse()
    samples = start.rows - start.skipped
    if samples < 2:
        found = "contains no rows of data" if start.rows == 0 else f"contains {max(samples, 0)} rows after start_s"
        raise ImportDataError(f"{path} {found}", "Check the file, and start_s in [sampling] of the map.")
    rate_hz = start.rate_hz(path)
    check_rate(path, rate_hz)
    jitter_s = start.clock.jitter_s if start.clock else None
    return Scan(
        start.skipped,
        samples,
        rate_hz,
        jitter_s,
        dict(zip(axes, low.tolist(), strict=True)),
        dict(zip(axes, high.tolist(), strict=True)),
    )


def check_rate(path: Path, rate_hz: float) -> None:
    """Check that the protocol supports a rate.

    Raises:
        ImportDataError: it does not.
    """
    if rate_hz > MAX_RATE_HZ:
        remedy = (
            "Resample the file with an anti-aliasing filter, such as scipy.signal.resample_poly, and import the result."
        )
    elif rate_hz < MIN_RATE_HZ:
        remedy = "This rate cannot resolve a contact edge. Check that rate_hz is in Hz, and check time_unit."
    else:
        return
    allowed = f"{MIN_RATE_HZ:g} to {MAX_RATE_HZ:g} Hz"
    raise ImportDataError(
        f"{path}: the protocol does not support a rate of {rate_hz:.6g} Hz, allowed: {allowed}", remedy
    )


def _sparse_columns(import_map: ImportMap) -> int:
    """Return how many columns at the end may have gaps: those of the slow quantities."""
    dense = {column.column for column in import_map.axis.present().values()} | {import_map.sampling.time_column}
    return sum(name not in dense for name in import_map.columns())


class _BadValues:
    """Counter of values that are not finite, which keeps the place of the first."""

    def __init__(self, path: Path, names: Sequence[str], dense: int) -> None:
        self.count = 0
        self._path = path
        self._names = names
        self._dense = dense
        self._first = ""

    def look(self, block: Block) -> None:
        finite = np.isfinite(block.values[:, : self._dense])
        if finite.all():
            return
        rows, columns = np.nonzero(~finite)
        if not self.count:
            value = block.values[rows[0], columns[0]]
            self._first = (
                f"{block.where(int(rows[0]))}, column '{self._names[columns[0]]}': {value} is not a finite number"
            )
        self.count += len(rows)

    def refuse(self) -> None:
        if self.count:
            more = f" ({self.count} such values in the file)" if self.count > 1 else ""
            raise ImportDataError(
                f"{self._path}: {self._first}{more}", "Fill the gaps or cut them out before importing."
            )


class _Start:
    """Counter of rows that finds the first row to keep and checks the time column, if any."""

    def __init__(self, import_map: ImportMap, names: Sequence[str]) -> None:
        sampling = import_map.sampling
        self.rows = 0
        self.skipped = 0
        self.clock: _TimeColumn | None = None
        self._stated_hz = sampling.rate_hz
        self._start_s = sampling.start_s
        if sampling.time_column is not None:
            self.clock = _TimeColumn(names.index(sampling.time_column), TIME_UNITS_S[sampling.time_unit])
        elif sampling.rate_hz is not None:
            # Slightly less than the product, so that 0.1 s at 10 kHz is 1000 rows and not 1001.
            self.skipped = int(np.ceil(sampling.start_s * sampling.rate_hz - 1e-6))

    def look(self, path: Path, block: Block) -> None:
        if self.clock:
            times_s = self.clock.look(path, block)
            self.skipped += int(np.count_nonzero(times_s - self.clock.first_s < self._start_s - 1e-9))
        self.rows += len(block.values)

    def rows_to_skip(self, block: Block) -> int:
        return min(max(self.skipped - block.first_row, 0), len(block.values))

    def rate_hz(self, path: Path) -> float:
        if self.clock:
            return self.clock.rate_hz(path)
        assert self._stated_hz is not None  # the map has one of the two
        return self._stated_hz


class _TimeColumn:
    """Check of a time column for uniform steps, and measurement of its rate."""

    def __init__(self, column: int, unit_s: float) -> None:
        self.first_s = 0.0
        self.jitter_s = 0.0
        self._column = column
        self._unit_s = unit_s
        self._last_s: float | None = None
        self._interval_s = 0.0
        self._rows = 0
        self._rates: list[tuple[float, str]] = []

    def look(self, path: Path, block: Block) -> FloatArray:
        times_s = block.values[:, self._column] * self._unit_s
        if self._last_s is None:
            self.first_s = float(times_s[0])
            before = times_s
        else:
            before = np.concatenate(([self._last_s], times_s))
        steps_s = np.diff(before)
        lead = len(times_s) - len(steps_s)
        if self._interval_s == 0.0 and len(steps_s):
            self._interval_s = float(np.median(steps_s))
            if self._interval_s <= 0.0:
                raise ImportDataError(
                    f"{path}: the time does not advance from {block.where(0)} on",
                    "Check the column. If its times are rounded, state rate_hz instead of time_column.",
                )
        self._check_steps(path, block, steps_s, lead)
        self._last_s = float(times_s[-1])
        self._rows += len(times_s)
        if len(times_s) >= _MIN_ROWS_FOR_RATE:
            self._rates.append(((len(times_s) - 1) / float(times_s[-1] - times_s[0]), block.where(0)))
        return times_s

    def rate_hz(self, path: Path) -> float:
        assert self._last_s is not None
        rate_hz = (self._rows - 1) / (self._last_s - self.first_s)
        for part_hz, where in self._rates:
            if abs(part_hz / rate_hz - 1.0) > _RATE_TOLERANCE:
                raise ImportDataError(
                    f"{path}: the rate changes: {part_hz:.6g} Hz from {where} on, {rate_hz:.6g} Hz overall",
                    "Resample the file to one rate before importing.",
                )
        return rate_hz

    def _check_steps(self, path: Path, block: Block, steps_s: FloatArray, lead: int) -> None:
        if not len(steps_s):
            return
        deviations_s = np.abs(steps_s - self._interval_s)
        self.jitter_s = max(self.jitter_s, float(deviations_s.max()))
        wrong = np.flatnonzero(deviations_s > _STEP_TOLERANCE * self._interval_s)
        if len(wrong):
            row = int(wrong[0])
            step = steps_s[row] / self._interval_s
            raise ImportDataError(
                f"{path}: {block.where(row + lead)}: the time steps by {step:.3g} sample intervals"
                f" ({len(wrong)} such steps in this part of the file)",
                "If samples are missing, cut the file there. If the times are only rounded, state rate_hz "
                f"(about {1 / self._interval_s:.6g}) instead of time_column.",
            )
