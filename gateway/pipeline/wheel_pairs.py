"""Comparison of the left and the right wheel of an axle: they slip to the same side at a time.

Steering, side wind and a banked road turn or push both wheels to one side. What differs between them, toe and ply
steer, is constant, and so part of the zero that each wheel's slip is counted from. A wheel that slips to the right
whenever the other slips to the left has a lateral axis that points the other way, or a position that is another's.
One wheel alone cannot show that.
"""

import math
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Final

from gateway.estimators.estimator import Status
from gateway.pipeline.results import Alarm, RevolutionResult
from gateway.quantity_catalogue import declared
from gateway.reasons import Code, Reason
from gateway.wheel_position import right_of

ALARM: Final = "lateral axis"
"""Name of the alarm of a pair."""

# A block of one wheel's revolutions may come before those of the other wheel.
_WAITING: Final = 256
# Pairs of revolutions, each of which is beyond three errors at both wheels, and the share that must be opposite. A
# wheel that meets a kerb or a puddle alone is one of few.
_LEAST: Final = 8
_OPPOSITE: Final = 0.8


@dataclass(slots=True)
class _Pair:
    """A left and a right wheel.

    Attributes:
        waiting: middle of the revolution, ns, half its period, ns, and direction of the latest, by side.
        same: pairs of revolutions with slip to the same side.
        opposite: pairs with slip to opposite sides.
    """

    waiting: tuple[deque[tuple[float, float, float]], deque[tuple[float, float, float]]] = field(
        default_factory=lambda: (deque(maxlen=_WAITING), deque(maxlen=_WAITING))
    )
    same: int = 0
    opposite: int = 0

    def take(self, side: int, middle_ns: float, half_ns: float, direction: float) -> None:
        """Compare a revolution with that of the other wheel at its time."""
        for other_ns, other_half_ns, other in self.waiting[1 - side]:
            if abs(other_ns - middle_ns) < min(half_ns, other_half_ns):
                self.same += other == direction
                self.opposite += other != direction
        self.waiting[side].append((middle_ns, half_ns, direction))

    @property
    def is_opposite(self) -> bool:
        """Whether one of them has its sign wrong."""
        count = self.same + self.opposite
        return count >= _LEAST and self.opposite > _OPPOSITE * count


class WheelPairs:
    """Compares the wheels of one vehicle; in whatever order their revolutions come, the same ones are compared."""

    def __init__(self, witnesses: Callable[[], Iterable[Alarm]] = tuple) -> None:
        """Start without revolutions; `witnesses` returns the alarms of what the vehicle's signals contradict."""
        self._witnesses = witnesses
        self._pairs: dict[str, _Pair] = {}
        self._lefts: dict[str, str] = {}
        self._names = frozenset(quantity.name for quantity in declared() if quantity.is_of_axle)

    def take(self, result: RevolutionResult) -> bool:
        """Take a revolution of any wheel; one without host time, as of a dump, has no other at its time.

        Returns:
            Whether the alarms of its pair begin or end with it.
        """
        if not result.host_ns:
            return False
        direction = next(
            (e.value for e in result.estimates if e.name in self._names and e.status is not Status.INVALID), 0.0
        )
        if not direction or math.isnan(direction):
            return False
        right = right_of(result.position)
        if right is not None:
            self._lefts[right] = result.position
        pair = self._pairs.setdefault(right or result.position, _Pair())
        half_ns = 0.5e9 * result.revolution.period_s
        was_opposite = pair.is_opposite
        pair.take(int(right is None), result.host_ns - half_ns, half_ns, direction)
        return pair.is_opposite is not was_opposite

    def alarms(self) -> Iterator[Alarm]:
        """Yield those of the vehicle's signals, and one for both wheels of a pair that slips to opposite sides."""
        yield from self._witnesses()
        for right, left in self._lefts.items():
            pair = self._pairs[right]
            if pair.is_opposite:
                for position, other in ((left, right), (right, left)):
                    told = Reason(Code.LATERAL_SLIP_APART, other=other, opposite=pair.opposite, same=pair.same)
                    yield Alarm(position, ALARM, told)
