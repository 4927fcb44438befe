"""Import of foreign measurements for programs."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from gateway.api.recording_access import Recording
from gateway.api.recording_access import open as open_recording
from gateway.core.config.document_tables import document_text
from gateway.core.errors import ImportDataError
from gateway.core.session.program_arguments import PathLike, paths
from gateway.importing.exported_file import import_exported
from gateway.importing.import_map import ImportMap, load_map, parse_map
from gateway.importing.importer import import_file
from gateway.importing.map_guess import guess_map as guessed_map

_MAP = "the import map"


def import_measurement(
    files: PathLike | Sequence[PathLike],
    import_map: ImportMap | Mapping[str, Any] | PathLike | None = None,
    *,
    out: PathLike | None = None,
) -> Recording:
    """Convert a measurement file to a recording and open it, as `treadlink import`.

    Args:
        files: CSV, MATLAB, HDF5, MDF, TDMS, UFF, IDE or Parquet; several in the order of time are one measurement.
        import_map: meaning of the columns: a TOML file, or its tables as a dictionary; None for one CSV or MF4 file of
            samples that `Recording.export` has written.
        out: new .mcap file, or a folder for it; None for the name of the first file with .mcap in the current folder.

    Raises:
        TreadlinkError: the map has faults, the measurement does not match it, or `out` exists.
    """
    file_paths = paths(files)
    target = Path(f"{file_paths[0].stem}.mcap") if out is None else Path(out)
    if import_map is None:
        if len(file_paths) > 1:
            raise ImportDataError("several files need an import map", "Give one file, or a map.")
        return open_recording(import_exported(file_paths[0], target).recording)
    if isinstance(import_map, Mapping):
        import_map = parse_map(document_text(import_map, _MAP), _MAP)
    elif not isinstance(import_map, ImportMap):
        import_map = load_map(Path(import_map))
    report = import_file(file_paths, import_map, target)
    return open_recording(report.recording)


def guess_map(file: PathLike) -> str:
    """Return a first import map for a measurement file in TOML, as `treadlink import --guess`; doubts have a `?`.

    Raises:
        ImportDataError: the file cannot be read, or none of its columns can be an acceleration.
    """
    return guessed_map(Path(file))
