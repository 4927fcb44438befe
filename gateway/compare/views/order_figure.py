"""Orders of wheels as a figure: SVG, PNG, or a self-contained page."""

from __future__ import annotations

import html
import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from gateway import __version__
from gateway.compare.views.order_tables import order_lines, share_texts
from gateway.compare.views.wheel_orders import WheelOrders
from gateway.core.constants import AXIS_NAMES
from gateway.core.revolutions.angle_resampling import angle_grid
from gateway.core.text.figure_file import check_figure, figure_bytes
from gateway.core.text.output_file import write_whole
from gateway.core.text.text import escaped

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SUFFIXES: Final = (".html", ".svg", ".png")

# The palette of Okabe and Ito, which is safe for colour-blind readers.
_COLOURS: Final = ("#0072B2", "#009E73", "#D55E00")
_RADIAL: Final = AXIS_NAMES.index("radial")
_WIDTH_INCH, _HEIGHT_INCH = 11.0, 7.0
_DECADES: Final = 4.0
_SHOWN_ORDERS: Final = 30
# Ranges of speed whose spectra are drawn above each other, with their colours.
_SPEED_COLOURS: Final = ("#56B4E9", "#0072B2", "#E69F00", "#D55E00")


def write_figure(path: Path, wheels: Sequence[WheelOrders], recording: str, *, force: bool = False) -> None:
    """Draw the orders of wheels.

    Raises:
        OutputError: as `check_figure`, or the file cannot be written.
    """
    check_figure(path, SUFFIXES)
    import matplotlib

    suffix = path.suffix.lower()
    with matplotlib.rc_context({"svg.hashsalt": "treadlink", "font.size": 9.0, "axes.titlelocation": "left"}):
        if suffix == ".html":
            write_whole(path, _page(wheels, recording), force=force)
        else:
            write_whole(path, _drawn(wheels, suffix.removeprefix("."), title=escaped(recording)), force=force)


def _drawn(wheels: Sequence[WheelOrders], kind: str, *, title: str = "") -> bytes:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(_WIDTH_INCH, _HEIGHT_INCH * len(wheels)), dpi=110, layout="constrained")
    if title:
        figure.suptitle(title)
    parts = figure.subfigures(len(wheels), 1, squeeze=False)[:, 0]
    for part, wheel in zip(parts, wheels, strict=True):
        _draw(part, wheel)
    return figure_bytes(figure, kind)


def _draw(figure: Any, wheel: WheelOrders) -> None:
    low, high = wheel.speed_range_kmh
    figure.suptitle(
        f"{wheel.wheel}: {wheel.statistics.revolutions} revolutions, {low:.0f} to {high:.0f} km/h", fontsize=11.0
    )
    (spectrum, waterfall), (signal, speeds), (average, share) = figure.subplots(3, 2, width_ratios=(1.35, 1.0))
    _spectrum(spectrum, wheel)
    _waterfall(figure, waterfall, wheel)
    _signal(signal, wheel)
    _by_speed(speeds, wheel)
    _average(average, wheel)
    _share(share, wheel)


def _spectrum(axes: Axes, wheel: WheelOrders) -> None:
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
            axes.plot(orders[1:], values[axis][1:], color=_COLOURS[axis], lw=0.9, label=name)
            top = max(top, float(np.nanmax(values[axis][1:])))
    for order in range(1, _SHOWN_ORDERS + 1):
        axes.axvline(order, color="0.9", lw=0.6, zorder=0)
    if top > 0.0:
        axes.set_yscale("log")
        axes.set_ylim(top * 10.0**-_DECADES, 2.0 * top)
    axes.set(xlim=(0, _SHOWN_ORDERS), xlabel="order", ylabel="amplitude, m/s²", title=title)
    axes.legend(fontsize=8.0)


def _waterfall(figure: Any, axes: Axes, wheel: WheelOrders) -> None:
    from matplotlib.colors import LogNorm

    speeds = wheel.statistics.speeds
    edges = [wheel.kmh(speeds[0].low_radps)]
    rows = []
    for speed_bin in speeds:
        low, high = wheel.kmh(speed_bin.low_radps), wheel.kmh(speed_bin.high_radps)
        if low > edges[-1] + 1e-9:
            # A range without a revolution stays empty.
            rows.append(np.full(speed_bin.amplitude_mps2.shape[1] - 1, math.nan))
            edges.append(low)
        rows.append(speed_bin.amplitude_mps2[_RADIAL][1:])
        edges.append(high)
    values = np.array(rows)
    axes.set(xlabel="order", ylabel="speed, km/h", title="radial amplitude against speed")
    if not np.isfinite(values).any():
        return
    top = float(np.nanmax(values))
    norm = LogNorm(top * 10.0**-_DECADES, top) if top > 0.0 else None
    columns = np.arange(values.shape[1] + 1) + 0.5
    mesh = axes.pcolormesh(columns, edges, values, norm=norm, cmap="viridis", rasterized=True)
    axes.set_xlim(0.5, _SHOWN_ORDERS + 0.5)
    figure.colorbar(mesh, ax=axes, label="m/s²")


def _signal(axes: Axes, wheel: WheelOrders) -> None:
    """Draw the radial axis over consecutive revolutions."""
    axes.set(xlabel="revolutions", ylabel="radial, m/s²", title="radial axis over consecutive revolutions, as measured")
    radial = wheel.statistics.block_mps2[_RADIAL]
    if np.isfinite(radial).all() and len(radial):
        # Every second sample of the grid is enough for the eye.
        turns = np.arange(len(radial)) * (wheel.statistics.block_revolutions / len(radial))
        axes.plot(turns[::2], radial[::2], color=_COLOURS[_RADIAL], lw=0.7)
        axes.set_xlim(0, wheel.statistics.block_revolutions)


def _by_speed(axes: Axes, wheel: WheelOrders) -> None:
    """Draw the radial spectra at several speeds over the square of the angular speed: a tire's own shape coincides."""
    axes.set(
        xlim=(0, _SHOWN_ORDERS),
        xlabel="order",
        ylabel="radial amplitude / Ω², mm",
        title="radial spectrum by speed",
    )
    ranges = wheel.speeds_with_spectrum
    picked = np.unique(np.linspace(0, len(ranges) - 1, min(len(ranges), len(_SPEED_COLOURS))).round().astype(int))
    top = 0.0
    for index, colour in zip(picked.tolist(), _SPEED_COLOURS, strict=False):
        speed_bin = ranges[index]
        values = 1e3 * speed_bin.fine_mps2[_RADIAL][1:] / (0.5 * (speed_bin.low_radps + speed_bin.high_radps)) ** 2
        if not np.isfinite(values).any():
            continue
        speed = f"{wheel.kmh(speed_bin.low_radps):.0f} to {wheel.kmh(speed_bin.high_radps):.0f} km/h"
        label = f"{speed}: {share_texts(speed_bin)[_RADIAL]} on integer orders"
        axes.plot(wheel.statistics.fine_order[1:], values, color=colour, lw=0.8, label=label)
        top = max(top, float(np.nanmax(values)))
    if top > 0.0:
        axes.set_yscale("log")
        # Room for the legend above the peaks.
        axes.set_ylim(top * 10.0**-_DECADES, 100.0 * top)
        axes.legend(fontsize=7.0, loc="upper right")


def _average(axes: Axes, wheel: WheelOrders) -> None:
    radial = wheel.mean.radial
    degrees = np.degrees(angle_grid())
    scatter = np.nan_to_num(radial.scatter_mps2)
    mean = radial.radial_mps2
    axes.fill_between(
        degrees, mean - scatter, mean + scatter, color=_COLOURS[_RADIAL], alpha=0.3, lw=0, label="scatter"
    )
    axes.plot(degrees, mean, color=_COLOURS[_RADIAL], lw=1.0, label="mean")
    speed = wheel.kmh(wheel.mean.omega_radps)
    axes.set(
        xlim=(-180, 180),
        xlabel="angle from the contact's centre, deg",
        ylabel="radial, m/s²",
        title=f"time synchronous average at {speed:.1f} km/h, gravity removed",
    )
    axes.set_xticks(range(-180, 181, 60))
    axes.legend(fontsize=8.0)


def _share(axes: Axes, wheel: WheelOrders) -> None:
    statistics = wheel.statistics
    places = np.arange(len(AXIS_NAMES))
    share = 100.0 * statistics.integer_share
    error = np.nan_to_num(100.0 * statistics.integer_share_std)
    axes.bar(places, np.nan_to_num(share), yerr=error, color=_COLOURS, width=0.6)
    for axis, text in zip(places.tolist(), share_texts(statistics), strict=True):
        axes.text(axis, 2.0, text, ha="center", fontsize=8.0, bbox={"facecolor": "white", "lw": 0, "pad": 1.5})
    axes.axhline(100.0 * statistics.noise_share, color="0.4", ls="--", lw=0.8)
    axes.set_xticks(places, AXIS_NAMES)
    axes.set(ylim=(0, 105), ylabel="%", title="power on integer orders (dashed: noise)")


def _page(wheels: Sequence[WheelOrders], recording: str) -> bytes:
    """Return a page with a figure and a table for each wheel, which loads nothing."""
    name = html.escape(escaped(recording))
    parts = [
        "<!doctype html>",
        f'<html lang="en"><head><meta charset="utf-8"><title>Orders of {name}</title>',
        "<style>body{font:16px/1.5 sans-serif;max-width:68rem;margin:2rem auto;padding:0 1rem;background:#fff;"
        "color:#111}svg{width:100%;height:auto}pre{overflow-x:auto;font-size:13px}</style></head><body>",
        f"<h1>Orders of {name}</h1>",
        "<p>Amplitudes are root mean squares over the revolutions. What repeats in every revolution lies on integer "
        "orders; road, cavity and other shafts lie between them.</p>",
    ]
    for wheel in wheels:
        svg = _drawn([wheel], "svg").decode()
        lines = "\n".join(order_lines(wheel, _SHOWN_ORDERS))
        parts += [
            f"<section><h2>{html.escape(wheel.wheel)}</h2>",
            svg[svg.index("<svg") :],
            f"<details><summary>Numbers</summary><pre>{html.escape(lines)}</pre></details></section>",
        ]
    parts.append(f"<footer><p>treadlink {html.escape(__version__)}</p></footer></body></html>")
    return ("\n".join(parts) + "\n").encode()
