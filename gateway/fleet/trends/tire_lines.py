"""Lines of one tire: each series is fitted, tested for outliers and kept, and its changes become findings."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from gateway.core.estimates.wear import bending_left
from gateway.core.quantity import Basis, Trend, Watch
from gateway.core.reasons import Code, CoreCode, Reason, Value
from gateway.core.types import FloatArray, IntArray
from gateway.fleet.reasons import FleetCode
from gateway.fleet.trends.causes import Change, Finding
from gateway.fleet.trends.late_changes import LateChange, Shape, find_shape
from gateway.fleet.trends.level_steps import LEAST_POINTS, with_steps
from gateway.fleet.trends.neighbouring_wheels import Shared
from gateway.fleet.trends.outlier_detection import OutlierSearch, find_outliers
from gateway.fleet.trends.plausible_readings import PlausibleReadings
from gateway.fleet.trends.recording_doubts import doubt_of, weights_by_doubt
from gateway.fleet.trends.regression import LEAST_FREEDOM, Fit, weights_of
from gateway.fleet.trends.regression import fit as fitted
from gateway.fleet.trends.stated_changes import StatedChange, places_of
from gateway.fleet.trends.tire_history import TireHistory
from gateway.fleet.trends.trend_line import (
    TrendLine,
    centred,
    column_of_step,
    columns_of,
    combination,
    date_of,
    finding_quantile,
    is_constant,
    last_run,
    level_columns,
    notable_changes,
    part_of_line,
    relative_change,
    runs_of_outliers,
    size_of_change,
    size_of_change_at,
    size_of_run,
    size_of_step,
    slope_after,
    slope_before,
    span_of,
    varies,
)
from gateway.fleet.trends.trend_result import TrendNumber, TrendOutlier, TrendSeries
from gateway.fleet.trends.watched_series import SERIES

# Spread of the temperature from which its influence is fitted, and recordings that this needs.
_LEAST_SPREAD_K: Final = 2.0
_LEAST_FOR_TEMPERATURE: Final = 12
_LEAST_SPREAD_SPEED: Final = 0.03
_LEAST_SPREAD_PRESSURE: Final = 0.005
# What is worth a finding, besides being significant; the rest is in `gateway.fleet.trends.watched_series`.
NOTABLE_LOSS_PA: Final = 2000.0
PRESSURE: Final = "pressure_at_20_degc"
# Share of a notable change below which numbers do not follow it: readings have a resolution.
_FOLLOWED: Final = 0.1
_LEVELS: Final = {
    name for name, _, w in SERIES.values() if Basis.LOAD in w.explains | w.follows and w.trend is not Trend.SENSOR
}
# Steps of the load that the wear is fitted beside.
_MOST_LOAD_LEVELS: Final = 3


@dataclass(slots=True)
class TireWork:
    """Work on one tire."""

    history: TireHistory
    family: int
    readings: PlausibleReadings
    changes: Sequence[StatedChange]
    cold: Shared
    numbers: list[TrendNumber] = field(default_factory=list)
    series: list[TrendSeries] = field(default_factory=list)
    outliers: list[TrendOutlier] = field(default_factory=list)
    findings: list[Finding] = field(default_factory=list)
    onsets: dict[str, list[Change]] = field(default_factory=dict)
    tested: int = 0


def stuck_temperature(tire: TireWork, places: IntArray) -> Reason | None:
    """Return that the temperature of recordings is not measured, so that what a season makes looks like a trend."""
    if not tire.readings.has_temperature:
        return Reason(FleetCode.TREND_NOT_MEASURED, quantity="temperature")
    degc = tire.readings.temperature_degc[places]
    if not is_constant(degc):
        return None
    return Reason(FleetCode.TREND_TEMPERATURE_STUCK, temperature_degc=float(degc[0]), count=len(degc))


def softened_by_wear(tire: TireWork, name: str, line: TrendLine, along: FloatArray) -> tuple[float, float] | None:
    """Return a combination (p,) of the coefficients of ln(stiffness) that the wear makes in percent, and its error.

    None without wear. A wear that decreases is none: a bending stiffness that rises is the rubber's.
    """
    history = tire.history
    thickness_mm, wear_mm = 1e3 * history.column("ring_thickness_m")[line.places], history.column("wear_mm")
    # Statements that only the wear rests on shift it: their levels are fitted beside those of the stiffness.
    wear_only = set(places_of(tire.changes, "wear_mm")) - set(places_of(tire.changes, name))
    design = np.column_stack([line.design, *level_columns(line.places, sorted(wear_only))])
    with np.errstate(invalid="ignore"):
        remaining = 1.0 - wear_mm[line.places] / thickness_mm
        used = ~line.search.is_outlier & (remaining > 0.0)
    if used.sum() < (~line.search.is_outlier).sum():
        return None
    percent = np.zeros(len(remaining))
    percent[used] = 100.0 * bending_left(remaining[used])
    wear_fit = fitted(design, percent, np.ones(len(remaining)), used)
    if wear_fit is None:
        return None
    padded = np.concatenate([along, np.zeros(design.shape[1] - len(along))])
    value = float(padded @ wear_fit.coefficients)
    return (value, math.sqrt(max(float(padded @ wear_fit.covariance @ padded), 0.0))) if value < 0.0 else None


def _steps_of(name: str, shape: Shape) -> list[int]:
    change = shape.change
    if name != "wear_mm" or change is None or not change.is_slope:
        return shape.steps
    # A tread does not jump where it begins to wear faster: the newest line of its own holds what the place is off.
    return [step for step in shape.steps if abs(step - change.begin) >= LEAST_POINTS]


def fit_line(
    tire: TireWork,
    name: str,
    values: FloatArray,
    stds: FloatArray,
    *,
    warm: bool = False,
    covariate: FloatArray | None = None,
    steps_from: float = 0.0,
    tested: bool = True,
) -> TrendLine | None:
    """Fit a trend with steps, test for outliers, and keep the series; None with too few values.

    Args:
        tire: to add series and outliers to.
        name: of the series; the wear is followed over the distance, others over the time.
        values: (n,) NaN where unknown, in the unit of the series.
        stds: (n,) stated errors.
        warm: whether the temperature may have an influence.
        covariate: (n,) another influence.
        steps_from: least size of a step.
        tested: whether outliers are reported.
    """
    history, watch = tire.history, SERIES[name].watch
    abscissa = 1e-3 * history.km if name == "wear_mm" else history.months
    usable = np.isfinite(values)
    if warm:
        usable &= ~tire.readings.is_impossible
    index = np.flatnonzero(usable)
    if len(index) < LEAST_FREEDOM + 2 or not span_of(abscissa[index]) > 0.0:
        return None
    influence, spread = (tire.readings.temperature_degc, _LEAST_SPREAD_K) if warm else (covariate, _LEAST_SPREAD_SPEED)
    columns = [np.ones(len(index)), centred(abscissa[index])]
    if influence is not None and len(index) >= _LEAST_FOR_TEMPERATURE and varies(influence[index], spread):
        columns.append(centred(influence[index]))
    has_covariate = len(columns) > 2
    levels = level_columns(index, places_of(tire.changes, name))
    design = np.column_stack([*columns, *levels])
    pressure = _course_of_pressure(tire, name, index)
    design = np.column_stack([design, *pressure])
    loads = _levels_of_load(tire, name, index, design, values[index])
    design = np.column_stack([design, *loads])
    of_load = slice(design.shape[1] - len(loads), design.shape[1])
    chosen, chosen_stds = values[index], stds[index]
    shape = find_shape(
        design,
        chosen,
        family=tire.family,
        least_step=steps_from,
        least_change=_FOLLOWED * watch.notable,
        may_be_isolated=tested,
        is_level=name in _LEVELS,
    )
    steps, change = _steps_of(name, shape), shape.change
    all_doubts = history.doubts_of(name)
    doubts = [all_doubts[row] for row in index]

    def fitted_line(change: LateChange | None) -> TrendLine:
        plain = with_steps(design, steps)
        for columns in columns_of(change, steps, len(index)):
            full_design = np.column_stack([plain, *columns])
            weights = np.multiply(weights_of(full_design, chosen, chosen_stds), weights_by_doubt(doubts))
            if tested:
                search = find_outliers(full_design, chosen, weights, family=tire.family)
            else:
                all_used = np.ones(len(index), dtype=bool)
                search = OutlierSearch(~all_used, fitted(full_design, chosen, weights, all_used))
            if search.fit is not None:
                break
        doubt = doubt_of([doubts[row] for row in np.flatnonzero(~search.is_outlier)])
        dates = tuple(date_of(int(history.time_ns[row])) for row in index)
        return TrendLine(
            index,
            chosen,
            chosen_stds,
            full_design,
            steps,
            search,
            has_covariate,
            doubt,
            len(levels),
            dates,
            change,
            len(columns) > 1,
            of_load,
            of_load.start - 1 if pressure else None,
            history.months[index],
        )

    line = fitted_line(change)
    if change is None and line.search.fit is not None and (begin := last_run(line)) is not None:
        # The newest recordings do not fit, but agree with each other.
        change = LateChange(begin, False, (np.arange(len(index)) >= begin).astype(np.float64))
        line = fitted_line(change)
    if change is not None and not change.is_slope and steps_from and size_of_change(line)[0] > 0.0:
        steps = [*steps, change.begin]
        line = fitted_line(None)
    if line.search.fit is None:
        return None
    _keep_line(tire, name, line, tested=tested)
    if line.doubt is None:
        tire.findings += _findings_of_line(tire, name, line)
        tire.onsets[name] = list(notable_changes(name, line))
    return line


def _levels_of_load(
    tire: TireWork, name: str, index: IntArray, design: FloatArray, values: FloatArray
) -> list[FloatArray]:
    """Return columns of steps of the load for what follows it: the contact is another, and what is taken from it."""
    if name == "estimated_load_n" or not (name == "wear_mm" or Basis.LOAD in SERIES[name].watch.follows):
        return []
    columns: list[FloatArray] = []
    for change in tire.onsets.get("estimated_load_n", ())[:_MOST_LOAD_LEVELS]:
        if change.begin is None:
            continue
        # What follows the load shows the place of its step more sharply.
        close = np.flatnonzero(np.abs(index - change.begin) <= change.apart)
        designs = [np.column_stack([design, *columns, level]) for level in level_columns(index, index[close].tolist())]
        if designs:
            squares = [
                float(np.sum((values - rows @ np.linalg.lstsq(rows, values, rcond=None)[0]) ** 2)) for rows in designs
            ]
            columns.append(designs[int(np.argmin(squares))][:, -1])
    return columns


def _course_of_pressure(tire: TireWork, name: str, index: IntArray) -> list[FloatArray]:
    """Return the logarithm of the pressure for what follows it; nothing where it varies little.

    A tire's number goes with a power of the pressure: a cold week, refills and leaks would be changes of the tire. That
    of a warm tire is in what the temperature does to a stiffness, so only the bends of the cold one count there.
    """
    watch = SERIES[name].watch
    pressure_series = next((series for series in tire.series if series.name == PRESSURE), None)
    is_followed = Basis.PRESSURE in watch.follows and watch.trend in (Trend.LINE, Trend.STIFFNESS)
    if pressure_series is None or not is_followed or len(index) < _LEAST_FOR_TEMPERATURE:
        return []
    gauge = tire.readings.pressure_pa[index]
    is_measured = bool(np.all(tire.history.column("pressure_measured")[index] > 0.0))
    if watch.trend is Trend.LINE and is_measured and np.isfinite(gauge).all() and gauge.min() > 0.0:
        return [centred(np.log(gauge))] if np.log(gauge).std() > _LEAST_SPREAD_PRESSURE else []
    course = np.interp(tire.history.months[index], pressure_series.abscissa, pressure_series.expected)
    line = np.column_stack([np.ones(len(index)), tire.history.months[index]])
    bend = course - line @ np.linalg.lstsq(line, course, rcond=None)[0]
    if not np.ptp(bend) > SERIES[PRESSURE].watch.notable:
        return []
    return [centred(np.log(np.maximum(course, 1.0)))]


def _keep_line(tire: TireWork, name: str, line: TrendLine, *, tested: bool) -> None:
    """Keep the series of a line as figures show it, and its outliers."""
    history, watch, search, fit = tire.history, SERIES[name].watch, line.search, line.fit
    # Figures show what remains at the mean temperature or speed.
    influence = line.design[:, 2] * fit.coefficients[2] if line.has_covariate else np.zeros(len(line.values))
    if tested:
        tire.tested += len(line.values)
        outliers = [number for number in np.flatnonzero(search.is_outlier).tolist() if _is_reported(watch, fit, number)]
        tire.outliers += [_outlier(history, name, watch.unit, line, fit, number) for number in outliers]
    tire.series.append(
        TrendSeries(
            name=name,
            unit=watch.unit,
            against="km" if name == "wear_mm" else "months",
            abscissa=(history.km if name == "wear_mm" else history.months)[line.places],
            values=line.values - influence,
            stds=line.stds,
            expected=fit.expected - influence,
            is_outlier=search.is_outlier if tested else np.zeros(len(line.values), dtype=bool),
            steps=tuple(sorted({*line.steps, *([line.change.begin] if line.change is not None else [])})),
        )
    )


def _is_reported(watch: Watch, fit: Fit, number: int) -> bool:
    """Return whether an outlier is reported: a sensor's only to the worse, and by what is worth a finding."""
    residual = float(fit.residuals[number])
    return watch.trend is not Trend.SENSOR or (
        residual * (watch.worse or residual) > 0.0 and abs(residual) >= watch.notable
    )


def _findings_of_line(tire: TireWork, name: str, line: TrendLine) -> Iterator[Finding]:
    """Yield a finding for each notable change from one recording on, and for recordings in a row that deviate."""
    history, fit, watch = tire.history, line.fit, SERIES[name].watch
    for begin, end in runs_of_outliers(line.search):
        # Of one that is worse at first, as of one that is better for a while, nothing is left to do.
        side = fit.residuals[begin] * watch.worse
        if side < 0.0 < begin or (side > 0.0 and begin < LEAST_POINTS):
            continue
        if _is_passage(line, begin, end):
            continue
        scale = fit.scale / np.sqrt(fit.weights[begin:end])
        lowest = float(np.abs(fit.residuals[begin:end] / scale).min()) if fit.scale > 0.0 else math.inf
        reason = Reason(FleetCode.TREND_PASSED, name=name, deviations=lowest, **part_of_line(history, line, begin, end))
        yield Finding(reason, name, relative_change(name, line, begin, size_of_run(line, begin, end)))
    yield from _load_findings(tire, name, line)
    yield from _pressure_findings(tire, name, line)
    for number, begin in enumerate(line.steps):
        size, std = size_of_step(line, number)
        if watch.falls_with_wear:
            contrast = np.zeros(line.design.shape[1])
            contrast[column_of_step(line, number)] = 1.0
            softening = softened_by_wear(tire, name, line, contrast)
            size, std = (size, std) if softening is None else (size - softening[0], math.hypot(std, softening[1]))
        is_certain = abs(size) > finding_quantile(line) * std
        if abs(size) >= watch.notable and is_certain and size * (watch.worse or size) > 0.0:
            end = min([step for step in line.steps if step > begin], default=len(line.values))
            changed = reason_of_change(watch.level, tire, name, line, (size, std), begin, end)
            yield Finding(changed, name, relative_change(name, line, begin, (size, std)))
    if line.change is not None and (newest := _newest_change(tire, name, line, line.change)) is not None:
        yield newest


def _is_passage(line: TrendLine, begin: int, end: int) -> bool:
    """Return whether outliers are values between two levels, through which a step that does not come at once passes."""
    if end in line.steps or begin not in line.steps:
        return end in line.steps
    size, _ = size_of_step(line, line.steps.index(begin))
    return size * float(line.fit.residuals[begin]) < 0.0


def _load_findings(tire: TireWork, name: str, line: TrendLine) -> Iterator[Finding]:
    """Yield what steps of the load make of a series: named with it, unless it is more than follows; wear is none."""
    watch = SERIES[name].watch
    for column in range(line.of_load.start, line.of_load.stop if name != "wear_mm" else 0):
        begin = int(np.flatnonzero(line.design[:, column])[0])
        size, std = combination(line, np.eye(line.design.shape[1])[column])
        if abs(size) >= watch.notable and abs(size) > finding_quantile(line) * std:
            changed = reason_of_change(watch.level, tire, name, line, (size, std), begin, len(line.values))
            yield Finding(changed, name, relative_change(name, line, begin, (size, std)))


def _pressure_findings(tire: TireWork, name: str, line: TrendLine) -> Iterator[Finding]:
    """Yield what changes of the pressure make of a series: named with them, unless it is more than follows."""
    watch = SERIES[name].watch
    for change in tire.onsets.get(PRESSURE, ()) if line.of_pressure is not None else ():
        begin = int(np.searchsorted(line.places, change.begin)) if change.begin is not None else 0
        if not 0 < begin < len(line.places) or change.log_ratio is None:
            continue
        contrast = np.zeros(line.design.shape[1])
        contrast[line.of_pressure] = change.log_ratio
        size, std = combination(line, contrast)
        if abs(size) >= watch.notable and abs(size) > finding_quantile(line) * std:
            changed = reason_of_change(watch.level, tire, name, line, (size, std), begin, len(line.values))
            yield Finding(changed, name, relative_change(name, line, begin, (size, std)))


def _newest_change(tire: TireWork, name: str, line: TrendLine, change: LateChange) -> Finding | None:
    """Return the finding of the change that the newest recordings show; None where it needs no attention."""
    history, watch = tire.history, SERIES[name].watch
    size, std = size_of_change(line)
    explained = softened_by_wear(tire, name, line, size_of_change_at(line)) if watch.falls_with_wear else None
    if explained is not None:
        size, std = size - explained[0], math.hypot(std, explained[1])
    if size * (watch.worse or size) <= 0.0:
        return None
    if watch.worse and watch.trend is Trend.SENSOR:
        # A sensor that was better for a while is not worse than before.
        influence = line.design[:, 2] * line.fit.coefficients[2] if line.has_covariate else 0.0
        levels = watch.worse * (line.fit.expected - influence)
        if levels[-1] - levels[: change.begin].max() < watch.notable:
            return None
    if change.is_slope and name in ("wear_mm", PRESSURE):
        changed = _changed_rate(history, name, line, change, abs(size) >= watch.notable)
    elif abs(size) >= watch.notable:
        code = FleetCode.TREND_SLOPE_CHANGED if change.is_slope else watch.level
        changed = reason_of_change(code, tire, name, line, (size, std), change.begin, len(line.values))
    else:
        changed = None
    return None if changed is None else Finding(changed, name, relative_change(name, line, change.begin, (size, std)))


def _changed_rate(
    history: TireHistory, name: str, line: TrendLine, change: LateChange, is_notable: bool
) -> Reason | None:
    """Return that wear or loss of pressure have become faster.

    Slower wear needs no attention; a leak does before it has become a low pressure.
    """
    before, after = combination(line, slope_before(line)), combination(line, slope_after(line))
    part = part_of_line(history, line, change.begin, len(line.values))
    bend, bend_std = combination(line, slope_after(line) - slope_before(line))
    if abs(bend) < finding_quantile(line) * bend_std:
        return None
    if name == "wear_mm" and bend > 0.0 and is_notable:
        return Reason(
            FleetCode.TREND_WEAR_CHANGED, before_m=1e-3 * before[0], before_std_m=1e-3 * before[1],
            after_m=1e-3 * after[0], after_std_m=1e-3 * after[1], **part,
        )  # fmt: skip
    # A pressure that rises was filled up: what follows is no change of a loss.
    is_filled = before[0] > 2.0 * before[1]
    if name != "wear_mm" and bend < 0.0 and not is_filled and -after[0] > max(1e-3 * NOTABLE_LOSS_PA, 2.0 * after[1]):
        return Reason(
            FleetCode.TREND_LOSS_CHANGED, before_pa=-1e3 * before[0], before_std_pa=1e3 * before[1],
            after_pa=-1e3 * after[0], after_std_pa=1e3 * after[1], **part,
        )  # fmt: skip
    return None


def reason_of_change(
    code: Code, tire: TireWork, name: str, line: TrendLine, size: tuple[float, float], begin: int, end: int
) -> Reason:
    """Return the finding of a change; that of a logarithm as a share of the value itself."""
    (change, std), watch = size, SERIES[name].watch
    if watch.is_logarithm:
        change, std = 100.0 * math.expm1(change / 100.0), std * math.exp(change / 100.0)
    cause: dict[str, Value] = {}
    if code is CoreCode.TREND_CONTACT_CHANGED:
        is_measured = (tire.history.column("pressure_measured") > 0.0) & np.isfinite(tire.readings.pressure_pa)
        cause["by"] = "measured" if is_measured[line.places].all() else "unmeasured"
    part = part_of_line(tire.history, line, begin, end)
    return Reason(code, name=name, change=change, std=std, unit=watch.unit, **cause, **part)


def _outlier(history: TireHistory, name: str, unit: str, line: TrendLine, fit: Fit, number: int) -> TrendOutlier:
    recording = int(line.places[number])
    scale = fit.scale / math.sqrt(float(fit.weights[number]))
    return TrendOutlier(
        history.vehicle,
        history.position,
        history.sensor_id,
        history.recordings[recording],
        history.paths[recording],
        int(history.time_ns[recording]),
        name,
        float(line.values[number]),
        float(fit.expected[number]),
        unit,
        float(fit.residuals[number]) / scale if scale > 0.0 else math.inf,
    )
