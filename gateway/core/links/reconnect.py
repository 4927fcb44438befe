"""Links that are opened again whenever they break, with an event for each change."""

import contextlib
import logging
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import Enum, auto
from typing import Final, Protocol

from gateway.core.clock import Clock, wait_until
from gateway.core.errors import LinkLostError, SourceError, TreadlinkError
from gateway.core.links.reasons import LinkCode
from gateway.core.links.source import Chunk, LinkEvent, LinkEventKind, LinkItem
from gateway.core.reasons import Reason

READ_TIMEOUT_S: Final = 0.05
_LONGEST_SILENCE_S: Final = 60.0
_MAX_MUTE_OPENINGS: Final = 2
# Less than a terminal holds: a read that brings more is followed by the next at once.
_TERMINAL_BYTES: Final = 4095

_logger = logging.getLogger(__name__)


class Link(Protocol):
    """One connection, used once: opened, read until it breaks, closed."""

    def open(self) -> None:
        """Connect.

        Raises:
            SourceError: it cannot be opened now; message and remedy say why.
        """
        ...

    def read(self, timeout_s: float) -> bytes:
        """Return the bytes that have arrived, or wait for the first; empty after `timeout_s`.

        Raises:
            LinkLostError: the connection broke.
        """
        ...

    def write(self, data: bytes) -> None:
        """Write a frame to the hub; callable from any thread.

        Raises:
            LinkLostError: the connection broke.
            SourceError: the hub takes no data.
        """
        ...

    def close(self) -> None:
        """Disconnect; may be called at any time and twice, never raises."""
        ...


class LinkState(Enum):
    """State of a reconnecting source."""

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


class BriefConnections:
    """Connections in a row that broke within the longest pause: their peer is tried less and less often.

    A peer that lets everyone in, and out again at once, must not fill recordings and logs with its events.
    """

    def __init__(self, backoff: Backoff) -> None:
        """Take the pauses that the attempts keep."""
        self._cap_ns = backoff.cap_ns
        self._opened_ns = self._count = 0

    def opened(self, now_ns: int) -> None:
        """Note that a connection was set up."""
        self._opened_ns = now_ns

    def lost(self, now_ns: int) -> int:
        """Note that it broke; return how many before it broke as soon."""
        self._count = self._count + 1 if now_ns - self._opened_ns < self._cap_ns else 0
        return max(0, self._count - 1)


class ReconnectingSource:
    """A source over a link: chunks with arrival times, events of the link, unlimited retries.

    Only the first opening may fail: a port that was never there is a mistake, one that disappeared is an event.

    Attributes:
        rate_hz: sampling rate to set on the hub, None to leave it.
        gather_s: time between a read and the next one. One that follows at once has few bytes, and wakes everything
            behind it for them.
    """

    vehicle_toml: str | None = None

    def __init__(
        self,
        link: str,
        make_link: Callable[[], Link],
        clock: Clock,
        *,
        rate_hz: float | None = None,
        silence_s: float = 0.0,
    ) -> None:
        """Name the link; nothing is opened yet.

        Args:
            link: name in chunks and events.
            make_link: makes a new connection for every attempt.
            clock: stamps arrivals and paces the attempts.
            rate_hz: sampling rate to set on the hub, None to leave it.
            silence_s: a connection without a byte for this long counts as lost; 0 for never. After openings that
                bring no byte it doubles up to a minute, for hubs that take long to start.
        """
        self._silence_s = silence_s
        # Openings since the last byte.
        self._heard_ns = self._mute_openings = 0
        self.rate_hz = rate_hz
        self.gather_s = 0.02
        self._name = link
        self._make_link = make_link
        self._clock = clock
        self._backoff = Backoff()
        self._brief_connections = BriefConnections(self._backoff)
        self._closed = threading.Event()
        self._link_lock = threading.Lock()
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
            _logger.info("%s is open", self._name)
            yield self._event(LinkEventKind.CONNECTED)
            while True:
                error: LinkLostError
                try:
                    yield from self._chunks(stop)
                    return
                except LinkLostError as lost:
                    error = lost
                _logger.info("%s lost: %s", self._name, error)
                lost_ns = self._clock.now_ns()
                self._drop()
                yield self._event(LinkEventKind.LOST, _message(error))
                first: list[LinkItem] = []
                yield from self._retries(stop, error, first)
                if self._current is None:
                    return
                away_s = (self._clock.now_ns() - lost_ns) * 1e-9
                _logger.info("%s is open again after %.1f s", self._name, away_s)
                yield self._event(LinkEventKind.RESTORED, details=(Reason(LinkCode.LINK_AWAY, away_s=away_s),))
                yield from first
        finally:
            self._drop()
            self.state = LinkState.CLOSED if self._closed.is_set() else LinkState.IDLE

    def _retries(self, stop: threading.Event, lost: LinkLostError, first: list[LinkItem]) -> Iterator[LinkEvent]:
        """Open the link again; yield an event for each new cause of a failure.

        A peer that twice accepted and then closed, or said nothing, is not back before it brings data, which goes to
        `first`.
        """
        needs_data = self._mute_openings >= _MAX_MUTE_OPENINGS
        reported_cause: int | str | None = lost.cause if needs_data else None
        failures = max(self._mute_openings, self._brief_connections.lost(self._clock.now_ns()))
        while True:
            failures += 1
            self.state = LinkState.WAITING
            due_ns = self._clock.now_ns() + self._backoff.pause_ns(failures)
            if not wait_until(self._clock, due_ns, stop, self._closed):
                return
            try:
                if self._open(stop) and needs_data:
                    first += self._first_items(stop, failures)
                return
            except (SourceError, LinkLostError) as refused:
                self._drop()
                if refused.cause != reported_cause:
                    reported_cause = refused.cause
                    interval = Reason(LinkCode.RETRY_INTERVAL, interval_s=self._backoff.cap_ns * 1e-9)
                    yield self._event(LinkEventKind.RETRYING, _message(refused), (interval,))
                _logger.debug("%s: attempt %d failed: %s", self._name, failures, refused)

    def _first_items(self, stop: threading.Event, failures: int) -> list[LinkItem]:
        """Return what a link brings first; nothing when stopped or closed before.

        Raises:
            LinkLostError: it was lost before, or is silent.
        """
        silence_s = min(self._silence_s * 2 ** min(failures - 1, 20), max(self._silence_s, _LONGEST_SILENCE_S))
        return next(filter(None, self._arrivals(stop, silence_s)), [])

    def send(self, data: bytes) -> None:
        """Write a frame to the hub; callable from any thread.

        Raises:
            LinkLostError: it is not connected, or the write failed.
            SourceError: the hub takes no data.
        """
        link = self._current
        if link is None:
            raise LinkLostError(f"{self.link} is not connected")
        link.write(data)

    def close(self) -> None:
        """Release the port. A read or an opening in progress in another thread ends and releases it there."""
        self._closed.set()
        if self._link_lock.acquire(timeout=2 * READ_TIMEOUT_S):
            try:
                self._drop()
                self.state = LinkState.CLOSED
            finally:
                self._link_lock.release()

    def _chunks(self, stop: threading.Event) -> Iterator[LinkItem]:
        for items in self._arrivals(stop, self._silence_s):
            yield from items

    def _arrivals(self, stop: threading.Event, silence_s: float) -> Iterator[list[LinkItem]]:
        """Yield what each read of the link has brought, nothing included, until stopped or closed.

        Raises:
            LinkLostError: the connection broke, or brought nothing for `silence_s`.
        """
        while not stop.is_set():
            with self._link_lock:
                if self._closed.is_set() or self._current is None:
                    return
                data = self._current.read(READ_TIMEOUT_S)
            if data:
                self._heard_ns, self._mute_openings = self._clock.now_ns(), 0
            elif 0.0 < silence_s <= (self._clock.now_ns() - self._heard_ns) * 1e-9:
                raise LinkLostError(
                    f"{self._name} is connected, but silent for {silence_s:g} s",
                    "Does its firmware hang, or does another program have it? Connecting again.",
                    cause="silent",
                )
            yield self._items_of(data)
            if 0 < len(data) < _TERMINAL_BYTES:
                stop.wait(self.gather_s)

    def _items_of(self, data: bytes) -> list[LinkItem]:
        """Return the items of a read."""
        return [Chunk(self._name, self._heard_ns, data)] if data else []

    def _open(self, stop: threading.Event) -> bool:
        """Open a new connection; False when stopped or closed meanwhile. Opening may block, stopping must not."""
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
        with self._link_lock:
            self._current = link
        self._heard_ns = self._clock.now_ns()
        self._brief_connections.opened(self._heard_ns)
        self._mute_openings += 1
        self.state = LinkState.CONNECTED
        return True

    def _drop(self) -> None:
        current, self._current = self._current, None
        if current is not None:
            current.close()

    def _event(self, kind: LinkEventKind, text: str = "", details: tuple[Reason, ...] = ()) -> LinkEvent:
        return LinkEvent(self._name, self._clock.now_ns(), kind, text, details=details)


class _Attempt:
    """Opening of a link in a thread of its own, which closes it again when the caller has given up."""

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
        except Exception as error:  # raised by the waiting thread in `take`
            self._error = error
        with self._lock:
            self.done.set()
            if self._abandoned:
                self._link.close()

    def take(self) -> Link | None:
        """Return the open link, or None when it is not open yet; it is then closed once it opens.

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


def _message(error: TreadlinkError) -> str:
    return f"{error}. {error.remedy}".strip()
