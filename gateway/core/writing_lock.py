"""Lock on a file while it is written, by which other commands distinguish it from one that was interrupted."""

import os
import sys
from contextlib import suppress
from io import FileIO
from typing import BinaryIO

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]


def lock_for_writing(file: FileIO) -> None:
    """Lock an open file until it is closed or its process ends, however that happens.

    Raises:
        BlockingIOError: another command writes it.
    """
    if fcntl is not None:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise
        except OSError:  # a file system without locks
            return


def is_being_written(file: BinaryIO) -> bool:
    """Return whether a process that holds the lock of an open file is writing it.

    False where the system has no locks: nothing is known there.
    """
    if fcntl is not None:
        try:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
        except OSError:
            return False
        with suppress(OSError):
            fcntl.flock(file, fcntl.LOCK_UN)
    return False


def process_runs(number: int) -> bool:
    """Return whether a process of this computer has this number; False where asking would disturb it (Windows)."""
    if sys.platform == "win32":
        return False
    try:
        os.kill(number, 0)
    except ProcessLookupError:
        return False
    except (PermissionError, OverflowError):
        return True
    return True
