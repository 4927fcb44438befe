"""Pulls of distance, load, wear, road class and cavity on simulated tires drawn at random.

python tools/bench_road_cavity.py [--tires N] [--seed N] [QUANTITY...]
"""

import argparse
import math
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from firmware_protocol.decoder import FrameDecoder
from gateway.core.config.validation import parse_document
from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.estimates.estimator import Estimate, Status
from gateway.core.estimates.results import RevolutionResult
from gateway.core.estimates.tire_data import ReferenceNumbers
from gateway.core.estimates.wheel_setup import TireData, WheelSetup
from gateway.core.reasons import codes_of
from gateway.core.wheels.wheels import Pipeline
from gateway.forces.reasons import ForceCode
from gateway.forces.tire_fit import TirePoint, fit_load_calibration, reference_numbers
from gateway.simulator.road_profile import CLASSES, quarter_car
from gateway.simulator.scenario_model import Scenario
from gateway.simulator.simulation import simulate
from gateway.simulator.truth import WheelTruth
from gateway.simulator.wheel_plan import wheel_plans
from tools.validity.tires import World, draw_world

SECONDS: Final = 20.0
RATE_HZ: Final = 4000.0


@dataclass(frozen=True, slots=True)
class Pull:
    """One estimate beside its truth.

    Attributes:
        group: row of the table.
        estimate: at the end of the run; None where it is not determined.
        truth: in the unit of the estimate.
        holds: whether what is said beside the number is right, such as the letter of a class; None where nothing is.
    """

    group: str
    estimate: Estimate | None
    truth: float
    holds: bool | None = None


def main(arguments: list[str]) -> int:
    """Run the bench and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("quantities", nargs="*", choices=[[], *BENCHES], metavar="QUANTITY", help=", ".join(BENCHES))
    parser.add_argument("--tires", type=int, default=24, help="tires to draw [default: 24]")
    parser.add_argument("--seed", type=int, default=1, help="seed of the draw [default: 1]")
    options = parser.parse_args(arguments)
    print(f"{'quantity':<40} runs  given   rms pull  max pull  beyond 2  median std  right")
    for name in options.quantities or BENCHES:
        pulls: list[Pull] = []
        for index in range(options.tires):
            pulls += BENCHES[name](options.seed, index)
        for group in dict.fromkeys(pull.group for pull in pulls):
            print(_row(group, [pull for pull in pulls if pull.group == group]))
    return 0


def _row(group: str, pulls: list[Pull]) -> str:
    estimated = [pull for pull in pulls if pull.estimate is not None and pull.estimate.status is not Status.INVALID]
    line = f"{group:<40} {len(pulls):4d}  {100 * len(estimated) / len(pulls):3.0f} %"
    if not estimated:
        return line
    errors = np.array([(pull.estimate.value - pull.truth) / pull.estimate.std for pull in estimated if pull.estimate])
    stds = np.median([pull.estimate.std for pull in estimated if pull.estimate])
    right = [pull.holds for pull in estimated if pull.holds is not None]
    return (
        f"{line} {math.sqrt(float(np.square(errors).mean())):10.2f} {errors[np.argmax(np.abs(errors))]:+9.2f} "
        f"{100 * float((np.abs(errors) > 2.0).mean()):6.0f} % {stds:11.3g}  "
        f"{f'{100 * np.mean(right):.0f} %' if right else ''}"
    ).rstrip()


def run(
    world: World,
    tables: str,
    estimators: tuple[str, ...],
    seed: int,
    *,
    tire: TireData | None = None,
    wheel: str = "",
    loads: str | None = None,
    radius: float = 1.0,
    seconds: float = SECONDS,
    stated: float | None = None,
) -> tuple[list[RevolutionResult], WheelTruth]:
    """Return the results of a wheel on a drawn tire, and the truth."""
    text = scenario_text(world, tables, seed, wheel, loads)
    simulation = simulate(parse_document(Scenario, text, "bench"), duration_s=seconds)
    setup = WheelSetup(
        "FL",
        0,
        0,
        radius * world.radius_m,
        load_n=stated,
        pressure_pa=world.pressure_pa,
        radius_std_m=0.01 * world.radius_m,
        tire=tire or TireData(),
    )
    pipeline, decoder = Pipeline((setup,), setup, estimators), FrameDecoder()
    results: list[RevolutionResult] = []
    for chunk in simulation.chunks("link", 10**18):
        results += pipeline.frames("link", decoder.feed(chunk.data), chunk.host_ns)
    return results + pipeline.finish(), simulation.truth["FL"]


def scenario_text(world: World, tables: str, seed: int, wheel: str = "", loads: str | None = None) -> str:
    """Return the scenario of one wheel on a drawn tire."""
    bs, cw, rs, ts = world.numbers
    speed = min(world.speed_kmh, 130.0)
    return f"""
[scenario]
seed = {seed}
[motion]
speed_kmh = [[0, {speed:.3f}], [{SECONDS}, {speed * (1.0 + 20.0 * world.drift_per_s):.3f}]]
[tire]
radius_mm = {1e3 * world.radius_m:.4f}
Bs = {bs:.6g}
Cw = {cw:.6g}
Rs = {rs:.6g}
Ts = {ts:.6g}
reference_pressure_kpa = {1e-3 * world.reference_pa:.4f}
tread_stiffness_mpa = {world.tread_mpa:.4f}
[sensor]
axes = ["circumferential", "radial"]
rate_hz = {RATE_HZ}
range_g = 2000
noise_mg_rthz = {world.noise_mg_rthz:.4f}
{tables}
[[wheel]]
position = "FL"
wheel = 0
load_n = {loads or world.load_n}
pressure_kpa = {1e-3 * world.pressure_pa:.4f}
{wheel}
"""


def last(results: list[RevolutionResult], name: str) -> Estimate | None:
    """Return an estimate of the last revolution."""
    return next((estimate for estimate in results[-1].estimates if estimate.name == name), None) if results else None


def road(seed: int, index: int) -> Iterator[Pull]:
    """Yield the class of a random road under a random vehicle, and of an even road with jitter of the edges."""
    world = draw_world(seed, index)
    rng = np.random.default_rng([seed, index, 8608])
    sprung = world.load_n / STANDARD_GRAVITY_MPS2
    unsprung = sprung / (1.0 + 8.0 * math.exp(0.3 * rng.standard_normal()))
    sprung -= unsprung
    spring = sprung * (2.0 * math.pi * rng.normal(1.3, 0.2)) ** 2
    (plan,) = wheel_plans(parse_document(Scenario, scenario_text(world, "", 1), "bench"))
    tire_npm = quarter_car(plan.tire, world.load_n, world.pressure_pa, unsprung, spring, 1.0).tire_npm
    hop = math.sqrt((tire_npm + spring) / unsprung)
    damper = 2.0 * 0.25 * math.exp(0.35 * rng.standard_normal()) * hop * unsprung
    letter = CLASSES[int(rng.integers(0, 4))]
    jitter = f"leading_jitter_mm = {rng.uniform(0.0, 1.0):.3f}\ntrailing_jitter_mm = {rng.uniform(0.0, 0.5):.3f}\n"
    table = (
        f"[road]\nprofile = '{letter}'\nunsprung_kg = {unsprung:.4f}\nsuspension_knpm = {1e-3 * spring:.4f}\n"
        f"damper_nspm = {damper:.3f}\n{jitter}"
    )
    results, _ = run(world, table, ("kinematic", "road"), 1000 * seed + index)
    result = last(results, "road_class")
    truth = 1.0 + CLASSES.index(letter)
    holds = None
    if result is not None and result.status is not Status.INVALID:
        holds = CLASSES[min(max(round(result.value), 1), 8) - 1] == letter
    yield Pull("road class", result, truth, holds)
    yield Pull(f"road class {letter}", result, truth, holds)


def cavity(seed: int, index: int) -> Iterator[Pull]:
    """Yield the gas of a random cavity: temperature with a calibrated length, ratio from the size, and another gas."""
    world = draw_world(seed, index)
    rng = np.random.default_rng([seed, index, 343])
    gas_degc = float(rng.uniform(0.0, 70.0))
    liner_degc = gas_degc + 6.0 * rng.standard_normal()
    rim_m = world.radius_m * rng.uniform(0.58, 0.68)
    length = math.pi * (world.radius_m + rim_m)
    wheel_hz = min(world.speed_kmh, 130.0) / 3.6 / (2.0 * math.pi * world.radius_m)
    half_split = abs(rng.normal(3.5, 1.5))
    # Either of the two is louder, or both are alike.
    split = rng.uniform(-1.0, 1.0) * (math.hypot(wheel_hz, half_split) - wheel_hz)
    for group, ratio, std, is_air in (
        ("cavity temperature, length to 0.3 %", 1.0, 0.003, True),
        ("cavity gas, length to 2 %", 1.0, 0.02, True),
        ("cavity gas, helium in it", 1.35, 0.01, False),
    ):
        hertz = math.sqrt(1.4 * 8.314462618 / 0.0289652 * (gas_degc + 273.15) * ratio) / length + split
        stated = length * (1.0 + std * rng.standard_normal())
        table = (
            f"[vibration]\ncavity_rms_mps2 = {rng.uniform(2.0, 8.0):.3f}\ncavity_hz = {hertz:.4f}\n"
            f"cavity_bandwidth_hz = {rng.uniform(3.0, 8.0):.3f}\n[road]\nrms_mps2 = {rng.uniform(0.5, 3.0):.3f}\n"
        )
        tire = TireData(cavity_length_m=stated, cavity_length_std_m=std * length)
        wheel = f"temperature_degc = {liner_degc:.3f}"
        results, _ = run(world, table, ("kinematic", "cavity"), 1000 * seed + index, tire=tire, wheel=wheel)
        name, truth = ("cavity_temperature_degc", gas_degc) if std < 0.005 else ("cavity_gas_ratio", ratio)
        result = last(results, name)
        flagged = result is not None and ForceCode.CAVITY_CONTRADICTED in codes_of(result.reasons)
        is_estimated = result is not None and result.status is not Status.INVALID
        yield Pull(group, result, truth, flagged is not is_air if is_estimated else None)


def distance(seed: int, index: int) -> Iterator[Pull]:
    """Yield distance and angular speed of a drive with a radius that is stated with an error of 1 %."""
    world = draw_world(seed, index)
    rng = np.random.default_rng([seed, index, 1])
    results, truth = run(
        world, "", ("kinematic", "distance"), 1000 * seed + index, radius=1.0 + 0.01 * rng.standard_normal()
    )
    shift_s = truth.hub_s(0.0)
    if not results:
        return
    first, final = results[0].revolution, results[-1].revolution
    ends = np.array([first.start_s, final.start_s + final.period_s]) - shift_s
    angles = truth.angle_rad(ends)
    yield Pull("distance", last(results, "distance_m"), world.radius_m * float(angles[1] - angles[0]))
    turn = truth.angle_rad(np.array([final.start_s, final.start_s + final.period_s]) - shift_s)
    omega = float(turn[1] - turn[0]) / final.period_s
    yield Pull("angular speed", last(results, "angular_speed_radps"), omega)
    yield Pull("rpm", last(results, "rotation_rpm"), omega * 30.0 / math.pi)


def load(seed: int, index: int) -> Iterator[Pull]:
    """Yield load and wear of a worn and warm tire that was calibrated new and cold."""
    world = draw_world(seed, index)
    rng = np.random.default_rng([seed, index, 310])
    rate, rate_std = 0.006 + 0.003 * rng.standard_normal(), 3e-4
    degc, wear_mm = float(rng.uniform(15.0, 65.0)), float(rng.uniform(0.0, 0.4)) * world.thickness_mm
    points = []
    for share in (0.7, 1.0, 1.3):
        stated_world = replace(world, load_n=share * world.load_n)
        results, _ = run(
            stated_world,
            "",
            ("kinematic", "weak-form"),
            index,
            seconds=8.0,
            wheel="temperature_degc = 25",
            stated=stated_world.load_n,
        )
        good = [result for result in results[5:] if not result.revolution.faults]
        if not good:
            return
        halves = [0.5 * (item.revolution.trailing_edge_rad - item.revolution.leading_edge_rad) for item in good]
        numbers = {estimate.name: estimate for estimate in good[-1].estimates}
        half = float(np.median(halves))
        points.append(TirePoint("", stated_world.load_n, 0.0, world.pressure_pa, half, numbers, temperature_degc=25.0))
    reference = reference_numbers(points, "weak-form")
    calibration = fit_load_calibration(points).calibration
    measured_rate = rate + rate_std * rng.standard_normal()
    bs, *others = world.numbers
    warm = replace(world, numbers=(bs * math.exp(-rate * (degc - 25.0)), *others))
    thick = 1e-3 * world.thickness_mm
    wheel = (
        f"temperature_degc = {degc:.4f}\n[wheel.tire]\nwear_mm = {wear_mm:.4f}\n"
        f"ring_thickness_mm = {world.thickness_mm:.4f}"
    )
    stated = 1e-3 * (wear_mm + 0.3 * rng.standard_normal())
    new = TireData(ring_thickness_m=thick, reference=reference, load_calibration=calibration)
    known_rate = replace(reference, softening_per_k=measured_rate, softening_std_per_k=rate_std)
    by_number = ("kinematic", "weak-form", "wear", "load")
    for name, tire, estimators, load_n in (
        ("by the bending number", new, by_number, None),
        ("by stated wear", replace(new, wear_m=stated, wear_std_m=3e-4), ("kinematic", "load"), None),
        ("wear unknown", replace(new, reference=ReferenceNumbers(temperature_degc=25.0)), ("kinematic", "load"), None),
        ("assumed coefficient", new, by_number, world.load_n),
        ("measured coefficient", replace(new, reference=known_rate), by_number, world.load_n),
    ):
        results, _ = run(warm, "", estimators, 1000 * seed + index, tire=tire, wheel=wheel, seconds=12.0, stated=load_n)
        if load_n is None:
            yield Pull(f"load by angle, {name}", last(results, "load_by_angle_n"), world.load_n)
        else:
            yield Pull(f"wear, {name}", last(results, "wear_mm"), wear_mm)


BENCHES: Final[dict[str, Callable[[int, int], Iterator[Pull]]]] = {
    "distance": distance,
    "load": load,
    "road": road,
    "cavity": cavity,
}

if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
