"""Estimator of tread wear from the bending stiffness number, compared with that of the new tire.

A ring of thickness h has EI ~ h^3 and Bs = EI / (R^4 p0), so the wear is h0 (1 - (Bs p0 / (Bs_new p0_new))^1/3). h is
the thickness of the whole ring, belt and tread; with the tread depth alone, as printed in the ring paper, 6.4 mm of
wear would reduce Bs to a hundredth. Pressure and temperature are compensated where they are known, here and in the
reference; where they are not, the standard error includes how far they usually differ.
"""

import math
from typing import Final

import numpy as np

from gateway.core.estimates.disagreement import CONTRADICTION
from gateway.core.estimates.estimator import DETERMINED, Estimate, Revolution, Status, TireConditions
from gateway.core.estimates.reasons import EstimateCode
from gateway.core.estimates.registry import estimator_names
from gateway.core.estimates.revolution_block import RevolutionBlock, RevolutionEstimator
from gateway.core.estimates.tire_data import UNKNOWN_DIFFERENCE_K, Softening, TireData
from gateway.core.reasons import Reason
from gateway.core.revolutions.synchronous_average import DEFAULT_HORIZON_REVOLUTIONS, RunningMoments
from gateway.core.types import FloatArray

NAMES: Final = ("wear_mm", "wear_number", "wear_drift_mm")

_BENDING_POWER: Final = 3.0
"""Power of the ring's thickness in its bending stiffness."""

# Revolutions after which a value of the running average is independent of an earlier one.
_SPACING_REVOLUTIONS: Final = round(2 * DEFAULT_HORIZON_REVOLUTIONS)
# Usual difference from a pressure that is not known (one standard deviation).
_UNKNOWN_PRESSURE_SHARE: Final = 0.1
# Notes of most revolutions.
_FROM_RATIO: Final = Reason(EstimateCode.FROM_RATIO, ratio="Bs/Cw")
_NOT_COMPENSATED: Final = Reason(EstimateCode.TEMPERATURE_NOT_COMPENSATED, difference_k=UNKNOWN_DIFFERENCE_K)
# Least number of values for a drift.
_LEAST_VALUES: Final = 4


class WearEstimator(RevolutionEstimator):
    """Wear in mm, the ring paper's wear number (Eq. 30), and the drift of the wear since the first value.

    Gives wear_mm, wear_number and wear_drift_mm.

    The standard error covers that of the number, of the reference, of the thickness, of the rubber's softening
    with temperature, and of a temperature or pressure that is not known. The drift's covers scatter and softening.
    Without a load Bs/Cw is used in place of Bs, because wear does not change the belt's width.
    """

    name = "wear"

    def reset(self) -> None:
        """Forget the drift."""
        self._values = RunningMoments(2, covariance=True)
        self._first = self._latest = 0.0
        self._next_index: int | None = None
        self._temperatures: list[float | None] = []
        self._tire: TireData | None = None
        self._latest_drift: Estimate | None = None

    def _estimates(self, block: RevolutionBlock, index: int) -> tuple[Estimate, ...]:
        revolution, conditions = block.revolutions[index], block.conditions[index]
        wear = _wear(conditions)
        if wear.status is Status.INVALID:
            return (wear, *(Estimate.invalid(name, *wear.reasons) for name in NAMES[1:]))
        radius_mm = conditions.radius_m * 1e3
        number = wear._replace(
            name=NAMES[1],
            value=wear.value / radius_mm,
            std=wear.std / radius_mm,
            scatter_std=wear.scatter_std / radius_mm,
        )
        return wear, number, self._drift(revolution, wear, conditions)

    def _drift(self, revolution: Revolution, wear: Estimate, conditions: TireConditions) -> Estimate:
        """Add a value when it is independent of the last, and return the drift since the first."""
        temperature = conditions.temperature_degc
        if wear.status is Status.VALID and (self._next_index is None or revolution.index >= self._next_index):
            if self._next_index is None:
                self._first = float(revolution.index)
            self._next_index = revolution.index + _SPACING_REVOLUTIONS
            self._latest = float(revolution.index)
            self._values.update(np.array([self._latest, wear.value]), 1.0 / (self._values.count + 1))
            self._temperatures = [*self._temperatures[:1], temperature]
            self._latest_drift = None
        if self._latest_drift is None or conditions.tire is not self._tire:
            self._tire, self._latest_drift = conditions.tire, self._line(conditions.tire)
        return self._latest_drift

    def _line(self, tire: TireData) -> Estimate:
        """Return the drift along the line through all values."""
        count = self._values.count
        if count < _LEAST_VALUES:
            needed = (_LEAST_VALUES - 1) * _SPACING_REVOLUTIONS
            return Estimate.invalid(NAMES[2], Reason(EstimateCode.NEEDS_WEAR_VALUES, revolutions=needed))
        (xx, xy), (_, yy) = self._values.variance()
        span = self._latest - self._first
        residual = max(float(yy - xy * xy / xx), 0.0) * (count - 1) / (count - 2)
        scatter = math.sqrt(residual / (xx * (count - 1))) * span
        first_degc, last_degc = self._temperatures[0], self._temperatures[-1]
        softening = tire.reference.softening(last_degc, first_degc)
        thickness_mm = 1e3 * (tire.ring_thickness_m or 0.0)
        reasons = [Reason(EstimateCode.OVER_REVOLUTIONS, revolutions=span)]
        if not softening.is_known:
            reasons.append(_NOT_COMPENSATED)
        std = math.hypot(scatter, thickness_mm / _BENDING_POWER * softening.std)
        return Estimate(NAMES[2], float(xy / xx) * span, std, Status.VALID, tuple(reasons))


def thickness_left(bending: float) -> float:
    """Return the share of the ring's thickness that is left, from ln(EI / EI of the new ring)."""
    return math.exp(bending / _BENDING_POWER)


def bending_left(thickness_share: FloatArray) -> FloatArray:
    """Return (n,) ln(EI / EI of the new ring) from the positive shares of its thickness that are left."""
    return np.asarray(_BENDING_POWER * np.log(thickness_share), dtype=np.float64)


def _wear(conditions: TireConditions) -> Estimate:
    """Return the wear from the numbers of the reference's estimator."""
    tire = conditions.tire
    thickness = tire.ring_thickness_m
    if thickness is None:
        return Estimate.invalid(NAMES[0], Reason(EstimateCode.NEEDS_RING_THICKNESS))
    bending = bending_since_reference(conditions)
    if bending.status is Status.INVALID:
        return Estimate.invalid(NAMES[0], *bending.reasons)
    softening = tire.reference.softening(conditions.temperature_degc, tire.reference.temperature_degc)
    bending = _with_ratio(bending, conditions, softening, thickness)
    remaining = thickness_left(bending.value - softening.logarithm)
    notes = list(bending.reasons)
    if not softening.is_known:
        notes.append(_NOT_COMPENSATED)
    slope = thickness * remaining / _BENDING_POWER
    error = slope * math.hypot(bending.std, softening.std)
    std = math.hypot(error, (1.0 - remaining) * tire.ring_thickness_std_m)
    value, status = thickness * (1.0 - remaining), bending.status
    if tire.wear_m is not None and abs(value - tire.wear_m) > DETERMINED * math.hypot(std, tire.wear_std_m):
        status = Status.PROVISIONAL
        notes.insert(0, Reason(EstimateCode.WEAR_CONTRADICTED, stated_m=tire.wear_m, stated_std_m=tire.wear_std_m))
    return Estimate(NAMES[0], 1e3 * value, 1e3 * std, status, tuple(notes), 1e3 * slope * bending.scatter_std)


def _with_ratio(bending: Estimate, conditions: TireConditions, softening: Softening, thickness_m: float) -> Estimate:
    """Return ln(EI / EI of the reference) with an error of at least its difference from that by Bs/Cw.

    They differ where load, pressure or radius are not as stated, or the reference is not of this tire. The error of Bs
    contains that difference where the belt's width has set it, so it counts once. Beyond a contradiction it is noted.
    """
    by_ratio = bending_since_reference(conditions, prefer_ratio=True)
    if by_ratio.status is Status.INVALID:
        return bending
    difference = abs(bending.value - by_ratio.value)
    if difference <= CONTRADICTION * math.hypot(bending.std, by_ratio.std):
        return bending._replace(std=max(bending.std, difference))
    number_m, ratio_m = (
        thickness_m * (1.0 - thickness_left(estimate.value - softening.logarithm)) for estimate in (bending, by_ratio)
    )
    note = Reason(EstimateCode.WEARS_DISAGREE, number_m=number_m, ratio_m=ratio_m)
    return bending._replace(std=difference, reasons=(*bending.reasons, note))


def bending_since_reference(conditions: TireConditions, *, prefer_ratio: bool = False) -> Estimate:
    """Return ln(EI / EI of the reference), neither at the same temperature, from the numbers of its estimator.

    Args:
        conditions: with the numbers of the estimator.
        prefer_ratio: use Bs/Cw, on which the stated load has no influence, even where a load is stated.
    """
    name = "bending"
    reference = conditions.tire.reference
    if reference.Bs is None:
        return Estimate.invalid(name, Reason(EstimateCode.NEEDS_REFERENCE_NUMBER, number="Bs"))
    numbers = conditions.given.get(reference.estimator)
    if numbers is None:
        code = (
            EstimateCode.NEEDS_ESTIMATOR if reference.estimator in estimator_names() else EstimateCode.UNKNOWN_ESTIMATOR
        )
        return Estimate.invalid(name, Reason(code, estimator=reference.estimator))
    bending, new_value, new_relative = numbers.get("Bs"), reference.Bs, reference.Bs_std / reference.Bs
    if bending is None:
        bending = Estimate.invalid(
            "Bs", Reason(EstimateCode.NUMBER_MISSING, estimator=reference.estimator, number="Bs")
        )
    notes: list[Reason] = []
    if (bending.status is Status.INVALID or prefer_ratio) and reference.Cw is not None:
        ratio = numbers.get("Bs/Cw")
        if ratio is not None and ratio.status is not Status.INVALID:
            bending, new_value = ratio, reference.Bs / reference.Cw
            new_relative = math.hypot(new_relative, reference.Cw_std / reference.Cw)
            notes.append(_FROM_RATIO)
    if bending.status is Status.INVALID:
        return Estimate.invalid(name, *bending.reasons)
    stiffness = bending.value / new_value
    errors = [bending.std / bending.value, new_relative]
    status = bending.status
    if conditions.pressure_pa and reference.pressure_pa:
        stiffness *= conditions.pressure_pa / reference.pressure_pa
    else:
        notes.append(Reason(EstimateCode.PRESSURE_NOT_COMPENSATED))
        errors.append(_UNKNOWN_PRESSURE_SHARE)
        status = Status.PROVISIONAL
    if not (stiffness > 0.0 and math.isfinite(stiffness)):
        return Estimate.invalid(name, Reason(EstimateCode.BENDING_NOT_POSITIVE))
    if bending.status is Status.PROVISIONAL:
        notes[:0] = bending.reasons
    scatter = bending.scatter_std / bending.value
    return Estimate(name, math.log(stiffness), math.hypot(*errors), status, tuple(notes), scatter)
