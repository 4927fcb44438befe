"""`treadlink live`: live estimates, on a screen or as lines."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Unpack

import click

from gateway.core.cli.options import (
    PAGE_URI,
    SessionOptions,
    config_option,
    keep_option,
    latency_option,
    plain_option,
    publish_option,
    session_options,
    split_option,
    web_option,
)
from gateway.core.cli.path_option import path_option
from gateway.core.cli.run_options import run_options
from gateway.core.cli.stop_signals import StopRequest, stop_request

if TYPE_CHECKING:
    from gateway.core.cli.session_setup import RunningSession
    from gateway.core.recording.run_description import RunDescription


@click.command()
@click.argument("sources", nargs=-1, required=True, metavar="SOURCE...")
@config_option
@path_option("--record", metavar="PATH", help="Also record to this new .mcap file, or to a new file in this folder.")
@split_option
@keep_option
@plain_option
@web_option
@publish_option
@session_options
@run_options
@latency_option
def live(
    sources: tuple[str, ...],
    record: Path | None,
    split: tuple[str, int] | None,
    keep: int | None,
    plain: bool,
    web: bool,
    publish: tuple[str, ...],
    run: RunDescription,
    latency_s: float,
    **options: Unpack[SessionOptions],
) -> None:
    """Show live estimates of the wheels at SOURCE...

    \b
    SOURCE is one of
      /dev/ttyUSB0:921600  COM3:921600  hub on a serial port, with its baud rate
      192.168.4.1:5000                  hub behind a TCP server
      ble://NAME-or-ADDRESS             hub on Bluetooth LE (treadlink scan)
      sim:demo                          simulated car (treadlink simulate --list)
      replay:FILE?speed=1               recording; also speed=10, speed=max
      can:INTERFACE:CHANNEL?dbc=FILE    signals of the car, beside the wheels
      can:FILE.blf                      the same, from a log
      nmea:/dev/ttyACM0                 position and ground speed by GNSS
      nmea:localhost:2947               the same, from gpsd; nmea:FILE.nmea a log
      rtl433:PIPE  rtl433:FILE.json     tire pressure sensors (TPMS) by rtl_433

    Keys: space pauses, m sets a mark in the recording, r describes the run and records it, a acknowledges alarms, tab
    or 1 to 8 select a wheel, z zooms the waveform, t shows trends, ? shows help, q quits. A summary is printed at the
    end.

    \b
    Examples:
      treadlink live sim:demo --web
      treadlink live /dev/ttyUSB0:921600 --config car.toml --record drives/
    """
    from gateway.core.cli.session_setup import chosen_split, is_terminal, start_session

    if split is not None and record is None:
        raise click.UsageError("--split needs --record.")
    has_form = web or any(uri.startswith("web:") for uri in publish) or (not plain and is_terminal())
    if run and record is None and not has_form:
        raise click.UsageError("--test, --driver, --tire, --comment and --tag are for a recording: give --record.")
    with stop_request() as stop:
        session = start_session(
            sources,
            record=record,
            split=chosen_split(split, keep),
            **options,
            run=run,
            publish=(*publish, PAGE_URI) if web else publish,
            latency_s=latency_s,
        )
        show_session(session, stop, plain=plain)


def show_session(session: RunningSession, stop: StopRequest, *, plain: bool) -> None:
    """Run the screen, or print lines if there is no terminal, then print the summary."""
    from gateway.core.cli.session_setup import ending, is_terminal, run_plain, run_published

    with ending(session, stop):
        if session.publisher is not None and session.publisher.uses_standard_output:
            run_published(session, stop)
        elif plain or not is_terminal():
            from gateway.core.text.aligned_table import for_terminal

            run_plain(session, stop, lambda line: click.echo(for_terminal(line)))
        else:
            from gateway.core.cli.logs import held_back
            from gateway.core.session.session_parts import show_screen

            with held_back():
                show_screen(session.live, lambda: stop.is_set() or session.time_is_up(), session.addresses)
