"""Reassembly of the links' streams from torn places, so that every undamaged frame passes its checksum.

A torn place contains the rest of a message, possibly the rest of a damaged record header, and possibly the end of a
later message whose header is lost. The rest of a header must not stay between two halves of a frame. The right cut is
the one at which the frame across it passes its checksum.
"""

import json
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, NamedTuple

from gateway.core.recording.mcap_layout import RAW_ENCODING, ChannelInfo, raw_topic
from gateway.upkeep.evidence import (
    REACH,
    LinkHistory,
    Span,
    completes,
    continuation,
    divide,
    ending,
    frames_in,
    intact,
    ticks_in,
    unfinished,
    without_foreign_frames,
)
from gateway.upkeep.salvage import CompleteMessage, IndexedMessage, Salvage, TornPlace

_MAX_JSON_BYTES: Final = 1 << 20
_MAX_PIECES_AHEAD: Final = 4096
# Enough for the rest of a frame and a complete one, which has the hub's time.
_AHEAD_BYTES: Final = 2 * REACH


class Rescued(NamedTuple):
    """Message for the repaired file."""

    channel: ChannelInfo
    log_time_ns: int
    data: bytes


@dataclass
class Losses:
    """Counts of recovered and lost data.

    Attributes:
        torn_places: places where the chain of records is broken.
        unverified: messages outside a chunk with a correct checksum; their bytes are kept unchanged.
        bytes_kept: link bytes recovered from torn places.
        bytes_dropped: bytes of torn places that belong to no frame.
        compressed_chunks: damaged compressed chunks, which are lost.
        topics_lost: damaged messages of decoded topics.
    """

    torn_places: int = 0
    unverified: int = 0
    bytes_kept: int = 0
    bytes_dropped: int = 0
    compressed_chunks: int = 0
    topics_lost: int = 0


class _Ahead(NamedTuple):
    """Data after a torn place.

    Attributes:
        streams: the next bytes of each link.
        time_ns: time of the next message.
        sequences: sequence number of the next message of each link that has one.
        before: the message that ended right before it, None when unknown.
    """

    streams: dict[int, bytes]
    time_ns: int
    sequences: dict[int, int]
    before: IndexedMessage | None


class Stitcher:
    """Conversion of pieces into messages, with torn places resolved by the streams before and after."""

    def __init__(self, salvage: Salvage) -> None:
        """Prepare to stitch the pieces of `salvage`."""
        self.losses = Losses()
        self._salvage = salvage
        self._history: dict[int, LinkHistory] = defaultdict(LinkHistory)
        self._times_ns: dict[int, int] = {}
        self._sequences: dict[int, int] = {}
        self._adopt_undeclared_links()

    def messages(self) -> Iterator[Rescued]:
        """Yield the messages of the repaired file in order."""
        for piece in self._salvage.pieces():
            if isinstance(piece, CompleteMessage):
                yield from self._whole(piece)
                continue
            self.losses.torn_places += 1
            if piece.compressed:
                self.losses.compressed_chunks += 1
                self.losses.bytes_dropped += len(piece.data)
            else:
                ahead = self._look_ahead(piece.end)
                rescued = list(self._torn(piece, ahead))
                yield from rescued
                if len(self._links()) > 1:
                    yield from self._strays(bytes(piece.data), rescued, ahead)

    def _whole(self, piece: CompleteMessage) -> Iterator[Rescued]:
        number, sequence, time_ns, _, view = piece.message
        if piece.verified:
            self._adopt(piece)
        info = self._salvage.channels.get(number)
        data = bytes(view)
        self.losses.unverified += not piece.verified
        if info is not None and info.encoding == RAW_ENCODING:
            self._times_ns[number] = time_ns
            self._sequences[number] = sequence
            yield self._link_bytes(number, time_ns, data)
        elif info is not None and (piece.verified or _is_json(data)):
            self._times_ns[number] = time_ns
            yield Rescued(info, time_ns, data)
        elif info is not None or _is_json(data):
            self.losses.topics_lost += 1
        else:
            # Link bytes with a damaged channel number.
            yield from self._positioned(data, self._look_ahead(piece.end))

    def _torn(self, piece: TornPlace, ahead: _Ahead) -> Iterator[Rescued]:
        data = bytes(piece.data)
        info = self._salvage.channels.get(piece.head.channel) if piece.head is not None else None
        if piece.head is None or info is None:
            yield from self._positioned(data, ahead)
            return
        complete = piece.stated <= len(data)
        if info.encoding != RAW_ENCODING:
            if complete and _is_json(data[: piece.stated]):
                yield Rescued(info, piece.head.log_time_ns, data[: piece.stated])
                data = data[piece.stated :]
            else:
                self.losses.topics_lost += 1
            yield from self._positioned(data, ahead)
            return
        number = piece.head.channel
        self._sequences[number] = piece.head.sequence
        self._times_ns[number] = piece.head.log_time_ns
        at_end = piece.end == self._salvage.size and not complete
        foreign = None if at_end else self._foreign(data, number, piece.stated, ahead)
        if foreign is not None:
            link, until, begin = foreign
            yield self._piece(number, ahead, data[: min(until, piece.stated)])
            yield self._piece(link, ahead, data[begin:])
        else:
            head = data[: piece.stated]
            parts = [head, *self._parts(number, head, data[piece.stated :], ahead)] if complete else [data]
            keep = ending(data, ahead.streams.get(number, b""))
            best, _ = self._best(number, [*parts, data, data[:keep], b""], ahead)
            self.losses.bytes_dropped += len(data) - len(best)
            if best:
                yield self._piece(number, ahead, best)

    def _foreign(self, data: bytes, number: int, stated: int, ahead: _Ahead) -> tuple[int, int, int] | None:
        """Find the end of another link's message, whose header is lost, after the start of the message of `number`.

        Returns:
            The other link, the latest end of the part of `number`, and the earliest start of the other part.
        """
        others = [link for link in self._links_missing(ahead) if link != number]
        if not others:
            return None
        before = max(0, len(data) - ahead.before.max_bytes) if ahead.before is not None else 0
        runs = divide(frames_in(data), self._ticks_us([number, *others], ahead), number, (before, stated))
        for link in others:
            until = next((run.start for run in runs if run.link == link), len(data))
            pending, following = self._history[link].unfinished(), ahead.streams.get(link, b"")
            trim = continuation(pending, data, following, before, until)
            if trim is not None and trim < len(data):
                return link, trim, trim
        for run in runs:
            if run.link != number:
                return run.link, run.start, before
            before = max(before, run.end)
        for link in others:
            if completes(data[before:], ahead.streams.get(link, b"")):
                return link, len(data), before
        return None

    def _positioned(self, data: bytes, ahead: _Ahead) -> Iterator[Rescued]:
        """Assign bytes of unknown origin to the link of their frames, without the rest of a header."""
        links = self._links_missing(ahead)
        runs = divide(frames_in(data), self._ticks_us(links, ahead)) if len(links) > 1 else []
        if len({run.link for run in runs}) > 1:
            for index, run in enumerate(runs):
                begin = runs[index - 1].end if index else 0
                until = runs[index + 1].start if index + 1 < len(runs) else len(data)
                yield self._piece(run.link, ahead, data[begin:until])
            return
        candidates = [
            (gain, link, part)
            for link in ([runs[0].link] if runs else links)
            for part, gain in [self._best(link, [b"", *self._parts(link, b"", data, ahead)], ahead)]
        ]
        gain, link, part = max(candidates, default=(0, 0, b""), key=lambda entry: entry[0])
        self.losses.bytes_dropped += len(data) - len(part) if gain else len(data)
        if gain:
            yield self._piece(link, ahead, part)

    def _parts(self, link: int, head: bytes, rest: bytes, ahead: _Ahead) -> list[bytes]:
        """Return the candidates for a link's part, when `rest` after `head` may contain bytes of no stream."""
        following = ahead.streams.get(link, b"")
        keep = ending(rest, following)
        parts = [head + rest[:keep], head + rest]
        first = next((frame.start for frame in frames_in(rest)), len(rest))
        trim = continuation(unfinished(self._history[link].tail() + head), rest, following, 0, first)
        if trim is not None:
            parts += [head + rest[trim:], head + rest[trim : max(trim, keep)]]
        return parts

    def _best(self, link: int, parts: list[bytes], ahead: _Ahead) -> tuple[bytes, int]:
        """Return the part with which most frames of a link pass, the first of equal ones, and the number it adds."""
        before, behind = self._history[link].tail(), ahead.streams.get(link, b"")[:REACH]
        passing = [intact(before + part + behind) for part in parts]
        most = max(passing)
        return parts[passing.index(most)], most - intact(before + behind)

    def _ticks_us(self, links: list[int], ahead: _Ahead) -> dict[int, dict[int, int]]:
        """Return the times of each link's hubs before the place, or after it if there are none before."""
        return {link: {**ticks_in(ahead.streams.get(link, b"")), **self._history[link].ticks_us()} for link in links}

    def _look_ahead(self, position: int) -> _Ahead:
        """Read until every link has enough bytes, or the limit of pieces is reached."""
        streams: dict[int, bytes] = dict.fromkeys(self._links(), b"")
        sequences: dict[int, int] = {}
        first_sequences: dict[int, int] = {}
        time_ns: int | None = None
        certain = dict.fromkeys(streams, True)
        for count, piece in enumerate(self._salvage.pieces(position, self._times_ns)):
            if count > _MAX_PIECES_AHEAD or all(len(stream) >= _AHEAD_BYTES for stream in streams.values()):
                break
            message, data = (
                (piece.head, piece.data) if isinstance(piece, TornPlace) else (piece.message, piece.message.data)
            )
            if message is None:
                continue
            if time_ns is None:
                time_ns = message.log_time_ns
            link = message.channel
            if link in streams:
                # Bytes after a missing message cannot belong to a frame before it.
                certain[link] &= message.sequence == sequences.get(link, message.sequence - 1) + 1
                first_sequences.setdefault(link, message.sequence)
                sequences[link] = message.sequence
                if certain[link]:
                    streams[link] += bytes(data[: piece.stated] if isinstance(piece, TornPlace) else data)
                certain[link] &= not isinstance(piece, TornPlace) or len(piece.data) >= piece.stated
        if time_ns is None:
            time_ns = max(self._times_ns.values(), default=0)
        # An unknown arrival must not be stated too early, which would disturb the time base.
        return _Ahead(streams, time_ns, first_sequences, self._salvage.message_before(position, self._times_ns))

    def _links(self) -> list[int]:
        return [number for number, info in self._salvage.channels.items() if info.encoding == RAW_ENCODING]

    def _links_missing(self, ahead: _Ahead) -> list[int]:
        """Return the links that may have a message without header here."""
        links = self._links()
        after = ahead.sequences
        # With consecutive numbers, none is missing.
        missing = [link for link in links if link not in after or after[link] != self._sequences.get(link, -1) + 1]
        if ahead.before is None:
            return missing
        channel = ahead.before.channel
        is_accounted = self._times_ns.get(channel) == ahead.before.time_ns and channel not in missing
        return [channel] if channel in links and not is_accounted else []

    def _piece(self, number: int, ahead: _Ahead, data: bytes) -> Rescued:
        link_data = without_foreign_frames(data, self._span(number, ahead))
        self.losses.bytes_kept += len(link_data)
        self.losses.bytes_dropped += len(data) - len(link_data)
        return self._link_bytes(number, ahead.time_ns, link_data)

    def _span(self, link: int, ahead: _Ahead) -> Span:
        return Span(self._history[link].ticks_us(), ticks_in(ahead.streams.get(link, b"")))

    def _strays(self, data: bytes, rescued: list[Rescued], ahead: _Ahead) -> Iterator[Rescued]:
        """Yield frames that fit one link but were not assigned, as one place may contain parts of several messages."""
        for frame in frames_in(data):
            whole = data[frame.start : frame.end]
            fitting = [link for link in self._links() if self._span(link, ahead).admits(frame)]
            if len(fitting) == 1 and not any(whole in message.data for message in rescued):
                self.losses.bytes_dropped -= len(whole)
                yield self._piece(fitting[0], ahead, whole)

    def _link_bytes(self, number: int, time_ns: int, data: bytes) -> Rescued:
        self._history[number].append(data)
        return Rescued(self._salvage.channels[number], time_ns, data)

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


def _is_json(data: bytes) -> bool:
    try:
        return len(data) <= _MAX_JSON_BYTES and isinstance(json.loads(data), dict)
    except (ValueError, RecursionError):
        return False
