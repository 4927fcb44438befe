"""Reader of recordings, finished or not, in one pass."""

import json
import logging
import os
from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Final

from mcap.opcode import Opcode
from mcap.records import Channel, Metadata

from firmware_protocol.decoder import FrameDecoder
from gateway.core.errors import RecordingError
from gateway.core.links.reasons import LinkCode
from gateway.core.links.source import LinkItem
from gateway.core.reasons import Code, Reason
from gateway.core.recording.mcap_layout import (
    CHANNEL_METADATA,
    MAX_CHANNEL_CHARS,
    MAX_CHANNELS,
    MAX_RECORD_BYTES,
    RAW_ENCODING,
    SESSION_METADATA,
    ChannelInfo,
    RecordedMessage,
    declared_channel,
    is_sealed,
    link_items,
    recorded_dbc,
)
from gateway.core.recording.mcap_records import (
    MAGIC,
    NO_RECORD,
    RECORD_HEAD,
    ChunkTooLargeError,
    channel_info,
    chunk_records,
    parse_chunk,
    parse_message,
    parse_small,
    walk,
)
from gateway.core.recording.reasons import RecordingCode
from gateway.core.recording.regular_file import open_recording_file
from gateway.core.recording.run_description import NO_DESCRIPTION, RunDescription, parse_description, read_notes
from gateway.core.writing_lock import is_being_written

# Those of `import`, which is a feature, and the first bytes of its formats that have some.
MEASUREMENT_SUFFIXES: Final = frozenset(
    {
        ".csv",
        ".txt",
        ".tsv",
        ".dat",
        ".lvm",
        ".tdx",
        ".xlsx",
        ".xlsm",
        ".mat",
        ".h5",
        ".hdf5",
        ".mf4",
        ".mdf",
        ".nc4",
        ".npy",
        ".npz",
        ".raw",
        ".vbo",
        ".wav",
        ".parquet",
        ".pq",
        ".tdms",
        ".uff",
        ".unv",
        ".ide",
    }
)
_MEASUREMENT_MAGICS: Final = (b"\x89HDF\r\n", b"MATLAB ", b"MDF     ", b"UnFinMF ", b"PAR1")
REPAIR_REMEDY: Final = "`treadlink repair` recovers what is left of it."
# Begin of a file that is no recording, looked at for frames of a link.
_PROBE_BYTES: Final = 1 << 14
_MAX_TIME_DIGITS: Final = 19
_FOOTER_BYTES: Final = RECORD_HEAD.size + 20
_LARGEST_TAIL_BYTES: Final = 4096

_READ_RECORDS: Final = frozenset(
    (Opcode.CHUNK, Opcode.MESSAGE, Opcode.CHANNEL, Opcode.METADATA, Opcode.DATA_END, Opcode.FOOTER)
)
# Limits that no session reaches: what a hostile file states would otherwise fill the memory.
_MAX_LINKS: Final = 256
_MAX_NOTE_CHARS: Final = 4 << 20
_ENTRY_CHARS: Final = 100

_logger = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class RecordingInfo:
    """Description of a recording.

    Attributes:
        path: the file.
        size_bytes: its size.
        finished: False when it is being written, its writer was killed or its end is missing.
        in_progress: whether it is being written.
        treadlink: version that wrote it, empty when unknown.
        start_ns: start of the session, None when unknown.
        sources: URIs of the sources.
        vehicle_toml: vehicle configuration of the session.
        dbc_text: DBC file of the vehicle bus, None without one.
        run: description of the test run as recorded, without later notes.
    """

    path: Path
    size_bytes: int
    finished: bool
    treadlink: str = ""
    start_ns: int | None = None
    sources: tuple[str, ...] = ()
    vehicle_toml: str | None = None
    dbc_text: str | None = None
    in_progress: bool = False
    run: RunDescription = NO_DESCRIPTION

    def described_run(self) -> RunDescription:
        """Return the description of the run with the notes that were added afterwards.

        Raises:
            RecordingError: the notes cannot be read.
        """
        return self.run.with_notes(read_notes(self.path))


class RecordingReader:
    """Reader of finished, unfinished, compressed and truncated recordings; memory use is constant.

    Attributes:
        info: description of the recording.
        position: bytes read so far in the current pass, for progress bars.
        session: the session's metadata as stored, empty when damaged.
        notes: other metadata found in the pass as (name, entries), such as those of a repair.
    """

    def __init__(self, path: Path | str) -> None:
        """Read the recording's description.

        Raises:
            RecordingError: the file does not exist, cannot be read, or is not an MCAP file.
        """
        self.position = 0
        self._path = Path(path)
        self._in_progress = False
        self._forget_damage()
        self.notes: list[tuple[str, dict[str, str]]] = []
        self._channels: dict[int, ChannelInfo] = {}
        self._links: set[str] = set()
        self._note_chars = 0
        self._watchers: list[Callable[[RecordedMessage], None]] = []
        with open_recording_file(self._path) as file:
            size = os.fstat(file.fileno()).st_size
            self.session = self._session_metadata(file, size)
            finished = _is_finished(file, size)
            self._in_progress = not finished and is_being_written(file)
            self.info = _describe(self._path, size, finished, self._in_progress, self.session)

    @property
    def damage(self) -> Reason | None:
        """What was unreadable in the last pass, None when everything was read; several parts are counted."""
        parts = self._damaged_parts + len(self._undeclared)
        if parts < 2 or self._unread_bytes < 1.0:
            return self._first_damage
        return Reason(
            LinkCode.RECORDING_PARTS_DAMAGED,
            recording=str(self._path),
            parts=parts,
            at_byte=self._first_damaged_byte,
            unread_bytes=round(self._unread_bytes),
            size_bytes=self.info.size_bytes,
        )

    @property
    def vehicle_toml(self) -> str | None:
        """Text of the vehicle configuration in the recording, None when it contains none."""
        return self.info.vehicle_toml

    def items(self) -> Generator[LinkItem, None, None]:
        """Yield chunks, frames of buses, link events and marks in file order; `damage` is set afterwards."""
        for message in self.messages():
            for take in self._watchers:
                take(message)
            yield from self.link_items(message)

    def watch(self, take: Callable[[RecordedMessage], None]) -> None:
        """Call a function with each message that `items` reads, before its items; not those of copies made before."""
        self._watchers = [*self._watchers, take]

    def link_items(self, message: RecordedMessage) -> Iterator[LinkItem]:
        """Yield the link items of a message; those of more links than a session can have are damage."""
        for item in link_items(message):
            if self._is_of_session(item.link):
                yield item
            else:
                self._note(LinkCode.RECORDING_RECORD_DAMAGED, at_byte=self.position)
                self._unread_bytes += len(message.data) * self._stored_share

    def messages(self) -> Generator[RecordedMessage, None, None]:
        """Yield all messages in file order, including decoded topics; `damage` is set afterwards."""
        self._forget_damage()
        # Made anew, not cleared: a copy of the reader makes a pass of its own.
        self._channels = {}
        self._links = set()
        self.notes = []
        self._note_chars = 0
        with open_recording_file(self._path) as file:
            size = os.fstat(file.fileno()).st_size
            self.position = file.seek(len(MAGIC))
            for opcode, length, body in self._records(file, size):
                if opcode == Opcode.DATA_END:
                    break
                yield from self._record_messages(opcode, length, memoryview(body))
            self.position = size

    def _record_messages(self, opcode: int, length: int, body: memoryview) -> Iterator[RecordedMessage]:
        if opcode != Opcode.CHUNK:
            yield from self._parse_record(opcode, body)
            return
        is_cut_off = len(body) < length
        try:
            chunk = parse_chunk(body, length=length)
            # The present part of a plain chunk is usable when the rest is cut off, as its frames have checksums.
            records = chunk_records(chunk) if not is_cut_off else memoryview(b"") if chunk.compression else chunk.data
        except ChunkTooLargeError as error:
            at_byte = self.position - len(body)
            self._note(
                RecordingCode.RECORDING_RECORD_TOO_LARGE,
                at_byte=at_byte,
                size_bytes=error.size_bytes,
                largest_bytes=MAX_RECORD_BYTES,
            )
            self._unread_bytes += len(body)
            return
        except ValueError as error:
            at_byte = self.position - len(body)
            _logger.info("%s: %s near byte %d", self._path, error, at_byte)
            self._note(LinkCode.RECORDING_CHUNK_DAMAGED, at_byte=at_byte, skipped_bytes=len(body))
            self._unread_bytes += len(body)
            return
        if is_cut_off and chunk.compression:
            self._unread_bytes += len(body)
        self._stored_share = len(chunk.data) / max(len(records), 1)
        for inner_opcode, inner_body in walk(records):
            if inner_opcode != NO_RECORD or not is_cut_off:
                yield from self._parse_record(inner_opcode, inner_body)

    def _parse_record(self, opcode: int, body: memoryview) -> Iterator[RecordedMessage]:
        try:
            if opcode == Opcode.MESSAGE:
                message = parse_message(body)
                channel = self._channels.get(message.channel)
                if channel is None:
                    self._note(LinkCode.RECORDING_CHANNEL_UNDECLARED, channel=message.channel)
                    self._unread_bytes += len(body) * self._stored_share
                else:
                    yield RecordedMessage(channel, message.sequence, message.log_time_ns, bytes(message.data))
            elif opcode == Opcode.CHANNEL:
                record: Channel = parse_small(opcode, body)
                self._declare(record.id, channel_info(record))
            elif opcode == Opcode.METADATA:
                self._take_metadata(parse_small(opcode, body))
            elif opcode == NO_RECORD:
                raise ValueError("what follows is no record")
        except ValueError as error:
            _logger.info("%s: %s near byte %d", self._path, error, self.position)
            self._note(LinkCode.RECORDING_RECORD_DAMAGED, at_byte=self.position)
            self._unread_bytes += len(body) * self._stored_share

    def _take_metadata(self, metadata: Metadata) -> None:
        if metadata.name == CHANNEL_METADATA:
            declared = declared_channel(metadata.metadata)
            if declared is not None and declared[0] not in self._channels:
                self._declare(*declared)
        elif metadata.name != SESSION_METADATA:
            self._note_chars += len(metadata.name) + sum(
                len(key) + len(value) + _ENTRY_CHARS for key, value in metadata.metadata.items()
            )
            if self._note_chars > _MAX_NOTE_CHARS:
                raise ValueError("too much metadata")
            self.notes.append((metadata.name, metadata.metadata))
        elif not is_sealed(metadata.metadata):
            self._note(LinkCode.RECORDING_DESCRIPTION_DAMAGED)

    def _declare(self, number: int, channel: ChannelInfo) -> None:
        """Remember a channel; raises ValueError when it is not one that a session can have."""
        if number not in self._channels and len(self._channels) >= MAX_CHANNELS:
            raise ValueError("too many channels")
        if sum(map(len, channel)) > MAX_CHANNEL_CHARS:
            raise ValueError("the name of a channel is too long")
        if channel.encoding == RAW_ENCODING and not self._is_of_session(channel.link):
            raise ValueError("too many links")
        self._channels[number] = channel

    def _is_of_session(self, link: str) -> bool:
        """Return whether a link is one of at most _MAX_LINKS of the recording."""
        if link not in self._links and len(self._links) >= _MAX_LINKS:
            return False
        self._links.add(link)
        return True

    def _records(self, file: BinaryIO, size: int) -> Iterator[tuple[int, int, bytes]]:
        """Yield (opcode, stated length, body); the last body may be shorter than stated."""
        while self.position < size:
            head = file.read(RECORD_HEAD.size)
            if len(head) < RECORD_HEAD.size:
                self._note(LinkCode.RECORDING_CUT_OFF, at_byte=size)
                return
            opcode, length = RECORD_HEAD.unpack(head)
            remaining = size - self.position - len(head)
            if not 0 < opcode < 0x80 or (length > MAX_RECORD_BYTES and length > remaining):
                self._note(LinkCode.RECORDING_RECORD_MISSING, at_byte=self.position)
                self._unread_bytes += size - self.position
                return
            if length > remaining:
                self._note(LinkCode.RECORDING_CUT_OFF, at_byte=size)
            is_needed = opcode in _READ_RECORDS
            if is_needed and length > MAX_RECORD_BYTES:
                self._note(
                    RecordingCode.RECORDING_RECORD_TOO_LARGE,
                    at_byte=self.position,
                    size_bytes=length,
                    largest_bytes=MAX_RECORD_BYTES,
                )
                self._unread_bytes += length
                is_needed = False
            if is_needed:
                body = file.read(length)
                self.position += len(head) + len(body)
                yield opcode, length, body
            else:
                self.position = file.seek(self.position + len(head) + min(length, remaining))
            if opcode == Opcode.FOOTER:
                return

    def _session_metadata(self, file: BinaryIO, size: int) -> dict[str, str]:
        """Return the session's metadata from before the first chunk."""
        file.seek(0)
        magic = file.read(len(MAGIC))
        if magic != MAGIC:
            if FrameDecoder().feed(magic + file.read(_PROBE_BYTES)):
                remedy = f"It is the raw dump of a link: `treadlink record 'replay:{self._path}?speed=max'` records it."
            elif self._path.suffix.lower() in MEASUREMENT_SUFFIXES or magic.startswith(_MEASUREMENT_MAGICS):
                remedy = (
                    f"It is a measurement: `treadlink import --guess '{self._path}'` writes a first import map for it."
                )
            elif size > 1 << 10 and self._path.suffix.lower() == ".mcap":
                remedy = f"If it was one whose beginning is lost: {REPAIR_REMEDY}"
            else:
                remedy = "Recordings are created by `treadlink record` and end in .mcap."
            raise RecordingError(f"'{self._path}' is not a recording: it does not start like an MCAP file", remedy)
        self.position = len(MAGIC)
        entries: dict[str, str] = {}
        for opcode, length, body in self._records(file, size):
            if opcode in (Opcode.CHUNK, Opcode.MESSAGE, Opcode.DATA_END) or len(body) < length:
                break
            if opcode == Opcode.METADATA:
                try:
                    record: Metadata = parse_small(opcode, memoryview(body))
                except ValueError:
                    break
                if record.name == SESSION_METADATA:
                    entries = record.metadata if is_sealed(record.metadata) else {}
                    break
        self._forget_damage()
        self.position = 0
        return entries

    def _forget_damage(self) -> None:
        self._first_damage: Reason | None = None
        self._first_damaged_byte = 0
        self._is_cut = False
        self._damaged_parts = 0
        self._last_damaged_byte = -1
        self._undeclared: set[int] = set()
        # Parts of the file: of a compressed chunk the share of its stored size.
        self._unread_bytes = 0.0
        self._stored_share = 1.0

    def _note(self, code: Code, **values: int) -> None:
        if code is LinkCode.RECORDING_CUT_OFF and self._in_progress:
            return  # its writer has not completed it yet
        if self._is_cut:
            return  # what follows is of the record that is cut off
        self._is_cut = code is LinkCode.RECORDING_CUT_OFF
        if self._first_damage is None:
            self._first_damage = Reason(code, recording=str(self._path), **values)
            self._first_damaged_byte = values.get("at_byte", self.position)
        if "channel" in values:
            self._undeclared.add(values["channel"])
        elif (at_byte := values.get("at_byte", 0)) != self._last_damaged_byte:
            self._damaged_parts += 1
            self._last_damaged_byte = at_byte


def _is_finished(file: BinaryIO, size: int) -> bool:
    """Return whether a file ends with a footer, which may have fields of a later version of MCAP."""
    file.seek(max(size - _LARGEST_TAIL_BYTES, 0))
    tail = file.read(_LARGEST_TAIL_BYTES)
    end = len(tail) - len(MAGIC)
    heads = range(end - _FOOTER_BYTES, -1, -1)
    return tail.endswith(MAGIC) and any(
        tail.startswith(RECORD_HEAD.pack(Opcode.FOOTER, end - head - RECORD_HEAD.size), head) for head in heads
    )


def _describe(path: Path, size: int, finished: bool, in_progress: bool, entries: dict[str, str]) -> RecordingInfo:
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
        start_ns=int(start) if start.isdecimal() and len(start) <= _MAX_TIME_DIGITS else None,
        sources=sources,
        vehicle_toml=entries.get("vehicle_toml"),
        dbc_text=recorded_dbc(entries),
        in_progress=in_progress,
        run=parse_description(entries.get("run", "{}")),
    )
