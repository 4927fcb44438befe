"""Points of a tire calibration from recordings, the report of its fit, and its tables for the configuration."""

import math
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Final

import numpy as np

from gateway.core.config.si_values import table_values
from gateway.core.config.toml_writer import toml_text
from gateway.core.config.vehicle import LoadCalibrationTable, Reference, VehicleConfig
from gateway.core.errors import ConfigError, TreadlinkError
from gateway.core.estimates.results import RevolutionResult
from gateway.core.estimates.tire_data import SOFTENING_STD_PER_K, LoadCalibration, ReferenceNumbers
from gateway.core.recording.reader import RecordingReader
from gateway.core.revolutions.contact_edges import error_beyond_definition
from gateway.core.ring_quantities import RING_NUMBERS
from gateway.core.session.recording_pass import RecordingPass, open_recording
from gateway.core.session.session_parts import RigChannel, RigChannels, open_rig_channels
from gateway.forces.known_runs import PRESSURE_KPA, pressure_fault
from gateway.forces.tire_fit import LoadFit, TirePoint

ESTIMATOR: Final = "weak-form"
MIN_REVOLUTIONS: Final = 20
# Share of the assumed error below which the loss of stiffness with temperature counts as measured.
_MEASURED_SHARE: Final = 0.8
# From here on the scatter of the recordings is hardly by chance, also of two.
_NOTED_SCATTER: Final = 2.0
# Relative scatter of a measured load up to which one point stands for its revolutions; beyond it, each band does.
_MAX_LOAD_SCATTER: Final = 0.1
# Width of a band, in the logarithm of the load: the scatter within it is a third of it.
_LOAD_BAND: Final = 0.15
# The first revolutions of a wheel are timed without a running average to compare them with.
_SKIPPED_REVOLUTIONS: Final = 5


def recording_points(
    path: Path, fallback: VehicleConfig | None, positions: Sequence[str], on_left_out: Callable[[str], None]
) -> list[TirePoint]:
    """Estimate one recording and return its usable wheels; `on_left_out` gets the others with the reason."""
    reader = RecordingReader(path)
    try:
        recording = open_recording(reader, None if reader.vehicle_toml else fallback, verifies=False)
    except ConfigError:
        if fallback is None:
            raise
        recording = open_recording(reader, fallback, verifies=False)
    if recording.vehicle is None:
        raise TreadlinkError(
            f"'{path}' contains no vehicle configuration", "Give one that states the loads: --config VEHICLE.toml."
        )
    wheels: dict[str, list[RevolutionResult]] = defaultdict(list)
    recorded: set[str] = set()
    rig = open_rig_channels(reader)
    for result in RecordingPass(recording, ("kinematic", ESTIMATOR), is_watched=False):
        recorded.add(result.position)
        if not positions or result.position in positions:
            wheels[result.position].append(result)
    for position in dict.fromkeys(positions):
        if position not in recorded:
            known = ", ".join(sorted(recorded)) or "none"
            on_left_out(f"{path.name} {position}: no revolution of this wheel; wheels with revolutions: {known}")
    points = []
    for position, results in wheels.items():
        for part, revolutions, is_swept in _parts(results, rig):
            name = f"{path.name} {position}{part}"
            point = _point(name, revolutions, rig, is_swept=is_swept)
            if isinstance(point, str):
                on_left_out(f"{name}: {point}")
            else:
                points.append(point)
    return points


def _parts(results: Sequence[RevolutionResult], rig: RigChannels) -> list[tuple[str, list[RevolutionResult], bool]]:
    """Return a wheel's usable revolutions, by bands of its load where the rig varies it, and whether it does."""
    valid = [result for result in results[_SKIPPED_REVOLUTIONS:] if not result.revolution.faults]
    channel = _rig_load(valid, rig)
    if channel is None:
        return [("", valid, False)]
    # A load that the rig has measured is that of the revolutions used; those without a value are not used.
    loaded_results = [
        (result, abs(float(load_n)))
        for result, load_n in zip(valid, channel.values, strict=True)
        if np.isfinite(load_n) and load_n
    ]
    loads_n = np.array([load_n for _, load_n in loaded_results])
    if len(loaded_results) < MIN_REVOLUTIONS or loads_n.std() <= _MAX_LOAD_SCATTER * loads_n.mean():
        return [("", [result for result, _ in loaded_results], False)]
    bands: dict[int, list[tuple[RevolutionResult, float]]] = defaultdict(list)
    for result, load_n in loaded_results:
        bands[math.floor(math.log(load_n / loads_n.min()) / _LOAD_BAND)].append((result, load_n))
    return [
        (f" at {np.mean([load_n for _, load_n in band]):.0f} N", [result for result, _ in band], True)
        for _, band in sorted(bands.items())
    ]


def _rig_load(results: Sequence[RevolutionResult], rig: RigChannels) -> RigChannel | None:
    intervals_s = [(result.revolution.start_s, result.revolution.period_s) for result in results]
    return rig.at(results[0].position, "load", intervals_s) if results else None


def no_points_error(positions: Sequence[str]) -> TreadlinkError:
    """Return the error where no wheel of any recording can be used."""
    position_hint = f", and must be one of {', '.join(positions)}." if positions else "."
    return TreadlinkError(
        "no wheel of these recordings can be used",
        "A wheel needs a stated load, a pressure of {:.0f} to {:.0f} kPa".format(*PRESSURE_KPA)
        + f" and {MIN_REVOLUTIONS} valid revolutions{position_hint}",
    )


def _point(name: str, valid: Sequence[RevolutionResult], rig: RigChannels, *, is_swept: bool) -> TirePoint | str:
    """Return the point of a wheel's revolutions, or the reason for leaving it out.

    The ring's numbers are averages over revolutions of one load: where it is swept, there are none.
    """
    channel = _rig_load(valid, rig)
    if len(valid) < MIN_REVOLUTIONS:
        rig_note = "" if channel is None else " with a load of the rig"
        return f"it has {len(valid)} valid revolutions{rig_note}, {MIN_REVOLUTIONS} are required"
    conditions = valid[-1].conditions
    load_n, load_std_n = conditions.load_n, conditions.load_std_n
    if channel is not None:
        measured = channel.mean()
        load_n, load_std_n = abs(measured.value), measured.std
    if load_n is None:
        return "its load is not stated"
    pressures = [result.conditions.pressure_pa for result in valid if result.conditions.pressure_pa is not None]
    if not pressures:
        return "its pressure is unknown"
    pressure_pa = float(np.mean(pressures))
    if (fault := pressure_fault(pressure_pa)) is not None:
        return fault
    temperatures = [r.conditions.temperature_degc for r in valid if r.conditions.temperature_degc is not None]
    return TirePoint(
        name=name,
        load_n=load_n,
        load_std_n=load_std_n,
        pressure_pa=pressure_pa,
        half_angle_rad=float(
            np.median([0.5 * (r.revolution.trailing_edge_rad - r.revolution.leading_edge_rad) for r in valid])
        ),
        numbers={} if is_swept else {estimate.name: estimate for estimate in valid[-1].estimates},
        temperature_degc=float(np.mean(temperatures)) if temperatures else None,
        half_angle_std_rad=_half_angle_std_rad(valid),
    )


def _half_angle_std_rad(valid: Sequence[RevolutionResult]) -> float:
    """Return the error of a half angle that a recording's median still has.

    Noise moves an edge in the same direction in every revolution, so that the error of one revolution does not fall
    with their number.
    """
    stds = [
        0.5
        * math.hypot(
            error_beyond_definition(result.revolution.leading_edge_std_rad),
            error_beyond_definition(result.revolution.trailing_edge_std_rad),
        )
        for result in valid
    ]
    finite = [std for std in stds if math.isfinite(std)]
    return float(np.median(finite)) if finite else 0.0


def fit_lines(points: Sequence[TirePoint], fit: LoadFit, reference: ReferenceNumbers) -> list[str]:
    """Return the fit as a table with its validity, and the softening with temperature."""
    width = max(len("recording and wheel"), *(len(point.name) for point in points))
    lines = [f"{'recording and wheel':<{width}}   load N  p kPa  half rad      std  fit err  left out"]
    for point, residual, left_out in zip(points, fit.residuals, fit.left_out, strict=True):
        left_out_text = f"{100 * left_out:+6.1f} %" if np.isfinite(left_out) else "       -"
        lines.append(
            f"{point.name:<{width}} {point.load_n:8.0f} {1e-3 * point.pressure_pa:6.1f} {point.half_angle_rad:9.4f} "
            f"{point.half_angle_std_rad:8.4f} {100 * residual:+6.1f} %  {left_out_text}"
        )
    law = fit.calibration
    low, high = (law.load_at(half, law.pressure_pa) for half in law.half_angle_range_rad)
    lines += [
        "",
        f"ln(load / {law.load_n:.0f} N) = {law.angle_exponent:.3f} x {law.angle_curvature:+.3f} x^2 "
        f"{law.pressure_exponent:+.3f} ln(pressure / {1e-3 * law.pressure_pa:.1f} kPa), "
        f"x = ln(half angle / {law.half_angle_rad:.4f} rad)",
        *_exponent_lines(fit),
        f"standard error {100.0 * law.relative_std:.1f} %"
        + (
            ""
            if fit.is_error_measured
            else " (assumed; three recordings with different loads are needed to measure it)"
        ),
        f"valid for {low:.0f} to {high:.0f} N at {1e-3 * law.pressure_pa:.0f} kPa, "
        f"{1e-3 * law.pressure_range_pa[0]:.0f} to {1e-3 * law.pressure_range_pa[1]:.0f} kPa, at the present wear",
        f"bending stiffness falls by ({100.0 * reference.softening_per_k:.2f} ± "
        f"{100.0 * reference.softening_std_per_k:.2f}) % per kelvin"
        + (
            "" if is_softening_measured(reference) else " (assumed; recordings of the same tires 20 K apart measure it)"
        ),
    ]
    return lines


def _exponent_lines(fit: LoadFit) -> Iterator[str]:
    """Yield the exponents with their errors, and a note on each that the recordings do not determine."""
    law = fit.calibration
    yield (
        f"exponent {law.angle_exponent:.2f} ± {fit.angle_exponent_std:.2f}, curvature {law.angle_curvature:.2f} ± "
        f"{fit.angle_curvature_std:.2f}, exponent of the pressure {law.pressure_exponent:.2f} ± "
        f"{fit.pressure_exponent_std:.2f}"
    )
    if fit.scatter > _NOTED_SCATTER:
        yield (
            f"the recordings scatter {fit.scatter:.1f} times as much as their errors say. Check that loads and "
            "pressures are right and that all are of tires of one kind"
        )
    if not fit.is_angle_exponent_determined:
        yield (
            "the recordings do not determine the exponent: its usual value counts as much. Add recordings at other "
            "loads, further apart and with less noise"
        )
    if not fit.is_pressure_exponent_determined:
        yield (
            "the recordings do not determine the exponent of the pressure: its usual value counts as much. Add "
            "recordings at another pressure to use the calibration over pressures"
        )


def is_softening_measured(reference: ReferenceNumbers) -> bool:
    """Return whether the recordings say more about the softening with temperature than its assumed range."""
    return reference.softening_std_per_k < _MEASURED_SHARE * SOFTENING_STD_PER_K


def calibration_toml(calibration: LoadCalibration, reference: ReferenceNumbers) -> str:
    """Return the tables for the vehicle configuration, checked against its schema."""
    table = LoadCalibrationTable(**table_values(LoadCalibrationTable, calibration))
    tire: dict[str, object] = {"load_calibration": table.model_dump(exclude_none=True)}
    reference_values = table_values(Reference, reference)
    omitted = {f"{name}_std" for name in RING_NUMBERS if name not in reference_values}
    if not is_softening_measured(reference):
        omitted |= {"softening_percent_per_k", "softening_std_percent_per_k"}
    if any(name in reference_values for name in RING_NUMBERS) and reference.pressure_pa is not None:
        tire["reference"] = Reference(**reference_values).model_dump(include=reference_values.keys() - omitted)
    return toml_text({"tire": tire})
