"""Fit of the forward model to an averaged waveform: Gauss-Newton with priors, weighted by noise and model error.

Orders are weighted with the inverse variance of noise plus model error. Model error is the residual's power beyond
noise in bands of orders, estimated during the fit: where the model cannot follow the waveform, the weights are flat;
where it can, they are those of the noise.
"""

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from gateway.core.types import BoolArray, ComplexArray, FloatArray
from gateway.ring.forward_model import PRIOR_MEAN, PRIOR_STD, SIZE, ForwardModel, ForwardSolution, P, stacked
from gateway.ring.reference_tire import TABLE_3_LOAD_NUMBER
from gateway.ring.rolling_ring import RingNotConvergedError

# Largest change of a parameter in one step, in these units.
_REACH: Final[FloatArray] = np.minimum(np.where(np.arange(SIZE) < P.DAMPING, 0.5, 0.5 * PRIOR_STD), 2.0)

# Bands of orders [first, next) of equal model error.
ERROR_BANDS: Final = (0, 2, 5, 8, 12, 17, 23, 30, 38, 47, 57, 68, 80, 94, 110, 128)
MAX_ORDER: Final = 110
# Order 1 of the signal belongs to gravity and the hub.
_UNUSED_ORDER: Final = 1
# Least standard error of an order, as a share of the mean: resampling, rounding and the remaining error of the grid.
_MIN_STD: Final = 1e-5
# Model error assumed at first, as a share of the mean.
_FIRST_ERROR: Final = 0.02
# Degrees of freedom that the model error over all bands counts for in that of one band.
_POOLED_FREEDOM: Final = 2.0

# Gauss-Newton step at which the orders of the packets are searched: the ring has settled by then.
_WAVES_FROM: Final = 3
# Amplitude over its standard error from which the order and decay of a packet are fitted.
_DISTINCT: Final = 3.0
# Least curvature of a drum times the belt radius: drums have at most ten times the tire's radius.
_MIN_CURVATURE: Final = 0.1
# Standard errors within which a curvature is taken for that of a flat road.
_FLAT: Final = 2.0
# Model error of the mean, which only the gain follows.
_MEAN_ERROR: Final = 1e-4
# Parameters that decide convergence: order and decay of a packet in the noise never settle.
_DECISIVE: Final[BoolArray] = np.array(
    [parameter not in (P.BEFORE_ORDER, P.BEFORE_DECAY, P.AFTER_ORDER, P.AFTER_DECAY) for parameter in P]
)

_MAX_STEPS: Final = 40
# Largest step over the parameters' standard errors that counts as converged.
_CONVERGED: Final = 0.1
_HALVINGS: Final = 4

_SEARCH_ORDERS: Final = range(15, 90)
# Amplitude, as a share of R omega^2, below which a packet's order is searched again.
_FAINT: Final = 0.01


@dataclass(frozen=True, slots=True)
class ForwardFit:
    """Result of a fit.

    Attributes:
        solution: the fitted model.
        model_orders: (m,) its orders, extrapolated to zero grid step.
        residual: (m,) complex, data minus model, shares of the data's mean.
        noise: (SIZE, SIZE) covariance of the parameters from the noise of the orders.
        model: (SIZE, SIZE) covariance from model error (the residual by bands, with random signs), from priors, and
            from the errors of the sensor's offset and of the steady value.
        half_angle_rad: half of the contact angle, extrapolated to zero grid step.
        half_angle_gradient: (SIZE,) derivative of the contact's half angle by the parameters.
        converged: False when the fit ran out of steps.
    """

    solution: ForwardSolution
    model_orders: ComplexArray
    residual: ComplexArray
    noise: FloatArray
    model: FloatArray
    half_angle_rad: float
    half_angle_gradient: FloatArray
    converged: bool

    @property
    def parameters(self) -> FloatArray:
        """The fitted vector."""
        return self.solution.parameters

    def numbers(self, load_number: float) -> FloatArray:
        """Return Bs, Cw, Rs, Ts at a load number Q / (p0 R^2), (4,)."""
        numbers = self.solution.ring.numbers
        result: FloatArray = np.array(numbers) * (load_number / TABLE_3_LOAD_NUMBER)
        return result

    @property
    def residual_share(self) -> float:
        """Rms of the residual from order 2 on, as a share of the signal's."""
        unexplained, total = (float(np.sum(np.abs(orders[2:]) ** 2)) for orders in (self.residual, self.data))
        return math.sqrt(unexplained / total)

    @property
    def data(self) -> ComplexArray:
        """The orders that were fitted."""
        return self.model_orders + self.residual

    def half_angle_std_rad(self) -> float:
        """Return the standard error of the contact's half angle."""
        return math.sqrt(float(self.half_angle_gradient @ (self.noise + self.model) @ self.half_angle_gradient))


def fit_forward(
    orders: ComplexArray,
    order_std: FloatArray,
    half_angle_rad: float,
    model: ForwardModel,
    *,
    start: FloatArray | None = None,
    use_mean: bool = True,
) -> ForwardFit | None:
    """Fit the model to the orders of an averaged waveform.

    Args:
        orders: (m,) coefficients c - i s over R omega^2, orders 0 to model.max_order.
        order_std: (m,) standard error of one real coefficient, positive.
        half_angle_rad: of the contact as seen in the waveform, for a cold start.
        model: what is not fitted; its grid is refined where the bending layer is thinner than it resolves.
        start: (SIZE,) parameters of a fit of nearly the same waveform; None starts from Table 3's tire.
        use_mean: False where the sensor does not pass the steady value.

    Returns:
        The fit; None when no ring in equilibrium was found near the data.
    """
    if start is not None:
        return _fit(orders, order_std, half_angle_rad, model.resolving(start), start, use_mean)
    coarse = _fit(orders, order_std, half_angle_rad, model, None, use_mean)
    if coarse is None:
        return None
    finer = model.resolving(coarse.parameters)
    if finer.nodes == model.nodes:
        return coarse
    return _fit(orders, order_std, half_angle_rad, finer, coarse.parameters, use_mean) or coarse


def _fit(
    orders: ComplexArray,
    order_std: FloatArray,
    half_angle_rad: float,
    model: ForwardModel,
    start: FloatArray | None,
    use_mean: bool,
) -> ForwardFit | None:
    """Fit on the model's grid."""
    variance = np.square(np.maximum(order_std, _MIN_STD))
    variance[0] *= 0.5
    used = np.ones(len(orders), dtype=np.bool_)
    used[_UNUSED_ORDER] = False
    used[0] = use_mean
    try:
        solution = model.solve(cold_start(model, half_angle_rad) if start is None else start.copy())
        if start is None:
            solution = place_centre(model, solution, orders)
        end = _converge(model, solution, orders, variance, used, cold=start is None)
        solution = end.solution
        fine, half_angle = model.refined(solution)
        derivatives, half_angle_gradient = model.derivatives(solution)
        systematic = model.systematic_changes(solution)
    except (RingNotConvergedError, ValueError, np.linalg.LinAlgError):
        return None
    rows = np.where(end.free[:, np.newaxis], derivatives, 0.0)
    residual = np.where(used, orders - fine, 0.0)
    by_noise, by_model = _covariances(rows, residual, variance, end.error, used, solution.parameters, systematic)
    return ForwardFit(
        solution=solution,
        model_orders=fine,
        residual=residual,
        noise=by_noise,
        model=by_model,
        half_angle_rad=half_angle,
        half_angle_gradient=np.where(end.free, half_angle_gradient, 0.0),
        converged=end.converged,
    )


class _End(NamedTuple):
    """State in which the Gauss-Newton iteration ended.

    Attributes:
        solution: the model.
        free: (SIZE,) parameters that were fitted.
        error: (m,) variance of model error.
        converged: whether the last step was smaller than the standard errors.
    """

    solution: ForwardSolution
    free: BoolArray
    error: FloatArray
    converged: bool


def _converge(
    model: ForwardModel,
    solution: ForwardSolution,
    orders: ComplexArray,
    variance: FloatArray,
    used: BoolArray,
    *,
    cold: bool,
) -> _End:
    """Iterate from `solution`; model error and the order of the edge waves are updated on the way."""
    free = np.ones(SIZE, dtype=np.bool_)
    free[P.SHEAR] = model.shear
    correction = model.refined(solution)[0] - solution.orders
    error = np.full(len(orders), _FIRST_ERROR**2)
    size = math.inf
    for step in range(1, _MAX_STEPS + 1):
        if step == (_WAVES_FROM if cold else 1):
            remainder = orders - solution.orders - correction
            solution = begin_waves(model, solution, remainder, variance + error, used, all_sides=cold)
        residual = orders - solution.orders - correction
        rows = np.where(free[:, np.newaxis], model.derivatives(solution)[0], 0.0)
        normal, _ = _normal(rows, residual, variance + error, used, solution.parameters)
        error = _model_error(residual, variance, _leverage(rows, normal, variance + error, used), used)
        normal, gradient = _normal(rows, residual, variance + error, used, solution.parameters)
        posterior = np.linalg.inv(normal)
        std = np.sqrt(np.diagonal(posterior))
        change = _limited(np.where(free, posterior @ gradient, 0.0))
        size = float(np.max(np.abs(change) / std, where=_DECISIVE, initial=0.0))
        stepped = _move(model, solution, change, orders - correction, variance + error, used)
        if stepped is None:
            break
        solution = stepped
        free = _distinct(solution.parameters, std, free)
        if size < 1.0 and free[P.ROAD_CURVATURE] and _is_flat(solution.parameters, std):
            free[P.ROAD_CURVATURE] = False
            flat = solution.parameters.copy()
            flat[P.ROAD_CURVATURE] = 0.0
            solution = model.solve(flat, solution.ring)
        elif size < _CONVERGED and (not cold or step > _WAVES_FROM):
            break
        if size < 1.0:
            correction = model.refined(solution)[0] - solution.orders
    return _End(solution, free, error, size < 1.0)


def _covariances(
    rows: ComplexArray,
    residual: ComplexArray,
    variance: FloatArray,
    error: FloatArray,
    used: BoolArray,
    parameters: FloatArray,
    systematic: ComplexArray,
) -> tuple[FloatArray, FloatArray]:
    """Return the covariance of the parameters from noise, and from all else, by a linearised refit.

    All else is model error, priors, and the changes `systematic` of the orders, (k, m), one standard error each.
    """
    normal, _ = _normal(rows, residual, variance + error, used, parameters)
    posterior = np.linalg.inv(normal)
    weight = np.where(used, 1.0 / (variance + error), 0.0)
    response = posterior @ stacked(rows)
    by_noise = response * np.tile(weight * np.sqrt(variance), 2)
    by_model = response * np.tile(weight * np.sqrt(error), 2)
    by_prior = posterior / PRIOR_STD
    by_cause = response @ (stacked(systematic) * np.tile(weight, 2)).T
    return by_noise @ by_noise.T, by_model @ by_model.T + by_prior @ by_prior.T + by_cause @ by_cause.T


def _limited(change: FloatArray) -> FloatArray:
    """Limit a step to _REACH: the ring's parameters by a common factor, the packets' one by one."""
    ring = change[: P.BEFORE_COSINE] / _REACH[: P.BEFORE_COSINE]
    limited = np.clip(change, -_REACH, _REACH)
    limited[: P.BEFORE_COSINE] = change[: P.BEFORE_COSINE] / max(1.0, float(np.abs(ring).max()))
    return limited


def _distinct(parameters: FloatArray, std: FloatArray, free: BoolArray) -> BoolArray:
    """Hold order and decay of packets within the noise."""
    result = free.copy()
    for first in (P.BEFORE_COSINE, P.AFTER_COSINE):
        amplitude = math.hypot(parameters[first], parameters[first + 1])
        result[first + 2 : first + 4] = amplitude > _DISTINCT * max(std[first], std[first + 1])
    return result


def _is_flat(parameters: FloatArray, std: FloatArray) -> bool:
    """Return whether the road is flat: a drum would show and does not."""
    curvature, error = abs(float(parameters[P.ROAD_CURVATURE])), float(std[P.ROAD_CURVATURE])
    return error < _MIN_CURVATURE and curvature < max(0.5 * _MIN_CURVATURE, _FLAT * error)


def _move(
    model: ForwardModel,
    solution: ForwardSolution,
    change: FloatArray,
    data: ComplexArray,
    variance: FloatArray,
    used: BoolArray,
) -> ForwardSolution | None:
    """Take the step, or a part of it that improves the fit; None when no part does."""
    initial_cost = _cost(solution, data, variance, used)
    for _ in range(_HALVINGS + 1):
        try:
            stepped = model.solve(solution.parameters + change, solution.ring)
        except (RingNotConvergedError, ValueError):
            change = 0.25 * change
            continue
        if _cost(stepped, data, variance, used) <= initial_cost * (1.0 + 1e-9):
            return stepped
        change = 0.4 * change
    return None


def _cost(solution: ForwardSolution, data: ComplexArray, variance: FloatArray, used: BoolArray) -> float:
    misfit = np.abs(data - solution.orders)[used] ** 2 / variance[used]
    return float(misfit.sum() + np.sum(np.square((solution.parameters - PRIOR_MEAN) / PRIOR_STD)))


def _normal(
    rows: ComplexArray, residual: ComplexArray, variance: FloatArray, used: BoolArray, parameters: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the normal matrix and the gradient, priors included."""
    weight = np.where(used, 1.0 / np.sqrt(variance), 0.0)
    jacobian = stacked(rows * weight)
    normal = jacobian @ jacobian.T + np.diag(PRIOR_STD**-2.0)
    gradient = jacobian @ stacked(residual * weight) - (parameters - PRIOR_MEAN) / PRIOR_STD**2
    return normal, gradient


def _leverage(rows: ComplexArray, normal: FloatArray, variance: FloatArray, used: BoolArray) -> FloatArray:
    """Return the share of each order's own two coefficients in their fit, (m,), 0 to 2."""
    weight = np.where(used, 1.0 / np.sqrt(variance), 0.0)
    size = len(variance)
    jacobian = stacked(rows * weight)
    diagonal = np.sum(jacobian * np.linalg.solve(normal, jacobian), axis=0)
    result: FloatArray = diagonal[:size] + diagonal[size:]
    return result


def _model_error(residual: ComplexArray, variance: FloatArray, leverage: FloatArray, used: BoolArray) -> FloatArray:
    """Return the variance of model error of one coefficient of each order, (m,).

    It is the residual's power beyond noise over the degrees of freedom that the fit leaves in the band. A band that
    the fit can follow in any case says little about its model error, so the mean over all bands is added.
    """
    shaped = used.copy()
    shaped[0] = False
    power = np.where(shaped, np.abs(residual) ** 2, 0.0)
    freedom = np.where(shaped, np.maximum(2.0 - leverage, 0.0), 0.0)
    starts = [start for start in ERROR_BANDS if start < len(variance)]
    banded = np.add.reduceat(np.stack([power, freedom, np.where(shaped, variance, 0.0) * freedom]), starts, axis=1)
    overall = max(float(banded[0].sum() - banded[2].sum()) / max(float(banded[1].sum()), 1.0), 0.0)
    excess = (np.maximum(banded[0] - banded[2], 0.0) + _POOLED_FREEDOM * overall) / (banded[1] + _POOLED_FREEDOM)
    error: FloatArray = np.repeat(excess, np.diff([*starts, len(variance)]))
    # The gain absorbs the error of the mean.
    error[0] = _MEAN_ERROR**2
    return error


def cold_start(model: ForwardModel, half_angle_rad: float) -> FloatArray:
    """Return Table 3's tire, made stiffer or softer as a whole until its contact has the measured length."""
    start = PRIOR_MEAN.copy()
    scaled = [P.BS, P.CW, P.RS, P.TS, P.TREAD, P.EXTENSION]
    solution = model.solve(start)
    for _ in range(3):
        # The half angle grows with about the 0.8th power of load over stiffness.
        step = 1.25 * math.log(solution.half_angle_rad / half_angle_rad)
        start = start.copy()
        start[scaled] += np.clip(step, -1.0, 1.0)
        solution = model.solve(start, solution.ring)
    return start


def place_centre(model: ForwardModel, solution: ForwardSolution, orders: ComplexArray) -> ForwardSolution:
    """Return the model with the contact centre and the gain of the data."""
    parameters = solution.parameters.copy()
    n = np.arange(2, min(40, len(orders)))
    trials = np.linspace(-0.06, 0.06, 121)
    overlap = (np.exp(1j * np.multiply.outer(trials, n)) @ (orders[n] * solution.orders[n].conj())).real
    parameters[P.CENTRE] = trials[int(np.argmax(overlap))]
    parameters[P.GAIN] = math.log(max(float(overlap.max() / np.sum(np.abs(solution.orders[n]) ** 2)), 0.3))
    return model.solve(parameters, solution.ring)


def begin_waves(
    model: ForwardModel,
    solution: ForwardSolution,
    residual: ComplexArray,
    variance: FloatArray,
    used: BoolArray,
    *,
    all_sides: bool,
) -> ForwardSolution:
    """Give each packet the order that explains most of the residual.

    Without `all_sides` only faint packets are changed, so that a fit that continues keeps what it has found.
    """
    p = solution.parameters.copy()
    weight = np.where(used, 1.0 / np.sqrt(variance), 0.0)
    data = stacked(residual * weight)
    # Place of the order among the parameters, and cosine and sine of the packet among the bases.
    places = (P.BEFORE_ORDER, slice(0, 2)), (P.AFTER_ORDER, slice(6, 8))
    for (order_index, basis_rows), packet in zip(places, solution.packets(), strict=True):
        if not all_sides and packet.amplitude > _FAINT:
            continue
        best_gain = -1.0
        for order in _SEARCH_ORDERS:
            if order > 0.9 * model.max_order:
                break
            trial = p.copy()
            trial[order_index] = order
            basis = model.wave_orders(trial, solution.ring)[basis_rows]
            columns = np.stack([stacked(row * weight) for row in basis], axis=1)
            amplitudes, *_ = np.linalg.lstsq(columns, data, rcond=None)
            gain = float(data @ (columns @ amplitudes))
            if gain > best_gain:
                best_gain, p[order_index] = gain, order
    return model.solve(p, solution.ring)
