"""Estimator with the ring paper's linear ring and the terms that the paper's own estimator leaves out.

Differences from `ring-paper`: n^2 - 1 in place of n^2, orders from 2 up, a vertical road force, contact edges and
pressure shape fitted along with the numbers, and every order weighted with its error. Contact edges and pressure shape
have priors, which is generalised least squares with those directions in the covariance.

It follows the waveform of the exact ring ten times closer, and its Bs is right within some percent. But it is still a
linear ring: its Cw, Rs and Ts are those of a belt that does not lose tension in the contact
(docs/explanation/estimators.md).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from gateway.core.estimates.estimator import AngleAverage, Estimate, Revolution, TireConditions
from gateway.core.reasons import CoreCode, Reason
from gateway.core.revolutions.order_spectrum import ORDER_COUNT
from gateway.core.types import BoolArray, ComplexArray, FloatArray
from gateway.papers.reasons import PaperCode
from gateway.ring.bounded_fit import BoundedFit, fit_nonnegative
from gateway.ring.contact_pressure import unit_road_orders
from gateway.ring.determination import (
    NUMBER_UNITS,
    FittedNumbers,
    all_invalid,
    doubt_about,
    load_number,
    number_estimates,
    unusable,
)
from gateway.ring.order_errors import band_mean, relative_std
from gateway.ring.reasons import RingCode
from gateway.ring.ring_series import stiffness_terms

FIRST_ORDER: Final = 2
_UNKNOWN_EDGE_STD_RAD: Final = 0.01
# Residual, as a share of the signal, above which the ring is rejected.
MAX_RESIDUAL_SHARE: Final = 0.5
_MODEL_NOTE: Final = Reason(PaperCode.LINEAR_RING)

# Legendre coefficients of the contact pressure, degrees 1 to 4: prior means and standard errors. On the exact ring
# degree 2 is -1.0 to -0.2 and degree 4 is 0.0 to -0.6 over loads; 1 and 3 come from damping and are at most 0.2.
SHAPE_MEANS: Final = (0.0, -0.5, 0.0, -0.35)
SHAPE_STDS: Final = (0.2, 0.35, 0.1, 0.3)
# Nuisance parameters count in standard errors from this many below their means. The fit allows no negative parameters,
# so it leaves them free within five standard errors.
_RANGE: Final = 5.0
_NUISANCES: Final = 2 + len(SHAPE_MEANS)
# Least error of an order, as a share of the largest: the linear ring follows the exact one no closer.
_LEAST_STD: Final = 1e-3

# Error of the linear ring with a constant tension on the exact one, over the fitted value: rms over random tires
# (docs/evidence/validity.md). It is a bias, which repeats.
MODEL_ERRORS: Final = np.array([0.05, 0.6, 0.11, 5.0])

# A number below this share of its unit is on its bound.
_ON_BOUND: Final = 1e-6


class RingModalEstimator:
    """Bs, Cw, Rs, Ts and their ratios to Cw from the running average's orders 2 to 60."""

    name = "ring-modal"

    def __init__(self) -> None:
        """Start cold."""
        self.reset()

    def reset(self) -> None:
        """Forget the warm start."""
        self._warm: FloatArray | None = None

    def update(self, revolution: Revolution, average: AngleAverage, conditions: TireConditions) -> tuple[Estimate, ...]:
        """Return Bs, Cw, Rs, Ts, then Bs/Cw, Rs/Cw, Ts/Cw.

        Without load or pressure the four are invalid, but not the ratios. Provisional until the average has settled, on
        a revolution with faults, and where the data do not determine a number. Never raises on values.
        """
        reason = unusable(average, conditions)
        if reason:
            return self._cold(reason)
        mean = float(average.orders_mps2[0].real)
        if not mean > 0.0:
            return self._cold(Reason(CoreCode.NO_STEADY_VALUE))
        carried = int(np.flatnonzero(np.isfinite(average.orders_mps2))[-1])
        relative = average.orders_mps2 / mean
        std = relative_std(average.orders_std_mps2, mean, np.abs(np.nan_to_num(relative)), carried)
        used = slice(FIRST_ORDER, carried + 1)
        edge_std = 0.5 * (average.leading_edge_std_rad + average.trailing_edge_std_rad)
        fit = fit_modal(
            np.arange(FIRST_ORDER, carried + 1, dtype=np.float64),
            relative[used],
            std[used],
            edges_rad=(average.leading_edge_rad, average.trailing_edge_rad),
            edge_std_rad=edge_std if np.isfinite(edge_std) and edge_std > 0.0 else _UNKNOWN_EDGE_STD_RAD,
            start=self._warm,
        )
        if fit is None:
            return self._cold(Reason(RingCode.ORDERS_UNUSABLE))
        if fit.residual_share > MAX_RESIDUAL_SHARE:
            return self._cold(Reason(RingCode.RING_DOES_NOT_FIT, residual=fit.residual_share, limit=MAX_RESIDUAL_SHARE))
        self._warm = fit.parameters
        number = load_number(conditions)
        fitted = FittedNumbers(
            fit.numbers * number, fit.free, _noise(fit, std[used]) * number**2, _model(fit) * number**2
        )
        return number_estimates(
            self.name, fitted, conditions, doubt_about(revolution, average.effective_count), (_MODEL_NOTE,)
        )

    def _cold(self, reason: Reason) -> tuple[Estimate, ...]:
        self._warm = None
        return all_invalid(reason)


def _noise(fit: ModalFit, std: FloatArray) -> FloatArray:
    """Return the covariance of the numbers from the errors of the orders."""
    scaled = fit.response * std
    covariance: FloatArray = (scaled @ scaled.conj().T).real
    return covariance


def _model(fit: ModalFit) -> FloatArray:
    """Return the covariance of the numbers from model error.

    It is that of the residual added back with random phases and sizes by band, and the known bias of the model.
    """
    power = np.zeros(ORDER_COUNT)
    power[FIRST_ORDER : FIRST_ORDER + len(fit.residual)] = 0.5 * np.square(np.abs(fit.residual))
    drawn = np.sqrt(band_mean(power)[FIRST_ORDER : FIRST_ORDER + len(fit.residual)])
    scaled = fit.response * drawn
    covariance: FloatArray = (scaled @ scaled.conj().T).real
    covariance += np.diag(np.square(MODEL_ERRORS * fit.numbers))
    return covariance


@dataclass(frozen=True, slots=True)
class ModalFit:
    """Fitted linear ring, at load number Q / (p0 R^2) = 1.

    Attributes:
        numbers: (4,) Bs, Cw, Rs, Ts.
        free: (4,) False where a number is held at 0.
        half_angle_rad: of the contact.
        response: (4, m) complex; the numbers change by the real part of response @ conj(change of the orders over R).
        residual: (m,) complex orders over R.
        residual_share: rms residual over rms signal.
        parameters: of the fit, to start the next one from.
    """

    numbers: FloatArray
    free: BoolArray
    half_angle_rad: float
    response: ComplexArray
    residual: ComplexArray
    residual_share: float
    parameters: FloatArray


def fit_modal(
    orders: FloatArray,
    coefficients: ComplexArray,
    coefficients_std: FloatArray,
    *,
    edges_rad: tuple[float, float],
    edge_std_rad: float,
    start: FloatArray | None = None,
) -> ModalFit | None:
    """Fit s_n / (R Omega^2) = -n^2 (n^2 - 1) (alpha_n - i beta_n) R / Q / (pi D_n) over orders from 2 up.

    Args:
        orders: (m,) from 2 up; order 1 of the linear ring is zero.
        coefficients: (m,) complex orders of s over its mean.
        coefficients_std: (m,) standard errors of their real and of their imaginary parts.
        edges_rad: measured leading and trailing edge.
        edge_std_rad: standard error of half angle and centre.
        start: parameters of a nearby fit; None starts from Table 3's ring.

    Returns:
        The fit, or None when the data are not finite.
    """
    half, centre = 0.5 * (edges_rad[1] - edges_rad[0]), 0.5 * (edges_rad[1] + edges_rad[0])
    size = float(np.abs(coefficients).max())
    weights = 1.0 / np.hypot(coefficients_std, _LEAST_STD * size)
    if not (np.isfinite(coefficients).all() and np.isfinite(weights).all() and size > 0.0):
        return None
    model = _LinearRing(
        orders=orders,
        terms=stiffness_terms(orders) * NUMBER_UNITS,
        weights=weights,
        means=np.array([half, centre, *SHAPE_MEANS]),
        stds=np.array([min(edge_std_rad, 0.1 * half), edge_std_rad, *SHAPE_STDS]),
    )
    data = np.concatenate([_stacked(coefficients * weights), np.full(_NUISANCES, _RANGE)])
    # One start is enough: soft and stiff belts and sidewalls, over Table 1 and with noise, all lead to one minimum.
    cold = np.concatenate([np.ones(4), np.full(_NUISANCES, _RANGE)])
    fit = fit_nonnegative(model.values, data, cold if start is None else np.maximum(start, 1e-3), tolerance=1e-5)
    return _result(fit, model, coefficients) if math.isfinite(fit.cost) else None


@dataclass(frozen=True, slots=True)
class _LinearRing:
    """Weighted orders of the linear ring, and its nuisance parameters as data with their priors.

    Attributes:
        orders: (m,).
        terms: (m, 4) factors of the numbers in the stiffness of each order.
        weights: (m,) inverse standard errors of the orders.
        means: (6,) prior means of half angle, centre and pressure shape.
        stds: (6,) their standard errors.
    """

    orders: FloatArray
    terms: FloatArray
    weights: FloatArray
    means: FloatArray
    stds: FloatArray

    def nuisance(self, parameters: FloatArray) -> FloatArray:
        """Return half angle, centre and pressure shape, (6,)."""
        return self.means + (parameters[4:] - _RANGE) * self.stds

    def values(self, parameters: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the model values, (2 m + 6,), and their Jacobian by the parameters, (2 m + 6, 10)."""
        orders, terms, stds = self.orders, self.terms, self.stds
        stiffness = np.maximum(terms @ parameters[:4], 1e-9)
        half_angle, centre, *shape = self.nuisance(parameters).tolist()
        amounts = np.array([1.0, *shape])
        unit, slope = unit_road_orders(orders, half_angle, len(SHAPE_MEANS))
        factor = -np.square(orders) * (np.square(orders) - 1.0) / math.pi
        # The shift of the contact is a phase; the rotation of the tangential force that it causes is of second order.
        gain = factor * np.exp(-1j * orders * centre) / stiffness * self.weights
        values = gain * (amounts @ unit)
        m = 2 * len(orders)
        jacobian = np.zeros((m + _NUISANCES, len(parameters)))
        jacobian[:m, :4] = _stacked(-(values / stiffness)[:, np.newaxis] * terms)
        jacobian[:m, 4] = _stacked(gain * (amounts @ slope)) * stds[0]
        jacobian[:m, 5] = _stacked(-1j * orders * values) * stds[1]
        jacobian[:m, 6:] = _stacked((gain * unit[1:]).T) * stds[2:]
        jacobian[m:, 4:] = np.eye(_NUISANCES)
        return np.concatenate([_stacked(values), parameters[4:]]), jacobian


def _result(fit: BoundedFit, model: _LinearRing, coefficients: ComplexArray) -> ModalFit:
    """Return the ring at the minimum, with its response to changes of the orders."""
    free = fit.parameters[:4] > _ON_BOUND
    m = len(coefficients)
    normal = fit.jacobian.T @ fit.jacobian
    normal += 1e-14 * np.trace(normal) * np.eye(len(normal))
    inverse = np.linalg.solve(normal, fit.jacobian.T)[:4] * NUMBER_UNITS[:, np.newaxis]
    residual = _complex(fit.residuals[:m], fit.residuals[m : 2 * m]) / model.weights
    response = _complex(inverse[:, :m], inverse[:, m : 2 * m]) * model.weights
    return ModalFit(
        numbers=np.where(free, fit.parameters[:4], 0.0) * NUMBER_UNITS,
        free=free,
        half_angle_rad=float(model.nuisance(fit.parameters)[0]),
        response=response,
        residual=residual,
        residual_share=float(np.linalg.norm(residual) / np.linalg.norm(coefficients)),
        parameters=fit.parameters,
    )


def _stacked(values: ComplexArray) -> FloatArray:
    """Return real parts above imaginary parts."""
    result: FloatArray = np.concatenate([values.real, values.imag])
    return result


def _complex(real: FloatArray, imaginary: FloatArray) -> ComplexArray:
    return np.asarray(real + 1j * imaginary, dtype=np.complex128)
