"""Power of single revolutions by angle, and of what differs from one to the next or alternates."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.closure.data.campaign_data import AngleScatter
from gateway.closure.effects.effect import RADIAL
from gateway.types import BoolArray, FloatArray

CELLS: Final = 64
"""Angles of a profile: 0.1 rad each, the width of a burst that a wheel's turn smears."""

# Fewer revolutions do not show what is rare.
_LEAST: Final = 12
# Share of the revolutions that is left out of a cell: those of the largest power.
_TRIMMED: Final = 0.05
# Share of the largest powers, burst excepted, below which a cell of a clipped signal has next to no scatter: noise is
# never so uneven, whereas the end of the range leaves a fraction of a count.
_FLAT: Final = 0.01
_LARGE: Final = 0.95


def angle_scatter(
    residuals: FloatArray, present: BoolArray, index: NDArray[np.integer], *, clipped: bool = False
) -> AngleScatter | None:
    """Return the power of deviations by angle; None for too few revolutions.

    Args:
        residuals: (n, 3, grid) deviations of revolutions from their mean, in order of time, theta from -pi.
        present: (3,) axes.
        index: (n,) running numbers of the revolutions.
        clipped: whether the radial axis reaches the end of its range in some of them.
    """
    count = len(residuals)
    if count < _LEAST:
        return None
    parts = residuals.reshape(count, 3, CELLS, -1)
    cells = np.square(parts).mean(axis=-1)
    at_limit = np.zeros((3, CELLS), dtype=bool)
    if clipped:
        mean = cells[:, RADIAL].mean(axis=0)
        at_limit[RADIAL] = mean < _FLAT * np.quantile(mean, _LARGE)
    # The scatter of a cell's power from turn to turn, in the median cell, which holds noise.
    relative = cells.std(axis=0) / np.maximum(cells.mean(axis=0), 1e-30)
    spread = np.array([np.median(relative[axis, ~at_limit[axis]]) for axis in range(3)])
    # The largest of every cell are left out: a few turns in which the speed or the load changed are no scatter.
    usual = _usual(cells)
    power = np.where(usual, cells, 0.0).sum(axis=0) / usual.sum(axis=0)
    # The turn in which a load or a gain steps is no scatter either.
    changes = np.diff(parts, axis=0)
    steps = 0.5 * np.square(changes, out=changes).mean(axis=-1)
    small = _usual(steps)
    successive = np.where(small, steps, 0.0).sum(axis=0) / small.sum(axis=0)
    sign = np.where(np.asarray(index) % 2, -1.0, 1.0)
    swing = np.tensordot(sign - sign.mean(), np.where(usual[..., None], parts, 0.0), axes=1) / np.sqrt(count)
    alternating = np.square(swing).reshape(3, CELLS, -1).mean(axis=-1)
    freedom = np.where(present, 1.0 / np.square(np.maximum(spread, 1e-3)), 0.0)
    # Noise is what most of a turn holds.
    freedom[at_limit.mean(axis=1) > 0.5] = 0.0
    return AngleScatter(power, successive, alternating, freedom, count, at_limit)


def _usual(powers: FloatArray) -> BoolArray:
    """Return which of (n, 3, cells) powers are not among the largest of their cell."""
    count = len(powers)
    usual: BoolArray = powers <= np.sort(powers, axis=0)[count - 1 - max(1, round(_TRIMMED * count))]
    return usual
