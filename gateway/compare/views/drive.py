"""What a page shows of a drive, collected revolution by revolution in bounded memory."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from gateway.compare.views.drive_path import WheelPath
from gateway.core.config.vehicle import VehicleConfig, shown_units_of
from gateway.core.estimates.estimator import Estimate, Status
from gateway.core.estimates.results import AlarmRecord, RevolutionResult, WheelSnapshot
from gateway.core.estimates.weighted_mean import MeanEstimate
from gateway.core.links.source import LinkEvent
from gateway.core.reasons import Notice
from gateway.core.recording.mcap_layout import MARKS_TOPIC, RecordedMessage, link_items
from gateway.core.recording.reader import RecordingReader
from gateway.core.recording.recorded_file import RecordedFile
from gateway.core.session.session_parts import RigChannels, open_rig_channels
from gateway.core.shown_units import ShownUnits
from gateway.core.text.numbers import show
from gateway.core.text.readout import DISTANCE, SPEED
from gateway.core.text.table_sinks import Cell
from gateway.core.text.wheel_rows import WheelRow
from gateway.core.types import FloatArray
from gateway.planner.uncertainty_budget import LatestRevolutions

MAX_POINTS: Final = 480
"""Revolutions of a wheel that are drawn."""
MAX_WAVEFORMS: Final = 64
"""Waveforms of a wheel at even times, and again for alarms and marks."""
MEASURED: Final = ("pressure_pa", "temperature_degc")
"""Conditions that are drawn."""
_WAVEFORM_INTERVAL_S: Final = 60.0
_WAVEFORM_POINTS: Final = 240
# Time without revolutions from which they are drawn apart.
_GAP_S: Final = 2.0


class Point(NamedTuple):
    """Estimates of a revolution.

    Attributes:
        time_ns: its end by the computer's clock, or by the hub's where the recording has no other.
        values: value, standard error and whether it is valid, by quantity; without what is invalid.
        is_after_gap: whether there were no revolutions for a time since the point before.
    """

    time_ns: int
    values: dict[str, tuple[float, float, bool]]
    is_after_gap: bool = False


class Gap(NamedTuple):
    """A time without revolutions of a wheel.

    Attributes:
        begin_ns: end of the last revolution before it, as `Point.time_ns`.
        end_ns: begin of the next one.
        silent_s: time of it for which the sensor was silent; 0 for a wheel that stood still.
    """

    begin_ns: int
    end_ns: int
    silent_s: float


class Waveform(NamedTuple):
    """The radial axis of one revolution.

    Attributes:
        time_ns: as `Point.time_ns`.
        cause: alarm or mark that it is kept for; empty at even times.
        angle_rad: (n,) 0 at the contact centre.
        radial_mps2: (n,) as `Revolution.radial_mps2`.
    """

    time_ns: int
    cause: str
    angle_rad: FloatArray
    radial_mps2: FloatArray


class DriveWheel:
    """One wheel of a drive.

    Attributes:
        row: its means and counts, as in the dataset of a campaign.
        points: estimates of evenly chosen revolutions, at most MAX_POINTS.
        stride: `points` has every stride-th revolution.
        spans: smallest and largest valid value by quantity.
        gaps: times without revolutions, at most MAX_POINTS.
        waveforms: at even times, at most MAX_WAVEFORMS.
        marked_waveforms: of alarms and marks, at most MAX_WAVEFORMS.
        state: last state, None when it is not known.
        rolled: last estimate of the distance that is not invalid, None without one.
        path: by its speed and turn rate.
        radius_source: whether the belt radius is stated or assumed.
    """

    def __init__(self, radius_source: str = "stated") -> None:
        self.radius_source = radius_source
        self.row = WheelRow()
        self.points: list[Point] = []
        self.stride = 1
        self.spans: dict[str, tuple[float, float]] = {}
        self.gaps: list[Gap] = []
        self.waveforms: list[Waveform] = []
        self.marked_waveforms: list[Waveform] = []
        self.state: WheelSnapshot | None = None
        self.rolled: Estimate | None = None
        self.path = WheelPath()
        self._revolutions = 0
        self._span_s: tuple[float, float] | None = None
        self._time_ns = 0
        self._is_after_gap = False
        self._alarms: frozenset[str] = frozenset()
        self._interval_s = _WAVEFORM_INTERVAL_S

    def add(self, result: RevolutionResult, marks: Sequence[str] = ()) -> None:
        """Take one revolution, and the marks that were set since the one before."""
        self.row.add(result)
        time_ns = result.host_ns or round((result.revolution.start_s + result.revolution.period_s) * 1e9)
        self._note_gap(result, time_ns)
        self.path.add(result, time_ns)
        usable = [estimate for estimate in result.estimates if estimate.status is not Status.INVALID]
        self.rolled = next((estimate for estimate in usable if estimate.name == DISTANCE), self.rolled)
        for estimate in usable:
            if estimate.status is Status.VALID:
                low, high = self.spans.get(estimate.name, (math.inf, -math.inf))
                self.spans[estimate.name] = min(low, estimate.value), max(high, estimate.value)
        if self._revolutions % self.stride == 0:
            values = {
                estimate.name: (estimate.value, estimate.std, estimate.status is Status.VALID) for estimate in usable
            }
            self.points.append(Point(time_ns, {**_measured(result), **values}, self._is_after_gap))
            self._is_after_gap = False
            if len(self.points) > MAX_POINTS:
                self.points = [
                    point._replace(is_after_gap=point.is_after_gap or left_out.is_after_gap)
                    for left_out, point in zip((self.points[0], *self.points[1::2]), self.points[::2], strict=False)
                ]
                self.stride *= 2
        self._keep_waveforms(result, time_ns, marks)
        self._revolutions += 1
        self._time_ns = time_ns

    def _note_gap(self, result: RevolutionResult, time_ns: int) -> None:
        revolution = result.revolution
        begin_s, end_s = revolution.start_s, revolution.start_s + revolution.period_s
        if not revolution.follows and self._span_s is not None:
            # The hub's time goes back where it has started again.
            is_gap = begin_s < self._span_s[0] or begin_s - self._span_s[1] >= _GAP_S
            self._is_after_gap |= is_gap
            if is_gap and len(self.gaps) < MAX_POINTS:
                begin_ns = time_ns - round(revolution.period_s * 1e9)
                self.gaps.append(Gap(self._time_ns, begin_ns, result.silent_before_s))
        self._span_s = begin_s, end_s

    def _keep_waveforms(self, result: RevolutionResult, time_ns: int, marks: Sequence[str]) -> None:
        alarms = frozenset(alarm.name for alarm in result.alarms)
        causes = [*sorted(alarms - self._alarms), *marks]
        self._alarms = alarms
        if causes and len(self.marked_waveforms) < MAX_WAVEFORMS:
            self.marked_waveforms.append(_waveform(result, time_ns, ", ".join(causes)))
        is_due = not self.waveforms or abs(time_ns - self.waveforms[-1].time_ns) >= self._interval_s * 1e9
        if is_due and not result.revolution.faults:
            self.waveforms.append(_waveform(result, time_ns, ""))
            if len(self.waveforms) > MAX_WAVEFORMS:
                self.waveforms = self.waveforms[::2]
                self._interval_s *= 2.0

    def cells(self) -> dict[str, Cell]:
        """Return its means and counts, the status of the speed, and the distance where an estimator gives it."""
        cells = self.row.cells(self.state, ())
        if self.state is not None:
            counters = self.state.counters
            cells |= {"lost_while_heard": counters.lost_while_heard, "silent_s": counters.silent_s}
        *_, status, _ = dict(self.row.quantities()).get(SPEED, (None, None))
        cells["speed_status"] = status
        if status == Status.INVALID:
            cells |= dict.fromkeys(("speed_mean_mps", "speed_min_mps", "speed_max_mps"))
        if self.rolled is not None:
            cells["distance"] = show(self.rolled).text()
        if self.row.conditions is not None:
            cells |= {"radius_std_m": self.row.conditions.radius_std_m, "radius_source": self.radius_source}
        return cells


def _measured(result: RevolutionResult) -> dict[str, tuple[float, float, bool]]:
    """Return pressure and temperature of a revolution where they were measured."""
    conditions = result.conditions
    pressure, temperature = MEASURED
    measured = {
        pressure: (conditions.pressure_pa, conditions.pressure_std_pa),
        temperature: (conditions.temperature_degc, math.nan),
    }
    return {name: (value, std, True) for name, (value, std) in measured.items() if value is not None}


def _waveform(result: RevolutionResult, time_ns: int, cause: str) -> Waveform:
    radial_mps2 = result.revolution.radial_mps2
    chosen = np.unique(np.linspace(0, len(radial_mps2) - 1, min(len(radial_mps2), _WAVEFORM_POINTS)).astype(int))
    return Waveform(time_ns, cause, 2.0 * np.pi * chosen / len(radial_mps2) - np.pi, radial_mps2[chosen])


class Drive:
    """One recording on its way to a page.

    Attributes:
        name: of the file.
        run: lines of what is stated of the run: test, driver, tags, tires, comments.
        start_ns: start of the session, which the times of alarms count from; None when it is not known.
        wheels: by position, in the order of their first revolution.
        marks: time and text of each, in order.
        alarms: of the whole recording.
        notices: contradictions, and what has no result.
        latest: revolutions of the wheels of a vehicle.
        units: that its page shows.
    """

    def __init__(self, name: str, run: Sequence[str] = (), start_ns: int | None = None) -> None:
        self.name, self.run, self.start_ns = name, run, start_ns
        self.wheels: dict[str, DriveWheel] = {}
        self.marks: list[tuple[int, str]] = []
        self.alarms: Sequence[AlarmRecord] = ()
        self.notices: Sequence[Notice] = ()
        self._marks_taken: dict[str, int] = {}
        self._rig: RigChannels | None = None
        self._turns: dict[str, list[tuple[float, float]]] = {}
        self._radius_source = "assumed"
        self.latest = LatestRevolutions(())
        self.units = ShownUnits.SI

    @classmethod
    def of(cls, file: RecordedFile, vehicle: VehicleConfig | None = None) -> Drive:
        """Return a collector for a recording, which also takes the marks that the file is read with."""
        drive = cls(file.info.path.name, file.info.described_run().lines(), file.info.start_ns)
        drive.units = shown_units_of(vehicle)
        if vehicle is not None:
            drive.latest = LatestRevolutions(vehicle.wheel_setups())
            if not any("radius" in text for text in vehicle.vehicle.assumed):
                drive._radius_source = "stated"
        if isinstance(file, RecordingReader):
            file.watch(drive.take_mark)
            drive._rig = open_rig_channels(file)
        return drive

    def take_mark(self, message: RecordedMessage) -> None:
        """Take a message of the recording if it is a mark."""
        if message.channel.topic == MARKS_TOPIC and len(self.marks) < MAX_POINTS:
            self.marks += [(item.host_ns, item.text) for item in link_items(message) if isinstance(item, LinkEvent)]

    def add(self, result: RevolutionResult) -> None:
        """Take one revolution."""
        wheel = self.wheels.get(result.position)
        if wheel is None:
            wheel = self.wheels[result.position] = DriveWheel(self._radius_source)
        begin = end = self._marks_taken.get(result.position, 0)
        while end < len(self.marks) and self.marks[end][0] <= result.host_ns:
            end += 1
        self._marks_taken[result.position] = end
        if not result.revolution.faults:
            self._turns.setdefault(result.position, []).append((result.revolution.start_s, result.revolution.period_s))
        wheel.add(result, [text for _, text in self.marks[begin:end]])
        self.latest.add(result)

    def rig_means(self, position: str) -> dict[str, MeanEstimate]:
        """Return the means of the rig's channels at the revolutions of a wheel, after the last one."""
        return self._rig.means(position, self._turns.get(position, ())) if self._rig is not None else {}

    def finish(
        self, states: Sequence[WheelSnapshot], alarms: Sequence[AlarmRecord], notices: Sequence[Notice]
    ) -> tuple[str, ...]:
        """Take what is complete at the end of a pass: last states of the wheels, alarms and notices; no lines."""
        self.alarms, self.notices = alarms, notices
        for state in states:
            if state.position in self.wheels:
                self.wheels[state.position].state = state
        return ()


class Drives:
    """Recordings on their way to a page, in the order in which they were read."""

    def __init__(self) -> None:
        """Start without a recording."""
        self.drives: list[Drive] = []

    def begin(self, file: RecordedFile, vehicle: VehicleConfig | None) -> Drive:
        """Return a collector for a recording that is read next."""
        self.drives.append(Drive.of(file, vehicle))
        return self.drives[-1]

    def write(self) -> None:
        """Write nothing: a page does, or a comparison."""
