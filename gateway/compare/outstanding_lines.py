"""Lines between the integer orders that stand out of what lies around them, and what they keep as the speed changes.

A line is judged against the median power of the bins between the orders around it. Under noise the mean power of n
blocks has a chi-squared distribution with 2 n degrees of freedom, so that the ratio of a bin to its surroundings has
nearly an F distribution. What repeats with every revolution lies on integer orders, and is not judged.
"""

import math
from collections.abc import Iterator
from enum import StrEnum
from typing import Final, NamedTuple

import numpy as np

from gateway.compare.order_statistics import OrderStatistics
from gateway.core.constants import AXIS_NAMES
from gateway.core.types import BoolArray, FloatArray, IntArray

FALSE_ALARM: Final = 0.01
"""Probability that noise alone makes any line of a wheel."""
MINIMUM_TIMES: Final = 2.0
"""Times the amplitude around it from which a line is told."""

# Distance from an integer order, in orders, from which its leakage is past.
_LEAKAGE_ORDERS: Final = 0.3
# Below it gravity leaks, which does not grow with the speed as the rest does; a steady speed has no such leakage.
_LOWEST_ORDER: Final = 2.0
_STEADY: Final = 1.01
# Bins around a line that are its surroundings, to either side in orders.
_AROUND_ORDERS: Final = 4.0
_ENOUGH_AROUND: Final = 6
# Relative efficiency of a median against a mean: 2 / pi.
_EFFICIENCY: Final = 0.64
# Speeds that differ by it tell what a line keeps, where so many times more of them show it than the contrary.
_OTHER_SPEED: Final = 1.05
_CLEAR: Final = 2.0


class Keeps(StrEnum):
    """What a line keeps as the speed changes."""

    ORDER = "order"
    FREQUENCY = "frequency"
    UNKNOWN = "unknown"


class OutstandingLine(NamedTuple):
    """A line between the orders.

    Attributes:
        axis: that shows it clearest.
        order: in cycles per revolution.
        frequency_hz: at the middle of its range of speed.
        amplitude_mps2: root mean square over the blocks of its amplitude.
        times: its amplitude over that around it.
        range_radps: angular speeds of the range.
        keeps: as the speed changes.
    """

    axis: str
    order: float
    frequency_hz: float
    amplitude_mps2: float
    times: float
    range_radps: tuple[float, float]
    keeps: Keeps


class _Spectrum(NamedTuple):
    """Spectrum of a range of speed.

    Attributes:
        range_radps: angular speeds.
        fine_mps2: (3, m) as in `SpeedBin`.
        ratio: (3, m) power over the median power around it; NaN where it is not judged.
        limit: (m,) that noise alone rarely exceeds.
    """

    range_radps: tuple[float, float]
    fine_mps2: FloatArray
    ratio: FloatArray
    limit: FloatArray

    @property
    def rotation_hz(self) -> float:
        return sum(self.range_radps) / (4.0 * math.pi)

    @property
    def half_width(self) -> float:
        """Of the range of speed, over its middle."""
        low, high = self.range_radps
        return (high - low) / (high + low)


def outstanding_lines(statistics: OrderStatistics) -> list[OutstandingLine]:
    """Return the lines of a wheel, the clearest first; of one at several speeds or on several axes the clearest."""
    low, high = statistics.omega_range_radps
    orders = statistics.fine_order
    is_judged = np.abs(orders - np.round(orders)) > _LEAKAGE_ORDERS
    is_judged &= orders > (_LEAKAGE_ORDERS if high < _STEADY * low else _LOWEST_ORDER)
    measured = [speed_bin for speed_bin in statistics.speeds if speed_bin.blocks]
    tests = max(len(AXIS_NAMES) * len(measured) * int(is_judged.sum()), 1)
    spectra = [
        _Spectrum(
            (speed_bin.low_radps, speed_bin.high_radps),
            speed_bin.fine_mps2,
            *_ratios(speed_bin.fine_mps2, is_judged, orders, speed_bin.blocks_by_order, tests),
        )
        for speed_bin in measured
    ]
    candidates = sorted(
        (line for spectrum in spectra for line in _lines(spectrum, spectra, orders)),
        key=lambda line: line.times,
        reverse=True,
    )
    lines: list[OutstandingLine] = []
    for line in candidates:
        if not any(_is_same(line, clearer, orders[1]) for clearer in lines):
            lines.append(line)
    return lines


def _ratios(
    fine_mps2: FloatArray, is_judged: BoolArray, orders: FloatArray, blocks: IntArray, tests: int
) -> tuple[FloatArray, FloatArray]:
    """Return the power of each judged bin over the median power around it, (3, m), and its limit, (m,)."""
    from scipy.stats import chi2, f

    # Orders that no sampling carries are no surroundings; of those near the end few blocks may tell.
    is_judged = is_judged & (blocks > 0)
    power = np.where(is_judged, np.square(fine_mps2), math.nan)
    ratio, limit = np.full(power.shape, math.nan), np.full(len(orders), math.inf)
    freedom = 2 * np.maximum(blocks, 1)
    # A median of chi-squared powers lies below their mean.
    below = chi2.ppf(0.5, freedom) / freedom
    for index in np.flatnonzero(is_judged):
        distance = np.abs(orders - orders[index])
        around = is_judged & (distance <= _AROUND_ORDERS) & (distance > 1.5 * orders[1])
        if around.sum() < _ENOUGH_AROUND:
            continue
        level = np.median(power[:, around], axis=1)
        np.divide(power[:, index], level, out=ratio[:, index], where=level > 0.0)
        by_chance = f.isf(FALSE_ALARM / tests, freedom[index], _EFFICIENCY * freedom[around].sum())
        limit[index] = max(by_chance / below[around].mean(), MINIMUM_TIMES**2)
    return ratio, limit


def _lines(spectrum: _Spectrum, spectra: list[_Spectrum], orders: FloatArray) -> Iterator[OutstandingLine]:
    for axis, index in np.argwhere(np.nan_to_num(spectrum.ratio) > spectrum.limit).tolist():
        order, ratio = float(orders[index]), float(spectrum.ratio[axis, index])
        yield OutstandingLine(
            AXIS_NAMES[axis],
            order,
            order * spectrum.rotation_hz,
            float(spectrum.fine_mps2[axis, index]),
            math.sqrt(ratio),
            spectrum.range_radps,
            _keeps(axis, order, spectrum, spectra, orders),
        )


def _keeps(axis: int, order: float, spectrum: _Spectrum, spectra: list[_Spectrum], orders: FloatArray) -> Keeps:
    """Return what a line keeps: the one that more of the other speeds show."""
    votes, others = {Keeps.ORDER: 0, Keeps.FREQUENCY: 0}, 0
    for compared in spectra:
        change = compared.rotation_hz / spectrum.rotation_hz
        if max(change, 1.0 / change) < _OTHER_SPEED:
            continue
        others += 1
        # Within a range the speed, and so the order of a frequency, is known to its width.
        shift = order / change * (spectrum.half_width + compared.half_width)
        for keeps, expected_order, tolerance in ((Keeps.ORDER, order, 0.0), (Keeps.FREQUENCY, order / change, shift)):
            is_near = np.abs(orders - expected_order) <= 1.01 * orders[1] + tolerance
            votes[keeps] += bool((np.nan_to_num(compared.ratio[axis, is_near]) > compared.limit[is_near]).any())
    clearer, fewer = sorted(votes, key=lambda keeps: votes[keeps], reverse=True)
    # One of many speeds may show it by chance.
    is_clear = others > 0 and votes[clearer] >= max(_CLEAR * votes[fewer], min(others, 2))
    return clearer if is_clear else Keeps.UNKNOWN


def _is_same(line: OutstandingLine, clearer: OutstandingLine, step: float) -> bool:
    """Return whether a line is a clearer one again: at another speed, on another axis, or in the next bin."""
    tolerance = 1.5 * step
    if Keeps.FREQUENCY in (line.keeps, clearer.keeps):
        rotation_sum_hz = line.frequency_hz / line.order + clearer.frequency_hz / clearer.order
        return abs(line.frequency_hz - clearer.frequency_hz) <= tolerance * rotation_sum_hz
    return abs(line.order - clearer.order) <= tolerance
