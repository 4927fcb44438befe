"""Work of campaign workers that fails as machines do: killed, out of memory, on a full disk."""

import os
import resource
import signal
from collections.abc import Callable
from pathlib import Path

from gateway.fleet.recording_estimation import Estimated, EstimationOrder, estimate_recording

_SMALL_BYTES = 4096


def faulty_work(order: EstimationOrder, on_bytes: Callable[[int], None] | None = None) -> Estimated:
    """Estimate a recording, unless its name asks for a fault."""
    name = order.content.path.name
    if name.startswith("killed_once"):
        mark = Path(f"{order.content.path}.was_killed")
        if not mark.exists():
            mark.touch()
            _leave_part(order)
            os.kill(os.getpid(), signal.SIGKILL)
    elif name.startswith("killed"):
        _leave_part(order)
        os.kill(os.getpid(), signal.SIGKILL)
    elif name.startswith("hog"):
        held = []
        while True:
            held.append(bytearray(os.urandom(1 << 20) * 16))
    elif name.startswith("full_disk"):
        before = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (_SMALL_BYTES, before[1]))
        try:
            return estimate_recording(order, on_bytes)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, before)
    elif name.startswith("grows"):
        with order.content.path.open("ab") as file:
            file.write(b"x")
    elif name.startswith("memory_error"):
        raise MemoryError
    return estimate_recording(order, on_bytes)


def _leave_part(order: EstimationOrder) -> None:
    """Leave half a file, as a process that is killed while it writes."""
    (order.folder / f".{order.token}.revolutions.parquet.1.part").write_bytes(b"PAR1 half")
