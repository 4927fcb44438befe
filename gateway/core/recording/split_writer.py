"""Recording in several files, one after the other: each can be read alone, and no data is in two of them."""

import logging
import os
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Final, NamedTuple

from firmware_protocol import wire
from firmware_protocol.messages import MessageType
from gateway.core.errors import RecordingError
from gateway.core.links.source import Chunk, LinkEvent, LinkItem
from gateway.core.recording.writer import RecordingWriter

# Hubs repeat HELLO every 2 s. A link without one in this time goes on in the new file at its next chunk.
_HANDOVER_NS: Final = 5_000_000_000
# Those of a hub's wheels follow each other; the first of them is where a file begins.
_SAME_HELLOS_NS: Final = 500_000_000
_HELLO_START: Final = wire.SYNC + bytes((wire.VERSION_BYTE, MessageType.HELLO))
# Time after which a file that could not be opened is tried again.
_RETRY_NS: Final = 5_000_000_000
# Descriptors that opening a file needs: the file, its folder, and the lock beside it.
_RESERVED: Final = 4
_logger = logging.getLogger(__name__)


class Split(NamedTuple):
    """Where a recording goes on in a new file.

    Attributes:
        size_bytes: size of a file, None for any.
        duration_ns: time of its data, None for any.
        keep: number of files that are kept, two or more; None for all.
    """

    size_bytes: int | None = None
    duration_ns: int | None = None
    keep: int | None = None


class SplitWriter:
    """A `Recorder` that goes on in a new file at a size or after a time; used by one thread.

    A link goes on in the new file from its next HELLO on. So a frame is in one file as a whole, and each file contains
    what its samples need, but for up to 2 s of wheels whose HELLO does not follow at once. Decoded topics, marks and
    other events are in the new file as soon as it exists.

    Attributes:
        items: number of link items written to all files.
        parts: number of files so far.
        refusal: why the next file cannot be opened, empty where it can; the present one goes on until then.
    """

    def __init__(self, open_part: Callable[[Path, int], RecordingWriter], path: Path, start_ns: int, split: Split):
        """Create the first file.

        Args:
            open_part: creates a file, from its path or folder and its start in ns since the epoch.
            path: a new file, or a folder for files named after their start times.
            start_ns: start of the session, ns since the epoch.
            split: when to go on in a new file.

        Raises:
            RecordingError: the file cannot be created.
        """
        self._open_part = open_part
        self._target = path
        self._split = split
        self._begin_ns = start_ns
        self._current = open_part(path, start_ns)
        self._previous: RecordingWriter | None = None
        self._waiting_links: set[str] = set()
        self._links: set[str] = set()
        self._finished: deque[tuple[Path, int]] = deque()
        self._finished_bytes = self._largest_bytes = 0  # read by other threads
        # Begin of a possible HELLO at the end of a chunk, by link.
        self._pending: dict[str, bytes] = {}
        # First HELLO since the file began, by link; it need not be the first of several.
        self._hello_ns: dict[str, int] = {}
        self.items = 0
        self.parts = 1
        self.refusal = ""
        self._retry_ns = 0
        self._reserved: list[int] = []
        self._reserve()

    @property
    def path(self) -> Path:
        """Path of the present file."""
        return self._current.path

    @property
    def size_bytes(self) -> int:
        """Size of the files that are kept, without the current chunk."""
        previous = self._previous.size_bytes if self._previous is not None else 0
        return self._finished_bytes + previous + self._current.size_bytes

    def most_bytes(self) -> int | None:
        """Return the size that the kept files have together in the long run, None where it is not known."""
        keep, size = self._split.keep, self._split.size_bytes or self._largest_bytes
        return keep * size if keep is not None and size else None

    def write(self, item: LinkItem) -> None:
        """Record an item of a link.

        Raises:
            RecordingError: the disk is full or gone; the written part stays readable.
        """
        self.items += 1
        if isinstance(item, LinkEvent):
            self._current.write(item)
            return
        if not self._links:
            self._begin_ns = item.host_ns  # recorded data have times of their own
        self._links.add(item.link)
        if self._is_due(item.host_ns):
            self._begin_part(item.host_ns)
        previous = self._previous
        if previous is not None and item.link in self._waiting_links and isinstance(item, Chunk):
            self._write_divided(item, previous)
        else:
            self._waiting_links.discard(item.link)
            self._current.write(item)
        if not self._waiting_links or item.host_ns - self._begin_ns >= _HANDOVER_NS:
            self._end_previous()

    def _write_divided(self, chunk: Chunk, previous: RecordingWriter) -> None:
        """Write what comes before a HELLO to the previous file, and the rest to the new one."""
        data = self._pending.pop(chunk.link, b"") + chunk.data
        start = data.find(_HELLO_START)
        if start >= 0:
            first_ns = self._hello_ns.setdefault(chunk.link, chunk.host_ns)
            if max(first_ns - self._begin_ns, chunk.host_ns - first_ns) < _SAME_HELLOS_NS:
                start = -1
        if start < 0 and chunk.host_ns - self._begin_ns < _HANDOVER_NS:
            start = next(n for n in range(len(_HELLO_START) - 1, -1, -1) if data.endswith(_HELLO_START[:n]))
            self._pending[chunk.link] = data[len(data) - start :]
            before, after = data[: len(data) - start], b""
        else:
            self._waiting_links.discard(chunk.link)
            before, after = data[: max(start, 0)], data[max(start, 0) :]
        for writer, part in ((previous, before), (self._current, after)):
            if part:
                writer.write(Chunk(chunk.link, chunk.host_ns, part))

    def write_topic(self, topic: str, host_ns: int, payload: Mapping[str, Any]) -> None:
        """Record a decoded quantity.

        Raises:
            RecordingError: the disk is full or gone.
        """
        self._current.write_topic(topic, host_ns, payload)

    def tick(self, now_ns: int) -> None:
        """Flush to the operating system.

        Raises:
            RecordingError: the disk is full or gone.
        """
        for writer in self._writers():
            writer.tick(now_ns)

    def sync(self) -> None:
        """Flush to the disk.

        Raises:
            RecordingError: the disk is full or gone.
        """
        for writer in self._writers():
            writer.sync()

    def close(self) -> None:
        """Finish the files; may be called twice.

        Raises:
            RecordingError: the disk is full or gone.
        """
        try:
            self._end_previous()
        finally:
            self._current.close()
            self._free_reserved()

    def _reserve(self) -> None:
        """Hold descriptors for the next file: connections and other files may take all that the system gives."""
        with suppress(OSError):
            while len(self._reserved) < _RESERVED:
                self._reserved.append(os.open(os.devnull, os.O_RDONLY))

    def _free_reserved(self) -> None:
        while self._reserved:
            os.close(self._reserved.pop())

    def _writers(self) -> list[RecordingWriter]:
        return [writer for writer in (self._previous, self._current) if writer is not None]

    def _is_due(self, now_ns: int) -> bool:
        size, duration = self._split.size_bytes, self._split.duration_ns
        if self._previous is not None or (self.refusal and now_ns < self._retry_ns):
            return False
        return (size is not None and self._current.size_bytes >= size) or (
            duration is not None and now_ns - self._begin_ns >= duration
        )

    def _begin_part(self, now_ns: int) -> None:
        self._remove_old()
        target = self._target if self._target.is_dir() else self._next_name()
        self._free_reserved()
        try:
            writer = self._open_part(target, now_ns)
        except RecordingError as error:
            if not self.refusal:
                _logger.warning("the recording goes on in '%s': %s", self._current.path, error)
            self.refusal, self._retry_ns = str(error), now_ns + _RETRY_NS
            return
        finally:
            self._reserve()
        self.refusal = ""
        self._previous, self._current = self._current, writer
        self._begin_ns = now_ns
        self._waiting_links = set(self._links)
        self.parts += 1

    def _end_previous(self) -> None:
        previous, self._previous = self._previous, None
        if previous is not None:
            for link, data in self._pending.items():
                previous.write(Chunk(link, self._begin_ns, data))
            self._pending.clear()
            self._hello_ns.clear()
            previous.close()
            self._finished.append((previous.path, previous.size_bytes))
            self._finished_bytes += previous.size_bytes
            self._largest_bytes = max(self._largest_bytes, previous.size_bytes)

    def _remove_old(self) -> None:
        """Remove the oldest files, so that with the present and the next one no more than `keep` are left."""
        while self._split.keep is not None and self._finished and len(self._finished) + 2 > self._split.keep:
            path, size = self._finished.popleft()
            self._finished_bytes -= size
            try:
                path.unlink()
                _logger.info("removed %s", path)
            except OSError as error:  # moved to where it is safe, or the disk will say so when it is full
                _logger.warning("cannot remove the old recording %s: %s", path, error.strerror)

    def _next_name(self) -> Path:
        number = self.parts + 1
        while (path := self._target.with_name(f"{self._target.stem}-{number}{self._target.suffix}")).exists():
            number += 1
        return path
