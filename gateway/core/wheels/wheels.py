"""The whole pipeline, from frames of any number of links to results of any number of wheels.

Synchronous and deterministic: no clock, no I/O. The results do not depend on the chunks in which frames arrive.
"""

from collections.abc import Container, Iterable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from firmware_protocol.frame_blocks import FrameBlock, FrameList
from firmware_protocol.messages import Frame, SampleBlock
from gateway.core.estimates.registry import DEFAULT_ESTIMATORS
from gateway.core.estimates.results import RevolutionResult, Silence, WheelSnapshot
from gateway.core.estimates.wheel_setup import WheelSetup
from gateway.core.types import FloatArray
from gateway.core.wheels.frame_router import FrameRouter, Hub, StreamWatcher
from gateway.core.wheels.outside_readings import OutsideReading
from gateway.core.wheels.wheel_pipeline import WheelPipeline


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
            hold_s: longest time by which a revolution may come later, together with the next ones: work on several at
                once takes less than on one at a time. By the hub's samples and clock, so that the results do not depend
                on when frames arrive.

        Raises:
            ConfigError: unknown estimator.
        """
        self._estimators = tuple(estimators)
        self._hold_s = hold_s
        self._unknown = unknown
        self._order = [WheelPipeline(setup, self._estimators, hold_s) for setup in setups]
        self._configured = {wheel.setup.position: wheel for wheel in self._order}
        self._positions = {(setup.hub, setup.wheel): setup.position for setup in setups}
        self._router: FrameRouter[WheelPipeline] = FrameRouter(self._positions, self._make_wheel)
        # Wheels that have sent a frame, with the clocks of their hubs.
        self._active_wheels: list[tuple[Hub, WheelPipeline]] = []
        self.limit = self._router.limit

    def attach(self, watcher: StreamWatcher) -> None:
        """Let a watcher take the frames that come."""
        self._router.attach(watcher)

    def hold(self, hold_s: float) -> None:
        """Let revolutions wait for at most so long from here on."""
        self._hold_s = hold_s
        for wheel in self._order:
            wheel.hold(hold_s)

    def take(self, link: str, block: FrameBlock, hosts_ns: NDArray[np.int64] | None) -> list[RevolutionResult]:
        """Take decoded frames; return the revolutions that are complete and due.

        Args:
            link: link on which they arrived.
            block: the frames.
            hosts_ns: (frames,) arrival time of each; None where they are not known, as of a dump.
        """
        self._router.take(link, block, hosts_ns)
        return [
            result
            for hub, wheel in self._active_wheels
            for result in (wheel.complete() if wheel.is_due(hub.last_us) else wheel.completed())
        ]

    def frames(self, link: str, frames: Sequence[Frame], host_ns: int) -> list[RevolutionResult]:
        """Take frames that arrived together at `host_ns`, as `take`."""
        return self.take(link, FrameList(frames), np.full(len(frames), host_ns))

    def can_decide(self, link: str, frames: Iterable[Frame]) -> bool:
        """Return whether frames are enough for something to be decided, such as the end of a revolution."""
        wheels = self._router.wheels
        for _, hub, number, _, _, message in frames:
            if not isinstance(message, SampleBlock):
                return True
            wheel = wheels.get((link, hub, number))
            if wheel is not None and wheel.can_decide(message.first_sample + len(message.counts)):
                return True
        return False

    def complete(self, link: str) -> list[RevolutionResult]:
        """Return the revolutions of a link that wait for the next ones, as when it falls silent."""
        link_wheels = (wheel for key, wheel in self._router.wheels.items() if key[0] == link)
        return [result for wheel in link_wheels if wheel is not None for result in wheel.complete()]

    def _make_wheel(self, position: str, hub: int, number: int, clock: Hub) -> WheelPipeline:
        """Return the wheel of a position; one that is not configured is new."""
        wheel = self._configured.get(position)
        if wheel is None:
            setup = replace(self._unknown, position=position, hub=hub, wheel=number)
            wheel = WheelPipeline(setup, self._estimators, self._hold_s)
            self._order.append(wheel)
        self._active_wheels.append((clock, wheel))
        return wheel

    def outside(self, position: str, reading: OutsideReading) -> None:
        """Take a reading of a receiver beside the hubs for a wheel; that of a revolution is the latest at its end."""
        for wheel in self._order:
            if wheel.setup.position == position:
                wheel.outside(reading)

    def outside_silence(self, position: str, host_ns: int) -> Silence | None:
        """Return the silence of a receiver beside the hubs at a time, None while the wheel needs none of it."""
        return next((wheel.outside_silence(host_ns) for wheel in self._order if wheel.setup.position == position), None)

    def finish(self) -> list[RevolutionResult]:
        """Complete the revolutions that can be completed, when no more frames will come."""
        results: list[RevolutionResult] = []
        for hub, wheel in self._active_wheels:
            results += wheel.finish(hub.host)
        return results

    def wheels(self) -> tuple[WheelSnapshot, ...]:
        """Return the latest state of every wheel, configured ones first."""
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
