"""Commands to hubs: at every connection of a session, or a single one with its reply."""

import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from typing import Final, NamedTuple

from firmware_protocol.decoder import FrameDecoder
from firmware_protocol.messages import (
    COMMAND_TYPES,
    EVERY_HUB,
    Command,
    CommandResult,
    Frame,
    Hello,
    Outcome,
    SetRate,
    SetStream,
    SetTime,
)
from gateway.core.clock import Clock, wait_until
from gateway.core.errors import LinkLostError, SourceError
from gateway.core.links.source import Chunk, LinkEvent, LinkEventKind, LinkItem, Source, TwoWaySource, WrappedSource
from gateway.core.session.hub_log import refusal
from gateway.core.text.wording import text
from gateway.security.cmac import Key
from gateway.security.command_signing import HubAtLink, HubCommands, command_frame

REPLY_TIMEOUT_S: Final = 5.0
_REPEAT_PERIOD_NS: Final = 1_000_000_000
_NO_KEYS: Final[Mapping[str, Key]] = {}


class CommandedSource(WrappedSource):
    """A source whose hub is sent the time, the rate and a start command at every connection.

    A hub that takes no commands streams without them, so a failed write is not a fault. With keys each start of a hub
    gets signed commands after its hello and its answer to a challenge; without keys they are not signed.
    """

    def __init__(
        self, source: TwoWaySource, clock: Clock, keys: Mapping[str, Key] = _NO_KEYS, *, may_be_unsigned: bool = False
    ) -> None:
        """Wrap a source.

        Args:
            source: to wrap.
            clock: gives the time to send.
            keys: of sensors and hubs by identity.
            may_be_unsigned: whether with keys a hub that does not sign gets unsigned commands.
        """
        super().__init__(source)
        self._source: TwoWaySource = source
        self._clock = clock
        self._keys = keys
        self._may_be_unsigned = may_be_unsigned

    def items(self, stop: threading.Event) -> Iterator[LinkItem]:
        """Yield the items of the source, and send the commands after each connection."""
        greeter: _Greeter | None = None
        for item in self._source.items(stop):
            yield item
            if isinstance(item, Chunk):
                if greeter is not None:
                    with suppress(LinkLostError, SourceError):
                        greeter.read(item.data)
            elif isinstance(item, LinkEvent) and item.kind.is_open:
                if self._keys:
                    commands = HubCommands(self._keys, may_be_unsigned=self._may_be_unsigned)
                    greeter = _Greeter(self._source, self._settings, commands, self._clock)
                    continue
                with suppress(LinkLostError, SourceError):
                    for seq, command in enumerate(self._settings()):
                        self._source.send(command_frame(command, seq))

    def _settings(self) -> list[Command]:
        rate_hz = self._source.rate_hz
        rate = [] if rate_hz is None else [SetRate(rate_hz)]
        return [SetTime(self._clock.now_ns()), *rate, SetStream(True)]


class _Greeter:
    """Sends the settings to every hub of a connection, once for each of its starts."""

    def __init__(
        self, source: TwoWaySource, settings: Callable[[], list[Command]], commands: HubCommands, clock: Clock
    ) -> None:
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
            is_repeated = isinstance(message, CommandResult) and self._commands.resynchronise(hub, message)
            if is_repeated:
                self._greeted.pop(hub.hub, None)
            if self._greeted.get(hub.hub) is hub:
                continue
            if hub.is_present:
                self._greeted[hub.hub] = hub
                for command in self._settings():
                    with suppress(OverflowError):  # no counter is left in this start; the hub streams all the same
                        self._source.send(self._commands.frame(command, hub)[1])
            elif (is_repeated or isinstance(message, Hello)) and self._commands.may_answer_hello(
                hub, self._clock.now_ns()
            ):
                self._answer_hello(hub)

    def _answer_hello(self, hub: HubAtLink) -> None:
        if hub.verifies_commands:
            with suppress(KeyError):  # without its key the hub takes no command; the guard reports that
                self._source.send(self._commands.challenge(hub))
        elif self._commands.may_be_unsigned:
            self._greeted[hub.hub] = hub
            for seq, command in enumerate(self._settings()):
                self._source.send(command_frame(command, seq, hub.hub))


def with_commands(
    source: Source, clock: Clock, keys: Mapping[str, Key] = _NO_KEYS, *, may_be_unsigned: bool = False
) -> Source:
    """Return a source that sends its hub the settings, or the source itself when it cannot be written to."""
    if not isinstance(source, TwoWaySource):
        return source
    return CommandedSource(source, clock, keys, may_be_unsigned=may_be_unsigned)


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
    may_be_unsigned: bool = False,
    timeout_s: float = REPLY_TIMEOUT_S,
) -> Executed:
    """Connect, send one command until the reply comes, and return which hub executed it.

    Command and reply can be lost, so the command is repeated every second under a new counter: it states the wanted
    result, so that carried out twice it changes nothing more. With keys it is signed, and sent to the first hub that
    answers a challenge. A reply counts only if it repeats a counter that was sent.

    Args:
        source: link of the hub.
        command: to execute; the time of a SetTime is that of sending.
        clock: gives that time and those of repetitions, and limits the answers to hellos.
        keys: of sensors and hubs by identity.
        may_be_unsigned: whether with keys a hub that does not sign gets an unsigned command.
        timeout_s: from the connection on.

    Raises:
        SourceError: no connection, no reply, no key, no signature, or the hub refuses.
    """
    exchange = _Exchange(source, command, clock, HubCommands(keys, may_be_unsigned=may_be_unsigned), bool(keys))
    stop = threading.Event()
    try:
        for item in source.items(stop):
            if isinstance(item, LinkEvent):
                if item.kind is LinkEventKind.CONNECTED:
                    exchange.begin()
                    repeat_args = (exchange, clock, clock.now_ns(), timeout_s, stop)
                    threading.Thread(target=_repeat, args=repeat_args, name="command", daemon=True).start()
                elif item.kind is LinkEventKind.LOST:
                    raise SourceError(item.text, "Try again.")
            elif exchange.read(item.data):
                stop.set()
    finally:
        stop.set()
    return exchange.executed()


def _repeat(exchange: "_Exchange", clock: Clock, due_ns: int, timeout_s: float, stop: threading.Event) -> None:
    """Send the command again every second from `due_ns` until stopped, and stop when the time is over."""
    end_ns = due_ns + round(timeout_s * 1e9)
    while wait_until(clock, due_ns := min(due_ns + _REPEAT_PERIOD_NS, end_ns), stop, stop):
        if due_ns == end_ns:
            stop.set()
            return
        with suppress(LinkLostError, SourceError):  # the reading end reports a lost link
            exchange.repeat()


class _Exchange:
    """One command to the first hub of a link that can take it, and the reply; read and repeated by two threads."""

    def __init__(
        self, source: TwoWaySource, command: Command, clock: Clock, commands: HubCommands, has_keys: bool
    ) -> None:
        self._source = source
        self._command = command
        self._clock = clock
        self._commands = commands
        self._has_keys = has_keys
        self._decoder = FrameDecoder(commands)
        self._lock = threading.Lock()
        self._addressee: HubAtLink | None = None
        self._sent: list[int] = []
        self._is_out = False
        self._reply: Frame | None = None
        self._refusal: Frame | None = None

    def begin(self) -> None:
        """Send the command at once if there is no key to sign it with."""
        if not self._has_keys:
            with self._lock:
                self._send_unsigned()

    def repeat(self) -> None:
        """Send again what has had no answer: the command, or the challenges before it."""
        with self._lock:
            addressee = self._addressee
            if self._reply is not None:
                return
            if self._is_out and addressee is not None and addressee.verifies_commands:
                self._send_signed(addressee)
            elif self._is_out:
                self._send_unsigned(EVERY_HUB if addressee is None else addressee.hub)
            else:
                for hub in self._commands.hubs.values():
                    if hub.answered_ns is not None:
                        self._answer_hello(hub)

    def read(self, data: bytes) -> bool:
        """Read a chunk and send what it makes due; return whether the reply has come."""
        with self._lock:
            for frame in self._decoder.feed(data):
                hub = self._commands.hubs.get(frame.hub)
                if self._addressee is not None and frame.hub == self._addressee.hub and hub is not self._addressee:
                    self._addressee, self._sent, self._is_out = None, [], False  # the hub has started again
                if isinstance(frame.message, CommandResult):
                    self._take(frame, frame.message, hub)
                elif self._has_keys and hub is not None and not self._is_out:
                    self._proceed(hub, frame)
                if self._reply is not None:
                    return True
            return False

    def executed(self) -> Executed:
        """Return which hub has executed the command."""
        reply = self._refusal if self._reply is None else self._reply
        if reply is not None and isinstance(reply.message, CommandResult):
            refused = refusal(reply.message)
            if refused is not None:
                raise SourceError(f"hub {reply.hub} {text(refused)}", _remedy(reply.message))
            hub = self._addressee or self._commands.hubs.get(reply.hub)
            protocol = "" if hub is None else "{}.{}".format(*hub.protocol)
            return Executed(reply.hub, self._addressee is not None and self._addressee.verifies_commands, protocol)
        hubs = self._commands.hubs.values()
        if self._has_keys and not self._sent and hubs:
            if any(hub.verifies_commands for hub in hubs):
                raise SourceError(
                    f"{self._source.link} did not reply to the challenge under its hub's key; the command was not sent",
                    "Try again. If it stays so, compare the hub's key with that of `treadlink keys list`.",
                )
            raise SourceError(
                f"{self._source.link} does not sign its frames, or not with a key that is there, or its firmware takes "
                "no signed commands; the command was not sent",
                "Import the keys of its sensors: `treadlink keys import FILE`. If the hub really does not sign, "
                "send the command with --unsigned.",
            )
        sent = f" to the command, sent {len(self._sent)} times" if len(self._sent) > 1 else ""
        raise SourceError(
            f"{self._source.link} did not reply{sent}",
            "Its firmware may take no commands; it then streams without them.",
        )

    def _proceed(self, hub: HubAtLink, frame: Frame) -> None:
        """Send what a hub can take now: the command, or a challenge after a hello."""
        if hub.is_present:
            self._addressee = hub
            if not self._send_signed(hub):
                exhausted = CommandResult(0, COMMAND_TYPES[type(self._command)], Outcome.REPEATED)
                self._reply = frame._replace(message=exhausted)
        elif isinstance(frame.message, Hello):
            self._answer_hello(hub)

    def _answer_hello(self, hub: HubAtLink) -> None:
        if not self._commands.may_answer_hello(hub, self._clock.now_ns()):
            return
        if hub.verifies_commands:
            self._challenge(hub)
        elif self._commands.may_be_unsigned:
            self._addressee = hub
            self._send_unsigned(hub.hub)

    def _challenge(self, hub: HubAtLink) -> None:
        try:
            self._source.send(self._commands.challenge(hub))
        except KeyError as missing:
            raise SourceError(
                f"hub {hub.hub} takes only signed commands, and there is no key for it",
                f"Import the key of {missing.args[0]}: treadlink keys import FILE.",
            ) from missing

    def _command_now(self) -> Command:
        return SetTime(self._clock.now_ns()) if isinstance(self._command, SetTime) else self._command

    def _send_signed(self, hub: HubAtLink) -> bool:
        """Sign and send the command; return False when the hub has no counter left."""
        try:
            seq, data = self._commands.frame(self._command_now(), hub)
        except OverflowError:
            return False
        self._sent.append(seq)
        self._is_out = True
        self._source.send(data)
        return True

    def _send_unsigned(self, hub: int = EVERY_HUB) -> None:
        seq = len(self._sent)
        self._sent.append(seq)
        self._is_out = True
        self._source.send(command_frame(self._command_now(), seq, hub))

    def _take(self, frame: Frame, result: CommandResult, hub: HubAtLink | None) -> None:
        """Take a result for the reply if it can only be that of the command as it was sent."""
        if not self._sent or result.command != COMMAND_TYPES[type(self._command)]:
            return
        if self._addressee is None or not self._addressee.verifies_commands:
            if result.seq in self._sent and (self._addressee is None or frame.hub == self._addressee.hub):
                self._reply = frame
        elif hub is self._addressee:
            if result.outcome in (Outcome.REPEATED, Outcome.NOT_VERIFIED):
                # Such an answer says nothing of the command sent: anybody can provoke it. It may only explain silence.
                self._refusal = frame
                if self._commands.resynchronise(hub, result):
                    self._is_out = False
                    self._challenge(hub)
            elif result.seq in self._sent:
                self._reply = frame


def _remedy(result: CommandResult) -> str:
    if result.outcome == Outcome.NOT_VERIFIED:
        return "The hub takes only commands signed with its key: see `treadlink keys list` and --keys."
    return "See docs/reference/protocol.md, Commands."
