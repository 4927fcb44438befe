"""`treadlink command`: one command to a hub, and its answer."""

from __future__ import annotations

import click

from firmware_protocol.messages import Command, SetRate, SetStream, SetTime
from firmware_protocol.wire import MAX_RATE_HZ, MIN_RATE_HZ
from gateway.clock import SystemClock
from gateway.errors import SourceError
from gateway.io.source import open_source
from gateway.session.commands import TwoWaySource, execute

_clock = SystemClock()


@click.group()
def command() -> None:
    """Tell a hub what to do, and say what became of it.

    SOURCE is a hub that can be written to: ble://NAME-or-ADDRESS. A session (live, record) starts its hubs and tells
    them the time by itself.
    """


@command.command()
@click.argument("source")
def start(source: str) -> None:
    """Let SOURCE send samples."""
    _tell(source, SetStream(True))


@command.command()
@click.argument("source")
def stop(source: str) -> None:
    """Let SOURCE send no samples until it is told to or starts anew; its status goes on."""
    _tell(source, SetStream(False))


@command.command()
@click.argument("source")
@click.argument("rate_hz", type=click.FloatRange(MIN_RATE_HZ, MAX_RATE_HZ), metavar="HZ")
def rate(source: str, rate_hz: float) -> None:
    """Let SOURCE sample at HZ, or at the nearest that it can, until it starts anew."""
    _tell(source, SetRate(rate_hz))


@command.command()
@click.argument("source")
def time(source: str) -> None:
    """Tell SOURCE this computer's time."""
    _tell(source, SetTime(_clock.now_ns()))


def _tell(uri: str, what: Command) -> None:
    opened = open_source(uri, _clock)
    try:
        if not isinstance(opened, TwoWaySource):
            raise SourceError(f"'{uri}' cannot be written to", "Give a hub on Bluetooth: ble://NAME.")
        click.echo(f"hub {execute(opened, what)} executed the command")
    finally:
        opened.close()
