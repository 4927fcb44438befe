"""A drive as one self-contained HTML page: verdict, pictures, tables."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

from gateway.compare.views.drive import Drive, Drives, DriveWheel
from gateway.compare.views.drive_path_picture import path_picture
from gateway.compare.views.drive_pictures import begin_ns, date_utc, pictures_json
from gateway.compare.views.drive_verdict import verdict
from gateway.compare.views.wheel_glance import GLANCE, number
from gateway.core.estimates.estimator import Estimate, Status
from gateway.core.estimates.reasons import EstimateCode
from gateway.core.optional_packages import require_packages
from gateway.core.quantity_catalogue import quantity_of
from gateway.core.shown_units import shown_in
from gateway.core.table_columns import RECORDING_PARTS
from gateway.core.text.html_template import result_page, script_data
from gateway.core.text.numbers import MISSING, STATUS_MARKS, Unit, age, fixed, plain_name, round_to_error, split_name
from gateway.core.text.output_file import check_target, write_whole
from gateway.core.text.page_parts import page_part
from gateway.core.text.readout import DISTANCE, WEAR, plain_wear
from gateway.core.text.table_sinks import Cell
from gateway.core.text.text import clean, counted
from gateway.core.text.wording import joined
from gateway.planner.uncertainty_budget import Budget

_VIEWS: Final = "gateway.compare.views"
_NO_WEAR: Final = "below zero by less than twice its error: no wear can be measured"


class _Value(NamedTuple):
    """A cell of the table of means: text, second line, and whether it is to be used with care."""

    text: str
    small: str
    is_doubtful: bool


def check_page(path: Path, *, force: bool = False) -> None:
    """Fail before the work if a page cannot be made.

    Raises:
        OutputError: jinja2 is missing, the file exists and `force` is not set, or it cannot be written.
    """
    require_packages("the page of a drive", "plot", "jinja2")
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
    """Return recordings as an HTML page without external resources; errors as for `result_page`."""
    sections = [_section(f"r{index}", drive) for index, drive in enumerate(drives)]
    return page_over_time(
        "drive_page.html.j2",
        title=f"Drive {drives[0].name}" if len(drives) == 1 else counted(len(drives), "recording"),
        facts=recorded_at(drives[0]) if len(drives) == 1 else "",
        steps=len(drives) == 1 and bool(sections[0]["verdict"].actions),
        sections=sections,
    )


def page_over_time(template: str, **values: object) -> str:
    """Return a page of this room with pictures over time; values and errors as for `result_page`."""
    scripts = [page_part("uPlot.iife.min.js"), page_part("pictures.js")]
    scripts += [page_part(name, _VIEWS) for name in ("drive_section.js", "drive_page.js")]
    style = "\n".join(page_part(name, _VIEWS).text for name in ("drive_section.css", "drive_page.css"))
    return result_page(_VIEWS, template, scripts=scripts, style=style, **values)


def recorded_at(drive: Drive) -> str:
    """Return date and time of the beginning in UTC, and the time to the last revolution."""
    start_ns = begin_ns(drive)
    end_ns = max((wheel.points[-1].time_ns for wheel in drive.wheels.values()), default=start_ns)
    return f"{date_utc(start_ns)}, {age((end_ns - start_ns) * 1e-9)}"


def _section(identity: str, drive: Drive) -> dict[str, Any]:
    """Return what the page shows of one recording; the template escapes all text except data for the script."""
    with shown_in(drive.units):
        return _shown_section(identity, drive)


def _shown_section(identity: str, drive: Drive) -> dict[str, Any]:
    wheels = list(drive.wheels)
    rows = {position: wheel.cells() for position, wheel in drive.wheels.items()}
    means, notes = _means(drive)
    start_ns = begin_ns(drive)
    end_ns = max((wheel.points[-1].time_ns for wheel in drive.wheels.values()), default=start_ns)
    first = verdict(drive, start_ns, end_ns)
    return {
        "id": identity,
        "title": drive.name,
        "facts": recorded_at(drive),
        "run": [clean(line) for line in drive.run],
        "wheels": wheels,
        "verdict": first,
        "glance": [
            (label, [text(rows[position]) for position in wheels])
            for label, text in GLANCE
            if any(text(row) != MISSING for row in rows.values())
        ],
        "means": means,
        "notes": notes,
        "data": script_data(pictures_json(drive, first.events, start_ns)) if wheels else "",
        "drawn": " ".join(filter(None, (_drawn(drive.wheels.values()), *_drawn_wear(notes)))),
        "path": path_picture({position: wheel.path for position, wheel in drive.wheels.items()}),
    }


def _means(drive: Drive) -> tuple[list[tuple[str, str, list[_Value]]], list[tuple[str, str, str]]]:
    """Return rows of quantity, unit and the wheels' means, and notes of wheels, quantities and reason."""
    rows: dict[str, dict[str, _Value]] = {}
    reasons: dict[str, dict[str, list[str]]] = {}
    budgets = drive.latest.budgets()
    for position, wheel in drive.wheels.items():
        if wheel.rolled is not None and wheel.rolled.reasons:
            reasons.setdefault(joined(wheel.rolled.reasons), {}).setdefault(position, []).append("distance")
        for name, values in wheel.row.quantities():
            if name == DISTANCE:
                continue  # it only grows
            label, unit = plain_name(name), split_name(name)[1]
            cells: dict[str, Cell] = dict(zip(RECORDING_PARTS, values, strict=True))
            status, reason = Status(str(cells["_status"])), str(cells["_reason"])
            value, std, scatter = (number(cells, part) for part in ("", "_std", "_scatter"))
            largest = next((entry.largest for entry in budgets.get(position, ()) if entry.estimate.name == name), "")
            if name == WEAR and value < plain_wear(Estimate(name, value, std, status)).value:
                value = 0.0
                reasons.setdefault(_NO_WEAR, {}).setdefault(position, []).append(label)
            rows.setdefault(name, {})[position] = _value(
                unit.of(value), std * unit.factor, scatter * unit.factor, status, largest
            )
            span = wheel.spans.get(name)
            if span is not None and any(
                reason.code is EstimateCode.ROW_SCATTERS for reason in wheel.row.means()[name].reasons
            ):
                rows.setdefault(name, {})[position] = _span(span, unit)
                continue
            if reason:
                reasons.setdefault(reason, {}).setdefault(position, []).append(label)
    absent = _Value(MISSING, "", False)
    table = [
        (plain_name(name), split_name(name)[1].symbol, [row.get(position, absent) for position in drive.wheels])
        for name, row in rows.items()
    ]
    return table, [*_notes(reasons), *_better_statements(budgets)]


def _better_statements(budgets: Mapping[str, Iterable[Budget]]) -> Iterator[tuple[str, str, str]]:
    """Yield for each quantity that people follow the statement that helps it, of the wheel with the largest error."""
    worst: dict[str, tuple[str, Budget]] = {}
    for position, budget in ((position, budget) for position, of_wheel in budgets.items() for budget in of_wheel):
        name, std = budget.estimate.name, budget.estimate.std
        if budget.advice and quantity_of(name).watch and (name not in worst or std > worst[name][1].estimate.std):
            worst[name] = position, budget
    for position, budget in worst.values():
        yield position, "", clean(budget.advice)


def _span(span: tuple[float, float], unit: Unit) -> _Value:
    """Return the span of a quantity that varies by far more than its errors: a mean would say nothing."""
    low, high = sorted(map(unit.of, span))
    size = round_to_error(high, (high - low) / 10.0)
    decimals = len(size.value.partition(".")[2]) if not size.power else None
    if decimals is None:
        return _Value(f"{low:.3g} to {high:.3g}", "varies", False)
    return _Value(f"{fixed(low, decimals)} to {fixed(high, decimals)}", "varies", False)


def _value(value: float, std: float, scatter: float, status: Status, largest: str) -> _Value:
    """Return the mean, the scatter and the largest part of the error of a quantity."""
    if status is Status.INVALID:
        return _Value(MISSING, "", True)
    size = round_to_error(scatter, scatter)
    detail = f"scatter {size.error}{size.power}" if size.error else ""
    detail = ", ".join(filter(None, (detail, f"most from {largest}" if largest else "")))
    mean = f"{round_to_error(value, std).joined()} {STATUS_MARKS[status]}".strip()
    return _Value(mean, detail, status is not Status.VALID)


def _notes(reasons: dict[str, dict[str, list[str]]]) -> Iterator[tuple[str, str, str]]:
    """Yield the wheels and the quantities of each reason."""
    for reason, of_wheels in reasons.items():
        positions_of: dict[tuple[str, ...], list[str]] = {}
        for position, labels in of_wheels.items():
            positions_of.setdefault(tuple(labels), []).append(position)
        for quantities, wheels in positions_of.items():
            yield clean(", ".join(wheels)), ", ".join(quantities), clean(reason)


def _drawn_wear(notes: Iterable[tuple[str, str, str]]) -> Iterator[str]:
    """Yield why the picture of wear is below zero where the table has none."""
    if any(reason == _NO_WEAR for *_, reason in notes):
        yield "Wear is drawn as measured: below zero by less than twice its error it means none, and is 0 in the table."


def _drawn(wheels: Iterable[DriveWheel]) -> str:
    stride = max((wheel.stride for wheel in wheels), default=1)
    return "" if stride == 1 else f"One of {stride} revolutions is drawn."
