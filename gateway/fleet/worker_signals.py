"""Signals and messages of worker processes; dask imports this module in each before its first task."""

from __future__ import annotations

import logging
import signal
from contextlib import suppress


def dask_setup(_: object) -> None:
    """Ignore Ctrl-C, which a terminal sends to all processes: the campaign ends its workers itself.

    Alarms are rows of the dataset. Printed by a worker, they would stand within the progress of the campaign, and name
    a wheel but no recording.
    """
    program = logging.getLogger("gateway")
    if not program.handlers:
        program.addHandler(logging.NullHandler())
    with suppress(ValueError):  # not in the main thread
        signal.signal(signal.SIGINT, signal.SIG_IGN)


dask_setup(None)
