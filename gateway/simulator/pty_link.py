"""A pseudo-terminal that stands in for a hub's serial port."""

from __future__ import annotations

import contextlib
import os
import select
from collections import deque
from typing import Final

from gateway.errors import SourceError

BACKLOG_BYTES: Final = 1 << 16


class PtyPort:
    """The hub's end of a serial line: takes bytes whether or not somebody reads the other end.

    Like a real line it never waits: bytes that nobody reads are gone, and of a reader that is too slow whole chunks
    are lost once BACKLOG_BYTES wait for it.

    Attributes:
        path: of the other end, for a reader to open.
        sent: bytes that a reader was given.
        unread: bytes that went nowhere because no reader was there.
        dropped: bytes of chunks that a slow reader missed.
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
        # Opened and closed once: from now on the system tells whether a reader holds the other end.
        os.close(slave)
        os.set_blocking(self._master, False)
        self._poll = select.poll()
        self._poll.register(self._master, select.POLLIN)
        self._waiting: deque[bytes] = deque()
        self._waiting_bytes = 0
        self.sent = self.unread = self.dropped = 0

    @property
    def connected(self) -> bool:
        """Whether somebody holds the other end open."""
        return not any(event & select.POLLHUP for _, event in self._poll.poll(0))

    def write(self, data: bytes) -> None:
        """Hand a chunk to the reader, as far as it takes it now; the rest waits for the next call."""
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
        """Hand over as much of what waits as the reader takes now."""
        self._drain_input()
        while self._waiting:
            try:
                written = os.write(self._master, self._waiting[0])
            except OSError:
                # Full (the reader is slow) or hung up just now (told by the next poll).
                return
            self.sent += written
            self._waiting_bytes -= written
            left = self._waiting.popleft()[written:]
            if left:
                self._waiting.appendleft(left)

    def close(self) -> None:
        """Take the line away; a reader sees it vanish. May be called twice."""
        if self._master >= 0:
            os.close(self._master)
            self._master = -1

    def _drain_input(self) -> None:
        """Throw away what the reader sends, as a hub without commands does."""
        with contextlib.suppress(OSError):
            while os.read(self._master, 4096):
                pass
