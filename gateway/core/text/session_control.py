"""What the console and the page ask a session for: marks, alarms that are seen, recordings."""

from collections.abc import Mapping
from typing import Protocol

from gateway.core.estimates.results import RevolutionResult, SessionSnapshot
from gateway.core.shown_units import ShownUnits


class SessionControl(Protocol):
    """What its views may ask a session for, from any thread."""

    @property
    def may_record(self) -> bool:
        """Whether a recording can be begun."""
        ...

    def mark(self, text: str) -> bool:
        """Mark an event in the recording, with the present time; return whether it is kept: something is recorded."""
        ...

    def acknowledge(self) -> None:
        """Note that the user has seen the alarms that stand."""
        ...

    def show_in(self, units: ShownUnits) -> None:
        """Have all screens of the session show numbers in these units."""
        ...

    @property
    def run_form(self) -> dict[str, str]:
        """Fields of the form that describes the run, with what is stated."""
        ...

    def start_recording(self, form: Mapping[str, str] = ...) -> None:
        """Begin a recording, described by the fields of a form; does nothing while one runs.

        Raises:
            TreadlinkError: it cannot be begun, or the form is wrong.
        """
        ...

    def stop_recording(self) -> None:
        """End the recording, if one runs.

        Raises:
            RecordingError: the disk refused.
        """
        ...


class ShownSession(SessionControl, Protocol):
    """A running session as the console uses it, from the thread of the console."""

    def snapshot(self) -> SessionSnapshot:
        """Return the latest state; cheap, never raises."""
        ...

    def results(self) -> list[RevolutionResult]:
        """Return the results since the last call."""
        ...

    def pause(self, paused: bool) -> bool:
        """Pause a replay, or let it go on; return whether the session can be paused, as a live hub cannot."""
        ...

    def request_stop(self) -> None:
        """Ask the session to end; returns at once."""
        ...
