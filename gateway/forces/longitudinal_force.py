"""Estimator of longitudinal force, axle torque and rolling resistance from the asymmetry of the belt's shape.

The sidewall carries every force between belt and rim. Its deflection follows from the belt's shape but for the belt's
place on the rim and its turn against it, which the balance of the free belt determines (`asymmetric_rows`). Neither
contact pressure, contact shear nor friction is assumed. docs/explanation/forces.md has the derivation, the bounds and
the errors. The circumferential axis adds nothing: on a thin belt it reads the derivative of the radial axis.
"""

import math
from typing import Final

import numpy as np

from gateway.core.contacts.contact_timing import MOST_UNSEEN
from gateway.core.estimates.disagreement import CONTRADICTION
from gateway.core.estimates.estimator import (
    DETERMINED,
    AngleAverage,
    Estimate,
    Revolution,
    Status,
    TireConditions,
    not_used,
)
from gateway.core.estimates.pace import LONGEST, is_due
from gateway.core.estimates.reasons import EstimateCode
from gateway.core.estimates.revolution_block import RevolutionBlock, RevolutionEstimator
from gateway.core.estimates.sensor_claims import CORNER_TOLERANCE, Tilt
from gateway.core.quantity_catalogue import quantity_of
from gateway.core.reasons import CoreCode, Reason
from gateway.core.revolutions.sensor_mounting import HUB_ORDER
from gateway.core.trust.reasons import TrustCode
from gateway.core.types import FloatArray
from gateway.forces.asymmetric_belt import curvature_from_signal
from gateway.forces.asymmetric_rows import Force, U
from gateway.forces.asymmetric_solve import (
    LASTING,
    AsymmetricSolution,
    TirePrior,
    corrected_orders,
    solve_asymmetric,
)
from gateway.forces.lateral_shape import CIRCUMFERENTIAL, LATERAL
from gateway.forces.reasons import ForceCode
from gateway.ring.belt_shape import MAX_ORDER, orders_about
from gateway.ring.determination import doubt_about, positive, unusable
from gateway.ring.order_errors import relative_std, wave_std
from gateway.ring.reasons import RingCode

NAMES: Final = ("longitudinal_force_n", "axle_torque_nm", "longitudinal_ratio", "rolling_resistance", "damping_loss")

# Memory of the forces in revolutions: about two seconds at 65 km/h. A single one is known to a percent of the load.
HORIZON_REVOLUTIONS: Final = 16.0
# Memory of the tire's stiffnesses and losses, which change with temperature and pressure only.
TIRE_HORIZON_REVOLUTIONS: Final = 500.0
# Times as many revolutions as the short mean that the long one needs, to be a prior of its own.
_MIN_MEMORY_RATIO: Final = 2.0
# Rolling resistance of the forces at load number 1.
_RESISTANCE: Final[FloatArray] = np.array([0.0, -1.0, 1.0, 0.0])
# Longest pause between solutions, so that the linear response bridges less than half of the memory.
_MAX_PAUSE: Final = 8
# Change of the forces, in standard errors, after which the balance is solved again.
_CHANGE_STDS: Final = 1.0
# Error of the direction of the road, which the belt's direction in the contact stands for, where the tread is pressed
# unevenly: rolling at 0.7 % resistance and 0.3 of the load in braking tilt the exact ring by this (docs).
_LEVEL_STD_RAD: Final = 2e-4
# A belt that inflation strains by 5e-4 changes force and torque by this share, and rolling resistance by this share of
# the force over the load (docs/explanation/forces.md). The strain of a belt is not known.
_EXTENSION_STD: Final = 0.02
_EXTENSION_LOSS_STD: Final = 0.004
# Force and torque over the load, at a random place of the sensor, by the run-out in m: 0.1 mm makes 1.2 %
# (docs/explanation/forces.md). It is the same in every revolution.
_BY_RUN_OUT: Final = 120.0
# Likewise of rolling resistance and the belt's loss: 0.1 mm makes 0.05 %.
_LOSS_BY_RUN_OUT: Final = 5.0
# Change of force and torque over the load from one revolution to the next where they are not measured: braking by a
# fifth of the load begins within ten.
_CHANGE: Final = 0.02
# Largest standard error of a valid force near zero, over the load: driving at steady speed takes 1 to 5 % of it.
_USEFUL_STD: Final = 0.02
# Largest error of the load of a balance that is solved: its row is one of those that hold.
_LOAD_TOLERANCE: Final = 0.1
# Largest part of the asymmetry that is not of the balance, of a force that is known to a share of itself only: what is
# beyond is of a stone or of water, and its phase is not random.
_LARGEST_UNBALANCED: Final = 0.3


class _Track:
    """A running mean of the orders, and the balance of that mean."""

    def __init__(self, horizon_revolutions: float, longest: int) -> None:
        """Start empty.

        Args:
            horizon_revolutions: memory of the mean.
            longest: longest pause between solutions, in revolutions.
        """
        self._horizon, self._max_pause = horizon_revolutions, longest
        self._mean: FloatArray = np.zeros(2 * MAX_ORDER)
        self._tilted: FloatArray = np.zeros(2 * MAX_ORDER)
        self._count = 0
        self._weight_square = 1.0
        self._solved_at = 0
        self._solved_orders: FloatArray = np.zeros(0)
        self._std: FloatArray = np.zeros(0)
        self._waves: FloatArray = np.zeros(0)
        self.solution: AsymmetricSolution | None = None

    @property
    def effective_count(self) -> float:
        """Number of revolutions of equal weight that would have the same variance."""
        return 1.0 / self._weight_square if self._count else 0.0

    def update(self, orders: FloatArray, tilted: FloatArray | None) -> None:
        """Add a revolution; `tilted` is the part of other axes in its orders, None for none."""
        self._count += 1
        weight = max(1.0 / self._count, 1.0 / self._horizon)
        self._mean = self._mean + weight * (orders - self._mean)
        self._tilted = self._tilted + weight * ((0.0 if tilted is None else tilted) - self._tilted)
        self._weight_square = (1.0 - weight) ** 2 * self._weight_square + weight * weight

    @property
    def is_outdated(self) -> bool:
        """Whether the mean must be solved again."""
        if is_due(self._count) or self._count - self._solved_at >= self._max_pause:
            return True
        # A mean that had no solution is tried again at the same pace.
        if self.solution is None:
            return False
        squares = np.square(self.solution.response @ (corrected_orders(self._mean) - self._solved_orders))
        return bool((squares > _CHANGE_STDS**2 * np.diagonal(self.covariance))[Force.LONGITUDINAL :].any())

    def solve(self, own_std: FloatArray, waves: FloatArray, half_angle_rad: float, prior: TirePrior | None) -> None:
        """Solve the balance of the mean; `own_std` are errors of one revolution's orders, `waves` those of every one.

        Raises:
            numpy.linalg.LinAlgError: the mean describes no belt.
        """
        start = None if self.solution is None else self.solution.unknowns
        self.solution, self._solved_at = None, self._count
        self._std, self._waves = own_std, waves
        solution = solve_asymmetric(self._mean, self._mean_std, half_angle_rad, start, prior)
        load_error = abs(float(solution.forces[Force.LOAD]) - 1.0)
        # Not a number is no load either.
        if not (
            load_error <= _LOAD_TOLERANCE and np.isfinite(solution.forces).all() and (solution.unknowns[:4] > 0.0).all()
        ):
            raise np.linalg.LinAlgError("the balance describes no belt")
        self.solution = solution
        self._solved_orders = corrected_orders(self._mean)

    @property
    def forces(self) -> FloatArray:
        """Forces of the mean at load number 1, (4,); between solutions by the linear response."""
        assert self.solution is not None
        mean_forces: FloatArray = self.solution.forces + self.solution.response @ (
            corrected_orders(self._mean) - self._solved_orders
        )
        return mean_forces

    @property
    def covariance(self) -> FloatArray:
        """Covariance of the forces, (4, 4); what is of other axes is an error as a whole."""
        assert self.solution is not None
        tilted = self.solution.response @ corrected_orders(self._tilted)
        return self.solution.noise(self._mean_std) + self.solution.common() + np.multiply.outer(tilted, tilted)

    @property
    def scatter(self) -> FloatArray:
        """Covariance of the forces by the scatter of the averaged revolutions, (4, 4)."""
        assert self.solution is not None
        return self.solution.noise(self._std * math.sqrt(self._weight_square))

    @property
    def unbalanced(self) -> float:
        """Correction that noise does not explain, over the asymmetric part of the mean."""
        assert self.solution is not None
        sines = corrected_orders(self._mean)[len(self.solution.correction) // 2 :]
        excess = max(1.0 - 1.0 / max(self.solution.misfit, 1.0), 0.0)
        asymmetric = max(float(np.linalg.norm(sines)), 1e-300)
        return math.sqrt(excess) * float(np.linalg.norm(self.solution.correction)) / asymmetric

    def tire(self) -> TirePrior:
        """Return the tire's own unknowns."""
        assert self.solution is not None
        return self.solution.tire(self._mean_std)

    @property
    def _mean_std(self) -> FloatArray:
        """Errors of the mean's orders: waves of the tread repeat every revolution."""
        std: FloatArray = np.hypot(self._std * math.sqrt(self._weight_square), self._waves)
        return std


class LongitudinalForceEstimator(RevolutionEstimator):
    """Force of the road along the direction of travel, torque at the axle, and losses; the load sets the scale.

    Gives longitudinal_force_n, axle_torque_nm, longitudinal_ratio, rolling_resistance and damping_loss.

    The force is that of the road on the tire, positive forward; the torque is positive when it drives. Both are
    means over the latest revolutions. longitudinal_ratio is force over load, and needs no load. rolling_resistance
    is torque / R minus force, over the load; damping_loss is the part of it that the belt's own deformation loses,
    without the tread. Revolutions that are not used leave the forces with the error of what may have changed since, and
    end them after MOST_UNSEEN; the losses are of the tire and stay.
    """

    name = "longitudinal-force"

    def reset(self) -> None:
        """Forget the running means and their solutions."""
        self._recent = _Track(HORIZON_REVOLUTIONS, _MAX_PAUSE)
        self._tire = _Track(TIRE_HORIZON_REVOLUTIONS, LONGEST)
        self._omega_radps = 0.0
        # Revolutions since the latest that was used, and what may have changed of the mean since.
        self._unseen_count, self._change_std = 0, 0.0

    def _estimates(self, block: RevolutionBlock, index: int) -> tuple[Estimate, ...]:
        revolution, conditions = block.revolutions[index], block.conditions[index]
        self._unseen_count += 1
        self._change_std += (_CHANGE * self._unseen_count - self._change_std) / HORIZON_REVOLUTIONS
        if revolution.faults:
            ended = _all_invalid(not_used(revolution.faults))
            if self._recent.solution is None or self._tire.solution is None:
                return ended
            # What is measured without this revolution still is, as of every average.
            held = self._after_solution(revolution, conditions)
            return held if self._unseen_count <= MOST_UNSEEN else (*ended[:3], *held[3:])
        average = block.averages.at(index)
        reason = unusable(average, conditions)
        if reason is None and not positive(revolution.omega_radps):
            reason = Reason(EstimateCode.SPEED_OR_RADIUS_UNKNOWN)
        if reason:
            return _all_invalid(reason)
        edges = average.leading_edge_rad, average.trailing_edge_rad
        max_order = min(MAX_ORDER, revolution.order_max)
        signal = orders_about(revolution.radial_mps2, 0.5 * (edges[0] + edges[1]), max_order)
        if not (np.isfinite(signal).all() and signal[0].real > 0.0):
            return _all_invalid(Reason(CoreCode.NO_STEADY_VALUE))
        curvature = curvature_from_signal(signal, conditions.sensor_offset_m / conditions.radius_m)
        tilted = _tilted(revolution, edges, max_order, float(signal[0].real), conditions.tilt)
        if self._unseen_count > MOST_UNSEEN + 1:
            self._recent = _Track(HORIZON_REVOLUTIONS, _MAX_PAUSE)
        self._unseen_count, self._change_std = 0, 0.0
        self._recent.update(curvature, tilted)
        self._tire.update(curvature, tilted)
        weight = 1.0 / min(self._tire.effective_count, TIRE_HORIZON_REVOLUTIONS)
        self._omega_radps += weight * (revolution.omega_radps - self._omega_radps)
        try:
            self._solve(average, revolution, float(signal[0].real), edges, max_order, conditions.hub_mps2)
        except np.linalg.LinAlgError:
            return _all_invalid(Reason(RingCode.NO_BELT_SHAPE))
        if self._recent.solution is None or self._tire.solution is None:
            return _all_invalid(Reason(RingCode.NO_BELT_SHAPE))
        return self._after_solution(revolution, conditions)

    def _solve(
        self,
        average: AngleAverage,
        revolution: Revolution,
        mean_mps2: float,
        edges_rad: tuple[float, float],
        max_order: int,
        hub_mps2: float,
    ) -> None:
        """Solve the balances that are outdated."""
        outdated = self._tire.is_outdated
        if not (outdated or self._recent.is_outdated):
            return
        relative = np.abs(average.orders_mps2) / mean_mps2
        # The average knows the errors of its orders from its scatter; those of one revolution are larger.
        revolution_std = average.orders_std_mps2 * math.sqrt(average.effective_count)
        std = relative_std(revolution_std, mean_mps2, np.nan_to_num(relative), max_order)
        half_angle_rad = 0.5 * (edges_rad[1] - edges_rad[0])
        signal = orders_about(average.radial_mps2, 0.5 * (edges_rad[0] + edges_rad[1]), max_order)
        waves = wave_std(signal, std / math.sqrt(average.effective_count), max_order)
        waves[HUB_ORDER] = math.hypot(waves[HUB_ORDER], hub_mps2 / mean_mps2)
        if revolution.corner:
            # An order that is turned has its sine from its cosine.
            count = min(len(signal), len(waves))
            corner_std = CORNER_TOLERANCE * revolution.corner / np.arange(1.0, count) * np.abs(signal[1:count])
            waves[1:count] = np.hypot(waves[1:count], corner_std / mean_mps2)
        if outdated:
            self._tire.solve(std, waves, half_angle_rad, None)
        self._recent.solve(std, waves, half_angle_rad, self._prior(revolution.omega_radps))

    def _prior(self, omega_radps: float) -> TirePrior | None:
        """Return the tire from the long mean; None while it hardly is longer than the short one."""
        memory_ratio = self._tire.effective_count / self._recent.effective_count
        if memory_ratio < _MIN_MEMORY_RATIO or self._tire.solution is None:
            return None
        tire = self._tire.tire()
        # The short mean is part of the long one: what is known without it.
        covariance = tire.covariance * (memory_ratio / (memory_ratio - 1.0))
        # Damping of either kind, with the speed or without, at another speed than the mean one.
        change = math.log(omega_radps / self._omega_radps)
        for index in (LASTING.index(U.DAMPING), LASTING.index(U.BENDING_DAMPING)):
            covariance[index, index] += (tire.mean[index] * change) ** 2
        return TirePrior(tire.mean, covariance)

    def _after_solution(self, revolution: Revolution, conditions: TireConditions) -> tuple[Estimate, ...]:
        """Return the estimates."""
        doubts = doubt_about(revolution, self._recent.effective_count, is_linear_ring=conditions.tire.is_linear_ring)
        if revolution.ac_coupled and not revolution.corner:
            doubts = (*doubts, Reason(ForceCode.AC_CORNER_NOT_STATED))
        assert self._recent.solution is not None
        assert self._tire.solution is not None
        forces, covariance = self._recent.forces, self._recent.covariance
        tilt = math.hypot(self._recent.solution.tilt_rad, _LEVEL_STD_RAD)
        run_out = _BY_RUN_OUT * conditions.tire.runout_m
        pull, torque = float(forces[Force.LONGITUDINAL]), float(forces[Force.TORQUE])
        doubts = (*doubts, *_impossible(forces, covariance, tilt, _LOSS_BY_RUN_OUT * conditions.tire.runout_m))
        unbalanced = self._recent.unbalanced
        pull_variance, torque_variance = (
            float(covariance[force, force]) for force in (Force.LONGITUDINAL, Force.TORQUE)
        )
        change = self._change_std
        pull_std = math.hypot(math.sqrt(pull_variance), tilt, _EXTENSION_STD * pull, run_out, change)
        torque_std = math.hypot(math.sqrt(torque_variance), _EXTENSION_STD * torque, run_out, change)
        scatter = self._recent.scatter
        pull_scatter, torque_scatter = (
            math.hypot(_root(scatter[force, force]), change) for force in (Force.LONGITUDINAL, Force.TORQUE)
        )
        ratio = _signed(NAMES[2], pull, pull_std, pull_scatter, 1.0, doubts, unbalanced)
        losses = self._losses(doubts, _LOSS_BY_RUN_OUT * conditions.tire.runout_m)
        load = conditions.load_n
        if load is None or not positive(load):
            missing = Reason(RingCode.NEEDS_LOAD)
            return (Estimate.invalid(NAMES[0], missing), Estimate.invalid(NAMES[1], missing), ratio, *losses)
        relative = conditions.load_std_n / load
        lever = load * conditions.radius_m
        lever_relative = math.hypot(relative, conditions.radius_std_m / conditions.radius_m)
        return (
            _signed(
                NAMES[0],
                load * pull,
                load * math.hypot(pull_std, pull * relative),
                load * pull_scatter,
                load,
                doubts,
                unbalanced,
            ),
            _signed(
                NAMES[1],
                lever * torque,
                lever * math.hypot(torque_std, torque * lever_relative),
                lever * torque_scatter,
                lever,
                doubts,
                unbalanced,
            ),
            ratio,
            *losses,
        )

    def _losses(self, doubts: tuple[Reason, ...], run_out: float) -> tuple[Estimate, Estimate]:
        """Return rolling resistance and the belt's part of it, from the long mean."""
        assert self._tire.solution is not None
        forces, covariance = self._tire.forces, self._tire.covariance
        tilt = math.hypot(self._tire.solution.tilt_rad, _LEVEL_STD_RAD)
        resistance, std = _resistance(forces, covariance, tilt, run_out)
        scatter = self._tire.scatter
        rolling = _positive(NAMES[3], resistance, std, _root(float(_RESISTANCE @ scatter @ _RESISTANCE)), doubts)
        undetermined = next((reason for reason in rolling.reasons if reason.code is CoreCode.NOT_DETERMINED), None)
        return (
            # A difference of numbers some hundred times as large: below three errors it may be the road's direction.
            rolling if undetermined is None else Estimate.invalid(NAMES[3], undetermined),
            _positive(
                NAMES[4],
                float(forces[Force.LOSS]),
                math.hypot(_root(float(covariance[Force.LOSS, Force.LOSS])), run_out),
                _root(scatter[Force.LOSS, Force.LOSS]),
                doubts,
            ),
        )


def _tilted(
    revolution: Revolution, edges_rad: tuple[float, float], max_order: int, mean_mps2: float, tilt: Tilt
) -> FloatArray | None:
    """Return the orders (2 MAX_ORDER,) that the radial axis of a tilted sensor has of the others; None without a tilt.

    Ply steer makes the lateral axis antisymmetric about the contact, as a longitudinal force does the radial one.
    """
    parts = [
        -angle_rad * axis_mps2
        for angle_rad, axis_mps2 in zip(tilt[:2], revolution.axes_mps2[[LATERAL, CIRCUMFERENTIAL]], strict=True)
        if angle_rad and math.isfinite(axis_mps2[0])
    ]
    if not parts:
        return None
    orders = orders_about(sum(parts[1:], parts[0]), 0.5 * (edges_rad[0] + edges_rad[1]), max_order)[1:] / mean_mps2
    result: FloatArray = np.concatenate([orders.real, -orders.imag])
    return result


def _resistance(forces: FloatArray, covariance: FloatArray, tilt_rad: float, run_out: float) -> tuple[float, float]:
    """Return rolling resistance over the load, and its standard error."""
    extension = _EXTENSION_LOSS_STD * float(forces[Force.LONGITUDINAL])
    std = math.hypot(_root(float(_RESISTANCE @ covariance @ _RESISTANCE)), tilt_rad, extension, run_out)
    return float(_RESISTANCE @ forces), std


def _impossible(forces: FloatArray, covariance: FloatArray, tilt_rad: float, run_out: float) -> tuple[Reason, ...]:
    """Return why no rolling tire has these forces; empty where one may.

    Force and torque are bounded by friction, and a tire loses energy. What repeats with the wheel and is no force, as
    run-out, makes an asymmetry of either sign of loss.
    """
    pull, torque, loss = (float(forces[force]) for force in (Force.LONGITUDINAL, Force.TORQUE, Force.LOSS))
    reasons = []
    if max(abs(pull), abs(torque)) > quantity_of(NAMES[2]).possible[1]:
        reasons.append(Reason(ForceCode.BEYOND_FRICTION, force=pull, torque=torque))
    loss_std = math.hypot(_root(float(covariance[Force.LOSS, Force.LOSS])), _EXTENSION_LOSS_STD * pull, run_out)
    losses = (_resistance(forces, covariance, tilt_rad, run_out), (loss, loss_std))
    value, std = min(losses, key=lambda pair: pair[0] + CONTRADICTION * pair[1])
    if value < -CONTRADICTION * std:
        reasons.append(Reason(ForceCode.TIRE_GIVES_ENERGY, share=-value, std=std))
    return tuple(reasons)


def _root(variance: float) -> float:
    return math.sqrt(max(variance, 0.0))


def _signed(
    name: str,
    value: float,
    std: float,
    scatter_std: float,
    unit: float,
    doubts: tuple[Reason, ...],
    unbalanced: float,
) -> Estimate:
    """Return a force, valid where known to a share of the load, or to a third of itself by a balance that holds."""
    if not (math.isfinite(value) and math.isfinite(std)):
        return Estimate.invalid(name, Reason(TrustCode.NOT_FINITE))
    if std > max(_USEFUL_STD * unit, abs(value) / DETERMINED):
        doubts = (*doubts, Reason(TrustCode.FORCE_NOT_DETERMINED, share=std / unit, limit=_USEFUL_STD))
    elif std > _USEFUL_STD * unit and unbalanced > _LARGEST_UNBALANCED:
        doubts = (*doubts, Reason(ForceCode.ASYMMETRY_NOT_BALANCED, share=unbalanced, limit=_LARGEST_UNBALANCED))
    return Estimate(name, value, std, Status.PROVISIONAL if doubts else Status.VALID, doubts, scatter_std)


def _positive(name: str, value: float, std: float, scatter_std: float, doubts: tuple[Reason, ...]) -> Estimate:
    """Return a loss, valid where it is known to a third of itself."""
    if not (math.isfinite(value) and math.isfinite(std)):
        return Estimate.invalid(name, Reason(TrustCode.NOT_FINITE))
    if not value > DETERMINED * std:
        doubts = (*doubts, Reason(CoreCode.NOT_DETERMINED, relative_error=abs(std / value) if value else math.inf))
    return Estimate(name, value, std, Status.PROVISIONAL if doubts else Status.VALID, doubts, scatter_std)


def _all_invalid(reason: Reason) -> tuple[Estimate, ...]:
    return tuple(Estimate.invalid(name, reason) for name in NAMES)
