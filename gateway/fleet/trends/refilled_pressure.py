"""Pressure loss of a tire that is refilled at unknown times: likelihood over all refills, seen or not.

The pressure at one temperature falls steadily and jumps at refills. A trend with the jumps that stand out of the
scatter would take all the others for a smaller loss: a tire that loses 1 kPa a month and gets 1 kPa every month seems
tight. Here no refill is decided on. For every loss, the likelihood of the recordings is summed over all refills: jumps
come at random with a rate, their sizes are exponential with a mean, and the pressure between two recordings is a level
on a grid that moves with the loss (forward algorithm of a hidden Markov model, Rabiner 1989). Rate, mean size and
scatter are profiled. The interval of the likelihood ratio then contains losses that small refills would hide, up to
MOST_REFILLS a month. A pressure that is topped up oftener is level but for a scatter, and shows no loss.
"""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gateway.core.types import FloatArray

LEAST_RECORDINGS: Final = 8
"""Fewer recordings do not tell scatter from refills."""

MOST_REFILLS: Final = 2.0
"""Refills in a month up to which they are considered: higher rates make scatter look like refills and losses."""

_MAD_TO_STD: Final = 1.4826
# Refills in a month, 0 for none: tires are looked after once in a while, not every day.
_RATES: Final = (0.0, 0.25, 0.5, 1.0, MOST_REFILLS)
# Mean sizes of a refill: those of a careful driver, and of a forgotten tire.
_SIZES_KPA: Final = (1.0, 3.0, 10.0)
# Share of jumps that let air out.
_DOWNWARD: Final = 0.1
# The scatter is estimated from few recordings.
_SCATTERS: Final = (0.7, 1.0, 1.4)
# A sensor's resolution is no better.
_LEAST_SCATTER_KPA: Final = 0.01
# Grid of levels about each recording, in scatters.
_HALF_WINDOW: Final = 4.5
_CELLS_A_SCATTER: Final = 3
# More recordings are averaged in order: the time of a likelihood grows with their number.
_MOST_POINTS: Final = 120
_COARSE, _FINE = 48, 20
# Times that the range of losses is extended while its ends are likely.
_EXTENSIONS: Final = 4
# Log likelihood below the maximum within which the grid of losses is refined.
_REFINED: Final = 12.0
# Falls of the log likelihood at the ends of the intervals: 68 %, 95 % and 99.9 % for a normal estimate. Where the
# scatter nearly hides the refills it is not normal, so the upper end is that of 99.9 %.
_NARROW, _LOW, _FAR = 0.5, 1.92, 5.41


class PressureLoss(NamedTuple):
    """Loss of pressure in kPa a month.

    Attributes:
        value: most likely one.
        std: half the width of the 68 % interval.
        low: lower end of the 95 % interval.
        high: upper end, which also covers what nearly hidden refills conceal.
        least: lower end of the 99.9 % interval, for findings.
        high_unrefilled: upper end if there were no refills at all.
    """

    value: float
    std: float
    low: float
    high: float
    least: float
    high_unrefilled: float


def pressure_loss(months: FloatArray, cold_kpa: FloatArray) -> PressureLoss | None:
    """Return the loss of pressure; None where the recordings are too few or at one time.

    Args:
        months: (n,) times of the recordings, increasing.
        cold_kpa: (n,) pressures at one temperature, finite, without outliers.
    """
    if len(months) < LEAST_RECORDINGS or not months[-1] > months[0]:
        return None
    scatter = max(scatter_of(cold_kpa), _LEAST_SCATTER_KPA)
    times_months, values, counts = _averaged(months, cold_kpa)
    losses, kinds = _candidate_losses(times_months, values, scatter), _refill_kinds(scatter, (1.0,))
    log_likelihood = _log_likelihood(times_months, values, counts, losses, kinds, scatter / _CELLS_A_SCATTER)
    for _ in range(_EXTENSIONS):
        likely = log_likelihood.max(axis=1) >= log_likelihood.max() - _REFINED
        if not (likely[0] or likely[-1]):
            break
        reach = float(losses[-1] - losses[0])
        losses = np.linspace(losses[0] - reach * likely[0], losses[-1] + reach * likely[-1], _COARSE)
        log_likelihood = _log_likelihood(times_months, values, counts, losses, kinds, scatter / _CELLS_A_SCATTER)
    kinds = _refill_kinds(scatter, _SCATTERS)
    for _ in range(2):
        profile = log_likelihood.max(axis=1)
        window = np.flatnonzero(profile >= profile.max() - _REFINED)
        losses = np.linspace(losses[max(window[0] - 1, 0)], losses[min(window[-1] + 1, len(losses) - 1)], _FINE)
        log_likelihood = _log_likelihood(times_months, values, counts, losses, kinds, scatter / _CELLS_A_SCATTER)
        # Kinds that are out of the question everywhere cost time only; that without refills is reported.
        is_possible = (log_likelihood.max(axis=0) >= log_likelihood.max() - _REFINED) | (kinds[:, 0] == 0.0)
        kinds, log_likelihood = kinds[is_possible], log_likelihood[:, is_possible]
    profile, unrefilled = log_likelihood.max(axis=1), log_likelihood[:, kinds[:, 0] == 0.0].max(axis=1)
    narrow = _interval(losses, profile, _NARROW)
    return PressureLoss(
        value=_vertex(losses, profile),
        std=0.5 * (narrow[1] - narrow[0]),
        low=_interval(losses, profile, _LOW)[0],
        high=_interval(losses, profile, _FAR)[1],
        least=_interval(losses, profile, _FAR)[0],
        high_unrefilled=_interval(losses, unrefilled, _FAR)[1],
    )


def _refill_kinds(scatter: float, factors: Sequence[float]) -> FloatArray:
    """Return rate, mean size and scatter of every kind of refills, (h, 3)."""
    return np.array(
        [
            (rate, size, factor * scatter)
            for rate in _RATES
            for size in (_SIZES_KPA if rate else _SIZES_KPA[:1])
            for factor in factors
        ]
    )


def scatter_of(values: FloatArray) -> float:
    """Return the scatter of single recordings: second differences do not know the trend, and few contain a refill."""
    return _MAD_TO_STD * float(np.median(np.abs(np.diff(values, 2)))) / math.sqrt(6.0)


def _averaged(months: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return times, values and numbers of recordings, averaged in order where there are many."""
    count = len(months)
    if count <= _MOST_POINTS:
        return months, values, np.ones(count)
    starts = np.linspace(0, count, _MOST_POINTS + 1).astype(int)[:-1]
    counts = np.diff(np.append(starts, count)).astype(np.float64)
    return np.add.reduceat(months, starts) / counts, np.add.reduceat(values, starts) / counts, counts


def _candidate_losses(months: FloatArray, values: FloatArray, scatter: float) -> FloatArray:
    """Return losses that jumps of at most all rises or falls between neighbours could make of the fitted slope."""
    span = float(months[-1] - months[0])
    slope = float(np.polyfit(months, values, 1)[0])
    changes = np.diff(values)
    rises, falls = float(changes[changes > 0.0].sum()), -float(changes[changes < 0.0].sum())
    below, above = (max(1.5 * total, 3.0 * scatter) / span for total in (falls, rises))
    return np.linspace(-slope - below, -slope + above, _COARSE)


def _log_likelihood(
    months: FloatArray, values: FloatArray, counts: FloatArray, losses: FloatArray, kinds: FloatArray, cell: float
) -> FloatArray:
    """Return the log likelihood of every loss (k,) under every kind of refills (h,), as (k, h).

    In the frame that moves with a loss, the level stands still between refills, so cells are never interpolated. The
    window of a recording is a whole number of cells away from that of the one before.
    """
    rates, sizes, scatters = kinds.T
    half = round(_HALF_WINDOW * _CELLS_A_SCATTER)
    size = 2 * half + 1
    index = np.arange(size)
    detrended = values + losses[:, None] * months
    centres = np.round(detrended / cell).astype(np.int64)
    offsets = detrended - centres * cell
    levels = (index - half) * cell
    steps = cell / sizes
    weights = np.exp(steps[:, None] * index)
    shape = (len(losses), len(rates), size)
    total = np.zeros(shape[:2])
    state = np.full(shape, 1.0 / size)
    for recording in range(len(months)):
        if recording:
            source = index + (centres[:, recording] - centres[:, recording - 1])[:, None]
            jump_probability = 1.0 - np.exp(-rates * (months[recording] - months[recording - 1]))
            state = _next_state(state, source, jump_probability, steps, weights)
        stds = scatters / math.sqrt(counts[recording])
        deviations = (offsets[:, recording, None] - levels)[:, None, :] / stds[:, None]
        state = state * np.exp(-0.5 * deviations**2) / stds[:, None]
        sums = np.maximum(state.sum(axis=2), np.finfo(np.float64).tiny)
        total += np.log(sums)
        state /= sums[:, :, None]
    return total


def _next_state(
    state: FloatArray, source: NDArray[np.int64], jump_probability: FloatArray, steps: FloatArray, weights: FloatArray
) -> FloatArray:
    """Return the probabilities of levels after the time to the next recording.

    Args:
        state: (k, h, size) before.
        source: (k, size) cell of the window before that has the same level as each cell of the next.
        jump_probability: (h,) probability of a jump.
        steps: (h,) cell over the mean size of a jump.
        weights: (h, size) exponentials over the cells of the window.
    """
    size = state.shape[2]

    def shifted(values: FloatArray, cells: NDArray[np.int64]) -> FloatArray:
        """Return values (k, h, size) at other cells, 0 outside the window."""
        inside = np.clip(cells, 0, size - 1)
        gathered = np.take_along_axis(values, np.broadcast_to(inside[:, None, :], values.shape), axis=2)
        return np.asarray(np.where((cells == inside)[:, None, :], gathered, 0.0))

    below, above = np.minimum(source, size - 1), np.maximum(source, 0)
    rate = steps[:, None]
    up = shifted(np.cumsum(state * weights, axis=2), below) * np.exp(-rate * source[:, None, :].clip(min=0))
    down = shifted(np.cumsum((state / weights)[:, :, ::-1], axis=2)[:, :, ::-1], above)
    down = down * np.exp(rate * source[:, None, :].clip(max=size - 1))
    jumps = rate * ((1.0 - _DOWNWARD) * up + _DOWNWARD * down)
    jump_share = jump_probability[:, None]
    return np.asarray((1.0 - jump_share) * shifted(state, source) + jump_share * jumps)


def _vertex(abscissa: FloatArray, heights: FloatArray) -> float:
    """Return the place of the maximum, by a parabola through the highest point and its neighbours."""
    top = int(np.argmax(heights))
    if not 0 < top < len(abscissa) - 1:
        return float(abscissa[top])
    before, middle, after = heights[top - 1 : top + 2]
    bend = before - 2.0 * middle + after
    return float(abscissa[top] + 0.5 * (abscissa[1] - abscissa[0]) * ((before - after) / bend if bend < 0.0 else 0.0))


def _interval(abscissa: FloatArray, heights: FloatArray, fall: float) -> tuple[float, float]:
    """Return the outermost places at which the heights have fallen by this from their maximum."""
    limit = float(heights.max()) - fall
    inside = np.flatnonzero(heights >= limit)
    first, last = int(inside[0]), int(inside[-1])
    low, high = float(abscissa[first]), float(abscissa[last])
    if first > 0:
        low = float(np.interp(limit, heights[first - 1 : first + 1], abscissa[first - 1 : first + 1]))
    if last < len(abscissa) - 1:
        high = float(np.interp(-limit, -heights[last : last + 2], abscissa[last : last + 2]))
    return low, high
