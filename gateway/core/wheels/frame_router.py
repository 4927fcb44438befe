"""Routing of frames to wheels: admission, names, and the clocks of hubs."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING, Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from firmware_protocol.messages import HUB_ITSELF, Environment, Hello, Message
from firmware_protocol.sequence import unwrap
from firmware_protocol.wheel_limit import WheelLimit
from gateway.core.wheels.timebase import HostClock

if TYPE_CHECKING:
    from firmware_protocol.block_decoder import FrameBatch, SampleGroup


class Hub:
    """Clock of a hub: unwraps its 32-bit ticks and maps them to host time.

    Attributes:
        boot_count: of its last hello, None before one.
        last_us: newest hub time, None before the first frame since its start.
        host: clock of the host.
    """

    def __init__(self) -> None:
        """Begin before the first frame."""
        self.boot_count: int | None = None
        self.last_us: int | None = None
        self.host = HostClock()
        # Hub times of frames whose arrival the host's clock does not know yet.
        self._arrived_us: list[int] = []

    def restart(self) -> None:
        """Forget the clock before a start."""
        self.last_us = None
        self.host = HostClock()

    def unwrap(self, tick_us: int) -> int:
        """Return the hub time of the next frame, without wraps."""
        self.last_us = tick_us if self.last_us is None else unwrap(self.last_us, tick_us)
        return self.last_us

    def arrived(self, tick_us: int) -> int:
        """Return the hub time of the next frame, without wraps; the host's clock learns of it by `stamp_arrivals`."""
        unwrapped = self.unwrap(tick_us)
        self._arrived_us.append(unwrapped)
        return unwrapped

    def stamp_arrivals(self, host_ns: int) -> None:
        """Let the host's clock know that the frames since the last call arrived together at `host_ns`."""
        if self._arrived_us:
            self.host.stamp_arrival(self._arrived_us, host_ns)
            self._arrived_us.clear()

    def stamp_all(self, ticks_us: NDArray[np.uint32], hosts_ns: NDArray[np.int64] | None) -> NDArray[np.int64]:
        """Take the ticks and any arrivals of frames, (n,) each, n > 0; return their hub times without wraps."""
        first = self.unwrap(int(ticks_us[0]))
        steps = np.diff(ticks_us).astype(np.int32).astype(np.int64)
        unwrapped = first + np.concatenate(([0], np.cumsum(steps)))
        if hosts_ns is not None:
            self.host.stamp_all(unwrapped, hosts_ns)
        self.last_us = int(unwrapped[-1])
        return unwrapped


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
        self.limit = WheelLimit(configured)
        self.wheels: dict[tuple[str, int, int], WheelT | None] = {}
        self._configured = configured
        self._owners: dict[tuple[int, int], str] = {}
        self._make = make
        self._hubs: dict[tuple[str, int], Hub] = {}

    def batch(self, link: str, batch: FrameBatch, host_ns: NDArray[np.int64] | None) -> None:
        """Take a block of decoded frames that arrived on `link` at `host_ns`, (frames,), None where that is unknown."""
        for stretch in batch.stretches(partial(self.limit.admits, link)):
            if stretch.parts:
                ticks_us = self._stamp(link, batch, stretch.frames, stretch.is_used, host_ns)
                for group, part in stretch.parts:
                    self._group(link, group, part, ticks_us[group.frame_index[part] - stretch.frames.start])
            if (other := stretch.other) is not None:
                hub, number, message = int(batch.hub[other]), int(batch.wheel[other]), batch.message(other)
                arrived_ns = int(host_ns[other]) if host_ns is not None else None
                self.slow(link, hub, number, int(batch.tick_us[other]), message, arrived_ns)

    def slow(self, link: str, hub_number: int, number: int, tick: int, message: Message, host_ns: int | None) -> None:
        """Take a frame without samples of an admitted source; `host_ns` is None without arrival."""
        hub = self.hub(link, hub_number)
        if isinstance(message, Hello):
            if hub.boot_count is not None and hub.boot_count != message.boot_count:
                for (of_link, of_hub, _), wheel in self.wheels.items():
                    if (of_link, of_hub) == (link, hub_number) and wheel is not None:
                        wheel.restart()
                hub.restart()
            hub.boot_count = message.boot_count
        tick_us = hub.unwrap(tick)
        if host_ns is not None:
            hub.host.stamp(tick_us, host_ns)
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
        return ((number, hub) for (of_link, number), hub in self._hubs.items() if of_link == link)

    def stamp_arrivals(self, link: str, host_ns: int) -> None:
        """Let the clocks of a link's hubs know that the frames since the last call arrived together at `host_ns`."""
        for (of_link, _), hub in self._hubs.items():
            if of_link == link:
                hub.stamp_arrivals(host_ns)

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

    def _stamp(
        self,
        link: str,
        batch: FrameBatch,
        part: slice,
        is_used: NDArray[np.bool_],
        host_ns: NDArray[np.int64] | None,
    ) -> NDArray[np.int64]:
        """Unwrap the hub time of a run of sample frames and update the hubs' clocks; unused frames change nothing."""
        hubs = np.asarray(batch.hub[part])
        ticks = np.asarray(batch.tick_us[part]).astype(np.uint32)
        unwrapped = np.empty(len(ticks), np.int64)
        for number in np.unique(hubs[is_used]).tolist():
            frames = np.flatnonzero((hubs == number) & is_used)
            arrivals_ns = host_ns[part][frames] if host_ns is not None else None
            unwrapped[frames] = self.hub(link, number).stamp_all(ticks[frames], arrivals_ns)
        return unwrapped

    def _group(self, link: str, group: SampleGroup, part: slice, ticks_us: NDArray[np.int64]) -> None:
        wheel = self.wheel(link, group.hub, group.wheel)
        if wheel is None:
            return
        host = self.hub(link, group.hub).host
        first, counts = np.asarray(group.first_sample[part]).astype(np.uint32), group.counts[part]
        breaks = np.flatnonzero(np.diff(first) != counts.shape[1]) + 1
        for lo, hi in pairwise([0, *breaks.tolist(), len(first)]):
            run = counts[lo:hi].reshape(-1, counts.shape[2])
            wheel.add(int(first[lo]), ticks_us[lo:hi].tolist(), group.axes, run, host)
