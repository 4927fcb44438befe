"""`treadlink record`: record sources to a file, without a screen."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Final

import click

from gateway.cli.options import config_option, duration_option, effects_option, estimator_option, keys_option
from gateway.cli.session_setup import RunningSession, ending, start_session
from gateway.cli.stop_signals import StopRequest, stop_request
from gateway.views.text import clean
from gateway.views.wording import notice_text

_POLL_S: Final = 0.1
_REPORT_S: Final = 1.0


@click.command()
@click.argument("sources", nargs=-1, required=True, metavar="SOURCE...")
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    default=Path("recordings"),
    show_default=True,
    metavar="PATH",
    help="New .mcap file, or a folder for a file named after the start time.",
)
@config_option
@duration_option
@keys_option
@estimator_option
@effects_option
def record(
    sources: tuple[str, ...],
    out: Path,
    config_path: Path | None,
    duration_s: float | None,
    key_file: Path | None,
    estimators: tuple[str, ...],
    effects_paths: tuple[Path, ...],
) -> None:
    """Record SOURCE... until Ctrl-C, the end of the source, or --duration.

    The bytes of the links are written to disk before they are decoded. Estimates are recorded as additional topics,
    which plotting programs can show. Sources are those of `treadlink live`. Existing files are never overwritten.
    """
    with stop_request() as stop:
        session = start_session(
            sources,
            config_path=config_path,
            record=out,
            estimators=estimators,
            key_file=key_file,
            effects_paths=effects_paths,
            duration_s=duration_s,
        )
        with ending(session, stop, needs_revolutions=False):
            _watch(session, stop)


def _watch(session: RunningSession, stop: StopRequest) -> None:
    live = session.live
    shown_s = 0.0
    on_terminal = sys.stderr.isatty()
    ended = False
    try:
        while not ended and not stop.is_set():
            ended = live.wait(_POLL_S)
            live.results()
            for notice in live.notices():
                click.echo(f"* {clean(notice_text(notice))}", err=True)
            snapshot = live.snapshot()
            if on_terminal and snapshot.elapsed_s >= shown_s:
                shown_s = snapshot.elapsed_s + _REPORT_S
                frames = sum(link.frames for link in snapshot.links)
                lost = sum(link.frames_lost for link in snapshot.links)
                size_mb = snapshot.recorded_bytes / 1e6
                alarms = f", {len(snapshot.alarms)} ALARMS" if snapshot.alarms else ""
                text = f"{snapshot.elapsed_s:7.0f} s  {size_mb:8.1f} MB  {frames} frames, {lost} lost{alarms}"
                click.echo(f"\r{text}\033[K", nl=False, err=True)
            if session.time_is_up():
                live.request_stop()
    finally:
        if on_terminal:
            click.echo("", err=True)
