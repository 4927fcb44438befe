"""Size of the terms of a turn, and what they do to ply steer, conicity and roll before and after their removal.

    python tools/bench_turn_terms.py

The sizes are the largest of a revolution on an axis. Then a simulated tire rolls on a flat road at 65 km/h. The terms
are added to its lateral axis and nothing else is changed: it slips as on a straight. "Left in" is without the turn's
tracker. "From the start" turns from the first revolution on, "after 60" goes straight before. An asterisk marks what is
valid and more than 2.5 errors from the straight.
"""

import math
import sys
from pathlib import Path
from unittest.mock import patch

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np

from gateway.core.estimates.estimator import Estimate, Status
from gateway.forces.turn_tracker import NO_TURN, TurnTracker
from gateway.ring.turning_wheel import HubMotion, turning_acceleration
from tools.generators.lateral_signals import RADIUS_M, Sensor, lateral, radial, samples, through_pipeline

SPEED_MPS = 65.0 / 3.6
NAMES = (
    "ply_steer_ahead_rad",
    "ply_steer_contact_line_rad",
    "ply_steer_peak_rad",
    "conicity_slope_rad",
    "sensor_roll_rad",
)
# A tight curve that a lane change turns into the other one within a second, and its camber.
TERMS = {
    "turn 0.3 rad/s": HubMotion(turn_radps=0.3),
    "camber 0.05 rad/s": HubMotion(camber_radps=0.05),
    "turn 1.1 rad/s2": HubMotion(turn_radps2=1.1),
    "turn at 3 deg camber": HubMotion(turn_radps=0.3, camber_rad=math.radians(3.0)),
}
SPEEDS_KMH = (30.0, 65.0, 130.0)
# Turn and camber rate in rad/s.
MOTIONS = {
    "straight": (0.0, 0.0),
    "left, 180 m": (SPEED_MPS / 180.0, 0.0),
    "right, 180 m": (-SPEED_MPS / 180.0, 0.0),
    "right, 60 m": (-SPEED_MPS / 60.0, 0.0),
    "camber 0.05 rad/s": (0.0, 0.05),
}
MARKED_ERRORS = 2.5


def estimates(turn_radps: float, camber_radps: float, straights: int) -> list[Estimate]:
    """Return the estimates of NAMES after straights and 60 revolutions with the terms."""
    ring, sensor = radial(), Sensor(noise_mg=5.0, road_mps2=0.5)
    values = samples(ring, [(straights + 60, lateral(ring))], sensor)
    omega = SPEED_MPS / RADIUS_M
    phase = omega * np.arange(len(values)) / sensor.rate_hz - 0.7 * math.pi
    motion = HubMotion(turn_radps=turn_radps, camber_radps=camber_radps)
    terms = turning_acceleration(phase, omega, RADIUS_M, motion)[:, 1] + SPEED_MPS * turn_radps
    values[:, 1] += (phase > math.pi * (2.0 * straights - 1.0)) * terms
    last = {estimate.name: estimate for estimate in through_pipeline(values, sensor, ["ply-steer"])[-1].estimates}
    return [last[name] for name in NAMES]


def block(title: str, straights: int) -> None:
    """Print the estimates under each motion."""
    straight = estimates(0.0, 0.0, straights)
    for name, motion in MOTIONS.items():
        cells = []
        for estimate, reference in zip(estimates(*motion, straights), straight, strict=True):
            off = abs(estimate.value - reference.value) > MARKED_ERRORS * estimate.std
            mark = "*" if off and estimate.status is Status.VALID else " "
            cells.append(f"{math.degrees(estimate.value):7.3f}±{math.degrees(estimate.std):.3f}{mark}")
        print(f"{title:15s} {name:18s}", "".join(cells))


def sizes() -> None:
    """Print the terms at three speeds; without those of the turn where it has a camber."""
    angles = np.linspace(0.0, 2.0 * math.pi, 360, endpoint=False)
    print(f"{'m/s2':24s}" + "".join(f"{f'{speed:.0f} km/h: lateral, others':>32s}" for speed in SPEEDS_KMH))
    for name, motion in TERMS.items():
        cells = []
        for speed_kmh in SPEEDS_KMH:
            omega = speed_kmh / 3.6 / RADIUS_M
            added = turning_acceleration(angles, omega, RADIUS_M, motion)
            if name != next(iter(TERMS)) and motion.turn_radps:
                added -= turning_acceleration(angles, omega, RADIUS_M, HubMotion(turn_radps=motion.turn_radps))
            circumferential, lateral_mps2, radial_mps2 = np.abs(added).max(axis=0)
            cells.append(f"{lateral_mps2:21.3f} {max(circumferential, radial_mps2):10.3f}")
        print(f"{name:24s}" + "".join(cells))


def main() -> None:
    """Print the tables."""
    sizes()
    print(f"{'deg':34s}        ahead     contact line             peak         conicity             roll")
    with patch.object(TurnTracker, "take", lambda *_arguments: NO_TURN):
        block("left in", 0)
    block("from the start", 0)
    block("after 60", 60)


if __name__ == "__main__":
    main()
