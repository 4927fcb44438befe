"""One wheel on the console: its panel, and the details of the selected wheel."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from gateway.console.styled_rows import (
    EMPTY,
    Role,
    Row,
    Run,
    beside,
    fill_while_fitting,
    fit,
    plot_row,
    row_width,
)
from gateway.console.trend_history import TrendHistory, TrendQuantity
from gateway.console.trend_plot import draw_trend
from gateway.console.waveform import LEGEND, Zoom, draw_waveform
from gateway.core.estimates.estimator import Status
from gateway.core.estimates.results import RevolutionResult, WheelSnapshot, WheelState
from gateway.core.quantity_catalogue import quantity_of
from gateway.core.shown_units import ShownUnits, shown_units
from gateway.core.text.numbers import MISSING, STATUS_MARKS, Shown, age, fixed, percent, show, shown_value, unit_symbol
from gateway.core.text.readout import SPEED, WEAR, Reading, plain_wear, read_result
from gateway.core.text.text import ELLIPSIS, clean, crop, crop_middle, filled, pad, width
from gateway.core.text.wording import text as reason_text
from gateway.core.types import FloatArray

PANEL_MIN_WIDTH: Final = 58
PANEL_MIN_HEIGHT: Final = 12
_DETAIL_WIDTH: Final = 38
_DETAIL_WIDTH_WIDE: Final = 58
_WIDE: Final = 120
_PLOT_MIN_ROWS: Final = 6  # with its legend and axis
_WAITING: Final = {
    WheelState.NO_DATA: "no data: nothing received from this sensor yet",
    WheelState.SEARCHING: "searching: needs two passes through the contact",
    WheelState.STANDSTILL: "standing still, or too slow to measure",
    WheelState.ROLLING: "first revolution under way",
    WheelState.SILENT: "silent",
    WheelState.ENDED: "ended: no revolution was completed",
}


_Shape = tuple[int, int, Zoom, TrendQuantity | None, ShownUnits, int]


@dataclass(slots=True)
class Plots:
    """The plot of each wheel: its waveform, drawn again only when it has a new revolution, or a trend.

    Attributes:
        history: of the trends.
        trend: the quantity whose trend is shown, None for the waveforms.
        elapsed_s: of the session that is shown.
    """

    history: TrendHistory = field(default_factory=TrendHistory)
    trend: TrendQuantity | None = None
    elapsed_s: float = 0.0
    _begin_s: float = 0.0
    _drawn: dict[str, tuple[RevolutionResult, FloatArray | None, _Shape, list[Row]]] = field(default_factory=dict)

    def take(self, result: RevolutionResult, elapsed_s: float) -> None:
        """Add a revolution to the trends; from its time on, the present goes on with the session."""
        self.history.add(result)
        self._begin_s = result.host_ns * 1e-9 - elapsed_s

    def rows(self, wheel: WheelSnapshot, width_cells: int, height: int, zoom: Zoom) -> list[Row]:
        """Return the wheel's waveform or trend, empty before its first revolution and in silence."""
        if wheel.last is None or wheel.silence is not None:
            return []
        now_s = int(self._begin_s + self.elapsed_s) if self.trend is not None else 0
        shape = (width_cells, height, zoom, self.trend, shown_units(), now_s)
        drawn = self._drawn.get(wheel.position)
        if drawn and drawn[0] is wheel.last and drawn[1] is wheel.average_mps2 and drawn[2] == shape:
            return drawn[3]
        if self.trend is None:
            revolution = wheel.last.revolution
            plot = draw_waveform(
                revolution.radial_mps2,
                wheel.average_mps2,
                width_cells,
                height,
                zoom=zoom,
                edges_rad=(revolution.leading_edge_rad, revolution.trailing_edge_rad),
            )
        else:
            points = self.history.points(wheel.position, self.trend.name)
            plot = draw_trend(points, unit_symbol(self.trend.name), width_cells, height, now_s)
        rows = [plot_row(row) for row in plot]
        self._drawn[wheel.position] = (wheel.last, wheel.average_mps2, shape, rows)
        return rows


def _speed(wheel: WheelSnapshot, reading: Reading | None) -> str:
    if reading is None or wheel.state is not WheelState.ROLLING:
        return f"{MISSING} {unit_symbol(SPEED)}"
    return reading.speed.text()


def surroundings(wheel: WheelSnapshot) -> list[Run]:
    """Return pressure, temperature and load; of a silent wheel the stated load and what still comes.

    Old values have their age.
    """
    old = wheel.old_environment
    load_n = wheel.load_n
    if wheel.silence is not None:
        load_n = wheel.last.conditions.load_n if wheel.last is not None else load_n
        if not wheel.has_current_environment:
            missing = [(f"{MISSING} {unit_symbol(name)}", Role.VALUE) for name in ("pressure_pa", "temperature_degc")]
            return [*missing, _load(wheel, load_n)]
    since = f" ({age(old.age_s)} old)" if old is not None else " still received" if wheel.silence is not None else ""
    role = Role.WARNING if old is not None else Role.VALUE if wheel.silence is None else Role.LABEL
    return [
        _of_source(wheel, "pressure_pa", f"{_with_unit('pressure_pa', wheel.pressure_pa, 1)}{since}", role),
        (_with_unit("temperature_degc", wheel.temperature_degc, 1), role),
        _load(wheel, load_n),
    ]


def _load(wheel: WheelSnapshot, load_n: float | None) -> Run:
    if load_n is None:
        return "load not stated", Role.LABEL
    return _of_source(wheel, "load_n", _with_unit("load_n", load_n, 0), Role.VALUE)


def _with_unit(name: str, value: float | None, decimals: int) -> str:
    return f"{shown_value(name, value, decimals)} {unit_symbol(name)}"


def _of_source(wheel: WheelSnapshot, name: str, text: str, role: Role) -> Run:
    """Return a value as one that is measured, or as one that is stated."""
    return (f"{text} stated", Role.TEXT) if name in wheel.stated and role is Role.VALUE else (text, role)


def silence_text(wheel: WheelSnapshot) -> str:
    """Return what is silent and for how long; empty while samples arrive."""
    silence = wheel.silence
    if silence is None:
        return ""
    says_when = "silence_s" in dict(silence.reason.values)
    since = "" if says_when else f" for {age(silence.age_s)}"
    sentence = f"SILENT{since}: {reason_text(silence.reason)}"
    return clean(sentence if sentence.endswith("?") else f"{sentence}.")


def _last_heard(wheel: WheelSnapshot) -> str:
    """Return the last revolution of a silent wheel; empty when there was none."""
    reading = reading_of(wheel)
    if reading is None or wheel.last is None:
        return ""
    return f"Last revolution: {wheel.last.revolution.index}, at {reading.speed.text()}."


def note_of(wheel: WheelSnapshot, reading: Reading | None) -> Run | None:
    """Return why the wheel's numbers are not valid or not current, if they are not."""
    if wheel.silence is not None:
        return f"{silence_text(wheel)} {_last_heard(wheel)}", Role.WARNING
    if reading is None or wheel.last is None:
        return _WAITING[wheel.state], Role.LABEL
    if wheel.state is not WheelState.ROLLING:
        return f"{wheel.state.value}: values of revolution {wheel.last.revolution.index}", Role.WARNING
    if reading.note:
        mark = STATUS_MARKS[reading.status]
        doubtful = bool(mark) or reading.ratios_only or bool(wheel.last.revolution.faults)
        return clean(f"{mark} {reading.note}" if mark else reading.note), Role.WARNING if doubtful else Role.LABEL
    return None


def car_runs(reading: Reading | None) -> list[Run]:
    """Return the vehicle's own signals; one that is not received has no number."""
    signals = reading.car if reading is not None else ()
    return [
        (f"{signal.label} {signal.text()}", Role.WARNING if signal.status is Status.INVALID else Role.TEXT)
        for signal in signals
    ]


def shown_numbers(wheel: WheelSnapshot, reading: Reading | None) -> list[Shown]:
    """Return the numbers, then wear and the other estimates of a live view."""
    if reading is None:
        return []
    others = [reading.rotation] if reading.rotation.status is not Status.INVALID else []
    others += [reading.distance] if reading.distance is not None else []
    others += [show(plain_wear(wheel.wear_mm))] if wheel.wear_mm is not None else []
    labels = set()
    for estimate in reading.further:
        quantity = quantity_of(estimate.name)
        entry = show(estimate)
        label = entry.label if quantity.live_label is None else quantity.live_label
        if (
            label
            and label not in labels
            and estimate.status is not Status.INVALID
            and estimate.name != WEAR
            and not estimate.name.endswith("_age_s")
        ):
            labels.add(label)
            others.append(entry._replace(label=label))
    return [*reading.numbers, *others]


def number_rows(wheel: WheelSnapshot, reading: Reading | None, cells: int) -> list[Row]:
    """Return one row for each number: name, value with error, unit, mark.

    Numbers have their symbols, and their plain names where all of these fit in `cells` cells.
    """
    numbers = shown_numbers(wheel, reading)
    plain = [_number_row(entry.plain, entry) for entry in numbers]
    if all(row_width(row) <= cells for row in plain):
        return plain
    label_width = max((width(number.label) for number in reading.numbers), default=0) if reading is not None else 0
    return [_number_row(pad(entry.label, max(label_width, width(entry.label))), entry) for entry in numbers]


def _number_row(name: str, entry: Shown) -> Row:
    unit = f" {entry.unit}" if entry.unit else ""
    mark = f" {entry.mark}" if entry.mark else ""
    return (name + " ", Role.LABEL), (entry.number.joined(), Role.VALUE), (unit, Role.TEXT), (mark, Role.WARNING)


def _grid(rows: Sequence[Row], columns: int, cells: int) -> list[Row]:
    """Return rows side by side in columns of `cells` cells; one that is too long for a column gets several."""
    lines: list[list[Run]] = []
    free_columns = 0
    for row in rows:
        span = min(-(-row_width(row) // cells), columns)
        if span > free_columns:
            lines.append([])
            free_columns = columns
        if row_width(row) == span * cells and span < free_columns:
            # It would touch its neighbour.
            span += 1
        lines[-1] += fit(row, span * cells)
        free_columns -= span
    return [tuple(line) for line in lines]


def counter_runs(wheel: WheelSnapshot) -> list[Run]:
    """Return counters of samples and revolutions, without a rate in silence; those that need attention are warnings."""
    c = wheel.counters
    lost = percent(c.lost_while_heard, c.samples + c.lost_while_heard) if wheel.silence is None else MISSING
    silent = [(f"was silent {age(c.silent_s)}", Role.WARNING)] if c.silent_s else []
    runs = [
        (f"lost {lost}", Role.WARNING if c.lost_while_heard else Role.LABEL),
        *silent,
        (f"overwritten {c.samples_overwritten}", Role.WARNING if c.samples_overwritten else Role.LABEL),
        (f"saturated {c.samples_saturated}", Role.WARNING if c.samples_saturated else Role.LABEL),
        (f"rejected {c.revolutions_rejected}", Role.LABEL),
    ]
    if not wheel.sensor_id:
        return [*runs, ("no hello yet", Role.LABEL)]
    return [*runs, (f"sensor {clean(wheel.sensor_id)}", Role.LABEL), (f"{wheel.rate_hz:g} Hz", Role.LABEL)]


def _legend(wheel: WheelSnapshot, trend: TrendQuantity | None) -> Row:
    if trend is not None:
        symbol = unit_symbol(trend.name)
        unit = f", {symbol}" if symbol else ""
        return ((f"{trend.label}{unit}", Role.VALUE), ("  dots: one standard error", Role.LABEL))
    row = plot_row(LEGEND)
    last = wheel.last.revolution.radial_mps2 if wheel.last is not None else None
    if last is None or wheel.average_mps2 is None or last.shape != wheel.average_mps2.shape:
        return row
    difference = last - wheel.average_mps2
    rms = math.sqrt(float(np.mean(difference * difference)))
    return (*row, (f"  difference {fixed(rms, 1)} m/s² rms", Role.LABEL))


def reading_of(wheel: WheelSnapshot) -> Reading | None:
    """Return the reading of a wheel's latest result, None before its first revolution."""
    return read_result(wheel.last) if wheel.last is not None else None


def current_reading(wheel: WheelSnapshot) -> Reading | None:
    """Return the reading of a wheel that is heard: old numbers would look alive."""
    return reading_of(wheel) if wheel.silence is None else None


def state_text(wheel: WheelSnapshot) -> str:
    """Return the state of a wheel, of a silent one with its age."""
    return f"silent for {age(wheel.silence.age_s)}" if wheel.silence is not None else wheel.state.value


def panel(
    wheel: WheelSnapshot, number: int, cells: int, height: int, *, selected: bool, alarm: bool, zoom: Zoom, plots: Plots
) -> list[Row]:
    """Draw a wheel as a framed panel of `cells` x `height`."""
    inner, inner_height = cells - 4, height - 2
    reading = current_reading(wheel)
    body: list[Row] = [fill_while_fitting(((_speed(wheel, reading), Role.TITLE),), surroundings(wheel), inner)]
    if reading is not None:
        body.append(_contact_row(reading, inner))
    if car := car_runs(reading):
        body.append(fill_while_fitting((("car", Role.LABEL),), car, inner))
    room = inner_height - len(body) - _PLOT_MIN_ROWS if reading is not None else inner_height
    columns = max(2, inner // 28)
    grid = _grid(number_rows(wheel, reading, inner), columns, inner // columns)
    if len(grid) > room:
        grid = _grid(number_rows(wheel, reading, 0), columns, inner // columns)
    note = _wrap(note_of(wheel, reading), inner)
    # Numbers come first; the note gets as many lines as leave the waveform its minimum height.
    body += grid[: max(room, 1)]
    body += _cut(note, max(1, min(3, room - len(grid))), inner)
    plot = plots.rows(wheel, inner, inner_height - len(body) - 1, zoom)
    if plot:
        body += [_legend(wheel, plots.trend), *plot]
    frame = Role.SELECTED_FRAME if selected else Role.FRAME
    left_edge, right_edge = ("║ ", " ║") if selected else ("│ ", " │")
    rows = [
        ((left_edge, frame), *fit(body[i] if i < len(body) else EMPTY, inner), (right_edge, frame))
        for i in range(inner_height)
    ]
    return [_panel_top(wheel, number, cells, selected, alarm), *rows, _panel_bottom(wheel, cells, selected)]


def _contact_row(reading: Reading, cells: int) -> Row:
    """Return where the contact begins and ends; the unit once, where there is no room for two."""
    begin, end = reading.leading, reading.trailing
    row: Row = ((f"{begin.plain} {begin.text()}  {end.plain.removeprefix('contact ')} {end.text()}", Role.VALUE),)
    if row_width(row) <= cells or begin.status is Status.INVALID or end.status is Status.INVALID:
        return row
    return ((f"contact from {begin.number.joined()} to {end.text()}", Role.VALUE),)


def _panel_top(wheel: WheelSnapshot, number: int, cells: int, selected: bool, alarm: bool) -> Row:
    frame = Role.SELECTED_FRAME if selected else Role.FRAME
    line, start, end = ("═", "╔═", "╗") if selected else ("─", "┌─", "┐")
    name = crop_middle(clean(wheel.position), cells - 40)
    title: list[Run] = [(start, frame), (f" {number} {name} ", Role.TITLE), (f"{state_text(wheel)} ", Role.TEXT)]
    if alarm:
        title.append((" ALARM ", Role.ALARM))
    tail = f" rev {wheel.last.revolution.index} " if wheel.last is not None else ""
    missing = cells - row_width(tuple(title)) - len(tail) - 2
    return fit((*title, (line * missing, frame), (tail, Role.LABEL), (line + end, frame)), cells)


def _panel_bottom(wheel: WheelSnapshot, cells: int, selected: bool) -> Row:
    frame = Role.SELECTED_FRAME if selected else Role.FRAME
    line, start, end = ("═", "╚═ ", "╝") if selected else ("─", "└─ ", "┘")
    first, *others = counter_runs(wheel)
    row = (*fill_while_fitting(((start, frame), first), others, cells - 3), (" ", frame))
    return (*row, (line * (cells - row_width(row) - 1), frame), (end, frame))


def details(wheel: WheelSnapshot, number: int, cells: int, height: int, zoom: Zoom, plots: Plots) -> list[Row]:
    """Draw the selected wheel below the overview: a rule with its conditions, numbers left, waveform right."""
    if height < 1:
        return []
    reading = current_reading(wheel)
    name = crop_middle(clean(wheel.position), 24)
    load, state = surroundings(wheel)[-1], (state_text(wheel), Role.TEXT if wheel.silence is None else Role.WARNING)
    start: Row = (("══ ", Role.SELECTED_FRAME), (f"{number} {name}", Role.TITLE))
    rule = fill_while_fitting(start, [load, state], cells - 3)
    revolution = f" rev {wheel.last.revolution.index} " if wheel.last is not None else " "
    legend = plot_row(LEGEND) if plots.trend is None else _legend(wheel, plots.trend)
    end = (*legend, (" ══", Role.SELECTED_FRAME)) if reading is not None else EMPTY
    line = cells - row_width(rule) - len(revolution) - row_width(end) - 1
    rule = (*rule, (revolution, Role.LABEL), ("═" * line + " ", Role.SELECTED_FRAME), *end)
    detail_width = _DETAIL_WIDTH_WIDE if cells >= _WIDE else _DETAIL_WIDTH
    left_rows: list[Row] = number_rows(wheel, reading, detail_width - 1)
    note = _cut(_wrap(note_of(wheel, reading), detail_width - 1), 4, detail_width - 1)
    if reading is not None:
        left_rows[len(reading.numbers) : len(reading.numbers)] = [
            _number_row(entry.plain, entry) for entry in (reading.speed, reading.leading, reading.trailing)
        ]
        left_rows[len(reading.numbers) : len(reading.numbers)] = [
            (("car ", Role.LABEL), run) for run in car_runs(reading)
        ]
        # The note matters more than the last rows of the list, and replaces them where room is short.
        shown_rows = max(height - 1 - len(note), len(reading.numbers))
        left_rows = left_rows[:shown_rows]
    left_rows = [*left_rows, *note, *((run,) for run in counter_runs(wheel))]
    plot = plots.rows(wheel, cells - detail_width, height - 1, zoom)
    return [rule, *beside(left_rows, detail_width, plot, height - 1)]


def _wrap(run: Run | None, cells: int) -> list[Row]:
    if run is None:
        return []
    text, role = run
    return [((line, role),) for line in filled(text.split(), cells)]


def _cut(rows: list[Row], height: int, cells: int) -> list[Row]:
    """Return the first `height` rows, the last with an ellipsis when there were more."""
    if len(rows) <= height:
        return rows
    (text, role), *_ = rows[height - 1]
    return [*rows[: height - 1], ((crop(f"{text} {ELLIPSIS}", cells), role),)]
