"""Time synchronous average of all revolutions of a measurement, with their scatter."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from gateway.signal.angle_resampling import GRID_SIZE
from gateway.signal.synchronous_average import AngleAverage, RunningAverage, RunningMoments
from gateway.types import ComplexArray, FloatArray

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


class MeanOfRevolutions:
    """Adds revolutions one by one; memory is that of a few revolutions."""

    def __init__(self, n: int = GRID_SIZE) -> None:
        """Start empty; `n` is the size of the angle grid."""
        self._radial = RunningAverage(math.inf, n)
        self._axes = RunningMoments(_AXES * n)
        self._omega = RunningMoments(1)

    def add(
        self,
        axes_mps2: FloatArray,
        radial_mps2: FloatArray,
        orders_mps2: ComplexArray,
        omega_radps: float,
        *,
        edges_rad: tuple[float, float],
        edges_std_rad: tuple[float, float],
        noise_mps2: float,
    ) -> None:
        """Add a revolution.

        Args:
            axes_mps2: (3, n) axes as measured, NaN rows for absent axes.
            radial_mps2: (n,) radial axis, normalised.
            orders_mps2: (61,) its coefficients.
            omega_radps: mean angular speed.
            edges_rad: leading and trailing edge, NaN when not known.
            edges_std_rad: their standard errors.
            noise_mps2: noise of one sample of the normalised radial axis.

        Raises:
            ValueError: as `RunningAverage.update`; nothing is added.
        """
        self._radial.update(
            radial_mps2,
            orders_mps2,
            omega_radps,
            edges_rad=edges_rad,
            edges_std_rad=edges_std_rad,
            noise_mps2=noise_mps2,
        )
        weight = 1.0 / (self._axes.count + 1)
        self._axes.update(axes_mps2.ravel(), weight)
        self._omega.update(np.array([omega_radps]), weight)

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
