"""`treadlink estimate`: estimate recordings in one pass and write tables."""

import contextlib
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from gateway.core.cli import exit_status
from gateway.core.cli.estimate_outputs import EstimateOutput, open_outputs, with_added_options
from gateway.core.cli.options import (
    FiniteRange,
    config_option,
    effects_option,
    estimator_option,
    force_option,
    keys_option,
)
from gateway.core.cli.path_option import path_option
from gateway.core.cli.summary_output import SummaryOutput
from gateway.core.errors import TreadlinkError
from gateway.core.text.output_file import check_outputs
from gateway.core.text.wording import text

if TYPE_CHECKING:
    from gateway.core.text.result_table import ResultTable


@click.command()
@click.argument("recordings", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="RECORDING...")
@config_option
@path_option("--csv", "csv_path", help="Write a CSV table to this file, one row per revolution.")
@path_option("--json", "json_path", help="Write JSON lines to this file, one object per revolution.")
@path_option("--parquet", "parquet_path", help="Write a Parquet table to this file; needs treadlink[parquet].")
@path_option(
    "--metadata",
    "metadata_path",
    help="Write what the columns mean to this file: units, descriptions, conventions (JSON, csvw).",
)
@with_added_options
@force_option
@keys_option
@estimator_option
@effects_option
@click.option(
    "--coverage",
    type=FiniteRange(0.0, 1.0, min_open=True, max_open=True),
    metavar="PROBABILITY",
    help="Also write errors that hold with this probability, such as 0.95 (expanded uncertainty), and their factor.",
)
def estimate(
    recordings: tuple[Path, ...],
    config_path: Path | None,
    csv_path: Path | None,
    json_path: Path | None,
    parquet_path: Path | None,
    metadata_path: Path | None,
    force: bool,
    key_file: Path | None,
    estimators: tuple[str, ...],
    effects_paths: tuple[Path, ...],
    coverage: float | None,
    **added_paths: Path | None,
) -> None:
    """Estimate RECORDING... in one pass, with the same results as `treadlink live`.

    A summary of each recording is printed. Tables get one row per revolution and wheel: times, speed, contact edges and
    estimates with their standard errors and status. The page of --html shows each recording at a glance. Recordings are
    estimated independently of each other, in the order given, each with the vehicle configuration it contains, unless
    --config gives another. For many recordings, `treadlink campaign` uses all processors.

    A FILE appears when it is complete, or not at all. A FILE of - is standard output; the summary is then printed to
    standard error. The exit status is 1 if a recording has no frames, or a wheel that sent samples has no revolution.

    \b
    Examples:
      treadlink estimate drive.mcap --html drive.html
      treadlink estimate drives/*.mcap --csv drives.csv
    """
    from gateway.core.cli.recording_estimates import estimate_recording
    from gateway.core.estimates.weighted_mean import coverage_factor
    from gateway.core.recording.recorded_file import check_exist
    from gateway.core.session.session_parts import default_key_file
    from gateway.core.text.progress import progress_view
    from gateway.core.text.result_table import TableFormat, open_table

    table_paths = {
        TableFormat.CSV: csv_path,
        TableFormat.JSON: json_path,
        TableFormat.PARQUET: parquet_path,
        TableFormat.METADATA: metadata_path,
    }
    outputs = {kind: path for kind, path in table_paths.items() if path is not None}
    if coverage is not None and not outputs:
        raise click.UsageError("--coverage adds columns to a table: give --csv, --json or --parquet too.")
    written = [path for path in (*outputs.values(), *added_paths.values()) if path is not None]
    check_outputs(written, (*recordings, config_path, *effects_paths, key_file or default_key_file()), force=force)
    added = open_outputs(added_paths, force=force)
    factor = None if coverage is None else coverage_factor(coverage)
    check_exist(recordings)
    # A table on standard output must not be mixed with other lines.
    summary = SummaryOutput(written)
    sizes = [path.stat().st_size if path.is_file() else 0 for path in recordings]
    missing, damaged = 0, []
    with contextlib.ExitStack() as stack:
        tables = [
            stack.enter_context(open_table(path, kind, force=force, coverage_factor=factor))
            for kind, path in outputs.items()
        ]
        view = stack.enter_context(progress_view())
        bar = view.bar(recordings[0].name if len(recordings) == 1 else f"{len(recordings)} recordings")
        for index, path in enumerate(recordings):
            before_bytes = sum(sizes[:index])

            def on_position(read_bytes: int, before_bytes: int = before_bytes) -> None:
                bar.show((before_bytes + read_bytes) / max(sum(sizes), 1))

            estimated = estimate_recording(
                path,
                on_position,
                tables,
                config_path=config_path,
                effects_paths=effects_paths,
                key_file=key_file,
                estimators=estimators,
                outputs=added,
            )
            with view.hidden():
                for line in estimated.lines:
                    summary(line)
            if not written:
                summary.finish()
            missing += estimated.missing
            if estimated.damage is not None:
                damaged.append(text(estimated.damage))
        _write(added, tables)
    for path in written:
        summary.written(path)
    if damaged:
        raise TreadlinkError("; ".join(damaged), "The readable part was estimated.")
    if missing:
        raise SystemExit(exit_status.NO_RESULT)
    summary.finish()


def _write(outputs: Sequence[EstimateOutput], tables: "Sequence[ResultTable]") -> None:
    """Write outputs of features, and repeat in the tables what each has for their metadata."""
    for output in outputs:
        metadata = output.write() or {}
        for table in tables:
            table.repeat(metadata)
