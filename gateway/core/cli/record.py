"""`treadlink record`: record sources to a file, without a screen."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Final, Unpack

import click

from gateway.core.cli.options import (
    SessionOptions,
    config_option,
    keep_option,
    session_options,
    split_option,
)
from gateway.core.cli.path_option import path_option
from gateway.core.cli.run_options import run_options
from gateway.core.cli.stop_signals import StopRequest, stop_request

if TYPE_CHECKING:
    from gateway.core.cli.session_setup import RunningSession
    from gateway.core.estimates.results import SessionSnapshot
    from gateway.core.recording.run_description import RunDescription

_POLL_S: Final = 0.1


@click.command()
@click.argument("sources", nargs=-1, required=True, metavar="SOURCE...")
@path_option(
    "--out",
    default=Path("recordings"),
    show_default=True,
    metavar="PATH",
    help="New .mcap file, or a folder for a file named after the start time.",
)
@split_option
@keep_option
@config_option
@session_options
@run_options
def record(
    sources: tuple[str, ...],
    out: Path,
    split: tuple[str, int] | None,
    keep: int | None,
    run: RunDescription,
    **options: Unpack[SessionOptions],
) -> None:
    """Record SOURCE... until Ctrl-C, the end of the source, or --duration.

    The bytes of the links are written to disk before they are decoded. Estimates are recorded as additional topics,
    which plotting programs can show. Sources are those of `treadlink live`. Existing files are never overwritten.

    \b
    Examples:
      treadlink record /dev/ttyUSB0:921600 --config car.toml --out drives/
      treadlink record sim:demo --out demo.mcap --duration 60
    """
    from gateway.core.cli.session_setup import chosen_split, ending, start_session

    with stop_request() as stop:
        session = start_session(
            sources,
            record=out,
            split=chosen_split(split, keep),
            **options,
            run=run,
        )
        with ending(session, stop, needs_revolutions=False):
            _watch(session, stop)


def _watch(session: RunningSession, stop: StopRequest) -> None:
    from gateway.core.text.aligned_table import for_terminal
    from gateway.core.text.progress import progress_view
    from gateway.core.text.text import clean
    from gateway.core.text.wording import notice_text

    live = session.live
    ended = False
    with progress_view() as view:
        while not ended and not stop.is_set():
            ended = live.wait(_POLL_S)
            live.results()
            notices = live.notices()
            if notices:
                with view.hidden():
                    for notice in notices:
                        click.echo(for_terminal(f"* {clean(notice_text(notice))}", on_err=True), err=True)
            view.text(_state_text(live.snapshot()))
            if session.time_is_up():
                live.request_stop()


def _state_text(snapshot: SessionSnapshot) -> str:
    from gateway.core.text.numbers import duration

    frames = sum(link.frames for link in snapshot.links)
    lost = sum(link.frames_lost for link in snapshot.links)
    alarms = f", {len(snapshot.alarms)} ALARMS" if snapshot.alarms else ""
    size_mb = snapshot.recorded_bytes / 1e6
    remaining_s = snapshot.disk.left_s if snapshot.disk is not None else None
    full = f", disk full in {duration(remaining_s)}" if remaining_s is not None else ""
    return f"{snapshot.elapsed_s:7.0f} s  {size_mb:8.1f} MB  {frames} frames, {lost} lost{full}{alarms}"
