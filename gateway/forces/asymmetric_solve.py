"""Solution of the balance of a belt that is not symmetric: its unknowns, its forces, and their errors.

As in `weak_form_solve`, the orders are corrected as little as possible until all rows hold. The forces follow the
orders directly and through the unknowns, so their response to the orders gives every standard error.
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np

from gateway.core.revolutions.order_spectrum import ORDER_COUNT
from gateway.core.types import FloatArray
from gateway.forces.asymmetric_belt import AsymmetricShape, asymmetric_shape, level_part
from gateway.forces.asymmetric_rows import (
    ROWS,
    AsymmetricRows,
    Force,
    U,
    asymmetric_rows,
    free_begin,
    free_motion,
    row_sensitivity,
)
from gateway.ring.belt_shape import MAX_ORDER
from gateway.ring.determination import NUMBER_UNITS
from gateway.ring.order_errors import BANDS

# Places of the orders that are corrected, 2 to 60, cosines then sines. Order 1 is the closure's.
_CORRECTED: Final = np.concatenate([np.arange(1, ORDER_COUNT - 1), MAX_ORDER + np.arange(1, ORDER_COUNT - 1)])
_HALF: Final = len(_CORRECTED) // 2
_BAND_EDGES: Final = [edge - 2 for edge in BANDS]

# Units of the unknowns, a car tire at load number 1; dampings of a rolling resistance of about 1 %.
_UNITS: Final[FloatArray] = np.array([*NUMBER_UNITS, 0.8, 0.1, 0.08, 0.03, 0.03, 0.2, 0.02 * NUMBER_UNITS[0]])
_COLD: Final[FloatArray] = np.array([*NUMBER_UNITS, 0.8, 0.0, 0.08, 0.0, 0.0, 0.0, 0.0])
_COLD_PASSES: Final = 6
_WARM_PASSES: Final = 2
# Standard error of the belt's bending damping from 0, over its bending stiffness: a loss angle of 0.1 at order 5, where
# a contact bends the belt. Cords, which carry the bending, lose less than rubber.
_BENDING_LOSS: Final = 0.02
# Prior of every unknown in its unit: only keeps the system from being singular.
_WEAK: Final = 1e3
# Unknowns that belong to the tire and not to the moment.
LASTING: Final = (U.BS, U.CW, U.RS, U.TS, U.DAMPING, U.BENDING_DAMPING)
# Relative change of the unknowns, in their units, within which a step is small.
_LARGEST_STEP: Final = 1.0
# Part of the contact's half angle in which the belt lies level, and another to compare with: where the tread is
# compressed unevenly they differ.
LEVEL_SHARE: Final = 0.5
_OTHER_LEVEL_SHARE: Final = 0.8


@dataclass(frozen=True, slots=True)
class TirePrior:
    """Knowledge of a tire's own unknowns from other data.

    Attributes:
        mean: (6,) in the order of LASTING.
        covariance: (6, 6).
    """

    mean: FloatArray
    covariance: FloatArray


@dataclass(frozen=True, slots=True)
class AsymmetricSolution:
    """Unknowns and forces of one waveform at load number 1.

    Attributes:
        unknowns: (11,) in the order of `U`.
        forces: (4,) in the order of `Force`, over the load, and over load and radius.
        response: (4, 118) derivative of the forces by the cosine and sine orders 2 to 60 of the relative signal.
        unknown_response: (11, 118) likewise of the unknowns.
        prior_response: (4, k) derivative of the forces by independent unit errors of the priors.
        unknown_prior_response: (11, k) likewise of the unknowns.
        correction: (118,) least change of the orders with which the rows hold.
        misfit: chi-square of the balance over its degrees of freedom.
        tilt_rad: difference of the belt's direction in the contact by its two definitions.
    """

    unknowns: FloatArray
    forces: FloatArray
    response: FloatArray
    unknown_response: FloatArray
    prior_response: FloatArray
    unknown_prior_response: FloatArray
    correction: FloatArray
    misfit: float
    tilt_rad: float

    def noise(self, order_std: FloatArray) -> FloatArray:
        """Return the covariance of the forces by errors of the orders, (ORDER_COUNT,), (4, 4)."""
        weighted = self.response * _cosine_sine_std(order_std)
        covariance: FloatArray = weighted @ weighted.T
        return covariance

    def common(self) -> FloatArray:
        """Return the covariance of the forces by priors and model error, (4, 4)."""
        waves = self._waves() @ self.response.T
        covariance: FloatArray = waves.T @ waves + self.prior_response @ self.prior_response.T
        return covariance

    def tire(self, order_std: FloatArray) -> TirePrior:
        """Return the tire's own unknowns with their covariance, by errors of the orders, priors and model error."""
        rows = list(LASTING)
        weighted = self.unknown_response[rows] * _cosine_sine_std(order_std)
        waves = self._waves() @ self.unknown_response[rows].T
        by_prior = self.unknown_prior_response[rows]
        covariance = weighted @ weighted.T + waves.T @ waves + by_prior @ by_prior.T
        return TirePrior(self.unknowns[rows], covariance)

    def _waves(self) -> FloatArray:
        """Return independent unit model errors of the orders, (k, 118).

        They are the correction that lets the balance hold, with random phase in each band of orders, minus the part
        that the errors of the orders explain.
        """
        # Phases are random, so either quadrature carries half of it.
        excess = max(1.0 - 1.0 / max(self.misfit, 1.0), 0.0) * (ROWS + 1) / _FREEDOM
        cosine, sine = self.correction[:_HALF], self.correction[_HALF:]
        waves = []
        for first, following in pairwise(_BAND_EDGES):
            for cosine_part, sine_part in ((cosine, sine), (-sine, cosine)):
                wave = np.zeros(2 * _HALF)
                wave[first:following] = cosine_part[first:following]
                wave[_HALF + first : _HALF + following] = sine_part[first:following]
                waves.append(wave)
        result: FloatArray = np.sqrt(0.5 * excess) * np.array(waves)
        return result


_FREEDOM: Final = ROWS + 1 - len(U) + 1


def corrected_orders(orders: FloatArray) -> FloatArray:
    """Return the orders (2 MAX_ORDER,) to which `AsymmetricSolution.response` refers, (118,)."""
    corrected: FloatArray = orders[..., _CORRECTED]
    return corrected


def solve_asymmetric(
    orders: FloatArray,
    order_std: FloatArray,
    half_angle_rad: float,
    start: FloatArray | None = None,
    prior: TirePrior | None = None,
) -> AsymmetricSolution:
    """Solve the balance of one waveform.

    Args:
        orders: (2 MAX_ORDER,) of kappa R, as in `asymmetric_belt`.
        order_std: (ORDER_COUNT,) standard error of the cosine and of the sine of each order, all positive.
        half_angle_rad: half of the contact angle.
        start: (11,) unknowns of a similar waveform, None for none.
        prior: of the tire's own unknowns, None for none.

    Raises:
        numpy.linalg.LinAlgError: the orders describe no belt.
    """
    motion = free_motion(free_begin(half_angle_rad))
    level = LEVEL_SHARE * half_angle_rad
    unknowns = _COLD if start is None else start
    variance = np.square(_cosine_sine_std(order_std))
    correction = np.zeros(2 * _HALF)
    for _ in range(_COLD_PASSES if start is None else _WARM_PASSES):
        shape = asymmetric_shape(_add_correction(orders, correction), level)
        rows = asymmetric_rows(shape, motion, unknowns)
        sensitivity, forces_by_order = (part[:, _CORRECTED] for part in row_sensitivity(shape, motion, unknowns))
        step = _step(rows, sensitivity, forces_by_order, correction, variance, unknowns, prior)
        unknowns, correction = unknowns + step.change, step.correction
    shape = asymmetric_shape(_add_correction(orders, correction), level)
    rows = asymmetric_rows(shape, motion, unknowns)
    return AsymmetricSolution(
        unknowns=unknowns,
        forces=rows.forces,
        response=forces_by_order + rows.forces_by_unknown @ step.response,
        unknown_response=step.response,
        prior_response=rows.forces_by_unknown @ step.by_prior,
        unknown_prior_response=step.by_prior,
        correction=correction,
        misfit=step.misfit,
        tilt_rad=_tilt(shape, half_angle_rad),
    )


@dataclass(frozen=True, slots=True)
class _Step:
    change: FloatArray
    correction: FloatArray
    response: FloatArray
    by_prior: FloatArray
    misfit: float


def _step(
    rows: AsymmetricRows,
    sensitivity: FloatArray,
    forces_by_order: FloatArray,
    correction: FloatArray,
    variance: FloatArray,
    unknowns: FloatArray,
    prior: TirePrior | None,
) -> _Step:
    """Return one Gauss-Newton step of unknowns and correction; the last row is the load, which is 1."""
    by_order = np.concatenate([sensitivity, forces_by_order[Force.LOAD : Force.LOAD + 1]])
    by_unknown = np.concatenate([rows.by_unknown, rows.forces_by_unknown[Force.LOAD : Force.LOAD + 1]])
    residual = np.append(rows.balance, rows.forces[Force.LOAD] - 1.0)
    # At the measured orders the rows are off by the residual minus what the present correction makes.
    target = -(residual - by_order @ correction)
    # The product of the weighted sensitivity with its transpose is the covariance, but squares the condition number.
    factor = np.asarray(np.linalg.qr((by_order * np.sqrt(variance)).T, mode="r"), dtype=np.float64).T
    whitened = np.linalg.solve(factor, np.column_stack([by_unknown * _UNITS, target, by_order]))
    jacobian, whitened_target, orders = whitened[:, : len(U)], whitened[:, len(U)], whitened[:, len(U) + 1 :]
    root, prior_target = _prior_rows(prior, unknowns)
    basis, upper = np.linalg.qr(np.concatenate([jacobian, root]))
    change = np.linalg.solve(upper, basis.T @ np.append(whitened_target, prior_target))
    if not np.isfinite(change).all():
        raise np.linalg.LinAlgError("the balance has no solution")
    remainder = whitened_target - jacobian @ change
    change *= min(1.0, _LARGEST_STEP / max(float(np.abs(change).max()), 1e-300))
    response = -np.linalg.solve(upper, basis[: len(whitened_target)].T @ orders) * _UNITS[:, np.newaxis]
    by_prior = np.linalg.solve(upper, basis[len(whitened_target) :].T) * _UNITS[:, np.newaxis]
    new_correction = variance * (by_order.T @ np.linalg.solve(factor.T, remainder))
    return _Step(change * _UNITS, new_correction, response, by_prior, float(remainder @ remainder) / _FREEDOM)


def _prior_rows(prior: TirePrior | None, unknowns: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return rows for the changes of the unknowns in their units, and what they should be."""
    weak = np.eye(len(U)) / _WEAK
    bending = np.zeros(len(U))
    bending[U.BENDING_DAMPING] = _UNITS[U.BENDING_DAMPING] / (_BENDING_LOSS * max(abs(float(unknowns[U.BS])), 1e-6))
    rows = [weak, bending[np.newaxis]]
    targets = [np.zeros(len(U)), -bending @ (unknowns / _UNITS)[:, np.newaxis]]
    if prior is not None:
        rows, targets = rows[:1], targets[:1]
        units = _UNITS[list(LASTING)]
        scaled = prior.covariance / np.outer(units, units)
        # The ridge keeps a covariance of rounded numbers positive.
        factor = np.linalg.cholesky(scaled + np.eye(len(LASTING)) * 1e-12 * np.trace(scaled))
        whitened = np.linalg.inv(factor)
        root = np.zeros((len(LASTING), len(U)))
        root[:, list(LASTING)] = whitened
        rows.append(root)
        targets.append(whitened @ ((prior.mean - unknowns[list(LASTING)]) / units))
    return np.concatenate(rows), np.concatenate(targets)


def _tilt(shape: AsymmetricShape, half_angle_rad: float) -> float:
    """Return the direction of the belt in most of the contact, 0 being that in its middle."""
    return float(np.angle(shape.tangent[level_part(_OTHER_LEVEL_SHARE * half_angle_rad)]).mean())


def _add_correction(orders: FloatArray, correction: FloatArray) -> FloatArray:
    corrected = orders.copy()
    corrected[_CORRECTED] += correction
    return corrected


def _cosine_sine_std(order_std: FloatArray) -> FloatArray:
    return np.tile(order_std[2:ORDER_COUNT], 2)
