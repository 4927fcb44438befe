"""Contents of an export: columns, and rows that are read from the recording block by block."""

import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_protocol.messages import Axis
from gateway.core.constants import AXIS_NAMES
from gateway.core.estimates.result_block import blocks_of
from gateway.core.estimates.results import RevolutionResult
from gateway.core.quantity_catalogue import CATALOGUE, quantity_of
from gateway.core.recording.revolution_fields import estimate_descriptions
from gateway.core.revolutions.angle_resampling import GRID_SIZE, angle_grid, elapsed_angles
from gateway.core.revolutions.order_spectrum import ORDER_COUNT
from gateway.core.table_columns import (
    AVERAGE_COLUMNS,
    OTHER,
    RESULT_HEAD,
    RESULT_TAIL,
    REVOLUTION_COLUMNS,
    SAMPLE_COLUMNS,
    Column,
    estimate_columns,
)
from gateway.core.text.numbers import distinct_name
from gateway.core.text.result_columns import TAKEN, Cells, as_objects, estimate_cells, result_columns, unknown
from gateway.core.types import FloatArray
from gateway.exporting.export_registry import CONTENTS, SAMPLES
from gateway.exporting.export_table import DTYPES, Block, WheelTable
from gateway.exporting.mean_revolution import MeanOfRevolutions
from gateway.exporting.recorded_signals import SignalBlock

# Revolutions in one block of rows.
_BLOCK_REVOLUTIONS: Final = 64
# Results that are looked at for names of estimates that are not listed, such as those of plug-ins.
_LOOKED_AT: Final = 256


class Source(NamedTuple):
    """What the rows are read from.

    Attributes:
        samples: makes an iterator over the samples of the chosen wheels.
        results: makes an iterator over their revolutions, with the estimators or without.
        recording: file name of the recording.
        start_ns: zero of the times.
        estimators: names of the estimators.
    """

    samples: Callable[[], Iterator[SignalBlock]]
    results: Callable[[bool], Iterator[RevolutionResult]]
    recording: str
    start_ns: int
    estimators: Sequence[str]


@dataclass(frozen=True, slots=True)
class Measured:
    """A content of a recording.

    Attributes:
        what: its name.
        columns: of every wheel.
        rows: wheel and block of rows, in the order of the recording.
    """

    what: str
    columns: tuple[Column, ...]
    rows: Iterator[tuple[str, Block]]

    def table(self, wheel: str) -> WheelTable:
        """Return the table of a wheel, without conditions."""
        return WheelTable(self.what, wheel, self.columns)


def measured(what: str, source: Source) -> Measured:
    """Return a content of a recording; nothing is read but the first results of the estimators.

    Raises:
        KeyError: there is no such content.
    """
    if what == SAMPLES:
        return Measured(what, _OF_SAMPLES, _sample_rows(source))
    results = source.results(CONTENTS[what].needs_estimators)
    if what == "angle":
        return Measured(what, _ANGLE_COLUMNS, _blocks(results, _ANGLE_COLUMNS, _in_angle(source.start_ns)))
    if what == "orders":
        return Measured(what, _ORDER_COLUMNS, _blocks(results, _ORDER_COLUMNS, _in_orders(source.start_ns)))
    if what == "average":
        return Measured(what, _AVERAGE_COLUMNS, _average_rows(results, source.start_ns))
    first = list(itertools.islice(results, _LOOKED_AT))
    columns = _estimate_columns(first, source.estimators)
    results = itertools.chain(first, results)
    return Measured(what, columns, _estimate_rows(results, columns, source))


# --- samples

_OF_SAMPLES: Final = tuple(column for column in SAMPLE_COLUMNS.values() if column.name != "host_utc")


def _sample_rows(source: Source) -> Iterator[tuple[str, Block]]:
    for block in source.samples():
        rows = len(block)
        lost = np.zeros(rows, np.int64)
        lost[:1] = block.lost_before
        yield (
            block.wheel,
            {
                "time_s": (block.host_time_ns - source.start_ns) * 1e-9,
                **{f"{name}_mps2": block.axes_mps2[:, axis] for axis, name in enumerate(AXIS_NAMES)},
                "saturated": block.saturated,
                "lost_before": lost,
                "number": block.first_sample + np.arange(rows, dtype=np.int64),
                "segment": np.full(rows, block.segment, np.int64),
                "device_s": block.hub_time_s,
                "host_ns": block.host_time_ns,
            },
        )


# --- contents of revolutions

Rows = dict[str, Any]


def _gathered(results: Iterable[RevolutionResult]) -> Iterator[tuple[str, list[RevolutionResult]]]:
    """Yield wheel and several of its results at once."""
    pending: dict[str, list[RevolutionResult]] = {}
    for result in results:
        of_wheel = pending.setdefault(result.position, [])
        of_wheel.append(result)
        if len(of_wheel) >= _BLOCK_REVOLUTIONS:
            yield result.position, pending.pop(result.position)
    yield from pending.items()


def _blocks(
    results: Iterable[RevolutionResult], columns: Sequence[Column], rows_of: Callable[[RevolutionResult], Rows]
) -> Iterator[tuple[str, Block]]:
    """Yield the rows of results, several revolutions of a wheel at once."""
    return ((wheel, _joined(columns, list(map(rows_of, of_wheel)))) for wheel, of_wheel in _gathered(results))


def _joined(columns: Sequence[Column], rows: Sequence[Rows]) -> Block:
    return {
        column.name: np.concatenate([np.atleast_1d(np.asarray(row[column.name], DTYPES[column.kind])) for row in rows])
        for column in columns
    }


# --- angle

_ANGLE_COLUMNS: Final = (
    *(REVOLUTION_COLUMNS[name] for name in ("time_s", "revolution", "angle_rad")),
    *(REVOLUTION_COLUMNS[f"{name}_mps2"] for name in (*AXIS_NAMES, "normalised")),
    *(REVOLUTION_COLUMNS[name] for name in ("omega_radps", "usable")),
    SAMPLE_COLUMNS["host_ns"],
)


def _in_angle(start_ns: int) -> Callable[[RevolutionResult], Rows]:
    # In the order of time: a revolution begins at angle 0, in the middle of the grid.
    order = np.argsort(elapsed_angles())
    angle, elapsed = angle_grid()[order], elapsed_angles()[order]

    def rows_of(result: RevolutionResult) -> Rows:
        revolution = result.revolution
        host_ns = _begin_ns(result) + np.rint(_times_s(result, elapsed) * 1e9).astype(np.int64)
        return {
            "time_s": (host_ns - start_ns) * 1e-9,
            "revolution": np.full(GRID_SIZE, revolution.index),
            "angle_rad": angle,
            **{f"{AXIS_NAMES[axis]}_mps2": revolution.axes_mps2[axis][order] for axis in Axis},
            "normalised_mps2": revolution.radial_mps2[order],
            "omega_radps": np.full(GRID_SIZE, revolution.omega_radps),
            "usable": np.full(GRID_SIZE, not revolution.faults),
            "host_ns": host_ns,
        }

    return rows_of


def _begin_ns(result: RevolutionResult) -> int:
    """Return the host time of the begin of a revolution."""
    return result.host_ns - round(result.revolution.period_s * 1e9)


def _times_s(result: RevolutionResult, elapsed_rad: FloatArray) -> FloatArray:
    """Return the times since the begin of a revolution at constant angular acceleration, same shape."""
    revolution = result.revolution
    begin_radps = revolution.omega_radps - 0.5 * revolution.omega_dot_radps2 * revolution.period_s
    square = np.maximum(begin_radps**2 + 2.0 * revolution.omega_dot_radps2 * elapsed_rad, 0.0)
    times: FloatArray = 2.0 * elapsed_rad / (begin_radps + np.sqrt(square))
    return times


# --- orders

_ORDER_COLUMNS: Final = (
    *(REVOLUTION_COLUMNS[name] for name in ("time_s", "revolution", "omega_radps", "usable", "order_max")),
    *(
        Column(f"order_{order:02d}_{part}_mps2", f"{part} coefficient of order {order} of the normalised radial axis")
        for order in range(ORDER_COUNT)
        for part in ("cosine", "sine")
    ),
    SAMPLE_COLUMNS["host_ns"],
)


def _in_orders(start_ns: int) -> Callable[[RevolutionResult], Rows]:
    def row_of_orders(result: RevolutionResult) -> Rows:
        revolution = result.revolution
        row: Rows = {
            "time_s": (result.host_ns - start_ns) * 1e-9,
            "revolution": revolution.index,
            "omega_radps": revolution.omega_radps,
            "usable": not revolution.faults,
            "order_max": revolution.order_max,
            "host_ns": result.host_ns,
        }
        for order, value in enumerate(revolution.orders_mps2.tolist()):
            # A coefficient is c - i s.
            row[f"order_{order:02d}_cosine_mps2"] = value.real
            row[f"order_{order:02d}_sine_mps2"] = -value.imag if not math.isnan(value.imag) else math.nan
        return row

    return row_of_orders


# --- average

_AVERAGE_COLUMNS: Final = tuple(AVERAGE_COLUMNS.values())


def _average_rows(results: Iterable[RevolutionResult], start_ns: int) -> Iterator[tuple[str, Block]]:
    means: dict[str, MeanOfRevolutions] = {}
    for result in results:
        if not result.revolution.faults:
            means.setdefault(result.position, MeanOfRevolutions()).add(result.revolution)
    for wheel, total in means.items():
        mean = total.mean()
        if mean is None:
            continue
        yield (
            wheel,
            {
                **mean.curves(),
                "revolutions": np.full(GRID_SIZE, mean.count, np.int64),
                "omega_radps": np.full(GRID_SIZE, mean.omega_radps),
                "omega_std_radps": np.full(GRID_SIZE, mean.omega_std_radps),
                "host_ns": np.full(GRID_SIZE, start_ns, np.int64),
            },
        )


# --- estimates

# The wheel is the table's, and the time a column of its own.
_LEFT_OUT: Final = frozenset({"position", "host_utc"})


def _estimate_columns(first: Iterable[RevolutionResult], estimators: Sequence[str]) -> tuple[Column, ...]:
    names = dict.fromkeys(estimate_descriptions(name for name in CATALOGUE if name in estimators))
    for result in first:
        names |= dict.fromkeys(_plain(distinct_name(estimate.name, TAKEN)) for estimate in result.estimates)
    descriptions = estimate_descriptions()
    return (
        REVOLUTION_COLUMNS["time_s"],
        *(column for column in RESULT_HEAD.values() if column.name not in _LEFT_OUT),
        REVOLUTION_COLUMNS["period_s"],
        REVOLUTION_COLUMNS["omega_radps"],
        *(
            column
            for name in names
            for column in estimate_columns(name, descriptions.get(name) or quantity_of(name).description)
        ),
        *RESULT_TAIL.values(),
        OTHER,
    )


def _plain(name: str) -> str:
    return name.replace("/", "_over_")


def _estimate_rows(
    results: Iterable[RevolutionResult], columns: Sequence[Column], source: Source
) -> Iterator[tuple[str, Block]]:
    names = {column.name for column in columns}
    for wheel, of_wheel in _gathered(results):
        for block in blocks_of(of_wheel):
            fixed, named = result_columns(block, source.recording)
            plain = {_plain(name): parts for name, parts in named.items()}
            cells = fixed | estimate_cells(plain)
            cells["time_s"] = np.array([(result.host_ns - source.start_ns) * 1e-9 for result in block.results])
            cells["period_s"] = np.array([revolution.period_s for revolution in block.revolutions])
            cells["omega_radps"] = np.array([revolution.omega_radps for revolution in block.revolutions])
            cells[OTHER.name] = as_objects(
                {name: parts for name, parts in plain.items() if name not in names}, len(block)
            )
            missing = {column.name: unknown(column, len(block)) for column in columns if column.name not in cells}
            yield wheel, {column.name: _converted(cells | missing, column) for column in columns}


def _converted(cells: Mapping[str, Cells], column: Column) -> NDArray[Any]:
    """Return cells of the type of a column: 0 for an unknown time, empty for an unknown text."""
    values = cells[column.name]
    if values.dtype.kind == "M":
        values = np.where(np.isnat(values), 0, values.view(np.int64))
    if column.kind is str:
        values = np.array(["" if text is None else text for text in values.tolist()], np.object_)
    return values.astype(DTYPES[column.kind], copy=False)
