"""Errors that `treadlink plan` says against those of recordings with the same sensor, by random plans.

A plan drives its wheels through the pipeline directly, with its own clock, blocks and averages. The other side is what
a user would do: a hub's bytes of the same data sheet, written into a scenario, through decoder, time base and session.
Tire size, load, speed, wear, range, rate, noise, steps and band are random. The ratio of two scatters of N wheels each
scatters by 1 / sqrt(2 N) itself, so that of two by 1 / sqrt(N). Plans take a minute each: --results FILE keeps them,
and a later run with the same code goes on. Run: python tools/bench_plan.py [--plans N] [--wheels N] [--minutes M]
"""

import argparse
import json
import math
import time
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from gateway.core.config.vehicle import parse_vehicle
from gateway.core.estimates.results import RevolutionResult
from gateway.core.session.core import SessionCore
from gateway.fleet.content_keys import estimators_version
from gateway.planner.accelerometer import Accelerometer
from gateway.planner.planned_errors import AFTER, ESTIMATORS, plan_sensor
from gateway.simulator.scenario import parse_scenario, vehicle_toml
from gateway.simulator.scenario_model import Scenario
from gateway.simulator.simulation import simulate

_WITHIN: Final = 0.2
# Recorded beyond the last revolution: the first ones may be left out.
_SPARE_REVOLUTIONS: Final = 6
# Results do not depend on how many revolutions wait for each other, and the largest blocks take half the time.
_LATENCY_S: Final = 60.0


class RandomPlan(NamedTuple):
    """Tire, sensor and speed of a plan whose range covers its peak, and the scenario that records it."""

    tire: Scenario
    sensor: Accelerometer
    speed_mps: float
    recorded: Scenario


class Comparison(NamedTuple):
    """One quantity after some revolutions of one plan.

    Attributes:
        quantity: its name.
        revolutions: averaged.
        scatter_ratio: planned over recorded standard deviation.
        shift: planned less recorded mean, in standard errors of this difference.
    """

    quantity: str
    revolutions: int
    scatter_ratio: float
    shift: float


def random_plan(rng: np.random.Generator) -> RandomPlan:
    """Return a plan of random tire and sensor."""
    radius_m, speed_mps = rng.uniform(0.26, 0.40), rng.uniform(40.0, 140.0) / 3.6
    load_n = 5000.0 * radius_m / 0.32 * rng.uniform(0.7, 1.1)
    peak_g = 1.5 * speed_mps**2 / radius_m / 9.81 + 2.0
    rate_hz = float(round(rng.uniform(2000.0, 12_000.0)))
    sensor = Accelerometer(
        name="random",
        range_g=peak_g * rng.uniform(1.0, 4.0),
        rate_hz=rate_hz,
        bandwidth_hz=float(rng.choice([0.2, 0.3, 0.4])) * rate_hz,
        noise_mg_rthz=math.exp(rng.uniform(math.log(0.5), math.log(50.0))),
        resolution_mg=math.exp(rng.uniform(math.log(1.0), math.log(100.0))),
    )
    tire = f"""
        [scenario]
        duration_s = {(AFTER[-1] + _SPARE_REVOLUTIONS) * 2.0 * math.pi * radius_m / speed_mps!r}
        [tire]
        radius_mm = {1e3 * radius_m!r}
        wear_mm = {rng.uniform(0.0, 4.0)!r}
        [[wheel]]
        position = "FL"
        wheel = 0
        load_n = {load_n!r}
    """
    recorded = f"""{tire}
        temperature_degc = 25.0
        [wheel.motion]
        speed_kmh = {3.6 * speed_mps!r}
        [sensor]
        axes = ["radial"]
        range_g = {sensor.range_g!r}
        rate_hz = {sensor.rate_hz!r}
        bandwidth_hz = {sensor.bandwidth_hz!r}
        noise_mg_rthz = {[sensor.noise_mg_rthz] * 3}
        resolution_mg = {sensor.resolution_mg!r}
    """
    return RandomPlan(parse_scenario(tire, "the tire"), sensor, speed_mps, parse_scenario(recorded, "the recording"))


def recorded_estimates(scenario: Scenario, seed: int) -> dict[tuple[str, int], float]:
    """Return the estimates of one recording by quantity and number of revolutions; empty for too few of them."""
    core = SessionCore(
        parse_vehicle(vehicle_toml(scenario), "the scenario"), estimators=ESTIMATORS, latency_s=_LATENCY_S
    )
    results: list[RevolutionResult] = []
    for chunk in simulate(scenario, seed=seed).chunks("sim:bench", 1_760_000_000_000_000_000):
        results += core.take(chunk)
    results += core.finish()
    if len(results) < AFTER[-1]:
        return {}
    values = [{estimate.name: estimate.value for estimate in result.estimates} for result in results]
    estimated = {(name, count): values[count - 1][name] for name in values[0] for count in AFTER}
    # Each revolution has a speed of its own; the mean of several is planned.
    speeds = {("speed_mps", count): float(np.mean([row["speed_mps"] for row in values[:count]])) for count in AFTER}
    return estimated | speeds


def compared(plan: RandomPlan, wheels: int, seed: int) -> list[Comparison]:
    """Return what is planned against what is recorded."""
    planned = plan_sensor(plan.tire, plan.sensor, plan.speed_mps, wheels=wheels, seed=seed)
    recordings = [recorded_estimates(plan.recorded, seed * wheels + wheel) for wheel in range(wheels)]
    comparisons = []
    for error in planned.errors:
        key = (error.quantity, error.revolutions)
        values = np.array([row[key] for row in recordings if math.isfinite(row.get(key, math.nan))])
        if len(values) > 1 and (scatter := float(values.std(ddof=1))) > 0.0:
            shift = error.truth + error.stays - float(values.mean())
            std = math.hypot(error.stays_std, scatter / math.sqrt(len(values)))
            comparisons.append(Comparison(*key, error.scatter / scatter, shift / std))
    return comparisons


def main() -> None:
    """Compare random plans and print the table."""
    options = _options()
    ends_s = time.monotonic() + 60.0 * options.minutes
    stored = _kept(options)
    plans: list[list[Comparison]] = []
    for number in range(options.plans):
        if number not in stored:
            if time.monotonic() > ends_s:
                break
            plan = random_plan(np.random.default_rng([options.seed, number]))
            _keep(options, number, compared(plan, options.wheels, number), stored)
        plans.append(stored[number])
        print(f"plan {number + 1} of {options.plans}: {len(plans[-1])} comparisons", flush=True)
    comparisons: dict[tuple[str, int], list[Comparison]] = defaultdict(list)
    for comparison in (comparison for of_plan in plans for comparison in of_plan):
        comparisons[comparison.quantity, comparison.revolutions].append(comparison)
    by_chance = 100.0 * math.erf(_WITHIN * math.sqrt(0.5 * options.wheels))
    print(f"{len(plans)} plans of {options.wheels} wheels: planned over recorded scatter, median; within 20 %")
    print(f"({by_chance:.0f} % where both are the same); means that differ by more than three standard errors")
    print("| quantity |" + "".join(f" after {count} |" for count in AFTER))
    print("|---|" + "---|" * len(AFTER))
    for name in dict.fromkeys(quantity for quantity, _ in comparisons):
        print(f"| {name} |" + "".join(f" {_cell(comparisons[name, count])} |" for count in AFTER))
    late = [item for (_, count), items in comparisons.items() if count > 1 for item in items]
    print(f"after 10 and 100 revolutions, all quantities: {_cell(late)} of {len(late)}")


def _kept(options: argparse.Namespace) -> dict[int, list[Comparison]]:
    """Return the plans that a former run with the same code has compared, by number."""
    if options.results is None or not options.results.exists():
        return {}
    rows = map(json.loads, options.results.read_text("utf-8").splitlines())
    return {
        row["number"]: [Comparison(*values) for values in row["comparisons"]]
        for row in rows
        if row["of"] == _identity(options)
    }


def _keep(
    options: argparse.Namespace, number: int, of_plan: list[Comparison], stored: dict[int, list[Comparison]]
) -> None:
    """Keep the comparisons of a plan, in the file as well."""
    stored[number] = of_plan
    if options.results is not None:
        row = {"of": _identity(options), "number": number, "comparisons": of_plan}
        with options.results.open("a", encoding="utf-8") as file:
            file.write(json.dumps(row) + "\n")


def _identity(options: argparse.Namespace) -> list[Any]:
    return [options.seed, options.wheels, estimators_version()]


def _cell(comparisons: Sequence[Comparison]) -> str:
    if not comparisons:
        return "-"
    ratios = np.array([comparison.scatter_ratio for comparison in comparisons])
    far = sum(abs(comparison.shift) > 3.0 for comparison in comparisons)
    return f"{np.median(ratios):.2f}; {100.0 * np.mean(np.abs(ratios - 1.0) <= _WITHIN):.0f} %; {far}"


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--plans", type=int, default=30)
    parser.add_argument("--wheels", type=int, default=160, help="drives of a plan, and recordings beside them")
    parser.add_argument("--minutes", type=float, default=math.inf, help="no plan is begun after them")
    parser.add_argument("--results", type=Path, help="JSON lines of the plans that are done")
    parser.add_argument("--seed", type=int, default=0)
    return parser.parse_args()


if __name__ == "__main__":
    main()
