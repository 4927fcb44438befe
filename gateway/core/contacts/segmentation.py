"""Passages of the sensor through the contact: dips of the radial axis, identified by their physics.

Outside the contact a radial inner-liner sensor reads R Omega^2, inside it about zero, with overshoots at both edges
(curvature law s = V^2 kappa). A contact of length L at speed v is therefore a dip of depth about R Omega^2 = v^2 / R
and duration w = L / v, so that depth * w^2 = L^2 / R at any speed. That product distinguishes contacts from other dips.
"""

import math
import sys
from typing import Final, NamedTuple

import numpy as np

from gateway.core.compiled import core
from gateway.core.contacts.contact_trains import WheelProperties, best_train, doubtful
from gateway.core.contacts.dips import box_offsets, find_dips, is_at_range_end, noise_std_mps2
from gateway.core.types import FloatArray

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


class Contact(NamedTuple):
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
    radial_mps2: FloatArray, rate_hz: float, prior: WheelProperties | None = None
) -> tuple[list[tuple[float, float, float]], int]:
    """Find the contacts of a rolling wheel without knowing its speed, coupling or the sensor's direction.

    Args:
        radial_mps2: (n,) radial axis, nominally positive inward.
        rate_hz: sampling rate.
        prior: properties of the wheel from earlier contacts, if any.

    Returns:
        (sample, depth, duration in samples) of the latest train of at least three consecutive contacts, in time order
        and coarsely placed (see `refine_contact`), or none; and the sign that makes the axis positive inward.
    """
    decimation = max(1, int(rate_hz // SEARCH_RATE_HZ))
    n = len(radial_mps2) // decimation * decimation
    signal = radial_mps2[:n].reshape(-1, decimation).mean(axis=1) if decimation > 1 else radial_mps2
    rate = rate_hz / decimation
    dips_by_sign = find_dips(signal, rate)
    prefix = np.concatenate(([0.0], np.cumsum(signal)))
    clipped_span = float(np.ptp(signal)) if is_at_range_end(signal) else 0.0
    best_indices: list[int] = []
    best_sign, best_strength = 1, 0.0
    for sign in (1, -1) if prior is None else (prior.sign,):
        dips = dips_by_sign[sign]
        train, strength = best_train(dips, sign * prefix, rate, clipped_span=clipped_span, prior=prior)
        strength *= _SIGN_PREFERENCE if sign > 0 else 1.0
        if strength > best_strength and (prior is not None or not doubtful(train, dips, dips_by_sign[-sign])):
            best_indices, best_sign, best_strength = train, sign, strength
    half, dips_of_sign = 0.5 * (decimation - 1), dips_by_sign[best_sign]
    coarse = [
        (dips_of_sign.centre[i] * decimation + half, dips_of_sign.depth[i], dips_of_sign.width[i] * decimation)
        for i in best_indices
    ]
    return [(float(centre), float(depth), float(width)) for centre, depth, width in coarse], best_sign


def refine_contact(
    radial_mps2: FloatArray, guess: float, width: float, *, prefix: FloatArray | None = None, first: int = 0
) -> Contact | None:
    """Locate a contact to a fraction of a sample by its two half-level crossings.

    Args:
        radial_mps2: (n,) radial axis, positive inward.
        guess: sample number near the centre, within a quarter of `width`.
        width: expected duration in samples.
        prefix: (n + 1,) cumulative sum of the axis from 0 on, if known.
        first: number of the first sample.

    Returns:
        the contact, or None when a crossing lies outside the array.
    """
    return refined(radial_mps2, cumulative(radial_mps2) if prefix is None else prefix, guess, width, first)


def _refined_by_numpy(
    radial_mps2: FloatArray, prefix: FloatArray, guess: float, width: float, first: int
) -> Contact | None:
    """Locate a contact, as `refine_contact`."""
    middle = round(guess - first)
    reach = math.ceil(1.6 * width) + 2
    begin, end = max(middle - reach, 0), min(middle + reach + 1, len(radial_mps2))
    levels = _dip_levels(prefix, begin, middle, end, width)
    if levels is None:
        return None
    low, depth = levels
    # More noise needs more smoothing, or the first noisy sample beyond the level is mistaken for the edge.
    noise = noise_std_mps2(radial_mps2[begin:end])
    smooth = max(1, round(width * 0.08), round(min(0.35 * width, (_CROSSING_FACTOR * noise / depth) ** 2)))
    # Sums of `smooth` neighbouring samples.
    sums = prefix[begin + smooth : end + 1] - prefix[begin : end + 1 - smooth]
    level = (low + 0.5 * depth) * smooth
    shift = 0.5 * (smooth - 1)
    start = min(max(round(middle - begin - shift), 0), len(sums) - 1)
    above = sums > level
    after, before = start + int(above[start:].argmax()), start - int(above[start::-1].argmax())
    # No distance is also that of no crossing at all.
    if after == start or before == start:
        return None
    inside, outside = sums.item(after - 1), sums.item(after)
    trailing = after - (outside - level) / (outside - inside)
    inside, outside = sums.item(before + 1), sums.item(before)
    leading = before + (outside - level) / (outside - inside)
    # Timing error of a crossing: noise after smoothing, divided by the slope over the smoothing length.
    slopes = [max(_mean_slope(sums, index, smooth) / smooth, sys.float_info.min) for index in (after, before)]
    centre_std = 0.5 * noise / smooth**0.5 * math.hypot(1.0 / slopes[0], 1.0 / slopes[1])
    centre_std = math.hypot(centre_std, _SAMPLING_STD * min(1.0, _SAMPLING_WIDTH / width))
    return Contact(first + begin + shift + 0.5 * (leading + trailing), trailing - leading, depth, centre_std)


def _refined_by_core(
    radial_mps2: FloatArray, prefix: FloatArray, guess: float, width: float, first: int
) -> Contact | None:
    """As `_refined_by_numpy`."""
    assert core is not None
    radial = np.ascontiguousarray(radial_mps2)
    located = core.refine(radial, prefix, guess, width, first, np.empty(len(radial)))
    return Contact(*located) if located is not None else None


refined = _refined_by_numpy if core is None else _refined_by_core


def cumulative(values: FloatArray) -> FloatArray:
    """Return the cumulative sum of (n,) values from 0 on, (n + 1,)."""
    prefix = np.empty(len(values) + 1)
    prefix[0] = 0.0
    np.add.accumulate(values, out=prefix[1:])
    return prefix


def _dip_levels(prefix: FloatArray, begin: int, middle: int, end: int, width: float) -> tuple[float, float] | None:
    """Return the level of the dip around a sample, and its depth below the lower flank; None without a dip.

    Args:
        prefix: cumulative sum of the signal.
        begin: first sample that is used.
        middle: sample near the dip's centre.
        end: last sample that is used (exclusive).
        width: of the dip in samples.
    """
    centre, inner, outer = box_offsets(width)
    if middle - inner < begin + 1 or middle + inner + 1 >= end:
        return None

    def mean(first: int, last: int) -> float:
        first, last = max(first, begin), min(last, end)
        return (prefix.item(last) - prefix.item(first)) / (last - first)

    low = mean(middle - centre, middle + centre + 1)
    before = mean(middle - outer, middle - inner + 1)
    after = mean(middle + inner, middle + outer + 1)
    depth = min(before, after) - low
    return (low, depth) if depth > 0.0 else None


def _mean_slope(values: FloatArray, index: int, span: int) -> float:
    """Return the absolute slope over `span` values on either side of a place, within the array."""
    lo, hi = max(index - span, 0), min(index + span, len(values) - 1)
    return abs(values.item(hi) - values.item(lo)) / max(hi - lo, 1)


def is_still(radial_mps2: FloatArray, rate_hz: float) -> bool:
    """Return whether a radial axis without contacts varies as little as that of a wheel at rest."""
    box = max(1, round(_STILL_BOX_S * rate_hz))
    n = len(radial_mps2) // box * box
    return n >= 4 * box and float(radial_mps2[:n].reshape(-1, box).mean(axis=1).std()) < STANDSTILL_STD_MPS2
