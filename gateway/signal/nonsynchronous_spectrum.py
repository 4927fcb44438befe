"""What is not locked to the wheel: a spectrum over time with the angle-locked part taken off, and its lines.

Road roughness, the cavity's resonance and engine orders of another shaft do not repeat from revolution to revolution.
The time synchronous average holds what does, so the difference, put back on the time axis, holds the rest.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from gateway.types import FloatArray

# A line stands above the floor by what 800 bins of noise exceed once in a hundred spectra.
_NORMAL_QUANTILE: Final = 4.2
# Bins on either side that the floor is the median of, and that a line may take up.
_FLOOR_BINS: Final = 24
_LINE_BINS: Final = 10
# A line ends where it sinks to this many times the floor.
_LINE_END: Final = 1.5
_HANN_NOISE_BINS: Final = 1.5
# Square of the correlation of Hann segments that overlap by half.
_OVERLAP: Final = 1.0 / 36.0


@dataclass(frozen=True, slots=True)
class Spectrum:
    """Power spectral density, one-sided.

    Attributes:
        frequency_hz: (m,) evenly spaced.
        density_m2ps3: (m,) (m/s^2)^2 per Hz.
        averages: independent segments behind each value.
    """

    frequency_hz: FloatArray
    density_m2ps3: FloatArray
    averages: float

    @property
    def step_hz(self) -> float:
        """Distance of two frequencies."""
        return float(self.frequency_hz[1] - self.frequency_hz[0])

    def rms_mps2(self, low_hz: float, high_hz: float) -> tuple[float, float]:
        """Return the root mean square between two frequencies and its standard error."""
        inside = (self.frequency_hz >= low_hz) & (self.frequency_hz <= high_hz)
        power = self.density_m2ps3[inside]
        total = float(power.sum()) * self.step_hz
        if not total > 0.0:
            return 0.0, 0.0
        variance = _HANN_NOISE_BINS * float(np.square(power).sum()) / self.averages * self.step_hz**2
        return math.sqrt(total), 0.5 * math.sqrt(variance / total)


@dataclass(frozen=True, slots=True)
class Line:
    """A peak that stands out of its surroundings, with the floor under it taken off.

    Attributes:
        frequency_hz: of its centre.
        frequency_std_hz: one standard error.
        rms_mps2: root mean square.
        rms_std_mps2: one standard error.
    """

    frequency_hz: float
    frequency_std_hz: float
    rms_mps2: float
    rms_std_mps2: float


def welch_spectrum(signal_mps2: FloatArray, rate_hz: float, segment: int) -> Spectrum | None:
    """Return the averaged spectrum of overlapping Hann segments, or None when the signal is shorter than one.

    Args:
        signal_mps2: (m,) evenly spaced in time.
        rate_hz: samples a second.
        segment: samples of one segment, even; the resolution is rate_hz / segment.
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
    averages = count / (1.0 + 2.0 * _OVERLAP * (count - 1) / count)
    frequency: FloatArray = np.arange(segment // 2 + 1, dtype=np.float64) * (rate_hz / segment)
    return Spectrum(frequency, power, averages)


def spectral_lines(spectrum: Spectrum, low_hz: float, high_hz: float) -> tuple[Line, ...]:
    """Return the lines between two frequencies, strongest first.

    A line's width is that of the spectrum's window or its own, whichever is more.
    """
    inside = np.flatnonzero((spectrum.frequency_hz >= low_hz) & (spectrum.frequency_hz <= high_hz))
    if len(inside) < 2 * _FLOOR_BINS:
        return ()
    power = spectrum.density_m2ps3[inside]
    frequency = spectrum.frequency_hz[inside]
    padded = np.pad(power, _FLOOR_BINS, mode="reflect")
    around = np.lib.stride_tricks.sliding_window_view(padded, 2 * _FLOOR_BINS + 1)
    freedom = 2.0 * spectrum.averages
    # Median of the averaged power over its mean, and what a bin of noise exceeds rarely (Wilson and Hilferty).
    floor = np.median(around, axis=1) / (1.0 - 2.0 / (9.0 * freedom)) ** 3
    limit = floor * (1.0 - 2.0 / (9.0 * freedom) + _NORMAL_QUANTILE * math.sqrt(2.0 / (9.0 * freedom))) ** 3
    lines = []
    left = np.where(power > limit, power, 0.0)
    while (peak := int(np.argmax(left))) or left[0] > 0.0:
        if not left[peak] > 0.0:
            break
        first, last = _extent(power, floor, peak)
        part = slice(first, last + 1)
        left[max(0, first - 1) : last + 2] = 0.0
        own = np.maximum(power[part] - floor[part], 0.0)
        total = float(own.sum())
        centre = float(own @ frequency[part]) / total
        spread2 = float(own @ np.square(frequency[part] - centre)) / total
        rms = math.sqrt(total * spectrum.step_hz)
        # Both for a narrow band of noise; a steady tone is known better than this.
        variance = _HANN_NOISE_BINS * float(np.square(power[part]).sum()) / spectrum.averages
        lines.append(Line(centre, math.sqrt(spread2 / spectrum.averages), rms, 0.5 * rms * math.sqrt(variance) / total))
    return tuple(sorted(lines, key=lambda line: -line.rms_mps2))


def _extent(power: FloatArray, floor: FloatArray, peak: int) -> tuple[int, int]:
    """Return the first and last bin of the line around a peak; two on either side at least belong to the window."""
    ends = []
    for step in (-1, 1):
        at = peak
        for distance in range(1, _LINE_BINS + 1):
            following = at + step
            if not 0 <= following < len(power):
                break
            if distance > 2 and power[following] < _LINE_END * floor[following]:
                break
            at = following
        ends.append(at)
    return ends[0], ends[1]
