"""Decoding of a vehicle's bus with a DBC file, by cantools."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

from gateway.bounded_input import MAX_DBC_BYTES, read_bounded
from gateway.config.vehicle import VehicleConfig
from gateway.errors import ConfigError
from gateway.io.bus_frames import unpack
from gateway.io.source import BusFrames
from gateway.pipeline.vehicle_signals import SUFFIXES, UNITS, SignalHistory, SignalSetup, VehicleSignal, signal_name

_logger = logging.getLogger(__name__)

_LISTED: Final = 12
# SAE J1939-21: bits 8 to 25 are the parameter group, below is the source address, above the priority.
_J1939_GROUP: Final = 0x03FFFF00
_WHOLE_ID: Final = 0x1FFFFFFF


class _Wanted(NamedTuple):
    """A signal that is taken from a message."""

    signal: str
    key: str
    factor: float


class SignalDecoder:
    """Decodes the frames of buses into the history of signals.

    Attributes:
        history: of the signals.
        dbc_text: the DBC file in use.
        frames: decoded frames.
        undecodable: frames of known messages that do not fit them.
    """

    def __init__(
        self, setups: Sequence[SignalSetup], max_age_s: float, dbc_text: str, origin: str, *, is_j1939: bool = False
    ) -> None:
        """Find the signals in a DBC file.

        Args:
            setups: the signals.
            max_age_s: a signal that was not received for longer is unknown.
            dbc_text: the file.
            origin: names it in messages.
            is_j1939: compare extended identifiers without priority and source address.

        Raises:
            ConfigError: the file cannot be read, or lacks a message, a signal or a unit; the message lists all faults.
        """
        self.dbc_text = dbc_text
        self.frames = self.undecodable = 0
        database = _database(dbc_text, origin)
        self._extended_mask = _J1939_GROUP if is_j1939 else _WHOLE_ID
        self._messages: dict[tuple[int, bool], tuple[Any, list[_Wanted]]] = {}
        signals: list[VehicleSignal] = []
        faults: list[str] = []
        for setup in setups:
            found = self._find(database, setup)
            if isinstance(found, str):
                faults.append(found)
                continue
            signals.append(found)
        if faults:
            raise ConfigError("\n".join(f"{origin}: {fault}" for fault in faults), "Correct [vehicle_signals].")
        self.history = SignalHistory(signals, max_age_s)

    def take(self, item: BusFrames) -> dict[str, float]:
        """Decode a block of frames into the history; return the latest value of each signal in it."""
        latest: dict[str, float] = {}
        for frame in unpack(item.data, item.host_ns):
            known = self._messages.get(self._key(frame.can_id, frame.is_extended))
            if known is None or frame.is_error or frame.is_remote:
                continue
            message, wanted = known
            try:
                # A multiplexed message carries only some of its signals.
                values = message.decode(frame.data, decode_choices=False, allow_truncated=True)
            except Exception as error:  # a frame of another device may have any content
                self.undecodable += 1
                _logger.debug("frame %#x cannot be decoded: %s", frame.can_id, error)
                continue
            self.frames += 1
            for one in wanted:
                raw = values.get(one.signal)
                if isinstance(raw, int | float):
                    value = float(raw) * one.factor
                    self.history.add(one.key, frame.host_ns, value)
                    latest[one.key] = value
        return latest

    def _key(self, can_id: int, is_extended: bool) -> tuple[int, bool]:
        return can_id & self._extended_mask if is_extended else can_id, is_extended

    def _find(self, database: Any, setup: SignalSetup) -> VehicleSignal | str:
        """Register a signal; return it, or what is wrong."""
        what = f"vehicle_signals.signal {setup.message}.{setup.signal}"
        message = next((one for one in database.messages if one.name == setup.message), None)
        if message is None:
            return f"{what}: no message '{setup.message}'; it has {_some([one.name for one in database.messages])}"
        signal = next((one for one in message.signals if one.name == setup.signal), None)
        if signal is None:
            names = [one.name for one in message.signals]
            return f"{what}: no signal '{setup.signal}' in {setup.message}; it has {_some(names)}"
        unit_text = setup.unit if setup.unit is not None else (signal.unit or "")
        unit = UNITS.get(unit_text)
        if unit is None:
            return f"{what}: unit '{unit_text}' is not known; give unit, one of {', '.join(filter(None, UNITS))}"
        if unit.suffix not in SUFFIXES[setup.quantity]:
            return f"{what}: unit '{unit_text}' does not fit {setup.quantity}; give the right unit"
        found = VehicleSignal(
            signal_name(setup, unit.suffix), setup.quantity, unit.suffix, setup.wheel, setup.relative_std
        )
        key = self._key(message.frame_id, message.is_extended_frame)
        wanted = self._messages.setdefault(key, (message, []))[1]
        wanted.append(_Wanted(setup.signal, found.key, unit.factor * setup.factor))
        return found


def open_decoder(
    vehicle: VehicleConfig | None, config_path: Path | None, given: Sequence[str | None], recorded: Sequence[str | None]
) -> SignalDecoder | None:
    """Return the decoder of a vehicle's signals, None where the vehicle file maps none or no DBC file is known.

    Args:
        vehicle: its configuration.
        config_path: file of the configuration where the user gave one; its `dbc` is relative to it.
        given: texts of DBC files given with sources.
        recorded: texts of DBC files in recordings.

    Raises:
        ConfigError: the DBC file cannot be read, or does not fit the configuration.
    """
    mapping = vehicle.vehicle_signals if vehicle is not None else None
    if mapping is None or not mapping.signal:
        return None
    text, origin = next((text for text in given if text), None), "the DBC file of the source"
    if text is None and config_path is not None and mapping.dbc is not None:
        path = config_path.parent / mapping.dbc
        origin = str(path)
        try:
            data = read_bounded(path, MAX_DBC_BYTES)
        except OSError as error:
            raise ConfigError(
                f"cannot read the DBC file '{path}': {error.strerror}",
                "Correct vehicle_signals.dbc in the vehicle file.",
            ) from error
        if len(data) > MAX_DBC_BYTES:
            raise ConfigError(
                f"the DBC file '{path}' is larger than {MAX_DBC_BYTES >> 20} MiB",
                "Correct vehicle_signals.dbc in the vehicle file.",
            )
        text = data.decode("utf-8", errors="replace").replace("\r\n", "\n")
    if text is None:
        text, origin = next((text for text in recorded if text), None), "the DBC file in the recording"
    if text is None:
        return None
    return SignalDecoder(mapping.setups(), mapping.max_age_s, text, origin, is_j1939=mapping.j1939)


def _database(text: str, origin: str) -> Any:
    try:
        import cantools.database
    except ModuleNotFoundError as error:
        raise ConfigError(
            "vehicle signals need the package 'cantools', which is not installed",
            "Install it with: pip install 'treadlink[can]'",
        ) from error
    try:
        return cantools.database.load_string(text, database_format="dbc", strict=False)
    except Exception as error:  # parsers raise errors of many kinds
        raise ConfigError(f"{origin} cannot be read as a DBC file: {error}", "Check the file.") from error


def _some(names: Sequence[str]) -> str:
    more = f" and {len(names) - _LISTED} more" if len(names) > _LISTED else ""
    return (", ".join(names[:_LISTED]) or "none") + more
