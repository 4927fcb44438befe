"""Reading a recording in one pass, however it ended."""

from __future__ import annotations

import json
import os
from collections.abc import Generator, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Final

from mcap.opcode import Opcode
from mcap.records import Channel, Metadata

from gateway.errors import RecordingError
from gateway.io.source import LinkItem
from gateway.recording.mcap_layout import (
    CHANNEL_METADATA,
    MAX_RECORD_BYTES,
    SESSION_METADATA,
    ChannelInfo,
    RecordedMessage,
    declared_channel,
    is_sealed,
    message_to_item,
)
from gateway.recording.mcap_records import (
    MAGIC,
    RECORD_HEAD,
    channel_info,
    chunk_records,
    parse_chunk,
    parse_message,
    parse_small,
    walk,
)

REPAIR_REMEDY: Final = "`treadlink repair` rescues what is left of it."
_MOST_DIGITS: Final = 19
_FOOTER_BYTES: Final = RECORD_HEAD.size + 20


@dataclass(frozen=True, slots=True)
class RecordingInfo:
    """What a recording says of itself.

    Attributes:
        path: the file.
        size_bytes: its size.
        finished: False when its writer was killed, or the end is missing.
        treadlink: version that wrote it, empty when not known.
        start_ns: start of the session, None when not known.
        sources: URIs it was recorded from.
        vehicle_toml: configuration it was recorded with.
    """

    path: Path
    size_bytes: int
    finished: bool
    treadlink: str = ""
    start_ns: int | None = None
    sources: tuple[str, ...] = ()
    vehicle_toml: str | None = None


class RecordingReader:
    """Reads finished, unfinished, compressed and truncated recordings; memory stays flat.

    Attributes:
        info: what the recording says of itself.
        damage: after a pass, what could not be read and the remedy; None when all was.
        position: bytes read so far in the pass under way, for progress bars.
        session: the session's metadata as stored, empty when damaged.
        notes: other metadata met in the pass, as (name, entries): what a repair said of itself.
    """

    def __init__(self, path: Path | str) -> None:
        """Read the recording's description.

        Raises:
            RecordingError: not there, not readable, or no MCAP file.
        """
        self.damage: str | None = None
        self.position = 0
        self._path = Path(path)
        self.notes: list[tuple[str, dict[str, str]]] = []
        self._channels: dict[int, ChannelInfo] = {}
        with self._open() as file:
            size = os.fstat(file.fileno()).st_size
            self.session = self._session_metadata(file, size)
            self.info = _describe(self._path, size, _is_finished(file, size), self.session)

    @property
    def vehicle_toml(self) -> str | None:
        """Configuration text that the recording was made with, None when it has none."""
        return self.info.vehicle_toml

    def items(self) -> Generator[LinkItem, None, None]:
        """Yield chunks, link events and marks in file order; `damage` tells afterwards what was unreadable."""
        for message in self.messages():
            item = message_to_item(message)
            if item is not None:
                yield item

    def messages(self) -> Generator[RecordedMessage, None, None]:
        """Yield every message in file order, decoded topics too; `damage` as with `items`."""
        self.damage = None
        self._channels.clear()
        self.notes.clear()
        with self._open() as file:
            size = os.fstat(file.fileno()).st_size
            self.position = file.seek(len(MAGIC))
            for opcode, stated, body in self._records(file, size):
                if opcode == Opcode.DATA_END:
                    break
                yield from self._record_messages(opcode, stated, memoryview(body))
            self.position = size

    def _record_messages(self, opcode: int, stated: int, body: memoryview) -> Iterator[RecordedMessage]:
        if opcode != Opcode.CHUNK:
            yield from self._inner(opcode, body)
            return
        cut = len(body) < stated
        try:
            chunk = parse_chunk(body, length=stated)
            # What is there of a plain chunk is still good when the rest is cut off: its frames carry checksums.
            records = chunk_records(chunk) if not cut else memoryview(b"") if chunk.compression else chunk.data
        except ValueError as error:
            self._note(f"{error} near byte {self.position - len(body)}; {len(body)} bytes skipped")
            return
        for inner, inner_body in walk(records):
            yield from self._inner(inner, inner_body)

    def _inner(self, opcode: int, body: memoryview) -> Iterator[RecordedMessage]:
        try:
            if opcode == Opcode.MESSAGE:
                message = parse_message(body)
                channel = self._channels.get(message.channel)
                if channel is None:
                    self._note(f"a message of an undeclared channel {message.channel} was skipped")
                else:
                    yield RecordedMessage(channel, message.sequence, message.log_time_ns, bytes(message.data))
            elif opcode == Opcode.CHANNEL:
                record: Channel = parse_small(opcode, body)
                self._channels[record.id] = channel_info(record)
            elif opcode == Opcode.METADATA:
                self._learn(parse_small(opcode, body))
        except ValueError as error:
            self._note(f"{error} near byte {self.position}")

    def _learn(self, metadata: Metadata) -> None:
        if metadata.name == CHANNEL_METADATA:
            declared = declared_channel(metadata.metadata)
            if declared is not None:
                self._channels.setdefault(*declared)
        elif metadata.name != SESSION_METADATA:
            self.notes.append((metadata.name, metadata.metadata))
        elif not is_sealed(metadata.metadata):
            self._note("the description with the vehicle configuration is damaged")

    def _records(self, file: BinaryIO, size: int) -> Iterator[tuple[int, int, bytes]]:
        """Yield (opcode, stated length, body); the last body may be shorter than stated."""
        while self.position < size:
            head = file.read(RECORD_HEAD.size)
            if len(head) < RECORD_HEAD.size:
                self._note(f"cut off at byte {size}, inside a record")
                return
            opcode, length = RECORD_HEAD.unpack(head)
            if not 0 < opcode < 0x80 or length > MAX_RECORD_BYTES:
                self._note(f"no record where one should begin, at byte {self.position}; the rest was not read")
                return
            body = file.read(length)
            self.position += len(head) + len(body)
            if len(body) < length:
                self._note(f"cut off at byte {size}, inside a record")
            yield opcode, length, body
            if opcode == Opcode.FOOTER:
                return

    def _session_metadata(self, file: BinaryIO, size: int) -> dict[str, str]:
        """Return the session's metadata from before the first chunk."""
        file.seek(0)
        magic = file.read(len(MAGIC))
        if magic != MAGIC:
            remedy = REPAIR_REMEDY if size > 1 << 10 else "Recordings are made by `treadlink record` and end in .mcap."
            raise RecordingError(f"'{self._path}' is not a recording (it does not begin as an MCAP file does)", remedy)
        self.position = len(MAGIC)
        entries: dict[str, str] = {}
        for opcode, stated, body in self._records(file, size):
            if opcode in (Opcode.CHUNK, Opcode.MESSAGE, Opcode.DATA_END) or len(body) < stated:
                break
            if opcode == Opcode.METADATA:
                try:
                    record: Metadata = parse_small(opcode, memoryview(body))
                except ValueError:
                    break
                if record.name == SESSION_METADATA:
                    entries = record.metadata if is_sealed(record.metadata) else {}
                    break
        self.damage = None
        self.position = 0
        return entries

    def _note(self, text: str) -> None:
        if self.damage is None:
            self.damage = f"'{self._path}': {text}. {REPAIR_REMEDY}"

    def _open(self) -> BinaryIO:
        try:
            return self._path.open("rb")
        except FileNotFoundError as error:
            raise RecordingError(f"no recording '{self._path}'", "Check the path.") from error
        except OSError as error:
            raise RecordingError(
                f"cannot read recording '{self._path}': {error.strerror}", "Check its permissions."
            ) from error


def _is_finished(file: BinaryIO, size: int) -> bool:
    tail_bytes = _FOOTER_BYTES + len(MAGIC)
    if size < tail_bytes:
        return False
    file.seek(size - tail_bytes)
    tail = file.read(tail_bytes)
    return tail.endswith(MAGIC) and tail.startswith(RECORD_HEAD.pack(Opcode.FOOTER, 20))


def _describe(path: Path, size: int, finished: bool, entries: dict[str, str]) -> RecordingInfo:
    try:
        sources = tuple(str(source) for source in json.loads(entries.get("sources", "[]")))
    except (ValueError, TypeError, RecursionError):
        sources = ()
    start = entries.get("start_ns", "")
    return RecordingInfo(
        path=path,
        size_bytes=size,
        finished=finished,
        treadlink=entries.get("treadlink", ""),
        start_ns=int(start) if start.isdecimal() and len(start) <= _MOST_DIGITS else None,
        sources=sources,
        vehicle_toml=entries.get("vehicle_toml"),
    )
