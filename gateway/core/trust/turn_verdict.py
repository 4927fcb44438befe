"""What curves say of the lateral axes of a vehicle's wheels, and what is asked of a comparison of their turn rates."""

import math
from collections.abc import Mapping
from enum import StrEnum
from typing import Final, NamedTuple, Protocol

from gateway.core.estimates.results import RevolutionResult
from gateway.core.reasons import Reason
from gateway.core.trust.signal_evidence import Contradiction

TURN_RATE: Final = "turn_rate_radps"
"""Quantity of a revolution that has the sign of the lateral axis."""


class Witness(StrEnum):
    """What a turn rate is compared with."""

    TRACK = "track"
    YAW_RATE = "yaw_rate"
    COURSE = "course"
    WHEELS = "wheels"


class Gain(NamedTuple):
    """What a wheel reads over a witness, by a number of curves.

    Attributes:
        value: positive where both turn to one side.
        std: one standard error.
        curves: that it is of.
        is_related: whether the wheel turns as the witness does at all.
    """

    value: float = math.nan
    std: float = math.inf
    curves: int = 0
    is_related: bool = True


class Verdict(NamedTuple):
    """What curves say of a wheel from a time on.

    Attributes:
        at_ns: that time.
        sign: of its lateral axis: 1 to the left, -1 to the right, 0 open.
        by: what shows the sign.
        reversed_by: why the axis points to the right; None where it does not.
        sides: 1 for each other wheel whose axis points to the same side, -1 to the other one; as far as known.
        gain: of the axis over the stated one.
        gain_by: what shows the gain; None where nothing does.
        track_m: width of the track over the gain, where two wheels of an axle show it.
        contradictions: of the gain.
    """

    at_ns: float = -math.inf
    sign: int = 0
    by: Witness = Witness.WHEELS
    reversed_by: Reason | None = None
    sides: Mapping[str, int] = {}
    gain: Gain = Gain()
    gain_by: Witness | None = None
    track_m: Gain = Gain()
    contradictions: tuple[Contradiction, ...] = ()


NOTHING: Final = Verdict()


class TurnComparison(Protocol):
    """Compares the turn rates of all wheels of a vehicle; what is known at a time does not depend on their order."""

    def compare(self, result: RevolutionResult) -> None:
        """Compare a wheel's next revolution, if it has a turn rate."""
        ...

    def verdict(self, position: str, known_ns: float) -> Verdict:
        """Return what is known of a wheel by what has come up to a time."""
        ...
