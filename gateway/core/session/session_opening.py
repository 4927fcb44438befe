"""Opening of a live session: sources, vehicle, keys, effects, signals and recording."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from gateway.core.clock import Clock
from gateway.core.config.vehicle import Tire, VehicleConfig
from gateway.core.constants import LATENCY_S
from gateway.core.errors import ConfigError, RecordingError
from gateway.core.estimates.registry import DEFAULT_ESTIMATORS
from gateway.core.links.reconnect import ReconnectingSource
from gateway.core.links.source import Source, is_live, open_source, parse_source_uri
from gateway.core.links.time_limit import limited
from gateway.core.nearest_name import did_you_mean
from gateway.core.reasons import Reason
from gateway.core.recording.run_description import NO_DESCRIPTION, RunDescription, TireIdentity
from gateway.core.recording.split_writer import Split, SplitWriter
from gateway.core.recording.writer import RecordingWriter
from gateway.core.session.core import SessionCore
from gateway.core.session.corrections import open_effects
from gateway.core.session.latency import Latency
from gateway.core.session.live import LiveSession, Recordings
from gateway.core.session.publication import Publication
from gateway.core.session.session_parts import VehicleSignals, commanded_links, open_guard, open_vehicle_signals
from gateway.core.session.supervisor import Supervisor


def stated_run(vehicle: VehicleConfig | None, statement: RunDescription) -> RunDescription:
    """Return what the vehicle file states of the run, overridden by what the session's options give.

    Raises:
        ConfigError: the options give a tire at a position that the vehicle does not have.
    """
    if vehicle is None:
        return statement
    check_tires(vehicle, statement)
    table = vehicle.test
    tires = {wheel.position: _identity(vehicle.tire_of(wheel)) for wheel in vehicle.wheel}
    description = RunDescription(
        table.name or "",
        table.driver or "",
        table.comment or "",
        table.tags or (),
        {position: tire for position, tire in tires.items() if tire != TireIdentity()},
    )
    return description.overridden_by(statement)


def check_tires(vehicle: VehicleConfig | None, run: RunDescription) -> None:
    """Check that tires of a run are at wheels of the vehicle.

    Raises:
        ConfigError: one is not.
    """
    positions = [wheel.position for wheel in vehicle.wheel] if vehicle is not None else list(run.tires)
    for position in run.tires:
        if position not in positions:
            raise ConfigError(
                f"a tire is given at '{position}', but the vehicle has no such wheel",
                f"{did_you_mean(position, positions)}It has: {', '.join(positions)}.",
            )


def with_given_wear(vehicle: VehicleConfig | None, statement: RunDescription) -> VehicleConfig | None:
    """Return the vehicle with the wear that the session's options give, which the estimates use."""
    wear_mm = {position: tire.wear_m * 1e3 for position, tire in statement.tires.items() if tire.wear_m is not None}
    if vehicle is None or not wear_mm:
        return vehicle
    wheels = tuple(
        wheel.model_copy(update={"tire": wheel.tire.overridden_by(Tire(wear_mm=wear_mm[wheel.position]))})
        if wheel.position in wear_mm
        else wheel
        for wheel in vehicle.wheel
    )
    return vehicle.model_copy(update={"wheel": wheels})


def _identity(tire: Tire) -> TireIdentity:
    return TireIdentity(
        tire.maker or "",
        tire.dot or "",
        None if tire.wear_mm is None else tire.wear_mm * 1e-3,
        None if tire.run_in_km is None else tire.run_in_km * 1e3,
    )


@dataclass(frozen=True, slots=True)
class OpenedSession:
    """A started session.

    Attributes:
        live: the session.
        recorder: the recording, None without one.
        host_limit_s: session time at which to stop a session with a hub, which may be silent; None without a limit. A
            recording and a simulation end by their own time.
        sources: as they were opened.
    """

    live: LiveSession
    recorder: RecordingWriter | SplitWriter | None
    host_limit_s: float | None
    sources: tuple[Source, ...]

    def damage(self) -> Reason | None:
        """Return what of a replayed recording was unreadable, as far as it was read; None without any."""
        return next(filter(None, (getattr(source, "damage", None) for source in self.sources)), None)

    def time_is_up(self) -> bool:
        """Return whether the session has run for as long as it may."""
        return self.host_limit_s is not None and self.live.snapshot().elapsed_s >= self.host_limit_s

    def remove_empty_recording(self) -> bool:
        """Remove a recording without a single item of a link; return whether it was removed."""
        return self.recorder is not None and _remove_empty(self.recorder)


@dataclass(frozen=True, slots=True)
class SessionSettings:
    """What a user states of a session.

    Attributes:
        config_path: configuration file, beside which its DBC file is searched.
        record: new recording, or a folder for it.
        split: where the recording goes on in a new file; None for one file.
        estimators: names from the registry; none for the default ones.
        key_file: keys of signed frames; None for the user's.
        effects_paths: files of known effects.
        duration_s: limit of the time of the data, and of waiting for a silent hub.
        run: description of the test run, which replaces that of the configuration.
        latency_s: longest time that a result may wait.
    """

    config_path: Path | None = None
    record: Path | None = None
    split: Split | None = None
    estimators: Sequence[str] = ()
    key_file: Path | None = None
    effects_paths: Sequence[Path] = ()
    duration_s: float | None = None
    run: RunDescription = NO_DESCRIPTION
    latency_s: float = LATENCY_S


def open_session(
    uris: Sequence[str],
    choose: Callable[[Sequence[str | None]], VehicleConfig | None],
    settings: SessionSettings,
    *,
    clock: Clock,
    publish: Callable[[Sequence[str]], Publication | None] = lambda _: None,
) -> OpenedSession:
    """Open sources, configuration and recording, and start the session.

    Args:
        uris: of the sources.
        choose: returns the vehicle, given the configurations (TOML) that the sources provide.
        settings: what the user states.
        clock: of the session.
        publish: opens the live outputs, given the configured positions; the last step that can fail.

    Raises:
        TreadlinkError: a source, the configuration, the recording or a live output cannot be opened.
    """
    sources: list[Source] = []
    record, duration_s = settings.record, settings.duration_s
    recorder: RecordingWriter | SplitWriter | None = None
    supervisor = Supervisor()
    try:
        sources += [_opened_source(uri, clock, settings.latency_s) for uri in uris]
        opened = tuple(sources)
        vehicle = with_given_wear(choose([source.vehicle_toml for source in sources]), settings.run)
        run = stated_run(vehicle, settings.run)
        effects = open_effects(settings.effects_paths, vehicle)
        # Files and simulations repeat frames, so they neither check nor advance the counters against replay.
        guard = open_guard(vehicle, settings.key_file, remembers=all(map(is_live, uris)))
        is_replay = [parse_source_uri(uri).scheme == "replay" for uri in uris]
        signals, dbc_text = _opened_signals(vehicle, settings.config_path, sources, is_replay)
        links = commanded_links(sources, clock, settings.key_file, guard)
        sources = list(links.sources)
        open_recorder = partial(_open_recorder, clock=clock, vehicle=vehicle, uris=uris, dbc_text=dbc_text, run=run)
        recorder = open_recorder(record, settings.split) if record is not None else None

        def open_described(described: RunDescription) -> RecordingWriter | SplitWriter:
            check_tires(vehicle, described)
            return open_recorder(_folder_of(record), None, run=described)

        core = SessionCore(
            vehicle,
            estimators=settings.estimators or DEFAULT_ESTIMATORS,
            guard=guard,
            effects=effects,
            signals=signals,
            latency_s=settings.latency_s,
        )
        live = LiveSession(
            sources if duration_s is None else [limited(source, duration_s) for source in sources],
            core,
            clock,
            patient=[not is_live(uri) for uri in uris],
            recordings=Recordings(recorder, None if all(is_replay) else open_described, run),
            publication=publish([wheel.position for wheel in vehicle.wheel] if vehicle is not None else []),
            control=links.serve(),
            supervisor=supervisor,
        )
        for notice in links.in_use():
            live.core.notify(notice)
        live.start()
    except BaseException:
        supervisor.close()
        for source in sources:
            source.close()
        if recorder is not None:
            _remove_empty(recorder)
        raise
    return OpenedSession(live, recorder, duration_s if any(map(is_live, uris)) else None, opened)


def _opened_source(uri: str, clock: Clock, latency_s: float) -> Source:
    source = open_source(uri, clock)
    if isinstance(source, ReconnectingSource):
        source.gather_s = Latency(latency_s).read_s
    return source


def _opened_signals(
    vehicle: VehicleConfig | None, config_path: Path | None, sources: Sequence[Source], is_replay: Sequence[bool]
) -> tuple[VehicleSignals, str | None]:
    """Return the decoder of the vehicle's bus, and the DBC file that the recording stores."""
    texts = [getattr(source, "dbc_text", None) for source in sources]
    stated_texts = [text for text, recorded in zip(texts, is_replay, strict=True) if not recorded]
    recorded_texts = [text for text in texts if text not in stated_texts]
    signals = open_vehicle_signals(vehicle, config_path, stated=stated_texts, recorded=recorded_texts)
    return signals, signals.dbc_text or next(filter(None, texts), None)


def _folder_of(record: Path | None) -> Path:
    """Return the folder for further recordings of a session."""
    return Path() if record is None else record.parent if record.suffix == ".mcap" else record


def _open_recorder(
    path: Path,
    split: Split | None,
    *,
    clock: Clock,
    vehicle: VehicleConfig | None,
    uris: Sequence[str],
    dbc_text: str | None,
    run: RunDescription,
) -> RecordingWriter | SplitWriter:
    if path.suffix != ".mcap":
        try:
            path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise RecordingError(
                f"cannot record to '{path}': {error.strerror}", "Give another folder, or a new .mcap file."
            ) from error
    toml = vehicle.to_toml() if vehicle is not None else None

    def opened(target: Path, start_ns: int) -> RecordingWriter:
        return RecordingWriter(target, start_ns=start_ns, vehicle_toml=toml, sources=uris, dbc_text=dbc_text, run=run)

    start_ns = clock.now_ns()
    return opened(path, start_ns) if split is None else SplitWriter(opened, path, start_ns, split)


def _remove_empty(recorder: RecordingWriter | SplitWriter) -> bool:
    if recorder.items:
        return False
    with suppress(RecordingError):
        recorder.close()
    recorder.path.unlink(missing_ok=True)
    return True
