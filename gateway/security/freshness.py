"""The highest counter seen of every sensor, so that what was sent once is never taken again, also after a restart."""

from __future__ import annotations

import json
from collections.abc import Mapping
from enum import Enum
from pathlib import Path
from typing import Final

from gateway.security.cmac import SecurityError
from gateway.security.private_file import read_private, write_private

WINDOW: Final = 64
"""How many counters behind the highest a frame may come late."""

_ALL: Final = (1 << WINDOW) - 1
_HIGHEST: Final = 1 << 64
_FORMAT: Final = 1
_MOST_BYTES: Final = 16 << 20
_REMEDY: Final = "Delete it if you accept that frames of former sessions could be played to you again."


class Freshness(Enum):
    """What the full counter of a genuine frame says."""

    NEW = "new"
    LATE = "late"
    SEEN = "seen"
    OLD = "old"


class Counter:
    """Full counters, boot_count << 32 | seq, of one sensor.

    Attributes:
        highest: so far, -1 before the first.
    """

    __slots__ = ("_seen", "highest")

    def __init__(self, highest: int = -1) -> None:
        """Go on from the highest counter of former sessions: everything up to it counts as seen."""
        self.highest = highest
        self._seen = _ALL

    def take(self, counter: int) -> Freshness:
        """Judge a counter; NEW and LATE ones are noted and never come through again."""
        ahead = counter - self.highest
        if ahead > 0:
            if self.highest < 0:
                # What came before the first frame may still be on its way.
                self._seen = 1
            else:
                self._seen = (self._seen << ahead | 1) & _ALL if ahead < WINDOW else 1
            self.highest = counter
            return Freshness.NEW
        if -ahead >= WINDOW:
            return Freshness.OLD
        bit = 1 << -ahead
        if self._seen & bit:
            return Freshness.SEEN
        self._seen |= bit
        return Freshness.LATE


class Ledger:
    """Counters by identity, kept in a file across sessions, or in memory alone."""

    def __init__(self, path: Path | None = None) -> None:
        """Read the file if there is one.

        Raises:
            SecurityError: it cannot be read, is no such file, or others can change it.
        """
        self._path = path
        self._saved = _read(path) if path is not None else {}
        self._counters: dict[str, Counter] = {}

    def counter(self, identity: str) -> Counter:
        """Return the counter of a sensor, a live object."""
        found = self._counters.get(identity)
        if found is None:
            found = self._counters[identity] = Counter(self._saved.get(identity, -1))
        return found

    def highest(self) -> dict[str, int]:
        """Return the counters as they are now, for `save`."""
        return {name: counter.highest for name, counter in self._counters.items() if counter.highest >= 0}

    def save(self, current: Mapping[str, int] | None = None) -> None:
        """Write what has changed; what another treadlink wrote meanwhile is kept where it is higher.

        Args:
            current: what `highest` returned; with it this may run in another thread than all else, one at a time.

        Raises:
            SecurityError: it cannot be written.
        """
        current = self.highest() if current is None else current
        if self._path is None or current.items() <= self._saved.items():
            return
        there = _read(self._path)
        merged = {**self._saved, **there}
        for name, highest in current.items():
            merged[name] = max(highest, merged.get(name, -1))
        write_private(self._path, _text(merged))
        self._saved = merged

    def forget(self, identity: str) -> None:
        """Let a sensor begin anew, as with a new key.

        Raises:
            SecurityError: the file cannot be written.
        """
        self._counters.pop(identity, None)
        if self._path is not None and self._saved.pop(identity, None) is not None:
            write_private(self._path, _text(self._saved))


def _text(highest: Mapping[str, int]) -> str:
    # As text: other JSON readers round such numbers.
    return json.dumps({"format": _FORMAT, "highest": {name: str(value) for name, value in sorted(highest.items())}})


def _read(path: Path) -> dict[str, int]:
    text = read_private(path, _MOST_BYTES)
    if text is None:
        return {}
    try:
        content = json.loads(text)
        if content["format"] != _FORMAT:
            raise ValueError
        highest = {str(name): int(value) for name, value in content["highest"].items()}
        if not all(0 <= value < _HIGHEST for value in highest.values()):
            raise ValueError
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise SecurityError(f"'{path}' does not hold the counters of sensors", _REMEDY) from error
    return highest
