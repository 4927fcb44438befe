"""A simulated session as outputs see it."""

import threading
from collections.abc import Sequence

from gateway.core.clock import ManualClock
from gateway.core.config.vehicle import parse_vehicle
from gateway.core.estimates.registry import DEFAULT_ESTIMATORS
from gateway.core.estimates.results import RevolutionResult, SessionSnapshot
from gateway.core.links.source import LinkEvent, open_source
from gateway.core.session.core import SessionCore


def simulated_session(
    address: str, duration_s: float, estimators: Sequence[str] = DEFAULT_ESTIMATORS
) -> tuple[list[RevolutionResult], SessionSnapshot]:
    """Return the revolutions of a simulation, and the state of its session before the link ends."""
    source = open_source(address, ManualClock())
    core = SessionCore(parse_vehicle(source.vehicle_toml, address), estimators=estimators)
    results, snapshot = [], core.snapshot(0.0)
    for item in source.items(threading.Event()):
        if isinstance(item, LinkEvent):
            snapshot = core.snapshot(duration_s)
        results += core.take(item)
    return [*results, *core.finish()], snapshot
