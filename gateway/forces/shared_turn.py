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
_STATED_STDS: Final = 2.0
# Revolutions and changes of a verdict that are remembered.
_REMEMBERED, _CHANGES = 2, 64
# Gains of sensors, and what is left of the signal where a wheel turns as nothing else does.
_GAINS, _UNRELATED = (0.2, 5.0), 0.0
# Estimates of a revolution by the vehicle's signals, and the time by which they may be late.
_SIGNALS: Final = {Witness.YAW_RATE: ("yaw_rate_radps", 1.0), Witness.COURSE: ("course_rate_radps", 2.0)}
_COMPARED: Final = {TURN_RATE, *(name for name, _ in _SIGNALS.values())}


class _Reading(NamedTuple):
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
    latest: deque[_Reading] = field(default_factory=lambda: deque(maxlen=_REMEMBERED))
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
        self._waiting: list[_Reading] = []

    def compare(self, result: RevolutionResult) -> None:
        """Compare a wheel's next revolution, if it has a turn rate."""
        rates = {estimate.name: estimate for estimate in result.estimates if estimate.name in _COMPARED}
        turn_rate = rates.get(TURN_RATE)
        if turn_rate is None or turn_rate.status is Status.INVALID or not is_evidence(result.revolution):
            return
        wheel = self._wheels.setdefault(result.position, _Wheel())
        wheel.gain_std = result.conditions.lateral_gain_std
        period_ns = 1e9 * result.revolution.period_s
        reading = _Reading(
            result.host_ns,
            result.position,
            result.host_ns - 0.5 * period_ns,
            period_ns,
            result.conditions.radius_m * result.revolution.omega_radps,
            _rate(turn_rate),
            {
                witness: _rate(rates[name])
                for witness, (name, _) in _SIGNALS.items()
                if name in rates and rates[name].status is not Status.INVALID
            },
        )
        bisect.insort(self._waiting, reading, key=lambda entry: (entry.end_ns, entry.position))

    def verdict(self, position: str, known_ns: float) -> Verdict:
        """Return what is known of a wheel by what has come up to a time, and compare that."""
        if self._waiting and self._waiting[0].end_ns <= known_ns:
            count = bisect.bisect_right(self._waiting, known_ns, key=lambda entry: entry.end_ns)
            ready, self._waiting = self._waiting[:count], self._waiting[count:]
            for reading in ready:
                if self._take(reading):
                    self._judge(reading.end_ns)
        wheel = self._wheels.get(position)
        verdicts = reversed(wheel.verdicts) if wheel is not None else ()
        return next((verdict for verdict in verdicts if verdict.at_ns <= known_ns), NOTHING)

    def _take(self, reading: _Reading) -> bool:
        """Compare a revolution with those before it; return whether a curve ended."""
        wheel, time_s, period_s = self._wheels[reading.position], 1e-9 * reading.middle_ns, 1e-9 * reading.period_ns
        has_ended = False
        for witness, rate in reading.signals.items():
            if witness not in wheel.signals:
                wheel.signals[witness] = CurveGain(_SIGNALS[witness][1])
            has_ended |= wheel.signals[witness].take(time_s, period_s, reading.rate, rate, reading.speed_mps)
        for position, peer in self._wheels.items():
            for latest in peer.latest if position != reading.position else ():
                if abs(latest.middle_ns - reading.middle_ns) < 0.5 * min(latest.period_ns, reading.period_ns):
                    has_ended |= self._compare_pair(*sorted((latest, reading), key=lambda entry: entry.position))
        wheel.latest.append(reading)
        return has_ended

    def _compare_pair(self, first: _Reading, second: _Reading) -> bool:
        time_s, period_s = 1e-9 * first.middle_ns, 1e-9 * first.period_ns
        pair = first.position, second.position
        if pair not in self._pairs:
            self._pairs[pair] = CurveGain()
        has_ended = self._pairs[pair].take(time_s, period_s, first.rate, second.rate, first.speed_mps)
        for a, b in ((first, second), (second, first)):
            if right_of(a.position) == b.position:
                by_speeds = Rate(b.speed_mps / a.speed_mps - 1.0, 0.0)
                for reading in (a, b):
                    wheel = self._wheels[reading.position]
                    wheel.speeds = wheel.speeds or CurveGain(by_speeds=True)
                    has_ended |= wheel.speeds.take(time_s, period_s, reading.rate, by_speeds, a.speed_mps)
        return has_ended

    def _judge(self, time_ns: int) -> None:
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
            sign, sign_witness = signs[0] if signs else (0, Witness.WHEELS)
            settled = {witness: gain for witness, gain in absolute[position].items() if gain.curves >= _CURVES}
            gain_by = min(settled, key=lambda witness: settled[witness].std, default=None)
            verdict = Verdict(
                time_ns,
                sign,
                sign_witness,
                Reason(TrustCode.TURNS_OPPOSITE, witness=str(sign_witness)) if sign < 0 else None,
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
        differing = {peer: gain for peer, gain in self._peers(position) if self._are_apart(position, peer)}
        is_agreed = not any(self._are_apart(*pair) for pair in combinations(differing, 2))
        if len(differing) >= _FEW_CURVES and is_agreed:
            closest = min(differing.values(), key=lambda gain: gain.std)
            yield contradiction_of(closest, Witness.WHEELS)
            return
        for peer, gain in differing.items():
            # One that disagrees with several is the one at fault.
            if sum(self._are_apart(peer, wheel) for wheel in self._wheels if wheel != peer) > 1 or not is_agreed:
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
    excess = abs(abs(gain.value) - 1.0)
    return not _is_related(gain) or excess > max(CONTRADICTION * gain.std, _STATED_STDS * stated_std)


def contradiction_of(gain: Gain, witness: Witness) -> Contradiction:
    """Return the contradiction of a wheel's turn rate to a witness."""
    if not _is_related(gain):
        reason = Reason(ForceCode.TURNS_UNRELATED, witness=str(witness))
        return Contradiction(Subject.TURN_RATE, reason, {Basis.AXES: _UNRELATED})
    reason = Reason(ForceCode.LATERAL_GAIN_CONTRADICTED, gain=abs(gain.value), std=gain.std, witness=str(witness))
    return Contradiction(Subject.TURN_RATE, reason, {Basis.AXES: abs(gain.value)})
