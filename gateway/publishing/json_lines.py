"""Live output as JSON lines, to standard output, a file or a named pipe."""

from __future__ import annotations

import errno
import os
import select
import stat
import sys
import threading
from pathlib import Path
from typing import Final

from gateway.publishing.payloads import encoded, messages
from gateway.publishing.sink import (
    Item,
    PublishedState,
    Sink,
    SinkAddress,
    SinkDownError,
    SinkEndedError,
    SinkError,
    SinkSetting,
    missing_newline,
)

_WAIT_S: Final = 0.1
# A pipe that can be written takes this much without blocking.
_PIECE: Final = getattr(select, "PIPE_BUF", 512)
_YES_NO: Final = {"yes": True, "no": False}


def open_json_lines(address: SinkAddress, setting: SinkSetting) -> JsonLines:
    """Return the output of `jsonl:-` or `jsonl:PATH`, with the options `append` and `states` (yes or no).

    Raises:
        SinkError: the file exists and is not to be appended to, or its folder does not exist.
    """
    address.check_options({"append", "states"})
    append, states = (_yes_no(address, name) for name in ("append", "states"))
    if address.target == "-":
        return JsonLines(None, states=states)
    path = Path(address.target)
    if path.is_dir() or not path.parent.is_dir():
        raise SinkError(f"cannot publish to '{path}': not a file in an existing folder", "Create the folder first.")
    if path.is_file() and not append:
        raise SinkError(f"'{path}' exists", f"Give a new file, or add to it with 'jsonl:{path}?append=yes'.")
    return JsonLines(path, states=states)


class JsonLines(Sink):
    """Writes a line per revolution and alarm, with `states` also the state of wheels and links once a second.

    A line is begun only when the one before is complete, also after the receiver was away.
    """

    def __init__(self, path: Path | None, *, states: bool = False) -> None:
        """Prepare the output; a path of None is standard output."""
        self._path = path
        self._states = states
        self._file = -1
        self._is_pollable = False
        self._unwritten = b""
        self._item: Item | None = None

    def open(self, stop: threading.Event) -> None:
        """Open the file, or the pipe when it has a reader."""
        try:
            if self._path is None:
                self._file = os.dup(sys.stdout.fileno())
            else:
                flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT | getattr(os, "O_NONBLOCK", 0)
                self._file = os.open(self._path, flags, 0o666)
            mode = os.fstat(self._file).st_mode
            # Files and, on Windows, pipes cannot be waited for.
            self._is_pollable = not stat.S_ISREG(mode) and os.name == "posix"
            if self._item is None:
                self._unwritten = missing_newline(self._path) if self._path is not None and stat.S_ISREG(mode) else b""
        except OSError as error:
            no_reader = error.errno == errno.ENXIO
            raise SinkDownError("the pipe has no reader" if no_reader else error.strerror or str(error)) from error

    def send(self, item: Item, stop: threading.Event) -> None:
        """Write the lines of an item."""
        if isinstance(item, PublishedState) and not self._states:
            return
        if item is not self._item:
            lines = b"".join(encoded(message) + b"\n" for message in messages(item))
            # The rest of a line that an earlier receiver has begun to read is completed first.
            self._unwritten, self._item = self._unwritten + lines, item
        while self._unwritten:
            self._write(stop)
        self._item = None

    def poll(self) -> None:
        """Notice that the reader of a pipe has left."""
        if not self._is_pollable:
            return
        if any(event & select.POLLERR for _, event in self._polled(0, 0.0)):
            self._raise_disconnected()

    def close(self) -> None:
        """Close the file."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1

    def _write(self, stop: threading.Event) -> None:
        if stop.is_set():
            raise SinkDownError("the session has ended")
        try:
            if self._is_pollable and not self._polled(select.POLLOUT, _WAIT_S):
                return
            written = os.write(self._file, self._unwritten[:_PIECE] if self._is_pollable else self._unwritten)
        except BlockingIOError:
            return
        except BrokenPipeError:
            self._raise_disconnected()
        except OSError as error:
            raise SinkDownError(error.strerror or str(error)) from error
        else:
            self._unwritten = self._unwritten[written:]

    def _polled(self, events: int, timeout_s: float) -> list[tuple[int, int]]:
        poll = select.poll()
        poll.register(self._file, events)
        return poll.poll(timeout_s * 1e3)

    def _raise_disconnected(self) -> None:
        if self._path is None:
            raise SinkEndedError
        # A new reader begins with a whole line.
        self._unwritten, self._item = b"", None
        raise SinkDownError("the reader has left")


def _yes_no(address: SinkAddress, name: str) -> bool:
    value = address.options.get(name, "no")
    if value not in _YES_NO:
        raise SinkError(f"'{address.name}': {name}={value} is not allowed", "Give yes or no.")
    return _YES_NO[value]
