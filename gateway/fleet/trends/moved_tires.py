"""Tires that change wheels: a sensor that was at one wheel of a vehicle and then at another."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from gateway.core.reasons import Reason
from gateway.fleet.reasons import FleetCode
from gateway.fleet.trends.tire_history import TireHistory


class _Move(NamedTuple):
    """A sensor's change of wheels, after one recording and before or at the next; times in ns since the epoch."""

    vehicle: str
    sensor_id: str
    origin: str
    target: str
    after_ns: int
    until_ns: int

    def exchanges_with(self, other: _Move) -> bool:
        """Return whether another sensor went the other way at the same time."""
        return (
            (self.vehicle, self.origin, self.target) == (other.vehicle, other.target, other.origin)
            and max(self.after_ns, other.after_ns) < min(self.until_ns, other.until_ns)
            and self.sensor_id != other.sensor_id
        )


def findings_of_moves(histories: Sequence[TireHistory]) -> dict[tuple[str, str, str], tuple[Reason, ...]]:
    """Return the finding of each change of wheels, by vehicle, new wheel and sensor; an exchange is one finding."""
    moves = sorted(_moves(histories), key=lambda move: (move.until_ns, move.target, move.sensor_id))
    findings: dict[tuple[str, str, str], tuple[Reason, ...]] = defaultdict(tuple)
    reported: set[_Move] = set()
    for move in moves:
        if move in reported:
            continue
        reported.add(move)
        partner = next((second for second in moves if second not in reported and move.exchanges_with(second)), None)
        date = str(np.datetime64(move.until_ns, "ns").astype("datetime64[D]"))
        gap_s = 1e-9 * (move.until_ns - move.after_ns)
        since = {"since_s": 1e-9 * move.until_ns - 0.5 * gap_s, "since_std_s": gap_s / math.sqrt(12.0)}
        if partner is None:
            finding = Reason(FleetCode.TREND_TIRE_MOVED, origin=move.origin, target=move.target, date=date, **since)
        else:
            reported.add(partner)
            finding = Reason(
                FleetCode.TREND_TIRES_EXCHANGED,
                origin=move.origin,
                target=move.target,
                date=date,
                sensor=move.sensor_id,
                other=partner.sensor_id,
                **since,
            )
        findings[move.vehicle, move.target, move.sensor_id] += (finding,)
    return dict(findings)


def _moves(histories: Sequence[TireHistory]) -> Iterator[_Move]:
    recordings: dict[tuple[str, str], list[tuple[int, str]]] = defaultdict(list)
    for history in histories:
        if history.sensor_id and history.is_identified:
            times = ((int(time_ns), history.position) for time_ns in history.time_ns)
            recordings[history.vehicle, history.sensor_id] += times
    for (vehicle, sensor_id), observations in recordings.items():
        observations.sort()
        for (after_ns, origin), (until_ns, target) in pairwise(observations):
            if origin != target:
                yield _Move(vehicle, sensor_id, origin, target, after_ns, until_ns)
