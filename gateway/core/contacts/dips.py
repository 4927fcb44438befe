"""Detection of dips, of either sign, at every duration that a contact can have.

A multi-scale search: each scale is a box filter of the width of one contact duration.
"""

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gateway.core.revolutions.short_medians import median
from gateway.core.types import FloatArray

MIN_DEPTH_MPS2: Final = 4.0
# Range of depth * duration^2, which is about 1.3 L^2 / R: contact lengths of 40 to 550 mm on radii of 0.2 to 0.6 m.
DEPTH_DURATION2_M: Final = (0.004, 1.5)
# Range of contact durations: 250 km/h with a short contact, 9 km/h with a long one.
DURATION_S: Final = (0.0006, 0.22)
# Gravity makes dips of half a revolution. Scales up to this duration identify them: their score keeps growing beyond
# the longest contact.
_LONGEST_SCALE_S: Final = 0.9
# Boxes of the dip score in units of the contact duration: centre +-0.35, flanks 0.75 to 1.5 on either side.
_CENTRE_HALF, _FLANK_INNER, _FLANK_OUTER = 0.35, 0.75, 1.5
_SCALE_RATIO: Final = 2.0**0.5
# The search reaches back four of the longest periods that a duration allows, and at least this long.
_LOOK_BACK_DURATIONS: Final = 160.0
_LOOK_BACK_S: Final = 0.5
# The sampling rate is halved until a duration has at most this many samples.
_MAX_DURATION_SAMPLES: Final = 17.0
# Least score over the standard deviation that noise gives it.
_NOISE_FACTOR: Final = 5.0
# A signal that is at its maximum or minimum for this share of the samples is clipped.
_CLIPPED_SHARE: Final = 0.05


@dataclass(frozen=True, slots=True)
class Dips:
    """Dips in time order, (k,) each; `centre` and `width` in samples, `depth` and `floor` in the unit of the signal."""

    centre: FloatArray
    depth: FloatArray
    width: FloatArray
    floor: FloatArray

    def __len__(self) -> int:
        return len(self.centre)


def box_offsets(width: float) -> tuple[int, int, int]:
    """Return half the centre box, and the inner and outer flank distance, in samples, for a contact of `width`."""
    centre = max(1, round(_CENTRE_HALF * width))
    inner = max(centre + 1, round(_FLANK_INNER * width))
    return centre, inner, max(inner + 1, round(_FLANK_OUTER * width))


def _boxes(prefix: FloatArray, width: float) -> tuple[FloatArray, FloatArray, FloatArray, int]:
    """Return the means of centre, left and right flank around every sample that has all of them, and the first one."""
    centre, inner, outer = box_offsets(width)
    count = len(prefix) - 1 - 2 * outer
    if count <= 0:
        return np.empty(0), np.empty(0), np.empty(0), outer

    # Means over the samples from `first` to `end` (exclusive) from the first one that has all flanks.
    middle: FloatArray = prefix[outer + centre + 1 :][:count] - prefix[outer - centre :][:count]
    middle *= 1.0 / (2 * centre + 1)
    flanks: FloatArray = prefix[outer - inner + 1 :] - prefix[: inner - outer - 1]
    flanks *= 1.0 / (outer - inner + 1)
    return middle, flanks[:count], flanks[inner + outer :], outer


def dip_score(prefix: FloatArray, width: float) -> tuple[FloatArray, int]:
    """Score every sample as the centre of a dip of `width` samples: mean of the lower flank minus that of the centre.

    Args:
        prefix: (n + 1,) cumulative sum of the signal, starting with 0.
        width: expected contact duration in samples.

    Returns:
        scores in the signal's unit and the sample number of the first score; no scores when n is too small.
    """
    centre, leading, trailing, first = _boxes(prefix, width)
    flanks = np.minimum(leading, trailing, out=leading)
    flanks -= centre
    return flanks, first


def noise_std_mps2(signal: FloatArray) -> float:
    """Return the standard deviation of a signal's white noise, from the median of second differences (robust)."""
    if len(signal) < 8:
        return 0.0
    second = signal[1:-1] * -2.0
    second += signal[2:]
    second += signal[:-2]
    return median(np.abs(second, out=second)) / (0.6745 * math.sqrt(6.0))


class _Scale(NamedTuple):
    """Scores at one duration.

    Attributes:
        width: duration in samples of the signal.
        first: sample number of the first score.
        step: samples of the signal from score to score.
        reach: half a duration, in scores.
        score: (2, n) scores of the signal and of its negative.
        centre: (n,) mean of the centre box.
    """

    width: float
    first: float
    step: int
    reach: int
    score: FloatArray
    centre: FloatArray

    def highest(self, of: NDArray[np.intp], index: NDArray[np.intp]) -> FloatArray:
        """Return the highest scores within half a duration of places, (k,); -inf where there are none.

        Args:
            of: (k,) 0 for the signal, 1 for its negative.
            index: (k,) numbers of scores, may lie outside.
        """
        n = self.score.shape[1]
        around = index[:, np.newaxis] + np.arange(-self.reach, self.reach + 1)
        np.minimum(np.maximum(around, 0, out=around), n - 1, out=around)
        around += (of * n)[:, np.newaxis]
        values: FloatArray = np.maximum.reduce(self.score.reshape(-1).take(around), axis=1)
        values[(index < 0) | (index >= n)] = -math.inf
        return values


def find_dips(signal: FloatArray, rate_hz: float) -> dict[int, Dips]:
    """Find the dips of a signal and of its negative that may be contacts, each at its best-fitting duration.

    Args:
        signal: (n,) radial axis in m/s^2.
        rate_hz: sampling rate.

    Returns:
        for sign 1 and -1 the dips of the signal times that sign.
    """
    scales = _scales(signal, rate_hz)
    noise = noise_std_mps2(signal[-round(2.0 * rate_hz) :])
    lowest = 0.0 if is_at_range_end(signal) else DEPTH_DURATION2_M[0]
    longest_width = DURATION_S[1] * rate_hz
    parts = [np.empty((5, 0))]
    for number, scale in enumerate(scales):
        if scale.width > longest_width:
            break
        score = scale.score
        centre, inner, outer = box_offsets(scale.width / scale.step)
        floor = max(
            MIN_DEPTH_MPS2,
            lowest * (rate_hz / scale.width) ** 2,
            _NOISE_FACTOR * noise * ((1.0 / (2 * centre + 1) + 1.0 / (outer - inner + 1)) / scale.step) ** 0.5,
        )
        # The highest within half a duration is also one that is not lower than its neighbours.
        is_top = score > floor
        rises = score[:, 1:] >= score[:, :-1]
        is_top[:, 1:] &= rises
        falls = score[:, 1:] <= score[:, :-1]
        is_top[:, :-1] &= falls
        row, top = is_top.nonzero()
        if not len(top):
            continue
        depth = score[row, top]
        is_best = depth >= scale.highest(row, top)
        is_best &= depth * (scale.width / rate_hz) ** 2 <= DEPTH_DURATION2_M[1]
        row, top, depth = row[is_best], top[is_best], depth[is_best]
        centres = scale.first + top * float(scale.step)
        is_best = np.ones(len(top), np.bool_)
        for nearby in scales[max(number - 1, 0) : number] + scales[number + 1 : number + 2]:
            is_best &= depth >= nearby.highest(row, np.rint((centres - nearby.first) / nearby.step).astype(np.intp))
        sign = 1.0 - 2.0 * row[is_best]
        width = np.full(len(sign), scale.width)
        parts.append(np.stack((centres[is_best], depth[is_best], width, sign * scale.centre[top[is_best]], sign)))
    dips = np.concatenate(parts, axis=1)
    return {sign: _without_duplicates(dips[:4, dips[4] == sign]) for sign in (1, -1)}


def is_at_range_end(signal: FloatArray) -> bool:
    """Return whether a signal equals its maximum or minimum so often that this is the end of the sensor's range."""
    limit = _CLIPPED_SHARE * len(signal)
    return bool(np.count_nonzero(signal == signal.max()) > limit or np.count_nonzero(signal == signal.min()) > limit)


def _scales(signal: FloatArray, rate_hz: float) -> list[_Scale]:
    scales: list[_Scale] = []
    step, start = 1, 0
    prefix = np.concatenate(([0.0], np.cumsum(signal)))
    width = max(3.0, DURATION_S[0] * rate_hz)
    while width <= _LONGEST_SCALE_S * rate_hz:
        while width > _MAX_DURATION_SAMPLES * step:
            # Blocks end where the signal ends; samples that do not fill a block are dropped at the beginning.
            step *= 2
            length = (len(signal) // step) * step
            start = len(signal) - length
            prefix = np.concatenate(([0.0], np.cumsum(signal[start:].reshape(-1, step).mean(axis=1))))
        look_back = round(max(_LOOK_BACK_S * rate_hz, _LOOK_BACK_DURATIONS * width) / step)
        skip = max(0, len(prefix) - 1 - look_back)
        centre, leading, trailing, first = _boxes(prefix[skip:], width / step)
        if not len(centre):
            break
        score = np.empty((2, len(centre)))
        np.subtract(np.minimum(leading, trailing), centre, out=score[0])
        np.subtract(centre, np.maximum(leading, trailing), out=score[1])
        reach = max(1, round(0.5 * width / step))
        scales.append(_Scale(width, start + (skip + first + 0.5) * step - 0.5, step, reach, score, centre))
        width *= _SCALE_RATIO
    return scales


def _without_duplicates(parts: FloatArray) -> Dips:
    """Return the deepest of dips that overlap by more than half."""
    order = np.argsort(-parts[1], kind="stable")
    centre, _, width, _ = parts[:, order]
    unique: list[int] = []
    is_remaining = np.ones(len(centre), bool)
    for index in range(len(centre)):
        if is_remaining[index]:
            unique.append(index)
            is_remaining &= np.abs(centre - centre[index]) > 0.5 * np.maximum(width, width[index])
    chosen = parts[:, order[unique]]
    chosen = chosen[:, np.argsort(chosen[0], kind="stable")]
    return Dips(chosen[0], chosen[1], chosen[2], chosen[3])
