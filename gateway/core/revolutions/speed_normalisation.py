"""Normalisation of one revolution of the radial axis: gravity and the change of speed are removed.

A DC-coupled inner-liner sensor reads s = V^2 kappa + g cos(psi), positive inward, where psi is the angle of the belt's
normal from the vertical, kappa the belt's curvature and V = R Omega(t), which changes within a revolution.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Final

import numpy as np

from gateway.core.compiled import core
from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.revolutions.angle_resampling import Phase, angle_grid, elapsed_angles
from gateway.core.revolutions.contact_edges import contact_interior
from gateway.core.types import BoolArray, FloatArray

_ITERATIONS: Final = 3
# Highest plausible peak over the mean: a ring's overshoot is below three times its baseline.
_MAX_PEAK_RATIO: Final = 6.0
# How the compiled core restores the steady value of a revolution.
_IS_DC, _BY_CONTACT, _BY_STEADY_VALUE, _UNCHANGED = 0.0, 1.0, 2.0, 3.0


@dataclass(frozen=True, slots=True)
class NormalisedRevolutions:
    """Revolutions of the radial axis, reduced to steady free rolling.

    Attributes:
        radial_mps2: (k, n) without gravity, at the mean speed of each, with the steady value restored.
        constant_mps2: (k,) constant added to an AC-coupled signal to restore its steady value; 0 when DC-coupled.
        belt_angle_rad: (k, n) angle of the belt's normal from the vertical, used to remove gravity.
        used_belt_angle: (k,) False when that is only the material angle, because the waveform gave no closed belt.
    """

    radial_mps2: FloatArray
    constant_mps2: FloatArray
    belt_angle_rad: FloatArray
    used_belt_angle: BoolArray


def normalise_revolutions(
    radial_mps2: FloatArray,
    phases: Sequence[Phase],
    *,
    ac_coupled: bool = False,
    steady_mps2: FloatArray | None = None,
    gravity_mps2: float = STANDARD_GRAVITY_MPS2,
) -> NormalisedRevolutions:
    """Remove gravity and the angular acceleration within a revolution; restore an AC-coupled signal's steady value.

    Gravity acts at the belt's angle psi = integral of kappa R dtheta, where kappa R is the signal over its mean. In the
    contact the belt lies flat, so gravity is constant there. Where the waveform does not close into a belt (AC-coupled
    and no contact found, or a mean that is not positive), the material angle theta is used for psi.

    An AC-coupled signal has lost its constant. The mean of s over a closed belt is R Omega^2, so with `steady_mps2` the
    constant is restored to the accuracy of radius and gain. Without it, the middle of the contact is set to zero, which
    is accurate to a few percent of R Omega^2 on a flat road (`contact_interior` gives figures). An error of the
    constant stays in order 0; through the speed correction, order n receives the relative change of speed over n of it.
    With neither, the signal stays AC and the speed is not corrected, because that needs the steady value.

    Args:
        radial_mps2: (k, n) radial axis of each on the angle grid, positive inward.
        phases: phase of each.
        ac_coupled: True when the sensor does not pass the steady value.
        steady_mps2: (k,) R Omega^2 at the mean speed of each, used for AC-coupled signals only.
        gravity_mps2: acceleration of gravity; 0 for data without it.

    Returns:
        The normalised waveforms, with the constants and the angles used. NaN in, NaN out.
    """
    interiors: list[slice | None] | None = None
    if ac_coupled and steady_mps2 is None:
        shape = radial_mps2 - gravity_mps2 * _cosine(radial_mps2.shape[1])
        interiors = [contact_interior(row, phase.samples) for row, phase in zip(shape, phases, strict=True)]
    return normalised(radial_mps2, phases, interiors, steady_mps2 if ac_coupled else None, gravity_mps2)


def _normalised_by_numpy(
    radial_mps2: FloatArray,
    phases: Sequence[Phase],
    interiors: Sequence[slice | None] | None,
    steady_mps2: FloatArray | None,
    gravity_mps2: float,
) -> NormalisedRevolutions:
    """Normalise revolutions; of DC-coupled sensors where neither interiors nor steady values are given.

    Args:
        radial_mps2: (k, n) radial axis of each on the angle grid, positive inward.
        phases: phase of each.
        interiors: points in contact of each, where an AC-coupled signal is 0; None for one without a contact.
        steady_mps2: (k,) R Omega^2 at the mean speed of each, restored to an AC-coupled signal.
        gravity_mps2: acceleration of gravity.
    """
    count, n = radial_mps2.shape
    theta = angle_grid(n)
    gain = _inverse_square_speed(phases, n)
    constant = np.zeros((count, 1))
    ac_coupled = interiors is not None or steady_mps2 is not None
    has_interior = np.array([interior is not None for interior in interiors or [slice(0)] * count])
    closed = has_interior.copy()
    shape = radial_mps2 - gravity_mps2 * _cosine(n)
    angle, corrected = np.empty((2, count, n))
    for _ in range(_ITERATIONS if gravity_mps2 else 1):
        if interiors is not None:
            for index, interior in enumerate(interiors):
                if interior is not None and closed[index]:
                    constant[index] = -float(shape[index, interior].mean())
        elif steady_mps2 is not None:
            restored = (steady_mps2 - (shape * gain).mean(axis=1)) / gain.mean(axis=1)
            constant[closed, 0] = restored[closed]
        corrected = (shape + constant) * gain if ac_coupled else np.multiply(shape, gain, out=corrected)
        np.add.accumulate(corrected, axis=1, out=angle)
        mean = angle[:, -1] / n
        # The mean cannot be R Omega^2 when it is not positive, or peaks exceed it by far.
        highest = np.maximum(np.maximum.reduce(corrected, axis=1), -np.minimum.reduce(corrected, axis=1))
        closed &= (mean > 0.0) & (highest < _MAX_PEAK_RATIO * mean)
        # Integral of kappa R from theta = 0, where the belt lies on the road: the trapezoidal rule from -pi on.
        corrected *= 0.5
        angle -= corrected
        angle -= angle[:, n // 2, np.newaxis].copy()
        all_closed = bool(closed.all())
        angle *= ((2.0 * math.pi / n) / (mean if all_closed else np.where(closed, mean, 1.0)))[:, np.newaxis]
        if not all_closed:
            angle[~closed] = theta
        if gravity_mps2:
            np.cos(angle, out=shape)
            shape *= -gravity_mps2
            shape += radial_mps2
    if ac_coupled:
        shape += constant
        shape[~has_interior] -= constant[~has_interior]
        gain[~has_interior] = 1.0
    shape *= gain
    return NormalisedRevolutions(shape, constant[:, 0], angle, closed)


def _normalised_by_core(
    radial_mps2: FloatArray,
    phases: Sequence[Phase],
    interiors: Sequence[slice | None] | None,
    steady_mps2: FloatArray | None,
    gravity_mps2: float,
) -> NormalisedRevolutions:
    """As `_normalised_by_numpy`."""
    assert core is not None
    count, n = radial_mps2.shape
    rows = np.zeros((count, 6))
    rows[:, :3] = [(phase.rate, phase.acceleration, phase.samples) for phase in phases]
    modes = np.full(count, _IS_DC if steady_mps2 is None else _BY_STEADY_VALUE)
    if steady_mps2 is not None:
        rows[:, 3] = steady_mps2
    for index, interior in enumerate(interiors or ()):
        modes[index] = _UNCHANGED if interior is None else _BY_CONTACT
        rows[index, 4:] = (0, 0) if interior is None else (interior.start, min(interior.stop, n))
    shape, angle = np.empty((2, count, n))
    gain, constant, closed = np.empty(n), np.zeros(count), np.empty(count)
    radial = np.ascontiguousarray(radial_mps2)
    grids = angle_grid(n), elapsed_angles(n)
    core.normalise(radial, rows, modes, gravity_mps2, *grids, gain, shape, angle, constant, closed)
    return NormalisedRevolutions(shape, constant, angle, closed != 0.0)


normalised = _normalised_by_numpy if core is None else _normalised_by_core


@cache
def _cosine(n: int) -> FloatArray:
    """Return the cosine of the angle grid, (n,), read-only."""
    cosine: FloatArray = np.cos(angle_grid(n))
    cosine.setflags(write=False)
    return cosine


def _inverse_square_speed(phases: Sequence[Phase], n: int) -> FloatArray:
    """Return the inverse square of the speed on the angle grid over the revolution's mean speed, (k, n)."""
    rates, accelerations, samples = np.array([(phase.rate, phase.acceleration, phase.samples) for phase in phases]).T
    scale = np.square(samples / (2.0 * math.pi))
    gain: FloatArray = (2.0 * accelerations * scale)[:, np.newaxis] * elapsed_angles(n)
    gain += (rates * rates * scale)[:, np.newaxis]
    return np.reciprocal(gain, out=gain)
