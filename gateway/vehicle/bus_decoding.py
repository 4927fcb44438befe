"""Decoding of a vehicle's bus with a DBC file, by cantools."""

import logging
import math
import re
from collections.abc import Collection, Iterator, Sequence
from contextlib import suppress
from typing import Any, Final, NamedTuple

from gateway.core.errors import ConfigError
from gateway.core.links.bus_frames import BusFrame, unpack
from gateway.core.links.source import BusFrames
from gateway.core.reasons import Reason
from gateway.vehicle.dbc_file import message_names, only_messages
from gateway.vehicle.reasons import VehicleCode
from gateway.vehicle.vehicle_signals import (
    POSITION_UNITS,
    SUFFIXES,
    UNITS,
    SignalSetup,
    SignalValue,
    VehicleSignal,
    signal_name,
)

_logger = logging.getLogger(__name__)

# Above it only the mapped messages are parsed: cantools takes nearly a millisecond for each.
_MANY_MESSAGES: Final = 2000
_LISTED: Final = 12
# SAE J1939-21: bits 8 to 25 are the parameter group, below is the source address, above the priority.
_J1939_GROUP: Final = 0x03FFFF00
_SOURCE_ADDRESS: Final = 0xFF
_WHOLE_ID: Final = 0x1FFFFFFF
# DBC files of different makers write one unit as km/h, Km/h and KM/H.
_UNITS_ANY_CASE: Final = {name.lower(): unit for name, unit in UNITS.items()}
# Names of values that are none, in tables that also name the states of a switch.
_NO_VALUE: Final = re.compile(
    r"(^|[^a-z])(sna|n/?a|signal ?not ?av\w*|not ?av\w*|unav\w*|inval\w*|undef\w*|unknown|err(or)?|fault\w*|fail\w*|"
    r"init\w*|reserved|not ?used|unused|ung(ü|ue)ltig|fehler\w*|unbekannt|nicht ?verf\w*|"
    r"not ?(valid|defined|plausible))([^a-z]|$)",
    re.IGNORECASE,
)


class _Mapped(NamedTuple):
    """A signal that is taken from a message.

    Attributes:
        signal: its name.
        key: of the history.
        factor: from the value of the DBC file to SI.
        no_value: raw values that stand for no value.
        low: smallest possible value in the unit of the DBC file, -inf without one.
        high: largest possible value.
    """

    signal: Any
    key: str
    factor: float
    no_value: frozenset[int]
    low: float
    high: float

    def value(self, raw: object) -> float | None:
        """Return the measured value in SI of a raw value, None where it is none."""
        if not isinstance(raw, int | float) or raw in self.no_value:
            return None
        scaled = float(self.signal.conversion.raw_to_scaled(raw, decode_choices=False))
        return scaled * self.factor if self.low <= scaled <= self.high else None


class BusDecoder:
    """Decodes the frames of buses.

    Attributes:
        signals: the signals of the vehicle file.
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
        # One identifier may mean another thing on another bus: a message counts from the first bus that carries it.
        self._buses: dict[tuple[int, bool], tuple[str, int | None]] = {}
        self._reported: set[tuple[int, bool]] = set()
        self._notices: list[tuple[str, Reason]] = []
        database = _database(dbc_text, origin, {setup.message for setup in setups})
        self._extended_mask = _J1939_GROUP if is_j1939 else _WHOLE_ID
        self._messages: dict[tuple[int, bool], dict[int, tuple[Any, list[_Mapped]]]] = {}
        signals: list[VehicleSignal] = []
        faults: list[str] = []
        for setup in setups:
            signal = self._find(database, setup, max_age_s)
            if isinstance(signal, str):
                faults.append(signal)
                continue
            signals.append(signal)
        if faults:
            raise ConfigError("\n".join(f"{origin}: {fault}" for fault in faults), "Correct [vehicle_signals].")
        self.signals = tuple(signals)

    def values(self, item: BusFrames) -> Iterator[SignalValue]:
        """Yield the values in a block of frames."""
        for frame in unpack(item.data, item.host_ns):
            mapped = self._mapped(frame)
            if mapped is None or frame.is_error or frame.is_remote:
                continue
            message, signals = mapped
            if not self._is_of_one_bus(item.link, frame, message.name):
                continue
            try:
                # A multiplexed message carries only some of its signals.
                values = message.decode(frame.data, decode_choices=False, scaling=False, allow_truncated=True)
            except Exception as error:  # a frame of another device may have any content
                self.undecodable += 1
                _logger.debug("frame %#x cannot be decoded: %s", frame.can_id, error)
                continue
            self.frames += 1
            for wanted_signal in signals:
                value = wanted_signal.value(values.get(wanted_signal.signal.name))
                if value is not None:
                    yield SignalValue(wanted_signal.key, frame.host_ns, value)

    def take_notices(self) -> list[tuple[str, Reason]]:
        """Return what is to be said of the buses since the last call, with their links."""
        notices, self._notices = self._notices, []
        return notices

    def _is_of_one_bus(self, link: str, frame: BusFrame, message: str) -> bool:
        """Return whether a frame is of the bus that carried its message first; tell once of another one."""
        key, bus = self._key(frame.can_id, frame.is_extended), (link, frame.channel)
        first = self._buses.setdefault(key, bus)
        if first == bus:
            return True
        if key not in self._reported:
            self._reported.add(key)
            reason = Reason(
                VehicleCode.BUS_MESSAGE_TWICE, message=message, first=_bus_name(*first), second=_bus_name(*bus)
            )
            self._notices.append((link, reason))
        return False

    def _mapped(self, frame: BusFrame) -> tuple[Any, list[_Mapped]] | None:
        """Return message and signals of a frame; the source address matters where messages share a parameter group."""
        of_source = self._messages.get(self._key(frame.can_id, frame.is_extended), {})
        alone = next(iter(of_source.values())) if len(of_source) == 1 else None
        return alone or of_source.get(frame.can_id & _SOURCE_ADDRESS)

    def _key(self, can_id: int, is_extended: bool) -> tuple[int, bool]:
        return can_id & self._extended_mask if is_extended else can_id, is_extended

    def _find(self, database: Any, setup: SignalSetup, max_age_s: float) -> VehicleSignal | str:
        """Register a signal; return it, or what is wrong."""
        key_path = f"vehicle_signals.signal {setup.message}.{setup.signal}"
        message = next((candidate for candidate in database.messages if candidate.name == setup.message), None)
        if message is None:
            # The database has fewer messages than the file where only the mapped ones are valid.
            names = max([candidate.name for candidate in database.messages], message_names(self.dbc_text), key=len)
            return f"{key_path}: no message '{setup.message}'; it has {_listed(names)}"
        signal = next((candidate for candidate in message.signals if candidate.name == setup.signal), None)
        if signal is None:
            names = [candidate.name for candidate in message.signals]
            return f"{key_path}: no signal '{setup.signal}' in {setup.message}; it has {_listed(names)}"
        unit_text = setup.unit if setup.unit is not None else (signal.unit or "")
        unit = UNITS.get(unit_text) or _UNITS_ANY_CASE.get(unit_text.strip().lower())
        allowed = UNITS
        if SUFFIXES[setup.quantity] == {"deg"}:
            unit, allowed = POSITION_UNITS.get(unit_text.strip().lower()), POSITION_UNITS
        if unit is None:
            return f"{key_path}: unit '{unit_text}' is not known; give unit, one of {', '.join(filter(None, allowed))}"
        if unit.suffix not in SUFFIXES[setup.quantity]:
            return f"{key_path}: unit '{unit_text}' does not fit {setup.quantity}; give the right unit"
        vehicle_signal = VehicleSignal(
            signal_name(setup, unit.suffix), setup.quantity, unit.suffix, setup.wheel, setup.relative_std, max_age_s
        )
        key = self._key(message.frame_id, message.is_extended_frame)
        of_source = self._messages.setdefault(key, {})
        signals = of_source.setdefault(message.frame_id & _SOURCE_ADDRESS, (message, []))[1]
        low, high = _range(signal, setup)
        signals.append(
            _Mapped(signal, vehicle_signal.key, unit.factor * setup.factor, _no_values(signal, unit.suffix), low, high)
        )
        return vehicle_signal


def _bus_name(link: str, channel: int | None) -> str:
    return link if channel is None else f"{link}, channel {channel}"


def _no_values(signal: Any, suffix: str) -> frozenset[int]:
    """Return the raw values that stand for no value: in a quantity with a unit, a value with a name is a state.

    A name may also repeat the value in words, such as `0 km/h`; a number without a unit may be a switch.
    """
    names = {raw: str(name).strip() for raw, name in (signal.choices or {}).items()}
    return frozenset(
        raw
        for raw, name in names.items()
        if _NO_VALUE.search(name.replace("_", " ")) or (suffix and not re.match(r"[+-]?\d", name))
    )


def _range(signal: Any, setup: SignalSetup) -> tuple[float, float]:
    """Return the range that the DBC file states for a signal, widened by half a step; endless where it states none."""
    low, high = signal.minimum, signal.maximum
    # Where the file lacks the scale, the range may be that of the raw values or that of the quantity.
    if low is None or high is None or not low < high or abs(setup.factor) != 1.0:
        return -math.inf, math.inf
    half = 0.5 * abs(float(signal.scale)) + 1e-9 * max(abs(low), abs(high))
    return float(low) - half, float(high) + half


def _database(text: str, origin: str, mapped: Collection[str]) -> Any:
    """Return the messages of a DBC file, or of the mapped ones alone where the others are wrong."""
    try:
        import cantools.database
    except ModuleNotFoundError as error:
        raise ConfigError(
            "vehicle signals need the package 'cantools', which is not installed",
            "Install it with: pip install 'treadlink[can]'",
        ) from error
    if len(message_names(text)) > _MANY_MESSAGES:
        text = only_messages(text, mapped)
    try:
        return cantools.database.load_string(text, database_format="dbc", strict=False)
    except Exception as error:  # parsers raise errors of many kinds
        with suppress(Exception):  # the first error tells more
            database: Any = cantools.database.load_string(
                only_messages(text, mapped), database_format="dbc", strict=False
            )
            if database.messages:
                _logger.info("%s: only the mapped messages are valid: %s", origin, error)
                return database
        raise ConfigError(f"{origin} cannot be read as a DBC file: {error}", "Check the file.") from error


def _listed(names: Sequence[str]) -> str:
    more = f" and {len(names) - _LISTED} more" if len(names) > _LISTED else ""
    return (", ".join(names[:_LISTED]) or "none") + more
