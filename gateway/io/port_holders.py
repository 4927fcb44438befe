"""Programs that hold a device open, where the system says it."""

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Final

_PROCESSES: Final = Path("/proc")


def port_holders(port: str) -> tuple[str, ...]:
    """Return the other programs that have a port open, as `minicom (process 1234)`; none where they cannot be seen.

    Linux shows the open files of the user's own processes only; other systems show none.
    """
    try:
        device = Path(port).stat().st_rdev
    except OSError:
        return ()
    return tuple(_holders(device)) if device and _PROCESSES.is_dir() else ()


def _holders(device: int) -> Iterator[str]:
    for process in sorted(_PROCESSES.glob("[0-9]*"), key=lambda path: int(path.name)):
        if process.name == str(os.getpid()):
            continue
        try:
            if any(_is_of(path, device) for path in (process / "fd").iterdir()):
                yield f"{(process / 'comm').read_text(errors='replace').strip()} (process {process.name})"
        except OSError:  # it has ended, or belongs to another user
            continue


def _is_of(path: Path, device: int) -> bool:
    try:
        return path.stat().st_rdev == device
    except OSError:
        return False
