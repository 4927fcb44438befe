"""Normalisation of one revolution of the radial axis: gravity and the change of speed are removed.

A DC-coupled inner-liner sensor reads s = V^2 kappa + g cos(psi), positive inward, where psi is the angle of the belt's
normal from the vertical, kappa the belt's curvature and V = R Omega(t), which changes within a revolution.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from gateway.constants import STANDARD_GRAVITY_MPS2
from gateway.signal.angle_resampling import Phase, angle_grid
from gateway.signal.contact_edges import contact_interior
from gateway.types import FloatArray

_ITERATIONS: Final = 3
# Highest plausible peak over the mean: a ring's overshoot is below three times its baseline.
_MAX_PEAK_RATIO: Final = 6.0


@dataclass(frozen=True, slots=True)
class NormalisedRadial:
    """One revolution of the radial axis, reduced to steady free rolling.

    Attributes:
        radial_mps2: (n,) without gravity, at the revolution's mean speed, with the steady value restored.
        constant_mps2: constant added to an AC-coupled signal to restore its steady value; 0 when DC-coupled.
        belt_angle_rad: (n,) angle of the belt's normal from the vertical, used to remove gravity.
        used_belt_angle: False when that is only the material angle, because the waveform gave no closed belt.
    """

    radial_mps2: FloatArray
    constant_mps2: float
    belt_angle_rad: FloatArray
    used_belt_angle: bool


def normalise_radial(
    radial_mps2: FloatArray,
    phase: Phase,
    *,
    ac_coupled: bool = False,
    steady_mps2: float | None = None,
    gravity_mps2: float = STANDARD_GRAVITY_MPS2,
) -> NormalisedRadial:
    """Remove gravity and the angular acceleration within the revolution; restore an AC-coupled signal's steady value.

    Gravity acts at the belt's angle psi = integral of kappa R dtheta, where kappa R is the signal over its mean. In the
    contact the belt lies flat, so gravity is constant there. Where the waveform does not close into a belt (AC-coupled
    and no contact found, or a mean that is not positive), the material angle theta is used for psi.

    An AC-coupled signal has lost its constant. The mean of s over a closed belt is R Omega^2, so with `steady_mps2` the
    constant is restored to the accuracy of radius and gain. Without it, the middle of the contact is set to zero, which
    is accurate to a few percent of R Omega^2 on a flat road (`contact_interior` gives figures). An error of the
    constant stays in order 0; through the speed correction, order n receives the relative change of speed over n of it.
    With neither, the signal stays AC and the speed is not corrected, because that needs the steady value.

    Args:
        radial_mps2: (n,) radial axis on the angle grid, positive inward.
        phase: phase of the revolution.
        ac_coupled: True when the sensor does not pass the steady value.
        steady_mps2: R Omega^2 at the revolution's mean speed, used for AC-coupled signals only.
        gravity_mps2: acceleration of gravity; 0 for data without it.

    Returns:
        The normalised waveform, with the constant and the angle used. NaN in, NaN out.
    """
    n = radial_mps2.shape[0]
    theta = angle_grid(n)
    gain = phase.relative_speed(n) ** -2.0
    angle = theta
    closed = False
    constant = 0.0
    shape = radial_mps2 - gravity_mps2 * np.cos(theta)
    interior = None
    if ac_coupled and steady_mps2 is None:
        interior = contact_interior(shape, phase.samples)
        if interior is None:
            return NormalisedRadial(shape, 0.0, theta, False)
    for _ in range(_ITERATIONS if gravity_mps2 else 1):
        shape = radial_mps2 - gravity_mps2 * np.cos(angle)
        if interior is not None:
            constant = -float(shape[interior].mean())
        elif ac_coupled and steady_mps2 is not None:
            constant = (steady_mps2 - float((shape * gain).mean())) / float(gain.mean())
        curvature = _relative_curvature((shape + constant) * gain)
        if curvature is None:
            angle, closed = theta, False
            break
        angle, closed = _belt_angle(curvature), True
    shape = radial_mps2 - gravity_mps2 * np.cos(angle)
    return NormalisedRadial((shape + constant) * gain, constant, angle, closed)


def _relative_curvature(shape: FloatArray) -> FloatArray | None:
    """Return kappa R, whose mean is 1 on a closed belt; None when the mean cannot be R Omega^2."""
    mean = float(shape.mean())
    if not (mean > 0.0 and float(np.abs(shape).max()) < _MAX_PEAK_RATIO * mean):
        return None
    result: FloatArray = shape / mean
    return result


def _belt_angle(curvature: FloatArray) -> FloatArray:
    """Return the integral of kappa R from theta = 0, where the belt lies on the road, (n,)."""
    n = curvature.shape[0]
    step = 2.0 * math.pi / n
    # Trapezoidal rule from -pi on; the value at theta = 0 (index n/2) is then subtracted.
    integral = np.cumsum(curvature)
    integral -= 0.5 * curvature
    integral -= integral[n // 2]
    result: FloatArray = integral * step
    return result
