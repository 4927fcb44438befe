"""The guard within a session: its verdicts, gates of the links, notices, and counters saved in the background."""

import threading
from collections.abc import Mapping
from enum import StrEnum
from typing import Final, Protocol

from firmware_protocol.signing import Gate
from gateway.core.errors import TreadlinkError
from gateway.core.reasons import Level, Notice, Reason
from gateway.core.session.reasons import SessionCode

# A crash loses the counters of this time; frames as recent as that could be replayed to the next session.
_SAVE_EVERY_NS: Final = 5_000_000_000
_JOIN_S: Final = 5.0


class Verdict(StrEnum):
    """Verdict on a frame; only VERIFIED frames pass where signatures are required."""

    VERIFIED = "verified"
    UNSIGNED = "unsigned"
    FORGED = "wrong tag"
    EARLIER_START = "earlier start"
    REPLAYED = "replayed"
    TOO_LATE = "too late"
    NO_KEY = "no key"
    NOT_ADMITTED = "not admitted"
    EARLY = "before hello"


SUSPICIOUS: Final = (
    Verdict.UNSIGNED,
    Verdict.FORGED,
    Verdict.EARLIER_START,
    Verdict.REPLAYED,
    Verdict.TOO_LATE,
    Verdict.NOT_ADMITTED,
)
"""Verdicts that bad intent could explain."""


class CountedGate(Protocol):
    """Check of the frames of one link."""

    @property
    def counts(self) -> Mapping[Verdict, int]:
        """Frames by verdict."""
        ...

    def __call__(self, frame: bytes) -> bool:
        """Return whether an intact frame may pass."""
        ...


class CounterLedger(Protocol):
    """Counters of the senders, which are kept from session to session."""

    def starts(self) -> Mapping[str, int]:
        """Return the latest start of each sender."""
        ...

    def highest(self) -> Mapping[str, int]:
        """Return the highest counter of each sender."""
        ...

    def save(self, counters: Mapping[str, int]) -> None:
        """Store counters.

        Raises:
            TreadlinkError: they cannot be stored.
        """
        ...


class FrameGuard(Protocol):
    """Check of every frame of a session.

    Attributes:
        requires: True when only verified frames pass.
    """

    requires: bool

    @property
    def ledger(self) -> CounterLedger:
        """Counters of the senders."""
        ...

    def gate(self, link: str) -> CountedGate:
        """Return the check of a link, one per name."""
        ...

    def take_notices(self) -> list[Notice]:
        """Return the notices since the last call."""
        ...


class GuardWatch:
    """Wrapper of a guard, or of none."""

    def __init__(self, guard: FrameGuard | None) -> None:
        self._guard = guard
        self._due_ns = 0
        self._starts: Mapping[str, int] = {}
        self._saving: threading.Thread | None = None
        self._fault: Reason | None = None
        self._is_reported = False

    def gate(self, link: str) -> Gate | None:
        """Return the check of the frames of a link."""
        return self._guard.gate(link) if self._guard is not None else None

    def take_notices(self) -> list[Notice]:
        """Return the notices since the last call."""
        return self._guard.take_notices() if self._guard is not None else []

    def counts(self, link: str) -> Mapping[str, int]:
        """Return the number of frames of a link by verdict."""
        if self._guard is None:
            return {}
        return {verdict.value: count for verdict, count in self._guard.gate(link).counts.items()}

    def tick(self, now_ns: int) -> list[Notice]:
        """Save the counters when that is due, in the background as the disk may be slow; return new notices."""
        if self._guard is None:
            return []
        # The first frame of a start is stored at once: what comes before the next saving is then all that can be lost.
        starts = self._guard.ledger.starts()
        # A clock that was set back must not stop it.
        if starts == self._starts and 0 <= self._due_ns - now_ns <= _SAVE_EVERY_NS:
            return []
        if self._saving is None or not self._saving.is_alive():
            self._due_ns, self._starts = now_ns + _SAVE_EVERY_NS, starts
            current = self._guard.ledger.highest()
            self._saving = threading.Thread(target=self._save, args=(current,), name="save counters", daemon=True)
            self._saving.start()
        return [*self._guard.take_notices(), *self._new_fault()]

    def finish(self) -> list[Notice]:
        """Save the counters; return new notices."""
        if self._guard is None:
            return []
        if self._saving is not None:
            self._saving.join(_JOIN_S)
        if self._saving is None or not self._saving.is_alive():
            self._save(self._guard.ledger.highest())
        else:
            self._fault = Reason(SessionCode.COUNTERS_NOT_SAVED, how="late")
        return [*self._guard.take_notices(), *self._new_fault()]

    def _save(self, current: Mapping[str, int]) -> None:
        if self._guard is None:
            return
        try:
            self._guard.ledger.save(current)
        except TreadlinkError as error:
            self._fault = Reason(SessionCode.COUNTERS_NOT_SAVED, how="refused", error=str(error), remedy=error.remedy)

    def _new_fault(self) -> list[Notice]:
        if self._fault is None or self._is_reported:
            return []
        self._is_reported = True
        return [Notice("", self._fault, Level.SECURITY)]
