"""Running time synchronous average of revolutions in the angle domain, and running moments of vectors."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import Final, NamedTuple, Protocol

import numpy as np

from gateway.core.revolutions.angle_resampling import GRID_SIZE
from gateway.core.revolutions.contact_edges import EDGE_MODEL_STD_RAD
from gateway.core.revolutions.order_spectrum import ORDER_COUNT, order_coefficients
from gateway.core.types import ComplexArray, FloatArray

DEFAULT_HORIZON_REVOLUTIONS: Final = 50.0
# Place of the first cosine among the values of a revolution; sines follow, and the waveform precedes.
_ORDERS_START: Final = -2 * ORDER_COUNT
_WAVEFORM: Final = slice(None, _ORDERS_START)
_ORDERS: Final = slice(_ORDERS_START, None)


class Shares(NamedTuple):
    """Shares of earlier and new values in the running means after each of k updates.

    Attributes:
        prior: (k,) of the mean before the first update.
        values: (k, k) of the new values, lower triangular.
    """

    prior: FloatArray
    values: FloatArray


@lru_cache(maxsize=256)
def running_shares(weights: tuple[float, ...]) -> Shares:
    """Return the shares for weights of updates one after the other; only the first may be 1."""
    weight = np.array(weights, dtype=np.float64)
    retained = np.subtract(1.0, weight, dtype=np.float64)
    is_initial = retained[0] == 0.0
    if is_initial:
        retained[0] = 1.0
    product = np.asarray(np.cumprod(retained), dtype=np.float64)
    values: FloatArray = np.tril(np.multiply.outer(product, weight / product))
    prior: FloatArray = np.zeros_like(product) if is_initial else product
    for array in (prior, values):
        array.setflags(write=False)
    return Shares(prior, values)


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
        determined = freedom > 1e-12
        result: FloatArray = np.where(determined, self._spread / np.where(determined, freedom, 1.0), math.nan)
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


class AverageSteps(Protocol):
    """The running average after each of consecutive revolutions."""

    @property
    def edges_rad(self) -> Sequence[tuple[float, float]]:
        """Mean leading and trailing edge after each; NaN before the first."""
        ...

    @property
    def counts(self) -> Sequence[int]:
        """As `AngleAverage.count`, after each."""
        ...

    @property
    def effective_counts(self) -> Sequence[float]:
        """As `AngleAverage.effective_count`, after each."""
        ...

    @property
    def spectra(self) -> ComplexArray:
        """(k, 61) coefficients c - i s of the averaged waveform after each, over a common positive factor."""
        ...

    @property
    def scatters(self) -> Sequence[float]:
        """Mean square deviation of the revolutions from the average after each, over a common positive factor."""
        ...

    def edges_std_rad(self, index: int) -> tuple[float, float]:
        """Return the standard errors of both mean edges after the revolution `index`."""
        ...

    def at(self, index: int) -> AngleAverage:
        """Return the average after the revolution `index`."""
        ...


class OneAverage:
    """A given average as the only step."""

    def __init__(self, average: AngleAverage) -> None:
        self._average = average
        self.edges_rad = [(average.leading_edge_rad, average.trailing_edge_rad)]
        self.counts = [average.count]
        self.effective_counts = [average.effective_count]

    @cached_property
    def spectra(self) -> ComplexArray:
        """(1, 61) coefficients."""
        return order_coefficients(self._average.radial_mps2[np.newaxis])

    @cached_property
    def scatters(self) -> Sequence[float]:
        """Mean square deviation of the revolutions."""
        return [float(np.square(self._average.scatter_mps2).mean())]

    def edges_std_rad(self, index: int) -> tuple[float, float]:  # noqa: ARG002 - part of the interface
        """Return the standard errors of both mean edges."""
        return self._average.leading_edge_std_rad, self._average.trailing_edge_std_rad

    def at(self, index: int) -> AngleAverage:  # noqa: ARG002 - part of the interface
        """Return the average."""
        return self._average


@dataclass(frozen=True, slots=True)
class _Edges:
    """Running mean and scatter of both edges, and mean square of their stated errors."""

    count: int = 0
    mean: tuple[float, float] = (math.nan, math.nan)
    spread: tuple[float, float] = (0.0, 0.0)
    weight_square: float = 1.0
    square: tuple[float, float] = (0.0, 0.0)

    def and_then(self, edges: tuple[float, float], stds: tuple[float, float], floor: float) -> _Edges:
        count = self.count + 1
        weight = max(1.0 / count, floor)
        retained = 1.0 - weight
        mean, square = self.mean if self.count else (0.0, 0.0), self.square
        first, second = edges[0] - mean[0], edges[1] - mean[1]
        return _Edges(
            count,
            (mean[0] + weight * first, mean[1] + weight * second),
            (
                retained * (self.spread[0] + weight * first * first),
                retained * (self.spread[1] + weight * second * second),
            ),
            retained * retained * self.weight_square + weight * weight,
            (
                square[0] + weight * (stds[0] * stds[0] - square[0]),
                square[1] + weight * (stds[1] * stds[1] - square[1]),
            ),
        )

    def stds_rad(self) -> tuple[float, float]:
        """Return the standard errors of both means."""
        if not self.count:
            return math.nan, math.nan
        # The part of the stated errors beyond the scatter is the uncertainty of the edge's definition. It is a
        # constant error, so averaging does not reduce it.
        model = EDGE_MODEL_STD_RAD**2
        freedom = 1.0 - self.weight_square
        determined = self.count >= 3 and freedom > 1e-12

        def std(spread: float, square: float) -> float:
            scatter = spread / freedom if determined else max(square - model, 0.0)
            return math.sqrt(scatter * self.weight_square + max(square - scatter, model))

        return std(self.spread[0], self.square[0]), std(self.spread[1], self.square[1])


@dataclass(frozen=True, slots=True)
class _Moments:
    """Weighted mean, spread and sum of squared weights; arrays are never changed in place."""

    mean: FloatArray
    spread: FloatArray
    weight_square: FloatArray

    @classmethod
    def empty(cls, size: int) -> _Moments:
        return cls(np.zeros(size), np.zeros(size), np.ones(size))

    def and_then(self, values: FloatArray, weights: FloatArray) -> _Moments:
        """Return the moments with k further values (k, size) of weights (k, size or 1) added one after the other.

        They are the weighted mean and scatter about it, so the order of the sums does not matter. Deviations are taken
        from the earlier mean, which keeps the difference of squares exact.
        """
        if not len(values):
            return self
        # Share that each update leaves to the values before it, those of later updates included.
        if len(values) == 1:
            shares, retained = weights, 1.0 - weights[0]
        else:
            product = np.cumprod(1.0 - weights[::-1], axis=0)[::-1]
            shares, retained = weights.copy(), product[0]
            shares[:-1] *= product[1:]
        origin = np.where(retained > 0.0, self.mean, values[0])
        change = values - origin
        if shares.shape[1] == 1:
            column = shares[:, 0]
            mean, square = column @ change, column @ np.square(change)
        else:
            mean, square = np.sum(shares * change, axis=0), np.sum(shares * np.square(change), axis=0)
        spread = np.maximum(retained * self.spread + square - np.square(mean), 0.0)
        return _Moments(origin + mean, spread, retained**2 * self.weight_square + np.sum(np.square(shares), axis=0))

    def and_then_partly(self, values: FloatArray, weights: FloatArray, measured: FloatArray) -> _Moments:
        """As `and_then`, of values of which only a share `measured` (k, 1) scatters; it stands for the rest too."""
        mean, spread, weight_square = self.mean, self.spread, self.weight_square
        for value, weight, share in zip(values, weights, measured, strict=True):
            change, retained = value - mean, 1.0 - weight
            mean = mean + weight * change
            spread = retained * (spread + weight / share * np.square(change))
            weight_square = np.square(retained) * weight_square + np.square(weight) / share
        return _Moments(mean, spread, weight_square)

    def variance(self, part: slice) -> FloatArray:
        """Return the unbiased variance of one value of each of a part; NaN after a single one."""
        freedom = 1.0 - self.weight_square[part]
        determined = freedom > 1e-12
        result: FloatArray = np.where(determined, self.spread[part] / np.where(determined, freedom, 1.0), math.nan)
        return result


@dataclass(frozen=True, slots=True)
class _State:
    """All of the running average after a revolution.

    Attributes:
        moments: of the waveform, (n,), then of its cosines and sines, (61,) each, over the square of the speed.
        order_counts: (61,) revolutions that have carried each order.
        count: revolutions.
        weight_square: sum of their squared weights.
        order_noise: variance of a coefficient by noise.
        omega_radps: latest speed.
        edges: of the contact.
    """

    moments: _Moments
    order_counts: FloatArray
    count: int = 0
    weight_square: float = 1.0
    order_noise: float = 0.0
    omega_radps: float = math.nan
    edges: _Edges = field(default_factory=_Edges)

    @property
    def waveform_mps2(self) -> FloatArray:
        result: FloatArray = self.moments.mean[:_ORDERS_START] * self.omega_radps**2
        return result

    @property
    def scatter_mps2(self) -> FloatArray:
        result: FloatArray = np.sqrt(self.moments.variance(_WAVEFORM)) * self.omega_radps**2
        return result

    def average(self) -> AngleAverage:
        square = self.omega_radps**2
        carried = self.order_counts > 0.0
        cosine, sine = self.moments.mean[_ORDERS_START:].reshape(2, ORDER_COUNT)
        orders = np.where(carried, (cosine - 1j * sine) * square, complex(math.nan, math.nan))
        # Order 0 has no sine. Scatter has one degree of freedom per coefficient and revolution: below three revolutions
        # the estimate of the noise is better.
        variance = 0.5 * self.moments.variance(_ORDERS).reshape(2, ORDER_COUNT).sum(axis=0)
        variance[0] *= 2.0
        noise = np.full(ORDER_COUNT, self.order_noise)
        noise[0] *= 0.5
        variance = np.where(self.order_counts >= 3.0, variance, noise)
        orders_std = np.where(carried, np.sqrt(variance * self.moments.weight_square[-ORDER_COUNT:]) * square, math.nan)
        leading_std, trailing_std = self.edges.stds_rad()
        return AngleAverage(
            count=self.count,
            effective_count=1.0 / self.weight_square,
            omega_radps=self.omega_radps,
            radial_mps2=self.waveform_mps2,
            scatter_mps2=self.scatter_mps2,
            orders_mps2=orders,
            orders_std_mps2=orders_std,
            leading_edge_rad=self.edges.mean[0],
            trailing_edge_rad=self.edges.mean[1],
            leading_edge_std_rad=leading_std,
            trailing_edge_std_rad=trailing_std,
        )


def _cosines_and_sines(values: FloatArray, *, has_orders: bool) -> FloatArray:
    """Return the coefficients of k waveforms, (k, 122), from values (k, n + 122) that contain them or not."""
    if has_orders:
        return values[:, _ORDERS_START:]
    coefficients = order_coefficients(values[:, :_ORDERS_START])
    return np.concatenate([coefficients.real, -coefficients.imag], axis=1)


class _Steps:
    """The average after each revolution of a block; what is not asked for is not computed."""

    def __init__(
        self,
        before: _State,
        radial_mps2: FloatArray,
        orders_mps2: ComplexArray,
        omega_radps: Sequence[float],
        scalars: list[tuple[int, float, float, float, _Edges]],
        floor: float,
        measured: FloatArray | None,
    ) -> None:
        self._initial = before
        self._measured = measured
        self._omega = omega_radps
        self._scalars = scalars
        squares = np.square(np.array(omega_radps))[:, np.newaxis]
        self._carried = np.isfinite(orders_mps2.real)
        # Whether the revolutions before and those of the block have carried every order. Where all have, all values
        # have the same weights.
        self._had_all = bool((before.order_counts == before.count).all())
        self._has_all = bool(self._carried.all())
        self._is_even = self._had_all and self._has_all
        orders = orders_mps2 if self._has_all else np.where(self._carried, orders_mps2, 0.0)
        self._values = np.concatenate([radial_mps2, orders.real, -orders.imag], axis=1)
        self._values /= squares
        self._floor = floor
        self._states: dict[int, _State] = {}
        self._averages: dict[int, AngleAverage] = {}
        self.edges_rad = [edges.mean for *_, edges in scalars]
        self.counts = [count for count, *_ in scalars]
        self.effective_counts = [1.0 / weight_square for _, weight_square, *_ in scalars]

    @cached_property
    def _order_weights(self) -> tuple[FloatArray, FloatArray]:
        """Number of values of each order after each revolution, and the weights of the new ones, (k, 61) each."""
        counts = self._initial.order_counts + np.cumsum(self._carried, axis=0)
        weights = np.where(self._carried, np.maximum(1.0 / np.maximum(counts, 1.0), self._floor), 0.0)
        return counts, weights

    @cached_property
    def _weights(self) -> FloatArray:
        """Weights of the new values, (k, 1) where they are the same for all, else (k, n + 122)."""
        weights = np.array([[weight] for _, _, weight, *_ in self._scalars])
        if self._is_even:
            return weights
        _, order_weights = self._order_weights
        return np.concatenate(
            [np.repeat(weights, self._values.shape[1] - 2 * ORDER_COUNT, axis=1), order_weights, order_weights], axis=1
        )

    @cached_property
    def spectra(self) -> ComplexArray:
        """(k, 61) coefficients c - i s of the averaged waveform."""
        shares = running_shares(tuple(weight for _, _, weight, *_ in self._scalars))
        # Coefficients are those of the waveforms, as far as the sampling carries them.
        state = self._initial
        previous = _cosines_and_sines(state.moments.mean[np.newaxis], has_orders=self._had_all)
        block_values = _cosines_and_sines(self._values, has_orders=self._has_all)
        averaged = shares.prior[:, np.newaxis] * previous + shares.values @ block_values
        change = block_values - np.concatenate([previous, averaged[:-1]])
        if not self._has_all:
            change *= np.tile(self._carried, 2)
        squares = 0.5 * np.square(change).sum(axis=1)
        self._squares = (squares if self._measured is None else squares / self._measured[:, 0]).tolist()
        result: ComplexArray = averaged[:, :ORDER_COUNT] - 1j * averaged[:, ORDER_COUNT:]
        return result

    @cached_property
    def scatters(self) -> Sequence[float]:
        """Mean square deviation of the revolutions, of the orders that they carry."""
        moments = self._initial.moments
        if self._is_even:
            _ = self.spectra
            spread = 0.5 * float(moments.spread[_ORDERS_START:].sum())
            spreads = []
            for square, (_, _, weight, *_) in zip(self._squares, self._scalars, strict=True):
                spread = (1.0 - weight) * (spread + weight * square)
                spreads.append(spread)
        else:
            _, weights = self._order_weights
            steps = np.tile(weights, 2)
            scatter_weights = steps if self._measured is None else steps / self._measured
            mean, order_spreads = moments.mean[_ORDERS_START:].copy(), moments.spread[_ORDERS_START:]
            spreads = []
            for orders, weight, scatter in zip(self._values[:, _ORDERS_START:], steps, scatter_weights, strict=True):
                change = orders - mean
                mean += weight * change
                order_spreads = (1.0 - weight) * (order_spreads + scatter * np.square(change))
                spreads.append(0.5 * float(order_spreads.sum()))
        freedoms = [1.0 - weight_square for _, weight_square, *_ in self._scalars]
        return [
            spread / freedom if freedom > 1e-12 else math.nan for spread, freedom in zip(spreads, freedoms, strict=True)
        ]

    def edges_std_rad(self, index: int) -> tuple[float, float]:
        *_, edges = self._scalars[index]
        return edges.stds_rad()

    def at(self, index: int) -> AngleAverage:
        average = self._averages.get(index)
        if average is None:
            average = self._averages[index] = self.state(index).average()
        return average

    def state(self, index: int) -> _State:
        """Return the state after a revolution."""
        state = self._states.get(index)
        if state is None:
            state = self._states[index] = self._state(index)
        return state

    def _state(self, index: int) -> _State:
        # From the nearest state that is known.
        previous = max((known for known in self._states if known < index), default=-1)
        start = self._states[previous] if previous >= 0 else self._initial
        rows = slice(previous + 1, index + 1)
        counts = self._initial.order_counts + (index + 1) if self._is_even else self._order_weights[0][index]
        count, weight_square, _, noise, edges = self._scalars[index]
        values, weights = self._values[rows], self._weights[rows]
        return _State(
            moments=start.moments.and_then(values, weights)
            if self._measured is None
            else start.moments.and_then_partly(values, weights, self._measured[rows]),
            order_counts=counts,
            count=count,
            weight_square=weight_square,
            order_noise=noise,
            omega_radps=self._omega[index],
            edges=edges,
        )


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
        self._state = _State(_Moments.empty(self._n + 2 * ORDER_COUNT), np.zeros(ORDER_COUNT))
        self._latest: AngleAverage | None = None
        self._waveform: FloatArray | None = None
        self._steps: AverageSteps | None = None

    @property
    def steps(self) -> AverageSteps | None:
        """The steps of the last update, None before the first."""
        return self._steps

    @property
    def latest(self) -> AngleAverage | None:
        """The average after the last update, None before the first."""
        if self._latest is None and self._state.count:
            self._latest = self._state.average()
        return self._latest

    @property
    def scatter_mps2(self) -> FloatArray | None:
        """`AngleAverage.scatter_mps2` of the latest average alone, (n,); None before the first update."""
        return self._state.scatter_mps2 if self._state.count else None

    @property
    def waveform_mps2(self) -> FloatArray | None:
        """`AngleAverage.radial_mps2` of the latest average alone, (n,); None before the first update."""
        if self._waveform is None and self._state.count:
            self._waveform = self._state.waveform_mps2
        return self._waveform

    def update_block(
        self,
        radial_mps2: FloatArray,
        orders_mps2: ComplexArray,
        omega_radps: Sequence[float],
        *,
        edges_rad: Sequence[tuple[float, float]],
        edges_std_rad: Sequence[tuple[float, float]],
        noise_mps2: Sequence[float],
        measured: Sequence[float] | None = None,
    ) -> AverageSteps:
        """Add k revolutions.

        Args:
            radial_mps2: (k, n) normalised radial waveforms.
            orders_mps2: (k, 61) their coefficients; orders that are NaN keep their average.
            omega_radps: mean angular speeds.
            edges_rad: leading and trailing edge of each; NaN edges do not change the mean edges.
            edges_std_rad: standard errors of the two, including the uncertainty of the edge's definition.
            noise_mps2: noise of one angle-domain sample, used for standard errors until the scatter is known.
            measured: share of each that was measured, the rest being filled without scatter; None where all was.

        Returns:
            The average after each of them, at its speed.

        Raises:
            ValueError: no revolution, or a waveform has the wrong size or is not finite, or a speed is not positive;
                the average is unchanged.
        """
        if not len(radial_mps2) or radial_mps2.shape[1:] != (self._n,) or not np.isfinite(radial_mps2).all():
            raise ValueError(f"the average takes {self._n} finite samples per revolution")
        for omega in omega_radps:
            if not (math.isfinite(omega) and omega > 0.0):
                raise ValueError(f"the average needs a positive angular speed, not {omega}")
        state, floor = self._state, self._floor
        count, weight_square, order_noise, edges = state.count, state.weight_square, state.order_noise, state.edges
        scalars = []
        shares = (1.0,) * len(omega_radps) if measured is None else measured
        for omega, edge_pair, stds, sample_noise, share in zip(
            omega_radps, edges_rad, edges_std_rad, noise_mps2, shares, strict=True
        ):
            count += 1
            weight = max(1.0 / count, floor)
            weight_square = (1.0 - weight) ** 2 * weight_square + weight * weight / share
            noise = sample_noise * math.sqrt(2.0 / self._n) / (omega * omega) if math.isfinite(sample_noise) else 0.0
            order_noise += weight * (noise * noise - order_noise)
            if math.isfinite(edge_pair[0] + edge_pair[1] + stds[0] + stds[1]):
                edges = edges.and_then(edge_pair, stds, floor)
            scalars.append((count, weight_square, weight, order_noise, edges))
        column = None if measured is None else np.array(measured)[:, np.newaxis]
        steps = _Steps(state, radial_mps2, orders_mps2, omega_radps, scalars, floor, column)
        self._state, self._steps = steps.state(len(scalars) - 1), steps
        self._latest = self._waveform = None
        return steps
