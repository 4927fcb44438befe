"""Causes before consequences: findings that follow from another finding of the same tire are named with it.

A fall of the pressure lengthens the contact and softens the belt, a load does the same, and a sensor whose gain, zero
or place changes reads other numbers of the same tire. Of changes that begin together the cause is the finding; a change
with a refill, which is no finding itself, is none either.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

from gateway.quantity import Basis, Quantity, Trend
from gateway.quantity_catalogue import declared
from gateway.reasons import Reason
from gateway.trends.watched_series import SERIES

# Recordings by which changes of two series may begin apart: scatter moves the place of each.
_TOGETHER: Final = 2
# What a tire follows is declared apart from what an estimate of it rests on, as stated values.
_OF_TIRE: Final = frozenset({Basis.PRESSURE, Basis.LOAD})
_QUANTITIES: Final = {quantity.column: quantity for quantity in declared() if quantity.watch is not None}
# Those of the sensor first: a false reading may look like any change of the tire.
_CAUSES: Final = sorted(
    (series for series in SERIES.values() if series.watch.explains),
    key=lambda series: bool(series.watch.explains & _OF_TIRE),
)


class Finding(NamedTuple):
    """A finding of one series.

    Attributes:
        reason: what is said.
        series: name of the series; empty where it is of none.
        begin: recording from which on it changes; None where it drifts all the time.
    """

    reason: Reason
    series: str = ""
    begin: int | None = None


def with_causes(findings: Sequence[Finding], onsets: Mapping[str, Sequence[int]]) -> list[Reason]:
    """Return the findings without the consequences of others, whose series are named with the cause.

    Args:
        findings: of one tire.
        onsets: recordings at which each series changes notably, also where that is no finding, as a refill.
    """
    consequences: dict[int, list[str]] = {}
    explained: set[int] = set()
    for cause, _, watch in _CAUSES:
        of_cause = [index for index, finding in enumerate(findings) if finding.series == cause]
        begins = [findings[index].begin for index in of_cause]
        drifts = None in begins
        changes = [*onsets.get(cause, ()), *(begin for begin in begins if begin is not None)]
        for index, finding in enumerate(findings):
            quantity = _QUANTITIES.get(finding.series)
            if index in explained or quantity is None or not watch.explains & _bases_of(quantity):
                continue
            begin = finding.begin
            near = begin is not None and any(abs(begin - onset) <= _TOGETHER for onset in changes)
            if near or (begin is None and drifts):
                explained.add(index)
                if of_cause:
                    consequences.setdefault(of_cause[0], []).append(finding.series)
    return [
        Reason(finding.reason.code, **dict(finding.reason.values), consequences=tuple(dict.fromkeys(names)))
        if (names := consequences.get(index))
        else finding.reason
        for index, finding in enumerate(findings)
        if index not in explained
    ]


def _bases_of(quantity: Quantity) -> frozenset[Basis]:
    """Return what changes a series; nothing does of the sensor's, which are causes only."""
    if quantity.watch is None or quantity.watch.trend is Trend.SENSOR:
        return frozenset()
    return (quantity.rests_on | quantity.powers.keys()) - _OF_TIRE | quantity.watch.follows
