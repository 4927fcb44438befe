"""Estimator of the friction that a tire uses, and of the share of its contact that slides, by the brush model.

The friction used is horizontal over vertical force; it needs no model. The limit is not measured. But as slip grows,
sliding spreads from the trailing edge, and the side force moves forward: its pneumatic trail falls from a third of the
half contact length to zero, whatever the friction is. The trail so gives the sliding share of the contact, which for a
parabolic pressure is slip over the slip at which everything slides. The shape of the pressure is not known, so a
parabola and a nearly uniform pressure bound the share.
"""

import math
from functools import lru_cache
from typing import Final

import numpy as np

from gateway.core.constants import AXIS_NAMES
from gateway.core.estimates.estimator import (
    DETERMINED,
    Estimate,
    Status,
    TireConditions,
    sign_not_determined,
)
from gateway.core.estimates.reasons import EstimateCode
from gateway.core.estimates.revolution_block import RevolutionBlock, RevolutionEstimator
from gateway.core.reasons import Reason
from gateway.core.trust.reasons import TrustCode
from gateway.core.types import FloatArray
from gateway.forces.lateral_shape import LATERAL
from gateway.forces.reasons import ForceCode
from gateway.ring.reasons import RingCode

NAMES: Final = ("friction_used", "sliding_share")

# Exponents n of a contact pressure 1 - |x / a|^n: a parabola, and nearly uniform.
_EXPONENTS: Final = (2.0, 40.0)
# Relative error of a third of the half length as the trail at no slip, over belts that yield (docs).
_TRAIL_STD: Final = 0.15
# Longitudinal over side force from which slip is not lateral.
_LATERAL_SLIP: Final = 0.3
# Largest standard error of a valid share.
_USEFUL_STD: Final = 0.2
# Share that slides where the pressure begins and ends, which the brush on a rigid belt does not have.
_EDGE_STD: Final = 0.05
_POINTS: Final = 400


class FrictionUseEstimator(RevolutionEstimator):
    """Friction used and sliding share, from the forces of earlier estimators.

    Gives friction_used and sliding_share; needs the estimators `longitudinal-force` and `side-force`.
    """

    name = "friction"

    def _estimates(self, block: RevolutionBlock, index: int) -> tuple[Estimate, ...]:
        return _use_estimates(block.conditions[index], block.averages.edges_rad[index])


def _use_estimates(conditions: TireConditions, edges_rad: tuple[float, float]) -> tuple[Estimate, ...]:
    longitudinal = conditions.given.get("longitudinal-force")
    if longitudinal is None:
        missing = Reason(EstimateCode.NEEDS_ESTIMATOR, estimator="longitudinal-force")
        return tuple(Estimate.invalid(name, missing) for name in NAMES)
    pull = longitudinal["longitudinal_ratio"]
    side = _side_ratio(conditions)
    return _friction(pull, side), _sliding(conditions, pull, side, 0.5 * (edges_rad[1] - edges_rad[0]))


def _side_ratio(conditions: TireConditions) -> Estimate:
    """Return side force over load; invalid, with what is missing, where the tire has no usable side force."""
    given, load = conditions.given.get("side-force"), conditions.load_n
    if given is None:
        return Estimate.invalid("side", Reason(EstimateCode.NEEDS_ESTIMATOR, estimator="side-force"))
    if not given:
        return Estimate.invalid("side", Reason(TrustCode.AXIS_MISSING, axis=AXIS_NAMES[LATERAL]))
    force = given["side_force_n"]
    if force.status is Status.INVALID:
        return Estimate.invalid("side", *force.reasons)
    if load is None or not load > 0.0:
        return Estimate.invalid("side", Reason(RingCode.NEEDS_LOAD))
    std = math.hypot(force.std, force.value * conditions.load_std_n / load) / load
    return Estimate("side", force.value / load, std, force.status, force.reasons)


def _friction(pull: Estimate, side: Estimate) -> Estimate:
    if pull.status is Status.INVALID:
        return Estimate.invalid(NAMES[0], *pull.reasons)
    if side.status is Status.INVALID:
        reasons = (Reason(ForceCode.FRICTION_OF_LONGITUDINAL_ONLY), *side.reasons, *pull.reasons)
        return Estimate(NAMES[0], abs(pull.value), pull.std, Status.PROVISIONAL, tuple(dict.fromkeys(reasons)))
    resultant = math.hypot(pull.value, side.value)
    # Near zero the size of a vector has the error of its parts.
    share = (pull.value / resultant) ** 2 if resultant > 0.0 else 0.5
    std = math.sqrt(share * pull.std**2 + (1.0 - share) * side.std**2)
    reasons = tuple(dict.fromkeys((*pull.reasons, *side.reasons)))
    is_valid = pull.status is Status.VALID and side.status is Status.VALID
    return Estimate(NAMES[0], resultant, std, Status.VALID if is_valid else Status.PROVISIONAL, reasons)


def _sliding(conditions: TireConditions, pull: Estimate, side: Estimate, half_angle_rad: float) -> Estimate:
    if side.status is Status.INVALID:
        return Estimate.invalid(NAMES[1], *side.reasons)
    moment = conditions.given["side-force"]["aligning_moment_nm"]
    if moment.status is Status.INVALID:
        return Estimate.invalid(NAMES[1], *moment.reasons)
    assert conditions.load_n is not None
    force, force_std = side.value * conditions.load_n, side.std * conditions.load_n
    if not abs(force) > DETERMINED * force_std:
        return Estimate.invalid(NAMES[1], sign_not_determined(force, force_std))
    if pull.status is not Status.INVALID and abs(pull.value) > _LATERAL_SLIP * abs(side.value) + DETERMINED * pull.std:
        return Estimate.invalid(NAMES[1], Reason(ForceCode.SLIP_NOT_LATERAL, ratio=abs(pull.value / side.value)))
    # A moment that turns the tire against its side force.
    trail = -moment.value / force
    trail_std = math.hypot(moment.std / force, trail * force_std / force)
    full_trail = half_angle_rad * conditions.radius_m / 3.0
    ratio, ratio_std = trail / full_trail, math.hypot(trail_std / full_trail, _TRAIL_STD * trail / full_trail)
    shares = [[share_of_trail(r, n) for n in _EXPONENTS] for r in (ratio + ratio_std, ratio, ratio - ratio_std)]
    value = 0.5 * sum(shares[1])
    by_shape = 0.5 * abs(shares[1][0] - shares[1][1])
    by_trail = 0.25 * (sum(shares[2]) - sum(shares[0]))
    std = math.hypot(by_shape, by_trail, _EDGE_STD)
    worst = sorted(share for pair in shares for share in pair)
    doubt = Reason(ForceCode.SLIP_LIMIT_NOT_DETERMINED, trail_m=trail, std_m=trail_std, low=worst[0], high=worst[-1])
    doubts: tuple[Reason, ...] = (doubt,) if std > _USEFUL_STD else ()
    if side.status is not Status.VALID or moment.status is not Status.VALID:
        doubts = (*doubts, *side.reasons, *moment.reasons)
    doubts = tuple(dict.fromkeys(doubts))
    return Estimate(NAMES[1], value, std, Status.PROVISIONAL if doubts else Status.VALID, doubts)


def share_of_trail(ratio: float, exponent: float) -> float:
    """Return the sliding share of the contact of a trail over that at no slip, for a pressure 1 - |x / a|^exponent."""
    shares, ratios = _brush(exponent)
    return float(np.interp(-ratio, -ratios, shares))


@lru_cache(maxsize=4)
def _brush(exponent: float) -> tuple[FloatArray, FloatArray]:
    """Return sliding shares, rising, and the trail over that at no slip, falling.

    Bristles stick from the leading edge on and deflect in proportion to the distance from it, up to the friction limit,
    from where on they slide (ply steer paper, Eq. 19 and 20, on a rigid belt).
    """
    position = np.linspace(-1.0, 1.0, _POINTS + 1)
    limit = 1.0 - np.abs(position) ** exponent
    shares = np.linspace(0.0, 1.0, _POINTS + 1)
    ratios = np.empty_like(shares)
    for index, share in enumerate(shares):
        if index == 0:
            deflection = 1.0 + position
        else:
            onset = 1.0 - 2.0 * float(share)
            slope = (1.0 - abs(onset) ** exponent) / (1.0 + onset) if onset > -1.0 else math.inf
            deflection = np.where(position < onset, slope * (1.0 + position), limit) if onset > -1.0 else limit
        ratios[index] = 3.0 * float(np.trapezoid(deflection * position) / np.trapezoid(deflection))
    # Numbers of the grid's accuracy may not fall strictly.
    ratios = np.minimum.accumulate(ratios)
    for array in (shares, ratios):
        array.setflags(write=False)
    return shares, ratios
