"""Sessions of the commands live, record and replay: opening, running and closing."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import click

from gateway.cli import exit_status
from gateway.cli.stop_signals import StopRequest
from gateway.clock import Clock, SystemClock
from gateway.config.effects_file import open_effects
from gateway.config.vehicle import VehicleConfig, choose_vehicle
from gateway.errors import RecordingError
from gateway.estimators.registry import DEFAULT_ESTIMATORS
from gateway.io.source import Source, is_live, open_source, parse_source_uri
from gateway.io.time_limit import limited
from gateway.publishing.publisher import Publisher, open_publisher
from gateway.publishing.sink import SinkSetting
from gateway.reasons import Notice
from gateway.recording.writer import RecordingWriter
from gateway.security.guard import open_guard
from gateway.security.key_file import command_keys
from gateway.session.commands import with_commands
from gateway.session.live import LiveSession
from gateway.session.missing_results import FrameCounts, missing_frames, missing_revolutions
from gateway.session.signal_decoding import open_decoder
from gateway.views.plain import PlainView
from gateway.views.session_summary import ResultSummary, summary_lines
from gateway.views.text import clean
from gateway.views.wording import notice_text

_POLL_S: Final = 0.05
_STOP_WAIT_S: Final = 2.0


@dataclass(slots=True)
class RunningSession:
    """A started session with its summary.

    Attributes:
        live: the session.
        summary: of all its results.
        recorder: the recording, None without one.
        publisher: the live outputs, None without any.
        host_limit_s: session time at which to stop a session with a hub, which may be silent; None without a limit. A
            recording and a simulation end by their own time.
    """

    live: LiveSession
    summary: ResultSummary
    recorder: RecordingWriter | None
    host_limit_s: float | None = None
    publisher: Publisher | None = None

    def show_status(self, line: str) -> None:
        """Print a line to standard output, or to standard error where standard output belongs to a live output."""
        click.echo(line, err=self.publisher is not None and self.publisher.uses_standard_output)

    def time_is_up(self) -> bool:
        """Return whether the session has run for as long as it may."""
        return self.host_limit_s is not None and self.live.snapshot().elapsed_s >= self.host_limit_s


def start_session(
    uris: Sequence[str],
    *,
    config_path: Path | None,
    record: Path | None,
    estimators: Sequence[str],
    key_file: Path | None = None,
    effects_paths: Sequence[Path] = (),
    duration_s: float | None = None,
    publish: Sequence[str] = (),
    clock: Clock | None = None,
) -> RunningSession:
    """Open sources, configuration and recording, and start the session.

    Raises:
        TreadlinkError: a source, the configuration, the recording or a live output cannot be opened.
    """
    clock = clock or SystemClock()
    sources: list[Source] = []
    recorder: RecordingWriter | None = None
    publisher: Publisher | None = None
    try:
        sources += [open_source(uri, clock) for uri in uris]
        vehicle = choose_vehicle(config_path, [source.vehicle_toml for source in sources], uris[0])
        effects = open_effects(effects_paths, vehicle)
        # Files and simulations repeat frames, so they neither check nor advance the counters against replay.
        remembers = all(is_live(uri) for uri in uris)
        guard = open_guard(vehicle, key_file, remembers=remembers)
        keys = command_keys(key_file) if guard is not None or key_file is not None else {}
        texts = [getattr(source, "dbc_text", None) for source in sources]
        is_replay = [parse_source_uri(uri).scheme == "replay" for uri in uris]
        given = [text for text, recorded in zip(texts, is_replay, strict=True) if not recorded]
        signals = open_decoder(vehicle, config_path, given, [text for text in texts if text not in given])
        dbc_text = signals.dbc_text if signals is not None else next(filter(None, texts), None)
        sources = [with_commands(source, clock, keys) for source in sources]
        recorder = _open_recorder(record, clock, vehicle, uris, dbc_text) if record is not None else None
        positions = [wheel.position for wheel in vehicle.wheel] if vehicle is not None else []
        publisher = open_publisher(publish, SinkSetting(positions), clock)
        summary = ResultSummary()
        live = LiveSession(
            sources if duration_s is None else [limited(source, duration_s) for source in sources],
            vehicle,
            clock,
            patient=[not is_live(uri) for uri in uris],
            summary=summary,
            recorder=recorder,
            estimators=estimators or DEFAULT_ESTIMATORS,
            guard=guard,
            effects=effects,
            publication=publisher,
            signals=signals,
        )
        live.start()
    except BaseException:
        for source in sources:
            source.close()
        if recorder is not None:
            _remove_empty(recorder)
        if publisher is not None:
            publisher.close()
        raise
    return RunningSession(live, summary, recorder, duration_s if any(map(is_live, uris)) else None, publisher)


def _open_recorder(
    path: Path, clock: Clock, vehicle: VehicleConfig | None, uris: Sequence[str], dbc_text: str | None
) -> RecordingWriter:
    if path.suffix != ".mcap":
        try:
            path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise RecordingError(
                f"cannot record to '{path}': {error.strerror}", "Give another folder, or a new .mcap file."
            ) from error
    toml = vehicle.to_toml() if vehicle is not None else None
    return RecordingWriter(path, start_ns=clock.now_ns(), vehicle_toml=toml, sources=uris, dbc_text=dbc_text)


def run_plain(session: RunningSession, stop: StopRequest, write: Callable[[str], None]) -> None:
    """Print one line per revolution until the session ends, its time is up, or a signal asks to stop."""
    view = PlainView(write)
    live = session.live

    def show() -> None:
        for notice in live.notices():
            view.notice(notice)
        for result in live.results():
            view.result(result)

    _run_until_end(session, stop, show)


def run_published(session: RunningSession, stop: StopRequest) -> None:
    """Print notices to standard error, while standard output carries what is published.

    Raises:
        BrokenPipeError: the reader of standard output has left.
    """
    view = PlainView(session.show_status)
    live, publisher = session.live, session.publisher

    def show() -> None:
        live.results()
        for notice in live.notices():
            view.notice(notice)
        if publisher is not None and publisher.is_output_closed:
            raise BrokenPipeError

    _run_until_end(session, stop, show)


def _run_until_end(session: RunningSession, stop: StopRequest, show: Callable[[], None]) -> None:
    """Call `show` until the session ends, its time is up, or a signal asks to stop."""
    live = session.live

    def show_until(time_is_up: Callable[[], bool]) -> None:
        ended = False
        while not ended and not time_is_up():
            ended = live.wait(_POLL_S)
            show()

    show_until(lambda: stop.is_set() or session.time_is_up())
    live.request_stop()
    if not stop.is_set():
        # What arrived in time is shown, however far the processing is behind.
        show_until(stop.is_set)
    live.wait(_STOP_WAIT_S)
    show()


@contextmanager
def ending(session: RunningSession, stop: StopRequest, *, needs_revolutions: bool = True) -> Iterator[None]:
    """Finish the recording and print the summary after the work on a session, whatever ended it.

    Args:
        session: the session.
        stop: request of a signal to stop.
        needs_revolutions: whether a wheel without a revolution is a missing result.

    Raises:
        TreadlinkError: a source, the recording or the session failed.
        StopSignal: the terminal is closed, so that the summary cannot be printed.
        SystemExit: the session has no result.
    """
    try:
        try:
            yield
        finally:
            no_frames, no_revolutions = end_session(session, session.show_status)
    except OSError:
        stop.raise_if_set()
        raise
    if session.live.core.recording_fault is not None:
        raise RecordingError(session.live.core.recording_fault, "The part written before is readable.")
    if no_frames or (needs_revolutions and no_revolutions):
        raise SystemExit(exit_status.NO_RESULT)


def end_session(session: RunningSession, write: Callable[[str], None]) -> tuple[tuple[Notice, ...], tuple[Notice, ...]]:
    """Close the session and print its summary.

    A recording that has received nothing, because no source could be opened, is removed.

    Returns:
        the printed warnings of links without frames, and of wheels without revolutions.

    Raises:
        TreadlinkError: a source or the session failed.
    """
    try:
        snapshot = session.live.close()
    finally:
        sinks = session.publisher.close() if session.publisher is not None else ()
        removed = session.recorder is not None and _remove_empty(session.recorder)
    links = {link.link: FrameCounts(link.frames, sum(link.judged.values())) for link in snapshot.links}
    no_frames, no_revolutions = missing_frames(links), missing_revolutions(snapshot.wheels, links)
    if session.publisher is not None and session.publisher.is_output_closed:
        return no_frames, no_revolutions  # its reader wants nothing more
    write("")
    for line in summary_lines(session.summary.wheels(), snapshot.links, snapshot.alarm_records, sinks):
        write(clean(line))
    for notice in (*session.live.core.false_statements(), *no_frames, *no_revolutions):
        write(clean(notice_text(notice)))
    if snapshot.recording and not removed:
        write("")
        write(f"recording: {snapshot.recording} ({snapshot.recorded_bytes / 1e6:.1f} MB)")
        if session.live.core.recording_fault is None:
            write(f"  show its content: treadlink inspect {snapshot.recording}")
            write(f"  replay it: treadlink replay {snapshot.recording}")
        else:
            write(f"  INCOMPLETE: {session.live.core.recording_fault}")
    return no_frames, no_revolutions


def _remove_empty(recorder: RecordingWriter) -> bool:
    """Remove a recording without a single item of a link; return whether it was removed."""
    if recorder.items:
        return False
    with suppress(RecordingError):
        recorder.close()
    recorder.path.unlink(missing_ok=True)
    return True


def is_terminal() -> bool:
    """Return whether the screen can be shown."""
    return sys.stdin.isatty() and sys.stdout.isatty()
