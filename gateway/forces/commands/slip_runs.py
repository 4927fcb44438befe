"""Runs of `treadlink calibrate slip` from recordings, the report of the fit, and its table for the configuration."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from gateway.core.config.si_values import rounded, table_values
from gateway.core.config.toml_writer import toml_text
from gateway.core.errors import CalibrationError
from gateway.core.estimates.results import RevolutionResult
from gateway.core.revolutions.sensor_mounting import RollCalibration
from gateway.forces.commands.calibration_runs import read_runs, rig_mean, run_name
from gateway.forces.known_runs import PRESSURE_KPA, SlipRunsFile
from gateway.forces.slip_calibration import SlipCalibration
from gateway.forces.slip_fit import MIN_REVOLUTIONS, SlipFit, SlipRun, SlipRunRevolutions
from gateway.forces.tire_tables import SlipCalibrationTable

# The first revolutions of a wheel are timed without a running average to compare them with.
_SKIPPED_REVOLUTIONS: Final = 5
# Memory of the roll calibration: all runs count alike.
_ALL_REVOLUTIONS: Final = 1e9


def measured_runs(path: Path, runs: SlipRunsFile, fallback: Path | None) -> list[SlipRun]:
    """Return the measurement of every run.

    Args:
        path: of the runs file.
        runs: its content.
        fallback: vehicle configuration for recordings without one.

    Raises:
        TreadlinkError: a recording cannot be read or has no vehicle configuration.
        CalibrationError: a run cannot be used; every run counts, so none is left out silently.
    """
    roll = RollCalibration(horizon_revolutions=_ALL_REVOLUTIONS)
    measurements = [SlipRunRevolutions(roll) for _ in runs.run]
    intervals_s: list[list[tuple[float, float]]] = [[] for _ in runs.run]
    positions: dict[int, str] = {}

    def take(index: int, result: RevolutionResult) -> None:
        if measurements[index].add(result.revolution, result.conditions) and runs.run[index].slip_deg is None:
            intervals_s[index].append((result.revolution.start_s, result.revolution.period_s))
            positions[index] = result.position

    # One sensor on one tire: roll, yaw and share are those of all runs.
    wheels = [runs.wheel] * len(measurements)
    rigs = read_runs(path, runs.run, wheels, ("kinematic",), fallback, take, skipped_revolutions=_SKIPPED_REVOLUTIONS)
    for run, measured in zip(runs.run, measurements, strict=True):
        _check_usable(run_name(run), measured)
    slips = []
    for index, (run, rig) in enumerate(zip(runs.run, rigs, strict=True)):
        std_rad = math.radians(runs.slip_std_deg if run.slip_std_deg is None else run.slip_std_deg)
        if run.slip_deg is not None:
            slips.append((math.radians(run.slip_deg), std_rad))
            continue
        mean = rig_mean(run_name(run), rig, positions.get(index, ""), "slip_angle", intervals_s[index])
        slips.append((mean.value, math.hypot(mean.std, std_rad)))
    return [
        measured.run(run_name(run), *slip, is_reverse=run.direction == "reverse")
        for run, measured, slip in zip(runs.run, measurements, slips, strict=True)
    ]


def _check_usable(name: str, measured: SlipRunRevolutions) -> None:
    if measured.offered and not measured.has_lateral:
        raise CalibrationError(f"{name}: the sensor has no lateral axis", "Slip needs a sensor with a lateral axis.")
    if measured.count < MIN_REVOLUTIONS:
        raise CalibrationError(
            f"{name}: {measured.count} of {measured.offered} revolutions can be used, {MIN_REVOLUTIONS} are required",
            "Record longer, or correct from_s and to_s. `treadlink inspect` shows what the recording contains.",
        )


def slip_lines(runs: Sequence[SlipRun], fit: SlipFit) -> list[str]:
    """Return the fit as a table with its validity."""
    width = max(len("run"), *(len(run.name) for run in runs))
    lines = [f"{'run':<{width}}  rolling  revs  slip deg  slope deg     std  residual  pull  left out"]
    for run, residual, pull, left_out in zip(runs, fit.residual_rad, fit.pulls, fit.left_out, strict=True):
        left_out_text = f"{left_out:+8.1f}" if math.isfinite(left_out) else "       -"
        lines.append(
            f"{run.name:<{width}}  {'reverse' if run.is_reverse else 'forward'} {run.revolutions:5d}  "
            f"{math.degrees(run.slip_rad):+8.2f} {math.degrees(run.slope_rad):+10.4f} "
            f"{math.degrees(run.noise_std_rad):7.4f} {math.degrees(residual):+9.4f} {pull:+5.1f}  {left_out_text}"
        )
    law = fit.calibration
    if fit.degrees_of_freedom > 0:
        check = (
            f"chi-square {fit.chi_square:.1f}, degrees of freedom {fit.degrees_of_freedom}, probability "
            f"{fit.probability:.2g}"
        )
    else:
        check = "no check: the runs are just enough for the unknowns; one more run would check the law"
    lines += [
        "",
        f"belt share      {law.belt_share:.4f} ± {law.belt_share_std:.4f}, less "
        f"{math.radians(1e2 * law.saturation_prad):.1f} ± {math.radians(1e2 * law.saturation_std_prad):.1f} % per "
        "degree of slip",
        f"zero, forward   {_degrees(law.zero_rad, law.zero_std_rad)}: ply steer plus conicity",
    ]
    if law.ply_steer_rad is not None and law.conicity_rad is not None:
        lines += [
            f"ply steer       {_degrees(law.ply_steer_rad, law.ply_steer_std_rad)}, changes sign in reverse",
            f"conicity        {_degrees(law.conicity_rad, law.conicity_std_rad)}, the same in reverse",
        ]
    else:
        lines.append("ply steer and conicity are not separated: no run rolls in reverse")
    _, slip_std = law.slip_at(law.zero_rad, 0.0)
    lines += [
        f"slip angle      ± {math.degrees(slip_std):.3f} deg at zero slip by the calibration alone",
        check,
        _validity(law),
    ]
    return lines


def _validity(calibration: SlipCalibration) -> str:
    slips, halves = calibration.slip_range_rad, calibration.half_angle_range_rad
    low, high = _pressures_kpa(calibration)
    pressure = f", {low:.0f} to {high:.0f} kPa" if (low, high) != PRESSURE_KPA else ""
    return (
        f"valid for slip of {math.degrees(slips[0]):+.2f} to {math.degrees(slips[1]):+.2f} deg, half angles of "
        f"{math.degrees(halves[0]):.2f} to {math.degrees(halves[1]):.2f} deg{pressure}, this tire and sensor as mounted"
    )


def _degrees(value_rad: float, std_rad: float) -> str:
    return f"{math.degrees(value_rad):+.4f} ± {math.degrees(std_rad):.4f} deg"


def _pressures_kpa(calibration: SlipCalibration) -> tuple[float, float]:
    low, high = calibration.pressure_range_pa
    return (1e-3 * low, 1e-3 * high) if math.isfinite(high) else PRESSURE_KPA


def slip_toml(calibration: SlipCalibration) -> str:
    """Return the table for the vehicle configuration, checked against its schema."""
    low_kpa, high_kpa = _pressures_kpa(calibration)
    fields = table_values(SlipCalibrationTable, calibration)
    fields |= {"pressure_min_kpa": rounded(low_kpa), "pressure_max_kpa": rounded(high_kpa)}
    if calibration.ply_steer_rad is None or calibration.conicity_rad is None:
        for key in ("ply_steer_deg", "ply_steer_std_deg", "conicity_deg", "conicity_std_deg"):
            fields.pop(key, None)
    table = SlipCalibrationTable(**fields)
    return toml_text({"tire": {"slip_calibration": table.model_dump(include=set(fields))}})
