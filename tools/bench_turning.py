"""Ply steer and roll on random drives of straights and curves.

    python -m tools.bench_turning [--drives COUNT] [--seed SEED]

Each drive has a random tire, sensor and speed, then straights and curves of up to 0.5 g; a fifth begin in a curve. In
curves the tire slips by what its side force needs, and camber and bank of 2 deg (one standard deviation) disturb the
mean. What turning adds is that of a rigid rim, which positions differentiated twice confirm
(tests/ring/test_turning_wheel.py). The ply steer is compared with that of the same samples without it: false is valid
and more than 3.5 errors off.
"""

import argparse
import math

import numpy as np

from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.estimates.estimator import Status
from gateway.core.types import FloatArray
from gateway.forces.lateral_belt import solve_lateral_belt
from gateway.ring.turning_wheel import HubMotion, turning_acceleration
from tools.bench_lateral import Case, random_cases
from tools.generators.lateral_signals import RADIUS_M, lateral, samples, through_pipeline

SPEEDS_KMH = (50.0, 110.0)
BANK_RAD = math.radians(2.0)
COMPARED = ("ply_steer_ahead_rad", "ply_steer_contact_line_rad", "ply_steer_peak_rad", "sensor_roll_rad")
FALSE_ERRORS = 3.5


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

    def signals(self) -> tuple[FloatArray, FloatArray]:
        """Return samples with and without turning, (n, 3) each."""
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
        bank = rng.normal(0.0, BANK_RAD, len(ends))[part] * (yaw != 0.0)
        motion = HubMotion(turn_radps=yaw, left_mps2=self.speed_mps * yaw, bank_rad=bank)
        moving = still + turning_acceleration(phase, omega, RADIUS_M, motion)
        moving[:, 1] += motion.force_mps2()[:, 1]
        return moving, still


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--drives", type=int, default=200)
    parser.add_argument("--seed", type=int, default=11)
    arguments = parser.parse_args()
    valid, false = dict.fromkeys(COMPARED, 0), dict.fromkeys(COMPARED, 0)
    for number, case in enumerate(random_cases(arguments.drives, arguments.seed)):
        drive = Drive(case, np.random.default_rng((arguments.seed, number)))
        moving, still = drive.signals()
        results = through_pipeline(moving, case.sensor, ["ply-steer"])
        straight = through_pipeline(still, case.sensor, ["ply-steer"])
        for result, other in zip(results, straight, strict=False):
            reference = {estimate.name: estimate.value for estimate in other.estimates}
            for estimate in result.estimates:
                if estimate.name in COMPARED and estimate.status is Status.VALID:
                    away = abs(estimate.value - reference[estimate.name])
                    valid[estimate.name] += 1
                    false[estimate.name] += away > FALSE_ERRORS * estimate.std
    print(f"{arguments.drives} drives, seed {arguments.seed}")
    for name in COMPARED:
        print(f"{name:28s} valid {valid[name]:6d}  false {100.0 * false[name] / max(valid[name], 1):.2f} %")


if __name__ == "__main__":
    main()
