"""Figures of trends: values of each recording with their errors, the fitted trend, steps and outliers."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Final

import numpy as np

from gateway.trends.trend_result import TireTrend, TrendSeries
from gateway.trends.watched_series import SERIES, label_of
from gateway.views.report.figures import AFTER, BEFORE, MEASURED, QUIET, drawable

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST_POINTS: Final = 300
"""Points of a series that are drawn; outliers always are."""

_WIDTH_INCH: Final = 10.0
_COLUMNS: Final = 3
_ROW_INCH: Final = 2.3


def tire_figure(trend: TireTrend) -> Figure | None:
    """Draw the series of a tire, None when there is none to draw."""
    from matplotlib.figure import Figure

    series = _chosen(trend.series)
    if not series:
        return None
    rows = -(-len(series) // _COLUMNS)
    height = _ROW_INCH * rows
    # The panels are alike: fixed margins are as good as solved ones, and quicker.
    figure = Figure(figsize=(_WIDTH_INCH, height))
    panels = figure.subplots(rows, _COLUMNS, squeeze=False).ravel()
    figure.subplots_adjust(
        left=0.065, right=0.99, wspace=0.27, top=1.0 - 0.28 / height, bottom=0.48 / height, hspace=0.52
    )
    for panel, line in zip(panels, series, strict=False):
        _draw(panel, line)
    for panel in panels[len(series) :]:
        panel.set_visible(False)
    return figure


def _chosen(series: Sequence[TrendSeries]) -> list[TrendSeries]:
    """Return the series that are drawn, and the contact length where the load is not measured."""
    instead = () if any(line.name == "estimated_load_n" for line in series) else ("contact_length_m",)
    return [line for line in series if SERIES[line.name].watch.is_drawn or line.name in instead]


def _draw(panel: Axes, series: TrendSeries) -> None:
    normal = np.flatnonzero(~series.is_outlier)
    if len(normal) > MOST_POINTS:
        normal = normal[np.linspace(0, len(normal) - 1, MOST_POINTS).astype(int)]
    panel.plot(series.abscissa[normal], series.values[normal], "o", color=MEASURED, ms=3.0, mew=0.0, label="recording")
    outliers = np.flatnonzero(series.is_outlier)
    if outliers.size:
        panel.plot(
            series.abscissa[outliers], series.values[outliers], "x", color=BEFORE, ms=6.0, mew=1.6, label="outlier"
        )
    edges = [0, *series.steps, len(series.abscissa)]
    for begin, end in pairwise(edges):
        part = np.arange(begin, end)
        if len(part) > MOST_POINTS:
            part = part[np.linspace(0, len(part) - 1, MOST_POINTS).astype(int)]
        panel.plot(
            series.abscissa[part], series.expected[part], color=AFTER, lw=1.3, label="trend" if begin == 0 else None
        )
    for step in series.steps:
        panel.axvline(0.5 * (series.abscissa[step - 1] + series.abscissa[step]), color=QUIET, lw=0.8, ls=":")
    panel.set_title(drawable(f"{label_of(series.name)}, {series.unit}"), fontsize=9.5)
    panel.set_xlabel("km" if series.against == "km" else "months")
    panel.ticklabel_format(useOffset=False, axis="y")
