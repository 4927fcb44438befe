"""A running session: a reader thread per source, one for the recording, one for the core, snapshots for the view."""

import logging
import threading
from collections import Counter, deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Final, NamedTuple, TypeVar

from gateway.core.clock import Clock
from gateway.core.errors import RecordingError, TreadlinkError
from gateway.core.estimates.results import Alarm, RevolutionResult, SessionSnapshot
from gateway.core.links.playback import Playback, PlayedSource
from gateway.core.links.reasons import LinkCode
from gateway.core.links.source import BusFrames, LinkEvent, LinkEventKind, LinkItem, Sentences, Source, is_time
from gateway.core.reasons import Level, Notice, Reason
from gateway.core.recording.run_description import NO_DESCRIPTION, RunDescription, filled_in, form_of
from gateway.core.session.alarms import AlarmName
from gateway.core.session.bounded_buffer import Buffer
from gateway.core.session.computer_watch import ComputerWatch
from gateway.core.session.core import SHOWN_NOTICES, SessionCore
from gateway.core.session.core_watch import LOOK_S, CoreWatch
from gateway.core.session.lateness import LatenessWatch
from gateway.core.session.publication import Publication
from gateway.core.session.reasons import SessionCode
from gateway.core.session.recording_stage import Recorder, RecordingStage, Stage, disk_watch_of
from gateway.core.session.session_parts import LinkServer
from gateway.core.session.supervisor import Supervisor
from gateway.core.shown_units import ShownUnits
from gateway.core.text.session_summary import ResultSummary

_logger = logging.getLogger(__name__)
_Item = TypeVar("_Item")

_NO_FORM: Final[Mapping[str, str]] = {}
# Between the readers and the core: half a minute or more of any link.
_QUEUE_ITEMS: Final = 8192
_QUEUE_BYTES: Final = 32 << 20
# Results and notices that a view has not fetched yet; the oldest are dropped, and dropped results counted.
_RESULT_ITEMS: Final = 8192
_SNAPSHOT_INTERVAL_NS: Final = 100_000_000
_IDLE_S: Final = 0.05
_JOIN_S: Final = 5.0
# A source that can wait for the core does not wait longer.
_GIVEN_UP_S: Final = 20.0


class Recordings(NamedTuple):
    """Recordings of a session.

    Attributes:
        recorder: an open recording, closed at the end; None without one.
        begin: opens a new recording for `start_recording`; None when none may be begun.
        run: description of the run, until a form states another.
    """

    recorder: Recorder | None = None
    begin: Callable[[RunDescription], Recorder] | None = None
    run: RunDescription = NO_DESCRIPTION


_NO_RECORDINGS: Final = Recordings()


class LiveSession:
    """Runs sources through a `SessionCore` in the background.

    Every item goes to the recording first, then to the core, each with a bounded queue and a thread of its own, so that
    neither a slow disk nor a slow estimator nor a view that fetches nothing delays the others. A device cannot wait: a
    chunk that finds a queue full is dropped there and counted by stage. A recording and the simulator can wait, and do.
    A thread that fails ends the session, and `check` raises its error.

    Attributes:
        core: the synchronous session; only the session's own thread calls it after `start`.
        summary: of every result, also of those that no view fetched.
    """

    def __init__(
        self,
        sources: Sequence[Source],
        core: SessionCore,
        clock: Clock,
        *,
        patient: Sequence[bool],
        recordings: Recordings = _NO_RECORDINGS,
        publication: Publication | None = None,
        control: LinkServer | None = None,
        supervisor: Supervisor | None = None,
    ) -> None:
        """Build the session; `start` runs it.

        Args:
            sources: opened sources.
            core: new, without a recorder.
            clock: for the elapsed time of snapshots and for flushing.
            patient: per source, True when it can wait for a full queue.
            recordings: the open one and further ones.
            publication: live outputs; the caller closes them after the session.
            control: serves the links to other commands; the session closes it.
            supervisor: sees threads that were started before; the session closes it. None for one of its own.
        """
        self._control = control
        self._publication = publication
        self._sources = list(sources)
        self._patient = list(patient)
        # Chunks of a device come a hundred times a second. Taken together a few times less often, they find the code
        # and data of the last ones still in the processor's cache.
        self._round_s = core.latency.round_s
        self.summary = ResultSummary()
        self._clock = clock
        self._stop = threading.Event()
        self._done = threading.Event()
        self._acknowledged = threading.Event()
        self._items: Buffer[LinkItem] = Buffer(_QUEUE_ITEMS, _QUEUE_BYTES)
        self._results: deque[RevolutionResult] = deque(maxlen=_RESULT_ITEMS)
        self._results_lost = 0
        # Set while results wait for a view, and at the end.
        self._has_results = threading.Event()
        self._notices: deque[Notice] = deque(maxlen=_RESULT_ITEMS)
        self._dropped: dict[str, Counter[Stage]] = {source.link: Counter() for source in sources}
        # Time of the first item of each link whose time is out of range.
        self._refused_ns: dict[str, int] = {}
        self._supervisor = supervisor or Supervisor()
        self._failure: BaseException | None = None
        self._start_ns = clock.now_ns()
        # Time of the clock that was spent in pauses, and the beginning of the present one.
        self._paused_ns = 0
        self._pause_began_ns: int | None = None
        # Source of each link; a recording has several.
        self._source_of: dict[str, int] = {source.link: number for number, source in enumerate(self._sources)}
        self._latest_ns: dict[int, int] = {}
        self._lateness = LatenessWatch()
        recorder, self._open_recorder, self._run_description = recordings
        self._recording = None if recorder is None else RecordingStage(recorder, clock, disk_watch_of(recorder))
        # Held while a recording is begun or ended; the core takes the change over in its next round.
        self._recording_lock = threading.Lock()
        self._core_recording = self._recording
        self._may_record = self._open_recorder is not None
        self.core = core
        core.records_to(self._recording)
        for source in self._sources:
            self.core.add_link(source.link)
        self._notices.extend(self.core.take_notices())
        self._snapshot = self.core.snapshot(0.0)
        self._readers = [
            threading.Thread(target=self._read, args=(number,), name=f"read {source.link}")
            for number, source in enumerate(self._sources)
        ]
        self._core_thread = threading.Thread(target=self._guarded, name="session")
        self._watch = CoreWatch(self._core_thread)
        self._rounds = 0
        # Set while the core is stuck and waiting for it is in vain.
        self._is_given_up = False
        self._threads = [
            *self._readers,
            self._core_thread,
            threading.Thread(target=self._watch_core, name="core watch"),
        ]

    def start(self) -> None:
        """Start reading."""
        _logger.info("session starts with %s", ", ".join(source.link for source in self._sources))
        for thread in self._threads:
            thread.daemon = True
            thread.start()

    # For views

    def snapshot(self) -> SessionSnapshot:
        """Return the latest snapshot, made ten times a second."""
        return self._snapshot

    def mark(self, text: str) -> bool:
        """Mark an event in the recording, with the present time; return whether one is written, which keeps it."""
        recording = self._recording
        is_recorded = recording is not None and recording.is_writing
        details = () if is_recorded else (Reason(LinkCode.MARK_NOT_KEPT),)
        event = LinkEvent("user", self._clock.now_ns(), LinkEventKind.MARK, text, details=details)
        if self._done.is_set():  # nobody takes it any more
            notices = (*self._snapshot.notices, Notice("", event.reason))
            self._snapshot = replace(self._snapshot, notices=notices[-SHOWN_NOTICES:])
        else:
            self._offer(event, False, self._dropped[self._sources[0].link])
        return is_recorded

    @property
    def may_record(self) -> bool:
        """Whether `start_recording` can begin a recording."""
        return self._may_record

    @property
    def run_form(self) -> dict[str, str]:
        """Fields of the form that describes the run, with what is stated."""
        return form_of(self._run_description)

    def start_recording(self, form: Mapping[str, str] = _NO_FORM) -> None:
        """Begin a recording now; does nothing while one runs. Its first item for each open link is the link's opening.

        Args:
            form: fields that describe the run, as `run_form` has them.

        Raises:
            TreadlinkError: no recording may be begun, the form is wrong, or the file cannot be made.
        """
        with self._recording_lock:
            if self._recording is not None and self._recording.is_writing:
                return
            if self._open_recorder is None or not self._may_record:
                raise RecordingError("this session begins no recording", "A replay is recorded already.")
            described = filled_in(self._run_description, form)
            self._close_recording()
            recorder = self._open_recorder(described)
            self._run_description = described
            stage = RecordingStage(recorder, self._clock, disk_watch_of(recorder))
            now_ns = self._clock.now_ns()
            for link in self._snapshot.links:
                if link.connected:
                    stage.offer(LinkEvent(link.link, now_ns, LinkEventKind.CONNECTED))
            self._recording = stage

    def stop_recording(self) -> None:
        """End the recording, if one runs, and wait until its file is finished.

        Raises:
            RecordingError: the disk refused, or makes no progress.
        """
        with self._recording_lock:
            self._close_recording()

    def _close_recording(self) -> None:
        stage, self._recording = self._recording, None
        if stage is not None:
            stage.close()

    def pause(self, paused: bool) -> bool:
        """Pause a session of replays, or let it go on; return whether that is possible.

        A hub cannot be paused: the session goes on.
        """
        played = self._playbacks()
        if len(played) < len(self._sources):
            return False
        now_ns = self._clock.now_ns()
        if paused and self._pause_began_ns is None:
            self._pause_began_ns = now_ns
        elif not paused and self._pause_began_ns is not None:
            self._paused_ns += now_ns - self._pause_began_ns
            self._pause_began_ns = None
        for playback in played.values():
            playback.pause(paused)
        return True

    def request_stop(self) -> None:
        """Ask the sources to end; items already delivered are still processed."""
        self._stop.set()

    def results(self) -> list[RevolutionResult]:
        """Return the results since the last call."""
        if not self._done.is_set():
            self._has_results.clear()
        return _drain(self._results)

    def notices(self) -> list[Notice]:
        """Return the notices since the last call."""
        return _drain(self._notices)

    def acknowledge(self) -> None:
        """Note that the user has seen the alarms that stand, at the session's next look."""
        self._acknowledged.set()

    def show_in(self, units: ShownUnits) -> None:
        """Have the screen and the pages show numbers in these units."""
        self.core.show_in(units)

    # Life cycle

    def wait(self, timeout_s: float) -> bool:
        """Wait for the end of the session; return whether it has ended."""
        return self._done.wait(timeout_s)

    def wait_for_results(self, timeout_s: float) -> bool:
        """Wait for results or the end of the session; return whether it has ended."""
        self._has_results.wait(timeout_s)
        return self._done.is_set()

    def close(self) -> SessionSnapshot:
        """Stop, process delivered items, finish the recording and return the last snapshot.

        Raises:
            TreadlinkError: a source or the session failed.
        """
        self._stop.set()
        if self._control is not None:
            self._control.close()
        self._done.wait(_JOIN_S)
        for source in self._sources:
            source.close()
        # Delivered items are worth waiting for; a core that is stuck is left by its watch.
        while not self._done.wait(_JOIN_S) and self._core_thread.is_alive():
            pass
        for thread in self._threads:
            if thread.ident is not None:
                thread.join(_JOIN_S if not self._watch.stuck_s else 0.0)
        _logger.info("session closed%s", "" if self._done.is_set() else " with items left")
        self._supervisor.close()
        self._take_thread_ends()
        self.check()
        return self._snapshot

    def check(self) -> None:
        """Raise the error of a background thread, if one failed."""
        failure = self._failure
        if isinstance(failure, TreadlinkError):
            raise failure
        if failure is not None:
            raise TreadlinkError(
                f"the session ended by an internal error: {failure!r}",
                "Please report it with the recording; what was recorded so far is safe.",
            ) from failure

    def _guarded(self) -> None:
        try:
            self._run()
        except BaseException as error:
            self._fail(error)
            self._save_recording()
            self._end()

    def _fail(self, error: BaseException) -> None:
        """End the session with this error, unless it ends with another already."""
        _logger.debug("a thread of the session failed", exc_info=error)
        self._failure = self._failure or error
        self._stop.set()

    def _take_thread_ends(self) -> None:
        """Report threads that an error has ended; the session goes on, and fails at its end."""
        for name, error in self._supervisor.take():
            self._failure = self._failure or error
            self.core.stopped(name, Reason(SessionCode.THREAD_STOPPED, error=repr(error)))

    def _save_recording(self) -> None:
        """Finish the recording although the core has failed; does nothing where the core has finished it."""
        if self._recording is not None:
            with suppress(Exception):  # the user needs the failure of the core
                self._recording.close()

    def _read(self, number: int) -> None:
        source, patient = self._sources[number], self._patient[number]
        dropped = self._dropped[source.link]
        try:
            for item in source.items(self._stop):
                self._source_of.setdefault(item.link, number)
                if is_time(item.host_ns):
                    self._offer(item, patient, dropped)
                else:
                    self._refuse(item)
        except TreadlinkError as error:  # it cannot be opened
            self._fail(error)
        except BaseException as error:
            # The other sources go on.
            event = LinkEvent(source.link, self._clock.now_ns(), LinkEventKind.LOST, f"internal error: {error!r}")
            self._offer(event, patient, dropped)
            raise

    def _refuse(self, item: LinkItem) -> None:
        """Count the frames of an item that has no time at which it could be recorded."""
        self._refused_ns.setdefault(item.link, item.host_ns)
        count = item.count if isinstance(item, BusFrames | Sentences) else 1
        self._dropped.setdefault(item.link, Counter())[Stage.TIMES] += count

    def _offer(self, item: LinkItem, patient: bool, dropped: Counter[Stage]) -> None:
        """Hand an item to the recording, then to the core; anything but a chunk of a device may wait for room."""
        is_chunk = not isinstance(item, LinkEvent)
        size = len(item.text) if isinstance(item, LinkEvent) else len(item.data)
        wake = not is_chunk or not self._round_s
        recording = self._recording
        tells_time = is_chunk and not size
        if (
            recording is not None
            and not tells_time
            and not self._hand_over(
                lambda timeout_s: recording.offer(item, timeout_s=timeout_s), patient or not is_chunk
            )
        ):
            dropped[Stage.RECORDING] += 1
        if not self._hand_over(
            lambda timeout_s: self._items.put(item, size, timeout_s=timeout_s, wake=wake),
            patient or not is_chunk,
        ):
            dropped[Stage.DECODING] += 1

    def _hand_over(self, put: Callable[[float], bool], patient: bool) -> bool:
        if put(0.0):
            return True
        while patient and not self._stop.is_set() and not self._is_given_up:
            if put(_IDLE_S):
                return True
        return False

    def _run(self) -> None:
        due_ns = 0
        computer = ComputerWatch(self._clock)
        # The times of recordings that are played are not of this computer.
        is_of_computer = len(self._playbacks()) < len(self._sources) or self._recording is not None
        while True:
            self._rounds += 1
            item = self._items.get(self._round_s or _IDLE_S)
            if is_of_computer:
                self._take_computer_events(computer.events())
            if item is not None:
                self._note_time(item)
                self._note_lateness(item)
                self._take_results(self.core.take(item))
            else:
                if not any(reader.is_alive() for reader in self._readers) and not self._items:
                    break
            self._take_over_recording()
            self._take_thread_ends()
            if self._acknowledged.is_set():
                self._acknowledged.clear()
                self.core.acknowledge_alarms()
            now_ns = self._clock.now_ns()
            # A pause since the last look must not be taken for silence of the links.
            if is_of_computer:
                self._take_computer_events(computer.events())
            if now_ns >= due_ns:
                due_ns = now_ns + _SNAPSHOT_INTERVAL_NS
                self._take_results(self.core.tick(now_ns, self._link_times_ns(now_ns)))
                self._publish(now_ns, ended=False)
        with self._recording_lock:
            self._may_record = False
        self._take_over_recording()
        self._take_thread_ends()
        self._take_results(self.core.finish())
        self._publish(self._clock.now_ns(), ended=True)
        self._end()

    def _watch_core(self) -> None:
        """Name what keeps the core; end the session without it where it is asked to end, or nothing else comes."""
        name, reported_s, watch = "", 0.0, self._watch
        while not self._done.wait(LOOK_S):
            if not self._core_thread.is_alive():
                self._save_recording()
                self._end()
                return
            recording = self._recording
            is_stuck = watch.look(self._rounds) and not (recording is not None and recording.ending)
            self._is_given_up = is_stuck and watch.stuck_s >= _GIVEN_UP_S
            if not is_stuck:
                if reported_s:
                    self._notices.append(Notice(name, Reason(SessionCode.CORE_GOES_ON, stuck_s=reported_s)))
                reported_s = 0.0
                continue
            if not reported_s:
                self._notices.append(Notice(watch.name, watch.reason, Level.ERROR))
            name, reported_s = watch.name, watch.stuck_s
            self._show_stuck()
            is_idle = self._is_given_up and not any(reader.is_alive() for reader in self._readers)
            if self._stop.is_set() or is_idle:
                self._fail(
                    TreadlinkError(
                        f"{watch.name} has not returned for {watch.stuck_s:.0f} s; the session ended without it",
                        "The recording, if there is one, is finished. Leave out what hangs, or mend it.",
                    )
                )
                self._save_recording()
                self._show_stuck()
                self._end()

    def _show_stuck(self) -> None:
        """Show the state before the core got stuck, with its alarm and the present time."""
        now_ns = self._clock.now_ns()
        alarms = [alarm for alarm in self._snapshot.alarms if alarm.reason.code is not SessionCode.CORE_STUCK]
        alarms.append(Alarm(self._watch.name, AlarmName.STOPPED, self._watch.reason))
        _, size = self.core.recording.path_and_size
        elapsed_s = self._elapsed_s(now_ns)
        self._snapshot = replace(self._snapshot, elapsed_s=elapsed_s, alarms=tuple(alarms), recorded_bytes=size)
        if self._publication is not None:
            self._publication.show(self._snapshot, now_ns)

    def _end(self) -> None:
        self._done.set()
        self._has_results.set()

    def _take_over_recording(self) -> None:
        """Hand the core a recording that was begun since the last round, or take an ended one from it."""
        recording = self._recording
        if recording is not self._core_recording:
            self._core_recording = recording
            self.core.recording.goes_on_in(recording)

    def _take_computer_events(self, events: Sequence[LinkEvent]) -> None:
        """Record events of this computer, and take them at once: they may explain what has not arrived."""
        for event in events:
            if self._recording is not None:
                self._recording.offer(event, timeout_s=_IDLE_S)
            self._take_results(self.core.take(event))

    def _note_time(self, item: LinkItem) -> None:
        """Keep the time of the latest item of each source; a mark has the time of the clock."""
        number = self._source_of.get(item.link)
        if number is not None and not (isinstance(item, LinkEvent) and not item.is_of_link):
            self._latest_ns[number] = item.host_ns

    def _note_lateness(self, item: LinkItem) -> None:
        """Take note of how late items of a device are, and report it; what can wait for this computer never is."""
        number = self._source_of.get(item.link)
        if number is None or self._patient[number] or isinstance(item, LinkEvent):
            return
        now_ns = self._clock.now_ns()
        self.core.late((now_ns - item.host_ns) * 1e-9)
        late_s = self._lateness.take(item.host_ns, now_ns)
        if late_s is not None:
            self.core.notify(Notice(item.link, Reason(SessionCode.RESULTS_LATE, late_s=late_s), Level.WARNING))

    def _elapsed_s(self, now_ns: int) -> float:
        """Return the time since the start, pauses left out."""
        began_ns = self._pause_began_ns
        present_ns = now_ns - began_ns if began_ns is not None else 0
        return (now_ns - self._start_ns - self._paused_ns - present_ns) * 1e-9

    def _playbacks(self) -> dict[int, Playback]:
        """Return the schedules of the sources that are replays."""
        return {
            number: source.playback for number, source in enumerate(self._sources) if isinstance(source, PlayedSource)
        }

    def _link_times_ns(self, now_ns: int) -> dict[str, int]:
        """Return the time up to which each link is known, in the time of its items.

        While items wait, that is the time of the last one taken: what has not been read yet is not missing. Otherwise
        it is the time of the clock, or that of the replay. A source that waits for this computer has no other time
        than that of its items.
        """
        playbacks = {} if self._items else self._playbacks()
        times: dict[str, int] = {}
        for link, number in list(self._source_of.items()):
            time_ns = self._latest_ns.get(number)
            if number in playbacks:
                time_ns = playbacks[number].now_ns() or time_ns
            elif not self._patient[number] and not self._items:
                time_ns = now_ns
            if time_ns is not None:
                times[link] = time_ns
        return times

    def _take_results(self, results: Sequence[RevolutionResult]) -> None:
        for result in results:
            self.summary.add(result)
            if len(self._results) == _RESULT_ITEMS:
                self._results_lost += 1
            self._results.append(result)
        if results:
            self._has_results.set()
        self._notices.extend(self.core.take_notices())
        changes = self.core.take_alarm_changes()
        if self._publication is not None:
            self._publication.take([*results, *changes], self.core.newest_ns)

    def _publish(self, now_ns: int, *, ended: bool) -> None:
        # Drops that concern no link in particular are counted with the first.
        first = self._dropped[self._sources[0].link]
        if self._results_lost:
            first[Stage.VIEW] = self._results_lost
        if self._recording is not None and self._recording.topics_dropped:
            first[Stage.TOPICS] = self._recording.topics_dropped
        for link, stages in list(self._dropped.items()):
            if stages:
                self.core.dropped(link, dict(stages), self._refused_ns.get(link))
        if self._publication is not None:
            self.core.publishes_to(self._publication.sinks())
        recording = self._recording
        self.core.watches_disk(None if recording is None else recording.room)
        self._snapshot = self.core.snapshot(self._elapsed_s(now_ns), ended=ended)
        self._take_results(())
        if self._publication is not None:
            self._publication.show(self._snapshot, self.core.newest_ns)


def _drain(items: deque[_Item]) -> list[_Item]:
    """Empty a queue that another thread may be filling; return its items."""
    drained: list[_Item] = []
    # The other thread only adds: a full queue loses its oldest item, but is never empty after that.
    while items:
        drained.append(items.popleft())
    return drained
