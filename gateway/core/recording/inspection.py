"""Content of a recording: links, wheels, rates, losses and a time line, from one pass."""

import json
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_protocol.block_decoder import FrameBatch
from firmware_protocol.counters import LinkCounters
from firmware_protocol.messages import Hello, LogText, Message, MessageType
from firmware_protocol.sample_numbers import is_jump
from firmware_protocol.sequence import COUNTER_MASK, unwrap
from firmware_protocol.wheel_limit import WheelLimit
from gateway.core.links.bus_frames import has_frames
from gateway.core.links.nmea_sentences import Fix, ReceiverClock, SentenceReader
from gateway.core.links.source import BusFrames, Chunk, LinkEvent, LinkEventKind, SensorLines
from gateway.core.reasons import Reason
from gateway.core.recording.decoder_blocks import DecodedLinks
from gateway.core.recording.mcap_layout import ALARMS_TOPIC, DATA_SCHEMAS, MAX_TIME_NS, RecordedMessage
from gateway.core.recording.reader import RecordingInfo, RecordingReader

_SECOND_NS: Final = 1_000_000_000
# Lines of a hub's log that are kept; they are for people to read.
_MOST_LOG_LINES: Final = 1000
MAX_EVENTS: Final = 10_000
"""Largest number of events that an inspection keeps."""
# A day; the time line of a longer recording shows the rest in its last second.
_MAX_SECONDS: Final = 86_400
# Latest gaps that late blocks can fill.
_MAX_GAPS: Final = 64


@dataclass(slots=True)
class WheelInspection:
    """Inspection of one source (hub, wheel) of a link.

    Attributes:
        frames: number of frames by type.
        hello: the last hello, None without one.
        boots: boot counts seen, in order.
        samples: number of received samples.
        samples_lost: samples missing by their numbers, without late ones; a restart loses none, a repeat fills none.
        measured_hz: sampling rate by the hub's clock, None with too few samples.
        seconds: host second -> [samples, samples lost].
    """

    frames: Counter[str] = field(default_factory=Counter)
    hello: Hello | None = None
    boots: list[int] = field(default_factory=list)
    samples: int = 0
    samples_lost: int = 0
    measured_hz: float | None = None
    seconds: dict[int, list[int]] = field(default_factory=dict)
    _next: int | None = None
    _first: tuple[int, int] | None = None
    _tick: int | None = None
    _gaps: list[tuple[int, int]] = field(default_factory=list)

    def restart(self, boot_count: int) -> None:
        """Note a boot; a new boot count resets the counters."""
        if not self.boots or self.boots[-1] != boot_count:
            self.boots.append(boot_count)
            self._count_anew()

    def _count_anew(self) -> None:
        self._next = self._first = self._tick = None
        self._gaps.clear()

    def _fill(self, first: int, end: int) -> int:
        """Return how many samples of a late block were missing."""
        missing = sum(gap_end - gap for gap, gap_end in self._gaps)
        pieces = [piece for gap in self._gaps for piece in ((gap[0], min(gap[1], first)), (max(gap[0], end), gap[1]))]
        self._gaps = [(begin, piece_end) for begin, piece_end in pieces if begin < piece_end]
        return missing - sum(gap_end - gap for gap, gap_end in self._gaps)

    def _jumps(self, number: int, tick_us: int) -> bool:
        """Return whether sample numbers and the hub's clock advance apart, so that no samples are missing."""
        if self._next is None or self._tick is None or self.hello is None:
            return False
        elapsed_us = unwrap(self._tick, tick_us) - self._tick
        return bool(is_jump(unwrap(self._next, number) - self._next, elapsed_us, self.hello.rate_hz))

    def add(self, number: int, n: int, tick_us: int, host_s: int) -> None:
        """Count a block of n samples, by the number and the hub time of its first one."""
        if self._jumps(number, tick_us):
            self._count_anew()
        expected = self._next
        first = number if expected is None else unwrap(expected, number)
        gap = 0 if expected is None else first - expected
        if host_s not in self.seconds and len(self.seconds) >= _MAX_SECONDS:
            host_s = next(reversed(self.seconds))
        second = self.seconds.setdefault(host_s, [0, 0])
        self.samples += n
        second[0] += n
        if gap < 0:
            self.samples_lost -= self._fill(first, first + n)
            return
        if gap:
            self.samples_lost += gap
            second[1] += gap
            self._gaps = [*self._gaps[1 - _MAX_GAPS :], (first - gap, first)]
        self._next = first + n
        # Ticks may have wrapped in the gap.
        gap_us = round(gap * 1e6 / self.hello.rate_hz) if self.hello is not None else 0
        self._tick = tick_us if self._tick is None else unwrap(self._tick + gap_us, tick_us)
        if self._first is None:
            self._first = (first, self._tick)
        elif self._tick - self._first[1] > 1_000_000 and first > self._first[0]:
            self.measured_hz = (first - self._first[0]) * 1e6 / (self._tick - self._first[1])


@dataclass(slots=True)
class AlarmSpan:
    """A time for which an alarm stood; times in ns since the epoch.

    Attributes:
        subject: wheel, link, hub or live output.
        name: kind of the alarm.
        text: its last reason.
        begin_ns: it was raised.
        acknowledged_ns: the user acknowledged it, None when not.
        end_ns: it was over, None when it stood at the end.
    """

    subject: str
    name: str
    text: str
    begin_ns: int
    acknowledged_ns: int | None = None
    end_ns: int | None = None


class LogLine(NamedTuple):
    """A line of a hub's log: its arrival, the number of the hub, and the message."""

    host_ns: int
    hub: int
    message: LogText


@dataclass(slots=True)
class ReceiverInspection:
    """What a positioning receiver sent.

    Attributes:
        reader: counts of its sentences.
        first: first fix with a position, None before one.
        last: last one.
        clock: compares its time with that of the recording.
    """

    reader: SentenceReader = field(default_factory=SentenceReader)
    first: Fix | None = None
    last: Fix | None = None
    clock: ReceiverClock = field(default_factory=ReceiverClock)

    def take(self, lines: bytes, host_ns: int) -> None:
        """Take lines that arrived at a time."""
        for fix in self.reader.read(lines):
            self.clock.take(fix, host_ns)
            if fix.has_position:
                self.first, self.last = self.first or fix, fix


@dataclass(slots=True)
class LinkInspection:
    """Inspection of one link of a recording.

    Attributes:
        chunks: number of chunks.
        bytes_received: number of link bytes.
        first_ns: arrival of the first chunk.
        last_ns: arrival of the last chunk.
        longest_silence_s: longest time between two chunks, or from the last one to the end of the recording. Chunks
            with errors of a vehicle bus only do not count.
        counters: counts of the decoder.
        wheels: inspection by (hub, wheel).
        limit: admission of wheels; others are counted only.
        log: the first lines of the hubs' logs.
        log_lines: number of all of them.
        bus_frames: frames of a vehicle bus.
        receiver: what a positioning receiver sent, None where the link has none.
        sensor_lines: lines of a receiver of tire pressure sensors.
    """

    chunks: int = 0
    bytes_received: int = 0
    first_ns: int = 0
    last_ns: int = 0
    longest_silence_s: float = 0.0
    counters: LinkCounters = field(default_factory=LinkCounters)
    wheels: dict[tuple[int, int], WheelInspection] = field(default_factory=dict)
    limit: WheelLimit = field(default_factory=WheelLimit)
    log: list[LogLine] = field(default_factory=list)
    log_lines: int = 0
    bus_frames: int = 0
    receiver: ReceiverInspection | None = None
    sensor_lines: int = 0

    def wheel(self, hub: int, wheel: int) -> WheelInspection:
        """Return the inspection of a source, created if it is new."""
        return self.wheels.setdefault((hub, wheel), WheelInspection())

    def take(self, hub: int, wheel: int, message: Message, host_ns: int) -> None:
        """Take a hello or a line of a hub's log."""
        if isinstance(message, Hello):
            for (source_hub, _), source in self.wheels.items():
                if source_hub == hub:
                    source.restart(message.boot_count)
            self.wheel(hub, wheel).hello = message
        elif isinstance(message, LogText):
            self.log_lines += 1
            if len(self.log) < _MOST_LOG_LINES:
                self.log.append(LogLine(host_ns, hub, message))


@dataclass(frozen=True, slots=True)
class Inspection:
    """Inspection of a recording.

    Attributes:
        info: description of the recording.
        links: inspection of each link, by name.
        events: the first link events and marks in order, at most MAX_EVENTS.
        events_omitted: number of further ones.
        topics: number of messages by decoded topic.
        damage: what was unreadable, None when everything was read.
        alarms: history of the alarms as the session raised them, the first MAX_EVENTS.
    """

    info: RecordingInfo
    links: dict[str, LinkInspection]
    events: tuple[LinkEvent, ...]
    events_omitted: int
    topics: dict[str, int]
    damage: Reason | None
    alarms: tuple[AlarmSpan, ...] = ()

    @property
    def span_ns(self) -> tuple[int, int]:
        """Arrival of the first and the last chunk of all links; (0, 0) without any."""
        active = [link for link in self.links.values() if link.chunks]
        if not active:
            return 0, 0
        return min(link.first_ns for link in active), max(link.last_ns for link in active)


def inspect_recording(
    path: Path,
    on_position: Callable[[int], None] | None = None,
    on_batch: Callable[[str, FrameBatch], None] | None = None,
) -> Inspection:
    """Read a recording in one pass.

    Args:
        path: the file.
        on_position: called with the number of bytes read so far, for a progress bar.
        on_batch: called with the link and a block of its frames.

    Raises:
        RecordingError: the file does not exist or is not a recording.
    """
    reader = RecordingReader(path)
    links: dict[str, LinkInspection] = {}
    decoded = DecodedLinks()
    events: list[LinkEvent] = []
    alarms = _AlarmHistory()
    topics: Counter[str] = Counter()
    omitted = end_ns = 0
    last_heard_ns: dict[str, int] = {}
    ended: set[str] = set()

    def count(batches: Iterator[tuple[str, FrameBatch, NDArray[np.int64]]]) -> None:
        for link, batch, arrivals_ns in batches:
            if on_batch is not None:
                on_batch(link, batch)
            _count(links[link], batch, arrivals_ns)

    for message in reader.messages():
        if on_position is not None:
            on_position(reader.position)
        if message.channel.encoding not in DATA_SCHEMAS:
            topics[message.channel.topic] += 1
        if message.channel.topic == ALARMS_TOPIC:
            alarms.take(message)
        # Topics and events go on while nothing arrives.
        end_ns = max(end_ns, min(message.log_time_ns, MAX_TIME_NS))
        for item in reader.link_items(message):
            if isinstance(item, LinkEvent):
                if item.kind is LinkEventKind.ENDED:
                    ended.add(item.link)
                elif item.kind.is_open:
                    ended.discard(item.link)
                if len(events) < MAX_EVENTS:
                    events.append(item)
                else:
                    omitted += 1
                continue
            link = links.setdefault(item.link, LinkInspection(first_ns=item.host_ns, last_ns=item.host_ns))
            link.chunks += 1
            link.bytes_received += len(item.data)
            link.last_ns = max(link.last_ns, item.host_ns)
            if not isinstance(item, BusFrames) or has_frames(item.data):
                heard_ns = last_heard_ns.get(item.link, item.host_ns)
                link.longest_silence_s = max(link.longest_silence_s, (item.host_ns - heard_ns) * 1e-9)
                last_heard_ns[item.link] = max(heard_ns, item.host_ns)
            if isinstance(item, BusFrames):
                link.bus_frames += item.count
                continue
            if isinstance(item, SensorLines):
                link.sensor_lines += item.count
                continue
            if not isinstance(item, Chunk):
                link.receiver = link.receiver or ReceiverInspection()
                link.receiver.take(item.data, item.host_ns)
                continue
            count(decoded.add(item))
    for name in last_heard_ns.keys() - ended:
        silence_s = (end_ns - last_heard_ns[name]) * 1e-9
        links[name].longest_silence_s = max(links[name].longest_silence_s, silence_s)
    count(decoded.finish())
    for name, counters in decoded.counters.items():
        links[name].counters = counters
    return Inspection(reader.info, links, tuple(events), omitted, dict(topics), reader.damage, tuple(alarms.spans))


class _AlarmHistory:
    """Spans of alarms from the topic of their changes; what is no change is left out."""

    def __init__(self) -> None:
        self.spans: list[AlarmSpan] = []
        self._standing: dict[tuple[str, str], AlarmSpan] = {}

    def take(self, message: RecordedMessage) -> None:
        """Take a message of the topic."""
        try:
            change = json.loads(message.data)
            key, state = (str(change["subject"]), str(change["name"])), change["state"]
        except (ValueError, TypeError, KeyError, RecursionError):
            return
        span = self._standing.get(key)
        if span is None:
            span = AlarmSpan(*key, "", message.log_time_ns)
            if state == "raised" and len(self.spans) < MAX_EVENTS:
                self.spans.append(span)
                self._standing[key] = span
        span.text = str(change.get("text", ""))
        if state == "acknowledged":
            span.acknowledged_ns = message.log_time_ns
        elif state == "over":
            span.end_ns = message.log_time_ns
            self._standing.pop(key, None)


def _count(link: LinkInspection, batch: FrameBatch, arrivals_ns: NDArray[np.int64]) -> None:
    for hub, number, places in batch.by_source():
        if link.limit.admits("", hub, number):
            types, counts = np.unique(batch.type[places], return_counts=True)
            names = (MessageType(type_).name.lower() for type_ in types.tolist())
            link.wheel(hub, number).frames.update(dict(zip(names, counts.tolist(), strict=True)))
    seconds = arrivals_ns // _SECOND_NS
    for stretch in batch.stretches(partial(link.limit.admits, "")):
        for run in stretch.runs:
            wheel, number = link.wheel(run.hub, run.wheel), run.first_sample
            for tick_us, second in zip(run.ticks_us, seconds[run.places].tolist(), strict=True):
                wheel.add(number & COUNTER_MASK, run.block, tick_us, second)
                number += run.block
        if stretch.last is not None:
            index, frame = stretch.last
            link.take(frame.hub, frame.wheel, frame.message, int(arrivals_ns[index]))
