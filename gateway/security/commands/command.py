"""`treadlink command`: send a command to a hub and print its reply."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from firmware_protocol.wire import MAX_RATE_HZ, MIN_RATE_HZ
from gateway.core.cli.options import FiniteRange, keys_option
from gateway.core.clock import SystemClock
from gateway.core.errors import SourceError

if TYPE_CHECKING:
    from firmware_protocol.messages import Command
    from gateway.security.hub_commands import Executed

_clock = SystemClock()
_unsigned_option = click.option(
    "--unsigned",
    is_flag=True,
    help="Send unsigned to a hub that does not sign. Whoever can write to the link can pass for one.",
)


@click.group()
def command() -> None:
    """Send a command to a hub and print its reply.

    SOURCE is a hub: serial:PORT, tcp://HOST:PORT or ble://NAME-or-ADDRESS. Where there are keys,
    commands are signed, and go only to a hub that proves that it has the same key; --unsigned also allows others.
    If a session of yours has the hub, the command goes through it (not on Windows).
    `live` and `record` start their hubs and set their clocks automatically.
    """


@command.command()
@click.argument("source")
@keys_option
@_unsigned_option
def start(source: str, key_file: Path | None, unsigned: bool) -> None:
    """Start sending samples.

    Example: `treadlink command start /dev/ttyUSB0:921600`
    """
    from firmware_protocol.messages import SetStream

    _send(source, SetStream(True), key_file, unsigned)


@command.command()
@click.argument("source")
@keys_option
@_unsigned_option
def stop(source: str, key_file: Path | None, unsigned: bool) -> None:
    """Stop sending samples until started again or restarted.

    The hub continues to send its status.

    Example: `treadlink command stop /dev/ttyUSB0:921600`
    """
    from firmware_protocol.messages import SetStream

    _send(source, SetStream(False), key_file, unsigned)


@command.command()
@click.argument("source")
@click.argument("rate_hz", type=FiniteRange(MIN_RATE_HZ, MAX_RATE_HZ), metavar="HZ")
@keys_option
@_unsigned_option
def rate(source: str, rate_hz: float, key_file: Path | None, unsigned: bool) -> None:
    """Set the sampling rate to HZ until the hub restarts.

    The hub uses the nearest rate that it supports.

    Example: `treadlink command rate /dev/ttyUSB0:921600 4800`
    """
    from firmware_protocol.messages import SetRate

    _send(source, SetRate(rate_hz), key_file, unsigned)


@command.command()
@click.argument("source")
@keys_option
@_unsigned_option
def time(source: str, key_file: Path | None, unsigned: bool) -> None:
    """Set the hub's clock to the time of this computer.

    Example: `treadlink command time ble://Treadlink-FL`
    """
    from firmware_protocol.messages import SetTime

    _send(source, SetTime(_clock.now_ns()), key_file, unsigned)


def _send(uri: str, hub_command: Command, key_file: Path | None, unsigned: bool) -> None:
    from gateway.core.links.source import Source, TwoWaySource, open_source
    from gateway.security.control_socket import SessionSource, session_of
    from gateway.security.hub_commands import execute
    from gateway.security.key_file import command_keys

    opened: Source = open_source(uri, _clock)
    try:
        if not isinstance(opened, TwoWaySource):
            raise SourceError(f"'{uri}' does not accept commands", "Give serial:PORT, tcp://HOST:PORT or ble://NAME.")
        session = session_of(opened.link)
        way = f", through the session of process {session.process}" if session is not None else ""
        if session is not None:
            opened = SessionSource(opened.link, session.connection, _clock)
        keys = command_keys(key_file)
        executed = execute(opened, hub_command, _clock, keys=keys, may_be_unsigned=unsigned)
        click.echo(f"hub {executed.hub} executed the command{_signature(executed, bool(keys))}{way}")
    finally:
        opened.close()


def _signature(done: Executed, has_keys: bool) -> str:
    if done.signed:
        return ", which was signed"
    if not has_keys:
        return ""
    return f", which was not signed: the hub does not verify commands (protocol {done.protocol})"
