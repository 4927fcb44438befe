"""Changes of what the configuration states of a tire: they shift the numbers, and are no change of the tire."""

from collections.abc import Iterable
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np

from gateway.core.quantity import Statement
from gateway.core.reasons import Reason, Value
from gateway.fleet.reasons import FleetCode
from gateway.fleet.trends.tire_history import TireHistory
from gateway.fleet.trends.watched_series import SERIES

# A load that changes more often is stated for each recording, as on a scale; all numbers are then comparable.
_MOST_LOADS: Final = 3
_MOST_NAMED: Final = 3


class StatedChange(NamedTuple):
    """A change of a statement.

    Attributes:
        statement: what is stated.
        recording_index: of the first recording with the new statement.
        before: statement before, as text.
        after: statement from then on.
    """

    statement: Statement
    recording_index: int
    before: str
    after: str


def stated_changes(history: TireHistory) -> list[StatedChange]:
    """Return the changes of all statements, in the order of time; recordings that state nothing are passed over."""
    all_changes: list[StatedChange] = []
    for statement, texts in history.stated.items():
        known_texts = [(index, text) for index, text in enumerate(texts) if text]
        changes = [
            StatedChange(statement, index, before, after)
            for (_, before), (index, after) in pairwise(known_texts)
            if before != after
        ]
        if statement is not Statement.LOAD or len(changes) <= _MOST_LOADS:
            all_changes += changes
    return sorted(all_changes, key=lambda change: change.recording_index)


def places_of(changes: Iterable[StatedChange], name: str) -> list[int]:
    """Return the recordings at which the level of a series changes with what is stated, each once."""
    statements = SERIES[name].watch.shifted_by
    return sorted({change.recording_index for change in changes if change.statement in statements})


def findings_of_changes(history: TireHistory, changes: Iterable[StatedChange]) -> list[Reason]:
    """Return a finding for each change, the first ones of each statement only."""
    by_statement: dict[Statement, list[Reason]] = {}
    for change in changes:
        since = history.since(change.recording_index)
        date = str(np.datetime64(int(history.time_ns[change.recording_index]), "ns").astype("datetime64[D]"))
        reasons = by_statement.setdefault(change.statement, [])
        if len(reasons) < _MOST_NAMED:
            kind = "load" if change.statement is Statement.CALIBRATION else "tire"
            # Only loads and radii are numbers, which are told.
            is_number = change.statement in (Statement.LOAD, Statement.RADIUS)
            values: dict[str, Value] = (
                {"before": float(change.before), "after": float(change.after)} if is_number else {}
            )
            name = str(change.statement)
            reasons.append(
                Reason(FleetCode.TREND_STATED_CHANGED, statement=name, date=date, what=kind, **values, **since)
            )
    return [finding for findings in by_statement.values() for finding in findings]
