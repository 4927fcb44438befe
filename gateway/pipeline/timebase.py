"""Synchronisation of three clocks: the sensor's sample counter, the hub's microseconds, the host's arrival times.

Both fits use completed windows only, chosen by the requested time, so that the times do not depend on the chunks in
which frames arrive.
"""

from bisect import bisect_right
from collections import deque
from collections.abc import Sequence
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.signal.short_medians import median

# Distance of the support points of the sample clock, and their number in a fit.
_SAMPLE_WINDOW_S: Final = 0.5
_SAMPLE_WINDOWS: Final = 120
# The nominal rate is used until the hub's time stamps span this long, or differ from it by more than their error, up to
# which a hub may read a sensor late.
_MIN_SPAN_S: Final = 2.0
_STAMP_ERROR_US: Final = 2000.0
# A measured rate that deviates more than this from the nominal one indicates faulty time stamps.
_MAX_RATE_ERROR: Final = 0.1

_HOST_WINDOW_US: Final = 1_000_000
_HOST_WINDOWS: Final = 60
# A window is closed, and late frames for it are ignored, once a frame this many windows later has arrived. A time is
# computed from windows at least this much older, which are closed in whatever order wheels are processed.
_CLOSED_AFTER_WINDOWS: Final = 2
_USED_AFTER_WINDOWS: Final = 3


class SampleClock:
    """Maps a wheel's running sample number to hub time, measuring the true sampling rate against the hub's clock."""

    def __init__(self, nominal_rate_hz: float) -> None:
        """Start with the nominal rate."""
        self.nominal_rate_hz = nominal_rate_hz
        self._window = max(1, round(_SAMPLE_WINDOW_S * nominal_rate_hz))
        self._indices: list[int] = []
        self._ticks_us: list[int] = []
        # Fits by their last sample: times are asked for in no fixed order.
        self._fits: dict[int, tuple[float, int, float]] = {}

    def stamp(self, index: int, tick_us: int) -> None:
        """Add the hub time `tick_us` (unwrapped) of sample `index`."""
        if self._indices and index < self._indices[-1] + self._window:
            return
        self._indices.append(index)
        self._ticks_us.append(tick_us)
        # A time is asked for by up to some ten windows later: what it needs is still held then.
        if len(self._indices) > 3 * _SAMPLE_WINDOWS:
            del self._indices[:_SAMPLE_WINDOWS], self._ticks_us[:_SAMPLE_WINDOWS]

    def stamp_blocks(self, first: int, block: int, ticks_us: Sequence[int]) -> None:
        """Add the hub times of the first samples of blocks of `block` samples, the first of which is `first`."""
        block_index = 0
        while block_index < len(ticks_us):
            index = first + block_index * block
            due = self._indices[-1] + self._window if self._indices else index
            if index >= due:
                self.stamp(index, ticks_us[block_index])
                block_index += 1
            else:
                block_index = -((first - due) // block)

    def _fitted(self, index: float) -> tuple[float, int, float]:
        """Return rate in Hz, anchor sample and the anchor's hub time in us, from the time stamps up to `index`."""
        until = max(1, bisect_right(self._indices, index))
        last = self._indices[until - 1]
        cached = self._fits.get(last)
        if cached is not None:
            return cached
        indices = np.array(self._indices[max(0, until - _SAMPLE_WINDOWS) : until], np.float64)
        ticks = np.array(self._ticks_us[max(0, until - _SAMPLE_WINDOWS) : until], np.float64)
        rate, index_mean, tick_mean = self.nominal_rate_hz, float(indices.mean()), float(ticks.mean())
        span = indices[-1] - indices[0]
        differs = abs(ticks[-1] - ticks[0] - span * 1e6 / rate) > _STAMP_ERROR_US
        if span >= _MIN_SPAN_S * rate or differs:
            centred = indices - index_mean
            us_per_sample = float(centred @ (ticks - tick_mean) / (centred @ centred))
            measured = 1e6 / us_per_sample if us_per_sample > 0.0 else 0.0
            if abs(measured / rate - 1.0) <= _MAX_RATE_ERROR:
                rate = measured
        anchor_us = tick_mean + (last - index_mean) * 1e6 / rate
        while len(self._fits) >= _SAMPLE_WINDOWS:
            del self._fits[next(iter(self._fits))]
        self._fits[last] = rate, last, anchor_us
        return self._fits[last]

    def rate_hz(self, index: float) -> float:
        """Return the sampling rate, Hz, estimated from samples up to `index`."""
        return self._fitted(index)[0]

    def hub_us(self, index: float) -> float:
        """Return the hub time of a (fractional) sample number, us since the hub's start."""
        rate, anchor, anchor_us = self._fitted(index)
        return anchor_us + (index - anchor) * 1e6 / rate


class HostClock:
    """Maps hub time to host time by a line through the earliest arrivals, since a link only adds delay."""

    def __init__(self) -> None:
        """Start without arrivals."""
        # (window, hub time in us, host minus hub time in ns) of the earliest arrival in each closed window
        self._closed: deque[tuple[int, int, int]] = deque(maxlen=4 * _HOST_WINDOWS)
        self._open: dict[int, tuple[int, int, int]] = {}
        self._open_from = 0
        self._first: tuple[int, int] | None = None
        # The latest fits by their newest window: last point, offset in ns and drift in ns/us.
        self._fits: dict[int, tuple[tuple[int, int, int], float, float]] = {}
        self._newest: tuple[int, int] | None = None

    def stamp(self, tick_us: int, host_ns: int) -> None:
        """Add the arrival at `host_ns` of a frame with hub time `tick_us` (unwrapped)."""
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
        if window - _CLOSED_AFTER_WINDOWS >= self._open_from:
            self._open_from = window - _CLOSED_AFTER_WINDOWS + 1
            self._closed.extend(self._open.pop(done) for done in sorted(self._open) if done < self._open_from)

    def stamp_arrival(self, ticks_us: Sequence[int], host_ns: int) -> None:
        """Add frames, at least one, that arrived together at `host_ns`, in their order."""
        latest_us = max(ticks_us)
        if self._first is None or min(ticks_us) // _HOST_WINDOW_US != latest_us // _HOST_WINDOW_US:
            for tick_us in ticks_us:
                self.stamp(tick_us, host_ns)
        else:
            # The latest one had the least delay, which alone counts.
            self.stamp(latest_us, host_ns)

    def stamp_all(self, ticks_us: NDArray[np.int64], hosts_ns: NDArray[np.int64]) -> None:
        """Add the arrivals of frames, (n,) each, in their order, n > 0."""
        if self._first is None:
            self.stamp(int(ticks_us[0]), int(hosts_ns[0]))
        windows = ticks_us // _HOST_WINDOW_US
        delays_ns = hosts_ns - ticks_us * 1000
        edges = [0, *(np.flatnonzero(windows[1:] != windows[:-1]) + 1).tolist(), len(windows)]
        for begin, end in pairwise(edges):
            # Of the frames of one window only the earliest counts.
            earliest = begin + int(delays_ns[begin:end].argmin())
            self.stamp(int(ticks_us[earliest]), int(hosts_ns[earliest]))

    def measure_latency(self, tick_us: int, host_ns: int) -> None:
        """Set the frame that the latency is that of."""
        self._newest = tick_us, host_ns

    @property
    def latency_s(self) -> float | None:
        """Delay of the newest frame relative to the fastest frames, None before the first."""
        if self._newest is None:
            return None
        tick_us, host_ns = self._newest
        return max(0.0, (host_ns - self.host_ns(tick_us)) * 1e-9)

    def host_ns(self, tick_us: float) -> int:
        """Return the host time of hub time `tick_us`, with the least delay of the link included; 0 if unknown."""
        if self._first is None:
            return 0
        newest = int(tick_us // _HOST_WINDOW_US) - _USED_AFTER_WINDOWS
        fit = self._fits.get(newest)
        if fit is None:
            used = [point for point in self._closed if point[0] <= newest][-_HOST_WINDOWS:]
            if not used:
                return self._first[1] + round((tick_us - self._first[0]) * 1000.0)
            fit = used[-1], *self._line(used)
            # Windows that can still be closed belong to no fit that is kept.
            if newest < self._open_from:
                while len(self._fits) >= _HOST_WINDOWS:
                    del self._fits[next(iter(self._fits))]
                self._fits[newest] = fit
        (_, base_us, base_ns), offset_ns, drift = fit
        return base_ns + round(tick_us * 1000.0 + offset_ns + drift * (tick_us - base_us))

    @staticmethod
    def _line(points: list[tuple[int, int, int]]) -> tuple[float, float]:
        """Return offset in ns and drift in ns/us about the last point, fitted to the early half of the points."""
        _, base_us, base_ns = points[-1]
        if len(points) < 8:
            return float(min(delay for _, _, delay in points) - base_ns), 0.0
        ticks = np.array([tick - base_us for _, tick, _ in points], np.float64)
        delays = np.array([delay - base_ns for _, _, delay in points], np.float64)
        early = np.ones(len(points), bool)
        drift = offset = 0.0
        for _ in range(3):
            used = ticks[early]
            tick, delay = float(used.mean()), float(delays[early].mean())
            used -= tick
            drift = float(used @ delays[early]) / float(used @ used)
            offset = delay - drift * tick
            residual = delays - (offset + drift * ticks)
            early = residual <= median(residual[early])
            if early.sum() < 4:
                break
        return offset, drift
