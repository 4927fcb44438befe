"""What the page shows, as JSON: the contents of the console, with the same words, for a browser."""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final

import numpy as np

from gateway.console.status import link_row, sink_row
from gateway.console.styled_rows import Row, Run
from gateway.console.trend_history import TrendHistory, TrendPoint
from gateway.console.wheel_panel import (
    car_runs,
    counter_runs,
    current_reading,
    note_of,
    shown_numbers,
    state_text,
    surroundings,
)
from gateway.core.estimates.estimator import Status
from gateway.core.estimates.results import SessionSnapshot, WheelSnapshot, WheelState
from gateway.core.revolutions.order_spectrum import order_coefficients
from gateway.core.shown_units import ShownUnits, conversion
from gateway.core.text.numbers import MISSING, Shown, duration, unit_symbol
from gateway.core.text.readout import SPEED
from gateway.core.text.recording_topics import waveform_payload
from gateway.core.text.text import clean, counted, file_size
from gateway.core.text.wording import notice_text
from gateway.core.text.wording import text as reason_text
from gateway.core.types import ComplexArray, FloatArray
from gateway.publishing.web_page.drive_face import drive_face

JsonObject = dict[str, Any]
# The rows of links are for a terminal of this many cells: nothing is left out.
_CELLS: Final = 1000
_NAME_CELLS: Final = 60
UNIT_NAMES: Final = {
    units: ", ".join(conversion(symbol, units).symbol for symbol in ("km/h", "kPa", "°C", "N")) for units in ShownUnits
}
"""Units that a page can be switched to, in words."""


def page_state(snapshot: SessionSnapshot, *, run_form: Mapping[str, str] | None) -> JsonObject:
    """Return the state of the session with everything in words.

    Args:
        snapshot: of the session.
        run_form: fields that describe the next recording, None where none may be begun.
    """
    alarmed = {alarm.position for alarm in snapshot.alarms}
    raised_s = {(record.position, record.name): record.raised_s for record in snapshot.alarm_records}
    return {
        "type": "state",
        "elapsed": duration(snapshot.elapsed_s),
        "rolling": "ended" if snapshot.ended else _rolling(snapshot.wheels),
        "ended": snapshot.ended,
        "recording": clean(snapshot.recording),
        "recorded": file_size(snapshot.recorded_bytes),
        "may_record": run_form is not None,
        "run": dict(run_form or {}),
        "alarms": [
            clean(f"{alarm.position}: {reason_text(alarm.reason)}{' (acknowledged)' * snapshot.is_acknowledged(alarm)}")
            for alarm in snapshot.alarms
        ],
        "alarms_since": [
            duration(raised_s.get((alarm.position, alarm.name), snapshot.elapsed_s)) for alarm in snapshot.alarms
        ],
        "to_acknowledge": not all(map(snapshot.is_acknowledged, snapshot.alarms)),
        "units": snapshot.units,
        "unit_names": UNIT_NAMES,
        "drive": drive_face(snapshot),
        "wheels": [_wheel(wheel, is_alarmed=wheel.position in alarmed) for wheel in snapshot.wheels],
        "links": [_runs(link_row(link, _NAME_CELLS, _CELLS)) for link in snapshot.links],
        "outputs": [_runs(sink_row(sink, _NAME_CELLS, _CELLS)) for sink in snapshot.sinks],
        "notices": [clean(notice_text(notice)) for notice in snapshot.notices],
    }


def _rolling(wheels: Sequence[WheelSnapshot]) -> str:
    """Return how many wheels roll and, as one that is not heard may roll too, how many are silent."""
    rolling = sum(wheel.state is WheelState.ROLLING for wheel in wheels)
    silent = sum(wheel.silence is not None for wheel in wheels)
    return f"{rolling} of {counted(len(wheels), 'wheel')} rolling{f', {silent} silent' * bool(silent)}"


def _wheel(wheel: WheelSnapshot, *, is_alarmed: bool) -> JsonObject:
    """Return a wheel; what is silent has an age in place of its numbers."""
    reading = current_reading(wheel)
    is_rolling = reading is not None and wheel.state is WheelState.ROLLING
    note = note_of(wheel, reading)
    edges = (reading.leading, reading.trailing) if reading is not None else ()
    return {
        "position": clean(wheel.position),
        "key": wheel.position,
        "state": state_text(wheel),
        "kind": wheel.state.name.lower(),
        "alarm": is_alarmed,
        "speed": _number_fields(reading.speed)
        if reading is not None and is_rolling
        else [MISSING, "", unit_symbol(SPEED), "", ""],
        "edges": [f"{entry.plain} {entry.text()}" for entry in edges],
        "surroundings": _runs(surroundings(wheel)),
        "car": _runs(car_runs(reading)),
        "note": _runs([note])[0] if note is not None else None,
        "numbers": [[entry.plain, *_number_fields(entry)] for entry in shown_numbers(wheel, reading)],
        "counters": _runs(counter_runs(wheel)),
        "flags": [clean(f"{flag.name}: {reason_text(flag.reason)}") for flag in wheel.flags],
    }


def _number_fields(entry: Shown) -> list[str]:
    """Return value, error, unit, mark and reason."""
    number = entry.number
    error = f"{number.error}{number.power}" if number.error else ""
    return [number.value + number.power, error, entry.unit, entry.mark, clean(entry.reason)]


def _runs(row: Row | Iterable[Run]) -> list[list[str]]:
    """Return text and role of each run that is not blank."""
    return [[clean(text.strip()), role.value] for text, role in row if text.strip()]


def page_waveform(wheel: WheelSnapshot) -> JsonObject | None:
    """Return the last revolution over the average with its scatter, and their orders; None without or in silence."""
    last, average, scatter = wheel.last, wheel.average_mps2, wheel.scatter_mps2
    if last is None or average is None or wheel.silence is not None:
        return None
    waveform = waveform_payload(last, average)
    step = max(1, len(average) // len(waveform["theta_rad"]))
    return {
        "type": "waveform",
        "wheel": wheel.position,
        "revolution": waveform["index"],
        "angle_deg": [round(math.degrees(angle), 1) for angle in waveform["theta_rad"]],
        "last_mps2": waveform["radial_mps2"],
        "average_mps2": waveform["average_mps2"],
        "scatter_mps2": _numbers(scatter[::step]) if scatter is not None else [],
        "edges_deg": [
            round(math.degrees(edge), 2) if math.isfinite(edge) else None
            for edge in (last.revolution.leading_edge_rad, last.revolution.trailing_edge_rad)
        ],
        "orders_mps2": _magnitudes(last.revolution.orders_mps2),
        "average_orders_mps2": _magnitudes(order_coefficients(average)),
    }


def _magnitudes(orders: ComplexArray) -> list[float | None]:
    return _numbers(np.abs(orders))


def _numbers(values: FloatArray) -> list[float | None]:
    """Return values for JSON, which has no NaN."""
    return [round(value, 2) if math.isfinite(value) else None for value in values.tolist()]


def page_quantities(history: TrendHistory) -> JsonObject:
    """Return the quantities that have a trend."""
    return {"type": "quantities", "quantities": [quantity._asdict() for quantity in history.quantities()]}


def page_trend(history: TrendHistory, name: str, since_s: int) -> JsonObject:
    """Return the points of a quantity of every wheel from a time on: time, value, error, and 1 where provisional."""
    return {
        "type": "trend",
        "name": name,
        "since_s": since_s,
        "wheels": {
            position: [_point(point) for point in history.points(position, name, since_s)]
            for position in history.wheels()
        },
    }


def _point(point: TrendPoint) -> list[float | None]:
    value, std = (float(f"{number:.6g}") if math.isfinite(number) else None for number in (point.value, point.std))
    return [point.at_s, value, std, int(point.status is Status.PROVISIONAL)]
