"""Columns of a MATLAB file: vectors `x`, columns of matrices `data(:,2)`, and both inside structs `run.acc(:,2)`."""

from __future__ import annotations

import zlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gateway.errors import ImportDataError
from gateway.importing.columns import BLOCK_ROWS, Block
from gateway.importing.import_map import FileLayout


class MatColumns:
    """Reads MATLAB files up to version 7.2. The format cannot be read in parts: the file must fit into memory."""

    def __init__(self, path: Path, layout: FileLayout) -> None:  # noqa: ARG002 - the readers' common signature
        """Load the file.

        Raises:
            ImportDataError: it is not a MATLAB file that can be read, or has no numbers.
            OSError: the file cannot be read.
        """
        from scipy.io import loadmat
        from scipy.io.matlab import MatReadError

        with path.open("rb") as file:
            start = file.read(128)
        self._path = path
        if not start:
            raise ImportDataError(f"{path} is empty", "Check the file.")
        if b"MATLAB 7.3" in start or start.startswith(b"\x89HDF"):
            raise ImportDataError(
                f"{path} is a MATLAB 7.3 (HDF5) file, which is not read", "Save it with save('file.mat', '-v7')."
            )
        try:
            content = loadmat(str(path), squeeze_me=True, struct_as_record=False)
        except (MatReadError, ValueError, TypeError, NotImplementedError, IndexError, OSError, zlib.error) as error:
            raise ImportDataError(f"{path} is not a MATLAB file that can be read: {error}", "Save it anew.") from error
        self._columns: dict[str, NDArray[Any]] = {}
        for name, value in content.items():
            if not name.startswith("__"):
                self._add(name, value)

    @property
    def names(self) -> tuple[str, ...]:
        """Every numeric vector and matrix column."""
        return tuple(self._columns)

    def blocks(self, names: Sequence[str]) -> Iterator[Block]:
        """Yield the named columns, which must be of one length."""
        columns = [self._columns[name] for name in names]
        lengths = {name: len(column) for name, column in zip(names, columns, strict=True)}
        if len(set(lengths.values())) > 1:
            found = ", ".join(f"{name} has {length}" for name, length in lengths.items())
            raise ImportDataError(
                f"{self._path}: the columns differ in length: {found}", "Resample them to one rate before importing."
            )
        count = len(columns[0]) if columns else 0
        for first in range(0, count, BLOCK_ROWS):
            values = np.column_stack([column[first : first + BLOCK_ROWS] for column in columns]).astype(np.float64)
            yield Block(
                first,
                values,
                lambda k, first=first: f"row {first + k + 1}",  # type: ignore[misc]
                min(first + BLOCK_ROWS, count) / count,
            )

    def _add(self, name: str, value: object) -> None:
        fields = getattr(value, "_fieldnames", None)
        if fields is not None:
            for field in fields:
                self._add(f"{name}.{field}", getattr(value, field))
        elif isinstance(value, np.ndarray) and value.dtype.kind in "iuf":
            if value.ndim == 1:
                self._columns[name] = value
            elif value.ndim == 2:
                self._columns.update({f"{name}(:,{k + 1})": value[:, k] for k in range(value.shape[1])})
