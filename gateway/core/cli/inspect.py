"""`treadlink inspect`: show the content of recordings."""

import json
from pathlib import Path

import click

from gateway.core.cli import exit_status


@click.command()
@click.argument("recordings", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="RECORDING...")
@click.option("--json", "as_json", is_flag=True, help="Print JSON, one line per recording.")
@click.option(
    "--verify",
    "verifies",
    is_flag=True,
    help="Only compare with the folder's SHA256SUMS, and name what the folder lacks.",
)
def inspect(recordings: tuple[Path, ...], as_json: bool, verifies: bool) -> None:
    """Show the links, sensors, rates, losses, events and time line of RECORDING...

    The time line has one row per wheel. The height of a bar is the received share of the nominal data rate; an `x`
    below it marks lost samples.

    The exit status is 1 if a recording is damaged or has no frames.

    Example: `treadlink inspect drives/*.mcap`
    """
    from gateway.core.cli.inspection_report import inspection_json, inspection_lines
    from gateway.core.recording.inspection import inspect_recording
    from gateway.core.session.statement_watch import StatementWatch
    from gateway.core.text.aligned_table import for_terminal
    from gateway.core.text.progress import progress_bar
    from gateway.core.text.text import clean

    if verifies:
        _verify(recordings)
        return
    without_result = False
    for path in recordings:
        size = max(path.stat().st_size if path.exists() else 0, 1)
        watch = StatementWatch()
        with progress_bar(path.name) as bar:
            inspection = inspect_recording(
                path,
                lambda position, bar=bar, size=size: bar.show(position / size),  # type: ignore[misc]
                watch.take,
            )
        for name, link in inspection.links.items():
            watch.counters(name, link.counters)
        notices = watch.contradictions()
        if as_json:
            click.echo(json.dumps(inspection_json(inspection, notices)))
        else:
            for line in inspection_lines(inspection, notices):
                click.echo(for_terminal(clean(line)))
        without_result |= inspection.damage is not None or not any(
            link.counters.frames for link in inspection.links.values()
        )
    if without_result:
        raise SystemExit(exit_status.NO_RESULT)


def _verify(recordings: tuple[Path, ...]) -> None:
    """Compare all recordings with their manifests; name each that differs, and those that their folders lack."""
    from gateway.core.errors import RecordingError
    from gateway.core.recording.manifest import absent_recordings, verify
    from gateway.core.text.text import clean

    failed_count = 0
    # `*.mcap` of a copy does not name what it lacks.
    absent = [
        path for folder in dict.fromkeys(path.parent for path in recordings) for path in absent_recordings(folder)
    ]
    for path in dict.fromkeys((*recordings, *absent)):
        try:
            verify(path)
        except RecordingError as error:
            failed_count += 1
            click.echo(clean(f"{path}: NOT VERIFIED: {error}. {error.remedy}"))
        else:
            click.echo(clean(f"{path}: as in the manifest"))
    if failed_count:
        raise SystemExit(exit_status.NO_RESULT)
