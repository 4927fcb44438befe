"""Turn rates of the wheels of one vehicle, against each other and against what else shows how it turns.

All wheels of a body share its turn rate: that of a front wheel has the rate of steering too, whose mean over a curve is
zero. An axle's speeds give it by the track width, the vehicle's bus and a positioning receiver by themselves. So curves
show the sign and the gain of a lateral axis (`gateway.forces.curve_gain`), and which of several wheels disagrees.

What is compared depends on the times of the revolutions alone, not on the order in which they come.
"""

import bisect
import math
from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import combinations
from typing import Final, NamedTuple

from gateway.core.estimates.disagreement import CONTRADICTION
from gateway.core.estimates.estimator import Estimate, Status, is_evidence
from gateway.core.estimates.results import RevolutionResult
from gateway.core.quantity import Basis
from gateway.core.reasons import Reason
from gateway.core.trust.reasons import TrustCode
from gateway.core.trust.signal_evidence import Contradiction, Subject
from gateway.core.trust.turn_verdict import NOTHING, TURN_RATE, Gain, Verdict, Witness
from gateway.core.wheel_position import right_of
from gateway.forces.curve_gain import CurveGain, Rate, inverse
from gateway.forces.reasons import ForceCode

# Curves from which a gain is judged, and from which a wheel's sign follows from another's.
_CURVES, _FEW_CURVES = 8, 2
# Standard errors from which a sign is certain.
_SIGN: Final = 5.0
# Stated standard errors of a gain that are no contradiction.
_STATED: Final = 2.0
# Revolutions and changes of a verdict that are remembered.
_REMEMBERED, _CHANGES = 2, 64
# Gains of sensors, and what is left of the signal where a wheel turns as nothing else does.
_GAINS, _UNRELATED = (0.2, 5.0), 0.0
# Estimates of a revolution by the vehicle's signals, and the time by which they may be late.
_SIGNALS: Final = {Witness.YAW_RATE: ("yaw_rate_radps", 1.0), Witness.COURSE: ("course_rate_radps", 2.0)}
_COMPARED: Final = {TURN_RATE, *(name for name, _ in _SIGNALS.values())}


class _Read(NamedTuple):
    """A revolution of a wheel: times in ns, speed, turn rate, and the rates by the vehicle's signals."""

    end_ns: int
    position: str
    middle_ns: float
    period_ns: float
    speed_mps: float
    rate: Rate
    signals: Mapping[Witness, Rate]


@dataclass(slots=True)
class _Wheel:
    latest: deque[_Read] = field(default_factory=lambda: deque(maxlen=_REMEMBERED))
    signals: dict[Witness, CurveGain] = field(default_factory=dict)
    speeds: CurveGain | None = None
    gain_std: float = 0.0
    verdicts: deque[Verdict] = field(default_factory=lambda: deque((NOTHING,), maxlen=_CHANGES))


class SharedTurn:
    """Compares the turn rates of all wheels of a vehicle."""

    def __init__(self, tracks_m: Mapping[str, tuple[float, float]]) -> None:
        """Start without revolutions; `tracks_m` are track widths with their errors by position, as far as stated."""
        self._tracks = tracks_m
        self._wheels: dict[str, _Wheel] = {}
        self._pairs: dict[tuple[str, str], CurveGain] = {}
        self._waiting: list[_Read] = []

    def compare(self, result: RevolutionResult) -> None:
        """Compare a wheel's next revolution, if it has a turn rate."""
        rates = {each.name: each for each in result.estimates if each.name in _COMPARED}
        turn = rates.get(TURN_RATE)
        if turn is None or turn.status is Status.INVALID or not is_evidence(result.revolution):
            return
        wheel = self._wheels.setdefault(result.position, _Wheel())
        wheel.gain_std = result.conditions.lateral_gain_std
        period_ns = 1e9 * result.revolution.period_s
        read = _Read(
            result.host_ns,
            result.position,
            result.host_ns - 0.5 * period_ns,
            period_ns,
            result.conditions.radius_m * result.revolution.omega_radps,
            _rate(turn),
            {
                witness: _rate(rates[name])
                for witness, (name, _) in _SIGNALS.items()
                if name in rates and rates[name].status is not Status.INVALID
            },
        )
        bisect.insort(self._waiting, read, key=lambda each: (each.end_ns, each.position))

    def verdict(self, position: str, known_ns: float) -> Verdict:
        """Return what is known of a wheel by what has come up to a time, and compare that."""
        if self._waiting and self._waiting[0].end_ns <= known_ns:
            count = bisect.bisect_right(self._waiting, known_ns, key=lambda each: each.end_ns)
            due, self._waiting = self._waiting[:count], self._waiting[count:]
            for read in due:
                if self._take(read):
                    self._judge(read.end_ns)
        wheel = self._wheels.get(position)
        verdicts = reversed(wheel.verdicts) if wheel is not None else ()
        return next((verdict for verdict in verdicts if verdict.at_ns <= known_ns), NOTHING)

    def _take(self, read: _Read) -> bool:
        """Compare a revolution with those before it; return whether a curve ended."""
        wheel, at_s, period_s = self._wheels[read.position], 1e-9 * read.middle_ns, 1e-9 * read.period_ns
        ended = False
        for witness, rate in read.signals.items():
            if witness not in wheel.signals:
                wheel.signals[witness] = CurveGain(_SIGNALS[witness][1])
            ended |= wheel.signals[witness].take(at_s, period_s, read.rate, rate, read.speed_mps)
        for position, peer in self._wheels.items():
            for latest in peer.latest if position != read.position else ():
                if abs(latest.middle_ns - read.middle_ns) < 0.5 * min(latest.period_ns, read.period_ns):
                    ended |= self._take_both(*sorted((latest, read), key=lambda each: each.position))
        wheel.latest.append(read)
        return ended

    def _take_both(self, first: _Read, second: _Read) -> bool:
        at_s, period_s = 1e-9 * first.middle_ns, 1e-9 * first.period_ns
        pair = first.position, second.position
        if pair not in self._pairs:
            self._pairs[pair] = CurveGain()
        ended = self._pairs[pair].take(at_s, period_s, first.rate, second.rate, first.speed_mps)
        for a, b in ((first, second), (second, first)):
            if right_of(a.position) == b.position:
                by_speeds = Rate(b.speed_mps / a.speed_mps - 1.0, 0.0)
                for read in (a, b):
                    wheel = self._wheels[read.position]
                    wheel.speeds = wheel.speeds or CurveGain(by_speeds=True)
                    ended |= wheel.speeds.take(at_s, period_s, read.rate, by_speeds, a.speed_mps)
        return ended

    def _judge(self, at_ns: int) -> None:
        """Judge all wheels anew."""
        absolute = {position: dict(self._absolute(position)) for position in self._wheels}
        for position, wheel in self._wheels.items():
            by_speeds = Gain() if wheel.speeds is None else wheel.speeds.gain
            sides = {
                peer: int(math.copysign(1.0, gain.value))
                for peer, gain in self._peers(position)
                if gain.curves >= _FEW_CURVES and abs(gain.value) > _SIGN * gain.std
            }
            signs = [
                (int(math.copysign(1.0, gain.value)), witness)
                for witness, gain in absolute[position].items()
                if witness is not Witness.TRACK and abs(gain.value) > _SIGN * gain.std
            ]
            sign, by = signs[0] if signs else (0, Witness.WHEELS)
            settled = {witness: gain for witness, gain in absolute[position].items() if gain.curves >= _CURVES}
            gain_by = min(settled, key=lambda witness: settled[witness].std, default=None)
            verdict = Verdict(
                at_ns,
                sign,
                by,
                Reason(TrustCode.TURNS_OPPOSITE, witness=str(by)) if sign < 0 else None,
                sides=sides,
                gain=settled[gain_by] if gain_by is not None else Gain(),
                gain_by=gain_by,
                track_m=inverse(by_speeds) if by_speeds.curves >= _CURVES else Gain(),
                contradictions=tuple(self._contradictions(position, settled)),
            )
            if verdict._replace(at_ns=0.0) != wheel.verdicts[-1]._replace(at_ns=0.0):
                wheel.verdicts.append(verdict)

    def _absolute(self, position: str) -> Iterator[tuple[Witness, Gain]]:
        """Yield the gains of a wheel by what is no other wheel's axis."""
        wheel, track = self._wheels[position], self._tracks.get(position)
        for witness, signal in wheel.signals.items():
            if signal.gain.curves:
                yield witness, signal.gain
        if track is not None and wheel.speeds is not None and wheel.speeds.gain.curves:
            gain = wheel.speeds.gain
            std = math.hypot(track[0] * gain.std, gain.value * track[1])
            yield Witness.TRACK, gain._replace(value=track[0] * gain.value, std=std)

    def _peers(self, position: str) -> Iterator[tuple[str, Gain]]:
        """Yield the gains of a wheel over those of the others."""
        for (first, second), gain in self._pairs.items():
            if position == first:
                yield second, gain.gain
            elif position == second:
                yield first, inverse(gain.gain)

    def _contradictions(self, position: str, settled: Mapping[Witness, Gain]) -> Iterator[Contradiction]:
        """Yield the contradictions of a wheel's gain: by what is no axis, else by the other wheels."""
        stated_std = self._wheels[position].gain_std
        refuted = [(witness, gain) for witness, gain in settled.items() if _refutes(gain, stated_std)]
        for witness, gain in refuted:
            yield contradiction_of(gain, witness)
        if settled:
            return
        apart = {peer: gain for peer, gain in self._peers(position) if self._are_apart(position, peer)}
        agreed = not any(self._are_apart(*both) for both in combinations(apart, 2))
        if len(apart) >= _FEW_CURVES and agreed:
            closest = min(apart.values(), key=lambda gain: gain.std)
            yield contradiction_of(closest, Witness.WHEELS)
            return
        for peer, gain in apart.items():
            # One that disagrees with several is the one at fault.
            if sum(self._are_apart(peer, each) for each in self._wheels if each != peer) > 1 or not agreed:
                continue
            reason = Reason(ForceCode.WHEELS_TURN_APART, other=peer, ratio=abs(gain.value), std=gain.std)
            yield Contradiction(Subject.TURN_RATE, reason, {Basis.AXES: abs(gain.value)})

    def _are_apart(self, position: str, peer: str) -> bool:
        gain = next((gain for name, gain in self._peers(position) if name == peer), Gain())
        stated_std = math.hypot(self._wheels[position].gain_std, self._wheels[peer].gain_std)
        return gain.curves >= _CURVES and _refutes(gain, stated_std)


def _rate(estimate: Estimate) -> Rate:
    return Rate(estimate.value, estimate.std)


def _is_related(gain: Gain) -> bool:
    """Return whether a wheel turns as a witness does but for a gain that a sensor may have."""
    return gain.is_related and _GAINS[0] < abs(gain.value) < _GAINS[1]


def _refutes(gain: Gain, stated_std: float) -> bool:
    beyond = abs(abs(gain.value) - 1.0)
    return not _is_related(gain) or beyond > max(CONTRADICTION * gain.std, _STATED * stated_std)


def contradiction_of(gain: Gain, witness: Witness) -> Contradiction:
    """Return the contradiction of a wheel's turn rate to a witness."""
    if not _is_related(gain):
        reason = Reason(ForceCode.TURNS_UNRELATED, witness=str(witness))
        return Contradiction(Subject.TURN_RATE, reason, {Basis.AXES: _UNRELATED})
    reason = Reason(ForceCode.LATERAL_GAIN_CONTRADICTED, gain=abs(gain.value), std=gain.std, witness=str(witness))
    return Contradiction(Subject.TURN_RATE, reason, {Basis.AXES: abs(gain.value)})
