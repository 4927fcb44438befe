"""Trends of a dataset for a terminal."""

from collections.abc import Iterator, Sequence
from typing import Final

from gateway.core.estimates.estimator import Status
from gateway.core.shown_units import shown_in
from gateway.core.text.aligned_table import table_lines
from gateway.core.text.numbers import MISSING, STATUS_MARKS
from gateway.core.text.text import clean, counted
from gateway.core.text.wording import text
from gateway.fleet.trends.trend_result import FleetTrends, PairTrend, Quantity, TireTrend
from gateway.fleet.trends.watched_series import label_of
from gateway.fleet.views.finding_rows import finding_rows
from gateway.fleet.views.trend_tables import (
    LABELS,
    day,
    number_of,
    shown,
    shown_unit,
    tire_name,
    tires_text,
    unit_in,
    vehicles_of,
)

_SHORT: Final = (Quantity.WEAR_RATE, Quantity.PRESSURE_LOSS, Quantity.LOAD, "Bs_rate", "noise_rate")
_LISTED: Final = 40


def trend_lines(trends: FleetTrends, columns: int) -> list[str]:
    """Return the summary for a terminal of some columns."""
    with shown_in(trends.units):
        return list(_lines(trends, columns))


def _lines(trends: FleetTrends, columns: int) -> Iterator[str]:
    first = min(trend.first_ns for trend in trends.tires)
    last = max(trend.last_ns for trend in trends.tires)
    tires, recordings = counted(len(trends.tires), "tire"), counted(trends.recordings, "recording")
    yield f"{tires} of {vehicles_of(trends)}, {recordings}, {day(first)} to {day(last)} (UTC)"
    yield from (clean(text(note)) for note in trends.notes)
    findings = finding_rows(trends.tires)
    yield ""
    yield "findings:" if findings else "no finding"
    for row in findings[:_LISTED]:
        yield f"  {row.key}  {row.tire}: {row.said}"
        yield f"          since when: {row.since}"
        yield f"          how sure:   {row.sure}"
        if row.step:
            yield f"          what to do: {row.step}"
    if len(findings) > _LISTED:
        yield f"  ... and {len(findings) - _LISTED} more"
    yield ""
    rows = [["tire", *(f"{LABELS[name]}, {unit_in(trends.tires, name)}" for name in _SHORT)]]
    rows += [
        [tire_name(trend), *(shown(number_of(trend.numbers, name)) for name in _SHORT)]
        for trend in trends.tires[:_LISTED]
    ]
    yield from table_lines(rows, columns)
    if len(trends.tires) > _LISTED:
        yield f"... and {len(trends.tires) - _LISTED} more tires: --json, --csv or --html"
    yield from _mark_lines(trends.tires[:_LISTED])
    yield from _pair_lines(trends.pairs)
    yield from _outlier_lines(trends)


def _outlier_lines(trends: FleetTrends) -> Iterator[str]:
    recordings = dict.fromkeys((outlier.recording, outlier.path) for outlier in trends.outliers)
    yield ""
    yield f"outliers: {len(recordings)} of {trends.recordings} recordings" if recordings else "no outlier"
    for name, path in list(recordings)[:_LISTED]:
        deviations = "; ".join(
            f"{tire_name(outlier)} {label_of(outlier.name)} {outlier.deviation:+.1f}"
            for outlier in trends.outliers
            if outlier.path == path
        )
        yield f"  {clean(name)}: {deviations} standard deviations from its trend"
    if len(recordings) > _LISTED:
        yield f"  ... and {len(recordings) - _LISTED} more"


def _mark_lines(tires: Sequence[TireTrend]) -> Iterator[str]:
    """Yield why numbers of the table are marked or missing: one line for each reason, with its tires."""
    reasons: dict[tuple[str, str, str], list[str]] = {}
    for trend in tires:
        for quantity in _SHORT:
            number = number_of(trend.numbers, quantity)
            if number.status is not Status.VALID and number.reasons:
                reason = clean(text(number.reasons[0]))
                mark = STATUS_MARKS[number.status] if number.status is Status.PROVISIONAL else MISSING
                reasons.setdefault((mark, LABELS[quantity], reason), []).append(tire_name(trend))
    if reasons:
        yield ""
        yield f"marked {STATUS_MARKS[Status.PROVISIONAL]}, or {MISSING} for not determined:"
    for (mark, label, reason), names in list(reasons.items())[:_LISTED]:
        yield f"  {mark} {tires_text(names, len(tires))}, {label}: {reason}"
    if len(reasons) > _LISTED:
        yield f"  ... and {len(reasons) - _LISTED} more reasons: --json or --csv"


def _pair_lines(pairs: Sequence[PairTrend]) -> Iterator[str]:
    valid = [(pair, n) for pair in pairs for n in pair.numbers if n.status is not Status.INVALID]
    if valid:
        yield ""
        yield "asymmetry:"
    for pair, number in valid[:_LISTED]:
        wheels = f"{clean(pair.vehicle)} {pair.left} {pair.right}"
        yield f"  {wheels}: {LABELS[number.quantity]} {shown(number)} {shown_unit(number.unit).symbol}"
