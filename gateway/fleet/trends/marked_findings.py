"""What operators say of findings: acknowledged, put off or closed, until new evidence brings them back.

A finding is known by its tire, code and series. The size that it has when it is marked is kept with its error: one that
has grown beyond both is new evidence.
"""

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from enum import StrEnum
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from gateway.core.errors import ConfigError
from gateway.core.reasons import Reason
from gateway.core.text.output_file import write_whole
from gateway.fleet.reasons import FleetCode
from gateway.fleet.trends.trend_result import FleetTrends, TireTrend
from gateway.fleet.trends.watched_series import SERIES

FILE: Final = "marked-findings.json"
"""File of the dataset's folder."""

_FORMAT: Final = "treadlink marked findings"
# Errors of both sizes by which a finding must have grown.
_GROWN: Final = 3.5
_MIN_RATIO: Final = 1e-6
# Values of findings that are their size, with their errors; a count has none.
_SIZES: Final[Mapping[str, str]] = {
    "after_pa": "after_std_pa",
    "after_m": "after_std_m",
    "loss_pa": "std_pa",
    "fall_pa": "std_pa",
    "wear_m": "std_m",
    "rate_m": "std_m",
    "change": "std",
    "share": "std",
    "factor": "std",
    "change_m": "std",
    "change_mps2": "std",
    "count": "",
}


class MarkState(StrEnum):
    """What is said of a finding."""

    ACKNOWLEDGED = "acknowledged"
    CLOSED = "closed"
    PUT_OFF = "put-off"


class FindingMark(NamedTuple):
    """A mark.

    Attributes:
        state: of the finding.
        size: that it had, in the unit of its value; NaN where it has none.
        std: its error.
        until: day before which recordings do not bring one back that is put off, YYYY-MM-DD; else empty.
    """

    state: MarkState
    size: float
    std: float
    until: str = ""


def finding_key(tire: TireTrend, finding: Reason) -> str:
    """Return the short name of a finding, which stays the same while it lasts."""
    values = dict(finding.values)
    parts = (
        tire.vehicle,
        tire.position,
        tire.sensor_id,
        str(tire.part),
        finding.code.name,
        str(values.get("name", values.get("statement", ""))),
    )
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()[:6]


def read_marks(dataset: Path) -> dict[str, FindingMark]:
    """Return the marks of a dataset by the keys of findings.

    Raises:
        ConfigError: the file cannot be read, or is none of marks.
    """
    path = dataset / FILE
    try:
        document = json.loads(path.read_text("utf-8"))
        if document["format"] != _FORMAT:
            raise ValueError(document["format"])
        return {
            str(key): FindingMark(MarkState(mark["state"]), float(mark["size"]), float(mark["std"]), str(mark["until"]))
            for key, mark in document["marks"].items()
        }
    except FileNotFoundError:
        return {}
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise ConfigError(f"{path} cannot be read: {error}", "Correct or remove it.") from error


def set_marks(dataset: Path, trends: FleetTrends, texts: Sequence[str]) -> dict[str, FindingMark]:
    """Add marks to those of a dataset, write them, and return all.

    Args:
        dataset: its folder.
        trends: with the findings, none of them hidden.
        texts: KEY=acknowledged, KEY=closed, KEY=put-off:YYYY-MM-DD, or KEY=open for none.

    Raises:
        ConfigError: a text is none of these, or no finding has the key.
        OutputError: the file cannot be written.
    """
    marks = read_marks(dataset)
    findings = {finding_key(tire, finding): finding for tire in trends.tires for finding in tire.findings}
    for text in texts:
        key, _, mark_text = text.partition("=")
        state, _, until = mark_text.partition(":")
        if key not in findings:
            raise ConfigError(f"no finding has the key {key!r}", f"Keys: {', '.join(findings) or 'none'}.")
        if state == "open":
            marks.pop(key, None)
            continue
        if state not in set(MarkState) or (state == MarkState.PUT_OFF) != _is_day(until):
            raise ConfigError(
                f"{mark_text!r} is no mark of a finding", "Use acknowledged, closed, put-off:YYYY-MM-DD or open."
            )
        marks[key] = FindingMark(MarkState(state), *size_of(findings[key]), until)
    content = {"format": _FORMAT, "marks": {key: mark._asdict() for key, mark in sorted(marks.items())}}
    write_whole(dataset / FILE, json.dumps(content, indent=1) + "\n", force=True)
    return marks


def without_marked(trends: FleetTrends, marks: Mapping[str, FindingMark]) -> FleetTrends:
    """Return trends without the findings that are marked and show no new evidence; a note says how many."""
    if not marks:
        return trends
    newest = str(np.datetime64(max((tire.last_ns for tire in trends.tires), default=0), "ns").astype("datetime64[D]"))
    hidden = 0
    tires = []
    for tire in trends.tires:
        # Of several findings with one key, the last is marked and stands for all.
        last = {finding_key(tire, finding): finding for finding in tire.findings}
        hidden_keys = {key for key, finding in last.items() if _is_hidden(finding, marks.get(key), newest)}
        visible = tuple(finding for finding in tire.findings if finding_key(tire, finding) not in hidden_keys)
        hidden += len(tire.findings) - len(visible)
        tires.append(replace(tire, findings=visible))
    if not hidden:
        return trends
    note = Reason(FleetCode.TREND_FINDINGS_MARKED, count=hidden, file=FILE)
    return replace(trends, tires=tuple(tires), notes=(*trends.notes, note))


def _is_hidden(finding: Reason, mark: FindingMark | None, newest: str) -> bool:
    if mark is None or (mark.state is MarkState.PUT_OFF and newest >= mark.until):
        return False
    size, std = size_of(finding)
    is_reversed = size * mark.size < 0.0
    # The error of a count is its root.
    variance = std**2 + mark.std**2 if std else abs(size) + abs(mark.size)
    return not (is_reversed or abs(size) - abs(mark.size) > _GROWN * math.sqrt(variance))


def size_of(finding: Reason) -> tuple[float, float]:
    """Return size and error of a finding, of a ratio those of its logarithm; 0 where it has none: it never grows."""
    values = dict(finding.values)
    series = SERIES.get(str(values.get("name")))
    for name, std_name in _SIZES.items():
        if name in values:
            size, std = float(str(values[name])), float(str(values.get(std_name, 0.0)))
            if name == "change" and series is not None and series.watch.is_logarithm:
                ratio = max(1.0 + size / 100.0, _MIN_RATIO)
                return 100.0 * math.log(ratio), std / ratio
            return size, std
    return 0.0, 0.0


def _is_day(text: str) -> bool:
    try:
        return len(text) == 10 and str(np.datetime64(text, "D")) == text
    except ValueError:
        return False
