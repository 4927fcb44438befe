"""`treadlink repair`, `compact` and `set-clock`: repaired, compressed and newly dated copies."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import click

from gateway.core.cli.options import FiniteRange
from gateway.core.cli.path_option import path_option
from gateway.core.errors import OutputError, RecordingError

if TYPE_CHECKING:
    from gateway.core.text.progress import Bar
    from gateway.upkeep.repair import RepairReport


@click.command()
@click.argument("recording", type=click.Path(path_type=Path))
@path_option("--out", help="New file.  [default: NAME.repaired.mcap]")
@click.option("--force", is_flag=True, help="Write a copy even if the recording is undamaged.")
def repair(recording: Path, out: Path | None, force: bool) -> None:
    """Repair a RECORDING that was interrupted, cut off or damaged, and write the result to a new file.

    Only damaged frames are lost. In a compressed recording, whole chunks of about a second are lost. RECORDING itself
    is not changed.

    Example: `treadlink repair drive.mcap`
    """
    from gateway.core.text.progress import progress_bar
    from gateway.core.text.text import clean
    from gateway.upkeep.repair import needs_repair, repair_recording

    with progress_bar(f"checking {recording.name}") as bar:
        whole = not needs_repair(recording, _show_share(bar))
    if whole and not force:
        click.echo(f"{clean(str(recording))} is finished and undamaged. There is nothing to repair.")
        return
    with progress_bar(f"repairing {recording.name}") as bar:
        report = repair_recording(recording, out or _target_of(recording, "repaired"), _show_share(bar))
    for line in _report_lines(report):
        click.echo(clean(line))


@click.command()
@click.argument("recordings", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="RECORDING...")
@path_option("--out", help="New file, or folder of tables.  [default: NAME.compact.mcap, NAME.tables]")
@click.option("--in-place", is_flag=True, help="Replace each recording once its copy is verified.")
def compact(recordings: tuple[Path, ...], out: Path | None, in_place: bool) -> None:
    """Compress finished RECORDING... to new files, each read back and compared with the original.

    A compressed recording replays identically, but damage to it costs a whole chunk instead of single frames.

    In place of a recording, a DATASET of `treadlink campaign`: its tables are copied into few files of 100 MB, which
    queries read faster than two files a recording. `campaign` and `trends` use the dataset itself.

    Example: `treadlink compact drives/*.mcap --in-place`
    """
    if out is not None and (in_place or len(recordings) > 1):
        raise click.UsageError("--out requires a single recording and cannot be combined with --in-place.")
    datasets = [path for path in recordings if path.is_dir()]
    if datasets and in_place:
        raise click.UsageError("a dataset cannot be packed in place: campaign and trends use its files.")
    for dataset in datasets:
        real = dataset.resolve()
        _pack(dataset, out or real.parent / f"{real.name.removesuffix('.dataset')}.tables")
    recordings = tuple(path for path in recordings if path not in datasets)
    from gateway.core.text.progress import progress_bar
    from gateway.core.text.text import clean, file_size
    from gateway.upkeep.compact import compact_recording

    for recording in recordings:
        target = _hidden_beside(recording) if in_place else out or _target_of(recording, "compact")
        with progress_bar(f"compacting {recording.name}") as bar:
            report = compact_recording(recording, target, replace=in_place, progress=_show_share(bar))
        share = 100.0 * report.bytes_after / max(report.bytes_before, 1)
        click.echo(
            clean(
                f"{report.target}: {file_size(report.bytes_after)} instead of {file_size(report.bytes_before)} "
                f"({share:.0f} %), {report.messages} messages verified"
            )
        )


def _pack(dataset: Path, target: Path) -> None:
    from gateway.core.text.progress import progress_bar
    from gateway.core.text.text import clean, file_size
    from gateway.fleet.packed_tables import pack_tables

    with progress_bar(f"packing {dataset.name}") as bar:
        tables = pack_tables(dataset, target, _show_share(bar))
    for table in tables:
        files = "1 file" if table.files == 1 else f"{table.files} files"
        click.echo(
            clean(
                f"{target / table.name}: {table.rows} rows of {table.parts} files in {files}, "
                f"{file_size(table.size_bytes)}"
            )
        )
    unreadable = [path for table in tables for path in table.unreadable]
    if unreadable:
        raise OutputError(
            f"{len(unreadable)} files of '{dataset}' cannot be read and are left out, such as '{unreadable[0]}'",
            "Remove them, and run the same campaign again: it estimates what is missing.",
        )


@click.command("set-clock")
@click.argument("recording", type=click.Path(path_type=Path))
@click.option(
    "--ahead",
    "ahead_s",
    type=FiniteRange(-4e9, 4e9),
    metavar="SECONDS",
    help="Seconds to add to every time, negative to subtract.  [default: as the recording says]",
)
@path_option("--out", help="New file.  [default: NAME.dated.mcap]")
def set_clock(recording: Path, ahead_s: float | None, out: Path | None) -> None:
    """Write a copy of RECORDING with right times, if its computer's clock was wrong or was set later.

    The time comes from a positioning receiver in the recording (nmea:), else from the last step of the system time.
    RECORDING itself is not changed; decoded topics are left out of the copy.

    Example: `treadlink set-clock drive.mcap --ahead 3600`
    """
    from gateway.core.recording.writer import utc_text
    from gateway.core.text.progress import progress_bar
    from gateway.core.text.text import clean
    from gateway.upkeep.set_clock import recorded_clock_error_s
    from gateway.upkeep.set_clock import set_clock as write_copy

    recorded_s = recorded_clock_error_s(recording) if ahead_s is None else ahead_s
    if ahead_s is None and recorded_s == 0.0:
        raise RecordingError(
            f"the times of '{recording}' agree with its receiver's",
            "Nothing is to be set. To add a time all the same: --ahead SECONDS.",
        )
    ahead_s = recorded_s
    if ahead_s is None:
        raise RecordingError(
            f"'{recording}' says nothing of another time: it has neither a receiver's nor a step of the system time",
            "Give the seconds to add: --ahead SECONDS.",
        )
    target = out or _target_of(recording, "dated")
    with progress_bar(f"copying {recording.name}") as bar:
        start_ns = write_copy(recording, target, ahead_s, _show_share(bar))
    click.echo(clean(f"{target}: begins {utc_text(start_ns)}, {ahead_s:+.3f} s from {recording}"))


def _report_lines(report: RepairReport) -> Iterator[str]:
    from gateway.core.text.text import file_size

    losses = report.losses
    yield f"{report.target}"
    size = file_size(report.link_bytes)
    yield f"  recovered: {report.frames} frames in {size} of link data, {report.messages} messages"
    yield (
        f"  missing: {report.frames_lost} frames by their counters, including losses on the link; "
        f"{report.frames_broken} frames are incomplete"
    )
    if losses.torn_places:
        yield (
            f"  {losses.torn_places} damaged places: {losses.bytes_kept} bytes kept, {losses.bytes_dropped} bytes "
            "belong to no frame"
        )
    if losses.compressed_chunks:
        yield f"  {losses.compressed_chunks} compressed chunks were damaged and are lost"
    if losses.topics_lost:
        yield f"  {losses.topics_lost} messages of decoded topics are damaged; `treadlink estimate` computes them again"
    if not report.session_kept:
        yield "  the vehicle configuration in the recording is lost; give --config when replaying it"


def _target_of(recording: Path, word: str) -> Path:
    target = recording.with_name(f"{recording.stem}.{word}{recording.suffix or '.mcap'}")
    if target.exists():
        raise RecordingError(f"'{target}' already exists", "Recordings are never overwritten. Remove it or give --out.")
    return target


def _hidden_beside(recording: Path) -> Path:
    """Return the name of the copy that will replace the recording, in the folder of what a link leads to.

    Always the same, so that the next run replaces the part of one that was killed.
    """
    real = Path(os.path.realpath(recording))
    return real.with_name(f".{real.name}.compacting")


def _show_share(bar: Bar) -> Callable[[int, int], None]:
    """Return a function of (done, total) that shows their ratio."""
    return lambda done, total: bar.show(done / max(total, 1))
