"""The sensor saturates below its declared range, unseen by the converter."""

from __future__ import annotations

import math

import numpy as np
from scipy.special import ndtr

from gateway.closure.effects.base import (
    NOWHERE,
    RADIAL,
    Conditions,
    Here,
    Parameter,
    Stage,
    StartModel,
    bare,
)
from gateway.constants import STANDARD_GRAVITY_MPS2
from gateway.types import FloatArray

_ROOT_2PI = math.sqrt(2.0 * math.pi)
# A knee is at least this wide, so that the ends of the clipped part stay differentiable.
_LEAST_KNEE = 1e-4


class Clipping:
    """The radial axis stops at a limit that is the same at all speeds.

    The mean of many revolutions is not cut off sharply: noise, speed within a group and jitter of the contact spread
    the signal about its mean. With a normal spread of standard deviation knee * limit the mean of what is clipped is
    a - [w phi(z) + (a - limit) Phi(z)], w = knee * limit, z = (a - limit) / w; the same below at -limit.
    """

    name = "clipping"
    summary = "The radial axis saturates at a level below its declared range."
    equation = (
        "the radial axis reads no more than the limit, blurred over knee times the limit by what differs from "
        "revolution to revolution"
    )
    # Elements and amplifiers saturate at 10 g and more: below that nobody measures in a tire. Spread: noise and a
    # speed that varies by 3 % within a group.
    parameters: tuple[Parameter, ...] = (
        Parameter(
            "inverse_limit_s2pm", "s^2/m", 0.0, 0.01, 1e-3, 1e-7, inverse_display=(1.0 / STANDARD_GRAVITY_MPS2, "g")
        ),
        Parameter("knee", "", -0.1, 0.1, 0.01, 1e-4, prior_mean=0.01, factor=100.0, display_unit="%", varies=True),
    )
    seen_by = "radial axis, the fastest recordings: overshoot at the contact's edges, then the whole free arc"
    confused_with = (
        "bending and shear flexibility, which round the overshoot at every speed alike; anti-alias filter, which "
        "rounds rises and falls alike"
    )
    already_in: frozenset[StartModel] = NOWHERE
    stage = Stage.ELECTRIC
    axes: tuple[int, ...] = (RADIAL,)
    linear = False

    def starts(self, conditions: tuple[Conditions, ...]) -> tuple[tuple[float, ...], ...]:
        """Return limits from below the free arc of the fastest group to the tip of its overshoot."""
        steady = max((c.radius_m * c.omega_radps**2 for c in conditions), default=0.0)
        if not steady > 0.0:
            return ()
        return tuple((1.0 / (level * steady), 0.01) for level in (0.6, 0.9, 1.1, 1.2, 1.3, 1.4))

    def contribution(self, here: Here, parameters: FloatArray) -> FloatArray:
        """Return what the limit takes away."""
        change = bare(here)
        inverse = float(parameters[0])
        if inverse > 0.0:
            limit, width = self._limit(parameters)
            radial = here.signal_mps2[RADIAL]
            change[RADIAL] = _excess(-radial - limit, width) - _excess(radial - limit, width)
        return change

    def derivative(self, here: Here, parameters: FloatArray) -> FloatArray:
        """Return its derivatives by the inverse limit and by the knee."""
        change = np.zeros((2, *here.signal_mps2.shape))
        inverse, knee = float(parameters[0]), float(parameters[1])
        if inverse > 0.0:
            limit, width = self._limit(parameters)
            radial = here.signal_mps2[RADIAL]
            above, below = (radial - limit) / width, (-radial - limit) / width
            by_limit = _normal_share(above) - _normal_share(below)
            by_width = _normal_density(below) - _normal_density(above)
            change[0, RADIAL] = -limit * limit * (by_limit + by_width * width / limit)
            if abs(knee) > _LEAST_KNEE:
                change[1, RADIAL] = by_width * math.copysign(limit, knee)
        return change

    @staticmethod
    def _limit(parameters: FloatArray) -> tuple[float, float]:
        limit = 1.0 / float(parameters[0])
        return limit, max(abs(float(parameters[1])), _LEAST_KNEE) * limit


def _excess(over: FloatArray, width: float) -> FloatArray:
    """Return the mean of max(x, 0) of a normal x of mean `over` and standard deviation `width`."""
    z = over / width
    result: FloatArray = width * _normal_density(z) + over * _normal_share(z)
    return result


def _normal_density(z: FloatArray) -> FloatArray:
    result: FloatArray = np.exp(-0.5 * z * z) / _ROOT_2PI
    return result


def _normal_share(z: FloatArray) -> FloatArray:
    result: FloatArray = ndtr(z)
    return result


EFFECT = Clipping()
