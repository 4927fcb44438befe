"""Start-up of helper programs that must not outlive this one."""

import ctypes
import signal
import sys
from typing import Any, Final

_PR_SET_PDEATHSIG: Final = 1


def _end_with_the_parent() -> None:
    """Ask Linux to end this process when its parent is killed."""
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)


HELPER: Final[dict[str, Any]] = {
    # Ctrl-C reaches every process of the group of the terminal; a helper must outlive those who use it. (A session
    # would also be a group of the scheduler, in which the helper starves while the computer is busy.)
    "process_group": 0,
    "preexec_fn": _end_with_the_parent if sys.platform == "linux" else None,
}
"""Options of `subprocess.Popen` for a helper."""
