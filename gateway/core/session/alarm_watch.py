"""Silence and alarms of a session or recording, brought forward in the time of its frames."""

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_protocol.frame_blocks import FrameBlock
from gateway.core.config.vehicle import Thresholds, VehicleConfig
from gateway.core.estimates.estimator import Status
from gateway.core.estimates.results import (
    Alarm,
    AlarmRecord,
    LinkSnapshot,
    RevolutionResult,
    Silence,
    WheelSnapshot,
    WheelState,
)
from gateway.core.links.reasons import LinkCode
from gateway.core.links.source import LinkEvent, LinkEventKind, VehicleData
from gateway.core.reasons import Notice, Reason
from gateway.core.recording.decoder_blocks import LINKS_APART_NS
from gateway.core.session.alarm_log import AlarmLog
from gateway.core.session.alarms import (
    SILENCES,
    THRESHOLDS,
    AlarmKey,
    AlarmName,
    HubNames,
    alarms,
    has_wheel_limits,
    present_values,
    silent_alarms,
    superseded,
    threshold_alarms,
)
from gateway.core.session.reasons import SessionCode
from gateway.core.session.silence import SLOT_NS, SilenceWatch, VehiclePart, parts_heard
from gateway.core.session.wheel_identity import positions, sensor_ids
from gateway.core.session.wheel_watches import wheel_watches
from gateway.core.trust.wheel_pairs import ALARMS as PAIR_ALARMS
from gateway.core.wheels.wheels import Pipeline

State = tuple[tuple[WheelSnapshot, ...], tuple[LinkSnapshot, ...]]
Witnesses = Callable[[], Iterable[Alarm]]

REVIEW_INTERVAL_NS: Final = 100_000_000
"""Interval of reviews, in the time of the frames."""
# A link that was never open, or that has ended as it should, is no alarm in the history.
_NORMAL_DOWN: Final = frozenset({SessionCode.LINK_NOT_OPEN, LinkCode.LINK_ENDED})
_BUS_SLOT_NS: Final = 50_000_000
_STREAM_ALARMS: Final = frozenset({*SILENCES, AlarmName.LINK})
_MEASURED_ALARMS: Final = _STREAM_ALARMS | THRESHOLDS


class AlarmWatch(ABC):
    """Reviews alarms ten times per second of the frames' time, and whenever something falls silent.

    Attributes:
        thresholds: of the configuration.
        silence: takes the frames.
        log: history of the alarms.
    """

    def __init__(
        self, vehicle: VehicleConfig | None, pipeline: Pipeline, witnesses: Witnesses, *, logs: bool = True
    ) -> None:
        """Start without frames.

        Args:
            vehicle: its thresholds and positions; None without any.
            pipeline: names and admits the wheels.
            witnesses: returns the present alarms of what others compare or see.
            logs: whether alarms go to the program's log too.
        """
        self.thresholds = vehicle.thresholds if vehicle is not None else Thresholds()
        self.silence = SilenceWatch(pipeline.position, positions(vehicle).values(), self.thresholds.silent_after_s)
        self.log = AlarmLog(logs=logs)
        self._witness_alarms = witnesses
        self._watches = wheel_watches(vehicle)
        self._pipeline = pipeline
        self._review_due_ns: dict[str, int] = {}
        self._hub_names: HubNames = {}
        # Link whose time is the present one.
        self._link = ""

    @abstractmethod
    def review(self) -> list[Notice]:
        """Compare the present alarms with those before; return new notices."""

    def advance(self, link: str, now_ns: int) -> list[Notice]:
        """Bring a link to a time before its next frame is taken; return new notices."""
        notices: list[Notice] = []
        self._link = link
        for _ in self.silence.changes(link, now_ns):
            notices += self.review()
        review_due_ns = self._review_due_ns.get(link, 0)
        if not 0 < review_due_ns - now_ns <= REVIEW_INTERVAL_NS:
            self._review_due_ns[link] = now_ns + REVIEW_INTERVAL_NS
            notices += self.review()
        return notices

    def frames(self, link: str, block: FrameBlock, arrivals_ns: NDArray[np.int64]) -> list[Notice]:
        """Take frames of any source that is admitted, (frames,) with their arrivals; return new notices."""
        notices: list[Notice] = []
        for arrival in block.heard(arrivals_ns, SLOT_NS):
            notices += self.advance(link, arrival.arrived_ns)
            if self._pipeline.limit.admits(link, arrival.hub, arrival.wheel):
                self.silence.heard(link, arrival)
        return notices

    def vehicle(self, item: VehicleData) -> list[Notice]:
        """Take the arrival of data of the vehicle; return new notices."""
        notices = self.advance(item.link, item.host_ns)
        self.silence.vehicle(item.link, parts_heard(item), item.host_ns)
        return notices

    def link_event(self, event: LinkEvent) -> list[Notice]:
        """Take a change of a link at its time; return new notices."""
        notices = self.advance(event.link, event.host_ns)
        self.silence.turned(event.link, event.host_ns, None if event.kind.is_open else event.reason)
        return notices

    def pause(self, link: str, pause_ns: int, end_ns: int) -> list[Notice]:
        """Leave a pause of this computer out of the silence of a link; return new notices."""
        # What was silent before the pause is so without it.
        notices = self.advance(link, end_ns - pause_ns)
        self.silence.paused(link, pause_ns, end_ns)
        return notices

    def results(self, compared: Iterable[tuple[RevolutionResult, bool]]) -> list[RevolutionResult]:
        """Take the results of a block of frames, each with whether the comparison of wheels changes with it.

        Returns:
            The results, with what stands at their times where that is known.
        """
        return [result for result, _ in compared]

    def _witnesses(self) -> tuple[Alarm, ...]:
        return (*self._witness_alarms(), *(alarm for watch in self._watches for alarm in watch.alarms()))

    def _silent(self, wheels: Iterable[WheelSnapshot], several_links: bool) -> tuple[Alarm, ...]:
        hubs, vehicles = self.silence.silent_hubs(), self.silence.silent_vehicles()
        return silent_alarms(wheels, hubs, vehicles, self._hub_names, several_links=several_links)

    def _update(
        self,
        present: Iterable[Alarm],
        at_s: float,
        wheels: Sequence[WheelSnapshot],
        *,
        several_links: bool,
        values: Callable[[], Mapping[AlarmKey, Reason]] = dict,
        covers: Callable[[AlarmKey], bool] = lambda _: True,
    ) -> list[Notice]:
        """Take the present alarms of wheels with their silences; return new notices."""
        hidden = superseded(
            wheels,
            self.silence.silent_hubs(of_down_links=True),
            self.silence.silent_vehicles(of_down_links=True),
            self._hub_names,
            several_links=several_links,
        )
        return self.log.update(present, at_s, hidden=hidden, values=values, covers=covers)


class SessionAlarms(AlarmWatch):
    """Alarms of a session, from its present state."""

    def __init__(
        self, vehicle: VehicleConfig | None, pipeline: Pipeline, witnesses: Witnesses, state: Callable[[], State]
    ) -> None:
        """Start without frames; `state` returns the present snapshots of wheels and links, silence left out."""
        super().__init__(vehicle, pipeline, witnesses)
        self._state = state
        self._sensor_ids = sensor_ids(vehicle)

    def review(self) -> list[Notice]:
        """Compare the present alarms with those before; return new notices."""
        wheels, links = self._state()
        wheels = self.with_silences(wheels)
        for watch in self._watches:
            for wheel in wheels:
                watch.take(wheel, self.silence.elapsed_s(), is_current=wheel.has_current_environment)
        return self._update(
            [alarm for alarm in self.alarms(wheels, links) if not _is_normal(alarm)],
            self.silence.elapsed_s(),
            wheels,
            several_links=len(links) > 1,
            values=lambda: present_values(wheels, links, self.thresholds),
        )

    def alarms(self, wheels: Sequence[WheelSnapshot], links: Sequence[LinkSnapshot]) -> tuple[Alarm, ...]:
        """Return the present alarms of wheels, with their silences, of links and of what others see."""
        present = alarms(wheels, links, self.thresholds, self._sensor_ids, standing=self.log.standing())
        return *self._silent(wheels, len(links) > 1), *present, *self._witnesses()

    def with_silences(self, wheels: Sequence[WheelSnapshot]) -> tuple[WheelSnapshot, ...]:
        """Return wheels with what is silent of them."""
        silences = self.silence.of_wheels()
        return tuple(
            silenced(wheel, silences[wheel.position]) if wheel.position in silences else wheel for wheel in wheels
        )


class RecordingAlarms(AlarmWatch):
    """Alarms of a pass over a recording: silence by frame, thresholds and pairs by result, faults by block."""

    def __init__(
        self, vehicle: VehicleConfig | None, pipeline: Pipeline, witnesses: Witnesses, *, logs: bool = True
    ) -> None:
        """Start without frames; arguments as for `AlarmWatch`."""
        super().__init__(vehicle, pipeline, witnesses, logs=logs)
        self._wheels: dict[str, WheelSnapshot] = {}
        self._has_limits = has_wheel_limits(self.thresholds)
        # Wheels whose reading of a receiver beside the hubs is old.
        self._old: set[str] = set()
        # Arrivals of the vehicle's data that are later than the frames of hubs taken so far.
        self._arrivals: dict[str, deque[tuple[int, frozenset[VehiclePart]]]] = {}
        # Links of hubs that have ended as they should.
        self._ended: set[str] = set()

    def event(self, event: LinkEvent) -> None:
        """Take a change of a link, or a pause of the computer that recorded, after the frames before it."""
        if event.pause_ns is not None:
            for link in self._going_on():
                self.pause(link, event.pause_ns, event.host_ns)
        elif event.kind is LinkEventKind.ENDED:
            # A recording may end long after the last frame: that is no silence.
            self.advance(event.link, min(event.host_ns, self.silence.newest_ns()))
            self._ended |= {event.link} - self._arrivals.keys()
        elif event.is_of_link:
            self._ended.discard(event.link)
            self.link_event(event)
            self.review()

    def vehicle(self, item: VehicleData) -> list[Notice]:
        """Take the arrival of data of the vehicle; it takes effect before the first frame of a hub after it."""
        parts, host_ns = parts_heard(item), item.host_ns
        if not parts:
            return []
        arrivals = self._arrivals.setdefault(item.link, deque())
        # Arrivals within a slot count as one, and many wait for the frames of a hub's block.
        is_same_slot = len(arrivals) > 1 and 0 <= host_ns - arrivals[-2][0] < _BUS_SLOT_NS
        if is_same_slot and arrivals[-1][1] == parts:
            arrivals[-1] = host_ns, parts
        else:
            arrivals.append((host_ns, parts))
        return []

    def frames(self, link: str, block: FrameBlock, arrivals_ns: NDArray[np.int64]) -> list[Notice]:
        """Take frames before their results."""
        self._ended.discard(link)
        notices = [*super().frames(link, block, arrivals_ns), *self.review()]
        self._wheels.clear()
        return notices

    def advance(self, link: str, now_ns: int) -> list[Notice]:
        """Bring a link to a time before its next frame is taken, after the vehicle's data that came before it."""
        for vehicle_link, arrivals in self._arrivals.items():
            while arrivals and arrivals[0][0] <= now_ns:
                host_ns, parts = arrivals.popleft()
                super().advance(vehicle_link, host_ns)
                self.silence.vehicle(vehicle_link, parts, host_ns)
            super().advance(vehicle_link, now_ns)
        # A link that is silent has no frames that bring it forward.
        for other in self._going_on():
            if other != link and other not in self._arrivals:
                self._link = other
                for _ in self.silence.changes(other, now_ns - LINKS_APART_NS):
                    self.review()
        return super().advance(link, now_ns)

    def _going_on(self) -> list[str]:
        return [link for link in self.silence.links() if link not in self._ended]

    def results(self, compared: Iterable[tuple[RevolutionResult, bool]]) -> list[RevolutionResult]:
        """Take the results of a block; return them with alarms and the silence before them, then take faults."""
        results = [self._result(result, is_changed) for result, is_changed in compared]
        self._take_faults()
        return results

    def _result(self, result: RevolutionResult, is_changed: bool) -> RevolutionResult:
        position = result.position
        at_s = self.silence.since_begin_s(result.host_ns)
        if is_changed:
            self.log.update(self._witnesses(), at_s, covers=lambda key: key[1] in PAIR_ALARMS)
        if self._has_limits:
            wheel = _as_snapshot(result)
            self.log.update(
                threshold_alarms(wheel, self.thresholds, self.log.standing()),
                at_s,
                values=lambda: present_values([wheel], [], self.thresholds),
                covers=lambda key: key[0] == position and key[1] in THRESHOLDS,
            )
        self._take_outside(position, result.host_ns, at_s)
        if self._watches:
            self._watch(result, at_s)
        silent_s = self.silence.ended_before_s(position, result.host_ns)
        standing = self.log.standing_at(position, at_s)
        if standing == result.alarms and silent_s == result.silent_before_s:
            return result
        return replace(result, alarms=standing, silent_before_s=silent_s)

    def _take_outside(self, position: str, host_ns: int, at_s: float) -> None:
        """Take whether the reading of a receiver beside the hubs is old at a revolution."""
        silence = self._pipeline.outside_silence(position, host_ns)
        if silence is None and position not in self._old:
            return
        present = () if silence is None else (Alarm(position, AlarmName.ENVIRONMENT, silence.reason),)
        self.log.update(present, at_s, covers=lambda key: key == (position, AlarmName.ENVIRONMENT))
        (self._old.discard if silence is None else self._old.add)(position)

    def _watch(self, result: RevolutionResult, at_s: float) -> None:
        """Let the watches of features take a result, with what is known of its wheel at the end of the block."""
        position = result.position
        if not self._wheels:
            self._wheels = {wheel.position: wheel for wheel in self._pipeline.wheels()}
        of_block = self._wheels[position]
        is_old = any(alarm.name in SILENCES for alarm in self.log.standing_at(position, at_s))
        wheel = replace(_as_snapshot(result), stated=of_block.stated, flags=of_block.flags)
        for watch in self._watches:
            watch.take(wheel, at_s, is_current=not is_old)
            names = watch.names
            self.log.update(watch.alarms(), at_s, covers=lambda key: key[0] == position and key[1] in names)  # noqa: B023

    def _take_faults(self) -> None:
        wheels = self._pipeline.wheels()
        flags = [Alarm(wheel.position, flag.name, flag.reason) for wheel in wheels for flag in wheel.flags]
        flags += self._witnesses()
        self.log.update(flags, self.silence.link_s(self._link), covers=lambda key: key[1] not in _MEASURED_ALARMS)

    def finish(self) -> tuple[AlarmRecord, ...]:
        """Return the history of every alarm, with the silences that last to the end of the recording."""
        waiting_ns = [arrivals[-1][0] for arrivals in self._arrivals.values() if arrivals]
        end_ns = max([self.silence.newest_ns(), *waiting_ns])
        for link in self._going_on():
            self.advance(link, end_ns)
        self.review()
        self._take_faults()
        return self.log.records()

    def review(self) -> list[Notice]:
        """Compare the present alarms of links and streams with those before; return new notices."""
        several = len(self.silence.links()) > 1
        wheels = [WheelSnapshot(position, silences=silences) for position, silences in self.silence.of_wheels().items()]
        present = [*self._link_alarms(), *self._silent(wheels, several)]
        # Those of receivers beside the hubs change with a result.
        outside = {(position, AlarmName.ENVIRONMENT) for position in self._old}
        return self._update(
            present,
            self.silence.link_s(self._link),
            wheels,
            several_links=several,
            covers=lambda key: key[1] in _STREAM_ALARMS and key not in outside,
        )

    def _link_alarms(self) -> Iterator[Alarm]:
        for link, state in self.silence.down_links():
            yield Alarm(link, AlarmName.LINK, Reason(SessionCode.LINK_DOWN, state=state))


def silenced(wheel: WheelSnapshot, silences: tuple[Silence, ...]) -> WheelSnapshot:
    """Return a wheel with its silences; a wheel that has never had data stays without data."""
    is_stopped = any(silence.stops_numbers for silence in silences)
    state = WheelState.SILENT if is_stopped and wheel.state is not WheelState.NO_DATA else wheel.state
    return replace(wheel, state=state, silences=(*silences, *wheel.silences))


def _is_normal(alarm: Alarm) -> bool:
    return alarm.name == AlarmName.LINK and any(reason.code in _NORMAL_DOWN for reason in alarm.reason)


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
