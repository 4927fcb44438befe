"""Steps of a series: places from which on all values are higher or lower, as after a change of tire or a refill."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from gateway.types import BoolArray, FloatArray

LEAST_POINTS: Final = 4
"""Points of a level; fewer are outliers."""

_FALSE_RATE: Final = 0.01
_MOST_STEPS: Final = 12
# A step is a multiple of the scatter about the levels, or it is of no use to anyone.
_LEAST_SCATTERS: Final = 3.0
_NEIGHBOURS: Final = 10
_SPIKE: Final = 6.0
_MAD_TO_STD: Final = 1.4826


def find_steps(design: FloatArray, values: FloatArray, *, family: int = 1, least: float = 0.0) -> list[int]:
    """Return the indices at which a new level begins, in order.

    Steps are added one at a time where they reduce the residual most, as long as an F-test finds them significant over
    all places and series, and they are larger than three times the scatter that remains and than `least`.

    Args:
        design: (n, p) of the trend without steps, in the order of time.
        values: (n,) finite.
        family: number of series that are tested together.
        least: size below which a step is not reported.
    """
    from scipy import stats

    keep = np.flatnonzero(~_spikes(values))
    rows, wanted = design[keep], values[keep]
    count = len(keep)
    found: list[int] = []
    level = _FALSE_RATE / max(family, 1)
    while len(found) < _MOST_STEPS:
        present = np.column_stack([rows, *(_step(count, at) for at in found)])
        places = [at for at in range(LEAST_POINTS, count - LEAST_POINTS + 1) if _is_apart(at, found)]
        freedom = count - present.shape[1] - 1
        if not places or freedom < LEAST_POINTS:
            break
        # Residuals of values and of all candidate steps after the columns present: a step's gain follows from both.
        basis = np.linalg.qr(present)[0]
        left = wanted - basis @ (basis.T @ wanted)
        steps = np.column_stack([_step(count, at) for at in places])
        steps = steps - basis @ (basis.T @ steps)
        squares = np.einsum("ij,ij->j", steps, steps)
        usable = squares > 1e-9 * count
        sizes = np.where(usable, steps.T @ left / np.where(usable, squares, 1.0), 0.0)
        gains = sizes**2 * squares
        best = int(np.argmax(gains))
        rest = float(left @ left) - float(gains[best])
        if not rest > 1e-24 * float(wanted @ wanted) + 1e-300:
            chance = 0.0 if gains[best] > 0.0 else 1.0
        else:
            chance = float(stats.f.sf(gains[best] * freedom / rest, 1, freedom))
        scatter = math.sqrt(max(rest, 0.0) / freedom)
        size = abs(float(sizes[best]))
        if chance * len(places) > level or size < _LEAST_SCATTERS * scatter or size < least:
            break
        found.append(places[best])
    return sorted(int(keep[at]) for at in found)


def _step(count: int, at: int) -> FloatArray:
    return (np.arange(count) >= at).astype(np.float64)


def _is_apart(at: int, found: list[int]) -> bool:
    return all(abs(at - other) >= LEAST_POINTS for other in found)


def _spikes(values: FloatArray) -> BoolArray:
    """Return (n,) whether a value differs from the median of its neighbours on both sides by six times the scatter."""
    count = len(values)
    medians = np.empty(count)
    for at in range(count):
        begin = min(max(at - _NEIGHBOURS // 2, 0), max(count - _NEIGHBOURS - 1, 0))
        near = np.delete(values[begin : begin + _NEIGHBOURS + 1], at - begin)
        medians[at] = np.median(near) if near.size else values[at]
    off = np.abs(values - medians)
    scale = _MAD_TO_STD * float(np.median(off))
    return np.asarray(off > _SPIKE * scale if scale > 0.0 else np.zeros(count, dtype=bool))
