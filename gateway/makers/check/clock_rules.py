"""Rules of the hub's clock and of the sample numbers."""

from dataclasses import dataclass, field
from typing import Final

import numpy as np

from firmware_protocol.messages import Hello, HubStatus, MessageType, SampleBlock
from gateway.core.reasons import Reason
from gateway.makers.check.clauses import Clause, Ledger
from gateway.makers.check.seen_frame import SeenFrame, SourceKey, signed_step, source_name
from gateway.makers.reasons import FirmwareCode

# Time over which the page compares the rate and the hub's clock.
_SPAN_S: Final = 2.0
_RELATIVE_TOLERANCE: Final = 1e-3
# Blocks that are compared with one rate.
_MAX_BLOCKS: Final = 20_000
# The hub's clock against that of this computer: a share, and the jitter of arrivals.
_CLOCK_TOLERANCE: Final = 0.005
_ARRIVAL_JITTER_S: Final = 0.1
# Units that a counter of another unit has, by its pace.
_UNITS: Final = {"ms": 1e-3, "ns": 1e3, "ticks of 32768 Hz": 0.032768, "10 us": 0.1}
_UNIT_TOLERANCE: Final = 0.05
_MIN_EARLY_FRAMES: Final = 3


@dataclass(slots=True)
class _Blocks:
    """Sample blocks of a wheel since its last change of rate."""

    hello: Hello | None = None
    last: tuple[int, int, int, int] | None = None  # seq, first sample, tick, samples
    numbers: list[int] = field(default_factory=list)
    ticks_us: list[int] = field(default_factory=list)
    holes: int = 0
    hole: SeenFrame | None = None
    lost: bool = False


@dataclass(slots=True)
class _Clock:
    """Clock of a hub since its start."""

    last_tick_us: int | None = None
    unwrapped_us: int = 0
    arrivals: list[tuple[float, float]] = field(default_factory=list)  # clock and lateness in s
    samples_dropped: tuple[int, int] | None = None
    early: list[SeenFrame] = field(default_factory=list)
    close: int = 0


class ClockRules:
    """Follows `tick_us` and `first_sample`."""

    def __init__(self, ledger: Ledger) -> None:
        self._ledger = ledger
        self._clocks: dict[int, _Clock] = {}
        self._blocks: dict[SourceKey, _Blocks] = {}
        self._ticks: dict[tuple[SourceKey, int], tuple[int, int]] = {}

    def restarted(self, number: int) -> None:
        """Forget a hub's clock before its start."""
        self._judge_clock(number)
        self._clocks.pop(number, None)
        for source in [source for source in self._blocks if source[0] == number]:
            self._judge_blocks(source)
            del self._blocks[source]
        self._ticks = {key: value for key, value in self._ticks.items() if key[0][0] != number}

    def frame(self, seen: SeenFrame) -> None:
        """Take a frame."""
        self._monotonic(seen)
        clock = self._clocks.setdefault(seen.hub, _Clock())
        if isinstance(seen.message, SampleBlock):
            self._block(seen, seen.message)
            return
        blocks = self._blocks.setdefault(seen.source, _Blocks())
        if isinstance(seen.message, Hello):
            if blocks.hello is not None and blocks.hello.rate_hz != seen.message.rate_hz:
                self._judge_blocks(seen.source)
                blocks = self._blocks[seen.source] = _Blocks()
            blocks.hello = seen.message
        self._pace(clock, seen)
        self._compare_with_blocks(clock, seen)
        if isinstance(seen.message, HubStatus):
            dropped = seen.message.samples_dropped
            clock.samples_dropped = (dropped if clock.samples_dropped is None else clock.samples_dropped[0]), dropped

    def finish(self) -> None:
        """Judge what the whole stream shows."""
        for number in list(self._clocks):
            self._judge_clock(number)
        for source in self._blocks:
            self._judge_blocks(source)
        self._judge_first_sample()

    def _monotonic(self, seen: SeenFrame) -> None:
        key = seen.source, seen.type
        previous = self._ticks.get(key)
        self._ticks[key] = seen.seq, seen.tick_us
        # Log texts may be made at one time.
        if previous is None or signed_step(previous[0], seen.seq) <= 0 or seen.type == MessageType.LOG_TEXT:
            return
        self._ledger.check(Clause.TICK_MONOTONIC)
        step = signed_step(previous[1], seen.tick_us)
        if step < 0:
            reason = Reason(FirmwareCode.TICK_WRONG, how="goes_back", back_us=float(-step), tick_us=float(seen.tick_us))
            self._ledger.fail(Clause.TICK_MONOTONIC, seen, reason)
        elif step == 0 and not self._is_repeated(seen):
            self._ledger.fail(
                Clause.TICK_MONOTONIC, seen, Reason(FirmwareCode.TICK_WRONG, how="stands", tick_us=float(seen.tick_us))
            )

    def _is_repeated(self, seen: SeenFrame) -> bool:
        blocks = self._blocks.get(seen.source)
        return (
            isinstance(seen.message, SampleBlock)
            and blocks is not None
            and blocks.last is not None
            and blocks.last[1] == seen.message.first_sample
        )

    def _pace(self, clock: _Clock, frame: SeenFrame) -> None:
        """Note how late a frame arrives by the hub's clock."""
        if clock.last_tick_us is not None:
            clock.unwrapped_us += signed_step(clock.last_tick_us, frame.tick_us)
        clock.last_tick_us = frame.tick_us
        if frame.host_s is not None:
            clock.arrivals.append((clock.unwrapped_us * 1e-6, frame.host_s))

    def _block(self, frame: SeenFrame, block: SampleBlock) -> None:
        blocks = self._blocks.setdefault(frame.source, _Blocks())
        n = len(block.counts)
        last, blocks.last = blocks.last, (frame.seq, block.first_sample, frame.tick_us, n)
        if last is not None and signed_step(last[0], frame.seq) > 0:
            step = signed_step(last[1], block.first_sample)
            is_repeated = step == 0 and last[2] == frame.tick_us
            is_contiguous = not blocks.lost
            self._ledger.check(Clause.NUMBERS)
            if step < last[3] and not is_repeated:
                reason = Reason(FirmwareCode.NUMBERS_WRONG, how="overlap", step=float(step), samples=float(last[3]))
                self._ledger.fail(Clause.NUMBERS, frame, reason)
            elif step > last[3] and is_contiguous:
                blocks.holes += step - last[3]
                blocks.hole = blocks.hole or frame
        blocks.lost = False
        if len(blocks.numbers) < _MAX_BLOCKS:
            number = blocks.numbers[-1] + signed_step(last[1], block.first_sample) if blocks.numbers and last else 0
            tick = blocks.ticks_us[-1] + signed_step(last[2], frame.tick_us) if blocks.ticks_us and last else 0
            blocks.numbers.append(number)
            blocks.ticks_us.append(tick)

    def lost(self, source: SourceKey) -> None:
        """Note that frames of a source are missing before the next one."""
        if source in self._blocks:
            self._blocks[source].lost = True

    def may_pause(self, number: int) -> None:
        """Note that a hub may leave out samples before its next blocks: a command has stopped or started them."""
        for source, blocks in self._blocks.items():
            blocks.lost |= source[0] == number

    def _compare_with_blocks(self, clock: _Clock, frame: SeenFrame) -> None:
        """Compare a frame's clock with the last sample of every block sent before it."""
        for (hub, _), blocks in self._blocks.items():
            if hub != frame.hub or blocks.last is None or blocks.hello is None:
                continue
            _, _, tick_us, n = blocks.last
            length_us = (n - 1) / blocks.hello.rate_hz * 1e6
            behind_us = signed_step(tick_us, frame.tick_us)
            if 0 <= behind_us < 2.0 * length_us:
                clock.close += 1
                if behind_us < length_us - 1.0:
                    clock.early.append(frame)

    def _judge_clock(self, number: int) -> None:
        """Compare the pace of a hub's clock with that of the arrivals."""
        arrivals = np.array(self._clocks[number].arrivals) if number in self._clocks else np.empty((0, 2))
        if self._ledger.has_failed(Clause.TICK_MONOTONIC):
            return
        if len(arrivals) < 4 or arrivals[-1, 1] - arrivals[0, 1] < _SPAN_S:
            return
        self._ledger.check(Clause.TICK)
        # The earliest arrivals of the first third and of the last: what waits on the way comes later.
        third = len(arrivals) // 3
        lateness = arrivals[:, 1] - arrivals[:, 0]
        first, second = int(np.argmin(lateness[:third])), 2 * third + int(np.argmin(lateness[2 * third :]))
        hub_s, host_s = arrivals[second] - arrivals[first]
        if host_s <= 0.0:
            return
        pace = float(hub_s / host_s)
        if abs(pace - 1.0) <= _CLOCK_TOLERANCE + _ARRIVAL_JITTER_S / host_s:
            return
        unit = next((unit for unit, unit_pace in _UNITS.items() if abs(pace / unit_pace - 1.0) < _UNIT_TOLERANCE), "")
        values: dict[str, float | str] = {"how": "other_unit", "unit": unit} if unit else {"how": "pace"}
        reason = Reason(FirmwareCode.TICK_WRONG, pace=pace, duration_s=float(host_s), **values)
        self._ledger.fail(Clause.TICK, f"hub {number}", reason)

    def _judge_blocks(self, source: SourceKey) -> None:
        """Compare numbers and clock of a wheel's blocks with the stated rate."""
        blocks = self._blocks[source]
        dropped = self._clocks[source[0]].samples_dropped if source[0] in self._clocks else None
        if blocks.hole is not None:
            reason = Reason(FirmwareCode.NUMBERS_WRONG, how="holes", holes=float(blocks.holes))
            if dropped is None or dropped[1] == dropped[0]:
                self._ledger.fail(Clause.NUMBERS, blocks.hole, reason)
            else:
                self._ledger.fail(
                    Clause.LOSS,
                    blocks.hole,
                    Reason(FirmwareCode.NUMBERS_WRONG, how="dropped", holes=float(blocks.holes)),
                )
        if blocks.hello is None or len(blocks.numbers) < 3:
            return
        number, tick_s = np.array(blocks.numbers, float), np.array(blocks.ticks_us) * 1e-6
        subject, stated_hz = source_name(source), blocks.hello.rate_hz
        spans_2_s, samples_span_2_s = tick_s[-1] - tick_s[0] >= _SPAN_S, number[-1] >= _SPAN_S * stated_hz
        if not (spans_2_s or samples_span_2_s) or self._ledger.has_failed(Clause.NUMBERS, Clause.TICK_MONOTONIC):
            return
        slope, intercept_s = np.polyfit(number, tick_s, 1)
        # A dump has no arrival times that would tell the unit.
        in_ms = samples_span_2_s and abs(slope * stated_hz / _UNITS["ms"] - 1.0) < _UNIT_TOLERANCE
        if in_ms and not self._ledger.has_failed(Clause.TICK):
            values = {"measured_hz": float(1.0 / slope), "stated_hz": stated_hz}
            self._ledger.fail(Clause.TICK, f"hub {source[0]}", Reason(FirmwareCode.TICK_WRONG, how="ms", **values))
        if not spans_2_s:
            return
        self._ledger.check(Clause.RATE)
        self._ledger.check(Clause.RATE_EXACT)
        self._ledger.check(Clause.JITTER)
        error = 1.0 / (slope * stated_hz) - 1.0
        if abs(error) > _RELATIVE_TOLERANCE and not self._ledger.has_failed(Clause.RATE):
            reason = Reason(
                FirmwareCode.RATE_NOT_EXACT, stated_hz=stated_hz, measured_hz=float(1.0 / slope), share=float(error)
            )
            self._ledger.fail(Clause.RATE_EXACT, subject, reason, is_advice=True)
        residual_s = tick_s - intercept_s - slope * number
        spread_s = float(residual_s.max() - residual_s.min())
        if spread_s > _RELATIVE_TOLERANCE * _SPAN_S:
            reason = Reason(FirmwareCode.TICK_WRONG, how="jitters", spread_s=spread_s, std_s=float(residual_s.std()))
            self._ledger.fail(Clause.JITTER, subject, reason, is_advice=True)

    def _judge_first_sample(self) -> None:
        """Judge whether `tick_us` of blocks is that of their first sample, where the clock itself is right."""
        if self._ledger.has_failed(Clause.TICK_MONOTONIC, Clause.RATE, Clause.NUMBERS, Clause.JITTER):
            return
        for clock in self._clocks.values():
            if not clock.close:
                continue
            self._ledger.check(Clause.TICK_FIRST, clock.close)
            if len(clock.early) >= max(_MIN_EARLY_FRAMES, clock.close // 4):
                reason = Reason(
                    FirmwareCode.TICK_WRONG, how="not_of_first_sample", tick_us=float(clock.early[0].tick_us)
                )
                frame = clock.early[0]
                self._ledger.fail(
                    Clause.TICK_FIRST,
                    source_name(frame.source),
                    reason,
                    frame.data,
                    frame.at_byte,
                    count=len(clock.early),
                )
