"""Simulated hub: message schedule, counters and time stamps of the hub's own clock."""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_protocol import wire
from firmware_protocol.codec import encode_frame
from firmware_protocol.declaration import SAMPLES
from firmware_protocol.messages import (
    HUB_ITSELF,
    Environment,
    Frame,
    Hello,
    HubStatus,
    LogLevel,
    LogText,
    Message,
    MessageType,
    SampleBlock,
    TimeSync,
)
from gateway.security.cmac import FrameSigner
from gateway.security.key_file import hub_identity, sensor_identity
from gateway.simulator.scenario_tables import Hub
from gateway.simulator.sensor import FULL_SCALE_COUNTS
from gateway.simulator.simulated_wheel import WheelSimulator

FIRMWARE = (1, 0, 0)
HUB_ID = 0x5452_4541_4400_0000
_MASK = 0xFFFF_FFFF
SENSOR_SUPPLY_V = 3.0


def hello_of(wheel: WheelSimulator) -> Hello:
    """Return what the hub of a wheel says of its sensor."""
    return Hello(
        protocol_major=wire.VERSION_MAJOR,
        protocol_minor=wire.VERSION_MINOR,
        hub_id=HUB_ID + wheel.plan.hub.hub,
        sensor_id=wheel.plan.sensor_id,
        firmware=FIRMWARE,
        boot_count=wheel.plan.hub.boot_count,
        rate_hz=wheel.plan.sensor.rate_hz,
        axes=wheel.chain.axes,
        coupling=wheel.chain.coupling,
        highpass_hz=wheel.chain.highpass_hz,
        range_mps2=wheel.chain.range_mps2,
        scale_mps2=wheel.chain.scale_mps2,
        offset_counts=(0.0, 0.0, 0.0),
        saturation_counts=FULL_SCALE_COUNTS,
    )


class TimedFrame(NamedTuple):
    """An encoded frame and the true time, s since the beginning, at which the hub hands it to the link."""

    time_s: float
    data: bytes


class _Outgoing(NamedTuple):
    """A message to be sent: its true time, wheel and hub time stamp (us)."""

    time_s: float
    wheel: int
    tick_us: int
    type: MessageType
    message: Message


class HubSimulator:
    """Frames the samples of its wheels, block by block."""

    def __init__(
        self, hub: Hub, wheels: Sequence[WheelSimulator], title: str, signer: FrameSigner | None = None
    ) -> None:
        """Take the hub's data, its wheels, its first log text and an optional signer."""
        self._signer = signer
        self._identities = {wheel.plan.wheel: sensor_identity(wheel.plan.sensor_id) for wheel in wheels}
        self._identities[HUB_ITSELF] = hub_identity(HUB_ID + hub.hub)
        self._hub = hub
        self._wheels = tuple(wheels)
        self._title = title
        self._now_s = 0.0
        most_bytes = wire.MAX_PAYLOAD_BYTES if signer is None else wire.MAX_SIGNED_PAYLOAD_BYTES
        self._pending = {wheel.plan.wheel: _Pending(wheel, most_bytes) for wheel in wheels}
        self._sequence = dict.fromkeys([*self._pending, HUB_ITSELF], 0)
        self._sent = 0

    @staticmethod
    def identities(hub: Hub, sensor_ids: Iterable[int]) -> list[str]:
        """Return the identities that sign: the sensors of a hub and the hub itself."""
        return [*map(sensor_identity, sensor_ids), hub_identity(HUB_ID + hub.hub)]

    def advance(self, until_s: float) -> list[TimedFrame]:
        """Return the frames sent since the last call and before `until_s`, in sending order."""
        due = [*self._periodic(self._now_s, until_s)]
        for pending in self._pending.values():
            due += pending.blocks(until_s, self._tick)
        self._now_s = until_s
        if any(not wheel.plan.speaks(until_s) for wheel in self._wheels):
            due = [item for item in due if item.wheel == HUB_ITSELF or self._pending[item.wheel].speaks(item.time_s)]
        due.sort(key=lambda item: item.time_s)
        return [self._encoded(item) for item in due]

    def _tick(self, time_s: float) -> int:
        """Return the hub's clock in us at a true time."""
        return round((self._hub.uptime_s + time_s * (1.0 + self._hub.clock_ppm * 1e-6)) * 1e6)

    def _encoded(self, item: _Outgoing) -> TimedFrame:
        message = item.message
        if isinstance(message, HubStatus):
            message = message._replace(frames_sent=self._sent & _MASK)
        seq = self._sequence[item.wheel]
        self._sequence[item.wheel] = (seq + 1) & _MASK
        self._sent += 1
        frame = Frame(item.type, self._hub.hub, item.wheel, seq, item.tick_us & _MASK, message)
        data = encode_frame(frame)
        if self._signer is not None:
            data = self._signer(data, self._identities[item.wheel], self._hub.boot_count)
        return TimedFrame(item.time_s, data)

    def _periodic(self, begin_s: float, end_s: float) -> Iterator[_Outgoing]:
        if begin_s == 0.0:
            yield self._outgoing(0.0, HUB_ITSELF, MessageType.LOG_TEXT, LogText(LogLevel.INFO, self._title))
        for time_s in _times(begin_s, end_s, wire.HELLO_PERIOD_S):
            for wheel in self._wheels:
                yield self._outgoing(time_s, wheel.plan.wheel, MessageType.HELLO, hello_of(wheel))
        for time_s in _times(begin_s, end_s, wire.ENVIRONMENT_PERIOD_S):
            for wheel in self._wheels:
                pressure, temperature = wheel.plan.told_pressure_pa(time_s), wheel.plan.temperature_degc.at(time_s)
                message = Environment(pressure, temperature, SENSOR_SUPPLY_V)
                yield self._outgoing(time_s, wheel.plan.wheel, MessageType.ENVIRONMENT, message)
        for time_s in _times(begin_s, end_s, wire.HUB_STATUS_PERIOD_S):
            yield self._outgoing(time_s, HUB_ITSELF, MessageType.HUB_STATUS, self._status(time_s))
        for time_s in _times(begin_s, end_s, wire.TIME_SYNC_PERIOD_S):
            yield self._outgoing(time_s, HUB_ITSELF, MessageType.TIME_SYNC, TimeSync(self._tick(time_s), 0))

    def _outgoing(self, time_s: float, wheel: int, type_: MessageType, message: Message) -> _Outgoing:
        return _Outgoing(time_s, wheel, self._tick(time_s), type_, message)

    def _status(self, time_s: float) -> HubStatus:
        hub = self._hub
        battery = None
        if hub.battery_percent is not None:
            battery = round(max(0.0, hub.battery_percent - hub.battery_drain_percent_per_h * time_s / 3600.0))
        return HubStatus(
            uptime_s=int(hub.uptime_s + time_s),
            battery_percent=battery,
            supply_v=hub.supply_v,
            supply_w=hub.supply_w,
            rssi_dbm=hub.rssi_dbm,
            frames_sent=0,
            frames_dropped=0,
            samples_dropped=0,
            link_retries=0,
        )


class _Pending:
    """Samples of one wheel that do not fill a frame yet."""

    def __init__(self, wheel: WheelSimulator, most_bytes: int) -> None:
        self._wheel = wheel
        self.speaks = wheel.plan.speaks
        self._axes = wheel.chain.axes
        room = most_bytes - SAMPLES.size
        self._size = room // (2 * self._axes.bit_count())
        self._first = 0
        self._counts: NDArray[np.int16] = np.empty((0, self._axes.bit_count()), np.int16)

    def blocks(self, until_s: float, tick: Callable[[float], int]) -> Iterator[_Outgoing]:
        """Yield the full frames up to `until_s`; each is sent when its last sample has been taken."""
        rate = self._wheel.plan.sample_rate_hz
        samples = self._wheel.advance(until_s)
        counts = np.concatenate([self._counts, samples.counts])
        full = len(counts) // self._size * self._size
        for offset in range(0, full, self._size):
            first = self._first + offset
            block = SampleBlock(first & _MASK, self._axes, counts[offset : offset + self._size])
            ready_s = (first + self._size - 1) / rate
            yield _Outgoing(ready_s, self._wheel.plan.wheel, tick(first / rate), MessageType.SAMPLES, block)
        self._first += full
        self._counts = counts[full:]


def _times(begin_s: float, end_s: float, period_s: float) -> Iterator[float]:
    """Yield the multiples of a period in [begin, end)."""
    number = math.ceil(begin_s / period_s)
    while number * period_s < end_s:
        yield number * period_s
        number += 1
