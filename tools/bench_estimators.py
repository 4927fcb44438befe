# ruff: noqa: E402 - the number of threads must be set before numpy is imported
"""CPU time per revolution by stage and estimator, and per revolution of a dump.

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
from bench_ring_paper import BASE, OMEGA, ORDERS, RADIUS_M, revolution_of, sampled
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
from gateway.ring.rolling_ring import solve_rolling_ring

LOAD_N, PRESSURE_PA = 5000.0, 2.1e5
REVOLUTIONS = 64
# Inputs of the load and wear estimators, without which they return invalid estimates at once.
CONDITIONS = TireConditions(
    RADIUS_M,
    LOAD_N,
    PRESSURE_PA,
    tire=TireData(
        ring_thickness_m=0.015,
        reference=ReferenceNumbers(*TABLE_3_NUMBERS, pressure_pa=PRESSURE_PA),
    ),
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


def turns() -> tuple[list[Turn], np.ndarray, np.ndarray]:
    """Revolutions of the exact ring with noise, gravity and a running average; the samples and contact centres."""
    ring = solve_rolling_ring(BASE, LOAD_N, PRESSURE_PA, OMEGA, nodes=1440)
    samples, centres = sampled(ring, REVOLUTIONS + 2, seed=2)
    average = RunningAverage()
    results = []
    for previous, start, end in zip(centres, centres[1:], centres[2:], strict=False):
        revolution = revolution_of(samples, start, end, previous)
        results.append(Turn(revolution, extended(average, revolution)))
    return results, samples, centres


def print_stages(result: list[Turn], samples: np.ndarray, centres: np.ndarray) -> None:
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
    estimators = {name: update_times(name, result) for name in ESTIMATORS}
    used = rows | {name: float(np.median(estimators[name])) for name in DEFAULT_ESTIMATORS}
    total = sum(used.values())
    print(f"\nOne revolution of {phase.samples:.0f} samples, live, median, microseconds (share of {total:.0f})")
    for name, cost in used.items():
        print(f"{name:>20}{cost:10.0f}{100 * cost / total:6.0f} %")
    print("\nEvery estimator, microseconds an update over 64 revolutions: median, mean, most")
    for name, times in estimators.items():
        print(f"{name:>20}{np.median(times):10.0f}{np.mean(times):10.0f}{np.max(times):12.0f}")


def update_times(name: str, result: list[Turn]) -> np.ndarray:
    """Time of each update in turn, in microseconds, what it is given by others not counted."""
    names = [other for other in ESTIMATORS if other != "forward" or name == "forward"]
    chain: list[Estimator] = [make_estimator(other) for other in names[: names.index(name) + 1]]
    durations = []
    for turn in result:
        earlier: dict[str, dict[str, object]] = {}
        for estimator in chain:
            seeing = replace(CONDITIONS, given=earlier)  # type: ignore[arg-type]
            begin = time.perf_counter()
            estimates = estimator.update(turn.revolution, turn.average, seeing)
            elapsed = time.perf_counter() - begin
            earlier[estimator.name] = {estimate.name: estimate for estimate in estimates}
        durations.append(1e6 * elapsed)
    return np.array(durations)


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
    result, samples, centres = turns()
    print_stages(result, samples, centres)
    print_scipy(result[-1])


if __name__ == "__main__":
    main()
