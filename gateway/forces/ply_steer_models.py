"""Candidate laws for the ply steer angle over load and pressure, compared with Tables I and II of the ply steer paper.

Eq. 18 with the curvature change of a flat contact, 1/R, has no trend; the candidates do. Each is fitted to relative
errors and compared by its error at points left out of the fit. Contact length, deflection and curvature are those of a
rolling ring; with a radial axis the measured contact length can be used.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.types import FloatArray
from gateway.ring.reference_tire import TABLE_3_NUMBERS
from gateway.ring.rolling_ring import RingParameters, RingSolution, solve_rolling_ring

# Ply steer paper, Table I (400 kg) and Table II (2.1 bar), 205/55R16; their common point is listed once.
TABLE_LOAD_KG: Final = (400.0, 400.0, 400.0, 400.0, 300.0, 500.0)
TABLE_PRESSURE_BAR: Final = (1.8, 2.1, 2.4, 2.7, 2.1, 2.1)
TABLE_ANGLE_DEG: Final = (0.2826, 0.229, 0.2159, 0.1916, 0.1907, 0.2781)
# Table II, at 300, 400 and 500 kg.
TABLE_FORCE_N: Final = (24.39, 36.89, 55.44)

# Belt radius of a 205/55R16.
RADIUS_M: Final = 0.31
_NUMBERS_AT_PA: Final = 2.1e5
_NODES: Final = 1440


@dataclass(frozen=True, slots=True)
class Points:
    """Operating points, (m,) each.

    Attributes:
        load_n: vertical load.
        pressure_pa: inflation pressure.
        half_length_m: half of the contact length, R times the half angle.
        curvature_pm: mean change of the belt's curvature in the contact (negative: it is bent flat).
        deflection_m: of the tire.
        tension_n: of the belt on the inflated tire, p0 b R.
        radius_m: R.
    """

    load_n: FloatArray
    pressure_pa: FloatArray
    half_length_m: FloatArray
    curvature_pm: FloatArray
    deflection_m: FloatArray
    tension_n: FloatArray
    radius_m: float


@dataclass(frozen=True, slots=True)
class Candidate:
    """A law for the angle.

    Attributes:
        name: formula.
        basis: (m, k) functions whose sum with k constants is the angle, or its logarithm.
        logarithmic: whether the logarithm is fitted.
    """

    name: str
    basis: Callable[[Points], FloatArray]
    logarithmic: bool = False


@dataclass(frozen=True, slots=True)
class Comparison:
    """Fit of a candidate and its errors.

    Attributes:
        name: formula.
        constants: fitted on all points, SI and radians.
        fitted_rad: (m,) angles of the fit on all points.
        fit_rms: relative error of the fit.
        left_out_rms: relative error at points left out of the fit, one at a time.
        left_out_max: the largest of them.
    """

    name: str
    constants: FloatArray
    fitted_rad: FloatArray
    fit_rms: float
    left_out_rms: float
    left_out_max: float


CANDIDATES: Final = (
    Candidate("K / R (Eq. 18, flat contact)", lambda points: np.ones((len(points.load_n), 1))),
    Candidate("K k_x (Eq. 18, mean curvature change)", lambda points: points.curvature_pm[:, None]),
    Candidate(
        "K 2 d / a^2 (Eq. 18, parabola)", lambda points: (points.deflection_m / points.half_length_m**2)[:, None]
    ),
    Candidate("K a", lambda points: points.half_length_m[:, None]),
    Candidate("K a^2", lambda points: points.half_length_m[:, None] ** 2),
    Candidate("K Q", lambda points: points.load_n[:, None]),
    Candidate("K / p", lambda points: 1.0 / points.pressure_pa[:, None]),
    Candidate("K Q / p", lambda points: (points.load_n / points.pressure_pa)[:, None]),
    Candidate("K sqrt(Q / p)", lambda points: np.sqrt(points.load_n / points.pressure_pa)[:, None]),
    Candidate("K a / p", lambda points: (points.half_length_m / points.pressure_pa)[:, None]),
    Candidate("K a / sqrt(p)", lambda points: (points.half_length_m / np.sqrt(points.pressure_pa))[:, None]),
    Candidate(
        "K a / sqrt(T (1 + p / 2.1 bar) / 2)",
        lambda points: (
            points.half_length_m / np.sqrt(points.tension_n * (0.5 + 0.5 * points.pressure_pa / _NUMBERS_AT_PA))
        )[:, None],
    ),
    Candidate(
        "phi0 + K a^2 / p",
        lambda points: np.stack([np.ones_like(points.load_n), points.half_length_m**2 / points.pressure_pa], axis=1),
    ),
    Candidate(
        "K Q^m p^n",
        lambda points: np.stack(
            [np.ones_like(points.load_n), np.log(points.load_n), np.log(points.pressure_pa)], axis=1
        ),
        logarithmic=True,
    ),
)


_SPEED_MPS: Final = 60.0 / 3.6


def car_tire_ring(pressure_pa: float) -> RingParameters:
    """Return a car tire's ring at a pressure: the ring paper's numbers at 2.1 bar, sidewall half pressure-borne."""
    nominal = RingParameters.from_numbers(*TABLE_3_NUMBERS, radius_m=RADIUS_M, pressure_pa=_NUMBERS_AT_PA)
    stiffness_ratio = 0.5 + 0.5 * pressure_pa / _NUMBERS_AT_PA
    return RingParameters(
        radius_m=RADIUS_M,
        tension_width_m=nominal.tension_width_m,
        bending_stiffness_nm2=nominal.bending_stiffness_nm2,
        radial_stiffness_npm2=stiffness_ratio * nominal.radial_stiffness_npm2,
        tangential_stiffness_npm2=stiffness_ratio * nominal.tangential_stiffness_npm2,
    )


def roll_car_tire(load_n: float, pressure_pa: float) -> RingSolution:
    """Return the paper's tire size rolling under load."""
    return solve_rolling_ring(car_tire_ring(pressure_pa), load_n, pressure_pa, _SPEED_MPS / RADIUS_M, nodes=_NODES)


def table_points() -> tuple[Points, FloatArray]:
    """Return the paper's six operating points on the modelled ring, and the measured angles, rad."""
    load = np.array(TABLE_LOAD_KG) * STANDARD_GRAVITY_MPS2
    pressure = np.array(TABLE_PRESSURE_BAR) * 1e5
    rings = [roll_car_tire(q, p) for q, p in zip(load, pressure, strict=True)]
    points = Points(
        load_n=load,
        pressure_pa=pressure,
        half_length_m=np.array([RADIUS_M * ring.half_angle_rad for ring in rings]),
        curvature_pm=np.array([float(ring.curvature_pm[ring.in_contact].mean()) - 1.0 / RADIUS_M for ring in rings]),
        deflection_m=np.array([ring.deflection_m for ring in rings]),
        tension_n=np.array([p * ring.ring.tension_width_m * RADIUS_M for p, ring in zip(pressure, rings, strict=True)]),
        radius_m=RADIUS_M,
    )
    return points, np.radians(TABLE_ANGLE_DEG)


def compare(points: Points, angle_rad: FloatArray) -> list[Comparison]:
    """Fit every candidate, on all points and leaving one out; best left-out error first."""
    results = []
    for candidate in CANDIDATES:
        basis = candidate.basis(points)
        constants = _fit(basis, angle_rad, candidate.logarithmic)
        fitted = _angle(basis, constants, candidate.logarithmic)
        left_out = np.empty_like(angle_rad)
        for i in range(len(angle_rad)):
            mask = np.arange(len(angle_rad)) != i
            others = _fit(basis[mask], angle_rad[mask], candidate.logarithmic)
            left_out[i] = _angle(basis[i : i + 1], others, candidate.logarithmic)[0] / angle_rad[i] - 1.0
        results.append(
            Comparison(
                name=candidate.name,
                constants=constants,
                fitted_rad=fitted,
                fit_rms=float(np.sqrt(np.mean(np.square(fitted / angle_rad - 1.0)))),
                left_out_rms=float(np.sqrt(np.mean(np.square(left_out)))),
                left_out_max=float(np.abs(left_out).max()),
            )
        )
    return sorted(results, key=lambda result: result.left_out_rms)


def _fit(basis: FloatArray, angle_rad: FloatArray, logarithmic: bool) -> FloatArray:
    """Return the constants with the least relative error."""
    target = np.log(angle_rad) if logarithmic else np.ones_like(angle_rad)
    scaled = basis if logarithmic else basis / angle_rad[:, None]
    return np.asarray(np.linalg.lstsq(scaled, target, rcond=None)[0], dtype=np.float64)


def _angle(basis: FloatArray, constants: FloatArray, logarithmic: bool) -> FloatArray:
    value: FloatArray = basis @ constants
    return np.exp(value) if logarithmic else value
