"""Fit of the linear ring to measured orders with its contact pressure: numbers, edges and pressure shape together.

Every order is weighted with its error. What the fit rests on but does not know - contact edges, pressure shape - is
fitted along with prior knowledge of its size, which is generalised least squares with those directions in the
covariance.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from gateway.estimators.bounded_fit import fit_nonnegative
from gateway.physics.contact_pressure import unit_road_orders
from gateway.physics.reference_tire import TABLE_3_NUMBERS
from gateway.physics.ring_series import stiffness_terms
from gateway.types import BoolArray, ComplexArray, FloatArray

# Numbers are counted in Table 3's at its load number, so that all are about 1 at load number 1.
_UNITS: Final[FloatArray] = np.array(TABLE_3_NUMBERS) / 0.2325
# Legendre amounts of the contact pressure, degrees 1 to 4: prior means and standard errors. On the exact ring degree 2
# runs from -1.0 to -0.2 and degree 4 from 0.0 to -0.6 with load; 1 and 3 come with damping, 0.2 at the most.
SHAPE_MEANS: Final = (0.0, -0.5, 0.0, -0.35)
SHAPE_STDS: Final = (0.2, 0.35, 0.1, 0.3)
# Nuisances are counted in their standard errors from this many below their means, so that the fit, which knows no
# negative parameters, leaves them free within five standard errors.
_RANGE: Final = 5.0
_NUISANCES: Final = 2 + len(SHAPE_MEANS)
# The linear ring follows the exact one to a share of a percent of the largest order at best: no order counts for more.
_LEAST_STD: Final = 1e-3

_ZERO: Final = 1e-6


@dataclass(frozen=True, slots=True)
class ModalFit:
    """The linear ring as fitted, at load number Q / (p0 R^2) = 1.

    Attributes:
        numbers: (4,) Bs, Cw, Rs, Ts.
        free: (4,) False where a number is held at 0.
        half_angle_rad: of the contact.
        centre_rad: middle of the contact.
        shape: (4,) Legendre amounts of the contact pressure.
        response: (4, m) complex; the numbers move by the real part of response @ conj(change of the orders over R).
        residual: (m,) complex orders over R left over.
        misfit: chi-square over its degrees of freedom.
        left_over: rms residual over rms signal.
        parameters: where the fit ended, to start the next one from.
    """

    numbers: FloatArray
    free: BoolArray
    half_angle_rad: float
    centre_rad: float
    shape: FloatArray
    response: ComplexArray
    residual: ComplexArray
    misfit: float
    left_over: float
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
    terms = stiffness_terms(orders) * _UNITS
    factor = -np.square(orders) * (np.square(orders) - 1.0) / math.pi
    half, centre = 0.5 * (edges_rad[1] - edges_rad[0]), 0.5 * (edges_rad[1] + edges_rad[0])
    means = np.array([half, centre, *SHAPE_MEANS])
    stds = np.array([min(edge_std_rad, 0.1 * half), edge_std_rad, *SHAPE_STDS])
    size = float(np.abs(coefficients).max())
    weights = 1.0 / np.hypot(coefficients_std, _LEAST_STD * size)
    if not (np.isfinite(coefficients).all() and np.isfinite(weights).all() and size > 0.0):
        return None
    data = np.concatenate([_stacked(coefficients * weights), np.full(_NUISANCES, _RANGE)])

    def model(parameters: FloatArray) -> tuple[FloatArray, FloatArray]:
        nuisance = means + (parameters[4:] - _RANGE) * stds
        amounts = np.concatenate([[1.0], nuisance[2:]])
        unit, slope = unit_road_orders(orders, float(nuisance[0]), len(SHAPE_MEANS))
        # About the centre the tangential part's own turn is of second order: the shift is a phase.
        gain = factor * np.exp(-1j * orders * nuisance[1]) / np.maximum(terms @ parameters[:4], 1e-9) * weights
        values = gain * (amounts @ unit)
        jacobian = np.zeros((len(data), len(parameters)))
        m = 2 * len(orders)
        jacobian[:m, :4] = _stacked(-(values / np.maximum(terms @ parameters[:4], 1e-9))[:, np.newaxis] * terms)
        jacobian[:m, 4] = _stacked(gain * (amounts @ slope)) * stds[0]
        jacobian[:m, 5] = _stacked(-1j * orders * values) * stds[1]
        jacobian[:m, 6:] = _stacked((gain * unit[1:]).T) * stds[2:]
        jacobian[m:, 4:] = np.eye(_NUISANCES)
        return np.concatenate([_stacked(values), parameters[4:]]), jacobian

    # Only one minimum was ever found: from soft and stiff belts and either sidewall, over Table 1, with noise.
    cold = np.concatenate([np.ones(4), np.full(_NUISANCES, _RANGE)])
    best = fit_nonnegative(model, data, cold if start is None else np.maximum(start, 1e-3), tolerance=1e-5)
    if not math.isfinite(best.cost):
        return None
    free = best.parameters[:4] > _ZERO
    m = len(orders)
    normal = best.jacobian.T @ best.jacobian
    normal += 1e-14 * np.trace(normal) * np.eye(len(normal))
    inverse = np.linalg.solve(normal, best.jacobian.T)[:4] * _UNITS[:, np.newaxis]
    nuisance = means + (best.parameters[4:] - _RANGE) * stds
    residual = _complex(best.residuals[:m], best.residuals[m : 2 * m]) / weights
    response = _complex(inverse[:, :m], inverse[:, m : 2 * m]) * weights
    return ModalFit(
        numbers=np.where(free, best.parameters[:4], 0.0) * _UNITS,
        free=free,
        half_angle_rad=float(nuisance[0]),
        centre_rad=float(nuisance[1]),
        shape=nuisance[2:],
        response=response,
        residual=residual,
        misfit=best.cost / (2 * m - 4),
        left_over=float(np.linalg.norm(residual) / np.linalg.norm(coefficients)),
        parameters=best.parameters,
    )


def _stacked(values: ComplexArray) -> FloatArray:
    """Real parts above imaginary parts."""
    result: FloatArray = np.concatenate([values.real, values.imag])
    return result


def _complex(real: FloatArray, imaginary: FloatArray) -> ComplexArray:
    return np.asarray(real + 1j * imaginary, dtype=np.complex128)
