"""Identity of recordings by content, and of the settings and the code that estimate them."""

from __future__ import annotations

import hashlib
import json
import threading
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any, Final

from gateway.errors import RecordingError

ID_DIGITS: Final = 32
"""Hexadecimal digits of a content's identity: 128 bits of its SHA-256."""
SETTINGS_DIGITS: Final = 12
PATH_DIGITS: Final = 12

_BLOCK_BYTES: Final = 1 << 20
# Packages whose code decides about the numbers.
_ESTIMATING: Final = (
    "firmware_protocol",
    "gateway.estimators",
    "gateway.physics",
    "gateway.pipeline",
    "gateway.recording",
    "gateway.signal",
)
_DIAGNOSING: Final = ("gateway.closure",)


@dataclass(frozen=True, slots=True)
class FileContent:
    """A file as it was when its content was read.

    Attributes:
        path: absolute path.
        recording_id: identity of the content.
        size_bytes: its size.
        modified_ns: time of its last change.
    """

    path: Path
    recording_id: str
    size_bytes: int
    modified_ns: int

    def is_unchanged(self) -> bool:
        """Return whether the file is still the one that was read, by size and time of change."""
        try:
            found = self.path.stat()
        except OSError:
            return False
        return (found.st_size, found.st_mtime_ns) == (self.size_bytes, self.modified_ns)


def read_content(
    path: Path, stop: threading.Event | None = None, on_bytes: Callable[[int], None] | None = None
) -> FileContent | None:
    """Read a file and return its identity; None when `stop` is set meanwhile.

    Raises:
        RecordingError: the file cannot be read.
    """
    digest = hashlib.sha256()
    try:
        with path.open("rb") as file:
            while block := file.read(_BLOCK_BYTES):
                if stop is not None and stop.is_set():
                    return None
                digest.update(block)
                if on_bytes is not None:
                    on_bytes(len(block))
            found = path.stat()
    except OSError as error:
        raise RecordingError(
            f"'{path}' cannot be read: {error.strerror}", "Check the path and its permissions."
        ) from error
    return FileContent(path, digest.hexdigest()[:ID_DIGITS], found.st_size, found.st_mtime_ns)


def path_key(path: Path) -> str:
    """Return the identity of a path."""
    return hashlib.sha256(str(path).encode("utf-8", "surrogateescape")).hexdigest()[:PATH_DIGITS]


def settings_key(settings: Any) -> str:
    """Return the identity of settings that JSON can hold."""
    text = json.dumps(settings, sort_keys=True, ensure_ascii=True)
    return hashlib.sha256(text.encode()).hexdigest()[:SETTINGS_DIGITS]


@cache
def estimators_version() -> str:
    """Return the identity of the code that estimates: it changes when a file of it changes, not with a release."""
    return _code_digest(_ESTIMATING)


@cache
def diagnosis_version() -> str:
    """Return the identity of the code that diagnoses."""
    return _code_digest((*_ESTIMATING, *_DIAGNOSING))


def _code_digest(packages: tuple[str, ...]) -> str:
    digest = hashlib.sha256()
    for package in packages:
        root = Path(str(resources.files(package)))
        for path in sorted(root.rglob("*.py"), key=lambda one: one.relative_to(root).as_posix()):
            digest.update(f"{package}/{path.relative_to(root).as_posix()}\n".encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()[:SETTINGS_DIGITS]
