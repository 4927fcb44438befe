"""`treadlink import`: convert a measurement file to a recording."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING

import click

from gateway.core.cli.options import force_option
from gateway.core.cli.path_option import path_option

if TYPE_CHECKING:
    from gateway.importing.importer import ImportReport


@click.command("import")
@click.argument("files", nargs=-1, required=True, metavar="FILE...", type=click.Path(path_type=Path))
@path_option(
    "--map",
    "map_path",
    metavar="MAP.toml",
    help="Import map: what the columns mean. --guess writes a first one.",
)
@path_option(
    "--out",
    metavar="PATH",
    help=(
        "New .mcap file, or a folder for it; with --guess, the new map, - for standard output.  "
        "[default: the name of FILE with .mcap or .map.toml, in the current folder]"
    ),
)
@click.option("--guess", is_flag=True, help="Write a first import map for FILE, with what is not known as comments.")
@force_option
def import_(files: tuple[Path, ...], map_path: Path | None, out: Path | None, guess: bool, force: bool) -> None:
    """Make a recording of the measurement FILE of another program.

    FILE is CSV, MATLAB, HDF5, MDF, TDMS, UFF, IDE, FAMOS, VBO, WAV, Parquet, of numpy, or MCAP with Imu messages.
    Several files, in the order of time, or a folder of them are one
    measurement. The import map states the meaning of the columns; --guess writes a first one. A CSV or MF4 file of
    samples that `treadlink export` has written needs none: its wheels come back. A recording is never
    overwritten; --force overwrites a map.

    \b
    Examples:
      treadlink import run.csv --guess
      treadlink import run.csv --map run.map.toml
    """
    from gateway.core.text.progress import progress_bar
    from gateway.core.text.text import clean
    from gateway.importing.exported_file import import_exported
    from gateway.importing.import_map import load_map
    from gateway.importing.importer import import_file

    if guess and map_path is not None:
        raise click.UsageError("Give either --map with an import map, or --guess to write a first one.")
    file = files[0]
    if guess:
        if len(files) > 1:
            raise click.UsageError("Give --guess one of the files: the map that it writes holds for all.")
        _guess(file, out, force=force)
        return
    import_map = load_map(map_path) if map_path is not None else None
    if import_map is None and len(files) > 1:
        raise click.UsageError("Several files need an import map: --map.")
    recording = out or Path(f"{file.stem}.mcap")
    with progress_bar(f"importing {file.name}") as bar:
        if import_map is None:
            report = import_exported(file, recording, bar.show)
        else:
            report = import_file(files, import_map, recording, bar.show)
    for line in report_lines(report):
        click.echo(clean(line))
    if report.references:
        for line in _comparison_lines(report.recording):
            click.echo(clean(line))
    name = shlex.quote(str(report.recording))
    click.echo(f"next: treadlink estimate {name}, or treadlink replay {name}")


def _comparison_lines(recording: Path) -> list[str]:
    """Estimate the revolutions of a new recording, and return their differences from its references."""
    from gateway.core.recording.reader import RecordingReader
    from gateway.core.session.recording_pass import RecordingPass, open_recording
    from gateway.importing.reference_check import ReferenceCheck
    from gateway.importing.reference_topic import RecordedReferences
    from gateway.importing.views.reference_lines import reference_lines

    reader = RecordingReader(recording)
    opened = open_recording(reader, verifies=False)
    check = ReferenceCheck(RecordedReferences(reader), opened.vehicle)
    for result in RecordingPass(opened, (), is_watched=False):
        check.add(result)
    return reference_lines(check.comparisons())


def _guess(file: Path, out: Path | None, *, force: bool) -> None:
    """Write a first import map for a file."""
    from gateway.core.text.output_file import check_outputs, is_stdout, write_whole
    from gateway.core.text.progress import progress_bar
    from gateway.importing.map_guess import guess_map

    target = out or Path(f"{file.stem}.map.toml")
    check_outputs([target], [file], force=force)
    with progress_bar(f"reading {file.name}") as bar:
        text = guess_map(file, bar.show)
    write_whole(target, text, force=force)
    if not is_stdout(target):
        click.echo(f"written: {target}")
        words = shlex.join(["treadlink", "import", str(file), "--map", str(target)])
        click.echo(f"next: check what it assumes, then {words}")


def report_lines(report: ImportReport) -> list[str]:
    """Return the report of an import for a terminal."""
    from gateway.core.text.wording import text

    skipped = f", {report.skipped} earlier rows left out" if report.skipped else ""
    lines = [f"{report.samples} samples{skipped}, {report.duration_s:.6g} s at {_rate(report)}"]
    if report.left_out:
        lines.append(f"{report.left_out} samples that the time column skips are gaps between samples")
    if report.unreadable:
        lines.append(f'{report.unreadable} cells that are no numbers are gaps, by unreadable = "missing"')
    for wheel in report.wheels:
        lines.append(f"wheel {wheel.position}; range and quantisation in m/s^2:")
        lines += [
            f"  {axis.axis.name.lower():<16}{axis.low_mps2:>10.2f} to {axis.high_mps2:>9.2f}"
            f"   step {axis.step_mps2:.3g}, largest error {axis.error_mps2:.3g}"
            for axis in wheel.axes
        ]
        gaps = wheel.gaps if report.decimation is not None else wheel.gaps - wheel.left_out
        if gaps > 0:
            lines.append(f"{gaps} rows without a value in an axis are gaps between samples")
        if wheel.bridged:
            lines.append(
                f"{wheel.bridged} samples on {wheel.bridges} straight lines in every axis bridge gaps: they are left "
                "out as gaps between samples"
            )
        lines += [f"check: {text(finding)}" for finding in wheel.findings]
        if wheel.environment_frames:
            lines.append(f"{wheel.environment_frames} messages with pressure or temperature")
    lines += [f"reference {name}: {count} values" for name, count in report.references.items()]
    lines += [f"assumed: {assumption}" for assumption in report.assumed]
    if report.start_is_file_date:
        lines.append("assumed: start time is the modification time of the file (start_utc is not stated in the map)")
    lines.append(f"recording: {report.recording} ({report.size_bytes / 1e6:.3g} MB)")
    return lines


def _rate(report: ImportReport) -> str:
    if report.jitter_s is None:
        return f"{report.rate_hz:.8g} Hz"
    if report.rounding_s is None or report.rate_std_hz is None:
        return f"{report.rate_hz:.8g} Hz by the time column (steps within {report.jitter_s * 1e6:.2g} us)"
    return (
        f"{report.rate_hz:.8g} +- {report.rate_std_hz:.1g} Hz by the time column, whose times are rounded to "
        f"{report.rounding_s * 1e3:g} ms; if the rate is known better, state rate_hz and rate_std_percent instead"
    )
