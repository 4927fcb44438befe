"""Rows of a measurement in physical units at the rate of the recording."""

from dataclasses import dataclass

import numpy as np

from gateway.core.types import FloatArray
from gateway.importing.columns import Block
from gateway.importing.decimation import Decimator
from gateway.importing.import_map import ImportedWheel, ImportMap


@dataclass(frozen=True, slots=True)
class WheelColumns:
    """Places of a wheel's quantities among the columns of a row.

    Attributes:
        axes: columns of the axes, in the protocol's order.
        slow: columns of pressure and temperature, None where not measured.
    """

    axes: slice
    slow: tuple[int | None, int | None]


class SampleRows:
    """Conversion of the columns of a file: axes in m/s^2 in the protocol's direction, decimated where necessary.

    The columns are those of the map: first the axes of all wheels, then all others unchanged.
    """

    def __init__(self, import_map: ImportMap, factor: int) -> None:
        """Prepare the conversion.

        Args:
            import_map: meaning of the columns.
            factor: decimation, 1 for none.
        """
        axes = import_map.axis_columns()
        self._offsets = np.array([column.offset for column in axes])
        self._factors_mps2 = np.array([column.factor_mps2 for column in axes])
        limits = [column.full_scale_mps2 for column in axes]
        self._decimator = Decimator(factor, len(axes), np.array([np.inf if top is None else top for top in limits]))
        names = import_map.columns()
        self.wheels: list[WheelColumns] = []
        first_column = 0
        for wheel in import_map.wheels():
            count = len(wheel.axis.present())
            self.wheels.append(WheelColumns(slice(first_column, first_column + count), _slow(wheel, names)))
            first_column += count

    def feed(self, values: FloatArray) -> FloatArray:
        """Return the (m, columns) rows that are complete after n more of the file.

        Args:
            values: (n, columns) of the file.
        """
        scaled = values.copy()
        count = len(self._offsets)
        scaled[:, :count] = (values[:, :count] - self._offsets) * self._factors_mps2
        return self._decimator.feed(scaled)

    def finish(self, columns: int) -> FloatArray:
        """Return the (m, columns) rows that remain after the last of the file."""
        return self._decimator.feed(np.empty((0, columns)), last=True)


def kept_rows(block: Block, skipped: int) -> FloatArray:
    """Return the rows of a block after the first `skipped` ones of the file."""
    return block.values[max(skipped - block.first_row, 0) :]


def _slow(wheel: ImportedWheel, names: tuple[str, ...]) -> tuple[int | None, int | None]:
    pressure, temperature = (None if name is None else names.index(name) for name in wheel.slow_columns())
    return pressure, temperature
