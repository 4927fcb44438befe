"""Trends as rows: for scripts as JSON and CSV, and for the report."""

import io
import math
from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from gateway import __version__
from gateway.core.estimates.estimator import Status
from gateway.core.quantity import Trend
from gateway.core.quantity_catalogue import declared
from gateway.core.reasons import Reason
from gateway.core.shown_units import conversion, shown_units
from gateway.core.storable_text import storable
from gateway.core.text.numbers import MISSING, STATUS_MARKS, Unit, finite_or_none, fixed, round_to_error, split_name
from gateway.core.text.plain_values import plain, record
from gateway.core.text.table_sinks import CsvSink
from gateway.core.text.text import clean, counted
from gateway.core.text.wording import joined
from gateway.fleet.trends.trend_result import (
    UNKNOWN_VEHICLE,
    FleetTrends,
    Quantity,
    TireTrend,
    TrendNumber,
    TrendOutlier,
    asymmetry_of,
    by_temperature,
    rate_of,
)
from gateway.fleet.trends.watched_series import SERIES, followed_by

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
        name(quantity.watch): f"{quantity.label} with {variable}"
        for quantity in followed_by(Trend.STIFFNESS)
        for name, variable in ((rate_of, "age"), (by_temperature, "temperature"))
    },
    **{rate_of(quantity.watch): quantity.label.removeprefix("ln ") for quantity in followed_by(Trend.SENSOR)},
    **{
        asymmetry_of(quantity): f"{split_name(quantity.name)[0]}, left less right"
        for quantity in declared()
        if quantity.compared
    },
}
"""Label of each number of a trend."""
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
    mark, unit = STATUS_MARKS[number.status], shown_unit(number.unit)
    return f"{round_to_error(unit.of(number.value), number.std * unit.factor).joined()}{' ' + mark if mark else ''}"


def shown_unit(symbol: str) -> Unit:
    """Return how numbers in a unit of trends are shown now: kPa/month as psi/month."""
    return Unit(*conversion(symbol, shown_units()))


def number_of(numbers: Sequence[TrendNumber], quantity: str) -> TrendNumber:
    """Return a number of a tire; one without a value when the tire has none."""
    return next((number for number in numbers if number.quantity == quantity), TrendNumber(quantity))


def unit_in(tires: Sequence[TireTrend], quantity: str) -> str:
    """Return the unit in which a quantity is shown."""
    return shown_unit(next((n.unit for tire in tires for n in tire.numbers if n.quantity == quantity), "")).symbol


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


def tires_text(names: Sequence[str], every: int) -> str:
    """Return the tires that a reason is about: all, or the first ones by name."""
    if len(names) == every and every > 1:
        return "all tires"
    more = len(names) - _NAMED_TIRES
    return ", ".join(names[:_NAMED_TIRES]) + (f" and {counted(more, 'other')}" if more > 0 else "")


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
    """Return a value with six significant digits at most, in the unit that is shown."""
    if not math.isfinite(value):
        return MISSING
    display_unit = shown_unit(unit)
    value, unit = display_unit.of(value), display_unit.symbol
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
