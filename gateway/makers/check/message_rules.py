"""Rules of single messages and of their schedule."""

import unicodedata
from collections import deque
from dataclasses import dataclass, field
from typing import Final

from firmware_protocol import wire
from firmware_protocol.codec import CHANNELS
from firmware_protocol.declaration import SAMPLES
from firmware_protocol.messages import (
    HUB_ITSELF,
    Axis,
    Environment,
    Hello,
    HubStatus,
    LogLevel,
    LogText,
    MessageType,
    SampleBlock,
)
from gateway.core.constants import AXIS_NAMES
from gateway.core.reasons import Reason, Value
from gateway.makers.check.clauses import Clause, Ledger
from gateway.makers.check.counter_rules import CounterRules
from gateway.makers.check.seen_frame import SeenFrame, SourceKey, signed_step, source_name
from gateway.makers.reasons import FirmwareCode

_PERIODS: Final = {
    MessageType.HELLO: (Clause.HELLO_PERIOD, wire.HELLO_PERIOD_S),
    MessageType.ENVIRONMENT: (Clause.ENVIRONMENT_PERIOD, wire.ENVIRONMENT_PERIOD_S),
    MessageType.HUB_STATUS: (Clause.STATUS_PERIOD, wire.HUB_STATUS_PERIOD_S),
    MessageType.TIME_SYNC: (Clause.TIME_PERIOD, wire.TIME_SYNC_PERIOD_S),
}
_OF_WHEELS: Final = (MessageType.HELLO, MessageType.ENVIRONMENT)
# A schedule is judged over this time; so many messages more or fewer than expected are of its ends.
_MIN_SPAN_S: Final = 3.0
_SLACK: Final = 1.5
_MAX_LOGS_PER_S: Final = 10
_UPTIME_TOLERANCE_S: Final = 2.0
_SENT_SHARE: Final = 0.05
_SENT_SLACK: Final = 20
_FULL_BLOCKS: Final = 0.8
# Pressures of tires in kPa; a flat one in Pa is rarely among them, so that this is advice.
_KPA_RANGE: Final = (80.0, 1000.0)


@dataclass(slots=True)
class _Schedule:
    """Times of a source's frames, by arrival or, without arrival times, by the hub's clock."""

    counts: dict[int, int] = field(default_factory=dict)
    first_s: float | None = None
    last_s: float = 0.0
    last_tick_us: int = 0
    hello_seen: bool = False
    blocks: int = 0
    samples: int = 0
    channels: int = 0
    is_signed: bool = False


class MessageRules:
    """Looks at HELLO, HUB_STATUS, LOG_TEXT and at the times of all messages."""

    def __init__(self, ledger: Ledger, counters: CounterRules) -> None:
        self._ledger = ledger
        self._counters = counters
        self._schedules: dict[SourceKey, _Schedule] = {}
        self._logs: dict[int, deque[float]] = {}
        # They rest on clock and counters, which must be right.
        self._doubts: list[tuple[SeenFrame, Reason]] = []
        # Frames of a hub so far, and frames_sent with them, at its first status and its last.
        self._sent: dict[int, tuple[tuple[int, int], SeenFrame]] = {}
        self._frames: dict[int, int] = {}

    def frame(self, seen: SeenFrame) -> None:
        """Take a frame."""
        self._frames[seen.hub] = self._frames.get(seen.hub, 0) + 1
        schedule = self._schedules.setdefault(seen.source, _Schedule())
        self._time(schedule, seen)
        schedule.counts[seen.type] = schedule.counts.get(seen.type, 0) + 1
        message = seen.message
        # One that cannot be read is a fault of its own.
        schedule.hello_seen |= seen.type == MessageType.HELLO
        if isinstance(message, Hello):
            self._hello(seen, message)
        elif isinstance(message, SampleBlock) and seen.wheel != HUB_ITSELF:
            self._samples(schedule, seen, message)
        elif isinstance(message, Environment):
            self._environment(seen, message)
        elif isinstance(message, HubStatus):
            self._status(seen, message)
        elif isinstance(message, LogText):
            self._log(seen, message)

    def restarted(self, hub: int) -> None:
        """Forget the counters of a hub before its start."""
        self._sent.pop(hub, None)

    def _time(self, schedule: _Schedule, frame: SeenFrame) -> None:
        if frame.host_s is not None:
            time_s = frame.host_s
        else:
            step = signed_step(schedule.last_tick_us, frame.tick_us) if schedule.first_s is not None else 0
            time_s = schedule.last_s + max(0, step) * 1e-6
        schedule.last_tick_us = frame.tick_us
        if schedule.first_s is None:
            schedule.first_s = time_s
        schedule.last_s = max(schedule.last_s, time_s)

    def _hello(self, frame: SeenFrame, hello: Hello) -> None:
        self._ledger.check(Clause.HELLO_VALUES)
        self._ledger.check(Clause.SCALE_RANGE)
        self._ledger.check(Clause.HELLO_COUPLING)
        self._ledger.check(Clause.HELLO_SENSOR)
        if hello.protocol_major != wire.VERSION_MAJOR:
            reason = Reason(
                FirmwareCode.HELLO_WRONG, how="major", major=hello.protocol_major, minor=hello.protocol_minor
            )
            self._ledger.fail(Clause.HELLO_VALUES, frame, reason)
        absent = [axis for axis in Axis if not hello.axes >> axis & 1]
        if not absent:
            return
        self._ledger.check(Clause.HELLO_ABSENT)
        values = hello.range_mps2, hello.scale_mps2, hello.offset_counts
        filled = tuple(AXIS_NAMES[axis] for axis in absent if any(value[axis] for value in values))
        if filled:
            self._ledger.fail(
                Clause.HELLO_ABSENT,
                frame,
                Reason(FirmwareCode.HELLO_WRONG, how="absent_axes", axes=filled),
                is_advice=True,
            )

    def _samples(self, schedule: _Schedule, frame: SeenFrame, block: SampleBlock) -> None:
        if not schedule.blocks and self._counters.started(frame.source):
            self._ledger.check(Clause.HELLO_FIRST)
        if not schedule.hello_seen and self._counters.started(frame.source):
            self._ledger.fail(Clause.HELLO_FIRST, frame, Reason(FirmwareCode.HELLO_WRONG, how="late"))
        schedule.blocks += 1
        schedule.samples += len(block.counts)
        schedule.channels = CHANNELS[block.axes]
        schedule.is_signed = bool(frame.tag_bytes)

    def _environment(self, frame: SeenFrame, environment: Environment) -> None:
        pressure_pa = environment.pressure_pa
        if pressure_pa is not None and _KPA_RANGE[0] <= pressure_pa <= _KPA_RANGE[1]:
            reason = Reason(FirmwareCode.PRESSURE_LIKE_KPA, pressure_pa=pressure_pa)
            self._ledger.fail(Clause.ENVIRONMENT_VALUES, frame, reason, is_advice=True)

    def _status(self, frame: SeenFrame, status: HubStatus) -> None:
        self._ledger.check(Clause.STATUS_VALUES)
        difference_s = signed_step(frame.tick_us, round(status.uptime_s * 1e6) & 0xFFFF_FFFF) * 1e-6
        if abs(difference_s) > _UPTIME_TOLERANCE_S:
            reason = Reason(
                FirmwareCode.STATUS_WRONG,
                field="uptime_s",
                uptime_s=status.uptime_s,
                clock_s=status.uptime_s - difference_s,
            )
            self._doubts.append((frame, reason))
        number = self._frames[frame.hub] + self._counters.lost_of_hub(frame.hub)
        first_status = self._sent.get(frame.hub)
        if first_status is None:
            self._sent[frame.hub] = (number, status.frames_sent), frame
            return
        (first, sent), _ = first_status
        arrived, reported = number - first, (status.frames_sent - sent) % 2**32
        if abs(reported - arrived) > _SENT_SLACK + _SENT_SHARE * arrived:
            self._doubts.append(
                (frame, Reason(FirmwareCode.STATUS_WRONG, field="frames_sent", stated=reported, arrived=arrived))
            )

    def _log(self, seen: SeenFrame, log: LogText) -> None:
        self._ledger.check(Clause.LOG)
        if log.level > max(LogLevel):
            self._ledger.fail(Clause.LOG, seen, Reason(FirmwareCode.LOG_TEXT_WRONG, how="level", level=log.level))
        try:
            decoded = seen.payload[1:].decode()
        except UnicodeDecodeError:
            self._ledger.fail(Clause.LOG, seen, Reason(FirmwareCode.LOG_TEXT_WRONG, how="not_utf8"))
        else:
            if any(unicodedata.category(character).startswith("C") for character in decoded):
                self._ledger.fail(Clause.LOG, seen, Reason(FirmwareCode.LOG_TEXT_WRONG, how="controls"), is_advice=True)
        recent = self._logs.setdefault(seen.hub, deque())
        # The hub's clock: what waits on the way arrives at once.
        recent.append(seen.tick_us * 1e-6)
        while recent[-1] - recent[0] >= 1.0 or recent[-1] < recent[0]:
            recent.popleft()
        if len(recent) > _MAX_LOGS_PER_S:
            self._ledger.fail(Clause.LOG, seen, Reason(FirmwareCode.LOG_TEXT_WRONG, how="too_often", lines=len(recent)))

    def finish(self, capacity_bytes_per_s: float | None) -> None:
        """Judge the schedule, and the bytes against what the link carries.

        Args:
            capacity_bytes_per_s: of the link, None where it is not known.
        """
        if not self._ledger.has_failed(Clause.TICK, Clause.TICK_MONOTONIC, Clause.SEQ):
            for frame, reason in self._doubts:
                self._ledger.fail(Clause.STATUS_VALUES, frame, reason)
        for hub in self._frames:
            schedules = {source: schedule for source, schedule in self._schedules.items() if source[0] == hub}
            starts_s = [schedule.first_s for schedule in schedules.values() if schedule.first_s is not None]
            span_s = max(schedule.last_s for schedule in schedules.values()) - min(starts_s)
            self._hub_schedule(hub, schedules, span_s)
        self._throughput(capacity_bytes_per_s)

    def _hub_schedule(self, hub: int, schedules: dict[SourceKey, _Schedule], span_s: float) -> None:
        if span_s < _MIN_SPAN_S:
            reason = Reason(FirmwareCode.CHECK_NOT_DONE, why="too_short", duration_s=span_s, needed_s=_MIN_SPAN_S)
            for clause, _ in _PERIODS.values():
                # By a clock in a wrong unit, any time is short.
                if not self._ledger.has_failed(Clause.TICK):
                    self._ledger.leave(clause, reason)
            return
        wheels = [source for source, schedule in schedules.items() if source[1] != HUB_ITSELF and schedule.blocks]
        for type_, (clause, period_s) in _PERIODS.items():
            for source in wheels if type_ in _OF_WHEELS else [(hub, HUB_ITSELF)]:
                self._ledger.check(clause)
                count = schedules[source].counts.get(type_, 0) if source in schedules else 0
                missing = self._counters.lost(source)
                expected = span_s / period_s
                is_rare = count + missing < 0.8 * expected - 1.0 or (count == 0 and expected >= 1.0)
                if is_rare or (type_ is not MessageType.HELLO and count > _SLACK * expected + 2.0):
                    values: dict[str, Value] = {"count": count, "span_s": span_s, "due": expected}
                    reason = Reason(FirmwareCode.MESSAGE_RATE_WRONG, type=type_.name, **values)
                    self._ledger.fail(clause, source_name(source), reason)

    def _throughput(self, capacity_bytes_per_s: float | None) -> None:
        """Compare blocks with full ones, and the bytes of all wheels with the link."""
        needed = 0.0
        for source, schedule in self._schedules.items():
            if not schedule.blocks or schedule.first_s is None:
                continue
            self._ledger.check(Clause.THROUGHPUT)
            payload_bytes = wire.MAX_SIGNED_PAYLOAD_BYTES if schedule.is_signed else wire.MAX_PAYLOAD_BYTES
            full = (payload_bytes - SAMPLES.size) // (2 * schedule.channels)
            mean = schedule.samples / schedule.blocks
            overhead = wire.OVERHEAD_BYTES + SAMPLES.size + (wire.TAG_BYTES if schedule.is_signed else 0)
            if mean < _FULL_BLOCKS * full:
                excess = (overhead / mean + 2 * schedule.channels) / (overhead / full + 2 * schedule.channels) - 1.0
                reason = Reason(FirmwareCode.BLOCKS_NOT_FULL, samples=mean, full=full, more=excess)
                self._ledger.fail(Clause.THROUGHPUT, source_name(source), reason, is_advice=True)
            span_s = schedule.last_s - schedule.first_s
            if span_s > 0.0:
                sent = schedule.blocks + self._counters.lost(source)
                needed += sent * (overhead + mean * 2 * schedule.channels) / span_s
        if capacity_bytes_per_s is None:
            return
        self._ledger.check(Clause.THROUGHPUT)
        share = needed / capacity_bytes_per_s
        if share > _FULL_BLOCKS:
            reason = Reason(FirmwareCode.LINK_NEARLY_FULL, needed=needed, capacity=capacity_bytes_per_s, share=share)
            self._ledger.fail(Clause.THROUGHPUT, "", reason, is_advice=share <= 1.0)
