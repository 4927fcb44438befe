"""Readings of pressure and temperature by receivers beside the hub, by the time of their arrival."""

from bisect import bisect_right
from collections import deque
from typing import Final, NamedTuple

from firmware_protocol.messages import Environment

# Readings for revolutions that are not complete yet; a sensor of a tire sends every minute.
_DEPTH: Final = 64


class OutsideReading(NamedTuple):
    """A reading of a sensor that is not of the wheel's hub.

    Attributes:
        host_ns: arrival, ns since the epoch.
        reading: pressure and temperature, None for what it lacks.
        pressure_std_pa: standard error of the pressure.
        max_age_s: age from which it is old.
    """

    host_ns: int
    reading: Environment
    pressure_std_pa: float
    max_age_s: float

    def old_s(self, host_ns: float) -> float | None:
        """Return the age at a time, None while it is not old."""
        age_s = (host_ns - self.host_ns) * 1e-9
        return age_s if age_s > self.max_age_s else None


class OutsideReadings:
    """The latest readings of one wheel from outside."""

    def __init__(self) -> None:
        """Start without a reading."""
        self._readings: deque[OutsideReading] = deque(maxlen=_DEPTH)

    def __bool__(self) -> bool:
        return bool(self._readings)

    def add(self, reading: OutsideReading) -> None:
        """Append a reading; one that is not later than the last is left out."""
        if not self._readings or reading.host_ns > self._readings[-1].host_ns:
            self._readings.append(reading)

    def until(self, host_ns: float) -> list[OutsideReading]:
        """Return the readings up to a time, the latest first."""
        end = bisect_right(self._readings, host_ns, key=lambda reading: reading.host_ns)
        return [self._readings[index] for index in range(end - 1, -1, -1)]
