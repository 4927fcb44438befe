"""Frames in log files of a CAN bus: those that python-can reads, and texts of candump and SavvyCAN."""

from __future__ import annotations

import gzip
import itertools
import logging
import re
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from gateway.core.links.bus_frames import BusFrame

if TYPE_CHECKING:
    import can

_EXTENDED_DIGITS: Final = 3
_DIGITS: Final = re.compile(r"(\d+)$")
_FIRST_LINES: Final = 20
# candump without -l: time of -ta, -tA or none, interface, identifier, length, bytes.
_CONSOLE: Final = re.compile(
    r"\s*(?:\((?P<time>[^)]+)\)\s+)?(?P<bus>[A-Za-z][\w.-]*)\s+(?:[RT]X\s+(?:[\w-]+\s+){1,2})?(?P<id>[0-9A-Fa-f]{3,8})\s+"
    r"\[(?P<length>\d+)\](?P<rest>.*)"
)
_BYTE: Final = re.compile(r"\s*([0-9A-Fa-f]{2})(?=\s|$)")
_LISTED: Final = re.compile(r"\(\d+\.\d+\)\s+\S+\s+[0-9A-Fa-f]+#")
_SAVVY: Final = ("time stamp", "id", "extended")
# Times of candump beyond this count from 1970.
_SINCE_1970_S: Final = 1e8
_ERROR_ID: Final = 1 << 29
_ASC_STAMP: Final = re.compile(r"(\s*)(-?\d+\.\d+)(\s.*)", re.DOTALL)
_ASC_HEADER: Final = re.compile(r"\s*(?://|date|base|(?:no\s+)?internal|begin|end|previous|version)", re.IGNORECASE)
_ASC_FRAME: Final = re.compile(
    r"\s+(?:CANFD\s+\d+\s+[RT]x\b|Li\S*\s|\d+\s+[0-9A-Fa-f]+x?\s+[RT]x\s+(?:r|d\s+[0-9A-Fa-f]+(?:\s+[0-9A-Fa-f]{1,3})*(?:\s+\w+\s*=.*)?)\s*)",
    re.IGNORECASE,
)
_ASC_STARTS: Final = re.compile(r"\s*-?\d+\.\d+\s+CANFD\s+Start of measurement", re.IGNORECASE)


def channel_number(name: object) -> int | None:
    """Return the number of a bus by its name in a log: 1 of `1`, `can1` and `vcan1`, None where it has none."""
    match = _DIGITS.search(str(name).strip())
    return int(match[1]) if match else None


def frame_of(message: can.Message, host_ns: int, channel: int | None) -> BusFrame:
    """Return a message of python-can as a frame."""
    return BusFrame(
        host_ns,
        message.arbitration_id,
        message.is_extended_id,
        bytes(message.data),
        message.is_fd,
        message.is_remote_frame,
        message.is_error_frame,
        channel,
    )


def logged_frames(path: Path, offset_ns: int) -> Iterator[BusFrame]:
    """Yield the frames of a log file at its times, in the order of the file.

    Args:
        path: of the file.
        offset_ns: added to its times.

    Raises:
        ValueError: a line of text is none of its format, or the file is cut off.
        Exception: of python-can, where the file is damaged.
    """
    suffix = path.name.lower().removesuffix(".gz").rpartition(".")[2]
    first = [line for line in _first_lines(path) if line.strip()] if suffix in ("log", "csv") else []
    if first and suffix == "csv" and first[0].lower().startswith(_SAVVY[0]):
        yield from _savvy_frames(path, offset_ns)
    elif first and suffix == "log" and not any(map(_LISTED.match, first)):
        yield from _console_frames(path, offset_ns)
    else:
        yield from _library_frames(path, offset_ns, suffix)
    if suffix in ("log", "csv", "asc", "trc") and not _ends(path):
        raise ValueError("its last line has no end: the file may be cut there")


def _ends(path: Path) -> bool:
    """Return whether the last line of a text ends."""
    last = "\n"
    with _opened(path) as file:
        for line in file:
            last = line
    return last.endswith("\n")


def _library_frames(path: Path, offset_ns: int, suffix: str) -> Iterator[BusFrame]:
    import can

    source: Any
    if suffix == "asc":
        source = can.ASCReader(_AscLines(path))  # type: ignore[arg-type]
    elif suffix == "log":
        source = can.CanutilsLogReader(_ListedLines(path))  # type: ignore[arg-type]
    else:
        source = can.LogReader(path)
    # Vector counts channels from 1, python-can from 0.
    first_channel = 1 if suffix in ("asc", "blf") else 0
    before_s = source.file.before_s if suffix == "asc" else 0.0
    with source as reader, _collected_warnings(suffix) as messages:
        for message in reader:
            channel = channel_number(message.channel)
            channel = None if channel is None else channel + first_channel
            yield frame_of(message, offset_ns + round((message.timestamp - before_s) * 1e9), channel)
        if suffix == "asc" and source.file.unread:
            raise ValueError(f"{source.file.unread} lines are none of an ASC log, the first is {source.file.first}")
        stated_bytes = getattr(reader, "file_size", 0) if suffix == "blf" else 0
    if messages:
        raise ValueError(f"{len(messages)} lines cannot be read: {messages[0]}")
    if stated_bytes > path.stat().st_size:
        raise ValueError(f"the file is cut: it has {path.stat().st_size} of {stated_bytes} bytes")


@contextmanager
def _collected_warnings(suffix: str) -> Iterator[list[str]]:
    """Collect what python-can warns of while it reads, which then does not go to the screen."""
    messages: list[str] = []

    def note(record: logging.LogRecord) -> bool:
        messages.append(record.getMessage())
        return False

    logger = logging.getLogger(f"can.io.{suffix}")
    logger.addFilter(note)
    try:
        yield messages
    finally:
        logger.removeFilter(note)


class _ListedLines:
    """Lines of `candump -l`; one of another form is named by its number."""

    def __init__(self, path: Path) -> None:
        self._file = _opened(path)

    def __iter__(self) -> Iterator[str]:
        for number, line in enumerate(self._file, 1):
            if line.strip() and not _LISTED.match(line):
                raise ValueError(f"line {number} is no line of candump -l: (time) can0 123#11223344")
            yield line

    def read(self) -> str:
        """Return the rest; python-can asks whether a file can be read."""
        return "".join(self)

    def close(self) -> None:
        """Close the file."""
        self._file.close()


class _AscLines:
    """Lines of an ASC log as python-can reads them: times count from the start and are positive.

    Attributes:
        before_s: time by which all stamps were shifted: a log may begin before its trigger.
        unread: number of lines that are none of such a log.
        first: number of the first of them.
    """

    def __init__(self, path: Path) -> None:
        self._file = _opened(path)
        self.before_s = 0.0
        self.unread = self.first = 0
        self._is_relative = self._is_data = False
        self._time_s = 0.0
        self._remaining_lines = self._lines()
        first = [match for line in _first_lines(path, 200) if (match := _ASC_STAMP.match(line))]
        lowest_s = min((float(match[2]) for match in first), default=0.0)
        if lowest_s < 0.0:
            self.before_s = -lowest_s

    def __iter__(self) -> Iterator[str]:
        """Go on where the last loop has ended, as a file does."""
        return self._remaining_lines

    def _lines(self) -> Iterator[str]:
        for number, line in enumerate(self._file, 1):
            self._note(number, line)
            self._is_relative |= re.search(r"timestamps\s+relative", line, re.IGNORECASE) is not None
            match = _ASC_STAMP.match(line)
            if match is None:
                yield line
                continue
            if not self._is_data:
                # python-can takes the line that ends the header away.
                self._is_data = True
                yield "// data\n"
                yield "internal events logged\n"
            self._time_s = float(match[2]) + (self._time_s if self._is_relative else 0.0)
            if not _ASC_STARTS.match(line):
                yield f"{match[1]}{self._time_s + self.before_s:.9f}{match[3]}"

    def _note(self, number: int, line: str) -> None:
        """Count a line that is neither of the header nor stamped, or stamped as a frame without being one."""
        match = _ASC_STAMP.match(line)
        is_frame = match is not None and _ASC_FRAME.match(match[3]) is not None
        is_event = match is not None and not re.search(r"\s[RT]x\s", match[3])
        if not (is_frame or is_event or not line.strip() or _ASC_HEADER.match(line)):
            self.unread += 1
            self.first = self.first or number

    def read(self) -> str:
        """Return the rest; python-can asks whether a file can be read."""
        return "".join(self)

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def _console_frames(path: Path, offset_ns: int) -> Iterator[BusFrame]:
    """Yield the frames of what candump prints; lines without a time cannot be placed."""
    is_since_last, last_ns = _are_differences(path), 0
    with _opened(path) as file:
        for number, line in enumerate(file, 1):
            if not line.strip():
                continue
            match = _CONSOLE.fullmatch(line.rstrip())
            if match is None:
                raise ValueError(f"line {number} is no line of candump: (time) can0 123#11223344 with -l, or "
                                 f"(time) can0 123 [4] 11 22 33 44")  # fmt: skip
            if match["time"] is None:
                raise ValueError(f"line {number} has no time: record with candump -l, or with -ta")
            number_id, payload_text = int(match["id"], 16), match["rest"]
            is_error = "ERRORFRAME" in payload_text
            last_ns = _console_ns(match["time"].strip(), number) + (last_ns if is_since_last else 0)
            data = bytes(int(byte, 16) for byte in _bytes_of(payload_text, int(match["length"])))
            yield BusFrame(
                offset_ns + last_ns,
                number_id & (_ERROR_ID - 1) if is_error else number_id,
                len(match["id"]) > _EXTENDED_DIGITS and not is_error,
                data,
                len(match["length"]) > 1,
                is_remote="remote request" in payload_text,
                is_error=is_error,
                channel=channel_number(match["bus"]),
            )


def _are_differences(path: Path) -> bool:
    """Return whether the times of candump are those since the last frame, as with -td: they begin again and again."""
    matches = [_CONSOLE.fullmatch(line.rstrip()) for line in _first_lines(path, 200)]
    times = [match["time"].strip() for match in matches if match is not None and match["time"]]
    seconds = [float(text) for text in times if re.fullmatch(r"\d+\.\d+", text)]
    steps_back = sum(later <= before for before, later in itertools.pairwise(seconds))
    return len(seconds) > 2 and max(seconds) < _SINCE_1970_S and steps_back > 0.2 * len(seconds)


def _bytes_of(text: str, count: int) -> list[str]:
    pairs: list[str] = []
    offset = 0
    while len(pairs) < count and (match := _BYTE.match(text, offset)):
        pairs.append(match[1])
        offset = match.end()
    return pairs


def _console_ns(text: str, number: int) -> int:
    """Return a time of candump in ns: seconds since 1970, or a date with a time."""
    if re.fullmatch(r"\d+\.\d+", text):
        seconds, _, fraction = text.partition(".")
        return int(seconds) * 1_000_000_000 + int(fraction[:9].ljust(9, "0"))
    try:
        moment = datetime.fromisoformat(text)
    except ValueError as error:
        raise ValueError(f"line {number}: '{text}' is no time of candump -ta or -tA") from error
    return int(moment.replace(microsecond=0).timestamp()) * 1_000_000_000 + moment.microsecond * 1000


def _savvy_frames(path: Path, offset_ns: int) -> Iterator[BusFrame]:
    """Yield the frames of a CSV file of SavvyCAN (GVRET): times in us, bytes in columns of their own."""
    with _opened(path) as file:
        header = [cell.strip().lower() for cell in next(file).split(",")]
        places = {name: header.index(name) for name in ("time stamp", "id", "extended", "len", "d1")}
        bus = header.index("bus") if "bus" in header else None
        for number, line in enumerate(file, 2):
            cells = [cell.strip() for cell in line.split(",")]
            if cells == [""]:
                continue
            try:
                length = int(cells[places["len"]])
                data = bytes(int(cell, 16) for cell in cells[places["d1"] : places["d1"] + length])
                yield BusFrame(
                    offset_ns + int(cells[places["time stamp"]]) * 1000,
                    int(cells[places["id"]], 16),
                    cells[places["extended"]].lower() in ("true", "1"),
                    data,
                    channel=channel_number(cells[bus]) if bus is not None else None,
                )
            except (ValueError, IndexError) as error:
                raise ValueError(f"line {number} is no line of SavvyCAN: {','.join(header[:7])}, ...") from error


def _opened(path: Path) -> Any:
    if path.name.lower().endswith(".gz"):
        return gzip.open(path, "rt", encoding="utf-8", errors="replace")
    return path.open(encoding="utf-8", errors="replace")


def _first_lines(path: Path, count: int = _FIRST_LINES) -> list[str]:
    with _opened(path) as file:
        return [line for _, line in zip(range(count), file, strict=False)]
