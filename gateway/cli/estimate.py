"""`treadlink estimate`: estimate recordings in one pass and write tables."""

from pathlib import Path

import click

from gateway.cli.options import FiniteRange, config_option, effects_option, estimator_option, force_option, keys_option
from gateway.cli.path_option import path_option


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
@path_option(
    "--html",
    "html_path",
    help="Write a page with wheels, means and quantities over time to this file; needs treadlink[plot].",
)
@force_option
@keys_option
@estimator_option
@effects_option
@click.option(
    "--coverage",
    type=FiniteRange(0.0, 1.0, min_open=True, max_open=True),
    metavar="PROBABILITY",
    help="Also write expanded uncertainties of this coverage probability, such as 0.95, and their coverage factor.",
)
def estimate(
    recordings: tuple[Path, ...],
    config_path: Path | None,
    csv_path: Path | None,
    json_path: Path | None,
    parquet_path: Path | None,
    metadata_path: Path | None,
    html_path: Path | None,
    force: bool,
    key_file: Path | None,
    estimators: tuple[str, ...],
    effects_paths: tuple[Path, ...],
    coverage: float | None,
) -> None:
    """Estimate RECORDING... in one pass, with the same results as `treadlink live`.

    A summary of each recording is printed. Tables get one row per revolution and wheel: times, speed, contact edges and
    estimates with their standard errors and status. The page of --html shows each recording at a glance. Recordings are
    estimated independently of each other, in the order given, each with the vehicle configuration it contains, unless
    --config gives another. For many recordings, `treadlink campaign` uses all processors.

    A FILE appears when it is complete, or not at all. A FILE of - is standard output; the summary is then printed to
    standard error. The exit status is 1 if a recording has no frames, or a wheel that sent samples has no revolution.
    """
    from gateway.cli.estimate_run import run_estimate
    from gateway.cli.recording_estimates import EstimateOrder
    from gateway.estimators.registry import DEFAULT_ESTIMATORS
    from gateway.estimators.weighted_mean import coverage_factor
    from gateway.security.key_file import default_key_file
    from gateway.views.output_file import check_outputs
    from gateway.views.tables.result_table import TableFormat

    table_paths = {
        TableFormat.CSV: csv_path,
        TableFormat.JSON: json_path,
        TableFormat.PARQUET: parquet_path,
        TableFormat.METADATA: metadata_path,
    }
    outputs = {kind: path for kind, path in table_paths.items() if path is not None}
    if coverage is not None and not outputs:
        raise click.UsageError("--coverage adds columns to a table: give --csv, --json or --parquet too.")
    read = (*recordings, config_path, *effects_paths, key_file or default_key_file())
    check_outputs([*outputs.values(), html_path], read, force=force)
    if html_path is not None:
        from gateway.views.drive_page.drive_page import check_page

        check_page(html_path, force=force)
    factor = None if coverage is None else coverage_factor(coverage)
    orders = [
        EstimateOrder(
            path, config_path, effects_paths, key_file, estimators or DEFAULT_ESTIMATORS, is_drawn=html_path is not None
        )
        for path in recordings
    ]
    run_estimate(orders, outputs, page=html_path, force=force, coverage_factor=factor)
