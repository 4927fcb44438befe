"""Reader of numeric columns in MATLAB files up to version 7.2.

scipy's parser can crash the process on a damaged file, so `gateway.importing.reader_process` runs this module.
"""

import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gateway.importing.column_names import rate_of
from gateway.importing.columns import (
    BLOCK_ROWS,
    MAX_MATRIX_COLUMNS,
    Block,
    FileFacts,
    require_equal_lengths,
    row_places,
)
from gateway.importing.header_conditions import stated_conditions
from gateway.importing.matlab_objects import REMEDY, can_read_objects, object_columns, seconds_of

_MAX_DEPTH: Final = 16
# Elements of an array of structs, or of a cell array.
_MAX_STRUCTS: Final = 200


class MatColumns:
    """MATLAB file that is loaded as a whole.

    Columns are vectors `x`, columns of matrices `data(:,2)`, and both inside structs `run.acc(:,2)` and arrays of them
    `run(2).acc`.
    """

    def __init__(self, path: Path) -> None:
        """Load the file.

        Raises:
            Exception: of scipy, where it is no MATLAB file or damaged.
        """
        from scipy.io import loadmat
        from scipy.io.matlab import MatlabOpaque

        self._path = path
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # objects have no name of their own
            content = loadmat(str(path), squeeze_me=True, struct_as_record=False)
        self._columns: dict[str, NDArray[Any]] = {}
        self._unusable: dict[str, tuple[str, str]] = {}
        self._dates: dict[str, int | None] = {}
        self._rates_hz: dict[str, float] = {}
        self._conditions: list[tuple[str, str, str]] = []
        has_objects = content.pop("__function_workspace__", None) is not None
        for name, value in content.items():
            if not name.startswith("__") and not isinstance(value, MatlabOpaque):
                self._add(name, value, 0)
        if has_objects and can_read_objects():
            for name, column in object_columns(path).items():
                if column.dtype.kind == "M":
                    # MATLAB states no zone that this is sure of.
                    self._dates[name], column = None, seconds_of(column)
                self._columns[name] = column
        elif has_objects:
            self._unusable["tables and times"] = ("are MATLAB objects", REMEDY)

    @property
    def facts(self) -> FileFacts:
        """Every numeric vector and matrix column."""
        return FileFacts(
            tuple(self._columns),
            unusable=dict(self._unusable),
            dates=dict(self._dates),
            rates_hz=self._rates_hz,
            stated=self._conditions,
        )

    def blocks(self, names: Sequence[str]) -> Iterator[Block]:
        """Yield the named columns, which must have equal lengths."""
        columns = [self._columns[name] for name in names]
        require_equal_lengths(self._path, {name: len(column) for name, column in zip(names, columns, strict=True)})
        count = len(columns[0]) if columns else 0
        for first in range(0, count, BLOCK_ROWS):
            values = np.column_stack([column[first : first + BLOCK_ROWS] for column in columns]).astype(np.float64)
            yield Block(first, values, row_places(first), min(first + BLOCK_ROWS, count) / count)

    def close(self) -> None:
        """Release the columns."""
        self._columns.clear()

    def _add(self, name: str, value: object, depth: int) -> None:
        fields = getattr(value, "_fieldnames", None)
        if fields is not None and depth < _MAX_DEPTH:
            for field in fields:
                self._add(f"{name}.{field}", getattr(value, field, None), depth + 1)
        elif isinstance(value, int | float) and (rate_hz := rate_of(name, value)) is not None:
            self._rates_hz[name] = rate_hz
        elif isinstance(value, int | float | str):
            self._conditions += stated_conditions({name: f"{name.rpartition('.')[2].replace('_', ' ')}: {value}"[:200]})
        elif isinstance(value, np.ndarray) and value.dtype == object and value.size <= _MAX_STRUCTS:
            for number, element in enumerate(value.ravel(), 1):
                self._add(f"{name}({number})", element, depth + 1)
        elif isinstance(value, np.ndarray) and value.dtype.kind in "iuf":
            if value.ndim == 1:
                self._columns[name] = value
            elif value.ndim == 2 and value.shape[1] <= MAX_MATRIX_COLUMNS:
                self._columns.update({f"{name}(:,{k + 1})": value[:, k] for k in range(value.shape[1])})
            elif value.ndim == 2:
                self._unusable[name] = (
                    f"has {value.shape[0]} rows and {value.shape[1]} columns",
                    f"A column is one quantity: transpose it in MATLAB, {name} = {name}.'; and save again.",
                )
