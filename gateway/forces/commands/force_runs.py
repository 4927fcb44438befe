"""Runs of `treadlink calibrate side-force` from recordings, the report of the fit, and its table."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np

from gateway.core.config.si_values import rounded
from gateway.core.config.toml_writer import toml_text
from gateway.core.errors import CalibrationError
from gateway.core.estimates.estimator import Estimate, Status
from gateway.core.estimates.results import RevolutionResult
from gateway.core.session.session_parts import RigChannels
from gateway.forces.commands.calibration_runs import read_runs, rig_mean, run_name
from gateway.forces.known_runs import ForceRunsFile, ForceRunTable, check_pressure
from gateway.forces.side_force import HORIZON_REVOLUTIONS, scale_stds
from gateway.forces.side_force_calibration import LinearLaw, SideForceCalibration, fit_linear_law
from gateway.forces.tire_tables import SideForceCalibrationTable

# Revolutions between two values of the running mean that are taken: beyond twice its memory they are independent.
_STRIDE: Final = round(2.0 * HORIZON_REVOLUTIONS)
MIN_REVOLUTIONS: Final = 20
# First revolutions of a part, over which the mean forgets the force before it.
_REMEMBERED: Final = round(3.0 * HORIZON_REVOLUTIONS)
# Largest relative error of a calibrated factor; beyond it the runs determine nothing.
_LARGEST_ERROR: Final = 1.0 / 3.0


@dataclass(slots=True)
class ForceRun:
    """Displacements of the belt in one run.

    Attributes:
        name: shown to the user.
        table: the run as stated.
        shifts: estimates of the shift, one for each valid revolution, without the errors of its scale.
        yaws: of the yaw.
        halves_rad: contact half angles.
        turns: position, begin by the hub's time and duration of each, s.
        force_n: side force as stated, or that of the rig.
        force_std_n: its standard error.
        offered: revolutions, usable or not.
        averaged: those that the running mean has taken.
    """

    name: str
    table: ForceRunTable
    shifts: list[Estimate] = field(default_factory=list)
    yaws: list[Estimate] = field(default_factory=list)
    halves_rad: list[float] = field(default_factory=list)
    pressures_pa: list[float] = field(default_factory=list)
    turns: list[tuple[str, float, float]] = field(default_factory=list)
    force_n: float = math.nan
    force_std_n: float = math.nan
    offered: int = 0
    averaged: int = 0

    def take(self, result: RevolutionResult) -> None:
        """Add a revolution."""
        self.offered += 1
        estimates = {estimate.name: estimate for estimate in result.estimates}
        shift, yaw = estimates.get("belt_shift_m"), estimates.get("belt_yaw_rad")
        if shift is None or yaw is None or shift.status is Status.INVALID or yaw.status is Status.INVALID:
            return
        self.averaged += 1
        if self.table.from_s and self.averaged <= _REMEMBERED:
            return
        for estimates_of, estimate, scale_std in zip(
            (self.shifts, self.yaws), (shift, yaw), scale_stds(result.conditions), strict=True
        ):
            variance = estimate.std**2 - (scale_std * estimate.value) ** 2
            estimates_of.append(estimate._replace(std=math.sqrt(max(variance, estimate.scatter_std**2))))
        self.halves_rad.append(0.5 * (result.revolution.trailing_edge_rad - result.revolution.leading_edge_rad))
        self.turns.append((result.position, result.revolution.start_s, result.revolution.period_s))
        if result.conditions.pressure_pa is not None:
            self.pressures_pa.append(result.conditions.pressure_pa)

    def take_force(self, rig: RigChannels, stated_std_n: float) -> None:
        """Take the force as stated, or that of the rig at the revolutions used."""
        self.force_std_n = stated_std_n
        if self.table.side_force_n is not None:
            self.force_n = self.table.side_force_n
            return
        intervals_s = [(start, period) for _, start, period in self.turns]
        mean = rig_mean(self.name, rig, self.turns[0][0], "side_force", intervals_s)
        self.force_n, self.force_std_n = mean.value, math.hypot(mean.std, stated_std_n)

    @property
    def half_angle_rad(self) -> float:
        """Median contact half angle."""
        return float(np.median(self.halves_rad))


def measured_force_runs(path: Path, runs: ForceRunsFile, fallback: Path | None) -> list[ForceRun]:
    """Return the measurement of every run.

    Args:
        path: of the runs file.
        runs: its content.
        fallback: vehicle configuration for recordings without one.

    Raises:
        TreadlinkError: a recording cannot be read or has no vehicle configuration.
        CalibrationError: a run cannot be used; every run counts, so none is left out silently.
    """
    measured = [ForceRun(run_name(run), run) for run in runs.run]
    wheels = [run.wheel or runs.wheel for run in runs.run]
    estimators = ("kinematic", "side-force")
    rigs = read_runs(path, runs.run, wheels, estimators, fallback, lambda index, result: measured[index].take(result))
    for run, rig in zip(measured, rigs, strict=True):
        if len(run.shifts) < MIN_REVOLUTIONS:
            part_note = f" after the first {_REMEMBERED} of a part" if run.table.from_s else ""
            raise CalibrationError(
                f"{run.name}: {len(run.shifts)} of {run.offered} revolutions can be used, "
                f"{MIN_REVOLUTIONS} are required{part_note}",
                "Record longer, correct from_s and to_s, or use a sensor with a lateral axis.",
            )
        check_pressure(run.name, float(np.mean(run.pressures_pa)) if run.pressures_pa else None)
        run.take_force(rig, runs.side_force_std_n)
    return measured


def fit_side_force(runs: Sequence[ForceRun], stated: ForceRunsFile) -> SideForceCalibration:
    """Fit side force over shift, and moment over yaw where every run states one.

    Raises:
        CalibrationError: the runs do not determine a factor.
    """
    shifts = [_mean(run.shifts) for run in runs]
    side = _fit("side force", shifts, [run.force_n for run in runs], [run.force_std_n for run in runs])
    moments = [run.table.aligning_moment_nm for run in runs]
    stated_moments = [moment for moment in moments if moment is not None]
    if stated_moments and len(stated_moments) < len(moments):
        raise CalibrationError(
            f"{len(stated_moments)} of {len(moments)} runs state an aligning moment",
            "State aligning_moment_nm in all, or none.",
        )
    law = None
    if stated_moments:
        stds = [stated.aligning_moment_std_nm] * len(runs)
        law = _fit("aligning moment", [_mean(run.yaws) for run in runs], stated_moments, stds)
    halves = [run.half_angle_rad for run in runs]
    pressures = [float(np.mean(run.pressures_pa)) for run in runs if run.pressures_pa]
    is_known = len(pressures) == len(runs)
    return SideForceCalibration(
        side, law, (min(halves), max(halves)), (min(pressures), max(pressures)) if is_known else None
    )


def _mean(estimates: Sequence[Estimate]) -> tuple[float, float]:
    """Return the mean of independent values of a running mean, and its standard error."""
    chosen = estimates[::-_STRIDE]
    value, constant_std = np.mean([(estimate.value, estimate.constant_std) for estimate in chosen], axis=0).tolist()
    scatter_std = math.sqrt(sum(estimate.scatter_std**2 for estimate in chosen)) / len(chosen)
    return value, math.hypot(constant_std, scatter_std)


def _fit(
    label: str, displaced: Sequence[tuple[float, float]], forces: Sequence[float], stds: Sequence[float]
) -> LinearLaw:
    if float(np.ptp(np.asarray(forces))) == 0.0:
        raise CalibrationError(f"the {label} is the same in all runs", "Add a run at another one.")
    law = fit_linear_law(
        [displacement for displacement, _ in displaced], [error for _, error in displaced], forces, stds
    )
    if not law.factor_std < _LARGEST_ERROR * abs(law.factor):
        raise CalibrationError(
            f"the runs do not determine the {label}: the standard error is {law.factor_std / abs(law.factor):.2g} times"
            " the factor",
            "Use runs of larger forces, or longer ones. Check the signs: forces are positive to the left.",
        )
    return law


def force_lines(runs: Sequence[ForceRun], calibration: SideForceCalibration) -> list[str]:
    """Return the fit as a table with its validity."""
    width = max(len("run"), *(len(run.name) for run in runs))
    lines = [f"{'run':<{width}}   revs  shift mm      std  side force N  residual  yaw deg  moment N m  residual"]
    for run in runs:
        shift, shift_std = _mean(run.shifts)
        yaw, _ = _mean(run.yaws)
        moment = ""
        if calibration.moment is not None and run.table.aligning_moment_nm is not None:
            fitted, _ = calibration.moment.force(yaw, 0.0)
            moment_nm = run.table.aligning_moment_nm
            moment = f" {moment_nm:+11.1f} {fitted - moment_nm:+9.1f}"
        fitted, _ = calibration.side.force(shift, 0.0)
        force = run.force_n
        lines.append(
            f"{run.name:<{width}} {len(run.shifts):6d} {1e3 * shift:+9.4f} {1e3 * shift_std:8.4f} {force:+13.0f} "
            f"{fitted - force:+9.0f} {math.degrees(yaw):+8.4f}{moment}"
        )
    side = calibration.side
    lines += [
        "",
        f"side force       {1e-3 * side.factor:.2f} ± {1e-3 * side.factor_std:.2f} N/mm, zero at "
        f"{1e3 * side.zero:+.4f} ± {1e3 * side.zero_std:.4f} mm",
    ]
    if calibration.moment is None:
        lines.append("aligning moment  not calibrated: the runs state none")
    else:
        law, degree = calibration.moment, math.radians(1.0)
        lines.append(
            f"aligning moment  {law.factor * degree:.2f} ± {law.factor_std * degree:.2f} N m/deg, zero at "
            f"{law.zero / degree:+.5f} ± {law.zero_std / degree:.5f} deg"
        )
    low, high = (math.degrees(angle) for angle in calibration.half_angle_range_rad)
    if len(runs) == 2:
        lines.append("no check: two runs are just enough; one more would check the law")
    pressures = "at an unknown pressure"
    if calibration.pressure_range_pa is not None:
        pressures = "{:.0f} to {:.0f} kPa".format(*(1e-3 * pressure for pressure in calibration.pressure_range_pa))
    lines.append(f"valid for half angles of {low:.2f} to {high:.2f} deg, {pressures}, this tire and sensor as mounted")
    return lines


def force_toml(calibration: SideForceCalibration) -> str:
    """Return the table for the vehicle configuration, checked against its schema."""
    degree = math.radians(1.0)
    moment: dict[str, float] = {}
    if calibration.moment is not None:
        moment = {
            "moment_nm_per_deg": rounded(calibration.moment.factor * degree),
            "moment_std_nm_per_deg": rounded(calibration.moment.factor_std * degree),
            "yaw_zero_deg": rounded(calibration.moment.zero / degree),
            "yaw_zero_std_deg": rounded(calibration.moment.zero_std / degree),
        }
    fields = {
        "side_n_per_mm": rounded(1e-3 * calibration.side.factor),
        "side_std_n_per_mm": rounded(1e-3 * calibration.side.factor_std),
        "shift_zero_mm": rounded(1e3 * calibration.side.zero),
        "shift_zero_std_mm": rounded(1e3 * calibration.side.zero_std),
        **moment,
        "half_angle_min_rad": rounded(calibration.half_angle_range_rad[0]),
        "half_angle_max_rad": rounded(calibration.half_angle_range_rad[1]),
    }
    if calibration.pressure_range_pa is not None:
        low_pa, high_pa = calibration.pressure_range_pa
        fields |= {"pressure_min_kpa": rounded(1e-3 * low_pa), "pressure_max_kpa": rounded(1e-3 * high_pa)}
    table = SideForceCalibrationTable(**fields)
    return toml_text({"tire": {"side_force_calibration": table.model_dump(include=set(fields))}})
