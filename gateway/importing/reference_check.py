"""Check of the estimated revolutions of a recording against the references in it."""

from collections.abc import Sequence
from pathlib import Path

from gateway.core.config.vehicle import ASSUMED_RADIUS_MM, VehicleConfig
from gateway.core.estimates.results import AlarmRecord, RevolutionResult, WheelSnapshot
from gateway.core.estimates.sensor_claims import RATE_STD
from gateway.core.reasons import Notice
from gateway.core.recording.reader import RecordingReader
from gateway.core.recording.recorded_file import RecordedFile
from gateway.importing.reference_comparison import ReferenceComparison, TurnLog
from gateway.importing.reference_topic import RecordedReferences
from gateway.importing.views.reference_lines import reference_lines


class ReferenceCheck:
    """Collector of the revolutions of a recording while it is estimated, to compare them with its references."""

    def __init__(self, references: RecordedReferences, vehicle: VehicleConfig | None) -> None:
        """Prepare the check; `vehicle` gives the belt radii and the errors of the rates."""
        self._references = references
        self._turn_logs: dict[str, TurnLog] = {}
        setups = vehicle.wheel_setups() if vehicle is not None else ()
        self._setups = {setup.position: (setup.radius_m, setup.sensor.rate_std) for setup in setups}

    def add(self, result: RevolutionResult) -> None:
        """Add a revolution."""
        self._turn_logs.setdefault(result.position, TurnLog()).add(result.revolution, result.estimates)

    def comparisons(self) -> tuple[ReferenceComparison, ...]:
        """Return the comparison with every reference, by wheel."""
        comparisons = []
        for reference in self._references.references():
            turn_log = self._turn_logs.get(reference.position, TurnLog())
            comparison = turn_log.compare(
                reference.position,
                reference.name,
                reference.quantity,
                reference.times_s,
                reference.values,
                reference.value_std,
                *self._setups.get(reference.position, (ASSUMED_RADIUS_MM * 1e-3, RATE_STD)),
            )
            comparisons.append(comparison)
        return tuple(comparisons)


class _ReferenceLines:
    """Lines of a recording about its references."""

    def __init__(self, file: RecordedFile, vehicle: VehicleConfig | None) -> None:
        self._check: ReferenceCheck | None = None
        if isinstance(file, RecordingReader):  # the dump of a link has no references
            self._check = ReferenceCheck(RecordedReferences(file), vehicle)

    def add(self, result: RevolutionResult) -> None:
        """Take one revolution."""
        if self._check is not None:
            self._check.add(result)

    def finish(
        self, _states: Sequence[WheelSnapshot], _alarms: Sequence[AlarmRecord], _notices: Sequence[Notice]
    ) -> list[str]:
        """Return the lines of every comparison."""
        return reference_lines(self._check.comparisons()) if self._check is not None else []


class ReferenceOutput:
    """Comparison of estimates with references, printed only."""

    def begin(self, file: RecordedFile, vehicle: VehicleConfig | None) -> _ReferenceLines:
        """Return a collector for a recording that is read next."""
        return _ReferenceLines(file, vehicle)

    def write(self) -> None:
        """Do nothing: the lines are in the summaries."""


def open_references(_path: Path | None, *, force: bool) -> ReferenceOutput:  # noqa: ARG001 - the interface of outputs
    """Return the comparison, which every recording has."""
    return ReferenceOutput()
