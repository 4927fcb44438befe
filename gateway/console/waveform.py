"""Two curves over the angle around the contact, drawn with braille dots into terminal cells."""

import math
from enum import Enum
from functools import lru_cache
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gateway.core.types import BoolArray, FloatArray


class Ink(Enum):
    """Element of the plot; views give each a colour."""

    AXIS = "axis"
    LAST = "last"
    AVERAGE = "average"


class Zoom(Enum):
    """Half range shown around the contact centre, in degrees."""

    WHOLE = 180
    CONTACT = 90


PlotRow = tuple[tuple[str, Ink], ...]

MIN_WIDTH: Final = 24
MIN_HEIGHT: Final = 4
GUTTER: Final = 7  # `-12000┤`
_AXIS_ROWS: Final = 2
# Bit of each of the 4 x 2 dots of a braille cell, by row and column.
_DOT_BITS: Final = np.array([[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]], dtype=np.uint16)
_BRAILLE: Final = 0x2800
_BLANK: Final = ord(" ")
_DEFAULT_TOP_MPS2: Final = 1.0
_MIN_SPAN_MPS2: Final = 1e-3  # finer than any sensor resolves: drawn as a flat line
_AVERAGE_EVERY: Final = 2  # dot columns; sparse dots distinguish the average from the solid line without colour
LEGEND: Final[PlotRow] = (
    ("⠤⠤⠤", Ink.LAST),
    (" last  ", Ink.AXIS),
    ("⠄⠄⠄", Ink.AVERAGE),
    (" average", Ink.AXIS),
)
"""Explains the two curves."""


class Scale(NamedTuple):
    """Limits of an axis and the step of its ticks."""

    low: float
    high: float
    step: float


def nice_scale(low: float, high: float, ticks: int) -> Scale:
    """Return limits that hold [low, high] and a 1-2-5 tick step for about `ticks` ticks.

    The limits are multiples of a quarter step: steady from revolution to revolution without wasting a whole step.
    """
    span = high - low
    if span < _MIN_SPAN_MPS2:
        return Scale(low, low + _DEFAULT_TOP_MPS2, _DEFAULT_TOP_MPS2)
    rough_step = span / max(ticks, 1)
    decade = 10.0 ** math.floor(math.log10(rough_step))
    step = next(factor * decade for factor in (1.0, 2.0, 5.0, 10.0) if factor * decade >= rough_step * 0.999999)
    quantum = step / 4.0
    return Scale(quantum * math.floor(low / quantum + 1e-9), quantum * math.ceil(high / quantum - 1e-9), step)


@lru_cache(maxsize=16)
def _grid(n: int, half_range_rad: float, columns: int) -> tuple[FloatArray, FloatArray, int]:
    """Return where to read a curve of n samples, its sample numbers, and the readings per dot column."""
    per_column = max(1, math.ceil(n * half_range_rad / (math.pi * columns)))
    angle = np.linspace(-half_range_rad, half_range_rad, columns * per_column)
    return (angle + math.pi) * (n / (2.0 * math.pi)), np.arange(n + 1.0), per_column


def _columns(curve: FloatArray, half_range_rad: float, columns: int) -> tuple[FloatArray, FloatArray]:
    """Return the least and greatest value of the curve within each dot column; NaN where there is none."""
    grid, samples, per_column = _grid(len(curve), half_range_rad, columns)
    curve = np.where(np.isfinite(curve), curve, np.nan)
    # The curve is periodic: its first sample, at -pi, is its last as well.
    values = np.interp(grid, samples, np.append(curve, curve[0])).reshape(columns, per_column)
    return np.fmin.reduce(values, axis=1), np.fmax.reduce(values, axis=1)


def _dots(low: FloatArray, high: FloatArray, scale: Scale, rows: int, joined: bool) -> BoolArray:
    """Return which dots (rows from the top x columns) a curve covers; `joined` closes jumps between columns."""
    per_unit = (rows - 1) / (scale.high - scale.low)
    unknown = np.isnan(low)
    top, bottom = (scale.high - high) * per_unit, (scale.high - low) * per_unit
    # Columns without a value become an empty range below the plot.
    top[unknown], bottom[unknown] = 2.0 * rows, -1.0
    top, bottom = np.rint(top).astype(np.intp), np.rint(bottom).astype(np.intp)
    if joined:
        gap_up, gap_down = top[:-1] - 1, bottom[:-1] + 1
        drawn = (bottom >= top)[:-1] & (bottom >= top)[1:]
        bottom[1:] = np.where(drawn & (gap_up > bottom[1:]), gap_up, bottom[1:])
        top[1:] = np.where(drawn & (gap_down < top[1:]), gap_down, top[1:])
    row = np.arange(rows)[:, None]
    return (row >= top) & (row <= bottom)


def _pack(dots: BoolArray) -> NDArray[np.uint16]:
    """Return the braille bits of every cell."""
    rows, columns = dots.shape
    cells = dots.reshape(rows // 4, 4, columns // 2, 2)
    bits: NDArray[np.uint16] = np.einsum("aibj,ij->ab", cells, _DOT_BITS)
    return bits


def _runs(text: str, inks: BoolArray) -> list[tuple[str, Ink]]:
    """Split a row of cells where the ink changes."""
    cuts = [0, *(np.flatnonzero(inks[1:] != inks[:-1]) + 1).tolist(), len(text)]
    return [(text[i:j], Ink.LAST if inks[i] else Ink.AVERAGE) for i, j in pairwise(cuts)]


def _tick_labels(scale: Scale, rows: int) -> dict[int, str]:
    """Return the label of each text row that a tick falls into."""
    labels: dict[int, str] = {}
    decimals = max(0, -math.floor(math.log10(scale.step)))
    for k in range(math.ceil(scale.low / scale.step - 1e-9), math.floor(scale.high / scale.step + 1e-9) + 1):
        value = k * scale.step
        row = round((scale.high - value) / (scale.high - scale.low) * (4 * rows - 1)) // 4
        label = f"{value + 0.0:.{decimals}f}"
        labels[row] = label if len(label) < GUTTER else f"{value:.0e}"
    return labels


def _angle_axis(width: int, zoom: Zoom, edges_rad: tuple[float, float]) -> tuple[PlotRow, PlotRow]:
    """Return the axis line, with a triangle at each contact edge, and the row of its labels."""
    half = zoom.value
    quarters = [-half, -half // 2, 0, half // 2, half] if width >= 40 else [-half, 0, half]
    line = ["─"] * width
    labels = [" "] * width
    for angle in quarters:
        column = _column_of(angle, half, width)
        line[column] = "┴"
        label = f"{angle}°"
        start = min(max(column - len(label) // 2, 0), width - len(label))
        labels[start : start + len(label)] = label
    for edge_rad in edges_rad:
        if math.isfinite(edge_rad) and abs(math.degrees(edge_rad)) <= half:
            line[_column_of(math.degrees(edge_rad), half, width)] = "▲"
    margin = " " * (GUTTER - 1)
    return (((f"{margin}└{''.join(line)}", Ink.AXIS),), ((f"{'m/s²':>{GUTTER - 1}} {''.join(labels)}", Ink.AXIS),))


def _column_of(angle_deg: float, half_deg: float, width: int) -> int:
    return round((angle_deg + half_deg) / (2.0 * half_deg) * (width - 1))


def curve_rows(
    solid: tuple[FloatArray, FloatArray] | None,
    dotted: tuple[FloatArray, FloatArray] | None,
    scale: Scale,
    width: int,
    rows: int,
) -> list[PlotRow]:
    """Draw a solid line over a row of dots, each as least and greatest value of every dot column, beside a scale."""
    bits = []
    for curve_range, is_joined in ((solid, True), (dotted, False)):
        if curve_range is None:
            bits.append(np.zeros((rows, width), dtype=np.uint16))
            continue
        dots = _dots(*curve_range, scale, 4 * rows, is_joined)
        if not is_joined:
            dots[:, np.arange(2 * width) % _AVERAGE_EVERY != 0] = False
        bits.append(_pack(dots))
    merged = bits[0] | bits[1]
    codes = np.where(merged != 0, _BRAILLE + merged, _BLANK).astype("<u4")
    is_solid = bits[0] != 0
    labels = _tick_labels(scale, rows)
    drawn: list[PlotRow] = []
    for row in range(rows):
        label = labels.get(row)
        gutter = f"{label:>{GUTTER - 1}}┤" if label is not None else " " * (GUTTER - 1) + "│"
        cells = codes[row].tobytes().decode("utf-32-le")
        drawn.append(((gutter, Ink.AXIS), *_runs(cells, is_solid[row])))
    return drawn


def draw_waveform(
    last: FloatArray | None,
    average: FloatArray | None,
    width: int,
    height: int,
    *,
    zoom: Zoom = Zoom.WHOLE,
    edges_rad: tuple[float, float] = (math.nan, math.nan),
) -> tuple[PlotRow, ...]:
    """Draw the last revolution as a solid line over the running average as a row of dots.

    Args:
        last: (n,) values in m/s^2 on the grid theta = -pi + 2 pi k / n, or None.
        average: (n,) the same for the average, or None.
        width: cells of every row.
        height: number of rows, two of them for the angle axis.
        zoom: angle range shown.
        edges_rad: leading and trailing contact edge, marked on the axis; NaN when not known.

    Returns:
        `height` rows of `width` cells; none when the area is smaller than MIN_WIDTH x MIN_HEIGHT.
    """
    if width < MIN_WIDTH or height < MIN_HEIGHT:
        return ()
    plot_width, plot_rows = width - GUTTER, height - _AXIS_ROWS
    ranges = [
        None if curve is None or not len(curve) else _columns(curve, math.radians(zoom.value), 2 * plot_width)
        for curve in (last, average)
    ]
    # Zero, the reading inside the contact, is always on the scale.
    low = min([0.0, *(float(np.fmin.reduce(r[0])) for r in ranges if r is not None and not np.isnan(r[0]).all())])
    high = max([0.0, *(float(np.fmax.reduce(r[1])) for r in ranges if r is not None and not np.isnan(r[1]).all())])
    rows = curve_rows(ranges[0], ranges[1], nice_scale(low, high, max(2, plot_rows // 2)), plot_width, plot_rows)
    return (*rows, *_angle_axis(plot_width, zoom, edges_rad))
