"""Figures of a diagnosis as inline SVG: waveforms, residuals, order spectra, spectral densities and trends.

Names of recordings are not drawn; they stand in the page beside the figure. Colours are roles that the page's style
sheet defines for screen, dark mode and print.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import numpy as np

from gateway.core.constants import AXIS_NAMES
from gateway.core.text.numbers import split_name
from gateway.core.text.page_figure import AFTER, BEFORE, INK, MEASURED, NOISE, QUIET, RESIDUAL, drawable, new_figure
from gateway.core.types import FloatArray
from gateway.diagnosis.result import Curves, EffectCurves, Spectra, Trend, Unexplained
from gateway.diagnosis.views.quantities import recorded_axes

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

NOISE_STDS: Final = 2.0
"""Half height of every noise band, in standard deviations."""
CONTACT_VIEW_DEG: Final = 40.0
"""Half width of the view around the contact."""

_WIDTH_INCH: Final = 10.0
_UNIT: Final = "m/s²"
# Share of an effect's largest axis below which one is not drawn.
_VISIBLE: Final = 0.01
# Ratio of the largest coefficient to the noise above which the scale is logarithmic.
_LOG_FROM: Final = 30.0


def order_coefficients(theta_rad: FloatArray, values: FloatArray, orders: int) -> tuple[FloatArray, FloatArray]:
    """Return the cosine and sine coefficients of orders 0 to orders - 1 of values on an even grid of a revolution."""
    n = np.arange(orders)
    phase = n[:, None] * theta_rad
    scale = np.where(n == 0, 1.0, 2.0) / theta_rad.size
    return scale * (np.cos(phase) @ values), scale * (np.sin(phase) @ values)


def waveform_figure(curves: Curves, axis: int, unexplained: Sequence[Unexplained] = ()) -> Figure:
    """Draw measured mean, models and residuals, over the whole revolution and around the contact."""
    figure = new_figure(_WIDTH_INCH, 6.8)
    grid = figure.subplots(3, 2, width_ratios=(1.75, 1.0), height_ratios=(1.15, 1.0, 0.85), sharex="col", sharey="row")
    degrees = np.degrees(curves.theta_rad)
    for column, limit in enumerate((180.0, CONTACT_VIEW_DEG)):
        top, middle, bottom = grid[:, column]
        top.plot(degrees, curves.measured_mps2[axis], color=MEASURED, lw=4.0, label="measured")
        top.plot(degrees, curves.before_mps2[axis], color=BEFORE, ls="--", label="before: baseline model")
        top.plot(degrees, curves.after_mps2[axis], color=AFTER, label="after: with effects")
        _residual(middle, curves, axis)
        _residual(bottom, curves, axis, with_before=False)
        for residual in on_axis(unexplained, axis, "angle"):
            if residual.angle_rad is not None:
                bottom.axvspan(*np.degrees(residual.angle_rad), color=RESIDUAL, alpha=0.35, lw=0, label="unexplained")
        bottom.set_xlim(-limit, limit)
        bottom.set_xticks(np.linspace(-limit, limit, 9 if column == 0 else 5))
        bottom.set_xlabel("angle from the contact's centre, deg")
    grid[0, 0].set_title("whole revolution")
    grid[0, 1].set_title("around the contact")
    for panel, label in zip(grid[:, 0], ("acceleration", "residual", "residual after"), strict=True):
        panel.set_ylabel(f"{label}, {_UNIT}")
    noise = float(curves.noise_mps2[axis])
    label = f"noise, ±{NOISE_STDS:.0f} × {noise:.3g} {_UNIT}" if math.isfinite(noise) else ""
    _legend(figure, [grid[0, 0], grid[2, 0]], label)
    figure.align_ylabels(list(grid[:, 0]))
    return figure


def _angle_panels(count: int, panel_inch: float, *, is_small: bool = False) -> tuple[Figure, list[Axes]]:
    """Return a figure of panels above each other over the wheel's angle."""
    figure = new_figure(_WIDTH_INCH / 2 if is_small else _WIDTH_INCH, panel_inch * count + (0.75 if is_small else 0.8))
    panels = figure.subplots(count, 1, sharex=True, squeeze=False)[:, 0]
    panels[-1].set_xlim(-180, 180)
    panels[-1].set_xticks(np.linspace(-180, 180, 5 if is_small else 9))
    panels[-1].set_xlabel("angle from the contact's centre, deg")
    return figure, list(panels)


def effect_figure(curves: EffectCurves) -> Figure:
    """Draw what an effect adds to the axes on which it does, with a band of its error."""
    sizes = np.nan_to_num(np.square(curves.added_mps2)).mean(axis=1)
    axes = [axis for axis in range(len(AXIS_NAMES)) if sizes[axis] > _VISIBLE**2 * sizes.max()]
    figure, panels = _angle_panels(max(len(axes), 1), 1.8)
    degrees = np.degrees(curves.theta_rad)
    for panel, axis in zip(panels, axes, strict=False):
        added, band = curves.added_mps2[axis], NOISE_STDS * curves.std_mps2[axis]
        label = f"±{NOISE_STDS:.0f} standard errors"
        panel.fill_between(degrees, added - band, added + band, color=NOISE, alpha=0.6, lw=0, label=label)
        panel.plot(degrees, added, color=AFTER, lw=1.2, label="added by the effect")
        panel.set_ylabel(f"{AXIS_NAMES[axis]}, {_UNIT}")
    _legend(figure, [panels[0]], "")
    return figure


def residual_figure(curves: Curves) -> Figure:
    """Draw the residuals of all recorded axes of one group, small."""
    axes = recorded_axes(curves)
    figure, panels = _angle_panels(len(axes), 1.2, is_small=True)
    for panel, axis in zip(panels, axes, strict=True):
        _residual(panel, curves, axis)
        panel.set_title(AXIS_NAMES[axis], fontsize=9.5)
    figure.supylabel(f"residual, {_UNIT}", fontsize=10.0, color=INK)
    return figure


def orders_figure(curves: Curves, axis: int, unexplained: Sequence[Unexplained] = ()) -> Figure:
    """Draw cosine and sine coefficients of the residuals by order, with the noise of one coefficient."""
    std = np.asarray(curves.order_noise_mps2[axis], dtype=np.float64)
    orders = min(std.size, curves.theta_rad.size // 2)
    n, band = np.arange(orders), NOISE_STDS * std[:orders]
    residual_before = order_coefficients(curves.theta_rad, (curves.measured_mps2 - curves.before_mps2)[axis], orders)
    residual_after = order_coefficients(curves.theta_rad, (curves.measured_mps2 - curves.after_mps2)[axis], orders)
    figure = new_figure(_WIDTH_INCH, 4.4)
    panels = figure.subplots(2, 1, sharex=True, sharey=True)
    for panel, before, after, part in zip(panels, residual_before, residual_after, ("cosine", "sine"), strict=True):
        panel.fill_between(n, -band, band, step="mid", color=NOISE, alpha=0.35, lw=0, label="noise")
        panel.vlines(n - 0.18, 0.0, before, color=BEFORE, lw=1.0)
        panel.plot(n - 0.18, before, "o", color=BEFORE, ms=3.4, mfc="none", mew=1.0, label="before")
        panel.vlines(n + 0.18, 0.0, after, color=AFTER, lw=1.4)
        panel.plot(n + 0.18, after, "o", color=AFTER, ms=2.8, label="after")
        for residual in on_axis(unexplained, axis, "angle"):
            if residual.orders is not None:
                panel.axvspan(
                    residual.orders[0] - 0.5,
                    residual.orders[1] + 0.5,
                    ymax=0.05,
                    color=RESIDUAL,
                    lw=0,
                    label="unexplained",
                )
        panel.axhline(0.0, color=QUIET, lw=0.6)
        panel.set_ylabel(f"{part} part, {_UNIT}")
    _symmetric_scale(panels[0], np.concatenate([*residual_before, *residual_after]), band)
    panels[1].set_xlim(-1.0, orders)
    panels[1].set_xlabel("order of the wheel")
    _legend(figure, [panels[0]], f"noise of one coefficient, ±{NOISE_STDS:.0f} standard errors")
    return figure


def spectra_figure(spectra: Spectra, unexplained: Sequence[Unexplained] = (), *, small: bool = False) -> Figure:
    """Draw the spectral density of the signal that does not repeat with the wheel, one panel for each recorded axis."""
    axes = [axis for axis in range(3) if bool(np.isfinite(spectra.measured_m2ps3[axis]).any())]
    figure = new_figure(_WIDTH_INCH / 2, 1.25 * len(axes) + 0.75) if small else new_figure(_WIDTH_INCH, 3.3)
    shape = (len(axes), 1) if small else (1, len(axes))
    panels = figure.subplots(*shape, sharex=True, sharey=True, squeeze=False).ravel()
    positive = spectra.frequency_hz > 0.0
    frequency = spectra.frequency_hz[positive]
    for panel, axis in zip(panels, axes, strict=True):
        for residual in on_axis(unexplained, axis, "time"):
            if residual.hz is not None and 0.0 < residual.hz[0] <= residual.hz[1]:
                # A tone is narrow: its edge keeps it visible.
                panel.axvspan(*residual.hz, color=RESIDUAL, alpha=0.5, lw=3.0, label="unexplained")
        panel.loglog(frequency, spectra.measured_m2ps3[axis][positive], color=QUIET, lw=0.9, label="measured")
        panel.loglog(frequency, spectra.before_m2ps3[axis][positive], color=BEFORE, ls="--", label="sensor noise only")
        panel.loglog(frequency, spectra.after_m2ps3[axis][positive], color=AFTER, label="with effects")
        panel.set_title(AXIS_NAMES[axis], fontsize=9.5 if small else None)
        panel.xaxis.set_major_formatter("{x:g}")
    _density_ticks(panels[0])
    for panel in panels:
        panel.minorticks_off()
    for panel in panels if not small else panels[-1:]:
        panel.set_xlabel("frequency, Hz")
    if small:
        figure.supylabel("density, (m/s²)²/Hz", fontsize=10.0, color=INK)
    else:
        panels[0].set_ylabel("density, (m/s²)²/Hz")
        _legend(figure, list(panels), "")
    return figure


def _density_ticks(panel: Axes) -> None:
    """Add ticks between decades to a scale of less than two decades, which may hold none."""
    from matplotlib.ticker import LogLocator

    low, high = panel.get_ylim()
    if high < 100.0 * low:
        panel.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        panel.yaxis.set_major_formatter("{x:.1g}")


def trend_figure(trends: Sequence[Trend]) -> Figure:
    """Draw the residual against one quantity, one panel for each axis."""
    name, unit = split_name(trends[0].against)
    figure = new_figure(_WIDTH_INCH, 3.1)
    panels = figure.subplots(1, len(trends), sharex=True, squeeze=False)[0]
    for panel, trend in zip(panels, trends, strict=True):
        order = np.argsort(trend.at, kind="stable")
        abscissa = trend.at[order] * unit.factor + unit.offset
        panel.plot(abscissa, trend.noise_mps2[order], "_", color=QUIET, ms=13.0, mew=1.6, label="noise of the mean")
        panel.plot(
            abscissa,
            trend.before_mps2[order],
            "o",
            color=BEFORE,
            ms=6.5,
            mfc="none",
            mew=1.5,
            label="before",
            clip_on=False,
        )
        panel.plot(abscissa, trend.after_mps2[order], "o", color=AFTER, ms=5.0, label="after", clip_on=False)
        panel.set_ylim(bottom=0.0)
        panel.margins(x=0.08)
        panel.set_title(drawable(trend.axis))
        panel.set_xlabel(f"{drawable(name)}, {unit.symbol}" if unit.symbol else drawable(name))
    panels[0].set_ylabel(f"residual, {_UNIT} rms")
    _legend(figure, [panels[0]], "")
    return figure


def _residual(panel: Axes, curves: Curves, axis: int, *, with_before: bool = True) -> None:
    degrees, noise = np.degrees(curves.theta_rad), float(curves.noise_mps2[axis])
    if math.isfinite(noise):
        panel.axhspan(-NOISE_STDS * noise, NOISE_STDS * noise, color=NOISE, alpha=0.35, lw=0, label="noise")
    panel.axhline(0.0, color=QUIET, lw=0.6)
    if with_before:
        panel.plot(degrees, curves.measured_mps2[axis] - curves.before_mps2[axis], color=BEFORE, ls="--", lw=1.2)
    panel.plot(degrees, curves.measured_mps2[axis] - curves.after_mps2[axis], color=AFTER, lw=1.2)


def on_axis(unexplained: Sequence[Unexplained], axis: int, lock: str) -> list[Unexplained]:
    """Return the residuals of an axis and a lock that do not change during the recording."""
    return [
        residual
        for residual in unexplained
        if residual.axis == AXIS_NAMES[axis] and residual.lock == lock and not residual.changes
    ]


def _legend(figure: Figure, panels: Sequence[Axes], noise: str) -> None:
    """Put one legend above the panels; `noise` is the label of their noise band."""
    entries: dict[str, Artist] = {}
    for panel in panels:
        for handle, label in zip(*panel.get_legend_handles_labels(), strict=True):
            entries.setdefault(noise if noise and label == "noise" else label, handle)
    figure.legend(list(entries.values()), list(entries), loc="outside upper left", ncols=len(entries), handlelength=1.8)


def _symmetric_scale(panel: Axes, values: FloatArray, band: FloatArray) -> None:
    """Choose a scale on which both the largest coefficient and the noise can be read."""
    sizes, noise = np.abs(values[np.isfinite(values)]), band[np.isfinite(band) & (band > 0.0)]
    if not sizes.size or not noise.size or sizes.max() <= _LOG_FROM * np.median(noise):
        return
    linear = float(2.0 * np.median(noise))
    panel.set_yscale("symlog", linthresh=linear, linscale=1.0)
    top = math.floor(math.log10(float(sizes.max())))
    lowest = math.ceil(math.log10(linear))
    decades = [10.0**decade for decade in range(lowest, top + 1)]
    ticks = [*(-tick for tick in reversed(decades)), 0.0, *decades]
    panel.set_yticks(ticks, [f"{tick:g}".replace("-", "−") for tick in ticks])
    limit = 1.6 * float(sizes.max())
    panel.set_ylim(-limit, limit)
    panel.minorticks_off()
