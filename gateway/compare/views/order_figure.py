"""Orders of wheels as a figure: SVG, PNG, or a self-contained page."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from gateway.compare.views.drive_pictures import date_utc
from gateway.compare.views.order_tables import amplitude_rows, share_rows, share_texts
from gateway.compare.views.order_verdict import order_verdict
from gateway.compare.views.wheel_orders import WheelOrders
from gateway.core.constants import AXIS_NAMES
from gateway.core.revolutions.angle_resampling import angle_grid
from gateway.core.text.figure_file import check_figure, figure_bytes
from gateway.core.text.html_template import result_page
from gateway.core.text.numbers import split_name
from gateway.core.text.output_file import write_whole
from gateway.core.text.page_figure import (
    AFTER,
    BEFORE,
    GOOD,
    GRID,
    QUIET,
    RESIDUAL,
    Drawing,
    inline_svg,
    new_figure,
    report_style,
)
from gateway.core.text.readout import SPEED
from gateway.core.text.text import clean, counted, escaped

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SUFFIXES: Final = (".html", ".svg", ".png")


class _Palette(NamedTuple):
    """Colours of the axes, of ranges of speed, of lines behind, and of a limit."""

    axes: Sequence[str]
    speeds: Sequence[str]
    grid: str
    limit: str


# Of a picture alone: the palette of Okabe and Ito, which is safe for colour-blind readers. A page has its own roles.
_ALONE: Final = _Palette(["#0072B2", "#009E73", "#D55E00"], ["#56B4E9", "#0072B2", "#E69F00", "#D55E00"], "0.9", "0.4")
_ON_PAGE: Final = _Palette((AFTER, GOOD, BEFORE), (RESIDUAL, AFTER, GOOD, BEFORE), GRID, QUIET)
_TEMPLATE: Final = ("gateway.compare.views", "order_page.html.j2")
_RADIAL: Final = AXIS_NAMES.index("radial")
_WIDTH_INCH, _HEIGHT_INCH = 11.0, 7.0
_DECADES: Final = 4.0
_SHOWN_ORDERS: Final = 30
_NARROW_INCH: Final = (4.4, 3.0)


def write_figure(
    path: Path, wheels: Sequence[WheelOrders], recording: str, start_ns: int | None = None, *, force: bool = False
) -> None:
    """Draw the orders of wheels of a recording that starts at a time, ns since the epoch.

    Raises:
        OutputError: as `check_figure`, or the file cannot be written.
    """
    check_figure(path, SUFFIXES)
    import matplotlib

    suffix = path.suffix.lower()
    if suffix == ".html":
        write_whole(path, orders_page(wheels, recording, start_ns), force=force)
        return
    from matplotlib.figure import Figure

    with matplotlib.rc_context({"svg.hashsalt": "treadlink", "font.size": 9.0, "axes.titlelocation": "left"}):
        figure = Figure(figsize=(_WIDTH_INCH, _HEIGHT_INCH * len(wheels)), dpi=110, layout="constrained")
        figure.suptitle(escaped(recording))
        parts = figure.subfigures(len(wheels), 1, squeeze=False)[:, 0]
        for part, wheel in zip(parts, wheels, strict=True):
            _draw(part, wheel, _ALONE)
        write_whole(path, figure_bytes(figure, suffix.removeprefix(".")), force=force)


def _title(wheel: WheelOrders) -> str:
    speeds = wheel.speeds_text(0, *wheel.statistics.omega_range_radps)
    return f"{clean(wheel.wheel)}: {counted(wheel.statistics.revolutions, 'revolution')}, {speeds}"


def _draw(figure: Any, wheel: WheelOrders, palette: _Palette) -> None:
    figure.suptitle(_title(wheel), fontsize=11.0)
    for draw, axes in zip(_PICTURES, figure.subplots(3, 2, width_ratios=(1.35, 1.0)).flat, strict=True):
        draw(axes, wheel, palette)


def _spectrum(axes: Axes, wheel: WheelOrders, palette: _Palette) -> None:
    statistics = wheel.statistics
    if statistics.blocks:
        orders, values = statistics.fine_order, statistics.fine_mps2
        title = f"order spectrum, resolution 1/{statistics.block_revolutions} order"
    else:
        orders = np.arange(statistics.amplitude_mps2.shape[1], dtype=np.float64)
        values, title = statistics.amplitude_mps2, "order spectrum"
    top = 0.0
    for axis, name in enumerate(AXIS_NAMES):
        if np.isfinite(values[axis]).any():
            axes.plot(orders[1:], values[axis][1:], color=palette.axes[axis], lw=0.9, label=name)
            top = max(top, float(np.nanmax(values[axis][1:])))
    for order in range(1, _SHOWN_ORDERS + 1):
        axes.axvline(order, color=palette.grid, lw=0.6, zorder=0)
    if top > 0.0:
        axes.set_yscale("log")
        axes.set_ylim(top * 10.0**-_DECADES, 2.0 * top)
    axes.set(xlim=(0, _SHOWN_ORDERS), xlabel="order", ylabel="amplitude, m/s²", title=title)
    axes.legend(fontsize=9.0)


def _waterfall(axes: Axes, wheel: WheelOrders, _: _Palette) -> None:
    from matplotlib.colors import LogNorm

    speeds = wheel.statistics.speeds
    unit = split_name(SPEED)[1]
    edges = [unit.of(wheel.radius_m * speeds[0].low_radps)]
    rows = []
    for speed_bin in speeds:
        low, high = (unit.of(wheel.radius_m * edge) for edge in (speed_bin.low_radps, speed_bin.high_radps))
        if low > edges[-1] + 1e-9:
            # A range without a revolution stays empty.
            rows.append(np.full(speed_bin.amplitude_mps2.shape[1] - 1, math.nan))
            edges.append(low)
        rows.append(speed_bin.amplitude_mps2[_RADIAL][1:])
        edges.append(high)
    values = np.array(rows)
    axes.set(xlabel="order", ylabel=f"speed, {unit.symbol}", title="radial amplitude against speed")
    if not np.isfinite(values).any():
        return
    top = float(np.nanmax(values))
    norm = LogNorm(top * 10.0**-_DECADES, top) if top > 0.0 else None
    columns = np.arange(values.shape[1] + 1) + 0.5
    mesh = axes.pcolormesh(columns, edges, values, norm=norm, cmap="viridis", rasterized=True)
    axes.set_xlim(0.5, _SHOWN_ORDERS + 0.5)
    axes.figure.colorbar(mesh, ax=axes, label="m/s²")


def _signal(axes: Axes, wheel: WheelOrders, palette: _Palette) -> None:
    """Draw the radial axis over consecutive revolutions."""
    axes.set(xlabel="revolutions", ylabel="radial, m/s²", title="radial axis over consecutive revolutions, as measured")
    radial = wheel.statistics.block_mps2[_RADIAL]
    if np.isfinite(radial).all() and len(radial):
        # Every second sample of the grid is enough for the eye.
        revolutions = np.arange(len(radial)) * (wheel.statistics.block_revolutions / len(radial))
        axes.plot(revolutions[::2], radial[::2], color=palette.axes[_RADIAL], lw=0.7)
        axes.set_xlim(0, wheel.statistics.block_revolutions)


def _by_speed(axes: Axes, wheel: WheelOrders, palette: _Palette) -> None:
    """Draw the radial spectra at several speeds over the square of the angular speed: a tire's own shape coincides."""
    axes.set(
        xlim=(0, _SHOWN_ORDERS),
        xlabel="order",
        ylabel="radial amplitude / Ω², mm",
        title="radial spectrum by speed",
    )
    ranges = wheel.speeds_with_spectrum
    picked = np.unique(np.linspace(0, len(ranges) - 1, min(len(ranges), len(palette.speeds))).round().astype(int))
    top = 0.0
    for index, colour in zip(picked.tolist(), palette.speeds, strict=False):
        speed_bin = ranges[index]
        values = 1e3 * speed_bin.fine_mps2[_RADIAL][1:] / (0.5 * (speed_bin.low_radps + speed_bin.high_radps)) ** 2
        if not np.isfinite(values).any():
            continue
        speed = wheel.speeds_text(0, speed_bin.low_radps, speed_bin.high_radps)
        axes.plot(wheel.statistics.fine_order[1:], values, color=colour, lw=0.8, label=speed)
        top = max(top, float(np.nanmax(values)))
    if top > 0.0:
        axes.set_yscale("log")
        # Room for the legend above the peaks.
        axes.set_ylim(top * 10.0**-_DECADES, 100.0 * top)
        axes.legend(fontsize=9.0, loc="upper right")


def _average(axes: Axes, wheel: WheelOrders, palette: _Palette) -> None:
    radial = wheel.mean.radial
    degrees = np.degrees(angle_grid())
    scatter = np.nan_to_num(radial.scatter_mps2)
    mean = radial.radial_mps2
    axes.fill_between(
        degrees, mean - scatter, mean + scatter, color=palette.axes[_RADIAL], alpha=0.3, lw=0, label="scatter"
    )
    axes.plot(degrees, mean, color=palette.axes[_RADIAL], lw=1.0, label="mean")
    speed = wheel.speeds_text(1, wheel.mean.omega_radps)
    axes.set(
        xlim=(-180, 180),
        xlabel="angle from the contact's centre, deg",
        ylabel="radial, m/s²",
        title=f"time synchronous average at {speed}, gravity removed",
    )
    axes.set_xticks(range(-180, 181, 60))
    axes.legend(fontsize=9.0)


def _integer_shares(axes: Axes, wheel: WheelOrders, palette: _Palette) -> None:
    statistics = wheel.statistics
    places = np.arange(len(AXIS_NAMES))
    share = 100.0 * statistics.integer_share
    error = np.nan_to_num(100.0 * statistics.integer_share_std)
    axes.bar(places, np.nan_to_num(share), yerr=error, color=palette.axes, width=0.6)
    for axis, share_text in zip(places.tolist(), share_texts(statistics), strict=True):
        axes.text(axis, 106.0, share_text, ha="center", fontsize=8.0)
    axes.axhline(100.0 * statistics.noise_share, color=palette.limit, ls="--", lw=0.8)
    axes.set_xticks(places, AXIS_NAMES)
    axes.set(ylim=(0, 116), ylabel="%", title="power on integer orders (dashed: noise)")


_PICTURES: Final = (_spectrum, _waterfall, _signal, _by_speed, _average, _integer_shares)


def orders_page(wheels: Sequence[WheelOrders], recording: str, start_ns: int | None = None) -> str:
    """Return a page with verdict, figures and tables of every wheel, which loads nothing; errors as `result_page`."""
    verdict = order_verdict(wheels)
    return result_page(
        *_TEMPLATE,
        title=f"Orders of {clean(recording)}",
        facts=" · ".join([date_utc(start_ns or 0), *map(_title, wheels)]),
        answer=verdict.answer,
        lines=verdict.lines,
        steps=verdict.steps,
        axes=AXIS_NAMES,
        wheels=[
            {
                "id": f"w{index}",
                "name": wheel.wheel,
                "title": _title(wheel),
                "drawn": list(_drawings(index, wheel)),
                "tables": (
                    ("Shares", "Share of the power on integer orders", "Speed", share_rows(wheel)),
                    (
                        "Amplitudes",
                        "Amplitude in m/s², rms over the revolutions, and the part of it that repeats in each",
                        "Order",
                        amplitude_rows(wheel, _SHOWN_ORDERS),
                    ),
                ),
            }
            for index, wheel in enumerate(wheels)
        ],
    )


def _drawings(index: int, wheel: WheelOrders) -> Iterator[Drawing]:
    """Yield each picture of a wheel as a figure of its own, narrow enough for a phone; its title stands below it."""
    for number, draw in enumerate(_PICTURES):
        with report_style():
            figure = new_figure(*_NARROW_INCH)
            axes = figure.subplots()
            draw(axes, wheel, _ON_PAGE)
            title = axes.get_title(loc="left")
            axes.set_title("", loc="left")
            svg = inline_svg(figure, f"w{index}p{number}")
        alt = f"{title}, {clean(wheel.wheel)}; the numbers are in the tables."
        yield Drawing(svg, alt, f"{title[:1].upper()}{title[1:]}.", "")
