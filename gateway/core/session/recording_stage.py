"""Recording in a thread of its own: it receives every chunk first, and a slow disk delays nothing else."""

import logging
import threading
from collections.abc import Mapping
from contextlib import suppress
from enum import StrEnum
from pathlib import Path
from typing import Any, Final, NamedTuple, Protocol

from gateway.core.clock import Clock
from gateway.core.errors import RecordingError
from gateway.core.estimates.results import DiskRoom
from gateway.core.links.source import LinkEvent, LinkItem
from gateway.core.recording.split_writer import SplitWriter
from gateway.core.session.bounded_buffer import Buffer
from gateway.core.session.disk_watch import DiskWatch

_logger = logging.getLogger(__name__)

# Four minutes of four wheels: a disk that hangs for longer is reported, and dropped items are counted.
MAX_BYTES: Final = 64 << 20
MAX_ITEMS: Final = 1 << 19
# Decoded topics can be computed again from the raw bytes, so they may fill this share of the buffer only.
_TOPICS_SHARE: Final = 0.5
_POLL_S: Final = 0.02
_ENTRIES_PER_ROUND: Final = 1024
_SYNC_INTERVAL_NS: Final = 1_000_000_000
# Closing a recording waits for the disk as long as it makes progress, and this long when it makes none.
_STUCK_S: Final = 10.0


class Stage(StrEnum):
    """Stages of a session that drop items when they fall behind."""

    RECORDING = "recording"
    TOPICS = "recorded topics"
    DECODING = "decoding"
    VIEW = "view"
    TIMES = "time out of range"


class Recorder(Protocol):
    """A `RecordingWriter`, or a stage before it."""

    @property
    def path(self) -> Path:
        """The file."""
        ...

    @property
    def size_bytes(self) -> int:
        """Its size so far."""
        ...

    def write(self, item: LinkItem) -> None:
        """Record a link item."""
        ...

    def write_topic(self, topic: str, host_ns: int, payload: Mapping[str, Any]) -> None:
        """Record a decoded quantity."""
        ...

    def tick(self, now_ns: int) -> None:
        """Flush to the operating system."""
        ...

    def sync(self) -> None:
        """Flush to the disk."""
        ...

    def close(self) -> None:
        """Finish the file."""
        ...


class _Topic(NamedTuple):
    topic: str
    host_ns: int
    payload: Mapping[str, Any]


class RecordingStage:
    """A recorder that writes in the background.

    Guarantee: a chunk is in here before the decoder sees it, in the order of arrival, so neither the decoder nor an
    estimator can lose it. While the disk keeps up, a chunk reaches the operating system within 0.12 s, where killing
    this process cannot lose it, and the disk within one second more. While the disk does not keep up, 64 MiB wait here;
    beyond that decoded topics are dropped first, raw bytes last, and both are counted.

    Attributes:
        topics_dropped: decoded topics dropped for lack of room.
        room: what is left of the disk, None where it is not known.
    """

    def __init__(self, writer: Recorder, clock: Clock, disk: DiskWatch | None = None) -> None:
        """Start writing.

        Args:
            writer: writes the file; used by this stage only from now on.
            clock: paces flushes while nothing arrives.
            disk: measures what is left of the disk; None for not at all.
        """
        self.topics_dropped = 0
        self.room: DiskRoom | None = None
        self._writer = writer
        self._disk = disk
        self._clock = clock
        self._waiting: Buffer[LinkItem | _Topic] = Buffer(MAX_ITEMS, MAX_BYTES)
        self._ending = threading.Event()
        self._written = 0
        self._fault: RecordingError | None = None
        self._is_reported = False
        self._thread = threading.Thread(target=self._run, name="recording", daemon=True)
        self._thread.start()
        _logger.info("recording to %s", writer.path)

    @property
    def path(self) -> Path:
        """The file."""
        return self._writer.path

    @property
    def size_bytes(self) -> int:
        """Size of the file so far, without waiting items."""
        return self._writer.size_bytes

    @property
    def is_writing(self) -> bool:
        """Whether it takes items: not closed, and not refused by the disk."""
        return self._fault is None and not self._ending.is_set()

    @property
    def ending(self) -> bool:
        """Whether `close` was called and the file is not finished yet."""
        return self._ending.is_set() and self._thread.is_alive()

    def offer(self, item: LinkItem, *, timeout_s: float = 0.0) -> bool:
        """Append an item of a link; return False when there is no room within `timeout_s`."""
        if self._fault is not None or self._ending.is_set():
            return True
        size = len(item.text) if isinstance(item, LinkEvent) else len(item.data)
        return self._waiting.put(item, size, timeout_s=timeout_s, wake=False)

    def write(self, item: LinkItem) -> None:
        """Append an item; it is dropped when there is no room.

        Raises:
            RecordingError: the disk refused earlier.
        """
        self._raise_fault()
        self.offer(item)

    def write_topic(self, topic: str, host_ns: int, payload: Mapping[str, Any]) -> None:
        """Append a decoded quantity; it is dropped and counted when the buffer is half full.

        Raises:
            RecordingError: the disk refused earlier.
        """
        self._raise_fault()
        entry = _Topic(topic, host_ns, payload)
        if not self._waiting.put(entry, 32 * len(payload), below=_TOPICS_SHARE, wake=False):
            self.topics_dropped += 1

    def tick(self, now_ns: int) -> None:
        """Check the disk; flushing needs no call.

        Raises:
            RecordingError: the disk refused earlier.
        """
        del now_ns
        self._raise_fault()

    def sync(self) -> None:
        """Do nothing: the stage syncs on its own."""

    def close(self) -> None:
        """Write waiting items and finish the file; wait for the disk as long as it makes progress.

        Raises:
            RecordingError: the disk refused, or makes no progress.
        """
        self._ending.set()
        progress = -1
        while self._thread.is_alive() and progress != self._written:
            progress = self._written
            self._thread.join(_STUCK_S)
        if self._thread.is_alive():
            raise RecordingError(
                f"the disk of '{self.path}' takes no data for {_STUCK_S:g} s; {len(self._waiting)} items are lost",
                "What was written before stays readable. Check the disk or its network connection.",
            )
        self._raise_fault()

    def _raise_fault(self) -> None:
        if self._fault is not None and not self._is_reported:
            self._is_reported = True
            raise self._fault

    def _run(self) -> None:
        try:
            self._write_until_the_end()
        except RecordingError as error:
            self._fault = error
            self._close_and_discard()
        except BaseException as error:  # a fault of our own ends the recording as one of the disk does
            _logger.debug("the recording failed", exc_info=error)
            self._fault = RecordingError(
                f"recording '{self.path}' stopped by an internal error, {error!r}; the part written before stays "
                "readable",
                "Please report it.",
            )
            self._close_and_discard()

    def _write_until_the_end(self) -> None:
        sync_due_ns = self._clock.now_ns()
        while True:
            ending = self._ending.is_set()
            is_due = self._clock.now_ns() >= sync_due_ns
            if is_due and self._disk is not None:
                # Before a slow disk holds this thread: a short session may end meanwhile.
                room = self._disk.room(self._clock.now_ns())
                refusal = self._writer.refusal if isinstance(self._writer, SplitWriter) else ""
                self.room = room._replace(refusal=refusal) if room is not None else None
            all_written = self._write_some()
            now_ns = self._clock.now_ns()
            self._writer.tick(now_ns)
            if is_due:
                self._writer.sync()
                sync_due_ns = now_ns + _SYNC_INTERVAL_NS
            if all_written:
                if ending:
                    break
                self._ending.wait(_POLL_S)
        self._writer.close()
        _logger.info("recording %s finished, %d entries, %d bytes", self.path, self._written, self.size_bytes)

    def _write_some(self) -> bool:
        """Write a number of waiting entries; return whether none is left."""
        for _ in range(_ENTRIES_PER_ROUND):
            entry = self._waiting.get()
            if entry is None:
                return True
            if isinstance(entry, _Topic):
                self._writer.write_topic(*entry)
            else:
                self._writer.write(entry)
            self._written += 1
        return False

    def _close_and_discard(self) -> None:
        """Close the file as it is, and free the memory of waiting entries."""
        with suppress(Exception):  # the user needs the first failure
            self._writer.close()
        while self._waiting.get() is not None:
            pass


def disk_watch_of(recorder: Recorder) -> DiskWatch:
    """Return the watch of the disk that a recording is written to."""
    most_bytes = recorder.most_bytes if isinstance(recorder, SplitWriter) else lambda: None
    return DiskWatch(recorder.path.parent, lambda: recorder.size_bytes, most_bytes)
