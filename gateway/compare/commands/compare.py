"""`treadlink compare`: two recordings side by side."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from gateway.core.cli.options import config_option, effects_option, estimator_option, force_option, keys_option
from gateway.core.cli.path_option import path_option

if TYPE_CHECKING:
    from gateway.core.text.progress import Bar


@click.command()
@click.argument("first", type=click.Path(path_type=Path), metavar="FIRST")
@click.argument("second", type=click.Path(path_type=Path), metavar="SECOND")
@config_option
@path_option("--csv", "csv_path", help="Write the differences to this file.")
@path_option("--html", "html_path", help="Write a page with pictures to this file; needs treadlink[plot].")
@force_option
@keys_option
@estimator_option
@effects_option
def compare(
    first: Path,
    second: Path,
    config_path: Path | None,
    csv_path: Path | None,
    html_path: Path | None,
    force: bool,
    key_file: Path | None,
    estimators: tuple[str, ...],
    effects_paths: tuple[Path, ...],
) -> None:
    """Compare the recordings FIRST and SECOND: conditions side by side, means and their differences.

    For each wheel that both have, and each quantity that is valid in both, the mean over the valid revolutions with its
    standard error is shown, the difference (second less first) with its error, and how many errors it is. An error
    of the belt radius cancels where both rest on the same one; all other errors count as independent.

    \b
    Examples:
      treadlink compare before.mcap after.mcap
      treadlink compare before.mcap after.mcap --html differences.html
      treadlink compare tire-a.mcap tire-b.mcap --csv differences.csv
    """
    from gateway.compare.mean_comparison import compared_means
    from gateway.compare.views.comparison_page import comparison_page
    from gateway.compare.views.drive import Drives
    from gateway.compare.views.drive_comparison import comparison_csv, comparison_lines, means_of, radii_of
    from gateway.compare.views.drive_page import check_page
    from gateway.core.cli.recording_estimates import estimate_recording
    from gateway.core.cli.summary_output import SummaryOutput
    from gateway.core.errors import RecordingError, TreadlinkError
    from gateway.core.session.session_parts import default_key_file
    from gateway.core.text.aligned_table import terminal_columns
    from gateway.core.text.output_file import check_outputs, write_whole
    from gateway.core.text.progress import progress_bar
    from gateway.core.text.wording import text

    outputs = (csv_path, html_path)
    check_outputs(outputs, [first, second, config_path, *effects_paths, key_file or default_key_file()], force=force)
    if html_path is not None:
        check_page(html_path, force=force)
    collected, damaged = Drives(), []
    for path in (first, second):
        size = path.stat().st_size if path.is_file() else 0
        with progress_bar(f"estimating {path.name}") as bar:
            estimated = estimate_recording(
                path,
                partial(_show, bar, size),
                config_path=config_path,
                effects_paths=effects_paths,
                key_file=key_file,
                estimators=estimators,
                outputs=[collected],
            )
        if estimated.damage is not None:
            damaged.append(f"'{path}': {text(estimated.damage)}")
    before, after = collected.drives
    if not before.wheels.keys() & after.wheels.keys():
        wheels = " and ".join(f"{', '.join(drive.wheels) or 'no wheel'} in '{drive.name}'" for drive in (before, after))
        raise RecordingError(
            f"no wheel has revolutions in both recordings: {wheels}",
            "Name the wheels alike in the configuration, --config, or look at the recordings with treadlink inspect.",
        )
    differences = compared_means(means_of(before), means_of(after), radii_of(before), radii_of(after))
    summary = SummaryOutput(outputs)
    for line in comparison_lines(before, after, differences, terminal_columns(on_err=summary.err)):
        summary(line)
    if csv_path is not None:
        write_whole(csv_path, comparison_csv(differences), force=force)
    if html_path is not None:
        write_whole(html_path, comparison_page(before, after, differences), force=force)
    for output in outputs:
        summary.written(output)
    if damaged:
        raise TreadlinkError("; ".join(damaged), "The readable part was compared.")
    summary.finish()


def _show(bar: Bar, size: int, position: int) -> None:
    bar.show(position / max(size, 1))
