"""Routing of frames to wheels: admission, names, and the clocks of hubs."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import Final, Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from firmware_protocol.frame_blocks import FrameBlock, SampleRun, Stretch
from firmware_protocol.messages import HUB_ITSELF, Environment, Frame, Hello
from firmware_protocol.sequence import unwrap
from firmware_protocol.wheel_limit import WheelLimit
from gateway.core.wheels.timebase import HostClock

# A quarter of the time in which ticks wrap.
_LONG_SILENCE_NS: Final = 1000 << 30
# By which frames may arrive earlier or later after a silence.
_ARRIVAL_ERROR_US: Final = 30_000_000


class Hub:
    """Clock of a hub: unwraps its 32-bit ticks and maps them to host time.

    Attributes:
        start: serial number and boot count of its last hello, None before one.
        last_us: newest hub time, None before the first frame since its start.
        host: clock of the host.
    """

    def __init__(self) -> None:
        """Begin before the first frame."""
        self.start: tuple[int, int] | None = None
        self.last_us: int | None = None
        self.host = HostClock()

    def restart(self) -> None:
        """Forget the clock before a start."""
        self.last_us = None
        self.host = HostClock()

    def stamp(self, tick_us: int, host_ns: int | None) -> int:
        """Take the tick and any arrival of the next frame; return its hub time without wraps."""
        # Ticks may have wrapped in a silence.
        silence_us = self.host.silence_us(host_ns) if host_ns is not None else 0
        last_us = self.last_us if self.last_us is not None else tick_us
        self.last_us = unwrap(last_us + silence_us, tick_us)
        # Arrivals whose clock was set are no silence.
        if abs(self.last_us - last_us - silence_us) > _ARRIVAL_ERROR_US + 1e-3 * silence_us:
            self.last_us = unwrap(last_us, tick_us)
        if host_ns is not None:
            self.host.stamp(self.last_us, host_ns)
        return self.last_us

    def stamp_all(self, ticks_us: NDArray[np.uint32], hosts_ns: NDArray[np.int64] | None) -> NDArray[np.int64]:
        """Take the ticks and any arrivals of frames, (n,) each, n > 0; return their hub times without wraps."""
        if hosts_ns is not None and hosts_ns[-1] - hosts_ns[0] > _LONG_SILENCE_NS:
            return np.array([self.stamp(*both) for both in zip(ticks_us.tolist(), hosts_ns.tolist(), strict=True)])
        first_ns = int(hosts_ns[0]) if hosts_ns is not None else None
        unwrapped = np.full(len(ticks_us), self.stamp(int(ticks_us[0]), first_ns))
        unwrapped[1:] += np.cumsum((ticks_us[1:] - ticks_us[:-1]).view(np.int32), dtype=np.int64)
        if hosts_ns is not None:
            self.host.stamp_all(unwrapped, hosts_ns)
        self.last_us = int(unwrapped[-1])
        return unwrapped


class StreamWatcher(Protocol):
    """What else takes the frames of all admitted sources, each before its wheel does."""

    def samples(self, link: str, run: SampleRun) -> None:
        """Take samples."""
        ...

    def message(self, link: str, frame: Frame) -> None:
        """Take a frame without samples."""
        ...


class RoutedWheel(Protocol):
    """A wheel that takes what its sensor sends."""

    def hello(self, hello: Hello) -> None:
        """Take the description of the sensor."""
        ...

    def environment(self, tick_us: int, environment: Environment) -> None:
        """Take pressure and temperature at a hub time."""
        ...

    def restart(self) -> None:
        """Take a restart of the hub."""
        ...

    def add(
        self, first_sample: int, ticks_us: Sequence[int], axes: int, counts: NDArray[np.int16], host: HostClock
    ) -> None:
        """Take consecutive samples, with the hub times of the first of each of their equally long blocks."""
        ...


WheelT = TypeVar("WheelT", bound=RoutedWheel)


class FrameRouter(Generic[WheelT]):
    """Takes frames of any number of links to their wheels.

    Attributes:
        limit: admission of wheels; frames of others are not used.
        wheels: by link, hub and number, in the order of their first frames; None for one that is of no interest.
    """

    def __init__(
        self, configured: Mapping[tuple[int, int], str], make: Callable[[str, int, int, Hub], WheelT | None]
    ) -> None:
        """Start without frames.

        Args:
            configured: positions of the configured wheels, by hub and number.
            make: returns the wheel of a position, a hub number, a wheel number and the clock of the hub.
        """
        self._watchers: list[StreamWatcher] = []
        self.limit = WheelLimit(configured)
        self.wheels: dict[tuple[str, int, int], WheelT | None] = {}
        self._configured = configured
        self._owners: dict[tuple[int, int], str] = {}
        self._make = make
        self._hubs: dict[tuple[str, int], Hub] = {}

    def attach(self, watcher: StreamWatcher) -> None:
        """Let a watcher take the frames that come."""
        self._watchers.append(watcher)

    def take(self, link: str, block: FrameBlock, hosts_ns: NDArray[np.int64] | None) -> None:
        """Take frames of `link` that arrived at `hosts_ns`, (frames,), None where that is unknown."""
        for stretch in block.stretches(partial(self.limit.admits, link)):
            for watcher in self._watchers:
                for run in stretch.runs:
                    watcher.samples(link, run)
            if stretch.runs:
                self._samples(link, block, stretch, hosts_ns)
            if stretch.last is not None:
                index, frame = stretch.last
                for watcher in self._watchers:
                    watcher.message(link, frame)
                self._take_message(link, frame, int(hosts_ns[index]) if hosts_ns is not None else None)

    def _take_message(self, link: str, frame: Frame, host_ns: int | None) -> None:
        """Take a frame without samples of an admitted source; `host_ns` is None without arrival."""
        _, hub_number, number, _, tick, message = frame
        hub = self.hub(link, hub_number)
        if isinstance(message, Hello):
            start = message.hub_id, message.boot_count
            if hub.start not in (None, start):
                for (wheel_link, wheel_hub, _), wheel in self.wheels.items():
                    if (wheel_link, wheel_hub) == (link, hub_number) and wheel is not None:
                        wheel.restart()
                hub.restart()
            hub.start = start
        tick_us = hub.stamp(tick, host_ns)
        if (
            isinstance(message, Hello | Environment)
            and (source_wheel := self.wheel(link, hub_number, number)) is not None
        ):
            if isinstance(message, Hello):
                source_wheel.hello(message)
            else:
                source_wheel.environment(tick_us, message)

    def hub(self, link: str, number: int) -> Hub:
        """Return a hub, new if need be."""
        hub = self._hubs.get((link, number))
        if hub is None:
            hub = self._hubs[link, number] = Hub()
        return hub

    def hubs(self, link: str) -> Iterator[tuple[int, Hub]]:
        """Yield the hubs of a link by number."""
        return ((number, hub) for (hub_link, number), hub in self._hubs.items() if hub_link == link)

    def wheel(self, link: str, hub: int, number: int) -> WheelT | None:
        """Return an admitted wheel, new if need be; None for the hub itself, and for one that is of no interest."""
        if number == HUB_ITSELF:
            return None
        key = link, hub, number
        if key not in self.wheels:
            # A configured wheel has its position on the first link that has it.
            owner = self._owners.setdefault((hub, number), link)
            configured = self._configured.get((hub, number)) if owner == link else None
            position = configured or f"hub{hub}.wheel{number}" + ("" if owner == link else f" on {link}")
            self.wheels[key] = self._make(position, hub, number, self.hub(link, hub))
        return self.wheels[key]

    def _samples(self, link: str, block: FrameBlock, stretch: Stretch, hosts_ns: NDArray[np.int64] | None) -> None:
        """Unwrap the hub times of samples, update the clocks of their hubs, and add them to their wheels."""
        begin, ticks_us = stretch.begin, block.tick_us
        unwrapped_us = np.empty(stretch.end - begin, np.int64)
        for number, places in stretch.hubs:
            arrivals_ns = hosts_ns[places] if hosts_ns is not None else None
            unwrapped_us[np.subtract(places, begin)] = self.hub(link, number).stamp_all(ticks_us[places], arrivals_ns)
        for run in stretch.runs:
            if (wheel := self.wheel(link, run.hub, run.wheel)) is not None:
                run_us = unwrapped_us[np.subtract(run.places, begin)].tolist()
                wheel.add(run.first_sample, run_us, run.axes, run.counts, self.hub(link, run.hub).host)
