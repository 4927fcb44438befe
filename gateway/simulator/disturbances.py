"""Disturbances of the signal: contact-edge jitter, road, hub and cavity vibration, and impacts once per revolution."""

import math
from typing import Final

import numpy as np

from gateway.core.types import FloatArray
from gateway.simulator.filters import band_noise_gain, lowpass, lowpass_noise_gain, resonator
from gateway.simulator.motion import Turning, WheelRotation
from gateway.simulator.scenario_tables import Impact, Road, Vibration

# The shift of an edge fades out over this angle to either side, at the latest at the other edge.
_REACH_RAD: Final = 0.5
_LEAST_RAD: Final = 1e-6


class EdgeJitter:
    """Contact-edge jitter: the shape about each edge is shifted by a normal angle drawn for each revolution."""

    def __init__(self, leading_rad: float, trailing_rad: float, rng: np.random.Generator) -> None:
        """Take the standard deviation of each edge."""
        self._deviations = np.array([leading_rad, trailing_rad])
        self._rng = rng
        self._from = 0
        self._shifts = np.empty((0, 2))

    def shifted(self, angle_rad: FloatArray, edges_rad: tuple[float, float]) -> FloatArray:
        """Return the angles at which to evaluate the undisturbed shape. Calls must go forward in angle.

        Args:
            angle_rad: unwrapped material angles, rising.
            edges_rad: undisturbed (leading, trailing) contact angle.
        """
        if not self._deviations.any() or not len(angle_rad):
            return angle_rad
        turn = np.floor(angle_rad / (2.0 * math.pi) + 0.5)
        turns = turn.astype(np.int64)
        self._draw(int(turns[0]), int(turns[-1]))
        angle_in_turn_rad = angle_rad - 2.0 * math.pi * turn
        shifted_rad = angle_rad.copy()
        inside_rad = max(min(_REACH_RAD, edges_rad[1] - edges_rad[0]), _LEAST_RAD)
        for edge, (before_rad, behind_rad) in enumerate(((_REACH_RAD, inside_rad), (inside_rad, _REACH_RAD))):
            from_edge = angle_in_turn_rad - edges_rad[edge]
            scaled = np.clip(np.where(from_edge < 0.0, from_edge / before_rad, from_edge / behind_rad), -1.0, 1.0)
            shift = self._shifts[turns - self._from, edge]
            shifted_rad += shift * 0.5 * (1.0 + np.cos(math.pi * scaled))
        return shifted_rad

    def _draw(self, first: int, last: int) -> None:
        """Draw the shifts of revolutions `first` to `last` and drop earlier ones."""
        drawn_until = self._from + len(self._shifts)
        if not len(self._shifts):
            self._from = drawn_until = first
        drawn = self._rng.standard_normal((max(0, last + 1 - drawn_until), 2)) * self._deviations
        self._shifts = np.concatenate([self._shifts[first - self._from :], drawn])
        self._from = first


REFERENCE_MPS = 65.0 / 3.6
"""Speed at which a scenario states amplitudes."""

# An impact is dropped after this many time constants.
_FADED = 12.0


class RoadNoise:
    """Road noise: white noise through a two-pole low-pass, equal on the three axes, proportional to speed."""

    def __init__(self, road: Road, rate_hz: float, rng: np.random.Generator) -> None:
        """Take its amplitude and random generator."""
        bandwidth = min(road.bandwidth_hz, 0.45 * rate_hz)
        self._filter = lowpass(bandwidth, rate_hz)
        self._gain = road.rms_mps2 / lowpass_noise_gain(bandwidth, rate_hz) / REFERENCE_MPS
        self._rng = rng

    def add(self, force: FloatArray, speed_mps: FloatArray) -> None:
        """Add it to (n, 3) specific force."""
        if self._gain > 0.0:
            force += self._filter(self._rng.standard_normal(force.shape)) * (self._gain * speed_mps)[:, None]


class NarrowNoise:
    """Resonant noise: a peak of given width about a frequency, proportional to speed."""

    def __init__(
        self, rms_mps2: float, centre_hz: float, width_hz: float, rate_hz: float, rng: np.random.Generator
    ) -> None:
        """Take its amplitude, its -3 dB width and random generator."""
        self._gain = 0.0
        if rms_mps2:
            self._filter = resonator(centre_hz, width_hz, rate_hz)
            self._gain = rms_mps2 / band_noise_gain(centre_hz, width_hz, rate_hz) / REFERENCE_MPS
        self._rng = rng

    def __call__(self, speed_mps: FloatArray) -> FloatArray | float:
        """Return the next samples; 0 when there is none."""
        if not self._gain:
            return 0.0
        return self._filter(self._rng.standard_normal((len(speed_mps), 1)))[:, 0] * (self._gain * speed_mps)


class HubMotion:
    """Vertical acceleration of the hub: imbalance at order 1, and bounce of the unsprung mass.

    The whole wheel moves with its hub. To a sensor on it, the motion is a change of gravity.
    """

    def __init__(self, vibration: Vibration, rate_hz: float, rng: np.random.Generator) -> None:
        """Take the amplitudes of the table."""
        self._imbalance = vibration.imbalance_mps2 / REFERENCE_MPS**2
        self._phase = math.radians(vibration.imbalance_deg)
        self._bounce = NarrowNoise(vibration.hub_rms_mps2, vibration.hub_hz, vibration.hub_bandwidth_hz, rate_hz, rng)

    def __call__(self, turning: Turning) -> FloatArray | float:
        """Return the upward acceleration at the next samples, m/s^2; 0 when there is none."""
        bounce = self._bounce(turning.speed_mps)
        if not self._imbalance:
            return bounce
        return bounce + self._imbalance * turning.speed_mps**2 * np.cos(turning.angle_rad + self._phase)


class Blows:
    """Impact at a fixed wheel angle, such as a stone in the tread, and the ringing of the belt."""

    def __init__(self, impact: Impact, rotation: WheelRotation) -> None:
        """Take the table and the wheel's rotation."""
        self._amplitude = impact.amplitude_mps2 / REFERENCE_MPS
        self._at_rad = math.radians(impact.at_deg)
        self._rate_radps = 2.0 * math.pi * impact.frequency_hz
        self._decay_s = impact.decay_ms * 1e-3
        self._rotation = rotation

    def __call__(self, time_s: FloatArray) -> FloatArray | float:
        """Return amplitude exp(-t / decay) sin(2 pi f t) after each impact, radial, m/s^2; 0 when there is none."""
        if not self._amplitude:
            return 0.0
        # Impacts before the block still ring in it.
        span = np.array([max(0.0, time_s[0] - _FADED * self._decay_s), time_s[-1]])
        first, last = (self._rotation.at(span).angle_rad - self._at_rad) / (2.0 * math.pi)
        angles = 2.0 * math.pi * np.arange(math.ceil(first), math.floor(last) + 1) + self._at_rad
        total = np.zeros(len(time_s))
        times = self._rotation.times_at(angles)
        times = times[np.isfinite(times)]
        speeds = self._rotation.motion.at(times).speed_mps
        for struck_s, speed in zip(times.tolist(), speeds.tolist(), strict=True):
            since = time_s - struck_s
            after = since >= 0.0
            ringing = np.exp(-since[after] / self._decay_s) * np.sin(self._rate_radps * since[after])
            total[after] += self._amplitude * speed * ringing
        return total
