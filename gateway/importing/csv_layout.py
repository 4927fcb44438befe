"""Layout of a text file with columns, recognised by its first lines."""

import csv
import itertools
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from gateway.core.errors import ImportDataError
from gateway.importing.column_names import are_units, rate_in_text, sensitivity_in_text
from gateway.importing.csv_columns import PLACEHOLDER, column_names
from gateway.importing.header_conditions import stated_conditions
from gateway.importing.import_map import DELIMITERS, FileLayout

_READ_BYTES: Final = 1 << 17
_LINES: Final = 400
# Another sign for minus is no number to the reader, but the cell is none of a header.
_NUMBER: Final = re.compile(r"[+\-\u2212\u2013]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?|nan|[+-]?inf", re.IGNORECASE)
_FIGURE: Final = re.compile(r"\d[.,]\d")
_DATE: Final = re.compile(
    r"(?:(\d{1,4})[-/. ](\d{1,2}|[a-z]{3})[-/. ](\d{1,4})[T ])?\s*\d{1,2}:\d\d:\d\d(?:[^\d:].*)?", re.IGNORECASE
)
_MERIDIEM: Final = re.compile(r"[ap]\.?m", re.IGNORECASE)
_DECIMAL_COMMA: Final = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?")
_IDENTITY: Final = re.compile(
    r"(?=.)(?:(?:sensor|node|device|dev|imu|channel|wheel|tire|tyre|rad|position|pos|knoten|source|mac|serial)(?:s|_)?)?"
    r"[_ .-]?(?:id|no|nr|num(?:ber)?|name|index|addr(?:ess)?)?",
    re.IGNORECASE,
)
_AXIS_COLUMN: Final = re.compile(r"axis|achse|eje|axe|dir(?:ection)?|richtung|component|channel|kanal", re.IGNORECASE)
_VALUE: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9_:-]*")
_MAX_SENSORS: Final = 16
_COMMENTS: Final = ("#", "%", "//")
_SCORE_TOLERANCE: Final = 0.01
_MAX_HEADER_LINES: Final = 200


@dataclass(frozen=True, slots=True)
class TextLayout:
    """Layout of a text file; of another file, nothing.

    Attributes:
        layout: as in the import map.
        units: text of the line of units, by column; empty without such a line.
        dates: columns of dates with times, or times of day.
        date_order: of year, month and day in them: `ymd`, `dmy`, `mdy`; with `?` where days and months look alike.
        texts: columns of other texts, each with its first.
        rates_hz: sampling rates that the lines above the columns state, by the place of the line.
        stated: conditions that these lines state: key of an import map, its value in TOML, and the place.
        identities: column that states the sensor of each row, with its values; None without one.
        mv_per_g: sensitivity that they state, None where they state none or several.
    """

    layout: FileLayout = field(default_factory=FileLayout)
    units: Mapping[str, str] = field(default_factory=dict)
    dates: frozenset[str] = frozenset()
    date_order: str = "ymd"
    texts: Mapping[str, str] = field(default_factory=dict)
    rates_hz: Mapping[str, float] = field(default_factory=dict)
    stated: Sequence[tuple[str, str, str]] = ()
    mv_per_g: float | None = None
    identities: tuple[str, tuple[str, ...]] | None = None


def recognise_layout(path: Path) -> TextLayout:
    """Return the layout of a text file.

    Raises:
        ImportDataError: it has no lines of numbers.
        OSError: the file cannot be read.
    """
    lines, encoding = _first_lines(path)
    delimiter = _delimiter(lines)
    rows = [_cells(line, delimiter) for line in lines]
    header, start, width = _header(path, lines, rows)
    names = column_names(rows[header]) if header < start else [str(k + 1) for k in range(width)]
    data_rows = [row for row in rows[start:] if len(row) == width]
    has_comma = delimiter != "comma" and any(_DECIMAL_COMMA.fullmatch(cell) for row in data_rows for cell in row)
    layout = FileLayout(
        delimiter=delimiter,
        decimal="," if has_comma else ".",
        encoding=encoding,
        skip_rows=header,
        header=header < start,
        skip_rows_after_header=max(start - header - 1, 0),
    )
    columns = dict(zip(names, zip(*data_rows, strict=True), strict=False))
    _require_axes_apart(path, columns)
    dates = {name for name, cells in columns.items() if any(map(_DATE.fullmatch, cells))}
    head_lines = {f"line {k}": line for k, line in enumerate(lines[:start], 1)}
    sensitivities = set(map(sensitivity_in_text, head_lines.values())) - {None}
    return TextLayout(
        layout,
        units=dict(zip(names, rows[header + 1], strict=True)) if start - header > 1 else {},
        dates=frozenset(dates),
        date_order=_date_order([cell for name in dates for cell in columns[name]]),
        texts={
            name: next(cell for cell in cells if cell and not _NUMBER.fullmatch(cell))
            for name, cells in columns.items()
            if name not in dates and _is_text(cells)
        },
        rates_hz={label: rate_hz for label, line in head_lines.items() if (rate_hz := rate_in_text(line))},
        stated=stated_conditions(head_lines),
        mv_per_g=sensitivities.pop() if len(sensitivities) == 1 else None,
        identities=_identities(path, layout, columns),
    )


def _first_lines(path: Path) -> tuple[list[str], str]:
    """Return the first lines of a text file that are whole, and its encoding."""
    with path.open("rb") as file:
        data = file.read(_READ_BYTES)
    if not data:
        raise ImportDataError(f"{path} is empty", "Check the file.")
    text, encoding = _decoded(data)
    # Only these end a line for the reader; letters of other code pages may look like other ends.
    lines = re.split(r"\r\n|\r|\n", text)[:_LINES]
    return lines[:-1] if len(data) == _READ_BYTES else lines, encoding


def _header(path: Path, lines: Sequence[str], rows: Sequence[list[str]]) -> tuple[int, int, int]:
    """Return the first line of the header and that of the data, which may have no header, and the number of columns."""
    starts = (k for k in range(min(len(rows), _MAX_HEADER_LINES)) if any(rows[k]))
    start = next((k for k in starts if _are_data(rows[k : k + 5])), None)
    if start is None:
        raise ImportDataError(
            f"{path}: no line of the first {len(rows)} consists of numbers{_example(rows)}",
            "Check that it is a text file of columns.",
        )
    width = len(rows[start])
    # A blank line may part the header from the data.
    start = next((k + 1 for k in range(start - 1, -1, -1) if lines[k].strip()), 0)
    return start - _header_lines(lines, rows, start, width), start, width


def _header_lines(lines: Sequence[str], rows: Sequence[list[str]], start: int, width: int) -> int:
    """Return how many lines above the first of the data are of its columns: their names, units, and a remark."""
    head_rows = rows[max(start - 3, 0) : start][::-1]
    count = next((k for k, row in enumerate(head_rows) if len(row) != width or not any(row)), len(head_rows))
    if count == 3 and are_units(head_rows[1]):
        return 3
    # A line of units is directly below that of the names, and has no unit without a name. A remark may have as many
    # commas, and a line that ends a header as many tabs.
    is_remark = count > 1 and _is_comment(lines[start - 2]) and not _is_comment(lines[start - 1])
    if count > 1 and not is_remark and all(name or not unit for unit, name in zip(*head_rows[:2], strict=True)):
        return 2
    return min(count, 1)


def _require_axes_apart(path: Path, columns: Mapping[str, Sequence[str]]) -> None:
    """Check that each row has the values of all axes.

    Raises:
        ImportDataError: a column states the axis that a row is of.
    """
    for name, cells in columns.items():
        if _AXIS_COLUMN.fullmatch(name.strip()) and {cell.lower() for cell in cells} <= {"x", "y", "z"}:
            raise ImportDataError(
                f"{path}: each row has one value, of the axis in its column '{name}'",
                "Write the values of each axis as a column of their own, with one row for each time.",
            )


def _identities(
    path: Path, layout: FileLayout, columns: Mapping[str, Sequence[str]]
) -> tuple[str, tuple[str, ...]] | None:
    """Return the column that states the sensor of each row with its values, None where there is none."""
    for number, (name, cells) in enumerate(columns.items()):
        first = set(cells)
        if not _IDENTITY.fullmatch(name.strip()) or len(first) > _MAX_SENSORS or not all(map(_VALUE.fullmatch, first)):
            continue
        values: dict[str, None] = {}
        # The rows of a sensor may follow those of another.
        with path.open(encoding=layout.encoding, errors="replace") as file:
            for line in itertools.islice(file, layout.skip_rows + layout.header, None):
                row = _cells(line, layout.delimiter)
                if number < len(row) and row[number]:
                    values.setdefault(row[number])
                if len(values) > _MAX_SENSORS:
                    break
        if 1 < len(values) <= _MAX_SENSORS and all(map(_VALUE.fullmatch, values)):
            return name, tuple(values)
    return None


def _is_comment(line: str) -> bool:
    return line.lstrip().startswith(_COMMENTS)


def _example(rows: Sequence[list[str]]) -> str:
    """Return the first cell of a line in the middle that is no number, empty without one."""
    number = len(rows) // 2
    cell = next((cell for cell in rows[number] if cell and not _NUMBER.fullmatch(cell)), "") if rows else ""
    return f"; in line {number + 1}, '{cell[:40]}' is none" if cell else ""


def _date_order(cells: Sequence[str]) -> str:
    """Return the order of year, month and day in dates, with `?` where both orders of day and month are possible."""
    matches = [match for cell in cells if (match := _DATE.fullmatch(cell)) is not None]
    dates = [match for match in matches if match[1] and match[2].isdigit()]
    if all(len(match[1]) == 4 for match in dates):
        return "ymd"
    if any(int(match[1]) > 12 for match in dates):
        return "dmy"
    if any(int(match[2]) > 12 for match in dates):
        return "mdy"
    # Where hours have halves, the month comes first.
    return "mdy?" if any(_MERIDIEM.search(match[0]) for match in dates) else "dmy?"


def _is_text(cells: Sequence[str]) -> bool:
    """Return whether most cells are no numbers: single ones are unreadable, which the reader of the column says.

    A cell with a digit is a number of another notation.
    """
    filled = [cell for cell in cells if cell and not PLACEHOLDER.fullmatch(cell)]
    words = sum(not _NUMBER.fullmatch(cell) and not _FIGURE.search(cell) for cell in filled)
    return words > 0.5 * len(filled)


def _decoded(data: bytes) -> tuple[str, str]:
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        return data.decode("utf-16", "replace"), "utf-16"
    try:
        # The last character may be cut off.
        return data[: len(data) - 4 if len(data) == _READ_BYTES else None].decode("utf-8-sig"), "utf-8"
    except UnicodeDecodeError:
        return data.decode("latin-1"), "latin-1"


def _cells(line: str, delimiter: str) -> list[str]:
    if delimiter == "space":
        return line.split()
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=DELIMITERS[delimiter]), [])]
    except csv.Error:
        return [line]


def _delimiter(lines: list[str]) -> str:
    """Return the delimiter that cuts most lines into the same number of numbers, at least two."""
    delimiter, best_fit = "comma", (0.0, 0)
    for name in ("semicolon", "tab", "pipe", "comma", "space"):
        rows = [row for row in (_cells(line, name) for line in lines if line.strip()) if len(row) > 1]
        if not rows:
            continue
        width = Counter(map(len, rows)).most_common(1)[0][0]
        # A wrong delimiter leaves pieces such as `5;2` between the numbers.
        score = round(sum(_data_share(row) for row in rows if len(row) == width), 1)
        # Single lines of a header, such as `Channels<tab>1`, decide nothing.
        is_close = abs(score - best_fit[0]) <= _SCORE_TOLERANCE * best_fit[0]
        if width > best_fit[1] if is_close else score > best_fit[0]:
            delimiter, best_fit = name, (score, width)
    return delimiter


def _data_share(row: list[str]) -> float:
    """Return the share of numbers and dates among the cells that are not empty."""
    good = sum(bool(_NUMBER.fullmatch(cell) or _DATE.fullmatch(cell)) for cell in row)
    return good / max(sum(map(bool, row)), 1)


def _are_data(rows: Sequence[list[str]]) -> bool:
    """Return whether rows consist of numbers and dates for the larger part, with at least one of them."""
    filled = [row for row in rows if any(row)]
    return bool(filled) and all(_data_share(row) >= 0.5 for row in filled)
