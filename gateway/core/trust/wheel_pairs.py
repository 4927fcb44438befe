"""Comparison of the wheels of a vehicle: those of an axle slip to the same side at a time, and roll as fast.

Steering, side wind and a banked road turn or push both wheels to one side. What differs between them, toe and ply
steer, is constant, and so part of the zero that each wheel's slip is counted from. A wheel that slips to the right
whenever the other slips to the left has a lateral axis that points the other way, or a position that is another's.

Both wheels roll the same way but in a curve, where speeds that differ by a share d at the speed v mean a lateral
acceleration of d v^2 over the track. What no curve explains is a belt radius or a rate that is not as stated, until the
speeds agree within their errors. One wheel alone shows neither. Where wheels measure their turn rate, a curve verifies
the sign of their lateral axes (`gateway.core.trust.lateral_signs`).

`gateway.core.trust.axis_lags` compares the axes of all wheels, `gateway.core.trust.turn_verdict.TurnComparison` their
turn rates.

What is compared depends on the times of the revolutions alone, not on the order in which they come.
"""

import bisect
import math
from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from itertools import takewhile
from typing import Final, NamedTuple, Protocol

import numpy as np

from gateway.core.estimates.disagreement import CONTRADICTION
from gateway.core.estimates.estimator import Status, is_evidence
from gateway.core.estimates.results import Alarm, RevolutionResult
from gateway.core.quantity import Basis
from gateway.core.quantity_catalogue import declared
from gateway.core.reasons import Reason
from gateway.core.trust.axis_lags import ALARM as AXIS_LAG
from gateway.core.trust.axis_lags import AxisLags
from gateway.core.trust.lateral_signs import LateralSign
from gateway.core.trust.qualification import provisional_where, verified
from gateway.core.trust.reasons import TrustCode
from gateway.core.trust.signal_evidence import Contradiction, Evidence, Subject
from gateway.core.trust.turn_verdict import NOTHING, TURN_RATE, TurnComparison, Verdict, Witness
from gateway.core.wheel_position import right_of

ALARM: Final = "lateral axis"
"""Name of the alarm of an axis that points to the right, and of a pair that slips to opposite sides."""

ALARMS: Final = frozenset({ALARM, AXIS_LAG, str(Subject.WHEEL_SPEED), str(Subject.TURN_RATE)})
"""Names of the alarms of wheels that are compared."""

# A block of one wheel's revolutions may come before those of the other wheel.
_QUEUE_CAPACITY: Final = 4096
# Pairs of revolutions, each of which is beyond three errors at both wheels, and the share that must be opposite. A
# wheel that meets a kerb or a puddle alone is one of few.
_MIN_PAIRS: Final = 8
_OPPOSITE_SHARE: Final = 0.8
# Revolutions that are compared, some ten seconds of driving, and after how many this is done again.
_WINDOW_REVOLUTIONS: Final = 128
_COMPARISON_INTERVAL: Final = 16
# Lateral acceleration that ordinary driving does not exceed for so long, and the widest track, of a truck.
_CURVE_MPS2: Final = 4.0
_TRACK_M: Final = 2.1
# Results of one wheel come up to so much later than those of the other: live, they wait for the next ones.
_MAX_DELAY_NS: Final = 10_000_000_000
# Part of the speed by which accelerations that differ change it until the middle of the other revolution: without a
# neighbour, a revolution has none. A curve makes three times as much.
_MOST_CHANGE: Final = 1e-3
# Quantity that side force displaces, with the sign of the lateral axis.
_BELT_SHIFT: Final = "belt_shift_m"
# Changes of the verdict that are remembered.
_VERDICT_CAPACITY: Final = 256


class _WheelRevolution(NamedTuple):
    """A revolution of one wheel.

    End, middle and half of its period, ns, direction of its slip, speed, acceleration, turn rate and shift of its belt.
    """

    end_ns: float
    middle_ns: float
    half_ns: float
    direction: float
    speed_mps: float
    acceleration_mps2: float
    speed_std: float
    rate_radps: float
    shift_m: float


class _RevolutionPair(NamedTuple):
    """A revolution of either wheel at the same time; the ratio of the speeds is right over left."""

    end_ns: float
    side: float
    ratio: float
    speed_mps: float
    std: float
    rates_radps: tuple[float, float]
    shifts_m: tuple[float, float]


class _Verdict(NamedTuple):
    """What is known from a time on: pairs of revolutions that slip apart and together, and the ratio of the speeds.

    The counts are 0 where the slip says nothing, the ratio NaN where the speeds do not. Signs are those of the lateral
    axes, left and right, as `LateralSign` has them.
    """

    at_ns: float = -math.inf
    opposite: int = 0
    same: int = 0
    ratio: float = math.nan
    std: float = math.nan
    signs: tuple[int, int] = (0, 0)

    @property
    def says(self) -> tuple[bool, bool, tuple[int, int]]:
        """What changes alarms."""
        return self.opposite > 0, math.isfinite(self.ratio), self.signs

    def reason_of_slip(self, other: str) -> Reason:
        return Reason(TrustCode.LATERAL_SLIP_APART, other=other, opposite=self.opposite, same=self.same)

    def contradictions(self, other: str, *, is_right: bool) -> tuple[Contradiction, ...]:
        """Return that of the speeds at one of the wheels, were its radius or rate the wrong one."""
        if not math.isfinite(self.ratio):
            return ()
        ratio = 1.0 / self.ratio if is_right else self.ratio
        reason = Reason(TrustCode.WHEELS_ROLL_APART, other=other, ratio=1.0 / ratio, std=self.std)
        return (Contradiction(Subject.WHEEL_SPEED, reason, {Basis.RADIUS: ratio, Basis.RATE: ratio}),)


_NO_VERDICT: Final = _Verdict()
_NO_RATIO: Final = (math.nan, math.nan)


class VehicleWitness(Protocol):
    """Signals of the vehicle beside the wheels."""

    def joined(self, result: RevolutionResult) -> RevolutionResult:
        """Return a result with the signals at the middle of its revolution as further estimates."""
        ...

    def alarms(self) -> Iterator[Alarm]:
        """Yield an alarm for each contradiction that stands."""
        ...


@dataclass(slots=True)
class _Pair:
    """A left and a right wheel.

    Attributes:
        waiting: the latest revolutions, by side.
        newest_ns: end of the latest, by side.
        both: pairs of revolutions that earlier ones may still come between.
        opposite: whether the slip was to opposite sides, of the latest pairs of revolutions with slip.
        speeds: latest pairs of revolutions without faults.
        compared: how many there were.
        apart: ratio of the speeds and its error where they are apart, NaN where they are not.
        signs: of the lateral axes, by side.
        verdicts: each from its time on.
    """

    waiting: tuple[deque[_WheelRevolution], deque[_WheelRevolution]] = field(
        default_factory=lambda: (deque(maxlen=_QUEUE_CAPACITY), deque(maxlen=_QUEUE_CAPACITY))
    )
    newest_ns: list[float] = field(default_factory=lambda: [-math.inf, -math.inf])
    both: list[_RevolutionPair] = field(default_factory=list)
    opposite: deque[bool] = field(default_factory=lambda: deque(maxlen=_WINDOW_REVOLUTIONS))
    speeds: deque[_RevolutionPair] = field(default_factory=lambda: deque(maxlen=_WINDOW_REVOLUTIONS))
    compared: int = 0
    apart: tuple[float, float] = _NO_RATIO
    signs: tuple[LateralSign, LateralSign] = field(default_factory=lambda: (LateralSign(), LateralSign()))
    verdicts: deque[_Verdict] = field(default_factory=lambda: deque((_NO_VERDICT,), maxlen=_VERDICT_CAPACITY))

    def take(self, side: int, turn: _WheelRevolution) -> None:
        """Compare a revolution with those of the other wheel at its time."""
        others = self.waiting[1 - side]
        while others and others[0].middle_ns < turn.middle_ns - turn.half_ns:
            others.popleft()
        for candidate in takewhile(lambda candidate: candidate.middle_ns < turn.middle_ns + turn.half_ns, others):
            if abs(candidate.middle_ns - turn.middle_ns) < min(turn.half_ns, candidate.half_ns):
                left, right = (turn, candidate) if side == 0 else (candidate, turn)
                # Within the half revolution that they may be apart, a speed that changes would look like a curve.
                apart_s = 1e-9 * (right.middle_ns - left.middle_ns)
                gain_mps = 0.5 * (left.acceleration_mps2 + right.acceleration_mps2) * apart_s
                change_mps = abs((left.acceleration_mps2 - right.acceleration_mps2) * apart_s)
                is_known = change_mps < _MOST_CHANGE * left.speed_mps
                pair = _RevolutionPair(
                    max(turn.end_ns, candidate.end_ns),
                    turn.direction * candidate.direction,
                    (right.speed_mps - gain_mps) / left.speed_mps if is_known else math.nan,
                    left.speed_mps,
                    math.hypot(left.speed_std, right.speed_std),
                    (left.rate_radps, right.rate_radps),
                    (left.shift_m, right.shift_m),
                )
                bisect.insort(self.both, pair)
        self.waiting[side].append(turn)
        self.newest_ns[side] = turn.end_ns
        until_ns = min(self.newest_ns)
        while self.both and self.both[0].end_ns <= until_ns:
            self._judge(self.both.pop(0))

    def _judge(self, pair: _RevolutionPair) -> None:
        if pair.side > 0.0 or pair.side < 0.0:
            self.opposite.append(pair.side < 0.0)
        if math.isfinite(pair.ratio):
            for sign, rate_radps, shift_m in zip(self.signs, pair.rates_radps, pair.shifts_m, strict=True):
                sign.take(rate_radps, pair.speed_mps, pair.ratio, shift_m)
            self.speeds.append(pair)
            self.compared += 1
            if self.compared % _COMPARISON_INTERVAL == 0:
                self.apart = self._unexplained_ratio()
        count, opposite_count = len(self.opposite), sum(self.opposite)
        is_slip_opposite = count >= _MIN_PAIRS and opposite_count > _OPPOSITE_SHARE * count
        previous = self.verdicts[-1]
        opposite_count, same_count = (opposite_count, count - opposite_count) if is_slip_opposite else (0, 0)
        signs = self.signs[0].sign, self.signs[1].sign
        verdict = _Verdict(pair.end_ns, opposite_count, same_count, *self.apart, signs)
        if verdict.says != previous.says:
            self.verdicts.append(verdict)

    def _unexplained_ratio(self) -> tuple[float, float]:
        """Return the ratio of the speeds and its error where neither errors nor a curve explain it.

        Once a ratio is apart, a curve is no explanation of speeds that stay so: a slow stretch allows a tighter curve,
        and is no evidence that the radius is right.
        """
        if len(self.speeds) < _WINDOW_REVOLUTIONS:
            return _NO_RATIO
        ratios = np.array([pair.ratio for pair in self.speeds])
        ratio = float(np.median(ratios))
        slowest = min(pair.speed_mps for pair in self.speeds)
        is_persistent = (ratio - 1.0) * (self.apart[0] - 1.0) > 0.0
        curve_tolerance = 0.0 if is_persistent else _CURVE_MPS2 * _TRACK_M / slowest**2
        std = math.hypot(self.speeds[-1].std, float(ratios.std()) / math.sqrt(len(ratios)))
        return (ratio, std) if abs(ratio - 1.0) > CONTRADICTION * std + curve_tolerance else _NO_RATIO

    def verdict(self, at_ns: float) -> _Verdict:
        """Return what is known at a time."""
        return next((verdict for verdict in reversed(self.verdicts) if verdict.at_ns <= at_ns), _NO_VERDICT)


class WheelPairs:
    """Compares the wheels of one vehicle; in whatever order their revolutions come, the same ones are compared."""

    def __init__(self, join: VehicleWitness | None = None, turns: TurnComparison | None = None) -> None:
        """Start without revolutions; `join` adds the vehicle's signals, `turns` compares turn rates."""
        self._join, self._turns = join, turns
        self._axis_lags = AxisLags()
        self._pairs: dict[str, _Pair] = {}
        self._left_by_right: dict[str, str] = {}
        self._names = frozenset(quantity.name for quantity in declared() if quantity.is_of_axle)
        # Time of the latest result of a pair, and up to which a wheel's turn rate is judged.
        self._latest_ns: dict[str, float] = {}
        self._known_ns: dict[str, float] = {}

    def compared(self, results: list[RevolutionResult]) -> Iterator[tuple[RevolutionResult, bool]]:
        """Yield revolutions with the vehicle's signals and what these and the other wheels contradict.

        The time of the one that is yielded is the present of the alarms of its pair.

        Args:
            results: of any wheels. One without host time, as of a dump, has no other at its time.

        Yields:
            The result, and whether alarms of the pair begin or end with it.
        """
        if self._join is not None:
            results = [self._join.joined(result) for result in results]
        self._compare(results)
        yield from map(self._qualify, results)

    def _compare(self, results: Iterable[RevolutionResult]) -> None:
        for result in results:
            if not result.host_ns:
                continue
            self._axis_lags.compare(result)
            if self._turns is not None:
                self._turns.compare(result)
            revolution, conditions = result.revolution, result.conditions
            # An average that a revolution did not change is no further evidence, nor is one with gaps.
            is_evident = is_evidence(revolution)
            slips = result.estimates if is_evident else ()
            direction = next((e.value for e in slips if e.name in self._names and e.status is not Status.INVALID), 0.0)
            right = right_of(result.position)
            if right is not None:
                self._left_by_right[right] = result.position
            half_ns = 0.5e9 * revolution.period_s
            wheel_revolution = _WheelRevolution(
                result.host_ns,
                result.host_ns - half_ns,
                half_ns,
                0.0 if math.isnan(direction) else direction,
                conditions.radius_m * revolution.omega_radps if is_evident else math.nan,
                conditions.radius_m * revolution.omega_dot_radps2,
                math.hypot(conditions.radius_std_m / conditions.radius_m, conditions.claims.rate_std),
                *(next((e.value for e in result.estimates if e.name == n), math.nan) for n in (TURN_RATE, _BELT_SHIFT)),
            )
            self._pairs.setdefault(right or result.position, _Pair()).take(int(right is None), wheel_revolution)

    def _qualify(self, result: RevolutionResult) -> tuple[RevolutionResult, bool]:
        if not result.host_ns:
            return result, False
        position, known_ns = result.position, result.host_ns - _MAX_DELAY_NS
        result, is_changed = self._axis_lags.take(result, known_ns)
        previous_state = self._turn_alarm_state(position)
        self._known_ns[position] = max(self._known_ns.get(position, -math.inf), known_ns)
        is_changed |= self._turn_alarm_state(position) != previous_state
        estimates, contradictions = result.estimates, self._verdict(position, known_ns).contradictions
        sign, reversed_by = self._sign(position, known_ns)
        if sign > 0:
            estimates = verified(estimates)
        elif reversed_by is not None:
            estimates = provisional_where(estimates, Basis.SIGN, reversed_by)
        right = right_of(position) or position
        pair, left = self._pairs.get(right), self._left_by_right.get(right)
        if pair is not None and left is not None:
            previous_alarms = pair.verdict(self._latest_ns.get(right, -math.inf)).says
            self._latest_ns[right] = max(self._latest_ns.get(right, -math.inf), result.host_ns)
            is_changed |= pair.verdict(self._latest_ns[right]).says != previous_alarms
            verdict, is_right = pair.verdict(known_ns), position == right
            partner = left if is_right else right
            if verdict.opposite:
                estimates = provisional_where(estimates, Basis.SIGN, verdict.reason_of_slip(partner))
            contradictions = (*verdict.contradictions(partner, is_right=is_right), *contradictions)
        if contradictions:
            evidence = Evidence.of_contradictions(contradictions)
            estimates = tuple([evidence.qualified(estimate) for estimate in estimates])
        return result if estimates is result.estimates else replace(result, estimates=estimates), is_changed

    def _turn_alarm_state(self, position: str) -> tuple[object, ...]:
        """Return what changes the alarms of a wheel's turn rate."""
        known_ns = self._known_ns.get(position, -math.inf)
        verdict = self._verdict(position, known_ns)
        return self._sign(position, known_ns)[0], verdict.sign, [each.reason.code for each in verdict.contradictions]

    def _verdict(self, position: str, at_ns: float) -> Verdict:
        return NOTHING if self._turns is None else self._turns.verdict(position, at_ns)

    def _sign_by_speeds(self, position: str, at_ns: float) -> tuple[int, str]:
        """Return the sign of a lateral axis by its axle's speeds, and the other wheel; 0 where these do not show it."""
        right = right_of(position) or position
        left_wheel = self._left_by_right.get(right)
        if left_wheel is None or right not in self._pairs:
            return 0, ""
        return self._pairs[right].verdict(at_ns).signs[position == right], left_wheel if position == right else right

    def _sign(self, position: str, at_ns: float) -> tuple[int, Reason | None]:
        """Return the sign of a lateral axis as known at a time, 0 where it is open, and why it points to the right."""
        speed_sign, partner = self._sign_by_speeds(position, at_ns)
        if speed_sign:
            return speed_sign, Reason(TrustCode.LATERAL_AXIS_REVERSED, other=partner) if speed_sign < 0 else None
        verdict = self._verdict(position, at_ns)
        sign, witness = verdict.sign, verdict.by
        for wheel, side in verdict.sides.items() if not sign else ():
            sign = sign or side * (self._sign_by_speeds(wheel, at_ns)[0] or self._verdict(wheel, at_ns).sign)
        return sign, Reason(TrustCode.TURNS_OPPOSITE, witness=str(witness)) if sign < 0 else None

    def axis(self, position: str) -> Verdict:
        """Return what all curves so far say of a wheel's lateral axis, after the last result."""
        sign, reason = self._sign(position, math.inf)
        verdict = self._verdict(position, math.inf)
        return verdict._replace(sign=sign, reversed_by=reason)

    def alarms(self) -> Iterator[Alarm]:
        """Yield those of the vehicle's signals, of axes, and of wheels that turn, slip or roll apart."""
        if self._join is not None:
            yield from self._join.alarms()
        yield from self._axis_lags.alarms()
        for right, left in self._left_by_right.items():
            verdict = self._pairs[right].verdict(self._latest_ns.get(right, -math.inf))
            for position, partner, sign in ((left, right, verdict.signs[0]), (right, left, verdict.signs[1])):
                if sign < 0:
                    yield Alarm(position, ALARM, Reason(TrustCode.LATERAL_AXIS_REVERSED, other=partner))
                elif verdict.opposite:
                    yield Alarm(position, ALARM, verdict.reason_of_slip(partner))
                for contradiction in verdict.contradictions(partner, is_right=position == right):
                    yield Alarm(position, str(contradiction.subject), contradiction.reason)
        for position, known_ns in self._known_ns.items():
            turn_verdict, (_, reversed_by) = self._verdict(position, known_ns), self._sign(position, known_ns)
            speed_sign = self._sign_by_speeds(position, known_ns)[0]
            if reversed_by is not None and not speed_sign:
                yield Alarm(position, ALARM, reversed_by)
            if speed_sign * turn_verdict.sign < 0 and turn_verdict.by is Witness.YAW_RATE:
                yield Alarm(position, str(Subject.TURN_RATE), Reason(TrustCode.YAW_RATE_REVERSED))
            for contradiction in turn_verdict.contradictions:
                yield Alarm(position, str(contradiction.subject), contradiction.reason)
