"""Path of a vehicle: its yaw rate over time, and the speed of a wheel beside its middle."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from gateway.core.types import FloatArray
from gateway.ring.turning_wheel import HubMotion, turning_acceleration
from gateway.simulator.motion import MotionProfile
from gateway.simulator.time_series import Series

# Curvature over distance becomes a yaw rate over time by lines of this length, up to the last point of the curvature.
_STEP_S: Final = 0.02


def yaw_over_time(speed_kmh: Series, curvature_pm: Series) -> Series:
    """Return the yaw rate in rad/s over time of a curvature over distance; positive to the left."""
    if curvature_pm.is_constant and not curvature_pm.low:
        return curvature_pm
    motion = MotionProfile(speed_kmh)
    last_m = float(curvature_pm.times_s[-1])
    end_s = float(motion.time_at(np.array([last_m]))[0])
    changes = float(speed_kmh.times_s[-1])
    # After both, the yaw rate is constant.
    end_s = max(end_s if np.isfinite(end_s) else changes, changes) + _STEP_S
    times = np.linspace(0.0, end_s, max(2, round(end_s / _STEP_S) + 1))
    rolling = motion.at(times)
    rates = rolling.speed_mps * np.asarray(curvature_pm.at_times(rolling.distance_m))
    return Series(tuple(zip(times.tolist(), rates.tolist(), strict=True)))


def speed_beside(speed_kmh: Series, yaw_radps: Series, left_m: float) -> Series:
    """Return the speed in km/h of a wheel that is `left_m` to the left of the vehicle's middle, 0 at least."""
    times = np.union1d(speed_kmh.times_s, yaw_radps.times_s)
    speeds = np.interp(times, speed_kmh.times_s, speed_kmh.values)
    yaw = np.interp(times, yaw_radps.times_s, yaw_radps.values)
    wheel_kmh = np.maximum(speeds - 3.6 * left_m * yaw, 0.0)
    return Series(tuple(zip(times.tolist(), wheel_kmh.tolist(), strict=True)))


@dataclass(frozen=True, slots=True)
class Path:
    """Turns of a wheel's hub over time, by the vehicle's path, by steering and by the suspension, and its road.

    Attributes:
        yaw_radps: of the vehicle, positive to the left.
        slip_rad: slip angle; its rate turns the wheel, since a positive one heads to the left of its motion.
        camber_rad: positive where the left side is up.
        grade_rad: positive uphill.
        bank_rad: positive where the left side of the road is up.
        reverse: whether the wheel rolls backwards. Its x axis then points to the rear, so it turns the other way.
    """

    yaw_radps: Series
    slip_rad: Series
    camber_rad: Series
    grade_rad: Series
    bank_rad: Series
    reverse: bool

    @property
    def turns(self) -> bool:
        """Whether there is anything but a steady slip angle and camber on a level road."""
        rates = self.yaw_radps, self.grade_rad, self.bank_rad
        is_still = self.slip_rad.is_constant and self.camber_rad.is_constant
        return not is_still or any(series.low or series.high for series in rates)

    def add(
        self, force: FloatArray, time_s: FloatArray, omega_radps: FloatArray, axes: FloatArray, radius_m: float
    ) -> None:
        """Add what turn, camber rate, grade, bank and the curve make to a specific force without them.

        Args:
            force: (n, 3) circumferential, lateral, radial, m/s^2; changed.
            time_s: (n,).
            omega_radps: (n,) angular speed.
            axes: (n, 2) cosine and sine of the belt's inclination at the sensor.
            radius_m: belt radius.
        """
        direction = -1.0 if self.reverse else 1.0
        yaw = direction * np.asarray(self.yaw_radps.at_times(time_s))
        # The wheel heads into a curve by its slip angle.
        slip, toward_mps2 = np.asarray(self.slip_rad.at_times(time_s)), yaw * omega_radps * radius_m
        motion = HubMotion(
            turn_radps=yaw + self.slip_rad.rates_at(time_s),
            turn_radps2=direction * self.yaw_radps.rates_at(time_s),
            camber_rad=self.camber_rad.at_times(time_s),
            camber_radps=self.camber_rad.rates_at(time_s),
            forward_mps2=toward_mps2 * np.sin(slip),
            left_mps2=toward_mps2 * np.cos(slip),
            grade_rad=direction * np.asarray(self.grade_rad.at_times(time_s)),
            bank_rad=self.bank_rad.at_times(time_s),
        )
        force += turning_acceleration(np.arctan2(axes[:, 1], axes[:, 0]), omega_radps, radius_m, motion)
        # Camber and level gravity are in the force already.
        at_hub = motion.force_mps2() - HubMotion(camber_rad=motion.camber_rad).force_mps2()
        forward, left, upward = np.broadcast_to(at_hub, force.shape).T
        force[:, 0] += axes[:, 1] * upward - axes[:, 0] * forward
        force[:, 1] += left
        force[:, 2] += axes[:, 0] * upward + axes[:, 1] * forward
