"""What the viewer has learnt of recordings, in the user's cache: by content, bounded, made again when it is lost."""

from __future__ import annotations

import hashlib
import logging
import os
import zipfile
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gateway import __version__
from gateway.core.recording.regular_file import open_recording_file
from gateway.viewer.chunk_index import ChunkIndex

Arrays = dict[str, NDArray[Any]]
"""What is stored of a recording, by name."""

_logger = logging.getLogger(__name__)

MAX_BYTES: Final = 1 << 30
"""Of all recordings together; those that were looked at longest ago are removed first."""
_LAYOUT: Final = "2"
_PARTS: Final = 64
_PART_BYTES: Final = 1 << 16


def cache_folder() -> Path:
    """Return the user's folder."""
    from platformdirs import user_cache_path

    return user_cache_path("treadlink", appauthor=False) / "view"


def content_key(path: Path, index: ChunkIndex, setting: str) -> str:
    """Return the key of a recording: by its size, the times and places of its chunks, and 64 parts of its content.

    The whole content takes seconds to read, and a recording is never changed in place.

    Args:
        path: the recording.
        index: its chunks.
        setting: what else decides the result, such as configuration and keys.

    Raises:
        RecordingError: it cannot be read.
    """
    digest = hashlib.sha256(f"{_LAYOUT} {__version__} {setting}".encode())
    for column in index[1:]:
        digest.update(np.ascontiguousarray(column).tobytes())
    with open_recording_file(path) as file:
        size = os.fstat(file.fileno()).st_size
        digest.update(str(size).encode())
        for offset in np.linspace(0, max(size - _PART_BYTES, 0), _PARTS).astype(int).tolist():
            file.seek(offset)
            digest.update(file.read(_PART_BYTES))
    return digest.hexdigest()


def stored(key: str) -> Arrays | None:
    """Return what is stored by a key, None without it; a damaged file is removed."""
    path = cache_folder() / f"{key}.npz"
    try:
        with np.load(path, allow_pickle=False) as arrays:
            loaded = dict(arrays)
        os.utime(path)
        return loaded
    except FileNotFoundError:
        return None
    except (OSError, ValueError, EOFError, zipfile.BadZipFile) as error:
        _logger.warning("%s cannot be read, and is made again: %s", path, error)
        with suppress(OSError):
            path.unlink()
        return None


def store(key: str, arrays: Arrays) -> None:
    """Store by a key, and remove what is too much; without room for it, it is made again next time."""
    folder = cache_folder()
    part = folder / f"{key}.{os.getpid()}.part"
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        with part.open("wb") as file:
            np.savez(file, allow_pickle=False, **arrays)
        part.replace(folder / f"{key}.npz")
        _remove_oldest(folder)
    except OSError as error:
        _logger.warning("%s cannot be written: the recording is read again next time: %s", folder, error)
        with suppress(OSError):
            part.unlink()


def _remove_oldest(folder: Path) -> None:
    files = sorted(((file.stat().st_mtime_ns, file.stat().st_size, file) for file in folder.iterdir()), reverse=True)
    total = 0
    for _, size, file in files:
        total += size
        if total > MAX_BYTES:
            file.unlink(missing_ok=True)
