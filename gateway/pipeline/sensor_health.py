"""Faults of a sensor from its own signal: dead, stuck, mounted wrongly, loose, pressure frozen."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_protocol.messages import Axis, Environment
from gateway.constants import AXIS_NAMES, STANDARD_ATMOSPHERE_PA, ZERO_CELSIUS_K
from gateway.estimators.estimator import Revolution
from gateway.pipeline.results import SensorFlag
from gateway.reasons import Code, Reason
from gateway.types import FloatArray

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
_AVERAGING: Final = 0.1
_USED_EVERY: Final = 4
_REVOLUTIONS: Final = 10
# The waves of a measured tire reach 2.7 % of R Omega^2 behind the contact, with six times the power of those before it.
_RINGING_SHARE: Final = 0.025
_RINGING_RATIO: Final = 30.0

_FROZEN_READINGS: Final = 10
_FROZEN_PA: Final = 5_000.0


def ringing_spectrum(
    radial_mps2: FloatArray, revolution: Revolution, frequency_hz: FloatArray, side: int
) -> FloatArray:
    """Return the squared amplitude of oscillation beside the contact, (f,), NaN where it is not known.

    Args:
        radial_mps2: (n,) one axis on the angle grid.
        revolution: its contact edges and speed.
        frequency_hz: (f,) frequencies.
        side: +1 behind the contact, where a loose sensor rings, -1 before it, where the ringing has decayed.
    """
    theta = np.linspace(-math.pi, math.pi, len(radial_mps2), endpoint=False)
    if side > 0:
        begin = revolution.trailing_edge_rad + _EDGE_MARGIN_RAD
    else:
        begin = revolution.leading_edge_rad - _EDGE_MARGIN_RAD - _RANGE_RAD
    inside = (theta >= begin) & (theta < begin + _RANGE_RAD)
    count = int(inside.sum())
    unknown: FloatArray = np.full(len(frequency_hz), math.nan)
    if count < 8 * _TREND_DEGREE:
        return unknown
    place = np.linspace(-1.0, 1.0, count)
    signal = radial_mps2[inside]
    signal = signal - np.polynomial.chebyshev.chebval(
        place, np.polynomial.chebyshev.chebfit(place, signal, _TREND_DEGREE)
    )
    window = np.hanning(count)
    power = np.square(np.abs(np.fft.rfft(signal * window, _FFT_SIZE)) * 2.0 / window.sum())
    step_s = revolution.period_s / len(radial_mps2)
    spectrum: FloatArray = np.interp(frequency_hz, np.fft.rfftfreq(_FFT_SIZE, step_s), power)
    spectrum[(frequency_hz < _LOWEST_ORDER / revolution.period_s) | (frequency_hz > 0.2 / step_s)] = math.nan
    return spectrum


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
        self._still: tuple[tuple[int, int], ...] = ()
        self._mean: FloatArray = np.full(len(Axis), math.nan)
        self._frequency_hz: FloatArray = np.arange(_LOWEST_HZ, 0.4 * rate_hz, _STEP_HZ)
        self._behind: FloatArray = np.full(len(self._frequency_hz), math.nan)
        self._before = self._behind
        self._used = 0
        self._ringing: tuple[float, float] | None = None
        self._pressure_pa: float | None = None
        self._temperatures: tuple[float, float] = (math.inf, -math.inf)
        self._readings = 0
        self._pressure_error_pa = 0.0

    def samples(self, counts: NDArray[np.int16]) -> None:
        """Add (n, channels) raw samples that follow those of the last call."""
        if not len(counts):
            return
        low, high = counts.min(axis=0), counts.max(axis=0)
        if self._lowest is None or self._highest is None:
            self._lowest, self._highest, self._count = low, high, 0
            self._sum[:] = 0.0
        self._lowest, self._highest = np.minimum(low, self._lowest), np.maximum(high, self._highest)
        self._sum += counts.sum(axis=0, dtype=np.float64)
        self._count += len(counts)
        if self._count < self._window:
            return
        still = np.flatnonzero(self._lowest == self._highest).tolist()
        self._still = tuple((self._columns[at], int(self._lowest[at])) for at in still)
        self._mean = np.full(len(Axis), math.nan)
        self._mean[list(self._columns)] = (self._sum / self._count - self._offset) * self._scale
        self._lowest = self._highest = None

    def revolution(self, revolution: Revolution) -> None:
        """Add a revolution. Those with faults are skipped; of the others every fourth is enough for a loose sensor."""
        if revolution.faults or revolution.index % _USED_EVERY:
            return
        steady = revolution.radial_mps2.mean()
        if not steady > _LEAST_MEAN_MPS2:
            return
        behind, before = (
            ringing_spectrum(revolution.radial_mps2, revolution, self._frequency_hz, side) / steady**2
            for side in (1, -1)
        )
        self._behind, self._before = _averaged(self._behind, behind), _averaged(self._before, before)
        self._used += 1
        self._ringing = None
        known = np.isfinite(self._behind) & np.isfinite(self._before)
        if self._used < _REVOLUTIONS or not known.any():
            return
        after, ahead = self._behind[known], self._before[known]
        rings = (after > _RINGING_SHARE**2) & (after > _RINGING_RATIO * (ahead + np.median(ahead)))
        if rings.any():
            strongest = int(np.argmax(np.where(rings, after, 0.0)))
            self._ringing = float(self._frequency_hz[known][strongest]), math.sqrt(float(after[strongest]))

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
        return Reason(Code.SENSOR_LOOSE, frequency_hz=frequency_hz, share=share)

    def flags(self) -> tuple[SensorFlag, ...]:
        """Return the present faults."""
        return tuple(self._flags())

    def _flags(self) -> Iterator[SensorFlag]:
        if self._still and len(self._still) == len(self._columns) and not any(value for _, value in self._still):
            yield SensorFlag("dead", Reason(Code.SENSOR_DEAD))
        elif self._still:
            axes = tuple(Reason(Code.AXIS_READS, axis=AXIS_NAMES[axis], counts=value) for axis, value in self._still)
            yield SensorFlag("stuck", Reason(Code.SENSOR_STUCK, duration_s=_WINDOW_S, axes=axes))
        if self._is_dc and not self._still:
            yield from self._mounting()
        if (loose := self.doubt()) is not None:
            yield SensorFlag("loose", loose)
        if self._pressure_error_pa:
            low, high = self._temperatures
            frozen = Reason(Code.PRESSURE_FROZEN, temperature_change_k=high - low, error_pa=self._pressure_error_pa)
            yield SensorFlag("pressure frozen", frozen)

    def _mounting(self) -> Iterator[SensorFlag]:
        tilt = tilt_rad(self._mean)
        if tilt is not None:
            axis, angle = tilt
            yield SensorFlag("mounting", Reason(Code.SENSOR_TILTED, axis=AXIS_NAMES[axis], tilt_rad=angle))
        elif self._mean[Axis.RADIAL] < -_LEAST_MEAN_MPS2:
            yield SensorFlag("mounting", Reason(Code.SENSOR_FLIPPED))


def _averaged(average: FloatArray, fresh: FloatArray) -> FloatArray:
    """Return the running average; where one is NaN, the other is taken."""
    mixed: FloatArray = average + _AVERAGING * (fresh - average)
    return np.where(np.isnan(average), fresh, np.where(np.isnan(fresh), average, mixed))
