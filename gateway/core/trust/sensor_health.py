"""Faults of a sensor from its own signal: dead, stuck, mounted wrongly, loose, pressure frozen."""

import math
from collections.abc import Iterator, Sequence
from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_protocol.messages import Axis, Environment
from gateway.core.constants import AXIS_NAMES, STANDARD_ATMOSPHERE_PA, ZERO_CELSIUS_K
from gateway.core.estimates.estimator import Revolution, is_evidence
from gateway.core.estimates.results import SensorFlag
from gateway.core.reasons import Reason
from gateway.core.trust.reasons import TrustCode
from gateway.core.types import FloatArray

# A channel that stays at one count for this long does not measure: electrical noise alone would move it.
_WINDOW_S: Final = 1.0
# Tilt from which a fault is reported; up to 45 deg the tilt can be stated in the configuration and is corrected.
_TILT_RAD: Final = math.radians(20.0)
# Below this the mean of an axis may be its zero-g offset.
_LEAST_MEAN_MPS2: Final = 100.0

# Ringing is searched on both sides of the contact, from this distance to the edges and over this range of angle.
_EDGE_MARGIN_RAD: Final = 0.2
_RANGE_RAD: Final = 1.3
_TREND_DEGREE: Final = 5
_LOWEST_HZ: Final = 150.0
_LOWEST_ORDER: Final = 16.0
_STEP_HZ: Final = 25.0
_FFT_SIZE: Final = 2048
_AVERAGING_WEIGHT: Final = 0.1
_REVOLUTION_INTERVAL: Final = 4
_MIN_REVOLUTIONS: Final = 10
# The waves of a measured tire reach 2.7 % of R Omega^2 behind the contact, with six times the power of those before it.
_RINGING_SHARE: Final = 0.025
_RINGING_RATIO: Final = 30.0

_BINS: Final = np.arange(_FFT_SIZE // 2 + 1.0)

PRESSURE_FROZEN: Final = "pressure frozen"
"""Flag of a pressure that repeats to the bit while the temperature changes."""
_FROZEN_READINGS: Final = 10
_FROZEN_PA: Final = 5_000.0


class _Stretch(NamedTuple):
    """What turns a stretch of a waveform into its spectrum: trend to remove, window, factor of the power."""

    trend: FloatArray
    window: FloatArray
    factor: float


@lru_cache(maxsize=8)
def _stretch(count: int) -> _Stretch:
    """Return the constants of a stretch of `count` points; the trend is (count, degree + 1) orthonormal columns."""
    position = np.linspace(-1.0, 1.0, count)
    trend = np.linalg.qr(np.polynomial.chebyshev.chebvander(position, _TREND_DEGREE))[0]
    window = np.hanning(count)
    return _Stretch(trend, window, float((2.0 / window.sum()) ** 2))


def ringing_spectra(revolutions: Sequence[Revolution], frequency_hz: FloatArray) -> FloatArray:
    """Return the squared amplitude of oscillation of the radial axis beside the contact, (k, 2, f), NaN where unknown.

    The first is behind the contact, where a loose sensor rings, the second before it, where the ringing has decayed.

    Args:
        revolutions: their waveforms, contact edges and speeds.
        frequency_hz: (f,) frequencies.
    """
    spectra = np.full((len(revolutions), 2, len(frequency_hz)), math.nan)
    parts_by_length: dict[int, list[tuple[int, int, FloatArray]]] = {}
    for index, revolution in enumerate(revolutions):
        n = len(revolution.radial_mps2)
        after_rad = revolution.trailing_edge_rad + _EDGE_MARGIN_RAD
        before_rad = revolution.leading_edge_rad - _EDGE_MARGIN_RAD - _RANGE_RAD
        for side, start_rad in enumerate((after_rad, before_rad)):
            if math.isfinite(start_rad):
                first, end = (
                    min(max(math.ceil((angle + math.pi) * n / (2.0 * math.pi)), 0), n)
                    for angle in (start_rad, start_rad + _RANGE_RAD)
                )
                if end - first >= 8 * _TREND_DEGREE:
                    parts_by_length.setdefault(end - first, []).append((index, side, revolution.radial_mps2[first:end]))
    for count, parts in parts_by_length.items():
        stretch = _stretch(count)
        signals = np.stack([signal for _, _, signal in parts])
        signals -= (signals @ stretch.trend) @ stretch.trend.T
        signals *= stretch.window
        transforms = np.fft.rfft(signals, _FFT_SIZE, axis=1)
        powers = (np.square(transforms.real) + np.square(transforms.imag)) * stretch.factor
        for (index, side, _), power in zip(parts, powers, strict=True):
            revolution = revolutions[index]
            step_s = revolution.period_s / len(revolution.radial_mps2)
            low, high = _LOWEST_ORDER / revolution.period_s, 0.2 / step_s
            covered = slice(*np.searchsorted(frequency_hz, (low, math.nextafter(high, math.inf))).tolist())
            # Bins of the transform are 1 / (size step) apart.
            bins = frequency_hz[covered] * (_FFT_SIZE * step_s)
            spectra[index, side, covered] = np.interp(bins, _BINS, power)
    return spectra


def tilt_rad(mean_mps2: FloatArray) -> tuple[Axis, float] | None:
    """Return the axis that carries the steady value and its angle; None when it is the radial one.

    Args:
        mean_mps2: (3,) means of a DC-coupled sensor over a second or more of rolling; NaN for absent axes.
    """
    radial = mean_mps2[Axis.RADIAL]
    worst: tuple[Axis, float] | None = None
    for axis in (Axis.CIRCUMFERENTIAL, Axis.LATERAL):
        across = mean_mps2[axis]
        if not abs(across) >= _LEAST_MEAN_MPS2:
            continue
        angle = abs(math.atan2(across, abs(radial)))
        if angle >= _TILT_RAD and (worst is None or angle > worst[1]):
            worst = axis, angle
    return worst


def expected_pressure_change_pa(pressure_pa: float, coldest_degc: float, hottest_degc: float) -> float:
    """Return the change of gauge pressure of a closed volume between two temperatures (ideal gas)."""
    middle_k = 0.5 * (coldest_degc + hottest_degc) + ZERO_CELSIUS_K
    return (pressure_pa + STANDARD_ATMOSPHERE_PA) * (hottest_degc - coldest_degc) / middle_k


class SensorHealth:
    """Monitor of one sensor; `flags` lists its faults.

    Estimates have the error of a frozen pressure, and those of a loose sensor are provisional.
    """

    def __init__(
        self, columns: Sequence[int], scale_mps2: FloatArray, offset_counts: FloatArray, rate_hz: float, *, is_dc: bool
    ) -> None:
        """Take the layout and scale of the samples.

        Args:
            columns: axis of each channel.
            scale_mps2: (channels,) m/s^2 per count.
            offset_counts: (channels,) counts at zero acceleration.
            rate_hz: sampling rate.
            is_dc: whether the sensor passes the steady value.
        """
        self._columns, self._scale, self._offset, self._is_dc = tuple(columns), scale_mps2, offset_counts, is_dc
        self._window = round(_WINDOW_S * rate_hz)
        self._lowest: NDArray[np.int16] | None = None
        self._highest: NDArray[np.int16] | None = None
        self._sum: FloatArray = np.zeros(len(self._columns))
        self._count = 0
        self._stuck: tuple[tuple[int, int], ...] = ()
        self._mean: FloatArray = np.full(len(Axis), math.nan)
        self._frequency_hz: FloatArray = np.arange(_LOWEST_HZ, 0.4 * rate_hz, _STEP_HZ)
        # Averaged squared amplitudes behind and before the contact.
        self._spectra: FloatArray = np.full((2, len(self._frequency_hz)), math.nan)
        self._spectrum_count = self._next_index = 0
        self._ringing: tuple[float, float] | None = None
        self._pressure_pa: float | None = None
        self._temperatures: tuple[float, float] = (math.inf, -math.inf)
        self._readings = 0
        self._pressure_error_pa = 0.0

    def samples(self, counts: NDArray[np.int16]) -> tuple[int, int]:
        """Add (n, channels) raw samples that follow those of the last call; return the least and the greatest."""
        if not len(counts):
            return 0, 0
        low, high, total = _extremes_and_sum(counts)
        extremes = min(low.tolist()), max(high.tolist())
        if self._lowest is None or self._highest is None:
            self._lowest, self._highest, self._count = low, high, 0
            self._sum[:] = 0.0
        self._lowest, self._highest = np.minimum(low, self._lowest), np.maximum(high, self._highest)
        self._sum += total
        self._count += len(counts)
        if self._count < self._window:
            return extremes
        stuck_channels = np.flatnonzero(self._lowest == self._highest).tolist()
        self._stuck = tuple((self._columns[channel], int(self._lowest[channel])) for channel in stuck_channels)
        self._mean = np.full(len(Axis), math.nan)
        self._mean[list(self._columns)] = (self._sum / self._count - self._offset) * self._scale
        self._lowest = self._highest = None
        return extremes

    def revolutions(self, revolutions: Sequence[Revolution]) -> list[Reason | None]:
        """Add revolutions; return the fault, after each, that makes every shape doubtful, None without one.

        Those that are no evidence are skipped; of the others every fourth is enough for a loose sensor.
        """
        selected: list[int] = []
        for index, revolution in enumerate(revolutions):
            if revolution.index >= self._next_index and is_evidence(revolution):
                self._next_index = revolution.index + _REVOLUTION_INTERVAL
                selected.append(index)
        steady = [float(revolutions[index].radial_mps2.mean()) for index in selected]
        fast = [(index, mean) for index, mean in zip(selected, steady, strict=True) if mean > _LEAST_MEAN_MPS2]
        doubts: list[Reason | None] = []
        spectra = ringing_spectra([revolutions[index] for index, _ in fast], self._frequency_hz)
        for (index, mean), spectrum in zip(fast, spectra, strict=True):
            doubts += [self.doubt()] * (index - len(doubts))
            self._add_spectrum(spectrum / mean**2)
        return doubts + [self.doubt()] * (len(revolutions) - len(doubts))

    def _add_spectrum(self, spectrum: FloatArray) -> None:
        """Add the squared amplitudes of a revolution behind and before the contact, (2, f), over the steady value's."""
        self._spectra = _averaged(self._spectra, spectrum)
        self._spectrum_count += 1
        self._ringing = None
        if self._spectrum_count < _MIN_REVOLUTIONS:
            return
        if not (self._spectra[0] > _RINGING_SHARE**2).any():
            return
        measured = np.isfinite(self._spectra).all(axis=0)
        after, before = self._spectra[:, measured]
        is_ringing = (after > _RINGING_SHARE**2) & (after > _RINGING_RATIO * (before + np.median(before)))
        if is_ringing.any():
            strongest = int(np.argmax(np.where(is_ringing, after, 0.0)))
            self._ringing = float(self._frequency_hz[measured][strongest]), math.sqrt(float(after[strongest]))

    def environment(self, reading: Environment) -> float:
        """Add a pressure and temperature reading; return the possible error of the pressure, Pa."""
        pressure, temperature = reading.pressure_pa, reading.temperature_degc
        if pressure is None or temperature is None:
            return self._pressure_error_pa
        if pressure != self._pressure_pa:
            self._pressure_pa, self._readings, self._temperatures = pressure, 0, (temperature, temperature)
            self._pressure_error_pa = 0.0
        self._readings += 1
        low, high = self._temperatures
        self._temperatures = low, high = min(low, temperature), max(high, temperature)
        expected = expected_pressure_change_pa(pressure, low, high)
        if self._readings >= _FROZEN_READINGS and expected >= _FROZEN_PA:
            self._pressure_error_pa = expected
        return self._pressure_error_pa

    def doubt(self) -> Reason | None:
        """Return the fault that makes every shape doubtful, None without one."""
        if self._ringing is None:
            return None
        frequency_hz, share = self._ringing
        return Reason(TrustCode.SENSOR_LOOSE, frequency_hz=frequency_hz, share=share)

    def flags(self) -> tuple[SensorFlag, ...]:
        """Return the present faults."""
        return tuple(self._flags())

    def _flags(self) -> Iterator[SensorFlag]:
        if self._stuck and len(self._stuck) == len(self._columns) and not any(value for _, value in self._stuck):
            yield SensorFlag("dead", Reason(TrustCode.SENSOR_DEAD))
        elif self._stuck:
            axes = tuple(
                Reason(TrustCode.AXIS_READS, axis=AXIS_NAMES[axis], counts=value) for axis, value in self._stuck
            )
            yield SensorFlag("stuck", Reason(TrustCode.SENSOR_STUCK, duration_s=_WINDOW_S, axes=axes))
        if self._is_dc and not self._stuck:
            yield from self._mounting()
        if (loose := self.doubt()) is not None:
            yield SensorFlag("loose", loose)
        if self._pressure_error_pa:
            low, high = self._temperatures
            frozen = Reason(
                TrustCode.PRESSURE_FROZEN, temperature_change_k=high - low, error_pa=self._pressure_error_pa
            )
            yield SensorFlag(PRESSURE_FROZEN, frozen)

    def _mounting(self) -> Iterator[SensorFlag]:
        tilt = tilt_rad(self._mean)
        if tilt is not None:
            axis, angle = tilt
            yield SensorFlag("mounting", Reason(TrustCode.SENSOR_TILTED, axis=AXIS_NAMES[axis], tilt_rad=angle))
        elif self._mean[Axis.RADIAL] < -_LEAST_MEAN_MPS2:
            yield SensorFlag("mounting", Reason(TrustCode.SENSOR_FLIPPED))


def _averaged(average: FloatArray, latest: FloatArray) -> FloatArray:
    """Return the running average; where one is NaN, the other is taken."""
    mixed: FloatArray = average + _AVERAGING_WEIGHT * (latest - average)
    unknown = np.isnan(mixed)
    if unknown.any():
        mixed[unknown] = np.where(np.isnan(average), latest, average)[unknown]
    return mixed


def _extremes_and_sum(counts: NDArray[np.int16]) -> tuple[NDArray[np.int16], NDArray[np.int16], FloatArray]:
    """Return the least, the greatest and the sum of each channel of (n, channels) samples."""
    # Long rows are reduced many times faster than those of three values.
    columns = np.ascontiguousarray(counts.T)
    return columns.min(axis=1), columns.max(axis=1), columns.sum(axis=1, dtype=np.int64).astype(np.float64)
