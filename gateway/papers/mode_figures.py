"""The ring paper's Figs. 7, 9 and 10, redrawn: standing waves of the signal, modal force, influence of the numbers.

The signal is that of a geometrically exact ring with the numbers of Table 3, at 5000 N and 2.1 bar. Each function draws
into a matplotlib figure and returns a caption: what is reproduced, what is not, and why.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import TYPE_CHECKING, Final

import numpy as np
from scipy.interpolate import CubicSpline

from gateway.compare.order_statistics import BLOCK_REVOLUTIONS, OrderAccumulator, OrderStatistics
from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.revolutions.angle_resampling import GRID_SIZE, angle_grid
from gateway.core.revolutions.order_spectrum import highest_order
from gateway.core.ring_quantities import RING_NUMBERS
from gateway.core.types import FloatArray
from gateway.papers.ring_data import NOISE_MG_PER_RTHZ, RADIUS_M, RATE_HZ, fitted_orders, measured_orders, new_tire
from gateway.ring.reference_tire import TABLE_3_NUMBERS
from gateway.ring.ring_series import (
    Kinematics,
    modal_force,
    modal_number,
    modal_stiffness,
    signal_orders,
    stiffness_terms,
)
from gateway.ring.rolling_ring import RingSolution

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_SPEEDS_KMH: Final = (30.0, 65.0, 120.0)
_BLOCKS: Final = 4
# Vibration of the axle on a road, white up to the end of its band; about what `rms_mps2 = 2` of a scenario gives.
_ROAD_MPS2: Final = 2.0
_ROAD_BAND_HZ: Final = 500.0
_ORDERS: Final = np.arange(1, 61)
_SHOWN_ORDERS: Final = 30
_INFLUENCE_ORDERS: Final = np.arange(1, 31)
# Share of a number's influence on the signal, in squares, that the caption reports the orders of.
_BULK: Final = 0.95


def figures() -> Mapping[str, Callable[[Figure], str]]:
    """Return the figures by name; each draws into the figure it is given and returns its caption."""
    return {"ring-fig-7": _fig_7, "ring-fig-9": _fig_9, "ring-fig-10": _fig_10}


def _fig_7(figure: Figure) -> str:
    """Radial acceleration over several revolutions and its spectrum at three speeds."""
    upper, lower = figure.subplots(2, 1, height_ratios=(1, 2))
    spectra = {speed: _spectrum(speed) for speed in _SPEEDS_KMH}
    block = spectra[65.0].block_mps2[2][: 4 * GRID_SIZE]
    upper.plot(np.arange(len(block)) / GRID_SIZE, block, color="black", linewidth=0.8, label="65 km/h")
    upper.set(xlim=(0, 4), xlabel="revolutions", ylabel="radial\n(inward), m/s²")
    upper.legend(loc="upper right", fontsize=8.0)
    shares = []
    off_order = 0.0
    for speed, spectrum in spectra.items():
        amplitude = 1e3 * spectrum.fine_mps2[2] / _omega(speed) ** 2
        share, std = 100.0 * spectrum.integer_share[2], 100.0 * spectrum.integer_share_std[2]
        shares.append(f"{share:.3f} ± {std:.3f} % at {speed:.0f} km/h")
        lower.plot(spectrum.fine_order[1:], amplitude[1:], linewidth=0.9, label=f"{speed:.0f} km/h: {share:.3f} %")
        is_off_order = np.arange(len(amplitude)) % BLOCK_REVOLUTIONS != 0
        off_order = max(off_order, float(np.nanmax(amplitude[is_off_order]) / np.nanmax(amplitude[1:])))
    lower.set(
        xlim=(0, _SHOWN_ORDERS), xlabel="frequency over that of rotation", ylabel="amplitude / Ω², mm", yscale="log"
    )
    lower.legend(fontsize=8.0, title="power on integer orders", title_fontsize=8.0)
    return (
        f"Reproduced: the spectrum over {BLOCK_REVOLUTIONS} revolutions has its peaks on integer orders, and of the "
        f"power above order 0 there lie {', '.join(shares)}; white noise alone has {100.0 / BLOCK_REVOLUTIONS:.1f} %. "
        f"Between them the amplitude is at most {100 * off_order:.1f} % of the largest. The noise is that of a sensor "
        f"({NOISE_MG_PER_RTHZ:.0f} mg/√Hz) and of a road ({_ROAD_MPS2:.0f} m/s² rms below {_ROAD_BAND_HZ:.0f} Hz). "
        "Integer orders show that the signal repeats with the revolution, as any signal locked to the wheel does. They "
        "do not show that a ring describes it. For a recording: `treadlink orders RECORDING --figure FILE`."
    )


def _fig_9(figure: Figure) -> str:
    """Modal force, modal tire model and amplitude of each standing wave."""
    force, model, signal = figure.subplots(1, 3)
    tire = new_tire()
    ring, half = tire.ring, tire.half_angle_rad
    uniform = modal_force(_ORDERS, ring.load_n, RADIUS_M, half)
    exact_force = _exact_force(ring)
    force.plot(_ORDERS, 1e-3 * uniform, color="#D55E00", label="Eq. 23, uniform")
    force.plot(_ORDERS, 1e-3 * exact_force, ":", color="black", label="exact ring")
    force.set(xlabel="mode number n", ylabel="modal force αn, kN/m")
    true, fitted = (
        modal_number(_ORDERS, numbers) for numbers in (TABLE_3_NUMBERS, tire.estimates["ring-paper"].tolist())
    )
    model.plot(_ORDERS, -fitted, color="#D55E00", label="fitted")
    model.plot(_ORDERS, -true, ":", color="black", label="true numbers")
    model.set(xlabel="mode number n", ylabel="modal tire model -An p0", yscale="log")
    measured, by_fit = measured_orders(tire.average), fitted_orders(tire)
    signal.plot(_ORDERS, 1e3 * measured, ":", color="black", label="sensor")
    signal.plot(_ORDERS, 1e3 * by_fit, color="#D55E00", label="Eq. 27, fitted")
    signal.set(xlabel="mode number n", ylabel="cosine coefficient of s / Ω², mm")
    for axes in (force, model, signal):
        axes.legend(fontsize=7.5)
    zero = math.pi / half
    ring_zero = float(np.interp(0.0, -exact_force[: round(2 * zero)], _ORDERS[: round(2 * zero)]))
    error = float(np.linalg.norm(uniform - exact_force) / np.linalg.norm(exact_force))
    return (
        f"Reproduced: the modal force falls from Q / R = {1e-3 * ring.load_n / RADIUS_M:.1f} kN/m, the modal tire "
        f"model has its largest value at n = {_ORDERS[np.argmax(-true)]}, and their product fits the sensor's orders. "
        f"The uniform pressure of Eq. 22 first vanishes at n = π / θr = {zero:.1f}; the pressure of the exact ring at "
        f"{ring_zero:.1f}. The two forces differ by {100 * error:.0f} % rms over orders 1 to 60. Orders from there up "
        "show the shape of the contact pressure, not the tire."
    )


def _fig_10(figure: Figure) -> str:
    """Influence of each dimensionless number by order."""
    share_axes, signal_axes = figure.subplots(1, 2)
    n = _INFLUENCE_ORDERS
    terms = stiffness_terms(n) * np.array(TABLE_3_NUMBERS)
    shares = terms / modal_stiffness(n, TABLE_3_NUMBERS)[:, np.newaxis]
    # Size of d (s_n / Omega^2) / d ln number: the order times the share of Dn.
    influence, printed = (
        np.abs(_signal_orders(kinematics)[:, np.newaxis] * shares)
        for kinematics in (Kinematics.CORRECTED, Kinematics.PRINTED)
    )
    for index, name in enumerate(RING_NUMBERS):
        (line,) = share_axes.plot(n, 100.0 * shares[:, index], marker="o", markersize=2.5, label=name)
        signal_axes.plot(n, 1e3 * influence[:, index], color=line.get_color(), label=name)
        signal_axes.plot(n, 1e3 * printed[:, index], ":", color=line.get_color(), linewidth=1.0)
    share_axes.set(xlabel="mode number n", ylabel="share of the modal stiffness Dn, %", ylim=(0, 100))
    signal_axes.set(xlabel="mode number n", ylabel="change of s / Ω² by the number's logarithm, mm", yscale="log")
    signal_axes.set_ylim(1e-3, None)
    share_axes.legend(fontsize=8.0)
    largest = [RING_NUMBERS[column] for column in shares.argmax(axis=1)]
    ranges = ", ".join(
        f"{name} at {_range([int(order) for order, number in zip(n, largest, strict=True) if number == name])}"
        for name in RING_NUMBERS
        if name in largest
    )
    ends = ", ".join(f"{name} {_orders_with_most(influence[:, index])}" for index, name in enumerate(RING_NUMBERS))
    return (
        "Reproduced: Rs and Ts act on low modes, Cw and Bs on high ones. The largest term of the modal stiffness is "
        f"{ranges}. Ts is nowhere the largest: it has {100 * shares[0, 3]:.0f} % at n = 1, {100 * shares[1, 3]:.0f} % "
        f"at n = 2 and {100 * shares[3, 3]:.1f} % at n = 4. A sensor on the ring does not read n = 1 at all (n² - 1; "
        f"dotted: n² as in Eq. 25), so that Ts rests on orders 2 to 4. {100 * _BULK:.0f} % of each number's influence "
        f"on the signal (squares) lie at orders up to: {ends}. The influences overlap: the paper's conclusion that all "
        "four are estimated accurately does not follow from this figure."
    )


@lru_cache(maxsize=4)
def _spectrum(speed_kmh: float) -> OrderStatistics:
    """Return the order statistics of _BLOCKS blocks at one speed, with gravity, sensor noise and road."""
    omega = _omega(speed_kmh)
    ring = new_tire().ring
    radial, _ = ring.sensor.specific_force(omega)
    curve = CubicSpline(np.append(ring.theta_rad, math.pi), np.append(radial, radial[0]), bc_type="periodic")
    wave = curve(angle_grid())
    per_revolution = 2.0 * math.pi / omega
    samples = RATE_HZ * per_revolution
    rng = np.random.default_rng(round(speed_kmh))
    turns = _BLOCKS * BLOCK_REVOLUTIONS
    count = turns * GRID_SIZE
    line_hz = np.fft.rfftfreq(count, per_revolution / GRID_SIZE)
    # Power per hertz of both, white up to the end of its band; the sampling carries half of its rate.
    density = np.where(line_hz <= 0.5 * RATE_HZ, (NOISE_MG_PER_RTHZ * 1e-3 * STANDARD_GRAVITY_MPS2) ** 2, 0.0)
    density += np.where(line_hz <= _ROAD_BAND_HZ, _ROAD_MPS2**2 / _ROAD_BAND_HZ, 0.0)
    white = rng.standard_normal(len(line_hz)) + 1j * rng.standard_normal(len(line_hz))
    noise = np.fft.irfft(white * np.sqrt(density / 2.0 * line_hz[1] / 2.0) * count, n=count)
    total = OrderAccumulator(omega)
    for index, part in enumerate(noise.reshape(turns, GRID_SIZE)):
        axes = np.full((3, GRID_SIZE), math.nan)
        # A revolution begins at angle 0, in the middle of the grid.
        axes[2] = wave + np.roll(part, GRID_SIZE // 2)
        total.add(index, axes, omega, highest_order(samples))
    statistics = total.statistics()
    if statistics is None:
        raise ValueError("no revolution was added")
    return statistics


def _omega(speed_kmh: float) -> float:
    return speed_kmh / 3.6 / RADIUS_M


def _exact_force(ring: RingSolution) -> FloatArray:
    """Return the modal force of the exact ring's own contact pressure, N/m: the vertical push of `modal_force`."""
    n = _ORDERS[:, np.newaxis]
    kernel = (
        np.cos(ring.theta_rad) * np.cos(n * ring.theta_rad) + np.sin(ring.theta_rad) * np.sin(n * ring.theta_rad) / n
    )
    result: FloatArray = kernel @ ring.contact_pressure_npm * (2.0 * math.pi / len(ring.theta_rad))
    return result


def _signal_orders(kinematics: Kinematics) -> FloatArray:
    """Return the orders of s / Omega^2 of the new tire's linear ring, m, (n,)."""
    tire = new_tire()
    return signal_orders(
        _INFLUENCE_ORDERS,
        TABLE_3_NUMBERS,
        load_n=tire.ring.load_n,
        pressure_pa=tire.ring.pressure_pa,
        radius_m=RADIUS_M,
        half_angle_rad=tire.half_angle_rad,
        kinematics=kinematics,
    )


def _orders_with_most(influence: FloatArray) -> int:
    """Return the lowest order up to which _BULK of the squares lie."""
    running = np.cumsum(np.square(influence))
    return int(_INFLUENCE_ORDERS[np.searchsorted(running, _BULK * running[-1])])


def _range(orders: list[int]) -> str:
    return f"n = {orders[0]}" if len(orders) == 1 else f"n = {orders[0]} to {orders[-1]}"
