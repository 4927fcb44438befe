"""The ring paper's Eq. 11 with damping: radial and tangential damping apart, and how far a signal tells them apart.

The paper drops damping from Eq. 13 on. Here c_n = c_v + c_w n^2 is kept, beside the geometrically exact ring with the
same two dampings, and the Cramer-Rao bound of both is computed from the exact ring's orders.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.types import ComplexArray
from gateway.forces.damped_modes import phase_lag
from gateway.papers.ring_data import NOISE_MG_PER_RTHZ, OMEGA_RADPS, paper_ring
from gateway.ring.reference_tire import TABLE_3_LOAD_N, TABLE_3_NUMBERS, TABLE_3_PRESSURE_PA
from gateway.ring.ring_series import stiffness_terms
from gateway.ring.rolling_ring import RingParameters, RingSolution, solve_rolling_ring
from gateway.ring.rolling_ring.sensor_waveform import waveform_orders

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Radial loss angle of the sidewall, c_w Omega / k_w; with c_v = c_w it gives a rolling resistance of 2 %.
_LOSS: Final = 0.05
_ORDERS: Final = np.arange(2, 31)
# Orders of the fit of Eq. 11, those of `gateway.ring.sidewall_damping`.
_FITTED: Final = slice(0, 14)
_NODES: Final = 960
# Steps of the derivatives: share of a damping, torque in N m.
_STEP: Final = 0.01
_TORQUE_STEP_NM: Final = 2.0


def figures() -> Mapping[str, Callable[[Figure], str]]:
    """Return the figure by name; it draws into the figure it is given and returns its caption."""
    return {"ring-eq-11": _eq_11}


class DampingBound(NamedTuple):
    """Cramer-Rao bound of a revolution.

    Attributes:
        radial: relative standard error of c_w.
        tangential: of c_v.
        correlation: of both.
        torque_nm: standard error of the driving torque; NaN where it is known.
    """

    radial: float
    tangential: float
    correlation: float
    torque_nm: float


def damping_bound(*, torque_known: bool) -> DampingBound:
    """Return the bound for a sidewall with _LOSS at 65 km/h and 5 mg/rtHz, from orders 2 to 30 of the exact ring.

    The contact centre is not known. Numbers and tread are: they act on the even part of the signal.
    """
    used = [0, 1, 2] if torque_known else [0, 1, 2, 3]
    rows = _derivatives()[used]
    std_m = NOISE_MG_PER_RTHZ * 1e-3 * STANDARD_GRAVITY_MPS2 / math.sqrt(2.0 * math.pi / OMEGA_RADPS) / OMEGA_RADPS**2
    stacked = np.concatenate([rows.real, rows.imag], axis=1) / std_m
    covariance = np.linalg.inv(stacked @ stacked.T)
    std = np.sqrt(np.diagonal(covariance))
    return DampingBound(
        radial=float(std[0]),
        tangential=float(std[1]),
        correlation=float(covariance[0, 1] / (std[0] * std[1])),
        torque_nm=math.nan if torque_known else float(std[3]),
    )


def fitted_dampings(load_n: float, ratio: float = 1.0) -> tuple[float, float]:
    """Return c_w and c_v over the true c_w that Eq. 11 fits to the phases of an exact ring, the true numbers given.

    Fits s_n / c_n = n x + n (c_w n^2 + c_v) Omega / (p0 D_n) over orders 2 to 15, x the shift of the contact pressure.
    """
    ring = _damped(ratio)
    solution = _rolling(ring, load_n)
    n = _ORDERS[_FITTED].astype(np.float64)
    orders = waveform_orders(solution.sensor.radial_m, int(n[-1]))[int(n[0]) :]
    orders = orders * np.exp(1j * n * solution.contact_centre_rad)
    stiffness = stiffness_terms(n) @ np.array(TABLE_3_NUMBERS) * TABLE_3_PRESSURE_PA
    unit = ring.foundation_damping_nspm2 * OMEGA_RADPS
    columns = np.stack([n, n**3 * unit / stiffness, n * unit / stiffness], axis=1) * orders.real[:, np.newaxis]
    _, radial, tangential = np.linalg.lstsq(columns, -orders.imag, rcond=None)[0].tolist()
    return radial, tangential


def _eq_11(figure: Figure) -> str:
    """Phase lag by radial and tangential damping, and the change of the signal by each."""
    lag_axes, signal_axes = figure.subplots(1, 2)
    for name, ring in (("c_w = c_v", _damped(1.0)), ("c_w alone", _damped(0.0)), ("c_v alone", _tangential())):
        lag = phase_lag(_ORDERS, ring, TABLE_3_PRESSURE_PA, OMEGA_RADPS)
        lag_axes.plot(_ORDERS, 1e3 * lag, marker="o", markersize=2.5, label=name)
    lag_axes.set(xlabel="mode number n", ylabel="phase lag n γn, mrad", xlim=(0, 30), ylim=(0, None))
    lag_axes.legend(fontsize=8.0)
    rows = _derivatives()
    labels = ("c_w", "c_v", "contact centre, 1 mrad", "driving torque, 100 N m")
    for row, scale, label in zip(rows, (1.0, 1.0, 1e-3, 100.0), labels, strict=True):
        signal_axes.plot(_ORDERS, -1e3 * scale * row.imag, label=label)
    signal_axes.set(xlabel="mode number n", ylabel="sine coefficient of s / Ω², mm", xlim=(0, 30))
    signal_axes.legend(fontsize=8.0)
    bound, loose = damping_bound(torque_known=True), damping_bound(torque_known=False)
    fitted = {load: fitted_dampings(load) for load in (2000.0, 5000.0, 8000.0)}
    listed = "; ".join(
        f"{load:.0f} N: {radial:.2f} and {tangential:+.2f}" for load, (radial, tangential) in fitted.items()
    )
    resistance = _rolling(_damped(1.0), TABLE_3_LOAD_N).rolling_resistance
    return (
        f"Eq. 11 with c_n = c_v + c_w n², c_v = c_w and a radial loss of {100 * _LOSS:.0f} % (rolling resistance "
        f"{100 * resistance:.1f} % at 5000 N). The phase of c_v falls off faster with the order, by n², so noise alone "
        f"parts them: the Cramér-Rao bound of a revolution at {NOISE_MG_PER_RTHZ:.0f} mg/√Hz is "
        f"{100 * bound.radial:.1f} % of c_w and {100 * bound.tangential:.0f} % of c_v (correlation "
        f"{bound.correlation:+.2f}) where the driving torque is known. Where it is not, {100 * loose.radial:.1f} % and "
        f"{100 * loose.tangential:.0f} %, and the torque is bound to {loose.torque_nm:.0f} N m. The linear ring of Eq. "
        "11 does not reach that bound on a loaded belt: it fits c_w and c_v as these multiples of the truth: "
        f"{listed}. So c_v is not determined by Eq. 11, whatever the number of revolutions, and c_w to half of its "
        "value."
    )


def _damped(ratio: float) -> RingParameters:
    ring = paper_ring(0.0, TABLE_3_PRESSURE_PA)
    damping = _LOSS * ring.radial_stiffness_npm2 / OMEGA_RADPS
    return replace(ring, foundation_damping_nspm2=damping, tangential_damping_ratio=ratio)


def _tangential() -> RingParameters:
    """Return the ring with the tangential damping of `_damped(1)` and next to none radially."""
    ring, share = _damped(1.0), 1e-6
    return replace(
        ring, foundation_damping_nspm2=share * ring.foundation_damping_nspm2, tangential_damping_ratio=1.0 / share
    )


@lru_cache(maxsize=16)
def _rolling(ring: RingParameters, load_n: float) -> RingSolution:
    return solve_rolling_ring(ring, load_n, TABLE_3_PRESSURE_PA, OMEGA_RADPS, nodes=_NODES)


@lru_cache(maxsize=1)
def _derivatives() -> ComplexArray:
    """Return the derivatives of the orders 2 to 30 of s / Omega^2, m, (4, n): by ln c_w, ln c_v, centre and torque."""
    ring = _damped(1.0)

    def solved(radial: float, tangential: float, torque_nm: float, start: RingSolution | None = None) -> RingSolution:
        varied = replace(
            ring,
            foundation_damping_nspm2=radial * ring.foundation_damping_nspm2,
            tangential_damping_ratio=tangential / radial,
        )
        return solve_rolling_ring(
            varied,
            TABLE_3_LOAD_N,
            TABLE_3_PRESSURE_PA,
            OMEGA_RADPS,
            nodes=_NODES,
            axle_torque_nm=torque_nm,
            start=start,
        )

    base = solved(1.0, 1.0, 0.0)
    orders = _orders(base)
    radial = (_orders(solved(1.0 + _STEP, 1.0, 0.0, base)) - orders) / _STEP
    tangential = (_orders(solved(1.0, 1.0 + _STEP, 0.0, base)) - orders) / _STEP
    torque = (_orders(solved(1.0, 1.0, _TORQUE_STEP_NM, base)) - orders) / _TORQUE_STEP_NM
    return np.stack([radial, tangential, -1j * _ORDERS * orders, torque])


def _orders(solution: RingSolution) -> ComplexArray:
    result: ComplexArray = waveform_orders(solution.sensor.radial_m, int(_ORDERS[-1]))[_ORDERS[0] :]
    return result
