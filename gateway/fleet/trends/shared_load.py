"""A load that changes at several wheels of a vehicle at one time is one finding, reported at the first of them."""

import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from gateway.core.reasons import CoreCode, Reason
from gateway.fleet.trends.trend_result import TireTrend

_LOAD: Final = "estimated_load_n"
_SAME_DATE_STDS: Final = 3.5
# Between two recordings, by which a date without an error may be off.
_LEAST_STD_S: Final = 86_400.0


def with_one_load(tires: Sequence[TireTrend]) -> tuple[TireTrend, ...]:
    """Return tires where a change of load at several wheels, at one time and to one side, is reported once."""
    findings = [list(tire.findings) for tire in tires]
    vehicles: dict[str, list[tuple[int, Reason]]] = defaultdict(list)
    for index, tire in enumerate(tires):
        vehicles[tire.vehicle] += [(index, finding) for finding in tire.findings if _is_load(finding)]
    for changes in vehicles.values():
        while changes:
            first_index, first = changes.pop(0)
            repeats = [
                (index, finding)
                for index, finding in changes
                if tires[index].position != tires[first_index].position and _is_same(first, finding)
            ]
            if not repeats:
                continue
            also_at = ", ".join(dict.fromkeys(tires[index].position for index, _ in repeats))
            of_first = findings[first_index]
            of_first[of_first.index(first)] = Reason(first.code, **dict(first.values), also_at=also_at)
            for index, finding in repeats:
                findings[index].remove(finding)
                changes.remove((index, finding))
    return tuple(replace(tire, findings=tuple(of_tire)) for tire, of_tire in zip(tires, findings, strict=True))


def _is_load(finding: Reason) -> bool:
    values = dict(finding.values)
    # Of what lengthens a contact at one time, several wheels share the load, or a pressure that none measures.
    is_load = values.get("name") == _LOAD or finding.code is CoreCode.TREND_CONTACT_CHANGED
    return is_load and {"since_s", "change"} <= values.keys()


def _is_same(first: Reason, second: Reason) -> bool:
    """Return whether changes of one series are to one side, and at one time within the errors of their dates."""
    (first_s, first_std_s, first_change), (second_s, second_std_s, second_change) = (
        [float(str(dict(finding.values).get(name, 0.0))) for name in ("since_s", "since_std_s", "change")]
        for finding in (first, second)
    )
    limit_s = _SAME_DATE_STDS * max(math.hypot(first_std_s, second_std_s), _LEAST_STD_S)
    is_at_one_time = abs(first_s - second_s) <= limit_s
    return first["name"] == second["name"] and first_change * second_change > 0.0 and is_at_one_time
