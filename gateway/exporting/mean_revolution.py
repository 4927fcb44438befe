"""Time synchronous average of all revolutions of a measurement, with their scatter."""

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from gateway.core.constants import AXIS_NAMES
from gateway.core.estimates.estimator import Revolution
from gateway.core.estimates.revolution_block import extended
from gateway.core.revolutions.angle_resampling import GRID_SIZE, angle_grid
from gateway.core.revolutions.synchronous_average import AngleAverage, RunningAverage, RunningMoments
from gateway.core.types import FloatArray

_AXES: Final = 3


@dataclass(frozen=True, slots=True)
class MeanRevolution:
    """The mean of revolutions and the standard deviation from revolution to revolution.

    Attributes:
        count: number of revolutions.
        omega_radps: mean angular speed.
        omega_std_radps: its standard deviation; NaN for a single revolution.
        axes_mps2: (3, n) mean of the axes as measured; NaN rows for absent axes.
        axes_scatter_mps2: (3, n) standard deviation at each angle; NaN for a single revolution. At varying speed it
            contains the change of the waveform with the speed.
        radial: average of the normalised radial axis, every revolution scaled to the mean speed.
    """

    count: int
    omega_radps: float
    omega_std_radps: float
    axes_mps2: FloatArray
    axes_scatter_mps2: FloatArray
    radial: AngleAverage

    def curves(self) -> dict[str, FloatArray]:
        """Return the columns of `AVERAGE_COLUMNS` with one value an angle, by name."""
        curves = {"angle_rad": angle_grid()}
        for axis, name in enumerate(AXIS_NAMES):
            curves[f"{name}_mps2"] = self.axes_mps2[axis]
            curves[f"{name}_scatter_mps2"] = self.axes_scatter_mps2[axis]
        return curves | {
            "normalised_mps2": self.radial.radial_mps2,
            "normalised_scatter_mps2": self.radial.scatter_mps2,
        }


class MeanOfRevolutions:
    """Adds revolutions one by one; memory is that of a few revolutions."""

    def __init__(self, n: int = GRID_SIZE) -> None:
        """Start empty; `n` is the size of the angle grid."""
        self._radial = RunningAverage(math.inf, n)
        self._axes = RunningMoments(_AXES * n)
        self._omega = RunningMoments(1)

    def add(self, revolution: Revolution) -> None:
        """Add a revolution.

        Raises:
            ValueError: as `RunningAverage.update_block`; nothing is added.
        """
        extended(self._radial, revolution)
        weight = 1.0 / (self._axes.count + 1)
        self._axes.update(revolution.axes_mps2.ravel(), weight)
        self._omega.update(np.array([revolution.omega_radps]), weight)

    def mean(self) -> MeanRevolution | None:
        """Return the mean of the revolutions so far, None without any."""
        latest = self._radial.latest
        if latest is None:
            return None
        omega_radps = float(self._omega.mean[0])
        gain = (omega_radps / latest.omega_radps) ** 2
        return MeanRevolution(
            count=latest.count,
            omega_radps=omega_radps,
            omega_std_radps=math.sqrt(float(self._omega.variance()[0])) if latest.count > 1 else math.nan,
            axes_mps2=self._axes.mean.reshape(_AXES, -1),
            axes_scatter_mps2=np.sqrt(self._axes.variance()).reshape(_AXES, -1),
            radial=replace(
                latest,
                omega_radps=omega_radps,
                radial_mps2=latest.radial_mps2 * gain,
                scatter_mps2=latest.scatter_mps2 * gain,
                orders_mps2=latest.orders_mps2 * gain,
                orders_std_mps2=latest.orders_std_mps2 * gain,
            ),
        )
