"""Estimator of speed, rotation and contact length from timing and contact edges; needs only the belt radius."""

import math
from typing import Final

from gateway.core.estimates.estimator import OF_LOSS, Estimate, Revolution, Status, TireConditions, estimate_of
from gateway.core.estimates.reasons import EstimateCode
from gateway.core.estimates.revolution_block import BlockEstimator, RevolutionBlock
from gateway.core.reasons import Reason

NAMES: Final = (
    "speed_mps",
    "angular_speed_radps",
    "rotation_rpm",
    "leading_edge_rad",
    "trailing_edge_rad",
    "contact_length_m",
    "contact_fraction",
)

_RPM_PER_RADPS: Final = 30.0 / math.pi
_TURN_RAD: Final = 2.0 * math.pi

CENTRE_STD_RAD: Final = 0.008
"""Standard error of the contact's centre, common to both edges.

A belt that loses energy in bending bends late, which moves the whole waveform against the contact. The waveform does
not show it. A loss factor of 0.1 moves order n by 0.1 / n, and the edges are of order 12 or so.
docs/evidence/independent-tire.md has a belt with twice this loss.
"""


class KinematicEstimator(BlockEstimator):
    """Speed, rotation, both contact edges and contact length of each single revolution.

    Gives speed_mps, angular_speed_radps, rotation_rpm, both edges, contact_length_m and contact_fraction.

    Contact length is the material length R (trailing - leading). Its fraction of the circumference needs neither
    radius nor rate.

    The standard errors of speed and contact length have two parts. The error of the belt radius, which is constant,
    scales both alike: relative differences between revolutions are more accurate than the stated error. The other
    part is the timing of the two contacts for the speed, and the contact edges for the length. Angular
    speed and revolutions per minute have the errors of the timing and of the sampling rate, which is constant.
    Each edge has the error of the contact's centre too, which does not change the length.
    """

    name = "kinematic"

    def update_block(self, block: RevolutionBlock) -> list[tuple[Estimate, ...]]:
        """Return the estimates of every revolution."""
        return list(map(_estimates, block.revolutions, block.conditions))


def _estimates(revolution: Revolution, conditions: TireConditions) -> tuple[Estimate, ...]:
    radius = conditions.radius_m
    leading, trailing = revolution.leading_edge_rad, revolution.trailing_edge_rad
    leading_std, trailing_std = revolution.leading_edge_std_rad, revolution.trailing_edge_std_rad
    status, reasons = edge_condition(revolution)
    timing_condition = _timing_condition(revolution, status, reasons)
    radius_error = conditions.radius_std_m / radius if radius > 0.0 else math.nan
    speed = radius * revolution.omega_radps
    timing_error = math.hypot(revolution.period_std_s / revolution.period_s, conditions.claims.rate_std)
    speed_std = speed * math.hypot(timing_error, radius_error)
    omega_std = revolution.omega_radps * timing_error
    rpm, rpm_std = revolution.omega_radps * _RPM_PER_RADPS, omega_std * _RPM_PER_RADPS
    timing_scatter = revolution.period_std_s / revolution.period_s
    # The definition of both edges may be wrong in the same direction: their errors add.
    angle, angle_std = trailing - leading, leading_std + trailing_std
    length = radius * angle
    length_std = math.hypot(radius * angle_std, length * radius_error)
    fraction, fraction_std = angle / _TURN_RAD, angle_std / _TURN_RAD
    leading_std, trailing_std = math.hypot(leading_std, CENTRE_STD_RAD), math.hypot(trailing_std, CENTRE_STD_RAD)
    omega = revolution.omega_radps
    rows = (
        (NAMES[0], speed, speed_std, *timing_condition, speed * timing_scatter),
        (NAMES[1], omega, omega_std, *timing_condition, omega * timing_scatter),
        (NAMES[2], rpm, rpm_std, *timing_condition, rpm * timing_scatter),
        (NAMES[3], leading, leading_std, status, reasons, 0.0),
        (NAMES[4], trailing, trailing_std, status, reasons, 0.0),
        (NAMES[5], length, length_std, status, reasons, 0.0),
        (NAMES[6], fraction, fraction_std, status, reasons, 0.0),
    )
    # A sum is finite where all of it is.
    if math.isfinite(rpm + speed + length + angle + timing_scatter):
        return tuple(map(estimate_of, rows))
    return tuple(_checked_estimate(*row) for row in rows)


def _checked_estimate(
    name: str, value: float, std: float, status: Status, reasons: tuple[Reason, ...], scatter_std: float
) -> Estimate:
    """Return an estimate, invalid where its value is not finite."""
    if not math.isfinite(value):
        return Estimate.invalid(name, *(reasons or (Reason(EstimateCode.NO_CONTACT_EDGES),)))
    return Estimate(name, value, std, status, reasons, scatter_std if math.isfinite(scatter_std) else 0.0)


def _timing_condition(
    revolution: Revolution, status: Status, reasons: tuple[Reason, ...]
) -> tuple[Status, tuple[Reason, ...]]:
    """Return the status of the timing: lost samples do not lower it, and a placed contact has an error of its own."""
    if _is_loss_alone(revolution):
        return Status.VALID, tuple(
            fault for fault in revolution.faults if fault.code is EstimateCode.CONTACT_INTERPOLATED
        )
    return status, reasons


def edge_condition(revolution: Revolution) -> tuple[Status, tuple[Reason, ...]]:
    """Return the status of a revolution's contact edges, with the reasons.

    Loss does not lower it: where it took the contact, there are no edges, or those of an earlier one with an error for
    it.
    """
    if not (revolution.faults or revolution.saturated):
        return Status.VALID, ()
    has_edges = math.isfinite(revolution.trailing_edge_rad - revolution.leading_edge_rad)
    if has_edges and _is_loss_alone(revolution):
        return Status.VALID, tuple(fault for fault in revolution.faults if fault.code is not EstimateCode.SAMPLES_LOST)
    reasons = list(revolution.faults)
    if revolution.saturated:
        reasons.append(Reason(EstimateCode.RADIAL_SATURATED))
    return Status.PROVISIONAL, tuple(dict.fromkeys(reasons))


def _is_loss_alone(revolution: Revolution) -> bool:
    return not revolution.saturated and all(fault.code in OF_LOSS for fault in revolution.faults)
