"""`treadlink trends`: report how tires and sensors of a dataset change."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from gateway.core.cli.options import force_option
from gateway.core.cli.path_option import path_option
from gateway.core.cli.run_options import where_option
from gateway.core.cli.summary_output import SummaryOutput
from gateway.core.text.output_file import check_outputs, write_whole
from gateway.core.text.text import json_text

if TYPE_CHECKING:
    from gateway.core.recording.run_description import RunFilter


@click.command()
@click.argument("dataset", type=click.Path(path_type=Path), metavar="DATASET")
@path_option(
    "--odometer",
    "odometer_path",
    help="CSV file with the columns vehicle, utc and km: the distance driven, which wear per 1,000 km needs.",
)
@path_option("--html", "html_path", help="Write a report with figures to this HTML file.")
@path_option("--json", "json_path", help="Write all results to this JSON file.")
@path_option("--csv", "csv_path", help="Write a table of all numbers to this CSV file.")
@click.option(
    "--mark",
    "marks",
    multiple=True,
    metavar="KEY=MARK",
    help="Mark a finding: acknowledged, closed, put-off:YYYY-MM-DD, or open. It comes back when it has grown.",
)
@where_option
@force_option
def trends(
    dataset: Path,
    odometer_path: Path | None,
    html_path: Path | None,
    json_path: Path | None,
    csv_path: Path | None,
    marks: tuple[str, ...],
    where: RunFilter,
    force: bool,
) -> None:
    """Report how the tires and sensors of DATASET change, which `treadlink campaign` has made.

    Per tire and wheel: wear per 1,000 km, pressure loss per month at one temperature, load and its changes, stiffness
    with age and temperature, and noise, losses, clipping, offset and gain of the sensor; per axle, ply steer and slip
    of left against right. Each number has a standard error from the scatter between the recordings. What they do not
    determine has no value, but a reason. Another sensor, or a fall of the wear, begins a new tire. Recordings that do
    not fit the trend of their tire are named; the probability of a single false one in the whole report is 1 %.

    \b
    Examples:
      treadlink trends fleet.dataset --odometer odometer.csv --html fleet.html
      treadlink trends fleet.dataset --mark 3fa91c=acknowledged
      treadlink trends fleet.dataset --json - | jq '.tires[] | select(.findings != [])'
    """
    outputs = (html_path, json_path, csv_path)
    check_outputs(outputs, (odometer_path,), force=force)
    from gateway.core.text.page_figure import require_report_packages
    from gateway.fleet.parquet_parts import require_campaign_packages

    require_campaign_packages()
    if html_path is not None:
        require_report_packages()
    from gateway.core.text.aligned_table import terminal_columns
    from gateway.fleet.history_reading import read_histories, read_odometer
    from gateway.fleet.trends.fleet_analysis import analyse
    from gateway.fleet.trends.marked_findings import read_marks, set_marks, without_marked
    from gateway.fleet.views.trend_tables import trends_csv, trends_json
    from gateway.fleet.views.trend_terminal import trend_lines

    odometer = read_odometer(odometer_path) if odometer_path is not None else None
    histories = read_histories(dataset, odometer, where=where)
    fleet_trends = analyse(
        histories.tires, recordings=histories.recordings, failures=histories.failures, notes=histories.notes
    )
    marked = set_marks(dataset, fleet_trends, marks) if marks else read_marks(dataset)
    fleet_trends = without_marked(fleet_trends, marked)
    if json_path is not None:
        content = json_text(trends_json(fleet_trends), indent=2)
        write_whole(json_path, content + "\n", force=force)
    if csv_path is not None:
        write_whole(csv_path, trends_csv(fleet_trends), force=force)
    if html_path is not None:
        from gateway.fleet.views.trend_page import write_trends_page

        write_trends_page(fleet_trends, html_path, force=force)
    # A table on standard output must not be mixed with other lines.
    summary = SummaryOutput(outputs)
    for line in trend_lines(fleet_trends, terminal_columns(on_err=summary.err)):
        summary(line)
    for path in outputs:
        summary.written(path)
    summary.finish()
