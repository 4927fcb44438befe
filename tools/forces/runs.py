"""Driven, braked and freely rolling runs with known truth, through the whole chain.

On random tires of the exact ring with losses, extension and a drifting speed, and on tires of finite elements.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from validity.independent import RolledTable, RolledTire, rolled_tires, rolled_world
from validity.runs import Run, record_wheel, results_of
from validity.statements import Statement, draw_statement, known_exactly
from validity.tires import World, draw_world, ordinary

from gateway.core.estimates.estimator import Estimate, Status
from gateway.ring.rolling_ring import RingNotConvergedError
from gateway.simulator.tire_table import Range, TireTable
from gateway.simulator.wheel_plan import WheelPlan

ESTIMATORS: Final = ("kinematic", "self-calibration", "weak-form", "load", "longitudinal-force")
QUANTITIES: Final = ("longitudinal_force_n", "axle_torque_nm", "rolling_resistance", "load_by_width_n")
REVOLUTIONS: Final = 128
# Torque over load and radius.
TRACTIONS: Final = (-0.4, -0.1, -0.03, 0.0, 0.03, 0.06, 0.15)


@dataclass(frozen=True, slots=True)
class Measured:
    """One estimate at the end of a run beside the truth.

    Attributes:
        tire: name.
        case: what the run is.
        quantity: of the estimate.
        estimate: at the end of the run.
        truth: of the tire.
        load_n: of the tire, the unit of errors of a force.
    """

    tire: str
    case: str
    quantity: str
    estimate: Estimate
    truth: float
    unit: float


@dataclass(frozen=True, slots=True)
class Truth:
    """True values by name of the quantity."""

    values: dict[str, float]
    load_n: float
    radius_m: float

    def unit(self, quantity: str) -> float:
        """Return what an error of a quantity is compared with: the load for a force."""
        return (
            self.load_n * self.radius_m if quantity.endswith("_nm") else self.load_n if quantity.endswith("_n") else 1.0
        )


def simulated(index: int, traction: float, seed: int) -> Iterator[Measured]:
    """Yield the estimates of one random tire of the exact ring with an axle torque."""
    world = draw_world(seed, index)
    try:
        world = replace(ordinary(world, np.random.default_rng([seed, index, 7])), revolutions=REVOLUTIONS)
        plain = world.plan()
        torque = traction * world.load_n * world.radius_m
        plan = replace(plain, tire=replace(plain.tire, axle_torque_nm=torque))
        run = record_wheel(world, plan, _waveforms, (seed, index))
        ring = plan.tire.solve(world.load_n, world.pressure_pa, world.omega_radps)
    except RingNotConvergedError:
        return
    truth = {
        "longitudinal_force_n": ring.longitudinal_force_n,
        "axle_torque_nm": ring.axle_torque_nm,
        "rolling_resistance": ring.rolling_resistance,
        "load_by_width_n": world.load_n,
    }
    said = draw_statement(world, np.random.default_rng([seed, index, 1]))
    yield from _measured(
        f"{world.kind} {index}", _case(traction), run, said, Truth(truth, world.load_n, world.radius_m)
    )


def rolled(folder: Path, seed: int, is_stated: bool) -> Iterator[Measured]:
    """Yield the estimates of every kept tire of finite elements that states its forces."""
    for index, tire in enumerate(rolled_tires(folder)):
        about = tire.about
        if "longitudinal_force_n" not in about:
            continue
        world = replace(rolled_world(tire, seed, index), revolutions=REVOLUTIONS, noise_mg_rthz=5.0)
        said = draw_statement(world, np.random.default_rng([seed, index, 1]))
        if is_stated:
            world = replace(world, gain_error=(0.0, 0.0, 0.0), zero_g_mps2=(0.0, 0.0, 0.0), tilt_deg=(0.0, 0.0, 0.0))
            said = known_exactly(world, said)
        run = record_wheel(world, world.plan(), _kept(tire), (seed, index), lateral=False)
        truth = {name: float(about[name]) for name in QUANTITIES[:3]} | {"load_by_width_n": world.load_n}
        case = _case(truth["axle_torque_nm"] / (world.load_n * world.radius_m))
        yield from _measured(str(about["name"]), case, run, said, Truth(truth, world.load_n, world.radius_m))


def _case(traction: float) -> str:
    if traction < -0.015:
        return "braked"
    return "driven" if traction > 0.015 else "free"


def _measured(tire: str, case: str, run: Run, said: Statement, truth: Truth) -> Iterator[Measured]:
    results = results_of(run, said, ESTIMATORS)
    result = {} if not results else {estimate.name: estimate for estimate in results[-1].estimates}
    for name in QUANTITIES:
        estimate = result.get(name) or Estimate.invalid(name)
        yield Measured(tire, case, name, estimate, truth.values[name], truth.unit(name))


def _waveforms(plan: WheelPlan, world: World) -> TireTable:
    speeds = plan.motion.at(np.array([0.0, world.seconds])).speed_mps / plan.radius_m
    return TireTable(
        plan.tire,
        Range(plan.load_n.low, plan.load_n.high),
        Range(plan.pressure_pa.low, plan.pressure_pa.high),
        Range(float(speeds.min()), float(speeds.max())),
    )


def _kept(tire: RolledTire) -> Callable[[WheelPlan, World], Any]:
    def waveforms(plan: WheelPlan, _: World) -> RolledTable:
        return tire.table(plan.tire.sensor_offset_m)

    return waveforms


def pulls(measured: Sequence[Measured]) -> tuple[float, float, float, int]:
    """Return rms and largest pull of valid estimates, share valid, and number of falsely valid ones."""
    valid = [measurement for measurement in measured if measurement.estimate.status is Status.VALID]
    result = np.array(
        [(measurement.estimate.value - measurement.truth) / measurement.estimate.std for measurement in valid]
    )
    if not len(result):
        return math.nan, math.nan, 0.0, 0
    rms, largest = float(np.sqrt(np.mean(result**2))), float(np.abs(result).max())
    return rms, largest, len(valid) / len(measured), int((np.abs(result) > 3.0).sum())
