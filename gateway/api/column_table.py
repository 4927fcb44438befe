"""Base of all tables: named numpy columns with units, and their conversion to pandas and Arrow."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from html import escape
from typing import TYPE_CHECKING, Any, ClassVar, Final, Self

import numpy as np
from numpy.typing import NDArray

from gateway.api.table_plot import abscissa_of, drawn
from gateway.core.optional_packages import require_packages
from gateway.core.quantity_catalogue import unit_of as quantity_unit
from gateway.core.table_columns import REVOLUTION_COLUMNS, Column

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow as pa
    from matplotlib.figure import Figure

IndexArray = NDArray[np.int64]
TimeArray = NDArray[np.datetime64]
TextArray = NDArray[np.object_]

METADATA_KEY: Final = b"treadlink"
"""Key of the metadata of an Arrow schema: the values that belong to the whole table, as JSON."""
COLUMN: Final = "column"
"""Key of the metadata of a field that is a column: its description."""

_SHOWN_DIGITS: Final = 6
_BANDS: Final = ("_std", "_scatter")


def column(description: str = "") -> dict[str, str]:
    """Return the metadata that makes a field of a table a column; its unit is the suffix of its name.

    Without a description it has that of the column of this name in the files.
    """
    return {COLUMN: description}


def unit_of(name: str) -> str:
    """Return the unit of a column: that in its name as ASCII text, `m/s^2`, or `UTC` of a time; empty without one."""
    return "UTC" if name.endswith("_utc") else quantity_unit(name)


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class ColumnTable:
    """A table of numpy columns with one row per sample, revolution, reading or estimate.

    Every column is an attribute with its SI unit at the end of its name.

    Attributes:
        recording: name of the recording.
    """

    _rows: ClassVar[str] = "rows"
    _shared: ClassVar[Mapping[str, Column]] = REVOLUTION_COLUMNS

    recording: str

    @classmethod
    def of_rows(cls, rows: Iterable[Sequence[Any]], **others: Any) -> Self:
        """Return a table of rows.

        Args:
            rows: cells in the order of the columns; None is NaN in a column of numbers.
            others: what belongs to the whole table, by name.
        """
        columns = [field for field in fields(cls) if COLUMN in field.metadata]
        cells = list(zip(*rows, strict=True)) or [()] * len(columns)
        arrays: dict[str, Any] = {
            field.name: _MAKERS[str(field.type)](list(values)) for field, values in zip(columns, cells, strict=True)
        }
        return cls(**others, **arrays)

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns."""
        return tuple(self.descriptions)

    @property
    def descriptions(self) -> dict[str, str]:
        """One line of explanation per column."""
        return {
            field.name: field.metadata[COLUMN] or self._shared[field.name].description
            for field in fields(self)
            if COLUMN in field.metadata
        }

    @property
    def units(self) -> dict[str, str]:
        """Unit of each column as ASCII text; empty for numbers without unit, flags and text."""
        return {name: unit_of(name) for name in self.columns}

    @property
    def metadata(self) -> dict[str, Any]:
        """Values that belong to the whole table, such as wheel and sampling rate; NaN and arrays are left out."""
        values = {field.name: getattr(self, field.name) for field in fields(self) if COLUMN not in field.metadata}
        return {
            name: value
            for name, value in values.items()
            if not isinstance(value, np.ndarray) and not (isinstance(value, float) and math.isnan(value))
        }

    def __len__(self) -> int:
        return len(getattr(self, self.columns[0]))

    def __getitem__(self, name: str) -> NDArray[Any]:
        """Return a column by name; raises KeyError for another name."""
        if name not in self.columns:
            raise KeyError(f"there is no column '{name}': the columns are {', '.join(self.columns)}")
        values: NDArray[Any] = getattr(self, name)
        return values

    def to_dict(self) -> dict[str, NDArray[Any]]:
        """Return the columns by name."""
        return {name: self[name] for name in self.columns}

    def to_pandas(self) -> pd.DataFrame:
        """Return a DataFrame; `attrs` has `units`, `descriptions` and the values of the whole table.

        Raises:
            OutputError: pandas is not installed.
        """
        frame = require_pandas().DataFrame({name: _pandas_column(values) for name, values in self.to_dict().items()})
        frame.attrs.update(self._attributes())
        return frame

    def to_arrow(self) -> pa.Table:
        """Return an Arrow table; fields have the metadata `unit` and `description`, the schema has METADATA_KEY.

        Raises:
            OutputError: pyarrow is not installed.
        """
        require_packages("this", "parquet", "pyarrow")
        import pyarrow

        descriptions, units = self.descriptions, self.units
        arrays = {name: _arrow_column(pyarrow, values) for name, values in self.to_dict().items()}
        schema = pyarrow.schema(
            [
                pyarrow.field(name, array.type, metadata={"unit": units[name], "description": descriptions[name]})
                for name, array in arrays.items()
            ],
            metadata={METADATA_KEY: json.dumps(self.metadata, ensure_ascii=False).encode()},
        )
        return pyarrow.table(list(arrays.values()), schema=schema)

    def plot(self, *names: str) -> Figure:
        """Return a matplotlib figure of columns against angle or time, with one axis for each unit.

        Args:
            names: columns with one number a row; none for all that have a unit. A column `x_std_...` or
                `x_scatter_...` is the band of its quantity.

        Raises:
            KeyError: there is no such column.
            OutputError: matplotlib is not installed.
        """
        x = abscissa_of(self.columns)
        numbers = [name for name in self.columns if self[name].ndim == 1 and self[name].dtype.kind == "f"]
        chosen = list(names) or [
            name for name in numbers if name != x and unit_of(name) and not _is_band(name) and unit_of(name) != "s"
        ]
        series = {}
        for name in chosen:
            values = self[name]
            if values.ndim != 1 or values.dtype.kind not in "iufb":
                raise KeyError(f"column '{name}' has no single number a row: {', '.join(numbers)} have")
            band = next((other for other in numbers if _band_of(other) == name), None)
            series[name] = values.astype(np.float64), None if band is None else self[band], unit_of(name)
        return drawn(self[x], f"{x} ({unit_of(x)})", series, self._title())

    def _attributes(self) -> dict[str, Any]:
        return {"units": self.units, "descriptions": self.descriptions, **self.metadata}

    def _selected(self, rows: NDArray[Any] | slice) -> Self:
        """Return a table of some rows."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        return type(self)(**{name: v[rows] if name in self.columns else v for name, v in values.items()})

    def _title(self) -> str:
        """Return the first line of the text form."""
        return f"{len(self)} {self._rows}"

    def _lines(self) -> list[tuple[str, str, str, str]]:
        """Return name, unit, range and description of each column."""
        return [(name, unit, _range(self[name]), self.descriptions[name]) for name, unit in self.units.items()]

    def __repr__(self) -> str:
        lines = self._lines()
        name_width, unit_width, range_width = (max(len(line[column]) for line in lines) for column in range(3))
        rows = [
            f"  {name:<{name_width}}  {unit:<{unit_width}}  {span:<{range_width}}  {text}"
            for name, unit, span, text in lines
        ]
        return "\n".join([f"<{type(self).__name__}: {self._title()}>", *rows])

    def _repr_html_(self) -> str:
        head = "<tr><th>column</th><th>unit</th><th>range</th><th></th></tr>"
        rows = "".join(
            "<tr>" + "".join(f'<td style="text-align:left">{escape(cell)}</td>' for cell in line) + "</tr>"
            for line in self._lines()
        )
        return f"<p><b>{escape(type(self).__name__)}</b>: {escape(self._title())}</p><table>{head}{rows}</table>"


def _band_of(name: str) -> str:
    """Return the column whose error or scatter a column is, empty for any other."""
    return next((name.replace(part, "") for part in _BANDS if part in name), "")


def _is_band(name: str) -> bool:
    return any(part in name for part in _BANDS)


def require_pandas() -> Any:
    """Return pandas.

    Raises:
        OutputError: it is not installed; the remedy names the extra.
    """
    require_packages("this", "pandas", "pandas")
    import pandas

    return pandas


def text_array(values: list[str]) -> TextArray:
    """Return texts as an array of objects, (n,)."""
    array = np.empty(len(values), np.object_)
    array[:] = values
    return array


def utc_array(host_ns: NDArray[np.int64] | list[int]) -> TimeArray:
    """Return ns since the epoch as `datetime64[ns]`, NaT for 0, which stands for an unknown time."""
    times: NDArray[np.int64] = np.asarray(host_ns, np.int64)
    return np.where(times == 0, np.datetime64("NaT", "ns"), times.astype("datetime64[ns]"))


_MAKERS: Final[Mapping[str, Callable[[list[Any]], NDArray[Any]]]] = {
    "FloatArray": lambda values: np.array(values, np.float64),
    "IndexArray": lambda values: np.array(values, np.int64),
    "BoolArray": lambda values: np.array(values, np.bool_),
    "TextArray": text_array,
    "TimeArray": utc_array,
}
"""Makes the array of a column from its cells, by the annotation of the field."""


def _pandas_column(values: NDArray[Any]) -> Any:
    if values.ndim > 1:
        return list(values)
    if values.dtype.kind == "M":
        pandas = require_pandas()
        return pandas.Series(values).dt.tz_localize("UTC")
    return values


def _arrow_column(pyarrow: Any, values: NDArray[Any]) -> Any:
    if values.dtype.kind == "c":
        # Arrow has no complex numbers: real and imaginary part follow each other in the last dimension.
        values = np.stack((values.real, values.imag), axis=-1)
    if values.dtype.kind == "M":
        return pyarrow.array(values, pyarrow.timestamp("ns", tz="UTC"))
    if values.dtype.kind == "O":
        # Stated: without a row it would be null.
        return pyarrow.array(values, pyarrow.string(), from_pandas=True)
    if values.ndim == 1:
        return pyarrow.array(values)
    array = pyarrow.array(np.ascontiguousarray(values).ravel())
    for size in reversed(values.shape[1:]):
        array = pyarrow.FixedSizeListArray.from_arrays(array, int(size))
    return array


def _range(values: NDArray[Any]) -> str:
    """Return the lowest and the highest value as short text."""
    if not len(values):
        return ""
    kind = values.dtype.kind
    if kind == "b":
        return f"{int(values.sum())} true"
    if kind == "O":
        distinct = sorted(set(values.tolist()))
        return ", ".join(distinct) if len(", ".join(distinct)) <= 24 else f"{len(distinct)} different"
    if kind == "M":
        valid = values[~np.isnat(values)]
        return f"{str(valid.min())[:19]} .. {str(valid.max())[11:19]}" if len(valid) else "unknown"
    numbers = np.abs(values) if kind == "c" else values
    valid = numbers[np.isfinite(numbers)]
    if not len(valid):
        return "unknown"
    return f"{valid.min():.{_SHOWN_DIGITS}g} .. {valid.max():.{_SHOWN_DIGITS}g}"
