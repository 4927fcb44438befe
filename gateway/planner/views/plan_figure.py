"""Plans as a figure: the error of each quantity over speed, and the speeds at which each sensor can be used."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

from gateway.core.text.figure_file import check_figure, figure_bytes
from gateway.core.text.numbers import split_name
from gateway.core.text.output_file import write_whole
from gateway.core.text.text import escaped
from gateway.planner.planned_errors import AFTER, PlannedError, SensorPlan, fastest_mps

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import FigureBase

# The palette of Okabe and Ito, which is safe for colour-blind readers; further sensors begin again.
_COLOURS: Final = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
_COLUMNS: Final = 4
_PANEL_INCH: Final = (3.2, 2.4)
_ROW_INCH: Final = 0.3


def write_plan_figure(path: Path, plans: Sequence[SensorPlan], *, force: bool = False) -> None:
    """Draw plans.

    Raises:
        OutputError: as `check_figure`, or the file cannot be written.
    """
    check_figure(path)
    import matplotlib

    with matplotlib.rc_context({"svg.hashsalt": "treadlink", "font.size": 8.0, "axes.titlelocation": "left"}):
        write_whole(path, _drawn(plans, path.suffix.lower().removeprefix(".")), force=force)


def _drawn(plans: Sequence[SensorPlan], kind: str) -> bytes:
    from matplotlib.figure import Figure

    by_sensor: dict[str, list[SensorPlan]] = {}
    for plan in sorted(plans, key=lambda plan: plan.speed_mps):
        by_sensor.setdefault(plan.sensor.name, []).append(plan)
    colours = {name: _COLOURS[index % len(_COLOURS)] for index, name in enumerate(by_sensor)}
    quantities = list(dict.fromkeys(error.quantity for plan in plans for error in plan.errors))
    rows = math.ceil(len(quantities) / _COLUMNS)
    heights = (rows * _PANEL_INCH[1], 1.0 + _ROW_INCH * len(by_sensor))
    figure = Figure(figsize=(_COLUMNS * _PANEL_INCH[0], sum(heights)), dpi=110, layout="constrained")
    windows: FigureBase = figure
    if quantities:
        panels, windows = figure.subfigures(2, 1, squeeze=False, height_ratios=heights)[:, 0]
        axes = panels.subplots(rows, _COLUMNS, squeeze=False).ravel()
        for quantity, panel in zip(quantities, axes, strict=False):
            _errors(panel, quantity, by_sensor, colours)
        for unused in axes[len(quantities) :]:
            unused.set_axis_off()
    _windows(windows.subplots(), by_sensor, colours)
    return figure_bytes(figure, kind)


def _errors(axes: Axes, quantity: str, by_sensor: dict[str, list[SensorPlan]], colours: dict[str, str]) -> None:
    """Draw the scatter after the longest time and its bound as lines, and the scatter with what stays as circles."""
    label, unit = split_name(quantity)
    for name, plans in by_sensor.items():
        points = [(plan.speed_mps, _last(plan, quantity)) for plan in plans]
        finite = [(3.6 * speed, error) for speed, error in points if error is not None]
        kmh = [speed for speed, _ in finite]
        scatter = [unit.factor * error.scatter for _, error in finite]
        whole = [unit.factor * math.hypot(error.scatter, error.stays) for _, error in finite]
        axes.plot(kmh, scatter, color=colours[name], marker=".", lw=1.2)
        bounds = [unit.factor * error.bound for _, error in finite]
        axes.plot(kmh, bounds, color=colours[name], ls="--", lw=0.7)
        axes.plot(kmh, whole, color=colours[name], marker="o", markersize=3.5, fillstyle="none", ls=":", lw=1.0)
    axes.set(yscale="log", title=f"{label}, {unit.symbol}" if unit.symbol else label)
    axes.grid(color="0.9", lw=0.6)


def _last(plan: SensorPlan, quantity: str) -> PlannedError | None:
    return next((e for e in plan.errors if (e.quantity, e.revolutions) == (quantity, AFTER[-1])), None)


def _windows(axes: Axes, by_sensor: dict[str, list[SensorPlan]], colours: dict[str, str]) -> None:
    """Draw the speeds that the range allows as bars, and each planned speed as used (dot) or not (cross)."""
    for row, (name, plans) in enumerate(by_sensor.items()):
        if any(plan.usable for plan in plans):
            axes.barh(row, 3.6 * fastest_mps(plans[0]), height=0.5, color=colours[name], alpha=0.3)
        for plan in plans:
            marker = "o" if plan.usable else "x"
            axes.plot(3.6 * plan.speed_mps, row, marker=marker, color=colours[name], markersize=5.0)
    axes.set_yticks(range(len(by_sensor)), [escaped(name) for name in by_sensor])
    for tick in axes.get_yticklabels():
        tick.set_parse_math(False)  # a name may have dollar signs
    axes.set(
        xlabel="km/h",
        title=f"usable (dot), not usable (cross), up to where the peak fills the range (bar). Above: scatter after "
        f"{AFTER[-1]} revolutions (line), with what stays (circles), Cramer-Rao bound (dashes)",
    )
    axes.set_xlim(left=0.0)
    axes.invert_yaxis()
