"""Gaps in a revolution by samples that were lost: the angles that they leave without a sample, and what stands there.

The samples say nothing of these angles. What stands there is the shape of the revolutions just before, at this speed
and with this revolution's own constant and ramp, so that sums over the revolution are not moved by the gap. Whatever
averages revolutions lets the share of such a one that was measured stand for the scatter of all of it.
"""

import math
from collections import deque
from collections.abc import Iterable
from typing import Final, NamedTuple

import numpy as np

from firmware_protocol.messages import Axis
from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.estimates.revolution_block import LEAST_MEASURED
from gateway.core.revolutions.angle_resampling import Phase, beside_gap, elapsed_angles
from gateway.core.types import BoolArray, FloatArray

# Revolutions before whose mean is the shape, about a second of driving, and how many of them must have samples where
# this one has none: the mean of four has half the noise of one.
_MAX_REVOLUTIONS: Final = 8
_MIN_COVERAGE: Final = 4
# A wheel that stands, or a sensor that is silent, for longer may roll on under another load.
_LONGEST_PAUSE_S: Final = 10.0


def angles_in_gaps(gaps: Iterable[tuple[float, float]], phase: Phase, n: int) -> BoolArray:
    """Return at which points of the angle grid a revolution has no sample, (n,).

    Args:
        gaps: first and last (exclusive) sample of each, in the positions of `phase`.
        phase: of the revolution.
        n: size of the angle grid.
    """
    positions = phase.positions(elapsed_angles(n))
    inside = np.zeros(n, np.bool_)
    for first, end in gaps:
        inside |= beside_gap(positions, first, end)
    return inside


class _Reference(NamedTuple):
    """An earlier revolution: its axes, its angular speed, and at which angles it has no samples."""

    axes_mps2: FloatArray
    omega_radps: float
    inside: BoolArray | None


class GapFilling:
    """Fills gaps in the axes of a wheel's revolutions; deterministic, one revolution at a time."""

    def __init__(self) -> None:
        """Start without revolutions."""
        self.reset()

    def reset(self) -> None:
        """Forget the shape, as after a change of sensor."""
        self._references: deque[_Reference] = deque(maxlen=_MAX_REVOLUTIONS)
        self._state: object = None
        self._latest_s = -math.inf

    def take(
        self, axes_mps2: FloatArray, omega_radps: float, inside: BoolArray | None, state: object, start_s: float
    ) -> bool:
        """Take a revolution that may be averaged but for its gaps; return whether it has none left.

        Args:
            axes_mps2: (3, n) on the angle grid; is filled in place, and must not be changed afterwards.
            omega_radps: mean angular speed.
            inside: (n,) at which angles there is no sample; None where there are samples everywhere.
            state: what the shape depends on besides; revolutions of another state are forgotten.
            start_s: when the revolution begins; those from before a pause are forgotten.
        """
        if state != self._state or not 0.0 <= start_s - self._latest_s <= _LONGEST_PAUSE_S:
            self._references.clear()
        self._state, self._latest_s = state, start_s
        is_complete = inside is None or self._fill(axes_mps2, omega_radps, inside)
        self._references.append(_Reference(axes_mps2, omega_radps, inside))
        return is_complete

    def _fill(self, axes_mps2: FloatArray, omega_radps: float, inside: BoolArray) -> bool:
        if not inside.any():
            # Of a slow wheel a short gap lies between two angles of the grid.
            return True
        measured = ~inside
        if not self._references or measured.mean() < LEAST_MEASURED:
            return False
        total, count = np.zeros_like(axes_mps2), np.zeros(len(inside))
        angles_rad = elapsed_angles(len(inside)) - math.pi
        # Of the radial axis, whose direction is known, gravity does not grow with the speed.
        gravity = np.zeros_like(axes_mps2)
        gravity[Axis.RADIAL] = -STANDARD_GRAVITY_MPS2 * np.cos(angles_rad)
        for axes, omega, gap_mask in self._references:
            scaled = (axes - gravity) * (omega_radps / omega) ** 2
            total += scaled if gap_mask is None else np.where(gap_mask, 0.0, scaled)
            count += 1.0 if gap_mask is None else ~gap_mask
        if count[inside].min() < _MIN_COVERAGE:
            return False
        shape = total / np.maximum(count, 1.0) + gravity
        line = np.stack([np.ones_like(angles_rad), angles_rad], axis=1)
        rows = line[measured & (count > 0.0)]
        # Not by a common solver of all columns: an axis that is absent is no number, and must stay the only one.
        constant_and_ramp = np.linalg.inv(rows.T @ rows) @ (rows.T @ (axes_mps2 - shape)[:, measured & (count > 0.0)].T)
        axes_mps2[:, inside] = (shape + (line @ constant_and_ramp).T)[:, inside]
        return True
