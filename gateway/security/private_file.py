"""Files that only their owner may read: mode 0600, replaced as a whole or not at all."""

from __future__ import annotations

import os
import stat
import tempfile
from contextlib import suppress
from pathlib import Path

from gateway.security.cmac import SecurityError

_HAS_MODES = os.name == "posix"


def read_private(path: Path, most_bytes: int) -> str | None:
    """Return the text of a private file, None when there is no such file.

    Raises:
        SecurityError: it cannot be read, is not a regular file, is too long, or is not private.
    """
    try:
        # Opened first and checked then, so that the file checked is the file read; a pipe must not block.
        descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0))
    except FileNotFoundError:
        return None
    except OSError as error:
        raise SecurityError(f"'{path}' cannot be read: {error.strerror}", "Check its owner and mode.") from error
    try:
        _check(path, os.fstat(descriptor))
        with os.fdopen(descriptor, "rb", closefd=False) as file:
            data = file.read(most_bytes + 1)
    except OSError as error:
        raise SecurityError(f"'{path}' cannot be read: {error.strerror}", "Check the disk.") from error
    finally:
        os.close(descriptor)
    if len(data) > most_bytes:
        raise SecurityError(f"'{path}' is too large", "Give the right file.")
    try:
        return data.decode()
    except UnicodeDecodeError as error:
        raise SecurityError(f"'{path}' is not UTF-8 text", "Give the right file.") from error


def _check(path: Path, status: os.stat_result) -> None:
    if not stat.S_ISREG(status.st_mode):
        raise SecurityError(f"'{path}' is not a regular file", "Give a key file, or the name of a new one.")
    if _HAS_MODES and status.st_mode & 0o077:
        raise SecurityError(
            f"'{path}' can be read or changed by others (mode {stat.S_IMODE(status.st_mode):04o})",
            f"Make it private: chmod 600 '{path}'. If others may have read it, make new keys.",
        )
    if _HAS_MODES and status.st_uid not in (os.getuid(), 0):
        raise SecurityError(f"'{path}' belongs to another user", "Use a file of your own.")


def write_private(path: Path, text: str) -> None:
    """Replace a private file; a crash leaves either the old or the new one complete.

    Raises:
        SecurityError: it cannot be written.
    """
    try:
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        descriptor, name = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)  # mode 0600
        try:
            with os.fdopen(descriptor, "wb") as file:
                file.write(text.encode())
                file.flush()
                os.fsync(file.fileno())
            Path(name).replace(path)
        except BaseException:
            with suppress(OSError):
                Path(name).unlink()
            raise
    except OSError as error:
        raise SecurityError(f"'{path}' cannot be written: {error.strerror}", "Check folder and disk.") from error
