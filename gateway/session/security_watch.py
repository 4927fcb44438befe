"""The guard within a session: gates of the links, notices, and counters saved in the background."""

import threading
from collections.abc import Mapping
from typing import Final

from firmware_protocol.signing import Gate
from gateway.reasons import Code, Level, Notice, Reason
from gateway.security.cmac import SecurityError
from gateway.security.guard import Guard

# A crash loses the counters of this time; frames as recent as that could be replayed to the next session.
_SAVE_EVERY_NS: Final = 5_000_000_000
_JOIN_S: Final = 5.0


class SecurityWatch:
    """Wrapper of a guard, or of none."""

    def __init__(self, guard: Guard | None) -> None:
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
            self._fault = Reason(Code.COUNTERS_SAVED_LATE)
        return [*self._guard.take_notices(), *self._new_fault()]

    def _save(self, current: Mapping[str, int]) -> None:
        if self._guard is None:
            return
        try:
            self._guard.ledger.save(current)
        except SecurityError as error:
            self._fault = Reason(Code.COUNTERS_NOT_SAVED, error=str(error), remedy=error.remedy)

    def _new_fault(self) -> list[Notice]:
        if self._fault is None or self._is_reported:
            return []
        self._is_reported = True
        return [Notice("", self._fault, Level.SECURITY)]
