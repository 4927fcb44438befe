"""Doubts that recordings state about themselves: provisional values, alarms, rejected revolutions, damage."""

from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from gateway.core.reasons import Reason
from gateway.core.types import FloatArray
from gateway.fleet.reasons import FleetCode
from gateway.fleet.trends.tire_history import TireHistory

# Share of provisional values from which what is made of them is provisional, and weight of one below it.
_CONSIDERABLE: Final = 0.2
_PROVISIONAL_WEIGHT: Final = 0.25
_LEAST_VALID_SHARE: Final = 0.5


def weights_by_doubt(doubts: Sequence[str]) -> FloatArray:
    """Return (n,) factors of the weights of values: provisional ones count as those of twice the error."""
    return np.where([bool(doubt) for doubt in doubts], _PROVISIONAL_WEIGHT, 1.0)


def doubt_of(doubts: Sequence[str]) -> Reason | None:
    """Return why what is made of values is provisional, with the commonest reason; None where it is not.

    Args:
        doubts: (n,) why each value is provisional; empty where it is valid.
    """
    counts = Counter(doubt for doubt in doubts if doubt)
    if not counts or counts.total() < _CONSIDERABLE * len(doubts):
        return None
    commonest = counts.most_common(1)[0][0]
    return Reason(FleetCode.TREND_PROVISIONAL, count=counts.total(), of=len(doubts), why=commonest)


def findings_of_recordings(history: TireHistory) -> Iterator[Reason]:
    """Yield a finding for each alarm by its name, for rejected revolutions, and for damaged files."""
    total = len(history.recordings)
    counts: Counter[str] = Counter()
    last: dict[str, str] = {}
    for alarms in history.alarms:
        counts.update({name for name, _ in alarms})
        last |= dict(alarms)
    for name, count in counts.most_common():
        first = next(index for index, alarms in enumerate(history.alarms) if name in dict(alarms))
        since = 1e-9 * float(history.time_ns[first])
        yield Reason(FleetCode.TREND_ALARMS, name=name, count=count, of=total, why=last[name], since_s=since)
    revolutions, valid = history.column("revolutions"), history.column("revolutions_valid")
    few_valid = np.flatnonzero((revolutions > 0.0) & (valid < _LEAST_VALID_SHARE * revolutions))
    if few_valid.size and history.faults:
        faults: dict[str, int] = defaultdict(int)
        for index in few_valid:
            faults[history.faults[index]] += 1
        commonest, since = max(faults, key=lambda fault: faults[fault]), 1e-9 * float(history.time_ns[few_valid[0]])
        yield Reason(FleetCode.TREND_FEW_VALID, count=int(few_valid.size), of=total, why=commonest, since_s=since)
    damaged = np.flatnonzero(history.column("damaged") > 0.0)
    if damaged.size:
        since = 1e-9 * float(history.time_ns[damaged[0]])
        yield Reason(FleetCode.TREND_DAMAGED, count=int(damaged.size), of=total, since_s=since)
