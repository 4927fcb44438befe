"""Opening of files that are read at several places."""

import stat
from pathlib import Path
from typing import BinaryIO

from gateway.core.errors import RecordingError, reading_remedy
from gateway.core.nearest_name import missing_path_remedy


def open_regular(path: Path) -> BinaryIO:
    """Open a file for reading; a FIFO or a device, which would wait for a writer, is refused.

    Raises:
        RecordingError: it is no file.
        OSError: the system refuses.
    """
    mode = path.stat().st_mode
    if stat.S_ISDIR(mode):
        raise RecordingError(f"'{path}' is a folder, not a recording", f"Name its recordings: {path / '*.mcap'}")
    if not stat.S_ISREG(mode):
        raise RecordingError(
            f"'{path}' is a FIFO or a device: it cannot be read at several places",
            f"Write it to a file first: cat '{path}' > recording.mcap",
        )
    return path.open("rb")


def open_recording_file(path: Path) -> BinaryIO:
    """Open a recording for reading.

    Raises:
        RecordingError: it does not exist or cannot be read.
    """
    try:
        return open_regular(path)
    except FileNotFoundError as error:
        raise RecordingError(f"recording '{path}' does not exist", missing_path_remedy(path)) from error
    except OSError as error:
        raise RecordingError(f"cannot read recording '{path}': {error.strerror}", reading_remedy(error)) from error
