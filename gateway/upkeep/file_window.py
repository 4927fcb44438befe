"""Random access to the bytes of a file with bounded memory, without mapping it."""

import os
import re
import struct
from pathlib import Path
from typing import Any, BinaryIO, Final

from gateway.core.errors import RecordingError

WINDOW_BYTES: Final = 4 << 20
"""Bytes of the file that are in memory. A longer part is read on request, and belongs to the caller."""


class FileWindow:
    """Bytes of a file by position; its length is that at the start.

    A mapped file that another program cuts kills the process with SIGBUS, without a message. A read ends early.
    """

    def __init__(self, file: BinaryIO, path: Path) -> None:
        """Store the open file; `path` names it in messages."""
        self._file = file
        self._path = path
        self._size = os.fstat(file.fileno()).st_size
        self._start = 0
        self._window = memoryview(b"")

    def __len__(self) -> int:
        """Return the length of the file in bytes."""
        return self._size

    def part(self, first: int, end: int) -> memoryview:
        """Return the bytes from `first` to before `end`, or to the end of the file.

        Raises:
            RecordingError: the file became shorter, or cannot be read.
        """
        end = min(end, self._size)
        if first >= end:
            return memoryview(b"")
        if end - first > WINDOW_BYTES:
            return self._read(first, end)
        if not (self._start <= first and end <= self._start + len(self._window)):
            # Views of the old window stay valid: it is not written again.
            self._window = self._read(first, min(first + WINDOW_BYTES, self._size))
            self._start = first
        return self._window[first - self._start : end - self._start]

    def unpack(self, fields: struct.Struct, first: int) -> tuple[Any, ...]:
        """Return the fields at `first`, which must be in the file."""
        return fields.unpack(self.part(first, first + fields.size))

    def search(self, pattern: re.Pattern[bytes], pattern_bytes: int, first: int, end: int) -> int | None:
        """Return the first position from `first` of a match that ends up to `end`; None without one.

        Args:
            pattern: matches exactly `pattern_bytes` bytes.
            pattern_bytes: that number.
            first: position where the search begins.
            end: position where it ends.
        """
        end = min(end, self._size)
        while end - first >= pattern_bytes:
            remaining = self._start + len(self._window) - first
            # What the window already contains is searched first: most matches are near.
            length = remaining if self._start <= first and remaining >= pattern_bytes else WINDOW_BYTES
            view = self.part(first, min(first + length, end))
            match = pattern.search(view)
            if match is not None:
                return first + match.start()
            first += len(view) - pattern_bytes + 1
        return None

    def _read(self, first: int, end: int) -> memoryview:
        try:
            self._file.seek(first)
            data = self._file.read(end - first)
        except OSError as error:
            raise RecordingError(f"cannot read '{self._path}': {error.strerror}", "Check the disk.") from error
        if len(data) < end - first:
            raise RecordingError(
                f"'{self._path}' became shorter while it was read",
                "Another program changes it. Try again when that has ended.",
            )
        return memoryview(data)
