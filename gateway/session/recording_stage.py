"""Recording in a thread of its own: it gets every chunk first, and a slow disk holds up nobody."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Final, NamedTuple, Protocol

from gateway.clock import Clock
from gateway.errors import RecordingError
from gateway.io.source import Chunk, LinkItem
from gateway.session.bounded_buffer import Buffer

# Four minutes of four wheels: a disk that is stuck for longer is told, and what does not fit is counted.
MOST_BYTES: Final = 64 << 20
MOST_ITEMS: Final = 1 << 19
# Decoded topics can be computed again from the raw bytes; they leave this share of the room to them.
_TOPICS_BELOW: Final = 0.5
_LOOK_S: Final = 0.02
_AT_ONCE: Final = 1024
_SYNC_EVERY_NS: Final = 1_000_000_000
# Ending a recording waits for the disk as long as something moves, and so long when nothing does.
_STUCK_S: Final = 10.0


class Recorder(Protocol):
    """What records: a `RecordingWriter`, or a stage before it."""

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
        """Let what was written reach the operating system."""
        ...

    def sync(self) -> None:
        """Let what was written reach the disk."""
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

    What holds: a chunk is in here before the decoder sees it, in the order of arrival; nothing that the decoder or an
    estimator does can lose it. While the disk keeps up it reaches the operating system within 0.12 s, where killing
    this process cannot lose it, and the disk within a second more. While the disk does not keep up, 64 MiB wait here;
    beyond that decoded topics are dropped first, raw bytes last, and both are counted.

    Attributes:
        topics_dropped: decoded topics that found no room.
    """

    def __init__(self, writer: Recorder, clock: Clock, on_failure: Callable[[BaseException], None]) -> None:
        """Start writing.

        Args:
            writer: does the writing; nobody else may use it from now on.
            clock: paces flushes while nothing arrives.
            on_failure: told of an error that is no fault of the disk.
        """
        self.topics_dropped = 0
        self._writer = writer
        self._clock = clock
        self._on_failure = on_failure
        self._waiting: Buffer[LinkItem | _Topic] = Buffer(MOST_ITEMS, MOST_BYTES)
        self._ending = threading.Event()
        self._written = 0
        self._fault: RecordingError | None = None
        self._told = False
        self._thread = threading.Thread(target=self._run, name="recording", daemon=True)
        self._thread.start()

    @property
    def path(self) -> Path:
        """The file."""
        return self._writer.path

    @property
    def size_bytes(self) -> int:
        """Size of the file so far, without what waits."""
        return self._writer.size_bytes

    @property
    def ending(self) -> bool:
        """Whether `close` was called and the file is not finished yet."""
        return self._ending.is_set() and self._thread.is_alive()

    def offer(self, item: LinkItem, *, timeout_s: float = 0.0) -> bool:
        """Take an item of a link; False when there is no room within `timeout_s`."""
        if self._fault is not None or self._ending.is_set():
            return True
        size = len(item.data) if isinstance(item, Chunk) else len(item.text)
        return self._waiting.put(item, size, timeout_s=timeout_s, wake=False)

    def write(self, item: LinkItem) -> None:
        """Take an item; one that finds no room is dropped.

        Raises:
            RecordingError: the disk refused earlier.
        """
        self._raise_fault()
        self.offer(item)

    def write_topic(self, topic: str, host_ns: int, payload: Mapping[str, Any]) -> None:
        """Take a decoded quantity; dropped and counted when half of the room is taken.

        Raises:
            RecordingError: the disk refused earlier.
        """
        self._raise_fault()
        entry = _Topic(topic, host_ns, payload)
        if not self._waiting.put(entry, 32 * len(payload), below=_TOPICS_BELOW, wake=False):
            self.topics_dropped += 1

    def tick(self, now_ns: int) -> None:
        """Tell whether the disk still takes what comes; flushing goes by itself.

        Raises:
            RecordingError: it does not.
        """
        del now_ns
        self._raise_fault()

    def sync(self) -> None:
        """Nothing to do: syncing goes by itself."""

    def close(self) -> None:
        """Write what waits and finish the file; waits for the disk as long as it takes something.

        Raises:
            RecordingError: the disk refused, or takes nothing any more.
        """
        self._ending.set()
        progress = -1
        while self._thread.is_alive() and progress != self._written:
            progress = self._written
            self._thread.join(_STUCK_S)
        if self._thread.is_alive():
            raise RecordingError(
                f"the disk of '{self.path}' has taken nothing for {_STUCK_S:g} s; {len(self._waiting)} items are lost",
                "What was written before stays readable; check the disk or the network behind it.",
            )
        self._raise_fault()

    def _raise_fault(self) -> None:
        if self._fault is not None and not self._told:
            self._told = True
            raise self._fault

    def _run(self) -> None:
        try:
            self._write_until_the_end()
        except RecordingError as error:
            self._fault = error
            self._finish_what_is_left()
        except BaseException as error:  # handed on: a fault of our own must end the session, not the recording alone
            self._fault = RecordingError(f"recording '{self.path}' stopped by an internal error: {error!r}")
            self._told = True
            self._finish_what_is_left()
            self._on_failure(error)

    def _write_until_the_end(self) -> None:
        sync_due_ns = self._clock.now_ns() + _SYNC_EVERY_NS
        while True:
            ending = self._ending.is_set()
            all_written = self._write_some()
            now_ns = self._clock.now_ns()
            self._writer.tick(now_ns)
            if now_ns >= sync_due_ns:
                self._writer.sync()
                sync_due_ns = now_ns + _SYNC_EVERY_NS
            if all_written:
                if ending:
                    break
                self._ending.wait(_LOOK_S)
        self._writer.close()

    def _write_some(self) -> bool:
        """Write what waits, or a good deal of it; return whether all of it was written."""
        for _ in range(_AT_ONCE):
            entry = self._waiting.get()
            if entry is None:
                return True
            if isinstance(entry, _Topic):
                self._writer.write_topic(*entry)
            else:
                self._writer.write(entry)
            self._written += 1
        return False

    def _finish_what_is_left(self) -> None:
        """Close the file as it is, and give the memory back."""
        with suppress(RecordingError):  # the first failure is the one the user needs
            self._writer.close()
        while self._waiting.get() is not None:
            pass
