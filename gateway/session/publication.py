"""Interface between a session and its live outputs."""

from collections.abc import Sequence
from typing import Protocol

from gateway.pipeline.results import AlarmChange, RevolutionResult, SessionSnapshot, SinkSnapshot


class Publication(Protocol):
    """Live outputs of a session. No call blocks, whatever the receivers do."""

    def take(self, items: Sequence[RevolutionResult | AlarmChange], host_ns: int) -> None:
        """Take new revolutions and changes of alarms.

        Args:
            items: in their order.
            host_ns: time of the newest data, ns since the epoch.
        """
        ...

    def show(self, snapshot: SessionSnapshot, host_ns: int) -> None:
        """Take the present state of the session."""
        ...

    def sinks(self) -> tuple[SinkSnapshot, ...]:
        """Return the present state of the outputs."""
        ...
