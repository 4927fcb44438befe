"""A pseudo-terminal in place of a hub's serial port."""

import contextlib
import os
import select
from collections import deque
from typing import Final

from gateway.core.errors import SourceError

BACKLOG_BYTES: Final = 1 << 16


class PtyPort:
    """The hub's end of a serial line. It accepts bytes whether or not a reader is connected.

    Like a real line it never waits. Bytes without a reader are lost. A reader that is too slow loses whole chunks once
    BACKLOG_BYTES are waiting.

    Attributes:
        path: of the other end, for a reader to open.
        sent: bytes delivered to a reader.
        unread: bytes discarded because there was no reader.
        dropped: bytes of chunks lost to a slow reader.
    """

    def __init__(self) -> None:
        """Open a pseudo-terminal.

        Raises:
            SourceError: this system has none.
        """
        if not hasattr(os, "openpty"):
            raise SourceError("this system has no pseudo-terminals", "Use --out, or `treadlink live sim:...`.")
        import tty

        self._master, slave = os.openpty()
        self.path = os.ttyname(slave)
        tty.setraw(slave)
        # Opened and closed once, so that the system reports whether a reader holds the other end.
        os.close(slave)
        os.set_blocking(self._master, False)
        self._poll = select.poll()
        self._poll.register(self._master, select.POLLIN)
        self._waiting: deque[bytes] = deque()
        self._waiting_bytes = 0
        self.sent = self.unread = self.dropped = 0

    @property
    def connected(self) -> bool:
        """Whether a reader holds the other end open."""
        return not any(event & select.POLLHUP for _, event in self._poll.poll(0))

    @property
    def is_waiting(self) -> bool:
        """Whether bytes wait for the reader."""
        return bool(self._waiting)

    def write(self, data: bytes) -> None:
        """Hand a chunk to the reader, as much as it accepts now; the rest waits for the next call."""
        if not self.connected:
            self.unread += len(data) + self._waiting_bytes
            self._waiting.clear()
            self._waiting_bytes = 0
            return
        if self._waiting_bytes + len(data) > BACKLOG_BYTES:
            self.dropped += len(data)
        else:
            self._waiting.append(data)
            self._waiting_bytes += len(data)
        self.flush()

    def flush(self) -> None:
        """Hand over as many waiting bytes as the reader accepts now."""
        self._drain_input()
        while self._waiting:
            try:
                written = os.write(self._master, self._waiting[0])
            except OSError:
                # Full (the reader is slow) or just disconnected (the next poll reports it).
                return
            self.sent += written
            self._waiting_bytes -= written
            unsent = self._waiting.popleft()[written:]
            if unsent:
                self._waiting.appendleft(unsent)

    def close(self) -> None:
        """Close the line; the reader sees it disappear. May be called twice."""
        if self._master >= 0:
            os.close(self._master)
            self._master = -1

    def _drain_input(self) -> None:
        """Discard bytes from the reader, as a hub without commands does."""
        with contextlib.suppress(OSError):
            while os.read(self._master, 4096):
                pass
