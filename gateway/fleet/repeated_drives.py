"""Recordings of one drive: an original and what `compact` or `repair` have made of it count once."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import Any, Final

# Hosts estimate the zero of a hub's clock from arrival times; different drives differ by seconds at least.
_SAME_ZERO_NS: Final = 200_000_000
_SHARED: Final = 0.5
_NS: Final = 1_000_000_000

Row = Mapping[str, Any]


def without_repeats(rows: Sequence[Row]) -> tuple[list[Row], list[tuple[Row, Row]]]:
    """Return the rows of one tire that are of different drives, and pairs of a repeat and what it repeats.

    Two recordings are of one drive where they share more than half of the time of the shorter one, and the hub's clock
    was zero at the same time: a recorder that always begins at the same wrong date repeats its times only. Of several
    the one with the most valid revolutions is kept.
    """
    order = sorted(rows, key=_worth)
    distinct: list[Row] = []
    by_zero: dict[int, list[Row]] = defaultdict(list)
    repeats: list[tuple[Row, Row]] = []
    for row in order:
        second = int(row.get("hub_zero_utc") or 0) // _NS
        near = (other for zero_s in (second - 1, second, second + 1) for other in by_zero.get(zero_s, ()))
        same = next((other for other in near if _is_same_drive(row, other)), None)
        if same is None:
            distinct.append(row)
            by_zero[second].append(row)
        else:
            repeats.append((row, same))
    return distinct, repeats


def _worth(row: Row) -> tuple[int, int, str]:
    """Return what orders recordings of one drive: valid revolutions first, then the shortest path, the original's."""
    path = str(row["path"])
    return -(row.get("revolutions_valid") or 0), len(path), path


def _is_same_drive(row: Row, other: Row) -> bool:
    names = ("begin_utc", "end_utc", "hub_zero_utc")
    if any(drive.get(name) is None for drive in (row, other) for name in names):
        return False
    shared = min(row["end_utc"], other["end_utc"]) - max(row["begin_utc"], other["begin_utc"])
    shorter = min(row["end_utc"] - row["begin_utc"], other["end_utc"] - other["begin_utc"])
    return bool(shared > _SHARED * shorter and abs(row["hub_zero_utc"] - other["hub_zero_utc"]) <= _SAME_ZERO_NS)
