"""The plain view: one line per revolution, for logs, pipes and terminals without a screen."""

from collections.abc import Callable, Sequence
from typing import Final

from gateway.core.estimates.estimator import Status
from gateway.core.estimates.results import RevolutionResult
from gateway.core.reasons import Code, Notice, codes_of
from gateway.core.text.numbers import MISSING, Shown, fixed, shown_value, unit_symbol
from gateway.core.text.readout import SPEED, Reading, read_result
from gateway.core.text.text import clean, crop, crop_middle, pad, width
from gateway.core.text.wording import notice_text

LINE_WIDTH: Final = 216
HEADER_EVERY: Final = 40
_NUMBERS_TITLE: Final = "numbers ± standard error (~ provisional, x invalid)"
_PRESSURE: Final = "pressure_pa"
_NAME_WIDTH_MIN: Final = 5
# Both ends of `hub10.wheel10 on serial:/dev/ttyUSB1` are needed to tell wheels apart.
_NAME_WIDTH_MAX: Final = 28
# Wide enough for `Bs (3.083±0.012)e-3`, `Cw 0.1953±0.0012`, `Rs 2.974±0.031`, `Ts 2.529±0.099`.
_NUMBER_WIDTHS: Final = (19, 16, 14, 14)
_NUMBERS_WIDTH_MAX: Final = 78
_STATUS_WORDS: Final = {"valid": "ok", "provisional": "~", "invalid": "x"}


def _cell(number: Shown) -> str:
    return number.number.joined("±") + number.mark


class PlainView:
    """Results as aligned lines of at most LINE_WIDTH columns, without escape codes."""

    def __init__(self, write: Callable[[str], None]) -> None:
        """Set the function that writes a line and adds the line end."""
        self._write = write
        self._lines_until_header = 0
        self._name_width = _NAME_WIDTH_MIN
        self._number_widths = list(_NUMBER_WIDTHS)
        # Codes of the reasons given last, by position, and of the notes on valid numbers given so far.
        self._last_codes: dict[str, tuple[Code, ...]] = {}
        self._noted_codes: set[tuple[Code, ...]] = set()

    def result(self, result: RevolutionResult) -> None:
        """Write the line of a revolution, after the header when it is due or a column has grown."""
        reading = read_result(result)
        name = crop_middle(clean(result.position), _NAME_WIDTH_MAX)
        # One mark at the end of the line is enough when all numbers share a status.
        marked = any(number.status is not reading.status for number in reading.numbers)
        cells = [f"{entry.label} {entry.number.joined('±')}{entry.mark if marked else ''}" for entry in reading.numbers]
        self._make_room(width(name), cells)
        if self._lines_until_header <= 0:
            self._write(self._header())
            self._lines_until_header = HEADER_EVERY
        self._lines_until_header -= 1
        line = self._line(name, cells, reading, result)
        note = clean(reading.note)
        is_valid = reading.status is Status.VALID and not reading.ratios_only and not result.revolution.faults
        codes = codes_of(reading.reasons)
        # That a load is missing holds for every line, and is said with the first.
        is_said = is_valid or (reading.ratios_only and codes == self._last_codes.get(result.position))
        self._write(crop((line if is_said else line + note).rstrip(), LINE_WIDTH))
        # A note on valid numbers is written once; a reason that does not fit is written in full when it is new. Its
        # numbers may change with every revolution, so its codes are compared.
        if is_valid:
            if codes and codes not in self._noted_codes:
                self._noted_codes.add(codes)
                self._remark(f"{name} rev {result.revolution.index}: {note}")
        elif codes != self._last_codes.get(result.position, ()):
            self._last_codes[result.position] = codes
            if width(line) + width(note) > LINE_WIDTH:
                self._remark(f"{name} rev {result.revolution.index}: {note}")

    def notice(self, notice: Notice) -> None:
        """Write a notice."""
        self._remark(notice_text(notice))

    def _remark(self, text: str) -> None:
        """Write text on lines that begin with `#`, so that a filter can separate them from results."""
        for line in text.splitlines():
            self._write(f"# {clean(line)}")

    def _make_room(self, name_width: int, cells: Sequence[str]) -> None:
        if name_width > self._name_width:
            self._name_width = name_width
            self._lines_until_header = 0
        for slot, cell in enumerate(cells):
            if slot == len(self._number_widths):
                self._number_widths.append(0)
            new_width = min(len(cell), _NUMBERS_WIDTH_MAX - sum(self._number_widths) + self._number_widths[slot])
            if new_width > self._number_widths[slot]:
                self._number_widths[slot] = new_width
                self._lines_until_header = 0

    def _header(self) -> str:
        numbers = crop(_NUMBERS_TITLE, self._numbers_width())
        pressure = unit_symbol(_PRESSURE)
        return (
            f"{pad('wheel', self._name_width)} {'rev':>6} {'device s':>10} {unit_symbol(SPEED):>7} {'rpm':>6} {'m':>8} "
            f"{'begins at deg':>13} {'ends at deg':>12} {numbers:<{self._numbers_width()}} {pressure:>6} st reason"
        )

    def _numbers_width(self) -> int:
        return sum(self._number_widths) + len(self._number_widths) - 1

    def _line(self, name: str, cells: Sequence[str], reading: Reading, result: RevolutionResult) -> str:
        revolution = result.revolution
        numbers = " ".join(f"{cell:<{size}}" for cell, size in zip(cells, self._number_widths, strict=False))
        return (
            f"{pad(name, self._name_width)} {revolution.index:>6} {revolution.start_s:>10.3f} "
            f"{reading.speed.number.value + reading.speed.mark:>7} {fixed(reading.rotation.value, 1):>6} "
            f"{fixed(reading.distance.value, 1) if reading.distance else MISSING:>8} {_cell(reading.leading):>13} "
            f"{_cell(reading.trailing):>12} {numbers:<{self._numbers_width()}} "
            f"{shown_value(_PRESSURE, result.conditions.pressure_pa, 1):>6} {_STATUS_WORDS[reading.status]:<2} "
        )
