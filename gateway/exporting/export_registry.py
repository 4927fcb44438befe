"""Registries of an export: its contents, and the formats of its files."""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Final, NamedTuple

from gateway.core.errors import OutputError
from gateway.core.nearest_name import did_you_mean
from gateway.core.text.output_file import is_stdout


class Content(NamedTuple):
    """A content of an export.

    Attributes:
        description: one line.
        needs_results: whether its rows come from revolutions instead of samples.
        needs_estimators: whether the estimators have to run.
    """

    description: str
    needs_results: bool = True
    needs_estimators: bool = False


SAMPLES: Final = "samples"
CONTENTS: Final[dict[str, Content]] = {
    SAMPLES: Content("accelerations of every axis against time", needs_results=False),
    "angle": Content("every revolution on a grid of 1024 angles"),
    "orders": Content("order coefficients 0 to 60 of every revolution"),
    "average": Content("time synchronous average over the recording with its scatter"),
    "estimates": Content("speed, contact edges and estimates of every revolution", needs_estimators=True),
}


class ExportFormat(NamedTuple):
    """A format.

    Attributes:
        writer: "module:class", called with the target.
        suffixes: of files, from which the format is guessed.
        to_pipe: whether it can be written without going back.
        many_contents: whether a file holds several contents, such as samples and estimates.
        is_text: whether a terminal can show it.
        description: one line.
    """

    writer: str
    suffixes: tuple[str, ...]
    to_pipe: bool
    many_contents: bool
    is_text: bool
    description: str


_ROOM: Final = "gateway.exporting.formats"

FORMATS: Final[dict[str, ExportFormat]] = {
    "csv": ExportFormat(
        f"{_ROOM}.csv_file:CsvExport", (".csv",), True, False, True, "text; conditions and units in # lines"
    ),
    "parquet": ExportFormat(
        f"{_ROOM}.parquet_file:ParquetExport", (".parquet", ".pq"), True, False, False, "pandas, polars, DuckDB, Spark"
    ),
    "mat": ExportFormat(
        f"{_ROOM}.mat_file:MatExport", (".mat",), True, False, False, "MATLAB and Octave; a structure for each wheel"
    ),
    "mf4": ExportFormat(
        f"{_ROOM}.mdf_file:MdfExport", (".mf4", ".mdf"), False, False, False, "ASAM MDF 4.10, for measurement tools"
    ),
    "npz": ExportFormat(f"{_ROOM}.npz_file:NpzExport", (".npz",), True, False, False, "NumPy"),
    "tydex": ExportFormat(
        f"{_ROOM}.tydex_file:TydexExport", (".tdx", ".tydex"), True, False, True, "TYDEX 1.3, numbers of one wheel"
    ),
    "mcap": ExportFormat(
        f"{_ROOM}.mcap_file:McapExport", (".mcap",), True, True, False, "topics for Foxglove and PlotJuggler"
    ),
}


def format_of(path: Path, name: str | None) -> str:
    """Return the format of a file: the given one, else that of its suffix.

    Raises:
        OutputError: neither names one.
    """
    if name is not None:
        return name
    suffix = path.suffix.lower()
    format_name = next((candidate for candidate, entry in FORMATS.items() if suffix in entry.suffixes), None)
    if format_name is None:
        suffixes = ", ".join(entry.suffixes[0] for entry in FORMATS.values())
        problem = "standard output has no suffix" if is_stdout(path) else f"the suffix of '{path}' names no format"
        raise OutputError(
            problem, f"Give --format {', '.join(FORMATS)}" + ("." if is_stdout(path) else f", or one of {suffixes}.")
        )
    return format_name


def check_format(path: Path, name: str, contents: Sequence[str]) -> None:
    """Fail before the work if a file cannot have a format.

    Raises:
        OutputError: a binary format for a terminal, a format that no pipe takes, or contents that there are not or
            that do not fit the format.
    """
    unknown = next((content for content in contents if content not in CONTENTS), None)
    if unknown is not None:
        raise OutputError(
            f"no export has the content '{unknown}'",
            f"{did_you_mean(unknown, CONTENTS)}There is {', '.join(CONTENTS)}.",
        )
    chosen = FORMATS[name]
    direct = is_stdout(path) or (path.exists() and not path.is_file())
    if direct and not chosen.to_pipe:
        raise OutputError(f"{name} cannot be written to a pipe, since it is written out of order", "Give a file.")
    if is_stdout(path) and not chosen.is_text and sys.stdout.isatty():
        raise OutputError(f"{name} is binary and would be written to the terminal", "Give a file, or use a pipe.")
    if len(contents) > 1 and not chosen.many_contents:
        fitting = ", ".join(candidate for candidate, entry in FORMATS.items() if entry.many_contents)
        raise OutputError(
            f"a file of format {name} holds one content, not {len(contents)} ({', '.join(contents)})",
            f"Give --what once, or the format {fitting}.",
        )
