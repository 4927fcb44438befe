"""Channels of a test rig that vary in time, such as load and slip angle, at the revolutions of a recording."""

import math
from collections.abc import Iterable
from typing import Final, NamedTuple

import numpy as np

from gateway.core.estimates.weighted_mean import MeanEstimate
from gateway.core.recording.reader import RecordingReader
from gateway.core.recording.recorded_file import RecordedFile
from gateway.core.types import FloatArray
from gateway.importing.reference_comparison import FEWEST_TURNS, RIG_CHANNELS, mean_std, turn_means
from gateway.importing.reference_topic import RecordedReferences

_NAMES: Final = {
    "load": "rig_load_n",
    "side_force": "rig_side_force_n",
    "slip_angle": "rig_slip_angle_rad",
    "camber": "rig_camber_rad",
    "torque": "rig_torque_nm",
}


class RigValues(NamedTuple):
    """A channel at revolutions.

    Attributes:
        values: (n,) mean over each revolution in N, rad or N*m; NaN where the channel does not cover it.
        std: standard error of a value that all share.
    """

    values: FloatArray
    std: float

    @property
    def covered(self) -> int:
        """Number of revolutions with a value."""
        return int(np.isfinite(self.values).sum())

    def mean(self) -> MeanEstimate:
        """Return the mean; its error has that of the channel, and what the values vary by."""
        values = self.values[np.isfinite(self.values)]
        scatter, scatter_std = float(values.std(ddof=1)), mean_std(values)
        std = math.hypot(self.std, scatter_std)
        return MeanEstimate(
            float(values.mean()), std, self.std, scatter_std, scatter, len(values), len(values), math.inf
        )


class RigChannels:
    """Channels of the rig in a recording, complete after a pass over it."""

    def __init__(self, file: RecordedFile) -> None:
        """Watch a file that is read next; the dump of a link has no channels."""
        self._references = RecordedReferences(file) if isinstance(file, RecordingReader) else None

    def at(self, position: str, quantity: str, turns: Iterable[tuple[float, float]]) -> RigValues | None:
        """Return a channel of a wheel at revolutions; None without one.

        Args:
            position: of the wheel.
            quantity: one of `RIG_CHANNELS`.
            turns: begin of each revolution by the hub's time, and its duration, s.
        """
        for reference in self._references.references() if self._references is not None else ():
            if (reference.position, reference.quantity) == (position, quantity):
                starts, periods = np.array(list(turns), dtype=np.float64).reshape(-1, 2).T
                return RigValues(turn_means(reference.times_s, reference.values, starts, periods), reference.value_std)
        return None

    def means(self, position: str, turns: Iterable[tuple[float, float]]) -> dict[str, MeanEstimate]:
        """Return the mean of each channel of a wheel that covers three revolutions or more, by a name with unit."""
        revolutions = list(turns)
        measured = {_NAMES[quantity]: self.at(position, quantity, revolutions) for quantity in RIG_CHANNELS}
        return {name: rig.mean() for name, rig in measured.items() if rig is not None and rig.covered >= FEWEST_TURNS}
