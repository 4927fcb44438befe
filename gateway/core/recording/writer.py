"""Writer of recordings: link items as they arrive, before they are decoded."""

import json
import logging
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

from gateway import __version__
from gateway.core.errors import RecordingError
from gateway.core.links.source import Chunk, LinkEvent, LinkEventKind, LinkItem, VehicleData
from gateway.core.recording.container import McapOutput
from gateway.core.recording.mcap_layout import (
    COMPUTER_TOPIC,
    FORMAT_VERSION,
    JSON_ENCODING,
    MARKS_TOPIC,
    SESSION_METADATA,
    ChannelInfo,
    data_channel,
    dbc_metadata,
    encode_json,
    event_payload,
    event_topic,
    seal,
)
from gateway.core.recording.run_description import RunDescription
from gateway.core.recording.schemas import TopicSchema, schema_of

FLUSH_INTERVAL_NS: Final = 100_000_000

_logger = logging.getLogger(__name__)
# Of events that concern no link in particular.
_TOPICS: Final = {LinkEventKind.MARK: MARKS_TOPIC, LinkEventKind.COMPUTER: COMPUTER_TOPIC}


class _Pace:
    """Flush interval in one time base; items and the clock have different ones."""

    def __init__(self, start_ns: int) -> None:
        self._latest_ns = start_ns
        self._flushed_ns = start_ns

    def due(self, now_ns: int) -> bool:
        """Return whether the flush interval has passed since the last flush."""
        self._latest_ns = now_ns
        # The clocks of links never differ by a second; a larger step back is a new time base.
        return not -1_000_000_000 < now_ns - self._flushed_ns < FLUSH_INTERVAL_NS

    def flushed(self) -> None:
        """Note a flush after the latest time seen."""
        self._flushed_ns = self._latest_ns


class RecordingWriter:
    """Writer of a recording, safe to use from several threads.

    Data is flushed to the operating system when 0.1 s of the items' own time has passed since the last flush; `tick`
    does the same by the clock when nothing arrives. Items may run ahead of or behind the clock, for example in a
    simulation faster than real time. If both shared one mark, every item and every tick would end a chunk.

    Attributes:
        items: number of link items written.
    """

    def __init__(
        self,
        path: Path | str,
        *,
        start_ns: int,
        vehicle_toml: str | None = None,
        sources: Sequence[str] = (),
        dbc_text: str | None = None,
        run: RunDescription | None = None,
        in_part: bool = False,
    ) -> None:
        """Create the file.

        Args:
            path: a new file, or a folder for a file named after the start time.
            start_ns: start of the session, ns since the epoch.
            vehicle_toml: text of the vehicle configuration.
            sources: URIs of the sources, for information.
            dbc_text: DBC file of the vehicle bus.
            run: description of the test run.
            in_part: write to `NAME.part` until `publish`, for `whole_recording`.

        Raises:
            RecordingError: the file exists, or cannot be created.
        """
        self.items = 0
        self._lock = threading.Lock()
        self._output = McapOutput(_choose_path(Path(path), start_ns), in_part=in_part)
        self._raw_channels: dict[str, int] = {}
        self._topic_channels: dict[str, tuple[int, TopicSchema]] = {}
        self._item_pace, self._clock_pace = _Pace(start_ns), _Pace(start_ns)
        self._session = {
            "format": FORMAT_VERSION,
            "treadlink": __version__,
            "start_ns": str(start_ns),
            "started": utc_text(start_ns),
            "sources": json.dumps(list(sources)),
        }
        if vehicle_toml is not None:
            self._session["vehicle_toml"] = vehicle_toml
        if dbc_text is not None:
            self._session |= dbc_metadata(dbc_text)
        if run:
            self._session["run"] = run.to_json()
        self._session = seal(self._session)
        try:
            self._output.add_metadata(SESSION_METADATA, self._session)
            self._output.flush()
        except BaseException:  # a signal too; a file without content helps nobody
            self._output.abandon()
            raise
        _logger.info("recording to %s", self.path)

    @property
    def path(self) -> Path:
        """Path of the file."""
        return self._output.path

    @property
    def size_bytes(self) -> int:
        """Size so far, without the current chunk of up to 0.1 s."""
        return self._output.size_bytes

    def write(self, item: LinkItem) -> None:
        """Record what a link has brought, an event or a mark.

        Raises:
            RecordingError: the disk is full or gone; the written part stays readable.
        """
        with self._lock:
            self.items += 1
            if not isinstance(item, LinkEvent):
                channel = self._raw_channels.get(item.link)
                if channel is None:
                    channel = self._register_raw(item)
                self._output.add_message(channel, item.host_ns, item.data)
            else:
                topic = _TOPICS.get(item.kind) or event_topic(item.link)
                link = item.link if item.is_of_link else ""
                self._add_json(topic, item.host_ns, event_payload(item), link)
            self._flush_when_due(self._item_pace, item.host_ns)

    def write_topic(self, topic: str, host_ns: int, payload: Mapping[str, Any]) -> None:
        """Record a decoded quantity; topics and fields as in `schemas`.

        Raises:
            RecordingError: the disk is full or gone.
            ValueError: an unknown topic, or a required field is missing.
        """
        with self._lock:
            # Decoded values may lag far behind the items, so their time causes no flush; the next item or `tick` does.
            self._add_json(topic, host_ns, payload)

    def tick(self, now_ns: int) -> None:
        """Flush if 0.1 s has passed since the last flush; does nothing after `close`.

        Raises:
            RecordingError: the disk is full or gone.
        """
        with self._lock:
            if not self._output.closed:
                self._flush_when_due(self._clock_pace, now_ns)

    def sync(self) -> None:
        """Write all data through to the disk, which may take long.

        Raises:
            RecordingError: the disk is full or gone.
        """
        with self._lock:
            if not self._output.closed:
                self._output.sync()

    def close(self) -> None:
        """Finish the file; may be called twice.

        Raises:
            RecordingError: the disk is full or gone.
        """
        with self._lock:
            if self._output.closed:
                return
            if not self._output.failed:
                # Repeated at the end, so that a damaged start does not lose the configuration.
                self._output.add_metadata(SESSION_METADATA, self._session)
            self._output.close()
            _logger.info("closed %s: %d bytes", self.path, self._output.size_bytes)

    def publish(self) -> None:
        """Finish a file that was written in a part, and give it its name.

        Raises:
            RecordingError: the disk is full or gone, or another program created that name meanwhile.
        """
        self.close()
        self._output.publish()

    def discard(self) -> None:
        """Close and delete the incomplete file."""
        with self._lock:
            self._output.abandon()

    def _register_raw(self, item: Chunk | VehicleData) -> int:
        self._raw_channels[item.link] = number = self._output.register(data_channel(item))
        return number

    def _add_json(self, topic: str, host_ns: int, payload: Mapping[str, Any], link: str = "") -> None:
        registered = self._topic_channels.get(topic)
        if registered is None:
            schema = schema_of(topic)
            registered = (self._output.register(ChannelInfo(topic, JSON_ENCODING, link)), schema)
            self._topic_channels[topic] = registered
        number, schema = registered
        missing = [field for field in schema.required if field not in payload]
        if missing:
            raise ValueError(f"topic '{topic}' lacks {', '.join(missing)}")
        self._output.add_message(number, host_ns, encode_json(payload))

    def _flush_when_due(self, pace: _Pace, now_ns: int) -> None:
        if pace.due(now_ns):
            self._output.flush()
            self._item_pace.flushed()
            self._clock_pace.flushed()


@contextmanager
def whole_recording(writer: RecordingWriter) -> Iterator[RecordingWriter]:
    """Give a recording that is written in a part its name when it is complete, or discard it.

    For what can be made again from its source. A session records under the final name from the beginning.

    Raises:
        RecordingError: the disk is full or gone.
    """
    try:
        yield writer
        writer.publish()
    except BaseException:
        writer.discard()
        raise


def utc_text(ns: int) -> str:
    """Return ns since the epoch as ISO 8601 text."""
    return datetime.fromtimestamp(ns * 1e-9, UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")


def _choose_path(path: Path, start_ns: int) -> Path:
    if not path.is_dir():
        return path
    stem = datetime.fromtimestamp(start_ns * 1e-9, UTC).strftime("treadlink-%Y%m%dT%H%M%SZ")
    for number in range(1, 1000):
        candidate = path / (f"{stem}.mcap" if number == 1 else f"{stem}-{number}.mcap")
        if not candidate.exists():
            return candidate
    raise RecordingError(f"there is no free name for a recording in '{path}'", "Give a file name.")
