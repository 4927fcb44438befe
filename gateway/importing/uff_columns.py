"""Reader of time signals in universal files (UFF, dataset 58, text and binary); needs the package pyuff."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np

from gateway.core.errors import ImportDataError
from gateway.importing.waveform_columns import Waveform, WaveformColumns

_FUNCTIONS: Final = 58
_TIME_RESPONSE: Final = (0, 1)
# Directions of a degree of freedom in the format.
_DIRECTIONS: Final = {
    0: "",
    **{k * sign: f"{'-' if sign < 0 else ''}{axis}" for k, axis in enumerate("XYZ", 1) for sign in (1, -1)},
}
_NO_NAME: Final = ("", "none", "time response")


class UffColumns(WaveformColumns):
    """Universal file, loaded as a whole.

    Columns have the name in the first line of their dataset, or else node and direction of the response, `12 Z`.
    """

    def __init__(self, path: Path) -> None:
        """Load the signals.

        Raises:
            ImportDataError: it has no time signals.
            Exception: of pyuff, where it is no universal file or damaged.
        """
        import pyuff

        super().__init__(path)
        with _well_formed(path) as readable:
            file = pyuff.UFF(str(readable))
            numbers = [k for k, kind in enumerate(file.get_set_types()) if int(kind) == _FUNCTIONS]
            sets = [_dataset(path, file, k) for k in numbers]
        if not sets:
            raise ImportDataError(f"{path} has no dataset 58", "Export the time signals as universal file, dataset 58.")
        for number, dataset in enumerate(sets, 1):
            self._add(self._name(dataset, number), dataset)

    def _name(self, dataset: dict[str, Any], number: int) -> str:
        """Return a name for a dataset that no other has."""
        name = str(dataset.get("id1") or "").strip()
        if name.lower() in _NO_NAME:
            direction = _DIRECTIONS.get(int(dataset.get("rsp_dir") or 0), "")
            name = f"{int(dataset.get('rsp_node') or 0)} {direction}".strip()
        return name if name not in self.waveforms and name not in self.unusable else f"{name} (set {number})"

    def _add(self, name: str, dataset: dict[str, Any]) -> None:
        values = np.asarray(dataset.get("data"))
        if int(dataset.get("func_type") or 0) not in _TIME_RESPONSE:
            self.unusable[name] = ("is no time signal", "Export the time signals themselves.")
        elif values.ndim != 1 or values.dtype.kind not in "iuf":
            self.unusable[name] = ("contains no real numbers", "Export the time signals themselves.")
        elif not int(dataset.get("abscissa_spacing") or 0):
            self.unusable[name] = ("has times of its own for each value", "Export it with an even spacing.")
        else:
            stated_rows = int(dataset.get("num_pts") or 0)
            self.waveforms[name] = Waveform(
                # Other programs fill the last line with zeros.
                rows=min(len(values), stated_rows or len(values)),
                read=lambda first, end: values[first:end].astype(np.float64),
                step_s=float(dataset.get("abscissa_inc") or 0.0),
                unit=_unit(dataset),
                start_s=float(dataset.get("abscissa_min") or 0.0),
                stated_rows=stated_rows,
            )


def _dataset(path: Path, file: Any, number: int) -> dict[str, Any]:
    try:
        dataset: dict[str, Any] = file.read_sets(number)
    except Exception as error:  # pyuff raises one of its own, behind what it has stumbled over
        cause = error.__context__ or error
        raise ImportDataError(
            f"{path}: dataset {number + 1} is not as dataset 58 prescribes: {cause}",
            "Numbers in text have columns of 13 or 20 characters. Export it again, as binary (58b) if possible.",
        ) from error
    return dataset


@contextmanager
def _well_formed(path: Path) -> Iterator[Path]:
    """Yield a file that pyuff can read: without blanks behind values, and ended where it is cut off.

    Binary datasets contain any bytes; a file of them is left as it is.
    """
    data = path.read_bytes()
    lines = data.splitlines()
    if any(line.strip().startswith(b"58b") for line in lines):
        yield path
        return
    is_cut = any(line.strip() for line in lines) and next(filter(bytes.strip, reversed(lines))).strip() != b"-1"
    text = [line.rstrip() for line in lines]
    if is_cut:
        # Of the last value some digits may be missing.
        text[-1] = text[-1].rpartition(b" ")[0].rstrip()
        text.append(b"    -1")
    if not is_cut and text == lines:
        yield path
        return
    with TemporaryDirectory() as folder:
        repaired = Path(folder) / "whole.uff"
        repaired.write_bytes(b"\n".join(text) + b"\n")
        yield repaired


def _unit(dataset: dict[str, Any]) -> str:
    unit = str(dataset.get("ordinate_axis_units_lab") or "").strip()
    return "" if unit.upper() == "NONE" else unit
