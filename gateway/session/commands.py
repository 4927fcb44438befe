"""Commands to hubs: at every connection of a session, or a single one with its reply."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Mapping
from contextlib import suppress
from typing import Final, NamedTuple, Protocol, runtime_checkable

from firmware_protocol.decoder import FrameDecoder
from firmware_protocol.messages import (
    COMMAND_TYPES,
    COMMANDS,
    Command,
    CommandResult,
    Frame,
    MessageType,
    Outcome,
    SetRate,
    SetStream,
    SetTime,
)
from gateway.clock import Clock
from gateway.errors import LinkLostError, SourceError
from gateway.io.source import Chunk, LinkEvent, LinkEventKind, LinkItem, Source
from gateway.reasons import Code, Reason
from gateway.security.cmac import Key
from gateway.session.command_signing import HubAtLink, HubCommands, command_frame
from gateway.views.wording import text

REPLY_TIMEOUT_S: Final = 5.0
_OUTCOMES: Final = {
    Outcome.UNKNOWN_COMMAND: Code.COMMAND_UNKNOWN,
    Outcome.VALUE_REFUSED: Code.COMMAND_VALUE_REFUSED,
    Outcome.FAILED: Code.COMMAND_FAILED,
    Outcome.NOT_VERIFIED: Code.COMMAND_NOT_VERIFIED,
    Outcome.REPEATED: Code.COMMAND_REPEATED,
}
_NO_KEYS: Final[Mapping[str, Key]] = {}


@runtime_checkable
class TwoWaySource(Source, Protocol):
    """A source that can be written to.

    Attributes:
        rate_hz: sampling rate to set on its hub, None to leave it.
    """

    rate_hz: float | None

    def send(self, data: bytes) -> None:
        """Write a frame.

        Raises:
            LinkLostError: the write failed.
            SourceError: the hub takes no data.
        """
        ...


class CommandedSource:
    """A source whose hub is sent the time, the rate and a start command at every connection.

    A hub that takes no commands streams without them, so a failed write is not a fault. With keys the commands follow
    the first hello of each start of a hub, which says whether they must be signed; without keys they are not signed.
    """

    def __init__(self, source: TwoWaySource, clock: Clock, keys: Mapping[str, Key] = _NO_KEYS) -> None:
        """Wrap a source; the clock gives the time to send, the keys are those of sensors and hubs by identity."""
        self._source = source
        self._clock = clock
        self._keys = keys

    @property
    def link(self) -> str:
        """Name of the link."""
        return self._source.link

    @property
    def vehicle_toml(self) -> str | None:
        """Configuration that comes with the source."""
        return self._source.vehicle_toml

    def items(self, stop: threading.Event) -> Iterator[LinkItem]:
        """Yield the items of the source, and send the commands after each connection."""
        greeter: _Greeter | None = None
        for item in self._source.items(stop):
            yield item
            if isinstance(item, Chunk):
                if greeter is not None:
                    with suppress(LinkLostError, SourceError):
                        greeter.read(item.data)
            elif isinstance(item, LinkEvent) and item.kind in (LinkEventKind.CONNECTED, LinkEventKind.RESTORED):
                if self._keys:
                    greeter = _Greeter(self._source, self._settings, HubCommands(self._keys), self._clock)
                    continue
                with suppress(LinkLostError, SourceError):
                    for seq, command in enumerate(self._settings()):
                        self._source.send(command_frame(command, seq))

    def close(self) -> None:
        """Close the source."""
        self._source.close()

    def _settings(self) -> list[Command]:
        rate_hz = self._source.rate_hz
        rate = [] if rate_hz is None else [SetRate(rate_hz)]
        return [SetTime(self._clock.now_ns()), *rate, SetStream(True)]


class _Settings(Protocol):
    def __call__(self) -> list[Command]: ...


class _Greeter:
    """Sends the settings to every hub of a connection, once for each of its starts."""

    def __init__(self, source: TwoWaySource, settings: _Settings, commands: HubCommands, clock: Clock) -> None:
        self._source = source
        self._settings = settings
        self._commands = commands
        self._clock = clock
        self._decoder = FrameDecoder(commands)
        self._greeted: dict[int, HubAtLink] = {}

    def read(self, data: bytes) -> None:
        """Read a chunk of the link, and send what it makes due."""
        for frame in self._decoder.feed(data):
            hub = self._commands.hubs.get(frame.hub)
            if hub is None:
                continue
            message = frame.message
            repeated = isinstance(message, CommandResult) and self._commands.resynchronise(hub, message)
            if repeated or self._greeted.get(hub.hub) is not hub:
                self._greeted[hub.hub] = hub
                for command in self._settings():
                    with suppress(KeyError):  # without its key the hub takes no command; the guard reports that
                        self._source.send(self._commands.frame(command, hub, self._clock.now_ns()))


def with_commands(source: Source, clock: Clock, keys: Mapping[str, Key] = _NO_KEYS) -> Source:
    """Return a source that sends its hub the settings, or the source itself when it cannot be written to."""
    return CommandedSource(source, clock, keys) if isinstance(source, TwoWaySource) else source


class Executed(NamedTuple):
    """A command that a hub has executed.

    Attributes:
        hub: number of the hub.
        signed: whether the command was signed.
        protocol: version of the hub's firmware, empty when no hello has come.
    """

    hub: int
    signed: bool
    protocol: str


def execute(
    source: TwoWaySource,
    command: Command,
    clock: Clock,
    *,
    keys: Mapping[str, Key] = _NO_KEYS,
    timeout_s: float = REPLY_TIMEOUT_S,
) -> Executed:
    """Connect, send one command, wait for the reply and return which hub executed it.

    With keys the command follows the hub's hello, which says whether it must be signed.

    Raises:
        SourceError: no connection, no reply, no key, or the hub refuses.
    """
    commands, stop = HubCommands(keys), threading.Event()
    decoder = FrameDecoder(commands)
    deadline = threading.Timer(timeout_s, stop.set)
    sent: HubAtLink | None = None
    reply: Frame | None = None
    try:
        for item in source.items(stop):
            if isinstance(item, LinkEvent):
                if item.kind is LinkEventKind.CONNECTED:
                    deadline.start()
                    if not keys:
                        source.send(command_frame(command, 0))
                elif item.kind is LinkEventKind.LOST:
                    raise SourceError(item.text, "Try again.")
                continue
            for frame in decoder.feed(item.data):
                result, hub = frame.message, commands.hubs.get(frame.hub)
                if isinstance(result, CommandResult) and result.command == COMMAND_TYPES[type(command)]:
                    if hub is not None and commands.resynchronise(hub, result):
                        sent = None
                    elif sent is not None or not keys:
                        reply = frame
                        stop.set()
                if keys and hub is not None and sent is None:
                    sent = hub
                    source.send(_frame(commands, command, hub, clock))
    finally:
        stop.set()
        deadline.cancel()
    if reply is not None and isinstance(reply.message, CommandResult):
        refused = refusal(reply.message)
        if refused is not None:
            raise SourceError(f"hub {reply.hub} {text(refused)}", _remedy(reply.message))
        hub = commands.hubs.get(reply.hub)
        protocol = "" if hub is None else "{}.{}".format(*hub.protocol)
        return Executed(reply.hub, hub is not None and hub.verifies_commands, protocol)
    raise SourceError(
        f"{source.link} did not reply", "Its firmware may take no commands; it then streams without them."
    )


def _frame(commands: HubCommands, command: Command, hub: HubAtLink, clock: Clock) -> bytes:
    try:
        return commands.frame(command, hub, clock.now_ns())
    except KeyError as missing:
        raise SourceError(
            f"hub {hub.hub} takes only signed commands, and there is no key for it",
            f"Import the key of {missing.args[0]}: treadlink keys import FILE.",
        ) from missing


def _remedy(result: CommandResult) -> str:
    if result.outcome == Outcome.NOT_VERIFIED:
        return "The hub takes only commands signed with its key: see `treadlink keys list` and --keys."
    return "See docs/reference/protocol.md, Commands."


def refusal(result: CommandResult) -> Reason | None:
    """Return why a hub did not execute a command, None when it did."""
    if result.outcome == Outcome.DONE:
        return None
    known = {outcome.value: code for outcome, code in _OUTCOMES.items()}
    code = known.get(result.outcome)
    outcome = Reason(Code.COMMAND_OUTCOME, outcome=result.outcome) if code is None else Reason(code)
    name = MessageType(result.command).name if result.command in COMMANDS else f"command {result.command}"
    return Reason(Code.COMMAND_REFUSED, command=name, outcome=outcome)
