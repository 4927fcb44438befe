"""Estimator of the ply steer angle: the slope of the streamline in the contact, in four definitions, and of conicity.

Conicity displaces the belt evenly about the contact centre, so it adds nothing to the line through the whole contact.
This line alone decides the sign of the ply steer. The other definitions contain conicity. docs/explanation/ply-steer.md
has the meaning of the angles, their errors and their limits.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from gateway.constants import STANDARD_GRAVITY_MPS2
from gateway.estimators.determination import SETTLED_REVOLUTIONS
from gateway.estimators.estimator import AngleAverage, Estimate, Revolution, Status, TireConditions
from gateway.estimators.lateral_shape import (
    CIRCUMFERENTIAL,
    DEFINITIONS,
    ORDERS,
    LateralAverage,
    LateralRecord,
    contact_edges,
    edge_errors,
    has_lateral,
    slopes,
    why_unusable,
)
from gateway.reasons import Code, Reason
from gateway.signal.sensor_mounting import MOUNTING_STD_RAD, OFFSET_STD_MPS2, RollCalibration
from gateway.types import FloatArray

NAMES: Final = tuple(f"ply_steer_{definition}_rad" for definition in DEFINITIONS)
# Of a fixed part of the contact, so that it has its own sign.
_OWN_SIGN: Final = frozenset({"ply_steer_first_half_rad"})
LINE_NAME: Final = "ply_steer_contact_line_rad"
CONICITY_NAME: Final = "conicity_slope_rad"
ROLL_NAME: Final = "sensor_roll_rad"

# Memory of the average: ply steer changes only with load, pressure and temperature.
HORIZON_REVOLUTIONS: Final = 100.0
# Standard errors from zero beyond which a sign is reported.
_SIGNIFICANT: Final = 3.0
# Ply steer's share of the difference between second and first half of a rolling contact, over the contact line and the
# square of the half angle, and its standard deviation over belts and treads (docs/explanation/ply-steer.md).
_ROLLING_DIFFERENCE: Final = 2.9
_ROLLING_DIFFERENCE_STD: Final = 1.4
# Least number of orders: with fewer the peak is wrong by more than 0.01 deg.
ENOUGH_ORDERS: Final = 20


class Separated(NamedTuple):
    """Ply steer and conicity, separated by rolling both ways.

    Attributes:
        plysteer: part that changes sign with the direction of rotation, as when rolling forward.
        conicity: part that does not.
        std: one standard error of either.
    """

    plysteer: FloatArray
    conicity: FloatArray
    std: FloatArray


def separate_plysteer_conicity(
    forward: ArrayLike, reverse: ArrayLike, forward_std: ArrayLike = 0.0, reverse_std: ArrayLike = 0.0
) -> Separated:
    """Separate ply steer and conicity by the same quantity rolling forward and in reverse.

    Quantities are first-half slopes, side forces or whole deformations over the angle in the direction of travel. Peak
    and adhesion line do not work, because they lie at another place on every shape. The lateral axis must be fixed to
    the tire: the car is driven backwards. If the tire is turned on the rim instead, the roles are swapped: conicity is
    what changes sign on the vehicle's axis.

    Args:
        forward: rolling forward, any shape.
        reverse: rolling in reverse, same shape.
        forward_std: standard error of `forward`.
        reverse_std: standard error of `reverse`.
    """
    ahead, back = np.asarray(forward, dtype=np.float64), np.asarray(reverse, dtype=np.float64)
    std = 0.5 * np.hypot(np.asarray(forward_std, dtype=np.float64), np.asarray(reverse_std, dtype=np.float64))
    return Separated(0.5 * (ahead - back), 0.5 * (ahead + back), std)


class PlySteerEstimator:
    """Ply steer angle of the running average; no estimates when the sensor has no lateral axis."""

    def __init__(
        self, offset_std_mps2: float = OFFSET_STD_MPS2, horizon_revolutions: float = HORIZON_REVOLUTIONS
    ) -> None:
        """Start empty.

        Args:
            offset_std_mps2: one standard error of the constant in the lateral mean (zero-g offset, camber).
            horizon_revolutions: memory of the average.
        """
        self._average = LateralAverage(horizon_revolutions, RollCalibration(offset_std_mps2))

    @property
    def name(self) -> str:
        """Name in the registry."""
        return "ply-steer"

    def reset(self) -> None:
        """Forget the average and the roll calibration."""
        self._average.reset()
        self._average.roll.reset()

    def update(self, revolution: Revolution, average: AngleAverage, conditions: TireConditions) -> tuple[Estimate, ...]:
        """Return the estimates of NAMES, ply_steer_contact_line_rad, conicity_slope_rad and sensor_roll_rad.

        All ply steer angles include the mean slip angle of the averaged revolutions; those of NAMES also include
        conicity, and a reason says so. Peak and adhesion line take their sign from the contact line; they are invalid
        where its sign is not significant. conicity_slope_rad is half the change of the slope from the first to the
        second half of the contact, less what ply steer contributes to it in a rolling contact. The standard errors
        cover scatter, roll calibration, a mounting yaw of 1 deg and the contact edges, but not the definition of the
        slope, in which the angles differ. Never raises on values.
        """
        if not has_lateral(revolution):
            return ()
        unusable = why_unusable(revolution)
        if unusable is None:
            self._average.update(revolution)
        edges = contact_edges(average, conditions)
        if isinstance(edges, Reason):
            return _all_invalid(unusable or edges)
        if not self._average.effective_count:
            return _all_invalid(unusable or Reason(Code.NO_REVOLUTION_YET))
        record = self._average.record()
        found = slopes(record, edges, conditions.radius_m)
        roll = self._average.roll
        rows = np.concatenate([found.rows, found.parity_rows])
        variance = np.sum((rows @ record.covariance) * rows, axis=1)
        # The place of the peak is the largest of several places: their noise counts once more.
        variance[0] *= 2.0
        variance += np.square(rows @ record.radial_m * roll.roll_std_rad)
        variance += np.square(rows @ _along(record, revolution, conditions) * MOUNTING_STD_RAD)
        # The slopes scale with the lateral axis's gain over the radius.
        scale_std = math.hypot(conditions.gain_std, conditions.radius_std_m / conditions.radius_m)
        variance += np.square(rows @ record.lateral_m * scale_std)
        edges_std = (average.leading_edge_std_rad, average.trailing_edge_std_rad)
        variance += np.square(edge_errors(record, found, edges, edges_std, conditions.radius_m))
        doubt = unusable or self._doubt(record.order_max)
        orders = Reason(Code.ORDERS_USED, first=ORDERS.start, last=record.order_max)
        stds = np.sqrt(variance)
        line, difference = found.parity_rad.tolist()
        line_std, difference_std = stds[len(NAMES) :].tolist()
        estimates = [
            _estimate(name, float(value), float(std), doubt, (Reason(Code.INCLUDES_CONICITY), orders))
            for name, value, std in zip(NAMES, found.values_rad, stds, strict=False)
        ]
        if not abs(line) > _SIGNIFICANT * line_std:
            chance = Reason(Code.SIGN_NOT_DETERMINED, errors=abs(line) / line_std if line_std > 0.0 else math.nan)
            estimates = [
                e if name in _OWN_SIGN else Estimate.invalid(name, chance)
                for name, e in zip(NAMES, estimates, strict=True)
            ]
        estimates.append(_estimate(LINE_NAME, line, line_std, doubt, (orders,)))
        estimates.append(_conicity(line, difference, (line_std, difference_std), edges, doubt))
        return (*estimates, _roll_estimate(roll))

    def _doubt(self, order_max: int) -> Reason | None:
        """Return why the angle is provisional; None when it is not."""
        count = self._average.effective_count
        if count < SETTLED_REVOLUTIONS:
            return Reason(Code.NOT_SETTLED, revolutions=count, needed=SETTLED_REVOLUTIONS)
        if order_max < ENOUGH_ORDERS:
            return Reason(Code.TOO_FEW_ORDERS, orders=order_max, needed=ENOUGH_ORDERS)
        if not self._average.roll.count:
            return Reason(Code.ROLL_NOT_CALIBRATED, assumed_rad=MOUNTING_STD_RAD)
        return None


def _estimate(name: str, value: float, std: float, doubt: Reason | None, notes: tuple[Reason, ...]) -> Estimate:
    if not (math.isfinite(value) and math.isfinite(std)):
        return Estimate.invalid(name, Reason(Code.NOT_FINITE))
    if doubt is None and not abs(value) > _SIGNIFICANT * std:
        doubt = Reason(Code.NOT_DETERMINED, relative_error=std / abs(value) if value else math.inf)
    if doubt is not None:
        return Estimate(name, value, std, Status.PROVISIONAL, (*notes, doubt))
    return Estimate(name, value, std, Status.VALID, notes)


def _along(record: LateralRecord, revolution: Revolution, conditions: TireConditions) -> FloatArray:
    """Return the coefficients of the circumferential axis over Omega^2, (2 k,) m.

    Without that axis it is -(e / R) ds/dtheta and gravity, which a sensor e below the neutral layer would read.
    """
    if not np.isnan(revolution.axes_mps2[CIRCUMFERENTIAL]).all():
        return record.along_m
    depth = math.hypot(conditions.sensor_offset_m, conditions.sensor_offset_std_m)
    cosine, sine = record.radial_m.reshape(2, -1) * np.asarray(ORDERS)
    result: FloatArray = np.concatenate([-sine, cosine]) * (depth / conditions.radius_m)
    result[len(ORDERS)] += STANDARD_GRAVITY_MPS2 / revolution.omega_radps**2
    return result


def _conicity(
    line_rad: float,
    difference_rad: float,
    stds_rad: tuple[float, float],
    edges_rad: tuple[float, float],
    doubt: Reason | None,
) -> Estimate:
    """Return conicity's part of the change of slope in the contact."""
    square = (0.5 * (edges_rad[1] - edges_rad[0])) ** 2
    value = difference_rad - _ROLLING_DIFFERENCE * square * line_rad
    std = math.hypot(
        stds_rad[1], _ROLLING_DIFFERENCE * square * stds_rad[0], _ROLLING_DIFFERENCE_STD * square * line_rad
    )
    if doubt is None and not abs(value) > _SIGNIFICANT * std:
        doubt = Reason(Code.CONICITY_NOT_SEPARATED)
    return _estimate(CONICITY_NAME, value, std, doubt, ())


def _roll_estimate(roll: RollCalibration) -> Estimate:
    if not roll.count:
        return Estimate.invalid(ROLL_NAME, Reason(Code.AC_COUPLED))
    return Estimate(ROLL_NAME, roll.roll_rad, roll.roll_std_rad, Status.VALID, (Reason(Code.FROM_AXIS_MEANS),))


def _all_invalid(reason: Reason) -> tuple[Estimate, ...]:
    return tuple(Estimate.invalid(name, reason) for name in (*NAMES, LINE_NAME, CONICITY_NAME, ROLL_NAME))
