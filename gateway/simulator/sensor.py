"""The sensor: mounting, gain, offset, noise, bandwidth, coupling, range and 16 bit."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from firmware_protocol.messages import Axis, Coupling
from gateway.physics.rolling_ring_waveform import STANDARD_GRAVITY_MPS2
from gateway.simulator.filters import Biquad, highpass, lowpass
from gateway.simulator.scenario_tables import Sensor

FloatArray = NDArray[np.float64]

FULL_SCALE_COUNTS = 32767
_AXES = {"circumferential": Axis.CIRCUMFERENTIAL, "lateral": Axis.LATERAL, "radial": Axis.RADIAL}


class SensorChain:
    """Turns specific force along the belt's directions into counts, block by block.

    Attributes:
        axes: axis mask of the channels.
        channels: number of channels.
        coupling: as the hello tells it.
        highpass_hz: corner of the AC coupling, 0 when DC.
        range_mps2: full scale per axis, 0 for absent ones.
        scale_mps2: m/s^2 per count per axis as the hello tells it.
    """

    def __init__(self, sensor: Sensor, rng: np.random.Generator) -> None:
        """Take the sensor's data sheet and its random numbers."""
        present = sorted({_AXES[name] for name in sensor.axes})
        self._columns = [int(axis) for axis in present]
        self.channels = len(present)
        self.axes = sum(1 << axis for axis in present)
        self.coupling = Coupling.AC if sensor.coupling == "ac" else Coupling.DC
        self.highpass_hz = sensor.highpass_hz if sensor.coupling == "ac" else 0.0
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
        self._matrix = (gain * to_counts)[self._columns] * mounting_matrix(sensor.roll_deg, sensor.pitch_deg).T[
            :, self._columns
        ]
        self._offset = (to_counts * np.array(sensor.zero_g_offset_g) * STANDARD_GRAVITY_MPS2)[self._columns]
        density = np.array(sensor.noise_mg_rthz) * 1e-3 * STANDARD_GRAVITY_MPS2
        self._noise = (np.abs(to_counts) * density * math.sqrt(0.5 * sensor.rate_hz))[self._columns]
        self._rng = rng
        self._filters: list[Biquad] = []
        if sensor.bandwidth_hz is not None:
            self._filters.append(lowpass(sensor.bandwidth_hz, sensor.rate_hz))
        if self.highpass_hz:
            self._filters.append(highpass(self.highpass_hz, sensor.rate_hz))

    def __call__(self, force_mps2: FloatArray) -> NDArray[np.int16]:
        """Return (n, channels) counts of (n, 3) specific force along circumferential, lateral, radial."""
        signal = force_mps2 @ self._matrix
        signal += self._offset
        if self._noise.any():
            signal += self._rng.standard_normal(signal.shape) * self._noise
        for section in self._filters:
            signal = section(signal)
        np.rint(signal, out=signal)
        np.clip(signal, -FULL_SCALE_COUNTS, FULL_SCALE_COUNTS, out=signal)
        return signal.astype(np.int16)


def mounting_matrix(roll_deg: float, pitch_deg: float) -> FloatArray:
    """Return the matrix from the belt's directions (circumferential, lateral, radial) to the sensor's axes.

    Roll, about the circumferential axis, lets the radial acceleration leak into +lateral; pitch, about the lateral
    axis, lets it leak into +circumferential.
    """
    roll, pitch = math.radians(roll_deg), math.radians(pitch_deg)
    rolled = np.array([[1.0, 0.0, 0.0], [0.0, math.cos(roll), math.sin(roll)], [0.0, -math.sin(roll), math.cos(roll)]])
    pitched = np.array(
        [[math.cos(pitch), 0.0, math.sin(pitch)], [0.0, 1.0, 0.0], [-math.sin(pitch), 0.0, math.cos(pitch)]]
    )
    matrix: FloatArray = pitched @ rolled
    return matrix


def _triple(values: list[float]) -> tuple[float, float, float]:
    first, second, third = values
    return first, second, third
