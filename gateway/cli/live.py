"""`treadlink live`: wheels being estimated, on a screen or line by line."""

from __future__ import annotations

from pathlib import Path

import click

from gateway.cli.session_setup import (
    RunningSession,
    config_option,
    duration_option,
    effects_option,
    end_session,
    estimator_option,
    is_terminal,
    keys_option,
    run_plain,
    start_session,
)


@click.command()
@click.argument("sources", nargs=-1, required=True, metavar="SOURCE...")
@config_option
@click.option(
    "--record",
    type=click.Path(path_type=Path),
    help="Record to this new .mcap file, or to a file named by the time in this folder.",
)
@click.option("--plain", is_flag=True, help="One line a revolution; the default where the output is no terminal.")
@duration_option
@keys_option
@estimator_option
@effects_option
def live(
    sources: tuple[str, ...],
    config_path: Path | None,
    record: Path | None,
    plain: bool,
    duration_s: float | None,
    key_file: Path | None,
    estimators: tuple[str, ...],
    effects_paths: tuple[Path, ...],
) -> None:
    """Watch wheels being estimated.

    \b
    SOURCE is one of
      serial:///dev/ttyUSB0?baudrate=921600   a hub on a serial port
      tcp://host:port                         a hub behind a TCP server
      ble://NAME-or-ADDRESS                   a hub on Bluetooth LE (treadlink scan lists them)
      sim:demo                                a simulated vehicle (treadlink simulate --list)
      replay:FILE?speed=1                     a recording; speed=10, speed=max

    Keys in the console: space pauses, m marks an event in the recording, tab or 1 to 8 choose the wheel, z zooms the
    waveform, ? helps, q quits. A summary follows the end.
    """
    session = start_session(
        sources,
        config_path=config_path,
        record=record,
        estimators=estimators,
        key_file=key_file,
        effects_paths=effects_paths,
    )
    show_session(session, plain=plain, duration_s=duration_s)


def show_session(session: RunningSession, *, plain: bool, duration_s: float | None) -> None:
    """Run the console, or plain lines where there is no terminal, then the summary."""
    if plain or not is_terminal():
        run_plain(session, duration_s, click.echo)
    else:
        from gateway.views.console.screen import run_console

        run_console(session.live, duration_s)
    end_session(session, click.echo)
