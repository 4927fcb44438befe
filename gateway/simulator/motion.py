"""Motion of a wheel: the vehicle's speed integrated exactly, the wheel's angle, and torsional ripple."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from gateway.core.types import FloatArray
from gateway.simulator.time_series import Series

# Each pass of the inversion multiplies the error by at most the ripple's amplitude: 0.2 to the power 24 is 1e-17.
_PASSES = 24


class Turning(NamedTuple):
    """Rotation at given times, arrays of the same shape.

    Attributes:
        angle_rad: unwrapped material angle of the sensor.
        omega_radps: angular speed.
        omega_dot_radps2: angular acceleration.
        speed_mps: of the vehicle.
    """

    angle_rad: FloatArray
    omega_radps: FloatArray
    omega_dot_radps2: FloatArray
    speed_mps: FloatArray


@dataclass(frozen=True, slots=True)
class Ripple:
    """Torsional ripple, omega (1 + amplitude cos(order angle + phase)), with the angle taken without ripple.

    Attributes:
        amplitude: share of the angular speed, below 1.
        order: periods per revolution; an integer order repeats in every revolution.
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
            ripple_phase_rad = order * angle + self.ripple.phase_rad
            cosine, sine = np.cos(ripple_phase_rad), np.sin(ripple_phase_rad)
            omega_dot = omega_dot * (1.0 + share * cosine) - share * order * omega * omega * sine
            angle = angle + share / order * sine
            omega = omega * (1.0 + share * cosine)
        return Turning(angle, omega, omega_dot, rolling.speed_mps)

    def times_at(self, angle_rad: FloatArray) -> FloatArray:
        """Return the first times at which the sensor has these angles; infinity for angles never reached."""
        smooth = angle_rad
        if self.ripple.amplitude:
            share, order = self.ripple.amplitude, self.ripple.order
            for _ in range(_PASSES):
                smooth = angle_rad - share / order * np.sin(order * smooth + self.ripple.phase_rad)
        return self.motion.time_at((smooth - self.phase_rad) * self.radius_m)

    def bottoms_rad(self, begin_s: float, end_s: float) -> FloatArray:
        """Return the angles in [begin, end) at which the sensor is directly below the axle: multiples of 2 pi."""
        first, last = self.at(np.array([begin_s, end_s])).angle_rad / (2.0 * math.pi)
        return 2.0 * math.pi * np.arange(math.ceil(first), math.ceil(last))


# End of a profile that does not repeat and holds its last speed.
_FOREVER_S = 1e9


class Rolling(NamedTuple):
    """Motion at given times, arrays of the same shape.

    Attributes:
        distance_m: rolled since the beginning.
        speed_mps: speed.
        acceleration_mps2: acceleration.
    """

    distance_m: FloatArray
    speed_mps: FloatArray
    acceleration_mps2: FloatArray


class MotionProfile:
    """A piecewise linear speed profile, held at its last value or repeated."""

    def __init__(self, speed_kmh: Series, repeat: bool = False) -> None:
        """Lay out the profile. A repeated profile must end at its initial speed."""
        times, speeds = speed_kmh.times_s, speed_kmh.values / 3.6
        if times[0] != 0.0:
            # Held before the first point; times before 0 are cut off.
            start = float(np.interp(0.0, times, speeds))
            keep = times > 0.0
            times, speeds = np.r_[0.0, times[keep]], np.r_[start, speeds[keep]]
        self._period_s = float(times[-1]) if repeat and len(times) > 1 else 0.0
        if not self._period_s:
            times, speeds = np.r_[times, times[-1] + _FOREVER_S], np.r_[speeds, speeds[-1]]
        self._times, self._speeds = times, speeds
        self._slopes = np.diff(speeds) / np.diff(times)
        self._distances = np.r_[0.0, np.cumsum(0.5 * (speeds[1:] + speeds[:-1]) * np.diff(times))]

    @property
    def highest_mps(self) -> float:
        """Highest speed of the profile."""
        return float(self._speeds.max())

    def at(self, time_s: FloatArray) -> Rolling:
        """Return the motion at `time_s` >= 0."""
        laps = np.zeros_like(time_s)
        in_lap_s = time_s
        if self._period_s:
            laps = np.floor(time_s / self._period_s)
            in_lap_s = time_s - laps * self._period_s
        segment = np.clip(np.searchsorted(self._times, in_lap_s, side="right") - 1, 0, len(self._slopes) - 1)
        since = in_lap_s - self._times[segment]
        slope = self._slopes[segment]
        speed = self._speeds[segment] + slope * since
        distance = self._distances[segment] + since * (self._speeds[segment] + 0.5 * slope * since)
        return Rolling(distance + laps * self._distances[-1], speed, slope)

    def time_at(self, distance_m: FloatArray) -> FloatArray:
        """Return the first time at which a distance is reached; infinity for distances never reached."""
        laps = np.zeros_like(distance_m)
        in_lap_m = distance_m
        total = self._distances[-1]
        if self._period_s and total > 0.0:
            # The end belongs to its lap: a lap that ends at standstill reaches its end before the next one begins.
            laps = np.maximum(np.ceil(distance_m / total) - 1.0, 0.0)
            # Rounding may put the end of a lap just beyond it, where a lap that ends at standstill never gets.
            in_lap_m = np.clip(distance_m - laps * total, 0.0, total)
        segment = np.clip(np.searchsorted(self._distances, in_lap_m, side="left") - 1, 0, len(self._slopes) - 1)
        remaining_m = in_lap_m - self._distances[segment]
        speed, slope = self._speeds[segment], self._slopes[segment]
        # v t + a t^2 / 2 = remaining_m, in the form that also holds for a = 0.
        root = np.sqrt(np.maximum(speed**2 + 2.0 * slope * remaining_m, 0.0))
        with np.errstate(divide="ignore", invalid="ignore"):
            since = np.where(remaining_m > 0.0, 2.0 * remaining_m / (speed + root), 0.0)
        reached = in_lap_m <= total
        return np.where(reached, self._times[segment] + since + laps * self._period_s, np.inf)
