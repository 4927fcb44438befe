"""Turn and camber rate, ply steer, conicity, belt shift, roll and signs of lateral axes on random drives with curves.

    python tools/bench_turning.py [--drives COUNT] [--seed SEED] [--first NUMBER] [--bank DEG]

Nothing that makes the signals is the gateway's: a belt of finite elements (tools/independent_tire) rolls along a
course, and what its sensor reads is the position of that point in space, differentiated twice. Each drive has a
random tire, sensor, speed, grade and bank, then straights and curves of up to 0.5 g that begin and end within a
second. A fifth begin in a curve. On straights the car keeps its lane; the tire slips by what its side force needs, on
a bank too, and cambers in curves. Ply steer, conicity and shift are compared with those of the same tire under the same
slip on a straight, level road, the roll with the sensor's own, turn and camber rate with their means over each
revolution, also where curves begin and end: false is valid and more than 3.5 errors off. Two wheels of an axle drive a
curve of 0.1 g for 3 s, the lateral axis of each to the left or to the right.
"""

import argparse
import itertools
import math
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from independent_tire.driving import MARGIN, OVERSAMPLED, Course, DrivenTire
from independent_tire.rolling import Belt
from independent_tire.sideways import Sides
from independent_tire.steady import roll_steadily

from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.estimates.estimator import Estimate, Status
from gateway.core.estimates.results import RevolutionResult
from gateway.core.trust.reasons import TrustCode
from gateway.core.trust.wheel_pairs import WheelPairs
from gateway.core.types import FloatArray
from tools.generators.lateral_signals import Sensor, disturbed, through_pipeline

G = STANDARD_GRAVITY_MPS2
RADIUS_M, RATE_HZ = 0.32, 9600.0
SPEEDS_KMH = (50.0, 110.0)
SLIPS_RAD = np.radians([-8.0, -5.0, -3.0, -2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0, 3.0, 5.0, 8.0])
# Drives of one tire, each with a sensor of its own.
DRIVES_A_TIRE = 10
# Yaw rate of straights, and the time over which it lasts.
LANE_RADPS, LANE_S, STEP_S = 0.006, 1.5, 0.1
COMPARED = (
    "ply_steer_ahead_rad",
    "ply_steer_contact_line_rad",
    "ply_steer_peak_rad",
    "conicity_slope_rad",
    "belt_shift_m",
    "sensor_roll_rad",
)
FALSE_ERRORS = 3.5
CLEAR_CURVE = (0.1 * G, 3.0)


@dataclass(frozen=True, slots=True, eq=False)
class Car:
    """A tire, its load and pressure."""

    tire: DrivenTire
    load_n: float
    pressure_pa: float

    def slip_rad(self, acceleration_mps2: FloatArray) -> FloatArray:
        """Return the slip angles whose side force carries the wheel's part of the car, gravity on a bank included."""
        forces = self.tire.forces_n - np.interp(0.0, SLIPS_RAD, self.tire.forces_n)
        slip: FloatArray = np.interp(self.load_n / G * acceleration_mps2, forces, SLIPS_RAD)
        return slip


def random_car(rng: np.random.Generator) -> Car:
    """Return a random car tire."""
    bs, cw, rs, ts = np.array([3.0833e-3, 0.1953, 2.9740, 2.5289]) * np.exp(rng.normal(0.0, 0.1, 4))
    pressure, load = float(rng.uniform(1.8e5, 3e5)), float(rng.uniform(2500.0, 6500.0))
    belt = Belt(
        name="driven",
        radius_m=RADIUS_M,
        pressure_pa=pressure,
        tension_width_m=cw * RADIUS_M,
        bending_nm2=bs * RADIUS_M**4 * 2.1e5,
        extension_n=2e7,
        radial_npm2=rs * (0.5 * 2.1e5 + 0.5 * pressure),
        tangential_npm2=ts * (0.5 * 2.1e5 + 0.5 * pressure),
        mass_kgpm=3.5,
        tread_npm2=7e7,
        speed_mps=80.0 / 3.6,
        sinking_m=0.02,
        sidewall_damping_nspm2=float(rng.uniform(0.0, 120.0)),
        friction=0.8,
        slip_scale=0.04,
        elements=480,
    )
    sides = Sides(
        shear_n=float(10 ** rng.uniform(5.5, 6.4)),
        bending_nm2=float(10 ** rng.uniform(2.5, 3.6)),
        sidewall_npm2=float(10 ** rng.uniform(5.0, 5.7)),
        tread_npm2=float(10 ** rng.uniform(6.5, 7.1)),
        friction=float(rng.uniform(0.7, 1.2)),
        coupling_m=float(rng.uniform(0.8e-3, 2.5e-3) * rng.choice([-1.0, 1.0])),
        conicity_rad=math.radians(rng.uniform(-0.6, 0.6)),
    )
    return Car(DrivenTire(roll_steadily(belt, load), sides, SLIPS_RAD, 5e-3), load, pressure)


def random_sensor(rng: np.random.Generator) -> Sensor:
    """Return a sensor that is glued by hand."""
    return Sensor(
        rate_hz=RATE_HZ,
        noise_mg=float(10 ** rng.uniform(-0.3, 1.2)),
        roll_rad=math.radians(rng.normal(0.0, 1.0)),
        yaw_rad=math.radians(rng.normal(0.0, 1.0)),
        lateral_offset_mps2=float(rng.normal(0.0, 0.7)),
        road_mps2=float(rng.uniform(0.0, 2.0)),
        seed=int(rng.integers(2**31)),
    )


def smooth(
    rng: np.random.Generator, time_s: FloatArray, std: float, lasts_s: float, step_s: float = STEP_S
) -> FloatArray:
    """Return noise of first order that lasts for a time, its corners rounded over a step."""
    count = int(time_s[-1] / step_s) + 5
    keep = math.exp(-step_s / lasts_s)
    values = np.empty(count)
    values[0] = rng.normal(0.0, std)
    for index in range(1, count):
        values[index] = keep * values[index - 1] + rng.normal(0.0, std * math.sqrt(1.0 - keep**2))
    eased = time_s / step_s
    number = eased.astype(np.int64)
    share = eased - number
    share = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
    result: FloatArray = values[number] + share * (values[number + 1] - values[number])
    return result


def course_of(
    car: Car, parts: list[tuple[float, float]], speed_mps: float, bank_std_rad: float, rng: np.random.Generator
) -> Course:
    """Return a course of parts, (seconds, lateral acceleration in m/s^2, 0 of a straight), each with its bank."""
    step = 1.0 / (RATE_HZ * OVERSAMPLED)
    time = step * np.arange(round(sum(seconds for seconds, _ in parts) / step) + 2 * MARGIN)
    acceleration, bank, at = (
        np.full(len(time), parts[0][1]),
        np.full(len(time), rng.normal(0.0, bank_std_rad)),
        0.0,
    )
    for (seconds, before), (_, after) in itertools.pairwise(parts):
        at += seconds
        begins_s = rng.uniform(0.4, 1.0)
        share = np.clip((time - at) / begins_s + 0.5, 0.0, 1.0)
        share = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
        acceleration += (after - before) * share
        bank += share * (rng.normal(0.0, bank_std_rad) - bank)
    speed = speed_mps + smooth(rng, time, 0.4, 4.0)
    yaw = acceleration / speed + smooth(rng, time, LANE_RADPS, LANE_S)
    return Course(
        step,
        speed,
        np.cumsum(yaw) * step,
        # The tires carry what a sideways level reads: the path's acceleration and gravity on the bank.
        car.slip_rad(speed * yaw + G * bank),
        rng.normal(0.0, math.radians(2.0)) * acceleration / G,
        smooth(rng, time, math.radians(2.5), 8.0),
        bank,
    )


def results_of(
    car: Car, sensor: Sensor, felt: FloatArray, names: list[str], position: str = "FL", lateral: float = 1.0
) -> list[RevolutionResult]:
    """Return the revolutions of a wheel whose lateral axis has a factor."""
    values = disturbed(felt, sensor)
    values[:, 1] *= lateral
    return through_pipeline(values, sensor, names, load_n=car.load_n, pressure_pa=car.pressure_pa, position=position)


def of(result: RevolutionResult, name: str) -> Estimate | None:
    """Return an estimate by its name."""
    return next((estimate for estimate in result.estimates if estimate.name == name), None)


class Tally:
    """Errors of a quantity, and how many valid ones are false."""

    def __init__(self) -> None:
        self.errors: list[float] = []
        self.standard: list[float] = []

    def add(self, estimate: Estimate | None, truth: float) -> None:
        """Add an estimate if it is valid."""
        if estimate is not None and estimate.status is Status.VALID and math.isfinite(truth):
            self.errors.append(estimate.value - truth)
            self.standard.append(self.errors[-1] / estimate.std)

    def line(self, name: str) -> str:
        """Return the figures."""
        if not self.errors:
            return f"{name:28s} valid      0"
        errors, standard = np.array(self.errors), np.array(self.standard)
        return (
            f"{name:28s} valid {len(errors):6d}  rms {np.sqrt(np.mean(errors**2)):.4g}  "
            f"median {np.median(np.abs(errors)):.4g}  pulls {np.sqrt(np.mean(standard**2)):.2f}  "
            f"false {100.0 * np.mean(np.abs(standard) > FALSE_ERRORS):.2f} %"
        )


def within(result: RevolutionResult, values: FloatArray) -> FloatArray:
    """Return what varies during a revolution."""
    begin = round(result.revolution.start_s * RATE_HZ)
    return values[begin : begin + round(result.revolution.period_s * RATE_HZ)]


def drive(car: Car, bank_std_rad: float, rng: np.random.Generator, tallies: dict[str, Tally]) -> int:
    """Drive, and return the number of straight revolutions with a valid curve radius."""
    parts: list[tuple[float, float]] = []
    for _ in range(rng.integers(2, 5)):
        acceleration = float(rng.uniform(0.1, 0.5) * rng.choice([-1.0, 1.0])) * G
        parts += [(float(rng.uniform(2.0, 8.0)), 0.0), (float(rng.uniform(3.0, 6.0)), acceleration)]
    if rng.random() < 0.2:
        parts = parts[1:]
    sensor = random_sensor(rng)
    course = course_of(car, parts, float(rng.uniform(*SPEEDS_KMH)) / 3.6, bank_std_rad, rng)
    felt, _, yaw = car.tire.felt(course, 0.0)
    cambering = np.gradient(course.camber_rad + course.bank_rad, course.step_s)[MARGIN::OVERSAMPLED]
    still = car.tire.felt(course.straight(), 0.0, paced_by=course)[0]
    names = ["kinematic", "self-calibration", "ply-steer", "turning", "side-force"]
    results = results_of(car, sensor, felt, names)
    straight = {
        round(result.revolution.start_s / result.revolution.period_s * 2.0): result
        for result in results_of(car, sensor, still, ["ply-steer", "side-force"])
    }
    radii = 0
    for result in results:
        rates = within(result, yaw)
        if not len(rates):
            continue
        tallies["turn_rate_radps"].add(of(result, "turn_rate_radps"), float(rates.mean()))
        tallies["camber_rate_radps"].add(of(result, "camber_rate_radps"), float(within(result, cambering).mean()))
        radius = of(result, "curve_radius_m")
        radii += radius is not None and radius.status is Status.VALID and float(np.abs(rates).max()) < LANE_RADPS
        other = straight.get(round(result.revolution.start_s / result.revolution.period_s * 2.0))
        for name in COMPARED:
            same = None if other is None else of(other, name)
            truth = sensor.roll_rad if name == "sensor_roll_rad" else math.nan if same is None else same.value
            tallies[name].add(of(result, name), truth)
    return radii


def axle(car: Car, bank_std_rad: float, rng: np.random.Generator, axes: tuple[float, float]) -> list[RevolutionResult]:
    """Return the latest results of two wheels that drove a clear curve, with what their pair says."""
    seconds, curve = CLEAR_CURVE[1], CLEAR_CURVE[0] * float(rng.choice([-1.0, 1.0]))
    speed = float(rng.uniform(*SPEEDS_KMH)) / 3.6
    course = course_of(car, [(5.0, 0.0), (seconds + 1.0, curve), (12.0, 0.0)], speed, bank_std_rad, rng)
    half_m = 0.5 * float(rng.uniform(1.3, 1.8))
    taken = []
    for position, left_m, axis in zip(("FL", "FR"), (half_m, -half_m), axes, strict=True):
        felt = car.tire.felt(course, left_m)[0]
        taken += results_of(car, random_sensor(rng), felt, ["ply-steer", "turning", "side-force"], position, axis)
    latest = {result.position: result for result, _ in WheelPairs().compared(taken)}
    return [latest["FL"], latest["FR"]]


def shown_axis(result: RevolutionResult) -> int:
    """Return 1 where the axis is shown to point to the left, -1 to the right, 0 where it is open."""
    codes = {reason.code for estimate in result.estimates for reason in estimate.reasons}
    if TrustCode.LATERAL_AXIS_REVERSED in codes:
        return -1
    return 0 if TrustCode.LATERAL_SIGN_UNVERIFIED in codes else 1


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--drives", type=int, default=200)
    parser.add_argument("--seed", type=int, default=11)
    parser.add_argument("--first", type=int, default=0, help="number of the first drive")
    parser.add_argument("--bank", type=float, default=2.0, help="standard deviation of the road's bank, deg")
    arguments = parser.parse_args()
    bank_std_rad = math.radians(arguments.bank)
    tallies = {name: Tally() for name in ("turn_rate_radps", "camber_rate_radps", *COMPARED)}
    signs, radii = {1: 0, 0: 0, -1: 0}, 0
    car = None
    for number in range(arguments.first, arguments.first + arguments.drives):
        if car is None or number % DRIVES_A_TIRE == 0:
            car = random_car(np.random.default_rng((arguments.seed, number // DRIVES_A_TIRE, 0)))
        radii += drive(car, bank_std_rad, np.random.default_rng((arguments.seed, number, 1)), tallies)
        rng = np.random.default_rng((arguments.seed, number, 2))
        axes = tuple(float(axis) for axis in rng.choice([-1.0, 1.0], 2))
        for result, axis in zip(axle(car, bank_std_rad, rng, (axes[0], axes[1])), axes, strict=True):
            signs[int(shown_axis(result) * axis)] += 1
    print(f"{arguments.drives} drives from {arguments.first}, seed {arguments.seed}, bank {arguments.bank:g} deg")
    for name, tally in tallies.items():
        print(tally.line(name))
    print(f"valid curve radius on a straight: {radii}")
    print(f"sign of the axis by a curve of 0.1 g for 3 s: {signs[1]} right, {signs[0]} open, {signs[-1]} wrong")


if __name__ == "__main__":
    main()
