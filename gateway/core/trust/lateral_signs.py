"""Sign and gain of the lateral axes of two wheels of an axle, by curves.

In a curve the outer wheel rolls faster.

V_right - V_left = turn rate times track, and the turn rate has the sign of the lateral axis it is read from. So the
ratio of the speeds rises with the curvature that either wheel reads, by the track, or falls where its axis points to
the right. Belt radii that are not as stated are in the constant of that line, and rolling radii that change with the
load make its slope larger only.

Both wheels have one turn rate, that of their body. Where they read different ones, the lateral gain of one of them is
wrong, or it stands elsewhere. A load changes rolling radii by as much as a gain would, so the track gives no gain.
"""

import math
from collections import deque
from typing import Final, NamedTuple

from gateway.core.estimates.disagreement import CONTRADICTION

TURN_RATE: Final = "turn_rate_radps"
"""Quantity of a revolution that has the sign of the lateral axis."""

_LEAST: Final = 30
# Correlation that the line must have, and its standard errors from none: errors last for some revolutions.
_CORRELATION: Final = 0.35
_ERRORS: Final = 6.0
# Tracks from karts to mining trucks, with what loads change of rolling radii.
_TRACKS_M: Final = (0.5, 8.0)
# Latest revolutions that may refute the sign of all.
_REFUTING: Final = 256
# Curves that are compared, and standard errors of a turn rate from which it is one.
_CURVES: Final = 8
_COMPARED: Final = 64
_TURNS: Final = 4.0
# Revolutions of a curve.
_LASTS: Final = 8


class Rate(NamedTuple):
    """Turn rate that a wheel reads, with its standard error; NaN without one."""

    radps: float = math.nan
    std_radps: float = math.nan


class _Line:
    """Line through the ratio of two wheels' speeds over the curvature that one of them reads."""

    def __init__(self) -> None:
        self.count = 0
        self._means, self._squares, self._product = (0.0, 0.0), (0.0, 0.0), 0.0

    def take(self, *values: float) -> None:
        """Add a revolution: curvature, and what the ratio of the speeds has beyond 1."""
        self.count += 1
        changes = tuple(value - mean for value, mean in zip(values, self._means, strict=True))
        share = 1.0 / self.count
        self._means = (self._means[0] + share * changes[0], self._means[1] + share * changes[1])
        weight = 1.0 - share
        self._squares = (self._squares[0] + weight * changes[0] ** 2, self._squares[1] + weight * changes[1] ** 2)
        self._product += weight * changes[0] * changes[1]

    @property
    def sign(self) -> int:
        """1 where the axis points to the left, -1 where it points to the right, 0 where no curve has shown it."""
        scale = math.sqrt(self._squares[0] * self._squares[1])
        if self.count < _LEAST or not scale:
            return 0
        square = (self._product / scale) ** 2
        if square < max(_CORRELATION**2, _ERRORS**2 * (1.0 - square) / self.count):
            return 0
        track_m = self._product / self._squares[0]
        return int(math.copysign(1.0, track_m)) if _TRACKS_M[0] < abs(track_m) < _TRACKS_M[1] else 0


class LateralSign:
    """Sign of a lateral axis by all revolutions, or by the latest ones where these contradict them."""

    def __init__(self) -> None:
        self._every, self._latest = _Line(), _Line()

    def take(self, rate_radps: float, speed_mps: float, ratio: float) -> None:
        """Add a revolution; `ratio` is the speed at right over that at left. Values that are not finite are ignored."""
        if not (math.isfinite(rate_radps * ratio) and speed_mps > 0.0):
            return
        for line in (self._every, self._latest):
            line.take(rate_radps / speed_mps, ratio - 1.0)
        if self._latest.count == _REFUTING:
            if self._latest.sign * self._every.sign < 0:
                self._every = self._latest
            self._latest = _Line()

    @property
    def sign(self) -> int:
        """1 where the axis points to the left, -1 where it points to the right, 0 where no curve has shown it."""
        return self._every.sign


class LateralGain:
    """Turn rate that the right wheel reads over that of the left one, by the means of curves.

    Within a curve, the errors of a turn rate last.
    """

    def __init__(self) -> None:
        self._curves: deque[tuple[float, float]] = deque(maxlen=_COMPARED)
        self._count, self._sums = 0, (0.0, 0.0, 0.0)

    def take(self, left: Rate, right: Rate) -> None:
        """Add a revolution of both; rates that are not finite are ignored."""
        rate, std = 0.5 * (left.radps + right.radps), math.hypot(left.std_radps, right.std_radps)
        if not (math.isfinite(rate) and math.isfinite(std)):
            return
        if abs(rate) > _TURNS * 0.5 * std and rate * self._sums[0] >= 0.0:
            self._count += 1
            total, difference, error = self._sums
            self._sums = total + rate, difference + right.radps - left.radps, error + std
            return
        if self._count >= _LASTS:
            total, difference, error = self._sums
            self._curves.append((difference / total, error / abs(total)))
        self._count, self._sums = 0, (0.0, 0.0, 0.0)

    @property
    def apart(self) -> tuple[float, float]:
        """Ratio of right over left and its standard error where curves contradict 1, NaN where they do not."""
        count = len(self._curves)
        if count < _CURVES:
            return math.nan, math.nan
        mean = math.fsum(curve for curve, _ in self._curves) / count
        scatter = math.sqrt(math.fsum((curve - mean) ** 2 for curve, _ in self._curves) / (count - 1))
        error = math.sqrt(math.fsum(std**2 for _, std in self._curves) / count)
        std = max(scatter, error) / math.sqrt(count)
        # Of the difference over the mean; axes that point apart have no ratio.
        if not CONTRADICTION * std < abs(mean) < 1.5:
            return math.nan, math.nan
        ratio = (2.0 + mean) / (2.0 - mean)
        return ratio, std * ratio
