"""Steps of a series: places from which on all values are higher or lower, as after a change of tire or a refill."""

import math
from typing import Final

import numpy as np

from gateway.core.types import BoolArray, FloatArray
from gateway.fleet.trends.regression import correlation_factor

LEAST_POINTS: Final = 4
"""Points of a level; fewer are outliers."""

_FALSE_RATE: Final = 0.01
_MOST_STEPS: Final = 12
# A smaller step is significant in a long series, but of no consequence; that of a level may be.
_MIN_SCATTERS: Final = 3.0
_SCATTERS_OF_LEVEL: Final = 1.5
_LOOK_AHEAD: Final = 3
_NEIGHBOURS: Final = 5
_SPIKE_SCATTERS: Final = 6.0
_MAD_TO_STD: Final = 1.4826
# Share of the sum of squares that rounding leaves.
_ROUNDING: Final = 1e-20
# A rise from one value to the next that deviates by this many times the robust scatter of all is tried as a step.
_JUMP_SCATTERS: Final = 4.0
_LAD_ROUNDS: Final = 20


def find_steps(
    design: FloatArray, values: FloatArray, *, family: int = 1, min_size: float = 0.0, scatters: float = _MIN_SCATTERS
) -> list[int]:
    """Return the indices at which a new level begins, in order.

    All jumps from one value to the next are tried together first: of a saw-tooth, such as a leak that is refilled every
    month, no single step reduces the residual. Further steps are added one at a time where they reduce it most. One
    that is not significant stays for a while, as several steps may show only together. Those are kept that an F-test
    finds significant over all places and series in the end, and that are larger than `scatters` times the scatter that
    remains and than `min_size`.

    Args:
        design: (n, p) of the trend without steps, in the order of time.
        values: (n,) finite.
        family: number of series that are tested together.
        min_size: size below which a step is not reported, in the unit of the values.
        scatters: the same, in scatters that remain.
    """
    # What the temperature makes of the values would hide spikes.
    keep = np.flatnonzero(~_spikes(values - design @ np.linalg.lstsq(design, values, rcond=None)[0]))
    rows, targets = design[keep], values[keep]
    level = _FALSE_RATE / max(family, 1)
    jumps = _significant(rows, targets, _jumps(rows, targets), level, min_size, scatters)
    added, significant = list(jumps), len(jumps)
    while len(added) - len(jumps) < _MOST_STEPS and len(added) - significant < _LOOK_AHEAD:
        candidate = _best_step(rows, targets, added)
        if candidate is None:
            break
        added.append(candidate)
        if _is_step(rows, targets, added, candidate, level, min_size, scatters):
            significant = len(added)
    return sorted(
        int(keep[index]) for index in _significant(rows, targets, added[:significant], level, min_size, scatters)
    )


def find_levels(design: FloatArray, values: FloatArray, *, family: int = 1) -> list[int]:
    """Return the steps of a series that is usually level, as a load: a line through a step hides it.

    Of the steps of (n,) values without the time, column 1 of the design (n, p), those that are significant with it too.
    """
    steps = find_steps(np.delete(design, 1, axis=1), values, family=family, scatters=_SCATTERS_OF_LEVEL)
    return sorted(_significant(design, values, steps, _FALSE_RATE, 0.0, _SCATTERS_OF_LEVEL))


def _significant(
    rows: FloatArray, targets: FloatArray, places: list[int], level: float, min_size: float, scatters: float
) -> list[int]:
    """Return the steps that are significant beside each other; the last ones given are dropped first."""
    steps = list(places)
    while True:
        insignificant = [step for step in steps if not _is_step(rows, targets, steps, step, level, min_size, scatters)]
        if not insignificant:
            return steps
        steps.remove(insignificant[-1])


def _jumps(rows: FloatArray, targets: FloatArray) -> list[int]:
    """Return the places of sudden changes between neighbours, the largest first.

    Differences of neighbours follow the trend without its level, and steps are their outliers: a fit of least absolute
    deviations is not bent by them.
    """
    count = len(targets)
    if count < 2 * LEAST_POINTS:
        return []
    slopes, changes = np.diff(rows, axis=0), np.diff(targets)
    slopes = slopes[:, np.abs(slopes).max(axis=0) > 0.0]
    residuals, scale = changes, 0.0
    weights = np.ones(count - 1)
    for _ in range(_LAD_ROUNDS):
        root = np.sqrt(weights)
        residuals = changes - slopes @ np.linalg.lstsq(slopes * root[:, None], changes * root, rcond=None)[0]
        scale = _MAD_TO_STD * float(np.median(np.abs(residuals)))
        if not scale > 0.0:
            return []
        weights = 1.0 / np.maximum(np.abs(residuals), 1e-3 * scale)
    jumps: list[int] = []
    for place in (np.argsort(-np.abs(residuals), kind="stable") + 1).tolist():
        if abs(residuals[place - 1]) <= _JUMP_SCATTERS * scale:
            break
        if LEAST_POINTS <= place <= count - LEAST_POINTS and all(abs(place - jump) >= LEAST_POINTS for jump in jumps):
            jumps.append(place)
    freedom = count - rows.shape[1] - LEAST_POINTS
    return jumps[: max(freedom, 0)]


def _best_step(rows: FloatArray, targets: FloatArray, present: list[int]) -> int | None:
    """Return the place where one more step reduces the residual most; None without a place or freedom."""
    count = len(targets)
    places = [
        place
        for place in range(LEAST_POINTS, count - LEAST_POINTS + 1)
        if all(abs(place - step) >= LEAST_POINTS for step in present)
    ]
    if not places or count - rows.shape[1] - len(present) - 1 < LEAST_POINTS:
        return None
    # The residuals of the values and of all candidate steps after the columns present give each step's gain.
    basis = np.linalg.qr(with_steps(rows, present))[0]
    residuals = targets - basis @ (basis.T @ targets)
    steps = (np.arange(count)[:, None] >= np.array(places)).astype(np.float64)
    steps -= basis @ (basis.T @ steps)
    squares = np.einsum("ij,ij->j", steps, steps)
    usable = squares > 1e-9 * count
    gains = np.where(usable, (steps.T @ residuals) ** 2 / np.where(usable, squares, 1.0), 0.0)
    peak = int(np.argmax(gains))
    return places[peak] if gains[peak] > 0.0 else None


def _is_step(
    rows: FloatArray, targets: FloatArray, steps: list[int], step: int, level: float, min_size: float, scatters: float
) -> bool:
    """Return whether one of the steps found is significant beside the others, and large enough."""
    from scipy import stats

    count = len(targets)
    columns = with_steps(rows, [step, *(place for place in steps if place != step)])
    # The step as the last column: its coefficient and gain stand alone in the last row of R.
    columns = np.column_stack([np.delete(columns, rows.shape[1], axis=1), columns[:, rows.shape[1]]])
    basis, triangle = np.linalg.qr(columns)
    scores = basis.T @ targets
    residuals = targets - basis @ scores
    freedom = count - columns.shape[1]
    if freedom < LEAST_POINTS or not abs(triangle[-1, -1]) > 1e-9:
        return False
    misfit, gain, size = float(residuals @ residuals), float(scores[-1]) ** 2, abs(float(scores[-1] / triangle[-1, -1]))
    rounding = _ROUNDING * float(targets @ targets)
    if gain <= rounding or misfit <= rounding:
        return gain > rounding and size >= min_size
    scatter = math.sqrt(misfit / freedom)
    if size < max(scatters * scatter, min_size):
        return False
    if size < _MIN_SCATTERS * scatter:
        misfit *= correlation_factor(residuals, columns.shape[1])
    return float(stats.f.sf(gain * freedom / misfit, 1, freedom)) * count <= level


def with_steps(rows: FloatArray, places: list[int]) -> FloatArray:
    """Return a design (n, p) with a column more for each step, 0 before it and 1 from it on."""
    steps = (np.arange(len(rows))[:, None] >= np.array(places, dtype=int)).astype(np.float64)
    return np.column_stack([rows, steps])


def _spikes(values: FloatArray) -> BoolArray:
    """Return (n,) whether a value differs by six times the scatter from the medians of its neighbours on both sides.

    Before the first and after the last values only the other side counts. Of a run of LEAST_POINTS and more, all are a
    level of their own, and none is a spike.
    """
    count = len(values)
    if count <= 2 * _NEIGHBOURS:
        return np.zeros(count, dtype=bool)
    medians = np.median(np.lib.stride_tricks.sliding_window_view(values, _NEIGHBOURS), axis=1)
    before, after = np.full(count, np.nan), np.full(count, np.nan)
    before[_NEIGHBOURS:] = medians[:-1]
    after[: count - _NEIGHBOURS] = medians[1:]
    deviations = np.fmin(np.abs(values - before), np.abs(values - after))
    # The nearer of two medians: its scatter is about half that of the values.
    scale = 2.0 * _MAD_TO_STD * float(np.median(deviations))
    is_spike = np.asarray(deviations > _SPIKE_SCATTERS * scale if scale > 0.0 else np.zeros(count, dtype=bool))
    for begin, end in runs(is_spike):
        if end - begin >= LEAST_POINTS:
            is_spike[begin:end] = False
    return is_spike


def runs(marked: BoolArray) -> list[tuple[int, int]]:
    """Return begin and end (exclusive) of each run of marked values, in order."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], marked, [False]]).astype(np.int8)))
    return [(int(begin), int(end)) for begin, end in zip(edges[::2], edges[1::2], strict=True)]
