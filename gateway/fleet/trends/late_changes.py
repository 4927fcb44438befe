"""Change of a series from one recording on: another slope, or a last few values at another level.

A line through all values hides both, and a test for outliers takes the newest state for errors. The place is that of
the largest F statistic among all candidates (Quandt 1960: The estimation of the parameters of a linear regression
system obeying two separate regimes. J. Am. Stat. Assoc. 53, 873-880), with Bonferroni's limit for their number. No
single value decides: the change is significant without each of those that support it most.
"""

import math
from typing import Final, NamedTuple

import numpy as np

from gateway.core.types import BoolArray, FloatArray, IntArray
from gateway.fleet.trends.level_steps import LEAST_POINTS, find_levels, find_steps, with_steps
from gateway.fleet.trends.regression import LEAST_FREEDOM, correlation_factor

LEAST_AFTER: Final = 3
"""Values after a change of slope: two and one that confirms them."""

_FALSE_RATE: Final = 0.01
# Shorter ones may be a single drive; those of LEAST_POINTS and more are steps.
_LAST_VALUES: Final = range(2, LEAST_POINTS)
# Values that are left out in turn: those that support a change most.
_OMITTED_COUNT: Final = 6
# A smaller change may be significant in a long series, but moves the newest value by less than one recording's scatter.
_LEAST_SCATTERS: Final = 1.0
# Scatters by which an isolated value lies beyond all of its four neighbours: normal ones hardly ever do.
_ISOLATED: Final = 4.0
_MAD_TO_STD: Final = 1.4826
# Places of a change of slope that are tried: the last ones each, and as many over a long series.
_MOST_KNEES: Final = 100
# Share of the sum of squares that rounding leaves.
_ROUNDING: Final = 1e-20


class LateChange(NamedTuple):
    """A change of a series.

    Attributes:
        begin: index of the first value of the new state.
        is_slope: whether the slope changes; otherwise the level of the last few values.
        column: (n,) what is added to the design: the time since the change, or 1 after it.
    """

    begin: int
    is_slope: bool
    column: FloatArray


class Shape(NamedTuple):
    """Steps of a series, and its change.

    Attributes:
        steps: indices at which a new level begins.
        change: None where there is none.
    """

    steps: list[int]
    change: LateChange | None


def find_shape(
    design: FloatArray,
    values: FloatArray,
    *,
    family: int = 1,
    least_step: float = 0.0,
    least_change: float = 0.0,
    may_be_isolated: bool = True,
    is_level: bool = False,
) -> Shape:
    """Return steps and the change that describe a series best.

    A change of slope looks like a step to a line, and steps like a change of slope. Both orders are tried, and that
    with the smaller Bayesian information criterion is taken.

    Args:
        design: (n, p) of the trend; column 0 is the level, 1 the time or distance, increasing.
        values: (n,) finite.
        family: number of series that are tested together.
        least_step: size below which a step is not reported.
        least_change: size at the last value below which a change is not reported.
        may_be_isolated: whether isolated values may be errors, which are left out here.
        is_level: whether a step is likelier than a trend.
    """
    if not np.ptp(values) > 0.0:
        return Shape([], None)
    keep = ~_isolated(design, values) if may_be_isolated else np.ones(len(values), dtype=bool)

    def changed(steps: list[int]) -> LateChange | None:
        return _find_change(with_steps(design, steps), values, keep, family, least_change)

    steps = find_steps(design, values, family=family, min_size=least_step)
    if is_level and not steps:
        steps = find_levels(design, values, family=family)
    options = [Shape(steps, changed(steps))]
    first = options[0].change if not steps else changed([])
    if first is not None:
        # The newest values that have left the trend count as such, also where a step would do.
        others = find_steps(np.column_stack([design, first.column]), values, family=family, min_size=least_step)
        if others or steps:
            other_change = changed(others) if others else first
            # Steps alone that leave no change are not replaced by more parts: a scatter that grows would call for them.
            if other_change is not None and (options[0].change is not None or len(others) < len(steps)):
                options.append(Shape(others, other_change))
    best_shape = min(options, key=lambda shape: _criterion(design[keep], values[keep], shape, keep))
    if best_shape.change is not None and best_shape.change.is_slope and least_step > 0.0:
        # Steps that are too small to be reported make a change of slope, too.
        small_steps = Shape(find_steps(design, values, family=family), None)
        if small_steps.steps and _criterion(design[keep], values[keep], small_steps, keep) <= _criterion(
            design[keep], values[keep], best_shape, keep
        ):
            return Shape(steps, None)
    return best_shape


def _criterion(rows: FloatArray, targets: FloatArray, shape: Shape, keep: BoolArray) -> float:
    """Return the Bayesian information criterion; steps and changes have two parameters each, size and place."""
    count = len(keep)
    steps = (np.arange(count)[:, None] >= np.array(shape.steps, dtype=int)).astype(np.float64)[keep]
    columns = [rows, steps, *([shape.change.column[keep, None]] if shape.change is not None else [])]
    residuals = _residuals(np.column_stack(columns), targets)
    squares = max(float(residuals @ residuals), _ROUNDING * float(targets @ targets), np.finfo(np.float64).tiny)
    parameters = 2 * (len(shape.steps) + (shape.change is not None))
    return len(targets) * math.log(squares) + parameters * math.log(len(targets))


def _find_change(
    design: FloatArray, values: FloatArray, keep: BoolArray, family: int, least_size: float
) -> LateChange | None:
    """Return the most significant change; None without one that is significant and large enough."""
    retained = np.flatnonzero(keep)
    rows, targets = design[retained], values[retained]
    count, columns = rows.shape
    if count - columns - 1 < LEAST_FREEDOM + 1:
        return None
    candidates = _candidates(design[:, 1], retained)
    if not candidates:
        return None
    regressors = np.column_stack([candidate.column[retained] for candidate in candidates])
    basis = np.linalg.qr(rows)[0]
    residuals = targets - basis @ (basis.T @ targets)
    orthogonal = regressors - basis @ (basis.T @ regressors)
    squares = np.einsum("ij,ij->j", orthogonal, orthogonal)
    usable = squares > 1e-9 * np.einsum("ij,ij->j", regressors, regressors)
    gains = np.where(usable, (orthogonal.T @ residuals) ** 2 / np.where(usable, squares, 1.0), 0.0)
    peak = int(np.argmax(gains))
    level = _FALSE_RATE / max(family, 1) / len(candidates)
    column = regressors[:, peak]
    if not gains[peak] > 0.0 or not _is_significant(rows, column, targets, level):
        return None
    support = orthogonal[:, peak] * residuals * np.sign(orthogonal[:, peak] @ residuals)
    for omitted in np.argsort(-support)[:_OMITTED_COUNT]:
        is_kept = np.arange(count) != omitted
        if not _is_significant(rows[is_kept], column[is_kept], targets[is_kept], level):
            return None
    size = abs(float(orthogonal[:, peak] @ residuals) / float(squares[peak]) * float(column[-1]))
    scatter = math.sqrt(max(float(residuals @ residuals) - float(gains[peak]), 0.0) / (count - columns - 1))
    return candidates[peak] if size >= max(least_size, _LEAST_SCATTERS * scatter) else None


def _candidates(time: FloatArray, retained: IntArray) -> list[LateChange]:
    """Return changes of slope at each value, and of the level of the last few."""
    count, index = len(retained), np.arange(len(time))
    knees = range(LEAST_POINTS - 1, count - LEAST_AFTER)
    stride = -(-len(knees) // _MOST_KNEES) or 1
    candidates = [
        LateChange(int(retained[knee + 1]), True, np.maximum(time - time[retained[knee]], 0.0))
        for number, knee in enumerate(reversed(knees))
        if (number < _MOST_KNEES or number % stride == 0) and time[retained[knee + 1]] > time[retained[knee]]
    ]
    candidates += [
        LateChange(int(retained[count - length]), False, (index >= retained[count - length]).astype(np.float64))
        for length in _LAST_VALUES
        if count - length >= LEAST_POINTS
    ]
    return candidates


def _is_significant(rows: FloatArray, column: FloatArray, targets: FloatArray, level: float) -> bool:
    """Return whether a column reduces the residual by more than chance, for residuals that may follow each other."""
    from scipy import stats

    basis = np.linalg.qr(rows)[0]
    orthogonal = column - basis @ (basis.T @ column)
    square = float(orthogonal @ orthogonal)
    if not square > 1e-9 * float(column @ column):
        return False
    residuals = targets - basis @ (basis.T @ targets)
    gain = float(orthogonal @ residuals) ** 2 / square
    remaining = residuals - orthogonal * (float(orthogonal @ residuals) / square)
    freedom = len(targets) - rows.shape[1] - 1
    misfit, rounding = float(remaining @ remaining), _ROUNDING * float(targets @ targets)
    if gain <= rounding or misfit <= rounding:
        return gain > rounding
    misfit *= correlation_factor(remaining, rows.shape[1] + 1)
    return bool(stats.f.sf(gain * freedom / misfit, 1, freedom) <= level)


def _isolated(design: FloatArray, values: FloatArray) -> BoolArray:
    """Return (n,) whether a value lies far beyond the two before and the two after it, on the same side of all."""
    is_isolated = np.zeros(len(values), dtype=bool)
    if len(values) < 5:
        return is_isolated
    residuals = _residuals(design, values)
    neighbours = np.stack([residuals[:-4], residuals[1:-3], residuals[3:-1], residuals[4:]])
    centre = residuals[2:-2]
    excess = np.maximum(centre - neighbours.max(axis=0), neighbours.min(axis=0) - centre)
    scale = _MAD_TO_STD * float(np.median(np.abs(np.diff(residuals, 2)))) / math.sqrt(6.0)
    is_isolated[2:-2] = excess > _ISOLATED * scale
    return is_isolated if scale > 0.0 else np.zeros(len(values), dtype=bool)


def _residuals(rows: FloatArray, targets: FloatArray) -> FloatArray:
    return np.asarray(targets - rows @ np.linalg.lstsq(rows, targets, rcond=None)[0])
