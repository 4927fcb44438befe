"""Evidence of a wheel's own signal for or against what is stated, and its consequences for the estimates.

`assess` compares what self-calibration measures with what is stated, each with its standard error. Beyond three
standard errors of both together there is a `Contradiction`: it lists the causes that would explain it, and the
estimates that it moves are provisional, or invalid where it may move them by more than a fifth. Where nothing is
stated, the measured value is used and its error carried. Short of three standard errors, the errors of what is stated
grow by the chance that it is wrong (`gateway.core.estimates.disagreement`).

The steady value. The mean of the radial axis over a closed belt is G R Omega^2 (1 - e/R mean(k^2)) + z. So its ratio to
the value expected is G r f^2 with the relative errors G of the gain, r of the belt radius and f of the sampling rate,
apart from the zero-g offset z. Gravity, which turns through the sensor's axis once per revolution, gives G alone. z
is separated where the speed varies.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any, Final, NamedTuple, Self

from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.estimates.disagreement import CONTRADICTION, disagreement_std
from gateway.core.estimates.doubt_rules import EVERY_RULE, DoubtRule
from gateway.core.estimates.estimator import SETTLED_REVOLUTIONS, Estimate, Status, TireConditions
from gateway.core.estimates.lost_steady_value import LostSteadyValue
from gateway.core.estimates.sensor_claims import UNKNOWN_OFFSET_STD_M, SensorClaims, Tilt
from gateway.core.quantity import LARGEST_ZERO_MPS2, Basis
from gateway.core.quantity_catalogue import quantity_of
from gateway.core.reasons import Reason
from gateway.core.trust.calibration_estimates import gravity_absent, steady_value_lost, zero_contradicted
from gateway.core.trust.reasons import TrustCode
from gateway.core.trust.refuted_sums import (
    GRAVITY_ALONE,
    LEAST_GRAVITY_ERROR,
    ZERO_MEASURED,
    Equations,
    Value,
    gravity_gain,
    steady_ratio,
    zero_offset,
)
from gateway.core.trust.self_calibration import GREATEST_MEAN_SQUARE, OFFSET_MODEL_M, PITCH_MODEL_RAD
from gateway.core.trust.sensor_measurement import Measured

# Relative change of an estimate from which it is invalid.
_INVALID_CHANGE: Final = 0.2
# Relative change above which its size says nothing: a factor of four.
_UNBOUNDED: Final = 3.01
# Share of an estimate's standard error below which a change of it does not matter.
_MINOR_SHARE: Final = 0.3
# Belts from karts to earthmovers: no tire has another radius.
_RADII_M: Final = (0.1, 1.2)
# Ratios of sampling rates that are mistaken for each other, such as the rate before decimation.
_RATE_RATIOS: Final = (0.1, 0.2, 0.25, 1.0 / 3.0, 0.5, 2.0 / 3.0, 0.75, 4.0 / 3.0, 1.5, 2.0, 3.0, 4.0, 5.0, 10.0)
# Implausibility, in standard errors, of a rate that is mistaken by such a ratio, or by any other; of a wrong unit.
_RATIO_ERRORS: Final = 2.0
# A light contact may be found in every second or third revolution only.
_MISSED_CONTACTS: Final = (2.0, 3.0)
_MISSED_ERRORS: Final = 2.5
_OTHER_RATE_ERRORS: Final = 8.0
_UNIT_ERRORS: Final = 1.0
# A stated radius is replaced by the measured one when its standard error is larger by this factor.
_RADIUS_UNKNOWN: Final = 2.0
# Root mean square share of an error of the steady value that the sampling rate has: radius, gain or rate are wrong,
# each as likely as the others, and the steady value is of the rate squared.
_RATE_ERROR_SHARE: Final = 0.5 * math.sqrt(1.0 / 3.0)
# Root mean square share of a difference within the errors of what is stated that one of three causes of it has: half of
# such differences are these errors alone, the others one of the causes, each as likely.
_SINGLE_CAUSE_SHARE: Final = math.sqrt(0.5 / 3.0)
# Standard error of the gain by gravity over the stated one, up to which their disagreement says something.
_GRAVITY_STD_RATIO: Final = 2.0


# Order 2 by motion of the hub from which it is noted, over R Omega^2.
_NOTABLE_HUB: Final = 3e-4
# Difference of the rolls by the means of two axes and by the shape of the lateral one, on belts of random tires.
_ROLL_BY_SHAPE_RAD: Final = 6e-3

# Share of the true signal in an axis that is not the one it is taken for.
_WRONG_AXIS_SHARE: Final = 0.0


class Subject(StrEnum):
    """What a contradiction is about, one or two words."""

    AXES = "axes"
    CONDITIONS = "load or pressure"
    COUPLING = "coupling"
    GRAVITY = "gravity"
    OFFSET = "sensor offset"
    STEADY = "steady value"
    TIMING = "timing of the axes"
    TURN_RATE = "turn rate"
    VEHICLE_SPEED = "vehicle speed"
    WHEEL_SPEED = "wheel speed"
    ZERO = "zero-g offset"


@dataclass(frozen=True, slots=True)
class Contradiction:
    """A stated value that the signal contradicts.

    Attributes:
        subject: of the comparison.
        reason: stated and measured value, and the causes that would explain it.
        ratios: true over stated value that each possible cause would need.
    """

    subject: Subject
    reason: Reason
    ratios: dict[Basis, float]

    def effect_on(self, estimate: Estimate) -> float:
        """Return the largest relative change of an estimate by one of the causes.

        It is NaN where the error of the estimate contains it, infinite where it rests on what the signal lacks.
        """
        quantity = quantity_of(estimate.name)
        if Basis.COUPLING in self.ratios:
            return math.inf if Basis.COUPLING in quantity.rests_on else 0.0
        changes = [
            abs(ratio**power - 1.0) if ratio or power > 0.0 else math.inf
            for cause, ratio in self.ratios.items()
            if (power := quantity.powers.get(cause))
        ]
        if not changes and self.ratios.keys() & {Basis.OFFSET, Basis.ZERO} & quantity.rests_on:
            return math.nan
        return max(changes, default=0.0)


class Evidence(NamedTuple):
    """Result of the comparison.

    Attributes:
        sensor_offset_m: in use: as stated, as measured, or both together.
        sensor_offset_std_m: its standard error; the difference of both where they contradict each other.
        offset_is_known: False where it is neither stated nor measured.
        steady_std_mps2: standard error of the steady value of the radial axis, beyond a common gain.
        gain_std: relative standard error of the gain of all axes.
        radius_m: in use.
        radius_std_m: its standard error.
        contradictions: of stated and measured values.
        unsure: relative error of radius, gain and rate beyond the stated ones, by a steady value near a contradiction.
        disagreement: of the steady value with what is stated, where it is most of the radius's error; None elsewhere.
        hub_mps2: order 2 by motion of the hub.
        roll_std_rad: error of the roll from means at one speed.
        hub_motion: that motion where it is notable; None elsewhere.
        tilt: how the sensor sits askew.
    """

    sensor_offset_m: float
    sensor_offset_std_m: float
    offset_is_known: bool
    steady_std_mps2: float
    gain_std: float
    radius_m: float
    radius_std_m: float
    contradictions: tuple[Contradiction, ...] = ()
    unsure: float = 0.0
    disagreement: Reason | None = None
    hub_mps2: float = 0.0
    roll_std_rad: float = 0.0
    hub_motion: Reason | None = None
    tilt: Tilt = Tilt()

    @classmethod
    def of_contradictions(cls, contradictions: tuple[Contradiction, ...]) -> Self:
        """Return evidence of contradictions alone, to qualify estimates with."""
        return cls(0.0, 0.0, True, 0.0, 0.0, 1.0, 0.0, contradictions)

    def applied_to(
        self, conditions: TireConditions, given: Mapping[str, Mapping[str, Estimate]] | None = None
    ) -> TireConditions:
        """Return the conditions with the values in use, and with the estimates `given` by earlier estimators."""
        claims = conditions.claims
        if self.unsure:
            claims = replace(claims, rate_std=math.hypot(claims.rate_std, _RATE_ERROR_SHARE * self.unsure))
        return TireConditions(
            self.radius_m,
            conditions.load_n,
            conditions.pressure_pa,
            conditions.temperature_degc,
            conditions.load_std_n,
            conditions.pressure_std_pa,
            self.radius_std_m,
            self.sensor_offset_m,
            self.sensor_offset_std_m,
            self.steady_std_mps2,
            self.gain_std,
            self.hub_mps2,
            self.roll_std_rad,
            self.tilt,
            claims,
            conditions.tire,
            conditions.given if given is None else given,
            conditions.rules,
            conditions.pressure_measured,
        )

    @property
    def says_anything(self) -> bool:
        """Whether `qualified` changes any estimate."""
        return (
            bool(self.contradictions)
            or not self.offset_is_known
            or self.disagreement is not None
            or self.hub_motion is not None
        )

    @property
    def _is_coupled(self) -> bool:
        return any(contradiction.subject is Subject.COUPLING for contradiction in self.contradictions)

    def qualified(self, estimate: Estimate) -> Estimate:
        """Return an estimate with what the evidence says against it.

        It is invalid where a contradiction may change it by more than a fifth, and provisional where by more than
        a share of its standard error. Without a steady value, that is the reason whatever an estimator finds missing.
        """
        if estimate.status is Status.INVALID and not self._is_coupled:
            return estimate
        reasons, worst = [], 0.0
        for contradiction in self.contradictions:
            effect = contradiction.effect_on(estimate)
            if math.isnan(effect):
                reasons.append(Reason(TrustCode.ERROR_COVERS, why=contradiction.reason))
            elif effect > _UNBOUNDED:
                reasons.append(Reason(TrustCode.NOTHING_FOLLOWS, why=contradiction.reason))
                worst = effect
            elif effect * abs(estimate.value - quantity_of(estimate.name).origin) > _MINOR_SHARE * estimate.std or (
                effect and math.isnan(estimate.std)
            ):
                reasons.append(Reason(TrustCode.MAY_CHANGE_BY, effect=effect, why=contradiction.reason))
                worst = max(worst, effect)
        if worst > _INVALID_CHANGE:
            return Estimate.invalid(estimate.name, *reasons)
        if estimate.status is Status.INVALID:
            return estimate
        status = Status.PROVISIONAL if reasons else estimate.status
        notes = self._notes_on(estimate.name)
        if not (reasons or notes):
            return estimate
        return estimate._replace(status=status, reasons=(*reasons, *estimate.reasons, *notes))

    def _notes_on(self, name: str) -> list[Reason]:
        """Return what is to be known of a quantity beside contradictions."""
        quantity, notes = quantity_of(name), []
        if self.disagreement is not None and quantity.is_radius_times_angle:
            notes.append(self.disagreement)
        if not self.offset_is_known and Basis.OFFSET in quantity.rests_on:
            notes.append(Reason(TrustCode.OFFSET_UNKNOWN, std_m=self.sensor_offset_std_m))
        if self.hub_motion is not None and Basis.HUB in quantity.rests_on:
            notes.append(self.hub_motion)
        return notes


def assess(
    measured: Measured | None,
    conditions: TireConditions,
    steady_mps2: float,
    *,
    ac_coupled: bool,
    lost: LostSteadyValue | None = None,
    full_scale_mps2: float = math.nan,
) -> Evidence:
    """Return the evidence on one wheel.

    Args:
        measured: by self-calibration; None before its first revolutions.
        conditions: as stated.
        steady_mps2: R Omega^2 of the stated radius at the present speed, positive.
        ac_coupled: whether the sensor passes no steady value, as stated.
        lost: what is left of the steady value where that contradicts the stated coupling.
        full_scale_mps2: end of the range of the radial axis; NaN when not known.
    """
    claims = conditions.claims
    if conditions.rules is not EVERY_RULE:
        measured, lost = _filtered(measured, conditions.rules), lost if DoubtRule.COUPLING in conditions.rules else None
    radius = Value(conditions.radius_m, conditions.radius_std_m)
    contradictions: list[Contradiction] = []
    if lost is not None:
        # What was measured rests on the steady value.
        measured = None
        contradictions.append(Contradiction(Subject.COUPLING, steady_value_lost(lost), {Basis.COUPLING: math.nan}))
    zero_std, gain_std = claims.zero_g_std_mps2, claims.gain_std
    # Relative error of the measured offset that a contradicted gain or rate makes.
    offset_error = 0.0
    if measured is not None:
        axis_contradictions = tuple(_axis_contradictions(measured, steady_mps2, radius.value))
        contradictions += axis_contradictions
        if any(Basis.ALONG in contradiction.ratios for contradiction in axis_contradictions):
            # The offset and the hub's motion are read from an axis that is not what it is taken for.
            measured = measured._replace(offset_m=None, hub_mps2=0.0)
    steady = _SteadyValue(radius)
    if measured is not None and (ratio := _steady_ratio(measured, zero_std)) is not None:
        steady = _assess_steady_value(measured, ratio, conditions, radius)
        contradictions += steady.contradictions
        gain_std = math.hypot(gain_std, steady.unsure)
        offset_error = steady.unsure
        for contradiction in contradictions:
            gain_ratio = contradiction.ratios.get(Basis.GAIN, 1.0)
            gain_std = max(gain_std, abs(gain_ratio - 1.0))
            rate_effect = contradiction.ratios.get(Basis.RATE, 1.0) ** -2.0
            offset_error = max(offset_error, abs(1.0 / gain_ratio - 1.0), abs(rate_effect - 1.0))
    radius, unsure = steady.radius, steady.unsure
    zero_is_measured = False
    if (zero := _measured_zero(measured, zero_std)) is not None:
        zero_is_measured = True
        if (reason := zero_contradicted(*zero, zero_std)) is not None:
            contradictions.append(Contradiction(Subject.ZERO, reason, {Basis.ZERO: math.nan}))
            zero_std = abs(zero.value)
        else:
            zero_std = math.hypot(zero.value, zero.std)
    gravity = None if measured is None else measured.along_gravity
    if gravity is not None and gravity.is_absent:
        contradictions.append(Contradiction(Subject.AXES, gravity_absent(gravity), {Basis.AXES: _WRONG_AXIS_SHARE}))
    offset_m, offset_std_m, offset_is_known = _offset(measured, conditions, offset_error, contradictions)
    offset_std_m = math.hypot(offset_std_m, claims.nonlinear_offset_m(steady_mps2, full_scale_mps2, radius.value))
    if ac_coupled:
        # The mean was restored from the belt radius; the rest of the signal has the sensor's gain.
        steady_std = steady_mps2 * math.hypot(conditions.radius_std_m / conditions.radius_m, claims.gain_std, unsure)
    else:
        steady_std = _steady_std(conditions, steady_mps2, zero_std)
        if not zero_is_measured:
            steady_std = math.hypot(steady_std, min(unsure * steady_mps2, LARGEST_ZERO_MPS2))
    return Evidence(
        sensor_offset_m=offset_m,
        sensor_offset_std_m=offset_std_m,
        offset_is_known=offset_is_known,
        steady_std_mps2=steady_std,
        gain_std=gain_std,
        radius_m=radius.value,
        radius_std_m=radius.std,
        contradictions=tuple(contradictions),
        unsure=unsure,
        disagreement=steady.disagreement,
        hub_mps2=0.0 if measured is None else measured.hub_mps2,
        hub_motion=_hub_motion(measured, steady_mps2),
        roll_std_rad=0.0 if measured is None else _roll_std(measured, claims),
        tilt=Tilt() if measured is None else measured.tilt,
    )


def _hub_motion(measured: Measured | None, steady_mps2: float) -> Reason | None:
    """Return that the hub moves at the wheel's frequency, None where its motion does not matter."""
    # Noise and road of fewer revolutions look like a motion of the hub, which the errors contain.
    if measured is None or measured.revolutions < SETTLED_REVOLUTIONS:
        return None
    if not measured.hub_mps2 > _NOTABLE_HUB * steady_mps2:
        return None
    return Reason(TrustCode.HUB_MOVES, amplitude_mps2=2.0 * measured.hub_mps2)


def _measured_zero(measured: Measured | None, zero_std_mps2: float) -> Value | None:
    """Return the zero-g offset of the radial axis, None where it is not known better than stated."""
    if measured is None or measured.ac_coupled:
        return None
    zero = zero_offset(measured.by_mean, zero_std_mps2)
    return zero if zero is not None and zero.std < ZERO_MEASURED * zero_std_mps2 else None


def _steady_std(conditions: TireConditions, steady_mps2: float, zero_std_mps2: float) -> float:
    """Return the error of the steady value by the zero-g offset, in m/s^2.

    A zero-g offset larger than the errors of gain and radius would show in the steady value.
    """
    claims, radius_std = conditions.claims, conditions.radius_std_m / conditions.radius_m
    scale = steady_mps2 * math.hypot(radius_std, claims.gain_std, 2.0 * claims.rate_std)
    return zero_std_mps2 * scale / math.hypot(zero_std_mps2, scale) if scale and zero_std_mps2 else zero_std_mps2


class _SteadyValue(NamedTuple):
    """What the steady value says of what is stated.

    Attributes:
        radius: of the belt, in m.
        contradictions: of radius, gain or rate.
        unsure: relative; radius, gain, rate or zero may be wrong by it.
        disagreement: why, None where it does not matter.
    """

    radius: Value
    contradictions: tuple[Contradiction, ...] = ()
    unsure: float = 0.0
    disagreement: Reason | None = None


def _assess_steady_value(measured: Measured, ratio: Value, conditions: TireConditions, radius: Value) -> _SteadyValue:
    """Compare the steady value with belt radius, gain and rate as stated.

    Args:
        measured: by self-calibration.
        ratio: of the measured steady value to that of the stated radius.
        conditions: as stated.
        radius: of the belt as stated, in m.
    """
    claims, radius_std = conditions.claims, conditions.radius_std_m / conditions.radius_m
    # The offset enters the mean by e/R mean(k^2).
    depth_m = 0.0 if measured.offset_m is not None else UNKNOWN_OFFSET_STD_M
    if claims.offset_m is not None:
        depth_m = min(depth_m, claims.offset_std_m)
    depth = depth_m / conditions.radius_m
    mean_square = min(measured.mean_square, GREATEST_MEAN_SQUARE)
    gravity_gain = _gravity_gain(measured, depth)
    by_gain = math.hypot(ratio.std, claims.gain_std, 2.0 * claims.rate_std, mean_square * depth)
    measured_radius = Value(conditions.radius_m * ratio.value, conditions.radius_m * by_gain)
    if radius.std > _RADIUS_UNKNOWN * measured_radius.std and abs(measured_radius.value - radius.value) <= (
        CONTRADICTION * math.hypot(radius.std, measured_radius.std)
    ):
        return _SteadyValue(_weighted(radius, measured_radius))
    tolerance = math.hypot(by_gain, radius_std)
    if abs(ratio.value - 1.0) > CONTRADICTION * tolerance:
        return _SteadyValue(radius, (_steady_contradiction(measured, conditions, ratio, by_gain, depth),))
    if (gravity_only := _gravity_contradiction(gravity_gain, claims.gain_std)) is not None:
        return _SteadyValue(radius, (gravity_only,))
    speed_ratio = _gravity_speed_ratio(gravity_gain, ratio, measured, conditions, mean_square * depth)
    if speed_ratio is not None and abs(speed_ratio.value - 1.0) > CONTRADICTION * speed_ratio.std:
        return _SteadyValue(radius, (_steady_contradiction(measured, conditions, ratio, by_gain, depth),))
    if DoubtRule.SHORT_OF_IT not in conditions.rules:
        return _SteadyValue(radius)
    unsure = disagreement_std(ratio.value - 1.0, tolerance)
    if speed_ratio is not None:
        unsure = max(unsure, disagreement_std(speed_ratio.value - 1.0, speed_ratio.std))
    if gravity_gain is not None:
        unsure = max(unsure, _hidden_error(gravity_gain, measured, claims.gain_std))
    # Of a radius, a gain or a rate that is not as stated.
    cause_error = _SINGLE_CAUSE_SHARE * (ratio.value - 1.0)
    widened = Value(radius.value, math.hypot(radius.std, max(unsure, abs(cause_error)) * radius.value))
    disagreement = Reason(TrustCode.STEADY_VALUE_DISAGREES, ratio=ratio.value, std=tolerance, error=unsure)
    return _SteadyValue(widened, (), unsure, disagreement if unsure > radius_std else None)


def _filtered(measured: Measured | None, rules: frozenset[DoubtRule]) -> Measured | None:
    """Return what is measured without that which only rules that do not apply look at."""
    if measured is None:
        return None
    relations, zero_sums = measured.relations, Equations(*[0.0] * len(Equations._fields))
    if DoubtRule.AXES not in rules:
        relations = relations._replace(circumferential_late_rad=0.0, lateral_late_rad=0.0, is_swapped=False)
    defaults: dict[DoubtRule, dict[str, Any]] = {
        DoubtRule.STEADY_VALUE: {"by_mean": zero_sums, "contact_gain": None},
        DoubtRule.GRAVITY: {"by_gravity": zero_sums, "along_gravity": None},
        DoubtRule.SENSOR_OFFSET: {"offset_m": None},
        DoubtRule.ROLL: {"roll_by_mean_rad": math.nan, "relations": relations._replace(along_zero_mps2=math.nan)},
        DoubtRule.TILT: {"tilt": Tilt()},
        DoubtRule.HUB_MOTION: {"hub_mps2": 0.0},
    }
    changes = {name: value for rule, parts in defaults.items() if rule not in rules for name, value in parts.items()}
    return measured._replace(**{"relations": relations, **changes})


def _roll_std(measured: Measured, claims: SensorClaims) -> float:
    """Return the error of the roll from the means of the axes that the other axes and its own shape show.

    A zero-g offset of the lateral axis moves the roll by the means alone, a slip angle that by the shape, and a roll
    both. What is stated of the zero-g offsets is one statement: where the circumferential axis is off by more, so may
    be the lateral one.
    """
    by_zero = _excess_zero_mps2(measured, claims) / measured.steady_mps2 if measured.steady_mps2 > 0.0 else 0.0
    difference = measured.roll_by_mean_rad - measured.relations.roll_rad
    if not math.isfinite(difference):
        return by_zero
    excess = max(difference**2 - _ROLL_BY_SHAPE_RAD**2, 0.0)
    return math.hypot(max(math.sqrt(excess), _SINGLE_CAUSE_SHARE * abs(difference)), by_zero)


def _excess_zero_mps2(measured: Measured, claims: SensorClaims) -> float:
    """Return the error of zero-g offsets that the circumferential axis shows beyond what is stated of them, m/s^2."""
    zero_mps2, tilt = measured.relations.along_zero_mps2, measured.relations.tilt
    if not math.isfinite(zero_mps2):
        return 0.0
    # The tilt by the shape, and the gains of two axes, take their share of the mean.
    gains = math.hypot(claims.gain_std, claims.along_gain_std)
    by_tilt = measured.steady_mps2 * math.hypot(PITCH_MODEL_RAD, gains * tilt)
    std = math.hypot(claims.zero_g_std_mps2, by_tilt)
    return abs(zero_mps2) if abs(zero_mps2) > CONTRADICTION * std else disagreement_std(zero_mps2, std)


def _swapped_offset(measured: Measured, claims: SensorClaims) -> tuple[float, float] | None:
    """Return the depth by the axis that is along the belt where it is taken for the lateral one, else None."""
    offset_m = measured.relations.swapped_offset_m
    if not (measured.relations.is_swapped and math.isfinite(offset_m)):
        return None
    return offset_m, math.hypot(OFFSET_MODEL_M, math.hypot(claims.gain_std, claims.along_gain_std) * offset_m)


def _axis_contradictions(measured: Measured, steady_mps2: float, radius_m: float) -> Iterator[Contradiction]:
    """Yield what the axes say of each other."""
    relations, omega_radps = measured.relations, math.sqrt(steady_mps2 / radius_m)
    if relations.is_swapped:
        ratios = {Basis.AXES: _WRONG_AXIS_SHARE, Basis.ALONG: _WRONG_AXIS_SHARE}
        yield Contradiction(Subject.AXES, Reason(TrustCode.AXES_SWAPPED), ratios)
    for axis, late_rad, basis in (
        ("circumferential", relations.circumferential_late_rad, Basis.ALONG),
        ("lateral", relations.lateral_late_rad, Basis.AXES),
    ):
        if late_rad:
            reason = Reason(TrustCode.AXIS_LATE, axis=axis, late_s=late_rad / omega_radps)
            yield Contradiction(Subject.TIMING, reason, {basis: _WRONG_AXIS_SHARE})


def _offset(
    measured: Measured | None, conditions: TireConditions, error: float, contradictions: list[Contradiction]
) -> tuple[float, float, bool]:
    """Return the sensor's offset in use, its standard error, and whether it is known; add a contradiction.

    `error` is a relative error of the measured offset beyond its own.
    """
    claims = conditions.claims
    stated_offset = None if claims.offset_m is None else Value(claims.offset_m, claims.offset_std_m)
    by_signal = None
    measured_offset = None if measured is None else measured.offset_m or _swapped_offset(measured, claims)
    if measured_offset is not None:
        value, std = measured_offset
        by_signal = Value(value, math.hypot(std, error * value))
    if stated_offset is None and by_signal is None:
        return 0.0, UNKNOWN_OFFSET_STD_M, False
    if stated_offset is None or by_signal is None:
        single = stated_offset if by_signal is None else by_signal
        assert single is not None
        return single.value, single.std, True
    difference = abs(stated_offset.value - by_signal.value)
    if difference <= CONTRADICTION * math.hypot(stated_offset.std, by_signal.std):
        combined = _weighted(stated_offset, by_signal)
        return combined.value, combined.std, True
    reason = Reason(
        TrustCode.OFFSET_CONTRADICTED,
        stated_m=stated_offset.value,
        stated_std_m=stated_offset.std,
        offset_m=by_signal.value,
        std_m=by_signal.std,
    )
    contradictions.append(Contradiction(Subject.OFFSET, reason, {Basis.OFFSET: math.nan}))
    return stated_offset.value, difference, True


def _weighted(first_value: Value, second_value: Value) -> Value:
    """Return the mean of two values weighted with their inverse variances."""
    if not first_value.std or not second_value.std:
        return first_value if not first_value.std else second_value
    first, second = first_value.std**-2.0, second_value.std**-2.0
    return Value((first * first_value.value + second * second_value.value) / (first + second), (first + second) ** -0.5)


def _steady_ratio(measured: Measured, zero_std_mps2: float) -> Value | None:
    """Return measured over expected steady value, without the errors of gain, radius and rate."""
    if measured.ac_coupled:
        return None if measured.contact_gain is None else Value(*measured.contact_gain)
    return steady_ratio(measured.by_mean, zero_std_mps2)


def _gravity_gain(measured: Measured, depth: float) -> Value | None:
    """Return the gain from gravity; `depth` is the standard error of the sensor's offset over the belt radius."""
    return None if measured.ac_coupled else gravity_gain(measured.by_gravity, depth)


def _gravity_speed_ratio(
    gravity: Value | None, ratio: Value, measured: Measured, conditions: TireConditions, by_depth: float
) -> Value | None:
    """Return V^2 / R with the gain that gravity and the statement give together, over R Omega^2; None without gravity.

    So the speed by gravity is compared with that by the radius. Its error contains that of radius and rate, and what
    moves the hub, which may be as much in gravity's order.
    """
    claims = conditions.claims
    if gravity is None:
        return None
    gravity = Value(gravity.value, math.hypot(gravity.std, measured.hub_mps2 / STANDARD_GRAVITY_MPS2))
    if abs(gravity.value - 1.0) > CONTRADICTION * math.hypot(gravity.std, claims.gain_std):
        return None
    gain = _weighted(Value(1.0, claims.gain_std), gravity)
    radius_std = conditions.radius_std_m / conditions.radius_m
    error = math.hypot(ratio.std, gain.std, 2.0 * claims.rate_std, by_depth, radius_std)
    return Value(ratio.value / gain.value, error)


def _hidden_error(gravity: Value, measured: Measured, gain_std: float) -> float:
    """Return the error of gain, radius or rate where gravity disagrees with the stated gain.

    The steady value agrees. So it is a vibration, or two statements are wrong and hide each other.
    """
    std = math.hypot(gravity.std, measured.hub_mps2 / STANDARD_GRAVITY_MPS2)
    difference, combined_std = gravity.value - 1.0, math.hypot(std, gain_std)
    if std > _GRAVITY_STD_RATIO * gain_std and abs(difference) <= CONTRADICTION * combined_std:
        return 0.0
    return disagreement_std(difference, combined_std)


def _gravity_contradiction(gain: Value | None, gain_std: float) -> Contradiction | None:
    """Return the contradiction of the gain by gravity to the stated one where the steady value is as expected."""
    if gain is None:
        return None
    limit = max(GRAVITY_ALONE * math.hypot(gain.std, gain_std), LEAST_GRAVITY_ERROR)
    if abs(gain.value - 1.0) <= limit:
        return None
    reason = Reason(TrustCode.GRAVITY_CONTRADICTED, gain=gain.value, std=gain.std)
    ratio = max(gain.value, 0.1)
    # The steady value has the right size, so radius or rate make up for the gain.
    ratios = {Basis.GAIN: ratio, Basis.RADIUS: 1.0 / ratio, Basis.RATE: ratio**-0.5}
    return Contradiction(Subject.GRAVITY, reason, ratios)


def _steady_contradiction(
    measured: Measured, conditions: TireConditions, ratio: Value, by_gain: float, depth: float
) -> Contradiction:
    """Return the contradiction of the steady value, with its possible causes, the likeliest first."""
    candidates = sorted(_causes(measured, conditions, ratio, by_gain, depth), key=lambda cause: cause.errors)
    reasons = tuple(cause.reason for cause in candidates) or (Reason(TrustCode.NO_SINGLE_CAUSE),)
    ratios = {cause.cause: cause.ratio for cause in reversed(candidates)}
    if not ratios:
        # Several statements are wrong, any of these three among them.
        value = max(ratio.value, 0.1)
        ratios = {Basis.RADIUS: value, Basis.RATE: math.sqrt(value), Basis.GAIN: value}
    reason = Reason(TrustCode.STEADY_VALUE_CONTRADICTED, ratio=ratio.value, std=by_gain, causes=reasons)
    return Contradiction(Subject.STEADY, reason, ratios)


class _Cause(NamedTuple):
    """A possible cause, its implausibility in standard errors, and the ratio of true to stated value it needs."""

    errors: float
    cause: Basis
    ratio: float
    reason: Reason


def _causes(
    measured: Measured, conditions: TireConditions, ratio: Value, by_gain: float, depth: float
) -> Iterator[_Cause]:
    claims = conditions.claims
    tolerance = CONTRADICTION * math.hypot(by_gain, conditions.radius_std_m / conditions.radius_m) * abs(ratio.value)
    gravity = _gravity_gain(measured, depth)

    def gravity_allows(gain: float) -> bool:
        if gravity is None:
            return True
        return abs(gravity.value - gain) <= CONTRADICTION * math.hypot(gravity.std, claims.gain_std * gain)

    value = ratio.value
    if gravity_allows(value):
        units = [
            _Cause(_UNIT_ERRORS, Basis.GAIN, factor, Reason(TrustCode.WOULD_FIT, what=unit))
            for factor, unit in ((STANDARD_GRAVITY_MPS2, "mps2"), (1.0 / STANDARD_GRAVITY_MPS2, "g"))
            if abs(value - factor) <= tolerance
        ]
        yield from units
        if value > 0.0 and not units:
            errors = abs(math.log(value)) / max(claims.gain_std, 1e-6)
            yield _Cause(errors, Basis.GAIN, value, Reason(TrustCode.WOULD_FIT, what="gain", gain=value))
    if not gravity_allows(1.0):
        return
    if value > 0.0:
        root = math.sqrt(value)
        nearest = min(_RATE_RATIOS, key=lambda candidate: abs(math.log(candidate / root)))
        is_common_ratio = abs(nearest**2 - value) <= tolerance
        rate = nearest if is_common_ratio else root
        stated_hz = measured.rate_hz
        yield _Cause(
            _RATIO_ERRORS if is_common_ratio else _OTHER_RATE_ERRORS,
            Basis.RATE,
            rate,
            Reason(TrustCode.WOULD_FIT, what="rate", rate_hz=rate * stated_hz, stated_hz=stated_hz),
        )
        if is_common_ratio and nearest in _MISSED_CONTACTS:
            missed = Reason(TrustCode.WOULD_FIT, what="contacts", every=nearest)
            yield _Cause(_MISSED_ERRORS, Basis.RATE, rate, missed)
        radius_m = conditions.radius_m * value
        if _RADII_M[0] <= radius_m <= _RADII_M[1]:
            errors = abs(math.log(value)) / max(conditions.radius_std_m / conditions.radius_m, 1e-6)
            reason = Reason(TrustCode.WOULD_FIT, what="radius", radius_m=radius_m, stated_m=conditions.radius_m)
            yield _Cause(errors, Basis.RADIUS, value, reason)
    zero_mps2 = (value - 1.0) * measured.steady_mps2
    if not measured.ac_coupled and abs(zero_mps2) <= LARGEST_ZERO_MPS2:
        errors = abs(zero_mps2) / max(claims.zero_g_std_mps2, 1e-6)
        yield _Cause(errors, Basis.ZERO, math.nan, Reason(TrustCode.WOULD_FIT, what="zero", zero_mps2=zero_mps2))
