"""Identity of recordings by content."""

import hashlib
import os
import threading
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from gateway.core.errors import RecordingError
from gateway.core.recording.regular_file import open_regular

ID_DIGITS: Final = 32
"""Hexadecimal digits of a content's identity: 128 bits of its SHA-256."""

_BLOCK_BYTES: Final = 1 << 20


@dataclass(frozen=True, slots=True)
class FileContent:
    """A file as it was when its content was read.

    Attributes:
        path: absolute path.
        sha256: of the content, hexadecimal.
        size_bytes: its size.
        modified_ns: time of its last change.
    """

    path: Path
    sha256: str
    size_bytes: int
    modified_ns: int

    @property
    def recording_id(self) -> str:
        """Identity of the content."""
        return self.sha256[:ID_DIGITS]

    def is_unchanged(self) -> bool:
        """Return whether the file is still the one that was read, by size and time of change."""
        try:
            present = self.path.stat()
        except OSError:
            return False
        return (present.st_size, present.st_mtime_ns) == (self.size_bytes, self.modified_ns)


def read_content(path: Path, stop: threading.Event | None = None) -> FileContent | None:
    """Read a file and return its identity; None when `stop` is set meanwhile.

    Raises:
        RecordingError: the file cannot be read.
    """
    digest = hashlib.sha256()
    try:
        with open_regular(path) as file:
            while block := file.read(_BLOCK_BYTES):
                if stop is not None and stop.is_set():
                    return None
                digest.update(block)
            status = path.stat()
    except OSError as error:
        raise RecordingError(
            f"'{path}' cannot be read: {error.strerror}", "Check the path and its permissions."
        ) from error
    return FileContent(path, digest.hexdigest(), status.st_size, status.st_mtime_ns)


def check_distinct(paths: Iterable[Path]) -> None:
    """Check that no file is given twice, be it under another name or as a copy.

    Raises:
        RecordingError: one is; or a file whose size is that of another cannot be read.
    """
    known_paths: set[str] = set()
    paths_by_size: dict[int, list[Path]] = defaultdict(list)
    for path in paths:
        # Unlike Path.resolve, it leaves a loop of symbolic links to those who open the file.
        real = os.path.realpath(path)
        if real in known_paths:
            raise RecordingError(f"'{path}' is given twice", "Give each recording once.")
        known_paths.add(real)
        if path.is_file():
            paths_by_size[path.stat().st_size].append(path)
    for candidates in paths_by_size.values():
        contents: dict[str, Path] = {}
        for path in candidates if len(candidates) > 1 else ():
            content = read_content(path)
            # Nothing stops the reading.
            assert content is not None
            first = contents.setdefault(content.recording_id, path)
            if first is not path:
                raise RecordingError(
                    f"'{path}' is a copy of '{first}': their content is the same", "Give each recording once."
                )
