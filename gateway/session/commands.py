"""Telling a hub what to do: at every connection of a session, or once and waiting for its answer."""

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

ANSWER_TIMEOUT_S: Final = 5.0
_TYPES: Final = {
    SetStream: MessageType.SET_STREAM,
    SetRate: MessageType.SET_RATE,
    SetTime: MessageType.SET_TIME,
}
_OUTCOMES: Final = {
    Outcome.UNKNOWN_COMMAND: "it does not know this command",
    Outcome.VALUE_REFUSED: "it refuses the value",
    Outcome.FAILED: "it failed",
}


@runtime_checkable
class TwoWaySource(Source, Protocol):
    """A source that can be written to.

    Attributes:
        rate_hz: sampling rate that the user wants of its hub, None to leave it.
    """

    rate_hz: float | None

    def send(self, data: bytes) -> None:
        """Write a frame.

        Raises:
            LinkLostError: it did not go out.
            SourceError: the hub takes none.
        """
        ...


class CommandedSource:
    """A source whose hub is told the time, the rate and to start streaming whenever it is connected.

    A hub that takes no commands streams of itself, so that a write that fails is no fault.
    """

    def __init__(self, source: TwoWaySource, clock: Clock) -> None:
        """Wrap `source`; the clock is what the hub is told."""
        self._source = source
        self._clock = clock

    @property
    def link(self) -> str:
        """Name of the link."""
        return self._source.link

    @property
    def vehicle_toml(self) -> str | None:
        """Configuration that the source brings along."""
        return self._source.vehicle_toml

    def items(self, stop: threading.Event) -> Iterator[LinkItem]:
        """Yield the source's items, and send commands after each that says that it is connected."""
        for item in self._source.items(stop):
            yield item
            if isinstance(item, LinkEvent) and item.kind in (LinkEventKind.CONNECTED, LinkEventKind.RESTORED):
                self._greet()

    def close(self) -> None:
        """Close the source."""
        self._source.close()

    def _greet(self) -> None:
        rate_hz = self._source.rate_hz
        wanted: list[Command] = [SetTime(self._clock.now_ns()), SetStream(True)]
        if rate_hz is not None:
            wanted.insert(1, SetRate(rate_hz))
        with suppress(LinkLostError, SourceError):
            for seq, command in enumerate(wanted):
                self._source.send(command_frame(command, seq))


def with_commands(source: Source, clock: Clock) -> Source:
    """Return `source` so that its hub is told what it needs, or as it is where nothing can be told."""
    return CommandedSource(source, clock) if isinstance(source, TwoWaySource) else source


def command_frame(command: Command, seq: int) -> bytes:
    """Return the frame of a command to every wheel of every hub of the link."""
    return encode_frame(Frame(_TYPES[type(command)], EVERY_HUB, HUB_ITSELF, seq, 0, command))


def carry_out(source: TwoWaySource, command: Command, timeout_s: float = ANSWER_TIMEOUT_S) -> str:
    """Connect, send one command, wait for the answer and return what became of it, in words.

    Raises:
        SourceError: no connection, no answer, or the hub refuses.
    """
    stop, decoder = threading.Event(), FrameDecoder()
    impatience = threading.Timer(timeout_s, stop.set)
    answer: Frame | None = None
    try:
        for item in source.items(stop):
            if isinstance(item, LinkEvent):
                if item.kind is LinkEventKind.CONNECTED:
                    source.send(command_frame(command, 0))
                    impatience.start()
                elif item.kind is LinkEventKind.LOST:
                    raise SourceError(item.text, "Try again.")
                continue
            for frame in decoder.feed(item.data):
                if isinstance(frame.message, CommandResult) and frame.message.command == _TYPES[type(command)]:
                    answer = frame
                    stop.set()
    finally:
        stop.set()
        impatience.cancel()
    if answer is not None and isinstance(answer.message, CommandResult):
        refused = refusal(answer.message)
        if refused:
            raise SourceError(f"hub {answer.hub} did not do as told: {refused}", "See docs/protocol.md, Commands.")
        return f"hub {answer.hub} has done it"
    raise SourceError(f"{source.link} did not answer", "Its firmware may take no commands; it streams of itself then.")


def refusal(result: CommandResult) -> str:
    """Return why a hub did not do as told, empty when it did."""
    if result.outcome == Outcome.DONE:
        return ""
    known = {outcome.value: text for outcome, text in _OUTCOMES.items()}
    name = MessageType(result.command).name if result.command in COMMANDS else f"command {result.command}"
    return f"{name}: {known.get(result.outcome, f'outcome {result.outcome}')}"
