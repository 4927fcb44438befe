"""Dates with times (ISO 8601) as seconds from the first of them, and times of day as seconds from midnight."""

import math
import re
from collections.abc import Callable, Sequence
from datetime import datetime, timedelta, tzinfo
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.core.errors import ImportDataError
from gateway.core.types import FloatArray
from gateway.importing.import_map import zone_of

_TIME: Final = re.compile(
    r"\s*(?:(\d{1,4}[-/. ](?:\d{1,2}|[a-z]{3})[-/. ]\d{1,4})[T ])?\s*(\d{1,2}:\d\d:\d\d(?:[.,]\d{1,9})?)\d*\s*"
    r"([ap]\.?m\.?)?\s*"
    r"(Z|[+-]\d\d(?::?\d\d)?)?\s*",
    re.IGNORECASE,
)
# Place of year, month and day in a date.
_PLACES: Final = {"ymd": (0, 1, 2), "dmy": (2, 1, 0), "mdy": (2, 0, 1)}
_MONTHS: Final = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")
# Stands for the date of times of day; they pass midnight where they step back by more than half a day.
_NO_DATE: Final = "1970-01-01"
_DAY_S: Final = 86400.0
_MISSING: Final = ("", "nan", "nat", "null", "none")
_EXAMPLE: Final = "2024-05-01T12:00:00.0001+02:00"
_ZONE_REMEDY: Final = (
    'State [sampling] time_zone, such as "Europe/Berlin", "UTC" or "+02:00", or write the times with their offset, '
    f"such as {_EXAMPLE}."
)


class IsoTimes:
    """Converter of ISO times, block by block.

    Attributes:
        column: name of the column.
        start_ns: the first time, ns since 1970 (UTC); None before there is one, and for times of day.
    """

    def __init__(self, path: Path, column: str, zone: str | None, order: str = "ymd") -> None:
        """Prepare the conversion.

        Args:
            path: file, for messages.
            column: name of the column.
            zone: time zone of times that state none, None when not stated.
            order: of year, month and day: `ymd`, `dmy` or `mdy`.
        """
        self.start_ns: int | None = None
        self._path = path
        self._order = order
        self.column = column
        self._zone_name = zone or ""
        self._zone: tzinfo | None = None if zone is None else zone_of(zone)
        self._has_dates: bool | None = None
        self.rewind()

    def rewind(self) -> None:
        """Begin again with the first row of the file."""
        self._midnight_s, self._last_s = 0.0, math.nan

    def seconds(self, cells: Sequence[str], where: Callable[[int], str]) -> FloatArray:
        """Return (n,) seconds from the first time of the file, or from the first midnight; NaN for empty cells.

        Args:
            cells: text of each row.
            where: returns the place of a row for messages.

        Raises:
            ImportDataError: a cell is no ISO time, has no time zone, or is ambiguous in its zone.
        """
        times: list[str] = []
        offsets: list[str | None] = []
        timed_rows: list[int] = []
        for row, cell in enumerate(cells):
            match = _TIME.fullmatch(cell.strip().strip('"'))
            if match is not None and self._has_dates is None:
                self._has_dates = match[1] is not None
            fits = match is not None and (match[1] is not None) == self._has_dates
            time = self._iso(match) if match is not None and fits else None
            if match is not None and time is not None:
                times.append(time)
                offsets.append(match[4])
                timed_rows.append(row)
            elif cell.strip().strip('"').lower() not in _MISSING:
                raise self._unreadable(cell, where(row))
        try:
            local = np.array([time.replace(",", ".") for time in times], dtype="datetime64[ns]")
        except ValueError as error:
            row = next(row for row, time in zip(timed_rows, times, strict=True) if not _is_date(time))
            raise self._unreadable(cells[row], where(row)) from error
        if self._has_dates is False:
            return self._of_day(local, timed_rows, len(cells))
        return self._from_local(local, offsets, timed_rows, len(cells), where)

    def _iso(self, match: re.Match[str]) -> str | None:
        if match[1] is None:
            return _iso(_NO_DATE, match[2], match[3], "ymd")
        return _iso(match[1], match[2], match[3], self._order)

    def _of_day(self, local: NDArray[np.datetime64], timed_rows: Sequence[int], rows: int) -> FloatArray:
        """Return (rows,) seconds from midnight, which go on where the times pass it."""
        seconds = np.full(rows, np.nan)
        if len(local):
            clock_s = local.astype(np.int64) * 1e-9
            previous_s = np.concatenate(([self._last_s], clock_s[:-1]))
            day_shifts_s = np.cumsum(clock_s - previous_s < -0.5 * _DAY_S) * _DAY_S
            seconds[np.asarray(timed_rows)] = clock_s + self._midnight_s + day_shifts_s
            self._midnight_s, self._last_s = self._midnight_s + float(day_shifts_s[-1]), float(clock_s[-1])
        return seconds

    def _from_local(
        self,
        local: NDArray[np.datetime64],
        offsets: Sequence[str | None],
        timed_rows: Sequence[int],
        rows: int,
        where: Callable[[int], str],
    ) -> FloatArray:
        """Return (rows,) seconds from the first time of the file.

        Args:
            local: (n,) local times.
            offsets: their offsets from UTC as text, None where not stated.
            timed_rows: (n,) their rows; the others are NaN.
            rows: number of rows.
            where: returns the place of a row for messages.

        Raises:
            ImportDataError: a time has no time zone, or is ambiguous in its zone.
        """
        shifts = {offset: _offset_ns(offset) for offset in set(offsets) if offset is not None}
        utc_ns = local.astype(np.int64) - np.array([shifts.get(offset or "", 0) for offset in offsets], dtype=np.int64)
        is_naive = np.array([offset is None for offset in offsets], dtype=np.bool_)
        if is_naive.any():
            places = np.asarray(timed_rows)[is_naive]
            utc_ns[is_naive] -= self._zone_ns(local[is_naive], lambda k: where(int(places[k])))
        seconds = np.full(rows, np.nan)
        if len(utc_ns):
            if self.start_ns is None:
                self.start_ns = int(utc_ns[0])
            # In integers: a double of the seconds since 1970 is 0.2 us coarse.
            seconds[np.asarray(timed_rows)] = (utc_ns - self.start_ns) * 1e-9
        return seconds

    def _zone_ns(self, local: NDArray[np.datetime64], where: Callable[[int], str]) -> NDArray[np.int64]:
        """Return the offset from UTC of local times in the stated zone."""
        if self._zone is None:
            raise ImportDataError(
                f"{self._path}: {where(0)}, column '{self.column}': '{local[0]}' states no time zone", _ZONE_REMEDY
            )
        buckets, first, bucket_index = _buckets(local)
        offsets_ns = np.zeros(len(buckets), dtype=np.int64)
        for k, bucket in enumerate(buckets):
            moment = bucket.astype("datetime64[us]").astype(datetime)
            # Clocks are changed at full quarters of an hour.
            early, late = (self._zone.utcoffset(moment.replace(fold=fold, tzinfo=None)) for fold in (0, 1))
            early = early or timedelta(0)
            late = late or timedelta(0)
            if early != late:
                fault = "occurs twice" if late < early else "does not exist"
                raise ImportDataError(
                    f"{self._path}: {where(int(first[k]))}, column '{self.column}': the local time "
                    f"'{local[first[k]]}' {fault} in {self._zone_name}, where the clock was changed",
                    f"Write the times with their offset, such as {_EXAMPLE}, or in UTC; or state the offset itself: "
                    '[sampling] time_zone = "+02:00".',
                )
            offsets_ns[k] = int(early / timedelta(microseconds=1)) * 1000
        return offsets_ns[bucket_index]

    def _unreadable(self, cell: str, position: str) -> ImportDataError:
        return ImportDataError(
            f"{self._path}: {position}, column '{self.column}': '{cell.strip()[:60]}' is not an ISO time",
            f"Write date and time, such as {_EXAMPLE}, or state [sampling] date_order; or write seconds, with another "
            "time_unit; or state rate_hz.",
        )


def _iso(date: str, clock: str, meridiem: str | None, order: str) -> str | None:
    """Return date and time of day as ISO text, None where the date has another order or the hour no such half."""
    parts = re.split(r"[-/. ]", date)
    if parts[1].isalpha():
        # The name of a month leaves no doubt about the order.
        order = "ymd" if len(parts[0]) == 4 else "dmy"
        parts[1] = str(_MONTHS.index(parts[1].lower()) + 1) if parts[1].lower() in _MONTHS else "13"
    year, month, day = (parts[index] for index in _PLACES[order])
    hour, remainder = clock.split(":", 1)
    number = int(hour)
    if len(year) != 4 or len(month) > 2 or len(day) > 2 or (meridiem is not None and not 1 <= number <= 12):
        return None
    if meridiem is not None:
        # 12 am is midnight, 12 pm noon.
        number = number % 12 + (12 if meridiem[0] in "pP" else 0)
    return f"{year}-{month:0>2}-{day:0>2}T{number:02}:{remainder}"


def _buckets(
    local: NDArray[np.datetime64],
) -> tuple[NDArray[np.datetime64], NDArray[np.intp], NDArray[np.intp]]:
    """Return the quarters of hours that occur, the first row in each, and the quarter of each row."""
    minutes = local.astype("datetime64[m]").astype(np.int64)
    quarters, first, bucket_index = np.unique(minutes // 15, return_index=True, return_inverse=True)
    return (quarters * 15).astype("datetime64[m]"), first, bucket_index


def _offset_ns(offset: str) -> int:
    if offset in ("Z", "z"):
        return 0
    digits = offset[1:].replace(":", "").ljust(4, "0")
    seconds = int(digits[:2]) * 3600 + int(digits[2:]) * 60
    return (-seconds if offset[0] == "-" else seconds) * 1_000_000_000


def _is_date(time: str) -> bool:
    try:
        np.datetime64(time.replace(",", "."), "ns")
    except ValueError:
        return False
    return True
