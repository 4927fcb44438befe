"""NumPy archive: an array for every column, `FL/radial_mps2`, and the units and conditions as JSON."""

import io
import json
import zipfile
from collections.abc import Iterable, Sequence
from typing import Final

import numpy as np

from gateway.core.table_columns import Column
from gateway.exporting.column_file import ColumnwiseExport
from gateway.exporting.export_table import DTYPES, WheelTable, described

ABOUT: Final = "about"
"""Name of the array with units, descriptions and conditions: one JSON text."""


class NpzExport(ColumnwiseExport):
    """Archive for `numpy.load`, compressed; text is stored in fixed width, unknown numbers are NaN."""

    def end(self) -> None:
        """Write the archive."""
        with zipfile.ZipFile(self.target.file, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
            metadata = np.array(json.dumps(_metadata(self.tables)))
            _put(archive, ABOUT, metadata.dtype, (), [metadata.tobytes()])
            for table in self.tables:
                for column in table.columns:
                    self._put_column(archive, table.wheel, column)
        self.discard()

    def _put_column(self, archive: zipfile.ZipFile, wheel: str, column: Column) -> None:
        file = self.files[wheel]
        name = f"{wheel.replace('/', '_')}/{column.name.replace('/', '_over_')}"
        if column.kind is not str:
            dtype = DTYPES[column.kind].newbyteorder("<")
            _put(archive, name, dtype, (file.rows,), file.stored(column))
            return
        # A character takes at least one byte of UTF-8, so that no text is cut off.
        text = np.dtype(f"<U{max(file.longest_text[column.name], 1)}")
        cells = (np.array(cell.decode(), text).tobytes() for cell in file.texts(column))
        _put(archive, name, text, (file.rows,), cells)


def _put(
    archive: zipfile.ZipFile, name: str, dtype: np.dtype[np.generic], shape: tuple[int, ...], data: Iterable[bytes]
) -> None:
    head = io.BytesIO()
    description = np.lib.format.dtype_to_descr(dtype)
    np.lib.format.write_array_header_1_0(head, {"descr": description, "fortran_order": False, "shape": shape})
    # A date of 1980 makes the same recording give the same file.
    entry = zipfile.ZipInfo(f"{name}.npy")
    entry.compress_type = zipfile.ZIP_DEFLATED
    with archive.open(entry, "w", force_zip64=True) as file:
        file.write(head.getvalue())
        for piece in data:
            file.write(piece)


def _metadata(tables: Sequence[WheelTable]) -> dict[str, object]:
    return {
        "columns": {
            column.name: {"unit": column.unit, "description": column.description} for column in tables[0].columns
        },
        "conditions": described(tables),
    }
