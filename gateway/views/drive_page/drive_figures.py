"""Figures of quantities over time: every wheel with the band of its standard errors."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from gateway.types import BoolArray, FloatArray
from gateway.views.drive_page.drive import Drive
from gateway.views.numbers import split_name
from gateway.views.readout import DISTANCE
from gateway.views.report.figures import AFTER, BEFORE, GOOD, INK, drawable, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_SIZE_INCH: Final = (5.0, 2.7)
# Colour and dashes by wheel: they differ in print and to colour-blind readers too.
_STYLES: Final = ((AFTER, "-"), (BEFORE, "--"), (GOOD, "-."), (INK, ":"))
_MINUTES_FROM_S: Final = 300.0


class Line(NamedTuple):
    """A quantity of one wheel over time.

    Attributes:
        position: wheel.
        style: index of its colour and dashes.
        time_s: (n,) since the first revolution of any wheel.
        value: (n,) NaN where it is invalid.
        std: (n,) NaN where it is not known.
        is_valid: (n,) False where it is provisional or invalid.
    """

    position: str
    style: int
    time_s: FloatArray
    value: FloatArray
    std: FloatArray
    is_valid: BoolArray


def begin_ns(drive: Drive) -> int:
    """Return the end of the first revolution of any wheel, ns; 0 without one."""
    return min((wheel.points[0].time_ns for wheel in drive.wheels.values()), default=0)


def drawn_quantities(drive: Drive) -> list[str]:
    """Return the quantities that have a value, without the distance, which only grows."""
    names = {
        name: None for wheel in drive.wheels.values() for point in wheel.points for name in point.values
    }  # a dict keeps their order
    return [name for name in names if name != DISTANCE]


def lines_of(drive: Drive, name: str, start_ns: int) -> list[Line]:
    """Return the lines of a quantity, in the unit that it is shown in."""
    factor, absent = split_name(name)[1].factor, (np.nan, np.nan, False)
    lines = []
    for style, (position, wheel) in enumerate(drive.wheels.items()):
        if not any(name in point.values for point in wheel.points):
            continue
        value, std, is_valid = np.array([point.values.get(name, absent) for point in wheel.points], np.float64).T
        time_s = np.array([point.time_ns - start_ns for point in wheel.points], np.float64) * 1e-9
        lines.append(Line(position, style, time_s, factor * value, factor * std, is_valid > 0.0))
    return lines


def quantity_figure(name: str, lines: list[Line]) -> Figure:
    """Draw a quantity: lines where it is valid, hollow points where it is provisional, gaps where it is invalid."""
    label, unit = split_name(name)
    figure = new_figure(*_SIZE_INCH)
    panel = figure.subplots()
    in_minutes = max(line.time_s[-1] for line in lines) > _MINUTES_FROM_S
    for line in lines:
        colour, dashes = _STYLES[line.style % len(_STYLES)]
        time = line.time_s / 60.0 if in_minutes else line.time_s
        valid = np.where(line.is_valid, line.value, np.nan)
        doubtful = ~line.is_valid & np.isfinite(line.value)
        panel.fill_between(time, line.value - line.std, line.value + line.std, color=colour, alpha=0.14, lw=0)
        panel.plot(time, valid, dashes, color=colour, lw=1.3, label=drawable(line.position))
        panel.plot(time[doubtful], line.value[doubtful], "o", color=colour, mfc="none", ms=2.2, mew=0.5)
    panel.set_title(drawable(f"{label}, {unit.symbol}" if unit.symbol else label))
    panel.set_xlabel("min" if in_minutes else "s")
    panel.ticklabel_format(useOffset=False, axis="y")
    if len(lines) > 1:
        figure.legend(loc="outside lower center", ncols=len(lines), handlelength=2.2, fontsize=9.0)
    return figure
