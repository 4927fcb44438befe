"""Which dips are the contacts of one rolling wheel: consecutive ones that obey its kinematics."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.signal.dips import Dips
from gateway.types import BoolArray, FloatArray

# Contact duration over period, L / (2 pi R).
DUTY: Final = (0.015, 0.22)
# Neighbouring intervals differ by less than this, even when a wheel speeds up from 10 km/h at 3 m/s^2.
INTERVAL_RATIO: Final = 1.9
# The square root of the depth goes with the speed, and the mean of it at both contacts times the period with the
# radius: (T (sqrt d1 + sqrt d2) / 4 pi)^2 = R times 1 to 2 for the edges' overshoot, less where gravity flattens dips.
_TURN2_M: Final = (0.1, 1.7)
# A clipped signal is shallower than it should be by any factor; its contacts still go through most of its span.
_CLIPPED_TURN2_M: Final = 1e-3
_CLIPPED_SHARE: Final = 0.3
# That product is the same for all revolutions of a wheel within this factor, noise included.
TURN_RATIO: Final = 1.4
_TRAIN_TURN_RATIO: Final = 1.35
# duration * sqrt(depth) of neighbouring contacts agrees within this factor, the steps of the durations included.
_SIZE_RATIO: Final = 2.0
_DEPTH_RATIO: Final = 6.0
# Between contacts the signal is R Omega^2 higher than in them unless the wheel stops or turns back there: then less
# than a third is left. Gravity stands against it, one g in the contact.
_LEVEL_SHARE: Final = 0.45
_LEVEL_GRAVITY_MPS2: Final = 6.5
# Longest period, 8 km/h on a radius of 0.55 m.
LONGEST_PERIOD_S: Final = 1.6
# Dips that take part at most, the latest.
_MOST_DIPS: Final = 240
# While nothing is known of the wheel: dips below this may be gravity's or an overshoot's at walking pace.
_LEAST_DEPTH_MPS2: Final = 11.0
# What is known of a wheel holds within these factors: load and pressure change, noise and gravity have their share.
_KNOWN_TURN_RATIO: Final = 1.4
_KNOWN_SIZE_RATIO: Final = 1.8
# A run of up to so many contacts is doubted when there are dips about it so many times deeper.
_FEW: Final = 3
# A dip hides shallower ones, not wider, within this share of the shortest period that its width allows.
_SHADOW: Final = 0.5
_SHADOW_DEPTH: Final = 3.0
_OUTDONE_SHARE: Final = 0.4
_OUTDONE_DEPTH: Final = 1.15
_OUTDONE_LENGTH: Final = 0.25
# A dip between two contacts is one, too, when it is nearly as deep and as long.
_SKIPPED_SHARE: Final = 0.7
_SKIPPED_LENGTH_LOG: Final = 0.7
_OUTDONE_NEAR: Final = 2.0


@dataclass(frozen=True, slots=True)
class Known:
    """What is known of a wheel from having followed it.

    Attributes:
        sign: makes its radial axis positive inward.
        turn: see `turn`, square root of m.
        size: contact's duration in s times the square root of its depth.
    """

    sign: int
    turn: float
    size: float


def turn(depth: FloatArray | float, other: FloatArray | float, period_s: FloatArray | float) -> FloatArray:
    """Return the square root of the radius that two contacts and the time between them tell, times 1 to 1.4."""
    return np.asarray(period_s * (np.sqrt(depth) + np.sqrt(other)) * (0.25 / np.pi), np.float64)


def least_level(depth: FloatArray | float) -> FloatArray:
    """Return by how much the mean over a revolution exceeds the contact's at least, for the shallower contact."""
    return np.asarray(_LEVEL_SHARE * depth - _LEVEL_GRAVITY_MPS2, np.float64)


def best_train(
    dips: Dips, prefix: FloatArray, rate_hz: float, *, clipped_span: float = 0.0, known: Known | None = None
) -> tuple[list[int], float]:
    """Find the strongest run of three or more dips that one rolling wheel can have made.

    Args:
        dips: candidates in time order.
        prefix: (n + 1,) cumulative sum of the signal that they are dips of.
        rate_hz: its sampling rate.
        clipped_span: span of the signal when it is clipped, so that depths may be too small by any factor; else 0.
        known: what is known of the wheel.

    Returns:
        places in `dips` in time order, none when there is no such run; and its strength.
    """
    places = _undominated(dips)[-_MOST_DIPS:]
    if len(places) < 3:
        return [], 0.0
    at, depth, width, floor = (values[places] for values in (dips.at, dips.depth, dips.width, dips.floor))
    least = _CLIPPED_TURN2_M if clipped_span else _TURN2_M[0]
    before, after, turns = _possible_pairs(at, depth, width / rate_hz, floor, prefix, rate_hz, least)
    good = np.minimum(depth[before], depth[after]) >= _CLIPPED_SHARE * clipped_span
    if known is not None:
        size = 0.5 * (width * np.sqrt(depth))[np.stack((before, after))].sum(axis=0) / rate_hz
        good &= (turns < _KNOWN_TURN_RATIO * known.turn) & (known.turn < _KNOWN_TURN_RATIO * turns)
        good &= (size < _KNOWN_SIZE_RATIO * known.size) & (known.size < _KNOWN_SIZE_RATIO * size)
    before, after, turns = before[good], after[good], turns[good]
    train, strength = _strongest(before.tolist(), after.tolist(), turns.tolist(), at.tolist(), depth * np.sqrt(width))
    return [int(places[place]) for place in train], strength


def _undominated(dips: Dips) -> NDArray[np.int64]:
    """Places of the dips that do not lie in the shadow of a deeper and longer one, nearer than a period can be."""
    near = np.abs(dips.at[:, None] - dips.at[None, :]) < _SHADOW * dips.width[None, :] / DUTY[1]
    ratio = dips.depth[None, :] / dips.depth[:, None]
    # What is many times deeper may be an impact beside a contact.
    near &= (ratio > 1.0) & (ratio < _SHADOW_DEPTH) & (dips.width[None, :] > 0.7 * dips.width[:, None])
    return np.flatnonzero(~near.any(axis=1))


def _strongest(
    before: list[int], after: list[int], turns: list[float], at: list[float], energy: FloatArray
) -> tuple[list[int], float]:
    """Join pairs into the run of three or more dips with the greatest sum of energies."""
    energies = energy.tolist()
    # Runs that end with each dip, by their last pair: value, place in `history`, interval, turn, dips.
    ending: list[list[tuple[float, int, float, float, int]]] = [[] for _ in at]
    history: list[tuple[int, int, int]] = []
    best, best_value, latest = -1, 0.0, -1
    for i, j, own in zip(before, after, turns, strict=True):
        if j != latest:
            # No more pairs end in the dip before this one; those that begin there look for the best first.
            if latest >= 0:
                ending[latest].sort(reverse=True)
            latest = j
        interval = at[j] - at[i]
        value, source, count = energies[i], -1, 2
        for earlier_value, place, earlier, earlier_turn, earlier_count in ending[i]:
            if (
                interval < INTERVAL_RATIO * earlier
                and earlier < INTERVAL_RATIO * interval
                and own < _TRAIN_TURN_RATIO * earlier_turn
                and earlier_turn < _TRAIN_TURN_RATIO * own
            ):
                value, source, count = earlier_value, place, earlier_count + 1
                break
        value += energies[j]
        history.append((i, j, source))
        ending[j].append((value, len(history) - 1, interval, own, count))
        if count >= 3 and value > best_value:
            best, best_value = len(history) - 1, value
    train: list[int] = []
    while best >= 0:
        first, last, best = history[best]
        train.append(last)
        if best < 0:
            train.append(first)
    return train[::-1], best_value


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


def _rough(at_s: FloatArray, width_s: FloatArray) -> BoolArray:
    period = at_s[None, :] - at_s[:, None]
    wider = np.maximum(width_s[None, :], width_s[:, None])
    result: BoolArray = (period > wider / (INTERVAL_RATIO * DUTY[1])) & (
        period < np.minimum(LONGEST_PERIOD_S, wider / DUTY[0])
    )
    return result


def doubtful(train: list[int], dips: Dips, others: Dips) -> bool:
    """Whether other dips, of the other sign, between those of a train or beside a short one, make better contacts.

    An edge's overshoot is a dip of the negative signal, and three of them may be in view before three contacts are.
    What is better repeats in every interval; what does not is an impact of the road.

    Args:
        train: places in `dips`.
        dips: of the train's own sign.
        others: of the other sign.
    """
    depth, at = dips.depth[train], dips.at[train]
    if float(np.median(depth)) < _LEAST_DEPTH_MPS2:
        return True
    length = depth * dips.width[train] ** 2
    other_length = others.depth * others.width**2
    better = 0
    for place, (before, after) in enumerate(pairwise(at.tolist())):
        inside = (others.at >= before) & (others.at <= after)
        inside &= others.depth >= _OUTDONE_DEPTH * math.sqrt(depth[place] * depth[place + 1])
        inside &= other_length >= _OUTDONE_LENGTH * math.sqrt(length[place] * length[place + 1])
        skipped = (
            (dips.at > before) & (dips.at < after) & (dips.depth >= _SKIPPED_SHARE * depth[place : place + 2].min())
        )
        skipped &= np.abs(np.log(dips.depth * dips.width**2 / length[place])) < _SKIPPED_LENGTH_LOG
        better += bool(inside.any() or skipped.any())
    if better >= _OUTDONE_SHARE * (len(train) - 1):
        return True
    if len(train) > _FEW:
        return False
    reach = 1.5 * float(np.diff(at).max())
    longest = float(np.median(length))
    for near in (dips, others):
        beside = (near.at > at[0] - reach) & (near.at < at[-1] + reach) & (near.depth > _OUTDONE_NEAR * depth.max())
        if (near.depth[beside] * near.width[beside] ** 2 > _OUTDONE_LENGTH * longest).any():
            return True
    return False
