"""Sensors of plugged hubs, and which of them is tapped or turned."""

import math
from collections import deque
from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np

from firmware_protocol.decoder import FrameDecoder
from firmware_protocol.messages import HUB_ITSELF, Axis, Environment, Frame, Hello, SampleBlock
from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.links.source import Chunk
from gateway.core.types import FloatArray

# Samples are looked at in windows of this length: long enough that noise averages out of gravity, short for a tap.
_WINDOW_S: Final = 0.1
# Windows at rest that tell how much a sensor scatters by itself.
REST_WINDOWS: Final = 10
_MAX_WINDOWS: Final = 6000
# A tap is a peak of several times the noise, and more than a step beside the car.
_TAP_RATIO: Final = 4.0
_TAP_MPS2: Final = 5.0
# Less is noise of a window's mean, or the creeping of a wheel that has stopped.
_STEADY_MPS2: Final = 0.1 * STANDARD_GRAVITY_MPS2
# A turn by 30 degrees moves gravity by half of it in one of two axes.
_TURN_MPS2: Final = 0.5 * STANDARD_GRAVITY_MPS2
# Time without samples after which a sensor is out of reach, asleep, or has no hello; nothing waits for it.
_SILENT_NS: Final = 5_000_000_000


class SensorAddress(NamedTuple):
    """Where a sensor is heard."""

    link: str
    hub: int
    wheel: int


class Window(NamedTuple):
    """Samples of a tenth of a second.

    Attributes:
        mean_mps2: (3,) mean of each axis, NaN of absent ones.
        span_mps2: largest peak to peak value of an axis.
        duration_s: exact length.
    """

    mean_mps2: FloatArray
    span_mps2: float
    duration_s: float = 0.0


@dataclass(slots=True)
class HeardSensor:
    """A sensor and what it has sent.

    Attributes:
        address: link, hub and wheel number.
        hello: its identity and format, None before one.
        pressure_pa: last reported, None without one.
        windows: the latest.
        window_count: number of all of them.
        heard_ns: when the latest ended, ns of the host's clock.
    """

    address: SensorAddress
    hello: Hello | None = None
    pressure_pa: float | None = None
    windows: deque[Window] = field(default_factory=lambda: deque(maxlen=_MAX_WINDOWS))
    window_count: int = 0
    heard_ns: int = 0
    _blocks: list[FloatArray] = field(default_factory=list)
    _rest: Window | None = None

    @property
    def sensor_id(self) -> str:
        """Serial number in hexadecimal digits, empty before a hello."""
        return "" if self.hello is None else f"{self.hello.sensor_id:08x}"

    def take(self, message: SampleBlock, host_ns: int) -> None:
        """Take samples that arrived at a time; without a hello they have no unit."""
        hello = self.hello
        if hello is None:
            return
        axes = [axis for axis in Axis if message.axes >> axis & 1]
        counts = np.asarray(message.counts, np.float64).reshape(-1, len(axes))
        block = np.full((len(counts), len(Axis)), np.nan)
        for column, axis in enumerate(axes):
            block[:, axis] = (counts[:, column] - hello.offset_counts[axis]) * hello.scale_mps2[axis]
        self._blocks.append(block)
        if sum(map(len, self._blocks)) >= _WINDOW_S * hello.rate_hz:
            samples = np.concatenate(self._blocks)
            self._blocks.clear()
            span = np.nanmax(np.ptp(samples, axis=0)) if axes else math.nan
            self.window_count += 1
            self.heard_ns = host_ns
            self.windows.append(Window(samples.mean(axis=0), float(span), len(samples) / hello.rate_hz))

    def begin_rest(self) -> None:
        """Forget what was sent; the next windows tell how the sensor is at rest."""
        self.windows.clear()
        self._blocks.clear()
        self._rest = None

    @property
    def is_rest_known(self) -> bool:
        """Whether the sensor was at rest for long enough."""
        if self._rest is None and len(self.windows) >= REST_WINDOWS:
            latest = list(self.windows)[-REST_WINDOWS:]
            means = np.array([window.mean_mps2 for window in latest])
            spans = [window.span_mps2 for window in latest]
            rest_window = Window(np.median(means, axis=0), float(np.median(spans)))
            if not any(_is_moved(window, rest_window) for window in latest):
                self._rest = rest_window
                # A roll begins here, at rest.
                self.windows = deque(latest, maxlen=_MAX_WINDOWS)
        return self._rest is not None

    @property
    def is_turning(self) -> bool:
        """Whether gravity has moved within the last second."""
        latest = list(self.windows)[-REST_WINDOWS:]
        return any(_is_turned(window, latest[-1]) for window in latest)

    @property
    def is_moved(self) -> bool:
        """Whether one of the latest three windows differs from rest as a tap or a turn does."""
        return self._rest is not None and any(_is_moved(window, self._rest) for window in list(self.windows)[-3:])


def _is_turned(window: Window, previous: Window) -> bool:
    change = np.abs(window.mean_mps2 - previous.mean_mps2)
    return bool(np.nanmax(change, initial=0.0) > _STEADY_MPS2)


def _is_moved(window: Window, rest_window: Window) -> bool:
    tapped = window.span_mps2 > max(_TAP_RATIO * rest_window.span_mps2, _TAP_MPS2)
    change = np.abs(window.mean_mps2 - rest_window.mean_mps2)
    return tapped or bool(np.nanmax(change, initial=0.0) > _TURN_MPS2)


class SensorListener:
    """Sensors heard on any number of links.

    Attributes:
        sensors: by address, in the order in which they were heard.
    """

    def __init__(self) -> None:
        """Start without a sensor."""
        self.sensors: dict[SensorAddress, HeardSensor] = {}
        self._decoders: dict[str, FrameDecoder] = {}

    def take(self, chunk: Chunk) -> None:
        """Take bytes of a link."""
        decoder = self._decoders.setdefault(chunk.link, FrameDecoder())
        for frame in decoder.feed(chunk.data):
            if frame.wheel != HUB_ITSELF:
                self._frame(chunk, frame)

    def _frame(self, chunk: Chunk, frame: Frame) -> None:
        address = SensorAddress(chunk.link, frame.hub, frame.wheel)
        sensor = self.sensors.setdefault(address, HeardSensor(address))
        message = frame.message
        if isinstance(message, Hello):
            sensor.hello = message
        elif isinstance(message, Environment):
            sensor.pressure_pa = message.pressure_pa if message.pressure_pa is not None else sensor.pressure_pa
        elif isinstance(message, SampleBlock):
            sensor.take(message, chunk.host_ns)

    def begin_rest(self) -> None:
        """Measure every sensor at rest again."""
        for sensor in self.sensors.values():
            sensor.begin_rest()

    @property
    def sending(self) -> list[HeardSensor]:
        """The sensors whose samples arrive."""
        sensors = self.sensors.values()
        newest_ns = max((sensor.heard_ns for sensor in sensors), default=0)
        return [sensor for sensor in sensors if newest_ns - sensor.heard_ns <= _SILENT_NS]

    @property
    def is_rest_known(self) -> bool:
        """Whether all sensors that send were at rest for long enough."""
        return all(sensor.is_rest_known for sensor in self.sending)

    def moved(self) -> list[HeardSensor]:
        """Return the sensors that are tapped or turned now."""
        return [sensor for sensor in self.sensors.values() if sensor.is_moved]
