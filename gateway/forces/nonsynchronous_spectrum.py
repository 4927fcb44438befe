"""Power spectrum of the nonsynchronous part of a signal, which is not locked to the wheel, and its spectral lines.

Road roughness, cavity resonance and orders of other shafts do not repeat from revolution to revolution. The time
synchronous average contains what repeats, so its difference from the signal, on the time axis, contains the rest.
"""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.ndimage import median_filter

from gateway.core.types import FloatArray

# Detection threshold, as a quantile of the normal distribution: 800 bins of noise exceed it once in a hundred spectra.
_NORMAL_QUANTILE: Final = 4.2
# Number of bins on either side: for the median that estimates the noise floor, and largest extent of a line.
_FLOOR_BINS: Final = 24
_LINE_BINS: Final = 10
# A line ends where the power falls below this many times the floor.
_LINE_END_RATIO: Final = 1.5
# Equivalent noise bandwidth of the Hann window.
_HANN_NOISE_BINS: Final = 1.5
# Squared correlation of Hann segments that overlap by half.
_OVERLAP_CORRELATION2: Final = 1.0 / 36.0


@dataclass(frozen=True, slots=True)
class Spectrum:
    """Power spectral density, one-sided.

    Attributes:
        frequency_hz: (m,) evenly spaced.
        density_m2ps3: (m,) (m/s^2)^2 per Hz.
        averages: effective number of independent segments averaged.
    """

    frequency_hz: FloatArray
    density_m2ps3: FloatArray
    averages: float

    @property
    def step_hz(self) -> float:
        """Frequency resolution."""
        return float(self.frequency_hz[1] - self.frequency_hz[0])

    def rms_mps2(self, low_hz: float, high_hz: float) -> tuple[float, float]:
        """Return the root mean square between two frequencies and its standard error."""
        in_band = (self.frequency_hz >= low_hz) & (self.frequency_hz <= high_hz)
        power = self.density_m2ps3[in_band]
        total = float(power.sum()) * self.step_hz
        if not total > 0.0:
            return 0.0, 0.0
        variance = _HANN_NOISE_BINS * float(np.square(power).sum()) / self.averages * self.step_hz**2
        return math.sqrt(total), 0.5 * math.sqrt(variance / total)


@dataclass(frozen=True, slots=True)
class Line:
    """A spectral line above the noise floor, with the floor subtracted.

    Attributes:
        frequency_hz: frequency of its centre.
        frequency_std_hz: standard error.
        rms_mps2: root mean square.
        rms_std_mps2: standard error.
    """

    frequency_hz: float
    frequency_std_hz: float
    rms_mps2: float
    rms_std_mps2: float


def welch_spectrum(signal_mps2: FloatArray, rate_hz: float, segment: int) -> Spectrum | None:
    """Return the averaged spectrum of overlapping Hann segments (Welch); None when the signal is shorter than one.

    Args:
        signal_mps2: (m,) evenly spaced in time.
        rate_hz: sampling rate.
        segment: samples per segment, even; the resolution is rate_hz / segment.
    """
    hop = segment // 2
    count = (len(signal_mps2) - segment) // hop + 1
    if count < 1:
        return None
    window = 0.5 - 0.5 * np.cos(2.0 * math.pi * np.arange(segment) / segment)
    pieces = np.lib.stride_tricks.sliding_window_view(signal_mps2, segment)[::hop][:count]
    pieces = (pieces - pieces.mean(axis=1, keepdims=True)) * window
    spectra = np.fft.rfft(pieces, axis=1)
    scale = 2.0 / (rate_hz * float(np.square(window).sum()))
    power: FloatArray = (spectra.real**2 + spectra.imag**2).sum(axis=0) * (scale / count)
    power[0] *= 0.5
    power[-1] *= 0.5
    averages = count / (1.0 + 2.0 * _OVERLAP_CORRELATION2 * (count - 1) / count)
    frequency: FloatArray = np.arange(segment // 2 + 1, dtype=np.float64) * (rate_hz / segment)
    return Spectrum(frequency, power, averages)


def spectral_lines(spectrum: Spectrum, low_hz: float, high_hz: float) -> tuple[Line, ...]:
    """Return the lines between two frequencies, strongest first.

    The width of a line is that of the window or its own, whichever is larger.
    """
    in_band = np.flatnonzero((spectrum.frequency_hz >= low_hz) & (spectrum.frequency_hz <= high_hz))
    if len(in_band) < 2 * _FLOOR_BINS:
        return ()
    power = spectrum.density_m2ps3[in_band]
    frequency = spectrum.frequency_hz[in_band]
    freedom = 2.0 * spectrum.averages
    # Ratio of median to mean of the averaged power, and the threshold of a noise bin (Wilson and Hilferty).
    floor = median_filter(power, 2 * _FLOOR_BINS + 1, mode="mirror") / (1.0 - 2.0 / (9.0 * freedom)) ** 3
    limit = floor * (1.0 - 2.0 / (9.0 * freedom) + _NORMAL_QUANTILE * math.sqrt(2.0 / (9.0 * freedom))) ** 3
    lines = []
    remaining = np.where(power > limit, power, 0.0)
    while (peak := int(np.argmax(remaining))) or remaining[0] > 0.0:
        if not remaining[peak] > 0.0:
            break
        first, last = _extent(power, floor, peak)
        part = slice(first, last + 1)
        remaining[max(0, first - 1) : last + 2] = 0.0
        excess = np.maximum(power[part] - floor[part], 0.0)
        total = float(excess.sum())
        centre = float(excess @ frequency[part]) / total
        moment = float(excess @ np.square(frequency[part] - centre)) / total
        rms = math.sqrt(total * spectrum.step_hz)
        # Both standard errors are those of a narrow band of noise; the errors of a steady tone are smaller.
        variance = _HANN_NOISE_BINS * float(np.square(power[part]).sum()) / spectrum.averages
        lines.append(Line(centre, math.sqrt(moment / spectrum.averages), rms, 0.5 * rms * math.sqrt(variance) / total))
    return tuple(sorted(lines, key=lambda line: -line.rms_mps2))


def _extent(power: FloatArray, floor: FloatArray, peak: int) -> tuple[int, int]:
    """Return the first and last bin of the line around a peak; at least two on either side belong to the window."""
    ends = []
    for step in (-1, 1):
        index = peak
        for distance in range(1, _LINE_BINS + 1):
            following = index + step
            if not 0 <= following < len(power):
                break
            if distance > 2 and power[following] < _LINE_END_RATIO * floor[following]:
                break
            index = following
        ends.append(index)
    return ends[0], ends[1]
