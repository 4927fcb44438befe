"""Running time synchronous average of revolutions in the angle domain, and running moments of vectors."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from gateway.signal.angle_resampling import GRID_SIZE
from gateway.signal.contact_edges import EDGE_MODEL_STD_RAD
from gateway.signal.order_spectrum import ORDER_COUNT
from gateway.types import ComplexArray, FloatArray

DEFAULT_HORIZON_REVOLUTIONS: Final = 50.0


class RunningMoments:
    """Running weighted mean, and variance or covariance, of vectors.

    Attributes:
        count: number of vectors added.
        mean: (size,); every update makes a new array, so that references to earlier means stay valid.
        weight_square: sum of the squared normalised weights, 1 over the effective count: a scalar, or one value per
            element when the weights are arrays.
    """

    def __init__(self, size: int, *, covariance: bool = False) -> None:
        """Start empty; with `covariance` the full covariance matrix is kept, which needs scalar weights."""
        self.count = 0
        self.mean: FloatArray = np.zeros(size)
        self.weight_square: float | FloatArray = 1.0
        self._full = covariance
        self._spread: FloatArray = np.zeros((size, size) if covariance else size)

    def update(self, values: FloatArray, weight: float | FloatArray) -> None:
        """Add values with `weight`, their share of the new mean; a weight of 0 leaves them out."""
        self.count += 1
        change = values - self.mean
        step = weight * change
        self.mean = self.mean + step
        self._spread = (1.0 - weight) * (self._spread + (np.outer(step, change) if self._full else step * change))
        self.weight_square = (1.0 - weight) ** 2 * self.weight_square + weight * weight

    def variance(self) -> FloatArray:
        """Return the unbiased variance (with `covariance`, the matrix) of one value; NaN after a single update."""
        freedom = 1.0 - np.asarray(self.weight_square)
        known = freedom > 1e-12
        result: FloatArray = np.where(known, self._spread / np.where(known, freedom, 1.0), math.nan)
        return result


@dataclass(frozen=True, slots=True)
class AngleAverage:
    """The running time synchronous average over revolutions, scaled to one angular speed.

    Attributes:
        count: revolutions averaged so far.
        effective_count: number of equally weighted revolutions with the same variance of the mean.
        omega_radps: angular speed that the average is scaled to.
        radial_mps2: (n,) mean of the revolutions' `radial_mps2` times (omega / omega_i)^2.
        scatter_mps2: (n,) standard deviation from revolution to revolution at each angle; NaN while count < 2.
        orders_mps2: (61,) complex coefficients of the average, c - i s.
        orders_std_mps2: (61,) standard error of each real coefficient (cosine or sine) of the average.
        leading_edge_rad: mean leading edge.
        trailing_edge_rad: mean trailing edge.
        leading_edge_std_rad: standard error of the mean.
        trailing_edge_std_rad: standard error of the mean.
    """

    count: int
    effective_count: float
    omega_radps: float
    radial_mps2: FloatArray
    scatter_mps2: FloatArray
    orders_mps2: ComplexArray
    orders_std_mps2: FloatArray
    leading_edge_rad: float
    trailing_edge_rad: float
    leading_edge_std_rad: float
    trailing_edge_std_rad: float


class RunningAverage:
    """Exponentially weighted average over revolutions; a plain mean until the horizon is reached.

    The waveform of a revolution scales with the square of its angular speed, so it is stored over omega^2 and returned
    at the speed of the latest revolution. Deterministic; O(n) time and memory.
    """

    def __init__(self, horizon_revolutions: float = DEFAULT_HORIZON_REVOLUTIONS, n: int = GRID_SIZE) -> None:
        """Start empty.

        Args:
            horizon_revolutions: length of the memory in revolutions, at least 1; the weight of a new revolution is at
                least its inverse. The effective count converges to 2 horizon - 1.
            n: size of the angle grid.

        Raises:
            ValueError: a horizon below 1.
        """
        if not horizon_revolutions >= 1.0:
            raise ValueError(f"the horizon of the average must be at least 1 revolution, not {horizon_revolutions}")
        self._floor = 1.0 / horizon_revolutions
        self._n = n
        self.reset()

    def reset(self) -> None:
        """Forget everything, as after a change of tire."""
        self._count = 0
        self._latest: AngleAverage | None = None
        self._wave = RunningMoments(self._n)
        self._cosine = RunningMoments(ORDER_COUNT)
        self._sine = RunningMoments(ORDER_COUNT)
        self._edges = RunningMoments(2)
        self._order_counts = np.zeros(ORDER_COUNT)
        self._order_noise = 0.0
        self._edge_square = np.zeros(2)

    @property
    def latest(self) -> AngleAverage | None:
        """The average after the last update, None before the first."""
        return self._latest

    def update(
        self,
        radial_mps2: FloatArray,
        orders_mps2: ComplexArray,
        omega_radps: float,
        *,
        edges_rad: tuple[float, float],
        edges_std_rad: tuple[float, float],
        noise_mps2: float,
    ) -> AngleAverage:
        """Add one revolution and return the new average.

        Args:
            radial_mps2: (n,) normalised radial waveform.
            orders_mps2: (61,) its coefficients; orders that are NaN keep their average.
            omega_radps: mean angular speed.
            edges_rad: leading and trailing edge; NaN edges do not change the mean edges.
            edges_std_rad: standard errors of the two, including the uncertainty of the edge's definition.
            noise_mps2: noise of one angle-domain sample, used for standard errors until the scatter is known.

        Returns:
            The average at this revolution's speed.

        Raises:
            ValueError: the waveform has the wrong size or is not finite, or the speed is not positive; the average is
                unchanged.
        """
        if radial_mps2.shape != (self._n,) or not np.isfinite(radial_mps2).all():
            raise ValueError(f"the average takes {self._n} finite samples per revolution")
        if not (math.isfinite(omega_radps) and omega_radps > 0.0):
            raise ValueError(f"the average needs a positive angular speed, not {omega_radps}")
        self._count += 1
        square = omega_radps**2
        weight = max(1.0 / self._count, self._floor)
        self._wave.update(radial_mps2 / square, weight)

        carried = np.isfinite(orders_mps2.real)
        self._order_counts += carried
        order_weights = np.where(carried, np.maximum(1.0 / np.maximum(self._order_counts, 1.0), self._floor), 0.0)
        scaled = np.where(carried, orders_mps2, 0.0) / square
        self._cosine.update(scaled.real, order_weights)
        self._sine.update(scaled.imag, order_weights)
        noise = noise_mps2 * math.sqrt(2.0 / self._n) / square if math.isfinite(noise_mps2) else 0.0
        self._order_noise += weight * (noise**2 - self._order_noise)

        if all(map(math.isfinite, (*edges_rad, *edges_std_rad))):
            self._edges.update(np.array(edges_rad), max(1.0 / (self._edges.count + 1), self._floor))
            share = max(1.0 / self._edges.count, self._floor)
            self._edge_square = self._edge_square + share * (np.square(edges_std_rad) - self._edge_square)
        self._latest = self._result(omega_radps)
        return self._latest

    def _result(self, omega_radps: float) -> AngleAverage:
        square = omega_radps**2
        seen = self._order_counts > 0.0
        orders = np.full(ORDER_COUNT, complex(math.nan, math.nan))
        orders[seen] = (self._cosine.mean + 1j * self._sine.mean)[seen] * square
        # Order 0 has no sine. Scatter has one degree of freedom per coefficient and revolution: below three revolutions
        # the estimate of the noise is better.
        variance = 0.5 * (self._cosine.variance() + self._sine.variance())
        variance[0] *= 2.0
        noise = np.full(ORDER_COUNT, self._order_noise)
        noise[0] *= 0.5
        variance = np.where(self._order_counts >= 3.0, variance, noise)
        orders_std = np.where(seen, np.sqrt(variance * self._cosine.weight_square) * square, math.nan)
        edges, edges_std = np.full(2, math.nan), np.full(2, math.nan)
        if self._edges.count:
            edges = self._edges.mean
            # The part of the stated errors beyond the scatter is the uncertainty of the edge's definition. It is a
            # constant error, so averaging does not reduce it.
            model_variance = EDGE_MODEL_STD_RAD**2
            known = self._edges.count >= 3
            scatter = self._edges.variance() if known else np.maximum(self._edge_square - model_variance, 0.0)
            definition = np.maximum(self._edge_square - scatter, model_variance)
            edges_std = np.sqrt(scatter * self._edges.weight_square + definition)
        return AngleAverage(
            count=self._count,
            effective_count=float(1.0 / self._wave.weight_square),
            omega_radps=omega_radps,
            radial_mps2=self._wave.mean * square,
            scatter_mps2=np.sqrt(self._wave.variance()) * square,
            orders_mps2=orders,
            orders_std_mps2=orders_std,
            leading_edge_rad=float(edges[0]),
            trailing_edge_rad=float(edges[1]),
            leading_edge_std_rad=float(edges_std[0]),
            trailing_edge_std_rad=float(edges_std[1]),
        )
