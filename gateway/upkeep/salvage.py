"""Search for complete messages in a damaged recording, and for the torn places between them.

The messages of a plain chunk can be found without the chunk, so the file is read as one flat chain of records. Where
the chain is broken, the search continues at the next place that can only be a record: a message states its time twice
and names a known channel, a chunk states its length three times, and other records must fill their length.
"""

import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, Final, NamedTuple

from mcap.opcode import Opcode
from mcap.records import Channel, MessageIndex, Metadata

from gateway.core.recording.mcap_layout import (
    CHANNEL_METADATA,
    JSON_ENCODING,
    MAX_CHANNEL_CHARS,
    MAX_CHANNELS,
    MAX_RECORD_BYTES,
    RAW_ENCODING,
    SESSION_METADATA,
    ChannelInfo,
    declared_channel,
    is_sealed,
)
from gateway.core.recording.mcap_records import (
    CHUNK_DATA_LENGTH,
    CHUNK_HEAD,
    MAGIC,
    MESSAGE_HEAD,
    RECORD_HEAD,
    ChunkParts,
    MessageParts,
    channel_info,
    chunk_records,
    metadata_name,
    parse_chunk,
    parse_message,
    parse_small,
    walk,
)
from gateway.upkeep.file_window import FileWindow

# A time is plausible within these limits of the last message of its channel; others are remains of deleted files.
_MAX_STEP_BACK_NS: Final = 60 * 10**9
_MAX_STEP_FORWARD_NS: Final = 30 * 86_400 * 10**9
_MAX_TIME_SAMPLES: Final = 10_000
# Channel numbers count up from 1, so a number that exceeds the known ones by more than this is not a channel.
_UNKNOWN_CHANNELS: Final = 64
# Longest name of a compression: zstd.
_CHUNK_HEAD_BYTES: Final = CHUNK_HEAD.size + 4 + CHUNK_DATA_LENGTH.size
# The searches expect that both match the same number of bytes.
_START_BYTES: Final = 9
_RECORD_START: Final = re.compile(rb"[\x01-\x0f][\s\S]{4}\x00{4}")
_DECLARATION: Final = re.compile(rb"[\x04\x0c][\s\S]{2}[\x00-\x0f]\x00{5}")


class CompleteMessage(NamedTuple):
    """Message with a valid header, after which the chain continues; its data may contain overwritten bytes.

    Attributes:
        message: its fields.
        verified: whether it is in a chunk with a correct checksum.
        end: position in the file after it, or after its verified chunk.
    """

    message: MessageParts
    verified: bool
    end: int


class TornPlace(NamedTuple):
    """Torn place: bytes between two intact parts of the chain.

    Attributes:
        data: the bytes after `head`, or after the last valid record.
        head: header of the message that starts here, None when it is lost too.
        stated: number of bytes stated in `head`.
        compressed: whether this is a damaged compressed chunk, in which nothing can be found.
        end: position in the file where the chain continues.
    """

    data: memoryview
    head: MessageParts | None
    stated: int
    compressed: bool
    end: int


class Salvage:
    """Finder of the valid records of a file.

    Attributes:
        channels: all channels declared in the file.
        session: the session's metadata, empty when no copy is intact.
        size: size of the file in bytes.
        position: bytes read so far by `pieces`, for progress bars.
    """

    def __init__(self, data: FileWindow) -> None:
        """Search the whole file for declarations.

        Args:
            data: the file; of it, a window, a record and a torn place are in memory at once.
        """
        self.channels: dict[int, ChannelInfo] = {}
        self.session: dict[str, str] = {}
        self.position = 0
        self._data = data
        self.size = len(data)
        self._usual_ns: dict[int, int] = {}
        self._find_declarations()
        self._find_usual_times()

    def pieces(self) -> Iterator[CompleteMessage | TornPlace]:
        """Yield complete messages and torn places in file order."""
        position = len(MAGIC) if bytes(self._data.part(0, len(MAGIC))) == MAGIC else 0
        base: dict[int, int] = {}
        while position < self.size:
            self.position = position
            opcode, end = self._plausible(position, base)
            body = position + RECORD_HEAD.size
            if opcode in (Opcode.DATA_END, Opcode.FOOTER):
                return
            if opcode == Opcode.CHUNK:
                chunk = self._chunk_head(body, end)
                records = self._whole_chunk(body, end)
                if records is not None:
                    for message in self._messages(records):
                        base[message.channel] = message.log_time_ns
                        yield CompleteMessage(message, True, end)
                    position = end
                elif chunk.compression:
                    position = self._torn_end(position + 1, base)
                    yield TornPlace(self._data.part(body, position), None, 0, True, position)
                else:
                    position = body + chunk.data_offset
                continue
            if opcode and self._goes_on(opcode, body, end, base):
                if opcode == Opcode.MESSAGE:
                    message = parse_message(self._data.part(body, end))
                    base[message.channel] = message.log_time_ns
                    yield CompleteMessage(message, False, end)
                position = end
                continue
            head = parse_message(self._data.part(body, body + MESSAGE_HEAD.size)) if opcode == Opcode.MESSAGE else None
            begin = body + MESSAGE_HEAD.size if head is not None else position
            position = self._torn_end(max(begin, position + 1), base)
            yield TornPlace(
                self._data.part(begin, position), head, end - begin if head is not None else 0, False, position
            )
            if head is not None:
                base[head.channel] = head.log_time_ns

    def _goes_on(self, opcode: int, body: int, end: int, base: Mapping[int, int]) -> bool:
        """Return whether a record ends where the next one starts."""
        if end > self.size or not (self.size - end < RECORD_HEAD.size or self._plausible(end, base)[0]):
            return False
        # Missing bytes may let a message end with a later record; then it contains the start of a record.
        begin = body + MESSAGE_HEAD.size
        return opcode != Opcode.MESSAGE or self._next_record(begin, base, end) == end

    def _whole_chunk(self, body: int, end: int) -> memoryview | None:
        """Return the records of a complete chunk with a correct checksum, else None."""
        if end > self.size:
            return None
        try:
            return chunk_records(parse_chunk(self._data.part(body, end)))
        except ValueError:
            return None

    def _messages(self, records: memoryview) -> Iterator[MessageParts]:
        """Yield the messages among the records of a chunk, and learn its channels."""
        for opcode, inner in walk(records):
            try:
                if opcode == Opcode.MESSAGE:
                    yield parse_message(inner)
                elif opcode == Opcode.CHANNEL:
                    channel: Channel = parse_small(opcode, inner)
                    self._declare(channel.id, channel_info(channel))
            except ValueError:  # written so: the checksum is correct
                continue

    def _declare(self, number: int, channel: ChannelInfo) -> None:
        """Remember a channel that is not known yet."""
        if len(self.channels) < MAX_CHANNELS and sum(map(len, channel)) <= MAX_CHANNEL_CHARS:
            self.channels.setdefault(number, channel)

    def _plausible(self, position: int, base: Mapping[int, int]) -> tuple[int, int]:
        """Return (opcode, end) of the record that must start at `position`, opcode 0 when none does."""
        body = position + RECORD_HEAD.size
        if body > self.size:
            return 0, position
        opcode, length = self._data.unpack(RECORD_HEAD, position)
        end = body + length
        if length > MAX_RECORD_BYTES or not self._is_valid(opcode, body, end, base):
            return 0, position
        return opcode, end

    def _is_valid(self, opcode: int, body: int, end: int, base: Mapping[int, int]) -> bool:
        if opcode == Opcode.MESSAGE:
            if end - body < MESSAGE_HEAD.size or body + MESSAGE_HEAD.size > self.size:
                return False
            number, _, log_time_ns, publish_time_ns = self._data.unpack(MESSAGE_HEAD, body)
            return (
                log_time_ns == publish_time_ns
                and 0 < number <= max(self.channels, default=0) + _UNKNOWN_CHANNELS
                and self._in_time(number, log_time_ns, base)
            )
        try:
            if opcode == Opcode.CHUNK:
                chunk = self._chunk_head(body, end)
                return _fits(chunk.end_time_ns, base.values())
            if end > self.size:
                return False
            if opcode == Opcode.DATA_END:
                follows = self._data.part(end, end + 1)[0] if end < self.size else 0
                return end - body == 4 and follows in (0, *range(Opcode.FOOTER, Opcode.SUMMARY_OFFSET + 1))
            if opcode == Opcode.METADATA:
                return bool(metadata_name(self._data.part(body, end)))
            # Nothing that follows is read after a footer.
            record = parse_small(opcode, self._data.part(body, end), exact=opcode == Opcode.FOOTER)
        except ValueError:
            return False
        if isinstance(record, MessageIndex):
            return all(
                _fits(time_ns, base.values()) and offset < MAX_RECORD_BYTES for time_ns, offset in record.records
            )
        if isinstance(record, Channel):
            return record.message_encoding in (RAW_ENCODING, JSON_ENCODING)
        return True

    def _in_time(self, number: int, time_ns: int, base: Mapping[int, int]) -> bool:
        if number in base:
            return _fits(time_ns, [base[number]])
        return abs(time_ns - self._usual_ns.get(number, time_ns)) <= _MAX_STEP_FORWARD_NS

    def _chunk_head(self, body: int, end: int) -> ChunkParts:
        """Return the fields of a chunk, with at most the start of its data.

        Raises:
            ValueError: the fields contradict each other.
        """
        return parse_chunk(self._data.part(body, min(end, body + _CHUNK_HEAD_BYTES)), length=end - body)

    def _torn_end(self, start: int, base: Mapping[int, int]) -> int:
        """Return where a torn place ends: a long one is yielded in places of the size of the largest record."""
        limit = start + MAX_RECORD_BYTES
        if limit >= self.size:
            return self._next_record(start, base)
        end = self._next_record(start, base, limit)
        # A record may begin in the last bytes and end after them, so the next place begins before them.
        return end if end < limit else limit - RECORD_HEAD.size

    def _next_record(self, start: int, base: Mapping[int, int], until: int | None = None) -> int:
        """Return the next position from `start` at which a record must start, or `until`, the end of the file."""
        position = start
        last = self.size if until is None else until
        while (start_at := self._data.search(_RECORD_START, _START_BYTES, position, last)) is not None:
            position = start_at
            opcode, end = self._plausible(position, base)
            if opcode in (Opcode.MESSAGE, Opcode.CHUNK):
                return position
            # Other records have fewer checks, so a record must follow them.
            if opcode and (self.size - end < RECORD_HEAD.size or self._plausible(end, base)[0]):
                return position
            position += 1
        return last

    def _find_declarations(self) -> None:
        unsealed: dict[int, ChannelInfo] = {}
        position = 0
        while (start_at := self._data.search(_DECLARATION, _START_BYTES, position, self.size)) is not None:
            position = start_at
            opcode, length = self._data.unpack(RECORD_HEAD, position)
            end = position + RECORD_HEAD.size + length
            record = self._declaration(opcode, position + RECORD_HEAD.size, end)
            position += 1
            if isinstance(record, Channel) and record.message_encoding in (RAW_ENCODING, JSON_ENCODING):
                unsealed.setdefault(record.id, channel_info(record))
            elif isinstance(record, Metadata) and record.name == CHANNEL_METADATA:
                declared = declared_channel(record.metadata)
                if declared is not None:
                    self._declare(*declared)
            elif isinstance(record, Metadata) and record.name == SESSION_METADATA and is_sealed(record.metadata):
                self.session = self.session or record.metadata
        for number, info in unsealed.items():
            self._declare(number, info)

    def _declaration(self, opcode: int, begin: int, end: int) -> Any:
        """Return the record of a channel, or metadata that describe a channel or the session; None for any other."""
        if end > self.size:
            return None
        body = self._data.part(begin, end)
        try:
            if opcode == Opcode.METADATA and metadata_name(body) not in (CHANNEL_METADATA, SESSION_METADATA):
                return None
            return parse_small(opcode, body)
        except ValueError:
            return None

    def _find_usual_times(self) -> None:
        """Use the median time of each channel, since a damaged first message may state 0."""
        times: dict[int, list[int]] = {}
        position = 0
        for _ in range(_MAX_TIME_SAMPLES):
            start_at = self._data.search(_RECORD_START, _START_BYTES, position, self.size)
            if start_at is None:
                break
            body = position = start_at + RECORD_HEAD.size
            if self._data.part(start_at, body)[0] == Opcode.MESSAGE and body + MESSAGE_HEAD.size <= self.size:
                number, _, log_time_ns, publish_time_ns = self._data.unpack(MESSAGE_HEAD, body)
                if log_time_ns == publish_time_ns:
                    times.setdefault(number, []).append(log_time_ns)
        self._usual_ns = {number: sorted(times_ns)[len(times_ns) // 2] for number, times_ns in times.items()}


def _fits(time_ns: int, bases_ns: Iterable[int]) -> bool:
    """Return whether a time plausibly follows one of the others, or there are no others."""
    bases = tuple(bases_ns)
    return not bases or any(-_MAX_STEP_BACK_NS <= time_ns - base <= _MAX_STEP_FORWARD_NS for base in bases)
