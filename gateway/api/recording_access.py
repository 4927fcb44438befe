"""Recordings for programs: wheels, signals, estimates and alarms of a file as tables."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Final, Literal, Self

from gateway.api.estimate_tables import Alarms, EstimateRows, Estimates
from gateway.api.revolution_view import Revolution
from gateway.api.signal_tables import (
    AngleWaveforms,
    AverageWaveform,
    Environment,
    OrderSpectra,
    Revolutions,
    Samples,
)
from gateway.compare.views.drive import Drive
from gateway.compare.views.drive_page import check_page, drive_page
from gateway.core.config.vehicle import ASSUMED_RADIUS_MM
from gateway.core.errors import OutputError, RecordingError, TreadlinkError
from gateway.core.estimates.registry import DEFAULT_ESTIMATORS
from gateway.core.estimates.results import RevolutionResult
from gateway.core.nearest_name import nearest
from gateway.core.recording.recorded_file import RecordedFile, open_recorded_file
from gateway.core.session.corrections import open_effects
from gateway.core.session.program_arguments import Config, PathLike, chosen_vehicle, paths, several_names
from gateway.core.session.recording_pass import OpenedRecording, RecordingPass
from gateway.core.session.wheel_identity import configured_tire
from gateway.core.text.output_file import check_outputs, write_whole
from gateway.core.text.wording import notice_text, text
from gateway.exporting.export_registry import check_format, format_of
from gateway.exporting.recorded_signals import (
    EnvironmentReading,
    HeardWheel,
    SignalBlock,
    Survey,
    sample_blocks,
    signals,
    survey,
)
from gateway.exporting.recording_export import ExportRequest, export_recording
from gateway.planner.uncertainty_budget import Budget, LatestRevolutions

if TYPE_CHECKING:
    from gateway.simulator.truth import WheelTruth

Progress = Callable[[float], None]
Axis = Literal["circumferential", "lateral", "radial", "normalised"]

_AXES: Final = ("circumferential", "lateral", "radial", "normalised")
# Revolutions that are kept in memory, so that each table of them does not read the file again: about 0.5 GB.
_KEPT_REVOLUTIONS: Final = 15_000


class WheelNotFoundError(TreadlinkError, KeyError):
    """A recording has no wheel of this position."""

    def __str__(self) -> str:
        return str(self.args[0])


@dataclass(frozen=True, slots=True)
class Provenance:
    """Origin of a recording.

    Attributes:
        path: the file, or the scenario that was simulated.
        size_bytes: size of the file.
        finished: False when its writer was killed or its end is missing.
        treadlink: version that wrote it, empty when unknown.
        start_ns: start of the session, ns since the epoch; None when unknown.
        duration_s: time from its first to its last frame.
        sources: URIs of the sources, `serial:///dev/ttyUSB0`.
        has_host_time: whether it contains the arrival times of frames.
        frames: good frames of all links.
        frames_lost: frames missing by their counters.
        crc_errors: frames with a bad CRC.
        damage: what was unreadable in words, empty when everything was read.
    """

    path: Path
    size_bytes: int
    finished: bool
    treadlink: str
    start_ns: int | None
    duration_s: float
    sources: tuple[str, ...]
    has_host_time: bool
    frames: int
    frames_lost: int
    crc_errors: int
    damage: str


@dataclass(frozen=True, slots=True)
class _Settings:
    """Options that an open recording does not have."""

    has_config_tables: bool
    effects_paths: tuple[Path, ...]
    estimators: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class _Estimated:
    """Results of one pass with estimators."""

    estimates: Estimates
    alarms: Alarms
    notices: tuple[str, ...]


def open(
    path: PathLike,
    *,
    config: Config | None = None,
    keys: PathLike | None = None,
    effects: PathLike | Sequence[PathLike] = (),
    estimators: str | Sequence[str] = (),
    progress: Progress | None = None,
) -> Recording:
    """Open a recording, or the raw dump of a link, which ends in `.bin`.

    Options are those of `treadlink estimate`. Only the description of the file is read here; each table reads what it
    needs.

    Args:
        path: the file.
        config: vehicle configuration as a TOML file, as its tables, or as read; None for the one in the recording.
        keys: file with the keys of signed frames; None for the key file of `treadlink keys`.
        effects: files of `treadlink diagnose --save-effects`, whose effects are subtracted.
        estimators: names of the estimators for `estimates`; none for the default ones.
        progress: called with the share of the file read so far, 0 to 1.

    Raises:
        RecordingError: the file cannot be read or is no recording.
        ConfigError: the configuration or the effects have faults, or do not belong together.
    """
    return recording_of(
        open_recorded_file(path), config=config, keys=keys, effects=effects, estimators=estimators, progress=progress
    )


def recording_of(
    file: RecordedFile,
    *,
    config: Config | None = None,
    keys: PathLike | None = None,
    effects: PathLike | Sequence[PathLike] = (),
    estimators: str | Sequence[str] = (),
    progress: Progress | None = None,
    truth: Mapping[str, WheelTruth] | None = None,
) -> Recording:
    """Return an open file as a recording; arguments and errors as for `open`, `truth` as in `Recording`."""
    vehicle = chosen_vehicle(config, [file.vehicle_toml], str(file.info.path))
    size = max(1, file.info.size_bytes)
    opened = OpenedRecording(
        file,
        vehicle,
        effects=open_effects(paths(effects), vehicle),
        key_file=None if keys is None else Path(keys),
        config_path=path_of(config),
        on_position=None if progress is None else lambda position: progress(min(1.0, position / size)),
    )
    settings = _Settings(
        has_config_tables=config is not None and opened.config_path is None,
        effects_paths=tuple(paths(effects)),
        estimators=several_names(estimators) or DEFAULT_ESTIMATORS,
    )
    return Recording(opened, settings, truth)


def path_of(config: Config | None) -> Path | None:
    """Return the file of a configuration, None when it is not given as a file."""
    return Path(config) if isinstance(config, str | Path) else None


class Recording(Mapping[str, "Wheel"]):
    """A recording: a mapping of positions to wheels.

    Every table is made from the file when it is asked for. Use it as a context manager, or call `close`, to free the
    revolutions that are kept in memory.

    Attributes:
        vehicle: configuration in use; None without one, then the belt radius is assumed.
        truth: true state of the wheels of a simulation, by position; empty for a recording.
    """

    def __init__(
        self, opened: OpenedRecording, settings: _Settings, truth: Mapping[str, WheelTruth] | None = None
    ) -> None:
        """Take an open recording; use `gateway.open`."""
        self.vehicle = opened.vehicle
        self.truth: Mapping[str, WheelTruth] = truth or {}
        self._recording = opened
        self._file = opened.file
        self._settings = settings
        self._survey: Survey | None = None
        self._damage = ""
        self._cached: dict[str, list[RevolutionResult]] | None = None
        self._is_small = True
        self._estimated: dict[tuple[str, ...], _Estimated] = {}
        self._closed = False

    # Mapping of wheels

    def __getitem__(self, position: str) -> Wheel:
        """Return a wheel; raises WheelNotFoundError for a position that the recording does not have."""
        if position not in self._content.wheels:
            positions = ", ".join(self.wheels) or "no wheel"
            guess = nearest(position, self.wheels)
            hint = f"Did you mean {guess}? " if guess else ""
            raise WheelNotFoundError(f"'{self.name}' has no wheel '{position}'", f"{hint}It has {positions}.")
        return Wheel(self, position)

    def __iter__(self) -> Iterator[str]:
        return iter(self._content.wheels)

    def __len__(self) -> int:
        return len(self._content.wheels)

    @property
    def wheels(self) -> tuple[str, ...]:
        """Positions of the wheels, configured ones first; only those that sent a frame."""
        return tuple(self._content.wheels)

    # Description

    @property
    def name(self) -> str:
        """Name of the file."""
        return self._file.info.path.name

    @property
    def path(self) -> Path:
        """Path of the file."""
        return self._file.info.path

    @property
    def info(self) -> Provenance:
        """Origin, length and losses."""
        info, content = self._file.info, self._content
        counters = content.links.values()
        has_host_time = bool(content.first_ns)
        longest_s = max(
            (wheel.samples / wheel.rate_hz for wheel in content.wheels.values() if wheel.samples), default=0.0
        )
        return Provenance(
            path=info.path,
            size_bytes=info.size_bytes,
            finished=info.finished,
            treadlink=info.treadlink,
            start_ns=info.start_ns,
            duration_s=(content.last_ns - content.first_ns) * 1e-9 if has_host_time else longest_s,
            sources=info.sources,
            has_host_time=has_host_time,
            frames=sum(counted.frames for counted in counters),
            frames_lost=sum(counted.lost for counted in counters),
            crc_errors=sum(counted.crc_errors for counted in counters),
            damage=self._damage,
        )

    # Results

    def estimates(self, estimators: str | Sequence[str] = ()) -> Estimates:
        """Return the estimates of all wheels, as `treadlink estimate` makes them; computed once.

        Args:
            estimators: names; none for those given to `open`.

        Raises:
            RecordingError: the file cannot be read.
            ConfigError: no such estimator.
        """
        return self._results(estimators).estimates

    def alarms(self) -> Alarms:
        """Return the alarms over the whole recording; computed together with the estimates."""
        return self._results(()).alarms

    def notices(self) -> tuple[str, ...]:
        """Return what `treadlink estimate` warns of: misplaced sensors, contradictions, missing revolutions."""
        return self._results(()).notices

    def uncertainty_budget(self, estimators: str | Sequence[str] = ()) -> dict[str, list[Budget]]:
        """Return what each statement adds to the last errors of each wheel: `parts`, and `advice` for a better one.

        As `treadlink estimate --uncertainty-budget`; empty without a vehicle.

        Args:
            estimators: names; none for those given to `open`.
        """
        recording = self._opened()
        latest = LatestRevolutions(() if self.vehicle is None else self.vehicle.wheel_setups())
        names = several_names(estimators) or self._settings.estimators
        for result in RecordingPass(recording, names, signals=recording.signals()):
            latest.add(result)
        return latest.budgets()

    def stream(self, estimators: str | Sequence[str] = ()) -> Iterator[Revolution]:
        """Yield the revolutions of all wheels with their estimates, one by one, in constant memory.

        Args:
            estimators: names; none for those given to `open`.
        """
        recording = self._opened()
        names = several_names(estimators) or self._settings.estimators
        has_host_time = self._has_host_time
        for result in RecordingPass(recording, names, signals=recording.signals()):
            yield Revolution(result, has_host_time=has_host_time)

    def samples(self, *, start_s: float = -math.inf, stop_s: float = math.inf) -> dict[str, Samples]:
        """Return the samples of all wheels in one pass, by position; arguments as for `Wheel.samples`."""
        blocks: dict[str, list[SignalBlock]] = {position: [] for position in self.wheels}
        for block in self.sample_blocks():
            blocks[block.wheel].append(block)
        return {
            position: Samples.of(wheel_blocks, recording=self.name, wheel=position, start_s=start_s, stop_s=stop_s)
            for position, wheel_blocks in blocks.items()
        }

    def sample_blocks(self, wheels: Sequence[str] | None = None) -> Iterator[SignalBlock]:
        """Yield the samples of all wheels, or of some, in blocks of some seconds, in constant memory."""
        yield from sample_blocks(self._opened(), wheels=wheels)

    # Life cycle

    def export(
        self,
        out: PathLike,
        *,
        what: str | Sequence[str] = "samples",
        wheels: Sequence[str] = (),
        estimators: str | Sequence[str] = (),
        force: bool = False,
    ) -> Path:
        """Write measurements to a file of another program, as `treadlink export`, and return its path.

        Args:
            out: file; its suffix gives the format: .csv, .parquet, .mat, .mf4, .npz, .tdx or .mcap.
            what: `samples`, `angle`, `orders`, `average` or `estimates`; several for .mcap only.
            wheels: positions; all when empty.
            estimators: for estimates; none for the default ones.
            force: overwrite the file.

        Raises:
            OutputError: the recording is in memory only or its configuration no file; the file exists or cannot be
                written.
        """
        recording = self._recording
        if not self.path.is_file():
            raise OutputError("a simulation in memory cannot be exported", "Give gateway.simulate a file: out=...")
        if self._settings.has_config_tables:
            raise OutputError("a configuration that is no file cannot be exported with", "Give config as a TOML file.")
        target, contents = Path(out), several_names(what)
        name = format_of(target, None)
        check_outputs([target], (self.path, recording.config_path), force=force)
        check_format(target, name, contents)
        chosen = several_names(estimators) or self._settings.estimators or DEFAULT_ESTIMATORS
        export_recording(
            self.path,
            target,
            ExportRequest(contents, name, chosen, tuple(wheels)),
            config_path=recording.config_path,
            effects_paths=self._settings.effects_paths,
            key_file=recording.key_file,
            force=force,
        )
        return target

    def report_html(self, path: PathLike | None = None, *, force: bool = False) -> str:
        """Return the page of `treadlink estimate --html`, and write it; arguments as `Diagnosis.report_html`."""
        if path is not None:
            check_page(Path(path), force=force)
        recording = self._opened()
        drive = Drive.of(recording.file, recording.vehicle)
        estimation = RecordingPass(recording, self._settings.estimators, signals=recording.signals())
        for result in estimation:
            drive.add(result)
        notices = (*estimation.notices(list(drive.wheels)), *estimation.missing())
        drive.finish(estimation.wheels, estimation.alarms(), notices)
        page = drive_page([drive])
        if path is not None:
            write_whole(Path(path), page, force=force)
        return page

    def close(self) -> None:
        """Free what is kept in memory; may be called twice. Tables stay valid."""
        self._closed = True
        self._cached = None
        self._estimated.clear()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        info = self.info
        state = "" if info.finished else ", not finished"
        return (
            f"<Recording '{self.name}': {', '.join(self.wheels) or 'no wheel'}, {info.duration_s:.1f} s, "
            f"{info.size_bytes / 1e6:.1f} MB{state}>"
        )

    def _repr_html_(self) -> str:
        rows = "".join(
            f"<tr><td>{escape(name)}</td><td>{', '.join(f'{sensor_id:08x}' for sensor_id in wheel.sensor_ids)}</td>"
            f"<td>{wheel.rate_hz:.0f}</td><td>{wheel.samples}</td></tr>"
            for name, wheel in self._content.wheels.items()
        )
        head = "<tr><th>wheel</th><th>sensor</th><th>rate / Hz</th><th>samples</th></tr>"
        return f"<p>{escape(repr(self)[1:-1])}</p><table>{head}{rows}</table>"

    # For wheels

    @property
    def _content(self) -> Survey:
        if self._survey is None:
            recording = self._opened()
            self._survey = survey(recording)
            self._damage = "" if recording.file.damage is None else text(recording.file.damage)
        return self._survey

    @property
    def _has_host_time(self) -> bool:
        return bool(self._content.first_ns)

    def _opened(self) -> OpenedRecording:
        if self._closed:
            raise RecordingError(f"'{self.name}' is closed", "Open it again with gateway.open.")
        # Each pass has a position of its own: one table may be asked for while another is read.
        return replace(self._recording, file=copy(self._file))

    def _revolutions(self, wheel: str) -> Iterator[RevolutionResult]:
        """Yield the revolutions of a wheel; those of a recording of moderate length are kept."""
        if self._cached is not None:
            yield from self._cached.get(wheel, ())
            return
        by_wheel: dict[str, list[RevolutionResult]] | None = {} if self._is_small else None
        for count, result in enumerate(RecordingPass(self._opened(), (), is_watched=False)):
            if by_wheel is not None:
                by_wheel.setdefault(result.position, []).append(result)
                if count >= _KEPT_REVOLUTIONS:
                    by_wheel, self._is_small = None, False
            if result.position == wheel:
                yield result
        self._cached = by_wheel

    def _results(self, estimators: str | Sequence[str]) -> _Estimated:
        names = several_names(estimators) or self._settings.estimators
        if names not in self._estimated:
            self._estimated[names] = self._estimate(names)
        return self._estimated[names]

    def _estimate(self, estimators: tuple[str, ...]) -> _Estimated:
        """Run the estimators; return their results with everything that the command prints about them."""
        recording = self._opened()
        rows = EstimateRows(has_host_time=self._has_host_time)
        positions: dict[str, None] = {}
        estimation = RecordingPass(recording, estimators, signals=recording.signals())
        for block in estimation.blocks():
            positions.setdefault(block.position)
            rows.add(block)
        return _Estimated(
            estimates=rows.table(self.name),
            alarms=Alarms.of(estimation.alarms(), recording=self.name),
            notices=tuple(map(notice_text, (*estimation.notices(list(positions)), *estimation.missing()))),
        )


class Wheel:
    """One wheel of a recording."""

    def __init__(self, recording: Recording, position: str) -> None:
        """Take a position of a recording; use `recording[position]`."""
        self.recording = recording
        self.position = position

    @property
    def heard(self) -> HeardWheel:
        """Sensors, stated sampling rate and number of samples."""
        return self.recording._content.wheels[self.position]

    @property
    def sensor_id(self) -> str:
        """Serial number of its sensor, the last one, as hexadecimal text; empty when it did not send one."""
        sensor_ids = self.heard.sensor_ids
        return f"{sensor_ids[-1]:08x}" if sensor_ids else ""

    @property
    def radius_m(self) -> float:
        """Belt radius: as configured, else as assumed."""
        tire = configured_tire(self.recording.vehicle, self.position)
        radius_m = tire.radius_m if tire is not None else None
        return ASSUMED_RADIUS_MM * 1e-3 if radius_m is None else radius_m

    def samples(self, *, start_s: float = -math.inf, stop_s: float = math.inf) -> Samples:
        """Return the samples of its axes in SI units.

        An hour at 9600 Hz takes about 2 GB; choose a part of a long recording, or read `recording.sample_blocks()`.

        Args:
            start_s: time of the hub's clock from which on samples are returned.
            stop_s: time of the hub's clock before which samples are returned.
        """
        return Samples.of(
            self.recording.sample_blocks((self.position,)),
            recording=self.recording.name,
            wheel=self.position,
            start_s=start_s,
            stop_s=stop_s,
        )

    def environment(self) -> Environment:
        """Return pressure and temperature in the tire."""
        recording = self.recording
        items = signals(recording._opened(), wheels=(self.position,))
        readings = [item for item in items if isinstance(item, EnvironmentReading)]
        return Environment.of(readings, recording=recording.name, wheel=self.position)

    def revolutions(self) -> Revolutions:
        """Return its revolutions: times, speed, contact and conditions."""
        recording = self.recording
        return Revolutions.of(
            recording._revolutions(self.position),
            recording=recording.name,
            wheel=self.position,
            has_host_time=recording._has_host_time,
        )

    def angle(self, *, start_s: float = -math.inf, stop_s: float = math.inf) -> AngleWaveforms:
        """Return its revolutions in the angle domain, 33 kB each.

        Args:
            start_s: time of the hub's clock from which on revolutions are returned, by their start.
            stop_s: time of the hub's clock before which revolutions are returned.
        """
        return AngleWaveforms.of(self._between(start_s, stop_s), recording=self.recording.name, wheel=self.position)

    def average(self, *, start_s: float = -math.inf, stop_s: float = math.inf) -> AverageWaveform:
        """Return the time synchronous average of its usable revolutions, with their scatter.

        Args:
            start_s: time of the hub's clock from which on revolutions are averaged, by their start.
            stop_s: time of the hub's clock before which revolutions are averaged.

        Raises:
            RecordingError: there is no usable revolution.
        """
        average = AverageWaveform.of(self._between(start_s, stop_s), recording=self.recording.name, wheel=self.position)
        if average is None:
            raise RecordingError(
                f"wheel {self.position} of '{self.recording.name}' has no usable revolution to average",
                "Its revolutions and their faults are in `revolutions()`, missing ones in `recording.notices()`.",
            )
        return average

    def orders(
        self, axis: Axis = "normalised", *, start_s: float = -math.inf, stop_s: float = math.inf
    ) -> OrderSpectra:
        """Return the order spectrum of each revolution.

        Args:
            axis: `normalised` is the radial axis without gravity and angular acceleration; `radial`,
                `circumferential` and `lateral` are the axes as measured.
            start_s: time of the hub's clock from which on revolutions are returned, by their start.
            stop_s: time of the hub's clock before which revolutions are returned.

        Raises:
            ValueError: another axis.
        """
        if axis not in _AXES:
            raise ValueError(f"there is no axis '{axis}': choose {', '.join(_AXES)}")
        return OrderSpectra.of(
            self._between(start_s, stop_s), recording=self.recording.name, wheel=self.position, axis=axis
        )

    def estimates(self, estimators: str | Sequence[str] = ()) -> Estimates:
        """Return its estimates; arguments as for `recording.estimates`."""
        table = self.recording.estimates(estimators)
        return table.select(wheel=self.position) if self.position in table.wheel.tolist() else table.select(status=())

    def _between(self, start_s: float, stop_s: float) -> Iterator[RevolutionResult]:
        for result in self.recording._revolutions(self.position):
            if start_s <= result.revolution.start_s < stop_s:
                yield result

    def __repr__(self) -> str:
        heard = self.heard
        return (
            f"<Wheel {self.position} of '{self.recording.name}': sensor {self.sensor_id or 'unknown'}, "
            f"{heard.samples} samples at {heard.rate_hz:g} Hz, belt radius {self.radius_m:g} m>"
        )
