"""Admission of connections to a listener: so many at once, and so many of one peer, whoever they are."""

import threading
from collections import Counter
from typing import Final

MOST_CONNECTIONS: Final = 64
"""Connections of a listener at once."""
MOST_OF_A_PEER: Final = 32
"""Connections of one address at once."""
HEAD_S: Final = 5.0
"""Time within which a connection has sent its request, token included."""


class Admission:
    """Counts the connections of a listener; used by several threads."""

    def __init__(self, most: int = MOST_CONNECTIONS, most_of_a_peer: int = MOST_OF_A_PEER) -> None:
        """Start without a connection."""
        self._max_connections, self._max_per_peer = most, most_of_a_peer
        self._peers: Counter[str] = Counter()
        self._lock = threading.Lock()

    def admit(self, peer: str) -> bool:
        """Count a connection of a peer; return False, and count none, where it is one too many."""
        with self._lock:
            if self._peers.total() >= self._max_connections or self._peers[peer] >= self._max_per_peer:
                return False
            self._peers[peer] += 1
            return True

    def release(self, peer: str) -> None:
        """Count a connection of a peer that was admitted no more."""
        with self._lock:
            self._peers[peer] -= 1
            if self._peers[peer] <= 0:
                del self._peers[peer]
