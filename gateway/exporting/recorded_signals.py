"""Signals of a recording, streamed: the accelerations of every wheel in SI with their times, and its revolutions.

Memory use is constant: a few seconds of samples per wheel.
"""

from __future__ import annotations

import math
from bisect import insort
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_protocol.counters import LinkCounters
from firmware_protocol.messages import Axis, Environment, Hello
from firmware_protocol.sample_numbers import is_jump
from firmware_protocol.sequence import unwrap
from gateway.core.estimates.results import RevolutionResult
from gateway.core.recording.decoder_blocks import DecodedLinks
from gateway.core.session.recording_pass import OpenedRecording, RecordingPass
from gateway.core.session.wheel_identity import positions
from gateway.core.types import BoolArray, FloatArray
from gateway.core.wheels.frame_router import FrameRouter, Hub
from gateway.core.wheels.revolution import SensorReading
from gateway.core.wheels.timebase import HostClock, SampleClock

# Distance of the support points between which times are linear.
_KNOT_S: Final = 0.5
# The first samples are dated by the sampling rate that is known after this time.
_RATE_KNOWN_S: Final = 2.5
# Samples are held back for this long, so that late ones find their place, and the first ones until the computer's time
# is known: the first frame may have come later than others.
_HOLD_S: Final = 3.0
_HOST_TIME_KNOWN_S: Final = 6.0
# As in the pipeline: longer gaps begin a new segment, with a clock of its own.
_MAX_GAP_S: Final = 0.25
_LATE_TOLERANCE_US: Final = 250_000
# More sensors of one wheel are made up.
_MOST_SENSORS: Final = 8
_BEFORE_EPOCH_NS: Final = -(2**62)


@dataclass(frozen=True, slots=True)
class SignalBlock:
    """Consecutive samples of one wheel, without a gap between them.

    Attributes:
        wheel: position from the configuration, `FL`, or `hub0.wheel2` when not configured.
        sensor_id: serial number of the sensor.
        segment: running number of the stretch of one clock. A restart of the hub, a change of the sensor or a gap
            of more than 0.25 s begins a new one.
        first_sample: the hub's running number of the first sample, without wraps.
        hub_time_s: (n,) time of the hub's clock, s since its start, not decreasing within a segment.
        host_time_ns: (n,) the same on the host's clock, ns since the epoch, with the least delay of the link included;
            0 when the file contains no arrival times.
        axes_mps2: (n, 3) specific force on the circumferential, lateral and radial axis, in the directions of the
            protocol, as the sensor states its scale and zero; NaN for absent axes.
        saturated: (n,) whether any axis is at the end of the sensor's range.
        range_mps2: (3,) end of the range of each axis; NaN for absent axes and where the sensor states none.
        lost_before: number of samples lost between the previous block of the wheel and this one.
        rate_hz: sampling rate, measured against the hub's clock.
        ac_coupled: whether the sensor passes no steady value.
    """

    wheel: str
    sensor_id: int
    segment: int
    first_sample: int
    hub_time_s: FloatArray
    host_time_ns: NDArray[np.int64]
    axes_mps2: FloatArray
    saturated: BoolArray
    range_mps2: FloatArray
    lost_before: int
    rate_hz: float
    ac_coupled: bool

    def __len__(self) -> int:
        return len(self.hub_time_s)


@dataclass(frozen=True, slots=True)
class EnvironmentReading:
    """Pressure and temperature at the inner liner of one wheel; None where the sensor does not measure one.

    Attributes:
        wheel: as in SignalBlock.
        hub_time_s: time of the hub's clock, s since its start.
        host_time_ns: the same on the host's clock, ns since the epoch; 0 when the file contains no arrival times.
        pressure_pa: inflation pressure above ambient (gauge).
        temperature_degc: temperature of the inner liner.
        supply_v: supply of the sensor.
    """

    wheel: str
    hub_time_s: float
    host_time_ns: int
    pressure_pa: float | None
    temperature_degc: float | None
    supply_v: float | None


SignalItem = SignalBlock | EnvironmentReading


@dataclass(slots=True)
class HeardWheel:
    """What a recording holds of one wheel.

    Attributes:
        wheel: as in SignalBlock.
        sensor_ids: serial numbers of its sensors, in the order in which they were heard.
        rate_hz: stated sampling rate, NaN without a hello.
        samples: number of samples received.
    """

    wheel: str
    sensor_ids: list[int] = field(default_factory=list)
    rate_hz: float = math.nan
    samples: int = 0

    def hello(self, hello: Hello) -> None:
        """Take sensor and sampling rate."""
        self.rate_hz = hello.rate_hz
        if hello.sensor_id not in self.sensor_ids and len(self.sensor_ids) < _MOST_SENSORS:
            self.sensor_ids.append(hello.sensor_id)

    def add(
        self, first_sample: int, ticks_us: Sequence[int], axes: int, counts: NDArray[np.int16], host: HostClock
    ) -> None:
        """Count samples."""
        del first_sample, ticks_us, axes, host
        self.samples += len(counts)

    def environment(self, tick_us: int, environment: Environment) -> None:
        """Take no notice."""

    def restart(self) -> None:
        """Take no notice."""


@dataclass(frozen=True, slots=True)
class Survey:
    """What a recording holds, without its signals.

    Attributes:
        wheels: by position, configured ones first; only those that were heard.
        links: counts of the decoder, by link.
        first_ns: arrival of the first frame, ns since the epoch; 0 when the file contains no arrival times.
        last_ns: arrival of the last.
    """

    wheels: Mapping[str, HeardWheel]
    links: Mapping[str, LinkCounters]
    first_ns: int
    last_ns: int


def survey(recording: OpenedRecording) -> Survey:
    """Return what a recording holds; errors as for `signals`."""
    configured = positions(recording.vehicle)
    router = FrameRouter(configured, lambda position, _hub, _number, _clock: HeardWheel(position))
    links = DecodedLinks(recording.guard())
    first_ns = last_ns = 0
    for link, batch, arrivals_ns in recording.blocks(links):
        first_ns, last_ns = first_ns or int(arrivals_ns[0]), max(last_ns, int(arrivals_ns[-1]))
        router.take(link, batch, arrivals_ns)
    order = {name: index for index, name in enumerate(configured.values())}
    wheels = [wheel for wheel in router.wheels.values() if wheel is not None]
    wheels.sort(key=lambda wheel: order.get(wheel.wheel, len(order)))
    return Survey({wheel.wheel: wheel for wheel in wheels}, links.counters, first_ns, last_ns)


def signals(recording: OpenedRecording, *, wheels: Collection[str] | None = None) -> Iterator[SignalItem]:
    """Yield the samples and the environment readings of a recording, in order of time for each wheel and kind.

    Samples that arrive before the sensor has stated their scale are left out, as in the estimates.

    Args:
        recording: recording or dump; its configuration names the wheels, None for names from their numbers.
        wheels: positions to read, None for all.

    Raises:
        RecordingError: the file cannot be read.
        SecurityError: the keys cannot be read.
    """
    arrivals = _Arrivals()

    def made(position: str, _hub: int, _number: int, hub: Hub) -> _Wheel | None:
        return _Wheel(position, hub, arrivals) if wheels is None or position in wheels else None

    router = FrameRouter(positions(recording.vehicle), made)
    for link, batch, arrivals_ns in recording.verified_blocks():
        # A dump has no arrival times.
        router.take(link, batch, arrivals_ns if arrivals_ns.any() else None)
        arrivals.take()
        yield from arrivals.items
        arrivals.items.clear()
    for wheel in router.wheels.values():
        if wheel is not None:
            wheel.flush()
    yield from arrivals.items


def sample_blocks(recording: OpenedRecording, *, wheels: Collection[str] | None = None) -> Iterator[SignalBlock]:
    """Yield the samples of a recording; arguments and errors as for `signals`."""
    for item in signals(recording, wheels=wheels):
        if isinstance(item, SignalBlock):
            yield item


def revolutions(
    recording: OpenedRecording, estimators: Sequence[str] = (), *, wheels: Collection[str] | None = None
) -> Iterator[RevolutionResult]:
    """Yield the revolutions of a recording in the angle domain, in order per wheel; errors as for `signals`.

    Args:
        recording: recording or dump.
        estimators: names from the registry, whose results also have the vehicle's signals; none for the revolutions
            alone.
        wheels: positions to yield, None for all.

    Raises:
        ConfigError: with estimators, the vehicle's DBC file cannot be read or does not fit.
    """
    vehicle_signals = recording.signals() if estimators else None
    for result in RecordingPass(recording, estimators, is_watched=False, signals=vehicle_signals):
        if wheels is None or result.position in wheels:
            yield result


@dataclass(order=True, slots=True)
class _Run:
    """Consecutive samples, converted."""

    first: int
    axes_mps2: FloatArray = field(compare=False)
    saturated: BoolArray = field(compare=False)

    @property
    def end(self) -> int:
        return self.first + len(self.saturated)

    def part(self, first: int, end: int) -> _Run:
        """Return samples `first` to `end` (exclusive)."""
        part = slice(first - self.first, end - self.first)
        return _Run(first, self.axes_mps2[part], self.saturated[part])


class _Segment:
    """Samples of one wheel on one clock, some of them held back until they can be dated."""

    def __init__(self, first: int, rate_hz: float) -> None:
        self.first = self.head = self.released = first
        self.rate_hz = rate_hz
        self.clock = SampleClock(rate_hz)
        self._pending: list[_Run] = []
        self._last_knot = (-math.inf, _BEFORE_EPOCH_NS)
        self._knot = max(1, round(_KNOT_S * rate_hz))

    def add(self, run: _Run, ticks_us: Sequence[int], block: int) -> None:
        """Append samples with the hub times of the first of each of their blocks."""
        self.clock.stamp_blocks(run.first, block, ticks_us)
        self._pending.append(run)
        self.head = run.end

    def insert(self, run: _Run) -> None:
        """Put late samples into their place, unless they are known or their neighbours are gone."""
        holes = [self.released, *(edge for stored in self._pending for edge in (stored.first, stored.end)), self.head]
        for lo, hi in list(zip(holes[::2], holes[1::2], strict=True)):
            first, end = max(lo, run.first), min(hi, run.end)
            if first < end:
                insort(self._pending, run.part(first, end))

    def ready(self) -> int:
        """Return the end of the samples that can be dated now."""
        if self.head - self.first < _HOST_TIME_KNOWN_S * self.rate_hz:
            return self.released
        return self.first + (self.head - round(_HOLD_S * self.rate_hz) - self.first) // self._knot * self._knot

    def release(self, end: int, host: HostClock) -> Iterator[tuple[_Run, FloatArray, NDArray[np.int64], float]]:
        """Yield the held samples before `end`, without gaps, with their hub times, host times and rate."""
        if end <= self.released:
            return
        parts: list[_Run] = []
        while self._pending and self._pending[0].first < end:
            run = self._pending.pop(0)
            if run.end > end:
                self._pending.insert(0, run.part(end, run.end))
                run = run.part(run.first, end)
            parts.append(run)
        begin = self.first + (self.released - self.first) // self._knot * self._knot
        knots = np.append(np.arange(begin, end, self._knot), end)
        # Dated by the stamps up to the knot, so that the times do not depend on the chunks in which samples arrive.
        dated_at = np.minimum(np.maximum(knots, self.first + round(_RATE_KNOWN_S * self.rate_hz)), self.head)
        knots_us = np.array([self._hub_us(*pair) for pair in zip(knots.tolist(), dated_at.tolist(), strict=True)])
        known_number = min(self.first + round((_HOST_TIME_KNOWN_S - 0.5) * self.rate_hz), self.head)
        known_us = self._hub_us(known_number, known_number)
        knots_ns = np.array([host.host_ns(hub_us, known_us) for hub_us in knots_us.tolist()], np.int64)
        # A fit that has learnt better may place a knot before the last one.
        knots_us[0], knots_ns[0] = max(knots_us[0], self._last_knot[0]), max(knots_ns[0], self._last_knot[1])
        np.maximum.accumulate(knots_us, out=knots_us)
        np.maximum.accumulate(knots_ns, out=knots_ns)
        self._last_knot = (float(knots_us[-1]), int(knots_ns[-1]))
        rate_hz = self.clock.rate_hz(float(dated_at[-1]))
        for run in _joined(parts):
            numbers = np.arange(run.first, run.end)
            hub_s = np.interp(numbers, knots, knots_us) * 1e-6
            since_ns = np.interp(numbers, knots, (knots_ns - knots_ns[0]).astype(np.float64))
            yield run, hub_s, knots_ns[0] + np.rint(since_ns).astype(np.int64), rate_hz
        self.released = end

    def _hub_us(self, number: int, dated_at: int) -> float:
        return self.clock.hub_us(dated_at) - (dated_at - number) * 1e6 / self.clock.rate_hz(dated_at)


def _joined(runs: Sequence[_Run]) -> Iterator[_Run]:
    """Yield runs that follow each other without a gap as one."""
    begin = 0
    for stop in range(1, len(runs) + 1):
        if stop < len(runs) and runs[stop - 1].end == runs[stop].first:
            continue
        parts = runs[begin:stop]
        if len(parts) == 1:
            yield parts[0]
        elif parts:
            yield _Run(
                parts[0].first,
                np.concatenate([part.axes_mps2 for part in parts]),
                np.concatenate([part.saturated for part in parts]),
            )
        begin = stop


@dataclass(slots=True)
class _Arrived:
    """Samples of one wheel in the order of their numbers, as they arrived in one block of frames."""

    wheel: _Wheel
    first: int
    axes: int
    ticks_us: list[int]
    counts: list[NDArray[np.int16]]
    end: int

    def goes_on(self, first: int, axes: int, length: int) -> bool:
        """Return whether blocks of a length follow these, and are like them."""
        return (first, axes, length) == (self.end, self.axes, (self.end - self.first) // len(self.ticks_us))


@dataclass(slots=True)
class _Arrivals:
    """Samples that the wheels have not taken yet, and the items that are complete."""

    waiting: list[_Arrived] = field(default_factory=list)
    items: list[SignalItem] = field(default_factory=list)

    def take(self) -> None:
        """Give the wheels their samples in the order of time."""
        for arrived in sorted(self.waiting, key=lambda arrived: arrived.ticks_us[0]):
            arrived.wheel.take(arrived)
        self.waiting.clear()


class _Wheel:
    """Samples of one wheel."""

    def __init__(self, position: str, hub: Hub, arrivals: _Arrivals) -> None:
        self._position = position
        self._hub = hub
        self._arrivals = arrivals
        self._hello: Hello | None = None
        self._reading: SensorReading | None = None
        self._segment: _Segment | None = None
        self._segments = -1
        self._lost = 0
        self._end: int | None = None

    def hello(self, hello: Hello) -> None:
        """Take the layout and scale of the samples; a change of sensor, rate or layout begins a new segment."""
        previous = self._hello
        if previous == hello:
            return
        self._arrivals.take()
        if previous is None or any(
            getattr(previous, name) != getattr(hello, name) for name in ("axes", "rate_hz", "boot_count", "sensor_id")
        ):
            self.flush()
        self._hello, self._reading = hello, SensorReading.from_hello(hello)

    def restart(self) -> None:
        """Handle a restart of the hub."""
        self._arrivals.take()
        self.flush()
        self._hello = self._reading = None

    def environment(self, tick_us: int, environment: Environment) -> None:
        """Take pressure and temperature."""
        self._arrivals.items.append(
            EnvironmentReading(
                wheel=self._position,
                hub_time_s=tick_us * 1e-6,
                host_time_ns=self._hub.host.host_ns(tick_us),
                pressure_pa=environment.pressure_pa,
                temperature_degc=environment.temperature_degc,
                supply_v=environment.supply_v,
            )
        )

    def add(
        self, first_sample: int, ticks_us: Sequence[int], axes: int, counts: NDArray[np.int16], host: HostClock
    ) -> None:
        """Take consecutive samples, with the hub times of the first of each of their equally long blocks."""
        del host
        waiting = self._arrivals.waiting
        last = next((arrived for arrived in reversed(waiting) if arrived.wheel is self), None)
        if last is not None and last.goes_on(first_sample, axes, len(counts) // len(ticks_us)):
            last.ticks_us += ticks_us
            last.counts.append(counts)
            last.end += len(counts)
        else:
            end = first_sample + len(counts)
            waiting.append(_Arrived(self, first_sample, axes, [*ticks_us], [counts], end))

    def take(self, arrived: _Arrived) -> None:
        """Date and convert samples that have arrived."""
        first_sample, axes, ticks_us = arrived.first, arrived.axes, arrived.ticks_us
        counts = arrived.counts[0] if len(arrived.counts) == 1 else np.concatenate(arrived.counts)
        hello, reading, segment = self._hello, self._reading, self._segment
        if hello is None or reading is None or axes != hello.axes:
            return
        converted = np.full((len(counts), len(Axis)), np.nan)
        converted[:, reading.columns] = reading.samples_mps2(counts)
        limit = reading.saturation_counts
        saturated: BoolArray = np.logical_or.reduce((counts >= limit) | (counts <= -limit), axis=1)
        first = unwrap(segment.head, first_sample) if segment is not None else first_sample
        if segment is not None:
            step = first - segment.head
            expected_us = segment.clock.hub_us(first)
            if step < 0 and abs(ticks_us[0] - expected_us) < _LATE_TOLERANCE_US:
                segment.insert(_Run(first, converted, saturated))
                return
            if step < 0 or step > _MAX_GAP_S * hello.rate_hz:
                self.flush()
                if step > 0 and not is_jump(step, ticks_us[0] - segment.clock.hub_us(segment.head), hello.rate_hz):
                    self._lost += step
                first = first if step > 0 else first_sample
                segment = None
        if segment is None:
            self._segments += 1
            segment = self._segment = _Segment(first, hello.rate_hz)
            self._end = None
        segment.add(_Run(first, converted, saturated), ticks_us, len(counts) // len(ticks_us))
        self._release(segment, segment.ready())

    def flush(self) -> None:
        """Complete the samples held back, at the end of a segment."""
        segment, self._segment = self._segment, None
        if segment is not None:
            self._release(segment, segment.head)

    def _release(self, segment: _Segment, end: int) -> None:
        hello, reading = self._hello, self._reading
        assert hello is not None
        assert reading is not None
        range_mps2 = reading.range_mps2
        for run, hub_s, host_ns, rate_hz in segment.release(end, self._hub.host):
            if self._end is not None:
                self._lost += run.first - self._end
            self._arrivals.items.append(
                SignalBlock(
                    wheel=self._position,
                    sensor_id=hello.sensor_id,
                    segment=self._segments,
                    first_sample=run.first,
                    hub_time_s=hub_s,
                    host_time_ns=host_ns,
                    axes_mps2=run.axes_mps2,
                    saturated=run.saturated,
                    range_mps2=range_mps2,
                    lost_before=self._lost,
                    rate_hz=rate_hz,
                    ac_coupled=reading.ac_coupled,
                )
            )
            self._lost, self._end = 0, run.end
