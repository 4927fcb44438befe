"""Signals of worker processes; dask imports this module in each before its first task."""

from __future__ import annotations

import signal
from contextlib import suppress


def dask_setup(_: object) -> None:
    """Ignore Ctrl-C, which a terminal sends to all processes: the campaign ends its workers itself."""
    with suppress(ValueError):  # not in the main thread
        signal.signal(signal.SIGINT, signal.SIG_IGN)


dask_setup(None)
