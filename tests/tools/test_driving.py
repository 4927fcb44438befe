"""Positions of a driven tire's sensor, differentiated twice, against what belt and turn make of it."""

import math
from dataclasses import replace

import numpy as np
import pytest
from independent_tire.driving import MARGIN, OVERSAMPLED, Course, DrivenTire
from independent_tire.sideways import Sides
from independent_tire.steady import roll_steadily
from independent_tire.tires import TIRES
from scipy.interpolate import CubicSpline

from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.ring.turning_wheel import HubMotion

SPEED_MPS, RATE_HZ, COUNT, OFFSET_M = 18.0, 9600.0, 2400, 4e-3
STEADY = roll_steadily(replace(TIRES[1], elements=240, friction=0.8, slip_scale=0.04, bending_damping_nm2s=0.0), 4000.0)
TIRE = DrivenTire(
    STEADY, Sides(1.6e6, 1e3, 2.5e5, 8e6, 1.0, coupling_m=1.2e-3), np.radians([-2.0, -1.0, 0.0, 1.0, 2.0]), OFFSET_M
)


def course(turn_radps: float = 0.0, camber_radps: float = 0.0, grade_rad: float = 0.0, bank_rad: float = 0.0) -> Course:
    steps = np.arange(COUNT * OVERSAMPLED + 2 * MARGIN)
    time, same = steps / (RATE_HZ * OVERSAMPLED), np.ones(len(steps))
    return Course(
        1.0 / (RATE_HZ * OVERSAMPLED),
        SPEED_MPS * same,
        turn_radps * time,
        0.0 * same,
        camber_radps * (time - time.mean()),
        grade_rad * same,
        bank_rad * same,
    )


STILL, ANGLE, _ = TIRE.felt(course(), 0.0)


def test_straight_wheel_reads_the_waveform_of_its_belt() -> None:
    theta, sensor = STEADY.mesh.mesh.theta_rad, STEADY.signals(OFFSET_M)
    angle = np.mod(ANGLE + math.pi, 2.0 * math.pi) - math.pi

    def over_angle(values: np.ndarray) -> np.ndarray:
        return np.asarray(
            CubicSpline(np.append(theta, math.pi), np.append(values, values[0]), bc_type="periodic")(angle)
        )

    square = (SPEED_MPS / (STEADY.belt.radius_m * STEADY.road_share)) ** 2
    along = square * over_angle(sensor.circumferential_m)
    along += STANDARD_GRAVITY_MPS2 * over_angle(sensor.gravity_circumferential)
    radial = square * over_angle(sensor.radial_m) + STANDARD_GRAVITY_MPS2 * over_angle(sensor.gravity_radial)
    assert np.abs(STILL[:, 0] - along).max() < 3e-3 * np.abs(along).max()
    assert np.abs(STILL[:, 2] - radial).max() < 1e-3 * np.abs(radial).max()


@pytest.mark.parametrize(("turn_radps", "camber_radps"), [(0.1, 0.0), (-0.3, 0.0), (0.0, 0.2)])
def test_turn_and_camber_rate_add_what_the_model_says(turn_radps: float, camber_radps: float) -> None:
    added = TIRE.felt(course(turn_radps, camber_radps), 0.0)[0][:, 1] - STILL[:, 1]
    _, (forward, _, up) = TIRE.at(ANGLE, np.zeros(COUNT))
    felt = SPEED_MPS * turn_radps + 2.0 * SPEED_MPS * (turn_radps * forward - camber_radps * up)
    camber_rad = camber_radps * (np.arange(COUNT) - 0.5 * COUNT) / RATE_HZ
    felt += STANDARD_GRAVITY_MPS2 * np.sin(camber_rad)
    # The belt stretches, and the sensor below it is slower where it bends.
    largest = 2.0 * SPEED_MPS * max(abs(turn_radps), abs(camber_radps))
    assert np.abs(added - felt).max() < 0.03 * largest


def test_grade_and_bank_turn_gravity() -> None:
    added = TIRE.felt(course(grade_rad=0.05, bank_rad=0.03), 0.0)[0] - STILL
    level, sloped = HubMotion().force_mps2(), HubMotion(grade_rad=0.05, bank_rad=0.03).force_mps2()
    forward, left, up = sloped - level
    cosine, sine = np.cos(ANGLE), np.sin(ANGLE)
    assert added[:, 1] == pytest.approx(left, abs=1e-3)
    # A rigid rim has these axes; the belt leans up to its half contact angle from it.
    away = 0.3 * abs(forward)
    assert np.abs(added[:, 0] - (-forward * cosine + up * sine)).max() < away
    assert np.abs(added[:, 2] - (forward * sine + up * cosine)).max() < away
