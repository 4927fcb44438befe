"""Narrow lines in single spectra: tones to be excluded from the fit of noise."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from scipy.ndimage import median_filter

from gateway.closure.inference.nonsynchronous_density import Site
from gateway.closure.inference.nonsynchronous_spectra import GroupSpectra
from gateway.types import FloatArray

# Bins on either side that make up a line, and within which the density falls to this share of its peak.
_LINE_BINS: Final = 2
_BESIDE: Final = 4
_VALLEY: Final = 0.25
_FLOOR_BINS: Final = 24
_NORMAL_QUANTILE: Final = 4.8
_WIDEST: Final = 12


def usable_bins(sites: Sequence[Site]) -> list[FloatArray]:
    """Return 1 for bins usable for the noise fit and 0 around tones, (3, m) for each group."""
    found = []
    for site in sites:
        spectra = site.spectra
        used = np.ones((3, len(spectra.frequency_hz)))
        power = spectra.mean_power()
        for axis in np.flatnonzero(spectra.present).tolist():
            for first, last in _tones(spectra, power[axis], axis):
                used[:, first:last] = 0.0
        found.append(used)
    return found


def envelope_moment(
    runs: Sequence[FloatArray], rate_hz: float, axis: int, band: tuple[float, float]
) -> tuple[float, float]:
    """Return E[A^4] / E[A^2]^2 of the envelope in a band (noise 2, tone 1), and the number of independent samples."""
    second = fourth = length = number = 0.0
    for run in runs:
        n = run.shape[1]
        low, high = round(band[0] / rate_hz * n), round(band[1] / rate_hz * n) + 1
        if high - low < 4:
            continue
        spectrum = np.fft.rfft(run[axis])[low:high]
        power = np.square(np.abs(np.fft.ifft(spectrum, 4 * len(spectrum))))
        # Number of independent samples: those at the band's own rate.
        second += float(power.mean()) * len(spectrum)
        fourth += float(np.square(power).mean()) * len(spectrum)
        length += len(spectrum)
        number += high - low
    if not second > 0.0:
        return 2.0, 0.0
    return fourth * length / second**2, number


def running_median(values: FloatArray, half: int) -> FloatArray:
    """Return the median of the bins within `half` of each, mirrored at the ends."""
    return median_filter(values, 2 * half + 1, mode="mirror")


def rare_ratio(freedom: float, quantile: float) -> float:
    """Return the level that a mean of exponential values exceeds as rarely as a normal value exceeds `quantile`.

    The mean is over `freedom` values of mean 1.
    """
    spread = 1.0 / (9.0 * freedom)
    return float((1.0 - spread + quantile * spread**0.5) ** 3)


def _tones(spectra: GroupSpectra, power: FloatArray, axis: int) -> list[tuple[int, int]]:
    if len(power) < 4 * _FLOOR_BINS:
        return []
    # Independent values of a single bin; the correlation with its neighbours is irrelevant here.
    freedom = float(spectra.freedom.sum()) * 1.9
    floor = running_median(power, _FLOOR_BINS)
    ratio = power / floor
    limit = rare_ratio(freedom, _NORMAL_QUANTILE)
    found = []
    left = ratio.copy()
    for _ in range(60):
        peak = int(np.argmax(left))
        if left[peak] < limit:
            break
        line = _part(peak, _LINE_BINS, len(power))
        sides = (power[max(0, peak - _BESIDE) : max(1, peak - 1)], power[peak + 2 : peak + _BESIDE + 1])
        narrow = all(len(side) and side.min() < _VALLEY * power[peak] for side in sides)
        share = max(0.0, 1.0 - float(floor[line].sum() / power[line].sum()))
        low, high = spectra.frequency_hz[line][[0, -1]]
        moment, number = envelope_moment(spectra.runs, spectra.rate_hz, axis, (float(low), float(high)))
        first, last = _extent(ratio, peak)
        if narrow and moment < 2.0 - 0.5 * share**2 and share**2 * np.sqrt(max(number, 1.0)) > 4.0:
            found.append((first, last))
        left[first:last] = 0.0
    return found


def _part(peak: int, half: int, size: int) -> slice:
    return slice(max(0, peak - half), min(size, peak + half + 1))


def _extent(ratio: FloatArray, peak: int) -> tuple[int, int]:
    first = last = peak
    while first > 0 and peak - first < _WIDEST and (peak - first < 3 or ratio[first - 1] > 1.5):
        first -= 1
    while last < len(ratio) - 1 and last - peak < _WIDEST and (last - peak < 3 or ratio[last + 1] > 1.5):
        last += 1
    return first, last + 1
