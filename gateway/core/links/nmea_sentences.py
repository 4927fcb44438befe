"""Position, ground speed, course and time from sentences of NMEA 0183, by pynmeagps."""

import importlib.util
import logging
import math
import re
from collections import deque
from collections.abc import Iterator
from datetime import UTC, date, datetime, time
from statistics import median
from typing import Final, NamedTuple

_logger = logging.getLogger(__name__)

_MPS_PER_KNOT: Final = 1852.0 / 3600.0
# The sentence with position, speed, time and date, which every receiver sends; the two letters before name its system.
_TYPE: Final = slice(3, 6)
_RMC: Final = b"RMC"
# NMEA 0183 allows 82 characters.
_MAX_SENTENCE_BYTES: Final = 256
# Dead reckoning (E) may rest on the wheels that it would be compared with; M is typed in, S simulated, N none.
_NO_MODES: Final = frozenset("EMSN")
# Status A, a latitude, eight fields more, a mode from NMEA 0183 version 2.3 on, and a checksum.
_WITH_POSITION: Final = re.compile(
    rb"\$..RMC,[^,\r\n]*,A,\d[^,*\r\n]*(?:,[^,*\r\n]*){8}(?:,(?![EMSN])[^*\r\n]*)?\*[0-9A-Fa-f]{2}"
)
# Sentences whose arrival is compared with their time, and the fewest that say something.
_COMPARED_SENTENCES: Final = 15
_MIN_COMPARED: Final = 3
# A receiver on a slow serial port, or behind gpsd, sends up to a second after its time.
_MIN_AHEAD_S: Final = 2.0


class Fix(NamedTuple):
    """Position, speed, course and time of one sentence.

    Attributes:
        latitude_deg: to the north, WGS 84; NaN without a position.
        longitude_deg: to the east; NaN without a position.
        ground_speed_mps: horizontal speed, NaN without one.
        course_rad: over ground, from north to the right; NaN without one.
        utc_ns: time of the fix, ns since the epoch; None without date or time.
    """

    latitude_deg: float
    longitude_deg: float
    ground_speed_mps: float
    course_rad: float
    utc_ns: int | None

    @property
    def has_position(self) -> bool:
        """Whether the receiver had a position."""
        return math.isfinite(self.latitude_deg)


_NO_FIX: Final = Fix(math.nan, math.nan, math.nan, math.nan, None)


def has_position(lines: bytes) -> bool:
    """Return whether lines have a sentence with a position that can be used, if its checksum and numbers are right."""
    return _WITH_POSITION.search(lines) is not None


def can_read_sentences() -> bool:
    """Return whether pynmeagps is installed."""
    return importlib.util.find_spec("pynmeagps") is not None


class ReceiverClock:
    """Compares the time of a receiver with that of the arrivals of its sentences."""

    def __init__(self) -> None:
        """Start without a sentence."""
        self._ahead_s: deque[float] = deque(maxlen=_COMPARED_SENTENCES)

    def take(self, fix: Fix, host_ns: int) -> None:
        """Take a fix and its arrival."""
        if fix.utc_ns is not None:
            self._ahead_s.append((fix.utc_ns - host_ns) * 1e-9)

    @property
    def has_time(self) -> bool:
        """Whether enough is known to compare."""
        return len(self._ahead_s) >= _MIN_COMPARED

    @property
    def ahead_s(self) -> float | None:
        """Time to add to that of the arrivals; None where they agree, or before enough is known."""
        ahead_s = median(self._ahead_s) if self.has_time else 0.0
        return ahead_s if abs(ahead_s) >= _MIN_AHEAD_S else None


class SentenceReader:
    """Reads the fixes in lines of a receiver.

    Attributes:
        sentences: lines that begin as a sentence.
        fixes: sentences with a position.
        without_fix: sentences that say that there is no position.
        damaged: sentences for a fix whose checksum or fields are wrong.
    """

    def __init__(self) -> None:
        """Start; without pynmeagps sentences are counted, but none is read."""
        self.sentences = self.fixes = self.without_fix = self.damaged = 0
        self._can_read = can_read_sentences()

    def read(self, lines: bytes) -> Iterator[Fix]:
        """Yield the fix of each sentence RMC, without a position where the receiver has none."""
        for line in lines.splitlines():
            if not line.startswith(b"$"):
                continue
            self.sentences += 1
            if line[_TYPE] != _RMC or not self._can_read:
                continue
            fix = _fix(line)
            if fix is None:
                self.damaged += 1
                continue
            self.fixes += fix.has_position
            self.without_fix += not fix.has_position
            yield fix


def _fix(line: bytes) -> Fix | None:
    from pynmeagps import NMEAReader

    try:
        # Without a checksum a digit that is wrong is a position that is wrong.
        if len(line) > _MAX_SENTENCE_BYTES or line[-3:-2] != b"*":
            return None
        message = NMEAReader.parse(line + b"\r\n")
        utc_ns = _utc_ns(message.date, message.time)
        mode = getattr(message, "posMode", "")
        if message.status != "A" or message.lat == "" or message.lon == "" or mode in _NO_MODES:
            return _NO_FIX._replace(utc_ns=utc_ns)
        latitude_deg, longitude_deg = float(message.lat), float(message.lon)
        speed_mps = math.nan if message.spd == "" else float(message.spd) * _MPS_PER_KNOT
        course_rad = math.nan if message.cog == "" else math.radians(float(message.cog))
    except Exception as error:  # the library raises errors of many kinds for what is no sentence
        _logger.debug("sentence cannot be read: %s", error)
        return None
    if not (abs(latitude_deg) <= 90.0 and abs(longitude_deg) <= 180.0):
        return None
    return Fix(latitude_deg, longitude_deg, speed_mps, course_rad, utc_ns)


def _utc_ns(day: object, time_of_day: object) -> int | None:
    if not isinstance(day, date) or not isinstance(time_of_day, time):
        return None
    return round(datetime.combine(day, time_of_day, UTC).timestamp() * 1e6) * 1000
