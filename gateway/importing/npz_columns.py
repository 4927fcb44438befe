"""Reader of the arrays in files of numpy, `.npz` and `.npy`, run by `gateway.importing.reader_process`."""

from pathlib import Path
from typing import Any

import numpy as np

from gateway.core.errors import ImportDataError
from gateway.core.storable_text import storable
from gateway.importing.column_names import rate_of
from gateway.importing.columns import MAX_MATRIX_COLUMNS
from gateway.importing.waveform_columns import Waveform, WaveformColumns


class NpzColumns(WaveformColumns):
    """Arrays, loaded as a whole: vectors `x` and columns of matrices `acc(:,3)`; a number may state the rate."""

    def __init__(self, path: Path) -> None:
        """Load the arrays.

        Raises:
            ImportDataError: the only array is of several dimensions or no numbers.
            Exception: of numpy, where it is no such file or damaged; objects are never unpickled.
        """
        super().__init__(path)
        loaded = np.load(path, allow_pickle=False)
        arrays = {path.stem: loaded} if isinstance(loaded, np.ndarray) else loaded
        for name in arrays:
            try:
                self._add(storable(name), np.asarray(arrays[name]))
            except ValueError as error:
                if "allow_pickle" not in str(error):
                    raise
                self.unusable[storable(name)] = ("contains objects of Python", "Save its values as numbers.")
        if not self.waveforms and self.unusable:
            name, (reason, remedy) = next(iter(self.unusable.items()))
            raise ImportDataError(f"{path}: '{name}' {reason}", remedy)

    def _add(self, name: str, array: Any) -> None:
        if array.dtype.names:
            for field in array.dtype.names:
                self._add(f"{name}.{storable(field)}", array[field])
        elif array.dtype.kind not in "iufb":
            self.unusable[name] = (f"contains {array.dtype}, not numbers", "Save its values as numbers.")
        elif array.size == 1:
            rate_hz = rate_of(name, array.ravel()[0])
            if rate_hz is not None:
                self.rates_hz[name] = rate_hz
        elif array.ndim == 1:
            self.waveforms[name] = Waveform.of(array)
        elif array.ndim == 2 and array.shape[1] <= MAX_MATRIX_COLUMNS:
            for k in range(array.shape[1]):
                self.waveforms[f"{name}(:,{k + 1})"] = Waveform.of(array[:, k])
        else:
            self.unusable[name] = (f"has the shape {array.shape}", "A column is one quantity: save (samples, axes).")
