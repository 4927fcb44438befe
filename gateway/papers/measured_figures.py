"""The papers' figures of measurements: Figs. 7, 11 to 16 of the ring paper, 2, 11, 13 to 15 of the ply steer paper.

They show all wheels and conditions, but Fig. 13 of the ply steer paper, which shows the first with a lateral axis. Its
Figs. 14 and 15 show the wheels of which only the pressure or only the load varies.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Final

import numpy as np

from gateway.compare.order_statistics import OrderStatistics
from gateway.core.errors import ConfigError
from gateway.core.nearest_name import did_you_mean
from gateway.core.revolutions.angle_resampling import GRID_SIZE, angle_grid
from gateway.core.revolutions.order_spectrum import ORDER_COUNT
from gateway.core.ring_quantities import RING_NUMBERS
from gateway.core.types import FloatArray
from gateway.forces.lateral_deformation import ORDERS, deformation, lateral_waveform
from gateway.papers.measured_tires import AHEAD, SLOPES, MeasuredTire, Waveforms
from gateway.papers.ring_data import ESTIMATORS, measured_orders
from gateway.papers.ring_figures import STYLES, draw_orders, draw_waveform, linear_trend, relative_residual
from gateway.ring.ring_series import signal_orders

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

_SHOWN_ORDERS: Final = 30
# Names in a legend; more lines have none.
_MOST_NAMES: Final = 8
# Wheels in a row of a figure.
_ROW: Final = 3
# Loads, and pressures, within it are one condition.
_SAME_CONDITION: Final = 0.03
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


# Wheels with coefficients, m: orders of Eq. 27, or of the lateral axis.
_WithOrders = Sequence[tuple[MeasuredTire, Waveforms, FloatArray]]


def _waveforms(tires: Sequence[MeasuredTire]) -> list[tuple[MeasuredTire, Waveforms]]:
    with_waveforms = [(tire, tire.waveforms) for tire in tires if tire.waveforms is not None]
    if not with_waveforms:
        raise _MissingError("a dataset has no waveforms")
    return with_waveforms


def _fitted(tires: Sequence[MeasuredTire]) -> _WithOrders:
    """Return the wheels with the orders of Eq. 27, m."""
    fitted = []
    for tire, waveforms in _waveforms(tires):
        values, _ = tire.numbers.get(ESTIMATORS[0], (np.full(len(RING_NUMBERS), math.nan), None))
        if np.isfinite(values).all():
            orders = signal_orders(
                np.arange(1, ORDER_COUNT),
                values.tolist(),
                load_n=tire.load_n,
                pressure_pa=tire.pressure_pa,
                radius_m=tire.radius_m,
                half_angle_rad=tire.fitted_half_angle_rad or tire.half_angle_rad,
            )
            fitted.append((tire, waveforms, orders))
    if not fitted:
        raise _MissingError("Eq. 28 gives no numbers; they need load and pressure")
    return fitted


def _make_fig_7(tires: Sequence[MeasuredTire]) -> Draw:
    spectra = [
        (tire, waveforms.orders)
        for tire, waveforms in _waveforms(tires)
        if waveforms.orders is not None and np.isfinite(waveforms.orders.integer_share[2])
    ]
    if not spectra:
        raise _MissingError("no recording has four revolutions that follow each other at a steady speed")
    return _titled(_fig_7, spectra)


def _fig_7(spectra: Sequence[tuple[MeasuredTire, OrderStatistics]], figure: Figure) -> str:
    """Radial acceleration over several revolutions and its spectrum."""
    upper, lower = figure.subplots(2, 1, height_ratios=(1, 2))
    shares = []
    for tire, spectrum in spectra:
        block = spectrum.block_mps2[2][: 4 * GRID_SIZE]
        upper.plot(np.arange(len(block)) / GRID_SIZE, block, linewidth=0.8)
        omega = tire.speed_kmh / 3.6 / tire.radius_m
        amplitude = 1e3 * spectrum.fine_mps2[2] / omega**2
        label = f"{tire.name}, {tire.speed_kmh:.0f} km/h"
        lower.plot(spectrum.fine_order[1:], amplitude[1:], linewidth=0.9, label=label)
        shares.append(
            f"{100.0 * spectrum.integer_share[2]:.3f} % of {label}, over {spectrum.block_revolutions} revolutions, "
            f"where white noise alone has {100.0 * spectrum.noise_share:.1f} %"
        )
    upper.set(xlim=(0, 4), xlabel="revolutions", ylabel="radial\n(inward), m/s²")
    lower.set(
        xlim=(0, _SHOWN_ORDERS), xlabel="frequency over that of rotation", ylabel="amplitude / Ω², mm", yscale="log"
    )
    _legend(lower, len(spectra))
    return f"Power above order 0 that lies on integer orders: {'; '.join(shares)}."


def _legend(axes: Axes, count: int) -> None:
    """Name the lines where they are few."""
    if count <= _MOST_NAMES:
        axes.legend(fontsize=8.0)


def _panels(figure: Figure, count: int) -> list[SubFigure]:
    """Return a part of the figure for each of several wheels."""
    columns = min(count, _ROW)
    rows = math.ceil(count / columns)
    width, height = figure.get_size_inches()
    figure.set_size_inches(width * (1.0 + 0.5 * (columns - 1)), height * max(0.75 * rows, 1.0))
    panels: list[SubFigure] = np.ravel(figure.subfigures(rows, columns, squeeze=False)).tolist()
    return panels[:count]


def _fig_11(fitted: _WithOrders, figure: Figure) -> str:
    """Standing-wave amplitudes of the radial acceleration: signal and fitted linear ring."""
    residuals = []
    for (tire, waveforms, orders), panel in zip(fitted, _panels(figure, len(fitted)), strict=True):
        measured = measured_orders(waveforms.average)
        draw_orders(panel.subplots(), measured, orders, tire.name)
        finite = np.isfinite(measured)
        residuals.append(f"{100 * relative_residual(measured[finite], orders[finite]):.0f} % of {_condition(tire)}")
    return (
        f"Residual of the orders by Eq. 27 with the numbers of Eq. 28: {'; '.join(residuals)}. A good fit of the "
        "orders does not make the numbers right."
    )


def _fig_12(fitted: _WithOrders, figure: Figure) -> str:
    """Radial acceleration over a revolution: signal and fitted linear ring."""
    errors = []
    for (tire, waveforms, orders), panel in zip(fitted, _panels(figure, len(fitted)), strict=True):
        average = waveforms.average
        label = f"{tire.name}, {average.count} revolutions"
        error = draw_waveform(panel, average.radial_mps2, average.omega_radps, tire.radius_m, orders, label)
        size = np.ptp(average.radial_mps2)
        errors.append(f"{np.sqrt(np.mean(error**2)):.0f} of {size:.0f} m/s² peak to peak of {_condition(tire)}")
    return f"Root mean square error of the waveform that the four numbers of Eq. 28 give: {'; '.join(errors)}."


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


def _make_slopes(against: str, constant: str, tires: Sequence[MeasuredTire]) -> Draw:
    wheels = _comparable_wheels(tires, against, constant)
    series = {name: [(tire, *tire.slopes_rad[name]) for tire in wheels if name in tire.slopes_rad] for name in SLOPES}
    degrees = {
        name: [(tire, math.degrees(value), math.degrees(std)) for tire, value, std in points]
        for name, points in series.items()
    }
    draw = _titled(_trend, _usable(degrees, against), "ply steer angle, °", against)
    draw.__doc__ = f"Ply steer angle against {against}"
    return draw


def _comparable_wheels(tires: Sequence[MeasuredTire], against: str, constant: str) -> Sequence[MeasuredTire]:
    """Return the wheels of one load, or pressure, that have the most values of the other; all if none is known."""
    abscissa, constant_of = (_ABSCISSAE[name][1] for name in (against, constant))
    complete = [tire for tire in tires if 0.0 < abscissa(tire) < math.inf and 0.0 < constant_of(tire) < math.inf]

    def neighbours(middle: MeasuredTire) -> list[MeasuredTire]:
        return [tire for tire in complete if abs(constant_of(tire) / constant_of(middle) - 1.0) <= _SAME_CONDITION]

    def values(wheels: Sequence[MeasuredTire]) -> int:
        steps = np.diff(np.log(sorted(abscissa(tire) for tire in wheels)))
        return int(np.count_nonzero(steps > _SAME_CONDITION))

    if not complete:
        return tires
    chosen = max(map(neighbours, complete), key=values)
    if not values(chosen) and values(complete):
        raise _MissingError(f"no two wheels of one {constant} differ in {against}")
    return chosen


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
        style = dict(
            STYLES.get(name, {"marker": "os^D"[index % 4], "markersize": 5.5, "label": name.replace("_", " ")})
        )
        axes.errorbar(x, y, yerr=np.nan_to_num(std), linestyle="none", capsize=2.0, alpha=0.85, **style)
        if len(set(x)) >= _FEWEST_FOR_TREND:
            slope, correlation = linear_trend(x, y)
            sentences.append(f"{style['label']}: slope {slope:+.3g}, r {correlation:+.2f}, {len(x)} points")
    axes.set(xlabel=_ABSCISSAE[against][0], ylabel=label)
    axes.set_ylim(min(0.0, axes.get_ylim()[0]), max(0.0, axes.get_ylim()[1]))
    axes.legend(fontsize=8.0)
    trends = "; ".join(sentences) or "too few conditions for a trend"
    return f"Against {against}: {trends}. Bars are one standard error."


def _lateral(tires: Sequence[MeasuredTire]) -> _WithOrders:
    """Return the wheels with the coefficients of their lateral axis, m."""
    lateral = [(tire, wave, wave.lateral_m) for tire, wave in _waveforms(tires) if wave.lateral_m is not None]
    if not lateral:
        raise _MissingError("no sensor has a lateral axis")
    return lateral


def _make_ply_2(tires: Sequence[MeasuredTire]) -> Draw:
    lateral = _lateral(tires)
    if len(lateral) < 2:
        raise _MissingError("one recording has no other slip to compare with")
    return _titled(_ply_2, lateral)


def _ply_2(lateral: _WithOrders, figure: Figure) -> str:
    """Lateral acceleration of all recordings."""
    axes = figure.subplots()
    sizes = []
    for tire, waveforms, lateral_m in lateral:
        wave = waveforms.average.omega_radps**2 * lateral_waveform(lateral_m, GRID_SIZE)
        axes.plot(np.degrees(angle_grid()), wave, label=tire.name)
        sizes.append(f"{wave.max():.0f} and {wave.min():.0f} m/s² of {_condition(tire)}")
    axes.set(xlim=(-60, 60), xlabel="angle from contact centre, °", ylabel="lateral acceleration, m/s²")
    _legend(axes, len(lateral))
    return f"Extrema of orders {ORDERS.start} to {ORDERS.stop - 1}, without the sensor's roll: {'; '.join(sizes)}."


def _ply_11(lateral: _WithOrders, figure: Figure) -> str:
    """Lateral acceleration, mean of the samples and its orders that the estimator uses."""
    sizes = []
    for (tire, waveforms, lateral_m), panel in zip(lateral, _panels(figure, len(lateral)), strict=True):
        axes = panel.subplots()
        wave = waveforms.average.omega_radps**2 * lateral_waveform(lateral_m, GRID_SIZE)
        if waveforms.orders is not None and waveforms.orders.block_mps2.size:
            samples = waveforms.orders.block_mps2[1]
            mean_wave = samples[: len(samples) // GRID_SIZE * GRID_SIZE].reshape(-1, GRID_SIZE).mean(axis=0)
            # A block begins in the middle of a contact.
            mean_wave = np.roll(mean_wave - mean_wave.mean(), GRID_SIZE // 2)
            axes.plot(np.degrees(angle_grid()), mean_wave, color="0.6", label="samples with the roll, without mean")
        axes.plot(np.degrees(angle_grid()), wave, color="black", label=f"{tire.name}, orders")
        axes.set(xlim=(-60, 60), xlabel="angle from contact centre, °", ylabel="lateral acceleration, m/s²")
        axes.legend(fontsize=7.0)
        sizes.append(f"{wave.max():.0f} and {wave.min():.0f} m/s² of {_condition(tire)}")
    return (
        f"Orders {ORDERS.start} to {ORDERS.stop - 1} without the roll have their extrema at the contact edges: "
        f"{'; '.join(sizes)}."
    )


def _ply_13(tire: MeasuredTire, _: Waveforms, lateral_m: FloatArray, figure: Figure) -> str:
    """Lateral deformation, integrated twice, with the slopes in the contact."""
    axes = figure.subplots()
    shape = deformation(lateral_m, GRID_SIZE)
    shape = shape - shape[GRID_SIZE // 2]
    axes.plot(np.degrees(angle_grid()), 1e3 * shape, color="black", label=tire.name)
    edges = np.array(tire.edges_rad)
    named = []
    for definition, (slope, std) in tire.slopes_rad.items():
        if math.isfinite(slope) and definition != AHEAD:
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


_FIGURES: Final[dict[str, Callable[[Sequence[MeasuredTire]], Draw]]] = {
    "ring-fig-7": _make_fig_7,
    "ring-fig-11": lambda tires: _titled(_fig_11, _fitted(tires)),
    "ring-fig-12": lambda tires: _titled(_fig_12, _fitted(tires)),
    "ring-fig-13": partial(_make_trend, "Bs", "Bending stiffness number against wear", "wear"),
    "ring-fig-14": partial(_make_trend, "Cw", "Contact width number against pressure number", "pressure number"),
    "ring-fig-15": partial(_make_trend, "Rs", "Radial stiffness number against contact angle", "contact angle"),
    "ring-fig-16": partial(_make_trend, "Ts", "Tangential stiffness number against contact angle", "contact angle"),
    "ply-steer-fig-2": _make_ply_2,
    "ply-steer-fig-11": lambda tires: _titled(_ply_11, _lateral(tires)),
    "ply-steer-fig-13": lambda tires: _titled(_ply_13, *_lateral(tires)[0]),
    "ply-steer-fig-14": partial(_make_slopes, "pressure", "load"),
    "ply-steer-fig-15": partial(_make_slopes, "load", "pressure"),
}
