"""The overview: one line per wheel, for terminals too small for panels."""

import math
from collections.abc import Sequence
from typing import Final

from gateway.console.styled_rows import Role, Row, Run, fit
from gateway.console.wheel_panel import reading_of, silence_text
from gateway.core.estimates.results import WheelSnapshot, WheelState
from gateway.core.text.numbers import MISSING, STATUS_MARKS, Shown, fixed, round_to_error, shown_value, unit_symbol
from gateway.core.text.readout import Reading
from gateway.core.text.text import clean, crop_middle, pad, pad_left, width

_WIDE: Final = 110
_NAME_WIDTH: Final = 6
_NAME_WIDTH_WIDE: Final = 14
_SHORT_STATE: Final = {
    WheelState.NO_DATA: "no data",
    WheelState.SEARCHING: "search",
    WheelState.STANDSTILL: "stands",
    WheelState.ROLLING: "rolling",
    WheelState.SILENT: "silent",
    WheelState.ENDED: "ended",
}
_STATED_MARK: Final = "s"
_NUMBER_WIDTHS: Final = (8, 6, 5, 5)
_NUMBER_WIDTHS_WIDE: Final = (16, 13, 11, 11)


def overview(wheels: Sequence[WheelSnapshot], selected: int, alarmed: frozenset[str], cells: int) -> list[Row]:
    """Return a header and one row per wheel, each `cells` wide."""
    wide = cells >= _WIDE
    names = [clean(wheel.position) for wheel in wheels]
    limit = _NAME_WIDTH_WIDE if wide else _NAME_WIDTH
    name_width = min(max([5, *map(width, names)]), limit)
    readings = [reading_of(wheel) if wheel.silence is None else None for wheel in wheels]
    # The columns are named for numbers rather than ratios as soon as any wheel has numbers.
    labels = next((_labels(r) for r in readings if r and not r.ratios_only), None)
    labels = labels or next((_labels(r) for r in readings if r), ())
    widths = list(_NUMBER_WIDTHS_WIDE if wide else _NUMBER_WIDTHS)
    load = f" {unit_symbol('load_n'):>7}" if wide else ""
    header = (
        f"   {pad('wheel', name_width)} {'state':<{10 if wide else 7}} {unit_symbol('speed_mps'):>6} "
        f"{'begins°':>7} {'ends°':>6} {unit_symbol('pressure_pa'):>6} {unit_symbol('temperature_degc'):>5}"
        f"{load}  " + " ".join(f"{label:>{size}}" for label, size in zip(labels, widths, strict=False))
    )
    rows: list[Row] = [fit(((header, Role.LABEL),), cells)]
    for i, (wheel, reading) in enumerate(zip(wheels, readings, strict=True)):
        name = pad(crop_middle(names[i], name_width), name_width)
        start: Row = (
            (">" if i == selected else " ", Role.TITLE),
            (f"{i + 1}", Role.TITLE if i == selected else Role.LABEL),
            ("!" if wheel.position in alarmed else " ", Role.ALARM if wheel.position in alarmed else Role.TEXT),
            (name, Role.TITLE if i == selected else Role.TEXT),
        )
        rows.append(fit((*start, *_values(wheel, reading, wide, labels, widths)), cells))
    return rows


def _labels(reading: Reading) -> tuple[str, ...]:
    return tuple(number.label for number in reading.numbers)


def _values(
    wheel: WheelSnapshot, reading: Reading | None, wide: bool, labels: tuple[str, ...], widths: Sequence[int]
) -> Row:
    if wheel.silence is not None:
        return ((f" {silence_text(wheel)}", Role.WARNING),)
    rolling = wheel.state is WheelState.ROLLING
    state = f"{wheel.state.value:<10}" if wide else f"{_SHORT_STATE[wheel.state]:<7}"
    speed = _marked(reading.speed) if reading is not None and rolling else MISSING
    leading = _marked(reading.leading) if reading is not None else MISSING
    trailing = _marked(reading.trailing) if reading is not None else MISSING
    load = f" {_of_source(wheel, 'load_n', wheel.load_n, 0):>7}" if wide else ""
    # The columns have no room for the age of old values; the details of the wheel show it.
    is_current = wheel.has_current_environment
    pressure = _of_source(wheel, "pressure_pa", wheel.pressure_pa, 1) if is_current else MISSING
    temperature = shown_value("temperature_degc", wheel.temperature_degc, 1) if is_current else MISSING
    row: list[Run] = [
        (f" {state} ", Role.GOOD if rolling else Role.WARNING),
        (f"{speed:>6} ", Role.VALUE),
        (f"{leading:>7} {trailing:>6} ", Role.TEXT),
        (f"{pressure:>6} {temperature:>5}{load} ", Role.TEXT),
    ]
    if reading is None:
        return tuple(row)
    row.append((STATUS_MARKS[reading.status] or " ", Role.WARNING))
    row.append((" ".join(_cells(reading, wide, labels, widths)), Role.VALUE))
    return tuple(row)


def _marked(entry: Shown) -> str:
    return fixed(entry.value, 2) + entry.mark * math.isfinite(entry.value)


def _of_source(wheel: WheelSnapshot, name: str, value: float | None, decimals: int) -> str:
    """Return a number, with a mark where it is stated and not measured."""
    return shown_value(name, value, decimals) + _STATED_MARK * (name in wheel.stated)


def _short(entry: Shown) -> str:
    """Return the value without its error, in at most four digits even if the error justifies more."""
    digits = entry.number.value.replace(".", "").lstrip("-0")
    return entry.number.value + entry.number.power if len(digits) <= 4 else round_to_error(entry.value).joined()


def _cells(reading: Reading, wide: bool, labels: tuple[str, ...], widths: Sequence[int]) -> list[str]:
    values = {number.label: number.number.joined("±") if wide else _short(number) for number in reading.numbers}
    numerators = {label.partition("/")[0]: value for label, value in values.items()}
    denominators = {label.partition("/")[2] for label in values}
    if tuple(values) == labels:
        cells_by_label = values
    elif len(denominators) == 1 and {*numerators, *denominators} <= set(labels):
        # Ratios to one number go into the columns of their numerators, the divisor into its own.
        cells_by_label = {**numerators, **{label: f"/{label}" for label in denominators}}
    else:
        return [f"{label} {value}" for label, value in values.items()]
    return [pad_left(cells_by_label.get(label, ""), size) for label, size in zip(labels, widths, strict=False)]
