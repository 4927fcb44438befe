"""Comparison of the radial axis with its own revolutions, which reveals a column in another unit than stated."""

import math
from typing import Final

import numpy as np

from gateway.core.reasons import Reason
from gateway.core.types import FloatArray
from gateway.importing.import_map import ACCELERATION_UNITS_MPS2
from gateway.importing.reasons import ImportCode

_FASTEST_MPS: Final = 110.0
_SLOWEST_MPS: Final = 2.0
# Correlation with itself one revolution later; noise and a wheel at rest stay below.
_MIN_CORRELATION: Final = 0.4
_ONE_REVOLUTION: Final = 0.85
# The belt radius may be assumed and the contact's depth is rough, but units are a factor of 9.8 apart.
_TOLERANCE: Final = 1.6
_SMOOTHED_SHARE: Final = 0.02
# Three revolutions taken for one are a factor of 9.
_NO_UNIT: Final = 20.0


def unlikely_unit(radial_mps2: FloatArray, rate_hz: float, radius_m: float, stated: str, *, dc: bool) -> Reason | None:
    """Return a finding when the stated unit does not fit the revolutions, but another one does, or none by far.

    On a rolling wheel the mean of the radial axis is V^2/R = (2 pi / T)^2 R. An AC-coupled sensor has no mean, but in
    the contact it reads less by the same amount. The period T is the lag at which the signal repeats.

    Args:
        radial_mps2: (n,) radial axis at uniform times; NaN where missing.
        rate_hz: sampling rate.
        radius_m: belt radius, stated or assumed.
        stated: unit stated in the map.
        dc: whether the sensor passes the steady value.
    """
    period = revolution_lag(radial_mps2, rate_hz, radius_m)
    if period is None:
        return None
    period_s = period / rate_hz
    expected_mps2 = (2.0 * math.pi / period_s) ** 2 * radius_m
    found_mps2 = abs(float(np.nanmean(radial_mps2))) if dc else contact_depth(radial_mps2, period)
    if not found_mps2 > 0.0:
        return None
    units = {name: ACCELERATION_UNITS_MPS2[name] for name in ("m/s^2", "g", "mg")}
    if fits(found_mps2, expected_mps2):
        return None
    for name, factor_mps2 in units.items():
        if fits(found_mps2 * factor_mps2 / ACCELERATION_UNITS_MPS2[stated], expected_mps2):
            return Reason(
                ImportCode.UNIT_UNLIKELY,
                found_mps2=found_mps2,
                expected_mps2=expected_mps2,
                ratio=found_mps2 / expected_mps2,
                period_s=period_s,
                radius_m=radius_m,
                stated=stated,
                fitting=name,
            )
    ratio = found_mps2 / expected_mps2
    if no_unit_fits(ratio):
        return Reason(ImportCode.SCALE_UNLIKELY, found_mps2=found_mps2, expected_mps2=expected_mps2, ratio=ratio)
    return None


def no_unit_fits(ratio: float) -> bool:
    """Return whether a steady acceleration is so far from V^2/R that not even a missed revolution explains it."""
    return abs(math.log(ratio)) > math.log(_NO_UNIT)


def fits(found_mps2: float, expected_mps2: float) -> bool:
    """Return whether a steady acceleration agrees with that of the revolutions; units are further apart."""
    return abs(math.log(found_mps2 / expected_mps2)) < math.log(_TOLERANCE)


def revolution_lag(signal: FloatArray, rate_hz: float, radius_m: float) -> int | None:
    """Return the shortest lag, in samples, at which the signal repeats; None when it does not."""
    count = len(signal)
    min_lag = math.ceil(2.0 * math.pi * radius_m / _FASTEST_MPS * rate_hz)
    max_lag = min(int(2.0 * math.pi * radius_m / _SLOWEST_MPS * rate_hz), count // 2)
    present = np.isfinite(signal)
    if max_lag <= min_lag or not present.any():
        return None
    centred = np.where(present, signal - np.nanmean(signal), 0.0)
    spectrum = np.fft.rfft(centred, 2 * count)
    products = np.fft.irfft(np.abs(spectrum) ** 2)[: max_lag + 1]
    correlation = products / np.maximum(count - np.arange(max_lag + 1), 1) * count
    if not correlation[0] > 0.0:
        return None
    correlation /= correlation[0]
    # The main lobe around lag 0 is the width of the contact, not a period.
    below = np.flatnonzero(correlation < 0.25)
    start = max(min_lag, int(below[0]) if len(below) else max_lag)
    if start >= max_lag:
        return None
    peak = float(correlation[start:].max())
    if peak < _MIN_CORRELATION:
        return None
    first = start + int(np.flatnonzero(correlation[start:] >= _ONE_REVOLUTION * peak)[0])
    return first + int(np.argmax(correlation[first : first + max(1, first // 20)]))


def contact_depth(signal: FloatArray, period: int) -> float:
    """Return how far the contact lies below the rest of a revolution, in the signal's unit."""
    turns = len(signal) // period
    width = max(1, round(_SMOOTHED_SHARE * period))
    filled = np.where(np.isfinite(signal), signal, np.nanmedian(signal))
    smooth = np.convolve(filled, np.ones(width) / width, "same")
    # The contact may lie anywhere in a turn, and the period is not a whole number of samples.
    parts = smooth[: turns * period].reshape(turns, period)
    return float(np.median(np.median(parts, axis=1) - parts.min(axis=1)))
