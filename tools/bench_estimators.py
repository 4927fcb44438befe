# ruff: noqa: E402 - the number of threads must be set before numpy is imported
"""CPU time per revolution by stage and estimator.

For comparison: scipy's general least squares on the ring paper's problem. Run: python tools/bench_estimators.py
"""

import itertools
import math
import os
import platform
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

for _threads in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_threads, "1")

import numpy as np
import scipy
from bench_ring_paper import OMEGA, ORDERS, RADIUS_M, sampled
from scipy.optimize import least_squares

from gateway.core.estimates.estimator import AngleAverage, Estimator, Revolution, TireConditions
from gateway.core.estimates.registry import DEFAULT_ESTIMATORS, ESTIMATORS, make_estimator
from gateway.core.estimates.revolution_block import extended
from gateway.core.estimates.tire_data import ReferenceNumbers, TireData
from gateway.core.revolutions.angle_resampling import fit_phase, resample_revolutions
from gateway.core.revolutions.contact_edges import find_contact_edges
from gateway.core.revolutions.order_spectrum import ORDER_COUNT, order_coefficients
from gateway.core.revolutions.speed_normalisation import normalise_revolutions
from gateway.core.revolutions.synchronous_average import RunningAverage
from gateway.ring.reference_tire import TABLE_3_NUMBERS
from gateway.ring.ring_series import stiffness_terms
from tools.generators.lateral_signals import Sensor, lateral, radial, through_pipeline
from tools.generators.lateral_signals import samples as three_axes

LOAD_N, PRESSURE_PA = 5000.0, 2.1e5
REVOLUTIONS = 64
# Inputs of the load and wear estimators, without which they return invalid estimates at once.
CONDITIONS = TireConditions(
    RADIUS_M,
    LOAD_N,
    PRESSURE_PA,
    tire=TireData(ring_thickness_m=0.015, reference=ReferenceNumbers(*TABLE_3_NUMBERS, pressure_pa=PRESSURE_PA)),
)


@dataclass(frozen=True, slots=True)
class Turn:
    """A revolution and the average that includes it."""

    revolution: Revolution
    average: AngleAverage


def microseconds(work: Callable[[], object], repeats: int = 200) -> float:
    """Median time of one call."""
    durations = []
    for _ in range(repeats):
        begin = time.perf_counter()
        work()
        durations.append(time.perf_counter() - begin)
    return 1e6 * float(np.median(durations))


def turns() -> list[Turn]:
    """Revolutions of the exact ring with three axes, ply steer, noise, gravity and a running average."""
    wheel, sensor, average = radial(LOAD_N, PRESSURE_PA), Sensor(noise_mg=5.0), RunningAverage()
    rolled = through_pipeline(three_axes(wheel, [(REVOLUTIONS + 4, lateral(wheel))], sensor), sensor)[-REVOLUTIONS:]
    return [Turn(r.revolution, extended(average, r.revolution)) for r in rolled]


def print_stages(result: list[Turn]) -> None:
    samples, centres = sampled(radial(LOAD_N, PRESSURE_PA), 4, seed=2)
    axes = np.stack([samples] * 3, axis=1)
    phase = fit_phase(centres[1], centres[2], centres[0])
    waves = resample_revolutions([axes], [phase])[:, 0]
    (clean,) = normalise_revolutions(waves, [phase]).radial_mps2
    average, revolutions = RunningAverage(), itertools.cycle([turn.revolution for turn in result])
    rows = {
        "resample, 3 axes": microseconds(lambda: resample_revolutions([axes], [phase])),
        "gravity and drift": microseconds(lambda: normalise_revolutions(waves, [phase])),
        "orders": microseconds(lambda: order_coefficients(clean)),
        "contact edges": microseconds(lambda: find_contact_edges(clean, phase.samples)),
        "running average": microseconds(lambda: extended(average, next(revolutions))),
    }
    estimators = {name: times for name in ESTIMATORS if len(times := update_times(name, result))}
    used = rows | {name: float(np.median(estimators[name])) for name in DEFAULT_ESTIMATORS if name in estimators}
    total = sum(used.values())
    print(f"\nOne revolution of {phase.samples:.0f} samples, live, median, microseconds (share of {total:.0f})")
    for name, cost in used.items():
        print(f"{name:>20}{cost:10.0f}{100 * cost / total:6.0f} %")
    print("\nEvery estimator, microseconds an update over 64 revolutions: median, mean, most; - without an estimate")
    for name in ESTIMATORS:
        times = estimators.get(name)
        shown = f"{'-':>10}" if times is None else f"{np.median(times):10.0f}{times.mean():10.0f}{times.max():12.0f}"
        print(f"{name:>20}{shown}")


def update_times(name: str, result: list[Turn]) -> np.ndarray:
    """Time of each update in turn, in microseconds, without that of others before it; none where none estimates."""
    names = [other for other in ESTIMATORS if other != "forward" or name == "forward"]
    chain: list[Estimator] = [make_estimator(other) for other in names[: names.index(name) + 1]]
    durations, has_estimate = [], False
    for turn in result:
        earlier: dict[str, dict[str, object]] = {}
        for estimator in chain:
            seeing = replace(CONDITIONS, given=earlier)  # type: ignore[arg-type]
            begin = time.perf_counter()
            estimates = estimator.update(turn.revolution, turn.average, seeing)
            elapsed = time.perf_counter() - begin
            earlier[estimator.name] = {estimate.name: estimate for estimate in estimates}
        durations.append(1e6 * elapsed)
        has_estimate = has_estimate or any(math.isfinite(estimate.value) for estimate in estimates)
    return np.array(durations if has_estimate else [])


def print_scipy(turn: Turn) -> None:
    """Eq. 28 by scipy.optimize.least_squares, Jacobian given, bounds at zero, from 1.5 times the paper's numbers."""
    average = turn.average
    half = 0.5 * (average.trailing_edge_rad - average.leading_edge_rad)
    measured = average.orders_mps2[1:ORDER_COUNT].real / OMEGA**2
    numerator = -LOAD_N / (math.pi * PRESSURE_PA * RADIUS_M * half) * ORDERS**3 * np.sin(ORDERS * half)
    units = np.array(TABLE_3_NUMBERS)
    terms = stiffness_terms(ORDERS) * units

    def residual(parameters: np.ndarray) -> np.ndarray:
        return numerator / (terms @ parameters) - measured

    def jacobian(parameters: np.ndarray) -> np.ndarray:
        stiffness = terms @ parameters
        return terms * (-numerator / stiffness**2)[:, np.newaxis]

    def solve() -> object:
        return least_squares(residual, np.full(4, 1.5), jac=jacobian, bounds=(1e-9, np.inf), x_scale=1.0)

    print(f"\nscipy.optimize.least_squares on Eq. 28, cold: {microseconds(solve, 30):.0f} microseconds")


def main() -> None:
    cpu = platform.processor() or platform.machine()
    print(f"{cpu}, {os.cpu_count()} cores, one thread used; Python {platform.python_version()},")
    print(f"numpy {np.__version__}, scipy {scipy.__version__}")
    result = turns()
    print_stages(result)
    print_scipy(result[-1])


if __name__ == "__main__":
    main()
