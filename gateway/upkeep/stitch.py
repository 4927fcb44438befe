"""Messages of a repaired recording: whole ones as they are, of torn places the bytes of the frames that are whole.

A torn place contains the rest of a message, and possibly the end of a later one whose header is lost. Its frames are
known by their checksums and belong to the link whose hub's clock they follow.
"""

import json
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, NamedTuple

from firmware_protocol.framing import next_frame
from firmware_protocol.wire import HEADER, SYNC
from gateway.core.recording.mcap_layout import RAW_ENCODING, ChannelInfo, raw_topic
from gateway.upkeep.salvage import CompleteMessage, Salvage, TornPlace

_HEADER: Final = HEADER.reader("hub", "tick_us")
_MAX_JSON_BYTES: Final = 1 << 20
# Enough for the latest frame of every hub of a link.
_RECENT_BYTES: Final = 16_384
_TICK_RANGE: Final = 1 << 32
# A frame follows the latest one of its hub within these limits; others are remains of deleted files.
_MAX_TICKS_BACK_US: Final = 2_000_000
_MAX_TICKS_AHEAD_US: Final = 600_000_000


class RescuedMessage(NamedTuple):
    """Message for the repaired file."""

    channel: ChannelInfo
    log_time_ns: int
    data: bytes


@dataclass
class Losses:
    """Counts of recovered and lost data.

    Attributes:
        torn_places: places where the chain of records is broken.
        bytes_kept: link bytes recovered from torn places.
        bytes_dropped: bytes of torn places that belong to no frame.
        compressed_chunks: damaged compressed chunks, which are lost.
        topics_lost: damaged messages of decoded topics.
    """

    torn_places: int = 0
    bytes_kept: int = 0
    bytes_dropped: int = 0
    compressed_chunks: int = 0
    topics_lost: int = 0


class _FrameAt(NamedTuple):
    """Intact frame: hub, the hub's time, start and end in the bytes that contain it."""

    hub: int
    tick_us: int
    start: int
    end: int


class Stitcher:
    """Conversion of the pieces of a damaged file into messages."""

    def __init__(self, salvage: Salvage) -> None:
        """Prepare to stitch the pieces of `salvage`."""
        self.losses = Losses()
        self._salvage = salvage
        self._recent: dict[int, bytearray] = defaultdict(bytearray)
        self._adopt_undeclared_links()

    def messages(self) -> Iterator[RescuedMessage]:
        """Yield the messages of the repaired file in order.

        Bytes of torn places get the time of the next message: one that is too early would disturb the time base.
        """
        waiting: list[tuple[int, bytes]] = []
        time_ns = 0
        for piece in self._salvage.pieces():
            if isinstance(piece, CompleteMessage):
                time_ns = piece.message.log_time_ns
                for link, data in waiting:
                    yield RescuedMessage(self._salvage.channels[link], time_ns, data)
                message = self._complete(piece)
                if message is not None:
                    yield message
                    waiting = []
                else:
                    waiting = self._divided(bytes(piece.message.data), None) if self._is_lost_link(piece) else []
                continue
            self.losses.torn_places += 1
            if piece.compressed:
                self.losses.compressed_chunks += 1
                self.losses.bytes_dropped += len(piece.data)
            else:
                waiting += self._torn(piece)
        for link, data in waiting:
            yield RescuedMessage(self._salvage.channels[link], time_ns, data)

    def _complete(self, piece: CompleteMessage) -> RescuedMessage | None:
        """Return a complete message, None where its channel or its content is damaged."""
        number, _, time_ns, _, view = piece.message
        if piece.verified:
            self._adopt(piece)
        info = self._salvage.channels.get(number)
        data = bytes(view)
        if info is not None and info.encoding == RAW_ENCODING:
            self._remember(number, data)
        elif info is None or not (piece.verified or _is_json(data)):
            self.losses.topics_lost += info is not None or _is_json(data)
            return None
        return RescuedMessage(info, time_ns, data)

    def _is_lost_link(self, piece: CompleteMessage) -> bool:
        """Return whether a message is link bytes with a damaged channel number."""
        return piece.message.channel not in self._salvage.channels and not _is_json(bytes(piece.message.data))

    def _torn(self, piece: TornPlace) -> list[tuple[int, bytes]]:
        data = bytes(piece.data)
        info = self._salvage.channels.get(piece.head.channel) if piece.head is not None else None
        if piece.head is None or info is None:
            return self._divided(data, None)
        if info.encoding == RAW_ENCODING:
            # What follows a message of its full length may be the header of another record.
            return [
                *self._divided(data[: piece.stated], piece.head.channel),
                *self._divided(data[piece.stated :], None),
            ]
        self.losses.topics_lost += 1
        return self._divided(data[piece.stated :], None)

    def _divided(self, data: bytes, head: int | None) -> list[tuple[int, bytes]]:
        """Return the parts of a torn place by link.

        Args:
            data: bytes of the place.
            head: link of the message that starts here, None when unknown.
        """
        links = self._links()
        parts: list[tuple[int, bytearray]] = []
        end = 0
        ticks = {link: {frame.hub: frame.tick_us for frame in _frames_in(bytes(self._recent[link]))} for link in links}
        for frame in _frames_in(data):
            link = _link_of(frame, ticks, head)
            if link is None:
                end = frame.end
                continue
            ticks[link][frame.hub] = frame.tick_us
            if not parts and head not in (None, link):
                parts.append((head, bytearray(data[: frame.start])))
                end = frame.start
            if not parts or parts[-1][0] != link:
                parts.append((link, bytearray()))
            # The bytes before a frame may be the rest of one that an earlier message begins.
            parts[-1][1].extend(data[end : frame.end])
            end = frame.end
        last = parts[-1][0] if parts else head
        if last is None and len(links) == 1 and SYNC in data[end:]:
            # A frame that the next message ends; without the start of one, these are remains of another record.
            last, end = links[0], data.index(SYNC, end)
        if last is not None and end < len(data):
            if not parts:
                parts.append((last, bytearray()))
            parts[-1][1].extend(data[end:])
        for link, part in parts:
            self._remember(link, part)
        bytes_kept = sum(len(part) for _, part in parts)
        self.losses.bytes_kept += bytes_kept
        self.losses.bytes_dropped += len(data) - bytes_kept
        return [(link, bytes(part)) for link, part in parts]

    def _links(self) -> list[int]:
        return [number for number, info in self._salvage.channels.items() if info.encoding == RAW_ENCODING]

    def _remember(self, link: int, data: bytes | bytearray) -> None:
        recent = self._recent[link]
        recent += data
        if len(recent) > 2 * _RECENT_BYTES:
            del recent[:-_RECENT_BYTES]

    def _adopt_undeclared_links(self) -> None:
        """Find the links by their bytes, if all their declarations are lost."""
        if not self._links():
            for piece in self._salvage.pieces():
                if isinstance(piece, CompleteMessage) and self._adopt(piece):
                    return

    def _adopt(self, piece: CompleteMessage) -> bool:
        """Treat an undeclared channel as a link if its messages are not JSON."""
        number = piece.message.channel
        if number in self._salvage.channels or _is_json(bytes(piece.message.data)):
            return False
        declared = {info.link for info in self._salvage.channels.values() if info.encoding == RAW_ENCODING}
        events = [info.link for info in self._salvage.channels.values() if info.link and info.link not in declared]
        link = events[0] if len(events) == 1 else f"recovered-{number}"
        self._salvage.channels[number] = ChannelInfo(raw_topic(link), RAW_ENCODING, link)
        return True


def _link_of(frame: _FrameAt, ticks_us: dict[int, dict[int, int]], head: int | None) -> int | None:
    """Return the link of a frame, whose hub's clock it follows most closely; None where it follows none.

    Args:
        frame: of a torn place.
        ticks_us: latest time of each hub, by link.
        head: link of the message in which the frame stands, None when unknown.
    """
    ahead_us = {
        link: (frame.tick_us - hubs[frame.hub] + _MAX_TICKS_BACK_US) % _TICK_RANGE
        for link, hubs in ticks_us.items()
        if frame.hub in hubs
    }
    if not ahead_us:
        return head if head is not None else next(iter(ticks_us)) if len(ticks_us) == 1 else None
    link = min(ahead_us, key=lambda link: (abs(ahead_us[link] - _MAX_TICKS_BACK_US), link != head))
    # Where another link has sent nothing yet, the frame may be its first.
    limit_us = _MAX_TICKS_AHEAD_US if all(ticks_us.values()) else 2 * _MAX_TICKS_BACK_US
    return link if ahead_us[link] <= limit_us else None


def _frames_in(data: bytes) -> Iterator[_FrameAt]:
    """Yield the intact frames in `data`, which may contain bytes of several links and start and end anywhere."""
    position = 0
    while position < len(data):
        start, end, _ = next_frame(data, position)
        if end:
            hub, tick_us = _HEADER.unpack_from(data, start)
            yield _FrameAt(hub, tick_us, start, end)
        # A frame that does not fit may hide others that do.
        position = end or start + 1


def _is_json(data: bytes) -> bool:
    try:
        return len(data) <= _MAX_JSON_BYTES and isinstance(json.loads(data), dict)
    except (ValueError, RecursionError):
        return False
