"""Where the sensor passes through the contact: dips of the radial axis, found by their physics.

Outside the contact a radial inner-liner sensor reads R Omega^2, inside it about zero, with overshoots at both edges
(curvature law s = V^2 kappa). A contact of length L at speed v therefore is a dip of depth about R Omega^2 = v^2 / R
and duration w = L / v, so that depth * w^2 = L^2 / R whatever the speed. That product tells contacts from the rest.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

# depth * duration^2 = about 1.3 L^2 / R, for contact lengths of 50 to 350 mm on radii of 0.2 to 0.6 m.
DEPTH_DURATION2_M: Final = (0.004, 0.9)
# Contact duration over period, L / (2 pi R).
DUTY: Final = (0.015, 0.2)
MIN_DEPTH_MPS2: Final = 4.0
# 250 km/h with a short contact, 7 km/h with a long one.
DURATION_S: Final = (0.0008, 0.16)
# The search looks at no more than this many samples a second; the shortest contact still spans four.
SEARCH_RATE_HZ: Final = 4800.0
# Boxes of the dip score in units of the contact duration: centre +-0.35, flanks 0.75 to 1.5 on either side.
_CENTRE, _FLANK_IN, _FLANK_OUT = 0.35, 0.75, 1.5
_SCALE_STEP: Final = 2.0**0.5
# Neighbouring intervals differ by less than this, even when a wheel speeds up from 10 km/h at 3 m/s^2.
INTERVAL_RATIO: Final = 1.9
# Depth * duration^2 is the same for all contacts of a wheel; an overshoot's is at most a quarter of it.
_OUTDONE: Final = 3.0
# Neighbouring contacts last equally long but for the change of speed and the steps of the search's durations.
_WIDTH_RATIO: Final = INTERVAL_RATIO * _SCALE_STEP * 1.05
# Shares of the deepest dip that a dip needs to take part, tried in this order.
_DEPTH_TIERS: Final = (0.5, 0.35, 0.2, 0.1, 0.05, 0.0)
# Dips of the nominal sign win unless the other sign's are clearly deeper.
_SIGN_PREFERENCE: Final = 1.15


@dataclass(frozen=True, slots=True)
class Contact:
    """One passage through the contact patch.

    Attributes:
        centre: running sample number, fractional, midway between the two half-level crossings.
        duration: samples between the half-level crossings.
        depth_mps2: flanks minus contact, positive.
        centre_std: standard error of `centre` in samples.
        predicted: True when the samples of this contact were lost and its place is a prediction.
    """

    centre: float
    duration: float
    depth_mps2: float
    centre_std: float
    predicted: bool = False


def box_offsets(width: float) -> tuple[int, int, int]:
    """Half centre box, inner and outer flank distances in samples for a contact of `width` samples."""
    centre = max(1, round(_CENTRE * width))
    inner = max(centre + 1, round(_FLANK_IN * width))
    return centre, inner, max(inner + 1, round(_FLANK_OUT * width))


def dip_score(prefix: FloatArray, width: float) -> tuple[FloatArray, int]:
    """Score every sample as the centre of a dip of `width` samples: the lower flank's mean minus the centre's mean.

    Args:
        prefix: (n + 1,) cumulative sum of the signal, starting with 0.
        width: expected contact duration in samples.

    Returns:
        scores in the signal's unit and the sample number that the first belongs to; no scores when n is too small.
    """
    centre, inner, outer = box_offsets(width)
    n = len(prefix) - 1
    count = n - 2 * outer
    if count <= 0:
        return np.empty(0), outer

    def box(first: int, end: int) -> FloatArray:
        first, end = first + outer, end + outer
        return (prefix[end : end + count] - prefix[first : first + count]) * (1.0 / (end - first))

    flanks = np.minimum(box(-outer, -inner + 1), box(inner, outer + 1))
    flanks -= box(-centre, centre + 1)
    return flanks, outer


def noise_std_mps2(signal: FloatArray) -> float:
    """Standard deviation of the white noise of a signal, robust against dips: median of second differences."""
    if len(signal) < 8:
        return 0.0
    second = signal[2:] - 2.0 * signal[1:-1] + signal[:-2]
    return float(np.median(np.abs(second)) / (0.6745 * 6.0**0.5))


def _dips(signal: FloatArray, rate_hz: float) -> list[tuple[int, float, float]]:
    """Find dips of any duration: (sample, depth, duration in samples), in time order, physical ones only."""
    prefix = np.concatenate(([0.0], np.cumsum(signal)))
    best = np.zeros(len(signal))
    best_width = np.ones(len(signal))
    noise = noise_std_mps2(signal)
    width = max(3.0, DURATION_S[0] * rate_hz)
    while width <= DURATION_S[1] * rate_hz:
        score, first = dip_score(prefix, width)
        if not len(score):
            break
        centre, inner, outer = box_offsets(width)
        floor = max(
            MIN_DEPTH_MPS2,
            DEPTH_DURATION2_M[0] * (rate_hz / width) ** 2,
            5.0 * noise * (1.0 / (2 * centre + 1) + 1.0 / (outer - inner + 1)) ** 0.5,
        )
        window = best[first : first + len(score)]
        better = score > np.maximum(window, floor)
        window[better] = score[better]
        best_width[first : first + len(score)][better] = width
        width *= _SCALE_STEP
    found: list[tuple[int, float, float]] = []
    # Deepest first; a dip rules out others within the shortest period that its duration allows.
    while (depth := float(best[index := int(np.argmax(best))])) > 0.0:
        width = float(best_width[index])
        reach = round(width / DUTY[1])
        best[max(0, index - reach) : index + reach + 1] = 0.0
        if depth * (width / rate_hz) ** 2 <= DEPTH_DURATION2_M[1]:
            found.append((index, depth, width))
    return sorted(found)


def _latest_train(dips: list[tuple[int, float, float]]) -> list[tuple[int, float, float]]:
    """The latest run of three or more dips that one rolling wheel can have made; empty when there is none.

    The deepest are tried first: between two contacts a real belt has shallow dips of its own.
    """
    deepest = max((depth for _, depth, _ in dips), default=0.0)
    for share in _DEPTH_TIERS:
        train = _train_among([dip for dip in dips if dip[1] >= share * deepest])
        if train:
            return train
    return []


def _train_among(dips: list[tuple[int, float, float]]) -> list[tuple[int, float, float]]:
    """As `_latest_train`, every dip taking part."""
    for last in range(len(dips) - 1, 1, -1):
        train = [dips[last]]
        for dip in reversed(dips[:last]):
            interval = train[0][0] - dip[0]
            widths = (train[0][2], dip[2])
            if not DUTY[0] * interval <= min(widths) <= max(widths) <= DUTY[1] * interval * INTERVAL_RATIO:
                break
            if max(widths) > _WIDTH_RATIO * min(widths):
                break
            if len(train) > 1:
                following = train[1][0] - train[0][0]
                ratio = interval / following
                if not 1.0 / INTERVAL_RATIO <= ratio <= INTERVAL_RATIO:
                    break
                # depth goes with 1 / period^2; the factor leaves room for gravity and for the edges' overshoot
                if not 1 / 3.0 <= dip[1] / train[0][1] * ratio**2 <= 3.0:
                    break
            train.insert(0, dip)
        if len(train) >= 3:
            return train
    return []


def _outdone(train: list[tuple[int, float, float]], dips: list[tuple[int, float, float]]) -> bool:
    """Whether a dip within the train makes a better contact: then the train is an edge's overshoot, upside down.

    It happens while fewer than three contacts are in view, but already three overshoots.
    """
    size = float(np.median([depth * width**2 for _, depth, width in train]))
    for before, after in pairwise(train):
        deepest = max(before[1], after[1])
        for at, depth, width in dips:
            if before[0] <= at <= after[0]:
                wide = depth * width**2 / size
                if (depth >= deepest and wide >= _OUTDONE) or (depth >= 1.5 * deepest and wide >= 1.0 / _OUTDONE):
                    return True
    return False


def find_contacts(radial_mps2: FloatArray, rate_hz: float) -> tuple[list[tuple[float, float, float]], int]:
    """Find the contacts of a rolling wheel without knowing its speed, coupling or the sensor's direction.

    Args:
        radial_mps2: (n,) radial axis, nominally positive inward.
        rate_hz: sampling rate.

    Returns:
        (sample, depth, duration in samples) of at least three consecutive contacts, the latest there are, in time
        order and coarsely placed (see `refine_contact`), or none; and the sign that makes the axis positive inward.
    """
    decimation = max(1, int(rate_hz // SEARCH_RATE_HZ))
    n = len(radial_mps2) // decimation * decimation
    signal = radial_mps2[:n].reshape(-1, decimation).mean(axis=1) if decimation > 1 else radial_mps2
    rate = rate_hz / decimation
    best: list[tuple[int, float, float]] = []
    best_sign, best_strength = 1, 0.0
    both = {sign: _dips(signal * sign, rate) for sign in (1, -1)}
    for sign, dips in both.items():
        train = _latest_train(dips)
        if train and not any(_outdone(train, others) for others in both.values()):
            strength = float(np.median([depth for _, depth, _ in train])) * (_SIGN_PREFERENCE if sign > 0 else 1.0)
            if strength > best_strength:
                best, best_sign, best_strength = train, sign, strength
    half = 0.5 * (decimation - 1)
    return [(index * decimation + half, depth, width * decimation) for index, depth, width in best], best_sign


def refine_contact(radial_mps2: FloatArray, guess: float, width: float) -> Contact | None:
    """Place a contact to a fraction of a sample by its two half-level crossings.

    Args:
        radial_mps2: (n,) radial axis, positive inward.
        guess: sample number near the centre, within a quarter of `width`.
        width: expected duration in samples.

    Returns:
        the contact, in sample numbers of the array, or None when a crossing lies outside it.
    """
    middle = round(guess)
    reach = int(np.ceil(1.6 * width)) + 2
    first, end = middle - reach, middle + reach + 1
    if first < 0 or end > len(radial_mps2):
        first, end = max(first, 0), min(end, len(radial_mps2))
    segment = radial_mps2[first:end]
    centre, inner, outer = box_offsets(width)
    at = middle - first
    if at - inner < 1 or at + inner + 1 >= len(segment):
        return None
    low = float(segment[max(at - centre, 0) : at + centre + 1].mean())
    left = float(segment[max(at - outer, 0) : at - inner + 1].mean())
    right = float(segment[at + inner : at + outer + 1].mean())
    depth = min(left, right) - low
    if depth <= 0.0:
        return None
    smooth = max(1, round(width * 0.08))
    kernel = np.full(smooth, 1.0 / smooth)
    smoothed = np.convolve(segment, kernel, mode="valid") if smooth > 1 else segment
    shift = 0.5 * (smooth - 1)
    level = low + 0.5 * depth
    start = min(max(round(at - shift), 0), len(smoothed) - 1)
    rising = np.flatnonzero(smoothed[start:] > level)
    falling = np.flatnonzero(smoothed[: start + 1][::-1] > level)
    if not len(rising) or not len(falling) or rising[0] == 0 or falling[0] == 0:
        return None
    after = start + int(rising[0])
    before = start - int(falling[0])
    up = smoothed[after] - smoothed[after - 1]
    down = smoothed[before] - smoothed[before + 1]
    trailing = after - float(smoothed[after] - level) / float(up)
    leading = before + float(smoothed[before] - level) / float(down)
    # Timing error of a crossing: noise after smoothing over the slope across the smoothing length.
    span = max(1, smooth)
    lo, hi = max(after - span, 0), min(after + span, len(smoothed) - 1)
    slope_up = abs(float(smoothed[hi] - smoothed[lo])) / max(hi - lo, 1)
    lo, hi = max(before - span, 0), min(before + span, len(smoothed) - 1)
    slope_down = abs(float(smoothed[hi] - smoothed[lo])) / max(hi - lo, 1)
    noise = noise_std_mps2(segment) / smooth**0.5
    tiny = np.finfo(float).tiny
    centre_std = 0.5 * noise * float(np.hypot(1.0 / max(slope_up, tiny), 1.0 / max(slope_down, tiny)))
    return Contact(first + shift + 0.5 * (leading + trailing), trailing - leading, depth, centre_std)
