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
from gateway.fleet.trends.regression import Fit
from gateway.fleet.trends.tire_history import TireHistory
from gateway.fleet.trends.watched_series import SERIES

# Recordings from which the newest state has a line of its own, and from which its numbers are valid. A slope needs two
# values, its scatter three.
_LEAST_OWN_LINE: Final = 5
# Recordings in a row that deviate to the same side are no single errors.
_LEAST_RUN: Final = 2
_FINDING_SHARE: Final = 0.999


class TrendLine(NamedTuple):
    """A fitted series: design's column 0 is the level, 1 the trend, 2 the temperature where it is there.

    `doubt` says why numbers of the line are provisional, `levels` counts the changes of what is stated within it. The
    columns of `change` are the last ones of the design: what is added from it on, and the level of a line of its own.
    `of_load` are the columns of steps of the load, which are no part of the series' value.
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
    along = line.design[-1] - line.design[0]
    if line.has_covariate:
        along[2] = 0.0
    return np.asarray(along)


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
    both = [*runs(sides[0]), *runs(sides[1])]
    return sorted((begin, end) for begin, end in both if end - begin >= _LEAST_RUN)


def size_of_change(line: TrendLine) -> tuple[float, float]:
    """Return the distance of the newest value from the trend before the change, and its error."""
    assert line.change is not None
    return combination(line, size_of_change_at(line))


def size_of_step(line: TrendLine, number: int) -> tuple[float, float]:
    """Return the change of level at a step, and its error."""
    along = np.zeros(line.design.shape[1])
    along[line.design.shape[1] - len(line.steps) + number - (0 if line.change is None else 1 + line.has_own_line)] = 1.0
    return combination(line, along)


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
    place = None if begin is None else int(line.places[begin])
    if watch.is_logarithm:
        return Change(place, 0.01 * size[0], 0.01 * size[1])
    before = float(fit.expected[max((begin or 0) - 1, 0)])
    after = before + size[0]
    if before <= 0.0 or after <= 0.0:
        return Change(place)
    return Change(place, math.log(after / before), size[1] / after)


def combination(line: TrendLine, along: FloatArray) -> tuple[float, float]:
    """Return a combination (p,) of the coefficients of a line and its error.

    That of few recordings is not below the error that the scatter of all gives: theirs may be small by chance.
    """
    fit = line.fit
    variance = float(along @ fit.covariance @ along)
    if line.change is not None:
        rows = (line.design * np.sqrt(fit.weights)[:, None])[~line.search.is_outlier]
        variance = max(variance, fit.scale**2 * float(along @ np.linalg.pinv(rows.T @ rows) @ along))
    return float(along @ fit.coefficients), math.sqrt(max(variance, 0.0))


def part_of_line(history: TireHistory, line: TrendLine, begin: int, end: int) -> dict[str, Value]:
    """Return dates, number and names of the recordings of a part of a line."""
    first, last = history.recordings[int(line.places[begin])], history.recordings[int(line.places[end - 1])]
    return {
        "date": line.dates[begin], "until": line.dates[end - 1], "count": end - begin, "first": first, "last": last
    }  # fmt: skip


def slope_before(line: TrendLine) -> FloatArray:
    """Return the coefficients (p,) of the slope before a change."""
    along = np.zeros(line.design.shape[1])
    along[1] = 1.0
    return along


def slope_after(line: TrendLine) -> FloatArray:
    """Return the coefficients (p,) of the newest slope."""
    along = slope_before(line)
    if line.change is not None and line.change.is_slope:
        along[line.change_at] = 1.0
    return along


def size_of_change_at(line: TrendLine) -> FloatArray:
    """Return the coefficients (p,) of the distance of the newest value from the trend before the change."""
    along = np.zeros(line.design.shape[1])
    along[line.change_at :] = line.design[-1, line.change_at :]
    return along


def date_of(time_ns: int) -> str:
    """Return the date of a time since 1970."""
    return str(np.datetime64(time_ns, "ns").astype("datetime64[D]"))


def level_columns(index: IntArray, places: Sequence[int]) -> list[FloatArray]:
    """Return a column for each change that some recordings come before and some after, 0 before and 1 after."""
    columns = [(index >= begin).astype(np.float64) for begin in places]
    return [
        column
        for number, column in enumerate(columns)
        if 0.0 < column.sum() < len(index) and not any((column == other).all() for other in columns[:number])
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
