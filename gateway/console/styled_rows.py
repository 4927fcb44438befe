"""Rows of styled text for the console, without a terminal or a toolkit."""

from collections.abc import Iterable, Sequence
from enum import Enum
from typing import Final

from gateway.console.waveform import Ink, PlotRow
from gateway.core.text.text import crop, width


class Role(Enum):
    """Role of a piece of text, to which the board gives a style; no information is in the style alone."""

    TEXT = "text"
    LABEL = "label"
    VALUE = "value"
    TITLE = "title"
    GOOD = "good"
    WARNING = "warning"
    ALARM = "alarm"
    BAR = "bar"
    FRAME = "frame"
    SELECTED_FRAME = "selected frame"
    LAST = "last"
    AVERAGE = "average"


Run = tuple[str, Role]
Row = tuple[Run, ...]

EMPTY: Final[Row] = ()
_ROLE_OF_INK: Final = {Ink.AXIS: Role.LABEL, Ink.LAST: Role.LAST, Ink.AVERAGE: Role.AVERAGE}


def row_width(row: Row) -> int:
    """Return the width of a row in cells."""
    return width("".join([text for text, _ in row]))


def fit(row: Row, cells: int, fill: Role = Role.TEXT) -> Row:
    """Return a row of exactly `cells` cells, cropped with an ellipsis or padded with blanks."""
    missing = cells - row_width(row)
    if missing > 0:
        return (*row, (" " * missing, fill))
    if missing == 0:
        return row
    fitted: list[Run] = []
    used = 0
    for text, role in row:
        piece = text if used + width(text) < cells else crop(text + " ", cells - used)
        fitted.append((piece, role))
        used += width(piece)
        if used >= cells or piece != text:
            break
    # A wide character may leave one cell free at the cut.
    return (*fitted, (" " * (cells - used), fill)) if used < cells else tuple(fitted)


def spread(left: Row, right: Row, cells: int, fill: Role = Role.TEXT) -> Row:
    """Return a row with `left` and `right` at its ends; the left one is cropped when both do not fit."""
    room = max(cells - row_width(right), 0)
    return fit((*fit(left, room, fill), *right), cells, fill)


def beside(left: Sequence[Row], left_cells: int, right: Sequence[Row], height: int) -> list[Row]:
    """Return `height` rows of two blocks next to each other."""
    return [
        (*fit(left[i] if i < len(left) else EMPTY, left_cells), *(right[i] if i < len(right) else EMPTY))
        for i in range(height)
    ]


def fill_while_fitting(start: Row, fields: Iterable[Run], cells: int, gap: str = "  ") -> Row:
    """Append fields in order of importance until the next one would be cut."""
    row, used = list(start), row_width(start)
    for text, role in fields:
        used += len(gap) + width(text)
        if used > cells:
            break
        row += [(gap, Role.TEXT), (text, role)]
    return tuple(row)


def plot_row(row: PlotRow) -> Row:
    """Convert a row of the waveform plot to a row of the screen."""
    return tuple((text, _ROLE_OF_INK[ink]) for text, ink in row)
