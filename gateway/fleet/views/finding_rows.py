"""Findings of a fleet as they are told: what, since when, how sure, and what to do."""

import math
from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

from gateway.core.quantity import Basis
from gateway.core.reasons import CoreCode, Reason, Value
from gateway.core.text.text import clean
from gateway.core.text.wording import text
from gateway.fleet.reasons import FleetCode
from gateway.fleet.trends.marked_findings import finding_key, size_of
from gateway.fleet.trends.trend_result import TireTrend
from gateway.fleet.trends.watched_series import SERIES
from gateway.fleet.views.trend_tables import day, tire_name, tires_text

# In the order of their urgency.
_STEPS: Final = {
    "inspect belt, tread and rim before the tire is used again": "STRUCTURE_CHANGED",
    "check the pressure today, and look for a leak at valve, bead and tread":
        "PRESSURE_FELL LOSS_CHANGED LOSES_PRESSURE NEWEST_FALL",
    "measure the tread depth, and check wheel alignment and pressure": "WEARS_FAST WEARS_SHORT WEAR_CHANGED",
    "inspect the tire, and check that load and pressure are stated as they are":
        "STIFFNESS_DRIFTS SLOPE_CHANGED PASSED",
    "check that the sensor is fastened; if it is, replace it": "SENSOR_MOVES",
    "record at two speeds: they tell a changed gain of the sensor from a changed zero": "SENSOR_STEADY",
    "check fastening, supply and antenna of the sensor": "SENSOR_LOSSES SENSOR_NOISE",
    "drive slower, or take a sensor of a larger range": "SENSOR_CLIPS",
    "replace the pressure sensor, and measure the pressure by hand until then":
        "PRESSURE_STUCK PRESSURE_CONSTANT TEMPERATURE_IMPOSSIBLE TEMPERATURE_STUCK",
    "look at the last recording: treadlink estimate RECORDING --html drive.html": "ALARMS",
    "remove the cause that the finding names, and record again": "FEW_VALID",
    "copy the recordings again, or repair them: treadlink repair RECORDING": "DAMAGED",
    "record again soon: one recording proves no change": "LAST_DEVIATES",
    "check that the vehicle file says so too": "TIRES_EXCHANGED TIRE_MOVED STATED_CHANGED",
}  # fmt: skip
_STEP_OF: Final = {
    getattr(FleetCode, f"TREND_{name}"): step for step, names in _STEPS.items() for name in names.split()
}


def _step_of(finding: Reason) -> str:
    """Return what to do about a finding, a change of a level by what its series is of; empty where nothing is."""
    series = SERIES.get(str(dict(finding.values).get("name")))
    code = finding.code
    if series is not None and code in (CoreCode.TREND_LEVEL_CHANGED, CoreCode.TREND_CONTACT_CHANGED):
        if series.watch.drift is not None:
            code = series.watch.drift[0]
        elif Basis.PRESSURE in series.watch.explains:
            code = FleetCode.TREND_PRESSURE_FELL
        else:
            code = FleetCode.TREND_WEAR_CHANGED if series.name == "wear_mm" else FleetCode.TREND_SLOPE_CHANGED
    return _STEP_OF.get(code, "")


# Multiples of its error beyond which more say nothing.
_MOST_TIMES: Final = 100.0
_DAY_S: Final = 86_400.0


class FindingRow(NamedTuple):
    """A finding.

    Attributes:
        tire: name.
        said: what was found.
        since: when it began, with the error of the date where it has one.
        sure: how sure it is.
        step: what to do; empty where nothing is.
        key: that marks it.
    """

    tire: str
    said: str
    since: str
    sure: str
    step: str
    key: str


def finding_rows(tires: Sequence[TireTrend]) -> list[FindingRow]:
    """Return each finding, the most urgent first; of those with one key the last, with how many more there are."""
    rows = []
    for tire in tires:
        by_key: dict[str, list[Reason]] = {}
        for finding in tire.findings:
            by_key.setdefault(finding_key(tire, finding), []).append(finding)
        for key, findings in by_key.items():
            last, suffix = findings[-1], f" (and {len(findings) - 1} more)" if len(findings) > 1 else ""
            values, step = dict(last.values), _step_of(last)
            sentence = f"{clean(text(last))}{suffix}"
            rows.append(FindingRow(tire_name(tire), sentence, _since(tire, values), _sure(last, values), step, key))
    urgency = list(_STEPS)
    return sorted(rows, key=lambda row: urgency.index(row.step) if row.step else len(urgency))


def _since(tire: TireTrend, values: Mapping[str, Value]) -> str:
    """Return the day on which a finding began, and its error where that is half a day or more."""
    begin_ns, std_days = (float(str(values.get(name, "nan"))) for name in ("since_s", "since_std_s"))
    begin_ns = round(1e9 * begin_ns) if math.isfinite(begin_ns) else tire.first_ns
    std_days /= _DAY_S
    if std_days >= 0.5:
        return f"{day(begin_ns)} ± {f'{std_days:.0f} days' if std_days >= 1.5 else '1 day'}"
    return f"{day(begin_ns)}, the first recording" if begin_ns <= tire.first_ns else day(begin_ns)


def _sure(finding: Reason, values: Mapping[str, Value]) -> str:
    """Return how far a finding is from chance, or in how many recordings it is."""
    size, std = size_of(finding)
    if std > 0.0:
        times = abs(size) / std
        return f"{f'more than {_MOST_TIMES:.0f}' if times > _MOST_TIMES else f'{times:.0f}'} times its error"
    if "deviations" in values:
        return f"{float(str(values['deviations'])):.1f} standard deviations in {values['count']} recordings in a row"
    if "of" in values:
        return f"in {values['count']} of {values['of']} recordings"
    if "count" in values:
        return f"in {values['count']} recordings"
    return "certain: " + ("by the numbers of the sensors" if "target" in values else "the vehicle file states it")


class TrendStep(NamedTuple):
    """What to do, and for which tires."""

    about: str
    step: str


def trend_steps(tires: Sequence[TireTrend]) -> list[TrendStep]:
    """Return one step for each remedy that the findings of any tire need."""
    names: dict[str, list[str]] = {step: [] for step in _STEPS}
    for tire in tires:
        for step in dict.fromkeys(filter(None, map(_step_of, tire.findings))):
            names[step].append(tire_name(tire))
    return [TrendStep(tires_text(of_step, len(tires)), step) for step, of_step in names.items() if of_step]
