"""A link that is opened again whenever it breaks, told once in plain words each time something changes."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import Enum, auto
from typing import Final, Protocol

from gateway.clock import Clock
from gateway.errors import LinkLostError, SourceError, TreadlinkError
from gateway.io.pacing import wait_until
from gateway.io.source import Chunk, LinkEvent, LinkEventKind, LinkItem

READ_TIMEOUT_S: Final = 0.05


class Link(Protocol):
    """One connection, used once: opened, read until it breaks, closed."""

    def open(self) -> None:
        """Connect.

        Raises:
            SourceError: it cannot be opened now; message and remedy say why.
        """
        ...

    def read(self, timeout_s: float) -> bytes:
        """Return what has arrived, or wait for the first bytes; empty after `timeout_s`.

        Raises:
            LinkLostError: the connection broke.
        """
        ...

    def close(self) -> None:
        """Disconnect; may be called at any time and twice, never raises."""
        ...


class LinkState(Enum):
    """What a reconnecting source is doing."""

    IDLE = auto()
    OPENING = auto()
    CONNECTED = auto()
    WAITING = auto()
    CLOSED = auto()


@dataclass(frozen=True, slots=True)
class Backoff:
    """Pauses between attempts: doubling from `first_ns` to `cap_ns`."""

    first_ns: int = 250_000_000
    cap_ns: int = 5_000_000_000

    def pause_ns(self, failures: int) -> int:
        """Return the pause after that many failures in a row (1 for the first)."""
        return min(self.cap_ns, self.first_ns << min(failures - 1, 40))


class ReconnectingSource:
    """Makes a source of a link: chunks with arrival times, events about the link, retries for ever.

    Only the very first opening may fail: a port that never was there is a mistake, one that vanished is an event.
    """

    vehicle_toml: str | None = None

    def __init__(self, link: str, make_link: Callable[[], Link], clock: Clock, backoff: Backoff | None = None) -> None:
        """Name the link; nothing is opened yet.

        Args:
            link: name in chunks and events.
            make_link: gives a fresh connection for every attempt.
            clock: stamps arrivals and paces the attempts.
            backoff: pauses between attempts.
        """
        self._name = link
        self._make_link = make_link
        self._clock = clock
        self._backoff = backoff if backoff is not None else Backoff()
        self._closed = threading.Event()
        self._using = threading.Lock()
        self._current: Link | None = None
        self.state = LinkState.IDLE

    @property
    def link(self) -> str:
        """Name of the link."""
        return self._name

    def items(self, stop: threading.Event) -> Iterator[LinkItem]:
        """Yield chunks and events until stopped or closed.

        Raises:
            SourceError: the link could not be opened the first time.
        """
        try:
            if not self._open(stop):
                return
            yield self._event(LinkEventKind.CONNECTED, f"{self._name} is open")
            failures = 0
            while True:
                error: TreadlinkError
                try:
                    for chunk in self._chunks(stop):
                        failures = 0
                        yield chunk
                    return
                except LinkLostError as lost:
                    error = lost
                lost_ns = self._clock.now_ns()
                self._drop()
                yield self._event(LinkEventKind.LOST, _sentence(error))
                reason = ""
                while True:
                    failures += 1
                    self.state = LinkState.WAITING
                    due_ns = self._clock.now_ns() + self._backoff.pause_ns(failures)
                    if not wait_until(self._clock, due_ns, stop, self._closed):
                        return
                    try:
                        if not self._open(stop):
                            return
                        break
                    except SourceError as refused:
                        if str(refused) != reason:
                            reason = str(refused)
                            text = f"{_sentence(refused)} Retrying every {self._backoff.cap_ns * 1e-9:g} s or less."
                            yield self._event(LinkEventKind.RETRYING, text)
                away_s = (self._clock.now_ns() - lost_ns) * 1e-9
                yield self._event(LinkEventKind.RESTORED, f"{self._name} is back after {away_s:.1f} s")
        finally:
            self._drop()
            self.state = LinkState.CLOSED if self._closed.is_set() else LinkState.IDLE

    def close(self) -> None:
        """Release the port. A read or an opening under way in another thread ends and releases it there."""
        self._closed.set()
        if self._using.acquire(timeout=2 * READ_TIMEOUT_S):
            try:
                self._drop()
                self.state = LinkState.CLOSED
            finally:
                self._using.release()

    def _chunks(self, stop: threading.Event) -> Iterator[LinkItem]:
        while not stop.is_set():
            with self._using:
                if self._closed.is_set() or self._current is None:
                    return
                data = self._current.read(READ_TIMEOUT_S)
            if data:
                yield Chunk(self._name, self._clock.now_ns(), data)

    def _open(self, stop: threading.Event) -> bool:
        """Open a fresh connection; False when stopped or closed meanwhile. Opening may block, stopping must not."""
        if stop.is_set() or self._closed.is_set():
            return False
        self.state = LinkState.OPENING
        attempt = _Attempt(self._make_link())
        while not attempt.done.wait(READ_TIMEOUT_S):
            if stop.is_set() or self._closed.is_set():
                break
        link = attempt.take()
        if link is None:
            return False
        with self._using:
            self._current = link
        self.state = LinkState.CONNECTED
        return True

    def _drop(self) -> None:
        current, self._current = self._current, None
        if current is not None:
            current.close()

    def _event(self, kind: LinkEventKind, text: str) -> LinkEvent:
        return LinkEvent(self._name, self._clock.now_ns(), kind, text)


class _Attempt:
    """Opens a link in a thread of its own, which closes it again when nobody waits for it any more."""

    def __init__(self, link: Link) -> None:
        self.done = threading.Event()
        self._link = link
        self._lock = threading.Lock()
        self._abandoned = False
        self._error: Exception | None = None
        threading.Thread(target=self._run, name="open-link", daemon=True).start()

    def _run(self) -> None:
        try:
            self._link.open()
        except Exception as error:  # handed to the thread that waits, which raises it
            self._error = error
        with self._lock:
            self.done.set()
            if self._abandoned:
                self._link.close()

    def take(self) -> Link | None:
        """Return the open link, None when it is not open yet; then it will be closed.

        Raises:
            SourceError: it could not be opened.
        """
        with self._lock:
            if not self.done.is_set():
                self._abandoned = True
                return None
        if self._error is not None:
            with contextlib.suppress(Exception):
                self._link.close()
            raise self._error
        return self._link


def _sentence(error: TreadlinkError) -> str:
    return f"{error}. {error.remedy}".strip()
