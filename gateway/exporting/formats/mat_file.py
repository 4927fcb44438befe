"""MATLAB file of version 5: a structure for each wheel, with the times and columns that a timetable is made of.

The layout of the elements is that of "MAT-File Format", MathWorks, Version 5.
"""

import re
import struct
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Final

from gateway import __version__
from gateway.core.errors import OutputError
from gateway.core.table_columns import Column
from gateway.exporting.column_file import ColumnFile, ColumnwiseExport
from gateway.exporting.export_table import DTYPES, Cell, WheelTable

TIME: Final = "time_s"
"""Column that becomes the row times of a timetable."""
MOST_BYTES: Final = (1 << 31) - 1
"""Largest variable of the format."""

_INT8, _UINT8, _UINT16, _INT32, _UINT32, _DOUBLE, _INT64, _MATRIX = 1, 2, 4, 5, 6, 9, 12, 14
_CELL_CLASS, _STRUCT_CLASS, _CHAR_CLASS, _LOGICAL_CLASS = 1, 2, 4, 9 | 0x200
# class and element type
_NUMBERS: Final = {float: (6, _DOUBLE), int: (14, _INT64), bool: (_LOGICAL_CLASS, _UINT8)}
# MATLAB shortens longer names.
_NAME_BYTES: Final = 64


class MatExport(ColumnwiseExport):
    """Variables by wheel, each a structure with `Time`, `Data`, `Units`, `Descriptions` and `Conditions`."""

    def end(self) -> None:
        """Write the file.

        Raises:
            OutputError: a wheel has more data than a variable of the format can hold.
        """
        title = f"MATLAB 5.0 MAT-file, written by treadlink {__version__}".encode().ljust(116)
        self.target.file.write(title + bytes(8) + struct.pack("<H", 0x0100) + b"IM")
        names = identifiers(table.wheel for table in self.tables)
        for table in self.tables:
            variable = _variable(names[table.wheel], table, self.files[table.wheel])
            if variable.size > MOST_BYTES:
                raise OutputError(
                    f"the table of {table.wheel} takes {variable.size / 1e9:.1f} GB, and a variable of a MAT file of "
                    f"version 5 at most {MOST_BYTES / 1e9:.1f} GB",
                    "Export to Parquet, MF4 or npz, or fewer data: one wheel, or orders instead of samples.",
                )
            for data in variable.parts:
                self.target.file.write(data)
        self.discard()


def identifiers(names: Iterable[str]) -> dict[str, str]:
    """Return a distinct MATLAB name for each name, `hub0_wheel2` for `hub0.wheel2`."""
    identifier_of: dict[str, str] = {}
    for name in names:
        plain = re.sub(r"\W", "_", name.replace("/", "_over_"), flags=re.ASCII)
        plain = (plain if plain[:1].isalpha() else f"x{plain}")[: _NAME_BYTES - 5]
        number, identifier = 1, plain
        while identifier in identifier_of.values():
            number += 1
            identifier = f"{plain}_{number}"
        identifier_of[name] = identifier
    return identifier_of


class _Element:
    """Data element with its size in bytes; the parts are made when they are written."""

    def __init__(self, size: int, parts: Iterable[bytes]) -> None:
        self.size = size
        self.parts = parts


def _plain(kind: int, data: bytes) -> _Element:
    return _streamed(kind, len(data), [data])


def _streamed(kind: int, size: int, data: Iterable[bytes]) -> _Element:
    padding = -size % 8

    def parts() -> Iterator[bytes]:
        yield struct.pack("<II", kind, size)
        yield from data
        yield bytes(padding)

    return _Element(8 + size + padding, parts())


def _matrix(array_class: int, rows: int, columns: int, name: str, content: Sequence[_Element]) -> _Element:
    head = [
        _plain(_UINT32, struct.pack("<II", array_class, 0)),
        _plain(_INT32, struct.pack("<ii", rows, columns)),
        _plain(_INT8, name.encode("ascii")),
    ]
    elements = [*head, *content]
    size = sum(element.size for element in elements)

    def parts() -> Iterator[bytes]:
        yield struct.pack("<II", _MATRIX, size)
        for element in elements:
            yield from element.parts

    return _Element(8 + size, parts())


def _text(text: str) -> _Element:
    data = text.encode("utf-16-le")
    length = len(data) // 2
    return _matrix(_CHAR_CLASS, min(length, 1), length, "", [_plain(_UINT16, data)])


def _scalar(value: Cell) -> _Element:
    if isinstance(value, str):
        return _text(value)
    if isinstance(value, int):
        array_class, kind = _NUMBERS[int]
        return _matrix(array_class, 1, 1, "", [_plain(kind, struct.pack("<q", value))])
    array_class, kind = _NUMBERS[float]
    return _matrix(array_class, 1, 1, "", [_plain(kind, struct.pack("<d", value))])


def _structure(fields: Mapping[str, _Element], name: str = "") -> _Element:
    names = b"".join(field.encode("ascii").ljust(_NAME_BYTES, b"\0") for field in fields)
    # The short form of an element: Octave reads no other one here.
    length = _Element(8, [struct.pack("<HHi", _INT32, 4, _NAME_BYTES)])
    head = [length, _plain(_INT8, names)]
    return _matrix(_STRUCT_CLASS, 1, 1, name, [*head, *fields.values()])


def _column(column: Column, file: ColumnFile) -> _Element:
    if column.kind is str:
        # Two passes, since the size stands before the cells.
        size = sum(_text(text.decode()).size for text in file.texts(column))
        cells = _Element(size, (part for text in file.texts(column) for part in _text(text.decode()).parts))
        return _matrix(_CELL_CLASS, file.rows, 1, "", [cells])
    array_class, kind = _NUMBERS[column.kind]
    size = file.rows * DTYPES[column.kind].itemsize
    return _matrix(array_class, file.rows, 1, "", [_streamed(kind, size, file.stored(column))])


def _variable(name: str, table: WheelTable, file: ColumnFile) -> _Element:
    columns = [column for column in table.columns if column.name != TIME]
    names = identifiers(column.name for column in columns)
    conditions = identifiers(condition.name for condition in table.conditions)
    fields: dict[str, _Element] = {}
    for column in table.columns:
        if column.name == TIME:
            fields["Time"] = _column(column, file)
    fields["Data"] = _structure({names[column.name]: _column(column, file) for column in columns})
    fields["Units"] = _structure({names[column.name]: _text(column.unit) for column in columns})
    fields["Descriptions"] = _structure({names[column.name]: _text(column.description) for column in columns})
    fields["Conditions"] = _structure({conditions[entry.name]: _scalar(entry.value) for entry in table.conditions})
    fields["Sources"] = _structure({conditions[entry.name]: _text(entry.source) for entry in table.conditions})
    return _structure(fields, name)
