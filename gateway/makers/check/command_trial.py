"""Commands that try out a hub, and what it must answer. Sans-io: frames and the time in, bytes to send out."""

import struct
from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final
from zlib import crc32

from firmware_protocol import wire
from firmware_protocol.codec import encode_payload, encode_raw
from firmware_protocol.messages import (
    COMMAND_TYPES,
    COMMANDS,
    HUB_ITSELF,
    Command,
    CommandResult,
    Hello,
    HubStatus,
    MessageType,
    Outcome,
    SampleBlock,
    SetRate,
    SetStream,
    SetTime,
    TimeSync,
)
from firmware_protocol.signing import is_signed, sign
from gateway.core.reasons import Reason
from gateway.makers.check.clauses import Clause, Ledger
from gateway.makers.check.seen_frame import SeenFrame
from gateway.makers.reasons import FirmwareCode
from gateway.security.cmac import Key, mac
from gateway.security.command_signing import HubAtLink, HubCommands

CLAUSES: Final = (
    Clause.COMMAND_ANSWER,
    Clause.COMMAND_CRC,
    Clause.COMMAND_UNKNOWN,
    Clause.COMMAND_VALUE,
    Clause.COMMAND_TIME,
    Clause.COMMAND_STREAM,
    Clause.COMMAND_RATE,
    Clause.COMMAND_REPEATED,
    Clause.COMMAND_VERIFIED,
)
_SEQ: Final = wire.HEADER.reader("seq")
_ANSWER_S: Final = 2.0
_QUIET_S: Final = 1.0
# What was made before a command may still be on its way.
_TRANSIT_S: Final = 0.5
_UNKNOWN_TYPE: Final = 63
_LOW_RATE_HZ: Final = 1.0
_U32: Final = 0xFFFF_FFFF

_FrameTest = Callable[[SeenFrame], bool]
_Script = Generator[tuple[float, _FrameTest], SeenFrame | None, None]
_Answer = Generator[tuple[float, _FrameTest], SeenFrame | None, SeenFrame | None]


@dataclass(slots=True)
class _Wait:
    """What a script waits for, and until when."""

    until_s: float
    wanted: _FrameTest


class CommandTrial:
    """Trial of the first hub that says hello: one command after the other, each with its answer.

    Attributes:
        pausing: hub whose samples a command may have stopped or started since the last look, None for none.
    """

    def __init__(self, ledger: Ledger, keys: Mapping[str, Key]) -> None:
        """Take the keys of sensors and hubs by identity."""
        self.pausing: int | None = None
        self._ledger = ledger
        self._commands = HubCommands(keys)
        self._now_ns = 0
        self._outgoing: list[bytes] = []
        self._hub = 0
        self._signs = False
        self._rates_hz: dict[int, float] = {}
        self._seq: int | None = None
        self._done = False
        self._script = self._trial()
        self._wait = _Wait(*next(self._script))

    def step(self, frames: Sequence[SeenFrame], now_ns: int) -> bytes:
        """Take frames and the time; return what is to be sent."""
        self._now_ns = now_ns
        for frame in frames:
            self._commands(frame.data)
            if isinstance(frame.message, Hello) and frame.wheel != HUB_ITSELF and frame.hub == self._hub:
                self._rates_hz[frame.wheel] = frame.message.rate_hz
            self._signs |= is_signed(frame.data)
            if not self._done and self._wait.wanted(frame):
                self._resume(frame)
        if not self._done and now_ns * 1e-9 > self._wait.until_s:
            self._resume(None)
        out, self._outgoing = b"".join(self._outgoing), []
        return out

    def sent(self, host_ns: int) -> None:
        """Note when the bytes of the last step left: what is waited for may come as much later."""
        self._wait.until_s += max(host_ns - self._now_ns, 0) * 1e-9

    def finish(self) -> None:
        """End the trial, and say why what was not tried was not."""
        if not self._done:
            self._leave(Reason(FirmwareCode.CHECK_NOT_DONE, why="stopped_early"))
        self._done = True

    def _resume(self, frame: SeenFrame | None) -> None:
        try:
            self._wait = _Wait(*self._script.send(frame))
        except StopIteration:
            self._done = True

    def _deadline_s(self, seconds: float) -> float:
        return self._now_ns * 1e-9 + seconds

    def _leave(self, reason: Reason) -> None:
        for clause in CLAUSES:
            self._ledger.leave(clause, reason)

    def _trial(self) -> _Script:
        hello = yield float("inf"), lambda frame: isinstance(frame.message, Hello) and frame.wheel != HUB_ITSELF
        assert hello is not None  # without an end of the time
        self._hub = hello.hub
        assert isinstance(hello.message, Hello)
        self._rates_hz[hello.wheel] = hello.message.rate_hz
        verifies = self._signs and hello.message.protocol_minor >= wire.SIGNED_COMMANDS_MINOR
        if verifies:
            yield from self._unsigned()
            if self._hub_at_link is None or not self._hub_at_link.verifies_commands or self._hub_at_link.key is None:
                self._leave(Reason(FirmwareCode.CHECK_NOT_DONE, why="no_key", identity=f"{hello.message.hub_id:016x}"))
                return
        time = SetTime(self._now_ns)
        answer = yield from self._execute(Clause.COMMAND_ANSWER, time, is_first=True)
        if answer is None:
            self._leave(Reason(FirmwareCode.CHECK_NOT_DONE, why="hub_takes_no_commands"))
            return
        yield from self._time(time.host_ns)
        yield from self._damaged()
        yield from self._raw(Clause.COMMAND_UNKNOWN, _UNKNOWN_TYPE, b"", Outcome.UNKNOWN_COMMAND)
        payload = struct.pack("<f", _LOW_RATE_HZ)
        yield from self._raw(Clause.COMMAND_VALUE, MessageType.SET_RATE, payload, Outcome.VALUE_REFUSED)
        yield from self._stream(is_signed=verifies)
        yield from self._rate()

    @property
    def _hub_at_link(self) -> HubAtLink | None:
        return self._commands.hubs.get(self._hub)

    # Single commands

    def _unsigned(self) -> _Script:
        """An unsigned command to a hub that signs must be refused."""
        frame = encode_raw(MessageType.SET_STREAM, encode_payload(SetStream(True)), self._hub, HUB_ITSELF, 0, 0)
        yield from self._send(Clause.COMMAND_VERIFIED, frame, Outcome.NOT_VERIFIED)

    def _execute(self, clause: Clause, command: Command, *, is_first: bool = False) -> _Answer:
        """Send a command that must be done; return the answer."""
        frame = self._frame(COMMAND_TYPES[type(command)], encode_payload(command))
        return (yield from self._send(clause, frame, Outcome.DONE, is_first=is_first))

    def _raw(self, clause: Clause, type_: int, payload: bytes, expected: Outcome) -> _Answer:
        return (yield from self._send(clause, self._frame(type_, payload), expected))

    def _send(self, clause: Clause, frame: bytes, expected: Outcome, *, is_first: bool = False) -> _Answer:
        """Send a frame and judge the answer; None when none came."""
        self._outgoing.append(frame)
        answer = yield self._deadline_s(_ANSWER_S), self._is_answer
        type_, seq = frame[wire.TYPE_OFFSET], _SEQ.unpack_from(frame)[0]
        name = MessageType(type_).name if type_ in COMMANDS else f"type {type_}"
        if answer is None:
            if not is_first:
                self._ledger.check(Clause.COMMAND_ANSWER)
                reason = Reason(FirmwareCode.ANSWER_WRONG, how="late", command=name, waited_s=_ANSWER_S)
                self._ledger.fail(Clause.COMMAND_ANSWER, f"hub {self._hub}", reason, frame)
            return None
        result = answer.message
        assert isinstance(result, CommandResult)
        self._ledger.check(Clause.COMMAND_ANSWER)
        self._ledger.check(clause)
        if answer.wheel != HUB_ITSELF:
            self._ledger.fail(
                Clause.COMMAND_ANSWER, answer, Reason(FirmwareCode.ANSWER_WRONG, how="not_of_hub", wheel=answer.wheel)
            )
        # With outcome 5 it is the highest counter so far.
        if result.command != type_ or (result.seq != seq and result.outcome != Outcome.REPEATED):
            reason = Reason(
                FirmwareCode.ANSWER_WRONG,
                how="other_command",
                command=result.command,
                seq=result.seq,
                sent=type_,
                sent_seq=seq,
            )
            self._ledger.fail(Clause.COMMAND_ANSWER, answer, reason)
        elif result.outcome != expected:
            reason = Reason(
                FirmwareCode.ANSWER_WRONG, how="outcome", command=name, outcome=result.outcome, expected=int(expected)
            )
            self._ledger.fail(clause, answer, reason)
        return answer

    def _is_answer(self, frame: SeenFrame) -> bool:
        return isinstance(frame.message, CommandResult) and frame.hub == self._hub

    def _frame(self, type_: int, payload: bytes) -> bytes:
        """Return a command to the hub itself, signed if it verifies commands, with the next counter."""
        hub = self._hub_at_link
        signs = hub is not None and hub.verifies_commands
        if self._seq is None:
            # A counter above that of every session before, without a memory.
            self._seq = min(self._now_ns // 1_000_000_000, _U32) if signs else 0
        frame = encode_raw(type_, payload, self._hub, HUB_ITSELF, self._seq, 0)
        self._seq = min(self._seq + 1, _U32)
        if hub is None or hub.key is None or not signs:
            return frame
        key = hub.key
        return sign(frame, hub.hub_id, hub.boot_count, lambda data: mac(key, data))

    # Steps

    def _time(self, host_ns: int) -> _Script:
        """TIME_SYNC repeats the time that was set."""
        echo = yield (
            self._deadline_s(_ANSWER_S + wire.TIME_SYNC_PERIOD_S),
            lambda frame: isinstance(frame.message, TimeSync) and frame.hub == self._hub,
        )
        self._ledger.check(Clause.COMMAND_TIME)
        if echo is None or not isinstance(echo.message, TimeSync):
            return
        if echo.message.host_ns != host_ns:
            reason = Reason(FirmwareCode.TIME_NOT_ECHOED, host_ns=echo.message.host_ns, sent_ns=host_ns)
            self._ledger.fail(Clause.COMMAND_TIME, echo, reason)

    def _damaged(self) -> _Script:
        """A command with a wrong CRC is dropped without an answer."""
        frame = self._frame(MessageType.SET_STREAM, encode_payload(SetStream(True)))
        body = frame[: -wire.CRC_BYTES]
        self._outgoing.append(body + struct.pack("<I", crc32(body) ^ 1))
        answer = yield self._deadline_s(_QUIET_S), self._is_answer
        self._ledger.check(Clause.COMMAND_CRC)
        if answer is not None:
            self._ledger.fail(Clause.COMMAND_CRC, answer, Reason(FirmwareCode.ANSWER_WRONG, how="to_damaged"))

    def _stream(self, *, is_signed: bool) -> _Script:
        """Samples stop and start; everything else goes on. The same command again is done again, or refused."""
        self.pausing = self._hub
        stopped = yield from self._execute(Clause.COMMAND_STREAM, SetStream(False))
        if stopped is not None and isinstance(stopped.message, CommandResult) and not stopped.message.outcome:
            yield self._deadline_s(_TRANSIT_S), lambda _: False
            late = yield self._deadline_s(_QUIET_S), self._is_samples
            if late is not None:
                self._ledger.fail(
                    Clause.COMMAND_STREAM,
                    late,
                    Reason(FirmwareCode.COMMAND_FUTILE, command="stream_off", waited_s=_TRANSIT_S),
                )
            status = yield self._deadline_s(_ANSWER_S), lambda frame: isinstance(frame.message, HubStatus)
            if status is None:
                reason = Reason(
                    FirmwareCode.MESSAGE_RATE_WRONG, type="HUB_STATUS", count=0, span_s=_ANSWER_S, due=_ANSWER_S
                )
                self._ledger.fail(Clause.COMMAND_STREAM, f"hub {self._hub}", reason)
        self.pausing = self._hub
        frame = self._frame(MessageType.SET_STREAM, encode_payload(SetStream(True)))
        yield from self._send(Clause.COMMAND_STREAM, frame, Outcome.DONE)
        samples = yield self._deadline_s(_ANSWER_S), self._is_samples
        if samples is None:
            reason = Reason(FirmwareCode.COMMAND_FUTILE, command="stream_on", waited_s=_ANSWER_S)
            self._ledger.fail(Clause.COMMAND_STREAM, f"hub {self._hub}", reason)
        expected = Outcome.REPEATED if is_signed else Outcome.DONE
        yield from self._send(Clause.COMMAND_REPEATED, frame, expected)

    def _is_samples(self, frame: SeenFrame) -> bool:
        return isinstance(frame.message, SampleBlock) and frame.hub == self._hub

    def _rate(self) -> _Script:
        """HELLO follows, with another rate if the sensor supports one; then the former rate is set again."""
        wheel, former_hz = next(iter(self._rates_hz.items()))
        half = former_hz / 2.0
        changed_hz = half if half >= wire.MIN_RATE_HZ else min(2.0 * former_hz, wire.MAX_RATE_HZ)
        for trial_hz in (changed_hz, former_hz):
            self.pausing = self._hub
            answer = yield from self._execute(Clause.COMMAND_RATE, SetRate(trial_hz))
            if answer is None or not isinstance(answer.message, CommandResult) or answer.message.outcome:
                return
            hello = yield (
                self._deadline_s(_ANSWER_S + wire.HELLO_PERIOD_S),
                lambda frame: isinstance(frame.message, Hello) and frame.source == (self._hub, wheel),
            )
            self.pausing = self._hub
            if hello is None or not isinstance(hello.message, Hello):
                reason = Reason(FirmwareCode.COMMAND_FUTILE, command="rate", stated_hz=former_hz, waited_s=_ANSWER_S)
                self._ledger.fail(Clause.COMMAND_RATE, f"hub {self._hub}", reason)
            elif trial_hz == former_hz and hello.message.rate_hz != former_hz:
                reason = Reason(
                    FirmwareCode.COMMAND_FUTILE, command="rate", stated_hz=hello.message.rate_hz, waited_s=0.0
                )
                self._ledger.fail(Clause.COMMAND_RATE, hello, reason)
