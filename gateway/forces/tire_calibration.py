"""Calibration of load and reference numbers for programs."""

from collections.abc import Callable, Sequence
from pathlib import Path

from gateway.core.estimates.tire_data import ReferenceNumbers
from gateway.core.recording.file_content import check_distinct
from gateway.core.session.program_arguments import Config, PathLike, chosen_vehicle, paths
from gateway.core.text.output_file import write_whole
from gateway.forces.calibration_points import (
    ESTIMATOR,
    calibration_toml,
    fit_lines,
    no_points_error,
    recording_points,
)
from gateway.forces.tire_fit import LoadFit, TirePoint, fit_load_calibration, reference_numbers


class TireCalibration:
    """Load calibration of a tire; `str()` is the report of `treadlink calibrate`.

    Attributes:
        points: the wheels of recordings that were used.
        fit: load against the tire's numbers, with its errors.
        reference: numbers of the new tire, for wear.
        left_out: wheels that could not be used, with the reason.
    """

    def __init__(
        self, points: Sequence[TirePoint], fit: LoadFit, reference: ReferenceNumbers, left_out: Sequence[str]
    ) -> None:
        """Keep the results."""
        self.points, self.fit, self.reference, self.left_out = tuple(points), fit, reference, tuple(left_out)

    @property
    def toml(self) -> str:
        """The tables for the vehicle configuration."""
        return calibration_toml(self.fit.calibration, self.reference)

    def save(self, path: PathLike) -> None:
        """Write the tables to a new file.

        Raises:
            OutputError: it exists or cannot be written.
        """
        write_whole(Path(path), self.toml)

    def __str__(self) -> str:
        return "\n".join(fit_lines(self.points, self.fit, self.reference))

    def __repr__(self) -> str:
        return f"<TireCalibration: {len(self.points)} wheels, {len(self.left_out)} left out>"


def calibrate(
    recordings: PathLike | Sequence[PathLike],
    *,
    config: Config | None = None,
    wheels: Sequence[str] = (),
    on_left_out: Callable[[str], None] = lambda _reason: None,
) -> TireCalibration:
    """Calibrate load and reference numbers from recordings with known loads, as `treadlink calibrate load`.

    Args:
        recordings: files of tires of one kind.
        config: vehicle configuration for recordings without one.
        wheels: positions to use; all when empty.
        on_left_out: called with the reason for each wheel that cannot be used, as soon as it is known.

    Raises:
        TreadlinkError: a recording cannot be read or is given twice, or no wheel can be used.
    """
    file_paths = paths(recordings)
    check_distinct(file_paths)
    fallback = chosen_vehicle(config, (), "calibrate") if config is not None else None
    left_out: list[str] = []

    def leave_out(reason: str) -> None:
        left_out.append(reason)
        on_left_out(reason)

    points = [point for path in file_paths for point in recording_points(path, fallback, wheels, leave_out)]
    if not points:
        raise no_points_error(wheels)
    return TireCalibration(points, fit_load_calibration(points), reference_numbers(points, ESTIMATOR), left_out)
