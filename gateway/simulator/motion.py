"""Speed over time, integrated exactly: how far a wheel has rolled at any moment, and when it had rolled so far."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gateway.simulator.time_series import Series
from gateway.types import FloatArray

# A profile that does not repeat is held at its last speed; it is laid out this far.
_FOREVER_S = 1e9


class Rolling(NamedTuple):
    """Motion at given times, arrays of the same shape.

    Attributes:
        distance_m: rolled since the beginning.
        speed_mps: speed.
        acceleration_mps2: its slope.
    """

    distance_m: FloatArray
    speed_mps: FloatArray
    acceleration_mps2: FloatArray


class MotionProfile:
    """A speed profile of straight lines, held at its last value or repeated for ever."""

    def __init__(self, speed_kmh: Series, repeat: bool = False) -> None:
        """Lay out the profile; repeated, it must end at the speed it begins with."""
        times, speeds = speed_kmh.times_s, speed_kmh.values / 3.6
        if times[0] != 0.0:
            # Held before the first point; times before 0 are cut off.
            start = float(np.interp(0.0, times, speeds))
            keep = times > 0.0
            times, speeds = np.r_[0.0, times[keep]], np.r_[start, speeds[keep]]
        self._period_s = float(times[-1]) if repeat and len(times) > 1 else 0.0
        if not self._period_s:
            times, speeds = np.r_[times, times[-1] + _FOREVER_S], np.r_[speeds, speeds[-1]]
        self._times, self._speeds = times, speeds
        self._slopes = np.diff(speeds) / np.diff(times)
        self._distances = np.r_[0.0, np.cumsum(0.5 * (speeds[1:] + speeds[:-1]) * np.diff(times))]

    @property
    def highest_mps(self) -> float:
        """Highest speed of the profile."""
        return float(self._speeds.max())

    def at(self, time_s: FloatArray) -> Rolling:
        """Return the motion at `time_s` >= 0."""
        laps = np.zeros_like(time_s)
        within = time_s
        if self._period_s:
            laps = np.floor(time_s / self._period_s)
            within = time_s - laps * self._period_s
        segment = np.clip(np.searchsorted(self._times, within, side="right") - 1, 0, len(self._slopes) - 1)
        since = within - self._times[segment]
        slope = self._slopes[segment]
        speed = self._speeds[segment] + slope * since
        distance = self._distances[segment] + since * (self._speeds[segment] + 0.5 * slope * since)
        return Rolling(distance + laps * self._distances[-1], speed, slope)

    def time_at(self, distance_m: FloatArray) -> FloatArray:
        """Return the first time at which so much has been rolled; infinity for what is never reached."""
        laps = np.zeros_like(distance_m)
        within = distance_m
        total = self._distances[-1]
        if self._period_s and total > 0.0:
            # The end of a lap belongs to it: a lap that ends standing still reaches it before the next begins.
            laps = np.maximum(np.ceil(distance_m / total) - 1.0, 0.0)
            within = distance_m - laps * total
        segment = np.clip(np.searchsorted(self._distances, within, side="left") - 1, 0, len(self._slopes) - 1)
        left = within - self._distances[segment]
        speed, slope = self._speeds[segment], self._slopes[segment]
        # v t + a t^2 / 2 = left, in the form that also holds for a = 0.
        root = np.sqrt(np.maximum(speed**2 + 2.0 * slope * left, 0.0))
        with np.errstate(divide="ignore", invalid="ignore"):
            since = np.where(left > 0.0, 2.0 * left / (speed + root), 0.0)
        reached = within <= total
        return np.where(reached, self._times[segment] + since + laps * self._period_s, np.inf)
