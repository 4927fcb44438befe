"""Sign of the lateral axes of two wheels of an axle, by curves.

In a curve the outer wheel rolls faster:
V_right - V_left = turn rate times track, and the turn rate has the sign of the lateral axis it is read from. So the
ratio of the speeds rises with the curvature that either wheel reads, by the track, or falls where its axis points to
the right. Belt radii that are not as stated are in the constant of that line, and rolling radii that change with the
load make its slope larger only.
"""

import math
from typing import Final

_LEAST: Final = 30
# Correlation that the line must have, and its standard errors from none: errors last for some revolutions.
_CORRELATION: Final = 0.35
_ERRORS: Final = 6.0
# Tracks from karts to mining trucks, with what loads change of rolling radii.
_TRACKS_M: Final = (0.5, 8.0)
# Latest revolutions that may refute the sign of all.
_REFUTING: Final = 256


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
