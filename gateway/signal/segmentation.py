"""Passages of the sensor through the contact: dips of the radial axis, identified by their physics.

Outside the contact a radial inner-liner sensor reads R Omega^2, inside it about zero, with overshoots at both edges
(curvature law s = V^2 kappa). A contact of length L at speed v is therefore a dip of depth about R Omega^2 = v^2 / R
and duration w = L / v, so that depth * w^2 = L^2 / R at any speed. That product distinguishes contacts from other dips.
"""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass
from typing import Final

import numpy as np

from gateway.signal.contact_trains import Known, best_train, doubtful
from gateway.signal.dips import box_offsets, find_dips, is_at_range_end, noise_std_mps2
from gateway.types import FloatArray

# Highest sampling rate of the search; the shortest contact still spans three samples.
SEARCH_RATE_HZ: Final = 4800.0
# The strength of trains of the nominal sign is multiplied by this.
_SIGN_PREFERENCE: Final = 1.15
# Linear interpolation of the crossings leaves this error of the centre, in samples, falling with the contact's width
# above the second number of samples.
_SAMPLING_STD: Final = 0.1
_SAMPLING_WIDTH: Final = 8.0
# Depth over noise that smoothing must reach before crossings are searched.
_CROSSING_FACTOR: Final = 8.0

# A wheel without contacts stands still when its signal varies by less than this.
STANDSTILL_STD_MPS2: Final = 2.5
_STILL_BOX_S: Final = 0.05


@dataclass(frozen=True, slots=True)
class Contact:
    """One passage through the contact patch.

    Attributes:
        centre: running sample number, fractional, midway between the two half-level crossings.
        duration: samples between the half-level crossings.
        depth_mps2: flanks minus contact, positive.
        centre_std: standard error of `centre` in samples.
        predicted: True when this contact was not observed, because its samples were lost or disturbed by an impact, and
            its place was interpolated between its neighbours.
    """

    centre: float
    duration: float
    depth_mps2: float
    centre_std: float
    predicted: bool = False


def find_contacts(
    radial_mps2: FloatArray, rate_hz: float, known: Known | None = None
) -> tuple[list[tuple[float, float, float]], int]:
    """Find the contacts of a rolling wheel without knowing its speed, coupling or the sensor's direction.

    Args:
        radial_mps2: (n,) radial axis, nominally positive inward.
        rate_hz: sampling rate.
        known: properties of the wheel, if known.

    Returns:
        (sample, depth, duration in samples) of the latest train of at least three consecutive contacts, in time order
        and coarsely placed (see `refine_contact`), or none; and the sign that makes the axis positive inward.
    """
    decimation = max(1, int(rate_hz // SEARCH_RATE_HZ))
    n = len(radial_mps2) // decimation * decimation
    signal = radial_mps2[:n].reshape(-1, decimation).mean(axis=1) if decimation > 1 else radial_mps2
    rate = rate_hz / decimation
    both = find_dips(signal, rate)
    prefix = np.concatenate(([0.0], np.cumsum(signal)))
    clipped_span = float(np.ptp(signal)) if is_at_range_end(signal) else 0.0
    best: list[int] = []
    best_sign, best_strength = 1, 0.0
    for sign in (1, -1) if known is None else (known.sign,):
        dips = both[sign]
        train, strength = best_train(dips, sign * prefix, rate, clipped_span=clipped_span, known=known)
        strength *= _SIGN_PREFERENCE if sign > 0 else 1.0
        if strength > best_strength and (known is not None or not doubtful(train, dips, both[-sign])):
            best, best_sign, best_strength = train, sign, strength
    half, found = 0.5 * (decimation - 1), both[best_sign]
    coarse = [(found.at[i] * decimation + half, found.depth[i], found.width[i] * decimation) for i in best]
    return [(float(at), float(depth), float(width)) for at, depth, width in coarse], best_sign


def refine_contact(radial_mps2: FloatArray, guess: float, width: float) -> Contact | None:
    """Locate a contact to a fraction of a sample by its two half-level crossings.

    Args:
        radial_mps2: (n,) radial axis, positive inward.
        guess: sample number near the centre, within a quarter of `width`.
        width: expected duration in samples.

    Returns:
        the contact, in sample numbers of the array, or None when a crossing lies outside it.
    """
    middle = round(guess)
    reach = math.ceil(1.6 * width) + 2
    first, end = max(middle - reach, 0), min(middle + reach + 1, len(radial_mps2))
    segment = radial_mps2[first:end]
    at = middle - first
    levels = _dip_levels(segment, at, width)
    if levels is None:
        return None
    low, depth = levels
    # More noise needs more smoothing, or the first noisy sample beyond the level is mistaken for the edge.
    noise = noise_std_mps2(segment)
    smooth = max(1, round(width * 0.08), round(min(0.35 * width, (_CROSSING_FACTOR * noise / depth) ** 2)))
    smoothed = _smoothed(segment, smooth) if smooth > 1 else segment
    shift = 0.5 * (smooth - 1)
    level = low + 0.5 * depth
    start = min(max(round(at - shift), 0), len(smoothed) - 1)
    after, before = _crossing(smoothed, start, level, 1), _crossing(smoothed, start, level, -1)
    if after is None or before is None:
        return None
    (below, above), (above_before, below_before) = smoothed[after - 1 : after + 1], smoothed[before : before + 2]
    trailing = after - float((above - level) / (above - below))
    leading = before + float((above_before - level) / (above_before - below_before))
    # Timing error of a crossing: noise after smoothing, divided by the slope over the smoothing length.
    slopes = [max(_mean_slope(smoothed, place, smooth), sys.float_info.min) for place in (after, before)]
    centre_std = 0.5 * noise / smooth**0.5 * math.hypot(*(1.0 / slope for slope in slopes))
    centre_std = math.hypot(centre_std, _SAMPLING_STD * min(1.0, _SAMPLING_WIDTH / width))
    return Contact(first + shift + 0.5 * (leading + trailing), trailing - leading, depth, centre_std)


def _smoothed(values: FloatArray, count: int) -> FloatArray:
    """Return the means of `count` neighbouring values, (n - count + 1,)."""
    total = np.add.accumulate(values)
    means = total[count - 1 :].copy()
    means[1:] -= total[:-count]
    means *= 1.0 / count
    return means


def _dip_levels(segment: FloatArray, at: int, width: float) -> tuple[float, float] | None:
    """Return the level of the dip around sample `at`, and its depth below the lower flank; None without a dip."""
    centre, inner, outer = box_offsets(width)
    if at - inner < 1 or at + inner + 1 >= len(segment):
        return None
    low = _mean(segment[max(at - centre, 0) : at + centre + 1])
    left = _mean(segment[max(at - outer, 0) : at - inner + 1])
    right = _mean(segment[at + inner : at + outer + 1])
    depth = min(left, right) - low
    return (low, depth) if depth > 0.0 else None


def _mean(values: FloatArray) -> float:
    """Return the mean; the method of arrays takes four times as long for some ten values."""
    return float(np.add.reduce(values)) / len(values)


def _crossing(smoothed: FloatArray, start: int, level: float, direction: int) -> int | None:
    """Return the first sample above the level from `start` on, in direction 1 or -1; None without a crossing."""
    above = (smoothed[start:] if direction > 0 else smoothed[start::-1]) > level
    distance = int(above.argmax())
    # Position 0 is also that of no crossing at all.
    return start + direction * distance if distance > 0 else None


def _mean_slope(smoothed: FloatArray, place: int, span: int) -> float:
    """Return the absolute slope over `span` samples on either side of a place, within the signal."""
    lo, hi = max(place - span, 0), min(place + span, len(smoothed) - 1)
    return abs(float(smoothed[hi] - smoothed[lo])) / max(hi - lo, 1)


def is_still(radial_mps2: FloatArray, rate_hz: float) -> bool:
    """Return whether a radial axis without contacts varies as little as that of a wheel at rest."""
    box = max(1, round(_STILL_BOX_S * rate_hz))
    n = len(radial_mps2) // box * box
    return n >= 4 * box and float(radial_mps2[:n].reshape(-1, box).mean(axis=1).std()) < STANDSTILL_STD_MPS2
