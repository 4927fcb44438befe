"""Sensor without noise and rounding, for the size of a contribution."""

from typing import Any

import numpy as np

from gateway.core.types import FloatArray
from gateway.simulator.sensor import SensorChain


class ExactChain(SensorChain):
    """The same sensor with real numbers in place of counts, and no noise."""

    def __call__(self, force_mps2: FloatArray, time_s: FloatArray, temperature_degc: float) -> Any:
        """Return (n, channels) of the noise-free counts, not rounded."""
        signal = force_mps2 @ self._matrix
        self._defect.mechanical(signal)
        warmer = temperature_degc - 25.0
        signal *= 1.0 + warmer * self._gain_drift
        signal += self._offset + warmer * self._offset_drift
        self._defect.element(signal, self._counts_per_mps2)
        for section in self._filters:
            signal = section(signal)
        signal += np.sin(self._tone_radps * time_s)[:, None] * self._tone
        return signal
