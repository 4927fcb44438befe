"""A car of finite-element tires that drives nine curves; what its sensors read are positions, differentiated twice."""

import math
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from independent_tire.driving import MARGIN, OVERSAMPLED, Course, DrivenTire
from independent_tire.sideways import Sides
from independent_tire.steady import roll_steadily
from independent_tire.tires import TIRES

from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.estimates.results import RevolutionResult
from gateway.core.types import FloatArray
from tools.generators.lateral_signals import Sensor, disturbed, through_pipeline

TRACK_M, WHEELBASE_M, SPEED_MPS = 1.55, 2.7, 11.0
RATE_HZ = 4800.0
STEP_S = 1.0 / (RATE_HZ * OVERSAMPLED)
LOAD_N = 4200.0
SLIPS_RAD = np.radians([-4.0, -2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0, 4.0])
# Straights and curves in turn: seconds and lateral acceleration.
PARTS = [
    part
    for seconds, acceleration in zip(
        (3.0, 4.0, 3.5, 3.0, 4.5, 3.0, 3.5, 4.0, 3.0),
        (2.2, -1.5, 2.8, 1.2, -2.5, -1.8, 2.0, -2.8, 1.6),
        strict=True,
    )
    for part in ((3.0, 0.0), (seconds, acceleration))
] + [(14.0, 0.0)]
NAMES = ("ply-steer", "turning")


@dataclass(frozen=True)
class Drive:
    """Yaw rate of the body and heading, at (n,) times since the start."""

    time_s: FloatArray
    yaw_radps: FloatArray
    heading_rad: FloatArray


@cache
def tire() -> DrivenTire:
    belt = replace(TIRES[0], elements=240, friction=0.8, slip_scale=0.04)
    sides = Sides(1.6e6, 1e3, 2.5e5, 8e6, 1.0, coupling_m=1.2e-3)
    return DrivenTire(roll_steadily(belt, LOAD_N), sides, SLIPS_RAD, 5e-3)


@cache
def _course(*, straight: bool) -> Course:
    ends = np.cumsum([seconds for seconds, _ in PARTS])
    time = STEP_S * np.arange(round(ends[-1] / STEP_S) + 2 * MARGIN)
    acceleration, before = np.zeros_like(time), 0.0
    for end, (_, after) in zip(ends, [*PARTS[1:], (0.0, 0.0)], strict=True):
        share = np.clip((time - end) / 0.8 + 0.5, 0.0, 1.0)
        acceleration += (after - before) * share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
        before = after
    if straight:
        acceleration = np.zeros_like(time)
    rng = np.random.default_rng(8)
    corners = np.arange(0.0, time[-1] + 2.0, 1.5)
    lane = np.interp(time, corners, rng.normal(0.0, 0.004, len(corners)))
    forces = tire().forces_n - tire().forces_n[len(SLIPS_RAD) // 2]
    slip = np.interp(LOAD_N / STANDARD_GRAVITY_MPS2 * acceleration, forces, SLIPS_RAD)
    none = np.zeros_like(time)
    heading = np.cumsum(acceleration / SPEED_MPS + lane) * STEP_S
    return Course(STEP_S, np.full_like(time, SPEED_MPS), heading, slip, none, none, none)


def drive() -> Drive:
    """Return how the body turns."""
    course = _course(straight=False)
    heading = course.heading_rad + course.slip_rad
    return Drive(STEP_S * np.arange(len(heading)), np.gradient(heading, STEP_S), heading)


@cache
def results(
    position: str, gain: float = 1.0, *, straight: bool = False, offset_mps2: float = 0.2
) -> tuple[RevolutionResult, ...]:
    """Return the revolutions of a wheel whose lateral axis has a gain; a front wheel is steered."""
    sensor = Sensor(
        rate_hz=RATE_HZ,
        noise_mg=3.0,
        roll_rad=math.radians(0.6),
        lateral_offset_mps2=offset_mps2,
        road_mps2=0.5,
        seed=sum(map(ord, position)),
    )
    values = disturbed(_felt(position, straight=straight), sensor)
    values[:, 1] *= gain
    return tuple(through_pipeline(values, sensor, NAMES, load_n=LOAD_N, position=position))


@cache
def _felt(position: str, *, straight: bool) -> FloatArray:
    course = _course(straight=straight)
    if position.startswith("F"):
        rate = np.gradient(course.heading_rad + course.slip_rad, STEP_S)
        course = replace(course, heading_rad=course.heading_rad + WHEELBASE_M / SPEED_MPS * rate)
    return tire().felt(course, (0.5 if position.endswith("L") else -0.5) * TRACK_M)[0]
