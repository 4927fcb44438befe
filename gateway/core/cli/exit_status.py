"""Exit status of all commands; docs/reference/exit-status.md is the page for users."""

import signal
from typing import Final

from gateway.core.cli.stop_signals import StopSignal

NO_RESULT: Final = 1
"""No result, or a finding that the user must act on; also every error that a message explains.

0 is success, and click uses 2 for a wrong command line.
"""
CLOSED_PIPE: Final = 141
"""The reader of standard output is gone: 128 plus the number of SIGPIPE, as in shells."""

_SIGNALLED: Final = 128


def of_signal(error: KeyboardInterrupt) -> int:
    """Return the exit status of a program that a signal ended: 128 plus its number, as in shells."""
    return _SIGNALLED + (error.number if isinstance(error, StopSignal) else signal.SIGINT)
