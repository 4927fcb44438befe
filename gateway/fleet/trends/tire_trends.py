"""Wear, load and stiffness of a tire over its recordings.

Bs, Rs and Ts are stiffnesses over the pressure, so their drift is that of the number times the pressure.
"""

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Final

import numpy as np

from gateway.core.estimates.estimator import Status
from gateway.core.reasons import Reason
from gateway.fleet.reasons import FleetCode
from gateway.fleet.trends.causes import Change, Finding
from gateway.fleet.trends.line_numbers import (
    is_significant,
    notes_of_steps,
    number_of,
    rate_number,
    reason_missing,
    shared_std,
    value_at_end,
    with_doubts,
)
from gateway.fleet.trends.tire_history import MONTH_NS, TireHistory
from gateway.fleet.trends.tire_lines import TireWork, fit_line, softened_by_wear, stuck_temperature
from gateway.fleet.trends.trend_line import (
    TrendLine,
    combination,
    finding_quantile,
    from_first_to_last,
    relative_change,
    slope_after,
    span_of,
)
from gateway.fleet.trends.trend_result import Quantity, TrendNumber, by_temperature, rate_of
from gateway.fleet.trends.watched_series import Series

_LEAST_1000KM: Final = 0.25
# Percent a month by which rubber hardens with age.
_AGEING: Final = 1.0
# Wear that no tire has within a distance, with a rate or without.
_NOTABLE_WEAR_MM: Final = 0.5
_SHORT_KM: Final = 1000.0


def add_wear(tire: TireWork) -> None:
    """Add rate and present value of the wear, and the finding of a wear that is too new for a rate."""
    history = tire.history
    wear = history.column("wear_mm")
    reason = reason_missing(history, "wear_mm", wear)
    if math.isfinite(history.km[0]) and not span_of(history.km) > 0.0 and np.isfinite(wear).any():
        reason = Reason(FleetCode.TREND_DISTANCE_CONSTANT)
    line = fit_line(tire, "wear_mm", wear, history.column("wear_mm_std"), warm=True)
    recorded = Reason(FleetCode.TREND_RECORDED_DISTANCE, distance_m=1e3 * span_of(history.km))
    basis = () if history.has_odometer else (recorded,)
    if line is None:
        tire.numbers.append(TrendNumber(Quantity.WEAR_RATE, unit="mm/1000 km", reasons=(reason,)))
        tire.numbers.append(TrendNumber(Quantity.WEAR_NOW, unit="mm", reasons=(reason,)))
        return
    status = Status.VALID if history.has_odometer else Status.PROVISIONAL
    rate = rate_number(
        Quantity.WEAR_RATE, "mm/1000 km", line, against="km", least=_LEAST_1000KM, status=status, reasons=basis
    )
    tire.numbers.append(rate)
    tire.numbers.append(value_at_end(Quantity.WEAR_NOW, "mm", line))
    worn, std = combination(line, from_first_to_last(line))
    span_km = span_of(history.km[line.places])
    if (
        (rate.status is Status.INVALID or span_km < _SHORT_KM)
        and line.doubt is None
        and worn > max(_NOTABLE_WEAR_MM, finding_quantile(line) * std)
    ):
        wears = Reason(FleetCode.TREND_WEARS_SHORT, wear_m=1e-3 * worn, std_m=1e-3 * std, distance_m=1e3 * span_km)
        tire.findings.append(Finding(wears, "wear_mm", Change(int(line.places[0]))))


def add_load(tire: TireWork) -> None:
    """Add the load: measured, or as it is stated."""
    history = tire.history
    measured, stds = history.column("estimated_load_n"), history.column("estimated_load_n_std")
    line = None
    if np.isfinite(measured).any():
        line = fit_line(tire, "estimated_load_n", measured, stds)
    if line is None:
        tire.numbers += _stated_load(history, reason_missing(history, "estimated_load_n", measured))
        return
    tire.numbers += _measured_load(line)
    slope, std = combination(line, slope_after(line))
    if line.doubt is None and abs(slope) > std:
        # What follows the load drifts with it, also where that is no finding.
        total_change = slope * span_of(line.months), std * span_of(line.months)
        tire.onsets["estimated_load_n"].append(relative_change("estimated_load_n", line, None, total_change))


def add_rate(tire: TireWork, series: Series) -> None:
    """Fit the line of a quantity over the months."""
    history, watch = tire.history, series.watch
    values, stds = (watch.factor * history.column(name) for name in (series.name, f"{series.name}_std"))
    line = fit_line(tire, series.name, values, stds)
    unit = f"{watch.unit}/month"
    if line is None:
        reason = reason_missing(history, series.name, values)
        tire.numbers.append(TrendNumber(rate_of(watch), unit=unit, reasons=(reason,)))
    else:
        tire.numbers.append(rate_number(rate_of(watch), unit, line))


def _measured_load(line: TrendLine) -> Iterator[TrendNumber]:
    fit, used = line.fit, ~line.search.is_outlier
    values, steps = line.values[used], notes_of_steps(line)
    count, shared_error = int(values.size), shared_std(line.stds)
    std = math.hypot(shared_error, float(np.std(values, ddof=1)) / math.sqrt(count))
    mean = float(values.mean())
    load = TrendNumber(
        Quantity.LOAD, mean, std, "N", Status.VALID, (), count, fit.freedom, mean - 2.0 * std, mean + 2.0 * std
    )
    yield with_doubts(load, line)
    yield rate_number(Quantity.LOAD_RATE, "N/month", line)
    scatter = float(np.std(fit.residuals[used], ddof=fit.coefficients.size))
    scatter_std = scatter / math.sqrt(2.0 * fit.freedom)
    spread = TrendNumber(
        Quantity.LOAD_SCATTER, scatter, scatter_std, "N", Status.VALID, steps, count, fit.freedom,
        scatter - 2.0 * scatter_std, scatter + 2.0 * scatter_std,
    )  # fmt: skip
    yield with_doubts(spread, line)


def _stated_load(history: TireHistory, reason: Reason) -> Iterator[TrendNumber]:
    """Yield the stated load where none is measured."""
    loads_n = history.column("load_n")
    is_stated = np.isfinite(loads_n)
    reasons = (Reason(FleetCode.TREND_LOAD_STATED), reason)
    if is_stated.any():
        std = shared_std(history.column("load_std_n")[is_stated]) or math.nan
        value, count = float(np.mean(loads_n[is_stated])), int(is_stated.sum())
        yield TrendNumber(Quantity.LOAD, value, std, "N", Status.PROVISIONAL, reasons, count)
    else:
        yield TrendNumber(Quantity.LOAD, unit="N", reasons=(reason,))
    yield TrendNumber(Quantity.LOAD_RATE, unit="N/month", reasons=(reason,))
    yield TrendNumber(Quantity.LOAD_SCATTER, unit="N", reasons=(reason,))


def add_stiffness(tire: TireWork, series: Series) -> None:
    """Add drift and temperature dependence of a stiffness, and the finding of a drift that wear does not explain."""
    history, name, watch = tire.history, series.name, series.watch
    values = history.column(name)
    factor = tire.readings.pressure_pa if watch.is_over_pressure else np.ones(len(values))
    with np.errstate(invalid="ignore", divide="ignore"):
        percent = 100.0 * np.log(values * factor)
        stds = 100.0 * history.column(f"{name}_std") / values
    quantity, temperature = rate_of(watch), by_temperature(watch)
    median = np.nanmedian(percent) if np.isfinite(percent).any() else 0.0
    line = fit_line(tire, name, percent - median, stds, warm=True)
    reason = reason_missing(history, name, percent)
    if line is None:
        tire.numbers.append(TrendNumber(quantity, unit="%/month", reasons=(reason,)))
        tire.numbers.append(TrendNumber(temperature, unit="%/K", reasons=(reason,)))
        return
    rate = rate_number(quantity, "%/month", line)
    if rate.status is not Status.INVALID and (stuck := stuck_temperature(tire, line.places)) is not None:
        rate = replace(rate, status=Status.PROVISIONAL, reasons=(stuck, *rate.reasons))
    drift = rate
    if (
        watch.falls_with_wear
        and rate.status is not Status.INVALID
        and (worn := softened_by_wear(tire, name, line, slope_after(line))) is not None
    ):
        slope, slope_std = worn
        softening = Reason(FleetCode.TREND_WEAR_SOFTENS, share=slope / 100.0, std=slope_std / 100.0)
        rate = replace(rate, reasons=(*rate.reasons, softening))
        drift = replace(rate, value=rate.value - slope, std=math.hypot(rate.std, slope_std))
    tire.numbers.append(rate)
    if line.has_covariate:
        tire.numbers.append(number_of(temperature, "%/K", line, np.eye(line.design.shape[1])[2]))
    else:
        tire.numbers.append(
            TrendNumber(temperature, unit="%/K", reasons=(Reason(FleetCode.TREND_TEMPERATURE_CONSTANT),))
        )
    if (
        line.change is None
        and is_significant(drift, line)
        and (abs(drift.value) - _AGEING * (watch.is_over_pressure and drift.value > 0.0)) * span_of(history.months)
        > watch.notable
    ):
        drifts = Reason(
            FleetCode.TREND_STIFFNESS_DRIFTS, name=name, share=drift.value / 100.0, std=drift.std / 100.0,
            span_s=1e-9 * MONTH_NS * span_of(line.months),
        )  # fmt: skip
        total_change = drift.value * span_of(history.months), drift.std * span_of(history.months)
        tire.findings.append(Finding(drifts, name, relative_change(name, line, None, total_change)))
