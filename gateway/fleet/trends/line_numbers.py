"""Numbers of a fitted line with error, status and reasons: its rate, and its value at the last recording."""

import math
from dataclasses import replace
from typing import Final

import numpy as np

from gateway.core.estimates.estimator import Status
from gateway.core.reasons import Reason
from gateway.core.types import FloatArray
from gateway.fleet.reasons import FleetCode
from gateway.fleet.trends.late_changes import LEAST_AFTER
from gateway.fleet.trends.regression import LEAST_FREEDOM
from gateway.fleet.trends.tire_history import MONTH_NS, TireHistory
from gateway.fleet.trends.trend_line import (
    TrendLine,
    combination,
    finding_quantile,
    quantile_of,
    slope_after,
    slope_before,
)
from gateway.fleet.trends.trend_result import TrendNumber

_DAY_S: Final = 86_400.0
DAY_MONTHS: Final = 1e9 * _DAY_S / MONTH_NS
# What changes within a day or a week (temperature, load, driver, road) is no ageing, and a rate per month from less
# than a week, a quarter of its unit, would be mostly that. The same share of 1,000 km is more than a day's drive. A
# pressure at one temperature changes by a leak only, which may be a fast one: a day is enough.
_LEAST_MONTHS: Final = 7.0 * DAY_MONTHS
_LEAST_VALID: Final = 8


def of_unidentified_tire(number: TrendNumber) -> TrendNumber:
    """Return a number as provisional, because recordings of several tires may be in it."""
    if number.status is Status.INVALID:
        return number
    return replace(
        number, status=Status.PROVISIONAL, reasons=(Reason(FleetCode.TREND_TIRE_UNIDENTIFIED), *number.reasons)
    )


def shared_std(stds: FloatArray) -> float:
    """Return the stated error that all recordings share; 0 when it is not known."""
    return float(np.nanmedian(stds)) if np.isfinite(stds).any() else 0.0


def rate_number(
    quantity: str,
    unit: str,
    line: TrendLine,
    *,
    against: str = "months",
    least: float = _LEAST_MONTHS,
    factor: float = 1.0,
    status: Status = Status.VALID,
    reasons: tuple[Reason, ...] = (),
) -> TrendNumber:
    """Return the trend of a line as a number; none from a span that is too short for its unit.

    Args:
        quantity: what it is.
        unit: of the number.
        line: fitted.
        against: "months" or "km" (thousands), the abscissa of the line.
        least: span that is needed.
        factor: of the coefficient.
        status: of the number where it has one.
        reasons: notes.
    """
    span, change = float(np.ptp(line.design[~line.search.is_outlier, 1])), line.change
    if span < least:
        if against == "km":
            reason = Reason(FleetCode.TREND_DISTANCE_SHORT, distance_m=1e6 * span, needed_m=1e6 * least)
        else:
            second = _DAY_S / DAY_MONTHS
            reason = Reason(FleetCode.TREND_SPAN_SHORT, span_s=second * span, needed_s=second * least)
        return TrendNumber(quantity, unit=unit, reasons=(reason,), count=int((~line.search.is_outlier).sum()))
    reasons = (*reasons, *notes_of_steps(line))
    contrast = slope_before(line)
    if change is None:
        return number_of(quantity, unit, line, contrast, factor=factor, status=status, reasons=reasons)
    end = len(line.values)
    if not change.is_slope or line.newest < LEAST_AFTER or np.ptp(line.design[change.begin - 1 :, 1]) < least:
        omitted = Reason(FleetCode.TREND_NEWEST_LEFT, count=end - change.begin, date=line.dates[change.begin])
        return number_of(
            quantity, unit, line, contrast, factor=factor, status=Status.PROVISIONAL, reasons=(omitted, *reasons)
        )
    value, std = combination(line, contrast)
    since = Reason(
        FleetCode.TREND_RATE_SINCE, count=end - change.begin, date=line.dates[change.begin], before=factor * value,
        std=abs(factor) * std, unit=unit,
    )  # fmt: skip
    if line.newest < _LEAST_VALID:
        status = Status.PROVISIONAL
    return number_of(quantity, unit, line, slope_after(line), factor=factor, status=status, reasons=(since, *reasons))


def notes_of_steps(line: TrendLine) -> tuple[Reason, ...]:
    """Return that a line has steps, where it has."""
    return (Reason(FleetCode.TREND_STEPS, count=len(line.steps)),) if line.steps else ()


def number_of(
    quantity: str,
    unit: str,
    line: TrendLine,
    along: FloatArray,
    *,
    factor: float = 1.0,
    status: Status = Status.VALID,
    reasons: tuple[Reason, ...] = (),
) -> TrendNumber:
    """Return a combination (p,) of the coefficients of a line as a number."""
    from scipy import stats

    fit = line.fit
    value, std = combination(line, along)
    value, std = factor * value, abs(factor) * std
    freedom, count = fit.freedom, fit.freedom + fit.coefficients.size
    if line.has_own_line and along[line.change_at :].any():
        freedom, count = max(1, min(freedom, line.newest - 2)), line.newest
    half = float(stats.t.ppf(0.975, freedom)) * std
    outliers = int(line.search.is_outlier.sum())
    notes = (*reasons, Reason(FleetCode.TREND_OUTLIERS_LEFT_OUT, count=outliers)) if outliers else reasons
    number = TrendNumber(quantity, value, std, unit, status, notes, count, freedom, value - half, value + half)
    return with_doubts(number, line)


def value_at_end(quantity: str, unit: str, line: TrendLine) -> TrendNumber:
    """Return the value of the trend at the last recording; its error includes what all recordings share.

    It follows a change. It is provisional where few recordings show the newest state, or the last one contradicts it.
    """
    row = line.design[-1].copy()
    if line.has_covariate:
        row[2] = 0.0
    row[line.of_load] = 0.0
    number = number_of(quantity, unit, line, row, reasons=notes_of_steps(line))
    shared_error = shared_std(line.stds)
    half, std = math.hypot(number.high - number.value, 2.0 * shared_error), math.hypot(number.std, shared_error)
    number = replace(number, std=std, low=number.value - half, high=number.value + half)
    if (change := line.change) is not None:
        since = Reason(FleetCode.TREND_NOW_SINCE, count=len(line.values) - change.begin, date=line.dates[change.begin])
        is_few = not change.is_slope or line.newest < _LEAST_VALID
        number = replace(
            number, status=Status.PROVISIONAL if is_few else number.status, reasons=(since, *number.reasons)
        )
    if (deviation := _deviation_of_last(line)) is not None:
        last = Reason(FleetCode.TREND_LAST_DEVIATES, deviation=deviation, date=line.dates[-1])
        number = replace(number, status=Status.PROVISIONAL, reasons=(last, *number.reasons))
    return number


def _deviation_of_last(line: TrendLine) -> float | None:
    """Return the deviation of the last value in standard deviations where chance does not explain it."""
    fit = line.fit
    if not fit.scale > 0.0 or fit.freedom < LEAST_FREEDOM + 1:
        return None
    deviation = float(fit.residuals[-1]) * math.sqrt(float(fit.weights[-1])) / fit.scale
    if line.search.is_outlier[-1]:
        return deviation
    square = deviation**2 / (1.0 - float(fit.leverage[-1]))
    remaining = fit.freedom - square
    studentized = math.sqrt(square * (fit.freedom - 1) / remaining) if remaining > 0.0 else math.inf
    return deviation if studentized > quantile_of(fit.freedom - 1) else None


def with_doubts(number: TrendNumber, line: TrendLine) -> TrendNumber:
    """Return a number of a line with the doubts about its recordings, and the levels that are fitted apart."""
    notes = (Reason(FleetCode.TREND_STATED_LEVELS, count=line.levels),) if line.levels else ()
    if line.doubt is None:
        return replace(number, reasons=(*number.reasons, *notes))
    return replace(number, status=Status.PROVISIONAL, reasons=(line.doubt, *number.reasons, *notes))


def is_significant(number: TrendNumber, line: TrendLine) -> bool:
    """Return whether a valid number of a line differs from 0 by more than chance."""
    if number.status is not Status.VALID:
        return False
    if not number.std > 0.0:
        return number.value != 0.0
    return abs(number.value) > finding_quantile(line) * number.std


def reason_missing(history: TireHistory, name: str, values: FloatArray) -> Reason:
    """Return why a series gives no number."""
    if not has_rolled(history):
        return Reason(FleetCode.TREND_NO_REVOLUTION)
    count = int(np.isfinite(values).sum())
    if not count and history.invalid.get(name):
        return Reason(FleetCode.TREND_NO_VALUES, why=history.invalid[name])
    if count < LEAST_FREEDOM + 2:
        return Reason(FleetCode.TREND_TOO_FEW, count=count, needed=LEAST_FREEDOM + 2)
    return Reason(FleetCode.TREND_UNDETERMINED)


def has_rolled(history: TireHistory) -> bool:
    """Return whether a recording has a revolution, or does not say how many."""
    revolutions = history.column("revolutions")
    return not np.isfinite(revolutions).any() or bool((revolutions > 0.0).any())
