"""Replay protection: the highest counter of every key, kept across restarts, so that no frame is accepted twice."""

import json
from collections.abc import Mapping
from enum import Enum
from pathlib import Path
from typing import Final

from gateway.security.cmac import SecurityError
from gateway.security.private_file import locked, read_private, write_private

WINDOW: Final = 64
"""Counters behind the highest by which a late frame is still accepted."""

_ALL_SEEN: Final = (1 << WINDOW) - 1
_COUNTER_END: Final = 1 << 64
_SEQ_BITS: Final = 32
_FORMAT: Final = 1
# Between an identity and the check value of its key.
_KEY_MARK: Final = ":"
_MAX_BYTES: Final = 16 << 20
_REMEDY: Final = "Delete it if you accept that frames of former sessions could be replayed."


class Freshness(Enum):
    """Verdict on the full counter of a genuine frame."""

    NEW = "new"
    LATE = "late"
    SEEN = "seen"
    OLD = "old"


class Counter:
    """Full counters of one sensor or hub, boot_count << 32 | seq.

    Attributes:
        highest: so far, -1 before the first.
    """

    __slots__ = ("_seen", "highest")

    @property
    def boot_count(self) -> int:
        """Boot count of the highest counter, -1 before the first."""
        return self.highest >> _SEQ_BITS

    def __init__(self, highest: int = -1) -> None:
        """Continue from the highest counter of former sessions: all up to it count as seen."""
        self.highest = highest
        self._seen = _ALL_SEEN

    def take(self, counter: int) -> Freshness:
        """Check a counter; NEW and LATE ones are remembered and not accepted again."""
        lead = counter - self.highest
        if lead > 0:
            if self.highest < 0:
                # Frames sent before the first one received may still arrive.
                self._seen = 1
            else:
                self._seen = (self._seen << lead | 1) & _ALL_SEEN if lead < WINDOW else 1
            self.highest = counter
            return Freshness.NEW
        if -lead >= WINDOW:
            return Freshness.OLD
        bit = 1 << -lead
        if self._seen & bit:
            return Freshness.SEEN
        self._seen |= bit
        return Freshness.LATE


class Ledger:
    """Counters of keys, kept in a file across sessions, or in memory only.

    A counter belongs to an identity and its key, since a counter must not repeat under the same key. A new key begins
    anew, also while a session with the old key is still running and saves its counters.
    """

    def __init__(self, path: Path | None = None) -> None:
        """Read the file if there is one.

        Raises:
            SecurityError: it cannot be read, is not such a file, or others can change it.
        """
        self._path = path
        self._saved = _stored_counters(path) if path is not None else {}
        self._counters: dict[str, Counter] = {}

    def counter(self, identity: str, check_value: str) -> Counter:
        """Return the counter of a sensor or hub under the key with this check value; changes to it are kept here."""
        name = _entry(identity, check_value)
        counter = self._counters.get(name)
        if counter is None:
            # Files of earlier versions name the identity alone.
            saved = max(self._saved.get(name, -1), self._saved.get(identity, -1))
            counter = self._counters[name] = Counter(saved)
        return counter

    def highest(self) -> dict[str, int]:
        """Return the counters as they are now, for `save`."""
        return {name: counter.highest for name, counter in self._counters.items() if counter.highest >= 0}

    def starts(self) -> dict[str, int]:
        """Return the latest start of every key, as its boot count."""
        return {name: counter.boot_count for name, counter in self._counters.items() if counter.highest >= 0}

    def save(self, current: Mapping[str, int] | None = None) -> None:
        """Write what has changed; higher counters that another process wrote meanwhile are kept.

        Args:
            current: result of `highest`; with it this may run in another thread, one call at a time.

        Raises:
            SecurityError: it cannot be written.
        """
        current = self.highest() if current is None else current
        if self._path is None or current.items() <= self._saved.items():
            return
        with locked(self._path):
            merged = _stored_counters(self._path)
            for name, highest in current.items():
                merged[name] = max(highest, merged.get(name, -1))
            write_private(self._path, _text(merged))
        self._saved = merged

    def forget(self, identity: str) -> None:
        """Forget the counters of a sensor or hub under all its keys, because its key is replaced or removed.

        Raises:
            SecurityError: the file cannot be written.
        """
        for name in [name for name in self._counters if _belongs_to(name, identity)]:
            del self._counters[name]
        if self._path is None:
            return
        with locked(self._path):
            saved = _stored_counters(self._path)
            remaining = {name: highest for name, highest in saved.items() if not _belongs_to(name, identity)}
            if remaining != saved:
                write_private(self._path, _text(remaining))
        self._saved = remaining


def _entry(identity: str, check_value: str) -> str:
    return f"{identity}{_KEY_MARK}{check_value}"


def _belongs_to(name: str, identity: str) -> bool:
    return name.partition(_KEY_MARK)[0] == identity


def _text(highest: Mapping[str, int]) -> str:
    # As text: other JSON readers would round numbers of this size.
    return json.dumps({"format": _FORMAT, "highest": {name: str(value) for name, value in sorted(highest.items())}})


def _stored_counters(path: Path) -> dict[str, int]:
    text = read_private(path, _MAX_BYTES)
    if text is None:
        return {}
    try:
        content = json.loads(text)
        if content["format"] != _FORMAT:
            raise ValueError
        highest = {str(name): int(value) for name, value in content["highest"].items()}
        if not all(0 <= value < _COUNTER_END for value in highest.values()):
            raise ValueError
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise SecurityError(f"'{path}' does not contain counters of sensors", _REMEDY) from error
    return highest
