"""Estimator of longitudinal force, axle torque and rolling resistance from the asymmetry of the belt's shape.

The sidewall carries every force between belt and rim. Its deflection follows from the belt's shape but for the belt's
place on the rim and its turn against it, which the balance of the free belt determines (`asymmetric_rows`). Neither
contact pressure, contact shear nor friction is assumed. docs/explanation/forces.md has the derivation, the bounds and
the errors. The circumferential axis adds nothing: on a thin belt it reads the derivative of the radial axis.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from gateway.estimators.asymmetric_rows import Force
from gateway.estimators.asymmetric_solve import AsymmetricSolution, corrected_orders, solve_asymmetric
from gateway.estimators.determination import DETERMINED, doubt_about, positive, unusable
from gateway.estimators.estimator import AngleAverage, Estimate, Revolution, Status, TireConditions, not_used
from gateway.estimators.order_errors import relative_std
from gateway.estimators.pace import is_due
from gateway.estimators.revolution_block import RevolutionBlock, one_revolution
from gateway.physics.asymmetric_belt import curvature_from_signal
from gateway.physics.belt_shape import MAX_ORDER, orders_about
from gateway.reasons import Code, Reason
from gateway.types import ComplexArray, FloatArray

NAMES: Final = ("longitudinal_force_n", "axle_torque_nm", "longitudinal_ratio", "rolling_resistance", "damping_loss")

# Memory of the forces in revolutions: about two seconds at 65 km/h. A single one is known to a percent of the load.
HORIZON_REVOLUTIONS: Final = 16.0
# Memory of the losses, which change with temperature and pressure only.
LOSS_HORIZON_REVOLUTIONS: Final = 500.0
# Longest pause between solutions, so that the linear response bridges less than half of the memory.
_LONGEST: Final = 8
# Change of the forces, in standard errors, after which the balance is solved again.
_MOVED: Final = 1.0
# Error of the direction of the road, which the belt's direction in the contact stands for, where the tread is pressed
# unevenly: rolling at 0.7 % resistance and 0.3 of the load in braking tilt the exact ring by this (docs).
_LEVEL_STD_RAD: Final = 2e-4
# A belt that inflation strains by 5e-4 changes force and torque by this share, and rolling resistance by this share of
# the force over the load (docs/explanation/forces.md). The strain of a belt is not known.
_EXTENSION_STD: Final = 0.02
_EXTENSION_LOSS_STD: Final = 0.004
# Largest standard error of a valid force near zero, over the load: driving at steady speed takes 1 to 5 % of it.
_USEFUL_STD: Final = 0.02


@dataclass(frozen=True, slots=True)
class _Renewed:
    """The latest solution and what the forces since then rest on.

    Attributes:
        solution: of the running mean.
        orders: (118,) of the mean then.
        count: revolutions averaged then.
        covariance: (4, 4) of one revolution's forces by errors of its orders and model error.
        common: (4, 4) likewise without the errors of its orders: what averaging does not reduce.
    """

    solution: AsymmetricSolution
    orders: FloatArray
    count: int
    covariance: FloatArray
    common: FloatArray


@dataclass(slots=True)
class _Mean:
    """Running mean with the sum of its squared weights."""

    horizon: float
    value: FloatArray
    count: int = 0
    weight_square: float = 1.0

    def update(self, value: FloatArray) -> None:
        """Add a value."""
        self.count += 1
        weight = max(1.0 / self.count, 1.0 / self.horizon)
        self.value = self.value + weight * (value - self.value)
        self.weight_square = (1.0 - weight) ** 2 * self.weight_square + weight * weight


class LongitudinalForceEstimator:
    """Force of the road along the direction of travel, torque at the axle, and losses; the load sets the scale."""

    def __init__(self) -> None:
        """Start cold."""
        self.reset()

    @property
    def name(self) -> str:
        """Name in the registry."""
        return "longitudinal-force"

    def reset(self) -> None:
        """Forget the running means and the warm start."""
        self._orders = _Mean(HORIZON_REVOLUTIONS, np.zeros(2 * MAX_ORDER))
        self._losses = _Mean(LOSS_HORIZON_REVOLUTIONS, np.zeros(2))
        self._renewed: _Renewed | None = None

    def update(self, revolution: Revolution, average: AngleAverage, conditions: TireConditions) -> tuple[Estimate, ...]:
        """Return longitudinal_force_n, axle_torque_nm, longitudinal_ratio, rolling_resistance and damping_loss.

        The force is that of the road on the tire, positive forward; the torque is positive when it drives. Both are
        means over the latest revolutions. longitudinal_ratio is force over load, and needs no load. rolling_resistance
        is torque / R minus force, over the load; damping_loss is the part of it that the belt's own deformation loses,
        without the tread. Never raises on values.
        """
        return self.update_block(one_revolution(revolution, average, conditions))[0]

    def update_block(self, block: RevolutionBlock) -> list[tuple[Estimate, ...]]:
        """Return the estimates of every revolution."""
        return [self._estimates(block, index) for index in range(len(block))]

    def _estimates(self, block: RevolutionBlock, index: int) -> tuple[Estimate, ...]:
        revolution, conditions = block.revolutions[index], block.conditions[index]
        if revolution.faults:
            return _all_invalid(not_used(revolution.faults))
        average = block.averages.at(index)
        reason = unusable(average, conditions)
        if reason:
            return _all_invalid(reason)
        edges = average.leading_edge_rad, average.trailing_edge_rad
        max_order = min(MAX_ORDER, revolution.order_max)
        signal = orders_about(revolution.radial_mps2, 0.5 * (edges[0] + edges[1]), max_order)
        if not (np.isfinite(signal).all() and signal[0].real > 0.0):
            return _all_invalid(Reason(Code.NO_STEADY_VALUE))
        own = curvature_from_signal(signal, conditions.sensor_offset_m / conditions.radius_m)
        self._orders.update(own)
        renewed = self._renewed
        if renewed is None or self._is_outdated(renewed):
            try:
                renewed = self._renewed = self._renew(average, signal, 0.5 * (edges[1] - edges[0]), max_order)
            except np.linalg.LinAlgError:
                self._renewed = None
                return _all_invalid(Reason(Code.NO_BELT_SHAPE))
        moved = corrected_orders(self._orders.value) - renewed.orders
        forces = renewed.solution.forces + renewed.solution.response @ moved
        single = renewed.solution.forces + renewed.solution.response @ (corrected_orders(own) - renewed.orders)
        self._losses.update(np.array([single[Force.TORQUE] - single[Force.LONGITUDINAL], single[Force.LOSS]]))
        return self._found(revolution, conditions, forces, renewed)

    def _is_outdated(self, renewed: _Renewed) -> bool:
        count = self._orders.count
        if is_due(count) or count - renewed.count >= _LONGEST:
            return True
        moved = corrected_orders(self._orders.value) - renewed.orders
        variance = np.diagonal(renewed.covariance) * self._orders.weight_square + np.diagonal(renewed.common)
        return bool((np.square(renewed.solution.response @ moved) > _MOVED**2 * variance)[:3].any())

    def _renew(self, average: AngleAverage, signal: ComplexArray, half_angle_rad: float, max_order: int) -> _Renewed:
        orders = self._orders.value
        sizes = np.concatenate([[1.0], np.hypot(orders[:MAX_ORDER], orders[MAX_ORDER:])])
        # The average knows the errors of its orders from its scatter; those of one revolution are larger.
        own_std = average.orders_std_mps2 * math.sqrt(average.effective_count)
        std = relative_std(own_std, float(signal[0].real), sizes, max_order)
        start = None if self._renewed is None else self._renewed.solution.unknowns
        mean_std = std * math.sqrt(self._orders.weight_square)
        solution = solve_asymmetric(orders, mean_std, half_angle_rad, start)
        if not (np.isfinite(solution.forces).all() and (solution.unknowns[:4] > 0.0).all()):
            raise np.linalg.LinAlgError("the balance describes no belt")
        common = solution.covariance(np.zeros_like(std))
        covariance = solution.covariance(std) - common
        return _Renewed(solution, corrected_orders(orders), self._orders.count, covariance, common)

    def _found(
        self, revolution: Revolution, conditions: TireConditions, forces: FloatArray, renewed: _Renewed
    ) -> tuple[Estimate, ...]:
        """Return the estimates from forces at load number 1."""
        covariance = renewed.covariance * self._orders.weight_square + renewed.common
        tilt = math.hypot(0.5 * renewed.solution.tilt_rad, _LEVEL_STD_RAD)
        pull, torque = float(forces[Force.LONGITUDINAL]), float(forces[Force.TORQUE])
        pull_std = math.hypot(math.sqrt(covariance[1, 1]), tilt, _EXTENSION_STD * pull)
        torque_std = math.hypot(math.sqrt(covariance[2, 2]), _EXTENSION_STD * torque)
        doubts = doubt_about(revolution, 1.0 / self._orders.weight_square)
        ratio = _signed(NAMES[2], pull, pull_std, 1.0, doubts)
        resistance, loss = self._losses.value.tolist()
        difference = np.array([0.0, -1.0, 1.0, 0.0])
        share = self._losses.weight_square
        common = math.hypot(
            math.sqrt(max(float(difference @ renewed.common @ difference), 0.0)), tilt, _EXTENSION_LOSS_STD * pull
        )
        own = float(difference @ renewed.covariance @ difference)
        resistance_std = math.hypot(math.sqrt(own * share), common)
        loss_std = math.sqrt(renewed.covariance[3, 3] * share + renewed.common[3, 3])
        losses = (
            _positive(NAMES[3], resistance, resistance_std, doubts),
            _positive(NAMES[4], loss, loss_std, doubts),
        )
        load = conditions.load_n
        if not positive(load):
            needs = Reason(Code.NEEDS_LOAD)
            return (Estimate.invalid(NAMES[0], needs), Estimate.invalid(NAMES[1], needs), ratio, *losses)
        assert load is not None
        relative = conditions.load_std_n / load
        lever = load * conditions.radius_m
        lever_relative = math.hypot(relative, conditions.radius_std_m / conditions.radius_m)
        return (
            _signed(NAMES[0], load * pull, load * math.hypot(pull_std, pull * relative), load, doubts),
            _signed(NAMES[1], lever * torque, lever * math.hypot(torque_std, torque * lever_relative), lever, doubts),
            ratio,
            *losses,
        )


def _signed(name: str, value: float, std: float, unit: float, doubts: tuple[Reason, ...]) -> Estimate:
    """Return a force, valid where it is known to a share of the load, or to a third of itself."""
    if not (math.isfinite(value) and math.isfinite(std)):
        return Estimate.invalid(name, Reason(Code.NOT_FINITE))
    if std > max(_USEFUL_STD * unit, abs(value) / DETERMINED):
        doubts = (*doubts, Reason(Code.FORCE_NOT_DETERMINED, share=std / unit, limit=_USEFUL_STD))
    return Estimate(name, value, std, Status.PROVISIONAL if doubts else Status.VALID, doubts)


def _positive(name: str, value: float, std: float, doubts: tuple[Reason, ...]) -> Estimate:
    """Return a loss, valid where it is known to a third of itself."""
    if not (math.isfinite(value) and math.isfinite(std)):
        return Estimate.invalid(name, Reason(Code.NOT_FINITE))
    if not value > DETERMINED * std:
        doubts = (*doubts, Reason(Code.NOT_DETERMINED, relative_error=abs(std / value) if value else math.inf))
    return Estimate(name, value, std, Status.PROVISIONAL if doubts else Status.VALID, doubts)


def _all_invalid(reason: Reason) -> tuple[Estimate, ...]:
    return tuple(Estimate.invalid(name, reason) for name in NAMES)
