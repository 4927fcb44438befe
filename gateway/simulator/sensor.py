"""Simulated sensor: mounting, gain, offset, noise, bandwidth, coupling, range, quantisation and defects."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from firmware_protocol.messages import Axis, Coupling
from gateway.core.constants import AXIS_NAMES, STANDARD_GRAVITY_MPS2
from gateway.core.types import FloatArray
from gateway.simulator.filters import Biquad, highpass, loose_mass, lowpass
from gateway.simulator.scenario_tables import Defect, Sensor


class SensorDefect:
    """Defects of some channels of a sensor, applied block by block."""

    def __init__(self, defect: Defect, channels: Sequence[str], rate_hz: float) -> None:
        """Take the defect table and the names of the channels in order."""
        self._hit = [i for i, name in enumerate(channels) if name in defect.axes]
        self._clip_mps2 = None if defect.clip_g is None else defect.clip_g * STANDARD_GRAVITY_MPS2
        self._loose = None if defect.loose_hz is None else loose_mass(defect.loose_hz, defect.loose_q, rate_hz)
        self._dead_s = math.inf if defect.dead_from_s is None else defect.dead_from_s
        self._stuck_s = math.inf if defect.stuck_from_s is None else defect.stuck_from_s
        self._last: NDArray[np.int16] | None = None

    def mechanical(self, signal: FloatArray) -> None:
        """Apply the ringing of a loose sensor: a mass on a spring, driven by the true signal."""
        if self._loose is not None and self._hit:
            signal[:, self._hit] = self._loose(signal[:, self._hit])

    def element(self, signal: FloatArray, counts_per_mps2: FloatArray) -> None:
        """Saturate the sensing element below its declared range, undetected by the converter."""
        if self._clip_mps2 is not None:
            for channel in self._hit:
                limit = self._clip_mps2 * abs(float(counts_per_mps2[channel]))
                np.clip(signal[:, channel], -limit, limit, out=signal[:, channel])

    def output(self, counts: NDArray[np.int16], time_s: FloatArray) -> None:
        """Freeze channels at their last value, or at 0, from a given time on."""
        if not len(counts):
            return
        for channel in self._hit:
            if (stuck := int(np.searchsorted(time_s, self._stuck_s))) < len(counts):
                frozen = counts[stuck - 1] if stuck else counts[0] if self._last is None else self._last
                counts[stuck:, channel] = frozen[channel]
            counts[int(np.searchsorted(time_s, self._dead_s)) :, channel] = 0
        self._last = counts[-1].copy()


FULL_SCALE_COUNTS = 32767
REFERENCE_DEGC = 25.0
"""Temperature at which gain and zero-g offset are as stated."""
NO_DEFECT = Defect()

_AXES = {"circumferential": Axis.CIRCUMFERENTIAL, "lateral": Axis.LATERAL, "radial": Axis.RADIAL}


class SensorChain:
    """Turns specific force along the belt's directions into counts, block by block.

    Attributes:
        axes: axis mask of the channels.
        channels: number of channels.
        coupling: as declared in the hello.
        highpass_hz: corner frequency as declared, 0 when DC.
        range_mps2: full scale per axis, 0 for absent ones.
        scale_mps2: m/s^2 per count per axis as declared in the hello.
    """

    def __init__(self, sensor: Sensor, rng: np.random.Generator, defect: Defect = NO_DEFECT) -> None:
        """Take the sensor's data sheet, random generator and defects."""
        present = sorted({_AXES[name] for name in sensor.axes})
        self._columns = [int(axis) for axis in present]
        self.channels = len(present)
        self.axes = sum(1 << axis for axis in present)
        corner_hz = sensor.highpass_hz if sensor.coupling == "ac" else 0.0
        self.highpass_hz = corner_hz if sensor.coupling_declared else 0.0
        self.coupling = Coupling.AC if self.highpass_hz else Coupling.DC
        full_scale = sensor.range_g * STANDARD_GRAVITY_MPS2
        signs = (1.0, 1.0, float(sensor.radial_sign))
        declared = signs if sensor.sign_declared else (1.0, 1.0, 1.0)
        self.range_mps2 = _triple([full_scale if axis in present else 0.0 for axis in Axis])
        self.scale_mps2 = _triple(
            [declared[axis] * full_scale / FULL_SCALE_COUNTS if axis in present else 0.0 for axis in Axis]
        )
        gain = 1.0 + 0.01 * np.array(sensor.gain_error_percent)
        to_counts = np.array(signs) * FULL_SCALE_COUNTS / full_scale
        # (3, channels): from the belt's directions to counts of the channels.
        share = 0.01 * sensor.cross_axis_percent
        cross = share + (1.0 - share) * np.eye(3)
        mounting = mounting_matrix(sensor.roll_deg, sensor.pitch_deg, sensor.yaw_deg)
        self._matrix = (gain * to_counts)[self._columns] * (cross @ mounting).T[:, self._columns]
        self._offset = (to_counts * np.array(sensor.zero_g_offset_g) * STANDARD_GRAVITY_MPS2)[self._columns]
        density = np.array(sensor.noise_mg_rthz) * 1e-3 * STANDARD_GRAVITY_MPS2
        self._noise = (np.abs(to_counts) * density * math.sqrt(0.5 * sensor.rate_hz))[self._columns]
        self._counts_per_mps2 = to_counts[self._columns]
        per_mg = 1e-3 * STANDARD_GRAVITY_MPS2 * self._counts_per_mps2
        self._gain_drift = 0.01 * np.array(sensor.gain_drift_percent_per_k)[self._columns]
        self._offset_drift = per_mg * np.array(sensor.zero_g_drift_mg_per_k)[self._columns]
        self._step = None if sensor.resolution_mg is None else np.abs(per_mg) * sensor.resolution_mg
        self._tone = np.abs(per_mg) * np.array(sensor.tone_mg)[self._columns]
        self._tone_radps = 2.0 * math.pi * sensor.tone_hz
        self._defect = SensorDefect(defect, [AXIS_NAMES[axis] for axis in self._columns], sensor.rate_hz)
        self._rng = rng
        self._filters: list[Biquad] = []
        if sensor.bandwidth_hz is not None:
            self._filters.append(lowpass(sensor.bandwidth_hz, sensor.rate_hz))
        if corner_hz:
            self._filters.append(highpass(corner_hz, sensor.rate_hz))

    def __call__(self, force_mps2: FloatArray, time_s: FloatArray, temperature_degc: float) -> NDArray[np.int16]:
        """Return (n, channels) counts of (n, 3) specific force along circumferential, lateral, radial.

        Args:
            force_mps2: at the sensor's place.
            time_s: (n,) of the samples.
            temperature_degc: of the sensor.
        """
        signal = force_mps2 @ self._matrix
        self._defect.mechanical(signal)
        warmer = temperature_degc - REFERENCE_DEGC
        if self._gain_drift.any():
            signal *= 1.0 + warmer * self._gain_drift
        signal += self._offset + warmer * self._offset_drift
        if self._noise.any():
            signal += self._rng.standard_normal(signal.shape) * self._noise
        self._defect.element(signal, self._counts_per_mps2)
        for section in self._filters:
            signal = section(signal)
        if self._tone.any():
            signal += np.sin(self._tone_radps * time_s)[:, None] * self._tone
        if self._step is not None:
            signal = np.rint(signal / self._step) * self._step
        np.rint(signal, out=signal)
        np.clip(signal, -FULL_SCALE_COUNTS, FULL_SCALE_COUNTS, out=signal)
        counts = signal.astype(np.int16)
        self._defect.output(counts, time_s)
        return counts


def mounting_matrix(roll_deg: float, pitch_deg: float, yaw_deg: float = 0.0) -> FloatArray:
    """Return the matrix from the belt's directions (circumferential, lateral, radial) to the sensor's axes.

    Roll, about the circumferential axis, projects the radial acceleration onto +lateral; pitch, about the lateral
    axis, lets it leak into +circumferential; yaw, about the radial axis and first of the three, lets the
    circumferential acceleration leak into +lateral.
    """
    cos_roll, sin_roll = math.cos(math.radians(roll_deg)), math.sin(math.radians(roll_deg))
    cos_pitch, sin_pitch = math.cos(math.radians(pitch_deg)), math.sin(math.radians(pitch_deg))
    cos_yaw, sin_yaw = math.cos(math.radians(yaw_deg)), math.sin(math.radians(yaw_deg))
    rolled = np.array([[1.0, 0.0, 0.0], [0.0, cos_roll, sin_roll], [0.0, -sin_roll, cos_roll]])
    pitched = np.array([[cos_pitch, 0.0, sin_pitch], [0.0, 1.0, 0.0], [-sin_pitch, 0.0, cos_pitch]])
    yawed = np.array([[cos_yaw, -sin_yaw, 0.0], [sin_yaw, cos_yaw, 0.0], [0.0, 0.0, 1.0]])
    matrix: FloatArray = pitched @ rolled @ yawed
    return matrix


def _triple(values: list[float]) -> tuple[float, float, float]:
    first, second, third = values
    return first, second, third
