"""Silence of hubs, sensors, parts of their streams, vehicle buses and receivers, from the arrival times of frames.

No clock: every time is given. The state changes at times that follow from the frames alone, so that live, replay and
batch report the same silences.
"""

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from enum import Enum, auto
from typing import Final, NamedTuple

from firmware_protocol import wire
from firmware_protocol.frame_blocks import Heard
from firmware_protocol.messages import HUB_ITSELF, Axis, Hello, Message, MessageType
from gateway.core.constants import AXIS_NAMES
from gateway.core.estimates.results import Silence, SilentPart
from gateway.core.links.bus_frames import has_frames
from gateway.core.links.nmea_sentences import has_position
from gateway.core.links.source import BusFrames, SensorLines, VehicleData
from gateway.core.reasons import Reason
from gateway.core.session.reasons import SessionCode
from gateway.core.wheels.old_pressure import ENVIRONMENT_INTERVALS, ENVIRONMENT_LEAST_S
from gateway.core.wheels.reasons import WheelCode

PositionOf = Callable[[str, int, int], str]

_S: Final = 1_000_000_000
SLOT_NS: Final = 100_000_000
"""Arrivals within one slot count as one, so that a link that delivers in bursts has the pace of its bursts."""
# The usual interval is the median of this many intervals; missing ones count as the expected interval.
_INTERVALS: Final = 15
_MIN_INTERVALS: Final = 5
# Frames of different links arrive in almost the order of their times; a larger step back is a clock that was set.
_SET_BACK_NS: Final = 5_000_000_000
_NEVER_NS: Final = 1 << 63
# Silences of a sensor that no result has been matched with yet.
_GAPS: Final = 256


class Limit(NamedTuple):
    """Silence after which a stream counts as stopped.

    Attributes:
        intervals: multiple of the stream's own usual interval.
        least_s: and at least this long.
        expected_s: interval before any has been seen.
    """

    intervals: float
    least_s: float
    expected_s: float


LIMITS: Final = {
    # Blocks come every 10 to 60 ms. Radio links that repeat packets and busy computers stall for some tenths of a
    # second.
    "samples": Limit(5.0, 1.0, 0.1),
    # A sensor sends its environment every second and its hello every 2 s. Two in a row may be lost on the link.
    "messages": Limit(3.0, 3.0, wire.ENVIRONMENT_PERIOD_S),
    # A hub sends its status and its time every second.
    "hub": Limit(3.0, 3.0, wire.HUB_STATUS_PERIOD_S),
    # Much faster in general, but as a hub: a control unit may restart. A receiver sends once a second.
    "vehicle": Limit(3.0, 3.0, wire.HUB_STATUS_PERIOD_S),
    # As the estimates that rest on the pressure.
    "environment": Limit(ENVIRONMENT_INTERVALS, ENVIRONMENT_LEAST_S, wire.ENVIRONMENT_PERIOD_S),
    # A configured sensor that nothing was ever received from: five hellos are due by then.
    "first": Limit(5.0, 10.0, wire.HELLO_PERIOD_S),
}
"""Limits of each stream; `silent_after_s` of the configuration replaces the least silence of samples."""


class VehiclePart(Enum):
    """What a link brings of the vehicle beside the wheels, the widest first."""

    BUS = auto()
    RECEIVER = auto()
    POSITION = auto()


_SILENT_PARTS: Final = {
    VehiclePart.BUS: SessionCode.BUS_SILENT,
    VehiclePart.RECEIVER: SessionCode.RECEIVER_SILENT,
    VehiclePart.POSITION: SessionCode.POSITION_MISSING,
}
_LINK_PARTS: Final = (VehiclePart.BUS, VehiclePart.RECEIVER)
_NO_PARTS: Final = frozenset[VehiclePart]()
_BUS_PARTS: Final = frozenset({VehiclePart.BUS})
_RECEIVER_PARTS: Final = frozenset({VehiclePart.RECEIVER})
_POSITION_PARTS: Final = frozenset({VehiclePart.RECEIVER, VehiclePart.POSITION})


def parts_heard(item: VehicleData) -> frozenset[VehiclePart]:
    """Return which parts an item is a sign of life of: errors of a bus are none, nor sentences without a position."""
    if isinstance(item, BusFrames):
        return _BUS_PARTS if has_frames(item.data) else _NO_PARTS
    if isinstance(item, SensorLines):
        return _NO_PARTS  # parked cars are silent
    return _POSITION_PARTS if has_position(item.data) else _RECEIVER_PARTS


class _Stream:
    """Arrival times of one kind of message: the last one and the usual interval."""

    __slots__ = ("_intervals", "_limit", "_slot", "_slot_ns", "counted_from_ns", "last_ns", "limit_ns")

    def __init__(self, limit: Limit, begin_ns: int) -> None:
        """Begin without an arrival; silence counts from `begin_ns`."""
        self._limit = limit
        self._intervals: deque[int] = deque(maxlen=_INTERVALS)
        self._slot: int | None = None
        self._slot_ns = begin_ns
        self.last_ns = self.counted_from_ns = begin_ns
        self.limit_ns = self._limit_ns()

    def arrived(self, host_ns: int) -> None:
        self.last_ns = host_ns
        # What was read before a pause of this computer may be taken after it: the pause stays left out. A time that was
        # set back counts again by itself.
        if host_ns > self.counted_from_ns:
            self.counted_from_ns = host_ns
        slot = host_ns // SLOT_NS
        if slot == self._slot:
            return
        if self._slot is not None and slot > self._slot:
            self._intervals.append(host_ns - self._slot_ns)
            self.limit_ns = self._limit_ns()
        self._slot, self._slot_ns = slot, host_ns

    @property
    def due_ns(self) -> int:
        """Time from which the stream is silent."""
        return self.counted_from_ns + self.limit_ns

    def _limit_ns(self) -> int:
        missing_count = max(0, _MIN_INTERVALS - len(self._intervals))
        intervals_ns = sorted([*self._intervals, *[round(self._limit.expected_s * _S)] * missing_count])
        return max(round(self._limit.least_s * _S), round(self._limit.intervals * intervals_ns[len(intervals_ns) // 2]))


class _Sensor:
    """Streams of one sensor.

    Attributes:
        samples: its samples.
        messages: its other messages.
        environment: None before the first.
        declared: axis mask of its hello, 0 before one.
        axes_ns: last arrival of each axis that has been declared.
        last_ns: last frame of any kind.
        resumed_ns: end of its last silence, or its first frame.
        gaps: begin and end of the latest silences of its samples.
    """

    __slots__ = ("axes_ns", "declared", "environment", "gaps", "last_ns", "messages", "resumed_ns", "samples")

    def __init__(self, samples: Limit, host_ns: int) -> None:
        self.samples = _Stream(samples, host_ns)
        self.messages = _Stream(LIMITS["messages"], host_ns)
        self.environment: _Stream | None = None
        self.declared = 0
        self.axes_ns: dict[Axis, int] = {}
        self.gaps: deque[tuple[int, int]] = deque(maxlen=_GAPS)
        self.last_ns = self.resumed_ns = host_ns

    def streams(self) -> Iterator[_Stream]:
        yield self.samples
        yield self.messages
        if self.environment is not None:
            yield self.environment

    def take(self, type_: int, message: Message | None, axes: int, host_ns: int) -> None:
        if host_ns - self.last_ns >= self.messages.limit_ns:
            self.resumed_ns = host_ns
            if self.environment is not None:
                self.environment.counted_from_ns = host_ns
        self.last_ns = host_ns
        if type_ == MessageType.SAMPLES:
            samples = self.samples
            if host_ns >= samples.counted_from_ns + samples.limit_ns:
                self.gaps.append((samples.last_ns, host_ns))
            samples.arrived(host_ns)
            for axis, last_ns in self.axes_ns.items():
                if axes >> axis & 1 and host_ns > last_ns:
                    self.axes_ns[axis] = host_ns
            return
        self.messages.arrived(host_ns)
        if type_ == MessageType.ENVIRONMENT:
            if self.environment is None:
                self.environment = _Stream(LIMITS["environment"], host_ns)
            self.environment.arrived(host_ns)
        elif isinstance(message, Hello) and message.axes != self.declared:
            self.declared = message.axes
            declared = [axis for axis in Axis if message.axes >> axis & 1]
            self.axes_ns = {axis: self.axes_ns.get(axis, host_ns) for axis in declared}

    def count_again(self, host_ns: int) -> None:
        self.resumed_ns = host_ns
        for stream in self.streams():
            stream.counted_from_ns = host_ns

    def is_silent(self, now_ns: int) -> bool:
        return now_ns >= self.samples.due_ns and now_ns >= self.messages.due_ns

    def silences(self, now_ns: int, others_ns: int) -> Iterator[Silence]:
        """Yield what is silent of a sensor whose hub is not; `others_ns` is the last sign of life of the hub's rest."""
        age_s = (now_ns - self.samples.last_ns) / _S
        if self.is_silent(now_ns):
            # Evidence that only the sensor is gone: the rest of the hub has outlived it.
            if others_ns - self.last_ns >= self.messages.limit_ns:
                age_s = (now_ns - self.last_ns) / _S
                yield Silence(SilentPart.SENSOR, age_s, Reason(SessionCode.SENSOR_SILENT, silence_s=age_s))
            else:
                missing = Reason(SessionCode.SAMPLES_MISSING, silence_s=age_s)
                yield Silence(SilentPart.SAMPLES, age_s, missing, is_certain=False)
            return
        if now_ns >= self.samples.due_ns:
            since_ns = max(self.samples.counted_from_ns, self.resumed_ns)
            # Evidence that only the samples are gone: another message has come well after them.
            is_certain = self.messages.last_ns - since_ns >= self.samples.limit_ns // 2
            code = SessionCode.SAMPLES_SILENT if is_certain else SessionCode.SAMPLES_MISSING
            yield Silence(SilentPart.SAMPLES, age_s, Reason(code, silence_s=age_s), is_certain)
        else:
            for axis, last_ns in self.axes_ns.items():
                if now_ns - max(last_ns, self.resumed_ns) >= self.samples.limit_ns:
                    age_s = (now_ns - last_ns) / _S
                    reason = Reason(SessionCode.AXIS_SILENT, axis=AXIS_NAMES[axis], silence_s=age_s)
                    yield Silence(SilentPart.AXIS, age_s, reason)
        if self.environment is not None and now_ns >= self.environment.due_ns:
            age_s = (now_ns - self.environment.last_ns) / _S
            yield Silence(SilentPart.ENVIRONMENT, age_s, Reason(WheelCode.ENVIRONMENT_SILENT, silence_s=age_s))

    def due_ns(self) -> Iterator[int]:
        """Yield the times at which the state may change without a further frame."""
        for stream in self.streams():
            yield stream.due_ns
        for last_ns in self.axes_ns.values():
            yield max(last_ns, self.resumed_ns) + self.samples.limit_ns


@dataclass(slots=True)
class _Hub:
    """Streams of one hub: its own messages, None before the first, and those of its sensors by wheel number."""

    stream: _Stream | None = None
    sensors: dict[int, _Sensor] = field(default_factory=dict)

    @property
    def last_ns(self) -> int:
        times = [sensor.last_ns for sensor in self.sensors.values()]
        return max([*times, *([self.stream.last_ns] if self.stream is not None else [])])

    def is_silent(self, now_ns: int) -> bool:
        is_sending = self.stream is not None and now_ns < self.stream.due_ns
        return not is_sending and all(sensor.is_silent(now_ns) for sensor in self.sensors.values())

    def others_ns(self, sensor: _Sensor) -> int:
        """Return the time of the last frame that is not of `sensor`."""
        stream_ns = self.stream.last_ns if self.stream is not None else 0
        return max([stream_ns, *(neighbour.last_ns for neighbour in self.sensors.values() if neighbour is not sensor)])

    def due_ns(self) -> Iterator[int]:
        if self.stream is not None:
            yield self.stream.due_ns
        for sensor in self.sensors.values():
            yield from sensor.due_ns()


@dataclass(slots=True)
class _Link:
    """State of one link.

    Attributes:
        begin_ns: time of the first item.
        now_ns: time up to which the link is known.
        later_ns: time from the first item of any link to its own.
        down: why the link is down, None while it is open.
        opened_ns: time at which it was opened last.
        hubs: hubs heard on it.
        vehicle: frames of a vehicle bus, or sentences of a receiver and those with a position.
        due_ns: time before which its state cannot change without a frame.
        paused_ns: begin and end of the last pause of this computer.
    """

    begin_ns: int
    now_ns: int
    later_ns: int = 0
    down: Reason | None = None
    opened_ns: int = 0
    hubs: dict[int, _Hub] = field(default_factory=dict)
    vehicle: dict[VehiclePart, _Stream] = field(default_factory=dict)
    due_ns: int = 0
    paused_ns: tuple[int, int] = (0, 0)

    def was_read_before_pause(self, host_ns: int) -> bool:
        """Return whether an item was read just before the last pause, or in it, and is taken after it."""
        begin_ns, end_ns = self.paused_ns
        return begin_ns - _SET_BACK_NS <= host_ns < end_ns

    def leave_out(self, pause_ns: int, now_ns: int) -> None:
        """Count no silence in a pause before `now_ns`; what was silent before it stays so."""
        sensors = [sensor for hub in self.hubs.values() for sensor in hub.sensors.values()]
        streams = [stream for sensor in sensors for stream in sensor.streams()]
        streams += [hub.stream for hub in self.hubs.values() if hub.stream is not None]
        streams += self.vehicle.values()
        for stream in streams:
            stream.counted_from_ns = min(stream.counted_from_ns + pause_ns, max(now_ns, stream.counted_from_ns))
        for sensor in sensors:
            sensor.resumed_ns = min(sensor.resumed_ns + pause_ns, max(now_ns, sensor.resumed_ns))
            for axis, last_ns in sensor.axes_ns.items():
                sensor.axes_ns[axis] = min(last_ns + pause_ns, max(now_ns, last_ns))

    @property
    def silent_part(self) -> VehiclePart | None:
        """The widest part of the vehicle that is silent."""
        return next((part for part, stream in self.vehicle.items() if self.now_ns >= stream.due_ns), None)

    def count_again(self, host_ns: int) -> None:
        """Count every silence from `host_ns`."""
        for stream in self.vehicle.values():
            stream.counted_from_ns = host_ns
        for hub in self.hubs.values():
            if hub.stream is not None:
                hub.stream.counted_from_ns = host_ns
            for sensor in hub.sensors.values():
                sensor.count_again(host_ns)


class SilentVehicle(NamedTuple):
    """A vehicle bus or receiver that is silent, or a receiver without a position.

    Attributes:
        link: its link.
        part: what is silent.
        age_s: time since it was last heard.
    """

    link: str
    part: VehiclePart
    age_s: float

    @property
    def reason(self) -> Reason:
        """What is silent, and for how long."""
        return Reason(_SILENT_PARTS[self.part], silence_s=self.age_s)


@dataclass(frozen=True, slots=True)
class SilentHub:
    """A hub that sends no frame of any kind.

    Attributes:
        link: its link.
        hub: its number.
        age_s: time since its last frame.
        positions: wheels without data because of it.
    """

    link: str
    hub: int
    age_s: float
    positions: tuple[str, ...]


class SilenceWatch:
    """Watches every link, hub, sensor, vehicle bus and receiver of a session or recording."""

    def __init__(self, position_of: PositionOf, configured: Iterable[str] = (), silent_after_s: float | None = None):
        """Start without a frame.

        Args:
            position_of: returns the wheel position of link, hub and wheel number.
            configured: positions from which something must come.
            silent_after_s: silence after which samples count as stopped; None for that of LIMITS.
        """
        self._position_of = position_of
        self._configured = tuple(configured)
        self._samples = LIMITS["samples"]
        if silent_after_s is not None:
            self._samples = Limit(self._samples.intervals, silent_after_s, self._samples.expected_s)
        self._links: dict[str, _Link] = {}

    # Input

    def turned(self, link: str, host_ns: int, down: Reason | None) -> None:
        """Note that a link is down, and why; None of one that is open, whose hubs get their time again."""
        state = self._link(link, host_ns)
        state.down = down
        if down is None:
            state.opened_ns = host_ns
            state.count_again(host_ns)

    def paused(self, link: str, pause_ns: int, now_ns: int) -> None:
        """Note that this computer paused before `now_ns`: the pause is no silence of the link."""
        state = self._link(link, now_ns)
        state.leave_out(pause_ns, now_ns)
        state.paused_ns = now_ns - pause_ns, now_ns
        state.now_ns, state.due_ns = max(state.now_ns, now_ns), 0

    def vehicle(self, name: str, parts: frozenset[VehiclePart], host_ns: int) -> None:
        """Take the parts of the vehicle that an item is a sign of life of."""
        if not parts:
            return
        link = self._brought(name, host_ns)
        # A receiver that is heard is to have a position.
        expected_parts = _POSITION_PARTS if VehiclePart.RECEIVER in parts else parts
        if not expected_parts <= link.vehicle.keys():
            streams = link.vehicle
            link.vehicle = {
                part: streams.get(part) or _Stream(LIMITS["vehicle"], host_ns)
                for part in VehiclePart
                if part in expected_parts or part in streams
            }
        for part in parts:
            link.vehicle[part].arrived(host_ns)
        link.due_ns = min([link.due_ns, *(stream.due_ns for stream in link.vehicle.values())])

    def changes(self, link: str, now_ns: int) -> Iterable[None]:
        """Move the time of a link forward; yield at each time on the way at which its state may have changed."""
        state = self._link(link, now_ns)
        if now_ns >= state.due_ns:
            return self._changes(state, now_ns)
        state.now_ns = max(state.now_ns, now_ns)
        return ()

    def _changes(self, state: _Link, now_ns: int) -> Iterator[None]:
        while now_ns >= state.due_ns:
            due_ns = self._next_change_ns(state)
            state.due_ns = due_ns if due_ns is not None else _NEVER_NS
            if now_ns >= state.due_ns:
                state.now_ns = state.due_ns
                yield
        state.now_ns = max(state.now_ns, now_ns)

    # Output

    @staticmethod
    def _next_change_ns(state: _Link) -> int | None:
        first_ns = state.begin_ns + round(LIMITS["first"].least_s * _S)
        due_ns = [first_ns, *(time_ns for hub in state.hubs.values() for time_ns in hub.due_ns())]
        due_ns += [stream.due_ns for stream in state.vehicle.values()]
        return min((time_ns for time_ns in due_ns if time_ns > state.now_ns), default=None)

    def links(self) -> tuple[str, ...]:
        """Return the names of the links."""
        return tuple(self._links)

    def newest_ns(self) -> int:
        """Return the latest time of any link, 0 before the first item."""
        return max((link.now_ns for link in self._links.values()), default=0)

    def since_begin_s(self, host_ns: int) -> float:
        """Return the time from the first item to `host_ns`."""
        return (host_ns - min((link.begin_ns for link in self._links.values()), default=host_ns)) / _S

    def link_s(self, name: str) -> float:
        """Return the time from the first item of any link up to which one is known, 0 before its first."""
        link = self._links.get(name)
        return (link.now_ns - link.begin_ns + link.later_ns) / _S if link is not None else 0.0

    def ended_before_s(self, position: str, host_ns: int) -> float:
        """Return how long samples of a wheel were missing in silences that ended before `host_ns`, each time once."""
        silent_ns = 0
        for name, link in self._links.items():
            for number, hub in link.hubs.items():
                for wheel, sensor in hub.sensors.items():
                    if sensor.gaps and self._position_of(name, number, wheel) == position:
                        while sensor.gaps and sensor.gaps[0][1] <= host_ns:
                            begin_ns, end_ns = sensor.gaps.popleft()
                            silent_ns += end_ns - begin_ns
        return silent_ns / _S

    def down_links(self) -> Iterator[tuple[str, Reason]]:
        """Yield the links that are down, with the reason."""
        for name, link in self._links.items():
            if link.down is not None:
                yield name, link.down

    def elapsed_s(self) -> float:
        """Return the time since the first item."""
        return max(((link.now_ns - link.begin_ns) / _S for link in self._links.values()), default=0.0)

    def of_wheels(self) -> dict[str, tuple[Silence, ...]]:
        """Return the silences of each wheel, the widest first; wheels without any are left out."""
        by_position: dict[str, tuple[Silence, ...]] = {}
        known_positions: set[str] = set()
        for name, link in self._links.items():
            for number, hub in link.hubs.items():
                for wheel, sensor in hub.sensors.items():
                    position = self._position_of(name, number, wheel)
                    known_positions.add(position)
                    silences = tuple(_silences(link, hub, sensor))
                    if silences:
                        by_position[position] = silences
        waited_s = self.elapsed_s()
        is_open = any(link.down is None and not link.vehicle for link in self._links.values())
        if is_open and waited_s >= LIMITS["first"].least_s:
            reason = Reason(SessionCode.SENSOR_NEVER_HEARD, silence_s=waited_s)
            for position in self._configured:
                if position not in known_positions:
                    by_position[position] = (Silence(SilentPart.SENSOR, waited_s, reason),)
        return by_position

    def silent_hubs(self, *, of_down_links: bool = False) -> Iterator[SilentHub]:
        """Yield the silent hubs of open links, or those of links that are down; hubs without wheels do not matter.

        A link that is open again counts as down for a hub of which no frame has come since: it may be frozen.
        """
        for name, link in self._links.items():
            for number, hub in link.hubs.items():
                if not hub.sensors:
                    continue
                is_unheard = link.down is not None or hub.last_ns < link.opened_ns
                if is_unheard if of_down_links else link.down is None and hub.is_silent(link.now_ns):
                    positions = tuple(self._position_of(name, number, wheel) for wheel in sorted(hub.sensors))
                    yield SilentHub(name, number, (link.now_ns - hub.last_ns) / _S, positions)

    def silent_vehicles(self, *, of_down_links: bool = False) -> Iterator[SilentVehicle]:
        """Yield what is silent of vehicles, of open links or of links that are down."""
        for name, link in self._links.items():
            part = next(iter(link.vehicle), None) if of_down_links else link.silent_part
            if part is not None and (link.down is not None) is of_down_links:
                yield SilentVehicle(name, part, (link.now_ns - link.vehicle[part].last_ns) / _S)

    def silent_s(self, link: str) -> float | None:
        """Return the time since the last frame of a link that is down, or brings nothing else either, else None.

        Of a link without a frame it is the time since its first event.
        """
        state = self._links.get(link)
        if state is None:
            return None
        hubs = state.hubs.values()
        is_silent = bool(hubs or state.vehicle) and all(hub.is_silent(state.now_ns) for hub in hubs)
        if state.down is None and not (is_silent and (not state.vehicle or state.silent_part in _LINK_PARTS)):
            return None
        heard_ns = [hub.last_ns for hub in hubs] + [stream.last_ns for stream in state.vehicle.values()]
        return (state.now_ns - max(heard_ns, default=state.begin_ns)) / _S

    def speaking_hubs(self, link: str) -> frozenset[int]:
        """Return the numbers of a link's hubs that are not silent."""
        state = self._links.get(link)
        hubs = state.hubs.items() if state is not None and state.down is None else ()
        return frozenset(number for number, hub in hubs if state is not None and not hub.is_silent(state.now_ns))

    def _link(self, name: str, host_ns: int) -> _Link:
        link = self._links.get(name)
        if link is None:
            later_ns = host_ns - min((other.begin_ns for other in self._links.values()), default=host_ns)
            link = self._links[name] = _Link(host_ns, host_ns, later_ns)
        return link

    def _brought(self, name: str, host_ns: int) -> _Link:
        """Return a link at the time of a frame."""
        link = self._links.get(name) or self._link(name, host_ns)
        if host_ns < link.now_ns - _SET_BACK_NS and not link.was_read_before_pause(host_ns):
            # Recordings that follow each other may have times that do not.
            link.begin_ns -= link.now_ns - host_ns
            link.now_ns, link.due_ns = host_ns, 0
            link.count_again(host_ns)
        if host_ns > link.now_ns:
            link.now_ns = host_ns
        return link

    def heard(self, name: str, frame: Heard) -> None:
        """Take what matters of a frame."""
        host_ns, number, wheel, type_, message, axes = frame
        link = self._brought(name, host_ns)
        hub = link.hubs.get(number)
        if hub is None:
            hub = link.hubs[number] = _Hub()
        if wheel == HUB_ITSELF:
            if hub.stream is None:
                hub.stream = _Stream(LIMITS["hub"], host_ns)
            hub.stream.arrived(host_ns)
            link.due_ns = min(link.due_ns, hub.stream.due_ns)
            return
        sensor = hub.sensors.get(wheel)
        if sensor is None:
            sensor = hub.sensors[wheel] = _Sensor(self._samples, host_ns)
        is_new = not sensor.axes_ns
        sensor.take(type_, message, axes, host_ns)
        if is_new or type_ != MessageType.SAMPLES:
            # It may have begun a stream, which is due earlier than those before.
            link.due_ns = min([link.due_ns, *sensor.due_ns()])


def _silences(link: _Link, hub: _Hub, sensor: _Sensor) -> Iterator[Silence]:
    now_ns = link.now_ns
    if link.down is not None:
        age_s = (now_ns - sensor.last_ns) / _S
        yield Silence(SilentPart.LINK, age_s, Reason(SessionCode.LINK_DOWN, state=link.down))
    elif hub.is_silent(now_ns):
        age_s = (now_ns - hub.last_ns) / _S
        yield Silence(SilentPart.HUB, age_s, Reason(SessionCode.HUB_OF_WHEEL_SILENT, silence_s=age_s))
    else:
        yield from sensor.silences(now_ns, hub.others_ns(sensor))
