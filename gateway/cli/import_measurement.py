"""`treadlink import`: convert a measurement file to a recording."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from gateway.importing.importer import ImportReport


@click.command("import")
@click.argument("file", type=click.Path(path_type=Path))
@click.option(
    "--map",
    "map_path",
    required=True,
    type=click.Path(path_type=Path),
    metavar="MAP.toml",
    help="Import map: the meaning of the columns; see docs/how-to/import-measurements.md.",
)
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    metavar="PATH",
    help="New .mcap file, or a folder for it.  [default: the name of FILE with .mcap, in the current folder]",
)
def import_(file: Path, map_path: Path, out: Path | None) -> None:
    """Convert the CSV, MAT or Parquet measurement FILE to a recording."""
    from gateway.importing.import_map import load_map
    from gateway.importing.importer import import_file
    from gateway.views.progress import progress_bar

    import_map = load_map(map_path)
    with progress_bar(f"importing {file.name}") as bar:
        report = import_file(file, import_map, out or Path(f"{file.stem}.mcap"), bar.show)
    for line in report_lines(report):
        click.echo(line)


def report_lines(report: ImportReport) -> list[str]:
    """Return the report of an import for a terminal."""
    from gateway.views.wording import text

    skipped = f", {report.skipped} earlier rows left out" if report.skipped else ""
    lines = [
        f"{report.samples} samples{skipped}, {report.duration_s:.6g} s at {_rate(report)}",
        f"wheel {report.position}; range and quantisation in m/s^2:",
    ]
    lines += [
        f"  {axis.axis.name.lower():<16}{axis.low_mps2:>10.2f} to {axis.high_mps2:>9.2f}"
        f"   step {axis.step_mps2:.3g}, largest error {axis.error_mps2:.3g}"
        for axis in report.axes
    ]
    if report.gaps:
        lines.append(f"{report.gaps} rows without a value in an axis are gaps between samples")
    lines += [f"check: {text(finding)}" for finding in report.findings]
    if report.environment_frames:
        lines.append(f"{report.environment_frames} messages with pressure or temperature")
    lines += [f"assumed: {assumption}" for assumption in report.assumed]
    if report.start_is_file_date:
        lines.append("assumed: start time is the modification time of the file (start_utc is not stated in the map)")
    lines += [
        f"recording: {report.recording} ({report.size_bytes / 1e6:.3g} MB)",
        f"next: treadlink estimate {report.recording}, or treadlink replay {report.recording}",
    ]
    return lines


def _rate(report: ImportReport) -> str:
    if report.jitter_s is None:
        return f"{report.rate_hz:.8g} Hz"
    if report.rounding_s is None or report.rate_std_hz is None:
        return f"{report.rate_hz:.8g} Hz by the time column (steps within {report.jitter_s * 1e6:.2g} us)"
    return (
        f"{report.rate_hz:.8g} +- {report.rate_std_hz:.1g} Hz by the time column, whose times are rounded to "
        f"{report.rounding_s * 1e3:g} ms; if the rate is known exactly, state rate_hz instead"
    )
