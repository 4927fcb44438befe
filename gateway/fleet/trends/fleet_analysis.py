"""Trends of a fleet: every tire's numbers by regression over its recordings."""

import math
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from gateway.core.estimates.estimator import Status
from gateway.core.quantity import Basis, Trend
from gateway.core.quantity_catalogue import NEW_TIRE_MM
from gateway.core.reasons import Reason, Value
from gateway.core.shown_units import ShownUnits
from gateway.core.trust.signal_evidence import Subject
from gateway.core.types import FloatArray
from gateway.fleet.reasons import FleetCode
from gateway.fleet.trends.axle_pairs import axle_pairs
from gateway.fleet.trends.causes import Finding, with_causes
from gateway.fleet.trends.level_steps import LEAST_POINTS, find_steps
from gateway.fleet.trends.line_numbers import of_unidentified_tire
from gateway.fleet.trends.moved_tires import findings_of_moves
from gateway.fleet.trends.neighbouring_wheels import without_common
from gateway.fleet.trends.plausible_readings import plausible_readings
from gateway.fleet.trends.pressure_trend import add_pressure, cold_kpa
from gateway.fleet.trends.recording_doubts import findings_of_recordings
from gateway.fleet.trends.regression import LEAST_FREEDOM
from gateway.fleet.trends.sensor_trend import add_sensor
from gateway.fleet.trends.shared_load import with_one_load
from gateway.fleet.trends.stated_changes import findings_of_changes, places_of, stated_changes
from gateway.fleet.trends.structure_trend import RAMPS, STEPS_APART, StructureChange, structure_changes
from gateway.fleet.trends.tire_history import TireHistory
from gateway.fleet.trends.tire_lines import TireWork
from gateway.fleet.trends.tire_trends import add_load, add_rate, add_stiffness, add_wear
from gateway.fleet.trends.trend_line import centred, date_of, is_constant, level_columns, quantile_of
from gateway.fleet.trends.trend_result import FleetTrends, Quantity, TireTrend, TrendNumber
from gateway.fleet.trends.watched_series import SERIES, followed_by

# Tires from which a fleet has a median wear, and a median loss of pressure: the wheels of a car beside one that leaks.
_LEAST_FLEET: Final = 4
_LEAST_TIGHT: Final = 3
# Driven and steered wheels wear by such a factor and more beside the others; and scatters of the fleet's rates.
_FAST_WEAR: Final = 2.0
_FAST_WEAR_SCATTERS: Final = 4.0
_FAST_WEAR_STDS: Final = 4.0
_MAD_TO_STD: Final = 1.4826
# Loss of pressure in a month that a fleet of tight tires may have by permeation, and excess over it that is a finding:
# rubber, pressure and temperature differ between tires by some 20 %. Errors of a rate that are no chance.
_MOST_PERMEATION_KPA: Final = 6.0
_EXCESS_LOSS_KPA: Final = 1.0
_EXCESS_LOSS: Final = 0.5
_EXCESS_LOSS_SCATTERS: Final = 3.0
_CHANCE: Final = 2.0
# Series of a tire that are tested for outliers.
_SERIES_OF_TIRE: Final = 12


def analyse(
    histories: Sequence[TireHistory], *, recordings: int, failures: int = 0, notes: Sequence[Reason] = ()
) -> FleetTrends:
    """Return the trends of all tires.

    Args:
        histories: one for each vehicle, wheel and sensor.
        recordings: number in the dataset.
        failures: recordings without results.
        notes: on the whole.
    """
    family = max(1, len(histories)) * _SERIES_OF_TIRE
    tires = [part for history in histories for part in _tires_of(history, family)]
    wheels: dict[str, list[TireHistory]] = defaultdict(list)
    for history in histories:
        wheels[history.vehicle].append(history)
    readings = [
        plausible_readings(tire, [other for other in wheels[tire.vehicle] if other.position != tire.position])
        for tire in tires
    ]
    colds = [cold_kpa(tire, reading) for tire, reading in zip(tires, readings, strict=True)]
    stuck = [
        not reading.has_temperature or is_constant(reading.temperature_degc[np.isfinite(cold)])
        for reading, cold in zip(readings, colds, strict=True)
    ]
    trends = [
        _trend_of(TireWork(tire, family, reading, stated_changes(tire), cold), structure)
        for tire, reading, cold, structure in zip(
            tires, readings, without_common(tires, colds, stuck), structure_changes(tires), strict=True
        )
    ]
    moves = findings_of_moves(tires)
    return FleetTrends(
        tires=with_one_load(_without_permeation(_with_fast_wear([_with_moves(trend, moves) for trend, _ in trends]))),
        pairs=tuple(axle_pairs(tires)),
        outliers=tuple(outlier for _, tire in trends for outlier in tire.outliers),
        tested=sum(tire.tested for _, tire in trends),
        recordings=recordings,
        failures=failures,
        notes=tuple(notes),
        units=max(histories, key=lambda history: int(history.time_ns[-1])).units if histories else ShownUnits.SI,
    )


def _with_moves(trend: TireTrend, moves: Mapping[tuple[str, str, str], tuple[Reason, ...]]) -> TireTrend:
    """Return a tire with the findings of its moves to this wheel; of several tires of one sensor, the first."""
    move_findings = moves.get((trend.vehicle, trend.position, trend.sensor_id), ()) if trend.part == 1 else ()
    return replace(trend, findings=(*move_findings, *trend.findings))


def _tires_of(history: TireHistory, family: int) -> Iterator[TireHistory]:
    """Yield the tires that one sensor has seen: a fall of the wear is a new tire, unless a statement explains it."""
    wear = history.column("wear_mm")
    measured = np.flatnonzero(np.isfinite(wear))
    starts: list[int] = []
    if len(measured) > LEAST_FREEDOM + 2:
        levels = level_columns(measured, places_of(stated_changes(history), "wear_mm"))
        design = np.column_stack([np.ones(len(measured)), centred(history.km[measured]), *levels])
        steps = find_steps(design, wear[measured], family=family, min_size=NEW_TIRE_MM)
        if levels and steps:
            full_design = np.column_stack([design, *level_columns(np.arange(len(measured)), steps)])
            by_levels = np.linalg.lstsq(full_design, wear[measured], rcond=None)[0][2 : 2 + len(levels)]
            wear = wear.copy()
            wear[measured] -= np.column_stack(levels) @ by_levels
        edges = [0, *steps, len(measured)]
        for begin, end in zip(edges, edges[2:], strict=False):
            fall = _fall(history.km[measured[begin:end]], wear[measured[begin:end]])
            if fall is not None:
                starts.append(int(measured[begin + fall]))
    yield from history.split(starts)


def _fall(km: FloatArray, wear: FloatArray) -> int | None:
    """Return where the wear falls by that of a tire between the two lines that fit best; None where it does not.

    A tire that begins to wear faster makes a step of a single line, too: there a change of slope fits better than a
    fall between lines of one slope, and lines of their own meet.
    """
    count, line_design = len(km), np.column_stack([np.ones(len(km)), centred(km)])
    index = np.arange(count)

    def squares(columns: FloatArray) -> float:
        residuals = wear - columns @ np.linalg.lstsq(columns, wear, rcond=None)[0]
        return float(residuals @ residuals)

    def two_lines(begin: int) -> FloatArray:
        late = (index >= begin).astype(np.float64)
        return np.column_stack([line_design, late, late * (km - 0.5 * (km[begin - 1] + km[begin]))])

    places = range(LEAST_POINTS, count - LEAST_POINTS + 1)
    if not places or count - 4 < LEAST_FREEDOM:
        return None
    begin = min(places, key=lambda candidate: squares(two_lines(candidate)))
    columns, freedom = two_lines(begin), count - 4
    fall = -float(np.linalg.lstsq(columns, wear, rcond=None)[0][2])
    scatter = math.sqrt(squares(columns) / freedom)
    std = scatter * math.sqrt(max(float(np.linalg.pinv(columns.T @ columns)[2, 2]), 0.0))
    if fall >= NEW_TIRE_MM and fall > quantile_of(freedom) * std:
        return begin
    # Few recordings give no slope of their own.
    begin = min(places, key=lambda candidate: squares(two_lines(candidate)[:, :3]))
    step = two_lines(begin)[:, :3]
    fall = -float(np.linalg.lstsq(step, wear, rcond=None)[0][2])
    knees = range(1, count - 1)
    bent_squares = min(squares(np.column_stack([line_design, np.maximum(km - km[knee], 0.0)])) for knee in knees)
    return begin if fall >= NEW_TIRE_MM and squares(step) < bent_squares else None


def _trend_of(tire: TireWork, structure: StructureChange | None) -> tuple[TireTrend, TireWork]:
    history = tire.history
    # What the wear follows comes first, what is graver is told first.
    add_load(tire)
    load_results = tire.numbers, tire.series, tire.findings
    tire.numbers, tire.series, tire.findings = [], [], []
    add_wear(tire)
    add_pressure(tire)
    tire.numbers += load_results[0]
    tire.series += load_results[1]
    tire.findings += load_results[2]
    for series in followed_by(Trend.LINE):
        add_rate(tire, series)
    for series in followed_by(Trend.STIFFNESS):
        add_stiffness(tire, series)
    add_sensor(tire)
    findings = with_causes([_dated(history, finding) for finding in tire.findings], tire.onsets)
    findings += findings_of_changes(history, tire.changes)
    findings += tire.readings.findings
    findings += _structure_findings(history, structure)
    has_steady_drift = any(
        finding.series and Basis.GAIN in SERIES[finding.series].watch.explains for finding in tire.findings
    )
    findings += [
        finding
        for finding in findings_of_recordings(history)
        # Each recording alarms of the steady value by itself; the sensor's drift is the cause.
        if not (has_steady_drift and finding.code is FleetCode.TREND_ALARMS and finding["name"] == Subject.STEADY)
    ]
    trend = TireTrend(
        vehicle=history.vehicle,
        position=history.position,
        sensor_id=history.sensor_id,
        part=history.part,
        first_ns=int(history.time_ns[0]),
        last_ns=int(history.time_ns[-1]),
        recordings=len(history.recordings),
        distance_km=float(history.km[-1] - history.km[0]),
        has_odometer=history.has_odometer,
        numbers=tuple(tire.numbers),
        findings=tuple(findings),
        series=tuple(tire.series),
        is_identified=history.is_identified,
    )
    if not history.is_identified:
        # What differs between tires would be taken for a change of one.
        trend = replace(trend, numbers=tuple(map(of_unidentified_tire, trend.numbers)), findings=())
    return trend, tire


def _dated(history: TireHistory, finding: Finding) -> Finding:
    """Return a finding that says since when it holds; one of all recordings, since the first."""
    if "since_s" in dict(finding.reason.values):
        return finding
    values = {**history.since(finding.change.begin or 0), **dict(finding.reason.values)}
    return finding._replace(reason=Reason(finding.reason.code, **values))


def _structure_findings(history: TireHistory, change: StructureChange | None) -> list[Reason]:
    """Return the finding of a structure that changes, where there is one."""
    if change is None:
        return []
    bounds = {} if change.ahead_rad is None else dict(zip(("from_rad", "to_rad"), change.ahead_rad, strict=True))
    return [
        Reason(
            FleetCode.TREND_STRUCTURE_CHANGED,
            place="ahead" if bounds else "unknown",
            **bounds,
            course="sudden" if change.is_sudden else "growing",
            date=date_of(int(history.time_ns[change.begin])),
            change=change.share,
            std=change.std,
            scatters=change.share / change.scatter,
            **_since(history, change),
        )
    ]


def _since(history: TireHistory, change: StructureChange) -> dict[str, Value]:
    """Return when a structure began to change; what grows is tried from few times on."""
    since = history.since(change.begin)
    if "since_std_s" in since:
        times, begin = history.time_ns, change.begin
        bounds_ns = times[[max(begin - STEPS_APART, 0), begin]] if change.is_sudden else times[[0, -1]] / len(RAMPS)
        since["since_std_s"] = 1e-9 * float(np.ptp(bounds_ns)) / math.sqrt(12.0)
    return since


def _numbers_of(tires: Sequence[TireTrend], quantity: str) -> list[TrendNumber]:
    return [next(number for number in tire.numbers if number.quantity == quantity) for tire in tires]


def _median_and_scatter(numbers: Sequence[TrendNumber], min_count: int) -> tuple[float, float]:
    """Return median and robust scatter of a fleet's valid numbers, NaN where they are too few."""
    values = np.array([number.value for number in numbers if number.status is Status.VALID])
    if len(values) < min_count:
        return math.nan, math.nan
    median = float(np.median(values))
    return median, _MAD_TO_STD * float(np.median(np.abs(values - median)))


def _with_fast_wear(tires: Sequence[TireTrend]) -> tuple[TireTrend, ...]:
    """Add a finding to tires that wear much faster than the median of the fleet: that tires wear is none."""
    rates = _numbers_of(tires, Quantity.WEAR_RATE)
    median_rate, scatter = _median_and_scatter(rates, _LEAST_FLEET)
    if math.isnan(median_rate):
        return tuple(tires)
    results = []
    for tire, rate in zip(tires, rates, strict=True):
        is_fast = rate.status is Status.VALID and rate.value - median_rate > max(
            _FAST_WEAR_STDS * rate.std, (_FAST_WEAR - 1.0) * max(median_rate, 0.0), _FAST_WEAR_SCATTERS * scatter
        )
        finding = Reason(
            FleetCode.TREND_WEARS_FAST, rate_m=1e-3 * rate.value, std_m=1e-3 * rate.std, median_m=1e-3 * median_rate,
            since_s=1e-9 * tire.first_ns,
        )  # fmt: skip
        is_known = any(other.code is FleetCode.TREND_WEARS_SHORT for other in tire.findings)
        results.append(replace(tire, findings=(finding, *tire.findings)) if is_fast and not is_known else tire)
    return tuple(results)


def _without_permeation(tires: Sequence[TireTrend]) -> tuple[TireTrend, ...]:
    """Leave out the finding of a loss of pressure that tires of the fleet have alike: rubber lets gas through."""
    losses = _numbers_of(tires, Quantity.PRESSURE_LOSS)
    median_kpa, scatter_kpa = _median_and_scatter(losses, _LEAST_TIGHT)
    if math.isnan(median_kpa):
        return tuple(tires)
    excess_kpa = max(_EXCESS_LOSS_KPA, _EXCESS_LOSS * median_kpa, _EXCESS_LOSS_SCATTERS * scatter_kpa)
    limits_kpa = [
        min(max(median_kpa + math.hypot(excess_kpa, _CHANCE * loss.std), 0.0), _MOST_PERMEATION_KPA) for loss in losses
    ]
    return tuple(
        replace(tire, findings=tuple(item for item in tire.findings if item.code is not FleetCode.TREND_LOSES_PRESSURE))
        if loss.value <= limit_kpa
        else tire
        for tire, loss, limit_kpa in zip(tires, losses, limits_kpa, strict=True)
    )
