"""Sensor element that the simulator lacks: a nonlinear radial axis, and a bond that yields."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gateway.core.types import FloatArray
from gateway.simulator.sensor import SensorChain

Element = Callable[[FloatArray, FloatArray], FloatArray]
"""From (n, 3) specific force and (n,) times, s, to the (n, 3) that the sensor's own axes read."""


@dataclass(frozen=True, slots=True)
class Bend:
    """The radial axis reads a + square a^2 + cube a^3.

    Attributes:
        square_s2pm: share of the reading per m/s^2.
        cube_s4pm2: share of the reading per (m/s^2)^2.
    """

    square_s2pm: float
    cube_s4pm2: float

    def __call__(self, force_mps2: FloatArray, _: FloatArray) -> FloatArray:
        """Return the output of the nonlinear element for (n, 3) specific force."""
        read = force_mps2.copy()
        read[:, 2] *= 1.0 + force_mps2[:, 2] * (self.square_s2pm + self.cube_s4pm2 * force_mps2[:, 2])
        return read


@dataclass(frozen=True, slots=True)
class Creep:
    """The sensor's bond yields under the centripetal load: its pitch grows with the logarithm of time.

    Attributes:
        pitch_rad: reached after `reach_s`.
        onset_s: time constant of the creep law, ln(1 + t / onset).
        reach_s: time at which `pitch_rad` is reached.
    """

    pitch_rad: float
    onset_s: float
    reach_s: float

    def __call__(self, force_mps2: FloatArray, time_s: FloatArray) -> FloatArray:
        """Return (n, 3) specific force along the axes of the tilting sensor."""
        angle = self.pitch_rad * np.log1p(time_s / self.onset_s) / math.log1p(self.reach_s / self.onset_s)
        cosine, sine = np.cos(angle), np.sin(angle)
        read = force_mps2.copy()
        read[:, 0] = cosine * force_mps2[:, 0] + sine * force_mps2[:, 2]
        read[:, 2] = cosine * force_mps2[:, 2] - sine * force_mps2[:, 0]
        return read


class BentChain:
    """Sensor chain with such an element in front."""

    def __init__(self, chain: SensorChain, element: Element) -> None:
        """Take the sensor and its element."""
        self._chain = chain
        self._element = element

    def __getattr__(self, name: str) -> Any:
        return getattr(self._chain, name)

    def __call__(self, force_mps2: FloatArray, time_s: FloatArray, temperature_degc: float) -> NDArray[np.int16]:
        """Return the sensor's counts of the distorted force."""
        return self._chain(self._element(force_mps2, time_s), time_s, temperature_degc)
