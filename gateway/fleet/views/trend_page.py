"""Trends as one self-contained HTML page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from gateway.core.estimates.estimator import Status
from gateway.core.quantity import Trend
from gateway.core.shown_units import shown_in
from gateway.core.text.html_template import result_page
from gateway.core.text.output_file import check_target, write_whole
from gateway.core.text.page_figure import (
    AFTER,
    BEFORE,
    MEASURED,
    QUIET,
    Drawing,
    drawable,
    inline_svg,
    report_style,
    require_report_packages,
)
from gateway.core.text.text import clean, counted
from gateway.core.text.wording import joined, text
from gateway.fleet.trends.trend_result import (
    FleetTrends,
    Quantity,
    TireTrend,
    TrendNumber,
    TrendSeries,
    by_temperature,
    rate_of,
)
from gateway.fleet.trends.watched_series import SERIES, followed_by, label_of
from gateway.fleet.views.finding_rows import FindingRow, finding_rows, trend_steps
from gateway.fleet.views.trend_tables import (
    LABELS,
    day,
    number_of,
    shown,
    shown_unit,
    tire_name,
    tires_text,
    unit_in,
    value_texts,
    vehicles_of,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST_FIGURES: Final = 60
"""Tires that are drawn: those with findings or outliers first."""

MOST_OUTLIERS: Final = 500
_MOST_NOTES: Final = 40

_TEMPLATE: Final = ("gateway.fleet.views", "fleet_trends.html.j2")
_TABLES: Final[tuple[tuple[str, str, tuple[str, ...]], ...]] = (
    ("tires", "Wear, pressure and load", tuple(Quantity)),
    (
        "stiffness",
        "Stiffness with age and temperature",
        tuple(name(quantity.watch) for quantity in followed_by(Trend.STIFFNESS) for name in (rate_of, by_temperature)),
    ),
    ("sensors", "Sensors", tuple(rate_of(quantity.watch) for quantity in followed_by(Trend.SENSOR))),
)
MOST_POINTS: Final = 300
"""Points of a series that are drawn; outliers always are."""

_LEAST_SPAN: Final = 1e-3
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
        if line.against == "km":
            # The last of long numbers would reach into the next panel.
            panel.locator_params(axis="x", nbins=5, prune="upper")
            panel.set_xlabel("km")
        else:
            panel.set_xlabel(f"months from {day(trend.first_ns)}")
    for panel in panels[len(series) :]:
        panel.set_visible(False)
    return figure


def _chosen(series: Sequence[TrendSeries]) -> list[TrendSeries]:
    """Return the series that are drawn, and the contact length where the load is not measured."""
    substitutes = () if any(line.name == "estimated_load_n" for line in series) else ("contact_length_m",)
    return [line for line in series if SERIES[line.name].watch.is_drawn or line.name in substitutes]


def _as_shown(series: TrendSeries) -> TrendSeries:
    """Return a series in the unit that is shown; logarithms in percent as ratios to the begin of their trend."""
    if not SERIES[series.name].watch.is_logarithm:
        unit = shown_unit(series.unit)
        values, expected = (row * unit.factor + unit.offset for row in (series.values, series.expected))
        return replace(series, values=values, expected=expected, unit=unit.symbol)
    base = series.expected[0]
    values, expected = (np.exp((row - base) / 100.0) for row in (series.values, series.expected))
    return replace(series, values=values, expected=expected, unit="begin = 1")


def _draw(panel: Axes, series: TrendSeries) -> None:
    series = _as_shown(series)
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
    panel.set_title(drawable(f"{label_of(series.name).removeprefix('ln ')}, {series.unit}"), fontsize=9.5)
    panel.ticklabel_format(useOffset=False, axis="y")
    low, high = panel.get_ylim()
    span = _LEAST_SPAN * max(abs(low), abs(high))
    if high - low < span:
        # Nearly equal values would be labelled with more digits than they have meaning.
        panel.set_ylim(0.5 * (low + high - span), 0.5 * (low + high + span))


class Cell(NamedTuple):
    """A number in a table: text, and why it has none or what it rests on."""

    text: str
    reason: str
    is_doubtful: bool


class Table(NamedTuple):
    """A table of numbers, one row for each tire; `missing` says why numbers have no value."""

    id: str
    title: str
    heads: list[tuple[str, str]]
    rows: list[tuple[str, list[Cell]]]
    missing: list[tuple[str, str, str]]
    notes: list[tuple[str, str, str]]
    notes_left: int


def write_trends_page(trends: FleetTrends, path: Path, *, force: bool = False) -> None:
    """Write trends as one self-contained HTML file, whole or not at all.

    Raises:
        OutputError: matplotlib or jinja2 is missing, the file exists and `force` is not set, or it cannot be written.
    """
    check_target(path, force=force)
    write_whole(path, trends_page(trends), force=force)


def trends_page(trends: FleetTrends) -> str:
    """Return trends as an HTML page without scripts and external resources; deterministic.

    Raises:
        OutputError: matplotlib or jinja2 is missing.
    """
    require_report_packages()
    with shown_in(trends.units):
        return _page(trends)


def _page(trends: FleetTrends) -> str:
    notable, healthy = _drawn_tires(trends)
    findings, steps = finding_rows(trends.tires), trend_steps(trends.tires)
    return result_page(
        *_TEMPLATE,
        title="Trends of tires and sensors",
        trends=trends,
        facts=_facts(trends),
        answer=" ".join(_answer(trends, findings)),
        # Of few findings each says by itself what to do.
        steps=steps if len(steps) < len(findings) else [],
        tables=[_table(trends.tires, *table) for table in _TABLES],
        most_outliers=MOST_OUTLIERS,
        drawn=_drawings(notable, "t"),
        healthy_drawn=_drawings(healthy, "h"),
        drawings_left=len(trends.tires) - len(notable) - len(healthy),
        clean=clean,
        day=day,
        findings=findings,
        label_of=label_of,
        labels=LABELS,
        value_texts=value_texts,
        text=text,
        tire_name=tire_name,
        with_unit=_with_unit,
    )


def _facts(trends: FleetTrends) -> str:
    parts = [counted(trends.recordings, "recording"), counted(len(trends.tires), "tire"), vehicles_of(trends)]
    if trends.tires:
        first, last = min(tire.first_ns for tire in trends.tires), max(tire.last_ns for tire in trends.tires)
        parts.append(f"{day(first)} to {day(last)} (UTC)")
    if trends.failures:
        parts.append(f"{trends.failures} recordings without results")
    return " · ".join(parts)


def _answer(trends: FleetTrends, findings: Sequence[FindingRow]) -> list[str]:
    """Return the summary, sentence by sentence: the most urgent finding first."""
    notable = list(dict.fromkeys(row.tire for row in findings))
    recordings = len({outlier.path for outlier in trends.outliers})
    verb = "has a finding" if len(notable) == 1 else "have findings"
    return [
        f"{findings[0].tire}: {findings[0].said}. "
        f"{len(notable)} of {counted(len(trends.tires), 'tire')} {verb}: {tires_text(notable, len(trends.tires))}."
        if notable
        else "No tire has a finding: nothing to act on.",
        f"{recordings} of {counted(trends.recordings, 'recording')} do not fit the trend of their tire."
        if recordings
        else "Every recording fits the trend of its tire.",
    ]


def _table(tires: Sequence[TireTrend], key: str, title: str, quantities: Sequence[str]) -> Table:
    units = {quantity: unit_in(tires, quantity) for quantity in quantities}
    rows: list[tuple[str, list[Cell]]] = []
    reasons: dict[tuple[bool, str, str], list[str]] = {}
    for tire in tires:
        cells = []
        for quantity in quantities:
            number = number_of(tire.numbers, quantity)
            note = clean(joined(number.reasons))
            cells.append(Cell(shown(number), note, number.status is not Status.VALID))
            if note:
                is_missing = number.status is Status.INVALID
                reasons.setdefault((is_missing, LABELS[quantity], note), []).append(tire_name(tire))
        rows.append((tire_name(tire), cells))
    labels: dict[tuple[bool, str, str], list[str]] = {}
    for (is_missing, label, note), names in reasons.items():
        labels.setdefault((is_missing, tires_text(names, len(tires)), note), []).append(label)
    missing, notes = (
        [(names, ", ".join(terms), note) for (is_missing, names, note), terms in labels.items() if is_missing is state]
        for state in (True, False)
    )
    more = sum(max(len(lines) - _MOST_NOTES, 0) for lines in (missing, notes))
    heads = [(LABELS[quantity], units[quantity]) for quantity in quantities]
    return Table(key, title, heads, rows, missing[:_MOST_NOTES], notes[:_MOST_NOTES], more)


def _with_unit(number: TrendNumber) -> str:
    if number.status is Status.INVALID:
        return clean(joined(number.reasons))
    return f"{shown(number)} {shown_unit(number.unit).symbol}"


def _drawn_tires(trends: FleetTrends) -> tuple[list[TireTrend], list[TireTrend]]:
    """Return the tires that are drawn: those with findings or outliers, and healthy ones."""
    with_outliers = {(outlier.vehicle, outlier.position, outlier.sensor_id) for outlier in trends.outliers}

    def rank(tire: TireTrend) -> int:
        is_unfit = (tire.vehicle, tire.position, tire.sensor_id) in with_outliers
        return 0 if tire.findings else 1 if is_unfit else 2

    drawn = sorted(trends.tires, key=rank)[:MOST_FIGURES]
    return [tire for tire in drawn if rank(tire) < 2], [tire for tire in drawn if rank(tire) == 2]


def _drawings(tires: Sequence[TireTrend], prefix: str) -> list[Drawing]:
    drawings = []
    with report_style():
        for number, tire in enumerate(tires):
            figure = tire_figure(tire)
            if figure is None:
                continue
            name = tire_name(tire)
            alt = f"Values of the recordings of {name} over distance or months, with the fitted trend."
            caption = clean(joined(tire.findings)) or "No finding."
            drawings.append(Drawing(inline_svg(figure, f"{prefix}{number}"), alt, f"{name}.", caption))
    return drawings
