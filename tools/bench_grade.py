"""Road grade on random drives over hills, with braking, pulling away and curves.

    python tools/bench_grade.py [--drives COUNT] [--seed SEED] [--first NUMBER]

Nothing that makes the signals is the gateway's: a belt of finite elements rolls along a course, and what its sensor
reads is the position of that point in space, differentiated twice (tools/bench_turning.py). The sensor is askew about
all axes, the hub bounces, and the wheel slips with the force along its heading. The grade of a drive has a level of
its own, and a third of the drives has no other. False is valid and more than 3.5 errors off.
"""

import argparse
import math
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from bench_turning import DRIVES_A_TIRE, LANE_RADPS, LANE_S, RATE_HZ, Car, Tally, of, random_car, random_sensor, smooth
from independent_tire.driving import MARGIN, OVERSAMPLED, Course

from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.estimates.results import RevolutionResult
from gateway.core.types import FloatArray
from tools.generators.lateral_signals import disturbed, through_pipeline

G = STANDARD_GRAVITY_MPS2
SECONDS, SPEEDS_KMH = 45.0, (45.0, 110.0)
# Time within which drivers brake, and over which roads bend upward.
EASED_S, BEND_S = 0.8, 1.0
# Largest slip in the speed for 1 g along the heading.
LARGEST_SLIP = 0.08
BOUNCE_HZ = (8.0, 16.0)
ESTIMATORS = ["kinematic", "self-calibration", "ply-steer", "turning", "grade"]


def eased(time_s: FloatArray, changes: list[tuple[float, float]]) -> FloatArray:
    """Return a value that goes to others, (time, value), each within `EASED_S`."""
    total, before = np.zeros_like(time_s), 0.0
    for begin_s, value in changes:
        share = np.clip((time_s - begin_s) / EASED_S, 0.0, 1.0)
        total += (value - before) * share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
        before = value
    return total


def pace(rng: np.random.Generator, cruise_mps: float) -> list[tuple[float, float]]:
    """Return when a driver brakes, pulls away and holds the speed."""
    changes, time_s, speed = [], float(rng.uniform(4.0, 10.0)), cruise_mps
    while time_s < SECONDS:
        change = float(rng.uniform(0.5, 3.0)) * float(rng.choice([-1.0, 0.6]))
        lasts = float(rng.uniform(1.5, 4.0))
        if not 0.55 * cruise_mps < speed + change * lasts < 1.5 * cruise_mps:
            change = -change
        changes += [(time_s, change), (time_s + lasts, 0.0)]
        speed += change * lasts
        time_s += lasts + float(rng.uniform(3.0, 10.0))
    return changes


def curves(rng: np.random.Generator) -> list[tuple[float, float]]:
    """Return when the road bends, and the lateral acceleration."""
    changes, time_s = [], float(rng.uniform(3.0, 12.0))
    while time_s < SECONDS:
        lasts = float(rng.uniform(3.0, 6.0))
        changes += [(time_s, float(rng.uniform(0.1, 0.5) * rng.choice([-1.0, 1.0])) * G), (time_s + lasts, 0.0)]
        time_s += lasts + float(rng.uniform(4.0, 12.0))
    return changes


def bounce_m(rng: np.random.Generator, step_s: float, count: int, rms_mps2: float) -> FloatArray:
    """Return the place of a hub that bounces."""
    frequency = np.fft.rfftfreq(count, step_s)
    band = (frequency > BOUNCE_HZ[0]) & (frequency < BOUNCE_HZ[1])
    spectrum = np.zeros(len(frequency), complex)
    spectrum[band] = (rng.normal(size=band.sum()) + 1j * rng.normal(size=band.sum())) / np.square(
        2.0 * math.pi * frequency[band]
    )
    acceleration = np.fft.irfft(-np.square(2.0 * math.pi * frequency) * spectrum, count)
    lift: FloatArray = np.fft.irfft(spectrum, count) * rms_mps2 / acceleration.std()
    return lift


def course_of(car: Car, rng: np.random.Generator) -> Course:
    """Return a random course over hills."""
    step = 1.0 / (RATE_HZ * OVERSAMPLED)
    time = step * np.arange(round(SECONDS / step) + 2 * MARGIN)
    cruise = float(rng.uniform(*SPEEDS_KMH)) / 3.6
    driven = eased(time, pace(rng, cruise))
    speed = cruise + np.cumsum(driven) * step + smooth(rng, time, 0.2, 4.0, BEND_S)
    lateral = eased(time, curves(rng))
    level = math.radians(rng.normal(0.0, 1.5))
    hills = math.radians(2.5) * float(rng.random() < 2.0 / 3.0)
    grade = level + smooth(rng, time, hills, float(rng.uniform(5.0, 12.0)), BEND_S)
    force = np.gradient(speed, step) + G * np.sin(grade)
    yaw = lateral / speed + smooth(rng, time, LANE_RADPS, LANE_S)
    camber = rng.normal(0.0, math.radians(2.0)) * lateral / G
    bank = smooth(rng, time, math.radians(2.0), 8.0, BEND_S)
    return Course(
        step,
        speed,
        np.cumsum(yaw) * step,
        car.slip_rad(speed * yaw + G * bank),
        camber,
        grade,
        bank,
        bounce_m(rng, step, len(time), float(rng.uniform(0.0, 1.0))),
        float(rng.uniform(0.0, LARGEST_SLIP)) * force / G,
    )


def drive(car: Car, rng: np.random.Generator) -> tuple[list[RevolutionResult], Course]:
    """Return the revolutions of a random drive, and its course."""
    sensor = replace(random_sensor(rng), pitch_rad=math.radians(rng.normal(0.0, 1.0)))
    course = course_of(car, rng)
    values = disturbed(car.tire.felt(course, 0.0)[0], sensor)
    return through_pipeline(values, sensor, ESTIMATORS, load_n=car.load_n, pressure_pa=car.pressure_pa), course


def grade_of(result: RevolutionResult, course: Course) -> float:
    """Return the mean grade of a revolution, NaN beyond the end."""
    grade = course.grade_rad[MARGIN:-MARGIN:OVERSAMPLED]
    begin = round(result.revolution.start_s * RATE_HZ)
    within = grade[begin : begin + round(result.revolution.period_s * RATE_HZ)]
    return float(within.mean()) if len(within) else math.nan


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--drives", type=int, default=200)
    parser.add_argument("--seed", type=int, default=21)
    parser.add_argument("--first", type=int, default=0, help="number of the first drive")
    arguments = parser.parse_args()
    hilly, steady, count = Tally(), Tally(), 0
    car = None
    for number in range(arguments.first, arguments.first + arguments.drives):
        if car is None or number % DRIVES_A_TIRE == 0:
            car = random_car(np.random.default_rng((arguments.seed, number // DRIVES_A_TIRE, 0)))
        results, course = drive(car, np.random.default_rng((arguments.seed, number, 1)))
        tally = hilly if np.ptp(course.grade_rad) > 1e-9 else steady
        for result in results:
            count += 1
            tally.add(of(result, "road_grade_rad"), grade_of(result, course))
    print(f"{arguments.drives} drives from {arguments.first}, seed {arguments.seed}, {count} revolutions")
    print(hilly.line("hills"))
    print(steady.line("one steady grade"))


if __name__ == "__main__":
    main()
