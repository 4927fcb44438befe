"""Weak-form estimator: the four numbers from the shape of the belt, geometrically exact, for any contact pressure.

It assumes neither a contact pressure nor a linear ring. Load, pressure and belt radius set the scale; the contact edges
only mark the beginning of the free belt. docs/explanation/estimators.md has the derivation and the errors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.estimates.estimator import Estimate
from gateway.core.estimates.pace import LONGEST, SHARE_OF_STD, differ, is_due
from gateway.core.estimates.revolution_block import BlockEstimator, ConditionArrays, RevolutionBlock
from gateway.core.reasons import CoreCode, Reason
from gateway.core.revolutions.order_spectrum import ORDER_COUNT
from gateway.core.revolutions.sensor_mounting import HUB_ORDER
from gateway.core.types import BoolArray, ComplexArray, FloatArray
from gateway.ring.belt_shape import (
    MAX_ORDER,
    curvature_orders,
    gravity_orders,
    orders_about,
)
from gateway.ring.determination import FittedSeries, all_invalid, doubt_about, load_number, series_estimates, unusable
from gateway.ring.order_errors import QUARTER_TURN, by_band, relative_std, wave_std
from gateway.ring.reasons import RingCode
from gateway.ring.sidewall_damping import SidewallDamping, sidewall_damping
from gateway.ring.weak_form_rows import ROWS, motion_begin
from gateway.ring.weak_form_solve import FREEDOM, WeakFormSolution, solve_balance

# The solution of the first revolution is the start of the next, so it need not converge on the noise.
_COLD_PASSES: Final = 2
# Curvature in the middle of the contact over the mean: below 0 on a drum, 0 on a road, near 1 at very low load.
_MAX_CONTACT_CURVATURE: Final = 0.9

# Relative change of the numbers by a belt that inflation strains by 1.2e-3 (docs/explanation/estimators.md). The strain
# of a belt is not known, so this is one standard error.
EXTENSION_ERRORS: Final[FloatArray] = np.array([-0.0015, -0.0025, 0.0045, -0.04])

# Standard error of the correction for damping as a share of it: what the linear ring leaves of the effect, and what it
# mistakes a shifted contact pressure for.
_DAMPING_ERROR: Final = 0.5
# Step of the derivative by the sensor's offset, over the belt radius.
_OFFSET_STEP: Final = 1e-3
_OFFSET_STEPS: Final[FloatArray] = np.array([[0.0], [-_OFFSET_STEP], [_OFFSET_STEP], [0.0]])

# Largest error of following the average by the response, in standard errors: a term of second order, (change / value)^2
# of the value. A change of one standard error renews the solution in any case.
_FOLLOWING_STDS: Final = 0.05
# A pass that changes a number by more standard errors is followed by another.
_CONVERGED_STDS: Final = 0.2
_FURTHER_PASSES: Final = 2
# Relative change of the scatter's variance from which the solution is renewed. Until then it scales the errors by noise
# and is taken to leave the weights of the orders among each other.
_SCATTER_CHANGE: Final = 0.5
# Relative changes of scatter and speed from which the solution is renewed.
_SCATTER: Final = 2
_STATE_SHARES: Final[FloatArray] = np.array([_SCATTER_CHANGE, SHARE_OF_STD])
_ORDERS: Final[FloatArray] = np.arange(ORDER_COUNT, dtype=np.float64)


@dataclass(frozen=True, slots=True)
class _Renewed:
    """The solution at the latest renewal, and what it rests on.

    Attributes:
        values: (4,) numbers at load number 1.
        fits: with their covariances.
        response: (4, ORDER_COUNT) derivative of the numbers by the orders of the relative signal.
        by_offset: (4,) derivative by the sensor's offset over the belt radius.
        by_sensor: (5, 16) covariance that a unit of each error of the sensor adds, as in `sensor_errors`.
        signal: (ORDER_COUNT,) orders of the relative signal.
        count: revolutions averaged.
        effective_count: of the average.
        offset_m: sensor's offset below the neutral layer.
        state: (4,) what else the solution rests on, as in `_Series.states`.
        allowed: (4,) by how much each of these may change.
        std: (4,) standard errors of the numbers at load number 1.
    """

    values: FloatArray
    fits: WaveformFits
    response: FloatArray
    by_offset: FloatArray
    by_sensor: FloatArray
    signal: FloatArray
    count: int
    effective_count: float
    offset_m: float
    state: FloatArray
    allowed: FloatArray
    std: FloatArray

    def followed(self, orders: FloatArray, conditions: ConditionArrays) -> FloatArray:
        """Return the numbers at load number 1 of k slightly different averages, to first order, (k, 4)."""
        result: FloatArray = self.values + (orders - self.signal) @ self.response.T
        result += np.multiply.outer((conditions.sensor_offset_m - self.offset_m) / conditions.radius_m, self.by_offset)
        return result

    def noise(self, scatters: FloatArray, effective_counts: FloatArray) -> FloatArray:
        """Return the variance of the noise of k averages over that at the renewal, (k,)."""
        renewal_scatter = float(self.state[_SCATTER])
        result: FloatArray = self.effective_count / effective_counts
        return result * (scatters / renewal_scatter) if renewal_scatter > 0.0 else result

    def model(self, sensor: FloatArray) -> FloatArray:
        """Return the covariance from model error and errors of the sensor (k, 5) at load number 1, (k, 4, 4)."""
        by_sensor = (np.square(sensor) @ self.by_sensor).reshape(-1, 4, 4)
        by_sensor += self.fits.model[0]
        return by_sensor

    def are_outdated(self, values: FloatArray, states: FloatArray, counts: Sequence[int]) -> BoolArray:
        """Return for each of k revolutions whether to renew, (k,).

        Args:
            values: (k, 4) numbers that followed the average; renewed where too far from the solution to follow further.
            states: (k, 4) what the solution rests on, as in `_Series.states`.
            counts: revolutions averaged.
        """
        limits = np.minimum(self.std, _FOLLOWING_STDS * np.abs(self.values)) * self.std
        has_changed = ~(np.square(values - self.values) <= limits)
        stale = [count != self.count and (is_due(count) or not 0 < count - self.count <= LONGEST) for count in counts]
        outdated: BoolArray = has_changed.any(axis=1) | differ(states, self.state, self.allowed) | stale
        return outdated


class _Series:
    """The revolutions of a block as the estimator sees them.

    Attributes:
        orders: (k, ORDER_COUNT) even orders of the relative signal about the contact centre.
        states: (k, 4) what solutions rest on besides: both edges, scatter and speed.
        sensor: (k, 5) errors of the sensor, in the units of `sensor_errors`.
        effective_counts: (k,) of the average.
        load_numbers: (k,) Q / (p0 R^2), 1 where it is not known.
        conditions: of each revolution.
    """

    def __init__(self, block: RevolutionBlock) -> None:
        averages, arrays = block.averages, block.condition_arrays
        edges = np.array(averages.edges_rad)
        self.states: FloatArray = np.array([*edges.T, averages.scatters, block.arrays.omega_radps]).T
        offset_std, hub = arrays.sensor_offset_std_m / arrays.radius_m, arrays.hub_mps2
        self.sensor: FloatArray = np.array([offset_std, arrays.steady_std_mps2, arrays.gain_std, hub, hub]).T
        self.orders = relative_orders(averages.spectra, edges)
        self.effective_counts: FloatArray = np.array(averages.effective_counts)
        self.load_numbers: FloatArray = np.array([load_number(conditions) for conditions in block.conditions])
        self.conditions = arrays


def relative_orders(spectra: ComplexArray, edges_rad: FloatArray) -> FloatArray:
    """Return the even orders of averages about their contact centres, over their means, (k, ORDER_COUNT).

    Args:
        spectra: (k, ORDER_COUNT) orders c - i s of the averages.
        edges_rad: (k, 2) contact edges.
    """
    angle = np.multiply.outer(0.5 * (edges_rad[:, 0] + edges_rad[:, 1]), _ORDERS)
    orders = spectra.real * np.cos(angle) - spectra.imag * np.sin(angle)
    with np.errstate(divide="ignore", invalid="ignore"):
        result: FloatArray = orders / orders[:, :1]
    return result


class WeakFormEstimator(BlockEstimator):
    """Bs, Cw, Rs, Ts and their ratios to Cw from the running average.

    The solution is renewed at the pace of `gateway.core.estimates.pace`; between renewals the numbers follow the
    average by the solution's own response to its orders.

    Gives Bs, Cw, Rs, Ts, then Bs/Cw, Rs/Cw, Ts/Cw.

    Without load or pressure the four are invalid, but not the ratios, for all four are proportional to
    Q / (p0 R^2). Provisional until the average has settled, on a revolution with faults, and where the data do not
    determine a number, model error included.
    """

    name = "weak-form"

    def reset(self) -> None:
        """Forget the warm start."""
        self._warm: WeakFormSolution | None = None
        self._renewed: _Renewed | None = None

    def update_block(self, block: RevolutionBlock) -> list[tuple[Estimate, ...]]:
        """Return the estimates of every revolution."""
        series, fitted = _Series(block), FittedSeries.empty(len(block))
        refusals: dict[int, Reason] = {}
        first, is_new = 0, False
        while first < len(block):
            first = self._follow(block, series, fitted, first, is_new=is_new)
            is_new = False
            if first < len(block):
                renewed = self._renew(block, series, first)
                if isinstance(renewed, Reason):
                    self._warm = self._renewed = None
                    refusals[first] = renewed
                    first += 1
                else:
                    self._renewed, is_new = renewed, True
        is_linear = block.conditions[0].tire.is_linear_ring
        counts = block.averages.effective_counts
        doubts = [doubt_about(*pair, is_linear_ring=is_linear) for pair in zip(block.revolutions, counts, strict=True)]
        estimates = series_estimates(self.name, fitted, block.conditions, doubts, noise_scatters=True)
        for index, reason in refusals.items():
            estimates[index] = all_invalid(reason)
        return estimates

    def _follow(
        self, block: RevolutionBlock, series: _Series, fitted: FittedSeries, first: int, *, is_new: bool
    ) -> int:
        """Set the numbers of the revolutions from `first` on up to the next that needs a renewal; return that one.

        With `is_new` the solution is that of the first.
        """
        renewed, remaining = self._renewed, slice(first, None)
        if renewed is None:
            return first
        values = renewed.followed(series.orders[remaining], series.conditions.rows(remaining))
        outdated = renewed.are_outdated(values, series.states[remaining], block.averages.counts[remaining])
        if is_new:
            outdated[0] = False
        count = int(outdated.argmax()) if outdated.any() else len(values)
        followed = slice(first, first + count)
        loads = series.load_numbers[followed]
        fitted.values[followed] = values[:count] * loads[:, np.newaxis]
        fitted.free[followed] = renewed.fits.free[0]
        squares = np.square(loads)[:, np.newaxis, np.newaxis]
        noise = renewed.noise(series.states[followed, _SCATTER], series.effective_counts[followed])
        fitted.noise[followed] = renewed.fits.noise[0] * (noise[:, np.newaxis, np.newaxis] * squares)
        fitted.model[followed] = renewed.model(series.sensor[followed]) * squares
        return first + count

    def _renew(self, block: RevolutionBlock, series: _Series, index: int) -> _Renewed | Reason:
        """Solve the balance of the average after a revolution, or return why it cannot be."""
        average, conditions = block.averages.at(index), block.conditions[index]
        current_orders, state = series.orders[index], series.states[index]
        reason = unusable(average, conditions)
        if reason:
            return reason
        edges = average.leading_edge_rad, average.trailing_edge_rad
        edges_std = np.array([average.leading_edge_std_rad, average.trailing_edge_std_rad])
        half_angle, centre = 0.5 * (edges[1] - edges[0]), 0.5 * (edges[1] + edges[0])
        highest_order = int(np.flatnonzero(np.isfinite(average.orders_mps2))[-1])
        max_order = MAX_ORDER if highest_order >= ORDER_COUNT - 1 else highest_order
        offset = conditions.sensor_offset_m / conditions.radius_m
        signal = orders_about(average.radial_mps2, centre, max_order)
        mean = float(signal[0].real)
        warm = self._warm
        damping = sidewall_damping(signal, warm.unknowns[0, :4], max_order) if warm is not None else None
        rows = np.stack([*[signal.real] * 3, _undamped(signal, damping)])
        sides = curvature_orders(rows, offset + _OFFSET_STEPS)
        raw_orders, orders = sides[:1], sides[3:]
        by_offset_step = (sides[2] - sides[1])[:ORDER_COUNT] / (2.0 * _OFFSET_STEP)
        if not np.isfinite(raw_orders).all():
            return Reason(CoreCode.NO_STEADY_VALUE)
        if (curvature := float(raw_orders[0].sum())) > _MAX_CONTACT_CURVATURE:
            return Reason(RingCode.NO_FLAT_CONTACT, curvature=curvature, limit=_MAX_CONTACT_CURVATURE)
        noise_std = relative_std(average.orders_std_mps2, mean, raw_orders[0], max_order)
        waves = wave_std(signal, noise_std, max_order)
        std = np.hypot(noise_std, waves)[np.newaxis]
        begin = motion_begin(half_angle)
        try:
            if warm is None:
                warm = solve_balance(raw_orders, begin, std, None, _COLD_PASSES)
                damping = sidewall_damping(signal, warm.unknowns[0, :4], max_order)
                orders = curvature_orders(_undamped(signal, damping)[np.newaxis], offset)
            solution = solve_balance(orders, begin, std, warm, 1)
            if self._renewed is not None:
                limit = _CONVERGED_STDS * self._renewed.std
                condition_rows = series.conditions.rows(slice(index, index + 1))
                followed = self._renewed.followed(current_orders[np.newaxis], condition_rows)[0]
                for _ in range(_FURTHER_PASSES):
                    numbers = solution.unknowns[0, :4]
                    if (np.abs(numbers - followed) <= limit).all():
                        break
                    followed, solution = numbers, solve_balance(orders, begin, std, solution, 1)
        except np.linalg.LinAlgError:
            return Reason(RingCode.NO_BELT_SHAPE)
        if not (np.isfinite(solution.unknowns).all() and np.isfinite(solution.correction).all()):
            return Reason(RingCode.NO_BELT_SHAPE)
        self._warm = solution
        systematic = [np.diag(waves)] if damping is None else [np.diag(waves), _damping_errors(damping, mean)]
        fits = fits_of(solution, noise_std[np.newaxis], np.concatenate(systematic))
        by_sensor = sensor_errors(mean, raw_orders, by_offset_step) @ solution.response[0, :4].T
        response = solution.response[0, :4] * fits.free[0][:, np.newaxis]
        response[:, max_order + 1 :] = 0.0
        renewed = _Renewed(
            values=fits.values[0],
            fits=fits,
            response=response,
            by_offset=response[:, 2:] @ by_offset_step[2:],
            by_sensor=(by_sensor[:, :, np.newaxis] * by_sensor[:, np.newaxis]).reshape(-1, 16),
            signal=current_orders,
            count=average.count,
            effective_count=average.effective_count,
            offset_m=conditions.sensor_offset_m,
            state=state,
            allowed=np.concatenate([SHARE_OF_STD * edges_std, _STATE_SHARES * state[2:]]),
            std=np.zeros(4),
        )
        model = renewed.model(series.sensor[index : index + 1])[0]
        return replace(renewed, std=np.sqrt(np.diagonal(fits.noise[0] + model)))


def _undamped(signal: ComplexArray, damping: SidewallDamping | None) -> FloatArray:
    """Return the even orders of a signal without the effect of its damping, where that is known."""
    even: FloatArray = signal.real
    return even if damping is None else even + damping.correction


def _damping_errors(damping: SidewallDamping, mean: float) -> FloatArray:
    """Return changes of the relative signal's orders by one standard error of either damping, (2, ORDER_COUNT)."""
    changes: FloatArray = np.stack([_DAMPING_ERROR * damping.change, damping.by_bending])[:, :ORDER_COUNT] / mean
    changes[:, :2] = 0.0  # order 0 is 1 and order 1 is the closure's
    return changes


def sensor_errors(mean: float, plain: FloatArray, by_offset: FloatArray) -> FloatArray:
    """Return changes of the relative signal's orders by one unit of each error of the sensor, (5, ORDER_COUNT).

    They are those of the sensor's offset over the belt radius, of the steady value in m/s^2, of the gain, with which
    gravity is subtracted, and of the hub's motion in m/s^2, twice: as an acceleration, and as a rotation that is uneven
    by as much.

    Args:
        mean: of the signal.
        plain: (1, MAX_ORDER + 1) curvature orders without the correction for damping.
        by_offset: (ORDER_COUNT,) their derivative by the sensor's offset over the belt radius.
    """
    changes = np.zeros((5, ORDER_COUNT))
    changes[0] = by_offset
    changes[2] = gravity_orders(plain)[0, :ORDER_COUNT] * (STANDARD_GRAVITY_MPS2 / mean)
    changes[4] = uneven_rotation(plain[0, :ORDER_COUNT]) / mean
    changes[:, :2] = 0.0  # order 0 is 1 and order 1 is the closure's
    # Column 0 of the response is that to a relative error of the steady value.
    changes[1, 0] = changes[3, HUB_ORDER] = 1.0 / mean
    return changes


def uneven_rotation(orders: FloatArray) -> FloatArray:
    """Return the change of even orders by an uneven rotation, with the mean as order 2 of the circumferential axis.

    Omega (1 + eps cos(2 theta)) reads 2 eps R Omega^2 along the belt and shifts the angles by eps / 2 sin(2 theta). In
    the phase that keeps the signal even, its slope times this shift is -eps / 4 sum n c_n (cos(n-2) - cos(n+2)).

    Args:
        orders: (m,) cosine orders of the signal over its mean.
    """
    slopes = 0.125 * _ORDERS[: len(orders)] * orders
    change = np.zeros(len(orders))
    change[:-2] -= slopes[2:]
    change[2:] += slopes[:-2]
    change[1] -= slopes[1]
    return change


@dataclass(frozen=True, slots=True)
class WaveformFits:
    """The four numbers of b waveforms at load number Q / (p0 R^2) = 1; all are proportional to it.

    Attributes:
        values: (b, 4) Bs, Cw, Rs, Ts.
        free: (b, 4) False where a number is held at 0.
        noise: (b, 4, 4) covariance from the errors of the orders.
        model: (b, 4, 4) covariance from model error.
        misfit: (b,) chi-square of the balance over its degrees of freedom.
    """

    values: FloatArray
    free: BoolArray
    noise: FloatArray
    model: FloatArray
    misfit: FloatArray


def fits_of(solution: WeakFormSolution, order_std: FloatArray, systematic: FloatArray | None = None) -> WaveformFits:
    """Return the numbers of a solution with their covariances.

    Noise: standard errors of the orders, propagated by the response of the numbers. Model error: the least correction
    of the orders that lets the balance hold, with random phase in each band, propagated by the same response, minus the
    part that noise alone explains. A band keeps its envelope, so that waves near the contact stay there, where bending
    is sensitive to them. The extension of the belt, which the balance neglects, is added.

    Args:
        solution: of b waveforms.
        order_std: (b or 1, ORDER_COUNT) standard errors of the relative signal's orders.
        systematic: (k, ORDER_COUNT) changes of the orders by one standard error of k independent causes.
    """
    response = solution.response[:, :4]
    weighted = response * order_std[:, np.newaxis, :]
    noise = weighted @ weighted.transpose(0, 2, 1)
    # The fit has removed UNKNOWNS degrees of freedom from the residual.
    excess = np.maximum(1.0 - 1.0 / np.maximum(solution.misfit, 1.0), 0.0) * (ROWS + 1) / FREEDOM
    waves = by_band(solution.correction)
    shifts = np.concatenate([waves, waves @ QUARTER_TURN], axis=1) @ response.transpose(0, 2, 1)
    model = 0.5 * excess[:, np.newaxis, np.newaxis] * (shifts.transpose(0, 2, 1) @ shifts)
    extension = solution.unknowns[:, :4] * EXTENSION_ERRORS
    model += extension[:, :, np.newaxis] * extension[:, np.newaxis, :]
    if systematic is not None:
        by_cause = systematic @ response.transpose(0, 2, 1)
        model += by_cause.transpose(0, 2, 1) @ by_cause
    return WaveformFits(
        values=solution.unknowns[:, :4],
        free=solution.free[:, :4],
        noise=noise if noise.shape == model.shape else np.broadcast_to(noise, model.shape),
        model=model,
        misfit=solution.misfit,
    )
