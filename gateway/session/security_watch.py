"""The guard's part in a session: gates for its links, what is to be told, and counters that outlive it."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from typing import Final

from firmware_protocol.signing import Gate
from gateway.security.cmac import SecurityError
from gateway.security.guard import Guard

# What a crash may lose of the counters; frames of so long ago could be played to the next session.
_SAVE_EVERY_NS: Final = 5_000_000_000
_JOIN_S: Final = 5.0


class SecurityWatch:
    """A guard, or none."""

    def __init__(self, guard: Guard | None) -> None:
        self._guard = guard
        self._due_ns = 0
        self._saving: threading.Thread | None = None
        self._fault: str | None = None
        self._told = False

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
        """Keep the counters now and then, in the background for the disk may be slow; return what went wrong, once."""
        # A clock that was set back must not stop it.
        if self._guard is None or 0 <= self._due_ns - now_ns <= _SAVE_EVERY_NS:
            return []
        if self._saving is None or not self._saving.is_alive():
            self._due_ns = now_ns + _SAVE_EVERY_NS
            current = self._guard.ledger.highest()
            self._saving = threading.Thread(target=self._save, args=(current,), name="save counters", daemon=True)
            self._saving.start()
        return self._guard.findings() + self._found()

    def finish(self) -> list[str]:
        """Keep the counters; return what went wrong, once."""
        if self._guard is None:
            return []
        if self._saving is not None:
            self._saving.join(_JOIN_S)
        if self._saving is None or not self._saving.is_alive():
            self._save(self._guard.ledger.highest())
        else:
            self._fault = "the counters of the sensors could not be written in time"
        return self._guard.findings() + self._found()

    def _save(self, current: Mapping[str, int]) -> None:
        if self._guard is None:
            return
        try:
            self._guard.ledger.save(current)
        except SecurityError as error:
            self._fault = f"{error}. {error.remedy}"

    def _found(self) -> list[str]:
        if self._fault is None or self._told:
            return []
        self._told = True
        return [f"SECURITY: frames of this session could be played to the next one: {self._fault}"]
