"""Synchronisation of three clocks: the sensor's sample counter, the hub's microseconds, the host's arrival times.

Both fits use completed windows only, chosen by the requested time, so that the times do not depend on the chunks in
which frames arrive.
"""

import math
from bisect import bisect_right
from collections import deque
from collections.abc import Sequence
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gateway.core.revolutions.short_medians import median
from gateway.core.types import FloatArray

# Distance of the support points of the sample clock, and their number in a fit.
_SAMPLE_WINDOW_S: Final = 0.5
_SAMPLE_WINDOWS: Final = 120
# The nominal rate is used until the hub's time stamps span this long, or differ from it by more than their error, up to
# which a hub may read a sensor late.
_MIN_SPAN_S: Final = 2.0
_STAMP_ERROR_US: Final = 2000.0
# A measured rate that deviates more than this from the nominal one indicates faulty time stamps.
_MAX_RATE_ERROR: Final = 0.1
# A time between two support points is a step, of the hub's clock or by samples that were lost or repeated unmarked,
# where it is off their median by more than so many of the median deviations, and by more than this. Steps are looked
# for in so many times or more, and up to this share of them.
_STEP_DEVIATIONS: Final = 8.0
_LEAST_STEP_US: Final = 100.0
_LEAST_TIMES: Final = 4
_MOST_STEPS: Final = 0.4
# Mean square residual, over that by neighbouring stamps alone, up to which stamps scatter about a line at random.
_RANDOM_SCATTER: Final = 1.5
# Relative error of the rate below which a clock counts as steady: a tenth of that which is assumed of every rate.
_STEADY_CLOCK: Final = 1e-5

_HOST_WINDOW_US: Final = 1_000_000
_HOST_WINDOWS: Final = 60
# A window is closed, and late frames for it are ignored, once a frame this many windows later has arrived. A time is
# computed from windows at least this much older, which are closed in whatever order wheels are processed.
_CLOSED_AFTER_WINDOWS: Final = 2
_USED_AFTER_WINDOWS: Final = 3


class _Fit(NamedTuple):
    """Line through time stamps.

    Attributes:
        rate_hz: sampling rate.
        anchor: sample number.
        anchor_us: its hub time.
        rate_std: relative standard error of the rate, by what the stamps leave of the line; 0 of a steady clock.
    """

    rate_hz: float
    anchor: int
    anchor_us: float
    rate_std: float


class SampleClock:
    """Maps a wheel's running sample number to hub time, measuring the true sampling rate against the hub's clock.

    A step of the hub's clock or of the sample numbers does not change the rate: the stamps before and after it are on
    parallel lines.
    """

    def __init__(self, nominal_rate_hz: float) -> None:
        """Start with the nominal rate."""
        self.nominal_rate_hz = nominal_rate_hz
        self._window = max(1, round(_SAMPLE_WINDOW_S * nominal_rate_hz))
        self._indices: list[int] = []
        self._ticks_us: list[int] = []
        # Fits by their last sample: times are asked for in no fixed order.
        self._fits: dict[int, _Fit] = {}

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
            next_index = self._indices[-1] + self._window if self._indices else index
            if index >= next_index:
                self.stamp(index, ticks_us[block_index])
                block_index += 1
            else:
                block_index = -((first - next_index) // block)

    def _fitted(self, index: float) -> _Fit:
        """Return the line through the time stamps up to `index`."""
        end = max(1, bisect_right(self._indices, index))
        last = self._indices[end - 1]
        cached = self._fits.get(last)
        if cached is not None:
            return cached
        indices = np.array(self._indices[max(0, end - _SAMPLE_WINDOWS) : end], np.float64)
        ticks = np.array(self._ticks_us[max(0, end - _SAMPLE_WINDOWS) : end], np.float64)
        ticks, steps_us, doubt = _without_steps(indices, ticks)
        rate, index_mean, tick_mean = self.nominal_rate_hz, float(indices.mean()), float(ticks.mean())
        span = indices[-1] - indices[0]
        is_off_rate = abs(ticks[-1] - ticks[0] - span * 1e6 / rate) > _STAMP_ERROR_US
        # A rate that the stamps do not support yet is off by what they say of it.
        std = abs(float(ticks[-1] - ticks[0]) / (span * 1e6 / rate) - 1.0) if span else 0.0
        if span >= _MIN_SPAN_S * rate or is_off_rate:
            centred = indices - index_mean
            us_per_sample = float(centred @ (ticks - tick_mean) / (centred @ centred))
            measured = 1e6 / us_per_sample if us_per_sample > 0.0 else 0.0
            if abs(measured / rate - 1.0) <= _MAX_RATE_ERROR:
                rate = measured
                if len(indices) > _LEAST_TIMES:
                    std = _slope_error(centred, ticks - tick_mean - us_per_sample * centred) / us_per_sample
        std = math.hypot(std, doubt)
        anchor_us = tick_mean + (last - index_mean) * 1e6 / rate + steps_us
        while len(self._fits) >= _SAMPLE_WINDOWS:
            del self._fits[next(iter(self._fits))]
        self._fits[last] = _Fit(rate, last, anchor_us, std if std > _STEADY_CLOCK else 0.0)
        return self._fits[last]

    def rate_hz(self, index: float) -> float:
        """Return the sampling rate, Hz, estimated from samples up to `index`."""
        return self._fitted(index).rate_hz

    def rate_std(self, index: float) -> float:
        """Return the relative standard error of `rate_hz` by the scatter of the stamps; 0 where the clock is steady."""
        return self._fitted(index).rate_std

    def hub_us(self, index: float) -> float:
        """Return the hub time of a (fractional) sample number, us since the hub's start."""
        rate, anchor, anchor_us, _ = self._fitted(index)
        return anchor_us + (index - anchor) * 1e6 / rate


class _Unstepped(NamedTuple):
    """Time stamps as they would be without steps.

    Attributes:
        ticks_us: (n,) hub times.
        steps_us: sum of the steps.
        doubt: relative error of the rate where the steps may be another rate.
    """

    ticks_us: FloatArray
    steps_us: float
    doubt: float


def _without_steps(indices: FloatArray, ticks_us: FloatArray) -> _Unstepped:
    """Return time stamps without the steps of the hub's clock and of the sample numbers.

    A late stamp is a step and a step back: the last one may be late, unless its step is larger than that. Where steps
    follow each other up to now, or are too many, they may be another rate.
    """
    samples, times_us = np.diff(indices), np.diff(ticks_us)
    if len(samples) < _LEAST_TIMES:
        return _Unstepped(ticks_us, 0.0, 0.0)
    # The usual deviation of a few times is by chance.
    min_step_us = _LEAST_STEP_US if len(samples) >= 2 * _LEAST_TIMES else 2.0 * _STAMP_ERROR_US
    # Near the mean rate all are near the median one, which takes longer.
    max_deviation_us = float(np.abs(times_us - samples * (times_us.sum() / samples.sum())).max())
    if max_deviation_us * (1.0 + float(samples.max() / samples.min())) <= min_step_us:
        return _Unstepped(ticks_us, 0.0, 0.0)
    deviation_us = times_us - samples * float(np.median(times_us / samples))
    limit_us = max(min_step_us, _STEP_DEVIATIONS * float(np.median(np.abs(deviation_us))))
    is_step = np.abs(deviation_us) > limit_us
    if not is_step.any():
        return _Unstepped(ticks_us, 0.0, 0.0)
    steps_us = np.where(is_step, deviation_us, 0.0)
    if np.count_nonzero(is_step) > _MOST_STEPS * len(samples):
        return _Unstepped(ticks_us, 0.0, float(np.abs(steps_us).sum() / times_us.sum()))
    run_length = int(np.argmin(is_step[::-1]))
    doubt = abs(float(steps_us[-run_length:].sum() / times_us[-run_length:].sum())) if run_length > 1 else 0.0
    unstepped_us = ticks_us - np.concatenate(([0.0], np.cumsum(steps_us)))
    if abs(steps_us[-1]) <= _STAMP_ERROR_US:
        steps_us[-1] = 0.0
    return _Unstepped(unstepped_us, float(steps_us.sum()), doubt)


def _slope_error(indices: FloatArray, residual_us: FloatArray) -> float:
    """Return the standard error of the slope of a line through time stamps, us per sample.

    Stamps that scatter at random are as far from the line as neighbouring ones from each other. What lies further off
    is taken for a random walk, as by samples that are lost unmarked: its mean step is as unsure as a single one. A
    rate that drifts gives the same.

    Args:
        indices: (n,) sample numbers about their mean, n > 4.
        residual_us: (n,) hub times less the line.
    """
    count, span = len(indices), float(indices[-1] - indices[0])
    mean_square = float(residual_us @ residual_us) / (count - 2)
    curvatures = np.diff(residual_us, 2)
    random_variance = float(curvatures @ curvatures) / (6.0 * len(curvatures))
    walk_variance = max(0.0, mean_square - _RANDOM_SCATTER * random_variance) * 15.0 * count / span**2
    return math.sqrt(mean_square / float(indices @ indices) + walk_variance)


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
        self._newest = tick_us, host_ns
        window = tick_us // _HOST_WINDOW_US
        if self._first is None:
            self._first = (tick_us, host_ns)
            self._open_from = window
        if window < self._open_from:
            return
        delay_ns = host_ns - tick_us * 1000
        earliest = self._open.get(window)
        if earliest is None or delay_ns < earliest[2]:
            self._open[window] = (window, tick_us, delay_ns)
        if window - _CLOSED_AFTER_WINDOWS >= self._open_from:
            self._open_from = window - _CLOSED_AFTER_WINDOWS + 1
            self._closed.extend(self._open.pop(number) for number in sorted(self._open) if number < self._open_from)

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
        self._newest = int(ticks_us[-1]), int(hosts_ns[-1])

    def silence_us(self, host_ns: int) -> int:
        """Return the time from the newest arrival to one at `host_ns`, 0 without or before it."""
        return max(0, host_ns - self._newest[1]) // 1000 if self._newest is not None else 0

    @property
    def latency_s(self) -> float | None:
        """Delay of the newest frame relative to the fastest frames, None before the first."""
        if self._newest is None:
            return None
        tick_us, host_ns = self._newest
        return max(0.0, (host_ns - self.host_ns(tick_us)) * 1e-9)

    def host_ns(self, tick_us: float, known_us: float = -math.inf) -> int:
        """Return the host time of hub time `tick_us`, with the least delay of the link included; 0 if unknown.

        Args:
            tick_us: hub time.
            known_us: later hub time up to which arrivals count, where there is one.
        """
        if self._first is None:
            return 0
        newest = int(max(tick_us, known_us) // _HOST_WINDOW_US) - _USED_AFTER_WINDOWS
        fit = self._fits.get(newest)
        if fit is None:
            points = [point for point in self._closed if point[0] <= newest][-_HOST_WINDOWS:]
            if not points:
                return self._first[1] + round((tick_us - self._first[0]) * 1000.0)
            fit = points[-1], *self._line(points)
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
        is_early = np.ones(len(points), bool)
        drift = offset = 0.0
        for _ in range(3):
            early_ticks = ticks[is_early]
            tick, delay = float(early_ticks.mean()), float(delays[is_early].mean())
            early_ticks -= tick
            drift = float(early_ticks @ delays[is_early]) / float(early_ticks @ early_ticks)
            offset = delay - drift * tick
            residual = delays - (offset + drift * ticks)
            is_early = residual <= median(residual[is_early])
            if is_early.sum() < 4:
                break
        return offset, drift
