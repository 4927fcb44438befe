"""The guard's part in a session: gates for its links, what is to be told, and counters that outlive it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from firmware_protocol.signing import Gate
from gateway.security.cmac import SecurityError
from gateway.security.guard import Guard

# What a crash may lose of the counters; frames of so long ago could be played to the next session.
_SAVE_EVERY_NS: Final = 5_000_000_000


class SecurityWatch:
    """A guard, or none."""

    def __init__(self, guard: Guard | None) -> None:
        self._guard = guard
        self._due_ns = 0
        self._failed = False

    def gate(self, link: str) -> Gate | None:
        """Return what judges the frames of a link."""
        return self._guard.gate(link) if self._guard is not None else None

    def findings(self) -> list[str]:
        """Take what is to be told since the last call."""
        return self._guard.findings() if self._guard is not None else []

    def counts(self, link: str) -> Mapping[str, int]:
        """Return how many frames of a link the guard judged how."""
        if self._guard is None:
            return {}
        return {verdict.value: count for verdict, count in self._guard.gate(link).counts.items()}

    def tick(self, now_ns: int) -> list[str]:
        """Keep the counters now and then; return what went wrong, once."""
        # A clock that was set back must not stop it.
        if self._guard is None or 0 <= self._due_ns - now_ns <= _SAVE_EVERY_NS:
            return []
        self._due_ns = now_ns + _SAVE_EVERY_NS
        return self.finish()

    def finish(self) -> list[str]:
        """Keep the counters; return what went wrong, once."""
        if self._guard is None:
            return []
        found = self._guard.findings()
        try:
            self._guard.ledger.save()
        except SecurityError as error:
            if not self._failed:
                self._failed = True
                found.append(
                    f"SECURITY: {error}: frames of this session could be played to the next one. {error.remedy}"
                )
        return found
