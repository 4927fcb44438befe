"""A fitted line of a series, and what its coefficients say: slopes, steps, changes and their errors."""

import math
from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

import numpy as np

from gateway.core.reasons import Reason, Value
from gateway.core.types import FloatArray, IntArray
from gateway.fleet.trends.causes import Change
from gateway.fleet.trends.late_changes import LateChange
from gateway.fleet.trends.level_steps import LEAST_POINTS, runs
from gateway.fleet.trends.outlier_detection import OutlierSearch
from gateway.fleet.trends.regression import Fit, correlation_factor
from gateway.fleet.trends.tire_history import TireHistory
from gateway.fleet.trends.watched_series import SERIES

# Recordings from which the newest state has a line of its own, and from which its numbers are valid. A slope needs two
# values, its scatter three.
_LEAST_OWN_LINE: Final = 5
# Recordings in a row that deviate to the same side are no single errors.
_LEAST_RUN: Final = 2
# Recordings on each side of the place of a change at which it may have begun.
_SEARCH_RADIUS: Final = 20
# Errors of a place that hold another one; and recordings by which scatter moves every place.
_PLACE_ERRORS: Final = 2.0
_PLACE_SCATTER: Final = 2
_FINDING_SHARE: Final = 0.999
# Time within which recordings are alike, pairs of them that show how much, errors of chance, and recordings beyond
# which the order of them is enough.
_CORRELATED_MONTHS: Final = 0.1
_LEAST_PAIRS: Final = 10
_CHANCE: Final = 2.0
_MOST_PAIRED: Final = 300


class TrendLine(NamedTuple):
    """A fitted series: design's column 0 is the level, 1 the trend, 2 the temperature where it is there.

    `doubt` says why numbers of the line are provisional, `levels` counts the changes of what is stated within it. The
    columns of `change` are the last ones of the design: what is added from it on, and the level of a line of its own.
    `of_load` are the columns of steps of the load, which are no part of the series' value, `of_pressure` that of the
    pressure where it bends. `months` are the times.
    """

    places: IntArray
    values: FloatArray
    stds: FloatArray
    design: FloatArray
    steps: list[int]
    search: OutlierSearch
    has_covariate: bool
    doubt: Reason | None
    levels: int
    dates: tuple[str, ...]
    change: LateChange | None
    has_own_line: bool
    of_load: slice
    of_pressure: int | None
    months: FloatArray

    @property
    def fit(self) -> Fit:
        """Fit of the recordings used."""
        assert self.search.fit is not None
        return self.search.fit

    @property
    def change_at(self) -> int:
        """Column of the change."""
        columns: int = self.design.shape[1]
        return columns - 1 - self.has_own_line

    @property
    def newest(self) -> int:
        """Recordings used since the change."""
        assert self.change is not None
        return sum(not is_outlier for is_outlier in self.search.is_outlier[self.change.begin :].tolist())


def inflation(line: TrendLine) -> float:
    """Return the variance inflation factor of the trend by the covariate."""
    time, covariate = (line.design[:, column] - line.design[:, column].mean() for column in (1, 2))
    square = float(time @ covariate) ** 2 / float((time @ time) * (covariate @ covariate))
    return 1.0 / max(1.0 - square, np.finfo(np.float64).eps)


def from_first_to_last(line: TrendLine) -> FloatArray:
    """Return the coefficients (p,) of the change over all recordings, at one value of the covariate."""
    contrast = line.design[-1] - line.design[0]
    if line.has_covariate:
        contrast[2] = 0.0
    return np.asarray(contrast)


def columns_of(change: LateChange | None, steps: Sequence[int], count: int) -> list[list[FloatArray]]:
    """Return columns of a change to fit, the first choice first.

    After a change of slope the newest values have a line of their own, so that its errors hold the change's place too.
    """
    if change is None:
        return [[]]
    if not change.is_slope or count - change.begin < _LEAST_OWN_LINE:
        return [[change.column]]
    if any(abs(change.begin - step) < LEAST_POINTS for step in steps):
        return [[change.column]]
    level = (np.arange(count) >= change.begin).astype(np.float64)
    return [[change.column, level], [change.column]]


def last_run(line: TrendLine) -> int | None:
    """Return where outliers to one side begin that reach the last value; None where it is none or alone."""
    return next((begin for begin, end in runs_of_outliers(line.search) if end == len(line.values)), None)


def runs_of_outliers(search: OutlierSearch) -> list[tuple[int, int]]:
    """Return begin and end of each run of outliers to one side."""
    assert search.fit is not None
    sides = search.is_outlier & (search.fit.residuals > 0.0), search.is_outlier & (search.fit.residuals < 0.0)
    outlier_runs = [*runs(sides[0]), *runs(sides[1])]
    return sorted((begin, end) for begin, end in outlier_runs if end - begin >= _LEAST_RUN)


def size_of_change(line: TrendLine) -> tuple[float, float]:
    """Return the distance of the newest value from the trend before the change, and its error."""
    assert line.change is not None
    return combination(line, size_of_change_at(line))


def column_of_step(line: TrendLine, number: int) -> int:
    """Return the column of a step."""
    columns: int = line.design.shape[1]
    return columns - len(line.steps) + number - (0 if line.change is None else 1 + line.has_own_line)


def size_of_step(line: TrendLine, number: int) -> tuple[float, float]:
    """Return the change of level at a step, and its error."""
    contrast = np.zeros(line.design.shape[1])
    contrast[column_of_step(line, number)] = 1.0
    return combination(line, contrast)


def begins_of(line: TrendLine, begin: int) -> tuple[IntArray, FloatArray]:
    """Return the values (m,) at which a step or a change may have begun, and their likelihoods, of the sum 1.

    Those of the regression with the change at another place; of recordings in a row that deviate, the first.
    """
    is_step = begin in line.steps
    if not is_step and (line.change is None or begin != line.change.begin):
        return np.array([begin]), np.ones(1)
    is_slope = not is_step and line.change is not None and line.change.is_slope
    columns = (
        [column_of_step(line, line.steps.index(begin))] if is_step else range(line.change_at, line.design.shape[1])
    )
    used = ~line.search.is_outlier
    root = np.sqrt(line.fit.weights[used])[:, None]
    basis = np.linalg.qr(np.delete(line.design, list(columns), axis=1)[used] * root)[0]
    targets = line.values[used] * root[:, 0]
    targets = targets - basis @ (basis.T @ targets)
    index, time = np.arange(len(line.values)), line.design[:, 1]
    places = np.arange(max(begin - _SEARCH_RADIUS, 1), min(begin + _SEARCH_RADIUS + 1, len(index)))
    gains = np.zeros(len(places))
    for number, place in enumerate(places.tolist()):
        change_columns = [np.maximum(time - time[place - 1], 0.0)] if is_slope else []
        if not is_slope or line.has_own_line:
            change_columns.append((index >= place).astype(np.float64))
        orthogonal = np.column_stack(change_columns)[used] * root
        orthogonal -= basis @ (basis.T @ orthogonal)
        fitted = orthogonal @ np.linalg.lstsq(orthogonal, targets, rcond=None)[0]
        gains[number] = float(fitted @ fitted)
    residuals = line.fit.residuals[used] * root[:, 0]
    variance = line.fit.scale**2 * correlation_factor(residuals, line.fit.coefficients.size)
    weights = np.exp(0.5 * (gains - gains.max()) / variance) if variance > 0.0 else (places == begin).astype(np.float64)
    return places, np.asarray(weights / weights.sum())


def since_std_s(history: TireHistory, line: TrendLine, begin: int) -> float:
    """Return the standard error of the date at which a change begins: it is known to a gap between recordings."""
    places, weights = begins_of(line, begin)
    seconds = 1e-9 * (history.time_ns[line.places] - history.time_ns[line.places[begin]]).astype(np.float64)
    gap = float(seconds[begin] - seconds[max(begin - 1, 0)])
    spread = weights @ (seconds[places] - weights @ seconds[places]) ** 2
    return math.sqrt(max(float(spread), 0.0) + gap**2 / 12.0)


def size_of_run(line: TrendLine, begin: int, end: int) -> tuple[float, float]:
    """Return the mean deviation of recordings in a row, and its error."""
    fit = line.fit
    residuals = fit.residuals[begin:end]
    return float(residuals.mean()), float(residuals.std(ddof=1)) / math.sqrt(end - begin)


def notable_changes(name: str, line: TrendLine) -> Iterator[Change]:
    """Yield the changes so large that others may follow them, whether they are faults or not.

    A long series shows changes that are too small to be the cause of anything.
    """
    notable = SERIES[name].watch.notable
    yield from (
        relative_change(name, line, begin, size_of_run(line, begin, end))
        for begin, end in runs_of_outliers(line.search)
    )
    sizes = [(begin, size_of_step(line, number)) for number, begin in enumerate(line.steps)]
    if line.change is not None:
        sizes.append((line.change.begin, size_of_change(line)))
    yield from (relative_change(name, line, begin, size) for begin, size in sizes if abs(size[0]) >= notable)


def relative_change(name: str, line: TrendLine, begin: int | None, size: tuple[float, float]) -> Change:
    """Return a change of a series by its size and error, in the unit of the series; None for `begin` is a drift."""
    fit, watch = line.fit, SERIES[name].watch
    if begin is None:
        onset, place_scatter = None, 0
    else:
        places, weights = begins_of(line, begin)
        spread = math.sqrt(float(weights @ (places - begin) ** 2))
        onset, place_scatter = int(line.places[begin]), max(_PLACE_SCATTER, math.ceil(_PLACE_ERRORS * spread))
    if watch.is_logarithm:
        return Change(onset, 0.01 * size[0], 0.01 * size[1], apart=place_scatter)
    before = float(fit.expected[max((begin or 0) - 1, 0)])
    after = before + size[0]
    if before <= 0.0 or after <= 0.0:
        return Change(onset, apart=place_scatter)
    return Change(onset, math.log(after / before), size[1] / after, apart=place_scatter)


def combination(line: TrendLine, along: FloatArray) -> tuple[float, float]:
    """Return a combination (p,) of the coefficients of a line and its error.

    That of few recordings is not below the error that the scatter of all gives: theirs may be small by chance. Nor is
    any below that of recordings of the same days, which weather, road and driver make alike.
    """
    fit, used = line.fit, ~line.search.is_outlier
    variance = float(along @ fit.covariance @ along)
    rows = (line.design * np.sqrt(fit.weights)[:, None])[used]
    inverse = np.linalg.pinv(rows.T @ rows)
    if line.change is not None:
        variance = max(variance, fit.scale**2 * float(along @ inverse @ along))
    residuals = fit.residuals[used] * np.sqrt(fit.weights[used])
    gaps_months = (
        np.abs(line.months[used][:, None] - line.months[used][None, :]) if used.sum() <= _MOST_PAIRED else np.zeros(0)
    )
    is_near = np.triu(gaps_months < _CORRELATED_MONTHS, 1) if gaps_months.size else np.zeros((0, 0), dtype=bool)
    if is_near.sum() >= _LEAST_PAIRS and fit.scale > 0.0:
        decay = np.exp(-gaps_months / _CORRELATED_MONTHS)
        share = float(np.mean(np.outer(residuals, residuals)[is_near])) / fit.scale**2 / float(np.mean(decay[is_near]))
        if share > _CHANCE / math.sqrt(float(is_near.sum())):
            moments = rows.T @ (np.eye(len(rows)) + min(share, 1.0) * (decay - np.eye(len(rows)))) @ rows
            variance = max(variance, fit.scale**2 * float(along @ inverse @ moments @ inverse @ along))
    return float(along @ fit.coefficients), math.sqrt(max(variance, 0.0))


def part_of_line(history: TireHistory, line: TrendLine, begin: int, end: int) -> dict[str, Value]:
    """Return dates, the error of the first, number and names of the recordings of a part of a line."""
    first, last = history.recordings[int(line.places[begin])], history.recordings[int(line.places[end - 1])]
    return {
        "date": line.dates[begin],
        "since_std_s": since_std_s(history, line, begin),
        "until": line.dates[end - 1],
        "count": end - begin,
        "first": first,
        "last": last,
    }


def slope_before(line: TrendLine) -> FloatArray:
    """Return the coefficients (p,) of the slope before a change."""
    contrast = np.zeros(line.design.shape[1])
    contrast[1] = 1.0
    return contrast


def slope_after(line: TrendLine) -> FloatArray:
    """Return the coefficients (p,) of the newest slope."""
    contrast = slope_before(line)
    if line.change is not None and line.change.is_slope:
        contrast[line.change_at] = 1.0
    return contrast


def size_of_change_at(line: TrendLine) -> FloatArray:
    """Return the coefficients (p,) of the distance of the newest value from the trend before the change."""
    contrast = np.zeros(line.design.shape[1])
    contrast[line.change_at :] = line.design[-1, line.change_at :]
    return contrast


def date_of(time_ns: int) -> str:
    """Return the date of a time since 1970."""
    return str(np.datetime64(time_ns, "ns").astype("datetime64[D]"))


def level_columns(index: IntArray, places: Sequence[int]) -> list[FloatArray]:
    """Return a column for each change that some recordings come before and some after, 0 before and 1 after."""
    columns = [(index >= place).astype(np.float64) for place in places]
    return [
        column
        for number, column in enumerate(columns)
        if 0.0 < column.sum() < len(index) and not any((column == earlier).all() for earlier in columns[:number])
    ]


def quantile_of(freedom: int) -> float:
    """Return Student's t beyond which a number is a finding."""
    from scipy import stats

    return float(stats.t.ppf(0.5 + 0.5 * _FINDING_SHARE, freedom))


def finding_quantile(line: TrendLine) -> float:
    """Return Student's t beyond which a number of a line is a finding."""
    return quantile_of(line.fit.freedom)


def centred(values: FloatArray) -> FloatArray:
    """Return values (n,) less their mean."""
    return np.asarray(values - values.mean(), dtype=np.float64)


def varies(values: FloatArray, least: float) -> bool:
    """Return whether all values are known and scatter by at least `least`."""
    return bool(np.isfinite(values).all()) and float(values.std()) >= least


def is_constant(values: FloatArray) -> bool:
    """Return whether all values are equal: measured ones never are."""
    return bool(values.size) and float(np.ptp(values)) == 0.0


def span_of(values: FloatArray) -> float:
    """Return the range of the known values; 0 without one."""
    finite = values[np.isfinite(values)]
    return float(np.ptp(finite)) if finite.size else 0.0
