"""The synchronous heart of a session: link items in, recording and results out. No threads, no clock."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Final

from firmware_protocol.decoder import FrameDecoder
from firmware_protocol.messages import CommandResult, Frame, Hello, HubStatus, LogText, MessageType
from gateway.config.effects_file import effects_notices, with_effects
from gateway.config.vehicle import ASSUMED_RADIUS_MM, Thresholds, VehicleConfig
from gateway.errors import RecordingError
from gateway.estimators.registry import DEFAULT_ESTIMATORS
from gateway.io.source import LinkEvent, LinkEventKind, LinkItem
from gateway.pipeline.results import LinkSnapshot, RevolutionResult, SessionSnapshot
from gateway.pipeline.wheel_setup import CorrectionTable, WheelSetup
from gateway.pipeline.wheels import Pipeline
from gateway.security.guard import Guard
from gateway.session.alarms import alarms, sensor_alarms
from gateway.session.commands import refusal
from gateway.session.link_health import LinkDiagnosis
from gateway.session.recording_stage import Recorder
from gateway.session.security_watch import SecurityWatch
from gateway.session.wheel_identity import sensor_ids, unconfigured
from gateway.views.recording_topics import log_level, message_topic, revolution_payload, waveform_payload

_NOTICES: Final = 20
_WAVEFORM_EVERY_NS: Final = 1_000_000_000

# What it means when a stage first drops something, by stage.
_BEHIND: Final = {
    "recording": "the disk does not keep up: bytes are MISSING FROM THE RECORDING",
    "recorded topics": "the disk does not keep up: decoded values are left out of the recording, raw bytes are kept",
    "decoding": "this computer does not keep up with decoding and estimating; the recording is complete",
    "view": "the screen does not keep up: lines are left out",
}

Listener = Callable[[RevolutionResult], None]
Notify = Callable[[str], None]


@dataclass(slots=True)
class _Link:
    """What the session knows of one link."""

    diagnosis: LinkDiagnosis
    decoder: FrameDecoder
    connected: bool = False
    note: str = ""
    bytes_received: int = 0
    status: HubStatus | None = None
    connected_rssi_dbm: int | None = None
    queue_dropped: Mapping[str, int] = field(default_factory=dict)


class SessionCore:
    """Records, decodes and estimates; one call per link item.

    A recording that fails does not end the session: the user is told, and the estimates go on.

    Attributes:
        recorder: the recording, None when there is none or it failed.
        recording_fault: why the recording stopped early, None when it did not.
        records_items: False when somebody before the core records the link items already.
        on_result: called for every completed revolution.
        on_notice: called with everything the user should be told.
    """

    def __init__(
        self,
        vehicle: VehicleConfig | None,
        *,
        recorder: Recorder | None = None,
        estimators: Sequence[str] = DEFAULT_ESTIMATORS,
        guard: Guard | None = None,
        effects: Sequence[CorrectionTable] = (),
    ) -> None:
        """Put the parts together.

        Args:
            vehicle: configuration; None when nobody gave one, then the belt radius is assumed and told so.
            recorder: an open recording, closed by `finish`.
            estimators: names from the registry.
            guard: judges every frame before anything else looks at it; None when signatures do not matter.
            effects: known effects to take off, a table a wheel.
        """
        self._watch = SecurityWatch(guard)
        self.recorder = recorder
        self.recording_fault: str | None = None
        self.records_items = True
        self.on_result: Listener | None = None
        self.on_notice: Notify | None = None
        self._notices: deque[str] = deque(maxlen=_NOTICES)
        self._links: dict[str, _Link] = {}
        self._newest_ns = 0
        self._waveform_due_ns: dict[str, int] = {}
        unknown = WheelSetup("", 0, 0, ASSUMED_RADIUS_MM * 1e-3)
        setups = with_effects(vehicle.wheel_setups() if vehicle is not None else (), effects)
        self._pipeline = Pipeline(setups, unknown, estimators)
        self._vehicle = vehicle
        self._unconfigured: set[str] = set()
        self._configured = {setup.position for setup in setups}
        self._recorded = (str(recorder.path), recorder.size_bytes) if recorder is not None else ("", 0)
        self._limits = vehicle.thresholds if vehicle is not None else Thresholds()
        self._sensor_ids = sensor_ids(vehicle)
        self._told_alarms: set[tuple[str, str]] = set()
        self._notices.extend(vehicle.notices() if vehicle is not None else ())
        self._notices.extend(effects_notices(effects))
        self._notices.extend(self._watch.findings())

    def notify(self, text: str) -> None:
        """Tell the user something, once, in plain words."""
        self._notices.append(text)
        if self.on_notice is not None:
            self.on_notice(text)

    def add_link(self, name: str) -> None:
        """Show a link before its first item."""
        self._link(name)

    def take(self, item: LinkItem) -> list[RevolutionResult]:
        """Record an item, decode it and return the revolutions that it completes."""
        if self.records_items:
            self._record(lambda recorder: recorder.write(item))
        self._newest_ns = max(self._newest_ns, item.host_ns)
        if isinstance(item, LinkEvent):
            self._event(item)
            return []
        link = self._link(item.link)
        if not link.connected:
            link.connected, link.note = True, "connected"
        link.bytes_received += len(item.data)
        results = self._decoded(item.link, link, link.decoder.feed(item.data), item.host_ns)
        self._diagnosed(item.link, self._watch.findings(), item.host_ns)
        self._diagnosed(item.link, link.diagnosis.data(item.host_ns, item.data, link.decoder.counters), item.host_ns)
        return results

    def _link(self, name: str) -> _Link:
        link = self._links.get(name)
        if link is None:
            diagnosis = LinkDiagnosis(name, lambda hub, wheel: self._pipeline.position(name, hub, wheel))
            link = self._links[name] = _Link(diagnosis, FrameDecoder(self._watch.gate(name)))
        return link

    def _diagnosed(self, name: str, findings: list[str], host_ns: int) -> None:
        """Tell what was found and keep it with the recording."""
        for text in findings:
            self.notify(text)
            entry = {"level": "warning", "text": text, "link": name}
            self._record(lambda recorder, entry=entry: recorder.write_topic("/log", host_ns, entry))  # type: ignore[misc]

    def _event(self, event: LinkEvent) -> None:
        if event.kind is LinkEventKind.MARK:
            self.notify(f"mark: {event.text}")
            return
        link = self._link(event.link)
        link.connected = event.kind in (LinkEventKind.CONNECTED, LinkEventKind.RESTORED)
        if link.connected:
            link.diagnosis.reconnected()
        if event.rssi_dbm is not None:
            link.connected_rssi_dbm = event.rssi_dbm
        if event.kind is not LinkEventKind.RETRYING or link.note != event.text:
            self.notify(f"{event.link}: {event.text}" if event.text else f"{event.link}: {event.kind}")
        link.note = event.text or str(event.kind)

    def _decoded(self, name: str, link: _Link, frames: list[Frame], host_ns: int) -> list[RevolutionResult]:
        for frame in frames:
            if frame.type != MessageType.SAMPLES:
                self._slow(name, link, frame, host_ns)
        return self._deliver(self._pipeline.frames(name, frames, host_ns), host_ns)

    def _slow(self, name: str, link: _Link, frame: Frame, host_ns: int) -> None:
        message = frame.message
        if isinstance(message, Hello):
            self._diagnosed(name, link.diagnosis.hello(frame, host_ns), host_ns)
        elif isinstance(message, HubStatus):
            link.status = message
        elif isinstance(message, LogText):
            self.notify(f"hub {frame.hub} ({log_level(message)}): {message.text}")
        elif isinstance(message, CommandResult) and refusal(message):
            self.notify(f"hub {frame.hub} did not do as told: {refusal(message)}")
        if self.recorder is not None:
            entry = message_topic(frame, self._pipeline.position(name, frame.hub, frame.wheel), name)
            if entry is not None:
                self._record(lambda recorder: recorder.write_topic(entry[0], host_ns, entry[1]))

    def _deliver(self, results: list[RevolutionResult], host_ns: int) -> list[RevolutionResult]:
        for result in results:
            if result.position not in self._configured and result.position not in self._unconfigured:
                self._unconfigured.add(result.position)
                self.notify(unconfigured(result.position, self._vehicle))
            if self.recorder is not None:
                self._record_result(result, host_ns)
            if self.on_result is not None:
                self.on_result(result)
        return results

    def _record_result(self, result: RevolutionResult, host_ns: int) -> None:
        base = f"/wheel/{result.position}"
        self._record(lambda recorder: recorder.write_topic(f"{base}/revolution", host_ns, revolution_payload(result)))
        if host_ns >= self._waveform_due_ns.get(base, 0):
            self._waveform_due_ns[base] = host_ns + _WAVEFORM_EVERY_NS
            average = self._pipeline.average_mps2(result.position)
            if average is not None:
                payload = waveform_payload(result, average)
                self._record(lambda recorder: recorder.write_topic(f"{base}/waveform", host_ns, payload))

    def _record(self, write: Callable[[Recorder], None]) -> None:
        if self.recorder is None:
            return
        try:
            write(self.recorder)
        except RecordingError as error:
            self._stop_recording(error)

    def _stop_recording(self, error: RecordingError) -> None:
        recorder, self.recorder = self.recorder, None
        self.recording_fault = str(error)
        if recorder is not None:
            self._recorded = (str(recorder.path), recorder.size_bytes)
            with suppress(RecordingError):  # the first failure is the one the user needs
                recorder.close()
        self.notify(f"RECORDING STOPPED: {error}. {error.remedy}".rstrip())

    def tick(self, now_ns: int) -> None:
        """Let the recording reach the disk, and silence be noticed, though nothing arrives."""
        self._record(lambda recorder: recorder.tick(now_ns))
        self._diagnosed("", self._watch.tick(now_ns), now_ns)
        for name, link in self._links.items():
            if link.connected:
                self._diagnosed(name, link.diagnosis.tick(now_ns), now_ns)
        self.look_at_sensors()

    def dropped(self, link: str, stages: Mapping[str, int]) -> None:
        """Note what the other stages of the session could not take; the first time is told."""
        known = self._link(link)
        for stage in stages.keys() - known.queue_dropped.keys():
            self.notify(f"{link}: {_BEHIND.get(stage, f'{stage} falls behind')}; what is dropped is counted")
        known.queue_dropped = stages

    def finish(self) -> list[RevolutionResult]:
        """End the session: complete what can be completed, close the recording."""
        results: list[RevolutionResult] = []
        for name, link in self._links.items():
            results += self._decoded(name, link, link.decoder.finish(), self._newest_ns)
        results += self._deliver(self._pipeline.finish(), self._newest_ns)
        self.look_at_sensors()
        self._diagnosed("", self._watch.finish(), self._newest_ns)
        if self.recorder is not None:
            self._record(lambda recorder: recorder.close())
        if self.recorder is not None:
            self._recorded = (str(self.recorder.path), self.recorder.size_bytes)
            self.recorder = None
        return results

    def snapshot(self, elapsed_s: float, *, ended: bool = False) -> SessionSnapshot:
        """Return the latest of everything, immutable."""
        wheels = self._pipeline.wheels()
        links = tuple(self._link_snapshot(name, link) for name, link in self._links.items())
        if self.recorder is not None:
            self._recorded = (str(self.recorder.path), self.recorder.size_bytes)
        found = alarms(wheels, links, self._limits, self._sensor_ids) if not ended else ()
        return SessionSnapshot(elapsed_s, wheels, links, found, tuple(self._notices), *self._recorded, ended)

    def look_at_sensors(self) -> None:
        """Tell what is wrong with sensors, each thing once; `tick` and `finish` do it."""
        wheels = self._pipeline.wheels()
        for alarm in sensor_alarms(alarms(wheels, (), self._limits, self._sensor_ids), wheels):
            if (alarm.position, alarm.name) not in self._told_alarms:
                self._told_alarms.add((alarm.position, alarm.name))
                self._diagnosed("", [f"{alarm.position}: {alarm.text}"], self._newest_ns)

    def _link_snapshot(self, name: str, link: _Link) -> LinkSnapshot:
        counters, status = link.decoder.counters, link.status
        rssi_dbm = status.rssi_dbm if status is not None else None
        return LinkSnapshot(
            link=name,
            connected=link.connected,
            note=link.note,
            bytes_received=link.bytes_received,
            frames=counters.frames,
            crc_errors=counters.crc_errors,
            noise_bytes=counters.noise_bytes,
            frames_lost=counters.lost,
            duplicates=counters.duplicates,
            reordered=counters.reordered,
            skipped=counters.skipped,
            latency_s=self._pipeline.latency_s(name),
            queue_dropped=dict(link.queue_dropped),
            battery_percent=status.battery_percent if status is not None else None,
            rssi_dbm=rssi_dbm if rssi_dbm is not None else link.connected_rssi_dbm,
            supply_w=status.supply_w if status is not None else None,
            judged=self._watch.counts(name),
        )
