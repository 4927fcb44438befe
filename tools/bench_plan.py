"""Errors that `treadlink plan` says against those of other simulated drives with the same sensor.

Random plans: tire size, load, speed, range, rate, noise, steps and band. Both sides are drives through the pipeline, so
this measures how well the number of drives of a plan determines the errors, not a formula. Run: python
tools/bench_plan.py [--plans N] [--wheels N] [--planned-wheels N]
"""

from __future__ import annotations

import argparse
import math
from collections import defaultdict

import numpy as np

from gateway.planning.accelerometer import Accelerometer
from gateway.planning.planned_errors import AFTER, plan_sensor
from gateway.simulator.scenario import parse_scenario
from gateway.simulator.scenario_model import Scenario

_WITHIN = 0.2


def main() -> None:
    options = _options()
    ratios: dict[tuple[str, int], list[float]] = defaultdict(list)
    unusable = 0
    for number in range(options.plans):
        rng = np.random.default_rng([options.seed, number])
        scenario, sensor, speed_mps = _random_plan(rng)
        planned = plan_sensor(scenario, sensor, speed_mps, wheels=options.planned_wheels, seed=2 * number)
        driven = plan_sensor(scenario, sensor, speed_mps, wheels=options.wheels, seed=2 * number + 1)
        unusable += not planned.usable
        found = {(error.quantity, error.revolutions): error.scatter for error in driven.errors}
        for error in planned.errors:
            scatter = found.get((error.quantity, error.revolutions), 0.0)
            if scatter > 0.0:
                ratios[error.quantity, error.revolutions].append(error.scatter / scatter)
        print(f"plan {number + 1} of {options.plans}", flush=True)
    print(f"{options.plans} plans, {unusable} not usable; {options.planned_wheels} against {options.wheels} wheels")
    print(f"{'quantity':<18}" + "".join(f"{f'after {count}: median, within 20 %':>36}" for count in AFTER))
    for name in dict.fromkeys(quantity for quantity, _ in ratios):
        cells = [_cell(ratios[name, count]) for count in AFTER]
        print(f"{name:<18}" + "".join(f"{cell:>36}" for cell in cells))


def _cell(ratios: list[float]) -> str:
    share = 100.0 * np.mean([abs(ratio - 1.0) <= _WITHIN for ratio in ratios]) if ratios else math.nan
    return f"{np.median(ratios):.2f}; {share:.0f} % of {len(ratios)}" if ratios else "-"


def _random_plan(rng: np.random.Generator) -> tuple[Scenario, Accelerometer, float]:
    """Return tire, sensor and speed of a plan whose range covers its peak."""
    radius_m, speed_mps = rng.uniform(0.26, 0.40), rng.uniform(40.0, 140.0) / 3.6
    load_n = 5000.0 * radius_m / 0.32 * rng.uniform(0.7, 1.1)
    text = f"""
        [tire]
        radius_mm = {1e3 * radius_m:.1f}
        [[wheel]]
        position = "FL"
        wheel = 0
        load_n = {load_n:.0f}
    """
    peak_g = 1.5 * speed_mps**2 / radius_m / 9.81 + 2.0
    rate_hz = rng.uniform(2000.0, 12_000.0)
    sensor = Accelerometer(
        name="random",
        range_g=peak_g * rng.uniform(1.0, 4.0),
        rate_hz=rate_hz,
        bandwidth_hz=float(rng.choice([0.2, 0.3, 0.4])) * rate_hz,
        noise_mg_rthz=math.exp(rng.uniform(math.log(0.5), math.log(50.0))),
        resolution_mg=math.exp(rng.uniform(math.log(1.0), math.log(100.0))),
    )
    return parse_scenario(text, "random plan"), sensor, speed_mps


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--plans", type=int, default=30)
    parser.add_argument("--wheels", type=int, default=160, help="drives that are compared with")
    parser.add_argument("--planned-wheels", type=int, default=160, help="drives that the plan is made of")
    parser.add_argument("--seed", type=int, default=0)
    return parser.parse_args()


if __name__ == "__main__":
    main()
