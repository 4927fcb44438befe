"""What can be wrong with a sensor: loose, saturating early, stuck, dead."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gateway.constants import STANDARD_GRAVITY_MPS2
from gateway.simulator.filters import loose_mass
from gateway.simulator.scenario_tables import Defect
from gateway.types import FloatArray


class SensorDefect:
    """Spoils some channels of a sensor, block by block."""

    def __init__(self, defect: Defect, channels: Sequence[str], rate_hz: float) -> None:
        """Take the table and the names of the channels in their order."""
        self._hit = [i for i, name in enumerate(channels) if name in defect.axes]
        self._clip_mps2 = None if defect.clip_g is None else defect.clip_g * STANDARD_GRAVITY_MPS2
        self._loose = None if defect.loose_hz is None else loose_mass(defect.loose_hz, defect.loose_q, rate_hz)
        self._dead_s = math.inf if defect.dead_from_s is None else defect.dead_from_s
        self._stuck_s = math.inf if defect.stuck_from_s is None else defect.stuck_from_s
        self._last: NDArray[np.int16] | None = None

    def mechanical(self, signal: FloatArray) -> None:
        """Let a loose sensor ring on its mounting: a mass on a spring, shaken by what it should measure."""
        if self._loose is not None and self._hit:
            signal[:, self._hit] = self._loose(signal[:, self._hit])

    def element(self, signal: FloatArray, counts_per_mps2: FloatArray) -> None:
        """Let the sensing element saturate below its declared range; the converter does not see it."""
        if self._clip_mps2 is not None:
            for channel in self._hit:
                limit = self._clip_mps2 * abs(float(counts_per_mps2[channel]))
                np.clip(signal[:, channel], -limit, limit, out=signal[:, channel])

    def output(self, counts: NDArray[np.int16], time_s: FloatArray) -> None:
        """Let channels repeat their last value, or read 0, from a time on."""
        if not len(counts):
            return
        for channel in self._hit:
            if (stuck := int(np.searchsorted(time_s, self._stuck_s))) < len(counts):
                held = counts[stuck - 1] if stuck else counts[0] if self._last is None else self._last
                counts[stuck:, channel] = held[channel]
            counts[int(np.searchsorted(time_s, self._dead_s)) :, channel] = 0
        self._last = counts[-1].copy()
