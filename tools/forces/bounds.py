"""The Cramer-Rao bound of the longitudinal quantities, from one revolution of the radial and circumferential axes.

Derivatives of the exact ring's waveform by its numbers, tread stiffness, dampings, torque and contact centre. The
contact shear of that ring is proportional to its pressure, which the estimator does not assume, so the bound may be
below what a method that is free of it can reach.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from accuracy.tables import Table

from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.revolutions.order_spectrum import ORDER_COUNT
from gateway.core.types import FloatArray
from gateway.forces.asymmetric_belt import curvature_from_signal
from gateway.forces.asymmetric_rows import Force
from gateway.forces.asymmetric_solve import solve_asymmetric
from gateway.ring.belt_shape import orders_about
from gateway.ring.reference_tire import TABLE_3_NUMBERS, TABLE_3_PRESSURE_PA, TABLE_3_RADIUS_M
from gateway.ring.rolling_ring import RingParameters, RingSolution, solve_rolling_ring
from gateway.ring.rolling_ring.sensor_waveform import waveform_orders

LOAD_N: Final = 5000.0
DENSITY_MG: Final = 5.0
_NODES: Final = 1440
_ORDERS: Final = 60
_STEP: Final = 2e-3
_OFFSET_M: Final = 6e-3
_LOGARITHMS: Final = (
    "bending_stiffness_nm2",
    "tension_width_m",
    "radial_stiffness_npm2",
    "tangential_stiffness_npm2",
    "tread_stiffness_npm2",
)
_DAMPING: Final = 60.0
_TREAD_DAMPING: Final = 2e3
_TORQUE_NM: Final = 50.0


@dataclass(frozen=True, slots=True)
class Sensitivity:
    """Derivatives of one revolution by the parameters: logarithms, two dampings in their own size, torque, centre.

    Attributes:
        radial: (k, 2 m) of the orders of the radial axis, m/s^2.
        along: (k, 2 m) of the circumferential axis.
        quantities: (3, k) of longitudinal force, torque and rolling resistance.
        tilt: (2 m,) of the circumferential axis by the sensor's pitch.
        period_s: of the revolution.
    """

    radial: FloatArray
    along: FloatArray
    quantities: FloatArray
    tilt: FloatArray
    period_s: float


DAMPING, TREAD_DAMPING = len(_LOGARITHMS), len(_LOGARITHMS) + 1


def sensitivity(speed_kmh: float, torque_nm: float = _TORQUE_NM) -> Sensitivity:
    """Return the derivatives of the reference tire at a speed."""
    omega = speed_kmh / 3.6 / TABLE_3_RADIUS_M
    ring = RingParameters.from_numbers(
        *TABLE_3_NUMBERS,
        radius_m=TABLE_3_RADIUS_M,
        pressure_pa=TABLE_3_PRESSURE_PA,
        foundation_damping_nspm2=_DAMPING,
        tread_damping_nspm2=_TREAD_DAMPING,
    )

    def solve(other: RingParameters, torque: float) -> RingSolution:
        return solve_rolling_ring(
            other, LOAD_N, TABLE_3_PRESSURE_PA, omega, nodes=_NODES, sensor_offset_m=_OFFSET_M, axle_torque_nm=torque
        )

    def moved(step: float) -> list[RingSolution]:
        changed = [replace(ring, **{name: getattr(ring, name) * math.exp(step)}) for name in _LOGARITHMS]
        changed.append(replace(ring, foundation_damping_nspm2=_DAMPING * (1.0 + 25.0 * step)))
        changed.append(replace(ring, tread_damping_nspm2=_TREAD_DAMPING * (1.0 + 25.0 * step)))
        return [*(solve(other, torque_nm) for other in changed), solve(ring, torque_nm + 1e3 * step)]

    base = solve(ring, torque_nm)
    above, below = moved(_STEP), moved(-_STEP)
    scale = np.array([*(1.0 for _ in _LOGARITHMS), 25.0, 25.0, 1e3]) * 2.0 * _STEP
    radial = [_stacked(a.sensor.radial_m - b.sensor.radial_m) for a, b in zip(above, below, strict=True)]
    along = [
        _stacked(a.sensor.circumferential_m - b.sensor.circumferential_m) for a, b in zip(above, below, strict=True)
    ]
    quantities = np.array([_quantities(a) - _quantities(b) for a, b in zip(above, below, strict=True)])
    square = omega**2
    turned = [_turned(curve) for curve in (base.sensor.radial_m, base.sensor.circumferential_m)]
    return Sensitivity(
        radial=square * np.vstack([np.array(radial) / scale[:, None], turned[0]]),
        along=square * np.vstack([np.array(along) / scale[:, None], turned[1]]),
        quantities=np.vstack([quantities / scale[:, None], np.zeros(3)]).T,
        tilt=square * _stacked(base.sensor.radial_m),
        period_s=2.0 * math.pi / omega,
    )


def _stacked(curve: FloatArray) -> FloatArray:
    orders = waveform_orders(curve, _ORDERS)[1:]
    return np.concatenate([orders.real, orders.imag])


def _turned(curve: FloatArray) -> FloatArray:
    orders = -1j * np.arange(1, _ORDERS + 1) * waveform_orders(curve, _ORDERS)[1:]
    return np.concatenate([orders.real, orders.imag])


def _quantities(ring: RingSolution) -> FloatArray:
    return np.array([ring.longitudinal_force_n, ring.axle_torque_nm, ring.rolling_resistance])


def bound(
    sensitivities: Sequence[Sensitivity],
    fixed: Sequence[int] = (),
    *,
    along: bool = False,
    tilt_std_rad: float = math.inf,
) -> tuple[FloatArray, FloatArray]:
    """Return the covariance of the quantities of the first of several speeds, and of all parameters there.

    Stiffnesses and dampings are those of the tire at every speed; torque and contact centre are each speed's own.

    Args:
        sensitivities: one revolution of each.
        fixed: parameters that are known.
        along: whether the circumferential axis is used too.
        tilt_std_rad: of the sensor's pitch, which reads the radial into the circumferential axis.
    """
    common = TREAD_DAMPING + 1
    per_speed = sensitivities[0].radial.shape[0] - common
    count = common + per_speed * len(sensitivities) + 1
    information = np.zeros((count, count))
    for number, entry in enumerate(sensitivities):
        indices = [*range(common), *range(common + per_speed * number, common + per_speed * (number + 1))]
        std = DENSITY_MG * 1e-3 * STANDARD_GRAVITY_MPS2 / math.sqrt(entry.period_s)
        rows = np.zeros((count, entry.radial.shape[1] * (2 if along else 1)))
        rows[indices, : entry.radial.shape[1]] = entry.radial
        if along:
            rows[indices, entry.radial.shape[1] :] = entry.along
            rows[-1, entry.radial.shape[1] :] = entry.tilt
        information += rows @ rows.T / std**2
    information[-1, -1] += tilt_std_rad**-2 if math.isfinite(tilt_std_rad) else 0.0
    if not along:
        information[-1, -1] = 1.0
    free = [index for index in range(count) if index not in fixed]
    part = information[np.ix_(free, free)]
    scale = np.sqrt(np.diagonal(part))
    covariance = np.zeros((count, count))
    covariance[np.ix_(free, free)] = np.linalg.inv(part / np.outer(scale, scale)) / np.outer(scale, scale)
    first = [*range(common), *range(common, common + per_speed)]
    whole = covariance[np.ix_(first, first)]
    quantities = sensitivities[0].quantities
    return quantities @ whole @ quantities.T, whole


def bound_table() -> Table:
    """Return the bound in several cases."""
    by_speed = {speed: sensitivity(speed) for speed in (30.0, 65.0, 120.0)}
    cases: list[tuple[str, Sequence[Sensitivity], tuple[int, ...], bool, float]] = [
        ("65 km/h", [by_speed[65.0]], (), False, math.inf),
        ("65 km/h, no tread damping", [by_speed[65.0]], (TREAD_DAMPING,), False, math.inf),
        ("65 km/h, sidewall damping known", [by_speed[65.0]], (DAMPING, TREAD_DAMPING), False, math.inf),
        ("65 km/h, stiffnesses known", [by_speed[65.0]], tuple(range(DAMPING)), False, math.inf),
        ("65 km/h, and one at 120 km/h", [by_speed[65.0], by_speed[120.0]], (), False, math.inf),
        ("65 km/h, and at 30 and 120 km/h", [by_speed[65.0], by_speed[30.0], by_speed[120.0]], (), False, math.inf),
        ("65 km/h, circumferential axis, pitch unknown", [by_speed[65.0]], (), True, math.inf),
        ("65 km/h, circumferential axis, pitch known", [by_speed[65.0]], (), True, 1e-9),
        ("30 km/h", [by_speed[30.0]], (), False, math.inf),
        ("120 km/h", [by_speed[120.0]], (), False, math.inf),
    ]
    rows = []
    for name, sensitivities, fixed, along, tilt in cases:
        covariance, whole = bound(sensitivities, fixed, along=along, tilt_std_rad=tilt)
        std = np.sqrt(np.diagonal(covariance))
        # Torque with the sidewall's damping.
        torque, damping = TREAD_DAMPING + 1, DAMPING
        size = math.sqrt(whole[torque, torque] * whole[damping, damping])
        correlation = f"{whole[torque, damping] / size:+.2f}" if size else "-"
        rows.append((name, f"{std[0]:.0f}", f"{std[1]:.1f}", f"{100.0 * std[2]:.2f}", correlation))
    rows.append(("65 km/h, the estimator", *(f"{value:.{digits}f}" for value, digits in _by_estimator()), "-"))
    return Table(
        "Cramer-Rao bound of one revolution",
        f"{LOAD_N:.0f} N, {DENSITY_MG:g} mg/√Hz; stiffnesses, tread, both dampings, torque and centre unknown",
        ("data", "longitudinal force, N", "torque, N m", "rolling resistance, %", "torque with sidewall damping"),
        tuple(rows),
    )


def _by_estimator() -> Iterator[tuple[float, int]]:
    """Yield the standard errors of the estimator's own balance for one revolution, with the digits to show."""
    omega = 65.0 / 3.6 / TABLE_3_RADIUS_M
    ring = RingParameters.from_numbers(
        *TABLE_3_NUMBERS,
        radius_m=TABLE_3_RADIUS_M,
        pressure_pa=TABLE_3_PRESSURE_PA,
        foundation_damping_nspm2=_DAMPING,
        tread_damping_nspm2=_TREAD_DAMPING,
    )
    base = solve_rolling_ring(ring, LOAD_N, TABLE_3_PRESSURE_PA, omega, nodes=_NODES, axle_torque_nm=_TORQUE_NM)
    signal = orders_about(base.sensor.radial_m, base.contact_centre_rad, _ORDERS)
    noise = DENSITY_MG * 1e-3 * STANDARD_GRAVITY_MPS2 * math.sqrt(omega / (2.0 * math.pi))
    std = np.full(ORDER_COUNT, noise / (omega**2 * float(signal[0].real)))
    result = solve_asymmetric(curvature_from_signal(signal, 0.0), std, base.half_angle_rad)
    covariance = result.noise(std) + result.common()
    difference = np.array([0.0, -1.0, 1.0, 0.0])
    yield LOAD_N * math.sqrt(covariance[Force.LONGITUDINAL, Force.LONGITUDINAL]), 0
    yield LOAD_N * TABLE_3_RADIUS_M * math.sqrt(covariance[Force.TORQUE, Force.TORQUE]), 1
    yield 100.0 * math.sqrt(float(difference @ covariance @ difference)), 2
