"""The figures of a diagnosis's page: which are drawn, and what is said beside them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from gateway.closure.diagnosis import Curves, Diagnosis, Spectra, Trend
from gateway.constants import AXIS_NAMES
from gateway.views.numbers import split_name
from gateway.views.report.figures import (
    CONTACT_VIEW_DEG,
    NOISE_STDS,
    orders_figure,
    residual_figure,
    spectra_figure,
    trend_figure,
    waveform_figure,
)
from gateway.views.report.rows import AxisResidual, present, printed, reference_group, residuals, significant
from gateway.views.report.svg import inline_svg, report_style
from gateway.views.text import clean

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOST_GROUPS: Final = 12
"""Groups whose residual is drawn small beside the reference group."""
MOST_SPECTRA: Final = 6


class Drawing(NamedTuple):
    """One figure: SVG that needs no escaping, and its text."""

    svg: Any
    alt: str
    title: str
    caption: str


class Chapter(NamedTuple):
    """Figures under one heading; `layout` is the class of their box."""

    id: str
    title: str
    text: str
    layout: str
    drawings: list[Drawing]


def chapters(diagnosis: Diagnosis) -> list[Chapter]:
    """Draw all figures of a diagnosis; a chapter without data is left out."""
    with report_style():
        return [chapter for chapter in _chapters(diagnosis) if chapter.drawings]


def _chapters(diagnosis: Diagnosis) -> Iterator[Chapter]:
    groups = diagnosis.curves
    if groups:
        index = reference_group(groups)
        reference = groups[index]
        label = printed(reference.label)
        chosen = "the only group" if len(groups) == 1 else f"of {len(groups)} groups the one that shows most"
        yield Chapter(
            "waveforms",
            "Waveform and residual",
            f"{label}: {chosen}. Residual: mean of the measured revolutions minus model. Nothing "
            f"is a residual that stays within the band, {NOISE_STDS:.0f} standard deviations of the mean's noise.",
            "figures",
            [_waveform(diagnosis, reference, axis, label) for axis in present(reference)],
        )
        yield Chapter(
            "orders",
            "Order spectrum of the residual",
            f"{label}. Cosine and sine coefficients of measured minus model. Where they span decades the scale is "
            "linear within the noise and logarithmic beyond.",
            "figures",
            [_orders(diagnosis, reference, axis, label) for axis in present(reference)],
        )
        others = _spread([one for at, one in enumerate(groups) if at != index], MOST_GROUPS)
        yield Chapter(
            "groups",
            "Residual of the other groups",
            _drawn("Colours and lines as above: dashed before, solid after.", len(others), len(groups) - 1),
            "small-figures",
            [_residual(at, one) for at, one in enumerate(others)],
        )
    yield from _time_locked(diagnosis)
    yield Chapter(
        "trends",
        "Trends of the residual",
        "One point a group: the residual of its mean, noise taken off in power, and the noise of the mean beside it.",
        "figures",
        [_trend(at, trends) for at, trends in enumerate(_by_quantity(diagnosis.trends))],
    )


def _time_locked(diagnosis: Diagnosis) -> Iterator[Chapter]:
    known = [one for one in diagnosis.spectra if bool(np.isfinite(one.measured_m2ps3).any())]
    if not known:
        return
    wanted = diagnosis.curves[reference_group(diagnosis.curves)].label if diagnosis.curves else known[0].label
    at = next((at for at, one in enumerate(known) if one.label == wanted), 0)
    others = _spread([one for index, one in enumerate(known) if index != at], MOST_SPECTRA)
    yield Chapter(
        "spectra",
        "What does not repeat with the wheel",
        "Spectral density of what is left when the mean revolution is taken off; vibration, resonances and tones "
        "stand above the sensor's own noise.",
        "figures",
        [_spectrum("s", known[at], diagnosis)],
    )
    yield Chapter(
        "other-spectra",
        "Time-locked spectra of the other groups",
        _drawn("Colours and lines as above.", len(others), len(known) - 1),
        "small-figures",
        [_spectrum(f"s{index}", one, diagnosis, small=True) for index, one in enumerate(others)],
    )


def _waveform(diagnosis: Diagnosis, curves: Curves, axis: int, label: str) -> Drawing:
    size = next(one for one in residuals(curves) if one.axis == AXIS_NAMES[axis])
    return _drawing(
        waveform_figure(curves, axis, diagnosis.unexplained),
        f"w{axis}",
        f"{AXIS_NAMES[axis].capitalize()} acceleration and residual in m/s² over the wheel's angle, {label}. "
        f"{_sizes(size)}",
        f"{AXIS_NAMES[axis].capitalize()} acceleration.",
        f"Measured mean and models; what both leave; what is left after, to its own scale. Right: within "
        f"±{CONTACT_VIEW_DEG:.0f} deg of the contact's centre. {_sizes(size)}",
    )


def _orders(diagnosis: Diagnosis, curves: Curves, axis: int, label: str) -> Drawing:
    return _drawing(
        orders_figure(curves, axis, diagnosis.unexplained),
        f"o{axis}",
        f"Cosine and sine coefficients in m/s² of the {AXIS_NAMES[axis]} residual by order, before and after, {label}.",
        f"{AXIS_NAMES[axis].capitalize()} residual by order.",
        "Bars at the foot mark orders of what is left unexplained." if _marked(diagnosis, axis) else "",
    )


def _marked(diagnosis: Diagnosis, axis: int) -> bool:
    return any(
        left.axis == AXIS_NAMES[axis] and left.lock == "angle" and left.orders is not None and not left.changes
        for left in diagnosis.unexplained
    )


def _residual(index: int, curves: Curves) -> Drawing:
    label = printed(curves.label)
    sizes = "Residual in m/s² rms, before → after (noise of the mean): " + ", ".join(
        f"{one.axis} {significant(one.before_mps2)} → {significant(one.after_mps2)} ({significant(one.noise_mps2)})"
        for one in residuals(curves)
    )
    return _drawing(
        residual_figure(curves), f"g{index}", f"Residuals over the wheel's angle, {label}. {sizes}.", label, sizes
    )


def _spectrum(prefix: str, spectra: Spectra, diagnosis: Diagnosis, *, small: bool = False) -> Drawing:
    label = printed(spectra.label)
    return _drawing(
        spectra_figure(spectra, diagnosis.unexplained, small=small),
        prefix,
        f"Spectral density in (m/s²)²/Hz over frequency for each axis: measured, sensor noise, effects added; {label}.",
        label,
        "",
    )


def _trend(index: int, trends: Sequence[Trend]) -> Drawing:
    name = clean(split_name(trends[0].against)[0])
    axes = ", ".join(clean(trend.axis) for trend in trends)
    return _drawing(
        trend_figure(trends),
        f"t{index}",
        f"Residual in m/s² rms against {name}, before and after, for the axes {axes}.",
        f"Against {name}.",
        "",
    )


def _drawing(figure: Figure, prefix: str, alt: str, title: str, caption: str) -> Drawing:
    from markupsafe import Markup

    # Matplotlib escapes what it draws, and figures draw no names of recordings.
    return Drawing(Markup(inline_svg(figure, prefix)), alt, title, caption)


def _sizes(size: AxisResidual) -> str:
    return (
        f"Residual {significant(size.before_mps2)} m/s² rms before, {significant(size.after_mps2)} after; "
        f"noise of the mean {significant(size.noise_mps2)}."
    )


def _drawn(keys: str, drawn: int, there: int) -> str:
    return keys if drawn == there else f"{keys} {drawn} of {there} groups, evenly picked."


def _spread(items: list[Any], most: int) -> list[Any]:
    if len(items) <= most:
        return items
    return [items[round(at)] for at in np.linspace(0, len(items) - 1, most)]


def _by_quantity(trends: Sequence[Trend]) -> list[list[Trend]]:
    grouped: dict[str, list[Trend]] = {}
    for trend in trends:
        if trend.at.size:
            grouped.setdefault(trend.against, []).append(trend)
    return list(grouped.values())
