"""Simulated wheel: from speed, load and pressure to raw counts."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.types import FloatArray
from gateway.simulator.disturbances import Blows, EdgeJitter, HubMotion, NarrowNoise, RoadNoise
from gateway.simulator.road_profile import RoadProfile, RoadRide, roughness_m3
from gateway.simulator.sensor import SensorChain
from gateway.simulator.tire_table import COLUMNS, LATERAL, WaveformTable, load_weights, look_up
from gateway.simulator.wheel_plan import WheelPlan


class WheelSamples(NamedTuple):
    """Consecutive samples.

    Attributes:
        first: running number of the first.
        counts: (n, channels) raw values, channels in ascending bit order of `Axis`.
    """

    first: int
    counts: NDArray[np.int16]


class WheelSimulator:
    """Simulates one wheel block by block; the same blocks with the same generator give the same samples."""

    def __init__(self, plan: WheelPlan, rng: np.random.Generator) -> None:
        """Solve the tire unless it has been solved before.

        Args:
            plan: the wheel.
            rng: its own random generator.
        """
        self.plan = plan
        self.phase_rad = float(rng.uniform(-math.pi, math.pi)) if plan.phase_rad is None else plan.phase_rad
        self.chain = SensorChain(plan.sensor, rng, plan.defect)
        rate = plan.sensor.rate_hz
        # Separate streams, so that one effect does not change the noise of another.
        hub_rng, cavity_rng, edge_rng, profile_rng = rng.spawn(4)
        self._rotation = plan.rotation(self.phase_rad)
        self._road = RoadNoise(plan.road, rate, rng)
        self._hub = HubMotion(plan.vibration, rate, hub_rng)
        vibration = plan.vibration
        self._cavity = NarrowNoise(
            vibration.cavity_rms_mps2, vibration.cavity_hz, vibration.cavity_bandwidth_hz, rate, cavity_rng
        )
        self._blows = Blows(plan.impact, self._rotation)
        per_mm = 1e-3 / plan.radius_m
        self._jitter = EdgeJitter(
            plan.road.leading_jitter_mm * per_mm,
            plan.road.trailing_jitter_mm * per_mm,
            edge_rng,
        )
        self._ride: RoadRide | None = None
        if plan.road.profile is not None:
            car = plan.quarter_car()
            density = roughness_m3(plan.road.profile)
            self._ride = RoadRide(RoadProfile(density, plan.road.waviness, car.contact_m, profile_rng), car, rate)
            self._loads_n, self._by_load = np.empty(0), list[WaveformTable]()
        self._table = plan.table()
        self._conditions: tuple[float, ...] | None = None
        self._edges_rad = (0.0, 0.0)
        self._waveform: WaveformTable = np.empty((0, COLUMNS), np.float32)
        self._waveform = self._waveform_at(0.0)
        self._rate_hz = plan.sample_rate_hz
        self._next = 0

    def advance(self, until_s: float) -> WheelSamples:
        """Return the samples taken since the last call and before `until_s` (true time since the beginning)."""
        first, last = self._next, max(self._next, math.ceil(until_s * self._rate_hz))
        end = self._waveform_at(until_s)
        samples = WheelSamples(first, np.empty((0, self.chain.channels), np.int16))
        if last > first:
            time_s = np.arange(first, last) / self._rate_hz
            force = self._force(time_s, end)
            samples = WheelSamples(first, self.chain(force, time_s, self.plan.temperature_degc.at(float(time_s[0]))))
        self._next, self._waveform = last, end
        return samples

    def _force(self, time_s: FloatArray, end: WaveformTable) -> FloatArray:
        """Return (n, 3) specific force at the sensor's place along circumferential, lateral, radial, in m/s^2.

        A wheel of changing load, pressure or speed is taken as steady at each moment: its waveform fades from that of
        the block's begin to that of its end. Of camber gravity is felt, and its rate as that of turning.
        """
        turning = self._rotation.at(time_s)
        angle = self._jitter.shifted(turning.angle_rad, self._edges_rad)
        camber = self.plan.camber_rad.at_times(time_s)
        gravity = STANDARD_GRAVITY_MPS2 * np.cos(camber) + self._hub(turning)
        if self._ride is not None:
            change_n, hub_mps2 = self._ride(self.plan.motion.at(time_s).distance_m)
            weights = load_weights(self._loads_n, self.plan.load_n.at_times(time_s) + change_n)
            shape = np.zeros((len(time_s), COLUMNS), np.float32)
            for node, table in enumerate(self._by_load):
                shape += weights[:, node, None] * look_up(table, angle)
            gravity = gravity + hub_mps2
        else:
            shape = look_up(self._waveform, angle)
            if end is not self._waveform:
                shape += np.linspace(0.0, 1.0, len(time_s), dtype=np.float32)[:, None] * (look_up(end, angle) - shape)
        force = np.empty((len(time_s), 3))
        square = turning.omega_radps * turning.omega_radps
        spin = turning.omega_dot_radps2
        force[:, 2] = square * shape[:, 0] + gravity * shape[:, 2] + spin * shape[:, 4]
        force[:, 0] = square * shape[:, 1] + gravity * shape[:, 3] + spin * shape[:, 5]
        force[:, 1] = square * shape[:, LATERAL] + STANDARD_GRAVITY_MPS2 * np.sin(camber)
        if self.plan.path.turns:
            self.plan.path.add(force, time_s, turning.omega_radps, shape[:, 2:4].astype(np.float64), self.plan.radius_m)
        if self.plan.reverse:
            # theta grows with the rotation, but the orientation of the sensor is fixed.
            np.negative(force[:, 0], out=force[:, 0])
        self._road.add(force, turning.speed_mps)
        force[:, 2] += self._cavity(turning.speed_mps) + self._blows(time_s)
        return force

    def _waveform_at(self, time_s: float) -> WaveformTable:
        """Return the waveform of the tire under the given conditions, cached while they do not change."""
        plan = self.plan
        omega = float(plan.motion.at(np.array([time_s])).speed_mps[0]) / plan.radius_m
        conditions = (
            plan.load_n.at(time_s),
            plan.pressure_pa.at(time_s),
            omega if self._table.depends_on_speed else 0.0,
            plan.slip_angle_rad.at(time_s),
        )
        if conditions != self._conditions:
            self._conditions = conditions
            self._edges_rad = self._table.edges_rad(*conditions[:3])
            if self._ride is not None:
                self._loads_n, self._by_load = self._table.by_load(*conditions[1:])
            return self._table.waveform(*conditions)
        return self._waveform
