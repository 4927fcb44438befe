"""Estimator of the vertical load from the contact, for wheels without a stated load or for comparison with it.

There are two methods. One is a power law of contact half angle and pressure, calibrated for the tire (`treadlink
calibrate`); it follows every revolution. Wear and warmth make the ring more flexible and so the contact longer under
the same load: on the exact ring Q ~ EI^beta at a half angle and pressure. EI is that of the bending number, whatever
has changed it; else that of the stated wear and the temperature; else the standard error includes the wear and the
temperature that a tire in use may have. The other uses the belt width, which wear does not change: all four numbers are
proportional to Q / (p0 R^2), so Q = Q0 Cw_new / Cw for any assumed load Q0.
"""

import math
from dataclasses import replace
from typing import Final, NamedTuple

from gateway.core.estimates.disagreement import CONTRADICTION, disagreement_std
from gateway.core.estimates.doubt_rules import DoubtRule
from gateway.core.estimates.estimator import Estimate, Estimator, Revolution, Status, TireConditions
from gateway.core.estimates.kinematic import edge_condition
from gateway.core.estimates.reasons import EstimateCode
from gateway.core.estimates.registry import ESTIMATORS, make_estimator
from gateway.core.estimates.revolution_block import RevolutionBlock, RevolutionEstimator
from gateway.core.estimates.tire_data import LOAD_LAW_STD, UNKNOWN_DIFFERENCE_K, LoadCalibration, TireData
from gateway.core.estimates.wear import bending_since_reference
from gateway.core.reasons import Reason
from gateway.core.revolutions.contact_edges import EDGE_MODEL_STD_RAD, error_beyond_definition

NAMES: Final = ("load_n", "load_by_angle_n", "load_by_width_n", "pressure_number")

_ASSUMED_LOAD_N: Final = 4000.0
# Revolutions over which a stated load is the mean: a kilometre, with its curves and bumps.
_DRIVE_REVOLUTIONS: Final = 500
# Change of the logarithm of EI from which its correction is reported: half a millimetre of wear of a usual ring.
_REPORTED_CHANGE: Final = 0.1
# beta on random tires of the exact ring: mean, standard deviation, and change with ln Bs about the mean of ln Bs.
_BETA: Final = 0.13
_BETA_STD: Final = 0.07
_BETA_STD_KNOWN_BS: Final = 0.055
_BETA_PER_LN_BS: Final = 0.0735
_MEAN_BS: Final = 1.73e-3
# Thickness of a ring of unknown thickness.
_USUAL_THICKNESS_M: Final = 0.015
# Root mean square of ln(EI / new EI) = 3 ln(1 - wear / thickness) over wear from 0 to 6.4 mm of 15 mm, each as likely:
# a car's tread of 8 mm and its legal limit of 1.6 mm, on a usual ring.
_UNKNOWN_WEAR_STD: Final = 0.9
# The ring wears down to its belt at most.
_LEAST_THICKNESS_SHARE: Final = 0.3


class LoadEstimator(RevolutionEstimator):
    """Load from contact angle and from belt width, the better of the two, and the pressure number.

    Gives load_n, load_by_angle_n, load_by_width_n and pressure_number Q / (2 p0 theta R^2) (Eq. 33).

    The pressure number uses the stated load where there is one.
    """

    name = "load"

    def reset(self) -> None:
        """Forget the warm start of the estimator that gives Cw, and the mean load of the drive."""
        self._numbers: Estimator | None = None
        unknown_tire = TireData()
        self._tires = unknown_tire, unknown_tire
        # Mean of pressure times the square of the half angle, which load is proportional to, and revolutions in it.
        self._mean_proxy = 0.0
        self._count = 0

    def _estimates(self, block: RevolutionBlock, index: int) -> tuple[Estimate, ...]:
        revolution, conditions = block.revolutions[index], block.conditions[index]
        pressure = conditions.pressure_pa
        if pressure is None or not (pressure > 0.0 and conditions.radius_m > 0.0):
            return tuple(Estimate.invalid(name, Reason(EstimateCode.NEEDS_PRESSURE)) for name in NAMES)
        half = 0.5 * (revolution.trailing_edge_rad - revolution.leading_edge_rad)
        half_std = 0.5 * math.hypot(
            error_beyond_definition(revolution.leading_edge_std_rad),
            error_beyond_definition(revolution.trailing_edge_std_rad),
        )
        by_angle = _by_angle(revolution, conditions, half, half_std, pressure)
        disagreement_n = _disagreement_n(by_angle, conditions)
        by_angle = _compared(by_angle, conditions)
        by_width = _with_average_lag(self._by_width(block, index), block, index, half, half_std)
        by_width = _compared(by_width, conditions)
        if DoubtRule.TWO_LOADS in conditions.rules:
            by_angle, by_width = _widened(by_angle, by_width)
        load = _better_estimate(by_angle, by_width)
        doubts = _contradictions((by_angle, by_width), conditions)
        edges, faults = edge_condition(revolution)
        doubts = doubts if edges is Status.VALID else (*doubts, *faults)
        change_n = self._load_change(revolution, half, half_std, pressure) * (conditions.load_n or 0.0)
        widened = replace(conditions, load_std_n=math.hypot(conditions.load_std_n, disagreement_n, change_n))
        return load, by_angle, by_width, _pressure_number(load, widened, doubts, half, half_std, pressure)

    def _load_change(self, revolution: Revolution, half: float, half_std: float, pressure: float) -> float:
        """Return the relative change of the load against its mean so far, as far as errors do not explain it.

        A load is stated of the whole drive. Steps and curves change it within.
        """
        if revolution.faults or not (half > 0.0 and math.isfinite(half_std)):
            return 0.0
        proxy = pressure * half * half
        self._count += 1
        self._mean_proxy += (proxy - self._mean_proxy) / min(self._count, _DRIVE_REVOLUTIONS)
        change = math.log(proxy / self._mean_proxy)
        return math.sqrt(max(change * change - (2.0 * half_std / half) ** 2, 0.0))

    def _without_width(self, tire: TireData) -> TireData:
        """Return data of the tire without its width, which an assumed load must not be compared with."""
        last_tire, without_width = self._tires
        if tire is not last_tire:
            without_width = replace(tire, reference=replace(tire.reference, Cw=None))
            self._tires = tire, without_width
        return without_width

    def _by_width(self, block: RevolutionBlock, index: int) -> Estimate:
        conditions = block.conditions[index]
        reference = conditions.tire.reference
        if reference.Cw is None:
            return Estimate.invalid(NAMES[2], Reason(EstimateCode.NEEDS_REFERENCE_NUMBER, number="Cw"))
        load, load_std = conditions.load_n, conditions.load_std_n
        numbers = conditions.given.get(reference.estimator) if load is not None else None
        if numbers is None or load is None:
            load, load_std = _ASSUMED_LOAD_N, 0.0
            if self._numbers is None:
                if reference.estimator not in ESTIMATORS:
                    return Estimate.invalid(
                        NAMES[2], Reason(EstimateCode.UNKNOWN_ESTIMATOR, estimator=reference.estimator)
                    )
                self._numbers = make_estimator(reference.estimator)
            assumed = replace(conditions, load_n=load, load_std_n=0.0, tire=self._without_width(conditions.tire))
            estimates = self._numbers.update(block.revolutions[index], block.averages.at(index), assumed)
            numbers = {estimate.name: estimate for estimate in estimates}
        width = numbers.get("Cw")
        if width is None:
            return Estimate.invalid(
                NAMES[2], Reason(EstimateCode.NUMBER_MISSING, estimator=reference.estimator, number="Cw")
            )
        if width.status is Status.INVALID:
            return Estimate.invalid(NAMES[2], *width.reasons)
        value = load * reference.Cw / width.value
        relative2 = max(0.0, (width.std / width.value) ** 2 + _added_variance(width, load_std / load, conditions))
        std = value * math.sqrt(relative2 + (reference.Cw_std / reference.Cw) ** 2)
        # Another width than the new tire's contradicts the stated load, not this one.
        doubts = tuple(
            reason
            for reason in width.reasons
            if reason.code not in (EstimateCode.WIDTH_CONTRADICTED, EstimateCode.SCALE_BY_WIDTH)
        )
        status = width.status if doubts else Status.VALID
        if status is Status.VALID and any(reason.code is EstimateCode.REVOLUTION_NOT_USED for reason in doubts):
            # The width is the tire's and lasts; the load of this revolution was not measured.
            status = Status.PROVISIONAL
        return Estimate(NAMES[2], value, std, status, doubts, value * width.scatter_std / width.value)


def _with_average_lag(by_width: Estimate, block: RevolutionBlock, index: int, half: float, half_std: float) -> Estimate:
    """Return a load by the width with the error that its average makes where the load has changed within its memory.

    The load goes with the square of the contact's half angle, which every revolution has of its own.
    """
    if by_width.status is Status.INVALID or block.revolutions[index].faults:
        return by_width
    leading, trailing = block.averages.edges_rad[index]
    ratio = 2.0 * half / (trailing - leading)
    if not ratio > 0.0:
        return by_width
    change = 2.0 * math.log(ratio)
    unexplained2 = change * change - (2.0 * half_std / half) ** 2
    return by_width._replace(std=math.hypot(by_width.std, by_width.value * math.sqrt(max(unexplained2, 0.0))))


def _added_variance(width: Estimate, load_std: float, conditions: TireConditions) -> float:
    """Return what the relative variance of a load by the width has beyond that of the width.

    The error of the stated load is part of that of Cw and cancels; those of pressure and radius do not. Where the width
    of the new tire has replaced all three together, pressure and radius come back as stated.
    """
    scale_std = next((reason["error"] for reason in width.reasons if reason.code is EstimateCode.SCALE_BY_WIDTH), None)
    if not isinstance(scale_std, float) or not conditions.pressure_pa:
        return -(load_std**2)
    pressure_std = conditions.pressure_std_pa / conditions.pressure_pa
    return pressure_std**2 + (2.0 * conditions.radius_std_m / conditions.radius_m) ** 2 - scale_std**2


def _disagreement_n(by_angle: Estimate, conditions: TireConditions) -> float:
    """Return the error of the stated load because the contact angle disagrees with it, short of a contradiction."""
    if conditions.load_n is None or by_angle.status is Status.INVALID:
        return 0.0
    combined_std = math.hypot(by_angle.std, conditions.load_std_n)
    return disagreement_std(by_angle.value - conditions.load_n, combined_std)


def _compared(estimate: Estimate, conditions: TireConditions) -> Estimate:
    """Return an estimate of the load, provisional where it contradicts the stated load.

    Short of that its error grows by the chance that pressure or radius are not as stated.
    """
    stated_n, stated_std_n = conditions.load_n, conditions.load_std_n
    if stated_n is None or estimate.status is Status.INVALID:
        return estimate
    difference, combined_std = estimate.value - stated_n, math.hypot(estimate.std, stated_std_n)
    if not abs(difference) > CONTRADICTION * combined_std:
        # The error of the width has it already.
        included = any(reason.code is EstimateCode.WIDTH_DISAGREES for reason in estimate.reasons)
        added = 0.0 if included else disagreement_std(difference, combined_std)
        return estimate._replace(std=math.hypot(estimate.std, added)) if added else estimate
    contradiction = Reason(EstimateCode.LOAD_CONTRADICTED, stated_n=stated_n, stated_std_n=stated_std_n)
    return estimate._replace(status=Status.PROVISIONAL, reasons=(contradiction, *estimate.reasons))


def _widened(by_angle: Estimate, by_width: Estimate) -> tuple[Estimate, Estimate]:
    """Return both loads with their difference in the errors: one of them is wrong by it, and nothing says which.

    Their errors are the calibration's, the reference's and the signal's, which are large beside the difference of two
    right loads: 0.3 standard errors at most on random tires. Beyond a contradiction that is noted.
    """
    if Status.INVALID in (by_angle.status, by_width.status):
        return by_angle, by_width
    difference_n = by_angle.value - by_width.value
    notes: tuple[Reason, ...] = ()
    if abs(difference_n) > CONTRADICTION * math.hypot(by_angle.std, by_width.std):
        notes = (Reason(EstimateCode.LOADS_DISAGREE, angle_n=by_angle.value, width_n=by_width.value),)
    first, second = (
        load._replace(std=math.hypot(load.std, difference_n), reasons=(*load.reasons, *notes))
        for load in (by_angle, by_width)
    )
    return first, second


def _by_angle(
    revolution: Revolution, conditions: TireConditions, half: float, half_std: float, pressure: float
) -> Estimate:
    calibration = conditions.tire.load_calibration
    if calibration is None:
        return Estimate.invalid(NAMES[1], Reason(EstimateCode.NEEDS_LOAD_CALIBRATION))
    if not half > 0.0:
        return Estimate.invalid(NAMES[1], Reason(EstimateCode.NO_CONTACT_EDGES))
    bending = _bending_effect(conditions, calibration)
    load = calibration.load_at(half, pressure) * math.exp(bending.logarithm)
    relative = math.hypot(
        max(calibration.relative_std, LOAD_LAW_STD),
        calibration.slope_at(half) * half_std / half,
        calibration.pressure_exponent * conditions.pressure_std_pa / pressure,
        bending.std,
    )
    if not (math.isfinite(load) and math.isfinite(relative)):
        return Estimate.invalid(NAMES[1], Reason(EstimateCode.EDGE_ERRORS_UNKNOWN))
    edges, faults = edge_condition(revolution)
    doubts = (*(() if edges is Status.VALID else faults), *calibration.outside(half, pressure))
    status = Status.PROVISIONAL if doubts else Status.VALID
    return Estimate(NAMES[1], load, load * relative, status, (*doubts, *bending.notes))


class _BendingEffect(NamedTuple):
    """Logarithm of the correction of a load for the ring's bending stiffness, its standard error, and notes."""

    logarithm: float
    std: float
    notes: tuple[Reason, ...]


def _bending_effect(conditions: TireConditions, calibration: LoadCalibration) -> _BendingEffect:
    """Return the correction for what the bending stiffness is beside that of the calibration."""
    reference = conditions.tire.reference
    beta, beta_std = _BETA, _BETA_STD
    if reference.Bs is not None:
        beta = max(0.0, beta + _BETA_PER_LN_BS * math.log(reference.Bs / _MEAN_BS))
        beta_std = _BETA_STD_KNOWN_BS
    change, std, notes = _bending_change(conditions, calibration)
    # Neither the exponent nor the change is certain: the last term is the product of both errors.
    return _BendingEffect(beta * change, math.hypot(beta * std, beta_std * change, beta_std * std), notes)


def _bending_change(
    conditions: TireConditions, calibration: LoadCalibration
) -> tuple[float, float, tuple[Reason, ...]]:
    """Return ln(EI / EI at the calibration), its standard error, and where it comes from."""
    tire = conditions.tire
    measured = bending_since_reference(conditions, prefer_ratio=True)
    if measured.status is Status.VALID:
        # The number has been measured at the present temperature; only calibration and reference may differ in it.
        reference_softening = tire.reference.softening(calibration.temperature_degc, tire.reference.temperature_degc)
        is_same_temperature = calibration.temperature_degc is None
        std = measured.std if is_same_temperature else math.hypot(measured.std, reference_softening.std)
        change = measured.value - (0.0 if is_same_temperature else reference_softening.logarithm)
        reasons = (
            (Reason(EstimateCode.CORRECTED_FOR_BENDING, change=math.expm1(change)),)
            if abs(change) > _REPORTED_CHANGE
            else ()
        )
        return change, std, reasons
    thickness = tire.ring_thickness_m or _USUAL_THICKNESS_M
    remaining = max(1.0 - (tire.wear_m or 0.0) / thickness, _LEAST_THICKNESS_SHARE)
    softening = tire.reference.softening(conditions.temperature_degc, calibration.temperature_degc)
    by_temperature = softening.logarithm if softening.is_known else 0.0
    # EI ~ thickness^3
    wear_std = _UNKNOWN_WEAR_STD if tire.wear_m is None else 3.0 * tire.wear_std_m / (thickness * remaining)
    change = 3.0 * math.log(remaining) + by_temperature
    notes = []
    if tire.wear_m is None:
        notes.append(Reason(EstimateCode.WEAR_UNKNOWN, relative_error=math.hypot(_BETA, _BETA_STD) * wear_std))
    elif 3.0 * abs(math.log(remaining)) > _REPORTED_CHANGE:
        notes.append(Reason(EstimateCode.CORRECTED_FOR_WEAR, wear_m=tire.wear_m))
    if not softening.is_known:
        notes.append(Reason(EstimateCode.TEMPERATURE_NOT_COMPENSATED, difference_k=UNKNOWN_DIFFERENCE_K))
    elif abs(by_temperature) > _REPORTED_CHANGE:
        notes.append(Reason(EstimateCode.CORRECTED_FOR_BENDING, change=math.expm1(by_temperature)))
    return change, math.hypot(wear_std, softening.std), tuple(notes)


def _better_estimate(by_angle: Estimate, by_width: Estimate) -> Estimate:
    """Return the estimate with the better status, then the smaller error, as load_n."""
    rank = {Status.VALID: 0, Status.PROVISIONAL: 1, Status.INVALID: 2}
    chosen = min(by_angle, by_width, key=lambda estimate: (rank[estimate.status], estimate.std))
    if chosen.status is Status.INVALID:
        return Estimate.invalid(
            NAMES[0],
            Reason(EstimateCode.NO_LOAD_FROM, source="contact_angle", why=by_angle.reasons),
            Reason(EstimateCode.NO_LOAD_FROM, source="belt_width", why=by_width.reasons),
        )
    source = Reason(EstimateCode.FROM_CONTACT_ANGLE if chosen is by_angle else EstimateCode.FROM_BELT_WIDTH)
    return chosen._replace(name=NAMES[0], reasons=(source, *chosen.reasons))


def _contradictions(loads: tuple[Estimate, ...], conditions: TireConditions) -> tuple[Reason, ...]:
    """Return what contradicts the stated load or pressure: loads from the contact, or another belt width."""
    width = conditions.given.get(conditions.tire.reference.estimator, {}).get("Cw")
    estimates = (*loads, width) if width is not None else loads
    codes = (EstimateCode.LOAD_CONTRADICTED, EstimateCode.WIDTH_CONTRADICTED)
    return tuple(dict.fromkeys(reason for estimate in estimates for reason in estimate.reasons if reason.code in codes))


def _scale_error(conditions: TireConditions, load_std: float) -> float:
    """Return the relative error of Q / (p0 R^2), of a load with that error, given the belt width of the new tire."""
    width = conditions.given.get(conditions.tire.reference.estimator, {}).get("Cw")
    errors = {
        reason.code: reason["error"]
        for reason in (width.reasons if width is not None else ())
        if reason.code in (EstimateCode.SCALE_BY_WIDTH, EstimateCode.WIDTH_DISAGREES)
    }
    scale_std, width_std = errors.get(EstimateCode.SCALE_BY_WIDTH), errors.get(EstimateCode.WIDTH_DISAGREES, 0.0)
    if isinstance(scale_std, float) and conditions.load_n is not None:
        return scale_std
    assert conditions.pressure_pa is not None
    relative_stds = (
        load_std,
        conditions.pressure_std_pa / conditions.pressure_pa,
        2.0 * conditions.radius_std_m / conditions.radius_m,
    )
    return math.hypot(*relative_stds, width_std if isinstance(width_std, float) else 0.0)


def _pressure_number(
    load: Estimate,
    conditions: TireConditions,
    contradictions: tuple[Reason, ...],
    half: float,
    half_std: float,
    pressure: float,
) -> Estimate:
    value, std, status, reasons = load.value, load.std, load.status, load.reasons
    if conditions.load_n is not None:
        value, std = conditions.load_n, conditions.load_std_n
        reasons = contradictions
        status = Status.PROVISIONAL if reasons else Status.VALID
    if status is Status.INVALID:
        return Estimate.invalid(NAMES[3], *reasons)
    if not (half > 0.0 and math.isfinite(half_std) and value > 0.0):
        return Estimate.invalid(NAMES[3], Reason(EstimateCode.NO_CONTACT_EDGES))
    number = value / (2.0 * pressure * half * conditions.radius_m**2)
    # The error of the edge's definition counts here, because the number is compared between tires.
    half_std = math.hypot(half_std, EDGE_MODEL_STD_RAD)
    relative = math.hypot(_scale_error(conditions, std / value), half_std / half)
    return Estimate(NAMES[3], number, number * relative, status, reasons)
