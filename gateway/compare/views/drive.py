"""What a page shows of a drive, collected revolution by revolution in constant memory."""

from collections.abc import Sequence
from typing import Final, NamedTuple

from gateway.core.config.vehicle import VehicleConfig
from gateway.core.estimates.estimator import Estimate, Status
from gateway.core.estimates.results import AlarmRecord, RevolutionResult, WheelSnapshot
from gateway.core.reasons import Notice
from gateway.core.recording.recorded_file import RecordedFile
from gateway.core.text.numbers import show
from gateway.core.text.readout import DISTANCE
from gateway.core.text.table_sinks import Cell
from gateway.core.text.wheel_rows import WheelRow

MOST_POINTS: Final = 240
"""Revolutions of a wheel that are drawn."""
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


class DriveWheel:
    """One wheel of a drive.

    Attributes:
        row: its means and counts, as in the dataset of a campaign.
        points: estimates of evenly chosen revolutions, at most MOST_POINTS.
        stride: `points` has every stride-th revolution.
        state: last state, None when it is not known.
        rolled: last estimate of the distance that is not invalid, None without one.
    """

    def __init__(self) -> None:
        self.row = WheelRow()
        self.points: list[Point] = []
        self.stride = 1
        self.state: WheelSnapshot | None = None
        self.rolled: Estimate | None = None
        self._revolutions = 0
        self._span_s: tuple[float, float] | None = None
        self._is_after_gap = False

    def add(self, result: RevolutionResult) -> None:
        """Take one revolution."""
        self.row.add(result)
        revolution = result.revolution
        begin_s, end_s = revolution.start_s, revolution.start_s + revolution.period_s
        if not revolution.follows and self._span_s is not None:
            # The hub's time goes back where it has started again.
            self._is_after_gap |= begin_s < self._span_s[0] or begin_s - self._span_s[1] >= _GAP_S
        self._span_s = begin_s, end_s
        usable = [estimate for estimate in result.estimates if estimate.status is not Status.INVALID]
        self.rolled = next((estimate for estimate in usable if estimate.name == DISTANCE), self.rolled)
        if self._revolutions % self.stride == 0:
            values = {
                estimate.name: (estimate.value, estimate.std, estimate.status is Status.VALID) for estimate in usable
            }
            self.points.append(Point(result.host_ns or round(end_s * 1e9), values, self._is_after_gap))
            self._is_after_gap = False
            if len(self.points) > MOST_POINTS:
                self.points = [
                    point._replace(is_after_gap=point.is_after_gap or left_out.is_after_gap)
                    for left_out, point in zip((self.points[0], *self.points[1::2]), self.points[::2], strict=False)
                ]
                self.stride *= 2
        self._revolutions += 1

    def cells(self) -> dict[str, Cell]:
        """Return its means and counts, and the distance with its error and status where an estimator gives it."""
        distance = {"distance": show(self.rolled).text()} if self.rolled is not None else {}
        return {**self.row.cells(self.state, ()), **distance}


class Drive:
    """One recording on its way to a page.

    Attributes:
        name: of the file.
        run: lines of what is stated of the run: test, driver, tags, tires, comments.
        wheels: by position, in the order of their first revolution.
        alarms: of the whole recording.
        notices: contradictions, and what has no result.
    """

    def __init__(self, name: str, run: Sequence[str] = ()) -> None:
        self.name, self.run = name, run
        self.wheels: dict[str, DriveWheel] = {}
        self.alarms: Sequence[AlarmRecord] = ()
        self.notices: Sequence[Notice] = ()

    def add(self, result: RevolutionResult) -> None:
        """Take one revolution."""
        wheel = self.wheels.get(result.position)
        if wheel is None:
            wheel = self.wheels[result.position] = DriveWheel()
        wheel.add(result)

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

    def begin(self, file: RecordedFile, _vehicle: VehicleConfig | None) -> Drive:
        """Return a collector for a recording that is read next."""
        self.drives.append(Drive(file.info.path.name, file.info.described_run().lines()))
        return self.drives[-1]

    def write(self) -> None:
        """Write nothing: a page does, or a comparison."""
