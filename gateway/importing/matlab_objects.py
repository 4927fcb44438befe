"""Columns of MATLAB tables, timetables, datetimes and durations, by the package mat-io; loaded as a whole."""

import warnings
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gateway.core.errors import ImportDataError

CLASSES: Final = ("table", "timetable", "datetime", "duration")
"""Classes of MATLAB that are read."""
REMEDY: Final = "Run: pip install 'treadlink[formats]', which brings mat-io; or save vectors, such as z = T.z."


def can_read_objects() -> bool:
    """Return whether the package is installed."""
    return find_spec("matio") is not None


def object_columns(path: Path) -> dict[str, NDArray[Any]]:
    """Return every column in the tables, datetimes and durations of a file: `T.z`, and `T.Time` of a timetable.

    Durations are in seconds, datetimes are `datetime64[ns]`.

    Raises:
        ImportDataError: the file cannot be read.
    """
    from matio import load_from_mat

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            content = load_from_mat(str(path))
    except (MemoryError, OSError):
        raise
    except Exception as error:  # the package raises whatever a damaged file makes it stumble over
        raise ImportDataError(
            f"{path}: its MATLAB objects cannot be read: {error or type(error).__name__}", "Save vectors instead."
        ) from error
    columns: dict[str, NDArray[Any]] = {}
    for name, value in content.items():
        if not name.startswith("__"):
            columns.update(_columns(name, value))
    return columns


def seconds_of(dates: NDArray[Any]) -> NDArray[np.float64]:
    """Return (n,) datetimes as seconds from the first, NaN where there is none."""
    valid_dates = dates[~np.isnat(dates)]
    steps = dates - (valid_dates[0] if len(valid_dates) else np.datetime64(0, "ns"))
    seconds: NDArray[np.float64] = np.where(np.isnat(steps), np.nan, steps.astype(np.int64) * 1e-9)
    return seconds


def _columns(name: str, value: Any) -> Iterator[tuple[str, NDArray[Any]]]:
    if hasattr(value, "columns") and hasattr(value, "index"):
        if value.index.dtype.kind in "mM":
            yield from _columns(f"{name}.{value.index.name or 'Time'}", value.index.to_numpy())
        for column in value.columns:
            array = value[column].to_numpy()
            if array.dtype.kind in "iufbmM":
                yield from _columns(f"{name}.{column}", array)
    elif isinstance(value, np.ndarray) and value.dtype.kind in "mM" and value.size > 1:
        times = value.ravel().astype("datetime64[ns]" if value.dtype.kind == "M" else "timedelta64[ns]")
        yield name, times if value.dtype.kind == "M" else times.astype(np.int64) * 1e-9
    elif isinstance(value, np.ndarray) and value.dtype.kind in "iufb" and value.ndim == 1 and "." in name:
        yield name, value
