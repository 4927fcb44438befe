"""Three clocks brought together: the sensor's sample counter, the hub's microseconds, the host's arrival times.

Both fits use closed windows only, chosen by the time that is asked for, so that the same frames give the same times
however they were cut into chunks.
"""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
from typing import Final

import numpy as np

# One support point of the sample clock per so many seconds of samples.
_SAMPLE_WINDOW_S: Final = 0.5
_SAMPLE_WINDOWS: Final = 120
# The nominal rate holds until the hub's stamps have spanned this long.
_MIN_SPAN_S: Final = 2.0
# A measured rate further than this from the nominal one is a fault of the stamps, not of the oscillator.
_MAX_RATE_ERROR: Final = 0.1

_HOST_WINDOW_US: Final = 1_000_000
_HOST_WINDOWS: Final = 60
# A window is settled, and stragglers for it are ignored, once a frame two windows later has been seen; a time is
# answered from windows that are settled by then whatever the order in which wheels are processed.
_SETTLED_AFTER: Final = 2
_ANSWERED_AFTER: Final = 3


class SampleClock:
    """Maps a wheel's running sample number to hub time, measuring the true sampling rate against the hub's clock."""

    def __init__(self, nominal_rate_hz: float) -> None:
        """Trust the nominal rate until enough stamps are there."""
        self.nominal_rate_hz = nominal_rate_hz
        self._window = max(1, round(_SAMPLE_WINDOW_S * nominal_rate_hz))
        self._indices: list[int] = []
        self._ticks_us: list[int] = []
        self._fit_at = -1
        self._fit = (nominal_rate_hz, 0, 0.0)

    def stamp(self, index: int, tick_us: int) -> None:
        """Learn that sample `index` was taken at hub time `tick_us` (unwrapped)."""
        if self._indices and index < self._indices[-1] + self._window:
            return
        self._indices.append(index)
        self._ticks_us.append(tick_us)
        if len(self._indices) > 2 * _SAMPLE_WINDOWS:
            del self._indices[:_SAMPLE_WINDOWS], self._ticks_us[:_SAMPLE_WINDOWS]
            self._fit_at = -1

    def _fitted(self, index: float) -> tuple[float, int, float]:
        """Rate in Hz, anchor sample and the anchor's hub time in us, from the stamps up to `index`."""
        until = max(1, bisect_right(self._indices, index))
        last = self._indices[until - 1]
        if last == self._fit_at:
            return self._fit
        indices = np.array(self._indices[max(0, until - _SAMPLE_WINDOWS) : until], np.float64)
        ticks = np.array(self._ticks_us[max(0, until - _SAMPLE_WINDOWS) : until], np.float64)
        rate = self.nominal_rate_hz
        if indices[-1] - indices[0] >= _MIN_SPAN_S * rate:
            centred = indices - indices.mean()
            us_per_sample = float(centred @ (ticks - ticks.mean()) / (centred @ centred))
            measured = 1e6 / us_per_sample if us_per_sample > 0.0 else 0.0
            if abs(measured / rate - 1.0) <= _MAX_RATE_ERROR:
                rate = measured
        anchor_us = float(ticks.mean() + (last - indices.mean()) * 1e6 / rate)
        self._fit_at, self._fit = last, (rate, last, anchor_us)
        return self._fit

    def rate_hz(self, index: float) -> float:
        """Return the sampling rate as known at sample `index`."""
        return self._fitted(index)[0]

    def hub_us(self, index: float) -> float:
        """Return the hub time of a (fractional) sample number, us since the hub's start."""
        rate, anchor, anchor_us = self._fitted(index)
        return anchor_us + (index - anchor) * 1e6 / rate


class HostClock:
    """Maps hub time to host time by a line through the earliest arrivals: a link only ever adds delay."""

    def __init__(self) -> None:
        """Know nothing yet."""
        # (window, hub time in us, host minus hub time in ns) of the earliest arrival in each settled window
        self._settled: deque[tuple[int, int, int]] = deque(maxlen=4 * _HOST_WINDOWS)
        self._open: dict[int, tuple[int, int, int]] = {}
        self._open_from = 0
        self._first: tuple[int, int] | None = None
        self._fit_key: tuple[int, int] | None = None
        self._fit = (0.0, 0.0)
        self.latency_s: float | None = None

    def stamp(self, tick_us: int, host_ns: int) -> None:
        """Learn that a frame with hub time `tick_us` (unwrapped) arrived at `host_ns`."""
        window = tick_us // _HOST_WINDOW_US
        if self._first is None:
            self._first = (tick_us, host_ns)
            self._open_from = window
        if window < self._open_from:
            return
        delay_ns = host_ns - tick_us * 1000
        best = self._open.get(window)
        if best is None or delay_ns < best[2]:
            self._open[window] = (window, tick_us, delay_ns)
        if window - _SETTLED_AFTER >= self._open_from:
            self._open_from = window - _SETTLED_AFTER + 1
            self._settled.extend(self._open.pop(done) for done in sorted(self._open) if done < self._open_from)

    def measure_latency(self, tick_us: int, host_ns: int) -> None:
        """Note how much later than the fastest frames this one came."""
        self.latency_s = max(0.0, (host_ns - self.host_ns(tick_us)) * 1e-9)

    def host_ns(self, tick_us: float) -> int:
        """Return the host time at which the hub's clock showed `tick_us`, less the link's least delay; 0 if unknown."""
        if self._first is None:
            return 0
        newest = tick_us // _HOST_WINDOW_US - _ANSWERED_AFTER
        used = [point for point in self._settled if point[0] <= newest][-_HOST_WINDOWS:]
        if not used:
            return self._first[1] + round((tick_us - self._first[0]) * 1000.0)
        key = (used[0][0], used[-1][0])
        if key != self._fit_key:
            self._fit_key, self._fit = key, self._line(used)
        offset_ns, drift = self._fit
        _, base_us, base_ns = used[-1]
        return base_ns + round(tick_us * 1000.0 + offset_ns + drift * (tick_us - base_us))

    @staticmethod
    def _line(points: list[tuple[int, int, int]]) -> tuple[float, float]:
        """Offset in ns and drift in ns/us about the last point, through the early half of the points."""
        _, base_us, base_ns = points[-1]
        if len(points) < 8:
            return float(min(delay for _, _, delay in points) - base_ns), 0.0
        ticks = np.array([tick - base_us for _, tick, _ in points], np.float64)
        delays = np.array([delay - base_ns for _, _, delay in points], np.float64)
        early = np.ones(len(points), bool)
        drift = offset = 0.0
        for _ in range(3):
            drift, offset = (float(value) for value in np.polyfit(ticks[early], delays[early], 1))
            residual = delays - (offset + drift * ticks)
            early = residual <= np.median(residual[early])
            if early.sum() < 4:
                break
        return offset, drift
