"""Check of the bytes of a link against the specification of the protocol, clause by clause. Sans-io.

The rules that every reader follows are those of `gateway.core.session.statement_watch`; what only the author of a
firmware wants to know is checked beside it.
"""

import re
from collections.abc import Mapping
from typing import Final

from firmware_protocol import wire
from firmware_protocol.checks import PayloadError
from firmware_protocol.codec import DECODERS, decode_payload
from firmware_protocol.frame_blocks import FrameList
from firmware_protocol.framing import next_frame
from firmware_protocol.messages import (
    HUB_ITSELF,
    Environment,
    Hello,
    Message,
    MessageType,
    SampleBlock,
    TimeSync,
)
from firmware_protocol.signing import is_signed
from gateway.core.links.source import Chunk
from gateway.core.reasons import Code, Reason
from gateway.core.session.line_content import identify_content
from gateway.core.session.reasons import SessionCode
from gateway.core.session.statement_watch import StatementWatch
from gateway.core.wheels.reasons import WheelCode
from gateway.makers.check.clauses import CheckReport, Clause, Ledger
from gateway.makers.check.clock_rules import ClockRules
from gateway.makers.check.counter_rules import CounterRules
from gateway.makers.check.damaged_frames import diagnosis
from gateway.makers.check.message_rules import MessageRules
from gateway.makers.check.seen_frame import SeenFrame
from gateway.makers.check.signal_rules import SignalRules
from gateway.makers.check.signature_rules import SignatureRules
from gateway.makers.reasons import FirmwareCode
from gateway.security.cmac import Key

RADIUS_M: Final = 0.32
"""Belt radius of a tire of a car, where none is given."""

_HEADER: Final = wire.HEADER.reader("version", "type", "hub", "wheel", "flags", "seq", "tick_us")
# Bytes without a frame that are kept for their diagnosis.
_MAX_NOISE_BYTES: Final = 16_384
# What no port lacks that is in raw mode, in so many bytes: XON and XOFF, a carriage return, a line feed alone.
_OFTEN_ALTERED: Final[tuple[bytes, ...]] = rb"[\x11\x13]", rb"\r", rb"(?<!\r)\n"
_MIN_ALTERED_BYTES: Final = 65_536

CLAUSE_OF: Final[Mapping[Code, Clause]] = {
    WheelCode.HELLO_AC_WITH_STEADY_VALUE: Clause.COUPLING,
    SessionCode.HELLO_AXES_DIFFER: Clause.AXES,
    SessionCode.HELLO_HIGHPASS_WITH_DC: Clause.HELLO_COUPLING,
    SessionCode.HELLO_KEEPS_CHANGING: Clause.HELLO_SENSOR,
    SessionCode.HELLO_RATE_DIFFERS: Clause.RATE,
    SessionCode.HELLO_SCALE_ABSURD: Clause.SCALE_RANGE,
    SessionCode.HELLO_SCALE_AGAINST_RANGE: Clause.SCALE_RANGE,
    SessionCode.HELLO_SCALE_ZERO: Clause.HELLO_VALUES,
    SessionCode.HELLO_SENSORS_ALTERNATE: Clause.HELLO_SENSOR,
    SessionCode.HELLO_ZERO_ABSURD: Clause.HELLO_VALUES,
    SessionCode.HUB_BOOT_COUNTS_DIFFER: Clause.BOOT_COUNT,
    SessionCode.HUB_CLOCK_STILL: Clause.TICK_MONOTONIC,
    SessionCode.HUB_NUMBER_RESERVED: Clause.HUB_NUMBER,
    SessionCode.HUB_SENDS_AS_WHEEL: Clause.HUB_ITSELF,
    SessionCode.HUB_SENDS_COMMANDS: Clause.TYPES,
    SessionCode.HUB_TIME_AGAINST_TICK: Clause.TIME_VALUES,
    SessionCode.PRESSURE_IMPOSSIBLE: Clause.ENVIRONMENT_VALUES,
    WheelCode.SAMPLES_BYTES_SWAPPED: Clause.BYTE_ORDER,
    SessionCode.SAMPLES_REPEATED: Clause.ONCE,
    SessionCode.SAMPLE_NUMBERS_JUMP: Clause.NUMBERS,
    SessionCode.TEMPERATURE_IMPOSSIBLE: Clause.ENVIRONMENT_VALUES,
}
"""Clause that each finding of StatementWatch is against."""

_ADVICE: Final = frozenset({Clause.HUB_NUMBER})


class FirmwareCheck:
    """Check of one link.

    Attributes:
        frames: intact frames so far.
        ledger: what was exercised and found so far.
    """

    def __init__(
        self,
        link: str,
        keys: Mapping[str, Key],
        *,
        radius_m: float = RADIUS_M,
        capacity_bytes_per_s: float | None = None,
    ) -> None:
        """Start before the first byte.

        Args:
            link: its name.
            keys: of sensors and hubs, by identity.
            radius_m: belt radius of a wheel that rolls.
            capacity_bytes_per_s: what the link carries, None where that is not known.
        """
        self.frames = 0
        self.ledger = Ledger()
        self._link = link
        self._capacity = capacity_bytes_per_s
        self._counters = CounterRules(self.ledger)
        self._clock = ClockRules(self.ledger)
        self._messages = MessageRules(self.ledger, self._counters)
        self._signal = SignalRules(self.ledger, radius_m)
        self._signatures = SignatureRules(self.ledger, keys)
        self._watch = StatementWatch(review_blocks=1)
        self._tail = b""
        self._missing_bytes = _OFTEN_ALTERED
        self._size = 0
        self._begin_ns: int | None = None
        self._end_ns = 0
        self._noise = b""
        self._noise_at = 0
        self._noise_bytes = 0
        self._damaged = 0
        self._first_damage: tuple[int, bytes] | None = None

    def chunk(self, chunk: Chunk) -> list[SeenFrame]:
        """Take bytes of the link; return the frames that they complete."""
        if self._begin_ns is None:
            self._begin_ns = chunk.host_ns
        self._end_ns = max(self._end_ns, chunk.host_ns)
        # A dump has no arrival times.
        host_s = (chunk.host_ns - self._begin_ns) * 1e-9 if chunk.host_ns else None
        base = self._size - len(self._tail)
        self._size += len(chunk.data)
        buffer = self._tail + chunk.data
        self._missing_bytes = tuple(pattern for pattern in self._missing_bytes if not re.search(pattern, buffer))
        start, frames = 0, []
        while True:
            offset, end, damaged = next_frame(buffer, start)
            self._note_noise(base + start, buffer[start:offset], damaged)
            if not end:
                break
            frame = self._frame(base + offset, buffer[offset:end], host_s, after_damage=damaged > 0 or offset > start)
            if frame is not None:
                frames.append(frame)
            start = end
        self._tail = buffer[offset:]
        return frames

    def _note_noise(self, at_byte: int, data: bytes, damaged: int) -> None:
        """Note bytes that belong to no intact frame."""
        if not data:
            return
        if not self._noise:
            self._noise_at = at_byte
        self._noise += data[: _MAX_NOISE_BYTES - len(self._noise)]
        # A stream may begin in the middle of a frame.
        if not self.frames and at_byte + len(data) < wire.MAX_FRAME_BYTES:
            return
        self._noise_bytes += len(data)
        self._damaged += damaged
        if self._first_damage is None or (damaged and wire.SYNC not in self._first_damage[1]):
            self._first_damage = at_byte, data

    def _frame(self, at_byte: int, data: bytes, host_s: float | None, *, after_damage: bool) -> SeenFrame | None:
        """Check an intact frame; return it unless it is of another major version."""
        self.frames += 1
        for clause in (Clause.SYNC, Clause.CONTIGUOUS, Clause.LENGTH, Clause.CRC, Clause.VERSION):
            self.ledger.check(clause)
        version, type_, hub, wheel, flags, seq, tick_us = _HEADER.unpack_from(data)
        frame = SeenFrame(at_byte, host_s, data, type_, hub, wheel, flags, seq, tick_us, None)
        if version != wire.VERSION_BYTE:
            self.ledger.fail(
                Clause.VERSION, frame, Reason(FirmwareCode.HEADER_WRONG, field="version", value=f"{version:#04x}")
            )
            if version >> 4 != wire.VERSION_MAJOR:
                return None
        self.ledger.check(Clause.TYPES)
        self.ledger.check(Clause.FLAGS)
        if flags & ~wire.KNOWN_FLAGS:
            self.ledger.fail(
                Clause.FLAGS, frame, Reason(FirmwareCode.HEADER_WRONG, field="flags", value=f"{flags:#04x}")
            )
        if type_ not in DECODERS:
            self.ledger.fail(Clause.TYPES, frame, Reason(FirmwareCode.HEADER_WRONG, field="type", value=type_))
        elif flags & wire.SIGNED_FLAG and not is_signed(data):
            self.ledger.fail(Clause.LAYOUT, frame, Reason(FirmwareCode.HEADER_WRONG, field="tag"))
        else:
            frame = frame._replace(message=self._content(frame))
        self._rules(frame, after_damage=after_damage)
        return frame

    def _content(self, frame: SeenFrame) -> Message | None:
        """Return the content of a frame; None where it breaks its layout."""
        self.ledger.check(Clause.LAYOUT)
        self.ledger.check(Clause.RANGES)
        try:
            return decode_payload(frame.type, frame.payload)
        except PayloadError as error:
            name, layout = MessageType(frame.type).name, error.layout_bytes
            if layout is None:
                self.ledger.fail(
                    Clause.RANGES, frame, Reason(FirmwareCode.PAYLOAD_WRONG, what="value", type=name, field=error.field)
                )
                return None
            reason = Reason(
                FirmwareCode.PAYLOAD_WRONG, what="length", type=name, length=len(frame.payload), layout=layout
            )
            self.ledger.fail(Clause.LAYOUT, frame, reason)
            return None

    def _rules(self, frame: SeenFrame, *, after_damage: bool) -> None:
        """Hand a frame to all rules."""
        lost = self._counters.lost(frame.source)
        if self._counters.frame(frame, after_damage=after_damage):
            self._clock.restarted(frame.hub)
            self._messages.restarted(frame.hub)
        if self._counters.lost(frame.source) != lost:
            self._clock.lost(frame.source)
        self._signatures.frame(frame)
        self._messages.frame(frame)
        if frame.message is None:
            return
        self._exercised(frame)
        self._clock.frame(frame)
        self._signal.frame(frame)
        self._watch.take(self._link, FrameList([frame.as_frame]))
        for notice in self._watch.new():
            clause = CLAUSE_OF.get(notice.reason.code)
            if clause is not None:
                self.ledger.fail(
                    clause, notice.subject, notice.reason, frame.data, frame.at_byte, is_advice=clause in _ADVICE
                )

    def _exercised(self, frame: SeenFrame) -> None:
        """Note the clauses of StatementWatch that a frame exercises."""
        self.ledger.check(Clause.HUB_ITSELF)
        self.ledger.check(Clause.HUB_NUMBER)
        if isinstance(frame.message, SampleBlock) and frame.wheel != HUB_ITSELF:
            self.ledger.check(Clause.AXES)
            self.ledger.check(Clause.ONCE)
        elif isinstance(frame.message, Environment):
            self.ledger.check(Clause.ENVIRONMENT_VALUES)
        elif isinstance(frame.message, TimeSync):
            self.ledger.check(Clause.TIME_VALUES)
        elif isinstance(frame.message, Hello):
            self.ledger.check(Clause.BOOT_COUNT)

    def may_pause(self, hub: int) -> None:
        """Note that a hub may leave out samples before its next blocks: a command has stopped or started them."""
        self._clock.may_pause(hub)

    def finish(self) -> CheckReport:
        """Judge what the whole stream shows, and return the results."""
        self._judge_noise()
        self._counters.finish()
        self._signal.finish()
        for notice in self._watch.contradictions():
            clause, count = CLAUSE_OF.get(notice.reason.code), dict(notice.reason.values).get("count")
            if clause is not None and isinstance(count, int | float):
                self.ledger.restate(clause, notice.subject, notice.reason, int(count))
        self._clock.finish()
        self._messages.finish(self._capacity)
        duration_s = (self._end_ns - self._begin_ns) * 1e-9 if self._begin_ns is not None else 0.0
        return CheckReport(self._link, duration_s, self._size, self.frames, self.ledger.results())

    def _judge_noise(self) -> None:
        """Find out what the bytes are that belong to no frame."""
        noise = self._noise if self.frames else self._noise + self._tail
        if not self.frames:
            verdict = diagnosis(noise)
            if verdict is not None:
                clause, reason, example, offset = verdict
                self.ledger.fail(clause, "", reason, example, self._noise_at + offset)
            elif noise:
                self.ledger.fail(Clause.SYNC, "", identify_content(self._link, noise), noise, self._noise_at)
            return
        if self._first_damage is None:
            return
        at_byte, example = self._first_damage
        if not self._damaged:
            reason = Reason(FirmwareCode.BYTES_BETWEEN_FRAMES, bytes=self._noise_bytes, frames=self.frames)
            self.ledger.fail(Clause.CONTIGUOUS, "", reason, example, at_byte)
            return
        verdict = diagnosis(noise)
        if verdict is not None and verdict[1].code is not FirmwareCode.FRAME_CRC_WRONG:
            self.ledger.fail(verdict[0], "", verdict[1], example, at_byte, count=self._damaged)
            return
        cause = "altered" if self._missing_bytes and self._size >= _MIN_ALTERED_BYTES else "unknown"
        reason = Reason(FirmwareCode.SOME_FRAMES_DAMAGED, damaged=self._damaged, frames=self.frames, cause=cause)
        self.ledger.fail(Clause.CRC, "", reason, example, at_byte, count=self._damaged)
