"""A drive as one self-contained HTML page."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from gateway import __version__
from gateway.compare.views.drive import Drive, Drives, DriveWheel
from gateway.core.estimates.estimator import Status
from gateway.core.table_columns import RECORDING_PARTS
from gateway.core.text.html_template import html_template, report_css
from gateway.core.text.numbers import MISSING, STATUS_MARKS, duration, round_to_error, split_name
from gateway.core.text.output_file import check_target, write_whole
from gateway.core.text.readout import DISTANCE
from gateway.core.text.result_table import iso_utc
from gateway.core.text.session_summary import alarm_line
from gateway.core.text.table_sinks import Cell
from gateway.core.text.text import clean, counted
from gateway.core.text.wheel_glance import GLANCE, number
from gateway.core.text.wording import joined, notice_text
from gateway.core.types import BoolArray, FloatArray
from gateway.diagnosis.views.figures import (
    AFTER,
    BEFORE,
    GOOD,
    INK,
    drawable,
    inline_svg,
    new_figure,
    report_style,
    require_report_packages,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_TEMPLATE: Final = ("gateway.compare.views", "drive_page.html.j2")
# Times before it are no dates: the clock of a hub counts from its start.
_FIRST_DATE_NS: Final = 10**17
_SIZE_INCH: Final = (5.0, 2.7)
# Colour and dashes by wheel: they differ in print and to colour-blind readers too.
_STYLES: Final = ((AFTER, "-"), (BEFORE, "--"), (GOOD, "-."), (INK, ":"))
_MINUTES_FROM_S: Final = 300.0


class Line(NamedTuple):
    """A quantity of one wheel over time.

    Attributes:
        position: wheel.
        style: index of its colour and dashes.
        time_s: (n,) since the first revolution of any wheel.
        value: (n,) NaN where it is invalid, and within a time without revolutions.
        std: (n,) NaN where it is not known.
        is_valid: (n,) False where it is provisional or invalid.
    """

    position: str
    style: int
    time_s: FloatArray
    value: FloatArray
    std: FloatArray
    is_valid: BoolArray


def begin_ns(drive: Drive) -> int:
    """Return the end of the first revolution of any wheel, ns; 0 without one."""
    return min((wheel.points[0].time_ns for wheel in drive.wheels.values()), default=0)


def drawn_quantities(drive: Drive) -> list[str]:
    """Return the quantities that have a value, without the distance, which only grows."""
    names = {
        name: None for wheel in drive.wheels.values() for point in wheel.points for name in point.values
    }  # a dict keeps their order
    return [name for name in names if name != DISTANCE]


def lines_of(drive: Drive, name: str, start_ns: int) -> list[Line]:
    """Return the lines of a quantity, in the unit that it is shown in."""
    factor, absent = split_name(name)[1].factor, (np.nan, np.nan, False)
    lines = []
    for style, (position, wheel) in enumerate(drive.wheels.items()):
        if not any(name in point.values for point in wheel.points):
            continue
        rows: list[tuple[int, tuple[float, float, bool]]] = []
        for point in wheel.points:
            if point.is_after_gap:
                rows.append(((rows[-1][0] + point.time_ns) // 2, absent))
            rows.append((point.time_ns, point.values.get(name, absent)))
        value, std, is_valid = np.array([values for _, values in rows], np.float64).T
        time_s = np.array([time_ns - start_ns for time_ns, _ in rows], np.float64) * 1e-9
        lines.append(Line(position, style, time_s, factor * value, factor * std, is_valid > 0.0))
    return lines


def quantity_figure(name: str, lines: list[Line]) -> Figure:
    """Draw a quantity: lines where it is valid, hollow points where it is provisional, gaps where it is invalid."""
    label, unit = split_name(name)
    figure = new_figure(*_SIZE_INCH)
    panel = figure.subplots()
    in_minutes = max(line.time_s[-1] for line in lines) > _MINUTES_FROM_S
    for line in lines:
        colour, dashes = _STYLES[line.style % len(_STYLES)]
        time = line.time_s / 60.0 if in_minutes else line.time_s
        valid = np.where(line.is_valid, line.value, np.nan)
        doubtful = ~line.is_valid & np.isfinite(line.value)
        panel.fill_between(time, line.value - line.std, line.value + line.std, color=colour, alpha=0.14, lw=0)
        panel.plot(time, valid, dashes, color=colour, lw=1.3, label=drawable(line.position))
        panel.plot(time[doubtful], line.value[doubtful], "o", color=colour, mfc="none", ms=2.2, mew=0.5)
    panel.set_title(drawable(f"{label}, {unit.symbol}" if unit.symbol else label))
    panel.set_xlabel("min" if in_minutes else "s")
    panel.ticklabel_format(useOffset=False, axis="y")
    if len(lines) > 1:
        figure.legend(loc="outside lower center", ncols=len(lines), handlelength=2.2, fontsize=9.0)
    return figure


class _Value(NamedTuple):
    """A cell of the table of means: text, second line, and whether it is to be used with care."""

    text: str
    small: str
    is_doubtful: bool


def check_page(path: Path, *, force: bool = False) -> None:
    """Fail before the work if a page cannot be made.

    Raises:
        OutputError: matplotlib or jinja2 is missing, the file exists and `force` is not set, or it cannot be written.
    """
    require_report_packages()
    check_target(path, force=force)


class DrivePages(Drives):
    """Page of all recordings of a command."""

    def __init__(self, path: Path, *, force: bool = False) -> None:
        """Fail before the work if the page cannot be made; errors as for `check_page`."""
        super().__init__()
        check_page(path, force=force)
        self._path, self._force = path, force

    def write(self) -> None:
        """Write the recordings as one HTML file, whole or not at all.

        Raises:
            OutputError: as `check_page`.
        """
        write_whole(self._path, drive_page(self.drives), force=self._force)


def open_pages(path: Path | None, *, force: bool) -> DrivePages | None:
    """Return the page that is asked for, None without a file; errors as for `check_page`."""
    return None if path is None else DrivePages(path, force=force)


def drive_page(drives: Sequence[Drive]) -> str:
    """Return recordings as an HTML page without scripts and external resources; deterministic.

    Raises:
        OutputError: matplotlib or jinja2 is missing.
    """
    require_report_packages()
    with report_style():
        sections = [_section(f"r{index}", drive) for index, drive in enumerate(drives)]
    title = drives[0].name if len(drives) == 1 else counted(len(drives), "recording")
    return html_template(*_TEMPLATE).render(version=__version__, style=report_css(), title=title, sections=sections)


def _section(identity: str, drive: Drive) -> dict[str, object]:
    """Return what the page shows of one recording; the template escapes all text except drawings."""
    wheels = list(drive.wheels)
    rows = {position: wheel.cells() for position, wheel in drive.wheels.items()}
    means, notes = _means(drive)
    return {
        "id": identity,
        "title": drive.name,
        "facts": _facts(drive),
        "run": [clean(line) for line in drive.run],
        "wheels": wheels,
        "glance": [
            (label, [text(rows[position]) for position in wheels])
            for label, text in GLANCE
            if any(text(row) != MISSING for row in rows.values())
        ],
        "means": means,
        "notes": notes,
        "messages": [
            *(clean(notice_text(notice)) for notice in drive.notices),
            *(clean(alarm_line(alarm).strip()) for alarm in drive.alarms),
        ],
        "drawings": list(_drawings(identity, drive)),
        "drawn": _drawn(drive.wheels.values()),
    }


def _facts(drive: Drive) -> str:
    parts = [counted(len(drive.wheels), "wheel")]
    if drive.wheels:
        first_ns, last_ns = begin_ns(drive), max(wheel.points[-1].time_ns for wheel in drive.wheels.values())
        if first_ns > _FIRST_DATE_NS:
            parts.append(f"{iso_utc(first_ns)[:19].replace('T', ' ')} UTC")
        parts.append(duration((last_ns - first_ns) * 1e-9))
    return " · ".join(parts)


def _means(drive: Drive) -> tuple[list[tuple[str, str, list[_Value]]], list[tuple[str, str, str]]]:
    """Return rows of quantity, unit and the wheels' means, and notes of wheels, quantities and reason."""
    rows: dict[str, dict[str, _Value]] = {}
    reasons: dict[str, dict[str, list[str]]] = {}
    for position, wheel in drive.wheels.items():
        if wheel.rolled is not None and wheel.rolled.reasons:
            reasons.setdefault(joined(wheel.rolled.reasons), {}).setdefault(position, []).append("distance")
        for name, values in wheel.row.quantities():
            if name == DISTANCE:
                continue  # it only grows
            label, unit = split_name(name)
            cells: dict[str, Cell] = dict(zip(RECORDING_PARTS, values, strict=True))
            status, reason = Status(str(cells["_status"])), str(cells["_reason"])
            value, std, scatter = (number(cells, part) * unit.factor for part in ("", "_std", "_scatter"))
            rows.setdefault(name, {})[position] = _value(value, std, scatter, status)
            if reason:
                reasons.setdefault(reason, {}).setdefault(position, []).append(label)
    absent = _Value(MISSING, "", False)
    table = [
        (*(split_name(name)[0], split_name(name)[1].symbol), [row.get(position, absent) for position in drive.wheels])
        for name, row in rows.items()
    ]
    return table, list(_notes(reasons))


def _value(value: float, std: float, scatter: float, status: Status) -> _Value:
    """Return the mean and the scatter of a quantity."""
    if status is Status.INVALID:
        return _Value(MISSING, "", True)
    size = round_to_error(scatter, scatter)
    small = f"scatter {size.error}{size.power}" if size.error else ""
    text = f"{round_to_error(value, std).joined()} {STATUS_MARKS[status]}".strip()
    return _Value(text, small, status is not Status.VALID)


def _notes(reasons: dict[str, dict[str, list[str]]]) -> Iterator[tuple[str, str, str]]:
    """Yield the wheels and the quantities of each reason."""
    for reason, of_wheels in reasons.items():
        alike: dict[tuple[str, ...], list[str]] = {}
        for position, labels in of_wheels.items():
            alike.setdefault(tuple(labels), []).append(position)
        for shared, wheels in alike.items():
            yield clean(", ".join(wheels)), ", ".join(shared), clean(reason)


def _drawings(identity: str, drive: Drive) -> Iterator[tuple[Any, str]]:
    start_ns = begin_ns(drive)
    for index, name in enumerate(drawn_quantities(drive)):
        lines: list[Line] = lines_of(drive, name, start_ns)
        svg = inline_svg(quantity_figure(name, lines), f"{identity}-{index}")
        yield svg, f"{split_name(name)[0]} over time of {', '.join(line.position for line in lines)}"


def _drawn(wheels: Iterable[DriveWheel]) -> str:
    stride = max((wheel.stride for wheel in wheels), default=1)
    return "" if stride == 1 else f"One of {stride} revolutions is drawn."
