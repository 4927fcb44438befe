"""Waiting that ends at once when somebody stops or closes."""

from __future__ import annotations

import threading
from typing import Final

from gateway.clock import Clock

SLICE_NS: Final = 100_000_000


def wait_until(clock: Clock, deadline_ns: int, stop: threading.Event, closed: threading.Event) -> bool:
    """Sleep until `deadline_ns`; return False when stopped, or closed (seen within 0.1 s), before it."""
    while not stop.is_set() and not closed.is_set():
        now_ns = clock.now_ns()
        if now_ns >= deadline_ns:
            return True
        if clock.sleep_until_ns(min(deadline_ns, now_ns + SLICE_NS), stop):
            return False
    return False
