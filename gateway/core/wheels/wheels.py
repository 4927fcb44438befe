"""The whole pipeline, from frames of any number of links to results of any number of wheels.

Synchronous and deterministic: no clock, no I/O. The results do not depend on the chunks in which frames arrive.
"""

from __future__ import annotations

from collections.abc import Container, Iterable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from firmware_protocol.messages import Frame, SampleBlock
from gateway.core.estimates.registry import DEFAULT_ESTIMATORS
from gateway.core.estimates.results import RevolutionResult, WheelSnapshot
from gateway.core.estimates.wheel_setup import WheelSetup
from gateway.core.types import FloatArray
from gateway.core.wheels.frame_router import FrameRouter, Hub
from gateway.core.wheels.outside_readings import OutsideReading
from gateway.core.wheels.timebase import HostClock
from gateway.core.wheels.wheel_pipeline import WheelPipeline

if TYPE_CHECKING:
    from firmware_protocol.block_decoder import FrameBatch

# Sample numbers have 32 bits.
_SAMPLE_NUMBERS: Final = 1 << 32
# Share of the longest wait of revolutions for which samples wait for the next ones, and the most blocks that wait.
_GATHERED_SHARE: Final = 0.1
_MOST_BLOCKS: Final = 64
# Share of the longest wait after which wheels that are due together wait for each other no more.
_LATE_SHARE: Final = 0.2


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

    def is_due(self, wheel: WheelPipeline, longest_us: float) -> bool:
        """Return whether the samples have waited long enough, and the wheel has something to decide by them.

        By their number too: the hub's time may stand still.
        """
        ticks_us = self._ticks_us
        waited = ticks_us[-1] - ticks_us[0] >= longest_us and wheel.can_decide(self._next)
        return waited or len(ticks_us) >= _MOST_BLOCKS

    def add_to(self, wheel: WheelPipeline) -> None:
        """Add the samples to the wheel."""
        counts = self._parts[0] if len(self._parts) == 1 else np.concatenate(self._parts)
        wheel.add(self._first, self._ticks_us, self._axes, counts, self._host)


class _Source:
    """Hub and wheel from which samples come.

    Attributes:
        hub: the hub.
        wheel: None for the hub itself.
        run: samples that have not been added to the wheel yet, None without any.
    """

    __slots__ = ("hub", "run", "wheel")

    def __init__(self, hub: Hub, wheel: WheelPipeline | None) -> None:
        self.hub, self.wheel = hub, wheel
        self.run: _Run | None = None

    def begin_run(self, message: SampleBlock, tick_us: int) -> None:
        """Add the samples that wait, and let a block wait that does not follow them."""
        if self.wheel is not None:
            self.add_run()
            self.run = _Run(message, tick_us, self.hub.host)

    def add_run(self) -> None:
        """Add the samples that wait to the wheel."""
        if self.run is not None and self.wheel is not None:
            self.run.add_to(self.wheel)
            self.run = None

    def add_due(self, longest_us: float) -> None:
        """Add the samples that wait if they are due."""
        if self.run is not None and self.wheel is not None and self.run.is_due(self.wheel, longest_us):
            self.add_run()


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
                do not depend on when frames arrive. In `batch`, time after which those of a wheel are complete that
                sends nothing more.

        Raises:
            ConfigError: unknown estimator.
        """
        self._estimators = tuple(estimators)
        self._hold_s = hold_s
        self._unknown = unknown
        self._order = [WheelPipeline(setup, self._estimators, self._wheel_hold_s) for setup in setups]
        self._configured = {wheel.setup.position: wheel for wheel in self._order}
        self._positions = {(setup.hub, setup.wheel): setup.position for setup in setups}
        self._router: FrameRouter[WheelPipeline] = FrameRouter(self._positions, self._made)
        # Wheels that have sent a frame, with the clocks of their hubs.
        self._heard: list[tuple[Hub, WheelPipeline]] = []
        self.limit = self._router.limit
        # Sources of samples of each link, those that were admitted.
        self._sources: dict[str, dict[tuple[int, int], _Source]] = {}

    @property
    def _wheel_hold_s(self) -> float:
        return (1.0 - _GATHERED_SHARE) * self._hold_s

    def hold(self, hold_s: float) -> None:
        """Let revolutions wait for at most so long from here on."""
        self._hold_s = hold_s
        for wheel in self._order:
            wheel.hold(self._wheel_hold_s)

    def frames(self, link: str, frames: Iterable[Frame], host_ns: int) -> list[RevolutionResult]:
        """Take decoded frames that arrived on `link` at `host_ns`; return the revolutions that are complete and due."""
        newest: Hub | None = None
        router, sources = self._router, self._sources.setdefault(link, {})
        for frame in frames:
            _, hub_number, number, _, tick, message = frame
            if not isinstance(message, SampleBlock):
                # It takes effect between the samples before and behind it.
                self._add_runs(link)
                router.stamp_arrivals(link, host_ns)
                if self.limit.admits(link, hub_number, number):
                    router.slow(link, hub_number, number, tick, message, host_ns)
                    newest = router.hub(link, hub_number)
                continue
            entry = sources.get((hub_number, number)) or self._source(link, hub_number, number)
            if entry is not None:
                newest = entry.hub
                tick_us = newest.arrived(tick)
                if entry.run is None or not entry.run.goes_on(message, tick_us):
                    entry.begin_run(message, tick_us)
        router.stamp_arrivals(link, host_ns)
        if newest is not None and newest.last_us is not None:
            newest.host.measure_latency(newest.last_us, host_ns)
        longest_us = _GATHERED_SHARE * self._hold_s * 1e6
        for source in sources.values():
            source.add_due(longest_us)
        return self._completed(self._due())

    def _completed(self, due: Container[WheelPipeline]) -> list[RevolutionResult]:
        """Return the revolutions that are complete, those that wait of the wheels that are due."""
        return [
            result for _, wheel in self._heard for result in (wheel.complete() if wheel in due else wheel.completed())
        ]

    def _due(self) -> list[WheelPipeline]:
        """Return the wheel whose results have been due for longest, and all that have been for a share of `hold_s`.

        One wheel at a time keeps the work on a chunk short.
        """
        overdue = [(wheel, late_s) for hub, wheel in self._heard if (late_s := wheel.overdue_s(hub.last_us)) >= 0.0]
        if not overdue:
            return []
        latest_s = max(late_s for _, late_s in overdue)
        first = next(wheel for wheel, late_s in overdue if late_s == latest_s)
        return [wheel for wheel, late_s in overdue if wheel is first or late_s >= _LATE_SHARE * self._hold_s]

    def complete(self, link: str) -> list[RevolutionResult]:
        """Return the revolutions of a link that wait for the next ones, as when it falls silent."""
        self._add_runs(link)
        of_link = (wheel for key, wheel in self._router.wheels.items() if key[0] == link)
        return [result for wheel in of_link if wheel is not None for result in wheel.complete()]

    def _add_runs(self, link: str) -> None:
        """Add the samples of a link that wait to their wheels."""
        for source in self._sources.get(link, {}).values():
            source.add_run()

    def _source(self, link: str, hub: int, wheel: int) -> _Source | None:
        """Return a new source of samples; None if not admitted."""
        if not self.limit.admits(link, hub, wheel):
            return None
        source = _Source(self._router.hub(link, hub), self._router.wheel(link, hub, wheel))
        self._sources[link][hub, wheel] = source
        return source

    def _made(self, position: str, hub: int, number: int, clock: Hub) -> WheelPipeline:
        """Return the wheel of a position; one that is not configured is new."""
        wheel = self._configured.get(position)
        if wheel is None:
            setup = replace(self._unknown, position=position, hub=hub, wheel=number)
            wheel = WheelPipeline(setup, self._estimators, self._wheel_hold_s)
            self._order.append(wheel)
        self._heard.append((clock, wheel))
        return wheel

    def batch(self, link: str, batch: FrameBatch, host_ns: NDArray[np.int64] | None) -> list[RevolutionResult]:
        """Take a block of decoded frames of a dump; the results are those of `frames`, wheel by wheel.

        Args:
            link: link on which they arrived.
            batch: the block.
            host_ns: (frames,) arrival time of each; None where they are not known, as of a dump.
        """
        self._router.batch(link, batch, host_ns)
        # A wheel works on its revolutions when a block of them is full, or its buffer; one that sends no more does not.
        return self._completed([wheel for hub, wheel in self._heard if wheel.overdue_s(hub.last_us) >= self._hold_s])

    def outside(self, position: str, reading: OutsideReading) -> None:
        """Take a reading of a receiver beside the hubs for a wheel; that of a revolution is the latest at its end."""
        for wheel in self._order:
            if wheel.setup.position == position:
                wheel.outside(reading)

    def finish(self) -> list[RevolutionResult]:
        """Complete the revolutions that can be completed, when no more frames will come."""
        for of_link in self._sources:
            self._add_runs(of_link)
        results: list[RevolutionResult] = []
        for hub, wheel in self._heard:
            results += wheel.finish(hub.host)
        return results

    def wheels(self) -> tuple[WheelSnapshot, ...]:
        """Return the latest state of every wheel, configured ones first."""
        for link in self._sources:
            self._add_runs(link)
        return tuple(wheel.snapshot() for wheel in self._order)

    def position(self, link: str, hub: int, wheel: int) -> str:
        """Return the position that names a wheel in results."""
        routed = self._router.wheels.get((link, hub, wheel))
        return (
            routed.setup.position if routed is not None else self._positions.get((hub, wheel), f"hub{hub}.wheel{wheel}")
        )

    def average_mps2(self, position: str) -> FloatArray | None:
        """Return the running average of a wheel's radial axis, None before its first revolution."""
        return next((wheel.average_mps2 for wheel in self._order if wheel.setup.position == position), None)

    def latency_s(self, link: str, hubs: Container[int]) -> float | None:
        """Return the delay of the newest frame of these hubs relative to the fastest, None before the first frame."""
        latencies = [hub.host.latency_s for number, hub in self._router.hubs(link) if number in hubs]
        return max((value for value in latencies if value is not None), default=None)
