"""Turn rate and ply steer on random drives of straights and curves.

    python -m tools.bench_turning [--drives COUNT] [--seed SEED]

Each drive has a random tire, sensor and speed, then straights and curves of up to 0.5 g; a fifth begin in a curve. On
straights the car keeps its lane. In curves the tire slips by what its side force needs. Camber and bank of 2 deg (one
standard deviation) disturb the mean. What turning adds is that of a rigid rim, which positions differentiated twice
confirm (tests/ring/test_turning_wheel.py). The ply steer is compared with that of the same samples without it: false is
valid and more than 3.5 errors off.
"""

import argparse
import math

import numpy as np

from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.estimates.estimator import Status
from gateway.core.estimates.results import RevolutionResult
from gateway.core.trust.lateral_signs import TURN_RATE, LateralSign
from gateway.core.types import FloatArray
from gateway.forces.lateral_belt import solve_lateral_belt
from gateway.ring.turning_wheel import HubMotion, turning_acceleration
from tools.bench_lateral import Case, random_cases
from tools.generators.lateral_signals import RADIUS_M, lateral, samples, through_pipeline

SPEEDS_KMH = (50.0, 110.0)
BANK_RAD = math.radians(2.0)
# Yaw rate of straights, and the time over which it lasts.
LANE_RADPS, LANE_S, STEP_S = 0.006, 1.5, 0.1
COMPARED = ("ply_steer_ahead_rad", "ply_steer_contact_line_rad", "ply_steer_peak_rad", "sensor_roll_rad")
FALSE_ERRORS = 3.5
# Change of the yaw rate that begins or ends a curve.
SAME_RADPS = 0.02
# Scatter of the ratio of two wheels' speeds in a revolution.
SPEED_RATIO_STD = 5e-4
# Lateral acceleration and duration of a curve that must show the sign of a lateral axis.
CLEAR_CURVE = (0.1 * STANDARD_GRAVITY_MPS2, 3.0)


def wander(duration_s: float, rate_hz: float, rng: np.random.Generator) -> FloatArray:
    """Return the yaw rate of a lane that is kept, rad/s: noise of first order."""
    steps = int(duration_s / STEP_S) + 2
    keep = math.exp(-STEP_S / LANE_S)
    values = np.empty(steps)
    values[0] = rng.normal(0.0, LANE_RADPS)
    for step in range(1, steps):
        values[step] = keep * values[step - 1] + rng.normal(0.0, LANE_RADPS * math.sqrt(1.0 - keep**2))
    return np.interp(np.arange(math.ceil(duration_s * rate_hz) + 1) / rate_hz, STEP_S * np.arange(steps), values)


class Drive:
    """A random drive: turn of each revolution, and samples with and without what turning makes."""

    def __init__(self, case: Case, rng: np.random.Generator) -> None:
        self.case, self.rng = case, rng
        self.speed_mps = float(rng.uniform(*SPEEDS_KMH)) / 3.6
        turns_per_s = self.speed_mps / (2.0 * math.pi * RADIUS_M)
        self.parts: list[tuple[int, float]] = []
        for _ in range(rng.integers(2, 5)):
            acceleration = float(rng.uniform(0.1, 0.5) * rng.choice([-1.0, 1.0])) * STANDARD_GRAVITY_MPS2
            for seconds, size in ((rng.uniform(2.0, 8.0), 0.0), (rng.uniform(3.0, 6.0), acceleration)):
                self.parts.append((round(seconds * turns_per_s), size))
        if rng.random() < 0.2:
            # A fifth begin in the curve.
            self.parts = self.parts[1:]

    def signals(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return samples with and without turning, (n, 3) each, and the yaw rate at each, (n,)."""
        case, rng = self.case, self.rng
        slip = math.radians(0.5)
        neutral, pulled = (lateral(case.ring, case.belt, angle).side_force_n for angle in (0.0, slip))
        mass = case.ring.load_n / STANDARD_GRAVITY_MPS2
        shapes = []
        for count, size in self.parts:
            angle = float(np.clip(mass * size / (pulled - neutral) * slip, -0.08, 0.08))
            shapes.append((count, solve_lateral_belt(case.ring, case.belt, slip_angle_rad=angle)))
        still = samples(case.ring, shapes, case.sensor, speed_kmh=3.6 * self.speed_mps)
        omega = self.speed_mps / RADIUS_M
        phase = omega * np.arange(len(still)) / case.sensor.rate_hz - 0.7 * math.pi
        turned = np.floor((phase + math.pi) / (2.0 * math.pi))
        ends = np.cumsum([count for count, _ in self.parts])
        part = np.minimum(np.searchsorted(ends, turned, side="right"), len(ends) - 1)
        yaw = np.array([size / self.speed_mps for _, size in self.parts])[part]
        bank = rng.normal(0.0, BANK_RAD, len(ends))[part]
        yaw += (yaw == 0.0) * wander(len(yaw) / case.sensor.rate_hz, case.sensor.rate_hz, rng)[: len(yaw)]
        motion = HubMotion(turn_radps=yaw, left_mps2=self.speed_mps * yaw, bank_rad=bank)
        moving = still + turning_acceleration(phase, omega, RADIUS_M, motion)
        moving[:, 1] += motion.force_mps2()[:, 1]
        return moving, still, yaw


def pulls(results: list[RevolutionResult], yaw: FloatArray, rate_hz: float) -> tuple[list[float], list[float]]:
    """Return the turn rate's errors in rad/s and in standard errors, valid revolutions of one turn only."""
    errors, standard = [], []
    for result in results:
        revolution = result.revolution
        begin = round(revolution.start_s * rate_hz)
        during = yaw[begin : begin + round(revolution.period_s * rate_hz)]
        turn = next(estimate for estimate in result.estimates if estimate.name == "turn_rate_radps")
        # The revolution in which a curve begins or ends has no one rate.
        if turn.status is Status.VALID and len(during) and np.ptp(during) < SAME_RADPS:
            errors.append(turn.value - float(during.mean()))
            standard.append(errors[-1] / turn.std)
    return errors, standard


def shown_sign(case: Case, rng: np.random.Generator) -> tuple[int, int]:
    """Return the sign of a lateral axis that the first curve of two wheels shows, and the true one."""
    drive = Drive(case, rng)
    seconds = 2.0 * math.pi * RADIUS_M / drive.speed_mps
    curve, duration_s = CLEAR_CURVE[0] * float(rng.choice([-1.0, 1.0])), CLEAR_CURVE[1]
    drive.parts = [(round(time / seconds), size) for time, size in ((5.0, 0.0), (duration_s, curve), (4.0, 0.0))]
    moving, _, yaw = drive.signals()
    axis = int(rng.choice([-1, 1]))
    moving[:, 1] *= axis
    track_m, radii = rng.uniform(1.2, 2.0), 1.0 + rng.normal(0.0, 0.01)
    sign, rate_hz = LateralSign(), case.sensor.rate_hz
    for result in through_pipeline(moving, case.sensor, ["turning"]):
        turn = next(estimate for estimate in result.estimates if estimate.name == TURN_RATE)
        begin = round(result.revolution.start_s * rate_hz)
        rate = float(yaw[begin : begin + round(result.revolution.period_s * rate_hz)].mean())
        ratio = radii * (1.0 + rate * track_m / drive.speed_mps + rng.normal(0.0, SPEED_RATIO_STD))
        if turn.status is not Status.INVALID:
            sign.take(turn.value, drive.speed_mps, ratio)
    return sign.sign, axis


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--drives", type=int, default=200)
    parser.add_argument("--seed", type=int, default=11)
    arguments = parser.parse_args()
    errors: list[float] = []
    standard: list[float] = []
    signs = {1: 0, 0: 0, -1: 0}
    valid, false = dict.fromkeys(COMPARED, 0), dict.fromkeys(COMPARED, 0)
    for number, case in enumerate(random_cases(arguments.drives, arguments.seed)):
        drive = Drive(case, np.random.default_rng((arguments.seed, number)))
        moving, still, yaw = drive.signals()
        results = through_pipeline(moving, case.sensor, ["ply-steer", "turning"])
        straight = through_pipeline(still, case.sensor, ["ply-steer"])
        rate_errors, rate_pulls = pulls(results, yaw, case.sensor.rate_hz)
        errors += rate_errors
        standard += rate_pulls
        shown, axis = shown_sign(case, np.random.default_rng((arguments.seed, number, 1)))
        signs[shown * axis] += 1
        for result, other in zip(results, straight, strict=False):
            reference = {estimate.name: estimate.value for estimate in other.estimates}
            for estimate in result.estimates:
                if estimate.name in COMPARED and estimate.status is Status.VALID:
                    away = abs(estimate.value - reference[estimate.name])
                    valid[estimate.name] += 1
                    false[estimate.name] += away > FALSE_ERRORS * estimate.std
    print(f"{arguments.drives} drives, seed {arguments.seed}, {len(errors)} valid turn rates")
    print(
        f"turn rate: rms error {np.sqrt(np.mean(np.square(errors))):.4f} rad/s, median {np.median(np.abs(errors)):.4f}"
    )
    over = np.mean(np.abs(standard) > FALSE_ERRORS)
    print(f"           pulls {np.std(standard):.2f}, beyond {FALSE_ERRORS} errors {100.0 * over:.2f} %")
    print(f"sign of the axis by a curve of 0.1 g for 3 s: {signs[1]} right, {signs[0]} open, {signs[-1]} wrong")
    for name in COMPARED:
        print(f"{name:28s} valid {valid[name]:6d}  false {100.0 * false[name] / max(valid[name], 1):.2f} %")


if __name__ == "__main__":
    main()
