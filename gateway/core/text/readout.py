"""Contents of a result as views show them: speed, contact angles, and the numbers or only their ratios."""

import math
from collections.abc import Sequence
from functools import cache
from typing import Final, NamedTuple

from gateway.core.estimates.estimator import Estimate, Status
from gateway.core.estimates.results import RevolutionResult
from gateway.core.feature import Registry, added, object_of
from gateway.core.reasons import Reason
from gateway.core.ring_quantities import RING_NUMBERS, RING_RATIOS
from gateway.core.text.numbers import Shown, show
from gateway.core.text.wording import joined

SPEED: Final = "speed_mps"
ROTATION: Final = "rotation_rpm"
DISTANCE: Final = "distance_m"
WEAR: Final = "wear_mm"
LEADING: Final = "leading_edge_rad"
TRAILING: Final = "trailing_edge_rad"
# A value below zero by fewer standard errors is none.
_ZERO_LIMIT_STDS: Final = 2.0
_ORDER: Final = (Status.VALID, Status.PROVISIONAL, Status.INVALID)


def plain_wear(estimate: Estimate) -> Estimate:
    """Return wear as people read it: none where it is below zero by less than twice its error."""
    return estimate._replace(value=0.0) if -_ZERO_LIMIT_STDS * estimate.std < estimate.value < 0.0 else estimate


class Reading(NamedTuple):
    """Parts of a result in the order in which views show them.

    Attributes:
        speed: forward speed.
        rotation: revolutions per minute.
        leading: leading contact angle, negative.
        trailing: trailing contact angle, positive.
        further: every other estimate.
        distance: distance rolled; None when no estimator gives it.
        numbers: the dimensionless numbers, or their ratios when only those are known.
        status: worst status among the numbers shown, of speed and angles where no estimator of numbers runs, invalid
            where none runs at all.
        reasons: for that status.
        car: signals of the vehicle at the time of the revolution.
        ratios_only: True when `numbers` are ratios because the numbers themselves are invalid.
    """

    speed: Shown
    rotation: Shown
    leading: Shown
    trailing: Shown
    further: tuple[Estimate, ...]
    distance: Shown | None
    numbers: tuple[Shown, ...]
    status: Status
    reasons: tuple[Reason, ...]
    car: tuple[Shown, ...]
    ratios_only: bool

    @property
    def note(self) -> str:
        """The reasons as one text; empty when there is nothing to say."""
        if self.reasons:
            return f"ratios only: {joined(self.reasons)}" if self.ratios_only else joined(self.reasons)
        if self.ratios_only:
            return "ratios only"
        return "no estimates" if self.status is Status.INVALID and not self.numbers else ""


@cache
def vehicle_signal_names() -> frozenset[str]:
    """Return every name that a signal of the vehicle can have among the estimates of a revolution."""
    names: frozenset[str] = object_of(added(Registry.PARTS)["names of vehicle signals"])
    return names


def read_result(result: RevolutionResult) -> Reading:
    """Sort a result's estimates; speed and angles fall back to the revolution's own when no estimate names them."""
    others: dict[str, Estimate] = {}
    car: list[Estimate] = []
    numbers: list[Estimate] = []
    ratios: list[Estimate] = []
    for estimate in result.estimates:
        plain = estimate.name.rpartition(":")[2]
        if estimate.name in vehicle_signal_names():
            car.append(estimate)
        elif plain in RING_RATIOS:
            ratios.append(estimate)
        elif plain in RING_NUMBERS:
            numbers.append(estimate)
        else:
            others[estimate.name] = estimate
    speed, rotation, distance = others.pop(SPEED, None), others.pop(ROTATION, None), others.pop(DISTANCE, None)
    leading, trailing = others.pop(LEADING, None), others.pop(TRAILING, None)
    has_numbers = any(number.status is not Status.INVALID for number in numbers)
    ratios_only = not has_numbers and any(ratio.status is not Status.INVALID for ratio in ratios)
    shown_numbers = tuple(show(number) for number in (ratios if ratios_only else numbers))
    revolution = result.revolution
    kinematic = (
        show(speed or _measured(SPEED, revolution.omega_radps * result.conditions.radius_m, math.nan)),
        show(rotation or _measured(ROTATION, revolution.omega_radps * 30.0 / math.pi, math.nan)),
        show(leading or _measured(LEADING, revolution.leading_edge_rad, revolution.leading_edge_std_rad)),
        show(trailing or _measured(TRAILING, revolution.trailing_edge_rad, revolution.trailing_edge_std_rad)),
    )
    judged = shown_numbers if numbers or ratios or speed is None else kinematic
    return Reading(
        *kinematic,
        tuple(others.values()),
        None if distance is None else show(distance),
        shown_numbers,
        max((number.status for number in judged), key=_ORDER.index, default=Status.INVALID),
        revolution.faults or _reasons(numbers, kinematic),
        tuple(map(show, car)),
        ratios_only,
    )


def _measured(name: str, value: float, std: float) -> Estimate:
    return Estimate(name, value, std, Status.VALID if math.isfinite(value) else Status.INVALID)


def _reasons(numbers: Sequence[Estimate], kinematic: Sequence[Shown]) -> tuple[Reason, ...]:
    """Return the reasons of the first estimate of the worst status that has any."""
    # The worst status explains most; notes on valid numbers are shown only when nothing is wrong.
    items: tuple[Estimate | Shown, ...] = (*numbers, *kinematic)
    for status in reversed(_ORDER):
        for item in items:
            if item.status is status and item.reasons:
                return item.reasons
    return ()
