"""How a wheel turns: the distance rolled as an angle, and the ripple that a driveline or a brake lays over it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from gateway.simulator.motion import MotionProfile
from gateway.types import FloatArray

# Each pass of the inversion leaves at most the ripple's share of the error: 0.2 after 24 passes is 1e-17.
_PASSES = 24


class Turning(NamedTuple):
    """Rotation at given times, arrays of the same shape.

    Attributes:
        angle_rad: unwrapped material angle of the sensor.
        omega_radps: its rate.
        omega_dot_radps2: the rate's rate.
        speed_mps: of the vehicle.
    """

    angle_rad: FloatArray
    omega_radps: FloatArray
    omega_dot_radps2: FloatArray
    speed_mps: FloatArray


@dataclass(frozen=True, slots=True)
class Ripple:
    """Torsional ripple, omega (1 + amplitude cos(order angle + phase)), the angle being that without ripple.

    Attributes:
        amplitude: share of the angular speed, below 1.
        order: periods a revolution; a whole one repeats in every revolution.
        phase_rad: at angle 0.
    """

    amplitude: float = 0.0
    order: float = 2.0
    phase_rad: float = 0.0


@dataclass(frozen=True, slots=True)
class WheelRotation:
    """A wheel's angle over time.

    Attributes:
        motion: of the vehicle.
        radius_m: belt radius.
        phase_rad: angle at time 0, without ripple.
        ripple: over the steady rotation.
    """

    motion: MotionProfile
    radius_m: float
    phase_rad: float
    ripple: Ripple

    def at(self, time_s: FloatArray) -> Turning:
        """Return the rotation at `time_s` >= 0."""
        rolling = self.motion.at(time_s)
        per_m = 1.0 / self.radius_m
        angle = rolling.distance_m * per_m + self.phase_rad
        omega = rolling.speed_mps * per_m
        omega_dot = rolling.acceleration_mps2 * per_m
        share, order = self.ripple.amplitude, self.ripple.order
        if share:
            place = order * angle + self.ripple.phase_rad
            cosine, sine = np.cos(place), np.sin(place)
            omega_dot = omega_dot * (1.0 + share * cosine) - share * order * omega * omega * sine
            angle = angle + share / order * sine
            omega = omega * (1.0 + share * cosine)
        return Turning(angle, omega, omega_dot, rolling.speed_mps)

    def times_at(self, angle_rad: FloatArray) -> FloatArray:
        """Return the first times at which the sensor has these angles; infinity for what is never reached."""
        smooth = angle_rad
        if self.ripple.amplitude:
            share, order = self.ripple.amplitude, self.ripple.order
            for _ in range(_PASSES):
                smooth = angle_rad - share / order * np.sin(order * smooth + self.ripple.phase_rad)
        return self.motion.time_at((smooth - self.phase_rad) * self.radius_m)

    def bottoms_rad(self, begin_s: float, end_s: float) -> FloatArray:
        """Return the angles in [begin, end) at which the sensor is straight below the axle: multiples of 2 pi."""
        first, last = self.at(np.array([begin_s, end_s])).angle_rad / (2.0 * math.pi)
        return 2.0 * math.pi * np.arange(math.ceil(first), math.ceil(last))
