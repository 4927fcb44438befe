"""Commands to hubs: at every connection of a session, or a single one with its reply."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import suppress
from typing import Final, Protocol, runtime_checkable

from firmware_protocol.codec import encode_frame
from firmware_protocol.decoder import FrameDecoder
from firmware_protocol.messages import (
    COMMANDS,
    EVERY_HUB,
    HUB_ITSELF,
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
from gateway.io.source import LinkEvent, LinkEventKind, LinkItem, Source
from gateway.reasons import Code, Reason
from gateway.views.wording import text

REPLY_TIMEOUT_S: Final = 5.0
_MESSAGE_TYPES: Final = {
    SetStream: MessageType.SET_STREAM,
    SetRate: MessageType.SET_RATE,
    SetTime: MessageType.SET_TIME,
}
_OUTCOMES: Final = {
    Outcome.UNKNOWN_COMMAND: Code.COMMAND_UNKNOWN,
    Outcome.VALUE_REFUSED: Code.COMMAND_VALUE_REFUSED,
    Outcome.FAILED: Code.COMMAND_FAILED,
}


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

    A hub that takes no commands streams without them, so a failed write is not a fault.
    """

    def __init__(self, source: TwoWaySource, clock: Clock) -> None:
        """Wrap a source; the clock gives the time to send."""
        self._source = source
        self._clock = clock

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
        for item in self._source.items(stop):
            yield item
            if isinstance(item, LinkEvent) and item.kind in (LinkEventKind.CONNECTED, LinkEventKind.RESTORED):
                self._send_settings()

    def close(self) -> None:
        """Close the source."""
        self._source.close()

    def _send_settings(self) -> None:
        rate_hz = self._source.rate_hz
        wanted: list[Command] = [SetTime(self._clock.now_ns()), SetStream(True)]
        if rate_hz is not None:
            wanted.insert(1, SetRate(rate_hz))
        with suppress(LinkLostError, SourceError):
            for seq, command in enumerate(wanted):
                self._source.send(command_frame(command, seq))


def with_commands(source: Source, clock: Clock) -> Source:
    """Return a source that sends its hub the settings, or the source itself when it cannot be written to."""
    return CommandedSource(source, clock) if isinstance(source, TwoWaySource) else source


def command_frame(command: Command, seq: int) -> bytes:
    """Return the frame of a command to every wheel of every hub of the link."""
    return encode_frame(Frame(_MESSAGE_TYPES[type(command)], EVERY_HUB, HUB_ITSELF, seq, 0, command))


def execute(source: TwoWaySource, command: Command, timeout_s: float = REPLY_TIMEOUT_S) -> int:
    """Connect, send one command, wait for the reply and return the number of the hub that executed it.

    Raises:
        SourceError: no connection, no reply, or the hub refuses.
    """
    stop, decoder = threading.Event(), FrameDecoder()
    deadline = threading.Timer(timeout_s, stop.set)
    reply: Frame | None = None
    try:
        for item in source.items(stop):
            if isinstance(item, LinkEvent):
                if item.kind is LinkEventKind.CONNECTED:
                    source.send(command_frame(command, 0))
                    deadline.start()
                elif item.kind is LinkEventKind.LOST:
                    raise SourceError(item.text, "Try again.")
                continue
            for frame in decoder.feed(item.data):
                if isinstance(frame.message, CommandResult) and frame.message.command == _MESSAGE_TYPES[type(command)]:
                    reply = frame
                    stop.set()
    finally:
        stop.set()
        deadline.cancel()
    if reply is not None and isinstance(reply.message, CommandResult):
        refused = refusal(reply.message)
        if refused is not None:
            raise SourceError(f"hub {reply.hub} {text(refused)}", "See docs/protocol.md, Commands.")
        return reply.hub
    raise SourceError(
        f"{source.link} did not reply", "Its firmware may take no commands; it then streams without them."
    )


def refusal(result: CommandResult) -> Reason | None:
    """Return why a hub did not execute a command, None when it did."""
    if result.outcome == Outcome.DONE:
        return None
    known = {outcome.value: code for outcome, code in _OUTCOMES.items()}
    code = known.get(result.outcome)
    outcome = Reason(Code.COMMAND_OUTCOME, outcome=result.outcome) if code is None else Reason(code)
    name = MessageType(result.command).name if result.command in COMMANDS else f"command {result.command}"
    return Reason(Code.COMMAND_REFUSED, command=name, outcome=outcome)
