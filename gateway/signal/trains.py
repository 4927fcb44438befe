"""Which dips are the contacts of one rolling wheel: consecutive ones that obey its kinematics."""

from __future__ import annotations

from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.signal.dips import Dips

FloatArray = NDArray[np.float64]

# Contact duration over period, L / (2 pi R).
DUTY: Final = (0.015, 0.22)
# Neighbouring intervals differ by less than this, even when a wheel speeds up from 10 km/h at 3 m/s^2.
INTERVAL_RATIO: Final = 1.9
# The square root of the depth goes with the speed, and the mean of it at both contacts times the period with the
# radius: (T (sqrt d1 + sqrt d2) / 4 pi)^2 = R times 1 to 2 for the edges' overshoot, less where gravity flattens dips.
_TURN2_M: Final = (0.1, 1.7)
# A clipped signal is shallower than it should be by any factor.
_CLIPPED_TURN2_M: Final = 1e-3
# That product is the same for all revolutions of a wheel within this factor, noise included.
TURN_RATIO: Final = 1.5
_TRAIN_TURN_RATIO: Final = 1.35
# duration * sqrt(depth) of neighbouring contacts agrees within this factor, the steps of the durations included.
_SIZE_RATIO: Final = 2.0
_DEPTH_RATIO: Final = 6.0
# Between contacts the signal is R Omega^2 higher than in them unless the wheel stops or turns back there: then less
# than a third is left. Gravity stands against it, one g in the contact.
_LEVEL_SHARE: Final = 0.45
_LEVEL_GRAVITY_MPS2: Final = 3.0
# Longest period, 8 km/h on a radius of 0.55 m.
LONGEST_PERIOD_S: Final = 1.6
# Dips that take part at most, the latest.
_MOST_DIPS: Final = 240
_OUTDONE: Final = 3.0


def turn(depth: FloatArray | float, other: FloatArray | float, period_s: FloatArray | float) -> FloatArray:
    """Return the square root of the radius that two contacts and the time between them tell, times 1 to 1.4."""
    return np.asarray(period_s * (np.sqrt(depth) + np.sqrt(other)) * (0.25 / np.pi), np.float64)


def least_level(depth: FloatArray | float) -> FloatArray:
    """Return by how much the mean over a revolution exceeds the contact's at least, for the shallower contact."""
    return np.asarray(_LEVEL_SHARE * depth - _LEVEL_GRAVITY_MPS2, np.float64)


def best_train(dips: Dips, prefix: FloatArray, rate_hz: float, *, clipped: bool = False) -> tuple[list[int], float]:
    """Find the strongest run of three or more dips that one rolling wheel can have made.

    Args:
        dips: candidates in time order.
        prefix: (n + 1,) cumulative sum of the signal that they are dips of.
        rate_hz: its sampling rate.
        clipped: whether depths may be too small by any factor.

    Returns:
        places in `dips` in time order, none when there is no such run; and its strength.
    """
    base = max(0, len(dips) - _MOST_DIPS)
    at, depth, width, floor = (values[base:] for values in (dips.at, dips.depth, dips.width, dips.floor))
    if len(at) < 3:
        return [], 0.0
    least = _CLIPPED_TURN2_M if clipped else _TURN2_M[0]
    before, after, turns = _possible_pairs(at, depth, width / rate_hz, floor, prefix, rate_hz, least)
    strength = depth * np.sqrt(width)
    energy = strength.tolist()
    times = at.tolist()
    # Best run that ends in each pair, by its last but one: extended pair after pair in time order.
    ending: list[list[tuple[int, float, float, float, int]]] = [[] for _ in times]
    history: list[tuple[int, int, int]] = []
    best, best_value = -1, 0.0
    for i, j, own in zip(before.tolist(), after.tolist(), turns.tolist(), strict=True):
        interval = times[j] - times[i]
        value, source, count = energy[i], -1, 2
        for place, earlier, earlier_turn, earlier_value, earlier_count in ending[i]:
            if (
                earlier_value > value
                and interval < INTERVAL_RATIO * earlier
                and earlier < INTERVAL_RATIO * interval
                and own < _TRAIN_TURN_RATIO * earlier_turn
                and earlier_turn < _TRAIN_TURN_RATIO * own
            ):
                value, source, count = earlier_value, place, earlier_count + 1
        value += energy[j]
        history.append((i, j, source))
        ending[j].append((len(history) - 1, interval, own, value, count))
        if count >= 3 and value > best_value:
            best, best_value = len(history) - 1, value
    train: list[int] = []
    while best >= 0:
        i, j, best = history[best]
        train.append(j + base)
        last = i + base
    return ([last, *reversed(train)], best_value) if train else ([], 0.0)


def _possible_pairs(
    at: FloatArray,
    depth: FloatArray,
    width_s: FloatArray,
    floor: FloatArray,
    prefix: FloatArray,
    rate_hz: float,
    least_turn2_m: float,
) -> tuple[NDArray[np.int64], NDArray[np.int64], FloatArray]:
    """Dips that may be neighbouring contacts: places of both, in the order of the later one, and their turn."""
    at_s = at / rate_hz
    i, j = np.nonzero(_rough(at_s, width_s))
    # Sorted by the later dip, then by the earlier one, so that runs grow in time order.
    order = np.lexsort((i, j))
    i, j = i[order], j[order]
    period = at_s[j] - at_s[i]
    own = turn(depth[i], depth[j], period)
    size = width_s * np.sqrt(depth)
    size_ratio, depth_ratio = size[i] / size[j], depth[i] / depth[j]
    duty = np.sqrt(width_s[i] * width_s[j]) / period
    good = (own**2 >= least_turn2_m) & (own**2 <= _TURN2_M[1])
    good &= (size_ratio < _SIZE_RATIO) & (size_ratio > 1.0 / _SIZE_RATIO)
    good &= (depth_ratio < _DEPTH_RATIO) & (depth_ratio > 1.0 / _DEPTH_RATIO)
    good &= (duty > DUTY[0]) & (duty < DUTY[1])
    first, last = at[i].astype(np.int64), at[j].astype(np.int64)
    level = (prefix[last] - prefix[first]) / np.maximum(last - first, 1) - 0.5 * (floor[i] + floor[j])
    good &= level >= least_level(np.minimum(depth[i], depth[j]))
    return i[good], j[good], own[good]


def _rough(at_s: FloatArray, width_s: FloatArray) -> NDArray[np.bool_]:
    period = at_s[None, :] - at_s[:, None]
    wider = np.maximum(width_s[None, :], width_s[:, None])
    result: NDArray[np.bool_] = (period > wider / (INTERVAL_RATIO * DUTY[1])) & (
        period < np.minimum(LONGEST_PERIOD_S, wider / DUTY[0])
    )
    return result


def outdone(train: list[int], dips: Dips, others: Dips) -> bool:
    """Whether a dip within the train makes a better contact: then the train is an edge's overshoot, upside down.

    It happens while fewer than three contacts are in view, but already three overshoots.

    Args:
        train: places in `dips`.
        dips: of the train's own sign.
        others: dips of either sign to compare with.
    """
    size = float(np.median(dips.depth[train] * dips.width[train] ** 2))
    for before, after in pairwise(train):
        deepest = max(dips.depth[before], dips.depth[after])
        inside = (others.at >= dips.at[before]) & (others.at <= dips.at[after])
        relative = others.depth[inside] * others.width[inside] ** 2 / size
        deep = others.depth[inside]
        better = ((deep >= deepest) & (relative >= _OUTDONE)) | ((deep >= 1.5 * deepest) & (relative >= 1.0 / _OUTDONE))
        if better.any():
            return True
    return False
