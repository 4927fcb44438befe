"""Turn, camber and acceleration of the hub at the sensor, against positions that are differentiated twice."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.ring.turning_wheel import HubMotion, added_by_motion, sensor_axes, turning_acceleration

RADIUS_M, OMEGA = 0.32, 56.4
# Points of a circle about each time in the complex plane, and its radius.
POINTS, CIRCLE_S = 48, 0.02

Positions = Callable[[np.ndarray], np.ndarray]


def second_derivative(positions: Positions, time_s: float, order: int = 2) -> np.ndarray:
    """Return a derivative of an analytic position by Cauchy's integral over a circle about the time, (3,)."""
    turns = np.exp(2j * np.pi * np.arange(POINTS) / POINTS)
    values = positions(time_s + CIRCLE_S * turns)
    return (math.factorial(order) / CIRCLE_S**order * (values * turns**-order).mean(axis=-1)).real


class Drive:
    """A hub on a banked slope: a path in the road's plane with yaw and camber that change; analytic in time."""

    def __init__(self, seed: int) -> None:
        rng = np.random.default_rng(seed)
        # Coefficients of polynomials of time: yaw, camber, two coordinates of the hub, its height, and the spin.
        self.yaw = rng.normal(0.0, [0.5, 0.8, 0.6])
        self.camber = rng.normal(0.0, [0.1, 0.5, 0.7])
        self.path = rng.normal(0.0, 1.0, (3, 3)) * [[0.0, 18.0, 3.0], [0.0, 2.0, 3.0], [0.0, 0.1, 0.5]]
        self.spin = np.array([rng.uniform(0.0, 6.0), OMEGA, rng.normal(0.0, 3.0)])
        # Of the vertical along the road at time 0: a slope in one direction and one across it.
        upward = np.append(rng.normal(0.0, 0.1, 2), 1.0)
        self.upward = upward / np.linalg.norm(upward)

    def polynomial(self, coefficients: np.ndarray, time_s: np.ndarray) -> np.ndarray:
        return coefficients[0] + coefficients[1] * time_s + 0.5 * coefficients[2] * time_s**2

    def to_road(self, time_s: np.ndarray, x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
        """Return components along the wheel's axes along those of the road at time 0, (3, n)."""
        camber, yaw = self.polynomial(self.camber, time_s), self.polynomial(self.yaw, time_s)
        leftward, up = y * np.cos(camber) - z * np.sin(camber), y * np.sin(camber) + z * np.cos(camber)
        return np.array(
            [x * np.cos(yaw) - leftward * np.sin(yaw), x * np.sin(yaw) + leftward * np.cos(yaw), up + 0.0 * x]
        )

    def position(self, time_s: np.ndarray) -> np.ndarray:
        """Return the place of the sensor on a rim, (3, n)."""
        theta = self.polynomial(self.spin, time_s)
        hub = np.array([self.polynomial(row, time_s) for row in self.path])
        return hub + self.to_road(time_s, -RADIUS_M * np.sin(theta), 0.0 * theta, -RADIUS_M * np.cos(theta))

    def motion(self, time_s: float) -> HubMotion:
        """Return what the functions take at a time; acceleration of the hub, grade and bank along its heading there."""
        yaw = float(self.polynomial(self.yaw, np.array(time_s)))
        x, y, z = self.path[:, 2]
        uphill, leftward, normal = self.upward
        ahead, across = uphill * np.cos(yaw) + leftward * np.sin(yaw), leftward * np.cos(yaw) - uphill * np.sin(yaw)
        return HubMotion(
            turn_radps=self.yaw[1] + self.yaw[2] * time_s,
            turn_radps2=self.yaw[2],
            camber_rad=float(self.polynomial(self.camber, np.array(time_s))),
            camber_radps=self.camber[1] + self.camber[2] * time_s,
            camber_radps2=self.camber[2],
            forward_mps2=x * np.cos(yaw) + y * np.sin(yaw),
            left_mps2=y * np.cos(yaw) - x * np.sin(yaw),
            upward_mps2=z,
            grade_rad=math.asin(ahead),
            bank_rad=math.atan2(across, normal),
        )


@pytest.mark.parametrize("seed", range(12))
def test_point_of_a_moving_wheel_feels_what_its_positions_do(seed: int) -> None:
    drive = Drive(seed)
    for time_s in (0.0, 0.013, 0.31, 0.77):
        force = second_derivative(drive.position, time_s) + STANDARD_GRAVITY_MPS2 * drive.upward
        motion = drive.motion(time_s)
        theta = np.array([drive.polynomial(drive.spin, np.array(time_s))])
        omega = drive.spin[1] + drive.spin[2] * time_s
        travel, inward = (axis[0] for axis in sensor_axes(theta))
        read = turning_acceleration(theta, omega, RADIUS_M, motion)[0]
        at_hub = motion.force_mps2()
        read += np.array([at_hub @ travel + RADIUS_M * drive.spin[2], at_hub[1], at_hub @ inward + RADIUS_M * omega**2])
        for component, axis in zip(read, (travel, np.array([0.0, 1.0, 0.0]), inward), strict=True):
            positioned = force @ drive.to_road(np.array([time_s]), *axis[:, np.newaxis])[:, 0]
            assert component == pytest.approx(positioned, abs=1e-9 * RADIUS_M * OMEGA**2)


def test_place_within_the_wheel_may_be_of_any_belt() -> None:
    # A belt whose lateral and radial displacement vary over the angle passes its places at a steady speed.
    rng = np.random.default_rng(7)
    waves = rng.normal(0.0, 0.01, (3, 2, 4))
    drive = Drive(99)
    drive.spin[2] = 0.0

    def streamline(theta: np.ndarray) -> np.ndarray:
        orders = np.arange(1, 5)[:, np.newaxis] * theta
        rigid = [-RADIUS_M * np.sin(theta), 0.0 * theta, -RADIUS_M * np.cos(theta)]
        return np.array(rigid) + waves[:, 0] @ np.cos(orders) + waves[:, 1] @ np.sin(orders)

    def local(time_s: np.ndarray) -> np.ndarray:
        return streamline(drive.polynomial(drive.spin, time_s))

    def path(time_s: np.ndarray) -> np.ndarray:
        hub = np.array([drive.polynomial(row, time_s) for row in drive.path])
        return hub + drive.to_road(time_s, *local(time_s))

    for time_s in (0.0, 0.02, 0.09):
        motion = drive.motion(time_s)
        position_m = local(np.array([time_s])).T
        velocity = second_derivative(local, time_s, order=1)[np.newaxis]
        within = second_derivative(local, time_s)
        read = added_by_motion(motion, position_m, velocity)[0] + within + motion.force_mps2(gravity_mps2=0.0)
        positioned = second_derivative(path, time_s)
        axes = [drive.to_road(np.array([time_s]), *row[:, np.newaxis])[:, 0] for row in np.eye(3)]
        np.testing.assert_allclose(read, axes @ positioned, atol=1e-9 * RADIUS_M * OMEGA**2)


def test_first_order_is_the_lateral_axis_alone() -> None:
    theta = np.linspace(-math.pi, math.pi, 64, endpoint=False)
    speed = RADIUS_M * OMEGA
    turn = turning_acceleration(theta, OMEGA, RADIUS_M, HubMotion(turn_radps=1e-4))
    camber = turning_acceleration(theta, OMEGA, RADIUS_M, HubMotion(camber_radps=1e-4))
    np.testing.assert_allclose(turn[:, 1], -2e-4 * speed * np.cos(theta), atol=1e-12)
    np.testing.assert_allclose(camber[:, 1], -2e-4 * speed * np.sin(theta), atol=1e-12)
    for other in (turn[:, [0, 2]], camber[:, [0, 2]]):
        assert np.abs(other).max() < 1e-8


def test_gravity_reads_grade_bank_and_camber() -> None:
    standing = HubMotion(camber_rad=0.02, grade_rad=0.05, bank_rad=-0.03).force_mps2()
    assert np.linalg.norm(standing) == pytest.approx(STANDARD_GRAVITY_MPS2)
    level = STANDARD_GRAVITY_MPS2 * math.cos(0.05)
    assert standing[0] == pytest.approx(STANDARD_GRAVITY_MPS2 * math.sin(0.05))
    # Bank and camber add: the axle's left side is up by their sum.
    assert standing[1:] == pytest.approx([level * math.sin(-0.01), level * math.cos(-0.01)])
