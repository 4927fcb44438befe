"""Join of a wheel's revolutions with the vehicle's signals, which are witnesses for sampling rate and belt radius.

Source of the comparison: Omega of the wheel from its contacts is proportional to the stated sampling rate f, and its
speed R Omega to f and the belt radius R. So the ratio of the car's Omega to the wheel's is that of the true to the
stated rate, and the ratio of the car's speed to R Omega that of the true to the stated radius, where the rate holds.
"""

import math
from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np

from gateway.core.estimates.estimator import Estimate, Status, is_evidence
from gateway.core.estimates.results import Alarm, RevolutionResult
from gateway.core.quantity import Basis
from gateway.core.reasons import Reason
from gateway.core.trust.reasons import TrustCode
from gateway.core.trust.signal_evidence import Contradiction, Evidence, Subject
from gateway.vehicle.reasons import VehicleCode
from gateway.vehicle.vehicle_signals import (
    COURSE_RATE,
    GROUND_SPEED_STD_MPS,
    RECEIVER_SIGNALS,
    Quantity,
    Reading,
    SignalHistory,
    VehicleSignal,
)

# Standard errors of both together from which car and wheel contradict each other.
_CONTRADICTION: Final = 3.0
# Ratios of the latest revolutions that are averaged, and the fewest that say anything.
_REVOLUTIONS: Final = 30
_FEWEST: Final = 8
# A car's speed says nothing at walking pace: its sensors have a lowest speed.
_LEAST_RADPS: Final = 3.0
# Speed from which a receiver's course says how the vehicle turns.
_LEAST_COURSE_MPS: Final = 3.0
# A receiver filters its speed and sends it up to this much later: a speed that changes is not that of the revolution.
_RECEIVER_DELAY_S: Final = 0.3
# Standard error of a speed taken as constant, per second: drivers rarely exceed 3.5 m/s^2, over the square root of 3.
_USUAL_MPS2: Final = 2.0
# A signal whose values all lie farther than this from the revolutions is not late, but of another date.
_OUTSIDE_NS: Final = 600_000_000_000
_MISSED_CONTACTS: Final = (2.0, 3.0)


class _Ratio(NamedTuple):
    """Value of the car over that of the wheel, and its relative standard error."""

    value: float
    std: float


@dataclass(slots=True)
class _Wheel:
    """Latest ratios of one wheel, and what they contradict."""

    ratios: dict[str, deque[float]]
    contradictions: tuple[Contradiction, ...] = ()


class VehicleJoin:
    """Adds the vehicle's signals to results, and qualifies estimates that they contradict; no state but ratios."""

    def __init__(self, history: SignalHistory) -> None:
        """Join with a history that someone else fills."""
        self.history = history
        self._wheels: dict[str, _Wheel] = {}
        self._begin_ns: int | None = None
        # The time of the latest revolution, and signals of which nothing had come when it was asked for.
        self._latest_ns = 0
        self._unheard: set[str] = set()
        self._is_outside_told = False

    def joined(self, result: RevolutionResult) -> RevolutionResult:
        """Return a result with the signals at the middle of its revolution as further estimates.

        Each signal gives its value and its age, the time since the last value received before.
        """
        revolution = result.revolution
        at_ns = result.host_ns - round(0.5e9 * revolution.period_s)
        if self._begin_ns is None:
            self._begin_ns = at_ns
        self._latest_ns = max(self._latest_ns, at_ns)
        wheel = self._wheels.setdefault(result.position, _Wheel({}))
        added: list[Estimate] = []
        for signal in self.history.of_wheel(result.position):
            reading = self.history.at(signal.key, at_ns, result.host_ns)
            age_name = signal.age_name
            if reading is None:
                if signal in RECEIVER_SIGNALS and not self.history.has_begun(signal.key, result.host_ns):
                    continue  # there may be no receiver
                missing = self._missing(signal.key, at_ns)
                added += [Estimate.invalid(signal.name, missing), Estimate.invalid(age_name, missing)]
                continue
            std = signal.std(reading.value)
            if signal.quantity is Quantity.GROUND_SPEED:
                # It comes late, and is kept until the next one.
                slope_mps2 = reading.slope_per_s if math.isfinite(reading.slope_per_s) else 0.0
                late_mps = slope_mps2 * (_RECEIVER_DELAY_S + reading.held_s)
                std = math.hypot(std, late_mps, _USUAL_MPS2 * reading.held_s)
            added.append(Estimate(signal.name, reading.value, std, Status.VALID))
            added.append(Estimate(age_name, reading.age_s, 0.0, Status.VALID))
            if signal.quantity is Quantity.COURSE:
                added += _course_rate(reading, result)
            self._compare(wheel, signal, reading, result)
        wheel.contradictions = tuple(self._contradictions(wheel, result))
        estimates = result.estimates
        if wheel.contradictions:
            evidence = Evidence.of_contradictions(wheel.contradictions)
            estimates = tuple(evidence.qualified(estimate) for estimate in estimates)
        return replace(result, estimates=(*estimates, *added))

    def _missing(self, key: str, at_ns: int) -> Reason:
        """Return why a signal has no value: its log may be of another date than the recording."""
        span_ns, begin_ns = self.history.span_ns(key), at_ns if self._begin_ns is None else self._begin_ns
        if span_ns is None:
            self._unheard.add(key)
            return Reason(VehicleCode.SIGNAL_MISSING)
        first_ns, last_ns = span_ns
        away_ns, side = max((begin_ns - last_ns, "before"), (first_ns - at_ns, "after"))
        if away_ns < _OUTSIDE_NS:
            return Reason(VehicleCode.SIGNAL_MISSING)
        shift_s = round((begin_ns - first_ns) * 1e-9)
        return Reason(VehicleCode.SIGNAL_OUTSIDE_RECORDING, away_s=away_ns * 1e-9, side=side, shift_s=shift_s)

    def take_outside(self) -> Reason | None:
        """Return, once, that values which came after the revolutions that lack them are of another date."""
        keys = [key for key in self._unheard if self.history.span_ns(key) is not None]
        self._unheard.difference_update(keys)
        for reason in (self._missing(key, self._latest_ns) for key in keys if not self._is_outside_told):
            if reason.code is VehicleCode.SIGNAL_OUTSIDE_RECORDING:
                self._is_outside_told = True
                return reason
        return None

    def alarms(self) -> Iterator[Alarm]:
        """Yield an alarm for each contradiction that stands."""
        for position, wheel in self._wheels.items():
            for contradiction in wheel.contradictions:
                yield Alarm(position, str(contradiction.subject), contradiction.reason)

    @staticmethod
    def _compare(wheel: _Wheel, signal: VehicleSignal, reading: Reading, result: RevolutionResult) -> None:
        """Keep the ratio of a speed of the car to that of the wheel."""
        revolution, value = result.revolution, reading.value
        if not (
            signal.is_witness and is_evidence(revolution) and revolution.omega_radps >= _LEAST_RADPS and value > 0.0
        ):
            return
        if signal.quantity is Quantity.GROUND_SPEED and not _is_of_revolution(signal, reading, revolution.period_s):
            return
        wheel_speed = revolution.omega_radps
        if signal.suffix == "mps":
            wheel_speed *= result.conditions.radius_m
        wheel.ratios.setdefault(signal.key, deque(maxlen=_REVOLUTIONS)).append(value / wheel_speed)

    def _contradictions(self, wheel: _Wheel, result: RevolutionResult) -> Iterator[Contradiction]:
        """Yield what the car's speeds contradict: the rate by its rotation, the radius by its speed."""
        conditions = result.conditions
        rate_std, radius_std = conditions.claims.rate_std, conditions.radius_std_m / conditions.radius_m
        # None where no speed of rotation comes: a sensor that is dead is no witness.
        rate_holds: bool | None = None
        linear: list[tuple[VehicleSignal, _Ratio]] = []
        for signal in self.history.of_wheel(result.position):
            ratio = _mean_ratio(wheel.ratios.get(signal.key), signal)
            if ratio is None:
                continue
            if signal.suffix == "mps":
                linear.append((signal, ratio))
                continue
            error = math.hypot(ratio.std * ratio.value, rate_std)
            rate_holds = abs(ratio.value - 1.0) <= _CONTRADICTION * error
            if not rate_holds:
                yield _rotation(ratio, error, result.revolution.rate_hz)
        if rate_holds is False:
            return  # without the rate, the speed says nothing of the radius
        for _, ratio in linear:
            error = math.hypot(ratio.std * ratio.value, rate_std, radius_std)
            if abs(ratio.value - 1.0) > _CONTRADICTION * error:
                yield _speed(ratio, error, result, rate_holds=bool(rate_holds))
                return


def _course_rate(reading: Reading, result: RevolutionResult) -> Iterator[Estimate]:
    """Yield the yaw rate by the course of a receiver, which is known by its speed to the side; not at walking pace."""
    speed_mps = result.conditions.radius_m * result.revolution.omega_radps
    if speed_mps > _LEAST_COURSE_MPS and math.isfinite(reading.slope_per_s):
        std = math.sqrt(2.0) * GROUND_SPEED_STD_MPS / speed_mps
        yield Estimate(COURSE_RATE, -reading.slope_per_s, std, Status.VALID)


def _is_of_revolution(signal: VehicleSignal, reading: Reading, period_s: float) -> bool:
    """Return whether a ground speed was received in a revolution, and neither too low nor changing for its error.

    A receiver sends once a second: between, a car that brakes has another speed.
    """
    error_mps = signal.usual_std * reading.value
    is_steady = abs(reading.slope_per_s) * _RECEIVER_DELAY_S <= error_mps
    return reading.nearest_s <= 0.5 * period_s and error_mps >= GROUND_SPEED_STD_MPS and is_steady


def _mean_ratio(ratios: deque[float] | None, signal: VehicleSignal) -> _Ratio | None:
    """Return the mean of the latest ratios; its error has their scatter and the stated error of the signal."""
    if ratios is None or len(ratios) < _FEWEST:
        return None
    values = np.array(ratios)
    centre = float(np.median(values))
    scatter = float(values.std(ddof=1)) / math.sqrt(len(values))
    return _Ratio(centre, math.hypot(signal.usual_std, scatter / centre))


def _rotation(ratio: _Ratio, error: float, rate_hz: float) -> Contradiction:
    """Return the contradiction of the car's rotation to the wheel's."""
    causes = [Reason(TrustCode.WOULD_FIT, what="rate", rate_hz=ratio.value * rate_hz, stated_hz=rate_hz)]
    missed = next(
        (count for count in _MISSED_CONTACTS if abs(ratio.value / count - 1.0) <= _CONTRADICTION * error), None
    )
    if missed is not None:
        causes.append(Reason(TrustCode.WOULD_FIT, what="contacts", every=missed))
    return Contradiction(
        Subject.WHEEL_SPEED, _contradicted(ratio, error, causes, "rotation", "contacts"), {Basis.RATE: ratio.value}
    )


def _speed(ratio: _Ratio, error: float, result: RevolutionResult, *, rate_holds: bool) -> Contradiction:
    """Return the contradiction of the car's speed to that of the wheel, the likeliest cause first."""
    stated_m, rate_hz = result.conditions.radius_m, result.revolution.rate_hz
    causes = [Reason(TrustCode.WOULD_FIT, what="radius", radius_m=stated_m * ratio.value, stated_m=stated_m)]
    ratios: Mapping[Basis, float] = {Basis.RADIUS: ratio.value}
    if not rate_holds:
        causes.append(Reason(TrustCode.WOULD_FIT, what="rate", rate_hz=ratio.value * rate_hz, stated_hz=rate_hz))
        ratios = {Basis.RADIUS: ratio.value, Basis.RATE: ratio.value}
    return Contradiction(Subject.VEHICLE_SPEED, _contradicted(ratio, error, causes, "speed", "radius"), dict(ratios))


def _contradicted(ratio: _Ratio, error: float, causes: list[Reason], what: str, of: str) -> Reason:
    return Reason(VehicleCode.CAR_CONTRADICTED, what=what, of=of, ratio=ratio.value, std=error, causes=tuple(causes))
