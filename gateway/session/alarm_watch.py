"""Silence and alarms of a session or recording, brought forward in the time of its frames."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import Final

from gateway.config.vehicle import Thresholds, VehicleConfig
from gateway.pipeline.results import (
    Alarm,
    AlarmRecord,
    DiskRoom,
    LinkSnapshot,
    Silence,
    SinkSnapshot,
    WheelSnapshot,
    WheelState,
)
from gateway.reasons import Code, Notice
from gateway.session.alarm_log import AlarmLog
from gateway.session.alarms import AlarmName, alarms, disk_alarm, present_values, sink_alarms, superseded
from gateway.session.silence import PositionOf, SilenceWatch
from gateway.session.wheel_identity import sensor_ids

State = tuple[tuple[WheelSnapshot, ...], tuple[LinkSnapshot, ...]]

REVIEW_INTERVAL_NS: Final = 100_000_000
"""Interval of reviews, in the time of the frames."""
# A link that was never open, or that has ended as it should, is no alarm in the history.
_NORMAL_DOWN: Final = frozenset({Code.LINK_NOT_OPEN, Code.LINK_ENDED})


class AlarmWatch:
    """Reviews the alarms ten times per second of the frames' time, and whenever something falls silent.

    Attributes:
        silence: takes the frames.
        log: history of the alarms.
        sinks: present state of the live outputs.
        disk: what is left of the disk of the recording, None when nothing is recorded.
        witnesses: returns the alarms of what the vehicle's signals contradict.
    """

    def __init__(self, vehicle: VehicleConfig | None, position_of: PositionOf, state: Callable[[], State]) -> None:
        """Start without frames.

        Args:
            vehicle: its thresholds, sensors and positions; None without any.
            position_of: returns the wheel position of link, hub and wheel number.
            state: returns the present snapshots of wheels and links, silence left out.
        """
        self.thresholds = vehicle.thresholds if vehicle is not None else Thresholds()
        configured = [wheel.position for wheel in vehicle.wheel] if vehicle is not None else []
        self.silence = SilenceWatch(position_of, configured, self.thresholds.silent_after_s)
        self.log = AlarmLog()
        self.sinks: tuple[SinkSnapshot, ...] = ()
        self.disk: DiskRoom | None = None
        self.witnesses: Callable[[], Iterable[Alarm]] = tuple
        self._state = state
        self._sensor_ids = sensor_ids(vehicle)
        self._review_due_ns: dict[str, int] = {}

    def advance(self, link: str, now_ns: int) -> list[Notice]:
        """Bring a link to a time before its next frame is taken; return new notices."""
        notices = [notice for _ in self.silence.changes(link, now_ns) for notice in self.review()]
        review_due_ns = self._review_due_ns.get(link, 0)
        if not 0 < review_due_ns - now_ns <= REVIEW_INTERVAL_NS:
            self._review_due_ns[link] = now_ns + REVIEW_INTERVAL_NS
            notices += self.review()
        return notices

    def review(self) -> list[Notice]:
        """Compare the present alarms with those before; return new notices."""
        wheels, links = self._state()
        wheels = self.with_silences(wheels)
        present = [alarm for alarm in self.alarms(wheels, links) if not _is_normal(alarm)]
        return self.log.update(
            present,
            self.silence.elapsed_s(),
            hidden=superseded(
                wheels,
                self.silence.silent_hubs(of_down_links=True),
                self.silence.silent_buses(of_down_links=True),
                several_links=len(links) > 1,
            ),
            values=lambda: present_values(wheels, links, self.thresholds),
        )

    def alarms(self, wheels: Sequence[WheelSnapshot], links: Sequence[LinkSnapshot]) -> tuple[Alarm, ...]:
        """Return the present alarms of wheels, with their silences, of links and of live outputs."""
        standing = self.log.standing()
        found = alarms(
            wheels,
            links,
            self.thresholds,
            self._sensor_ids,
            silent_hubs=self.silence.silent_hubs(),
            silent_buses=self.silence.silent_buses(),
            standing=standing,
        )
        of_disk = disk_alarm(self.disk, standing)
        return (*found, *self.witnesses(), *sink_alarms(self.sinks), *of_disk)

    def records(self) -> tuple[AlarmRecord, ...]:
        """Return the history of every alarm."""
        return self.log.records()

    def with_silences(self, wheels: Sequence[WheelSnapshot]) -> tuple[WheelSnapshot, ...]:
        """Return wheels with what is silent of them."""
        found = self.silence.of_wheels()
        return tuple(silenced(wheel, found[wheel.position]) if wheel.position in found else wheel for wheel in wheels)


def silenced(wheel: WheelSnapshot, silences: tuple[Silence, ...]) -> WheelSnapshot:
    """Return a wheel with its silences; a wheel that has never had data stays without data."""
    stops = any(silence.stops_numbers for silence in silences)
    state = WheelState.SILENT if stops and wheel.state is not WheelState.NO_DATA else wheel.state
    return replace(wheel, state=state, silences=silences)


def _is_normal(alarm: Alarm) -> bool:
    return alarm.name == AlarmName.LINK and any(reason.code in _NORMAL_DOWN for reason in alarm.reason)
