"""True state of a simulated wheel at any time, the reference for estimates."""

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from gateway.core.types import ComplexArray, FloatArray
from gateway.ring.rolling_ring import RingNumbers
from gateway.simulator.tire_model import TireModel
from gateway.simulator.wheel_plan import WheelPlan

# Angles at which the slope of the solution is sampled; the relative error of a peak is then 1e-6.
_FINE = 16384


class LateralSlopes(NamedTuple):
    """Slopes dy/ds of the belt's centre line in the contact, s = R theta, positive to the left.

    Attributes:
        peak_rad: largest slope with the sign of the line through the whole contact.
        first_half_rad: mean from the leading edge to the contact's middle.
        adhesion_line_rad: line through y where the slope around the peak keeps its sign.
    """

    peak_rad: float
    first_half_rad: float
    adhesion_line_rad: float


@lru_cache(maxsize=512)
def lateral_slopes(
    tire: TireModel, load_n: float, pressure_pa: float, omega_radps: float, slip_angle_rad: float
) -> LateralSlopes:
    """Return the slopes of a tire solved under these conditions.

    Raises:
        RingNotConvergedError: the ring has no equilibrium.
        BrushNotConvergedError: nor has its tread under slip.
    """
    ring = tire.solve(load_n, pressure_pa, omega_radps)
    shape = tire.solve_lateral(ring, slip_angle_rad).y_m
    return slopes_of(shape, ring.ring.radius_m, ring.leading_edge_rad, ring.trailing_edge_rad)


def slopes_of(y_m: FloatArray, radius_m: float, leading_rad: float, trailing_rad: float) -> LateralSlopes:
    """Return the slopes of a lateral shape given over theta = -pi + 2 pi i / N, (N,)."""
    spectrum = np.fft.rfft(y_m)[: len(y_m) // 2] / len(y_m)
    order = np.arange(len(spectrum))
    theta = -np.pi + 2.0 * np.pi * np.arange(_FINE) / _FINE

    def synthesised(coefficients: ComplexArray) -> FloatArray:
        padded = np.zeros(_FINE // 2 + 1, np.complex128)
        padded[: len(coefficients)] = coefficients
        return np.fft.irfft(padded, n=_FINE) * _FINE

    shape, slope = synthesised(spectrum), synthesised(1j * order * spectrum) / radius_m
    contact = np.flatnonzero((theta >= leading_rad) & (theta <= trailing_rad))
    sign = np.sign(_line(theta[contact], shape[contact])) or 1.0
    steep = int(contact[np.argmax(sign * slope[contact])])
    first, last = steep, steep
    while first > contact[0] and sign * slope[first - 1] > 0.0:
        first -= 1
    while last < contact[-1] and sign * slope[last + 1] > 0.0:
        last += 1
    middle = 0.5 * (leading_rad + trailing_rad)
    ends = np.interp([leading_rad, middle], theta, shape)
    return LateralSlopes(
        peak_rad=float(slope[steep]),
        first_half_rad=float(ends[1] - ends[0]) / (radius_m * (middle - leading_rad)),
        adhesion_line_rad=_line(theta[first : last + 1], shape[first : last + 1]) / radius_m,
    )


def _line(x: FloatArray, y: FloatArray) -> float:
    """Return the slope of the least-squares line, 0 through a single point."""
    centred = x - x.mean()
    return float(centred @ y / (centred @ centred)) if len(x) > 1 else 0.0


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
        """Return the unwrapped material angle of the sensor; multiples of 2 pi are directly below the axle."""
        return self.plan.rotation(self.phase_rad).at(time_s).angle_rad

    def bottom_times_s(self, begin_s: float, end_s: float) -> FloatArray:
        """Return the times in [begin, end) at which the sensor is directly below the axle (theta = 0)."""
        rotation = self.plan.rotation(self.phase_rad)
        return rotation.times_at(rotation.bottoms_rad(begin_s, end_s))

    def contact_edges_rad(self, time_s: float) -> tuple[float, float]:
        """Return the true (leading, trailing) contact angle, negative and positive."""
        return self.plan.table().edges_rad(self.load_n(time_s), self.pressure_pa(time_s), self.omega_radps(time_s))

    def numbers(self, time_s: float) -> RingNumbers:
        """Return the true dimensionless numbers at the pressure of that time, wear included."""
        return self.plan.tire.numbers(self.pressure_pa(time_s))

    def slopes(self, time_s: float) -> LateralSlopes:
        """Return the slopes of the belt in the contact from ply steer, conicity and slip together."""
        return self._slopes(time_s, self.slip_angle_rad(time_s))

    def ply_steer(self, time_s: float) -> LateralSlopes:
        """Return the slopes without slip: ply steer, conicity included."""
        return self._slopes(time_s, 0.0)

    def slip_angle_rad(self, time_s: float) -> float:
        """Return the slip angle, positive when it pulls the tire to the left."""
        return self.plan.slip_angle_rad.at(time_s)

    def camber_rad(self, time_s: float) -> float:
        """Return the inclination of the wheel plane."""
        return self.plan.camber_rad.at(time_s)

    def turn_radps(self, time_s: float) -> float:
        """Return the yaw rate of the vehicle, positive to the left."""
        return self.plan.path.yaw_radps.at(time_s)

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
        """Return the time of the hub's clock, s since its start."""
        return self.plan.hub.uptime_s + time_s * (1.0 + self.plan.hub.clock_ppm * 1e-6)
