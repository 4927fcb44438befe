"""Acceleration of a sensor on a wheel whose hub turns, cambers and accelerates: Eq. 5 of the ply steer paper, whole.

Axes of the wheel, ISO 8855: x forward in the wheel's plane, y to the left along the axle, z upward in the wheel's
plane. The axes turn with the hub, first about the road's normal, then with camber about x, but they do not spin. With
their angular velocity w, the sensor's place r, velocity v and acceleration a in them, and the hub's acceleration a0,

    f = a0 + a + 2 w x v + dw/dt x r + w x (w x r) + g up

is the specific force that a sensor reads. On a belt that rolls with V = R Omega the second term is of first order in
the rates: -2 V (turn cos(incline) + camber rate sin(incline)) on the lateral axis. It is 0 on both others.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.types import FloatArray


class HubMotion(NamedTuple):
    """Motion of a hub over a road; numbers or arrays (n,). The same for left and right wheels.

    Attributes:
        turn_radps: yaw rate about the road's normal, positive to the left: that of the vehicle and of steering.
        turn_radps2: its rate.
        camber_rad: inclination, positive where the left side of the axle is up.
        camber_radps: its rate.
        camber_radps2: the rate of that.
        forward_mps2: acceleration of the hub along its heading.
        left_mps2: of the hub to the left; V times the yaw rate of its path.
        upward_mps2: of the hub along the road's normal.
        grade_rad: slope of the road, positive uphill.
        bank_rad: crossfall of the road, positive where the left side is up.
    """

    turn_radps: ArrayLike = 0.0
    turn_radps2: ArrayLike = 0.0
    camber_rad: ArrayLike = 0.0
    camber_radps: ArrayLike = 0.0
    camber_radps2: ArrayLike = 0.0
    forward_mps2: ArrayLike = 0.0
    left_mps2: ArrayLike = 0.0
    upward_mps2: ArrayLike = 0.0
    grade_rad: ArrayLike = 0.0
    bank_rad: ArrayLike = 0.0

    def force_mps2(self, gravity_mps2: float = STANDARD_GRAVITY_MPS2) -> FloatArray:
        """Return the specific force at the hub along the wheel's axes, (n, 3) or (3,) m/s^2."""
        level = gravity_mps2 * np.cos(self.grade_rad)
        return self._cambered(
            np.asarray(self.forward_mps2) + gravity_mps2 * np.sin(self.grade_rad),
            np.asarray(self.left_mps2) + level * np.sin(self.bank_rad),
            np.asarray(self.upward_mps2) + level * np.cos(self.bank_rad),
        )

    def rates_radps(self) -> FloatArray:
        """Return the angular velocity along the wheel's axes, (n, 3) or (3,) rad/s."""
        return self._cambered(self.camber_radps, 0.0, self.turn_radps)

    def accelerations_radps2(self) -> FloatArray:
        """Return the angular acceleration along the wheel's axes, (n, 3) or (3,) rad/s^2."""
        cross_term = np.multiply(self.turn_radps, self.camber_radps)
        return self._cambered(self.camber_radps2, cross_term, self.turn_radps2)

    def _cambered(self, forward: ArrayLike, leftward: ArrayLike, upward: ArrayLike) -> FloatArray:
        """Return components along the heading, to the left and along the road's normal along the wheel's axes."""
        cosine, sine = np.cos(self.camber_rad), np.sin(self.camber_rad)
        parts = np.broadcast_arrays(
            forward, cosine * leftward + sine * np.asarray(upward), cosine * upward - sine * np.asarray(leftward)
        )
        result: FloatArray = np.stack(parts, axis=-1).astype(np.float64)
        return result


def added_by_motion(motion: HubMotion, place_m: FloatArray, velocity_mps: FloatArray) -> FloatArray:
    """Return what turn and camber add to the specific force at a place in the wheel, (n, 3) m/s^2 along its axes.

    Without the hub's own (`HubMotion.force_mps2`) and what the place's motion in the wheel's axes makes.

    Args:
        motion: of the hub.
        place_m: (n, 3) from the hub along the wheel's axes.
        velocity_mps: (n, 3) of the place in these axes, as of a belt that passes.
    """
    rates = motion.rates_radps()
    added = 2.0 * np.cross(rates, velocity_mps) + np.cross(motion.accelerations_radps2(), place_m)
    result: FloatArray = added + np.cross(rates, np.cross(rates, place_m))
    return result


def sensor_axes(angle_rad: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return directions of travel and toward the centre of a sensor on a rim, (n, 3) each along the wheel's axes.

    Args:
        angle_rad: (n,) of the sensor, 0 at the contact centre.
    """
    sine, cosine, zeros = np.sin(angle_rad), np.cos(angle_rad), np.zeros(np.shape(angle_rad))
    return np.stack([-cosine, zeros, sine], axis=-1), np.stack([sine, zeros, cosine], axis=-1)


def turning_acceleration(
    angle_rad: FloatArray, omega_radps: ArrayLike, radius_m: float, motion: HubMotion
) -> FloatArray:
    """Return what turn and camber add to the specific force at a rigid rim, (n, 3) in m/s^2.

    Along circumferential, lateral and radial, as a sensor reads: in the direction of its travel, to the left, toward
    the wheel centre. `HubMotion.force_mps2` is not in it.

    Args:
        angle_rad: (n,) angle of the sensor, 0 at the contact centre.
        omega_radps: rate of spin.
        radius_m: of the sensor.
        motion: of the hub.
    """
    travel, inward = sensor_axes(angle_rad)
    speed = radius_m * np.broadcast_to(omega_radps, np.shape(angle_rad))
    added = added_by_motion(motion, -radius_m * inward, speed[..., np.newaxis] * travel)
    circumferential, radial = np.sum(added * travel, axis=-1), np.sum(added * inward, axis=-1)
    result: FloatArray = np.stack([circumferential, added[..., 1], radial], axis=-1)
    return result
