"""Gain of a lateral axis by curves: the angle that a wheel turns through by its axis, over that by a witness.

A curve is summed from straight to straight, so that what is late by some seconds, or a front wheel that steers, adds
nothing. Zeros of both, such as belt radii that are not as stated, are their means on the straights between.
"""

import math
from collections import deque
from typing import Final, NamedTuple

import numpy as np

from gateway.core.trust.turn_verdict import Gain
from gateway.core.types import FloatArray

# Standard errors from which a revolution turns.
_SIGN_STDS: Final = 4.0
# Time below that ends a curve, the least and the longest of a curve, and the longest between two revolutions.
_QUIET_S, _MIN_S, _MAX_S, _GAP_S = 0.4, 0.8, 60.0, 1.0
# Scatter of the ratio of an axle's speeds.
_RATIO_STD: Final = 1.5e-3
# Straight revolutions whose mean is zero, and the fewest.
_ZERO_REVOLUTIONS, _MIN_STRAIGHT = 100, 10
# Curves that are kept, and those whose scatter says something.
_CURVES, _FEW_CURVES = 64, 5
# Of a curve: angles by wheel and witness, their errors, time, speed squared, and what the zero of the witness counts.
_SUMS: Final = 7
# Error of the angle of a curve beyond that stated: one that is the same in no other.
_OWN_STD: Final = 0.04
# Scatter of curves over their errors at least: on random tires of finite elements it is 0.45.
_MIN_SCATTER: Final = 0.5
# Share of the error of a turn rate that all curves have in common, by the tire's factor of side force, and the latest
# curves that it is read from: with it, gains of wheels with six such tires are 1.1 errors off rms, 3.0 at most.
_COMMON, _LATEST = 0.4, 3
# The outer wheel, with more load, rolls with a smaller radius: change of the ratio of the speeds with the lateral
# acceleration over the track, s^2/m^2. Of car tires by data of their rolling radii and heights of centers of gravity.
_BY_LOAD: Final = (4e-4, 3e-4)
_LOADS: Final[FloatArray] = _BY_LOAD[0] + _BY_LOAD[1] * np.linspace(-3.0, 3.0, 13)


class Rate(NamedTuple):
    """Rate at which something turns, with its standard error; NaN without one."""

    radps: float = math.nan
    std_radps: float = math.nan

    @property
    def side(self) -> float:
        """1 in a curve to the left, -1 in one to the right, 0 elsewhere."""
        return math.copysign(1.0, self.radps) if abs(self.radps) > _SIGN_STDS * self.std_radps else 0.0


def inverse(gain: Gain) -> Gain:
    """Return the witness over the wheel."""
    if not gain.value:
        return gain._replace(value=math.nan)
    return gain._replace(value=1.0 / gain.value, std=gain.std / gain.value**2)


class CurveGain:
    """Turn rate of a wheel over that of a witness, by the curves of a drive; deterministic."""

    def __init__(self, late_s: float = 0.0, *, by_speeds: bool = False) -> None:
        """Start without a curve.

        Args:
            late_s: time by which the witness may be late.
            by_speeds: whether the witness is what the ratio of an axle's speeds has beyond 1, right over left, whatever
                its unit; the gain is then over the track, 1/m.
        """
        self._late_s, self._by_speeds = late_s, by_speeds
        self._last_s = -math.inf
        self._pending: deque[tuple[float, ...]] = deque()
        self._pending_s = 0.0
        self._zeros, self._straights = (0.0, 0.0), 0
        self._sums, self._turns_s, self._quiet_s, self._sides = np.zeros(_SUMS), 0.0, 0.0, [0.0, 0.0]
        self._is_mixed = False
        self._curves: deque[FloatArray] = deque(maxlen=_CURVES)
        self.gain = Gain()

    def take(self, at_s: float, period_s: float, read: Rate, witness: Rate, speed_mps: float) -> bool:
        """Add a revolution; return whether a curve ended. Values that are not finite are ignored."""
        if not math.isfinite(read.radps * read.std_radps * witness.radps):
            return False
        has_ended = False
        if at_s - self._last_s > _GAP_S:
            self._sums, self._turns_s = np.zeros(_SUMS), 0.0
            self._forget_straight()
        self._last_s = at_s
        scale = speed_mps if self._by_speeds else 1.0
        values = (
            period_s * read.radps,
            period_s * scale * witness.radps,
            period_s * read.std_radps,
            period_s * witness.std_radps,
            period_s,
            period_s * speed_mps**2,
            period_s * scale,
        )
        sides = [read.side, witness.side]
        if self._by_speeds:
            has_zero = self._straights >= _MIN_STRAIGHT
            sides[1] = Rate(witness.radps - self._zeros[1], _RATIO_STD).side if has_zero else 0.0
        if any(sides) or self._turns_s:
            if self._turns_s and any(side * previous < 0.0 for side, previous in zip(sides, self._sides, strict=True)):
                # What a late witness has of one curve is in the next one.
                is_mixed = self._late_s > 0.0
                has_ended = self._end_curve(is_mixed=is_mixed)
                self._begin_curve(is_mixed=is_mixed)
            elif not self._turns_s:
                self._begin_curve()
            self._sides = [side or previous for side, previous in zip(sides, self._sides, strict=True)]
            self._sums = self._sums + np.array(values)
            self._turns_s += period_s if any(sides) else 0.0
            # A late witness turns on.
            side = sides[0] if self._sides[0] else sides[1]
            self._quiet_s = 0.0 if side else self._quiet_s + period_s
            if self._quiet_s >= max(_QUIET_S, self._late_s):
                has_ended = self._end_curve()
            elif self._sums[4] > _MAX_S:
                # A roundabout, or a zero that has changed.
                self._turns_s, self._straights = 0.0, 0
        else:
            self._go_straight(values)
        return has_ended

    def _go_straight(self, values: tuple[float, ...]) -> None:
        self._pending.append(values)
        self._pending_s += values[4]
        while self._pending and self._pending_s > self._late_s:
            angle, witness, _, _, duration_s, _, scaled_s = self._pending.popleft()
            self._pending_s -= duration_s
            self._straights += 1
            weight = 1.0 / min(self._straights, _ZERO_REVOLUTIONS)
            rate_zero, witness_zero = self._zeros
            rate_zero += weight * (angle / duration_s - rate_zero)
            self._zeros = rate_zero, witness_zero + weight * (witness / scaled_s - witness_zero)

    def _forget_straight(self) -> None:
        self._pending.clear()
        self._pending_s = 0.0

    def _begin_curve(self, *, is_mixed: bool = False) -> None:
        self._sums, self._sides = sum(map(np.array, self._pending), np.zeros(_SUMS)), [0.0, 0.0]
        self._forget_straight()
        self._quiet_s, self._is_mixed = 0.0, is_mixed

    def _end_curve(self, *, is_mixed: bool = False) -> bool:
        """Take the curve that ends, unless it is mixed with another one; return whether it was taken."""
        sums, turns_s, self._turns_s = self._sums, self._turns_s, 0.0
        if is_mixed or self._is_mixed:
            return False
        # Rates by signals have zeros within their errors.
        if turns_s < _MIN_S or (self._by_speeds and self._straights < _MIN_STRAIGHT):
            return False
        sums[:2] -= self._zeros * sums[[4, 6]]
        self._curves.append(sums)
        self.gain = self._fitted(np.array(self._curves))
        return True

    def _fitted(self, curves: FloatArray) -> Gain:
        """Return the gain by curves, (n, 7) sums over the time of each."""
        angle, witness, angle_std, witness_std, durations_s, squares, _ = curves.T
        variances = angle_std**2 + witness_std**2 + (_OWN_STD * np.maximum(np.abs(angle), _OWN_STD)) ** 2
        # Share of the witness in the errors: the line lies between both regressions (Deming).
        share = float(np.sum(witness_std**2 / variances) / np.sum(angle_std**2 / variances + 1e-12))
        loads, odds, values, stds = (_LOADS if self._by_speeds else np.zeros(1)), [], [], []
        for load in loads:
            model = witness / (1.0 + load * squares / durations_s)
            rr, ww, rw = (float(np.sum(a * b / variances)) for a, b in ((angle, angle), (model, model), (angle, model)))
            if not ww or not rw:
                return Gain(curves=len(curves))
            excess = share * rr - ww
            value = rw / ww if not share else (excess + math.sqrt(excess**2 + 4.0 * share * rw**2)) / (2.0 * share * rw)
            misfit = float(np.sum((angle - value * model) ** 2 / variances))
            values.append(value)
            scatter = 1.0 if len(curves) < _FEW_CURVES else max(math.sqrt(misfit / (len(curves) - 1)), _MIN_SCATTER)
            stds.append(scatter / math.sqrt(ww))
            odds.append(-0.5 * ((load - _BY_LOAD[0]) / _BY_LOAD[1]) ** 2 - 0.5 * misfit)
        weights = np.exp(np.array(odds) - max(odds))
        weights /= weights.sum()
        mean = float(weights @ values)
        std = math.sqrt(float(weights @ (np.square(stds) + np.square(np.array(values) - mean))))
        latest = curves[-_LATEST:]
        common = _COMMON * latest[:, 2:4].sum(axis=0) / (np.abs(latest[:, :2]).sum(axis=0) + 1e-9)
        std = math.hypot(std, mean * common[0], mean * common[1] if not self._by_speeds else 0.0)
        correlation = float(np.sum(angle * witness)) / math.sqrt(float(np.sum(angle**2) * np.sum(witness**2)))
        return Gain(mean, std, len(curves), abs(correlation) > 0.5)
