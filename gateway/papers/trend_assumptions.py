"""Assumptions under which the ring paper's Figs. 14 to 16 come out, tried on exact rings of known numbers.

The trends of the figures are those of the paper's estimator (Eq. 28), not of the tire. Each assumption changes one
thing: the tire (width, sidewall, tread), or the definition of the contact edges that the estimator is given. The nine
conditions are the new tire at the loads and pressures of Table 1, without noise.
"""

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np

from gateway.core.estimates.estimator import TireConditions
from gateway.core.estimates.registry import make_estimator
from gateway.core.revolutions.contact_edges import contact_levels, smoothing_order
from gateway.core.revolutions.order_spectrum import ORDER_COUNT
from gateway.core.ring_quantities import RING_NUMBERS
from gateway.core.types import FloatArray
from gateway.papers.ring_data import LOADS_N, OMEGA_RADPS, PRESSURES_PA, RADIUS_M, paper_ring, quiet_average
from gateway.papers.ring_paper import fit_ring_numbers
from gateway.ring.reference_tire import TABLE_3_LOAD_N, TABLE_3_PRESSURE_PA
from gateway.ring.ring_series import pressure_number
from gateway.ring.rolling_ring import RingParameters, RingSolution, solve_rolling_ring
from gateway.ring.rolling_ring.sensor_waveform import waveform_orders

_NODES: Final = 720
# Contact width of MF-Tyre 6.1 over the tire's width, with x the deflection over the radius: q1 x^(1/3) + q2 x. Equation
# A3.8 and values of a 205/60R15 tire: Pacejka, Tire and Vehicle Dynamics, 3rd edition, 2012, appendix 3.
_MF_WIDTH: Final = (1.059, -1.1878)
# 10 % softer at 20 mm, the size of the variants in docs/evidence/accuracy.md.
_SOFTENING_PM: Final = -5.0
# Tread 8 mm high and 0.2 m wide: 6 MPa give 150 MN/m^2, twice that where blocks cannot bulge or the tread is worn to
# half. The tire of the other figures has 70 MN/m^2, as of 3 MPa.
_FIRM_TREAD: Final = {"tread_stiffness_npm2": 1.5e8}
_STIFF_TREAD: Final = {"tread_stiffness_npm2": 3e8}


class Edge(StrEnum):
    """Definition of the contact edges that Eq. 28 and the pressure number are given.

    TRUE is where contact pressure ends; STEEPEST the steepest slope of the radial axis, which is the peak of the
    circumferential one; BASELINE where the radial axis crosses its mean.
    """

    TRUE = "pressure ends"
    STEEPEST = "steepest slope"
    BASELINE = "crosses the mean"


@dataclass(frozen=True, slots=True)
class Assumption:
    """One assumption.

    Attributes:
        name: shown in figures and tables.
        ring: load and pressure to the tire.
        edge: definition of the contact edges.
    """

    name: str
    ring: Callable[[float, float], RingParameters]
    edge: Edge = Edge.TRUE


class Reading(NamedTuple):
    """What the estimators make of one condition.

    Attributes:
        solution: the tire in equilibrium.
        half_angle_rad: contact half angle by the assumption's definition.
        steepest_rad: half of the angle between the steepest slopes of the radial axis.
        pressure_number: Pn with that angle (Eq. 33).
        numbers: (4,) Bs, Cw, Rs, Ts of Eq. 28.
        residual_share: rms residual of its fit over the rms signal.
        weak_form: (4,) those of the weak form, which is given no contact angle.
    """

    solution: RingSolution
    half_angle_rad: float
    steepest_rad: float
    pressure_number: float
    numbers: FloatArray
    residual_share: float
    weak_form: FloatArray


class Trend(NamedTuple):
    """Trend of a number over the nine conditions.

    Attributes:
        slope: of the number, linear.
        exponent: of a power law.
        correlation: of number and abscissa.
    """

    slope: float
    exponent: float
    correlation: float


def constant_width(load_n: float, pressure_pa: float) -> RingParameters:
    """Return the tire of the other figures: b is constant, half of the sidewall stiffness grows with pressure."""
    del load_n
    return paper_ring(0.0, pressure_pa)


def mf_width(load_n: float, pressure_pa: float) -> RingParameters:
    """Return a tire whose width grows as the contact width of MF-Tyre 6.1 does."""
    ring = constant_width(load_n, pressure_pa)
    grown = _mf_width(load_n, pressure_pa) / _mf_width(TABLE_3_LOAD_N, TABLE_3_PRESSURE_PA)
    return replace(ring, tension_width_m=ring.tension_width_m * grown)


def eq_31_width(load_n: float, pressure_pa: float) -> RingParameters:
    """Return a tire whose width is in proportion to Q / (2 p0 R theta_r), the contact width of Eq. 31."""
    ring = constant_width(load_n, pressure_pa)
    grown = _eq_31_width(load_n, pressure_pa) / _eq_31_width(TABLE_3_LOAD_N, TABLE_3_PRESSURE_PA)
    return replace(ring, tension_width_m=ring.tension_width_m * grown)


def _changed(
    tire: Callable[[float, float], RingParameters], **values: float
) -> Callable[[float, float], RingParameters]:
    """Return a tire that has other parameters than another one, whatever load and pressure."""
    return lambda load_n, pressure_pa: replace(tire(load_n, pressure_pa), **values)


ASSUMPTIONS: Final = (
    Assumption("constant width", constant_width),
    Assumption("edges: steepest slope", constant_width, Edge.STEEPEST),
    Assumption("edges: crossing the mean", constant_width, Edge.BASELINE),
    Assumption("width of MF-Tyre", mf_width),
    Assumption("width of Eq. 31", eq_31_width),
    Assumption("sidewall softens", _changed(constant_width, sidewall_stiffening_pm=_SOFTENING_PM)),
    Assumption("steepest slope, MF width", mf_width, Edge.STEEPEST),
    Assumption("edge pressure", _changed(constant_width, **_STIFF_TREAD)),
    Assumption("steepest slope, firm tread", _changed(constant_width, **_FIRM_TREAD), Edge.STEEPEST),
    Assumption("steepest, firm tread, Eq. 31", _changed(eq_31_width, **_FIRM_TREAD), Edge.STEEPEST),
    Assumption("steepest, firm tread, MF width", _changed(mf_width, **_FIRM_TREAD), Edge.STEEPEST),
)
"""Assumptions by growing number of changes; the first is the tire of the other figures, the last that beside it."""

IN_PAPER: Final = {"Cw": 1.0, "Rs": -1.0, "Ts": 1.0}
"""Sign of each trend in the paper."""


@lru_cache(maxsize=16)
def readings(assumption: Assumption) -> tuple[Reading, ...]:
    """Return the readings at the nine conditions, by pressure and load."""
    return tuple(
        _reading(assumption, *pressure_and_load) for pressure_and_load in itertools.product(PRESSURES_PA, LOADS_N)
    )


def trend(number: str, series: Sequence[Reading], *, weak_form: bool = False) -> Trend:
    """Return the trend of Eq. 28's number, or the weak form's: Cw over Pn, the others over the contact half angle."""
    index = RING_NUMBERS.index(number)
    x = np.array([reading.pressure_number if number == "Cw" else reading.half_angle_rad for reading in series])
    y = np.array([(reading.weak_form if weak_form else reading.numbers)[index] for reading in series])
    positive = np.maximum(y, 1e-6 * float(np.abs(y).max()))
    return Trend(
        slope=float(np.polyfit(x, y, 1)[0]),
        exponent=float(np.polyfit(np.log(x), np.log(positive), 1)[0]),
        correlation=float(np.corrcoef(x, y)[0, 1]),
    )


def agrees(series: Sequence[Reading]) -> bool:
    """Return whether all three trends of Eq. 28 have the signs of the paper."""
    return all(trend(number, series).correlation * sign > 0.0 for number, sign in IN_PAPER.items())


def edge_pressure(solution: RingSolution) -> float:
    """Return the contact pressure over the outer fifth of the contact, over its mean."""
    x = (solution.theta_rad - solution.contact_centre_rad) / solution.half_angle_rad
    inside = np.abs(x) <= 1.0
    outer = inside & (np.abs(x) >= 0.8)
    return float(solution.contact_pressure_npm[outer].mean() / solution.contact_pressure_npm[inside].mean())


def angle_error_exponent() -> float:
    """Return d ln Cw / d ln Pn of Eq. 28 under an error of the contact angle alone, at 5000 N and 2.1 bar."""
    solution = _solved(constant_width, TABLE_3_LOAD_N, TABLE_3_PRESSURE_PA)
    half, ends = solution.half_angle_rad, (0.99, 1.01)
    low, high = (_eq_28(solution, half * end)[0][1] for end in ends)
    return math.log(high / low) / math.log(ends[0] / ends[1])


def half_angle(solution: RingSolution, edge: Edge) -> float:
    """Return the contact half angle by a definition, from the waveform of the trailing edge."""
    if edge is Edge.TRUE:
        return solution.half_angle_rad
    theta, radial = solution.theta_rad, solution.sensor.radial_m
    if edge is Edge.STEEPEST:
        levels = contact_levels(radial, smoothing_order(math.inf))
        if levels.shapes is None:
            return math.nan
        return 0.5 * (levels.shapes[1].steepest_rad - levels.shapes[0].steepest_rad)
    mean = float(radial.mean())
    crossing = np.flatnonzero((radial[:-1] < mean) & (radial[1:] >= mean) & (theta[:-1] > 0.0))[0]
    share = (mean - radial[crossing]) / (radial[crossing + 1] - radial[crossing])
    return float(theta[crossing] + share * (theta[1] - theta[0]))


def _reading(assumption: Assumption, pressure_pa: float, load_n: float) -> Reading:
    solution = _solved(assumption.ring, load_n, pressure_pa)
    half = half_angle(solution, assumption.edge)
    numbers, residual = _eq_28(solution, half)
    return Reading(
        solution=solution,
        half_angle_rad=half,
        steepest_rad=half_angle(solution, Edge.STEEPEST),
        pressure_number=pressure_number(load_n, pressure_pa, RADIUS_M, half),
        numbers=numbers,
        residual_share=residual,
        weak_form=_weak_form(assumption.ring, load_n, pressure_pa),
    )


def _eq_28(solution: RingSolution, half_angle_rad: float) -> tuple[FloatArray, float]:
    """Return the numbers of Eq. 28 with this contact angle and the true load, and the residual."""
    orders = np.arange(1.0, ORDER_COUNT)
    fit = fit_ring_numbers(
        orders,
        waveform_orders(solution.sensor.radial_m, ORDER_COUNT - 1)[1:].real,
        np.full(len(orders), math.nan),
        force_m=solution.load_n / (math.pi * solution.pressure_pa * RADIUS_M * half_angle_rad),
        half_angle_rad=half_angle_rad,
    )
    if fit is None:
        return np.full(len(RING_NUMBERS), math.nan), math.nan
    return fit.numbers, fit.residual_share


@lru_cache(maxsize=128)
def _solved(ring: Callable[[float, float], RingParameters], load_n: float, pressure_pa: float) -> RingSolution:
    return solve_rolling_ring(ring(load_n, pressure_pa), load_n, pressure_pa, OMEGA_RADPS, nodes=_NODES)


@lru_cache(maxsize=128)
def _weak_form(ring: Callable[[float, float], RingParameters], load_n: float, pressure_pa: float) -> FloatArray:
    revolution, average = quiet_average(_solved(ring, load_n, pressure_pa))
    estimates = make_estimator("weak-form").update(revolution, average, TireConditions(RADIUS_M, load_n, pressure_pa))
    values = {estimate.name: estimate.value for estimate in estimates}
    return np.array([values[number] for number in RING_NUMBERS])


def _mf_width(load_n: float, pressure_pa: float) -> float:
    """Return the contact width of MF-Tyre 6.1 over the tire's, at the deflection of the tire of constant width."""
    x = _solved(constant_width, load_n, pressure_pa).deflection_m / RADIUS_M
    return _MF_WIDTH[0] * math.cbrt(x) + _MF_WIDTH[1] * x


@lru_cache(maxsize=16)
def _eq_31_width(load_n: float, pressure_pa: float) -> float:
    """Return Q / (2 p0 R theta_r), theta_r of the tire with this width in proportion, by fixed-point iteration."""
    ring = constant_width(load_n, pressure_pa)
    half = _solved(constant_width, load_n, pressure_pa).half_angle_rad
    nominal = _solved(constant_width, TABLE_3_LOAD_N, TABLE_3_PRESSURE_PA)
    reference = pressure_number(TABLE_3_LOAD_N, TABLE_3_PRESSURE_PA, RADIUS_M, nominal.half_angle_rad)
    # The contact angle falls with width to the power of a quarter, so three steps leave one percent.
    for _ in range(3):
        grown = pressure_number(load_n, pressure_pa, RADIUS_M, half) / reference
        wide = replace(ring, tension_width_m=ring.tension_width_m * grown)
        half = solve_rolling_ring(wide, load_n, pressure_pa, OMEGA_RADPS, nodes=480).half_angle_rad
    return pressure_number(load_n, pressure_pa, RADIUS_M, half) * RADIUS_M
