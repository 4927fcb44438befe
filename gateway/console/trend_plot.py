"""A quantity over the last minutes with its standard error, drawn with braille dots into terminal cells."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from gateway.console.trend_history import TrendPoint
from gateway.console.waveform import GUTTER, MIN_HEIGHT, MIN_WIDTH, Ink, PlotRow, curve_rows, nice_scale
from gateway.core.text.numbers import round_to_error
from gateway.core.types import FloatArray

SHOWN_S: Final = 180
"""Time that a trend on the console goes back."""
_GAP_S: Final = 3.0  # longer than between two revolutions of a wheel that is fast enough to be measured
_AXIS_ROWS: Final = 2


def draw_trend(points: Sequence[TrendPoint], unit: str, width: int, height: int, now_s: int) -> tuple[PlotRow, ...]:
    """Draw the values as a solid line over one standard error to each side as dots, the present at the right.

    Returns:
        `height` rows of `width` cells; none without a value, or when the area is too small.
    """
    begin_s = now_s - SHOWN_S
    visible = [point for point in points if point.at_s >= begin_s]
    if width < MIN_WIDTH or height < MIN_HEIGHT or not visible:
        return ()
    plot_width, plot_rows = width - GUTTER, height - _AXIS_ROWS
    largest = max(abs(point.value) for point in visible)
    exponent = round_to_error(largest).exponent
    times_s, value, std = (
        np.array(column, dtype=np.float64) for column in zip(*((p.at_s, p.value, p.std) for p in visible), strict=True)
    )
    value, std = value / 10.0**exponent, np.nan_to_num(std) / 10.0**exponent
    low, high = float(np.min(value - std)), float(np.max(value + std))
    # A value that does not change gets a scale of a thousandth of itself.
    margin = max(0.5e-3 * abs(high), 1e-6) if high - low < 2e-3 else 0.0
    scale = nice_scale(low - margin, high + margin, max(2, plot_rows // 2))
    columns_s = begin_s + (np.arange(2 * plot_width) + 1.0) * (SHOWN_S / (2 * plot_width))
    line, upper, lower = (
        _interpolated(columns_s.astype(np.float64), times_s, curve) for curve in (value, value + std, value - std)
    )
    rows = curve_rows((line, line), (lower, upper), scale, plot_width, plot_rows)
    symbol = f"e{exponent} {unit}".strip() if exponent else unit
    margin_text = " " * (GUTTER - 1)
    begin, end = f"-{SHOWN_S // 60} min", "now"
    axis = f"{margin_text}└{'─' * plot_width}"
    labels = f"{symbol:>{GUTTER - 1}.{GUTTER - 1}} {begin}{end:>{plot_width - len(begin)}}"
    return (*rows, ((axis, Ink.AXIS),), ((labels, Ink.AXIS),))


def _interpolated(columns_s: FloatArray, times_s: FloatArray, values: FloatArray) -> FloatArray:
    """Return the values at the columns, NaN where there is none near."""
    index = np.searchsorted(times_s, columns_s)
    before_s = times_s[np.maximum(index - 1, 0)]
    after_s = times_s[np.minimum(index, len(times_s) - 1)]
    is_within = (columns_s >= times_s[0] - 0.5) & (columns_s <= times_s[-1] + 0.5)
    is_known = is_within & (after_s - before_s <= _GAP_S)
    result: FloatArray = np.where(is_known, np.interp(columns_s, times_s, values), np.nan)
    return result
