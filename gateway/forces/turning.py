"""Estimator of the turn of a wheel: yaw rate, curve radius, camber rate and lateral acceleration of a revolution."""

import math
from collections.abc import Sequence
from typing import Final

from gateway.core.contacts.contact_timing import MOST_UNSEEN
from gateway.core.estimates.estimator import (
    DETERMINED,
    SETTLED_REVOLUTIONS,
    Estimate,
    Status,
    TireConditions,
    sign_not_determined,
)
from gateway.core.estimates.reasons import EstimateCode
from gateway.core.estimates.revolution_block import RevolutionBlock, measured_shares
from gateway.core.reasons import CoreCode, Reason
from gateway.forces.lateral_shape import LateralAxisEstimator, turns_of
from gateway.forces.reasons import ForceCode
from gateway.forces.turn_tracker import NO_TURN, Turn, TurnTracker

NAMES: Final = ("turn_rate_radps", "curve_radius_m", "camber_rate_radps", "lateral_acceleration_mps2")
# Changes between straights and curves that show which of them are straight.
_MIN_CHANGES: Final = 2
# Change of turn and camber rate from one revolution to the next where they are not measured: a curve begins within ten.
_CHANGE_RADPS: Final = 0.02


class TurningEstimator(LateralAxisEstimator[Sequence[tuple[Turn, float]]]):
    """Turn of each revolution (`gateway.forces.turn_tracker`); no estimates without a lateral axis.

    Gives the estimates of NAMES. A steady turn from the first revolution on is known no better than the tire's own
    first order is predicted by the orders above: turn rate, radius and acceleration are provisional until straights and
    curves have followed each other. The radius is invalid on straights, where its sign is not determined. A revolution
    that is not used has the turn of the one before, provisional, with the error of what may have changed since.
    """

    name = "turning"

    def __init__(self) -> None:
        self._tracker = TurnTracker()
        super().__init__()

    def reset(self) -> None:
        """Forget all revolutions."""
        self._tracker.reset()
        self._count, self._inverse_shares = 0, 0.0
        # The latest revolution, and how many after it were not used.
        self._latest, self._unseen_count = (NO_TURN, 0.0), 0

    def _taken(self, block: RevolutionBlock, selected: Sequence[int]) -> Sequence[tuple[Turn, float]]:
        """Return the turn of each, and the number of whole revolutions whose mean would have the same variance."""
        shares = measured_shares([block.revolutions[index] for index in selected]) or (1.0,) * len(selected)
        steps = []
        for turn, share in zip(turns_of(block, selected, self._tracker), shares, strict=True):
            self._count += 1
            self._inverse_shares += 1.0 / share
            steps.append((turn, self._count**2 / self._inverse_shares))
        return steps

    def _names(self, conditions: TireConditions) -> Sequence[str]:  # noqa: ARG002 - part of the interface
        return NAMES

    def _estimates(
        self,
        conditions: TireConditions,
        edges_rad: tuple[float, float],  # noqa: ARG002 - part of the interface
        steps: Sequence[tuple[Turn, float]],
        row: int,
    ) -> tuple[Estimate, ...]:
        self._latest, self._unseen_count = steps[row], 0
        return self._from_turn(conditions, *steps[row])

    def _unused(self, conditions: TireConditions, reason: Reason) -> tuple[Estimate, ...]:
        self._unseen_count += 1
        turn, count = self._latest
        is_held = reason.code is EstimateCode.REVOLUTION_NOT_USED and math.isfinite(turn.turn_std_radps)
        if not (is_held and conditions.radius_m > 0.0) or self._unseen_count > MOST_UNSEEN:
            return super()._unused(conditions, reason)
        change_std_radps = _CHANGE_RADPS * self._unseen_count
        widened = turn._replace(
            turn_std_radps=math.hypot(turn.turn_std_radps, change_std_radps),
            turn_scatter_radps=math.hypot(turn.turn_scatter_radps, change_std_radps),
            camber_std_radps=math.hypot(turn.camber_std_radps, change_std_radps),
            camber_scatter_radps=math.hypot(turn.camber_scatter_radps, change_std_radps),
        )
        return self._from_turn(conditions, widened, count, reason)

    def _from_turn(self, conditions: TireConditions, turn: Turn, count: float, *unused: Reason) -> tuple[Estimate, ...]:
        """Return the estimates of a turn after a number of revolutions, and why it is not of this revolution."""
        if not math.isfinite(turn.turn_std_radps):
            return tuple(Estimate.invalid(name, Reason(EstimateCode.NO_CONTACT_EDGES)) for name in NAMES)
        doubts = unused
        if count < SETTLED_REVOLUTIONS * (1.0 - 1e-9):
            doubts = (Reason(CoreCode.NOT_SETTLED, revolutions=count, needed=SETTLED_REVOLUTIONS), *unused)
        status = Status.PROVISIONAL if doubts else Status.VALID
        turn_status, turn_doubts = status, doubts
        if doubts == unused and turn.changes < _MIN_CHANGES:
            turn_status = Status.PROVISIONAL
            turn_doubts = (Reason(ForceCode.STRAIGHT_NOT_SHOWN, changes=turn.changes, needed=_MIN_CHANGES), *unused)
        rate, scatter = turn.turn_radps, turn.turn_scatter_radps
        # The axis shows V times a rate: the belt radius is in the rates once, in the curve radius twice.
        gain_std, radius_std = conditions.lateral_gain_std, conditions.radius_std_m / conditions.radius_m
        std = math.hypot(turn.turn_std_radps, gain_std * rate, radius_std * rate)
        camber_std = math.hypot(turn.camber_std_radps, gain_std * turn.camber_radps, radius_std * turn.camber_radps)
        speed = turn.speed_mps
        if abs(rate) > DETERMINED * std:
            curve_std = speed / rate**2 * math.hypot(turn.turn_std_radps, gain_std * rate, 2.0 * radius_std * rate)
            radius = Estimate(NAMES[1], speed / rate, curve_std, turn_status, turn_doubts, speed / rate**2 * scatter)
        else:
            radius = Estimate.invalid(NAMES[1], sign_not_determined(rate, std))
        return (
            Estimate(NAMES[0], rate, std, turn_status, turn_doubts, scatter),
            radius,
            Estimate(NAMES[2], turn.camber_radps, camber_std, status, doubts, turn.camber_scatter_radps),
            Estimate(
                NAMES[3],
                speed * rate,
                speed * math.hypot(turn.turn_std_radps, gain_std * rate),
                turn_status,
                turn_doubts,
                speed * scatter,
            ),
        )
