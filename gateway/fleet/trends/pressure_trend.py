"""Loss of pressure of a tire: refills, leaks from a date on, and the pressure of now.

Pressures are compared at one temperature by the gas law, with absolute ones: p20 = (p + p_atm) (293.15 K / T) - p_atm.
"""

import math
from dataclasses import replace
from typing import Final

import numpy as np

from gateway.core.constants import STANDARD_ATMOSPHERE_PA, ZERO_CELSIUS_K
from gateway.core.estimates.estimator import Status
from gateway.core.reasons import Reason, Value
from gateway.core.types import BoolArray, FloatArray, IntArray
from gateway.fleet.reasons import FleetCode
from gateway.fleet.trends.causes import Change, Finding
from gateway.fleet.trends.leak_model import (
    OF_FLOW,
    bent,
    is_steady_leak,
    mended_at,
    newest_fall,
    newest_leak,
    straightened,
)
from gateway.fleet.trends.line_numbers import (
    DAY_MONTHS,
    has_rolled,
    rate_number,
    reason_missing,
    shared_std,
    value_at_end,
    with_doubts,
)
from gateway.fleet.trends.plausible_readings import PlausibleReadings
from gateway.fleet.trends.refilled_pressure import (
    LEAST_RECORDINGS,
    MOST_REFILLS,
    PressureLoss,
    pressure_loss,
    scatter_of,
)
from gateway.fleet.trends.regression import LEAST_FREEDOM, correlation_factor
from gateway.fleet.trends.tire_history import MONTH_NS, TireHistory
from gateway.fleet.trends.tire_lines import NOTABLE_LOSS_PA, PRESSURE, TireWork, fit_line, stuck_temperature
from gateway.fleet.trends.trend_line import (
    TrendLine,
    combination,
    date_of,
    finding_quantile,
    is_constant,
    relative_change,
    slope_after,
    slope_before,
    span_of,
)
from gateway.fleet.trends.trend_result import Quantity, TrendNumber, TrendSeries

REFERENCE_DEGC: Final = 20.0
"""Temperature at which pressures are compared."""
_LEAST_LEAK_MONTHS: Final = DAY_MONTHS
# Time between refills of a driver who tops up often.
_OFTEN_MONTHS: Final = 7.0 * DAY_MONTHS
# Smaller refills are no steps of the line; they are part of the loss's likelihood.
_LEAST_REFILL_PA: Final = 3000.0
# Change of the temperature in a month that a sensor that is stuck does not show.
_UNSEEN_K: Final = 10.0
# Within hours, the sensor's temperature is behind that of a gas that a drive warms: 10 K are 11 kPa.
_NOTABLE_FALL_PA: Final = 20e3
# The same of the newest recordings together, which are below all before them: recordings, scatters, and size.
_LEAST_NEW, _MOST_NEW = 2, 5
_NEW_FALL_STDS: Final = 6.0
_NOTABLE_NEW_PA: Final = 4e3
# Recordings before them.
_LEAST_EARLIER, _MOST_EARLIER = 4, 8
_LEAST_SCATTER_KPA: Final = 0.3
# Share of the rate of a leak to which it is known where the finding states it; else it states the fall.
_KNOWN_RATE: Final = 0.4
# Errors by which a pressure rises that are no chance.
_CHANCE: Final = 2.0
# Ambient pressure of the weather at middle latitudes, which no wheel measures, and its integral time scale: twice the
# four days in which its correlation falls to 1/e.
_WEATHER_KPA: Final = 1.0
_WEATHER_MONTHS: Final = 8.0 * DAY_MONTHS


def cold_kpa(history: TireHistory, readings: PlausibleReadings) -> FloatArray:
    """Return (n,) gauge pressures at one temperature, NaN where they are not measured.

    Those of a tire that never sends a temperature are as they are.
    """
    measured = history.column("pressure_measured") > 0.0
    degc = readings.temperature_degc if readings.has_temperature else REFERENCE_DEGC
    warm = (degc + ZERO_CELSIUS_K) / (REFERENCE_DEGC + ZERO_CELSIUS_K)
    cold_pa = (readings.pressure_pa + STANDARD_ATMOSPHERE_PA) / warm - STANDARD_ATMOSPHERE_PA
    return np.where(measured, 1e-3 * cold_pa, math.nan)


def _comparable(tire: TireWork) -> tuple[FloatArray, Reason]:
    """Return (n,) pressures at one temperature in kPa, and why they give no number where they do not."""
    history, gauge = tire.history, tire.readings.pressure_pa
    measured = history.column("pressure_measured") > 0.0
    cold = tire.cold.cold_kpa
    if not has_rolled(history):
        reason = Reason(FleetCode.TREND_NO_REVOLUTION)
    elif not measured.any():
        reason = Reason(FleetCode.TREND_NOT_MEASURED, quantity="pressure")
    elif np.isfinite(cold).sum() > LEAST_FREEDOM + 1 and is_constant(gauge[np.isfinite(cold)]):
        # A gas that is warmed and cooled does not keep its pressure: a repeated value is no measurement of a loss.
        usable = np.isfinite(cold)
        reason = Reason(FleetCode.TREND_PRESSURE_CONSTANT, pressure_pa=float(gauge[usable][0]), count=int(usable.sum()))
        cold = np.full(len(cold), math.nan)
    else:
        reason = reason_missing(history, "", cold)
    usable_rows = np.flatnonzero(np.isfinite(cold))
    if usable_rows.size > LEAST_RECORDINGS:
        # What the tire lost before its leak was mended says nothing of now.
        cold = cold.copy()
        cold[
            : usable_rows[mended_at(history.months[usable_rows], cold[usable_rows], scatter_of(cold[usable_rows]))]
        ] = math.nan
    return cold, reason


def add_pressure(tire: TireWork) -> None:
    """Add loss of pressure and present pressure, and the finding of a loss or of a fall."""
    history = tire.history
    cold, reason = _comparable(tire)
    if _leak(tire, cold):
        return
    line = _pressure_line(tire, cold)
    refilled = None
    if line is not None:
        is_normal, change = _is_normal(line), line.change
        refilled = pressure_loss(history.months[line.places[is_normal]], line.values[is_normal])
        if refilled is None and change is None:
            reason = Reason(FleetCode.TREND_TOO_FEW, count=int(is_normal.sum()), needed=LEAST_RECORDINGS)
            line = None
    if line is None:
        tire.numbers.append(TrendNumber(Quantity.PRESSURE_LOSS, unit="kPa/month", reasons=(reason,)))
        tire.numbers.append(TrendNumber(Quantity.PRESSURE_NOW, unit="kPa", reasons=(reason,)))
        return
    plain, loss = _loss(tire, line, refilled)
    tire.numbers.append(loss)
    tire.findings = [_with_rate(finding, loss) for finding in tire.findings]
    tire.numbers.append(
        value_at_end(Quantity.PRESSURE_NOW, "kPa", line._replace(stds=_stated_kpa(history, line.places)))
    )
    if loss.status is Status.INVALID:
        if line.doubt is None and (fell := _fallen(history, line)) is not None:
            tire.findings.append(Finding(fell, PRESSURE, Change(int(line.places[0]))))
        return
    least_loss = loss.value - finding_quantile(line) * math.hypot(plain.std, _weather_error(tire, line))
    is_certain = (least_loss if refilled is None else min(refilled.least, least_loss)) > NOTABLE_LOSS_PA * 1e-3
    is_told = any(finding.series == PRESSURE for finding in tire.findings)
    is_lasting = not is_told and _loses_before_and_after(tire, line, loss)
    if loss.status is Status.VALID and (is_certain or is_lasting):
        series = tire.series[-1]
        refilled_at = max(line.steps if is_lasting else series.steps, default=0)
        loses = Reason(
            FleetCode.TREND_LOSES_PRESSURE, **_from_to(series, refilled_at), loss_pa=1e3 * loss.value,
            std_pa=1e3 * loss.std,
        )  # fmt: skip
        total_change = -loss.value * span_of(history.months), loss.std * span_of(history.months)
        tire.findings.append(Finding(loses, PRESSURE, relative_change(PRESSURE, line, None, total_change)))
    elif line.doubt is None and not is_told:
        # A fall is worth a stop before it has a rate.
        new_fall = _new_fall(tire, cold + max(loss.value, 0.0) * (history.months - history.months[-1]))
        tire.findings += () if new_fall is None else (new_fall,)


def _is_normal(line: TrendLine) -> BoolArray:
    """Return the recordings (n,) without outliers that have the newest slope and the usual level."""
    is_normal, change = ~line.search.is_outlier, line.change
    if change is not None and change.is_slope:
        is_normal[: change.begin - 1] = False
    elif change is not None:
        is_normal[change.begin :] = False
    return is_normal


def _loses_before_and_after(tire: TireWork, line: TrendLine, loss: TrendNumber) -> bool:
    """Return whether a certain loss before a change of slope goes on after it, whose few recordings prove less."""
    if line.change is None or not line.change.is_slope:
        return False
    slope, std = combination(line, slope_before(line))
    least_before = -slope - finding_quantile(line) * math.hypot(std, _weather_error(tire, line))
    return min(least_before, loss.value) > NOTABLE_LOSS_PA * 1e-3 and loss.value > _CHANCE * loss.std


def _stated_kpa(history: TireHistory, rows: IntArray) -> FloatArray:
    """Return the stated errors of the pressure sensor, which a difference of its readings has not."""
    return 1e-3 * history.column("pressure_std_pa")[rows]


def _with_rate(finding: Finding, loss: TrendNumber) -> Finding:
    """Return a finding of a faster loss with the rate and the error of the number."""
    is_rate_since = any(reason.code is FleetCode.TREND_RATE_SINCE for reason in loss.reasons)
    if finding.reason.code is not FleetCode.TREND_LOSS_CHANGED or not is_rate_since:
        return finding
    rate = {"after_pa": 1e3 * loss.value, "after_std_pa": 1e3 * loss.std}
    return finding._replace(reason=Reason(finding.reason.code, **{**dict(finding.reason.values), **rate}))


def _fitted(tire: TireWork, cold_kpa: FloatArray) -> TrendLine | None:
    """Fit the line of pressures (n,) at one temperature; None with too few."""
    return fit_line(tire, PRESSURE, cold_kpa, np.full(len(cold_kpa), math.nan), steps_from=_LEAST_REFILL_PA * 1e-3)


def _pressure_line(tire: TireWork, cold: FloatArray) -> TrendLine | None:
    """Fit the line of the pressure; that of a steady leak is straight in the time that its flow takes."""
    history = tire.history
    usable_rows = np.flatnonzero(np.isfinite(cold))
    is_steady = usable_rows.size > LEAST_RECORDINGS and is_steady_leak(
        history.months[usable_rows], cold[usable_rows], scatter_of(cold[usable_rows])
    )
    at_kpa = float(cold[usable_rows[-1]]) if usable_rows.size else math.nan
    straight_kpa = straightened(cold, at_kpa) if is_steady else cold
    line = _fitted(tire, straight_kpa)
    if line is not None and is_steady:
        series = tire.series[-1]
        tire.series[-1] = replace(series, values=bent(series.values, at_kpa), expected=bent(series.expected, at_kpa))
    if line is not None and line.change is not None:
        values = _from_to(tire.series[-1], line.change.begin - 1)
        tire.findings = [
            finding._replace(reason=Reason(finding.reason.code, **values, **dict(finding.reason.values)))
            if finding.reason.code is FleetCode.TREND_LOSS_CHANGED
            else finding
            for finding in tire.findings
        ]
    return line


def _from_to(series: TrendSeries, begin: int) -> dict[str, Value]:
    """Return fitted pressures at a recording and at the last one, and the time between them."""
    return {
        "from_pa": 1e3 * float(series.expected[begin]),
        "to_pa": 1e3 * float(series.expected[-1]),
        "over_s": 1e-9 * MONTH_NS * float(series.abscissa[-1] - series.abscissa[begin]),
    }


def _loss(tire: TireWork, line: TrendLine, refilled: PressureLoss | None) -> tuple[TrendNumber, TrendNumber]:
    """Return the loss by the line alone, and with refills, leak and temperature."""
    history, stuck = tire.history, stuck_temperature(tire, line.places)
    status, notes = (Status.VALID, ()) if stuck is None else (Status.PROVISIONAL, (stuck,))
    plain = rate_number(
        Quantity.PRESSURE_LOSS, "kPa/month", line, least=_LEAST_LEAK_MONTHS, factor=-1.0, status=status, reasons=notes
    )
    loss = (
        _with_refills(plain, refilled, line) if plain.status is not Status.INVALID and refilled is not None else plain
    )
    more_std = math.hypot(OF_FLOW * loss.value, _weather_error(tire, line))
    loss = replace(
        loss,
        std=math.hypot(loss.std, more_std),
        low=loss.value - math.hypot(loss.value - loss.low, 2.0 * more_std),
        high=loss.value + math.hypot(loss.high - loss.value, 2.0 * more_std),
    )
    if loss.status is Status.VALID and loss.value < -_CHANCE * loss.std:
        # No tire gains gas by itself: refills or what is not measured have made the trend.
        loss = replace(loss, status=Status.PROVISIONAL, reasons=(Reason(FleetCode.TREND_PRESSURE_RISES), *loss.reasons))
    fall = newest_fall(history.months[line.places], line.values, scatter_of(line.values))
    if loss.status is Status.VALID and fall is not None:
        # A leak that has begun has no rate yet, and the rate before it is not that of now.
        onset, deviation = fall
        below = Reason(
            FleetCode.TREND_NEWEST_FALL, count=len(line.values) - onset, date=line.dates[onset], deviation=deviation
        )
        loss = replace(loss, status=Status.PROVISIONAL, reasons=(below, *loss.reasons))
    return plain, loss


def _weather_error(tire: TireWork, line: TrendLine) -> float:
    """Return the error of a rate by the ambient pressure, in kPa a month: gauges measure against it.

    That of the least squares slope of values that are alike for some days. They scatter no more than the residuals and
    what the wheels have in common, of which level and slope take two degrees of freedom.
    """
    months = line.design[line.change.begin if line.change is not None and line.change.is_slope else 0 :, 1]
    span = max(float(np.ptp(months)), DAY_MONTHS)
    independent = max(span / _WEATHER_MONTHS, 2.0)
    scatter = math.hypot(float(line.fit.residuals[~line.search.is_outlier].std()), tire.cold.removed_kpa)
    scatter /= math.sqrt(max(1.0 - 2.0 / independent, 0.25))
    return min(_WEATHER_KPA, scatter) * math.sqrt(12.0 / independent) / span


def _leak(tire: TireWork, cold_kpa: FloatArray) -> bool:
    """Add the numbers and the finding of a leak that began at a date; return whether there is one.

    The recordings before it have the line, so that what the leak does is no step, and no trend of theirs.
    """
    history = tire.history
    rows = np.flatnonzero(np.isfinite(cold_kpa))
    if rows.size < 3:
        return False
    months, values = history.months[rows], cold_kpa[rows]
    stuck = stuck_temperature(tire, rows)
    # What an unseen change of the temperature makes of the pressure, by the gas law.
    unseen_kpa = (1e-3 * STANDARD_ATMOSPHERE_PA + values[-1]) * _UNSEEN_K / (REFERENCE_DEGC + ZERO_CELSIUS_K)
    drift_kpa = 1e-3 * NOTABLE_LOSS_PA if tire.cold.has_trend else float(unseen_kpa)
    leak = newest_leak(months, values, scatter_of(values), 0.0 if stuck is None else drift_kpa)
    if leak is None:
        return False
    tested, series_index = tire.tested, len(tire.series)
    line = _fitted(tire, np.where(np.arange(len(cold_kpa)) < rows[leak.begin], cold_kpa, math.nan))
    if line is None:
        tire.tested = tested
        return False
    series, count = tire.series[series_index], len(rows) - leak.begin
    tire.series[series_index] = replace(
        series,
        abscissa=months,
        values=values,
        stds=np.full(len(rows), math.nan),
        expected=np.concatenate([series.expected, leak.expected_kpa]),
        is_outlier=np.concatenate([series.is_outlier, np.zeros(count, dtype=bool)]),
        steps=(*series.steps, leak.begin),
    )
    slope, slope_std = combination(line, slope_after(line))
    first, last = int(rows[leak.begin]), int(rows[-1])
    date, until = date_of(int(history.time_ns[first])), date_of(int(history.time_ns[last]))
    since = Reason(FleetCode.TREND_RATE_SINCE, count=count, date=date, before=-slope, std=slope_std, unit="kPa/month")
    level_note = Reason(FleetCode.TREND_NOW_SINCE, count=count, date=date)
    now_std_kpa = math.hypot(leak.now_std_kpa, shared_std(_stated_kpa(history, rows)))
    status = Status.VALID if leak.is_certain else Status.PROVISIONAL
    for quantity, unit, value, std, state, reason in (
        (Quantity.PRESSURE_LOSS, "kPa/month", leak.rate_kpa, leak.rate_std_kpa, status, since),
        (Quantity.PRESSURE_NOW, "kPa", leak.now_kpa, now_std_kpa, status, level_note),
    ):
        number = TrendNumber(
            quantity,
            value,
            std,
            unit,
            state,
            (reason, *(() if stuck is None else (stuck,))),
            count,
            max(leak.freedom, 1),
            value - 2.0 * std,
            value + 2.0 * std,
        )
        tire.numbers.append(with_doubts(number, line))
    if line.doubt is None and leak.rate_kpa > NOTABLE_LOSS_PA * 1e-3:
        level = float(series.expected[-1])
        onset = Change(first, math.log(leak.now_kpa / level) if 0.0 < leak.now_kpa < level else None, grows=True)
        part: dict[str, Value] = {
            "date": date, "until": until, "count": count,
            "first": history.recordings[first], "last": history.recordings[last],
            "since_s": 1e-9 * (float(history.time_ns[0]) + MONTH_NS * leak.date_months),
            "since_std_s": 1e-9 * MONTH_NS * leak.date_std_months,
        }  # fmt: skip
        loses = Reason(
            FleetCode.TREND_LOSS_CHANGED, before_pa=-1e3 * slope, before_std_pa=1e3 * slope_std,
            after_pa=1e3 * leak.rate_kpa, after_std_pa=1e3 * leak.rate_std_kpa,
            **_from_to(tire.series[series_index], leak.begin - 1), **part,
        )  # fmt: skip
        if leak.rate_std_kpa > _KNOWN_RATE * leak.rate_kpa:
            fall_std = math.hypot(leak.now_std_kpa, scatter_of(values))
            loses = _reason_of_fall(history, int(rows[leak.begin - 1]), last, (level, leak.now_kpa), fall_std)
        tire.findings.append(Finding(loses, PRESSURE, onset))
        tire.onsets.setdefault(PRESSURE, []).append(onset)
    return True


def _hidden_by_frequent_refills(line: TrendLine) -> Reason | None:
    """Return what a tire could lose that is topped up to the same pressure every week; None where it is little.

    Its pressure is a saw-tooth, whose standard deviation is its height over the root of 12. No trend tells it from
    scatter, and the interval leaves it out: with it, it would hold nearly every loss of a sealed tire.
    """
    fit = line.fit
    hidden_pa = 1e3 * math.sqrt(12.0) * fit.scale / _OFTEN_MONTHS
    if hidden_pa < NOTABLE_LOSS_PA:
        return None
    # One digit: it is a bound by the scatter.
    digit = 10.0 ** math.floor(math.log10(hidden_pa))
    return Reason(FleetCode.TREND_REFILLS_OFTEN, often=MOST_REFILLS, hidden_pa=digit * round(hidden_pa / digit))


def _fallen(history: TireHistory, line: TrendLine) -> Reason | None:
    """Return the finding of a large fall of the pressure within a time that is too short for a rate."""
    used = np.flatnonzero(~line.search.is_outlier)
    first, last = int(line.places[used[0]]), int(line.places[used[-1]])
    change, std = combination(line, line.design[used[-1]] - line.design[used[0]])
    if -1e3 * change < _NOTABLE_FALL_PA or -change < finding_quantile(line) * std:
        return None
    last_kpa = float(line.fit.expected[used[-1]])
    return _reason_of_fall(history, first, last, (last_kpa - change, last_kpa), std)


def _new_fall(tire: TireWork, cold_kpa: FloatArray) -> Finding | None:
    """Return the finding of a fall that the newest recordings show and that is too new for a rate; None without one.

    Args:
        tire: the work on the tire.
        cold_kpa: (n,) pressures at one temperature without their trend, NaN where unknown.
    """
    rows = np.flatnonzero(np.isfinite(cold_kpa))
    values = cold_kpa[rows]
    if rows.size < LEAST_RECORDINGS:
        return None
    scatter = max(scatter_of(values), _LEAST_SCATTER_KPA)
    for count in range(min(_MOST_NEW, rows.size - _LEAST_EARLIER), _LEAST_NEW - 1, -1):
        before, after = values[:-count][-_MOST_EARLIER:], values[-count:]
        level, std = float(np.median(before)), scatter * math.sqrt(1.0 + 0.5 * math.pi / len(before))
        fall = level - float(after[-1])
        if after.max() < before.min() - scatter and fall > max(1e-3 * _NOTABLE_NEW_PA, _NEW_FALL_STDS * std):
            ends_kpa = (level, float(after[-1]))
            fell = _reason_of_fall(tire.history, int(rows[-count - 1]), int(rows[-1]), ends_kpa, std)
            return Finding(fell, PRESSURE, Change(int(rows[-count]), -fall / level, grows=True))
    return None


def _reason_of_fall(
    history: TireHistory, first: int, last: int, ends_kpa: tuple[float, float], std_kpa: float
) -> Reason:
    """Return that the pressure has fallen between two recordings."""
    before_kpa, now_kpa = ends_kpa
    return Reason(
        FleetCode.TREND_PRESSURE_FELL,
        from_pa=1e3 * before_kpa,
        to_pa=1e3 * now_kpa,
        fall_pa=1e3 * (before_kpa - now_kpa),
        std_pa=1e3 * std_kpa,
        span_s=1e-9 * float(history.time_ns[last] - history.time_ns[first]),
        first=history.recordings[first],
        last=history.recordings[last],
        **history.since(min(first + 1, last) if first else 0),
    )


def _with_refills(plain: TrendNumber, refilled: PressureLoss, line: TrendLine) -> TrendNumber:
    """Return the pressure loss with refills that no step shows; its errors are those of the line at least.

    The line knows of recordings that follow each other, the likelihood of refills does not.
    """
    half_width = 0.5 * (plain.high - plain.low)
    low, high = min(refilled.low, refilled.value - half_width), max(refilled.high, refilled.value + half_width)
    notes = plain.reasons
    # Without refills the interval would be less than half as wide upwards: they are what limits it.
    if high - refilled.value > 2.0 * (refilled.high_unrefilled - refilled.value) and high - refilled.value > half_width:
        notes = (*notes, Reason(FleetCode.TREND_REFILLS_HIDE, low_pa=1e3 * max(low, 0.0), high_pa=1e3 * high))
    if (refill_note := _hidden_by_frequent_refills(line)) is not None:
        notes = (*notes, refill_note)
    std = max(refilled.std, plain.std)
    # Weather makes recordings that follow each other alike, and so do refills: which of the two is not known.
    used = ~line.search.is_outlier
    if correlation_factor(line.fit.residuals[used], line.fit.coefficients.size) > 1.0:
        std = math.hypot(std, 0.5 * (refilled.value - plain.value))
    return replace(plain, value=refilled.value, std=std, low=low, high=high, reasons=notes)
