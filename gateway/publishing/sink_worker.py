"""Thread of one live output: a bounded buffer before it, reconnection behind it, and its counts."""

import logging
import threading
from contextlib import suppress
from typing import Final

from gateway.core.clock import Clock
from gateway.core.estimates.results import SinkSnapshot, SinkState
from gateway.core.links.reconnect import Backoff, BriefConnections
from gateway.core.reasons import CoreCode, Reason
from gateway.core.session.bounded_buffer import Buffer
from gateway.core.text.wording import text
from gateway.publishing.reasons import PublishingCode
from gateway.publishing.sink import (
    Item,
    PublishedAlarm,
    PublishedRevolution,
    PublishedState,
    Sink,
    SinkDownError,
    SinkEndedError,
    SinkRefusedError,
)

_logger = logging.getLogger(__name__)

MAX_ITEMS: Final = 8192
"""Revolutions and alarms that wait for a slow receiver: three minutes of four wheels at motorway speed."""
# Memory of a revolution without its waveforms, with a margin.
_ITEM_BYTES: Final = 8192
_MAX_BYTES: Final = MAX_ITEMS * (_ITEM_BYTES + 512)
# Revolutions leave this share of the buffer to alarms.
_REVOLUTIONS_SHARE: Final = 0.95
_IDLE_S: Final = 0.1
# With a backlog, states come this often; without one, as they are offered.
_STATE_INTERVAL_NS: Final = 1_000_000_000
_STALL_NS: Final = 1_000_000_000
_DROP_SHOWN_NS: Final = 10_000_000_000
BACKOFF: Final = Backoff(first_ns=250_000_000, cap_ns=10_000_000_000)
"""Pauses between attempts to reach a receiver."""


class SinkWorker:
    """Runs a sink in a thread of its own."""

    def __init__(
        self,
        name: str,
        sink: Sink,
        clock: Clock,
        *,
        max_items: int = MAX_ITEMS,
        state_interval_s: float = 1.0,
        alarms_only: bool = False,
    ) -> None:
        """Prepare the output; `start` runs it.

        Args:
            name: for views.
            sink: used by this worker only.
            clock: for the age of states, and the pauses between attempts.
            max_items: size of the buffer.
            state_interval_s: time from one state to the next.
            alarms_only: whether revolutions are left out.
        """
        self._alarms_only = alarms_only
        self._state_interval_ns = int(state_interval_s * 1e9)
        self._state_due_ns = 0
        self.name = name
        self._sink = sink
        self._clock = clock
        self._buffer: Buffer[Item] = Buffer(max_items, _MAX_BYTES)
        self._state: PublishedState | None = None
        self._state_sent_ns = clock.now_ns()
        self._ending = threading.Event()
        self._stop = threading.Event()
        self._lock = threading.Lock()
        self._phase = SinkState.CONNECTING
        self._note = Reason(PublishingCode.SINK_CONNECTING)
        self._since_ns = clock.now_ns()
        self._sending_since_ns: int | None = None
        self._blocked_since_ns: int | None = None
        self._published = 0
        self._lost = 0
        self._refusal: Reason | None = None
        self._seen_dropped = self._seen_full = 0
        self._dropped_at_ns: int | None = None
        self._drop_note = Reason(PublishingCode.SINK_FULL)
        self._pending_item: Item | None = None
        self._failures = 0
        self._brief = BriefConnections(BACKOFF)
        self._thread = threading.Thread(target=self._run, name=f"publish {name}", daemon=True)

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    # For the session: none of these blocks

    def offer(self, item: Item) -> None:
        """Append an item; it is dropped and counted when the buffer is full, and a state replaces the last one."""
        if isinstance(item, PublishedState):
            with self._lock:
                self._state = item
            return
        if self._alarms_only and isinstance(item, PublishedRevolution):
            return
        if self._phase is SinkState.ENDED:
            with self._lock:
                self._lost += 1
            return
        share = _REVOLUTIONS_SHARE if isinstance(item, PublishedRevolution) else 1.0
        self._buffer.put(item, _ITEM_BYTES, below=share)

    def wants_state(self, now_ns: int) -> bool:
        """Return whether it is time for the next state; the session asks with every one that it has."""
        if now_ns < self._state_due_ns:
            return False
        self._state_due_ns = now_ns + self._state_interval_ns
        return True

    def snapshot(self) -> SinkSnapshot:
        """Return the present health."""
        now_ns = self._clock.now_ns()
        with self._lock:
            phase, note, since_ns, sending_ns = self._phase, self._note, self._since_ns, self._sending_since_ns
            published, lost, pending, refusal = self._published, self._lost, self._pending_item, self._refusal
        full = self._buffer.dropped
        dropped = lost + full
        if phase is SinkState.UP and sending_ns is not None and now_ns - sending_ns >= _STALL_NS:
            phase, note, since_ns = SinkState.STALLED, Reason(PublishingCode.SINK_STALLED), sending_ns
        if dropped > self._seen_dropped:
            is_full = full > self._seen_full
            self._drop_note = Reason(PublishingCode.SINK_FULL) if is_full or refusal is None else refusal
            self._seen_dropped, self._seen_full, self._dropped_at_ns = dropped, full, now_ns
        is_dropping = (
            phase is not SinkState.ENDED
            and self._dropped_at_ns is not None
            and now_ns - self._dropped_at_ns < _DROP_SHOWN_NS
        )
        if is_dropping and phase is SinkState.UP:
            note = self._drop_note
        away_s = 0.0 if phase is SinkState.UP else (now_ns - since_ns) * 1e-9
        waiting = len(self._buffer) + _counts(pending)
        return SinkSnapshot(self.name, phase, note, published, dropped, waiting, away_s, is_dropping)

    @property
    def has_ended(self) -> bool:
        """Whether the receiver has left for good."""
        return self._phase is SinkState.ENDED

    @property
    def is_left(self) -> bool:
        """Whether the output ended while its receiver was away or took nothing, or its receiver refused items."""
        return self._note.code not in (CoreCode.SINK_CLOSED, PublishingCode.SINK_ENDED)

    # Life cycle

    def finish(self) -> None:
        """Ask the thread to end when everything is sent."""
        self._ending.set()

    def abandon(self) -> None:
        """Ask the thread to end at once; what waits is dropped."""
        self._stop.set()
        self._ending.set()

    def join(self, timeout_s: float) -> bool:
        """Wait for the thread; return whether it has ended."""
        self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def progress(self) -> tuple[int, int]:
        """Return numbers that change as long as the receiver takes items."""
        return self._published, self._lost

    def discard(self) -> None:
        """Count what waits as dropped, after the thread has ended or was abandoned."""
        while self._buffer.get() is not None:
            with self._lock:
                self._lost += 1
        with self._lock:
            self._lost += _counts(self._pending_item)
            self._pending_item = None

    # The thread

    def _run(self) -> None:
        try:
            while not self._stop.is_set():
                try:
                    self._connect()
                    self._serve()
                    break
                except SinkDownError as error:
                    if self._phase is SinkState.UP:
                        self._failures = self._brief.lost(self._clock.now_ns())
                    self._back_off(Reason(PublishingCode.SINK_LOST, error=str(error), interval_s=BACKOFF.cap_ns * 1e-9))
                except SinkEndedError:
                    self._enter(SinkState.ENDED, Reason(PublishingCode.SINK_ENDED))
                    _logger.info("%s: the reader has closed its end", self.name)
                    break
                except Exception as error:
                    # A fault of an output must end neither the session nor the output; the item may be its cause.
                    _logger.debug("%s failed", self.name, exc_info=error)
                    with self._lock:
                        self._lost += _counts(self._pending_item)
                        self._pending_item = None
                    self._back_off(Reason(PublishingCode.SINK_FAULT, error=repr(error)))
        finally:
            self._settle()

    def _settle(self) -> None:
        """Count what was sent but never confirmed as dropped, and release the receiver."""
        self._stop.set()
        with suppress(Exception):
            unconfirmed = self._sink.flush(self._stop)
            with self._lock:
                self._published -= unconfirmed
                self._lost += unconfirmed
        with suppress(Exception):
            self._sink.close()

    def _connect(self) -> None:
        if self._phase is not SinkState.DOWN:
            self._enter(SinkState.CONNECTING, Reason(PublishingCode.SINK_CONNECTING))
        self._sink.open(self._stop)
        self._failures = 0
        self._brief.opened(self._clock.now_ns())
        self._enter(SinkState.UP, Reason(PublishingCode.SINK_CONNECTED))
        _logger.info("%s: publishing", self.name)

    def _serve(self) -> None:
        """Send items until the session ends and nothing waits."""
        while not self._stop.is_set():
            try:
                if self._serve_once():
                    return
            except SinkRefusedError as error:
                self._refused(error)

    def _serve_once(self) -> bool:
        """Send the next item, or do what there is to do without one; return whether the session has ended."""
        is_ending = self._ending.is_set()
        if self._pending_item is None:
            self._pending_item = self._next()
        item = self._pending_item
        if item is not None:
            self._send(item)
        elif is_ending and self._state is None:
            self._sink.flush(self._stop)
            self._enter(SinkState.UP, self._refusal or Reason(CoreCode.SINK_CLOSED))
            return True
        else:
            self._sink.poll()
        return False

    def _refused(self, error: SinkRefusedError) -> None:
        """Count items that the receiver refused as dropped."""
        if self._refusal is None:
            _logger.info("%s: %s", self.name, error)
        with self._lock:
            self._refusal = Reason(PublishingCode.SINK_REFUSED, error=str(error))
            self._published -= error.count
            self._lost += error.count

    def _next(self) -> Item | None:
        """Return a state when nothing waits before it, or when one is due in spite of that, else the oldest item."""
        state, now_ns = self._state, self._clock.now_ns()
        is_due = now_ns - self._state_sent_ns >= _STATE_INTERVAL_NS
        if state is not None and (not self._buffer or (is_due and not state.snapshot.ended)):
            self._state_sent_ns = now_ns
            with self._lock:
                # A state that has come meanwhile is the next one.
                self._state = None if self._state is state else self._state
            return state
        return self._buffer.get(0.0 if self._ending.is_set() else _IDLE_S)

    def _send(self, item: Item) -> None:
        began_ns = self._clock.now_ns()
        with self._lock:
            self._sending_since_ns = began_ns
        try:
            self._sink.send(item, self._stop)
        except SinkDownError:
            self._blocked_since_ns = began_ns
            raise
        finally:
            with self._lock:
                self._sending_since_ns = None
        with self._lock:
            self._published += _counts(item)
            self._pending_item = None

    def _back_off(self, note: Reason) -> None:
        """Close the output and wait before the next attempt."""
        _logger.info("%s: %s", self.name, text(note))
        with suppress(Exception):
            self._sink.close()
        if isinstance(self._pending_item, PublishedState) and not self._pending_item.snapshot.ended:
            self._pending_item = None
        self._failures += 1
        self._enter(SinkState.DOWN, note)
        pause_ns = BACKOFF.pause_ns(1 if self._ending.is_set() else self._failures)
        self._clock.sleep_until_ns(self._clock.now_ns() + pause_ns, self._stop)

    def _enter(self, phase: SinkState, note: Reason) -> None:
        with self._lock:
            if self._phase is SinkState.UP and phase is not SinkState.UP:
                # A receiver that stalled before it was lost has been away since then.
                self._since_ns = self._blocked_since_ns or self._clock.now_ns()
            self._blocked_since_ns = None
            self._phase, self._note = phase, note


def _counts(item: Item | None) -> int:
    """Return 1 for an item that is counted: a revolution or an alarm."""
    return int(isinstance(item, PublishedRevolution | PublishedAlarm))
