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
from gateway.importing.time_column import TimeColumn
from gateway.types import FloatArray

# A million g; no sensor reads as much, and its square must still be a number.
_MAX_MPS2: Final = 1e7
# The ten-thousandfold of the time since 1970.
_MAX_TIME_S: Final = 1e13
# A file with more gaps has columns of different rates.
_MAX_GAP_SHARE: Final = 0.5


@dataclass(frozen=True, slots=True)
class Scan:
    """Result of the first pass.

    Attributes:
        skipped: rows before the start stated in the map.
        samples: rows after it.
        gaps: those in which an axis has no value.
        rate_hz: sampling rate, stated or measured by the time column.
        rate_std_hz: its standard error where the times are rounded, else None.
        rounding_s: step to which the times are rounded, None when they are not.
        jitter_s: largest deviation of a step of the time column from the sample interval, None without a time column.
        low_mps2: smallest value of each axis, in the protocol's direction.
        high_mps2: largest value of each axis.
        liveliest_mps2: (n,) radial axis of the block with the largest scatter, NaN in gaps.
    """

    skipped: int
    samples: int
    gaps: int
    rate_hz: float
    rate_std_hz: float | None
    rounding_s: float | None
    jitter_s: float | None
    low_mps2: dict[Axis, float]
    high_mps2: dict[Axis, float]
    liveliest_mps2: FloatArray


def scan(
    path: Path, reader: ColumnReader, import_map: ImportMap, progress: Callable[[float], None] = lambda _: None
) -> Scan:
    """Read the whole file once.

    Raises:
        ImportDataError: there are no rows, a value is infinite, most rows have no value, the times are not uniform, or
            the protocol does not support the rate.
    """
    if import_map.sampling.rate_hz is not None:
        check_rate(path, import_map.sampling.rate_hz)
    names = import_map.columns()
    axes = import_map.axis.present()
    use = [names.index(column.column) for column in axes.values()]
    factors = np.array([column.factor_mps2 for column in axes.values()])
    offsets = np.array([column.offset for column in axes.values()])
    low, high = np.full(len(axes), np.inf), np.full(len(axes), -np.inf)
    radial = list(axes).index(Axis.RADIAL)
    liveliest, most = np.empty(0), -1.0
    gaps = 0
    start = _Start(import_map, names)
    bad = _BadValues(path, names, _limits(import_map))
    for block in reader.blocks(names):
        progress(block.progress)
        bad.look(block)
        if bad.count:
            continue
        start.look(path, block)
        scaled = (block.values[start.rows_to_skip(block) :, use] - offsets) * factors
        present = np.isfinite(scaled).all(axis=1)
        gaps += len(scaled) - int(np.count_nonzero(present))
        if present.any():
            low = np.minimum(low, scaled[present].min(axis=0))
            high = np.maximum(high, scaled[present].max(axis=0))
            scatter = float(scaled[present, radial].std())
            if scatter > most:
                liveliest, most = scaled[:, radial].copy(), scatter
    bad.refuse()
    samples = start.rows - start.skipped
    if samples < 2:
        found = "contains no rows of data" if start.rows == 0 else f"contains {max(samples, 0)} rows after start_s"
        raise ImportDataError(f"{path} {found}", "Check the file, and start_s in [sampling] of the map.")
    if gaps > _MAX_GAP_SHARE * samples:
        raise ImportDataError(
            f"{path}: in {gaps} of {samples} rows an axis has no value",
            "Leave the axis out of the map, or resample the columns to one rate before importing.",
        )
    rate_hz, rate_std_hz = start.rate_hz(path)
    check_rate(path, rate_hz)
    return Scan(
        skipped=start.skipped,
        samples=samples,
        gaps=gaps,
        rate_hz=rate_hz,
        rate_std_hz=rate_std_hz,
        rounding_s=start.clock.rounding_s if start.clock else None,
        jitter_s=start.clock.jitter_s if start.clock else None,
        low_mps2=dict(zip(axes, low.tolist(), strict=True)),
        high_mps2=dict(zip(axes, high.tolist(), strict=True)),
        liveliest_mps2=liveliest,
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


def _limits(import_map: ImportMap) -> FloatArray:
    """Return the largest magnitude of each axis and of the time column, in the columns' units and order."""
    limits = {
        column.column: _MAX_MPS2 / abs(column.factor_mps2) + abs(column.offset)
        for column in import_map.axis.present().values()
    }
    if import_map.sampling.time_column is not None:
        limits.setdefault(import_map.sampling.time_column, _MAX_TIME_S / TIME_UNITS_S[import_map.sampling.time_unit])
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
            more = f" ({self.count} such values in the file)" if self.count > 1 else ""
            raise ImportDataError(
                f"{self._path}: {self._first}{more}",
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

    def rows_to_skip(self, block: Block) -> int:
        return min(max(self.skipped - block.first_row, 0), len(block.values))

    def rate_hz(self, path: Path) -> tuple[float, float | None]:
        if self.clock:
            return self.clock.rate_hz(path)
        assert self._stated_hz is not None  # the map has one of the two
        return self._stated_hz, None
