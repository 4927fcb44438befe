"""Trends as rows: for scripts as JSON and CSV, for the terminal, and for the report."""

import io
import math
from collections.abc import Iterator, Sequence
from typing import Any, Final

import numpy as np

from gateway import __version__
from gateway.core.estimates.estimator import Status
from gateway.core.quantity import Trend
from gateway.core.quantity_catalogue import declared
from gateway.core.reasons import Reason
from gateway.core.text.numbers import MISSING, STATUS_MARKS, finite_or_none, fixed, round_to_error, split_name
from gateway.core.text.plain_values import plain, record
from gateway.core.text.table_sinks import CsvSink
from gateway.core.text.text import clean, counted, pad, storable, width
from gateway.core.text.wording import joined, text
from gateway.fleet.trends.marked_findings import finding_key
from gateway.fleet.trends.trend_result import (
    UNKNOWN_VEHICLE,
    FleetTrends,
    PairTrend,
    Quantity,
    TireTrend,
    TrendNumber,
    TrendOutlier,
    asymmetry_of,
    by_temperature,
    rate_of,
)
from gateway.fleet.trends.watched_series import SERIES, followed_by, label_of

FORMAT: Final = "treadlink trends"
FORMAT_VERSION: Final = 1

LABELS: Final[dict[str, str]] = {
    Quantity.WEAR_RATE: "wear",
    Quantity.WEAR_NOW: "wear at the end",
    Quantity.PRESSURE_LOSS: "pressure loss",
    Quantity.PRESSURE_NOW: "pressure at the end, at 20 °C",
    Quantity.LOAD: "load",
    Quantity.LOAD_RATE: "change of the load",
    Quantity.LOAD_SCATTER: "scatter of the load",
    **{rate_of(quantity.watch): f"change of the {quantity.label}" for quantity in followed_by(Trend.LINE)},
    **{
        name(quantity.watch): f"{quantity.label} with {what}"
        for quantity in followed_by(Trend.STIFFNESS)
        for name, what in ((rate_of, "age"), (by_temperature, "temperature"))
    },
    **{rate_of(quantity.watch): quantity.label.removeprefix("ln ") for quantity in followed_by(Trend.SENSOR)},
    **{
        asymmetry_of(quantity): f"{split_name(quantity.name)[0]}, left less right"
        for quantity in declared()
        if quantity.compared
    },
}
"""Label of each number of a trend."""
_SHORT: Final = (Quantity.WEAR_RATE, Quantity.PRESSURE_LOSS, Quantity.LOAD, "Bs_rate", "noise_rate")
_LISTED: Final = 40
_NAMED_TIRES: Final = 3
_COLUMNS: Final = (
    "vehicle", "position", "other_position", "sensor_id", "part", "first_utc", "last_utc", "recordings", "distance_km",
    "has_odometer", "quantity", "value", "std", "unit", "low_95", "high_95", "status", "count", "freedom", "codes",
    "reason", "findings",
)  # fmt: skip


def tire_name(trend: TireTrend | TrendOutlier) -> str:
    """Return vehicle, wheel and sensor of a tire as one text."""
    parts = [trend.vehicle, trend.position, *([trend.sensor_id] if trend.sensor_id else [])]
    if isinstance(trend, TireTrend) and trend.part > 1:
        parts.append(f"tire {trend.part}")
    if isinstance(trend, TireTrend) and not trend.is_identified:
        parts.append("(not identified)")
    return clean(" ".join(parts))


def day(time_ns: int) -> str:
    """Return the day of a time, UTC."""
    return str(np.datetime_as_string(np.datetime64(time_ns, "ns"), unit="D"))


def shown(number: TrendNumber) -> str:
    """Return value and standard error, or a dash where it is not determined."""
    if number.status is Status.INVALID:
        return MISSING
    mark = STATUS_MARKS[number.status]
    return f"{round_to_error(number.value, number.std).joined()}{' ' + mark if mark else ''}"


def number_of(numbers: Sequence[TrendNumber], quantity: str) -> TrendNumber:
    """Return a number of a tire; one without a value when the tire has none."""
    return next((number for number in numbers if number.quantity == quantity), TrendNumber(quantity))


def unit_in(tires: Sequence[TireTrend], quantity: str) -> str:
    """Return the unit of a quantity."""
    return next((n.unit for tire in tires for n in tire.numbers if n.quantity == quantity), "")


def trends_json(trends: FleetTrends) -> dict[str, Any]:
    """Return trends as plain dicts, lists, strings and finite numbers; null where a value is not known."""
    document = {
        "format": FORMAT,
        "version": FORMAT_VERSION,
        "treadlink": __version__,
        "recordings": trends.recordings,
        "failures": trends.failures,
        "tested_values": trends.tested,
        "notes": trends.notes,
        "tires": [
            record(
                trend,
                without=("first_ns", "last_ns", "series"),
                first_utc=_utc(trend.first_ns),
                last_utc=_utc(trend.last_ns),
                numbers=list(map(_number_json, trend.numbers)),
            )
            for trend in trends.tires
        ],
        "pairs": [record(pair, numbers=list(map(_number_json, pair.numbers))) for pair in trends.pairs],
        "outliers": [
            record(outlier, without=("time_ns",), start_utc=_utc(outlier.time_ns)) for outlier in trends.outliers
        ],
    }
    return dict(plain(document))


def trends_csv(trends: FleetTrends) -> bytes:
    """Return one row for each number of each tire, and of each pair, as CSV."""
    file = io.BytesIO()
    sink = CsvSink(file)
    sink.header(_COLUMNS)
    for trend in trends.tires:
        head: list[Any] = [
            storable(trend.vehicle), trend.position, "", trend.sensor_id, trend.part, _utc(trend.first_ns),
            _utc(trend.last_ns), trend.recordings, finite_or_none(trend.distance_km), trend.has_odometer,
        ]  # fmt: skip
        for number in trend.numbers:
            sink.row([*head, *_cells(number), findings_text(trend.findings)])
    for pair in trends.pairs:
        start: list[Any] = [storable(pair.vehicle), pair.left, pair.right, "", None, "", "", None, None, None]
        for number in pair.numbers:
            sink.row([*start, *_cells(number), ""])
    sink.end()
    return file.getvalue()


def vehicles_of(trends: FleetTrends) -> str:
    """Return `2 vehicles`, `1 vehicle and unknown ones` or `unknown vehicles`."""
    names = {trend.vehicle for trend in trends.tires}
    known_count = len(names - {UNKNOWN_VEHICLE})
    if UNKNOWN_VEHICLE not in names:
        return counted(known_count, "vehicle")
    return f"{counted(known_count, 'vehicle')} and unknown ones" if known_count else "unknown vehicles"


def trend_lines(trends: FleetTrends) -> Iterator[str]:
    """Yield the summary for a terminal."""
    first = min(trend.first_ns for trend in trends.tires)
    last = max(trend.last_ns for trend in trends.tires)
    tires, read = counted(len(trends.tires), "tire"), counted(trends.recordings, "recording")
    yield f"{tires} of {vehicles_of(trends)}, {read}, {day(first)} to {day(last)} (UTC)"
    yield from (clean(text(note)) for note in trends.notes)
    yield ""
    rows = [["tire", "recordings", *(f"{LABELS[name]}, {unit_in(trends.tires, name)}" for name in _SHORT)]]
    rows += [
        [tire_name(trend), str(trend.recordings), *(shown(number_of(trend.numbers, name)) for name in _SHORT)]
        for trend in trends.tires[:_LISTED]
    ]
    widths = [max(width(row[column]) for row in rows) for column in range(len(rows[0]))]
    yield from ("  ".join(pad(cell, cells) for cell, cells in zip(row, widths, strict=True)).rstrip() for row in rows)
    if len(trends.tires) > _LISTED:
        yield f"... and {len(trends.tires) - _LISTED} more tires: --json, --csv or --html"
    yield from _mark_lines(trends.tires[:_LISTED])
    findings = finding_rows(trends.tires)
    yield ""
    yield "findings:" if findings else "no finding"
    yield from (f"  {key}  {name}: {said}" for name, said, key in findings[:_LISTED])
    if len(findings) > _LISTED:
        yield f"  ... and {len(findings) - _LISTED} more"
    yield from _pair_lines(trends.pairs)
    yield from _outlier_lines(trends)


def finding_rows(tires: Sequence[TireTrend]) -> list[tuple[str, str, str]]:
    """Return tire, text and key of each finding; of those with one key the last, with how many more there are."""
    rows = []
    for tire in tires:
        alike: dict[str, list[Reason]] = {}
        for finding in tire.findings:
            alike.setdefault(finding_key(tire, finding), []).append(finding)
        for key, findings in alike.items():
            more = f" (and {len(findings) - 1} more)" if len(findings) > 1 else ""
            rows.append((tire_name(tire), f"{clean(text(findings[-1]))}{more}", key))
    return rows


def _mark_lines(tires: Sequence[TireTrend]) -> Iterator[str]:
    """Yield why numbers of the table are marked: one line for each reason, with its tires."""
    reasons: dict[tuple[str, str], list[str]] = {}
    for trend in tires:
        for quantity in _SHORT:
            number = number_of(trend.numbers, quantity)
            if number.status is Status.PROVISIONAL and number.reasons:
                why = clean(text(number.reasons[0]))
                reasons.setdefault((LABELS[quantity], why), []).append(tire_name(trend))
    if reasons:
        yield ""
        yield f"marked {STATUS_MARKS[Status.PROVISIONAL]}:"
    for (label, why), names in list(reasons.items())[:_LISTED]:
        yield f"  {tires_text(names, len(tires))}, {label}: {why}"
    if len(reasons) > _LISTED:
        yield f"  ... and {len(reasons) - _LISTED} more reasons: --json or --csv"


def tires_text(names: Sequence[str], every: int) -> str:
    """Return the tires that a reason is about: all, or the first ones by name."""
    if len(names) == every and every > 1:
        return "all tires"
    more = len(names) - _NAMED_TIRES
    return ", ".join(names[:_NAMED_TIRES]) + (f" and {counted(more, 'other')}" if more > 0 else "")


def _pair_lines(pairs: Sequence[PairTrend]) -> Iterator[str]:
    valid = [(pair, n) for pair in pairs for n in pair.numbers if n.status is not Status.INVALID]
    if valid:
        yield ""
        yield "asymmetry:"
    for pair, number in valid[:_LISTED]:
        wheels = f"{clean(pair.vehicle)} {pair.left} {pair.right}"
        yield f"  {wheels}: {LABELS[number.quantity]} {shown(number)} {number.unit}"


def _outlier_lines(trends: FleetTrends) -> Iterator[str]:
    recordings = dict.fromkeys((outlier.recording, outlier.path) for outlier in trends.outliers)
    yield ""
    yield f"outliers: {len(recordings)} of {trends.recordings} recordings" if recordings else "no outlier"
    for name, path in list(recordings)[:_LISTED]:
        mine = [outlier for outlier in trends.outliers if outlier.path == path]
        what = "; ".join(f"{label_of(outlier.name)} {outlier.deviation:+.1f}" for outlier in mine)
        yield f"  {clean(name)}: {what} standard deviations from its trend"
    if len(recordings) > _LISTED:
        yield f"  ... and {len(recordings) - _LISTED} more"


def _number_json(number: TrendNumber) -> dict[str, Any]:
    return record(number, without=("low", "high"), low_95=number.low, high_95=number.high)


def _cells(number: TrendNumber) -> list[Any]:
    return [
        str(number.quantity), finite_or_none(number.value), finite_or_none(number.std), number.unit,
        finite_or_none(number.low), finite_or_none(number.high), str(number.status), number.count, number.freedom,
        " ".join(str(reason.code) for reason in number.reasons), joined(number.reasons),
    ]  # fmt: skip


def findings_text(findings: Sequence[Reason]) -> str:
    """Return findings as one text."""
    return clean(joined(findings))


def plain_number(value: float, unit: str) -> str:
    """Return a value with six significant digits at most."""
    if not math.isfinite(value):
        return MISSING
    size = abs(value)
    decimals = 0 if size >= 1000 else 1 if size >= 100 else 2 if size >= 1 else 4
    return f"{fixed(value, decimals)} {unit}".rstrip()


def value_texts(outlier: TrendOutlier) -> tuple[str, str]:
    """Return value and expected value of an outlier; those of a logarithm as a ratio."""
    if outlier.name in SERIES and SERIES[outlier.name].watch.is_logarithm:
        return f"{math.exp((outlier.value - outlier.expected) / 100.0):.3g} times", "1"
    return plain_number(outlier.value, outlier.unit), plain_number(outlier.expected, outlier.unit)


def _utc(time_ns: int) -> str:
    return f"{np.datetime_as_string(np.datetime64(time_ns, 'ns'), unit='s')}Z"
