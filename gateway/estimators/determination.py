"""Estimates of the four ring numbers, and the test of which of them the data determine.

A standard error from noise alone is too small on a real tire: whatever repeats every revolution and is not in the model
is averaged into the numbers. So estimators pass two covariances: of noise, and of model error, which is the change of
the numbers when the fit's residual is added back with random signs or phases. A number is determined when it lies
DETERMINED standard errors, of both together, from zero.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from gateway.constants import RING_NUMBERS, RING_RATIOS
from gateway.estimators.disagreement import CONTRADICTION, disagreement_std
from gateway.estimators.estimator import AngleAverage, Estimate, Revolution, Status, TireConditions, not_used
from gateway.physics.reference_tire import TABLE_3_NUMBERS
from gateway.reasons import Code, Reason
from gateway.types import BoolArray, FloatArray

_CW: Final = 1

NUMBER_UNITS: Final[FloatArray] = np.array(TABLE_3_NUMBERS) / 0.2325
"""Units of the four numbers in fits: all are about 1 for a car tire at load number 1. 0.2325 is Table 3's, rounded."""

# Effective revolutions in an average from which its estimates are valid.
SETTLED_REVOLUTIONS: Final = 8.0
# Least number of orders: 95 % of the sensitivity to tangential stiffness lies in orders up to 4, to bending up to 14.
LEAST_ORDERS: Final = 16

DETERMINED: Final = 3.0
# Bs below this share of Cw changes the shape only within millimetres of the edges, where a real tire has waves of its
# own: it must be determined better by this factor.
_WEAK_BENDING: Final = 1e-3
_WEAK_FACTOR: Final = 2.0
# Share of the error of a comparison from which what a disagreement adds to it matters.
_NEGLIGIBLE: Final = 0.3
# Correlations above this are reported.
_CONFOUNDED: Final = 0.95


@dataclass(frozen=True, slots=True)
class FittedNumbers:
    """The four numbers of an estimator, in the order of RING_NUMBERS.

    Attributes:
        values: (4,) 0 where on the bound.
        free: (4,) False where the fit puts a number on its bound 0.
        noise: (4, 4) covariance from noise and from the contact edges.
        model: (4, 4) covariance from model error.
    """

    values: FloatArray
    free: BoolArray
    noise: FloatArray
    model: FloatArray


@dataclass(frozen=True, slots=True)
class Determination:
    """Accuracy with which the data determine the four numbers.

    Attributes:
        relative_error: (4,) standard error over value, noise and model; inf where on the bound.
        model_share: (4,) share of the model error in the variance.
        correlation: (4, 4) of noise and model error together; 0 where not free.
        condition: of the correlation of the free numbers; 1 when they are independent.
        determined: (4,) True where a number is determined.
    """

    relative_error: FloatArray
    model_share: FloatArray
    correlation: FloatArray
    condition: float
    determined: BoolArray

    def why_not(self, index: int, relative_error: float | None = None) -> tuple[Reason, ...]:
        """Return why a number, or its ratio to Cw of that relative error, is not determined."""
        error = float(self.relative_error[index] if relative_error is None else relative_error)
        if not math.isfinite(error):
            return (Reason(Code.FIT_AT_ZERO, number=RING_NUMBERS[index]),)
        reasons = [Reason(Code.NOT_DETERMINED, relative_error=error)]
        if self.model_share.any():
            reasons.append(Reason(Code.MODEL_ERROR_SHARE, share=float(self.model_share[index])))
        others = np.abs(self.correlation[index]) - np.eye(4)[index]
        other = int(np.argmax(others))
        if others[other] > _CONFOUNDED:
            correlation = float(self.correlation[index, other])
            reasons.append(Reason(Code.CORRELATED, correlation=correlation, number=RING_NUMBERS[other]))
        return tuple(reasons)


def determination(fitted: FittedNumbers) -> Determination:
    """Return how well the data determine each number."""
    covariance = fitted.noise + fitted.model
    variance = np.diagonal(covariance)
    usable = fitted.free & np.isfinite(variance) & (fitted.values > 0.0)
    std = np.sqrt(np.where(usable, np.maximum(variance, 0.0), 0.0))
    relative = np.full(4, math.inf)
    relative[usable] = std[usable] / fitted.values[usable]
    known = usable & (std > 0.0)
    scale = np.where(known, std, 1.0)
    correlation = np.where(np.outer(known, known), covariance / np.outer(scale, scale), 0.0)
    correlation[np.diag_indices(4)] = 1.0
    eigenvalues = np.linalg.eigvalsh(correlation[np.ix_(known, known)]) if known.any() else np.ones(1)
    share = np.where(known, np.diagonal(fitted.model) / np.square(scale), 0.0)
    determined = relative * DETERMINED <= 1.0
    if usable[0] and usable[_CW] and fitted.values[0] < _WEAK_BENDING * fitted.values[_CW]:
        determined[0] = relative[0] * DETERMINED * _WEAK_FACTOR <= 1.0
    return Determination(
        relative, share, correlation, float(eigenvalues[-1] / max(float(eigenvalues[0]), 1e-300)), determined
    )


def number_estimates(
    estimator: str,
    fitted: FittedNumbers,
    conditions: TireConditions,
    doubts: tuple[Reason, ...],
    notes: tuple[Reason, ...] = (),
) -> tuple[Estimate, ...]:
    """Return Bs, Cw, Rs, Ts, then Bs/Cw, Rs/Cw, Ts/Cw.

    All four numbers are proportional to Q / (p0 R^2), so their errors include those of Q, p0 and R^2. Without load or
    pressure they are invalid, but not the ratios. The width of a belt does not change with wear: where Cw differs from
    the new tire's, load, pressure or radius are not as stated, and the four numbers are provisional; where it differs
    by less than a contradiction, their errors grow by the chance of that.

    Args:
        estimator: name in the registry.
        fitted: the numbers; those of any load number when `conditions` lack load or pressure.
        conditions: with their standard errors.
        doubts: why the estimates are provisional; empty when they are not.
        notes: what valid estimates rest on.
    """
    values, free = fitted.values.tolist(), fitted.free.tolist()
    covariance = (fitted.noise + fitted.model).tolist()
    std = [math.sqrt(max(row[place], 0.0)) for place, row in enumerate(covariance)]
    determined = _determined(values, free, covariance, std)
    missing = missing_conditions(conditions)
    scale = 0.0 if missing else scale_error(conditions)
    numbers_doubts, numbers_notes = doubts, notes
    width, added = (None, 0.0) if missing else _other_width(estimator, values[_CW], std[_CW], conditions)
    if added:
        scale = math.hypot(scale, added)
        numbers_notes = (*notes, *((width,) if width is not None else ()))
    elif width is not None:
        numbers_doubts = (*doubts, width)
    estimates = []
    for i, name in enumerate(RING_NUMBERS):
        if missing:
            estimates.append(Estimate.invalid(name, *missing))
            continue
        error = math.hypot(std[i], values[i] * scale)
        why_not = () if determined[i] else determination(fitted).why_not(i)
        estimates.append(_estimate(name, values[i], error, why_not, numbers_doubts, numbers_notes))
    cw = values[_CW]
    for name, i in zip(RING_RATIOS, (0, 2, 3), strict=True):
        if not free[_CW] or not cw > 0.0:
            estimates.append(Estimate.invalid(name, Reason(Code.FIT_AT_ZERO, number=RING_NUMBERS[_CW])))
            continue
        # To first order.
        ratio = values[i] / cw
        with_cw = covariance[i][_CW] + covariance[_CW][i]
        variance = (covariance[i][i] - ratio * with_cw + ratio * ratio * covariance[_CW][_CW]) / (cw * cw)
        error = math.sqrt(max(0.0, variance))
        # Weak bending must be determined better than the ratio's own error tells.
        fits = error * DETERMINED <= ratio and (i > 0 or determined[i])
        why_not = () if fits else determination(fitted).why_not(i, error / ratio if free[i] and ratio else math.inf)
        estimates.append(_estimate(name, ratio, error, why_not, doubts, notes))
    return tuple(estimates)


def _determined(values: list[float], free: list[bool], covariance: list[list[float]], std: list[float]) -> list[bool]:
    """Return which numbers are determined, as in `Determination`."""
    usable = [free[i] and math.isfinite(covariance[i][i]) and values[i] > 0.0 for i in range(len(values))]
    determined = [usable[i] and std[i] * DETERMINED <= values[i] for i in range(len(values))]
    if usable[0] and usable[_CW] and values[0] < _WEAK_BENDING * values[_CW]:
        determined[0] = std[0] * DETERMINED * _WEAK_FACTOR <= values[0]
    return determined


def _other_width(estimator: str, cw: float, std: float, conditions: TireConditions) -> tuple[Reason | None, float]:
    """Return what the difference between Cw and that of the new tire says, and what it adds to the relative error.

    A contradiction adds nothing. The reason is None where the difference hardly matters.
    """
    reference = conditions.tire.reference
    if reference.estimator != estimator or not reference.Cw or not cw > 0.0:
        return None, 0.0
    error = math.hypot(std / cw, scale_error(conditions), reference.Cw_std / reference.Cw)
    ratio = cw / reference.Cw
    difference = math.log(ratio)
    if abs(difference) > CONTRADICTION * error:
        return Reason(Code.WIDTH_CONTRADICTED, ratio=ratio, std=ratio * error), 0.0
    added = disagreement_std(difference, error)
    if not added > _NEGLIGIBLE * error:
        return None, added
    return Reason(Code.WIDTH_DISAGREES, ratio=ratio, std=ratio * error, error=added), added


def _estimate(
    name: str,
    value: float,
    std: float,
    why_not: tuple[Reason, ...],
    doubts: tuple[Reason, ...],
    notes: tuple[Reason, ...],
) -> Estimate:
    if not (value > 0.0 and math.isfinite(std)):
        return Estimate.invalid(name, *(why_not or (Reason(Code.FIT_AT_ZERO, number=name.removesuffix("/Cw")),)))
    if why_not or doubts:
        return Estimate(name, float(value), float(std), Status.PROVISIONAL, (*doubts, *why_not))
    return Estimate(name, float(value), float(std), Status.VALID, notes)


def load_number(conditions: TireConditions) -> float:
    """Return Q / (p0 R^2); 1 when load or pressure are not known, which leaves the ratios right."""
    if missing_conditions(conditions):
        return 1.0
    assert conditions.load_n is not None
    assert conditions.pressure_pa is not None
    return conditions.load_n / (conditions.pressure_pa * conditions.radius_m**2)


def scale_error(conditions: TireConditions) -> float:
    """Return the relative standard error of Q / (p0 R^2), which all four numbers share."""
    assert conditions.load_n is not None
    assert conditions.pressure_pa is not None
    return math.hypot(
        conditions.load_std_n / conditions.load_n,
        conditions.pressure_std_pa / conditions.pressure_pa,
        2.0 * conditions.radius_std_m / conditions.radius_m,
    )


def missing_conditions(conditions: TireConditions) -> tuple[Reason, ...]:
    """Return what is missing for absolute numbers; empty when nothing is."""
    missing = []
    if not positive(conditions.load_n):
        missing.append(Reason(Code.NEEDS_LOAD))
    if not positive(conditions.pressure_pa):
        missing.append(Reason(Code.NEEDS_PRESSURE))
    return tuple(missing)


def doubt_about(revolution: Revolution, effective_count: float) -> tuple[Reason, ...]:
    """Return why estimates from an average of that effective count are provisional; empty when they are not."""
    if revolution.faults:
        return (not_used(revolution.faults),)
    if effective_count < SETTLED_REVOLUTIONS * (1.0 - 1e-9):
        return (Reason(Code.NOT_SETTLED, revolutions=effective_count, needed=SETTLED_REVOLUTIONS),)
    return ()


def unusable(average: AngleAverage, conditions: TireConditions) -> Reason | None:
    """Return why no ring can be fitted to the average at all; None when one can."""
    orders = int(np.count_nonzero(np.isfinite(average.orders_mps2[1:])))
    if orders < LEAST_ORDERS:
        return Reason(Code.TOO_FEW_ORDERS, orders=orders, needed=LEAST_ORDERS)
    if not 0.0 < 0.5 * (average.trailing_edge_rad - average.leading_edge_rad) < math.pi / 2.0:
        return Reason(Code.NO_CONTACT_EDGES)
    if not (positive(average.omega_radps) and positive(conditions.radius_m)):
        return Reason(Code.SPEED_OR_RADIUS_UNKNOWN)
    return None


def all_invalid(*reasons: Reason) -> tuple[Estimate, ...]:
    """Return the four numbers and the ratios as invalid."""
    return tuple(Estimate.invalid(name, *reasons) for name in (*RING_NUMBERS, *RING_RATIOS))


def positive(value: float | None) -> bool:
    """Return whether a value is known, finite and above 0."""
    return value is not None and math.isfinite(value) and value > 0.0
