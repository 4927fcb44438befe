"""A running session: a reader thread per source, one for the recording, one for the core, snapshots for the view."""

from __future__ import annotations

import threading
from collections import Counter, deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Final

from gateway.clock import Clock
from gateway.errors import TreadlinkError
from gateway.io.source import Chunk, LinkEvent, LinkEventKind, LinkItem, Source
from gateway.pipeline.results import RevolutionResult, SessionSnapshot
from gateway.session.bounded_buffer import Buffer
from gateway.session.core import SessionCore
from gateway.session.recording_stage import RecordingStage
from gateway.views.session_summary import ResultSummary

# Between the readers and the core: half a minute and more of any link.
_QUEUE_ITEMS: Final = 8192
_QUEUE_BYTES: Final = 32 << 20
# Results that a view has not fetched yet; the oldest are dropped and counted.
_RESULT_ITEMS: Final = 8192
_SNAPSHOT_EVERY_NS: Final = 100_000_000
_IDLE_S: Final = 0.05
_JOIN_S: Final = 5.0


class LiveSession:
    """Runs sources through a `SessionCore` in the background.

    Every item goes to the recording first, then to the core, each with a bounded queue and a thread of its own: neither
    a slow disk nor a slow estimator nor a view that fetches nothing holds up the others. A device cannot wait, so a
    chunk that finds a queue full is dropped there and counted by stage; a recording or the simulator can, so it waits.
    Any thread that fails ends the session, and `check` raises its error.
    """

    def __init__(
        self,
        sources: Sequence[Source],
        core: SessionCore,
        clock: Clock,
        *,
        patient: Sequence[bool],
        summary: ResultSummary,
    ) -> None:
        """Prepare; `start` runs.

        Args:
            sources: opened sources.
            core: the synchronous session.
            clock: for snapshots' elapsed time and flushing.
            patient: per source, True when it can wait for a full queue.
            summary: adds up every result, also those that no view fetched.
        """
        self._sources = list(sources)
        self._patient = list(patient)
        self._core = core
        self._summary = summary
        self._clock = clock
        self._stop = threading.Event()
        self._done = threading.Event()
        self._items: Buffer[LinkItem] = Buffer(_QUEUE_ITEMS, _QUEUE_BYTES)
        self._results: deque[RevolutionResult] = deque(maxlen=_RESULT_ITEMS)
        self._results_lost = 0
        self._notices: deque[str] = deque(core.snapshot(0.0).notices, maxlen=_RESULT_ITEMS)
        self._dropped: dict[str, Counter[str]] = {source.link: Counter() for source in sources}
        self._failure: BaseException | None = None
        self._reading = len(self._sources)
        self._lock = threading.Lock()
        self._start_ns = clock.now_ns()
        self._recording: RecordingStage | None = None
        if core.recorder is not None:
            self._recording = core.recorder = RecordingStage(core.recorder, clock, self._fail)
            core.records_items = False
        core.on_result = self._take_result
        core.on_notice = self._notices.append
        for source in self._sources:
            core.add_link(source.link)
        self._snapshot = core.snapshot(0.0)
        self._threads = [
            threading.Thread(target=self._guard, args=(self._read, source, patient), name=f"read {source.link}")
            for source, patient in zip(self._sources, self._patient, strict=True)
        ]
        self._threads.append(threading.Thread(target=self._guard, args=(self._run,), name="session"))

    def start(self) -> None:
        """Begin reading."""
        for thread in self._threads:
            thread.daemon = True
            thread.start()

    # what views use

    def snapshot(self) -> SessionSnapshot:
        """Return the latest snapshot, made ten times a second."""
        return self._snapshot

    def mark(self, text: str) -> None:
        """Mark an event in the recording, with the time of now."""
        event = LinkEvent("user", self._clock.now_ns(), LinkEventKind.MARK, text)
        self._offer(event, False, self._dropped[self._sources[0].link])

    def request_stop(self) -> None:
        """Ask the sources to end; what they delivered is still processed."""
        self._stop.set()

    def results(self) -> list[RevolutionResult]:
        """Take the results that came since the last call."""
        taken: list[RevolutionResult] = []
        with suppress(IndexError):
            while True:
                taken.append(self._results.popleft())
        return taken

    def notices(self) -> list[str]:
        """Take the notices that came since the last call."""
        taken: list[str] = []
        with suppress(IndexError):
            while True:
                taken.append(self._notices.popleft())
        return taken

    # life

    def wait(self, timeout_s: float) -> bool:
        """Wait for the end of the session; True when it has ended."""
        return self._done.wait(timeout_s)

    def close(self) -> SessionSnapshot:
        """Stop, process what was delivered, finish the recording and return the last snapshot.

        Raises:
            TreadlinkError: a source or the session failed.
        """
        self._stop.set()
        self._done.wait(_JOIN_S)
        for source in self._sources:
            source.close()
        waiting = -1
        # What arrived is worth waiting for as long as it gets less, or the disk takes it.
        while not self._done.wait(_JOIN_S) and (len(self._items) != waiting or self._is_recording_ending()):
            waiting = len(self._items)
        for thread in self._threads:
            if thread.ident is not None:
                thread.join(_JOIN_S if self._done.is_set() else 0.0)
        self.check()
        return self._snapshot

    def check(self) -> None:
        """Raise what a background thread failed of, if one did."""
        failure = self._failure
        if isinstance(failure, TreadlinkError):
            raise failure
        if failure is not None:
            raise TreadlinkError(
                f"the session ended by an internal error: {failure!r}",
                "Please report it with the recording; what was recorded so far is safe.",
            ) from failure

    def _is_recording_ending(self) -> bool:
        return self._recording is not None and self._recording.ending

    def _guard(self, target: Callable[..., None], *arguments: object) -> None:
        try:
            target(*arguments)
        except BaseException as error:
            self._fail(error)
            if target == self._run:
                self._save_recording()
                self._done.set()

    def _fail(self, error: BaseException) -> None:
        """End the session for this reason, unless it ends for another already."""
        if self._failure is None:
            self._failure = error
        self._stop.set()

    def _save_recording(self) -> None:
        """Finish the recording though the core has failed: what arrived is worth as much as ever."""
        if self._recording is not None:
            with suppress(TreadlinkError):  # the failure of the core is the one to be told
                self._recording.close()

    def _read(self, source: Source, patient: bool) -> None:
        dropped = self._dropped[source.link]
        try:
            for item in source.items(self._stop):
                self._offer(item, patient, dropped)
        finally:
            with self._lock:
                self._reading -= 1

    def _offer(self, item: LinkItem, patient: bool, dropped: Counter[str]) -> None:
        """Hand an item to the recording, then to the core; what is no chunk of a device may wait for room."""
        is_chunk = isinstance(item, Chunk)
        size = len(item.data) if isinstance(item, Chunk) else len(item.text)
        recording = self._recording
        if recording is not None and not self._hand_over(
            lambda timeout_s: recording.offer(item, timeout_s=timeout_s), patient or not is_chunk
        ):
            dropped["recording"] += 1
        if not self._hand_over(
            lambda timeout_s: self._items.put(item, size, timeout_s=timeout_s), patient or not is_chunk
        ):
            dropped["decoding"] += 1

    def _hand_over(self, put: Callable[[float], bool], patient: bool) -> bool:
        if put(0.0):
            return True
        while patient and not self._stop.is_set():
            if put(_IDLE_S):
                return True
        return False

    def _run(self) -> None:
        due_ns = 0
        while True:
            item = self._items.get(_IDLE_S)
            if item is not None:
                self._core.take(item)
            else:
                with self._lock:
                    reading = self._reading
                if not reading and not self._items:
                    break
            now_ns = self._clock.now_ns()
            if now_ns >= due_ns:
                due_ns = now_ns + _SNAPSHOT_EVERY_NS
                self._core.tick(now_ns)
                self._publish(now_ns, ended=False)
        self._core.finish()
        self._publish(self._clock.now_ns(), ended=True)
        self._done.set()

    def _take_result(self, result: RevolutionResult) -> None:
        self._summary.add(result)
        if len(self._results) == _RESULT_ITEMS:
            self._results_lost += 1
        self._results.append(result)

    def _publish(self, now_ns: int, *, ended: bool) -> None:
        # What concerns no link in particular is counted with the first.
        first = self._dropped[self._sources[0].link]
        if self._results_lost:
            first["view"] = self._results_lost
        if self._recording is not None and self._recording.topics_dropped:
            first["recorded topics"] = self._recording.topics_dropped
        for link, stages in self._dropped.items():
            if stages:
                self._core.dropped(link, dict(stages))
        self._snapshot = self._core.snapshot((now_ns - self._start_ns) * 1e-9, ended=ended)
