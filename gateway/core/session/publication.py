"""Interface between a session and its live outputs."""

from collections.abc import Sequence
from typing import Protocol

from gateway.core.estimates.results import AlarmChange, RevolutionResult, SessionSnapshot, SinkSnapshot


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


class LiveOutputs(Publication, Protocol):
    """Live outputs that are open.

    Attributes:
        addresses: that users open in a browser.
    """

    addresses: tuple[str, ...]

    @property
    def uses_standard_output(self) -> bool:
        """Whether nothing else may be printed to standard output."""
        ...

    @property
    def is_output_closed(self) -> bool:
        """Whether the reader of standard output has left."""
        ...

    @property
    def is_receiver_left(self) -> bool:
        """After `close`: whether a receiver was away or took nothing at the end."""
        ...

    def close(self) -> tuple[SinkSnapshot, ...]:
        """Send what waits and end the outputs; return their last state."""
        ...
