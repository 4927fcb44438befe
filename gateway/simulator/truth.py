"""What a simulated wheel really does at any time: the answers that estimates are held against."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gateway.physics.rolling_ring import RingNumbers
from gateway.simulator.lateral_truth import LateralSlopes, lateral_slopes
from gateway.simulator.wheel_plan import WheelPlan
from gateway.types import FloatArray


@dataclass(frozen=True, slots=True)
class WheelTruth:
    """Truth of one wheel over true time, s since the beginning of the simulation.

    Attributes:
        plan: the wheel.
        phase_rad: material angle of the sensor at time 0, without ripple.
    """

    plan: WheelPlan
    phase_rad: float

    def speed_mps(self, time_s: float) -> float:
        """Return the speed."""
        return float(self.plan.motion.at(np.array([time_s])).speed_mps[0])

    def omega_radps(self, time_s: float) -> float:
        """Return the angular speed, without ripple."""
        return self.speed_mps(time_s) / self.plan.radius_m

    def angle_rad(self, time_s: FloatArray) -> FloatArray:
        """Return the unwrapped material angle of the sensor; multiples of 2 pi are straight below the axle."""
        return self.plan.rotation(self.phase_rad).at(time_s).angle_rad

    def bottom_times_s(self, begin_s: float, end_s: float) -> FloatArray:
        """Return the times in [begin, end) at which the sensor is straight below the axle (theta = 0)."""
        rotation = self.plan.rotation(self.phase_rad)
        return rotation.times_at(rotation.bottoms_rad(begin_s, end_s))

    def contact_edges_rad(self, time_s: float) -> tuple[float, float]:
        """Return the true (leading, trailing) contact angle, negative and positive."""
        return self.plan.table().edges_rad(self.load_n(time_s), self.pressure_pa(time_s), self.omega_radps(time_s))

    def numbers(self, time_s: float) -> RingNumbers:
        """Return the true dimensionless numbers at the pressure of that time, wear included."""
        return self.plan.tire.numbers(self.pressure_pa(time_s))

    def slopes(self, time_s: float) -> LateralSlopes:
        """Return the slopes of the belt in the contact, with all that bends it: plies, cone and slip."""
        return self._slopes(time_s, self.slip_angle_rad(time_s))

    def ply_steer(self, time_s: float) -> LateralSlopes:
        """Return the slopes that are left without slip: what is called ply steer, conicity included."""
        return self._slopes(time_s, 0.0)

    def slip_angle_rad(self, time_s: float) -> float:
        """Return the slip angle, positive when it pulls the tire to the left."""
        return self.plan.slip_angle_rad.at(time_s)

    def camber_rad(self, time_s: float) -> float:
        """Return the inclination of the wheel plane."""
        return self.plan.camber_rad.at(time_s)

    def _slopes(self, time_s: float, slip_angle_rad: float) -> LateralSlopes:
        omega = self.omega_radps(time_s) if self.plan.tire.depends_on_speed else 0.0
        return lateral_slopes(self.plan.tire, self.load_n(time_s), self.pressure_pa(time_s), omega, slip_angle_rad)

    def load_n(self, time_s: float) -> float:
        """Return the load."""
        return self.plan.load_n.at(time_s)

    def pressure_pa(self, time_s: float) -> float:
        """Return the gauge pressure."""
        return self.plan.pressure_pa.at(time_s)

    def hub_s(self, time_s: float) -> float:
        """Return what the hub's clock shows, s since its start."""
        return self.plan.hub.uptime_s + time_s * (1.0 + self.plan.hub.clock_ppm * 1e-6)
