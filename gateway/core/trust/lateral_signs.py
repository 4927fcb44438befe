"""Sign of the lateral axes of two wheels of an axle, by curves.

In a curve the outer wheel rolls faster:
V_right - V_left = turn rate times track, and the turn rate has the sign of the lateral axis it is read from. So the
ratio of the speeds rises with the curvature that either wheel reads, by the track, or falls where its axis points to
the right. Belt radii that are not as stated are in the constant of that line, and rolling radii that change with the
load make its slope larger only.

The side force that holds a car in its curve shows the same, before the tire's own share of a turn rate is known: the
belt's shift to the left rises with that ratio too.
"""

import math
from typing import Final

_MIN_REVOLUTIONS: Final = 30
# Correlation that the line must have, and its standard errors from none: errors last for some revolutions.
_CORRELATION: Final = 0.35
_CORRELATION_ERRORS: Final = 6.0
# Tracks from karts to mining trucks, with what loads change of rolling radii.
_TRACKS_M: Final = (0.5, 8.0)
# Revolutions within which a shift is compared: tires warm up, and lose pressure.
_SHIFT_REVOLUTIONS: Final = 256
# Latest revolutions that may refute the sign of all.
_REFUTING_REVOLUTIONS: Final = 256


class _Line:
    """Line through the ratio of two wheels' speeds over the curvature, or the belt's shift, that one of them reads."""

    def __init__(self, slopes: tuple[float, float], memory: float) -> None:
        """Start without revolutions.

        Args:
            slopes: amounts between which its slope may be.
            memory: revolutions that means are of.
        """
        self.count, self._slopes, self._memory = 0, slopes, memory
        self._means, self._squares, self._product = (0.0, 0.0), (0.0, 0.0), 0.0

    def take(self, *values: float) -> None:
        """Add a revolution: curvature or shift, and what the ratio of the speeds has beyond 1."""
        self.count += 1
        changes = tuple(value - mean for value, mean in zip(values, self._means, strict=True))
        weight = 1.0 / min(self.count, self._memory)
        self._means = (self._means[0] + weight * changes[0], self._means[1] + weight * changes[1])
        retained = 1.0 - weight
        self._squares = (self._squares[0] + retained * changes[0] ** 2, self._squares[1] + retained * changes[1] ** 2)
        self._product += retained * changes[0] * changes[1]

    @property
    def sign(self) -> int:
        """1 where the axis points to the left, -1 where it points to the right, 0 where no curve has shown it."""
        scale = math.sqrt(self._squares[0] * self._squares[1])
        if self.count < _MIN_REVOLUTIONS or not scale:
            return 0
        square = (self._product / scale) ** 2
        if square < max(_CORRELATION**2, _CORRELATION_ERRORS**2 * (1.0 - square) / self.count):
            return 0
        slope = self._product / self._squares[0]
        return int(math.copysign(1.0, slope)) if self._slopes[0] < abs(slope) < self._slopes[1] else 0


class _Lines:
    """A line through `every` revolution, and one through the latest ones, which may contradict it."""

    def __init__(self, slopes: tuple[float, float], memory: float) -> None:
        self._line_parameters = slopes, memory
        self.every, self._latest = _Line(*self._line_parameters), _Line(*self._line_parameters)

    def take(self, value: float, ratio: float) -> None:
        """Add a revolution; values that are not finite are ignored."""
        if not math.isfinite(value * ratio):
            return
        for line in (self.every, self._latest):
            line.take(value, ratio - 1.0)
        if self._latest.count == _REFUTING_REVOLUTIONS:
            if self._latest.sign * self.every.sign < 0:
                self.every = self._latest
            self._latest = _Line(*self._line_parameters)


class LateralSign:
    """Sign of a lateral axis by the turn rate and by the belt's shift; the latest revolutions may refute the others."""

    def __init__(self) -> None:
        self._by_turn, self._by_shift = _Lines(_TRACKS_M, math.inf), _Lines((0.0, math.inf), _SHIFT_REVOLUTIONS)

    def take(self, rate_radps: float, speed_mps: float, ratio: float, shift_m: float = math.nan) -> None:
        """Add a revolution; `ratio` is the speed at right over that at left. Values that are not finite are ignored."""
        if speed_mps > 0.0:
            self._by_turn.take(rate_radps / speed_mps, ratio)
            self._by_shift.take(shift_m, ratio)

    @property
    def sign(self) -> int:
        """1 where the axis points to the left, -1 where it points to the right, 0 where no curve has shown it."""
        by_turn, by_shift = self._by_turn.every.sign, self._by_shift.every.sign
        return 0 if by_turn * by_shift < 0 else by_turn or by_shift
