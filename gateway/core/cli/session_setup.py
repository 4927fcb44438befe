"""Sessions of the commands live, record and replay: opening, running and closing."""

import os
import shlex
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Unpack

import click

from gateway.core.cli import exit_status
from gateway.core.cli.options import SessionOptions
from gateway.core.cli.stop_signals import StopRequest
from gateway.core.clock import SystemClock
from gateway.core.config.vehicle import choose_vehicle
from gateway.core.constants import LATENCY_S
from gateway.core.errors import RecordingError, TreadlinkError
from gateway.core.links.source import parse_source_uri
from gateway.core.reasons import Notice
from gateway.core.recording.run_description import NO_DESCRIPTION, RunDescription
from gateway.core.recording.split_writer import Split, SplitWriter
from gateway.core.session.live import LiveSession
from gateway.core.session.missing_results import missing_frames, missing_revolutions
from gateway.core.session.publication import LiveOutputs
from gateway.core.session.session_opening import OpenedSession, SessionSettings, open_session
from gateway.core.session.session_parts import default_key_file, open_outputs, output_files
from gateway.core.shown_units import shown_in
from gateway.core.text.aligned_table import for_terminal
from gateway.core.text.output_file import check_outputs, is_stdout
from gateway.core.text.plain import PlainView
from gateway.core.text.progress import can_move_cursor
from gateway.core.text.session_summary import columns_of_terminal, summary_lines
from gateway.core.text.text import clean
from gateway.core.text.wording import notice_text, text

# Notices, and results that do not come, are looked for ten times a second.
_POLL_S: Final = 0.1
_STOP_WAIT_S: Final = 2.0


@dataclass(frozen=True, slots=True)
class RunningSession:
    """A started session with its live outputs.

    Attributes:
        opened: the session with its summary and recording.
        publisher: the live outputs, None without any.
    """

    opened: OpenedSession
    publisher: LiveOutputs | None = None

    @property
    def live(self) -> LiveSession:
        """The session."""
        return self.opened.live

    @property
    def addresses(self) -> tuple[str, ...]:
        """Addresses that users open in a browser."""
        return self.publisher.addresses if self.publisher is not None else ()

    def time_is_up(self) -> bool:
        """Return whether the session has run for as long as it may."""
        return self.opened.time_is_up()

    def show_status(self, line: str) -> None:
        """Print a line to standard output, or to standard error where standard output belongs to a live output."""
        on_err = self.publisher is not None and self.publisher.uses_standard_output
        click.echo(for_terminal(line, on_err=on_err), err=on_err)


def chosen_split(limit: tuple[str, int] | None, keep: int | None) -> Split | None:
    """Return where a recording goes on in a new file, from `--split` and `--keep`; None where it does not.

    Raises:
        UsageError: `--keep` without `--split`.
    """
    if limit is None:
        if keep is not None:
            raise click.UsageError("--keep needs --split.")
        return None
    kind, amount = limit
    return Split(keep=keep, **{"size_bytes" if kind == "size" else "duration_ns": amount})


def start_session(
    uris: Sequence[str],
    *,
    record: Path | None,
    publish: Sequence[str] = (),
    split: Split | None = None,
    run: RunDescription = NO_DESCRIPTION,
    latency_s: float = LATENCY_S,
    **options: Unpack[SessionOptions],
) -> RunningSession:
    """Open sources, configuration, recording and live outputs, and start the session.

    Raises:
        TreadlinkError: a source, the configuration, the recording or a live output cannot be opened.
    """
    inputs = [options["config_path"], options["key_file"] or default_key_file(), *options["effects_paths"]]
    _check_published(publish, uris, inputs, record)
    clock = SystemClock()
    publishers: list[LiveOutputs] = []
    started: list[LiveSession] = []

    def opened_outputs(positions: Sequence[str]) -> LiveOutputs | None:
        publisher = open_outputs(publish, positions, lambda: next(iter(started), None), clock)
        publishers.extend([publisher] if publisher is not None else [])
        return publisher

    try:
        opened = open_session(
            uris,
            lambda provided: choose_vehicle(options["config_path"], provided, uris[0]),
            SessionSettings(record=record, split=split, run=run, latency_s=latency_s, **options),
            clock=clock,
            publish=opened_outputs,
        )
    except BaseException:
        for publisher in publishers:
            publisher.close()
        raise
    started.append(opened.live)
    session = RunningSession(opened, publishers[0] if publishers else None)
    for address in session.addresses:
        click.echo(f"page: {address}", err=True)
    return session


def _check_published(
    publish: Sequence[str], uris: Sequence[str], inputs: Sequence[Path | None], record: Path | None
) -> None:
    """Check that no file of a live output is one that the session reads or writes, before it is opened.

    Raises:
        OutputError: it is.
        SourceError: a source's URI is wrong.
        SinkError: that of a live output is.
    """
    written = output_files(publish)
    sources = [parse_source_uri(uri) for uri in uris]
    # Options name files too, such as dbc. What is no file is compared in vain.
    source_paths = [Path(text) for source in sources for text in (source.target, *source.options.values())]
    # The outputs themselves explain what cannot be written, and a recording in a folder gets a new name.
    outputs = [path for path in (*written, record) if path is not None and _can_be_file(path)]
    check_outputs(outputs, [*inputs, *source_paths], force=True)


def _can_be_file(path: Path) -> bool:
    return path.parent.is_dir() and not path.is_dir() and not is_stdout(path) and os.access(path.parent, os.W_OK)


def run_plain(session: RunningSession, stop: StopRequest, write: Callable[[str], None]) -> None:
    """Print one line per revolution until the session ends, its time is up, or a signal asks to stop.

    `write` takes all lines of a round as one text, and adds the last line end.
    """
    lines: list[str] = []
    view = PlainView(lines.append)
    live = session.live

    def show() -> None:
        with shown_in(live.snapshot().units):
            for notice in live.notices():
                view.notice(notice)
            for result in live.results():
                view.result(result)
        if lines:
            text = "\n".join(lines)
            lines.clear()
            write(text)

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
            ended = live.wait_for_results(_POLL_S)
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
        SystemExit: the session has no result, or a live output was down at the end.
    """
    try:
        try:
            yield
        finally:
            no_frames, no_revolutions = end_session(session, session.show_status)
    except OSError:
        stop.raise_if_set()
        raise
    if session.live.core.recording.fault is not None:
        raise RecordingError(session.live.core.recording.fault, "Check the disk and its free space, then record again.")
    damage = session.opened.damage()
    if damage is not None:
        raise RecordingError(text(damage), "The readable part was replayed.")
    has_receiver_left = session.publisher is not None and session.publisher.is_receiver_left
    if no_frames or (needs_revolutions and no_revolutions) or has_receiver_left:
        raise SystemExit(exit_status.NO_RESULT)


def end_session(session: RunningSession, write: Callable[[str], None]) -> tuple[tuple[Notice, ...], tuple[Notice, ...]]:
    """Close the session and print its summary.

    A recording that has received nothing, because no source could be opened, is removed.

    Returns:
        the printed warnings of links without frames, and of wheels without revolutions.

    Raises:
        TreadlinkError: a source or the session failed.
    """
    failure: TreadlinkError | None = None
    try:
        snapshot = session.live.close()
    except TreadlinkError as error:
        failure, snapshot = error, session.live.snapshot()
    finally:
        sinks = session.publisher.close() if session.publisher is not None else ()
        removed = session.opened.remove_empty_recording()
    if failure is not None and not any(link.frames for link in snapshot.links):
        raise failure
    links = session.live.core.frame_counts()
    no_frames, no_revolutions = missing_frames(links), missing_revolutions(snapshot.wheels, links)
    if session.publisher is not None and session.publisher.is_output_closed:
        return no_frames, no_revolutions  # its reader wants nothing more
    write("")
    wheels = session.opened.live.summary.wheels(snapshot.wheels)
    with shown_in(snapshot.units):
        lines = summary_lines(wheels, snapshot.links, snapshot.alarm_records, sinks, columns=columns_of_terminal())
    for line in lines:
        write(clean(line))
    for notice in (*session.live.core.false_statements(), *no_frames, *no_revolutions):
        write(clean(notice_text(notice)))
    if snapshot.recording and not removed:
        write("")
        parts = session.opened.recorder.parts if isinstance(session.opened.recorder, SplitWriter) else 1
        several = f", {parts} files, this is the last" if parts > 1 else ""
        write(f"recording: {snapshot.recording} ({snapshot.recorded_bytes / 1e6:.1f} MB{several})")
        if session.live.core.recording.fault is None:
            write(f"  show its content: treadlink inspect {shlex.quote(str(snapshot.recording))}")
            write(f"  replay it: treadlink replay {shlex.quote(str(snapshot.recording))}")
        else:
            write(f"  INCOMPLETE: {session.live.core.recording.fault}")
    if failure is not None:
        raise failure
    return no_frames, no_revolutions


def is_terminal() -> bool:
    """Return whether the screen can be shown: on a terminal that can move its cursor."""
    return sys.stdin.isatty() and sys.stdout.isatty() and can_move_cursor(os.environ)
