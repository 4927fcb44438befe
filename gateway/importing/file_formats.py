"""Choice of the reader of a measurement file, by the map or by the suffix."""

import logging
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from gateway.core.errors import ImportDataError, reading_remedy
from gateway.core.feature import Registry
from gateway.core.nearest_name import missing_path_remedy
from gateway.core.plugins import Plugin, PluginStatus, load, missing_members, statuses
from gateway.core.reasons import CoreCode, Reason
from gateway.importing.columns import Block, ColumnReader, FileFacts
from gateway.importing.csv_columns import CsvColumns
from gateway.importing.import_map import ISO, SUFFIXES, FileFormat, ImportMap
from gateway.importing.iso_times import IsoTimes
from gateway.importing.reader_process import ProcessColumns, ReaderProcesses

_SUFFIXES: Final = ", ".join(SUFFIXES)
_UNPACK: Final = "Unpack the file first, then import what is in it."
_TO_CSV: Final = "Export the columns as CSV in the program that wrote the file, and import that."
# Files that are often tried, and the way from each to one that can be imported.
_REMEDIES: Final[dict[str, str]] = {
    ".tar": _UNPACK,
    **dict.fromkeys((".xls", ".ods", ".bin"), _TO_CSV),
    ".mcap": "This is a recording already. Run: treadlink estimate {name}",
    ".toml": "This is a configuration. Give the measurement as FILE and the map with --map.",
}

PLUGIN_NAMES_TAKEN: Final = tuple(suffix.removeprefix(".") for suffix in SUFFIXES)
"""Suffixes of this package, which plug-ins cannot take."""
_START_BYTES: Final = 4096
_MCAP: Final = b"\x89MCAP0\r\n"
_EXPORT: Final = (
    "this is an MCAP file of `treadlink export`, which is not read again",
    "Give the recording that it is of, or export samples to CSV or MF4, which can be imported.",
)
_RECORDING: Final = ("this is a recording already", "Run: treadlink estimate {name}")
# First bytes of files, whatever their suffix is.
_FIRST_BYTES: Final = {
    b"MDF ": FileFormat.MF4,
    b"UnFinMF ": FileFormat.MF4,
    b"\x89HDF\r\n\x1a\n": FileFormat.HDF5,
    b"MATLAB ": FileFormat.MAT,
    b"TDSm": FileFormat.TDMS,
    b"PAR1": FileFormat.PARQUET,
    b"\x1a\x45\xdf\xa3": FileFormat.IDE,
    b"|CF,2": FileFormat.FAMOS,
    b"\x93NUMPY": FileFormat.NPZ,
    b"**HEADER": FileFormat.TYDEX,
}
_BUS: Final = "Record its signals: treadlink record SOURCE can:{name}."
_TO_MCAP: Final = "Convert it to MCAP, with Imu messages: mcap convert {name} OUT.mcap."
# First bytes of files that are no measurement, or not yet: what they are, and the way to one.
_NO_MEASUREMENT: Final = {
    **dict.fromkeys((b"LOGG", b"date ", b";$FILEVERSION"), (" is a log of a CAN bus", _BUS)),
    b'VERSION "': (
        " names the signals of a CAN bus",
        "Give it with a log: treadlink record SOURCE can:LOG?dbc={name}.",
    ),
    b"#ROSBAG": (" is a bag of ROS 1", _TO_MCAP),
    b"SQLite format 3": (" is an SQLite database, as bags of ROS 2 are", _TO_MCAP),
    b"TDSh": (" is the index of a TDMS file", "Give the .tdms file beside it."),
    b"\xd4\xc3\xb2\xa1": (" is a capture of network packets", _TO_CSV),
    b"\xd0\xcf\x11\xe0": (" is a document of an old Office", _TO_CSV),
    b"{": (" is JSON", _TO_CSV),
    **dict.fromkeys(
        (b"\x1f\x8b", b"BZh", b"\xfd7zXZ", b"\x28\xb5\x2f\xfd", b"7z\xbc\xaf", b"Rar!", b"PK\x03\x04"),
        (" is packed", _UNPACK),
    ),
}
_UNIVERSAL: Final = re.compile(rb"\s*-1\s*\r?\n\s*(?:15|18|55|58b?|82|151|164|2411|2412)\b")
_logger = logging.getLogger(__name__)


class PluginReader:
    """A reader of a plug-in, whose faults end its own import only; follows `columns.ColumnReader`."""

    def __init__(self, path: Path, open_reader: Callable[[Path], ColumnReader]) -> None:
        """Open a file.

        Raises:
            ImportDataError: the reader fails; also for all other methods.
            OSError: the system refuses.
        """
        self._path = path
        with self._named_errors():
            self._reader = open_reader(path)

    @property
    def facts(self) -> FileFacts:
        """Statements of the file about its columns."""
        with self._named_errors():
            facts: object = self._reader.facts
        if not isinstance(facts, FileFacts):
            raise self._plugin_error(f"facts is {type(facts).__name__}, not FileFacts")
        return facts

    def blocks(self, names: Sequence[str]) -> Iterator[Block]:
        """Yield the named columns from the first row on."""
        with self._named_errors():
            blocks = iter(self._reader.blocks(names))
        while True:
            with self._named_errors():
                block = next(blocks, None)
            if block is None:
                return
            yield self._checked(block, names)

    def sample(self, names: Sequence[str]) -> Block | None:
        """Return rows that show what the columns are."""
        with self._named_errors():
            block = self._reader.sample(names)
        return None if block is None else self._checked(block, names)

    def close(self) -> None:
        """Release the file; what fails here has no consequence."""
        with suppress(ImportDataError), self._named_errors():
            self._reader.close()

    def _checked(self, block: object, names: Sequence[str]) -> Block:
        if not isinstance(block, Block):
            raise self._plugin_error(f"a block is {type(block).__name__}, not Block")
        values: Any = block.values
        if not isinstance(values, np.ndarray) or values.ndim != 2 or values.shape[1] != len(names):
            raise self._plugin_error(f"a block has the shape {np.shape(values)}, not (rows, {len(names)})")
        if values.dtype.kind not in "fiu":
            raise self._plugin_error(f"a block has values of type {values.dtype}, not numbers")
        return replace(block, values=values.astype(np.float64, copy=False))

    @contextmanager
    def _named_errors(self) -> Iterator[None]:
        try:
            yield
        except (ImportDataError, OSError):
            raise
        except (Exception, SystemExit) as error:  # code of others may raise anything
            _logger.debug("reader of a plug-in failed", exc_info=error)
            raise self._plugin_error(f"{type(error).__name__}: {error}") from error

    def _plugin_error(self, text: str) -> ImportDataError:
        return ImportDataError(f"{self._path} cannot be read: {text}", "Check the file, or update the plug-in.")


def recognised_format(path: Path) -> FileFormat | None:
    """Return the format of a file by its first bytes, or else by its suffix; None when both are unknown.

    Raises:
        ImportDataError: it is a recording of treadlink, or an MCAP file that treadlink has exported.
        OSError: the system refuses.
    """
    by_suffix = SUFFIXES.get(path.suffix.lower())
    if not path.is_file():
        return by_suffix
    with path.open("rb") as file:
        start = file.read(_START_BYTES)
        # A zip file lists its parts at its end.
        file.seek(max(path.stat().st_size - _START_BYTES, 0))
        end = file.read()
    if start.startswith(_MCAP):
        if b"treadlink.export" in start:
            raise ImportDataError(f"{path}: {_EXPORT[0]}", _EXPORT[1])
        if b"treadlink" in start:
            raise ImportDataError(f"{path}: {_RECORDING[0]}", _RECORDING[1].replace("{name}", path.name))
        return FileFormat.IMU
    by_content = _by_content(start, end)
    is_zip_or_text = by_suffix in (FileFormat.NPZ, FileFormat.XLSX) or start.startswith((b"{", b"date "))
    if by_content is None and _no_measurement(start) is not None and not is_zip_or_text:
        return None
    # A MATLAB file of version 7.3 is HDF5 behind its own header.
    if by_content is FileFormat.HDF5 and by_suffix is FileFormat.MAT:
        return by_suffix
    return by_content or by_suffix


def _by_content(start: bytes, end: bytes) -> FileFormat | None:
    if start[:4] == b"RIFF" and start[8:12] == b"WAVE":
        return FileFormat.WAV
    if start.startswith(b"PK\x03\x04") and b"[Content_Types].xml" in start + end:
        return FileFormat.XLSX
    if _UNIVERSAL.match(start):
        return FileFormat.UFF
    if b"[column names]" in start.lower() and b"[header]" in start.lower():
        return FileFormat.VBO
    return next((file_format for magic, file_format in _FIRST_BYTES.items() if start.startswith(magic)), None)


def open_columns(
    path: Path,
    import_map: ImportMap,
    processes: ReaderProcesses | None = None,
    rows_of: tuple[str, str] | None = None,
) -> ColumnReader:
    """Open a measurement file in the format stated by the map, or else given by the suffix.

    Args:
        path: measurement.
        import_map: layout of the file, and its column of ISO times.
        processes: supply of processes for formats that need one; None for a new process.
        rows_of: column of a text file and the text that it has in the rows to read; None for all rows.

    Raises:
        ImportDataError: there is no such file, its format is unknown or needs a missing package, or it cannot be read.
    """
    if path.is_dir():
        raise ImportDataError(
            f"{path} is a folder", "Give the measurement file itself, or the folder with an import map: --map."
        )
    if not path.exists():
        raise ImportDataError(f"{path} does not exist", missing_path_remedy(path))
    layout, sampling = import_map.file, import_map.sampling
    try:
        file_format = layout.format or recognised_format(path)
    except OSError as error:
        raise ImportDataError(f"{path} cannot be read: {error.strerror or error}", reading_remedy(error)) from error
    plugin_reader = _plugin_reader(path) if file_format is None else None
    if plugin_reader is not None:
        return plugin_reader
    if file_format is None:
        raise _unknown(path)
    try:
        if file_format is FileFormat.CSV:
            is_iso = sampling.time_column is not None and sampling.time_unit == ISO
            times = (
                IsoTimes(path, sampling.time_column or "", sampling.time_zone, sampling.date_order) if is_iso else None
            )
            return CsvColumns(path, layout, times, rows_of=rows_of)
        if rows_of is not None:
            raise ImportDataError(
                f"{path}: rows can be told apart by sensor_column in text files only",
                "Write it as CSV, or each sensor in columns of its own.",
            )
        if file_format is FileFormat.MAT and _is_hdf5(path):
            file_format = FileFormat.HDF5
        return ProcessColumns(path, file_format, processes)
    except OSError as error:
        reason = error.strerror or str(error)
        raise ImportDataError(f"{path} cannot be read: {reason}", reading_remedy(error)) from error


def _unknown(path: Path) -> ImportDataError:
    """Return what a file is that no reader takes, and what to do with it."""
    with path.open("rb") as file:
        content = _no_measurement(file.read(_START_BYTES))
    fault = f": unknown file format '{path.suffix}'" if path.suffix else ": a file name without a suffix"
    remedy = _REMEDIES.get(path.suffix.lower(), f'Known are {_SUFFIXES}. If it is text, state [file] format = "csv".')
    fault, remedy = content or (fault, remedy)
    return ImportDataError(f"{path}{fault}", remedy.replace("{name}", path.name))


def _no_measurement(start: bytes) -> tuple[str, str] | None:
    return next((content for magic, content in _NO_MEASUREMENT.items() if start.startswith(magic)), None)


def plugin_fault(_plugin: Plugin, loaded: object) -> Reason | None:
    """Return why the object of a plug-in is no reader of files, None when it is one."""
    if not callable(loaded):
        return Reason(CoreCode.PLUGIN_REFUSED, why="wrong_type", expected="a class of column readers")
    return missing_members(loaded, ("blocks", "sample", "close"))


def plugin_statuses() -> list[PluginStatus]:
    """Return the readers of plug-ins with the verdict."""
    return statuses(Registry.IMPORTERS, PLUGIN_NAMES_TAKEN, plugin_fault)


def _plugin_reader(path: Path) -> ColumnReader | None:
    """Return the reader of a plug-in for a file's suffix, None where there is none.

    Raises:
        ImportDataError: it cannot read the file.
        PluginError: it cannot be used.
    """
    suffix = path.suffix.lower().removeprefix(".")
    reader: Any = load(Registry.IMPORTERS, suffix, PLUGIN_NAMES_TAKEN, plugin_fault)
    return None if reader is None else PluginReader(path, reader)


def _is_hdf5(path: Path) -> bool:
    """Return whether a MATLAB file is one of version 7.3, which is HDF5."""
    with path.open("rb") as file:
        start = file.read(520)
    return start.startswith((b"MATLAB 7.3", b"\x89HDF")) or start[512:] == b"\x89HDF\r\n\x1a\n"
