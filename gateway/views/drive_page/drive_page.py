"""A drive as one self-contained HTML page."""

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

from gateway import __version__
from gateway.estimators.estimator import Status
from gateway.table_columns import RECORDING_PARTS
from gateway.views.drive_page.drive import Drive, DriveWheel
from gateway.views.drive_page.drive_figures import Line, begin_ns, drawn_quantities, lines_of, quantity_figure
from gateway.views.html_template import html_template, report_css
from gateway.views.numbers import MISSING, STATUS_MARKS, duration, round_to_error, split_name
from gateway.views.output_file import check_target, write_whole
from gateway.views.readout import DISTANCE
from gateway.views.report.figures import inline_svg, report_style, require_report_packages
from gateway.views.session_summary import alarm_line
from gateway.views.tables.result_table import iso_utc
from gateway.views.tables.table_sinks import Cell
from gateway.views.tables.wheel_glance import GLANCE, number
from gateway.views.text import clean, counted
from gateway.views.wording import notice_text

_TEMPLATE: Final = ("gateway.views.drive_page", "drive_page.html.j2")
# Times before it are no dates: the clock of a hub counts from its start.
_FIRST_DATE_NS: Final = 10**17


class _Value(NamedTuple):
    """A cell of the table of means: text, second line, and whether it is to be used with care."""

    text: str
    small: str
    is_doubtful: bool


class _Section(NamedTuple):
    """What the page shows of one recording; the template escapes all text except drawings."""

    id: str
    title: str
    facts: str
    run: list[str]
    wheels: list[str]
    glance: list[tuple[str, list[str]]]
    means: list[tuple[str, str, list[_Value]]]
    notes: list[tuple[str, str, str]]
    messages: list[str]
    drawings: list[tuple[Any, str]]
    drawn: str


def check_page(path: Path, *, force: bool = False) -> None:
    """Fail before the work if a page cannot be made.

    Raises:
        OutputError: matplotlib or jinja2 is missing, the file exists and `force` is not set, or it cannot be written.
    """
    require_report_packages()
    check_target(path, force=force)


def write_drive_page(drives: Sequence[Drive], path: Path, *, force: bool = False) -> None:
    """Write recordings as one HTML file, whole or not at all.

    Raises:
        OutputError: as `check_page`.
    """
    write_whole(path, drive_page(drives), force=force)


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


def _section(identity: str, drive: Drive) -> _Section:
    wheels = list(drive.wheels)
    rows = {position: wheel.row.cells(wheel.state, ()) for position, wheel in drive.wheels.items()}
    means, notes = _means(drive)
    return _Section(
        id=identity,
        title=drive.name,
        facts=_facts(drive),
        run=[clean(line) for line in drive.run],
        wheels=wheels,
        glance=[
            (label, [text(rows[position]) for position in wheels])
            for label, text in GLANCE
            if any(text(row) != MISSING for row in rows.values())
        ],
        means=means,
        notes=notes,
        messages=[
            *(clean(notice_text(notice)) for notice in drive.notices),
            *(clean(alarm_line(alarm).strip()) for alarm in drive.alarms),
        ],
        drawings=list(_drawings(identity, drive)),
        drawn=_drawn(drive.wheels.values()),
    )


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
        for name, values in wheel.row.quantities():
            if name == DISTANCE:
                continue
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
