"""The whole pipeline, from frames of any number of links to results of any number of wheels.

Synchronous and deterministic: no clock, no I/O. The results do not depend on the chunks in which frames arrive.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from operator import itemgetter
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from firmware_protocol.messages import HUB_ITSELF, Environment, Frame, Hello, MessageType, SampleBlock
from firmware_protocol.sequence import unwrap
from firmware_protocol.wheel_limit import WheelLimit
from gateway.estimators.registry import DEFAULT_ESTIMATORS
from gateway.pipeline.results import RevolutionResult, WheelSnapshot
from gateway.pipeline.timebase import HostClock
from gateway.pipeline.wheel_pipeline import WheelPipeline
from gateway.pipeline.wheel_setup import WheelSetup
from gateway.types import FloatArray

if TYPE_CHECKING:
    from firmware_protocol.block_decoder import FrameBatch, SampleGroup

# Sample numbers have 32 bits.
_SAMPLE_NUMBERS: Final = 1 << 32
# Share of the longest wait of revolutions for which samples wait for the next ones, and the most blocks that wait.
_GATHERED_SHARE: Final = 0.1
_MOST_BLOCKS: Final = 64


class _Hub:
    """Clock of a hub: unwraps its 32-bit ticks and maps them to host time."""

    def __init__(self) -> None:
        self.boot_count: int | None = None
        self.last_us: int | None = None
        self.host = HostClock()

    def restart(self) -> None:
        self.last_us = None
        self.host = HostClock()

    def unwrap(self, tick_us: int) -> int:
        self.last_us = tick_us if self.last_us is None else unwrap(self.last_us, tick_us)
        return self.last_us


class _Run:
    """Sample blocks of one wheel that follow each other without a gap: one addition takes less than several."""

    __slots__ = ("_axes", "_block", "_first", "_host", "_next", "_parts", "_ticks_us")

    def __init__(self, message: SampleBlock, tick_us: int, host: HostClock) -> None:
        """Start with a block and the hub time of its first sample."""
        self._first, self._axes, self._block = message.first_sample, message.axes, len(message.counts)
        self._next = (self._first + self._block) % _SAMPLE_NUMBERS
        self._host = host
        self._ticks_us = [tick_us]
        self._parts: list[NDArray[np.int16]] = [message.counts]

    def goes_on(self, message: SampleBlock, tick_us: int) -> bool:
        """Append a block, with the hub time of its first sample, if it follows the last one and is like it."""
        first_sample, axes, counts = message
        if first_sample != self._next or axes != self._axes or len(counts) != self._block:
            return False
        self._ticks_us.append(tick_us)
        self._parts.append(counts)
        self._next = (first_sample + self._block) % _SAMPLE_NUMBERS
        return True

    def is_long(self, longest_us: float) -> bool:
        """Return whether the samples have waited long enough; by their number too: the hub's time may stand still."""
        ticks_us = self._ticks_us
        return ticks_us[-1] - ticks_us[0] >= longest_us or len(ticks_us) >= _MOST_BLOCKS

    def add_to(self, wheel: WheelPipeline) -> None:
        """Add the samples to the wheel."""
        counts = self._parts[0] if len(self._parts) == 1 else np.concatenate(self._parts)
        wheel.add(self._first, self._ticks_us, self._axes, counts, self._host)


class _Source:
    """Hub and wheel from which samples come.

    Attributes:
        hub: the hub.
        wheel: None for the hub itself.
        ticks_us: hub times of the present frames.
        run: samples that have not been added to the wheel yet, None without any.
    """

    __slots__ = ("hub", "run", "ticks_us", "wheel")

    def __init__(self, hub: _Hub, wheel: WheelPipeline | None) -> None:
        self.hub, self.wheel = hub, wheel
        self.ticks_us: list[int] = []
        self.run: _Run | None = None

    def take(self, message: SampleBlock, tick_us: int) -> None:
        """Take a block, with the hub time of its first sample."""
        self.ticks_us.append(tick_us)
        if self.wheel is not None and not (self.run is not None and self.run.goes_on(message, tick_us)):
            self.add_run()
            self.run = _Run(message, tick_us, self.hub.host)

    def add_run(self) -> None:
        """Add the samples that wait to the wheel."""
        if self.run is not None and self.wheel is not None:
            self.run.add_to(self.wheel)
            self.run = None

    def stamp_arrival(self, host_ns: int) -> None:
        """Let the hub's clock know the present frames, which arrived together at `host_ns`, and forget them."""
        if self.ticks_us:
            self.hub.host.stamp_arrival(self.ticks_us, host_ns)
            self.ticks_us.clear()


class Pipeline:
    """Routes frames to wheels by link, hub and wheel number.

    Attributes:
        limit: admission of wheels; frames of others are not used.
    """

    def __init__(
        self,
        setups: Sequence[WheelSetup],
        unknown: WheelSetup,
        estimators: Sequence[str] = DEFAULT_ESTIMATORS,
        hold_s: float = 0.0,
    ) -> None:
        """Make a wheel for every setup; other wheels are added with their first frame.

        Args:
            setups: configured wheels.
            unknown: template for wheels that are not configured; position, hub and wheel number are filled in.
            estimators: names from the registry, in the order of their output.
            hold_s: longest time by which `frames` may return a revolution later, together with the next ones: work on
                several at once takes less than on one at a time. By the hub's samples and clock, so that the results
                do not depend on when frames arrive.

        Raises:
            ConfigError: unknown estimator.
        """
        self._estimators = tuple(estimators)
        self._hold_s = hold_s
        self._unknown = unknown
        self._setups = {(setup.hub, setup.wheel): setup for setup in setups}
        self._wheel_hold_s = (1.0 - _GATHERED_SHARE) * hold_s
        self._order = [WheelPipeline(setup, self._estimators, self._wheel_hold_s) for setup in setups]
        self._configured = {(w.setup.hub, w.setup.wheel): w for w in self._order}
        self._claimed: dict[tuple[int, int], str] = {}
        self._wheels: dict[tuple[str, int, int], WheelPipeline] = {}
        self._hubs: dict[tuple[str, int], _Hub] = {}
        self.limit = WheelLimit(self._setups)
        # Sources of samples of each link, those that were admitted.
        self._sources: dict[str, dict[tuple[int, int], _Source]] = {}

    def frames(self, link: str, frames: Iterable[Frame], host_ns: int) -> list[RevolutionResult]:
        """Take decoded frames that arrived on `link` at `host_ns`; return the revolutions that are complete and due."""
        newest: tuple[_Hub, int] | None = None
        sources = self._sources.setdefault(link, {})
        for frame in frames:
            _, hub_number, number, _, tick, message = frame
            if not isinstance(message, SampleBlock):
                # It takes effect between the samples before and behind it.
                for source in sources.values():
                    source.add_run()
                    source.stamp_arrival(host_ns)
                stamped = self._stamped(link, frame, host_ns)
                if stamped is not None:
                    newest = stamped
                    self._slow(link, frame, stamped[1])
                continue
            found = sources.get((hub_number, number)) or self._source(link, hub_number, number)
            if found is not None:
                tick_us = found.hub.unwrap(tick)
                found.take(message, tick_us)
                newest = found.hub, tick_us
        longest_us = _GATHERED_SHARE * self._hold_s * 1e6
        is_due = False
        for source in sources.values():
            source.stamp_arrival(host_ns)
            is_due = is_due or (source.run is not None and source.run.is_long(longest_us))
        if newest is not None:
            newest[0].host.measure_latency(newest[1], host_ns)
        if is_due:
            self._add_runs(link)
        return [result for wheel in self._due() for result in wheel.complete()]

    def _due(self) -> list[WheelPipeline]:
        """Return the wheel whose results have been due for longest, and all that have been for another `hold_s`.

        One wheel at a time keeps the work on a chunk short.
        """
        overdue = [
            (wheel, late_s)
            for (link, hub, _), wheel in self._wheels.items()
            if (late_s := wheel.overdue_s(self._hubs[link, hub].last_us)) >= 0.0
        ]
        if not overdue:
            return []
        latest_s = max(late_s for _, late_s in overdue)
        first = next(wheel for wheel, late_s in overdue if late_s == latest_s)
        return [wheel for wheel, late_s in overdue if wheel is first or late_s >= self._hold_s]

    def complete(self, link: str) -> list[RevolutionResult]:
        """Return the revolutions of a link that wait for the next ones, as when it falls silent."""
        self._add_runs(link)
        return [
            result for (of_link, _, _), wheel in self._wheels.items() if of_link == link for result in wheel.complete()
        ]

    def _add_runs(self, link: str) -> None:
        """Add the samples of a link that wait to their wheels."""
        for source in self._sources.get(link, {}).values():
            source.add_run()

    def _source(self, link: str, hub: int, wheel: int) -> _Source | None:
        """Return a new source of samples; None if not admitted."""
        if not self.limit.admits(link, hub, wheel):
            return None
        source = self._sources[link][hub, wheel] = _Source(self._known_hub(link, hub), self._wheel(link, hub, wheel))
        return source

    def _slow_frame(self, link: str, frame: Frame, host_ns: int) -> None:
        """Take a frame without samples."""
        stamped = self._stamped(link, frame, host_ns)
        if stamped is not None:
            hub, tick_us = stamped
            self._slow(link, frame, tick_us)
            hub.host.measure_latency(tick_us, host_ns)

    def _stamped(self, link: str, frame: Frame, host_ns: int) -> tuple[_Hub, int] | None:
        """Return the hub of a frame and the hub time, unwrapped, once the clocks know them; None if not admitted."""
        if not self.limit.admits(link, frame.hub, frame.wheel):
            return None
        hub = self._hub(link, frame)
        tick_us = hub.unwrap(frame.tick_us)
        hub.host.stamp(tick_us, host_ns)
        return hub, tick_us

    def _completed(self) -> list[RevolutionResult]:
        """Return the revolutions that were completed since the last call, wheel by wheel."""
        return [result for wheel in self._wheels.values() for result in wheel.complete()]

    def batch(self, link: str, batch: FrameBatch, host_ns: NDArray[np.int64]) -> list[RevolutionResult]:
        """Take a block of decoded frames of a dump; the results are those of `frames`, wheel by wheel.

        Args:
            link: link on which they arrived.
            batch: the block.
            host_ns: (frames,) arrival time of each.
        """
        groups = _Groups(batch, lambda hub, wheel: self.limit.admits(link, hub, wheel))
        slow = np.flatnonzero(batch.type != MessageType.SAMPLES).tolist()
        begin = 0
        # Split at every slow frame, so that a hello or a pressure takes effect exactly where it does live. In between,
        # wheels are independent, and each wheel's blocks are processed at once.
        for stop in (*slow, len(batch.type)):
            if stop > begin:
                ticks_us = self._stamp(link, batch, slice(begin, stop), groups.is_used[begin:stop], host_ns)
                for group, part in groups.in_stream_order(begin, stop):
                    own_ticks_us = ticks_us[group.frame_index[part] - begin]
                    self._group(link, group, part, own_ticks_us)
            if stop < len(batch.type):
                frame = Frame(
                    int(batch.type[stop]),
                    int(batch.hub[stop]),
                    int(batch.wheel[stop]),
                    int(batch.seq[stop]),
                    int(batch.tick_us[stop]),
                    batch.message(stop),
                )
                self._slow_frame(link, frame, int(host_ns[stop]))
            begin = stop + 1
        return self._completed()

    def _stamp(
        self, link: str, batch: FrameBatch, part: slice, is_used: NDArray[np.bool_], host_ns: NDArray[np.int64]
    ) -> NDArray[np.int64]:
        """Unwrap the hub time of a run of sample frames and update the hubs' clocks; unused frames change nothing."""
        hubs = np.asarray(batch.hub[part])
        ticks = np.asarray(batch.tick_us[part])
        arrivals = host_ns[part]
        unwrapped = np.empty(len(ticks), np.int64)
        for number in np.unique(hubs[is_used]).tolist():
            own = np.flatnonzero((hubs == number) & is_used)
            hub = self._known_hub(link, number)
            first = hub.unwrap(int(ticks[own[0]]))
            steps = np.diff(ticks[own].astype(np.uint32)).astype(np.int32).astype(np.int64)
            unwrapped[own] = first + np.concatenate(([0], np.cumsum(steps)))
            hub.host.stamp_all(unwrapped[own], arrivals[own])
            hub.last_us = int(unwrapped[own[-1]])
        return unwrapped

    def _group(self, link: str, group: SampleGroup, part: slice, ticks_us: NDArray[np.int64]) -> None:
        wheel = self._wheel(link, group.hub, group.wheel)
        if wheel is None:
            return
        host = self._hubs[(link, group.hub)].host
        first = np.asarray(group.first_sample[part]).astype(np.uint32)
        counts = group.counts[part]
        block = counts.shape[1]
        breaks = np.flatnonzero(np.diff(first) != block) + 1
        edges = [0, *breaks.tolist(), len(first)]
        for lo, hi in pairwise(edges):
            run = counts[lo:hi].reshape(-1, counts.shape[2])
            wheel.add(int(first[lo]), ticks_us[lo:hi].tolist(), group.axes, run, host)

    def _hub(self, link: str, frame: Frame) -> _Hub:
        hub = self._known_hub(link, frame.hub)
        if isinstance(frame.message, Hello):
            if hub.boot_count is not None and hub.boot_count != frame.message.boot_count:
                hub.restart()
                for (of_link, of_hub, _), wheel in self._wheels.items():
                    if (of_link, of_hub) == (link, frame.hub):
                        wheel.restart()
            hub.boot_count = frame.message.boot_count
        return hub

    def _known_hub(self, link: str, number: int) -> _Hub:
        hub = self._hubs.get((link, number))
        if hub is None:
            hub = self._hubs[(link, number)] = _Hub()
        return hub

    def _slow(self, link: str, frame: Frame, tick_us: int) -> None:
        if isinstance(frame.message, Hello | Environment):
            wheel = self._wheel(link, frame.hub, frame.wheel)
            if wheel is not None and isinstance(frame.message, Hello):
                wheel.hello(frame.message)
            elif wheel is not None and isinstance(frame.message, Environment):
                wheel.environment(tick_us, frame.message)

    def _wheel(self, link: str, hub: int, number: int) -> WheelPipeline | None:
        """Return an admitted wheel, new if need be; None for the hub itself, which has no sensor."""
        if number == HUB_ITSELF:
            return None
        key = (link, hub, number)
        wheel = self._wheels.get(key)
        if wheel is None:
            owner = self._claimed.setdefault((hub, number), link)
            configured = self._configured.get((hub, number)) if owner == link else None
            if configured is None:
                name = f"hub{hub}.wheel{number}" + ("" if owner == link else f" on {link}")
                configured = WheelPipeline(
                    replace(self._unknown, position=name, hub=hub, wheel=number), self._estimators, self._wheel_hold_s
                )
                self._order.append(configured)
            wheel = self._wheels[key] = configured
        return wheel

    def finish(self) -> list[RevolutionResult]:
        """Complete the revolutions that can be completed, when no more frames will come."""
        for of_link in self._sources:
            self._add_runs(of_link)
        results: list[RevolutionResult] = []
        for (link, hub, _), wheel in self._wheels.items():
            results += wheel.finish(self._hubs[(link, hub)].host)
        return results

    def wheels(self) -> tuple[WheelSnapshot, ...]:
        """Return the latest state of every wheel, configured ones first."""
        return tuple(wheel.snapshot() for wheel in self._order)

    def position(self, link: str, hub: int, wheel: int) -> str:
        """Return the position that names a wheel in results."""
        known = self._wheels.get((link, hub, wheel))
        if known is not None:
            return known.setup.position
        setup = self._setups.get((hub, wheel))
        return setup.position if setup is not None else f"hub{hub}.wheel{wheel}"

    def average_mps2(self, position: str) -> FloatArray | None:
        """Return the running average of a wheel's radial axis, None before its first revolution."""
        return next((wheel.average_mps2 for wheel in self._order if wheel.setup.position == position), None)

    def latency_s(self, link: str, hubs: Container[int]) -> float | None:
        """Return the delay of the newest frame of these hubs relative to the fastest, None before the first frame."""
        known = [hub.host.latency_s for (of, number), hub in self._hubs.items() if of == link and number in hubs]
        return max((value for value in known if value is not None), default=None)


class _Groups:
    """Sample blocks of a batch by wheel and shape, found by their place in the stream."""

    def __init__(self, batch: FrameBatch, admits: Callable[[int, int], bool]) -> None:
        # Places are taken in the order of the stream, as live.
        used = {(hub, wheel) for hub, wheel, _ in batch.by_source() if admits(hub, wheel)}
        self._groups = [group for group in batch.sample_groups() if (group.hub, group.wheel) in used]
        # Group of each frame of the batch, -1 where its samples are not used, and its place in the group.
        self._of: NDArray[np.int64] = np.full(len(batch), -1)
        self._place: NDArray[np.int64] = np.zeros(len(batch), np.int64)
        for number, group in enumerate(self._groups):
            self._of[group.frame_index] = number
            self._place[group.frame_index] = np.arange(len(group.frame_index))
        self.is_used: NDArray[np.bool_] = self._of >= 0

    def in_stream_order(self, begin: int, stop: int) -> Iterator[tuple[SampleGroup, slice]]:
        """Yield the groups' frames from `begin` to `stop`, those of each wheel in the order of the stream."""
        of = self._of[begin:stop]
        numbers, counts = np.unique(of, return_counts=True)
        parts: dict[tuple[int, int], list[tuple[SampleGroup, int, int]]] = {}
        for number, count in zip(numbers.tolist(), counts.tolist(), strict=True):
            if number >= 0:
                group = self._groups[number]
                lo = int(self._place[begin + int(np.argmax(of == number))])
                parts.setdefault((group.hub, group.wheel), []).append((group, lo, lo + count))
        for of_wheel in parts.values():
            if len(of_wheel) == 1:
                group, lo, hi = of_wheel[0]
                yield group, slice(lo, hi)
                continue
            # The wheel changed its block size or its axes: its blocks are taken one by one.
            frames = [(int(group.frame_index[at]), group, at) for group, lo, hi in of_wheel for at in range(lo, hi)]
            for _, group, at in sorted(frames, key=itemgetter(0)):
                yield group, slice(at, at + 1)
