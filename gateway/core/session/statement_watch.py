"""Statements of hubs compared with what they send: each false one is named once per wheel, with a count.

The rules are those of "What must agree" in the specification of the protocol. Sources are followed by the hub's numbers
and clock only, so that a recording gives the same counts as the session.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_protocol.counters import LinkCounters
from firmware_protocol.frame_blocks import FrameBlock, SampleRun
from firmware_protocol.messages import (
    COMMANDS,
    EVERY_HUB,
    HUB_ITSELF,
    Axis,
    Coupling,
    Environment,
    Frame,
    Hello,
    TimeSync,
)
from firmware_protocol.sample_numbers import apart_s, is_jump
from firmware_protocol.sequence import COUNTER_MASK
from firmware_protocol.wheel_limit import MOST_WHEELS, WheelLimit
from gateway.core.constants import AXIS_NAMES
from gateway.core.reasons import Code, Level, Notice, Reason, Value
from gateway.core.session.reasons import SessionCode
from gateway.core.wheels.possible_readings import is_possible_pressure, is_possible_temperature
from gateway.core.wheels.sample_content import SampleContent, is_chosen

# Jitter of the hub's stamps is far below this; a wrong rate is far above.
_RATE_SPAN_S: Final = 2.0
_RATE_TOLERANCE: Final = 0.03
_US: Final = 1_000_000

_RANGE_FACTOR: Final = 2.0
_FULL_SCALE_MPS2: Final = (10.0, 1e6)
_MAX_OFFSET_COUNTS: Final = 32768.0

# Blocks of a wheel that are reviewed together.
_REVIEW_BLOCKS: Final = 128
# Blocks of a wheel that are compared with later ones: some seconds at 9600 Hz. A hub keeps no more.
_RECENT_BLOCKS: Final = 1024
# One block may have been late when the hub changed its axes; one unknown frame may be an experiment of the hub.
_MIN_COUNTS: Final[Mapping[Code, int]] = {
    SessionCode.HELLO_AXES_DIFFER: 3,
    SessionCode.ONLY_UNKNOWN_TYPES: 3,
    SessionCode.SAMPLES_REPEATED: 3,
}
# Of the last ten hellos within one start, more than this many differed from the one before.
_LAST_HELLOS: Final = (1 << 10) - 1
_MAX_CHANGES: Final = 4

_Source = tuple[str, int, int]


class _Wheel:
    """State of one wheel: its hello, the last blocks, and the span over which the rate is measured."""

    __slots__ = (
        "axes",
        "below",
        "changes",
        "content",
        "firsts",
        "former_sensor",
        "hello",
        "last",
        "recent",
        "since",
        "ticks_us",
    )

    def __init__(self) -> None:
        self.hello: Hello | None = None
        # Whether each of the last hellos changed something, one bit each.
        self.changes = 0
        self.former_sensor: int | None = None
        # First samples and hub times of blocks that wait for their review, and their axis mask.
        self.firsts: list[int] = []
        self.ticks_us: list[int] = []
        self.axes = 0
        self.content = SampleContent()
        self.restart()

    def restart(self) -> None:
        """Forget the numbers before a start, a change of rate or a new connection."""
        # First sample and tick of the last block; samples and us since the begin of the span.
        self.last: tuple[int, int] | None = None
        self.since = (0, 0)
        # The last blocks, and the last sample number below the highest.
        self.recent = np.empty(0, np.int64)
        self.below = 0

    def repeated(self, blocks: NDArray[np.int64], samples: NDArray[np.int64], *, jumped: bool) -> int:
        """Take blocks; return how many came before.

        Args:
            blocks: first sample and tick of the next ones in one number each, (k,).
            samples: steps of their sample numbers, (k,).
            jumped: whether the numbers begin anew among them.
        """
        counts = np.concatenate([self.recent, blocks])
        number = np.cumsum(samples) + self.below
        highest = np.maximum.accumulate(np.append(0, number))
        self.below = 0 if jumped else int(number[-1] - highest[-1])
        count = 0
        if (number <= highest[:-1]).any():
            firsts = np.unique(counts, return_index=True)[1]
            count = len(blocks) - int(np.count_nonzero(firsts >= len(self.recent)))
        self.recent = counts[-_RECENT_BLOCKS:].copy()
        return count


class _Finding:
    """A false statement and how often it was met."""

    __slots__ = ("count", "named", "values")

    def __init__(self) -> None:
        self.values: dict[str, Value] = {}
        self.count = 0
        self.named = False


class StatementWatch:
    """Watch over the frames of all links of a session or recording. Memory is bounded by the limit of wheels."""

    def __init__(
        self,
        positions: Mapping[tuple[int, int], str] | None = None,
        limit: WheelLimit | None = None,
        *,
        review_blocks: int = _REVIEW_BLOCKS,
    ) -> None:
        """Start without frames.

        Args:
            positions: names of the configured wheels by (hub, wheel).
            limit: admission of wheels, shared with a pipeline; a new one when None.
            review_blocks: blocks of a wheel that are reviewed together; with 1, a finding follows its frame at once.
        """
        self._review_blocks = review_blocks
        self._positions = positions or {}
        self._limit = limit if limit is not None else WheelLimit(self._positions)
        self._links: set[str] = set()
        self._wheels: dict[_Source, _Wheel] = {}
        self._boot_counts: dict[tuple[str, int], int] = {}
        self._findings: dict[tuple[_Source, Code], _Finding] = {}
        self._has_new = False
        self._refusal_named = False

    def take(self, link: str, block: FrameBlock) -> None:
        """Take decoded frames in the order of the stream, of sources that the limit admits."""
        for stretch in block.stretches(partial(self._limit.admits, link)):
            for run in stretch.runs:
                self.samples(link, run)
            if stretch.last is not None:
                self.message(link, stretch.last[1])

    def samples(self, link: str, run: SampleRun) -> None:
        """Take samples of an admitted source: look at their content, and let them wait for their review."""
        self._links.add(link)
        source = link, run.hub, run.wheel
        if run.wheel == HUB_ITSELF:
            self._find(source, SessionCode.HUB_SENDS_AS_WHEEL, len(run.ticks_us))
            return
        wheel = self._wheel(source)
        if wheel.axes != run.axes:
            self._review(source, wheel)
            wheel.axes = run.axes
        first, block, hello = run.first_sample, run.block, wheel.hello
        firsts = range(first, first + len(run.counts), block)
        if hello is not None and run.axes == hello.axes:
            for begin in filter(is_chosen, firsts):
                for code, values in wheel.content.block(hello, run.counts[begin - first : begin - first + block]):
                    self._find(source, code, 1, **values)
        wheel.firsts += firsts
        wheel.ticks_us += run.ticks_us
        if len(wheel.firsts) >= self._review_blocks:
            self._review(source, wheel)

    def message(self, link: str, frame: Frame) -> None:
        """Take a frame without samples of an admitted source."""
        type_, hub, number, _, tick_us, message = frame
        self._links.add(link)
        source, is_hub = (link, hub, number), number == HUB_ITSELF
        if type_ in COMMANDS:
            self._find((link, hub, HUB_ITSELF), SessionCode.HUB_SENDS_COMMANDS)
        elif isinstance(message, Hello | Environment) and is_hub:
            self._find(source, SessionCode.HUB_SENDS_AS_WHEEL)
        elif isinstance(message, Hello):
            wheel = self._wheel(source)
            # Blocks before and behind a hello that is repeated belong to the same statement.
            if wheel.hello != message:
                self._review(source, wheel)
            self._hello(source, wheel, message)
        elif isinstance(message, Environment):
            self._environment(source, message)
        elif isinstance(message, TimeSync) and message.hub_us & 0xFFFF_FFFF != tick_us:
            self._find(source, SessionCode.HUB_TIME_AGAINST_TICK, hub_us=float(message.hub_us), tick_us=float(tick_us))

    def counters(self, link: str, counters: LinkCounters) -> None:
        """Take the counters of a link: sources that send nothing but frames of unknown types."""
        for (hub, wheel), counted in counters.sources.items():
            if counted.unknown_type and not counted.frames and self._limit.admits(link, hub, wheel):
                self._find((link, hub, wheel), SessionCode.ONLY_UNKNOWN_TYPES, 0)
                self._findings[(link, hub, wheel), SessionCode.ONLY_UNKNOWN_TYPES].count = counted.unknown_type

    def reopened(self, link: str) -> None:
        """Note that a link was reconnected: another hub may be on it."""
        for (of_link, _, _), wheel in self._wheels.items():
            if of_link == link:
                wheel.firsts, wheel.ticks_us = [], []
                wheel.restart()

    def new(self) -> list[Notice]:
        """Return the findings that have not been returned here before."""
        if not self._has_new and bool(self._limit.refused) == self._refusal_named:
            return []
        self._has_new = False
        notices: list[Notice] = []
        for (source, code), finding in self._findings.items():
            if not finding.named and finding.count >= _MIN_COUNTS.get(code, 1):
                finding.named = True
                notices.append(self._notice(source, code, finding))
        if self._limit.refused and not self._refusal_named:
            self._refusal_named = True
            notices.append(self._refusal())
        return notices

    def contradictions(self) -> list[Notice]:
        """Return all findings with their present counts."""
        for source, wheel in self._wheels.items():
            self._review(source, wheel)
        notices = [
            self._notice(source, code, finding)
            for (source, code), finding in sorted(self._findings.items(), key=lambda entry: entry[0])
            if finding.count >= _MIN_COUNTS.get(code, 1)
        ]
        return [*notices, self._refusal()] if self._limit.refused else notices

    def _wheel(self, source: _Source) -> _Wheel:
        wheel = self._wheels.get(source)
        if wheel is None:
            wheel = self._wheels[source] = _Wheel()
        return wheel

    def _hello(self, source: _Source, wheel: _Wheel, hello: Hello) -> None:
        previous, hub = wheel.hello, source[:2]
        boot_count = self._boot_counts.get(hub)
        if previous is None or previous[3:7] != hello[3:7]:  # sensor, firmware, boot count, rate
            wheel.restart()
        if previous is not None and previous.boot_count == hello.boot_count != boot_count and boot_count is not None:
            own_count, other_count = float(hello.boot_count), float(boot_count)
            self._find((*hub, HUB_ITSELF), SessionCode.HUB_BOOT_COUNTS_DIFFER, own=own_count, other=other_count)
        wheel.changes = wheel.changes << 1 & _LAST_HELLOS
        if previous is not None and previous != hello and previous.boot_count == hello.boot_count:
            self._hello_changed(source, wheel, previous, hello)
        self._boot_counts[hub] = hello.boot_count
        wheel.hello = hello
        self._scale(source, hello)
        if hello.coupling == Coupling.DC and hello.highpass_hz > 0.0:
            self._find(source, SessionCode.HELLO_HIGHPASS_WITH_DC, highpass_hz=hello.highpass_hz)
        if source[1] == EVERY_HUB:
            self._find((*hub, HUB_ITSELF), SessionCode.HUB_NUMBER_RESERVED)

    def _hello_changed(self, source: _Source, wheel: _Wheel, previous: Hello, hello: Hello) -> None:
        """Look at a hello that differs from the last one although the hub has not restarted."""
        former, wheel.former_sensor = wheel.former_sensor, previous.sensor_id
        if previous.sensor_id != hello.sensor_id == former:
            sensors = f"{hello.sensor_id:08x}", f"{previous.sensor_id:08x}"
            self._find(source, SessionCode.HELLO_SENSORS_ALTERNATE, sensor=sensors[0], other=sensors[1])
            return
        wheel.changes |= 1
        if wheel.changes.bit_count() > _MAX_CHANGES:
            self._find(source, SessionCode.HELLO_KEEPS_CHANGING)

    def _scale(self, source: _Source, hello: Hello) -> None:
        """Compare scale, range and zero of every present axis."""
        present = [axis for axis in Axis if hello.axes >> axis & 1]
        zero = tuple(AXIS_NAMES[axis] for axis in present if hello.scale_mps2[axis] == 0.0)
        if zero:
            self._find(source, SessionCode.HELLO_SCALE_ZERO, axes=zero)
        for axis in present:
            name, full_mps2 = AXIS_NAMES[axis], abs(hello.scale_mps2[axis]) * hello.saturation_counts
            stated_mps2, offset = hello.range_mps2[axis], hello.offset_counts[axis]
            # Without a stated range, as in an imported measurement, the scale is no statement about the sensor.
            if full_mps2 > 0.0 and stated_mps2 > 0.0 and not _FULL_SCALE_MPS2[0] <= full_mps2 <= _FULL_SCALE_MPS2[1]:
                self._find(source, SessionCode.HELLO_SCALE_ABSURD, axis=name, full_scale_mps2=full_mps2)
            elif (
                full_mps2 > 0.0
                and stated_mps2 > 0.0
                and not full_mps2 / _RANGE_FACTOR <= stated_mps2 <= full_mps2 * _RANGE_FACTOR
            ):
                self._find(
                    source,
                    SessionCode.HELLO_SCALE_AGAINST_RANGE,
                    axis=name,
                    range_mps2=stated_mps2,
                    full_scale_mps2=full_mps2,
                )
            if abs(offset) > _MAX_OFFSET_COUNTS:
                self._find(source, SessionCode.HELLO_ZERO_ABSURD, axis=name, offset_counts=offset)

    def _environment(self, source: _Source, reading: Environment) -> None:
        pressure_pa, temperature_degc = reading.pressure_pa, reading.temperature_degc
        if pressure_pa is not None and not is_possible_pressure(pressure_pa):
            self._find(source, SessionCode.PRESSURE_IMPOSSIBLE, pressure_pa=pressure_pa)
        if temperature_degc is not None and not is_possible_temperature(temperature_degc):
            self._find(source, SessionCode.TEMPERATURE_IMPOSSIBLE, temperature_degc=temperature_degc)

    def _review(self, source: _Source, wheel: _Wheel) -> None:
        """Compare the blocks that wait with the wheel's hello."""
        hello, first, tick = wheel.hello, np.array(wheel.firsts, np.int64) & COUNTER_MASK, np.array(wheel.ticks_us)
        wheel.firsts, wheel.ticks_us = [], []
        if hello is None or not len(first):
            return
        if wheel.axes != hello.axes:
            sent_axes, stated_axes = _axes_named(wheel.axes), _axes_named(hello.axes)
            self._find(source, SessionCode.HELLO_AXES_DIFFER, len(first), sent=sent_axes, stated=stated_axes)
        last = wheel.last or (int(first[0]), int(tick[0]))
        wheel.last = int(first[-1]), int(tick[-1])
        samples, us_steps = _steps(last[0], first), _steps(last[1], tick)
        jumps = np.flatnonzero(is_jump(samples, us_steps, hello.rate_hz))
        repeated = wheel.repeated((first << 32) ^ tick, samples, jumped=len(jumps) > 0)
        if repeated:
            self._find(source, SessionCode.SAMPLES_REPEATED, repeated)
        if len(jumps):
            jumps_s = apart_s(samples, us_steps, hello.rate_hz)[jumps]
            self._find(source, SessionCode.SAMPLE_NUMBERS_JUMP, len(jumps), last_s=float(jumps_s[-1]))
        begin = 0
        for jump in [*jumps.tolist(), len(samples)]:
            self._rate(source, wheel, hello.rate_hz, samples[begin:jump], us_steps[begin:jump])
            begin = jump + 1
            if jump < len(samples):
                wheel.since = (0, 0)

    def _rate(
        self, source: _Source, wheel: _Wheel, rate_hz: float, samples: NDArray[np.int64], us_steps: NDArray[np.int64]
    ) -> None:
        """Compare the samples and the hub's time of every span with the stated rate."""
        if not len(samples):
            return
        number, time_us = np.cumsum(samples) + wheel.since[0], np.cumsum(us_steps) + wheel.since[1]
        reached = np.maximum.accumulate(number)
        span = _RATE_SPAN_S * rate_hz
        begin = begin_us = 0
        while (index := int(np.searchsorted(reached, begin + span))) < len(number):
            elapsed_us = int(time_us[index]) - begin_us
            measured_hz = (int(number[index]) - begin) * _US / elapsed_us if elapsed_us > 0 else 0.0
            if elapsed_us <= 0:
                self._find(source, SessionCode.HUB_CLOCK_STILL, duration_s=_RATE_SPAN_S)
            elif abs(measured_hz / rate_hz - 1.0) > _RATE_TOLERANCE:
                self._find(
                    source,
                    SessionCode.HELLO_RATE_DIFFERS,
                    stated_hz=rate_hz,
                    measured_hz=measured_hz,
                    duration_s=_RATE_SPAN_S,
                )
            begin, begin_us = int(number[index]), int(time_us[index])
        wheel.since = int(number[-1]) - begin, int(time_us[-1]) - begin_us

    def _find(self, source: _Source, code: Code, count: int = 1, **values: Value) -> None:
        finding = self._findings.setdefault((source, code), _Finding())
        finding.values = values
        finding.count += count
        self._has_new = self._has_new or not finding.named

    def _notice(self, source: _Source, code: Code, finding: _Finding) -> Notice:
        return Notice(self._name(source), Reason(code, **finding.values, count=finding.count), Level.WARNING)

    def _name(self, source: _Source) -> str:
        link, hub, wheel = source
        name = f"hub {hub}" if wheel == HUB_ITSELF else self._positions.get((hub, wheel), f"hub{hub}.wheel{wheel}")
        return name if len(self._links) == 1 else f"{link}, {name}"

    def _refusal(self) -> Notice:
        reason = Reason(SessionCode.WHEELS_REFUSED, count=self._limit.refused, most=MOST_WHEELS)
        return Notice("", reason, Level.WARNING)


def _steps(previous: int, numbers: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the steps between numbers of 32 bits that wrap, the first from `previous`, (k,)."""
    steps: NDArray[np.int64] = numbers - np.append(previous, numbers[:-1])
    return (steps + 2**31) % 2**32 - 2**31


def _axes_named(mask: int) -> tuple[Value, ...]:
    return tuple(AXIS_NAMES[axis] for axis in Axis if mask >> axis & 1)
