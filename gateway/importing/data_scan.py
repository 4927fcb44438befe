"""First pass over a measurement: every value is checked, and rate and ranges are measured, before writing."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from firmware_protocol.messages import Axis
from firmware_protocol.wire import MAX_RATE_HZ, MIN_RATE_HZ
from gateway.core.errors import ImportDataError
from gateway.core.revolutions.bridged_gaps import BridgedGaps, Bridging
from gateway.core.types import FloatArray
from gateway.importing.columns import Block, BlockReader
from gateway.importing.decimation import Decimation, decimation_factor
from gateway.importing.held_samples import Held, HeldSamples
from gateway.importing.import_map import TIME_UNITS_S, ImportedWheel, ImportMap
from gateway.importing.sample_rows import SampleRows
from gateway.importing.time_column import MAX_SOURCE_HZ, MAX_TIME_S, TimeColumn

# A million g; no sensor reads as much, and its square must still be a number.
_MAX_MPS2: Final = 1e7
# A file with more gaps has columns of different rates.
_JOINED_ROWS: Final = 16384
_MAX_GAP_SHARE: Final = 0.5


@dataclass(frozen=True, slots=True)
class WheelScan:
    """Result of the first pass for one wheel.

    Attributes:
        gaps: samples in which an axis has no value.
        low_mps2: smallest value of each axis, in the protocol's direction.
        high_mps2: largest value of each axis.
        liveliest_mps2: (n,) radial axis of the block with the largest scatter, NaN in gaps.
        bridging: gaps that are bridged by straight lines, None without any.
        held: runs of samples of the file that repeat exactly, by the numbers of axes present; None without any.
    """

    gaps: int
    low_mps2: dict[Axis, float]
    high_mps2: dict[Axis, float]
    liveliest_mps2: FloatArray
    bridging: Bridging | None
    held: Held | None


@dataclass(frozen=True, slots=True)
class Scan:
    """Result of the first pass.

    Attributes:
        skipped: rows before the start stated in the map.
        samples: samples of each wheel after it, at the rate of the recording.
        rate_hz: sampling rate of the recording: that of the file, or a whole part of it.
        decimation: reduction of the file's rate, None where it is kept.
        rate_std_hz: standard error of the rate where the times are rounded, else None.
        rounding_s: step to which the times are rounded, None when they are not.
        jitter_s: largest deviation of a step of the time column from the sample interval, None without a time column.
        first_s: time of the first row by the time column, 0 without one.
        rate_change: as `TimeColumn.rate_change`, None without a time column.
        wheels: result for each wheel.
        ranges: (references, 2) smallest and largest value of each reference column, NaN without one.
        means: (references, 2) mean and standard deviation of each reference column, NaN without a value.
    """

    skipped: int
    samples: int
    rate_hz: float
    decimation: Decimation | None
    rate_std_hz: float | None
    rounding_s: float | None
    jitter_s: float | None
    first_s: float
    rate_change: tuple[float, float, float] | None
    wheels: tuple[WheelScan, ...]
    ranges: FloatArray
    means: FloatArray

    @property
    def source_rate_hz(self) -> float:
        """Rate of the file."""
        return self.rate_hz * (self.decimation.factor if self.decimation else 1)


def scan(
    path: Path, reader: BlockReader, import_map: ImportMap, progress: Callable[[float], None] = lambda _: None
) -> Scan:
    """Read the whole file, twice when a time column reveals only at its end that the rate is above the protocol's.

    Raises:
        ImportDataError: there are no rows, a value is infinite, most rows have no value, the times are not uniform, or
            the protocol does not support the rate.
    """
    if import_map.sampling.rate_hz is not None:
        check_rate(path, import_map.sampling.rate_hz)
    file_scan = _scan(path, reader, import_map, progress, None)
    factor = decimation_factor(file_scan.source_rate_hz)
    if factor != (file_scan.decimation.factor if file_scan.decimation else 1):
        file_scan = _scan(path, reader, import_map, progress, factor)
    return file_scan


def _scan(
    path: Path, reader: BlockReader, import_map: ImportMap, progress: Callable[[float], None], factor: int | None
) -> Scan:
    names = import_map.columns()
    start = _Start(import_map, names)
    bad = _BadValues(path, names, _limits(import_map))
    references = [_ReferenceRange(names.index(reference.column)) for reference in import_map.reference]
    rows: SampleRows | None = None
    wheels = [_WheelRange(wheel) for wheel in import_map.wheels()]
    samples = 0
    for block in reader.blocks(names):
        progress(block.progress)
        bad.look(block)
        if bad.count:
            continue
        start.look(path, block)
        if rows is None:
            factor = factor or decimation_factor(start.first_rate_hz)
            rows = SampleRows(import_map, factor)
        values = block.values[start.rows_to_skip(block) :]
        for reference in references:
            reference.look(values)
        for wheel, places in zip(wheels, rows.wheels, strict=True):
            wheel.held.add(values[:, places.axes])
        samples += _take(wheels, rows, rows.feed(values))
    bad.refuse()
    if rows is not None:
        samples += _take(wheels, rows, rows.finish(len(names)))
    start.require_rows(path, samples)
    for wheel in wheels:
        wheel.check_gaps(path, samples)
    rate_hz, rate_std_hz = start.rate_hz(path)
    check_rate(path, rate_hz)
    factor = factor or 1
    decimation = Decimation.of(factor, rate_hz)
    return Scan(
        skipped=start.skipped,
        samples=samples,
        # A measured rate may be above the limit by its own error.
        rate_hz=min(rate_hz / factor, MAX_RATE_HZ) if factor == decimation_factor(rate_hz) else rate_hz / factor,
        decimation=decimation,
        rate_std_hz=None if rate_std_hz is None else rate_std_hz / factor,
        rounding_s=start.clock.rounding_s if start.clock else None,
        jitter_s=start.clock.jitter_s if start.clock else None,
        first_s=start.clock.first_s if start.clock else 0.0,
        rate_change=start.rate_change(),
        wheels=tuple(wheel.wheel_scan() for wheel in wheels),
        ranges=np.array([reference.range for reference in references]).reshape(-1, 2),
        means=np.array([reference.mean for reference in references]).reshape(-1, 2),
    )


class _ReferenceRange:
    """Smallest and largest value of a reference, its mean and its standard deviation; NaN without a value."""

    def __init__(self, column: int) -> None:
        self._column = column
        self._count, self._sum, self._squares = 0, 0.0, 0.0
        self.range = (math.nan, math.nan)

    def look(self, values: FloatArray) -> None:
        present = values[:, self._column][np.isfinite(values[:, self._column])]
        if len(present):
            self._count += len(present)
            self._sum += float(present.sum())
            self._squares += float(np.square(present).sum())
            self.range = float(np.fmin(self.range[0], present.min())), float(np.fmax(self.range[1], present.max()))

    @property
    def mean(self) -> tuple[float, float]:
        if not self._count:
            return math.nan, math.nan
        mean = self._sum / self._count
        return mean, math.sqrt(max(self._squares / self._count - mean**2, 0.0))


def _take(wheels: Sequence[_WheelRange], rows: SampleRows, values: FloatArray) -> int:
    for wheel, columns in zip(wheels, rows.wheels, strict=True):
        wheel.look(values[:, columns.axes])
    return len(values)


class _WheelRange:
    """Ranges and gaps of one wheel's axes."""

    def __init__(self, wheel: ImportedWheel) -> None:
        self._wheel = wheel
        self._axes = list(wheel.axis.present())
        self._low, self._high = np.full(len(self._axes), np.inf), np.full(len(self._axes), -np.inf)
        self._radial = self._axes.index(Axis.RADIAL)
        self._liveliest, self._max_scatter = np.empty(0), -1.0
        self._recent = np.empty(0)
        self._gaps = 0
        self._bridged = BridgedGaps(len(self._axes))
        self.held = HeldSamples(len(self._axes))

    def look(self, values_mps2: FloatArray) -> None:
        present = np.isfinite(values_mps2).all(axis=1)
        self._bridged.add(values_mps2)
        self._gaps += len(values_mps2) - int(np.count_nonzero(present))
        if not present.any():
            return
        self._low = np.minimum(self._low, values_mps2[present].min(axis=0))
        self._high = np.maximum(self._high, values_mps2[present].max(axis=0))
        # The parts of a folder may be shorter than a revolution.
        self._recent = np.concatenate((self._recent, values_mps2[:, self._radial]))
        if len(self._recent) >= _JOINED_ROWS:
            self._compare_recent()

    def _compare_recent(self) -> None:
        scatter = float(np.nanstd(self._recent)) if np.isfinite(self._recent).any() else -1.0
        if scatter > self._max_scatter:
            self._liveliest, self._max_scatter = self._recent, scatter
        self._recent = np.empty(0)

    def check_gaps(self, path: Path, samples: int) -> None:
        if self._gaps > _MAX_GAP_SHARE * samples:
            raise ImportDataError(
                f"{path}: in {self._gaps} of {samples} rows an axis has no value",
                "Leave the axis out of the map, or resample the columns to one rate before importing.",
            )

    def wheel_scan(self) -> WheelScan:
        self._compare_recent()
        return WheelScan(
            gaps=self._gaps,
            low_mps2=dict(zip(self._axes, self._low.tolist(), strict=True)),
            high_mps2=dict(zip(self._axes, self._high.tolist(), strict=True)),
            liveliest_mps2=self._liveliest,
            bridging=self._bridged.result(),
            held=self.held.result(),
        )


def check_rate(path: Path, rate_hz: float) -> None:
    """Check that the protocol supports a rate.

    Raises:
        ImportDataError: it does not.
    """
    if rate_hz < MIN_RATE_HZ:
        raise ImportDataError(
            f"{path}: the protocol does not support a rate of {rate_hz:.6g} Hz, allowed: {MIN_RATE_HZ:g} Hz or more",
            "This rate cannot resolve a contact edge. Check that rate_hz is in Hz, and check time_unit.",
        )
    if rate_hz > MAX_SOURCE_HZ:
        raise ImportDataError(
            f"{path}: a rate of {rate_hz:.6g} Hz cannot be right, allowed: up to {MAX_SOURCE_HZ:g} Hz",
            "Check the column and time_unit.",
        )


def _limits(import_map: ImportMap) -> FloatArray:
    """Return the largest magnitude of each axis and of the time column, in the columns' units and order."""
    limits = {
        column.column: _MAX_MPS2 / abs(column.factor_mps2) + abs(column.offset) for column in import_map.axis_columns()
    }
    if import_map.sampling.time_column is not None:
        limits.setdefault(import_map.sampling.time_column, MAX_TIME_S / TIME_UNITS_S[import_map.sampling.time_unit])
    return np.array([limits[name] for name in import_map.columns() if name in limits])


class _BadValues:
    """Counter of values that no sensor gives, which keeps the place of the first. NaN is a gap."""

    def __init__(self, path: Path, names: Sequence[str], limits: FloatArray) -> None:
        """Prepare the check of the first columns, which have (n,) limits."""
        self.count = 0
        self._path = path
        self._names = names
        self._limits = limits
        self._first = ""

    def look(self, block: Block) -> None:
        bad = np.abs(block.values[:, : len(self._limits)]) > self._limits
        if not bad.any():
            return
        rows, columns = np.nonzero(bad)
        if not self.count:
            value, name = block.values[rows[0], columns[0]], self._names[columns[0]]
            self._first = f"{block.where(int(rows[0]))}, column '{name}': {value:g} cannot be measured"
        self.count += len(rows)

    def refuse(self) -> None:
        if self.count:
            count_note = f" ({self.count} such values in the file)" if self.count > 1 else ""
            raise ImportDataError(
                f"{self._path}: {self._first}{count_note}",
                "Check column and unit. Where there is no value, leave the cell empty: the import keeps the gap.",
            )


class _Start:
    """Counter of rows that finds the first row to keep and checks the time column, if any."""

    def __init__(self, import_map: ImportMap, names: Sequence[str]) -> None:
        sampling = import_map.sampling
        self.rows = 0
        self.skipped = 0
        self.clock: TimeColumn | None = None
        self._stated_hz = sampling.rate_hz
        self._start_s = sampling.start_s
        if sampling.time_column is not None:
            self.clock = TimeColumn(names.index(sampling.time_column), TIME_UNITS_S[sampling.time_unit])
        elif sampling.rate_hz is not None:
            # Slightly less than the product, so that 0.1 s at 10 kHz is 1000 rows and not 1001.
            self.skipped = int(np.ceil(sampling.start_s * sampling.rate_hz - 1e-6))

    def look(self, path: Path, block: Block) -> None:
        if self.clock:
            times_s = self.clock.look(path, block)
            self.skipped += int(np.count_nonzero(times_s - self.clock.first_s < self._start_s - 1e-9))
        self.rows += len(block.values)

    @property
    def first_rate_hz(self) -> float:
        """Rate that is stated, or that of the first block; 0 when there is none."""
        if self.clock:
            return 1.0 / self.clock.interval_s if self.clock.interval_s > 0 else 0.0
        return self._stated_hz or 0.0

    def rate_change(self) -> tuple[float, float, float] | None:
        return self.clock.rate_change() if self.clock else None

    def require_rows(self, path: Path, samples: int) -> None:
        rows = max(self.rows - self.skipped, 0)
        if min(rows, samples) < 2:
            shortage = f"contains {rows} rows after start_s" if self.rows else "contains no rows of data"
            raise ImportDataError(f"{path} {shortage}", "Check the file, and start_s in [sampling] of the map.")

    def rows_to_skip(self, block: Block) -> int:
        return min(max(self.skipped - block.first_row, 0), len(block.values))

    def rate_hz(self, path: Path) -> tuple[float, float | None]:
        if self.clock:
            return self.clock.rate_hz(path)
        assert self._stated_hz is not None  # the map has one of the two
        return self._stated_hz, None
