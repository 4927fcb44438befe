"""The synchronous core of a session: link items in, recording and results out. No threads, no clock."""

import logging
from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Final

import numpy as np

from firmware_protocol.decoder import FrameDecoder
from firmware_protocol.frame_blocks import FrameList, SampleRun
from firmware_protocol.messages import Frame, Hello, HubStatus, MessageType
from gateway.core.config.vehicle import VehicleConfig, shown_units_of
from gateway.core.constants import LATENCY_S
from gateway.core.estimates.registry import DEFAULT_ESTIMATORS
from gateway.core.estimates.results import (
    Alarm,
    AlarmChange,
    DiskRoom,
    LinkSnapshot,
    RevolutionResult,
    SessionSnapshot,
    SilentPart,
    SinkSnapshot,
    WheelSnapshot,
    WheelState,
)
from gateway.core.estimates.wheel_setup import CorrectionTable
from gateway.core.links.reasons import LinkCode
from gateway.core.links.source import BusFrames, Chunk, LinkEvent, LinkEventKind, LinkItem, VehicleData
from gateway.core.reasons import Code, Level, Notice, Reason, codes_of
from gateway.core.session.alarm_watch import SessionAlarms, State
from gateway.core.session.alarms import RECORDING, AlarmName, disk_alarm, sink_alarms
from gateway.core.session.corrections import effects_notices
from gateway.core.session.disk_watch import disk_notices
from gateway.core.session.frame_guard import FrameGuard, GuardWatch
from gateway.core.session.hub_log import HubLog
from gateway.core.session.latency import Latency
from gateway.core.session.link_health import LinkHealth, hub_name
from gateway.core.session.missing_results import FrameCounts, long_missing
from gateway.core.session.reasons import SessionCode
from gateway.core.session.recent_loss import RecentLoss
from gateway.core.session.recording_stage import Recorder, Stage
from gateway.core.session.result_path import ResultPath
from gateway.core.session.session_parts import VehicleSignals, open_vehicle_signals
from gateway.core.session.session_recording import SessionRecording
from gateway.core.session.silence import parts_heard
from gateway.core.session.wheel_identity import positions, unconfigured_wheel
from gateway.core.shown_units import ShownUnits

_logger = logging.getLogger(__name__)

SHOWN_NOTICES: Final = 20
"""Latest notices that a snapshot has."""
# Notices waiting for `take_notices`; the oldest are dropped.
_WAITING_NOTICES: Final = 8192
# Frames wait for the next ones for so long where nothing can be decided by them, and not more of them.
_GATHERED_NS: Final = 20_000_000
_MAX_WAITING: Final = 256
# A link that is silent for this long brings no samples for which its last revolutions could wait.
_SILENT_NS: Final = 400_000_000

_BAD_EVENTS: Final = (LinkEventKind.LOST, LinkEventKind.RETRYING)
# Details that cost frames.
_BAD_DETAILS: Final = (LinkCode.PORT_SHARED, LinkCode.MTU_TOO_SMALL)
_LOSSES: Final = (Stage.RECORDING, Stage.TOPICS)


@dataclass(slots=True)
class _Link:
    """State of one link, with the frames that wait for the next ones, and their arrivals."""

    health: LinkHealth
    decoder: FrameDecoder
    hub_log: HubLog
    connected: bool = False
    note: Reason = field(default_factory=lambda: Reason(SessionCode.LINK_NOT_OPEN))
    bytes_received: int = 0
    vehicle_frames: int | None = None
    newest_ns: int = 0
    loss: RecentLoss = field(default_factory=RecentLoss)
    statuses: dict[int, HubStatus] = field(default_factory=dict)
    waiting: list[Frame] = field(default_factory=list)
    arrivals_ns: list[int] = field(default_factory=list)
    connected_rssi_dbm: int | None = None
    queue_dropped: Mapping[Stage, int] = field(default_factory=dict)

    @property
    def frames(self) -> int:
        """Frames that were used, of hubs or of the vehicle's bus."""
        return self.decoder.counters.frames if self.vehicle_frames is None else self.vehicle_frames


class SessionCore:
    """Recording, decoding and estimating; one call per link item.

    A failed recording does not end the session: a notice reports it, and the estimates continue.

    Attributes:
        recording: of the session, where there is one.
        newest_ns: time of the newest item, ns since the epoch, 0 before the first.
        latency: of results.
    """

    def __init__(
        self,
        vehicle: VehicleConfig | None,
        *,
        recorder: Recorder | None = None,
        estimators: Sequence[str] = DEFAULT_ESTIMATORS,
        guard: FrameGuard | None = None,
        effects: Sequence[CorrectionTable] = (),
        signals: VehicleSignals | None = None,
        latency_s: float = LATENCY_S,
    ) -> None:
        """Build the session.

        Args:
            vehicle: configuration; None when there is none: the belt radius is then assumed, with a notice.
            recorder: an open recording, closed by `finish`.
            estimators: names from the registry.
            guard: verifies every frame first; None when signatures are not checked.
            effects: known effects to subtract, one table per wheel.
            signals: decodes the vehicle's bus and receivers; None for receivers only.
            latency_s: longest time that a result may wait, so that several revolutions are worked on at once.
        """
        self._watch = GuardWatch(guard)
        self.recording = SessionRecording(recorder, self.notify)
        self._records_items = True
        self._notices: deque[Notice] = deque(maxlen=SHOWN_NOTICES)
        self._new_notices: deque[Notice] = deque(maxlen=_WAITING_NOTICES)
        self._alarm_changes: deque[AlarmChange] = deque(maxlen=_WAITING_NOTICES)
        self._links: dict[str, _Link] = {}
        self.newest_ns = self._ticked_ns = 0
        self.latency = self._present_latency = Latency(latency_s)
        self._signals = signals or open_vehicle_signals(vehicle)
        self._pipeline = ResultPath(vehicle, effects, estimators, self.latency.hold_s, self._signals)
        self._statements = self._pipeline.statements
        self._vehicle = vehicle
        self._units = shown_units_of(vehicle)
        self._reported_missing: set[tuple[str, tuple[Code, ...]]] = set()
        # Configured wheels, and those that were reported not to be.
        self._accounted_wheels = set(positions(vehicle).values())
        self._pipeline.attach(self._statements)
        self._pipeline.attach(self)
        self._alarms = SessionAlarms(vehicle, self._pipeline, self._present_alarms, self._state)
        self._pipeline.raise_alarms(self._alarms)
        self._sinks: tuple[SinkSnapshot, ...] = ()
        self._disk: DiskRoom | None = None
        # Reasons of what of the session has stopped, by its name.
        self._stopped: dict[str, Reason] = {}
        for notice in vehicle.notices() if vehicle is not None else ():
            self.notify(notice)
        for notice in (*effects_notices(effects, vehicle), *self._watch.take_notices()):
            self.notify(notice)
        configured = len(self._accounted_wheels)
        _logger.info("session with %d configured wheels, estimators %s", configured, ", ".join(estimators))

    def records_to(self, recorder: Recorder | None) -> None:
        """Record results, messages and notices, but not the items of links, which are recorded before they come."""
        self.recording = SessionRecording(recorder, self.notify)
        self._records_items = False

    def notify(self, notice: Notice) -> None:
        """Add a notice."""
        self._notices.append(notice)
        self._new_notices.append(notice)

    def take_notices(self) -> list[Notice]:
        """Return the notices since the last call, those of the start first."""
        notices = list(self._new_notices)
        self._new_notices.clear()
        return notices

    def take_alarm_changes(self) -> list[AlarmChange]:
        """Return the alarms that were raised, acknowledged or are over since the last call."""
        self._record_alarm_changes()
        changes = list(self._alarm_changes)
        self._alarm_changes.clear()
        return changes

    def acknowledge_alarms(self) -> None:
        """Note that the user has seen the alarms that stand."""
        self._alarms.log.acknowledge(self._alarms.silence.elapsed_s())

    def show_in(self, units: ShownUnits) -> None:
        """Have screens show numbers in these units from the next snapshot on."""
        self._units = units

    def _record_alarm_changes(self) -> None:
        for change in self._alarms.log.take_changes():
            self.recording.alarm(change, self.newest_ns or self._ticked_ns)
            self._alarm_changes.append(change)

    def publishes_to(self, sinks: tuple[SinkSnapshot, ...]) -> None:
        """Set the present state of the live outputs, for alarms and snapshots."""
        self._sinks = sinks

    def watches_disk(self, room: DiskRoom | None) -> None:
        """Set what is left of the disk of the recording, for alarms and snapshots; say it once."""
        if self.recording.recorder is None:
            room = None
        if room is not None:
            for notice in disk_notices(self._disk, room):
                self.notify(notice)
        self._disk = room

    def late(self, late_s: float) -> None:
        """Note by how much this computer is late: while it is, results wait longer, which takes less work."""
        latency = self.latency.while_late(late_s)
        if latency != self._present_latency:
            self._present_latency = latency
            self._pipeline.hold(latency.hold_s)

    def add_link(self, name: str) -> None:
        """Show a link before its first item."""
        self._link(name)

    def take(self, item: LinkItem) -> list[RevolutionResult]:
        """Record and decode an item; return the revolutions that it completes."""
        if self._records_items:
            self.recording.item(item)
        if isinstance(item, LinkEvent):
            results = self._take_waiting()
            self._event(item)
            return results
        self.newest_ns = max(self.newest_ns, item.host_ns)
        if not isinstance(item, Chunk) or not item.data:
            results = self._take_waiting()
            self._report(item.link, self._alarms.advance(item.link, item.host_ns), item.host_ns)
        if not item.data:
            return results  # it tells the time
        link = self._link(item.link)
        if not link.connected:
            link.connected, link.note = True, Reason(LinkCode.LINK_CONNECTED)
        link.bytes_received += len(item.data)
        link.newest_ns = item.host_ns
        if not isinstance(item, Chunk):
            self._vehicle_data(link, item)
            self._alarms.silence.vehicle(item.link, parts_heard(item), item.host_ns)
            return results
        results = self._decoded(item.link, link, link.decoder.feed(item.data), item.host_ns)
        of_link = link.health.data(item.host_ns, item.data, link.decoder.counters)
        self._report(item.link, [*self._statements.new(), *self._watch.take_notices(), *of_link], item.host_ns)
        return results

    def _vehicle_data(self, link: _Link, item: VehicleData) -> None:
        """Decode frames of the vehicle's bus or lines of a receiver, and record the values."""
        notices = []
        if isinstance(item, BusFrames) and not self._signals.maps_bus and link.vehicle_frames is None:
            notices.append(Notice(item.link, Reason(SessionCode.BUS_NOT_MAPPED), Level.WARNING))
        link.vehicle_frames = (link.vehicle_frames or 0) + item.count
        values, _ = self._pipeline.vehicle(item)
        if values:
            self.recording.signals(values, item.host_ns)
        notices += [replace(notice, level=Level.WARNING) for notice in self._pipeline.notices_of_receivers()]
        self._report(item.link, notices, item.host_ns)

    def _link(self, name: str) -> _Link:
        link = self._links.get(name)
        if link is None:
            health = LinkHealth(
                name,
                lambda hub, wheel: self._pipeline.position(name, hub, wheel),
                lambda hub, wheel: self._pipeline.limit.admits(name, hub, wheel),
            )
            link = self._links[name] = _Link(health, FrameDecoder(self._watch.gate(name)), HubLog(name))
        return link

    def _report(self, link: str, notices: Iterable[Notice], host_ns: int) -> None:
        """Add notices and keep them with the recording."""
        for notice in notices:
            self.notify(notice)
            self.recording.notice(notice, link, host_ns)

    def _event(self, event: LinkEvent) -> None:
        reason, host_ns = event.reason, event.host_ns
        if not event.is_of_link:
            pause_ns = event.pause_ns
            if pause_ns is not None:
                for name, link in self._links.items():
                    self._report(name, self._alarms.pause(name, pause_ns, host_ns), host_ns)
                    link.health.paused(host_ns)
            self.notify(Notice("", reason, Level.INFO if event.kind is LinkEventKind.MARK else Level.WARNING))
            return
        self.newest_ns = max(self.newest_ns, host_ns)
        link = self._link(event.link)
        self._report(event.link, self._alarms.link_event(event), host_ns)
        link.connected = event.kind.is_open
        if link.connected:
            link.health.reconnected()
            self._statements.reopened(event.link)
        if event.rssi_dbm is not None:
            link.connected_rssi_dbm = event.rssi_dbm
        if event.kind is not LinkEventKind.RETRYING or link.note != reason:
            is_bad = event.kind in _BAD_EVENTS or any(detail.code in _BAD_DETAILS for detail in event.details)
            level = Level.WARNING if is_bad else Level.INFO
            self.notify(Notice(event.link, reason, level))
        link.note = reason

    def _decoded(self, name: str, link: _Link, frames: list[Frame], host_ns: int) -> list[RevolutionResult]:
        """Let frames wait for the next ones, or take them with those that wait: few at a time take more work."""
        link.waiting += frames
        link.arrivals_ns += [host_ns] * len(frames)
        if not frames or (0 <= host_ns - link.arrivals_ns[0] < self._gathered_ns and len(link.waiting) < _MAX_WAITING):
            is_needed = any(frame.type != MessageType.SAMPLES for frame in frames)
            if not is_needed and (self.latency.gather_s or not self._pipeline.can_decide(name, frames)):
                return []
        return self._take_frames(name, link)

    @property
    def _gathered_ns(self) -> float:
        return 1e9 * self._present_latency.gather_s or _GATHERED_NS

    def _take_waiting(self) -> list[RevolutionResult]:
        """Take the frames that wait, of all links."""
        return [result for name, link in self._links.items() for result in self._take_frames(name, link)]

    def _take_frames(self, name: str, link: _Link) -> list[RevolutionResult]:
        """Take the frames of a link that wait."""
        if not link.waiting:
            return []
        block, arrivals_ns = FrameList(link.waiting), np.array(link.arrivals_ns)
        link.waiting, link.arrivals_ns = [], []
        report = partial(self._report, name, host_ns=link.newest_ns)
        return self._deliver(self._pipeline.watched(name, block, arrivals_ns, report), link.newest_ns)

    def samples(self, link: str, run: SampleRun) -> None:
        """Take no notice: the wheel takes them."""

    def message(self, link: str, frame: Frame) -> None:
        """Take what concerns the link or a hub, and record it."""
        name, state, message = link, self._links[link], frame.message
        host_ns = state.newest_ns
        if isinstance(message, Hello):
            self._report(name, state.health.hello(frame, host_ns), host_ns)
        elif isinstance(message, HubStatus):
            state.statuses[frame.hub] = message
        else:
            hub = hub_name(frame.hub) if len(self._links) == 1 else f"{name}, {hub_name(frame.hub)}"
            for notice in state.hub_log.take(hub, message, host_ns):
                self.notify(notice)
        self.recording.message(frame, self._pipeline.position(name, frame.hub, frame.wheel), name, host_ns)

    def _deliver(self, results: list[RevolutionResult], host_ns: int) -> list[RevolutionResult]:
        for result in results:
            if result.position not in self._accounted_wheels:
                self._accounted_wheels.add(result.position)
                self.notify(Notice(result.position, unconfigured_wheel(self._vehicle), Level.WARNING))
        self.recording.results(results, host_ns, self._pipeline.average_mps2)
        return results

    def tick(self, now_ns: int, link_times_ns: Mapping[str, int] | None = None) -> list[RevolutionResult]:
        """Flush the recording, and report silence, even when no item arrives; return revolutions of silent links.

        Args:
            now_ns: of the clock.
            link_times_ns: time up to which each link is known, in the time of its items; links without one stand
                still. None when all of them have the time of the clock.
        """
        self._ticked_ns = now_ns
        self.recording.tick(now_ns)
        self._report("", self._watch.tick(now_ns), now_ns)
        results = self._take_waiting()
        for name, link in self._links.items():
            link_ns = link_times_ns.get(name) if link_times_ns is not None else now_ns
            if link_ns is None:
                continue
            # An item may carry a later time than the tick that follows it.
            link_ns = max(link_ns, link.newest_ns)
            if link_ns - link.newest_ns > _SILENT_NS:
                results += self._deliver(self._pipeline.compared(self._pipeline.complete(name)), link.newest_ns)
            self._report(name, self._alarms.advance(name, link_ns), now_ns)
            if link.connected and link.vehicle_frames is None:
                self._report(name, link.health.tick(link_ns), now_ns)
            self._statements.counters(name, link.decoder.counters)
            self._report(name, link.hub_log.tick(link_ns), now_ns)
        self._report("", self._statements.new(), now_ns)
        self._report_missing(now_ns)
        return results

    def _report_missing(self, now_ns: int) -> None:
        """Report once per wheel and reason why no revolution comes at all; a faulty sensor has an alarm instead."""
        for wheel in self._pipeline.wheels():
            missing = long_missing(wheel)
            if missing is not None and (wheel.position, codes_of((missing,))) not in self._reported_missing:
                self._reported_missing.add((wheel.position, codes_of((missing,))))
                self._report("", [Notice(wheel.position, missing)], now_ns)

    def stopped(self, name: str, reason: Reason) -> None:
        """Note that a part of the session has stopped, for alarms; say it."""
        self._stopped[name] = reason
        self._report("", [Notice(name, reason, Level.ERROR)], self.newest_ns or self._ticked_ns)

    def dropped(self, link: str, stages: Mapping[Stage, int], refused_ns: int | None = None) -> None:
        """Set the number of items that the stages of the session have dropped; the first drop is reported.

        Args:
            link: name of the link.
            stages: the numbers.
            refused_ns: time of the first item whose time is out of range, None without any.
        """
        state = self._link(link)
        for stage in stages.keys() - state.queue_dropped.keys():
            if stage is Stage.TIMES and refused_ns is not None:
                refused = Reason(SessionCode.TIMES_REFUSED, time_s=refused_ns * 1e-9)
                self._report(link, [Notice(link, refused, Level.ERROR)], self.newest_ns or self._ticked_ns)
                continue
            level = Level.ERROR if stage in _LOSSES else Level.WARNING
            self.notify(Notice(link, Reason(SessionCode.STAGE_BEHIND, stage=stage.name.lower()), level))
        state.queue_dropped = stages

    def finish(self) -> list[RevolutionResult]:
        """End the session: complete the last revolutions and close the recording."""
        results: list[RevolutionResult] = []
        for name, link in self._links.items():
            results += self._decoded(name, link, link.decoder.finish(), link.newest_ns)
            results += self._take_frames(name, link)
            self._statements.counters(name, link.decoder.counters)
            self._report(name, link.hub_log.finish(), self.newest_ns)
        self.false_statements()
        self._report("", self._statements.new(), self.newest_ns)
        results += self._deliver(self._pipeline.compared(self._pipeline.finish()), self.newest_ns)
        self._report("", [*self._alarms.review(), *self._watch.finish()], self.newest_ns)
        self._record_alarm_changes()
        self.recording.close()
        _logger.info("session finished, %d wheels", len(self._pipeline.wheels()))
        return results

    def snapshot(self, elapsed_s: float, *, ended: bool = False) -> SessionSnapshot:
        """Return the latest state, immutable."""
        wheels, links = self._state()
        wheels = self._at_end(wheels) if ended else self._alarms.with_silences(wheels)
        alarms = () if ended else self._alarms.alarms(wheels, links)
        notices, records = tuple(self._notices), self._alarms.log.records()
        recorded = self.recording.path_and_size
        return SessionSnapshot(
            elapsed_s, wheels, links, alarms, notices, *recorded, ended, records, self._sinks, self._disk, self._units
        )

    def frame_counts(self) -> dict[str, FrameCounts]:
        """Return the frames of each link that were used, and those that its gate has rejected."""
        return {name: FrameCounts(link.frames, link.decoder.counters.refused) for name, link in self._links.items()}

    def false_statements(self) -> list[Notice]:
        """Return what hubs stated against what they sent, with the present counts, for the summary."""
        return self._statements.contradictions()

    def _at_end(self, wheels: tuple[WheelSnapshot, ...]) -> tuple[WheelSnapshot, ...]:
        """Return wheels as they were at the end: a link that has ended as it should has not fallen silent."""
        return tuple(
            wheel
            if wheel.silence is not None and wheel.silence.part is not SilentPart.LINK
            else plain
            if plain.state is WheelState.NO_DATA
            else replace(plain, state=WheelState.ENDED)
            for wheel, plain in zip(self._alarms.with_silences(wheels), wheels, strict=True)
        )

    def _state(self) -> State:
        """Return the present snapshots of wheels, without their silences, and of links."""
        return self._pipeline.wheels(), tuple(self._link_snapshot(name, link) for name, link in self._links.items())

    def _present_alarms(self) -> Iterator[Alarm]:
        """Yield the present alarms of wheels that are compared, and of the session itself."""
        yield from self._pipeline.pairs.alarms()
        yield from sink_alarms(self._sinks)
        yield from disk_alarm(self._disk, self._alarms.log.standing())
        recording_faults = {RECORDING: self.recording.stopped} if self.recording.stopped is not None else {}
        for name, reason in {**recording_faults, **self._stopped}.items():
            yield Alarm(name, AlarmName.STOPPED, reason)

    def _link_snapshot(self, name: str, link: _Link) -> LinkSnapshot:
        counters, speaking = link.decoder.counters, self._alarms.silence.speaking_hubs(name)
        # What a hub that is gone has said last must not stand for ever.
        statuses = [status for hub, status in link.statuses.items() if hub in speaking] or [*link.statuses.values()]
        batteries = [status.battery_percent for status in statuses if status.battery_percent is not None]
        rssis_dbm = [status.rssi_dbm for status in statuses if status.rssi_dbm is not None]
        return LinkSnapshot(
            link=name,
            connected=link.connected,
            note=link.note,
            bytes_received=link.bytes_received,
            frames=link.frames,
            crc_errors=counters.crc_errors,
            noise_bytes=counters.noise_bytes,
            frames_lost=counters.lost,
            duplicates=counters.duplicates,
            reordered=counters.reordered,
            skipped=counters.skipped + counters.bad_payload,
            latency_s=self._pipeline.latency_s(name, speaking),
            queue_dropped={str(stage): count for stage, count in link.queue_dropped.items()},
            battery_percent=min(batteries, default=None),
            rssi_dbm=min(rssis_dbm, default=link.connected_rssi_dbm),
            supply_w=sum(status.supply_w for status in statuses) if statuses else None,
            judged=self._watch.counts(name),
            silent_s=self._alarms.silence.silent_s(name),
            recent_loss=link.loss.share(link.newest_ns, counters.frames, counters.lost),
        )
