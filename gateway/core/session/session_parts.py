"""Parts of a session that features supply: what the core asks of each, and how it gets them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Protocol

from gateway.core.clock import Clock
from gateway.core.config.vehicle import VehicleConfig
from gateway.core.estimates.wheel_setup import CorrectionTable
from gateway.core.feature import Registry, added, object_of
from gateway.core.links.source import Source, VehicleData
from gateway.core.reasons import Notice, Reason
from gateway.core.session.frame_guard import FrameGuard
from gateway.core.session.publication import LiveOutputs
from gateway.core.text.session_control import SessionControl, ShownSession
from gateway.core.trust.turn_verdict import TurnComparison
from gateway.core.trust.wheel_pairs import VehicleWitness
from gateway.core.types import FloatArray
from gateway.core.wheels.outside_readings import OutsideReading

if TYPE_CHECKING:
    from gateway.core.estimates.weighted_mean import MeanEstimate
    from gateway.core.recording.recorded_file import RecordedFile

_EFFECTS_FILE: Final = "effects file"
_FRAME_GUARD: Final = "frame guard"
_KEY_FILE: Final = "key file"
_COMMANDED_LINKS: Final = "commanded links"
_RIG_CHANNELS: Final = "rig channels"
_SHARED_TURN: Final = "shared turn"
_TIRE_SENSORS: Final = "tire sensors"
_VEHICLE_SIGNALS: Final = "vehicle signals"
_LIVE_OUTPUTS: Final = "live outputs"
_OUTPUT_FILES: Final = "files of live outputs"
_SCREEN: Final = "screen"


class VehicleSignals(Protocol):
    """Signals of the vehicle, decoded from what is recorded of it.

    Attributes:
        dbc_text: the DBC file in use, None without one.
        maps_bus: whether signals of the bus are mapped.
    """

    dbc_text: str | None
    maps_bus: bool

    def take(self, item: VehicleData) -> dict[str, float]:
        """Decode an item; return the latest value of each signal in it."""
        ...

    def take_notices(self) -> list[tuple[str, Reason]]:
        """Return what is to be said of receivers since the last call, with their links."""
        ...

    def witness(self) -> VehicleWitness:
        """Return what compares revolutions with these signals."""
        ...


class TireSensors(Protocol):
    """Sensors of tires that a receiver beside the hub hears."""

    def take(self, item: VehicleData) -> Iterable[tuple[str, OutsideReading]]:
        """Decode an item; yield the position of the wheel and each reading."""
        ...

    def take_notices(self) -> list[tuple[str, Reason]]:
        """Return what is to be said of their messages since the last call, with their links."""
        ...


class RigChannel(Protocol):
    """A channel of a test rig at revolutions."""

    @property
    def values(self) -> FloatArray:
        """(n,) mean over each revolution in N, rad or N*m; NaN where the channel does not cover it."""
        ...

    @property
    def covered(self) -> int:
        """Number of revolutions with a value."""
        ...

    def mean(self) -> MeanEstimate:
        """Return the mean; its error has that of the channel, and what the values vary by."""
        ...


class RigChannels(Protocol):
    """Channels of a test rig in a recording, complete after a pass over it."""

    def at(self, position: str, quantity: str, turns: Iterable[tuple[float, float]]) -> RigChannel | None:
        """Return a channel of a wheel at revolutions of a begin and a duration in s; None without one."""
        ...

    def means(self, position: str, turns: Iterable[tuple[float, float]]) -> dict[str, MeanEstimate]:
        """Return the mean of each channel of a wheel that covers enough revolutions, by a name with unit."""
        ...


class LinkServer(Protocol):
    """Serves the links of a session to other commands until it is closed."""

    def close(self) -> None:
        """End the service; may be called twice."""
        ...


class CommandedLinks(Protocol):
    """Links of a session to hubs that take commands.

    Attributes:
        sources: of the session; those that can be written to send their hub the settings at each connection.
    """

    sources: Sequence[Source]

    def serve(self) -> LinkServer:
        """Begin to serve the links to other commands."""
        ...

    def in_use(self) -> Iterator[Notice]:
        """Yield a notice for each link that another session has."""
        ...


@cache
def _part(name: str) -> Any:
    return object_of(added(Registry.PARTS)[name])


def open_effects_file(path: Path) -> CorrectionTable:
    """Return the table of an effects file, which is checked against the catalogue of effects.

    Raises:
        TreadlinkError: the file cannot be read, or holds effects that are not those of the catalogue.
    """
    table: CorrectionTable = _part(_EFFECTS_FILE)(path)
    return table


def default_key_file() -> Path:
    """Return the user's key file, which need not exist."""
    path: Path = _part(_KEY_FILE)()
    return path


def open_guard(vehicle: VehicleConfig | None, key_file: Path | None, *, remembers: bool) -> FrameGuard | None:
    """Return the guard that the policy of a vehicle requires, None for policy `off`.

    Args:
        vehicle: configuration.
        key_file: keys; the user's own file when None.
        remembers: whether counters are kept across sessions.

    Raises:
        TreadlinkError: keys or counters cannot be read, or keys are given that the policy would not use.
    """
    guard: FrameGuard | None = _part(_FRAME_GUARD)(vehicle, key_file, remembers=remembers)
    return guard


def commanded_links(
    sources: Sequence[Source], clock: Clock, key_file: Path | None, guard: FrameGuard | None
) -> CommandedLinks:
    """Return sources whose hubs are sent the settings at every connection, signed where frames are checked.

    Raises:
        TreadlinkError: the keys cannot be read.
    """
    links: CommandedLinks = _part(_COMMANDED_LINKS)(sources, clock, key_file, guard)
    return links


def open_vehicle_signals(
    vehicle: VehicleConfig | None,
    config_path: Path | None = None,
    *,
    stated: Sequence[str | None] = (),
    recorded: Sequence[str | None] = (),
) -> VehicleSignals:
    """Return a new decoder of the vehicle's signals; its bus is not decoded without a DBC file.

    Args:
        vehicle: its configuration.
        config_path: file of the configuration where the user gave one; its `dbc` is relative to it.
        stated: texts of DBC files given with sources.
        recorded: texts of DBC files in recordings.

    Raises:
        ConfigError: the DBC file cannot be read, or does not fit the configuration.
    """
    signals: VehicleSignals = _part(_VEHICLE_SIGNALS)(vehicle, config_path, stated, recorded)
    return signals


def open_rig_channels(file: RecordedFile) -> RigChannels:
    """Return the channels of a file that is read next."""
    channels: RigChannels = _part(_RIG_CHANNELS)(file)
    return channels


def open_tire_sensors(vehicle: VehicleConfig | None) -> TireSensors:
    """Return a new decoder of the sensors that a vehicle file names."""
    sensors: TireSensors = _part(_TIRE_SENSORS)(vehicle)
    return sensors


def open_shared_turn(vehicle: VehicleConfig | None) -> TurnComparison:
    """Return a new comparison of the turn rates of a vehicle's wheels."""
    comparison: TurnComparison = _part(_SHARED_TURN)(vehicle.tracks_m() if vehicle is not None else {})
    return comparison


def output_files(uris: Sequence[str]) -> list[Path]:
    """Return the files that live outputs write.

    Raises:
        TreadlinkError: a URI is wrong.
    """
    files: list[Path] = _part(_OUTPUT_FILES)(uris)
    return files


def open_outputs(
    uris: Sequence[str], positions: Sequence[str], session: Callable[[], SessionControl | None], clock: Clock
) -> LiveOutputs | None:
    """Return the live outputs of URIs, None without any.

    Args:
        uris: of the outputs.
        positions: configured wheels.
        session: returns the session once it has started, for outputs that control it.
        clock: of the session.

    Raises:
        TreadlinkError: one cannot be opened at all, or two are the same.
    """
    outputs: LiveOutputs | None = _part(_LIVE_OUTPUTS)(uris, positions, session, clock)
    return outputs


def show_screen(session: ShownSession, time_is_up: Callable[[], bool], addresses: tuple[str, ...]) -> None:
    """Show a session on the terminal until the user quits, its time is up, or it has ended."""
    _part(_SCREEN)(session, time_is_up, addresses)
