"""Cornering runs with known side force and aligning moment, through the whole chain, on two lateral models.

`brush`: the simulator's shear-flexible belt with a brush tread at a slip angle. `twisting`: a ring whose belt bends and
twists out of its plane, loaded by a given distribution of side force, and whose sensor rolls with the belt. It shares
no equation with the estimator: the operator of the estimator's rows is neither of the two.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, replace
from typing import Any, Final

import numpy as np
from accuracy.tables import Table
from validity.independent import RolledTable
from validity.runs import record_wheel, results_of
from validity.statements import Statement, draw_statement
from validity.tires import World, draw_world

from forces.runs import Measured
from gateway.core.config.toml_writer import toml_text
from gateway.core.config.vehicle import VehicleConfig, parse_vehicle
from gateway.core.estimates.estimator import Estimate, Status
from gateway.core.types import FloatArray
from gateway.forces.brush_tread import BrushNotConvergedError
from gateway.forces.free_belt import displacement_rows
from gateway.forces.lateral_belt import LateralBelt
from gateway.forces.lateral_deformation import ORDERS
from gateway.forces.side_force_calibration import SideForceCalibration, fit_linear_law
from gateway.ring.reference_tire import TABLE_3_LOAD_N, TABLE_3_NUMBERS, TABLE_3_PRESSURE_PA, TABLE_3_RADIUS_M
from gateway.ring.rolling_ring import RingNotConvergedError, RingParameters, RingSolution, solve_rolling_ring
from gateway.simulator.tire_model import TireModel
from gateway.simulator.tire_table import LATERAL, TABLE_ANGLES, Range, TireTable
from gateway.simulator.wheel_plan import WheelPlan

MODELS: Final = ("brush", "twisting")
QUANTITIES: Final = ("side_force_n", "aligning_moment_nm", "friction_used", "sliding_share")
_ESTIMATORS: Final = ("kinematic", "self-calibration", "weak-form", "longitudinal-force", "side-force", "friction")
_REVOLUTIONS: Final = 48
# Standard error of the rig's forces at the calibration, over the load, and of its moments over load and radius.
_RIG_STD: Final = 0.002
_CALIBRATED_DEG: Final = (-1.5, 0.0, 1.5)
_JUDGED_DEG: Final = (-4.0, -2.5, -0.7, 0.4, 1.0, 2.0, 3.5, 5.0)


@dataclass(frozen=True, slots=True)
class Cornering:
    """A lateral waveform with its forces.

    Attributes:
        lateral_m: (n,) lateral axis over omega^2, on the ring's angles.
        side_force_n: of the road on the tire.
        aligning_moment_nm: about the vertical axis.
        sliding_share: of the contact; NaN where the model has no tread.
    """

    lateral_m: FloatArray
    side_force_n: float
    aligning_moment_nm: float
    sliding_share: float


def brush(tire: TireModel, ring: RingSolution, slip_deg: float, _: np.random.Generator) -> Cornering:
    """Return the simulator's belt at a slip angle."""
    result = tire.solve_lateral(ring, math.radians(slip_deg))
    share = float(result.sliding.sum() / max(int(ring.in_contact.sum()), 1))
    return Cornering(result.lateral_m, result.side_force_n, result.aligning_moment_nm, share)


def twisting(tire: TireModel, ring: RingSolution, slip_deg: float, rng: np.random.Generator) -> Cornering:
    """Return a twisting ring under a side force of about a tenth of the load per degree, of a random distribution.

    Per length: EIz (y'' + phi / R)'' - (GJ / R) (phi' - y' / R)' - T y'' - T phi / R + ky y = f, and
    (EIz / R) (y'' + phi / R) - GJ (phi' - y' / R)' + kphi phi = h f, phi the roll of the section, T the tension (the
    pressure follows the section), h the distance of the tread below it. A yaw of the whole ring costs sidewall only.
    """
    belt, radius = tire.lateral, ring.ring.radius_m
    theta = ring.theta_rad
    position = (theta - ring.leading_edge_rad) / (ring.trailing_edge_rad - ring.leading_edge_rad)
    inside = (position > 0.0) & (position < 1.0)
    rise, fall = rng.uniform(0.5, 2.0), rng.uniform(0.3, 1.5)
    safe = np.clip(position, 0.0, 1.0)
    force = np.where(inside, safe**rise * (1.0 - safe) ** fall, 0.0)
    step = radius * float(theta[1] - theta[0])
    side = 0.1 * ring.load_n * slip_deg
    force *= side / (force.sum() * step)
    tension = ring.pressure_pa * ring.ring.tension_width_m * radius
    twist = np.random.default_rng([round(1e6 * radius), 1])
    stiffness = belt.sidewall_stiffness_npm2
    bending = belt.bending_stiffness_nm2
    torsion = 0.05 * bending
    # Roll stiffness of the sidewall: lateral stiffness at half the belt's width, times a spread of belts.
    roll = stiffness * 0.25**2 * math.exp(twist.uniform(-0.7, 0.7))
    number = np.fft.fftfreq(len(theta), 1.0 / len(theta)) / radius
    square = number**2
    a11 = bending * square**2 + torsion * square / radius**2 + tension * square + stiffness
    a21 = -(bending + torsion) * square / radius
    a12 = a21 - tension / radius
    a22 = bending / radius**2 + torsion * square + roll
    spectrum = np.fft.fft(force)
    moment = 0.01 * spectrum
    determinant = a11 * a22 - a12 * a21
    shape = np.fft.ifft((a22 * spectrum - a12 * moment) / determinant)
    rolled = np.fft.ifft((a11 * moment - a21 * spectrum) / determinant).real
    bend = np.fft.ifft(-square * radius**2 * np.fft.fft(shape)).real
    aligning = -float((force * np.sin(theta)).sum()) * radius * step
    return Cornering(bend + ring.sensor.radial_m * rolled, side, aligning, math.nan)


@dataclass(frozen=True, slots=True)
class CalibratedStatement(Statement):
    """A statement with a side force calibration."""

    side_force: SideForceCalibration | None = None

    def vehicle(self, world: World) -> VehicleConfig:
        """Return the configuration."""
        plain = Statement.vehicle(self, world).model_dump(exclude_none=True, mode="json")
        if self.side_force is None:
            return Statement.vehicle(self, world)
        side, moment = self.side_force.side, self.side_force.moment
        assert moment is not None
        deg = math.radians(1.0)
        low, high = self.side_force.half_angle_range_rad
        plain["tire"]["side_force_calibration"] = {
            "side_n_per_mm": 1e-3 * side.factor,
            "side_std_n_per_mm": 1e-3 * side.factor_std,
            "shift_zero_mm": 1e3 * side.zero,
            "shift_zero_std_mm": 1e3 * side.zero_std,
            "moment_nm_per_deg": moment.factor * deg,
            "moment_std_nm_per_deg": moment.factor_std * deg,
            "yaw_zero_deg": moment.zero / deg,
            "yaw_zero_std_deg": moment.zero_std / deg,
            "half_angle_min_rad": low,
            "half_angle_max_rad": high,
        }
        if self.side_force.pressure_range_pa is not None:
            low, high = self.side_force.pressure_range_pa
            plain["tire"]["side_force_calibration"] |= {"pressure_min_kpa": 1e-3 * low, "pressure_max_kpa": 1e-3 * high}
        return parse_vehicle(toml_text(plain), "bench")


def cornering(model: str, index: int, seed: int) -> Iterator[Measured]:
    """Yield the estimates of one random tire at two of the judged slip angles, calibrated at three others."""
    solve: Callable[..., Cornering] = {"brush": brush, "twisting": twisting}[model]
    world = replace(draw_world(seed, index), revolutions=_REVOLUTIONS)
    rng = np.random.default_rng([seed, index, 11])
    try:
        plan = world.plan()
        ring = plan.tire.solve(world.load_n, world.pressure_pa, world.omega_radps)
        table = _radial_table(plan, world)
        said = draw_statement(world, np.random.default_rng([seed, index, 1]))
        said = replace(said, load_n=world.load_n * (1.0 + 0.01 * float(rng.standard_normal())))
        points = [_run(world, plan, table, ring, solve, slip, said, rng, (seed, index, position))
                  for position, slip in enumerate(_CALIBRATED_DEG)]  # fmt: skip
        calibrated = _calibrated(said, points, ring, rng)
        for position in (2 * index, 2 * index + 1):
            slip = _JUDGED_DEG[position % len(_JUDGED_DEG)]
            truth, result, _ = _run(
                world, plan, table, ring, solve, slip, calibrated, rng, (seed, index, 10 + position)
            )
            yield from _judged(f"{world.kind} {index}, {model}", f"{slip:+g} deg", truth, result, world)
    except (RingNotConvergedError, BrushNotConvergedError):
        return


def _radial_table(plan: WheelPlan, world: World) -> TireTable:
    extents = (Range(plan.load_n.low, plan.load_n.high), Range(plan.pressure_pa.low, plan.pressure_pa.high))
    return TireTable(plan.tire, *extents, Range(world.omega_radps, world.omega_radps))


def _run(
    world: World, plan: WheelPlan, table: TireTable, ring: RingSolution, solve: Callable[..., Cornering], slip: float,
    said: Statement, rng: np.random.Generator, seed: tuple[int, ...],
) -> tuple[Cornering, dict[str, Estimate], float]:  # fmt: skip
    truth = solve(plan.tire, ring, slip, rng)
    conditions = world.load_n, world.pressure_pa, world.omega_radps
    angles = np.linspace(-math.pi, math.pi, TABLE_ANGLES + 1)
    curve = np.interp(angles, np.append(ring.theta_rad, math.pi), np.append(truth.lateral_m, truth.lateral_m[0]))

    def waveforms(_: WheelPlan, __: World) -> Any:
        wave = table.waveform(*conditions).copy()
        wave[:, LATERAL] = curve
        return RolledTable(wave, table.edges_rad(*conditions))

    results = results_of(record_wheel(world, plan, waveforms, seed), said, _ESTIMATORS)
    result = {} if not results else {estimate.name: estimate for estimate in results[-1].estimates}
    last = results[-1].revolution if results else None
    half = 0.5 * (last.trailing_edge_rad - last.leading_edge_rad) if last is not None else math.nan
    return truth, result, half


def _calibrated(
    said: Statement, points: list[tuple[Cornering, dict[str, Estimate], float]], ring: RingSolution,
    rng: np.random.Generator,
) -> Statement:  # fmt: skip
    force_std = _RIG_STD * ring.load_n
    moment_std = force_std * ring.ring.radius_m * 0.1
    shifts = [result.get("belt_shift_m") or Estimate.invalid("belt_shift_m") for _, result, _ in points]
    yaws = [result.get("belt_yaw_rad") or Estimate.invalid("belt_yaw_rad") for _, result, _ in points]
    if any(estimate.status is Status.INVALID for estimate in (*shifts, *yaws)):
        return said
    forces = [truth.side_force_n + force_std * float(rng.standard_normal()) for truth, _, _ in points]
    moments = [truth.aligning_moment_nm + moment_std * float(rng.standard_normal()) for truth, _, _ in points]
    count = len(points)
    side = fit_linear_law([s.value for s in shifts], [s.std for s in shifts], forces, [force_std] * count)
    moment = fit_linear_law([y.value for y in yaws], [y.std for y in yaws], moments, [moment_std] * count)
    halves = [half for _, _, half in points]
    pressure = ring.pressure_pa
    calibration = SideForceCalibration(side, moment, (min(halves), max(halves)), (pressure, pressure))
    stated = {field.name: getattr(said, field.name) for field in fields(Statement)}
    return CalibratedStatement(**stated, side_force=calibration)


def _judged(tire: str, case: str, truth: Cornering, result: dict[str, Estimate], world: World) -> Iterator[Measured]:
    values = {
        "side_force_n": (truth.side_force_n, world.load_n),
        "aligning_moment_nm": (truth.aligning_moment_nm, world.load_n * world.radius_m),
        "friction_used": (abs(truth.side_force_n) / world.load_n, 1.0),
        "sliding_share": (truth.sliding_share, 1.0),
    }
    for name, (value, unit) in values.items():
        if math.isfinite(value):
            yield Measured(tire, case, name, result.get(name) or Estimate.invalid(name), value, unit)


def linearity_table() -> Table:
    """Return how far side force and moment are linear in shift and yaw, without noise, on belts of both models."""
    rows = []
    for model, changes in (
        ("brush", {}),
        ("brush", {"bending_stiffness_nm2": 200.0}),
        ("brush", {"bending_stiffness_nm2": 4e3}),
        ("brush", {"sidewall_stiffness_npm2": 1.5e5}),
        ("brush", {"friction": 0.5}),
        ("twisting", {}),
        ("twisting", {"bending_stiffness_nm2": 400.0}),
        ("twisting", {"bending_stiffness_nm2": 3e3}),
    ):
        tire = TireModel(
            RingParameters.from_numbers(*TABLE_3_NUMBERS, radius_m=TABLE_3_RADIUS_M, pressure_pa=TABLE_3_PRESSURE_PA),
            reference_pa=TABLE_3_PRESSURE_PA,
            lateral=replace(LateralBelt(), **changes),
        )
        ring = solve_rolling_ring(tire.ring, TABLE_3_LOAD_N, TABLE_3_PRESSURE_PA, 56.4, nodes=1440)
        rng = np.random.default_rng(1)
        solve = {"brush": brush, "twisting": twisting}[model]
        results = [solve(tire, ring, slip, rng) for slip in (-6.0, -4.0, -2.0, -1.0, 0.0, 1.0, 2.0, 4.0, 6.0)]
        grid = len(ring.theta_rad)
        signs = np.where(np.asarray(ORDERS) % 2, -1.0, 1.0)
        spectra = np.array([np.fft.rfft(estimate.lateral_m)[ORDERS.start : ORDERS.stop] for estimate in results])
        spectra = spectra * signs * (2.0 / grid)
        records = np.concatenate([spectra.real, -spectra.imag], axis=1)
        shift, yaw = displacement_rows(ring.half_angle_rad) @ records.T
        lateral = 2.0 * math.pi * tire.ring.radius_m * tire.lateral.sidewall_stiffness_npm2
        cells = []
        for displaced, forces in (
            (shift, np.array([estimate.side_force_n for estimate in results])),
            (yaw, np.array([estimate.aligning_moment_nm for estimate in results])),
        ):
            line = np.polyfit(displaced, forces, 1)
            off = float(np.abs(np.polyval(line, displaced) - forces).max())
            cells.append((float(line[0]), f"{off:.2f} of {float(np.abs(forces).max()):.0f}"))
        words = ", ".join(f"{_belt_words(name)} {value:g}" for name, value in changes.items())
        (side, side_off), (moment, moment_off) = cells
        per_degree = moment * tire.ring.radius_m * math.radians(1.0)
        rows.append(
            (
                *(model, words or "as stated", f"{1e-3 * side:.0f}", f"{side / lateral:.2f}", side_off),
                *(f"{per_degree:.1f}", moment_off),
            )
        )
    return Table(
        "Force over displacement",
        "no noise, slip -6° to +6° (twisting: a random distribution of the force each); off: largest distance from a "
        "straight line",
        ("model", "belt", "K, N/mm", "K / (2π R ky)", "off, N", "M, N m/°", "off, N m"),
        tuple(rows),
    )


def _belt_words(name: str) -> str:
    return name.removesuffix("_nm2").removesuffix("_npm2").replace("_", " ")
