"""Trends of a fleet: every tire's numbers by regression over its recordings.

Pressures are compared at one temperature by the gas law, with absolute ones: p20 = (p + p_atm) (293.15 K / T) - p_atm.
Bs, Rs and Ts are stiffnesses over the pressure, so their drift is that of the number times the pressure.
"""

import math
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final, NamedTuple

import numpy as np

from gateway.core.constants import STANDARD_ATMOSPHERE_PA, ZERO_CELSIUS_K
from gateway.core.estimates.estimator import Status
from gateway.core.estimates.wear import bending_left
from gateway.core.quantity import Basis, Trend, Watch
from gateway.core.quantity import Quantity as Declared
from gateway.core.quantity_catalogue import NEW_TIRE_MM, declared
from gateway.core.reasons import Code, CoreCode, Reason, Value
from gateway.core.trust.signal_evidence import Subject
from gateway.core.types import FloatArray, IntArray
from gateway.core.wheel_position import right_of
from gateway.fleet.reasons import FleetCode
from gateway.fleet.trends.causes import Change, Finding, with_causes
from gateway.fleet.trends.late_changes import LEAST_AFTER, LateChange, find_shape
from gateway.fleet.trends.leak_model import (
    OF_FLOW,
    bent,
    is_steady_leak,
    mended_at,
    newest_fall,
    newest_leak,
    straightened,
)
from gateway.fleet.trends.level_steps import LEAST_POINTS, find_steps, runs, with_steps
from gateway.fleet.trends.moved_tires import findings_of_moves
from gateway.fleet.trends.neighbouring_wheels import Shared, without_common
from gateway.fleet.trends.outlier_detection import OutlierSearch, find_outliers
from gateway.fleet.trends.plausible_readings import PlausibleReadings, plausible_readings
from gateway.fleet.trends.recording_doubts import doubt_of, findings_of_recordings, weights_by_doubt
from gateway.fleet.trends.refilled_pressure import (
    LEAST_RECORDINGS,
    MOST_REFILLS,
    PressureLoss,
    pressure_loss,
    scatter_of,
)
from gateway.fleet.trends.regression import LEAST_FREEDOM, Fit, correlation_factor, weights_of
from gateway.fleet.trends.regression import fit as fitted
from gateway.fleet.trends.stated_changes import StatedChange, findings_of_changes, places_of, stated_changes
from gateway.fleet.trends.steady_value import parted_drift, zero_of
from gateway.fleet.trends.tire_history import MONTH_NS, TireHistory
from gateway.fleet.trends.trend_result import (
    FleetTrends,
    PairTrend,
    Quantity,
    TireTrend,
    TrendNumber,
    TrendOutlier,
    TrendSeries,
    asymmetry_of,
    by_temperature,
    rate_of,
)
from gateway.fleet.trends.watched_series import SERIES, Series, followed_by

REFERENCE_DEGC: Final = 20.0
"""Temperature at which pressures are compared."""

_DAY_S: Final = 86_400.0
_DAY_MONTHS: Final = 1e9 * _DAY_S / MONTH_NS
# Spread of the temperature from which its influence is fitted, and recordings that this needs.
_LEAST_SPREAD_K: Final = 2.0
_LEAST_FOR_TEMPERATURE: Final = 12
_LEAST_SPREAD_SPEED: Final = 0.03
# What changes within a day or a week (temperature, load, driver, road) is no ageing, and a rate per month from less
# than a week, a quarter of its unit, would be mostly that. The same share of 1,000 km is more than a day's drive. A
# pressure at one temperature changes by a leak only, which may be a fast one: a day is enough.
_LEAST_MONTHS: Final = 7.0 * _DAY_MONTHS
_LEAST_LEAK_MONTHS: Final = _DAY_MONTHS
_LEAST_1000KM: Final = 0.25
# Time between refills of a driver who tops up often.
_OFTEN_MONTHS: Final = 7.0 * _DAY_MONTHS
# Smaller refills are no steps of the line; they are part of the loss's likelihood.
_LEAST_REFILL_PA: Final = 3000.0
# Change of the temperature in a month that a sensor that is stuck does not show.
_UNSEEN_K: Final = 10.0
# What tight wheels lose a month by permeation, which a comparison with them leaves out.
_OF_OTHERS_KPA: Final = 2.0
# What is worth a finding, besides being significant; the rest is in `gateway.fleet.trends.watched_series`.
_NOTABLE_LOSS_PA: Final = 1000.0
# Within hours, the sensor's temperature is behind that of a gas that a drive warms: 10 K are 11 kPa.
_NOTABLE_FALL_PA: Final = 20e3
# Wear within a distance that is too short for a rate.
_NOTABLE_WEAR_MM: Final = 0.5
# Inflation of the variance of a trend by a covariate from which the two are usually called collinear.
_MOST_INFLATION: Final = 10.0
# Share of a notable change below which numbers do not follow it: readings have a resolution.
_FOLLOWED: Final = 0.1
# Recordings from which the newest state has a line of its own, and from which its numbers are valid. A slope needs two
# values, its scatter three.
_LEAST_OWN_LINE: Final = 5
# Steps of the load that the wear is fitted beside.
_MOST_LOAD_LEVELS: Final = 3
_LEAST_VALID: Final = 8
# Recordings in a row that deviate to the same side are no single errors.
_LEAST_RUN: Final = 2
# Share of the whole change of the steady value to which gain and zero are known where they are parted.
_PARTED: Final = 0.25
# Series of the sensor whose outliers are reported.
_TESTED_OF_SENSOR: Final = frozenset({"noise_mps2", "mounting_offset_m"})
# Value of the finding of a sensor that drifts, from the change in the unit of the series.
_DRIFTS: Final[Mapping[str, Callable[[float], float]]] = {
    "factor": lambda change: math.exp(change / 100.0),
    "share": lambda change: change / 100.0,
    "change_m": lambda change: change * 1e-3,
    "change_mps2": lambda change: change,
}
# Tires from which a fleet has a median wear, and excess over it that is a finding.
_LEAST_FLEET: Final = 4
_FAST_WEAR: Final = 1.5
_FAST_WEAR_STDS: Final = 4.0
_FINDING_SHARE: Final = 0.999
# Series of a tire that are tested for outliers.
_SERIES_OF_TIRE: Final = 12
_ANGLES: Final = 180.0 / math.pi


class _Line(NamedTuple):
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


@dataclass(slots=True)
class _Tire:
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
    readings = [plausible_readings(tire) for tire in tires]
    colds = [_cold_kpa(tire, reading) for tire, reading in zip(tires, readings, strict=True)]
    stuck = [
        _is_same(reading.temperature_degc[np.isfinite(cold)]) for reading, cold in zip(readings, colds, strict=True)
    ]
    trends = [
        _trend_of(_Tire(tire, family, reading, stated_changes(tire), cold))
        for tire, reading, cold in zip(tires, readings, without_common(tires, colds, stuck), strict=True)
    ]
    moves = findings_of_moves(tires)
    return FleetTrends(
        tires=_with_fast_wear([_with_moves(trend, moves) for trend, _ in trends]),
        pairs=tuple(_pairs(tires)),
        outliers=tuple(outlier for _, tire in trends for outlier in tire.outliers),
        tested=sum(tire.tested for _, tire in trends),
        recordings=recordings,
        failures=failures,
        notes=tuple(notes),
    )


def _with_moves(trend: TireTrend, moves: Mapping[tuple[str, str, str], tuple[Reason, ...]]) -> TireTrend:
    """Return a tire with the findings of its moves to this wheel; of several tires of one sensor, the first."""
    of_moves = moves.get((trend.vehicle, trend.position, trend.sensor_id), ()) if trend.part == 1 else ()
    return replace(trend, findings=(*of_moves, *trend.findings))


def _tires_of(history: TireHistory, family: int) -> Iterator[TireHistory]:
    """Yield the tires that one sensor has seen: a fall of the wear is a new tire, unless a statement explains it."""
    wear = history.column("wear_mm")
    measured = np.flatnonzero(np.isfinite(wear))
    begins: list[int] = []
    if len(measured) > LEAST_FREEDOM + 2:
        levels = _levels(measured, places_of(stated_changes(history), "wear_mm"))
        design = np.column_stack([np.ones(len(measured)), _centred(history.km[measured]), *levels])
        steps = find_steps(design, wear[measured], family=family, least=NEW_TIRE_MM)
        if levels and steps:
            whole = np.column_stack([design, *_levels(np.arange(len(measured)), steps)])
            by_levels = np.linalg.lstsq(whole, wear[measured], rcond=None)[0][2 : 2 + len(levels)]
            wear = wear.copy()
            wear[measured] -= np.column_stack(levels) @ by_levels
        edges = [0, *steps, len(measured)]
        for before, after in zip(edges, edges[2:], strict=False):
            fall = _fall(history.km[measured[before:after]], wear[measured[before:after]])
            if fall is not None:
                begins.append(int(measured[before + fall]))
    yield from history.split(begins)


def _fall(km: FloatArray, wear: FloatArray) -> int | None:
    """Return where the wear falls by that of a tire between the two lines that fit best; None where it does not.

    A tire that begins to wear faster makes a step of a single line, too: there a change of slope fits better than a
    fall between lines of one slope, and lines of their own meet.
    """
    count, along = len(km), np.column_stack([np.ones(len(km)), _centred(km)])
    index = np.arange(count)

    def squares(columns: FloatArray) -> float:
        residuals = wear - columns @ np.linalg.lstsq(columns, wear, rcond=None)[0]
        return float(residuals @ residuals)

    def two_lines(begin: int) -> FloatArray:
        late = (index >= begin).astype(np.float64)
        return np.column_stack([along, late, late * (km - 0.5 * (km[begin - 1] + km[begin]))])

    places = range(LEAST_POINTS, count - LEAST_POINTS + 1)
    if not places or count - 4 < LEAST_FREEDOM:
        return None
    begin = min(places, key=lambda candidate: squares(two_lines(candidate)))
    columns, freedom = two_lines(begin), count - 4
    fall = -float(np.linalg.lstsq(columns, wear, rcond=None)[0][2])
    scatter = math.sqrt(squares(columns) / freedom)
    std = scatter * math.sqrt(max(float(np.linalg.pinv(columns.T @ columns)[2, 2]), 0.0))
    if fall >= NEW_TIRE_MM and fall > _quantile_of(freedom) * std:
        return begin
    # Few recordings give no slope of their own.
    begin = min(places, key=lambda candidate: squares(two_lines(candidate)[:, :3]))
    step = two_lines(begin)[:, :3]
    fall = -float(np.linalg.lstsq(step, wear, rcond=None)[0][2])
    knees = range(1, count - 1)
    bent = min(squares(np.column_stack([along, np.maximum(km - km[knee], 0.0)])) for knee in knees)
    return begin if fall >= NEW_TIRE_MM and squares(step) < bent else None


def _trend_of(tire: _Tire) -> tuple[TireTrend, _Tire]:
    history = tire.history
    # What the wear follows comes first, what is graver is told first.
    _load(tire)
    of_load = tire.numbers, tire.series, tire.findings
    tire.numbers, tire.series, tire.findings = [], [], []
    _wear(tire)
    _pressure(tire)
    tire.numbers += of_load[0]
    tire.series += of_load[1]
    tire.findings += of_load[2]
    for series in followed_by(Trend.LINE):
        _over_months(tire, series)
    for series in followed_by(Trend.STIFFNESS):
        _stiffness(tire, series)
    _sensor(tire)
    findings = with_causes(tire.findings, tire.onsets)
    findings += findings_of_changes(history, tire.changes)
    findings += tire.readings.findings
    of_steady_value = any(
        finding.series and Basis.GAIN in SERIES[finding.series].watch.explains for finding in tire.findings
    )
    findings += [
        finding
        for finding in findings_of_recordings(history)
        # Each recording alarms of the steady value by itself; the sensor's drift is the cause.
        if not (of_steady_value and finding.code is FleetCode.TREND_ALARMS and finding["name"] == Subject.STEADY)
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
        trend = replace(trend, numbers=tuple(map(_of_unknown_tire, trend.numbers)), findings=())
    return trend, tire


def _of_unknown_tire(number: TrendNumber) -> TrendNumber:
    if number.status is Status.INVALID:
        return number
    return replace(
        number, status=Status.PROVISIONAL, reasons=(Reason(FleetCode.TREND_TIRE_UNIDENTIFIED), *number.reasons)
    )


def _with_fast_wear(tires: Sequence[TireTrend]) -> tuple[TireTrend, ...]:
    """Add a finding to tires that wear much faster than the median of the fleet: that tires wear is none."""
    rates = [next(n for n in tire.numbers if n.quantity == Quantity.WEAR_RATE) for tire in tires]
    valid_rates = [rate.value for rate in rates if rate.status is Status.VALID]
    if len(valid_rates) < _LEAST_FLEET:
        return tuple(tires)
    middle = float(np.median(valid_rates))
    judged = []
    for tire, rate in zip(tires, rates, strict=True):
        is_fast = rate.status is Status.VALID and rate.value - middle > max(
            _FAST_WEAR_STDS * rate.std, (_FAST_WEAR - 1.0) * max(middle, 0.0)
        )
        finding = Reason(
            FleetCode.TREND_WEARS_FAST, rate_m=1e-3 * rate.value, std_m=1e-3 * rate.std, median_m=1e-3 * middle
        )
        judged.append(replace(tire, findings=(finding, *tire.findings)) if is_fast else tire)
    return tuple(judged)


def _wear(tire: _Tire) -> None:
    history = tire.history
    wear = history.column("wear_mm")
    why = _missing(history, "wear_mm", wear)
    if math.isfinite(history.km[0]) and not _span(history.km) > 0.0 and np.isfinite(wear).any():
        why = Reason(FleetCode.TREND_DISTANCE_CONSTANT)
    line = _line(tire, "wear_mm", history.km * 1e-3, wear, history.column("wear_mm_std"), against="km", warm=True)
    basis = (
        () if history.has_odometer else (Reason(FleetCode.TREND_RECORDED_DISTANCE, distance_m=1e3 * _span(history.km)),)
    )
    if line is None:
        tire.numbers.append(TrendNumber(Quantity.WEAR_RATE, unit="mm/1000 km", reasons=(why,)))
        tire.numbers.append(TrendNumber(Quantity.WEAR_NOW, unit="mm", reasons=(why,)))
        return
    status = Status.VALID if history.has_odometer else Status.PROVISIONAL
    rate = _rate(
        Quantity.WEAR_RATE, "mm/1000 km", line, against="km", least=_LEAST_1000KM, status=status, reasons=basis
    )
    tire.numbers.append(rate)
    tire.numbers.append(_at_end(Quantity.WEAR_NOW, "mm", line))
    worn, std = _along(line, _from_first_to_last(line))
    if rate.status is Status.INVALID and line.doubt is None and worn > max(_NOTABLE_WEAR_MM, _quantile(line) * std):
        span_m = 1e3 * _span(history.km[line.places])
        wears = Reason(FleetCode.TREND_WEARS_SHORT, wear_m=1e-3 * worn, std_m=1e-3 * std, distance_m=span_m)
        tire.findings.append(Finding(wears, "wear_mm", Change(int(line.places[0]))))


def _cold_kpa(history: TireHistory, readings: PlausibleReadings) -> FloatArray:
    """Return (n,) gauge pressures at one temperature, NaN where they are not measured."""
    measured = history.column("pressure_measured") > 0.0
    warm = (readings.temperature_degc + ZERO_CELSIUS_K) / (REFERENCE_DEGC + ZERO_CELSIUS_K)
    cold_pa = (readings.pressure_pa + STANDARD_ATMOSPHERE_PA) / warm - STANDARD_ATMOSPHERE_PA
    return np.where(measured, 1e-3 * cold_pa, math.nan)


def _pressure(tire: _Tire) -> None:
    history = tire.history
    gauge, degc = tire.readings.pressure_pa, tire.readings.temperature_degc
    measured = history.column("pressure_measured") > 0.0
    cold = tire.cold.cold_kpa
    if not _has_rolled(history):
        why = Reason(FleetCode.TREND_NO_REVOLUTION)
    elif not measured.any():
        why = Reason(FleetCode.TREND_NOT_MEASURED, quantity="pressure")
    elif not np.isfinite(cold).any():
        why = Reason(FleetCode.TREND_NOT_MEASURED, quantity="temperature")
    elif np.isfinite(cold).sum() > LEAST_FREEDOM + 1 and _is_same(gauge[np.isfinite(cold)]):
        # A gas that is warmed and cooled does not keep its pressure: a repeated value is no measurement of a loss.
        usable = np.isfinite(cold)
        why = Reason(FleetCode.TREND_PRESSURE_CONSTANT, pressure_pa=float(gauge[usable][0]), count=int(usable.sum()))
        cold = np.full(len(cold), math.nan)
    else:
        why = _missing(history, "", cold)
    unknown = np.full(len(cold), math.nan)
    steps_from = _LEAST_REFILL_PA * 1e-3
    known = np.flatnonzero(np.isfinite(cold))
    if known.size > LEAST_RECORDINGS:
        # What the tire lost before its leak was mended says nothing of now.
        cold = cold.copy()
        cold[: known[mended_at(history.months[known], cold[known], scatter_of(cold[known]))]] = math.nan
    if _leak(tire, cold, unknown, steps_from):
        return
    known = np.flatnonzero(np.isfinite(cold))
    is_steady = known.size > LEAST_RECORDINGS and is_steady_leak(
        history.months[known], cold[known], scatter_of(cold[known])
    )
    at_kpa = float(cold[known[-1]]) if known.size else math.nan
    along = straightened(cold, at_kpa) if is_steady else cold
    line = _line(tire, "pressure_at_20_degc", history.months, along, unknown, steps_from=steps_from)
    if line is not None and is_steady:
        drawn = tire.series[-1]
        tire.series[-1] = replace(drawn, values=bent(drawn.values, at_kpa), expected=bent(drawn.expected, at_kpa))
    refilled = None
    if line is not None:
        normal, change = ~line.search.is_outlier, line.change
        if change is not None and change.is_slope:
            normal[: change.begin - 1] = False
        elif change is not None:
            normal[change.begin :] = False
        refilled = pressure_loss(history.months[line.places[normal]], line.values[normal])
        if refilled is None and change is None:
            why = Reason(FleetCode.TREND_TOO_FEW, count=int(normal.sum()), needed=LEAST_RECORDINGS)
            line = None
    if line is None:
        tire.numbers.append(TrendNumber(Quantity.PRESSURE_LOSS, unit="kPa/month", reasons=(why,)))
        tire.numbers.append(TrendNumber(Quantity.PRESSURE_NOW, unit="kPa", reasons=(why,)))
        return
    notes: tuple[Reason, ...] = ()
    status, warm_known = Status.VALID, degc[np.isfinite(cold)]
    if _is_same(warm_known):
        stuck = Reason(FleetCode.TREND_TEMPERATURE_STUCK, temperature_degc=float(warm_known[0]), count=len(warm_known))
        status, notes = Status.PROVISIONAL, (stuck,)
    plain = _rate(
        Quantity.PRESSURE_LOSS,
        "kPa/month",
        line,
        least=_LEAST_LEAK_MONTHS,
        factor=-1.0,
        status=status,
        reasons=notes,
    )
    loss = (
        _with_refills(plain, refilled, line) if plain.status is not Status.INVALID and refilled is not None else plain
    )
    loss = replace(loss, std=math.hypot(loss.std, tire.cold.trend_std_kpa, OF_FLOW * loss.value))
    fall = newest_fall(history.months[line.places], line.values, scatter_of(line.values))
    if loss.status is Status.VALID and fall is not None:
        # A leak that has begun has no rate yet, and the rate before it is not that of now.
        begin, deviation = fall
        below = Reason(
            FleetCode.TREND_NEWEST_FALL, count=len(line.values) - begin, date=line.dates[begin], deviation=deviation
        )
        loss = replace(loss, status=Status.PROVISIONAL, reasons=(below, *loss.reasons))
    tire.numbers.append(loss)
    tire.numbers.append(_at_end(Quantity.PRESSURE_NOW, "kPa", line))
    if loss.status is Status.INVALID:
        if line.doubt is None and (fell := _fallen(history, line)) is not None:
            tire.findings.append(Finding(fell, "pressure_at_20_degc", Change(int(line.places[0]))))
        return
    least = loss.value - _quantile(line) * plain.std
    is_certain = (least if refilled is None else min(refilled.least, least)) > 0.0
    if loss.status is Status.VALID and is_certain and loss.value > _NOTABLE_LOSS_PA * 1e-3:
        loses = Reason(FleetCode.TREND_LOSES_PRESSURE, loss_pa=1e3 * loss.value, std_pa=1e3 * loss.std)
        whole = -loss.value * _span(history.months), loss.std * _span(history.months)
        tire.findings.append(Finding(loses, "pressure_at_20_degc", _relative("pressure_at_20_degc", line, None, whole)))


def _leak(tire: _Tire, cold_kpa: FloatArray, unknown: FloatArray, steps_from: float) -> bool:
    """Add the numbers and the finding of a leak that began at a date; return whether there is one.

    The recordings before it have the line, so that what the leak does is no step, and no trend of theirs.
    """
    history, name = tire.history, "pressure_at_20_degc"
    rows = np.flatnonzero(np.isfinite(cold_kpa))
    if rows.size < 3:
        return False
    months, values = history.months[rows], cold_kpa[rows]
    degc = tire.readings.temperature_degc[rows]
    is_stuck = _is_same(degc)
    # What an unseen change of the temperature makes of the pressure, by the gas law.
    unseen_kpa = (1e-3 * STANDARD_ATMOSPHERE_PA + values[-1]) * _UNSEEN_K / (REFERENCE_DEGC + ZERO_CELSIUS_K)
    drift_kpa = _OF_OTHERS_KPA if tire.cold.has_trend else float(unseen_kpa)
    leak = newest_leak(months, values, scatter_of(values), drift_kpa if is_stuck else 0.0)
    if leak is None:
        return False
    tested, drawn = tire.tested, len(tire.series)
    line = _line(
        tire,
        name,
        history.months,
        np.where(np.arange(len(cold_kpa)) < rows[leak.begin], cold_kpa, math.nan),
        unknown,
        steps_from=steps_from,
    )
    if line is None:
        tire.tested = tested
        return False
    series, after = tire.series[drawn], len(rows) - leak.begin
    tire.series[drawn] = replace(
        series,
        abscissa=months,
        values=values,
        stds=np.full(len(rows), math.nan),
        expected=np.concatenate([series.expected, leak.expected_kpa]),
        is_outlier=np.concatenate([series.is_outlier, np.zeros(after, dtype=bool)]),
        steps=(*series.steps, leak.begin),
    )
    before, before_std = _along(line, _slope_after(line))
    first, last = int(rows[leak.begin]), int(rows[-1])
    date, until = _date(int(history.time_ns[first])), _date(int(history.time_ns[last]))
    since = Reason(FleetCode.TREND_RATE_SINCE, count=after, date=date, before=-before, std=before_std, unit="kPa/month")
    stuck = Reason(FleetCode.TREND_TEMPERATURE_STUCK, temperature_degc=float(degc[0]), count=len(degc))
    now = Reason(FleetCode.TREND_NOW_SINCE, count=after, date=date)
    status = Status.VALID if leak.is_certain else Status.PROVISIONAL
    for quantity, unit, value, std, state, why in (
        (
            Quantity.PRESSURE_LOSS,
            "kPa/month",
            leak.rate_kpa,
            leak.rate_std_kpa,
            status,
            since,
        ),
        (Quantity.PRESSURE_NOW, "kPa", leak.now_kpa, leak.now_std_kpa, status, now),
    ):
        number = TrendNumber(
            quantity,
            value,
            std,
            unit,
            state,
            (why, *((stuck,) if is_stuck else ())),
            after,
            max(leak.freedom, 1),
            value - 2.0 * std,
            value + 2.0 * std,
        )
        tire.numbers.append(_judged(number, line))
    if line.doubt is None and leak.rate_kpa > _NOTABLE_LOSS_PA * 1e-3:
        level = float(series.expected[-1])
        onset = Change(first, math.log(leak.now_kpa / level) if 0.0 < leak.now_kpa < level else None, 0.0)
        part: dict[str, Value] = {
            "date": date, "until": until, "count": after,
            "first": history.recordings[first], "last": history.recordings[last],
        }  # fmt: skip
        loses = Reason(
            FleetCode.TREND_LOSS_CHANGED, before_pa=-1e3 * before, before_std_pa=1e3 * before_std,
            after_pa=1e3 * leak.rate_kpa, after_std_pa=1e3 * leak.rate_std_kpa, **part,
        )  # fmt: skip
        tire.findings.append(Finding(loses, name, onset))
        tire.onsets.setdefault(name, []).append(onset)
    return True


def _hidden_by_frequent_refills(line: _Line) -> Reason | None:
    """Return what a tire could lose that is topped up to the same pressure every week; None where it is little.

    Its pressure is a saw-tooth, whose standard deviation is its height over the root of 12. No trend tells it from
    scatter, and the interval leaves it out: with it, it would hold nearly every loss of a sealed tire.
    """
    fit = line.fit
    hidden_pa = 1e3 * math.sqrt(12.0) * fit.scale / _OFTEN_MONTHS
    if hidden_pa < _NOTABLE_LOSS_PA:
        return None
    # One digit: it is a bound by the scatter.
    digit = 10.0 ** math.floor(math.log10(hidden_pa))
    return Reason(FleetCode.TREND_REFILLS_OFTEN, often=MOST_REFILLS, hidden_pa=digit * round(hidden_pa / digit))


def _fallen(history: TireHistory, line: _Line) -> Reason | None:
    """Return the finding of a large fall of the pressure within a time that is too short for a rate."""
    used = np.flatnonzero(~line.search.is_outlier)
    first, last = int(line.places[used[0]]), int(line.places[used[-1]])
    change, std = _along(line, line.design[used[-1]] - line.design[used[0]])
    if -1e3 * change < _NOTABLE_FALL_PA or -change < _quantile(line) * std:
        return None
    return Reason(
        FleetCode.TREND_PRESSURE_FELL,
        fall_pa=-1e3 * change,
        std_pa=1e3 * std,
        span_s=1e-9 * float(history.time_ns[last] - history.time_ns[first]),
        first=history.recordings[first],
        last=history.recordings[last],
    )


def _with_refills(plain: TrendNumber, refilled: PressureLoss, line: _Line) -> TrendNumber:
    """Return the pressure loss with refills that no step shows; its errors are those of the line at least.

    The line knows of recordings that follow each other, the likelihood of refills does not.
    """
    half = 0.5 * (plain.high - plain.low)
    low, high = min(refilled.low, refilled.value - half), max(refilled.high, refilled.value + half)
    notes = plain.reasons
    # Without refills the interval would be less than half as wide upwards: they are what limits it.
    if high - refilled.value > 2.0 * (refilled.high_unrefilled - refilled.value) and high - refilled.value > half:
        notes = (*notes, Reason(FleetCode.TREND_REFILLS_HIDE, low_pa=1e3 * max(low, 0.0), high_pa=1e3 * high))
    if (often := _hidden_by_frequent_refills(line)) is not None:
        notes = (*notes, often)
    std = max(refilled.std, plain.std)
    # Weather makes recordings that follow each other alike, and so do refills: which of the two is not known.
    used = ~line.search.is_outlier
    if correlation_factor(line.fit.residuals[used], line.fit.coefficients.size) > 1.0:
        std = math.hypot(std, 0.5 * (refilled.value - plain.value))
    return replace(plain, value=refilled.value, std=std, low=low, high=high, reasons=notes)


def _load(tire: _Tire) -> None:
    history = tire.history
    measured, stds = history.column("estimated_load_n"), history.column("estimated_load_n_std")
    line = None
    if np.isfinite(measured).any():
        line = _line(tire, "estimated_load_n", history.months, measured, stds)
    if line is None:
        tire.numbers += _stated_load(history, _missing(history, "estimated_load_n", measured))
    else:
        tire.numbers += _measured_load(line)


def _over_months(tire: _Tire, series: Series) -> None:
    """Fit the line of a quantity over the months."""
    history, watch = tire.history, series.watch
    values, stds = (watch.factor * history.column(name) for name in (series.name, f"{series.name}_std"))
    line = _line(tire, series.name, history.months, values, stds)
    unit = f"{watch.unit}/month"
    if line is None:
        why = _missing(history, series.name, values)
        tire.numbers.append(TrendNumber(rate_of(watch), unit=unit, reasons=(why,)))
    else:
        tire.numbers.append(_rate(rate_of(watch), unit, line))


def _measured_load(line: _Line) -> Iterator[TrendNumber]:
    fit, used = line.fit, ~line.search.is_outlier
    values, steps = line.values[used], _notes_of_steps(line)
    count, shared = int(values.size), _shared_std(line.stds)
    std = math.hypot(shared, float(np.std(values, ddof=1)) / math.sqrt(count))
    mean = float(values.mean())
    load = TrendNumber(
        Quantity.LOAD, mean, std, "N", Status.VALID, (), count, fit.freedom, mean - 2.0 * std, mean + 2.0 * std
    )
    yield _judged(load, line)
    yield _rate(Quantity.LOAD_RATE, "N/month", line)
    scatter = float(np.std(fit.residuals[used], ddof=fit.coefficients.size))
    scatter_std = scatter / math.sqrt(2.0 * fit.freedom)
    spread = TrendNumber(
        Quantity.LOAD_SCATTER, scatter, scatter_std, "N", Status.VALID, steps, count, fit.freedom,
        scatter - 2.0 * scatter_std, scatter + 2.0 * scatter_std,
    )  # fmt: skip
    yield _judged(spread, line)


def _stated_load(history: TireHistory, why: Reason) -> Iterator[TrendNumber]:
    """Yield the stated load where none is measured."""
    stated = history.column("load_n")
    is_stated = np.isfinite(stated)
    reasons = (Reason(FleetCode.TREND_LOAD_STATED), why)
    if is_stated.any():
        std = _shared_std(history.column("load_std_n")[is_stated]) or math.nan
        value, count = float(np.mean(stated[is_stated])), int(is_stated.sum())
        yield TrendNumber(Quantity.LOAD, value, std, "N", Status.PROVISIONAL, reasons, count)
    else:
        yield TrendNumber(Quantity.LOAD, unit="N", reasons=(why,))
    yield TrendNumber(Quantity.LOAD_RATE, unit="N/month", reasons=(why,))
    yield TrendNumber(Quantity.LOAD_SCATTER, unit="N", reasons=(why,))


def _shared_std(stds: FloatArray) -> float:
    """Return the stated error that all recordings share; 0 when it is not known."""
    return float(np.nanmedian(stds)) if np.isfinite(stds).any() else 0.0


def _stiffness(tire: _Tire, series: Series) -> None:
    history, name, watch = tire.history, series.name, series.watch
    values = history.column(name)
    factor = tire.readings.pressure_pa if watch.is_over_pressure else np.ones(len(values))
    with np.errstate(invalid="ignore", divide="ignore"):
        percent = 100.0 * np.log(values * factor)
        stds = 100.0 * history.column(f"{name}_std") / values
    quantity, temperature = rate_of(watch), by_temperature(watch)
    middle = np.nanmedian(percent) if np.isfinite(percent).any() else 0.0
    line = _line(tire, name, history.months, percent - middle, stds, warm=True)
    why = _missing(history, name, percent)
    if line is None:
        tire.numbers.append(TrendNumber(quantity, unit="%/month", reasons=(why,)))
        tire.numbers.append(TrendNumber(temperature, unit="%/K", reasons=(why,)))
        return
    rate = _rate(quantity, "%/month", line)
    if rate.status is not Status.INVALID and (stuck := _stuck(tire, line)) is not None:
        rate = replace(rate, status=Status.PROVISIONAL, reasons=(stuck, *rate.reasons))
    drift = rate
    if (
        watch.falls_with_wear
        and rate.status is not Status.INVALID
        and (worn := _softened_by_wear(tire, name, line, _slope_after(line))) is not None
    ):
        slope, slope_std = worn
        share = Reason(FleetCode.TREND_WEAR_SOFTENS, share=slope / 100.0, std=slope_std / 100.0)
        rate = replace(rate, reasons=(*rate.reasons, share))
        drift = replace(rate, value=rate.value - slope, std=math.hypot(rate.std, slope_std))
    tire.numbers.append(rate)
    if line.has_covariate:
        tire.numbers.append(_number(temperature, "%/K", line, np.eye(line.design.shape[1])[2]))
    else:
        tire.numbers.append(
            TrendNumber(temperature, unit="%/K", reasons=(Reason(FleetCode.TREND_TEMPERATURE_CONSTANT),))
        )
    if (
        line.change is None
        and _is_significant(drift, line)
        and abs(drift.value) * _span(history.months) > watch.notable
    ):
        drifts = Reason(FleetCode.TREND_STIFFNESS_DRIFTS, name=name, share=drift.value / 100.0, std=drift.std / 100.0)
        whole = drift.value * _span(history.months), drift.std * _span(history.months)
        tire.findings.append(Finding(drifts, name, _relative(name, line, None, whole)))


def _stuck(tire: _Tire, line: _Line) -> Reason | None:
    """Return that the temperature of a line is not measured, so that what a season makes looks like a trend."""
    degc = tire.readings.temperature_degc[line.places]
    if not _is_same(degc):
        return None
    return Reason(FleetCode.TREND_TEMPERATURE_STUCK, temperature_degc=float(degc[0]), count=len(degc))


def _softened_by_wear(tire: _Tire, name: str, line: _Line, along: FloatArray) -> tuple[float, float] | None:
    """Return a combination (p,) of the coefficients of ln(stiffness) that the wear makes in percent, and its error.

    None without wear. A wear that decreases is none: a bending stiffness that rises is the rubber's.
    """
    history = tire.history
    thickness_mm, wear_mm = 1e3 * history.column("ring_thickness_m")[line.places], history.column("wear_mm")
    # Statements that only the wear rests on shift it: their levels are fitted beside those of the stiffness.
    more = set(places_of(tire.changes, "wear_mm")) - set(places_of(tire.changes, name))
    design = np.column_stack([line.design, *_levels(line.places, sorted(more))])
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
    whole = np.concatenate([along, np.zeros(design.shape[1] - len(along))])
    value = float(whole @ wear_fit.coefficients)
    return (value, math.sqrt(max(float(whole @ wear_fit.covariance @ whole), 0.0))) if value < 0.0 else None


def _sensor(tire: _Tire) -> None:
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
        tested = name in _TESTED_OF_SENSOR
        findings_before = len(tire.findings)
        line = _line(tire, name, history.months, values, stds, covariate=covariate, tested=tested)
        quantity, unit = rate_of(watch), f"{watch.unit}/month"
        if line is None:
            why = _missing(history, name if name in history.invalid else "", values)
            tire.numbers.append(TrendNumber(quantity, unit=unit, reasons=(why,)))
            continue
        rate = _rate(quantity, unit, line)
        over = abs(rate.value) * _span(history.months)
        # Of a covariate that goes with the time, what bends its influence looks like a trend.
        shown = not line.has_covariate or _inflation(line) < _MOST_INFLATION
        if not shown:
            del tire.findings[findings_before:]
        if not shown and rate.status is not Status.INVALID:
            why = Reason(FleetCode.TREND_SPEED_WITH_TIME)
            rate = replace(rate, status=Status.PROVISIONAL, reasons=(why, *rate.reasons))
        tire.numbers.append(rate)
        if name == "gain" and line.doubt is not None:
            # That gain and zero are not parted in a recording, or contradict what is stated, is what changes.
            steady = list(_steady_value(tire, line))
            tire.findings += steady
            tire.onsets |= {finding.series: list(_notable_changes(name, line)) for finding in steady}
            continue
        change, std = _along(line, _from_first_to_last(line))
        worse = not watch.worse or change * watch.worse > 0.0
        # A single change that the series shows is told with its date; a drift beside it by the whole change.
        is_told = len(tire.findings) == findings_before + 1 and (
            over <= watch.notable or not _is_significant(rate, line)
        )
        if is_told or not (worse and abs(change) > watch.notable and abs(change) > _quantile(line) * std):
            continue
        if rate.status is Status.VALID and shown and line.steps and not _is_significant(rate, line):
            # What changes at once has a date.
            del tire.findings[findings_before:]
            sizes = [_size_of_step(line, number) for number in range(len(line.steps))]
            largest = int(np.argmax([abs(size) for size, _ in sizes]))
            begin, end = line.steps[largest], min([*line.steps[largest + 1 :], len(line.values)])
            changed = _changed(watch.level, history, name, line, sizes[largest], begin, end)
            tire.findings.append(Finding(changed, name, _relative(name, line, begin, sizes[largest])))
        elif rate.status is Status.VALID and shown and watch.drift:
            del tire.findings[findings_before:]
            code, value = watch.drift
            tire.findings.append(
                Finding(Reason(code, **{value: _DRIFTS[value](change)}, std=_std_of_drift(value, change, std)), name)
            )


def _std_of_drift(value: str, change: float, std: float) -> float:
    """Return the error of the value of a drift from that of the change."""
    return abs(_DRIFTS[value](change + std) - _DRIFTS[value](change - std)) / 2.0


def _inflation(line: _Line) -> float:
    """Return the variance inflation factor of the trend by the covariate."""
    time, covariate = (line.design[:, column] - line.design[:, column].mean() for column in (1, 2))
    square = float(time @ covariate) ** 2 / float((time @ time) * (covariate @ covariate))
    return 1.0 / max(1.0 - square, np.finfo(np.float64).eps)


def _from_first_to_last(line: _Line) -> FloatArray:
    """Return the coefficients (p,) of the change over all recordings, at one value of the covariate."""
    along = line.design[-1] - line.design[0]
    if line.has_covariate:
        along[2] = 0.0
    return np.asarray(along)


def _steady_value(tire: _Tire, line: _Line) -> Iterator[Finding]:
    """Yield what has changed of a sensor whose recordings do not part gain and zero: either, where all together do."""
    history = tire.history
    radius_m, speed_mps = history.column("stated_radius_m"), history.column("speed_mean_mps")
    gain, zero = SERIES["gain"].watch, SERIES["zero_g_offset_mps2"].watch
    parted = parted_drift(history.months, history.column("gain"), radius_m, speed_mps)
    change, std = _along(line, _from_first_to_last(line))
    share, least_gain = change / gain.factor, gain.notable / gain.factor
    as_zero_mps2 = zero_of(share, radius_m, speed_mps)
    # Two are parted where each is known to a share of what would explain all, or of what matters.
    if (
        parted is not None
        and parted.gain_std < _PARTED * max(abs(share), 2.0 * least_gain)
        and parted.zero_std_mps2 < _PARTED * max(abs(as_zero_mps2), 2.0 * zero.notable)
    ):
        many = _quantile_of(parted.freedom)
        if abs(parted.gain) > max(many * parted.gain_std, least_gain):
            yield Finding(Reason(CoreCode.TREND_SENSOR_GAIN, share=parted.gain, std=parted.gain_std), "gain")
        if abs(parted.zero_mps2) > max(many * parted.zero_std_mps2, zero.notable):
            moved = Reason(CoreCode.TREND_SENSOR_ZERO, change_mps2=parted.zero_mps2, std=parted.zero_std_mps2)
            yield Finding(moved, "zero_g_offset_mps2")
    elif abs(change) > _quantile(line) * std and (abs(share) > least_gain or abs(as_zero_mps2) > zero.notable):
        yield Finding(
            Reason(FleetCode.TREND_SENSOR_STEADY, share=share, change_mps2=as_zero_mps2, std=std / gain.factor), "gain"
        )


def _std_of(name: str) -> str:
    """Return the column of the standard error of a column: that of a condition has its unit at the end."""
    return "mounting_offset_std_m" if name == "mounting_offset_m" else f"{name}_std"


def _line(
    tire: _Tire,
    name: str,
    abscissa: FloatArray,
    values: FloatArray,
    stds: FloatArray,
    *,
    against: str = "months",
    warm: bool = False,
    covariate: FloatArray | None = None,
    steps_from: float = 0.0,
    tested: bool = True,
) -> _Line | None:
    """Fit a trend with steps, test for outliers, and keep the series; None with too few values.

    Args:
        tire: to add series and outliers to.
        name: of the series.
        abscissa: (n,).
        values: (n,) NaN where unknown, in the unit of the series.
        stds: (n,) stated errors.
        against: name of the abscissa.
        warm: whether the temperature may have an influence.
        covariate: (n,) another influence.
        steps_from: least size of a step.
        tested: whether outliers are reported.
    """
    history, watch = tire.history, SERIES[name].watch
    usable = np.isfinite(values)
    if warm:
        usable &= ~tire.readings.is_impossible
    index = np.flatnonzero(usable)
    if len(index) < LEAST_FREEDOM + 2 or not _span(abscissa[index]) > 0.0:
        return None
    columns = [np.ones(len(index)), _centred(abscissa[index])]
    other = tire.readings.temperature_degc if warm else covariate
    least = _LEAST_SPREAD_K if warm else _LEAST_SPREAD_SPEED
    has_covariate = other is not None and len(index) >= _LEAST_FOR_TEMPERATURE and _varies(other[index], least)
    if has_covariate and other is not None:
        columns.append(_centred(other[index]))
    levels = _levels(index, places_of(tire.changes, name))
    # By a step of the load the contact is another, and what is taken from it for wear as well.
    steps_of_load = [change.begin for change in tire.onsets.get("estimated_load_n", ()) if change.begin is not None]
    loads = _levels(index, steps_of_load)[:_MOST_LOAD_LEVELS] if name == "wear_mm" else []
    design = np.column_stack([*columns, *levels, *loads])
    of_load = slice(len(columns) + len(levels), design.shape[1])
    chosen, chosen_stds = values[index], stds[index]
    shape = find_shape(
        design,
        chosen,
        family=tire.family,
        least_step=steps_from,
        least_change=_FOLLOWED * watch.notable,
        may_be_isolated=tested,
    )
    steps, change = shape.steps, shape.change
    of_all = history.doubts_of(name)
    doubts = [of_all[row] for row in index]

    def fitted_line(change: LateChange | None) -> _Line:
        plain = with_steps(design, steps)
        for columns in _columns_of(change, steps, len(index)):
            whole = np.column_stack([plain, *columns])
            weights = np.multiply(weights_of(whole, chosen, chosen_stds), weights_by_doubt(doubts))
            if tested:
                search = find_outliers(whole, chosen, weights, family=tire.family)
            else:
                every = np.ones(len(index), dtype=bool)
                search = OutlierSearch(~every, fitted(whole, chosen, weights, every))
            if search.fit is not None:
                break
        doubt = doubt_of([doubts[row] for row in np.flatnonzero(~search.is_outlier)])
        dates = tuple(_date(int(history.time_ns[row])) for row in index)
        return _Line(
            index,
            chosen,
            chosen_stds,
            whole,
            steps,
            search,
            has_covariate,
            doubt,
            len(levels),
            dates,
            change,
            len(columns) > 1,
            of_load,
        )

    line = fitted_line(change)
    if change is None and line.search.fit is not None and (begin := _last_run(line)) is not None:
        # The newest recordings do not fit, but agree with each other.
        change = LateChange(begin, False, (np.arange(len(index)) >= begin).astype(np.float64))
        line = fitted_line(change)
    if change is not None and not change.is_slope and steps_from and _size_of_change(line)[0] > 0.0:
        steps = [*steps, change.begin]
        line = fitted_line(None)
    if line.search.fit is None:
        return None
    search, fit = line.search, line.fit
    # Figures show what remains at the mean temperature or speed.
    moved = design[:, 2] * fit.coefficients[2] if has_covariate else np.zeros(len(index))
    if tested:
        tire.tested += len(index)
        outliers = [number for number in np.flatnonzero(search.is_outlier).tolist() if _matters(watch, fit, number)]
        tire.outliers += [_outlier(history, name, watch.unit, line, fit, number) for number in outliers]
    tire.series.append(
        TrendSeries(
            name=name,
            unit=watch.unit,
            against=against,
            abscissa=abscissa[index] * (1e3 if against == "km" else 1.0),
            values=chosen - moved,
            stds=chosen_stds,
            expected=fit.expected - moved,
            is_outlier=search.is_outlier if tested else np.zeros(len(index), dtype=bool),
            steps=tuple(sorted({*steps, *([line.change.begin] if line.change is not None else [])})),
        )
    )
    if line.doubt is None:
        tire.findings += _findings_of_line(tire, name, line)
        tire.onsets[name] = list(_notable_changes(name, line))
    return line


def _matters(watch: Watch, fit: Fit, number: int) -> bool:
    """Return whether an outlier is reported: a sensor's only to the worse, and by what is worth a finding."""
    residual = float(fit.residuals[number])
    return watch.trend is not Trend.SENSOR or (
        residual * (watch.worse or residual) > 0.0 and abs(residual) >= watch.notable
    )


def _columns_of(change: LateChange | None, steps: Sequence[int], count: int) -> list[list[FloatArray]]:
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


def _last_run(line: _Line) -> int | None:
    """Return where outliers to one side begin that reach the last value; None where it is none or alone."""
    return next((begin for begin, end in _runs(line.search) if end == len(line.values)), None)


def _runs(search: OutlierSearch) -> list[tuple[int, int]]:
    """Return begin and end of each run of outliers to one side."""
    assert search.fit is not None
    sides = search.is_outlier & (search.fit.residuals > 0.0), search.is_outlier & (search.fit.residuals < 0.0)
    both = [*runs(sides[0]), *runs(sides[1])]
    return sorted((begin, end) for begin, end in both if end - begin >= _LEAST_RUN)


def _size_of_change(line: _Line) -> tuple[float, float]:
    """Return the distance of the newest value from the trend before the change, and its error."""
    assert line.change is not None
    return _along(line, _size_of_change_at(line))


def _size_of_step(line: _Line, number: int) -> tuple[float, float]:
    """Return the change of level at a step, and its error."""
    along = np.zeros(line.design.shape[1])
    along[line.design.shape[1] - len(line.steps) + number - (0 if line.change is None else 1 + line.has_own_line)] = 1.0
    return _along(line, along)


def _size_of_run(line: _Line, begin: int, end: int) -> tuple[float, float]:
    """Return the mean deviation of recordings in a row, and its error."""
    fit = line.fit
    residuals = fit.residuals[begin:end]
    return float(residuals.mean()), float(residuals.std(ddof=1)) / math.sqrt(end - begin)


def _notable_changes(name: str, line: _Line) -> Iterator[Change]:
    """Yield the changes so large that others may follow them, whether they are faults or not.

    A long series shows changes that are too small to be the cause of anything.
    """
    notable = SERIES[name].watch.notable
    yield from (_relative(name, line, begin, _size_of_run(line, begin, end)) for begin, end in _runs(line.search))
    sizes = [(begin, _size_of_step(line, number)) for number, begin in enumerate(line.steps)]
    if line.change is not None:
        sizes.append((line.change.begin, _size_of_change(line)))
    yield from (_relative(name, line, begin, size) for begin, size in sizes if abs(size[0]) >= notable)


def _relative(name: str, line: _Line, begin: int | None, size: tuple[float, float]) -> Change:
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


def _along(line: _Line, along: FloatArray) -> tuple[float, float]:
    """Return a combination (p,) of the coefficients of a line and its error.

    That of few recordings is not below the error that the scatter of all gives: theirs may be small by chance.
    """
    fit = line.fit
    variance = float(along @ fit.covariance @ along)
    if line.change is not None:
        rows = (line.design * np.sqrt(fit.weights)[:, None])[~line.search.is_outlier]
        variance = max(variance, fit.scale**2 * float(along @ np.linalg.pinv(rows.T @ rows) @ along))
    return float(along @ fit.coefficients), math.sqrt(max(variance, 0.0))


def _findings_of_line(tire: _Tire, name: str, line: _Line) -> Iterator[Finding]:
    """Yield a finding for each notable change from one recording on, and for recordings in a row that deviate."""
    history, change, fit, watch = tire.history, line.change, line.fit, SERIES[name].watch
    for begin, end in _runs(line.search):
        scale = fit.scale / np.sqrt(fit.weights[begin:end])
        least = float(np.abs(fit.residuals[begin:end] / scale).min()) if fit.scale > 0.0 else math.inf
        passed = Reason(FleetCode.TREND_PASSED, name=name, deviations=least, **_recordings(history, line, begin, end))
        yield Finding(passed, name, _relative(name, line, begin, _size_of_run(line, begin, end)))
    for number, begin in enumerate(line.steps):
        size, std = _size_of_step(line, number)
        if abs(size) >= watch.notable and size * (watch.worse or size) > 0.0:
            end = min([after for after in line.steps if after > begin], default=len(line.values))
            changed = _changed(watch.level, history, name, line, (size, std), begin, end)
            yield Finding(changed, name, _relative(name, line, begin, (size, std)))
    if change is None:
        return
    size, std = _size_of_change(line)
    explained = _softened_by_wear(tire, name, line, _size_of_change_at(line)) if watch.falls_with_wear else None
    if explained is not None:
        size, std = size - explained[0], math.hypot(std, explained[1])
    if size * (watch.worse or size) <= 0.0:
        return
    end, onset = len(line.values), _relative(name, line, change.begin, (size, std))
    if change.is_slope and name in ("wear_mm", "pressure_at_20_degc"):
        # Slower wear needs no attention; a leak does before it has become a low pressure.
        before, after = _along(line, _slope_before(line)), _along(line, _slope_after(line))
        part = _recordings(history, line, change.begin, end)
        bend, bend_std = _along(line, _slope_after(line) - _slope_before(line))
        if abs(bend) < _quantile(line) * bend_std:
            return
        if name == "wear_mm" and bend > 0.0 and abs(size) >= watch.notable:
            wears = Reason(
                FleetCode.TREND_WEAR_CHANGED, before_m=1e-3 * before[0], before_std_m=1e-3 * before[1],
                after_m=1e-3 * after[0], after_std_m=1e-3 * after[1], **part,
            )  # fmt: skip
            yield Finding(wears, name, onset)
        elif name != "wear_mm" and bend < 0.0 and -after[0] > max(1e-3 * _NOTABLE_LOSS_PA, 2.0 * after[1]):
            loses = Reason(
                FleetCode.TREND_LOSS_CHANGED, before_pa=-1e3 * before[0], before_std_pa=1e3 * before[1],
                after_pa=-1e3 * after[0], after_std_pa=1e3 * after[1], **part,
            )  # fmt: skip
            yield Finding(loses, name, onset)
    elif abs(size) >= watch.notable:
        code = FleetCode.TREND_SLOPE_CHANGED if change.is_slope else watch.level
        yield Finding(_changed(code, history, name, line, (size, std), change.begin, end), name, onset)


def _changed(
    code: Code, history: TireHistory, name: str, line: _Line, size: tuple[float, float], begin: int, end: int
) -> Reason:
    """Return the finding of a change; that of a logarithm as a share of the value itself."""
    (change, std), watch = size, SERIES[name].watch
    if watch.is_logarithm:
        change, std = 100.0 * math.expm1(change / 100.0), std * math.exp(change / 100.0)
    return Reason(code, name=name, change=change, std=std, unit=watch.unit, **_recordings(history, line, begin, end))


def _recordings(history: TireHistory, line: _Line, begin: int, end: int) -> dict[str, Value]:
    """Return dates, number and names of the recordings of a part of a line."""
    first, last = history.recordings[int(line.places[begin])], history.recordings[int(line.places[end - 1])]
    return {
        "date": line.dates[begin], "until": line.dates[end - 1], "count": end - begin, "first": first, "last": last
    }  # fmt: skip


def _slope_before(line: _Line) -> FloatArray:
    """Return the coefficients (p,) of the slope before a change."""
    along = np.zeros(line.design.shape[1])
    along[1] = 1.0
    return along


def _slope_after(line: _Line) -> FloatArray:
    """Return the coefficients (p,) of the newest slope."""
    along = _slope_before(line)
    if line.change is not None and line.change.is_slope:
        along[line.change_at] = 1.0
    return along


def _size_of_change_at(line: _Line) -> FloatArray:
    """Return the coefficients (p,) of the distance of the newest value from the trend before the change."""
    along = np.zeros(line.design.shape[1])
    along[line.change_at :] = line.design[-1, line.change_at :]
    return along


def _date(time_ns: int) -> str:
    return str(np.datetime64(time_ns, "ns").astype("datetime64[D]"))


def _outlier(history: TireHistory, name: str, unit: str, line: _Line, fit: Fit, number: int) -> TrendOutlier:
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


def _rate(
    quantity: str,
    unit: str,
    line: _Line,
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
            why = Reason(FleetCode.TREND_DISTANCE_SHORT, distance_m=1e6 * span, needed_m=1e6 * least)
        else:
            second = _DAY_S / _DAY_MONTHS
            why = Reason(FleetCode.TREND_SPAN_SHORT, span_s=second * span, needed_s=second * least)
        return TrendNumber(quantity, unit=unit, reasons=(why,), count=int((~line.search.is_outlier).sum()))
    reasons = (*reasons, *_notes_of_steps(line))
    before = _slope_before(line)
    if change is None:
        return _number(quantity, unit, line, before, factor=factor, status=status, reasons=reasons)
    end = len(line.values)
    if not change.is_slope or line.newest < LEAST_AFTER or np.ptp(line.design[change.begin - 1 :, 1]) < least:
        omitted = Reason(FleetCode.TREND_NEWEST_LEFT, count=end - change.begin, date=line.dates[change.begin])
        return _number(
            quantity, unit, line, before, factor=factor, status=Status.PROVISIONAL, reasons=(omitted, *reasons)
        )
    value, std = _along(line, before)
    since = Reason(
        FleetCode.TREND_RATE_SINCE, count=end - change.begin, date=line.dates[change.begin], before=factor * value,
        std=abs(factor) * std, unit=unit,
    )  # fmt: skip
    if line.newest < _LEAST_VALID:
        status = Status.PROVISIONAL
    return _number(quantity, unit, line, _slope_after(line), factor=factor, status=status, reasons=(since, *reasons))


def _notes_of_steps(line: _Line) -> tuple[Reason, ...]:
    return (Reason(FleetCode.TREND_STEPS, count=len(line.steps)),) if line.steps else ()


def _number(
    quantity: str,
    unit: str,
    line: _Line,
    along: FloatArray,
    *,
    factor: float = 1.0,
    status: Status = Status.VALID,
    reasons: tuple[Reason, ...] = (),
) -> TrendNumber:
    """Return a combination (p,) of the coefficients of a line as a number."""
    from scipy import stats

    fit = line.fit
    value, std = _along(line, along)
    value, std = factor * value, abs(factor) * std
    freedom, count = fit.freedom, fit.freedom + fit.coefficients.size
    if line.has_own_line and along[line.change_at :].any():
        freedom, count = max(1, min(freedom, line.newest - 2)), line.newest
    half = float(stats.t.ppf(0.975, freedom)) * std
    outliers = int(line.search.is_outlier.sum())
    notes = (*reasons, Reason(FleetCode.TREND_OUTLIERS_LEFT_OUT, count=outliers)) if outliers else reasons
    number = TrendNumber(quantity, value, std, unit, status, notes, count, freedom, value - half, value + half)
    return _judged(number, line)


def _at_end(quantity: str, unit: str, line: _Line) -> TrendNumber:
    """Return the value of the trend at the last recording; its error includes what all recordings share.

    It follows a change. It is provisional where few recordings show the newest state, or the last one contradicts it.
    """
    row = line.design[-1].copy()
    if line.has_covariate:
        row[2] = 0.0
    row[line.of_load] = 0.0
    number = _number(quantity, unit, line, row, reasons=_notes_of_steps(line))
    shared = _shared_std(line.stds)
    half, std = math.hypot(number.high - number.value, 2.0 * shared), math.hypot(number.std, shared)
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


def _deviation_of_last(line: _Line) -> float | None:
    """Return the deviation of the last value in standard deviations where chance does not explain it."""
    fit = line.fit
    if not fit.scale > 0.0 or fit.freedom < LEAST_FREEDOM + 1:
        return None
    deviation = float(fit.residuals[-1]) * math.sqrt(float(fit.weights[-1])) / fit.scale
    if line.search.is_outlier[-1]:
        return deviation
    square = deviation**2 / (1.0 - float(fit.leverage[-1]))
    remaining = fit.freedom - square
    apart = math.sqrt(square * (fit.freedom - 1) / remaining) if remaining > 0.0 else math.inf
    return deviation if apart > _quantile_of(fit.freedom - 1) else None


def _judged(number: TrendNumber, line: _Line) -> TrendNumber:
    """Return a number of a line with the doubts about its recordings, and the levels that are fitted apart."""
    notes = (Reason(FleetCode.TREND_STATED_LEVELS, count=line.levels),) if line.levels else ()
    if line.doubt is None:
        return replace(number, reasons=(*number.reasons, *notes))
    return replace(number, status=Status.PROVISIONAL, reasons=(line.doubt, *number.reasons, *notes))


def _levels(index: IntArray, places: Sequence[int]) -> list[FloatArray]:
    """Return a column for each change that some recordings come before and some after, 0 before and 1 after."""
    columns = [(index >= begin).astype(np.float64) for begin in places]
    return [
        column
        for number, column in enumerate(columns)
        if 0.0 < column.sum() < len(index) and not any((column == other).all() for other in columns[:number])
    ]


def _is_significant(number: TrendNumber, line: _Line) -> bool:
    if number.status is not Status.VALID:
        return False
    if not number.std > 0.0:
        return number.value != 0.0
    return abs(number.value) > _quantile(line) * number.std


def _quantile_of(freedom: int) -> float:
    """Return Student's t beyond which a number is a finding."""
    from scipy import stats

    return float(stats.t.ppf(0.5 + 0.5 * _FINDING_SHARE, freedom))


def _quantile(line: _Line) -> float:
    """Return Student's t beyond which a number of a line is a finding."""
    return _quantile_of(line.fit.freedom)


def _pairs(tires: Sequence[TireHistory]) -> Iterator[PairTrend]:
    """Yield the asymmetry of wheels whose positions differ in left and right only, over common recordings."""
    by_vehicle: dict[str, dict[str, list[TireHistory]]] = defaultdict(lambda: defaultdict(list))
    for tire in tires:
        by_vehicle[tire.vehicle][tire.position].append(tire)
    for vehicle, wheels in by_vehicle.items():
        for left_position in wheels:
            right_position = right_of(left_position)
            if right_position in wheels:
                numbers = tuple(
                    _difference(quantity, wheels[left_position], wheels[right_position])
                    for quantity in declared()
                    if quantity.compared
                )
                if not all(tire.is_identified for side in (left_position, right_position) for tire in wheels[side]):
                    numbers = tuple(map(_of_unknown_tire, numbers))
                yield PairTrend(vehicle, left_position, right_position, numbers)


def _difference(
    compared: Declared, left_tires: Sequence[TireHistory], right_tires: Sequence[TireHistory]
) -> TrendNumber:
    quantity = asymmetry_of(compared)
    first, second = _by_path(left_tires, compared.column), _by_path(right_tires, compared.column)
    starts = {
        path: (int(time_ns), path)
        for tire in left_tires
        for path, time_ns in zip(tire.paths, tire.time_ns, strict=True)
    }
    common = sorted(first.keys() & second.keys(), key=lambda path: starts[path])
    differences = np.array([first[path][0] - second[path][0] for path in common]) * _ANGLES
    stds = np.array([math.hypot(first[path][1], second[path][1]) for path in common]) * _ANGLES
    if len(common) < LEAST_FREEDOM + 1:
        reason = Reason(FleetCode.TREND_TOO_FEW, count=len(common), needed=LEAST_FREEDOM + 1)
        return TrendNumber(quantity, unit="deg", reasons=(reason,))
    design = np.ones((len(common), 1))
    search = find_outliers(design, differences, weights_of(design, differences, stds), family=1)
    fit = search.fit
    if fit is None:
        return TrendNumber(quantity, unit="deg", reasons=(Reason(FleetCode.TREND_UNDETERMINED),))
    # What all recordings share, such as the roll of a sensor, is part of the stated errors only.
    value, std = float(fit.coefficients[0]), math.hypot(fit.std(0), _shared_std(stds))
    doubts = [
        first[path][2] or second[path][2]
        for path, left_out in zip(common, search.is_outlier, strict=True)
        if not left_out
    ]
    why = [doubt] if (doubt := doubt_of(doubts)) is not None else []
    is_outlier = search.is_outlier
    for begin, end in _runs(search):
        if end == len(common):
            why.append(Reason(FleetCode.TREND_NEWEST_LEFT, count=end - begin, date=_date(starts[common[begin]][0])))
    notes = [Reason(FleetCode.TREND_OUTLIERS_LEFT_OUT, count=int(is_outlier.sum()))] if is_outlier.any() else []
    return TrendNumber(
        quantity,
        value,
        std,
        "deg",
        Status.PROVISIONAL if why else Status.VALID,
        (*why, *notes),
        fit.freedom + 1,
        fit.freedom,
        value - 2.0 * std,
        value + 2.0 * std,
    )


def _by_path(tires: Sequence[TireHistory], name: str) -> dict[str, tuple[float, float, str]]:
    """Return value, standard error and doubt of a quantity by the path of the recording."""
    by_path: dict[str, tuple[float, float, str]] = {}
    for tire in tires:
        values, stds = tire.column(name), tire.column(f"{name}_std")
        doubts = tire.doubts_of(name)
        rows = np.flatnonzero(np.isfinite(values))
        by_path |= {tire.paths[i]: (float(values[i]), float(stds[i]), doubts[i]) for i in rows}
    return by_path


def _missing(history: TireHistory, name: str, values: FloatArray) -> Reason:
    """Return why a series gives no number."""
    if not _has_rolled(history):
        return Reason(FleetCode.TREND_NO_REVOLUTION)
    count = int(np.isfinite(values).sum())
    if not count and history.invalid.get(name):
        return Reason(FleetCode.TREND_NO_VALUES, why=history.invalid[name])
    if count < LEAST_FREEDOM + 2:
        return Reason(FleetCode.TREND_TOO_FEW, count=count, needed=LEAST_FREEDOM + 2)
    return Reason(FleetCode.TREND_UNDETERMINED)


def _has_rolled(history: TireHistory) -> bool:
    """Return whether a recording has a revolution, or does not say how many."""
    revolutions = history.column("revolutions")
    return not np.isfinite(revolutions).any() or bool((revolutions > 0.0).any())


def _centred(values: FloatArray) -> FloatArray:
    return np.asarray(values - values.mean(), dtype=np.float64)


def _varies(values: FloatArray, least: float) -> bool:
    return bool(np.isfinite(values).all()) and float(values.std()) >= least


def _is_same(values: FloatArray) -> bool:
    """Return whether all values are equal: measured ones never are."""
    return bool(values.size) and float(np.ptp(values)) == 0.0


def _span(values: FloatArray) -> float:
    finite = values[np.isfinite(values)]
    return float(np.ptp(finite)) if finite.size else 0.0
