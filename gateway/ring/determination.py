"""Estimates of the four ring numbers, and the test of which of them the data determine.

A standard error from noise alone is too small on a real tire: whatever repeats every revolution and is not in the model
is averaged into the numbers. So estimators pass two covariances: of noise, and of model error, which is the change of
the numbers when the fit's residual is added back with random signs or phases. A number is determined when it lies
DETERMINED standard errors, of both together, from zero.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple, Self

import numpy as np

from gateway.core.estimates.disagreement import CONTRADICTION, disagreement_std
from gateway.core.estimates.doubt_rules import DoubtRule
from gateway.core.estimates.estimator import (
    DETERMINED,
    SETTLED_REVOLUTIONS,
    AngleAverage,
    Estimate,
    Revolution,
    Status,
    TireConditions,
    estimate_of,
    not_used,
)
from gateway.core.estimates.reasons import EstimateCode
from gateway.core.reasons import CoreCode, Reason
from gateway.core.ring_quantities import RING_NUMBERS, RING_RATIOS
from gateway.core.types import BoolArray, FloatArray
from gateway.ring.reasons import RingCode
from gateway.ring.reference_tire import TABLE_3_NUMBERS

_CW: Final = 1
_NAMES: Final = (*RING_NUMBERS, *RING_RATIOS)
_COUNT: Final = len(RING_NUMBERS)
_NUMBERS: Final = slice(_COUNT)
_RATIOS: Final = slice(_COUNT, None)
# Numbers over Cw, in the order of RING_RATIOS.
_OVER_CW: Final = np.array([0, 2, 3])

NUMBER_UNITS: Final[FloatArray] = np.array(TABLE_3_NUMBERS) / 0.2325
"""Units of the four numbers in fits: all are about 1 for a car tire at load number 1. 0.2325 is Table 3's, rounded."""

# Least number of orders: 95 % of the sensitivity to tangential stiffness lies in orders up to 4, to bending up to 14.
LEAST_ORDERS: Final = 16

# Bs below this share of Cw changes the shape only within millimetres of the edges, where a real tire has waves of its
# own: it must be determined better by this factor.
_WEAK_BENDING: Final = 1e-3
_WEAK_FACTOR: Final = 2.0
# Share of the error of a comparison from which what a disagreement adds to it matters.
_NEGLIGIBLE: Final = 0.3
# Change of Cw by the extension of the belt and by what else the ring of the estimators does not have, relative.
_WIDTH_MODEL_STD: Final = 0.02
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
class FittedSeries:
    """The four numbers of k revolutions; the arrays are filled in.

    Attributes:
        values: (k, 4) 0 where on the bound.
        free: (k, 4) as in `FittedNumbers`.
        noise: (k, 4, 4) likewise.
        model: (k, 4, 4) likewise.
    """

    values: FloatArray
    free: BoolArray
    noise: FloatArray
    model: FloatArray

    @classmethod
    def empty(cls, count: int) -> Self:
        """Return numbers of `count` revolutions, all on the bound."""
        noise, model = np.zeros((2, count, 4, 4))
        return cls(np.zeros((count, 4)), np.zeros((count, 4), dtype=np.bool_), noise, model)

    @classmethod
    def of(cls, numbers: FittedNumbers) -> Self:
        """Return the numbers of one revolution."""
        first_axis = np.newaxis
        return cls(
            numbers.values[first_axis], numbers.free[first_axis], numbers.noise[first_axis], numbers.model[first_axis]
        )

    def at(self, index: int) -> FittedNumbers:
        """Return the numbers of a revolution."""
        return FittedNumbers(self.values[index], self.free[index], self.noise[index], self.model[index])


@dataclass(frozen=True, slots=True)
class Determination:
    """Accuracy with which the data determine the four numbers.

    Attributes:
        relative_error: (4,) standard error over value, noise and model; inf where on the bound.
        model_share: (4,) share of the model error in the variance.
        correlation: (4, 4) of noise and model error together; 0 where not free.
    """

    relative_error: FloatArray
    model_share: FloatArray
    correlation: FloatArray

    def why_not(self, index: int, relative_error: float | None = None) -> tuple[Reason, ...]:
        """Return why a number, or its ratio to Cw of that relative error, is not determined."""
        error = float(self.relative_error[index] if relative_error is None else relative_error)
        if not math.isfinite(error):
            return (Reason(RingCode.FIT_AT_ZERO, number=RING_NUMBERS[index]),)
        reasons = [Reason(CoreCode.NOT_DETERMINED, relative_error=error)]
        if self.model_share.any():
            reasons.append(Reason(CoreCode.MODEL_ERROR_SHARE, share=float(self.model_share[index])))
        others = np.abs(self.correlation[index]) - np.eye(4)[index]
        partner = int(np.argmax(others))
        if others[partner] > _CONFOUNDED:
            correlation = float(self.correlation[index, partner])
            reasons.append(Reason(CoreCode.CORRELATED, correlation=correlation, number=RING_NUMBERS[partner]))
        return tuple(reasons)


def determination(fitted: FittedNumbers) -> Determination:
    """Return how well the data determine each number."""
    covariance = fitted.noise + fitted.model
    variance = np.diagonal(covariance)
    usable = fitted.free & np.isfinite(variance) & (fitted.values > 0.0)
    std = np.sqrt(np.where(usable, np.maximum(variance, 0.0), 0.0))
    relative = np.full(4, math.inf)
    relative[usable] = std[usable] / fitted.values[usable]
    has_error = usable & (std > 0.0)
    scale = np.where(has_error, std, 1.0)
    correlation = np.where(np.outer(has_error, has_error), covariance / np.outer(scale, scale), 0.0)
    correlation[np.diag_indices(4)] = 1.0
    share = np.where(has_error, np.diagonal(fitted.model) / np.square(scale), 0.0)
    return Determination(relative, share, correlation)


def number_estimates(
    estimator: str,
    fitted: FittedNumbers,
    conditions: TireConditions,
    doubts: tuple[Reason, ...],
    notes: tuple[Reason, ...] = (),
) -> tuple[Estimate, ...]:
    """Return the estimates of one revolution, as `series_estimates`.

    Args:
        estimator: name in the registry.
        fitted: the numbers; those of any load number when `conditions` lack load or pressure.
        conditions: with their standard errors.
        doubts: why the estimates are provisional; empty when they are not.
        notes: what valid estimates rest on.
    """
    return series_estimates(estimator, FittedSeries.of(fitted), [conditions], [doubts], notes)[0]


def series_estimates(
    estimator: str,
    fitted: FittedSeries,
    conditions: Sequence[TireConditions],
    doubts: Sequence[tuple[Reason, ...]],
    notes: tuple[Reason, ...] = (),
    *,
    noise_scatters: bool = False,
) -> list[tuple[Estimate, ...]]:
    """Return Bs, Cw, Rs, Ts, then Bs/Cw, Rs/Cw, Ts/Cw of each of k revolutions.

    All four numbers are proportional to Q / (p0 R^2), so their errors include those of Q, p0 and R^2. Without load or
    pressure they are invalid, but not the ratios. The width of a belt does not change with wear: where Cw differs from
    the new tire's, load, pressure or radius are not as stated, and the four numbers are provisional; where it differs
    by less than a contradiction, their errors grow by the chance of that.

    Args:
        estimator: name in the registry.
        fitted: the numbers; those of any load number when conditions lack load or pressure.
        conditions: of each, with their standard errors.
        doubts: why the estimates of each are provisional; empty when they are not.
        notes: what valid estimates rest on.
        noise_scatters: whether the covariance of noise is of noise alone, without the error of the edges' definition.
    """
    values, free = fitted.values, fitted.free
    covariance = fitted.noise + fitted.model
    variance = covariance.diagonal(axis1=1, axis2=2)
    std = np.sqrt(np.maximum(variance, 0.0))
    missing = [missing_conditions(condition) for condition in conditions]
    scales = [
        0.0 if lacking else scale_error(condition) for lacking, condition in zip(missing, conditions, strict=True)
    ]
    widths = [
        None if lacking else _width(estimator, cw, cw_std, condition, scale)
        for lacking, cw, cw_std, condition, scale in zip(
            missing, values[:, _CW].tolist(), std[:, _CW].tolist(), conditions, scales, strict=True
        )
    ]
    scales = [scale if width is None else width.scale for width, scale in zip(widths, scales, strict=True)]
    scale = np.array(scales)[:, np.newaxis]
    determined = _determined(values, free, variance, std)
    cw, ratio_noise = values[:, _CW, np.newaxis], None
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = values[:, _OVER_CW] / cw
        ratio_errors = _ratio_errors(ratios, cw, covariance)
        if noise_scatters:
            ratio_noise = _ratio_errors(ratios, cw, fitted.noise)
    # Weak bending must be determined better than the ratio's own error tells.
    ratio_fits: BoolArray = (ratio_errors * DETERMINED <= ratios) & (free[:, _CW, np.newaxis] & (cw > 0.0))
    ratio_fits[:, 0] &= determined[:, 0]
    all_values = np.concatenate([values, ratios], axis=1)
    errors = np.concatenate([np.hypot(std, values * scale), ratio_errors], axis=1)
    scatters: FloatArray = np.zeros(errors.shape)
    if ratio_noise is not None:
        noise = fitted.noise.diagonal(axis1=1, axis2=2)
        scatters = np.concatenate([np.sqrt(np.maximum(noise, 0.0)), ratio_noise], axis=1)
        scatters[~np.isfinite(scatters)] = 0.0
    sound = np.concatenate([determined, ratio_fits], axis=1) & (all_values > 0.0) & np.isfinite(errors)
    rows = list(zip(all_values.tolist(), errors.tolist(), scatters.tolist(), sound.tolist(), strict=True))
    estimates = []
    for index, (lacking, width) in enumerate(zip(missing, widths, strict=True)):
        if lacking:
            numbers = [Estimate.invalid(name, *lacking) for name in RING_NUMBERS]
        else:
            reason = None if width is None else width.reason
            numbers = _numbers(fitted, index, rows[index], reason, doubts[index], notes)
        estimates.append((*numbers, *_estimates(fitted, index, rows[index], _RATIOS, doubts[index], notes)))
    return estimates


def _numbers(
    fitted: FittedSeries,
    index: int,
    row: tuple[list[float], list[float], list[float], list[bool]],
    of_width: Reason | None,
    doubts: tuple[Reason, ...],
    notes: tuple[Reason, ...],
) -> list[Estimate]:
    """Return the four numbers with what the width of the belt says of them."""
    if of_width is not None and of_width.code is EstimateCode.WIDTH_CONTRADICTED:
        doubts = (*doubts, of_width)
    if of_width is not None and of_width.code is EstimateCode.WIDTH_DISAGREES:
        notes = (*notes, of_width)
    numbers = _estimates(fitted, index, row, _NUMBERS, doubts, notes)
    is_by_width = of_width is not None and of_width.code is EstimateCode.SCALE_BY_WIDTH
    if of_width is not None and is_by_width and numbers[_CW].status is not Status.INVALID:
        numbers[_CW] = numbers[_CW]._replace(reasons=(*numbers[_CW].reasons, of_width))
    return numbers


def _estimates(
    fitted: FittedSeries,
    index: int,
    row: tuple[list[float], list[float], list[float], list[bool]],
    columns: slice,
    doubts: tuple[Reason, ...],
    notes: tuple[Reason, ...],
) -> list[Estimate]:
    """Return estimates of one revolution.

    Args:
        fitted: the numbers.
        index: of the revolution.
        row: its values, errors, their scattering parts, and whether each is determined, numbers first, then ratios.
        columns: of the estimates that are wanted.
        doubts: why they are provisional.
        notes: what valid ones rest on.
    """
    status, reasons = (Status.PROVISIONAL, doubts) if doubts else (Status.VALID, notes)
    values, errors, scatters, sound = (column[columns] for column in row)
    return [
        estimate_of((name, value, error, status, reasons, scatter))
        if is_sound
        else _undetermined(fitted.at(index), _NAMES.index(name), value, error, doubts)
        for name, value, error, scatter, is_sound in zip(_NAMES[columns], values, errors, scatters, sound, strict=True)
    ]


def _undetermined(
    fitted: FittedNumbers, column: int, value: float, error: float, doubts: tuple[Reason, ...]
) -> Estimate:
    """Return the estimate of a number or ratio, by its column, that is not known or not determined."""
    name, at_zero = _NAMES[column], Reason(RingCode.FIT_AT_ZERO, number=RING_NUMBERS[_CW])
    if column < _COUNT:
        why_not = determination(fitted).why_not(column)
    elif not (fitted.free[_CW] and fitted.values[_CW] > 0.0):
        return Estimate.invalid(name, at_zero)
    else:
        number = int(_OVER_CW[column - _COUNT])
        relative = error / value if fitted.free[number] and value else math.inf
        why_not = determination(fitted).why_not(number, relative)
    if not (value > 0.0 and math.isfinite(error)):
        return Estimate.invalid(name, *why_not)
    return Estimate(name, value, error, Status.PROVISIONAL, (*doubts, *why_not))


def _ratio_errors(ratios: FloatArray, cw: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return the errors of the ratios (k, 3) to Cw (k, 1) to first order, (k, 3)."""
    variances = covariance.diagonal(axis1=1, axis2=2)
    with_cw = covariance[:, _OVER_CW, _CW] + covariance[:, _CW, _OVER_CW]
    square = variances[:, _OVER_CW] - ratios * with_cw + ratios * ratios * variances[:, _CW, np.newaxis]
    errors: FloatArray = np.sqrt(np.maximum(square / (cw * cw), 0.0))
    return errors


def _determined(values: FloatArray, free: BoolArray, variance: FloatArray, std: FloatArray) -> BoolArray:
    """Return which numbers of k revolutions are determined, (k, 4)."""
    usable = free & np.isfinite(variance) & (values > 0.0)
    determined: BoolArray = usable & (std * DETERMINED <= values)
    is_weak = usable[:, 0] & usable[:, _CW] & (values[:, 0] < _WEAK_BENDING * values[:, _CW])
    determined[:, 0] &= ~is_weak | (std[:, 0] * (DETERMINED * _WEAK_FACTOR) <= values[:, 0])
    return determined


class _Width(NamedTuple):
    """What the belt width of the new tire says of load, pressure and radius."""

    scale: float
    reason: Reason | None


def _width(estimator: str, cw: float, std: float, conditions: TireConditions, scale: float) -> _Width | None:
    """Return the relative error of the common factor of the four numbers, given the new tire's width; None for no news.

    Wear does not change the width, so Cw over that of the new tire is the factor by which the stated Q / (p0 R^2) is
    off, within the errors of both widths and of the model. `scale` is `scale_error`. Where the width knows the factor
    better than what is stated, its difference and error count; else the chance that the statement is wrong.
    A contradiction changes nothing.
    """
    reference = conditions.tire.reference
    if reference.estimator != estimator or not reference.Cw or not cw > 0.0 or DoubtRule.WIDTH not in conditions.rules:
        return None
    by_width = math.hypot(std / cw, reference.Cw_std / reference.Cw)
    error = math.hypot(by_width, scale)
    ratio = cw / reference.Cw
    difference = math.log(ratio)
    if abs(difference) > CONTRADICTION * error:
        return _Width(scale, Reason(EstimateCode.WIDTH_CONTRADICTED, ratio=ratio, std=ratio * error))
    measured = math.hypot(difference, by_width, _WIDTH_MODEL_STD)
    if measured < scale:
        return _Width(measured, Reason(EstimateCode.SCALE_BY_WIDTH, ratio=ratio, std=ratio * by_width, error=measured))
    added = disagreement_std(difference, error)
    if not added:
        return None
    reason = Reason(EstimateCode.WIDTH_DISAGREES, ratio=ratio, std=ratio * error, error=added)
    return _Width(math.hypot(scale, added), reason if added > _NEGLIGIBLE * error else None)


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
        missing.append(Reason(RingCode.NEEDS_LOAD))
    if not positive(conditions.pressure_pa):
        missing.append(Reason(EstimateCode.NEEDS_PRESSURE))
    return tuple(missing)


def doubt_about(revolution: Revolution, effective_count: float, *, is_linear_ring: bool = False) -> tuple[Reason, ...]:
    """Return why estimates from an average of that effective count are provisional; empty when they are not.

    With `is_linear_ring` the signal is that of a linear ring, and the model has the exact geometry.
    """
    if is_linear_ring:
        return (Reason(RingCode.SIGNAL_OF_LINEAR_RING),)
    if revolution.faults:
        return (not_used(revolution.faults),)
    if effective_count < SETTLED_REVOLUTIONS * (1.0 - 1e-9):
        return (Reason(CoreCode.NOT_SETTLED, revolutions=effective_count, needed=SETTLED_REVOLUTIONS),)
    return ()


def unusable(average: AngleAverage, conditions: TireConditions) -> Reason | None:
    """Return why no ring can be fitted to the average at all; None when one can."""
    orders = int(np.count_nonzero(np.isfinite(average.orders_mps2[1:])))
    if orders < LEAST_ORDERS:
        return Reason(RingCode.TOO_FEW_ORDERS, orders=orders, needed=LEAST_ORDERS)
    if not 0.0 < 0.5 * (average.trailing_edge_rad - average.leading_edge_rad) < math.pi / 2.0:
        return Reason(EstimateCode.NO_CONTACT_EDGES)
    if not (positive(average.omega_radps) and positive(conditions.radius_m)):
        return Reason(EstimateCode.SPEED_OR_RADIUS_UNKNOWN)
    return None


def all_invalid(*reasons: Reason) -> tuple[Estimate, ...]:
    """Return the four numbers and the ratios as invalid."""
    return tuple(Estimate.invalid(name, *reasons) for name in (*RING_NUMBERS, *RING_RATIOS))


def positive(value: float | None) -> bool:
    """Return whether a value is known, finite and above 0."""
    return value is not None and math.isfinite(value) and value > 0.0
