"""Sensor with a nonlinear radial axis, which the simulator lacks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gateway.simulator.sensor import SensorChain
from gateway.types import FloatArray


@dataclass(frozen=True, slots=True)
class Bend:
    """The radial axis reads a + square a^2 + cube a^3.

    Attributes:
        square_s2pm: share of the reading per m/s^2.
        cube_s4pm2: share of the reading per (m/s^2)^2.
    """

    square_s2pm: float
    cube_s4pm2: float

    def __call__(self, force_mps2: FloatArray) -> FloatArray:
        """Return the output of the nonlinear element for (n, 3) specific force."""
        read = force_mps2.copy()
        read[:, 2] *= 1.0 + force_mps2[:, 2] * (self.square_s2pm + self.cube_s4pm2 * force_mps2[:, 2])
        return read


class BentChain:
    """Sensor chain with a nonlinear element."""

    def __init__(self, chain: SensorChain, bend: Bend) -> None:
        """Take the sensor and its nonlinearity."""
        self._chain = chain
        self._bend = bend

    def __getattr__(self, name: str) -> Any:
        return getattr(self._chain, name)

    def __call__(self, force_mps2: FloatArray, time_s: FloatArray, temperature_degc: float) -> NDArray[np.int16]:
        """Return the sensor's counts of the distorted force."""
        return self._chain(self._bend(force_mps2), time_s, temperature_degc)
