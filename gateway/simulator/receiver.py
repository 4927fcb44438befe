"""Sentences of a positioning receiver on the simulated vehicle, which starts due north."""

import math
from collections.abc import Iterator
from datetime import UTC, datetime
from typing import Final

import numpy as np

from gateway.core.links.source import Sentences
from gateway.simulator.motion import MotionProfile
from gateway.simulator.time_series import Series, constant

LINK: Final = "nmea:sim"
START_DEG: Final = (48.0, 11.0)
"""Latitude and longitude of the start."""

RATES_HZ: Final = (0.01, 100.0)
"""Lowest and highest rate of fixes: a sentence states its time to hundredths of a second."""

EARTH_RADIUS_M: Final = 6_371_000.0
# Errors as data sheets state them: of the speed, and of a position, which wanders slowly.
_SPEED_STD_MPS: Final = 0.05
_POSITION_STD_M: Final = 2.1
_WANDERING_S: Final = 60.0
# From the time of a fix to its arrival.
_DELAY_S: Final = 0.1
# Between fixes the path is lines of this duration.
_STEP_S: Final = 0.05
_STRAIGHT: Final = constant(0.0)
_KNOT_MPS: Final = 1852.0 / 3600.0


class SimulatedReceiver:
    """Receiver that sends a sentence RMC at a steady rate."""

    def __init__(
        self, motion: MotionProfile, rate_hz: float, rng: np.random.Generator, yaw_radps: Series = _STRAIGHT
    ) -> None:
        """Mount the receiver.

        Args:
            motion: of the vehicle.
            rate_hz: fixes per second.
            rng: of its errors.
            yaw_radps: of the vehicle, positive to the left.
        """
        self._motion, self._yaw_radps = motion, yaw_radps
        self._interval_s = 1.0 / rate_hz
        self._rng = rng

    def sentences(self, start_ns: int) -> Iterator[Sentences]:
        """Yield sentences without end; the vehicle starts at `start_ns`, ns since the epoch."""
        keep = math.exp(-self._interval_s / _WANDERING_S)
        north_m, east_m = self._rng.normal(0.0, _POSITION_STD_M, 2)
        ahead_m, left_m, heading_rad, before_s = 0.0, 0.0, 0.0, 0.0
        count = 0
        while True:
            at_s = count * self._interval_s
            rolling = self._motion.at(np.array([at_s]))
            ahead, left, heading_rad = self._driven(before_s, at_s, heading_rad)
            ahead_m, left_m, before_s = ahead_m + ahead, left_m + left, at_s
            fresh_m = self._rng.normal(0.0, _POSITION_STD_M * math.sqrt(1.0 - keep * keep), 2)
            north_m, east_m = keep * north_m + fresh_m[0], keep * east_m + fresh_m[1]
            latitude_rad = math.radians(START_DEG[0]) + (ahead_m + north_m) / EARTH_RADIUS_M
            longitude_rad = math.radians(START_DEG[1]) + (east_m - left_m) / EARTH_RADIUS_M / math.cos(latitude_rad)
            speed_mps = max(0.0, float(rolling.speed_mps[0]) + float(self._rng.normal(0.0, _SPEED_STD_MPS)))
            at_ns = start_ns + round(at_s * 1e9)
            line = rmc(at_ns, math.degrees(latitude_rad), math.degrees(longitude_rad), speed_mps, heading_rad)
            yield Sentences(LINK, at_ns + round(_DELAY_S * 1e9), line)
            count += 1

    def _driven(self, begin_s: float, end_s: float, heading_rad: float) -> tuple[float, float, float]:
        """Return the way to the north and to the west in m, and the heading at its end."""
        times = np.linspace(begin_s, end_s, math.ceil((end_s - begin_s) / _STEP_S) + 1)
        middles = 0.5 * (times[1:] + times[:-1])
        turns = np.diff(times) * self._yaw_radps.at_times(middles)
        lengths = np.diff(self._motion.at(times).distance_m)
        headings = heading_rad + np.cumsum(turns) - 0.5 * turns
        ahead, left = (lengths * np.cos(headings)).sum(), (lengths * np.sin(headings)).sum()
        return float(ahead), float(left), heading_rad + float(turns.sum())


def rmc(
    utc_ns: int,
    latitude_deg: float,
    longitude_deg: float,
    speed_mps: float,
    heading_rad: float = 0.0,
    *,
    has_fix: bool = True,
) -> bytes:
    """Return a sentence RMC with its checksum and line end; the heading is from north to the west."""
    course_deg = round(math.degrees(-heading_rad) % 360.0, 2) % 360.0
    utc = datetime.fromtimestamp(utc_ns // 1_000_000_000, UTC)
    time_text = f"{utc:%H%M%S}.{utc_ns // 10_000_000 % 100:02d}"
    position = (
        f"{_angle(latitude_deg, 2, 'NS')},{_angle(longitude_deg, 3, 'EW')},{speed_mps / _KNOT_MPS:.3f},{course_deg:.2f}"
    )
    fields = f"A,{position}" if has_fix else "V,,,,,,"
    body = f"GNRMC,{time_text},{fields},{utc:%d%m%y},,,{'A' if has_fix else 'N'}"
    checksum = 0
    for byte in body.encode():
        checksum ^= byte
    return f"${body}*{checksum:02X}\r\n".encode()


def _angle(value_deg: float, digits: int, signs: str) -> str:
    """Return degrees and minutes as NMEA 0183 writes them, to a centimetre, with the letter of the half."""
    units = round(abs(value_deg) * 60.0 * 1e5)
    degrees, minutes = divmod(units, 60 * 100_000)
    return f"{degrees:0{digits}d}{minutes / 1e5:08.5f},{signs[value_deg < 0.0]}"
