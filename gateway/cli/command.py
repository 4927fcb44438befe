"""`treadlink command`: send a command to a hub and print its reply."""

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
    """Send a command to a hub and print its reply.

    SOURCE is a hub that accepts commands: ble://NAME-or-ADDRESS. The commands `live` and `record` start their hubs and
    set their clocks automatically.
    """


@command.command()
@click.argument("source")
def start(source: str) -> None:
    """Start sending samples."""
    _send(source, SetStream(True))


@command.command()
@click.argument("source")
def stop(source: str) -> None:
    """Stop sending samples until started again or restarted.

    The hub continues to send its status.
    """
    _send(source, SetStream(False))


@command.command()
@click.argument("source")
@click.argument("rate_hz", type=click.FloatRange(MIN_RATE_HZ, MAX_RATE_HZ), metavar="HZ")
def rate(source: str, rate_hz: float) -> None:
    """Set the sampling rate to HZ until the hub restarts.

    The hub uses the nearest rate that it supports.
    """
    _send(source, SetRate(rate_hz))


@command.command()
@click.argument("source")
def time(source: str) -> None:
    """Set the hub's clock to the time of this computer."""
    _send(source, SetTime(_clock.now_ns()))


def _send(uri: str, what: Command) -> None:
    opened = open_source(uri, _clock)
    try:
        if not isinstance(opened, TwoWaySource):
            raise SourceError(f"'{uri}' does not accept commands", "Give a hub on Bluetooth: ble://NAME.")
        click.echo(f"hub {execute(opened, what)} executed the command")
    finally:
        opened.close()
