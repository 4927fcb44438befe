"""Estimator of the ring paper (Eq. 28 and 29, misprints corrected), as a reference for the others.

It is not the best that the signal allows: on the geometrically exact ring its numbers are wrong by tens of percent,
because a loaded belt is not a linear ring and the contact pressure is not uniform.
docs/explanation/ring-paper-estimator.md has the equations, the corrections and the measured errors. The standard errors
cover noise, the fit's residual, load, pressure, contact angle and that model error.
"""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from gateway.core.estimates.estimator import AngleAverage, Estimate, Revolution, TireConditions
from gateway.core.reasons import Reason
from gateway.core.types import BoolArray, FloatArray
from gateway.papers.reasons import PaperCode
from gateway.ring.bounded_fit import BoundedFit, Model, fit_nonnegative
from gateway.ring.determination import FittedNumbers, all_invalid, doubt_about, load_number, number_estimates, unusable
from gateway.ring.reasons import RingCode
from gateway.ring.reference_tire import TABLE_3_NUMBERS
from gateway.ring.ring_series import stiffness_terms

# Residual, as a share of the signal, above which the ring is rejected: 0.06 on the exact ring, 0.24 on the measured
# tire.
MAX_RESIDUAL_SHARE: Final = 0.5

_MODEL_NOTE: Final = Reason(PaperCode.LINEAR_RING)
# Error of the model on the exact ring, over the fitted value: rms over random tires (docs/evidence/validity.md). It is
# a bias, which repeats.
MODEL_ERRORS: Final = np.array([0.35, 0.65, 0.3, 0.7])

# The fit works in units of Table 3, so that all four parameters are about 1.
_UNITS: Final = np.array(TABLE_3_NUMBERS)

# Starts of a cold fit: soft and stiff belts, wide and narrow ones, soft and stiff sidewalls.
_COLD_STARTS: Final = (
    (1.0, 1.0, 1.0, 1.0),
    (0.1, 0.5, 1.0, 3.0),
    (3.0, 0.3, 1.0, 1.0),
    (0.5, 3.0, 0.5, 0.5),
    (1.0, 0.3, 2.0, 0.1),
    (0.3, 1.0, 0.3, 5.0),
)
# A number below this share of its Table 3 value is on its bound.
_ON_BOUND: Final = 1e-6


class RingPaperEstimator:
    """Bs, Cw, Rs, Ts and their ratios to Cw from the running average's orders 1 to 60."""

    name = "ring-paper"

    def __init__(self) -> None:
        """Start cold."""
        self.reset()

    def reset(self) -> None:
        """Forget the warm start."""
        self._updates = 0
        self._warm: FloatArray | None = None
        self._warm_force_m = math.nan

    def update(self, revolution: Revolution, average: AngleAverage, conditions: TireConditions) -> tuple[Estimate, ...]:
        """Return Bs, Cw, Rs, Ts, then Bs/Cw, Rs/Cw, Ts/Cw.

        Without load or pressure the four are invalid, but not the ratios, for all four are proportional to Q / p0.
        Provisional until the average has settled, and on a revolution with faults. Never raises on values.
        """
        reason = unusable(average, conditions)
        if reason:
            return all_invalid(reason)
        orders = np.flatnonzero(np.isfinite(average.orders_mps2))
        tire = conditions.tire
        # Eq. 27 has no gravity; whether it was added to order 1 is not stated.
        orders = orders[orders > tire.is_linear_ring]
        half_angle = 0.5 * (average.trailing_edge_rad - average.leading_edge_rad)
        # The definition of both edges may be wrong in the same direction: their errors add.
        angle_std = 0.5 * (average.leading_edge_std_rad + average.trailing_edge_std_rad)
        if tire.half_angle_rad is not None:
            half_angle, angle_std = tire.half_angle_rad, tire.half_angle_std_rad
        force = load_number(conditions) * conditions.radius_m / (math.pi * half_angle)
        # Angle 0 is the middle of the contact here, whatever the segmentation has taken for it.
        centre = 0.5 * (average.trailing_edge_rad + average.leading_edge_rad)
        n = orders.astype(np.float64)
        coefficients = (average.orders_mps2[orders] * np.exp(1j * n * centre)).real / average.omega_radps**2
        stds = average.orders_std_mps2[orders] / average.omega_radps**2
        fit = fit_ring_numbers(n, coefficients, stds, force_m=force, half_angle_rad=half_angle, warm=self._start(force))
        if fit is None:
            self._warm = None
            return all_invalid(Reason(RingCode.ORDERS_UNUSABLE))
        if fit.residual_share > MAX_RESIDUAL_SHARE:
            self._warm = None
            return all_invalid(
                Reason(RingCode.RING_DOES_NOT_FIT, residual=fit.residual_share, limit=MAX_RESIDUAL_SHARE)
            )
        self._warm, self._warm_force_m = fit.numbers, force

        covariance = fit.covariance + np.outer(fit.angle_derivative, fit.angle_derivative) * _square(angle_std)
        model = np.diag(np.square((0.0 if tire.is_linear_ring else MODEL_ERRORS) * fit.numbers))
        fitted = FittedNumbers(fit.numbers, fit.free, covariance, model)
        return number_estimates(
            self.name,
            fitted,
            conditions,
            doubt_about(revolution, average.effective_count),
            () if tire.is_linear_ring else (_MODEL_NOTE,),
        )

    def _start(self, force_m: float) -> FloatArray | None:
        """Return the last numbers, scaled to this force; None for a cold start, at updates 1, 2, 4, 8, ..."""
        self._updates += 1
        if self._warm is None or not self._updates & (self._updates - 1):
            return None
        result: FloatArray = self._warm * (force_m / self._warm_force_m)
        return result


def _square(value: float) -> float:
    return value * value if math.isfinite(value) else 0.0


@dataclass(frozen=True, slots=True)
class RingFit:
    """Fitted numbers Bs, Cw, Rs, Ts.

    Attributes:
        numbers: (4,) at least 0.
        free: (4,) False where the fit puts a number on its bound 0.
        covariance: (4, 4) from the residual or from the noise, whichever is larger for each number; zero for numbers
            that are not free.
        angle_derivative: (4,) change of the numbers per rad of contact half angle.
        residual_share: rms residual over rms signal.
    """

    numbers: FloatArray
    free: BoolArray
    covariance: FloatArray
    angle_derivative: FloatArray
    residual_share: float


def fit_ring_numbers(
    orders: FloatArray,
    coefficients_m: FloatArray,
    coefficients_std_m: FloatArray,
    *,
    force_m: float,
    half_angle_rad: float,
    warm: FloatArray | None = None,
) -> RingFit | None:
    """Minimise Eq. 28 over Bs, Cw, Rs, Ts >= 0.

    The model is -force sin(n theta_r) n^3 / D_n with force = Q / (pi p0 R theta_r). All four numbers are proportional
    to the force, so any force gives the right ratios when load or pressure are not known.

    Args:
        orders: (m,) order numbers, m >= 5.
        coefficients_m: (m,) measured cosine coefficients of s / Omega^2.
        coefficients_std_m: (m,) their standard errors; NaN counts as unknown.
        force_m: Q / (pi p0 R theta_r), positive.
        half_angle_rad: contact half angle theta_r.
        warm: numbers to start from; None tries several starts and keeps the best.

    Returns:
        The fit, or None when the data are flat or not finite.
    """
    sine, cosine = np.sin(orders * half_angle_rad), np.cos(orders * half_angle_rad)
    cube = -force_m * orders**3
    numerator = cube * sine
    terms = stiffness_terms(orders) * _UNITS
    power = float(coefficients_m @ coefficients_m)
    if not (math.isfinite(power) and power > 0.0 and bool(np.isfinite(numerator).all())):
        return None

    fit = _best_fit(_LinearRing(terms, numerator), coefficients_m, warm)
    if not math.isfinite(fit.cost):
        return None
    free = fit.parameters > _ON_BOUND
    if not free.any():
        return None
    # Change of the numerator per rad at fixed load: of the sine, and of the force, which falls as 1 / theta_r.
    numerator_slope = cube * orders * cosine - numerator / half_angle_rad
    covariance, angle_derivative = _uncertainty(fit, free, terms, numerator, numerator_slope, coefficients_std_m)
    return RingFit(
        numbers=np.where(free, fit.parameters, 0.0) * _UNITS,
        free=free,
        covariance=covariance * np.outer(_UNITS, _UNITS),
        angle_derivative=angle_derivative * _UNITS,
        residual_share=math.sqrt(fit.cost / power),
    )


@dataclass(frozen=True, slots=True)
class _LinearRing:
    """Orders numerator / (terms @ parameters) of the linear ring, terms (m, 4)."""

    terms: FloatArray
    numerator: FloatArray

    def values(self, parameters: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the orders, (m,), and their Jacobian, (m, 4)."""
        stiffness = np.maximum(self.terms @ parameters, 1e-12)
        values = self.numerator / stiffness
        return values, self.terms * (-values / stiffness)[:, np.newaxis]

    def curvature(self, parameters: FloatArray, residuals: FloatArray) -> FloatArray:
        """Return the sum of residual times second derivative of the orders, (4, 4)."""
        stiffness = np.maximum(self.terms @ parameters, 1e-12)
        weights = (2.0 * residuals * self.numerator / stiffness**3)[:, np.newaxis]
        result: FloatArray = self.terms.T @ (weights * self.terms)
        return result


def _best_fit(ring: _LinearRing, data: FloatArray, warm: FloatArray | None) -> BoundedFit:
    """Return the fit from the warm start, or the best from all cold starts."""
    if warm is not None:
        # A number on its bound starts slightly above it, so that it can leave it.
        start = np.maximum(warm / _UNITS, 1e-3)
        return fit_nonnegative(ring.values, data, start, curvature=ring.curvature, tolerance=1e-5)
    fits = [
        fit_nonnegative(ring.values, data, start, curvature=ring.curvature, tolerance=1e-6)
        for start in (_scaled_start(ring.values, data, np.array(shape)) for shape in _COLD_STARTS)
    ]
    return min(fits, key=lambda fit: fit.cost)


def _scaled_start(model: Model, data: FloatArray, shape: FloatArray) -> FloatArray:
    """Scale a start so that the model has the size of the data; the model is proportional to 1 / parameters."""
    values, _ = model(shape)
    overlap = float(values @ data)
    if not overlap > 0.0:
        overlap = float(np.linalg.norm(values) * np.linalg.norm(data))
    result: FloatArray = shape * (float(values @ values) / overlap)
    return result


def _uncertainty(
    fit: BoundedFit,
    free: BoolArray,
    terms: FloatArray,
    numerator: FloatArray,
    numerator_slope: FloatArray,
    data_std: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Return the covariance (k, k) and the derivative by the half angle (k,), zero where not free.

    Both follow from the shift of the minimum: with f = a / (B p) its Hessian is B' diag(f^2 - 2 r f) / (B p)^2 B. The
    residual term matters here, where the model does not fit: without it the result is wrong by a factor of 3.
    """
    size = len(free)
    covariance, derivative = np.zeros((size, size)), np.zeros(size)
    free_terms = terms[:, free]
    stiffness = terms @ fit.parameters
    values, weighted = numerator / stiffness, free_terms / stiffness[:, np.newaxis]
    hessian = weighted.T @ ((values**2 - 2.0 * fit.residuals * values)[:, np.newaxis] * weighted)
    if np.linalg.eigvalsh(hessian)[0] <= 0.0:
        hessian = weighted.T @ (values[:, np.newaxis] ** 2 * weighted)
    jacobian = fit.jacobian[:, free]
    right = np.column_stack([jacobian.T, weighted.T @ ((values - fit.residuals) * numerator_slope / stiffness)])
    try:
        shifts = np.linalg.solve(hessian, right)
    except np.linalg.LinAlgError:
        shifts = np.full_like(right, math.nan)
    by_data = shifts[:, :-1]
    degrees = max(1, len(fit.residuals) - int(np.count_nonzero(free)))
    from_residual = fit.cost / degrees * (by_data @ by_data.T)
    by_noise = by_data * np.nan_to_num(data_std)
    from_noise = by_noise @ by_noise.T
    # The larger variance of each number, with the correlations of the residual's covariance.
    larger = np.sqrt(np.maximum(np.diagonal(from_noise) / np.maximum(np.diagonal(from_residual), 1e-300), 1.0))
    covariance[np.ix_(free, free)] = from_residual * np.outer(larger, larger)
    derivative[free] = shifts[:, -1]
    return covariance, derivative
