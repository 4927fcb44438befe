"""Estimator of the distance that a wheel has rolled since its first revolution.

A revolution runs from one contact centre to the next, so a whole number of turns lies between any two revolutions.
Over a short gap in the signal this number is certain; over a long one the distance is bridged at the mean of the speeds
before and after it.
"""

import math
from typing import Final

from gateway.core.estimates.estimator import Estimate, Status
from gateway.core.estimates.reasons import EstimateCode
from gateway.core.estimates.revolution_block import RevolutionBlock, RevolutionEstimator
from gateway.core.reasons import Reason

NAMES: Final = ("distance_m",)

# Gap between two revolutions, in turns, that no jitter of a contact makes.
_LEAST_GAP_TURNS: Final = 0.25
# Deviation of a vehicle's acceleration from its mean over some seconds, as of a car that is driven briskly.
_ACCELERATION_STD_MPS2: Final = 2.0
# Standard error of the number of missing turns, and distance to a whole number, within which it is taken as whole.
_WHOLE_STD_TURNS: Final = 0.15
_WHOLE_TOLERANCE_TURNS: Final = 0.3
# Standard error of a number of turns that is not whole.
_NOT_WHOLE_STD_TURNS: Final = 0.5


class DistanceEstimator(RevolutionEstimator):
    """Distance rolled since the first contact centre, up to the end of each revolution.

    Gives distance_m, 2 pi R for each turn, at the end of this revolution.

    The standard error has two parts: that of the belt radius, which scales the whole distance, and that of gaps
    in the signal. Slip between tire and road is not part of it.
    """

    name = "distance"

    def reset(self) -> None:
        """Start at 0 again, as after a change of tire."""
        self._distance_m = self._turns = self._bridged_m = self._bridged_s = 0.0
        self._bridged_variance_m2 = 0.0
        self._unknown_gaps = 0
        self._end_s = self._frequency_hz = math.nan

    def _estimates(self, block: RevolutionBlock, index: int) -> tuple[Estimate, ...]:
        revolution, conditions = block.revolutions[index], block.conditions[index]
        radius = conditions.radius_m
        if not (radius > 0.0 and revolution.omega_radps > 0.0):
            return (Estimate.invalid(NAMES[0], Reason(EstimateCode.SPEED_OR_RADIUS_UNKNOWN)),)
        circumference = 2.0 * math.pi * radius
        frequency = revolution.omega_radps / (2.0 * math.pi)
        # Between revolutions that share a contact there is none, whatever the hub's clock says.
        if not (revolution.follows or math.isnan(self._end_s)):
            self._bridge(revolution.start_s - self._end_s, frequency, circumference)
        self._end_s, self._frequency_hz = revolution.start_s + revolution.period_s, frequency
        self._distance_m += circumference * revolution.turns
        self._turns += revolution.turns
        if revolution.turns > 1 and any(fault.code is EstimateCode.CONTACT_INTERPOLATED for fault in revolution.faults):
            # Neither end of it was seen, so that it need not be whole turns.
            self._bridged_variance_m2 += (_NOT_WHOLE_STD_TURNS * circumference) ** 2
        by_radius = 2.0 * math.pi * self._turns * conditions.radius_std_m
        std = math.sqrt(by_radius**2 + self._bridged_variance_m2)
        doubts: list[Reason] = []
        if self._bridged_s:
            doubts.append(
                Reason(
                    EstimateCode.DISTANCE_BRIDGED,
                    duration_s=self._bridged_s,
                    distance_m=self._bridged_m,
                    std_m=math.sqrt(self._bridged_variance_m2),
                )
            )
        if self._unknown_gaps:
            doubts.append(Reason(EstimateCode.DISTANCE_INTERRUPTED, count=float(self._unknown_gaps)))
        status = Status.PROVISIONAL if doubts else Status.VALID
        return (Estimate(NAMES[0], self._distance_m, std, status, tuple(doubts)),)

    def _bridge(self, gap_s: float, frequency_hz: float, circumference_m: float) -> None:
        """Add the turns between two revolutions."""
        mean = 0.5 * (self._frequency_hz + frequency_hz)
        turns = gap_s * mean
        if abs(turns) < _LEAST_GAP_TURNS:
            return
        if gap_s < 0.0:
            # The hub's time has started again; how long it was silent is not known.
            self._unknown_gaps += 1
            return
        # The mean speed may differ from the mean of both ends, at most by all of it.
        change_hz = min(_ACCELERATION_STD_MPS2 / circumference_m * gap_s / 4.0, mean)
        std = gap_s * change_hz / math.sqrt(3.0)
        whole_turns = round(turns)
        if std < _WHOLE_STD_TURNS and abs(turns - whole_turns) < _WHOLE_TOLERANCE_TURNS:
            turns, std = float(whole_turns), 0.0
        else:
            self._bridged_s += gap_s
            self._bridged_m += turns * circumference_m
            self._bridged_variance_m2 += (std * circumference_m) ** 2
        self._turns += turns
        self._distance_m += turns * circumference_m
