"""A sensor that degrades: noise, losses, clipping, mounting offset, gain and zero over the time."""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import Final

import numpy as np

from gateway.core.estimates.estimator import Status
from gateway.core.quantity import Trend, Watch
from gateway.core.reasons import Reason
from gateway.fleet.reasons import FleetCode
from gateway.fleet.trends.causes import Change, Finding
from gateway.fleet.trends.late_changes import LEAST_AFTER
from gateway.fleet.trends.line_numbers import is_significant, rate_number, reason_missing
from gateway.fleet.trends.steady_value import parted_drift, zero_of
from gateway.fleet.trends.tire_lines import TireWork, fit_line, reason_of_change
from gateway.fleet.trends.trend_line import (
    TrendLine,
    combination,
    finding_quantile,
    from_first_to_last,
    inflation,
    notable_changes,
    quantile_of,
    relative_change,
    size_of_step,
    span_of,
)
from gateway.fleet.trends.trend_result import TrendNumber, rate_of
from gateway.fleet.trends.watched_series import SERIES, followed_by

# Inflation of the variance of a trend by a covariate from which the two are usually called collinear.
_MOST_INFLATION: Final = 10.0
# Share of the whole change of the steady value to which gain and zero are known where they are parted.
_PARTED_SHARE: Final = 0.25
# Series of the sensor whose outliers are reported.
_TESTED_OF_SENSOR: Final = frozenset({"noise_mps2", "mounting_offset_m"})
# Value of the finding of a sensor that drifts, from the change in the unit of the series.
_DRIFTS: Final[Mapping[str, Callable[[float], float]]] = {
    "factor": lambda change: math.exp(change / 100.0),
    "share": lambda change: change / 100.0,
    "change_m": lambda change: change * 1e-3,
    "change_mps2": lambda change: change,
}


def add_sensor(tire: TireWork) -> None:
    """Look for a sensor that degrades: noise, losses, clipping, offset, gain and zero over the time."""
    history = tire.history
    speed = history.column("speed_mean_mps")
    with np.errstate(invalid="ignore", divide="ignore"):
        noise = 100.0 * np.log(history.column("noise_mps2"))
        clipped = 100.0 * history.column("samples_saturated") / history.column("samples")
        lost = history.column("samples_lost") / (history.column("samples") + history.column("samples_lost"))
        log_speed = np.log(speed)
    derived = {"noise_mps2": noise, "samples_lost": 100.0 * lost, "samples_saturated": clipped}
    for name, _, watch in followed_by(Trend.SENSOR):
        if name in derived:
            values, stds = derived[name], np.full(len(speed), math.nan)
        else:
            values, stds = watch.factor * history.column(name), watch.factor * history.column(_std_of(name))
        covariate = log_speed if name == "noise_mps2" else None
        changes_from = len(tire.findings)
        line = fit_line(tire, name, values, stds, covariate=covariate, tested=name in _TESTED_OF_SENSOR)
        if line is not None:
            _judge_sensor(tire, name, line, changes_from)
            continue
        reason = reason_missing(history, name if name in history.invalid else "", values)
        tire.numbers.append(TrendNumber(rate_of(watch), unit=f"{watch.unit}/month", reasons=(reason,)))


def _judge_sensor(tire: TireWork, name: str, line: TrendLine, changes_from: int) -> None:
    """Add the rate of a series of the sensor, and what it shows: the changes of the line, a step or a drift.

    Args:
        tire: the work on the tire.
        name: of the series.
        line: of it.
        changes_from: index of the first finding of the line.
    """
    watch = SERIES[name].watch
    rate = rate_number(rate_of(watch), f"{watch.unit}/month", line)
    # Of a covariate that goes with the time, what bends its influence looks like a trend.
    is_separable = not line.has_covariate or inflation(line) < _MOST_INFLATION
    if not is_separable:
        del tire.findings[changes_from:]
        if rate.status is not Status.INVALID:
            reason = Reason(FleetCode.TREND_SPEED_WITH_TIME)
            rate = replace(rate, status=Status.PROVISIONAL, reasons=(reason, *rate.reasons))
    tire.numbers.append(rate)
    if name == "gain" and line.doubt is not None:
        # That gain and zero are not parted in a recording, or contradict what is stated, is what changes.
        _add_steady_value(tire, name, line)
        return
    change, std = combination(line, from_first_to_last(line))
    is_drift = is_significant(rate, line)
    growth = _growth(line, watch, change, std)
    # A single change that the series shows is told with its date; a drift beside it by the whole change.
    is_dated = (
        growth is None
        and len(tire.findings) == changes_from + 1
        and (abs(rate.value) * span_of(tire.history.months) <= watch.notable or not is_drift)
    )
    is_worse = change * (watch.worse or change) > 0.0
    is_notable = is_worse and abs(change) > max(watch.notable, finding_quantile(line) * std)
    if is_dated or not is_notable or rate.status is not Status.VALID or not is_separable:
        return
    if line.steps and not is_drift and growth is None:
        # What changes at once has a date.
        del tire.findings[changes_from:]
        tire.findings.append(_largest_step(tire, name, line))
    elif watch.drift:
        del tire.findings[changes_from:]
        change, std = growth or (change, std)
        code, value = watch.drift
        drift = Reason(code, **{value: _DRIFTS[value](change)}, std=_std_of_drift(value, change, std))
        tire.findings.append(Finding(drift, name))


def _add_steady_value(tire: TireWork, name: str, line: TrendLine) -> None:
    findings = list(_steady_value(tire, line))
    tire.findings += findings
    tire.onsets |= {finding.series: list(notable_changes(name, line)) for finding in findings}


def _growth(line: TrendLine, watch: Watch, change: float, std: float) -> tuple[float, float] | None:
    """Return the present size, with its error, of what grows and is fitted by steps one after the other."""
    steps = range(len(line.steps))
    limit = abs(change) - watch.notable
    if not watch.worse or len(steps) < 2 or any(abs(size_of_step(line, step)[0]) >= limit for step in steps):
        return None
    # The last level lags behind what grows.
    newest = line.fit.residuals[-LEAST_AFTER:]
    return change + float(newest.mean()), math.hypot(std, line.fit.scale / math.sqrt(len(newest)))


def _largest_step(tire: TireWork, name: str, line: TrendLine) -> Finding:
    sizes = [size_of_step(line, number) for number in range(len(line.steps))]
    largest = int(np.argmax([abs(size) for size, _ in sizes]))
    begin, end = line.steps[largest], min([*line.steps[largest + 1 :], len(line.values)])
    step = reason_of_change(SERIES[name].watch.level, tire, name, line, sizes[largest], begin, end)
    return Finding(step, name, relative_change(name, line, begin, sizes[largest]))


def _std_of_drift(value: str, change: float, std: float) -> float:
    """Return the error of the value of a drift from that of the change."""
    return abs(_DRIFTS[value](change + std) - _DRIFTS[value](change - std)) / 2.0


def _steady_value(tire: TireWork, line: TrendLine) -> Iterator[Finding]:
    """Yield what has changed of a sensor whose recordings do not part gain and zero: either, where all together do."""
    history = tire.history
    radius_m, speed_mps = history.column("stated_radius_m"), history.column("speed_mean_mps")
    of_gain, of_zero = SERIES["gain"], SERIES["zero_g_offset_mps2"]
    gain, zero = of_gain.watch, of_zero.watch
    steps = sorted({*line.steps, *([line.change.begin] if line.change is not None else [])})
    places = [int(line.places[step]) for step in steps]
    parted = parted_drift(history.months, history.column("gain"), radius_m, speed_mps, places)
    change, std = combination(line, from_first_to_last(line))
    share, least_gain = change / gain.factor, gain.notable / gain.factor
    as_zero_mps2 = zero_of(share, radius_m, speed_mps)
    # Two are parted where each is known to a share of what would explain all, or of what matters.
    if (
        parted is not None
        and parted.gain_std < _PARTED_SHARE * max(abs(share), 2.0 * least_gain)
        and parted.zero_std_mps2 < _PARTED_SHARE * max(abs(as_zero_mps2), 2.0 * zero.notable)
    ):
        quantile = quantile_of(parted.freedom)
        changes = (
            (of_gain, parted.gain, parted.gain_std, least_gain),
            (of_zero, parted.zero_mps2, parted.zero_std_mps2, zero.notable),
        )
        for (name, _, watch), size, size_std, notable in changes:
            if abs(size) <= max(quantile * size_std, notable) or watch.drift is None:
                continue
            if parted.begin is None:
                code, value = watch.drift
                yield Finding(Reason(code, **{value: size}, std=size_std), name)
            else:
                scaled, begin = (watch.factor * size, watch.factor * size_std), steps[parted.begin]
                reason = reason_of_change(watch.level, tire, name, line, scaled, begin, len(line.values))
                yield Finding(reason, name, Change(places[parted.begin]))
    elif abs(change) > finding_quantile(line) * std and (abs(share) > least_gain or abs(as_zero_mps2) > zero.notable):
        steady = Reason(
            FleetCode.TREND_SENSOR_STEADY, share=share, std=std / gain.factor,
            change_mps2=as_zero_mps2, zero_std_mps2=abs(as_zero_mps2 * std / change),
        )  # fmt: skip
        yield Finding(steady, "gain", Change(places[0] if len(places) == 1 else None))


def _std_of(name: str) -> str:
    """Return the column of the standard error of a column: that of a condition has its unit at the end."""
    return "mounting_offset_std_m" if name == "mounting_offset_m" else f"{name}_std"
