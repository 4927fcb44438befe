"""Silence and alarms of a recording that is estimated in one pass, from arrival times and results."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from firmware_protocol.block_decoder import FrameBatch
from gateway.config.vehicle import Thresholds, VehicleConfig
from gateway.estimators.estimator import Status
from gateway.io.source import LinkEvent, LinkEventKind
from gateway.pipeline.results import Alarm, AlarmRecord, RevolutionResult, WheelSnapshot, WheelState
from gateway.pipeline.wheels import Pipeline
from gateway.reasons import Code, Reason
from gateway.session.alarm_log import AlarmLog
from gateway.session.alarm_watch import REVIEW_INTERVAL_NS
from gateway.session.alarms import (
    SILENCES,
    THRESHOLDS,
    AlarmName,
    bus_alarms,
    has_wheel_limits,
    hub_alarms,
    present_values,
    silence_alarms,
    superseded,
    threshold_alarms,
)
from gateway.session.silence import SilenceWatch

_BUS_SLOT_NS = 50_000_000
_OF_STREAMS = frozenset({*SILENCES, AlarmName.LINK})


class BatchAlarms:
    """Finds the alarms of a recording: silence frame by frame, thresholds result by result, faults block by block."""

    def __init__(self, vehicle: VehicleConfig | None, *, logs: bool = True) -> None:
        """Take thresholds and positions of the configuration; `begin` follows.

        Args:
            vehicle: configuration; None without one.
            logs: whether alarms go to the program's log too.
        """
        # Returns the alarms of what the vehicle's signals contradict.
        self.witnesses: Callable[[], Iterable[Alarm]] = tuple
        self._thresholds = vehicle.thresholds if vehicle is not None else Thresholds()
        self._has_limits = has_wheel_limits(self._thresholds)
        self._configured = [wheel.position for wheel in vehicle.wheel] if vehicle is not None else []
        self._events: dict[str, deque[LinkEvent]] = {}
        # Ends and lengths of the pauses of the computer that recorded, and how many of them each link has passed.
        self._pauses: list[tuple[int, int]] = []
        self._passed: Counter[str] = Counter()
        # Arrivals of frames of vehicle buses that are later than the frames of hubs taken so far.
        self._arrivals_ns: dict[str, deque[int]] = {}
        self._log = AlarmLog(logs=logs)
        self._review_due_ns = 0

    def begin(self, pipeline: Pipeline) -> None:
        """Set the pipeline that names the wheels and knows their sensors."""
        self._pipeline = pipeline
        self._silence = SilenceWatch(pipeline.position, self._configured, self._thresholds.silent_after_s)

    def event(self, event: LinkEvent) -> None:
        """Take a change of a link; it takes effect before the first frame that arrived later."""
        if event.is_of_link:
            self._events.setdefault(event.link, deque()).append(event)
        elif event.pause_ns is not None:
            self._pauses.append((event.host_ns, event.pause_ns))

    def bus(self, link: str, host_ns: int) -> None:
        """Take the arrival of frames of a vehicle bus; it takes effect before the first frame of a hub after it."""
        arrivals_ns = self._arrivals_ns.setdefault(link, deque())
        # Arrivals within a slot count as one, and many wait for the frames of a hub's block.
        if len(arrivals_ns) > 1 and 0 <= host_ns - arrivals_ns[-2] < _BUS_SLOT_NS:
            arrivals_ns[-1] = host_ns
        else:
            arrivals_ns.append(host_ns)

    def batch(self, link: str, batch: FrameBatch, arrivals_ns: NDArray[np.int64]) -> None:
        """Take a block of frames before its results."""
        for host_ns, frame in self._silence.thinned(batch, arrivals_ns):
            self._take_buses(host_ns)
            self._take_events(link, host_ns)
            self._advance(link, host_ns)
            if self._pipeline.limit.admits(link, frame.hub, frame.wheel):
                self._silence.heard(link, frame, host_ns)
        self._review()

    def result(self, result: RevolutionResult) -> RevolutionResult:
        """Take a result; return it with the alarms that stand at its wheel and the silence before it."""
        position = result.position
        at_s = self._silence.since_begin_s(result.host_ns)
        if self._has_limits:
            wheel = _as_snapshot(result)
            self._log.update(
                threshold_alarms(wheel, self._thresholds, self._log.standing()),
                at_s,
                values=lambda: present_values([wheel], [], self._thresholds),
                covers=lambda key: key[0] == position and key[1] in THRESHOLDS,
            )
        silent_s = self._silence.ended_before_s(position, result.host_ns)
        standing = self._log.standing_at(position, at_s)
        if standing == result.alarms and silent_s == result.silent_before_s:
            return result
        return replace(result, alarms=standing, silent_before_s=silent_s)

    def end_of_block(self) -> None:
        """Take the faults of sensors after the results of a block."""
        wheels = self._pipeline.wheels()
        flags = [Alarm(wheel.position, flag.name, flag.reason) for wheel in wheels for flag in wheel.flags]
        flags += self.witnesses()
        others = frozenset({*_OF_STREAMS, *THRESHOLDS})
        self._log.update(flags, self._silence.elapsed_s(), covers=lambda key: key[1] not in others)

    def finish(self) -> tuple[AlarmRecord, ...]:
        """Return the history of every alarm, with the silences that last to the end of the recording."""
        waiting_ns = [arrivals_ns[-1] for arrivals_ns in self._arrivals_ns.values() if arrivals_ns]
        end_ns = max([self._silence.newest_ns(), *waiting_ns])
        self._take_buses(end_ns)
        for link in list(self._events):
            self._take_events(link, end_ns)
        for link in self._silence.links():
            self._advance(link, end_ns)
        self._review()
        self.end_of_block()
        return self._log.records()

    def _take_buses(self, until_ns: int) -> None:
        for link, arrivals_ns in self._arrivals_ns.items():
            while arrivals_ns and arrivals_ns[0] <= until_ns:
                host_ns = arrivals_ns.popleft()
                self._take_events(link, host_ns)
                self._advance(link, host_ns)
                self._silence.bus(link, host_ns)
            self._take_events(link, until_ns)
            self._advance(link, until_ns)

    def _take_events(self, link: str, until_ns: int) -> None:
        events = self._events.get(link)
        while events and events[0].host_ns <= until_ns:
            event = events.popleft()
            self._advance(link, event.host_ns)
            if event.kind in (LinkEventKind.CONNECTED, LinkEventKind.RESTORED):
                self._silence.opened(link, event.host_ns)
            elif event.kind is not LinkEventKind.ENDED:
                self._silence.closed(link, event.host_ns, event.reason)
            self._review()

    def _advance(self, link: str, host_ns: int) -> None:
        while self._passed[link] < len(self._pauses):
            end_ns, pause_ns = self._pauses[self._passed[link]]
            if end_ns > host_ns:
                break
            self._passed[link] += 1
            for _ in self._silence.changes(link, end_ns - pause_ns):
                self._review()
            self._silence.paused(link, pause_ns, end_ns)
        for _ in self._silence.changes(link, host_ns):
            self._review()
        if not 0 < self._review_due_ns - host_ns <= REVIEW_INTERVAL_NS:
            self._review_due_ns = host_ns + REVIEW_INTERVAL_NS
            self._review()

    def _review(self) -> None:
        silent, several = self._silence.of_wheels(), len(self._silence.links()) > 1
        wheels = [WheelSnapshot(position, silences=silences) for position, silences in silent.items()]
        self._log.update(
            [
                *self._link_alarms(),
                *hub_alarms(self._silence.silent_hubs(), several),
                *silence_alarms(wheels),
                *bus_alarms(self._silence.silent_buses()),
            ],
            self._silence.elapsed_s(),
            hidden=superseded(
                wheels,
                self._silence.silent_hubs(of_down_links=True),
                self._silence.silent_buses(of_down_links=True),
                several_links=several,
            ),
            covers=lambda key: key[1] in _OF_STREAMS,
        )

    def _link_alarms(self) -> Iterator[Alarm]:
        for link, state in self._silence.down_links():
            yield Alarm(link, AlarmName.LINK, Reason(Code.LINK_DOWN, state=state))


def _as_snapshot(result: RevolutionResult) -> WheelSnapshot:
    """Return the state of a wheel at the end of a revolution, as far as thresholds need it."""
    conditions = result.conditions
    valid = {estimate.name: estimate for estimate in result.estimates if estimate.status is not Status.INVALID}
    load_n = conditions.load_n
    if load_n is None and "load_n" in valid:
        load_n = valid["load_n"].value
    return WheelSnapshot(
        result.position,
        state=WheelState.ROLLING,
        last=result,
        pressure_pa=conditions.pressure_pa,
        temperature_degc=conditions.temperature_degc,
        load_n=load_n,
        wear_mm=valid.get("wear_mm"),
    )
