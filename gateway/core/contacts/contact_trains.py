"""Selection of the dips that are contacts of one rolling wheel: trains of consecutive dips that obey its kinematics.

Depth d of a contact is about R Omega^2. Its duration w and the time T between contacts therefore give two invariants of
a wheel: the size w sqrt(d), and the turn T (sqrt(d1) + sqrt(d2)) / (4 pi), about the square root of the radius.
"""

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.core.contacts.dips import Dips
from gateway.core.types import BoolArray, FloatArray

# Range of the contact duration over the period, L / (2 pi R).
DUTY: Final = (0.015, 0.22)
# Largest ratio of neighbouring intervals; it covers a wheel that accelerates from 10 km/h at 3 m/s^2.
INTERVAL_RATIO: Final = 1.9
# Range of the squared turn, in m: the radius times 1 to 2 for the overshoot at the edges, less where gravity makes dips
# shallower.
_TURN2_M: Final = (0.1, 1.7)
# In a clipped signal, dips are too shallow by an unknown factor, but contacts still span most of the signal's range.
_CLIPPED_TURN2_M: Final = 1e-3
_CLIPPED_DEPTH_SHARE: Final = 0.3
# Largest ratio of the turns of two revolutions of one wheel, noise included; within a train it is smaller.
TURN_RATIO: Final = 1.4
_TRAIN_TURN_RATIO: Final = 1.35
# Largest ratio of the sizes of neighbouring contacts, including the steps in which durations are searched.
_SIZE_RATIO: Final = 2.0
_DEPTH_RATIO: Final = 6.0
# Between contacts the mean signal is R Omega^2 above that in contact. If the wheel stops or reverses in between, less
# than a third of that remains. Gravity reduces it by up to 1 g.
_LEVEL_SHARE: Final = 0.45
_LEVEL_GRAVITY_MPS2: Final = 6.5
# Longest period: 8 km/h on a radius of 0.55 m.
LONGEST_PERIOD_S: Final = 1.6
# Largest number of dips considered; the latest are kept.
_MAX_DIPS: Final = 240
# Below this depth, dips of an unknown wheel may be caused by gravity, or by an overshoot at walking pace.
_MIN_DEPTH_MPS2: Final = 11.0
# Largest ratio to the known invariants of a wheel: load and pressure change, noise and gravity contribute.
_KNOWN_TURN_RATIO: Final = 1.4
_KNOWN_SIZE_RATIO: Final = 1.8
# A dip hides shallower dips that are not wider, within this share of the shortest period that its width allows, unless
# it is this many times deeper: then it may be an impact beside a contact.
_SHADOW_SHARE: Final = 0.5
_SHADOW_DEPTH_RATIO: Final = 3.0
# A train is doubtful when dips of the other sign, deeper by the ratio and of at least the share of squared contact
# length, occur in this share of its intervals.
_OUTDONE_SHARE: Final = 0.4
_OUTDONE_DEPTH_RATIO: Final = 1.15
_OUTDONE_LENGTH_SHARE: Final = 0.25
# A dip between two contacts counts as a skipped contact when its depth is at least this share of theirs and the
# logarithm of its squared length differs by less than this.
SKIPPED_DEPTH_SHARE: Final = 0.7
_SKIPPED_LENGTH_LOG: Final = 0.7
# A train of up to this many contacts is doubtful when dips around it are deeper by this ratio.
_SHORT_TRAIN: Final = 3
_NEAR_DEPTH_RATIO: Final = 2.0


@dataclass(frozen=True, slots=True)
class WheelProperties:
    """Properties of a wheel learnt by tracking it.

    Attributes:
        sign: makes its radial axis positive inward.
        turn: see the function `turn`, in m^(1/2).
        size: contact duration in s times the square root of its depth.
    """

    sign: int
    turn: float
    size: float


def turn(depth: FloatArray | float, other: FloatArray | float, period_s: FloatArray | float) -> FloatArray:
    """Return the turn of two contacts: the square root of the radius times 1 to 1.4, in m^(1/2)."""
    return np.asarray(period_s * (np.sqrt(depth) + np.sqrt(other)) * (0.25 / np.pi), np.float64)


def turn_of(depth: float, other: float, period_s: float) -> float:
    """Return what `turn` does, of one pair of contacts."""
    return period_s * (math.sqrt(depth) + math.sqrt(other)) * (0.25 / math.pi)


def least_level(depth: FloatArray | float) -> FloatArray:
    """Return the least height of a revolution's mean above the contact level, given the shallower contact's depth."""
    return np.asarray(_LEVEL_SHARE * depth - _LEVEL_GRAVITY_MPS2, np.float64)


def best_train(
    dips: Dips, prefix: FloatArray, rate_hz: float, *, clipped_span: float = 0.0, prior: WheelProperties | None = None
) -> tuple[list[int], float]:
    """Find the strongest train of three or more dips that one rolling wheel can have made.

    Args:
        dips: candidates in time order.
        prefix: (n + 1,) cumulative sum of the signal in which they were found.
        rate_hz: its sampling rate.
        clipped_span: range of the signal when it is clipped, so that depths may be too small by any factor; else 0.
        prior: properties of the wheel from earlier contacts, if any.

    Returns:
        indices into `dips` in time order, empty without such a train; and the strength of the train.
    """
    places = _undominated(dips)[-_MAX_DIPS:]
    if len(places) < 3:
        return [], 0.0
    centre, depth, width, floor = (values[places] for values in (dips.centre, dips.depth, dips.width, dips.floor))
    least_turn2_m = _CLIPPED_TURN2_M if clipped_span else _TURN2_M[0]
    starts, ends, turns = _possible_pairs(centre, depth, width / rate_hz, floor, prefix, rate_hz, least_turn2_m)
    good = np.minimum(depth[starts], depth[ends]) >= _CLIPPED_DEPTH_SHARE * clipped_span
    if prior is not None:
        size = 0.5 * (width * np.sqrt(depth))[np.stack((starts, ends))].sum(axis=0) / rate_hz
        good &= (turns < _KNOWN_TURN_RATIO * prior.turn) & (prior.turn < _KNOWN_TURN_RATIO * turns)
        good &= (size < _KNOWN_SIZE_RATIO * prior.size) & (prior.size < _KNOWN_SIZE_RATIO * size)
    starts, ends, turns = starts[good], ends[good], turns[good]
    train, strength = _strongest(
        starts.tolist(), ends.tolist(), turns.tolist(), centre.tolist(), depth * np.sqrt(width)
    )
    return [int(places[index]) for index in train], strength


def _undominated(dips: Dips) -> NDArray[np.int64]:
    """Return the indices of dips that are not hidden by a deeper and longer one nearer than a period can be."""
    is_shadowed = np.abs(dips.centre[:, None] - dips.centre[None, :]) < _SHADOW_SHARE * dips.width[None, :] / DUTY[1]
    ratio = dips.depth[None, :] / dips.depth[:, None]
    is_shadowed &= (ratio > 1.0) & (ratio < _SHADOW_DEPTH_RATIO) & (dips.width[None, :] > 0.7 * dips.width[:, None])
    return np.flatnonzero(~is_shadowed.any(axis=1))


def _strongest(
    starts: list[int], ends: list[int], turns: list[float], centre: list[float], energy: FloatArray
) -> tuple[list[int], float]:
    """Join pairs into the train of three or more dips with the greatest sum of energies."""
    energies = energy.tolist()
    # Trains that end with each dip, by their last pair: value, index into `history`, interval, turn, number of dips.
    ending: list[list[tuple[float, int, float, float, int]]] = [[] for _ in centre]
    history: list[tuple[int, int, int]] = []
    best_pair, best_value, latest = -1, 0.0, -1
    for i, j, turn in zip(starts, ends, turns, strict=True):
        if j != latest:
            # All pairs that end with the previous dip are known; sort its trains, best first.
            if latest >= 0:
                ending[latest].sort(reverse=True)
            latest = j
        interval = centre[j] - centre[i]
        value, source, count = energies[i], -1, 2
        for earlier_value, index, earlier_interval, earlier_turn, earlier_count in ending[i]:
            if (
                interval < INTERVAL_RATIO * earlier_interval
                and earlier_interval < INTERVAL_RATIO * interval
                and turn < _TRAIN_TURN_RATIO * earlier_turn
                and earlier_turn < _TRAIN_TURN_RATIO * turn
            ):
                value, source, count = earlier_value, index, earlier_count + 1
                break
        value += energies[j]
        history.append((i, j, source))
        ending[j].append((value, len(history) - 1, interval, turn, count))
        if count >= 3 and value > best_value:
            best_pair, best_value = len(history) - 1, value
    train: list[int] = []
    while best_pair >= 0:
        first, last, best_pair = history[best_pair]
        train.append(last)
        if best_pair < 0:
            train.append(first)
    return train[::-1], best_value


def _possible_pairs(
    centre: FloatArray,
    depth: FloatArray,
    width_s: FloatArray,
    floor: FloatArray,
    prefix: FloatArray,
    rate_hz: float,
    least_turn2_m: float,
) -> tuple[NDArray[np.int64], NDArray[np.int64], FloatArray]:
    """Return pairs of dips that may be neighbouring contacts: indices of both, ordered by the later, and their turn."""
    times_s = centre / rate_hz
    i, j = np.nonzero(_period_fits_width(times_s, width_s))
    # Sorted by the later dip, then by the earlier one, so that trains grow in time order.
    order = np.lexsort((i, j))
    i, j = i[order], j[order]
    period = times_s[j] - times_s[i]
    turns = turn(depth[i], depth[j], period)
    size = width_s * np.sqrt(depth)
    size_ratio, depth_ratio = size[i] / size[j], depth[i] / depth[j]
    duty = np.sqrt(width_s[i] * width_s[j]) / period
    good = (turns**2 >= least_turn2_m) & (turns**2 <= _TURN2_M[1])
    good &= (size_ratio < _SIZE_RATIO) & (size_ratio > 1.0 / _SIZE_RATIO)
    good &= (depth_ratio < _DEPTH_RATIO) & (depth_ratio > 1.0 / _DEPTH_RATIO)
    good &= (duty > DUTY[0]) & (duty < DUTY[1])
    first, last = centre[i].astype(np.int64), centre[j].astype(np.int64)
    level = (prefix[last] - prefix[first]) / np.maximum(last - first, 1) - 0.5 * (floor[i] + floor[j])
    good &= level >= least_level(np.minimum(depth[i], depth[j]))
    return i[good], j[good], turns[good]


def _period_fits_width(times_s: FloatArray, width_s: FloatArray) -> BoolArray:
    """Return (k, k), [i, j] True where the time from dip i to dip j is a period that their widths allow."""
    period = times_s[None, :] - times_s[:, None]
    wider = np.maximum(width_s[None, :], width_s[:, None])
    result: BoolArray = (period > wider / (INTERVAL_RATIO * DUTY[1])) & (
        period < np.minimum(LONGEST_PERIOD_S, wider / DUTY[0])
    )
    return result


def doubtful(train: list[int], dips: Dips, others: Dips) -> bool:
    """Return whether other dips are better contacts.

    They may be of the other sign, between those of a train, or near a short train.

    The overshoot of an edge is a dip of the negative signal, and three of them may be in view before three contacts
    are. Better contacts repeat in every interval; a road impact does not.

    Args:
        train: indices into `dips`.
        dips: dips of the train's own sign.
        others: dips of the other sign.
    """
    depth, centre = dips.depth[train], dips.centre[train]
    if float(np.median(depth)) < _MIN_DEPTH_MPS2:
        return True
    length = depth * dips.width[train] ** 2
    other_length = others.depth * others.width**2
    outdone_count = 0
    for index, (start, end) in enumerate(pairwise(centre.tolist())):
        inside = (others.centre >= start) & (others.centre <= end)
        inside &= others.depth >= _OUTDONE_DEPTH_RATIO * math.sqrt(depth[index] * depth[index + 1])
        inside &= other_length >= _OUTDONE_LENGTH_SHARE * math.sqrt(length[index] * length[index + 1])
        skipped = (
            (dips.centre > start)
            & (dips.centre < end)
            & (dips.depth >= SKIPPED_DEPTH_SHARE * depth[index : index + 2].min())
        )
        skipped &= np.abs(np.log(dips.depth * dips.width**2 / length[index])) < _SKIPPED_LENGTH_LOG
        outdone_count += bool(inside.any() or skipped.any())
    if outdone_count >= _OUTDONE_SHARE * (len(train) - 1):
        return True
    if len(train) > _SHORT_TRAIN:
        return False
    reach = 1.5 * float(np.diff(centre).max())
    typical_length = float(np.median(length))
    for candidates in (dips, others):
        is_near = (
            (candidates.centre > centre[0] - reach)
            & (candidates.centre < centre[-1] + reach)
            & (candidates.depth > _NEAR_DEPTH_RATIO * depth.max())
        )
        if (candidates.depth[is_near] * candidates.width[is_near] ** 2 > _OUTDONE_LENGTH_SHARE * typical_length).any():
            return True
    return False
