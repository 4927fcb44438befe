"""Causes before consequences: findings that follow from another finding of the same tire are named with it.

A fall of the pressure lengthens the contact and softens the belt, a load does the same, and a sensor whose gain, zero
or place changes reads other numbers of the same tire. Of changes that begin together the cause is the finding; a change
with a refill, which is no finding itself, is none either. A cause explains no more than physics lets follow from its
size: of a refill of 5 % no belt gets stiffer by half.
"""

from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

from gateway.core.quantity import Basis, Quantity, Trend
from gateway.core.quantity_catalogue import declared
from gateway.core.reasons import Reason
from gateway.fleet.trends.watched_series import SERIES

# What a tire follows is declared apart from what an estimate of it rests on, as stated values.
_OF_TIRE: Final = frozenset({Basis.PRESSURE, Basis.LOAD})
_QUANTITIES: Final = {quantity.column: quantity for quantity in declared() if quantity.watch is not None}
# Those of the sensor first: a false reading may look like any change of the tire. What may follow from another cause is
# the last.
_CAUSES: Final = sorted(
    (series for series in SERIES.values() if series.watch.explains),
    key=lambda series: (bool(series.watch.explains & _OF_TIRE), bool(series.watch.explains & series.watch.follows)),
)
# At a steady load the area of the contact is inverse to the pressure, and the belt's tension goes with it: a tire's
# number follows pressure and load by their first powers at most, beside those by which it is scaled.
_FOLLOWED_POWER: Final = 1.0
# Errors of a change that may be chance.
_CHANCE: Final = 2.0


class Change(NamedTuple):
    """A change of a series.

    Attributes:
        begin: recording from which on it changes; None where it drifts all the time.
        log_ratio: logarithm of the values after it over those before; None where they are not above zero, or unknown.
        std: error of `log_ratio`.
        grows: whether it grows from `begin` on, as by a leak: what follows from it shows later.
        apart: recordings by which scatter may have moved `begin`.
    """

    begin: int | None
    log_ratio: float | None = None
    std: float = 0.0
    grows: bool = False
    apart: int = 2


class Finding(NamedTuple):
    """A finding of one series.

    Attributes:
        reason: what is said.
        series: name of the series; empty where it is of none.
        change: what is found; none where it is of no series.
    """

    reason: Reason
    series: str = ""
    change: Change = Change(None)


def with_causes(findings: Sequence[Finding], onsets: Mapping[str, Sequence[Change]]) -> list[Reason]:
    """Return the findings without the consequences of others, whose series are named with the cause.

    Args:
        findings: of one tire.
        onsets: notable changes of each series, also those that are no finding, as a refill.
    """
    consequences: dict[int, list[str]] = {}
    explained: set[int] = set()
    for cause, _, watch in _CAUSES:
        of_cause = [index for index, finding in enumerate(findings) if finding.series == cause]
        # Those that follow from another cause are not named, so nothing can be named with them.
        named = [index for index in of_cause if index not in explained]
        if of_cause and not named:
            continue
        for index, finding in enumerate(findings):
            quantity = _QUANTITIES.get(finding.series)
            if (
                index in explained
                or quantity is None
                or finding.series == cause
                or not watch.explains & _bases_of(quantity)
            ):
                continue
            causes = [
                number
                for number in named
                if _follows(finding.change, findings[number].change, quantity, watch.explains)
            ]
            if causes or any(
                _follows(finding.change, change, quantity, watch.explains) for change in onsets.get(cause, ())
            ):
                explained.add(index)
                if named:
                    consequences.setdefault((causes or named)[0], []).append(finding.series)
    return [
        Reason(finding.reason.code, **dict(finding.reason.values), consequences=tuple(dict.fromkeys(names)))
        if (names := consequences.get(index))
        else finding.reason
        for index, finding in enumerate(findings)
        if index not in explained
    ]


def _follows(effect: Change, cause: Change, quantity: Quantity, explains: frozenset[Basis]) -> bool:
    """Return whether a change begins with another, and is no larger than what follows from it."""
    if effect.begin is None and cause.begin is not None:
        return False
    # What drifts all the time may bend what follows it at any place.
    if effect.begin is not None and cause.begin is not None:
        delay = effect.begin - cause.begin
        tolerance = max(effect.apart, cause.apart)
        if delay < -tolerance or (delay > tolerance and not cause.grows):
            return False
    # Through the sensor's gain, zero or place any other number may be read.
    if effect.log_ratio is None or cause.log_ratio is None or not explains <= _OF_TIRE:
        return True
    power = _FOLLOWED_POWER + max(abs(quantity.powers.get(basis, 0.0)) for basis in explains)
    largest = abs(cause.log_ratio) + _CHANCE * cause.std
    return abs(effect.log_ratio) - _CHANCE * effect.std <= power * largest


def _bases_of(quantity: Quantity) -> frozenset[Basis]:
    """Return what changes a series; nothing does of the sensor's, which are causes only."""
    if quantity.watch is None or quantity.watch.trend is Trend.SENSOR:
        return frozenset()
    return (quantity.rests_on | quantity.powers.keys()) - _OF_TIRE | quantity.watch.follows
