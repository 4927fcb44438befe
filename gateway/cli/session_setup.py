"""Sessions of the commands live, record and replay: opening, running and closing."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from gateway.clock import Clock, SystemClock
from gateway.config.effects_file import check_effects, load_effects
from gateway.config.vehicle import VehicleConfig, load_vehicle, recorded_vehicle
from gateway.errors import RecordingError
from gateway.estimators.registry import DEFAULT_ESTIMATORS
from gateway.io.source import Source, is_live, open_source
from gateway.pipeline.results import SessionSnapshot
from gateway.pipeline.wheel_setup import CorrectionTable
from gateway.recording.writer import RecordingWriter
from gateway.security.guard import open_guard
from gateway.session.commands import with_commands
from gateway.session.live import LiveSession
from gateway.views.plain import PlainView
from gateway.views.session_summary import ResultSummary, summary_lines
from gateway.views.text import clean

_POLL_S: Final = 0.05


@dataclass(slots=True)
class RunningSession:
    """A started session with its summary."""

    live: LiveSession
    summary: ResultSummary
    recorder: RecordingWriter | None


def choose_vehicle(config_path: Path | None, provided: Sequence[str | None], origin: str) -> VehicleConfig | None:
    """Return the vehicle of --config, else the first one that a source provides, else None."""
    if config_path is not None:
        return load_vehicle(config_path)
    texts = [text for text in provided if text]
    return recorded_vehicle(texts[0], origin) if texts else None


def open_effects(paths: Sequence[Path], vehicle: VehicleConfig | None) -> tuple[CorrectionTable, ...]:
    """Return the tables of effects files.

    Raises:
        ConfigError: a file cannot be read, or does not belong to the vehicle.
    """
    tables = tuple(map(load_effects, paths))
    check_effects(tables, vehicle)
    return tables


def start_session(
    uris: Sequence[str],
    *,
    config_path: Path | None,
    record: Path | None,
    estimators: Sequence[str],
    key_file: Path | None = None,
    effects_paths: Sequence[Path] = (),
    clock: Clock | None = None,
) -> RunningSession:
    """Open sources, configuration and recording, and start the session.

    Raises:
        TreadlinkError: a source, the configuration or the recording cannot be opened.
    """
    clock = clock or SystemClock()
    sources: list[Source] = []
    try:
        sources += [with_commands(open_source(uri, clock), clock) for uri in uris]
        vehicle = choose_vehicle(config_path, [source.vehicle_toml for source in sources], uris[0])
        effects = open_effects(effects_paths, vehicle)
        # Files and simulations repeat frames, so they neither check nor advance the counters against replay.
        remembers = all(is_live(uri) for uri in uris)
        guard = open_guard(vehicle, key_file, remembers=remembers)
        recorder = _open_recorder(record, clock, vehicle, uris) if record is not None else None
    except BaseException:
        for source in sources:
            source.close()
        raise
    summary = ResultSummary()
    live = LiveSession(
        sources,
        vehicle,
        clock,
        patient=[not is_live(uri) for uri in uris],
        summary=summary,
        recorder=recorder,
        estimators=estimators or DEFAULT_ESTIMATORS,
        guard=guard,
        effects=effects,
    )
    live.start()
    return RunningSession(live, summary, recorder)


def _open_recorder(path: Path, clock: Clock, vehicle: VehicleConfig | None, uris: Sequence[str]) -> RecordingWriter:
    if path.suffix != ".mcap":
        try:
            path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise RecordingError(
                f"cannot record to '{path}': {error.strerror}", "Give another folder, or a new .mcap file."
            ) from error
    toml = vehicle.to_toml() if vehicle is not None else None
    return RecordingWriter(path, start_ns=clock.now_ns(), vehicle_toml=toml, sources=uris)


def run_plain(session: RunningSession, duration_s: float | None, write: Callable[[str], None]) -> None:
    """Print one line per revolution until the session ends, the duration is over, or Ctrl-C."""
    view = PlainView(write)
    live = session.live

    def show() -> None:
        for notice in live.notices():
            view.notice(notice)
        for result in live.results():
            view.result(result)

    try:
        ended = False
        while not ended:
            ended = live.wait(_POLL_S)
            show()
            if duration_s is not None and live.snapshot().elapsed_s >= duration_s:
                live.request_stop()
                duration_s = None
    except KeyboardInterrupt:
        live.request_stop()
        live.wait(_POLL_S * 40)
        show()


def end_session(session: RunningSession, write: Callable[[str], None]) -> SessionSnapshot:
    """Close the session and print its summary.

    Raises:
        TreadlinkError: a source or the session failed.
    """
    snapshot = session.live.close()
    write("")
    for line in summary_lines(session.summary.wheels(), snapshot.links):
        write(clean(line))
    if snapshot.recording:
        write("")
        write(f"recording: {snapshot.recording} ({snapshot.recorded_bytes / 1e6:.1f} MB)")
        if session.live.core.recording_fault is None:
            write(f"  show its content: treadlink inspect {snapshot.recording}")
            write(f"  replay it: treadlink replay {snapshot.recording}")
        else:
            write(f"  INCOMPLETE: {session.live.core.recording_fault}")
    return snapshot


def is_terminal() -> bool:
    """Return whether the screen can be shown."""
    return sys.stdin.isatty() and sys.stdout.isatty()
