"""Reading of whole files that a user or a configuration names."""

import errno
import os
import stat
from pathlib import Path
from typing import Final

MAX_DBC_BYTES: Final = 16 << 20
"""Those of whole vehicles have a few MB."""


class NotRegularFileError(OSError):
    """A FIFO, a socket or a device: it may have no end, or wait for a writer without one."""


def read_bounded(path: Path, most_bytes: int) -> bytes:
    """Return the content of a regular file; of a larger one, the first `most_bytes` + 1 bytes.

    Raises:
        NotRegularFileError: it is neither a file nor a folder.
        OSError: the system refuses.
    """
    # Opened first and checked then, so that the file checked is the file read; a FIFO must not block.
    descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    try:
        mode = os.fstat(descriptor).st_mode
        if stat.S_ISDIR(mode):
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
        if not stat.S_ISREG(mode):
            raise NotRegularFileError(errno.EINVAL, "it is a FIFO or a device")
        with os.fdopen(descriptor, "rb", closefd=False) as file:
            return file.read(most_bytes + 1)
    finally:
        os.close(descriptor)
