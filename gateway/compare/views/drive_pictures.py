"""Numbers of a drive for the pictures of its page: quantities over time, events and waveforms, as JSON."""

import math
from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np

from gateway.compare.views.drive import MEASURED, Drive, DriveWheel
from gateway.compare.views.drive_verdict import Event
from gateway.core.quantity_catalogue import declared
from gateway.core.text.numbers import plain_name, split_name
from gateway.core.text.readout import DISTANCE, SPEED
from gateway.core.text.result_columns import iso_utc
from gateway.core.types import BoolArray, FloatArray

# Digits of a number below its standard error: more than an eye can see of a picture.
_DIGITS_BELOW_ERROR: Final = 1
_DIGITS: Final = 6
# Times before it are no dates: the clock of a hub counts from its start.
FIRST_DATE_NS: Final = 10**17


class Line(NamedTuple):
    """A quantity of waveform wheel over time.

    Attributes:
        position: wheel.
        style: index of its colour and dashes.
        time_s: (n,) since the beginning.
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


def date_utc(time_ns: int) -> str:
    """Return date and time, or that they were not recorded."""
    is_date = time_ns > FIRST_DATE_NS
    return iso_utc(time_ns)[:19].replace("T", " ") + " UTC" if is_date else "date not recorded"


def first_ns(drive: Drive) -> int:
    """Return the end of the first revolution of any wheel, ns; 0 without waveform."""
    return min((wheel.points[0].time_ns for wheel in drive.wheels.values()), default=0)


def begin_ns(drive: Drive) -> int:
    """Return the time from which the times of a drive count, ns: the start of its session, as those of its alarms."""
    return first_ns(drive) if drive.start_ns is None else min(drive.start_ns, first_ns(drive) or drive.start_ns)


def drawn_quantities(drive: Drive) -> list[str]:
    """Return the quantities that have a value, without the distance, which only grows."""
    names = {
        name: None for wheel in drive.wheels.values() for point in wheel.points for name in point.values
    }  # a dict keeps their order
    return [name for name in names if name != DISTANCE]


def lines_of(drive: Drive, name: str, start_ns: int) -> list[Line]:
    """Return the lines of a quantity, in the unit that it is shown in."""
    unit, absent = split_name(name)[1], (np.nan, np.nan, False)
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
        lines.append(
            Line(position, style, time_s, value * unit.factor + unit.offset, std * unit.factor, is_valid > 0.0)
        )
    return lines


def pictures_json(drive: Drive, events: Sequence[Event], start_ns: int) -> dict[str, Any]:
    """Return what the script of the page draws of waveform drive."""
    names = drawn_quantities(drive)
    times: list[list[float]] = [[] for _ in drive.wheels]
    quantities = []
    for name in names:
        label, unit = plain_name(name), split_name(name)[1]
        wheels: list[dict[str, Any] | None] = [None] * len(drive.wheels)
        for line in lines_of(drive, name, start_ns):
            times[line.style] = np.round(line.time_s, 3).tolist()
            wheels[line.style] = _columns(line)
        quantities.append({"name": name, "label": label, "unit": unit.symbol, "wheels": wheels})
    return {
        "begin_ms": start_ns // 1_000_000 if start_ns > FIRST_DATE_NS else None,
        "wheels": [{"name": position, "t": times[index]} for index, position in enumerate(drive.wheels)],
        "quantities": quantities,
        "first": [name for name in _first() if name in names and name not in _paired(names).values()] or names[:1],
        "pairs": _paired(names),
        "events": [
            {
                "kind": event.kind,
                "wheel": event.wheel,
                "begin": round(event.begin_s, 2),
                "end": round(event.end_s, 2) if math.isfinite(event.end_s) else None,
                "text": event.text,
            }
            for event in events
        ],
        "waveforms": [
            waveform
            for index, wheel in enumerate(drive.wheels.values())
            for waveform in _waveforms(index, wheel, start_ns)
        ],
    }


def _first() -> list[str]:
    """Return the quantities whose pictures are open at first: speed, air, contact, and what has a name outside."""
    named = [quantity.name for quantity in declared() if quantity.entity]
    return [SPEED, *MEASURED, "contact_length_m", *(name for name in named if name not in (SPEED, "contact_fraction"))]


def _paired(names: Sequence[str]) -> dict[str, str]:
    """Return the quantity that is drawn with another one at first: the temperature with the pressure."""
    pressure, temperature = MEASURED
    return {pressure: temperature} if pressure in names and temperature in names else {}


def _columns(line: Line) -> dict[str, Any]:
    stds = line.std[np.isfinite(line.std) & (line.std > 0.0)]
    digits = _DIGITS
    if stds.size:
        digits = _DIGITS_BELOW_ERROR + 1 - math.floor(math.log10(float(np.median(stds))))
    return {
        "v": _numbers(line.value, digits),
        "e": _numbers(line.std, digits + 1) if stds.size else None,
        "provisional": np.flatnonzero(~line.is_valid & np.isfinite(line.value)).tolist(),
    }


def _numbers(values: FloatArray, digits: int) -> list[float | None]:
    """Return numbers as JSON takes them: None where they are not finite."""
    return [value if math.isfinite(value) else None for value in np.round(values, digits).tolist()]


def _waveforms(index: int, wheel: DriveWheel, start_ns: int) -> list[dict[str, Any]]:
    return [
        {
            "wheel": index,
            "t": round((waveform.time_ns - start_ns) * 1e-9, 3),
            "cause": waveform.cause,
            "angle": np.round(np.degrees(waveform.angle_rad), 1).tolist(),
            "radial": _numbers(waveform.radial_mps2, 1),
        }
        for waveform in (*wheel.waveforms, *wheel.marked_waveforms)
    ]
