"""Steady value that a sensor has lost although DC coupling is stated, from the level in the contact.

The belt is flat in the contact, so a sensor that passes the steady value reads about zero there, and its mean is the
depth of the contact. Behind a high-pass the mean tends to zero and the contact reads minus its depth. The ratio of the
two depends on neither gain, unit, radius nor sampling rate. On a rough road it scatters, so the mean must also be less
than speed and belt radius let expect, which does not.
"""

import math
from collections import deque
from typing import Final, NamedTuple

from gateway.core.estimates.estimator import is_evidence
from gateway.core.estimates.revolution_block import RevolutionBlock
from gateway.core.quantity import LARGEST_ZERO_MPS2

# Half of the angle at the middle of the contact whose level is taken: a quarter of a car's contact.
_MIDDLE_RAD: Final = 0.05
# Share of the depth below the mean that the middle of a contact lacks or exceeds, one standard error: on the exact ring
# it is at -0.06 to +0.01 of R Omega^2, and a sensor 10 mm below the neutral layer raises it by 0.03.
_LEVEL_STD: Final = 0.04
# Lost share of the steady value from which it counts as lost: six times that error. A revolution on a rough road
# scatters by more, so the last three must agree, and the first ones must have lost twice as much.
_LOST_SHARE: Final = 0.25
_CONSECUTIVE: Final = 3
_FIRST_LOST_SHARE: Final = 0.5
# Revolutions in a row that must have their steady value until it no longer counts as lost. Behind a high-pass of 0.1 Hz
# a car that moves off has most of it for less than that.
_SOUND_REVOLUTIONS: Final = 16


class LostSteadyValue(NamedTuple):
    """Steady value of a sensor that has lost it.

    Attributes:
        share: of it that is left: mean over the depth of the contact, or over R Omega^2 where that is more.
        std: its standard error.
    """

    share: float
    std: float


class SteadyValueCheck:
    """Follows whether a sensor of stated DC coupling has its steady value; deterministic, one revolution at a time."""

    def __init__(self) -> None:
        """Start without revolutions."""
        self.reset()

    def reset(self) -> None:
        """Forget everything, as after a change of sensor."""
        # Share that is left, and whether that is a loss, of the last revolutions.
        self._shares: deque[float] = deque(maxlen=_CONSECUTIVE)
        self._sound_count = 0
        self._is_lost = False

    def update_block(self, block: RevolutionBlock) -> list[LostSteadyValue | None]:
        """Take revolutions; return what is left of the steady value after each, None where it is not lost.

        Revolutions that are no evidence and those of AC-coupled sensors change nothing.
        """
        radial = block.arrays.radial_mps2
        n = radial.shape[1]
        reach = max(round(_MIDDLE_RAD * n / (2.0 * math.pi)), 1)
        floors = radial[:, n // 2 - reach : n // 2 + reach + 1].mean(axis=1).tolist()
        means = block.arrays.orders_mps2[:, 0].real.tolist()
        states: list[LostSteadyValue | None] = []
        radii = [condition.radius_m for condition in block.conditions]
        for revolution, radius_m, mean, floor in zip(block.revolutions, radii, means, floors, strict=True):
            if is_evidence(revolution) and not (revolution.ac_coupled or revolution.saturated):
                self._take(mean, floor, radius_m * revolution.omega_radps**2)
            states.append(self._present() if self._is_lost and not revolution.ac_coupled else None)
        return states

    def _take(self, mean: float, floor: float, steady: float) -> None:
        depth = mean - floor
        if not (depth > 0.0 and steady > 0.0):
            return
        # A mean of minus the steady value is that of a wrong direction, as a rough road may give it at first.
        share = max(mean / depth, abs(mean) / steady)
        is_large = -floor > LARGEST_ZERO_MPS2
        self._shares.append(share if is_large else max(share, 1.0))
        lost_share = 1.0 - max(self._shares)
        if lost_share > (_LOST_SHARE if len(self._shares) == _CONSECUTIVE else _FIRST_LOST_SHARE):
            self._is_lost = True
        self._sound_count = self._sound_count + 1 if 1.0 - self._shares[-1] < _LOST_SHARE else 0
        if self._sound_count >= _SOUND_REVOLUTIONS:
            self._is_lost = False

    def _present(self) -> LostSteadyValue:
        mean = sum(self._shares) / len(self._shares)
        scatter = math.sqrt(sum((share - mean) ** 2 for share in self._shares)) / len(self._shares)
        return LostSteadyValue(mean, math.hypot(_LEVEL_STD, scatter))
