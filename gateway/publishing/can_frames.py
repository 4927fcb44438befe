"""CAN frames of live outputs, declared once: the DBC file and the encoder come from the same table.

A wheel has a slot of sixteen identifiers; every frame has eight bytes, Intel byte order, a counter of four bits and for
each number a status of two bits. A number that is not known, or that does not fit its range, has its highest raw value
(of a signed signal the lowest) and the status `not_available`.
"""

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any, Final

from gateway.core.errors import ConfigError
from gateway.core.estimates.results import WheelState
from gateway.core.quantity import BusFrame, OnBus, Quantity
from gateway.core.quantity_catalogue import MOTION_FRAME, on_bus, unit_of

DEFAULT_BASE_ID: Final = 0x500
SLOTS: Final = 8
"""Wheels that have identifiers."""
_IDS_PER_SLOT: Final = 16
_GATEWAY_OFFSET: Final = SLOTS * _IDS_PER_SLOT
_LARGEST_STANDARD_ID: Final = 0x7FF
_LARGEST_ID: Final = 0x1FFFFFFF
_STANDARD_POSITIONS: Final = ("FL", "FR", "RL", "RR")
NODE: Final = "Treadlink"
_COUNTER_BITS: Final = 4


class Availability(IntEnum):
    """Status of a number in a frame."""

    INVALID = 0
    PROVISIONAL = 1
    VALID = 2
    NOT_AVAILABLE = 3


_STATUS_CHOICES: Final = {int(status): status.name.lower() for status in Availability}
STATE_NUMBERS: Final = {state: number for number, state in enumerate(WheelState)}
_STATE_CHOICES: Final = {number: state.name.lower() for state, number in STATE_NUMBERS.items()}


@dataclass(frozen=True, slots=True)
class FrameSignal:
    """A signal of a frame.

    Attributes:
        name: in the DBC file.
        bits: length.
        scale: physical value of one count.
        unit: of the physical value.
        comment: for users.
        is_signed: two's complement.
        choices: names of the raw values.
        is_number: whether its last raw value means that it is not known.
    """

    name: str
    bits: int
    scale: float = 1.0
    unit: str = ""
    comment: str = ""
    is_signed: bool = False
    choices: Mapping[int, str] | None = None
    is_number: bool = False

    @property
    def unknown(self) -> int:
        """Raw value of a number that is not known."""
        return -(1 << (self.bits - 1)) if self.is_signed else (1 << self.bits) - 1

    @property
    def limits(self) -> tuple[int, int]:
        """Lowest and highest raw value."""
        low = -(1 << (self.bits - 1)) if self.is_signed else 0
        high = (1 << (self.bits - self.is_signed)) - 1
        if self.is_number:
            return (low + 1, high) if self.is_signed else (low, high - 1)
        return low, high

    def raw(self, value: float) -> int | None:
        """Return the raw value, None when it is not finite or out of range."""
        if not math.isfinite(value):
            return None
        raw = round(value / self.scale)
        low, high = self.limits
        return raw if low <= raw <= high else None


def _number(name: str, bits: int, scale: float, unit: str, comment: str, *, signed: bool = False) -> FrameSignal:
    return FrameSignal(name, bits, scale, unit, comment, signed, is_number=True)


def _status(signal: str) -> FrameSignal:
    return FrameSignal(f"{signal}Status", 2, comment=f"validity of {signal}", choices=_STATUS_CHOICES)


@dataclass(frozen=True, slots=True)
class FrameLayout:
    """A frame of a wheel.

    Attributes:
        offset: identifier within the slot.
        name: behind the name of the wheel.
        comment: for users.
        signals: in their order, from bit 0 on, without a gap; the counter follows.
        estimates: signal of a number -> name of the estimate that it carries.
    """

    offset: int
    name: str
    comment: str
    signals: tuple[FrameSignal, ...]
    estimates: Mapping[str, str] = field(default_factory=dict)


_EACH_REVOLUTION: Final = "after each revolution"
_ALSO_AT_REST: Final = f"{_EACH_REVOLUTION}; once a second while the wheel does not roll"


def _estimate_layout(frame: BusFrame, quantities: Iterable[tuple[Quantity, OnBus]]) -> FrameLayout:
    """Return the frame of quantities: numbers with errors, then statuses; that of the motion has more between them."""
    numbers: list[FrameSignal] = []
    estimates: dict[str, str] = {}
    for quantity, bus in quantities:
        estimates[bus.signal], unit = quantity.name, unit_of(quantity.name)
        numbers.append(_number(bus.signal, 16, bus.resolution, unit, quantity.description, signed=bus.is_signed))
        if bus.std_resolution:
            numbers.append(_number(f"{bus.signal}Error", 8, bus.std_resolution, unit, "one standard error"))
    others = _MOTION_SIGNALS if frame == MOTION_FRAME else ()
    comment = _ALSO_AT_REST if others else _EACH_REVOLUTION
    return FrameLayout(*frame, comment, (*numbers, *others, *map(_status, estimates)), estimates)


_MOTION_SIGNALS: Final = (
    FrameSignal("Revolution", 16, comment="running number of the revolution, modulo 65536"),
    FrameSignal("State", 3, comment="motion of the wheel", choices=_STATE_CHOICES),
)
CONDITIONS: Final = FrameLayout(
    2,
    "Conditions",
    _ALSO_AT_REST,
    (
        _number("Pressure", 16, 10.0, "Pa", "inflation pressure (gauge)"),
        _number("Temperature", 16, 0.01, "degC", "inner liner", signed=True),
        _number("Load", 16, 1.0, "N", "stated vertical load"),
        _status("Pressure"),
        _status("Temperature"),
        _status("Load"),
    ),
)
ALARM_BITS: Final = (
    "pressure", "temperature", "load", "speed", "wear", "silent", "old environment", "saturated", "wrong sensor",
)  # fmt: skip
"""Names of alarms that have a bit of their own; others set the bit `OtherAlarm`."""


def _bit_name(alarm: str) -> str:
    return "".join(word.capitalize() for word in alarm.split()) + "Alarm"


ALARMS: Final = FrameLayout(
    6,
    "Alarms",
    "on change and once a second",
    (*(FrameSignal(_bit_name(name), 1) for name in ALARM_BITS), FrameSignal("OtherAlarm", 1)),
)
LAYOUTS: Final = {
    layout.name: layout
    for layout in sorted(
        (CONDITIONS, ALARMS, *(_estimate_layout(frame, quantities) for frame, quantities in on_bus().items())),
        key=lambda layout: layout.offset,
    )
}
"""Frames of a wheel by name, in the order of their identifiers."""
MOTION: Final = LAYOUTS[MOTION_FRAME.name]
GATEWAY: Final = FrameLayout(
    0,
    "Gateway",
    "once a second",
    (
        FrameSignal("Uptime", 32, unit="s", comment="since the session began"),
        FrameSignal("RollingWheels", 4),
        FrameSignal("StandingAlarms", 8, comment="alarms that stand, at most 255"),
        FrameSignal("LinksDown", 4, comment="links that deliver nothing, at most 15"),
        FrameSignal("Ended", 1, comment="1 in the last frame of a session"),
    ),
)
_COUNTER: Final = FrameSignal("Counter", _COUNTER_BITS, comment="counts the frames of this identifier, modulo 16")


@dataclass(frozen=True, slots=True)
class Frame:
    """A frame ready to be sent."""

    can_id: int
    is_extended: bool
    data: bytes


def check_base_id(base_id: int) -> int:
    """Return the identifier of the first frame if all frames fit.

    Raises:
        ConfigError: they do not.
    """
    last = base_id + _GATEWAY_OFFSET
    if base_id < 0 or last > _LARGEST_ID or base_id <= _LARGEST_STANDARD_ID < last:
        raise ConfigError(
            f"the base identifier {base_id:#x} leaves no room for {_GATEWAY_OFFSET + 1} identifiers",
            f"Give 0 to {_LARGEST_STANDARD_ID - _GATEWAY_OFFSET:#x}, or 0x800 to {_LARGEST_ID - _GATEWAY_OFFSET:#x}.",
        )
    return base_id


class FrameEncoder:
    """Assigns wheels to slots and encodes frames with their counters."""

    def __init__(self, base_id: int = DEFAULT_BASE_ID, positions: Sequence[str] = ()) -> None:
        """Assign the slots of FL, FR, RL and RR, then those of other configured wheels.

        Args:
            base_id: identifier of the first frame.
            positions: configured wheels, in the order of the vehicle file.
        """
        self._base_id = check_base_id(base_id)
        self._is_extended = base_id > _LARGEST_STANDARD_ID
        self._slots = slots_of(positions)
        self._counters: dict[int, int] = {}

    def wheel(self, position: str, layout: FrameLayout, values: Mapping[str, float]) -> Frame | None:
        """Return a frame of a wheel, None for a ninth wheel.

        Args:
            position: of the wheel; one that is not known yet gets the next free slot.
            layout: of the frame.
            values: physical values of the signals; a number without one is not available.
        """
        slot = self._slots.setdefault(position, len(self._slots))
        if slot >= SLOTS:
            return None
        return self._frame(self._base_id + slot * _IDS_PER_SLOT + layout.offset, layout, values)

    def gateway(self, values: Mapping[str, float]) -> Frame:
        """Return the frame of the gateway."""
        return self._frame(self._base_id + _GATEWAY_OFFSET, GATEWAY, values)

    def _frame(self, can_id: int, layout: FrameLayout, values: Mapping[str, float]) -> Frame:
        unknown: set[str] = set()
        fields: list[tuple[FrameSignal, int]] = []
        for signal in layout.signals:
            raw = signal.raw(values[signal.name]) if signal.name in values else None
            if raw is None:
                unknown.add(signal.name)
                raw = signal.unknown if signal.is_number else 0
            fields.append((signal, raw))
        counter = self._counters.get(can_id, 0)
        self._counters[can_id] = (counter + 1) % (1 << _COUNTER_BITS)
        word, start_bit = 0, 0
        for signal, raw in (*fields, (_COUNTER, counter)):
            # A value beyond the range of its signal has no valid status.
            is_unknown = signal.name.removesuffix("Status") in unknown and signal.name.endswith("Status")
            if is_unknown and (signal.name in unknown or raw != Availability.INVALID):
                raw = Availability.NOT_AVAILABLE
            word |= (raw & ((1 << signal.bits) - 1)) << start_bit
            start_bit += signal.bits
        return Frame(can_id, self._is_extended, word.to_bytes(8, "little"))


def slots_of(positions: Sequence[str]) -> dict[str, int]:
    """Return the slots of FL, FR, RL, RR and of the configured wheels beyond them."""
    return {name: slot for slot, name in enumerate(dict.fromkeys((*_STANDARD_POSITIONS, *positions)))}


def dbc_text(base_id: int = DEFAULT_BASE_ID, positions: Sequence[str] = ()) -> str:
    """Return the DBC file of all frames.

    Args:
        base_id: identifier of the first frame.
        positions: configured wheels; slots without a wheel are named Wheel5 and so on.
    """
    from cantools.database.can import Database, Message, Node

    check_base_id(base_id)
    is_extended = base_id > _LARGEST_STANDARD_ID
    names = {slot: re.sub(r"\W", "_", name) for name, slot in slots_of(positions).items()}
    messages = [
        Message(
            base_id + slot * _IDS_PER_SLOT + layout.offset,
            f"{names.get(slot, f'Wheel{slot + 1}')}_{layout.name}",
            8,
            _dbc_signals(layout),
            comment=layout.comment,
            senders=[NODE],
            is_extended_frame=is_extended,
        )
        for slot in range(SLOTS)
        for layout in LAYOUTS.values()
    ]
    messages.append(
        Message(
            base_id + _GATEWAY_OFFSET,
            f"{NODE}_{GATEWAY.name}",
            8,
            _dbc_signals(GATEWAY),
            comment=GATEWAY.comment,
            senders=[NODE],
            is_extended_frame=is_extended,
        )
    )
    database = Database(messages, [Node(NODE, "treadlink, the gateway of intelligent tires")], version="1")
    text: str = database.as_dbc_string()
    return text.replace("\r\n", "\n")


def _dbc_signals(layout: FrameLayout) -> list[Any]:
    from collections import OrderedDict

    from cantools.database.can import Signal
    from cantools.database.conversion import BaseConversion

    signals, start_bit = [], 0
    for signal in (*layout.signals, _COUNTER):
        low, high = signal.limits
        choices: OrderedDict[int, Any] = OrderedDict(sorted((signal.choices or {}).items()))
        if signal.is_number:
            choices[signal.unknown] = "not_available"
        signals.append(
            Signal(
                signal.name,
                start_bit,
                signal.bits,
                is_signed=signal.is_signed,
                conversion=BaseConversion.factory(scale=signal.scale, choices=choices or None),
                minimum=low * signal.scale,
                maximum=high * signal.scale,
                unit=signal.unit or None,
                comment=signal.comment or None,
            )
        )
        start_bit += signal.bits
    return signals
