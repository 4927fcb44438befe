"""Reader of numeric columns in HDF5 files, those of MATLAB 7.3 included; needs the package h5py.

A damaged file can crash the HDF5 library, so `gateway.importing.reader_process` runs this module. Links to other files
are never followed.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from gateway.core.errors import ImportDataError
from gateway.core.storable_text import storable
from gateway.core.types import FloatArray
from gateway.importing.column_names import rate_of
from gateway.importing.columns import (
    BLOCK_ROWS,
    MAX_MATRIX_COLUMNS,
    Block,
    FileFacts,
    require_equal_lengths,
    row_places,
)
from gateway.importing.header_conditions import conditions_in
from gateway.importing.matlab_objects import CLASSES, can_read_objects, object_columns, seconds_of
from gateway.importing.waveform_columns import Waveform, WaveformColumns

if TYPE_CHECKING:
    import h5py

_MAX_DEPTH: Final = 16
_MAX_OBJECTS: Final = 20_000
_MAX_CELLS: Final = 200
# A larger chunk must be unpacked as a whole for its first value.
_MAX_CHUNK_BYTES: Final = 256 << 20
# More bytes than this for each stored one are no measurement; reading them would take forever.
_MAX_EXPANSION: Final = 20_000
_SMALL_BYTES: Final = 64 << 20
_MATLAB_NUMBERS: Final = {
    "double", "single", "logical", "int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64",
}  # fmt: skip
# An `offset` without a unit is that of a calibration.
_START: Final = re.compile(r"(?:wf_)?(?:t_?0|x_?0|(?:start|begin)[_ ]?(?:time|offset)?)(?:_s)?|offset_s", re.IGNORECASE)
_AS_VECTORS: Final = "Save its columns as vectors of numbers."
_MATLAB_TABLE: Final = (
    "MATLAB stores tables, timetables and times in a form of its own. Save vectors instead, such as "
    "t = seconds(T.Time); z = T.z; save('run.mat', 't', 'z', '-v7.3')."
)


@dataclass(frozen=True, slots=True)
class _Column:
    """Place of a column: a vector, a line of a matrix along `axis`, or a field of a compound type.

    Its values are `scale` times what is stored plus `offset`; those in `missing` are none.
    """

    data: Any
    rows: int
    axis: int = 0
    line: int = 0
    field: str | None = None
    scale: float = 1.0
    offset: float = 0.0
    missing: tuple[float, ...] = ()


class Hdf5Columns:
    """HDF5 file, read block by block.

    Columns are datasets `group/x`, columns of matrices `group/data(:,2)` and fields of compound types `table.x`. In
    files of MATLAB 7.3 they have the names of MATLAB: `run.acc(:,2)`, and `c{2}` in cell arrays.
    """

    def __init__(self, path: Path) -> None:
        """List the columns.

        Raises:
            ImportDataError: it has too many objects.
            Exception: of h5py, where it is no HDF5 file or damaged.
        """
        import h5py

        self._path = path
        with path.open("rb") as file:
            self._matlab = file.read(7) == b"MATLAB "
        self._columns: dict[str, _Column] = {}
        self._units: dict[str, str] = {}
        self._unusable: dict[str, tuple[str, str]] = {}
        self._dates: dict[str, int | None] = {}
        self._rates_hz: dict[str, float] = {}
        self._conditions: list[tuple[str, str, str]] = []
        # Datasets that state step and start.
        self._waveforms = WaveformColumns(path)
        self._objects: set[str] = set()
        self._count = 0
        self._file = h5py.File(path, "r")
        self._add_group("", self._file, 0, frozenset())
        self._add_objects()

    @property
    def facts(self) -> FileFacts:
        """Every numeric vector, matrix column and field."""
        return FileFacts(
            tuple(self._columns),
            units=self._units,
            unusable=dict(self._unusable),
            dates=dict(self._dates),
            rates_hz=self._rates_hz,
            stated=self._conditions,
        )

    def blocks(self, names: Sequence[str]) -> Iterator[Block]:
        """Yield the named columns, which must have equal lengths, or be aligned by starts that the file states."""
        waveforms = [self._waveforms.waveforms[name] for name in names if name in self._waveforms.waveforms]
        if len(waveforms) == len(names) and len({waveform.start_s for waveform in waveforms}) > 1:
            yield from self._waveforms.blocks(names)
            return
        columns = [self._columns[name] for name in names]
        require_equal_lengths(self._path, {name: column.rows for name, column in zip(names, columns, strict=True)})
        for name, column in zip(names, columns, strict=True):
            self._check_size(name, column.data)
        count = columns[0].rows if columns else 0
        for first in range(0, count, BLOCK_ROWS):
            end = min(first + BLOCK_ROWS, count)
            values = np.column_stack([_read_rows(column, first, end) for column in columns])
            yield Block(first, values, row_places(first), end / count)

    def close(self) -> None:
        """Close the file."""
        self._columns.clear()
        self._file.close()

    def _add_group(self, prefix: str, group: h5py.Group, depth: int, ancestors: frozenset[int]) -> None:
        import h5py

        address = h5py.h5o.get_info(group.id).addr
        if depth > _MAX_DEPTH or address in ancestors:
            return
        if depth and "MATLAB_sparse" in group.attrs:
            self._unusable[prefix] = ("is a sparse matrix", "Save it as a full one: full(x).")
            return
        self._note_rates(prefix, group)
        separator = "." if self._matlab else "/"
        for key in group:
            if self._matlab and not depth and key.startswith("#"):
                continue
            self._count += 1
            if self._count > _MAX_OBJECTS:
                raise ImportDataError(
                    f"{self._path} has more than {_MAX_OBJECTS} objects", "Copy the columns of one run to a new file."
                )
            name = f"{prefix}{separator}{storable(key)}" if prefix else storable(key)
            try:
                self._add_link(name, group, key, depth, ancestors | {address})
            except (MemoryError, ImportDataError):
                raise
            except Exception as error:  # one damaged object leaves the others
                cause = next(iter(str(error).splitlines()), "")[:200] or type(error).__name__
                self._unusable[name] = (f"is damaged: {cause}", "Write the file again.")

    def _add_link(self, name: str, group: h5py.Group, key: str, depth: int, ancestors: frozenset[int]) -> None:
        import h5py

        if isinstance(group.get(key, getlink=True), h5py.ExternalLink):
            self._unusable[name] = ("is a link to another file", "Copy the data into one file.")
            return
        member = group[key]
        if isinstance(member, h5py.Group):
            self._add_group(name, member, depth + 1, ancestors)
        elif isinstance(member, h5py.Dataset):
            self._add(name, member)

    def _add(self, name: str, data: h5py.Dataset) -> None:
        """Add the columns of a dataset, or the reason why it has none."""
        import h5py

        kind = data.dtype.kind
        matlab_class = _attribute(data, "MATLAB_class") if self._matlab else ""
        if data.shape is None or _attribute(data, "MATLAB_empty") not in ("", "0"):
            return
        if data.external or data.is_virtual:
            self._unusable[name] = ("is stored in another file", "Copy the data into one file.")
        elif missing := _missing_filters(data):
            self._unusable[name] = (
                f"is packed by the HDF5 filter {', '.join(missing)}, which is not installed",
                "Write it without: h5repack -f NONE old.h5 new.h5.",
            )
        elif matlab_class == "cell":
            self._add_cells(name, data)
        elif matlab_class == "char":
            self._unusable[name] = ("is text", _AS_VECTORS)
        elif matlab_class and matlab_class not in _MATLAB_NUMBERS:
            self._unusable[name] = (f"is a MATLAB object of class {storable(matlab_class)}", _MATLAB_TABLE)
            if matlab_class in CLASSES:
                self._objects.add(name)
        elif kind == "c" or set(data.dtype.names or ()) == {"real", "imag"}:
            self._unusable[name] = ("is complex", "Save its real part: real(x).")
        elif data.dtype.names:
            self._add_fields(name, data)
        elif h5py.check_ref_dtype(data.dtype) is not None:
            self._unusable[name] = ("is a list of references", _AS_VECTORS)
        elif kind not in "iufb":
            is_text = kind in "SU" or h5py.check_string_dtype(data.dtype) is not None
            self._unusable[name] = ("is text" if is_text else f"is of type {data.dtype}", _AS_VECTORS)
        else:
            self._add_numbers(name, data)

    def _add_objects(self) -> None:
        """Add the columns of tables and times, which MATLAB stores in a form of its own."""
        if not self._objects or not can_read_objects():
            return
        try:
            columns = object_columns(self._path)
        except ImportDataError:  # they stay named as objects, and the other columns can be used
            return
        for name, column in columns.items():
            self._unusable.pop(name.partition(".")[0], None)
            if column.dtype.kind == "M":
                self._dates[name], column = None, seconds_of(column)
            self._columns[name] = _Column(column, len(column))

    def _note_rates(self, name: str, holder: h5py.Group | h5py.Dataset) -> None:
        """Note the attributes that state a sampling rate."""
        for key in holder.attrs:
            rate_hz = rate_of(key, _attribute(holder, key))
            if rate_hz is not None:
                self._rates_hz[f"{name}@{storable(key)}"] = rate_hz
        self._conditions += conditions_in({storable(key): _attribute(holder, key) for key in holder.attrs}, name)

    def _add_numbers(self, name: str, data: h5py.Dataset) -> None:
        shape = data.shape
        self._note_rates(name, data)
        rate_hz = rate_of(name, np.asarray(data).ravel()[0]) if data.size == 1 else None
        if rate_hz is not None:
            self._rates_hz[name] = rate_hz
        unit = _attribute(data, "units") or _attribute(data, "unit") or _attribute(data, "Units")
        columns = []
        if len(shape) == 1:
            columns = [(name, _Column(data, shape[0]))]
        elif len(shape) == 2 and min(shape) == 1:
            axis = int(np.argmax(shape))
            columns = [(name, _Column(data, shape[axis], axis))] if max(shape) > 1 else []
        elif len(shape) == 2:
            # MATLAB writes columns first: a row of the dataset is a column of the matrix.
            axis = 1 if self._matlab else 0
            if shape[1 - axis] > MAX_MATRIX_COLUMNS:
                self._unusable[name] = (
                    f"has {shape[axis]} rows and {shape[1 - axis]} columns",
                    "A column is one quantity: transpose it, and save again.",
                )
            else:
                columns = [(f"{name}(:,{k + 1})", _Column(data, shape[axis], axis, k)) for k in range(shape[1 - axis])]
        elif shape:
            self._unusable[name] = (f"has {len(shape)} dimensions", _AS_VECTORS)
        step_s = next((1.0 / hz for key in data.attrs if (hz := rate_of(key, _attribute(data, key)))), 0.0)
        start_s = next((_number(_attribute(data, key)) for key in data.attrs if _START.fullmatch(key)), None)
        # The conventions of netCDF.
        scale, offset = (
            next(iter(_numbers(data, key)), usual) for key, usual in (("scale_factor", 1.0), ("add_offset", 0.0))
        )
        missing = (*_numbers(data, "_FillValue"), *_numbers(data, "missing_value"))
        for column_name, place in columns:
            column = replace(place, scale=scale, offset=offset, missing=missing)
            self._columns[column_name] = column
            if start_s is not None:
                read_rows = functools.partial(_read_rows, column)
                self._waveforms.waveforms[column_name] = Waveform(column.rows, read_rows, step_s, unit, start_s)
            if unit:
                self._units[column_name] = storable(unit)

    def _add_fields(self, name: str, data: h5py.Dataset) -> None:
        if len(data.shape) != 1:
            self._unusable[name] = (f"is a table of {len(data.shape)} dimensions", _AS_VECTORS)
            return
        for field in data.dtype.names:
            kind = data.dtype[field]
            column = f"{name}.{storable(field)}"
            if kind.kind in "iufb" and not kind.shape:
                self._columns[column] = _Column(data, data.shape[0], field=field)
            else:
                self._unusable[column] = (f"is of type {kind}", _AS_VECTORS)

    def _add_cells(self, name: str, data: h5py.Dataset) -> None:
        import h5py

        if data.size > _MAX_CELLS or h5py.check_ref_dtype(data.dtype) is not h5py.Reference:
            self._unusable[name] = (f"is a cell array of {data.size} elements", _AS_VECTORS)
            return
        for number, reference in enumerate(np.asarray(data).ravel(), 1):
            cell = self._file[reference] if reference else None
            # A cell array in a cell array could contain itself.
            if isinstance(cell, h5py.Dataset) and _attribute(cell, "MATLAB_class") != "cell":
                self._add(f"{name}{{{number}}}", cell)

    def _check_size(self, name: str, data: h5py.Dataset) -> None:
        """Check that a dataset can be read with bounded memory and in bounded time."""
        if isinstance(data, np.ndarray):
            return
        chunk_bytes = int(np.prod(data.chunks, dtype=object)) * data.dtype.itemsize if data.chunks else 0
        if chunk_bytes > _MAX_CHUNK_BYTES:
            raise ImportDataError(
                f"{self._path}: '{name}' is stored in chunks of {chunk_bytes / 1e6:.0f} MB",
                "Write the file with smaller chunks, such as h5repack -l CHUNK=65536.",
            )
        stored_bytes = data.id.get_storage_size()
        full_bytes = int(np.prod(data.shape, dtype=object)) * data.dtype.itemsize
        if full_bytes > _SMALL_BYTES + _MAX_EXPANSION * stored_bytes:
            raise ImportDataError(
                f"{self._path}: '{name}' claims {data.shape} values, but the file stores {stored_bytes} bytes of them",
                "The file is probably damaged or was not closed. Write it again.",
            )


def _number(text: str) -> float | None:
    """Return a number in a text, None where it is none."""
    try:
        return float(text.strip("[] "))
    except ValueError:
        return None


def _numbers(data: Any, name: str) -> tuple[float, ...]:
    """Return an attribute as numbers, nothing where it holds none."""
    try:
        return tuple(np.asarray(data.attrs.get(name, ()), dtype=np.float64).ravel().tolist())
    except (TypeError, ValueError):
        return ()


def _read_rows(column: _Column, first: int, end: int) -> FloatArray:
    data = column.data
    if column.field is not None:
        values = data.fields(column.field)[first:end]
    elif data.ndim == 1:
        values = data[first:end]
    elif column.axis == 0:
        values = data[first:end, column.line]
    else:
        values = data[column.line, first:end]
    numbers = np.asarray(values, dtype=np.float64)
    if column.missing:
        numbers = np.where(np.isin(numbers, column.missing), np.nan, numbers)
    return numbers * column.scale + column.offset if (column.scale, column.offset) != (1.0, 0.0) else numbers


def _missing_filters(data: h5py.Dataset) -> list[str]:
    """Return the filters of a dataset that this installation cannot undo, by name or number."""
    import h5py

    properties = data.id.get_create_plist()
    filters = [properties.get_filter(k) for k in range(properties.get_nfilters())]
    return [_text_of(name) or str(code) for code, _, _, name in filters if not h5py.h5z.filter_avail(code)]


def _text_of(name: bytes) -> str:
    return "".join(c for c in name.decode("ascii", "replace") if c.isprintable())


def _attribute(data: Any, name: str) -> str:
    """Return an attribute as text, empty where there is none or none that can be read."""
    try:
        value = data.attrs.get(name)
    except Exception:
        return "?"
    if value is None:
        return ""
    if isinstance(value, bytes | np.bytes_):
        return bytes(value).decode("utf-8", "replace")
    return str(value)[:80]
