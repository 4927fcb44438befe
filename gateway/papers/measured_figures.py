"""The papers' figures of measurements: Figs. 7 and 11 to 16 of the ring paper, 13 to 15 of the ply steer paper.

Figures of a waveform show the first wheel that has one; figures of trends show all wheels and conditions.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Final

import numpy as np

from gateway.compare.order_statistics import BLOCK_REVOLUTIONS, OrderStatistics
from gateway.core.errors import ConfigError
from gateway.core.estimates.ring_series import signal_orders
from gateway.core.nearest_name import did_you_mean
from gateway.core.revolutions.angle_resampling import GRID_SIZE, angle_grid
from gateway.core.revolutions.order_spectrum import ORDER_COUNT
from gateway.core.ring_quantities import RING_NUMBERS
from gateway.core.types import FloatArray
from gateway.forces.lateral_deformation import ORDERS, deformation
from gateway.papers.measured_tires import SLOPES, MeasuredTire, Waveforms
from gateway.papers.ring_data import ESTIMATORS, measured_orders
from gateway.papers.ring_figures import STYLES, draw_orders, draw_waveform, linear_trend, relative_residual

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_SHOWN_ORDERS: Final = 30
# Spectra of the first wheel at each of so many speeds that differ by so much.
_MOST_SPECTRA: Final = 4
_SPEED_STEP_KMH: Final = 5.0
_FEWEST_FOR_TREND: Final = 3

Draw = Callable[["Figure"], str]


class _MissingError(Exception):
    """The measurements lack what a figure shows."""


def measured_figures(
    tires: Sequence[MeasuredTire], names: Sequence[str] = ()
) -> tuple[dict[str, Draw], dict[str, str]]:
    """Return the figures that the measurements allow, and why the others are left out.

    Args:
        tires: wheels and conditions.
        names: of the figures; all where it is empty.

    Raises:
        ConfigError: a name is unknown, or a figure that is named lacks its data.
    """
    for name in names:
        if name not in _FIGURES:
            raise ConfigError(
                f"no figure '{name}' from measurements",
                f"{did_you_mean(name, _FIGURES)}There are {', '.join(_FIGURES)}.",
            )
    figures: dict[str, Draw] = {}
    missing: dict[str, str] = {}
    for name in names or _FIGURES:
        try:
            figures[name] = _FIGURES[name](tires)
        except _MissingError as reason:
            if names:
                raise ConfigError(f"'{name}' cannot be drawn: {reason}", "Give recordings that have it.") from None
            missing[name] = str(reason)
    return figures, missing


def _titled(draw: Callable[..., str], *arguments: object) -> Draw:
    """Return a drawing function with its data and its title."""
    drawing = partial(draw, *arguments)
    drawing.__doc__ = draw.__doc__
    return drawing


def _waveform(tires: Sequence[MeasuredTire]) -> tuple[MeasuredTire, Waveforms]:
    for tire in tires:
        if tire.waveforms is not None:
            return tire, tire.waveforms
    raise _MissingError("a dataset has no waveforms")


def _fitted(tires: Sequence[MeasuredTire]) -> tuple[MeasuredTire, Waveforms, FloatArray]:
    """Return a wheel with the orders of Eq. 27, m."""
    _waveform(tires)
    for tire in tires:
        values, _ = tire.numbers.get(ESTIMATORS[0], (np.full(len(RING_NUMBERS), math.nan), None))
        if tire.waveforms is not None and np.isfinite(values).all():
            fitted = signal_orders(
                np.arange(1, ORDER_COUNT),
                values.tolist(),
                load_n=tire.load_n,
                pressure_pa=tire.pressure_pa,
                radius_m=tire.radius_m,
                half_angle_rad=tire.half_angle_rad,
            )
            return tire, tire.waveforms, fitted
    raise _MissingError("Eq. 28 gives no numbers; they need load and pressure")


def _make_fig_7(tires: Sequence[MeasuredTire]) -> Draw:
    _waveform(tires)
    spectra: dict[int, tuple[MeasuredTire, OrderStatistics]] = {}
    for tire in tires:
        orders = tire.waveforms.orders if tire.waveforms is not None else None
        if orders is not None and np.isfinite(orders.integer_share[2]):
            spectra.setdefault(round(tire.speed_kmh / _SPEED_STEP_KMH), (tire, orders))
    if not spectra:
        raise _MissingError(f"no recording has {BLOCK_REVOLUTIONS} revolutions that follow each other")
    return _titled(_fig_7, list(spectra.values())[:_MOST_SPECTRA])


def _fig_7(spectra: Sequence[tuple[MeasuredTire, OrderStatistics]], figure: Figure) -> str:
    """Radial acceleration over several revolutions and its spectrum."""
    upper, lower = figure.subplots(2, 1, height_ratios=(1, 2))
    block = spectra[0][1].block_mps2[2][: 4 * GRID_SIZE]
    upper.plot(np.arange(len(block)) / GRID_SIZE, block, color="black", linewidth=0.8, label=spectra[0][0].name)
    upper.set(xlim=(0, 4), xlabel="revolutions", ylabel="radial\n(inward), m/s²")
    upper.legend(loc="upper right", fontsize=8.0)
    shares = []
    for tire, spectrum in spectra:
        omega = tire.speed_kmh / 3.6 / tire.radius_m
        amplitude = 1e3 * spectrum.fine_mps2[2] / omega**2
        share = f"{100.0 * spectrum.integer_share[2]:.3f} %"
        shares.append(f"{share} of {tire.name} at {tire.speed_kmh:.0f} km/h")
        lower.plot(
            spectrum.fine_order[1:], amplitude[1:], linewidth=0.9, label=f"{tire.name}, {tire.speed_kmh:.0f} km/h"
        )
    lower.set(
        xlim=(0, _SHOWN_ORDERS), xlabel="frequency over that of rotation", ylabel="amplitude / Ω², mm", yscale="log"
    )
    lower.legend(fontsize=8.0)
    return (
        f"Power above order 0 that lies on integer orders, over {BLOCK_REVOLUTIONS} revolutions: {', '.join(shares)}; "
        f"white noise alone has {100.0 / BLOCK_REVOLUTIONS:.1f} %."
    )


def _fig_11(tire: MeasuredTire, waveforms: Waveforms, fitted: FloatArray, figure: Figure) -> str:
    """Standing-wave amplitudes of the radial acceleration: signal and fitted linear ring."""
    measured = measured_orders(waveforms.average)
    draw_orders(figure.subplots(), measured, fitted, tire.name)
    finite = np.isfinite(measured)
    return (
        f"{_condition(tire)}: Eq. 27 with the numbers of Eq. 28 fits the orders with a residual of "
        f"{relative_residual(measured[finite], fitted[finite]):.0%}. A good fit of the orders does not make the "
        "numbers right."
    )


def _fig_12(tire: MeasuredTire, waveforms: Waveforms, fitted: FloatArray, figure: Figure) -> str:
    """Radial acceleration over a revolution: signal and fitted linear ring."""
    average = waveforms.average
    label = f"{tire.name}, {average.count} revolutions"
    error = draw_waveform(figure, average.radial_mps2, average.omega_radps, tire.radius_m, fitted, label)
    return (
        f"{_condition(tire)}: the four numbers of Eq. 28 give the waveform within {np.sqrt(np.mean(error**2)):.0f} "
        f"m/s² rms of {np.ptp(average.radial_mps2):.0f} m/s² peak to peak."
    )


_ABSCISSAE: Final[dict[str, tuple[str, Callable[[MeasuredTire], float]]]] = {
    "wear": ("wear, mm", lambda tire: tire.wear_mm),
    "pressure number": ("pressure number Pn = Q / (2 p0 θr R²)", lambda tire: tire.pressure_number),
    "contact angle": ("contact half angle, °", lambda tire: math.degrees(tire.half_angle_rad)),
    "pressure": ("pressure, bar", lambda tire: 1e-5 * tire.pressure_pa),
    "load": ("load, N", lambda tire: tire.load_n),
}


def _make_trend(number: str, title: str, against: str, tires: Sequence[MeasuredTire]) -> Draw:
    index = RING_NUMBERS.index(number)
    series = {
        estimator: [
            (tire, float(tire.numbers[estimator][0][index]), float(tire.numbers[estimator][1][index]))
            for tire in tires
            if estimator in tire.numbers
        ]
        for estimator in ESTIMATORS
    }
    draw = _titled(_trend, _usable(series, against), number, against)
    draw.__doc__ = title
    return draw


def _make_slopes(against: str, tires: Sequence[MeasuredTire]) -> Draw:
    series = {name: [(tire, *tire.slopes_rad[name]) for tire in tires if name in tire.slopes_rad] for name in SLOPES}
    degrees = {
        name: [(tire, math.degrees(value), math.degrees(std)) for tire, value, std in points]
        for name, points in series.items()
    }
    draw = _titled(_trend, _usable(degrees, against), "ply steer angle, °", against)
    draw.__doc__ = f"Ply steer angle against {against}"
    return draw


_Points = dict[str, list[tuple[float, float, float]]]


def _usable(series: Mapping[str, Sequence[tuple[MeasuredTire, float, float]]], against: str) -> _Points:
    """Return abscissa, value and error of each point that has them.

    Raises:
        _MissingError: less than two different abscissae.
    """
    abscissa = _ABSCISSAE[against][1]
    points = {
        name: [(abscissa(tire), value, std) for tire, value, std in values if math.isfinite(abscissa(tire) + value)]
        for name, values in series.items()
    }
    if not any(points.values()):
        raise _MissingError(f"no wheel has both a value and a known {against}")
    if len({x for values in points.values() for x, _, _ in values}) < 2:
        raise _MissingError(f"all wheels have the same {against}")
    return {name: values for name, values in points.items() if values}


def _trend(points: _Points, label: str, against: str, figure: Figure) -> str:
    """Values against a condition, with their errors."""
    axes: Axes = figure.subplots()
    sentences = []
    for index, (name, values) in enumerate(points.items()):
        x, y, std = (list(column) for column in zip(*values, strict=True))
        style = dict(STYLES.get(name, {"marker": "os^"[index % 3], "markersize": 5.5, "label": name.replace("_", " ")}))
        axes.errorbar(x, y, yerr=np.nan_to_num(std), linestyle="none", capsize=2.0, alpha=0.85, **style)
        if len(set(x)) >= _FEWEST_FOR_TREND:
            slope, correlation = linear_trend(x, y)
            sentences.append(f"{style['label']}: slope {slope:+.3g}, r {correlation:+.2f}, {len(x)} points")
    axes.set(xlabel=_ABSCISSAE[against][0], ylabel=label)
    axes.set_ylim(min(0.0, axes.get_ylim()[0]), max(0.0, axes.get_ylim()[1]))
    axes.legend(fontsize=8.0)
    trends = "; ".join(sentences) or "too few conditions for a trend"
    return f"Against {against}: {trends}. Bars are one standard error."


def _make_ply_13(tires: Sequence[MeasuredTire]) -> Draw:
    _waveform(tires)
    for tire in tires:
        if tire.waveforms is not None and tire.waveforms.lateral_m is not None:
            return _titled(_ply_13, tire, tire.waveforms.lateral_m)
    raise _MissingError("no sensor has a lateral axis")


def _ply_13(tire: MeasuredTire, lateral_m: FloatArray, figure: Figure) -> str:
    """Lateral deformation, integrated twice, with the slopes in the contact."""
    axes = figure.subplots()
    shape = deformation(lateral_m, GRID_SIZE)
    shape = shape - shape[GRID_SIZE // 2]
    axes.plot(np.degrees(angle_grid()), 1e3 * shape, color="black", label=tire.name)
    edges = np.array(tire.edges_rad)
    named = []
    for definition, (slope, std) in tire.slopes_rad.items():
        if math.isfinite(slope):
            text = f"{definition.replace('_', ' ')}: {math.degrees(slope):.3f} ± {math.degrees(std):.3f}°"
            named.append(text)
            axes.plot(np.degrees(edges), 1e3 * slope * tire.radius_m * edges, ":", label=text)
    for edge in np.degrees(edges):
        axes.axvline(edge, color="0.8")
    axes.set(xlim=(-180, 180), xlabel="angle from contact centre, °", ylabel="lateral deformation, mm (mean unknown)")
    axes.legend(fontsize=8.0)
    angles = "; ".join(named) or "no valid slope"
    return f"{_condition(tire)}: integrated twice over orders {ORDERS.start} to {ORDERS.stop - 1}. Slopes: {angles}."


def _condition(tire: MeasuredTire) -> str:
    parts = [tire.name, f"{tire.speed_kmh:.0f} km/h"]
    if math.isfinite(tire.load_n):
        parts.append(f"{tire.load_n:.0f} N")
    if math.isfinite(tire.pressure_pa):
        parts.append(f"{1e-5 * tire.pressure_pa:.2f} bar")
    return ", ".join(parts)


def _make_fitted(draw: Callable[..., str], tires: Sequence[MeasuredTire]) -> Draw:
    return _titled(draw, *_fitted(tires))


_FIGURES: Final[dict[str, Callable[[Sequence[MeasuredTire]], Draw]]] = {
    "ring-fig-7": _make_fig_7,
    "ring-fig-11": partial(_make_fitted, _fig_11),
    "ring-fig-12": partial(_make_fitted, _fig_12),
    "ring-fig-13": partial(_make_trend, "Bs", "Bending stiffness number against wear", "wear"),
    "ring-fig-14": partial(_make_trend, "Cw", "Contact width number against pressure number", "pressure number"),
    "ring-fig-15": partial(_make_trend, "Rs", "Radial stiffness number against contact angle", "contact angle"),
    "ring-fig-16": partial(_make_trend, "Ts", "Tangential stiffness number against contact angle", "contact angle"),
    "ply-steer-fig-13": _make_ply_13,
    "ply-steer-fig-14": partial(_make_slopes, "pressure"),
    "ply-steer-fig-15": partial(_make_slopes, "load"),
}
