"""Spectra of the nonsynchronous signal, by fold and in the bins of the fit."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from gateway.core.types import BoolArray, ComplexArray, FloatArray, IntArray
from gateway.diagnosis.data.campaign_data import Group, Remark
from gateway.diagnosis.effects.effect import CIRCUMFERENTIAL, RADIAL, GroupConditions

RESOLUTION_HZ: Final = 1.0
LOWEST_HZ: Final = 3.0
"""Lowest frequency used; below it, drift and the alignment of revolutions distort the spectrum."""

# Bandwidth of the deviations relative to their sampling rate.
_BAND_RATIO: Final = 0.4
# Variance factors of overlapping Hann segments, from the correlation of power in neighbouring bins (both sides) and in
# neighbouring segments.
_BIN_FACTOR: Final = 1.0 + 2.0 * (4.0 / 9.0 + 1.0 / 36.0)
_SEGMENT_FACTOR: Final = 1.0 + 2.0 / 36.0
# Bins for the fit: (upper frequency, width in bins). They are narrow around the hub and cavity resonances.
_WIDTHS_HZ: Final = ((45.0, 1), (140.0, 4), (310.0, 1), (600.0, 10), (1e9, 25))
_LEAST_SEGMENTS: Final = 2


@dataclass(frozen=True, slots=True)
class GroupSpectra:
    """Periodograms of one group, averaged by fold.

    Attributes:
        label: of the group.
        conditions: of the group.
        half_angle_rad: of the contact.
        present: (3,) whether each axis is present.
        frequency_hz: (m,) evenly spaced, by RESOLUTION_HZ or nearly so.
        power: (folds, 3, m) one-sided mean density of each fold; 0 for absent axes.
        freedom: (folds,) independent values behind one bin of 1 Hz, as if neighbouring bins were independent.
        cross: (m,) mean of X_radial conj(X_circumferential) on the same scale; 0 if either is absent.
        runs: the deviations, float64, 0 for absent axes.
        rate_hz: sampling rate of the deviations.
        first: (b,) first bin of each wide bin.
        count: (b,) bins in each.
    """

    label: Remark
    conditions: GroupConditions
    half_angle_rad: float
    present: BoolArray
    frequency_hz: FloatArray
    power: FloatArray
    freedom: FloatArray
    cross: ComplexArray
    runs: tuple[FloatArray, ...]
    rate_hz: float
    first: IntArray
    count: IntArray

    @property
    def step_hz(self) -> float:
        """Spacing of the bins."""
        return float(self.frequency_hz[1] - self.frequency_hz[0])

    @property
    def wheel_hz(self) -> float:
        """Revolutions per second."""
        return self.conditions.omega_radps / (2.0 * np.pi)

    @property
    def speed_mps(self) -> float:
        """Speed of the belt."""
        return self.conditions.omega_radps * self.conditions.radius_m

    def mean_power(self) -> FloatArray:
        """Return the density over all folds, (3, m)."""
        result: FloatArray = np.tensordot(self.freedom, self.power, axes=1) / self.freedom.sum()
        return result

    def wide(self, values: FloatArray) -> FloatArray:
        """Return the means over the wide bins, (..., b), of (..., m)."""
        result: FloatArray = np.add.reduceat(values, self.first, axis=-1) / self.count
        return result


def group_spectra(group: Group, folds: int) -> GroupSpectra | None:
    """Return the spectra of one group, or None if it is too short for two segments per fold."""
    rate_hz = group.deviation_rate_hz
    if not (rate_hz > 0.0 and group.deviations_mps2):
        return None
    runs = tuple(np.nan_to_num(run.astype(np.float64)) for run in group.deviations_mps2)
    present: BoolArray = np.asarray(np.isfinite(group.deviations_mps2[0]).all(axis=1))
    segment = 2 * round(0.5 * rate_hz / RESOLUTION_HZ)
    window = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(segment) / segment)
    low = round(LOWEST_HZ / rate_hz * segment)
    band = slice(low, int(_BAND_RATIO * segment) + 1)
    pieces = [_transforms(run, segment, window, band) for run in runs]
    spectra = np.concatenate([piece for piece in pieces if len(piece)] or [np.empty((0, 3, 1), complex)])
    if len(spectra) < _LEAST_SEGMENTS * folds:
        return None
    scale = 2.0 / (rate_hz * float(np.square(window).sum()))
    power = (np.square(spectra.real) + np.square(spectra.imag)) * scale
    cross = scale * (spectra[:, RADIAL] * np.conj(spectra[:, CIRCUMFERENTIAL])).mean(axis=0)
    parts = np.array_split(np.arange(len(spectra)), folds)
    frequency = np.arange(segment // 2 + 1, dtype=np.float64)[band] * (rate_hz / segment)
    first, count = _wide_bins(frequency)
    return GroupSpectra(
        group.label,
        group.conditions,
        group.half_angle_rad,
        present,
        frequency,
        np.stack([power[part].mean(axis=0) for part in parts]),
        np.array([len(part) / (_SEGMENT_FACTOR * _BIN_FACTOR) for part in parts]),
        cross,
        runs,
        rate_hz,
        first,
        count,
    )


def _transforms(run: FloatArray, segment: int, window: FloatArray, band: slice) -> ComplexArray:
    """Return the transforms (segments, 3, m) of overlapping pieces of a run (3, k)."""
    if run.shape[1] < segment:
        return np.empty((0, 3, 0), complex)
    pieces = np.lib.stride_tricks.sliding_window_view(run, segment, axis=1)[:, :: segment // 2].transpose(1, 0, 2)
    spectra: ComplexArray = np.fft.rfft((pieces - pieces.mean(axis=-1, keepdims=True)) * window, axis=-1)[..., band]
    return spectra


def _wide_bins(frequency_hz: FloatArray) -> tuple[IntArray, IntArray]:
    starts, begin = [], 0
    for end_hz, width in _WIDTHS_HZ:
        while begin < len(frequency_hz) and frequency_hz[begin] < end_hz:
            starts.append(begin)
            begin += width
    first = np.array(starts, dtype=np.intp)
    return first, np.diff(np.append(first, len(frequency_hz))).astype(np.intp)
