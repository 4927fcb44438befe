"""Samples that were lost or repeated without being marked, from the radial mean and the period of a revolution.

The mean of the radial axis is R Omega^2 of the true speed; the speed from the contacts is too high where samples are
missing between them. So the mean times the square of the period, which no speed changes, falls in one revolution, and
the period falls short of that of its neighbours by the same number of samples. A change of gain or radius changes the
mean alone, braking or skidding the period alone. Where contacts between its own two were not seen, as of a wheel that
lost its load, the product rises by the square of the number of turns.
"""

import math
import statistics
from collections import deque
from typing import Final

from gateway.core.quantity import LARGEST_ZERO_MPS2

# Revolutions whose median is the reference, and the least number of them.
_MEMORY: Final = 9
_MIN_REVOLUTIONS: Final = 3
# Least relative deviation, and the deviation in robust standard deviations of those revolutions: on an even road the
# product scatters by 0.05 %, on a rough one by up to 1 %.
_LEAST_DEVIATION: Final = 0.008
_DEVIATIONS: Final = 6.0
# Median absolute deviation of normal values over their standard deviation, inverted.
_MAD_TO_STD: Final = 1.483
# Share of the number of samples by which the period may miss what its neighbours let expect: these may change speed.
_AGREEMENT: Final = 0.5
# A change of the speed within a revolution, relative, squared and times this, bounds what it adds to the mean square.
_CHANGE_FACTOR: Final = 0.25
# Below, the mean is that of a wheel that hardly rolls, or of a sensor without a steady value.
_LEAST_MEAN_MPS2: Final = 30.0
# Root of the product over its reference from which more than one turn was made, and its greatest distance to a whole
# number where it tells which.
_SEVERAL_TURNS: Final = 1.5
# The same between contacts that were not seen, which need not be neighbours nor whole turns apart.
_UNSEEN_TURNS: Final = 1.25
_TURN_TOLERANCE: Final = 0.35
# Revolutions in a row that deviate alike from which the deviation is the new state, such as another gain.
_NEW_STATE_COUNT: Final = 3


class UnmarkedLossCheck:
    """Follows the revolutions of one DC-coupled wheel; deterministic, one revolution at a time."""

    def __init__(self) -> None:
        """Start without revolutions."""
        self.reset()

    def reset(self) -> None:
        """Forget everything, as after a gap or a change of sensor."""
        self._products: deque[float] = deque(maxlen=_MEMORY)
        # Their median, 0 without any.
        self._median_product = 0.0
        # Their periods, in the same order.
        self._sound_periods: deque[float] = deque(maxlen=_MEMORY)
        # The two latest periods as they should have been, the earlier one first.
        self._periods: tuple[float, ...] = ()
        self._deviating = 0

    @property
    def knows_a_turn(self) -> bool:
        """Whether there are revolutions to compare with."""
        return len(self._products) >= _MIN_REVOLUTIONS

    def turns(self, period: float, mean_mps2: float, stated: float = 0.0, *, is_whole: bool = True) -> int:
        """Return the number of turns between the contacts of a revolution; 1 where nothing tells of more.

        Args:
            period: between its contacts in samples.
            mean_mps2: mean of its radial axis, positive inward.
            stated: product of mean and square of the period of one turn by radius and rate as stated, which counts
                before there are revolutions to compare with; 0 for none.
            is_whole: whether both contacts were seen, so that only a whole number is one.
        """
        if not mean_mps2 > _LEAST_MEAN_MPS2:
            return 1
        reference = self._median_product if self.knows_a_turn else stated
        if not reference > 0.0:
            return 1
        turns = math.sqrt(mean_mps2 * period * period / reference)
        # The mean of a wheel that slows down falls with the square of its speed, so the product stays.
        if turns < (_SEVERAL_TURNS if is_whole else _UNSEEN_TURNS):
            return 1
        if is_whole and abs(turns - round(turns)) > _TURN_TOLERANCE:
            return 1
        return max(round(turns), 2)

    def missing(self, period: float, mean_mps2: float) -> float:
        """Take a revolution; return the number of samples it is short of, negative for repeated ones, 0 for none.

        Args:
            period: of the revolution in samples.
            mean_mps2: mean of its radial axis, positive inward.
        """
        missing_samples = self._missing_samples(period, mean_mps2)
        self._deviating = self._deviating + 1 if missing_samples else 0
        if self._deviating >= _NEW_STATE_COUNT:
            self.reset()
            missing_samples = 0.0
        if not missing_samples:
            self._products.append(mean_mps2 * period * period)
            self._median_product = statistics.median(self._products)
            self._sound_periods.append(period)
        self._periods = (*self._periods[-1:], period + missing_samples)
        return missing_samples

    def _missing_samples(self, period: float, mean_mps2: float) -> float:
        if not self.knows_a_turn or len(self._periods) < 2 or not mean_mps2 > _LEAST_MEAN_MPS2:
            return 0.0
        reference = self._median_product
        if not reference > _LEAST_MEAN_MPS2 * period * period:
            return 0.0
        deviations = [abs(product - reference) for product in self._products]
        # The median of few deviations may be small by chance: the largest of them is not.
        is_full = len(deviations) == _MEMORY
        scatter = (_MAD_TO_STD * statistics.median(deviations) if is_full else max(deviations)) / reference
        previous, last = self._periods
        change = period / last - 1.0
        # A zero-g offset is a larger part of the mean at lower speeds.
        speed_change = max(abs(period / self._sound_periods[0] - 1.0), abs(period / self._sound_periods[-1] - 1.0))
        zero_error = LARGEST_ZERO_MPS2 / mean_mps2 * speed_change
        limit = max(_LEAST_DEVIATION, _DEVIATIONS * scatter) + 2.0 * zero_error + _CHANGE_FACTOR * change * change
        ratio = reference / (mean_mps2 * period * period)
        if abs(ratio - 1.0) <= limit:
            return 0.0
        # Outside the contact, the samples that remain keep the mean. Lost in it, where they read zero, they raise it,
        # so that the product falls by half as much.
        mean_deficit = period * (math.sqrt(ratio) - 1.0)
        period_deficit = 2.0 * last - previous - period
        if not 1.0 - _AGREEMENT <= period_deficit / mean_deficit <= 2.0 + _AGREEMENT:
            return 0.0
        return mean_deficit * min(max(period_deficit / mean_deficit, 1.0), 2.0)
