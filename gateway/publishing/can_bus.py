"""Live output as frames on a CAN bus."""

from __future__ import annotations

import math
import threading
from collections.abc import Iterator, Mapping
from contextlib import suppress
from typing import Any, Final

import can

from gateway.core.errors import ConfigError
from gateway.core.estimates.estimator import Estimate
from gateway.core.estimates.results import RevolutionResult, SessionSnapshot, WheelSnapshot, WheelState
from gateway.publishing.can_frames import (
    ALARM_BITS,
    ALARMS,
    CONDITIONS,
    DEFAULT_BASE_ID,
    LAYOUTS,
    MOTION,
    STATE_NUMBERS,
    Availability,
    Frame,
    FrameEncoder,
    check_base_id,
)
from gateway.publishing.sink import (
    Item,
    PublishedAlarm,
    PublishedRevolution,
    Sink,
    SinkAddress,
    SinkDownError,
    SinkError,
    SinkSetting,
)
from gateway.vehicle.can_source import bus_option, error_text

_SEND_S: Final = 0.1
_ATTEMPTS: Final = 10
_DRAINED_PER_POLL: Final = 1000


def open_can(address: SinkAddress, setting: SinkSetting) -> CanSink:
    """Return the output of `can:INTERFACE:CHANNEL?base_id=0x500&bitrate=500000`, as python-can names them.

    Raises:
        SinkError: address or option cannot be used.
    """
    interface, _, channel = address.target.partition(":")
    if interface not in can.VALID_INTERFACES or not channel:
        raise SinkError(
            f"'{address.name}' does not name a CAN interface and its channel",
            f"Write can:INTERFACE:CHANNEL, for example can:socketcan:can0; interfaces: "
            f"{', '.join(sorted(can.VALID_INTERFACES))}.",
        )
    options: dict[str, Any] = {name: bus_option(value) for name, value in address.options.items()}
    base_id = options.pop("base_id", DEFAULT_BASE_ID)
    if not isinstance(base_id, int):
        raise SinkError(f"'{address.name}': base_id={base_id} is not a number", "Give it as 0x500 or 1280.")
    try:
        check_base_id(base_id)
    except ConfigError as error:
        raise SinkError(f"'{address.name}': {error}", error.remedy) from error
    return CanSink(interface, channel, options, FrameEncoder(base_id, setting.positions))


class CanSink(Sink):
    """Sends the frames of `gateway.publishing.can_frames`; `treadlink protocol dbc` describes them."""

    def __init__(self, interface: str, channel: str, options: Mapping[str, Any], encoder: FrameEncoder) -> None:
        """Prepare the bus; `options` go to python-can."""
        self._interface, self._channel, self._options = interface, channel, dict(options)
        self._encoder = encoder
        self._bus: can.BusABC | None = None
        self._alarms: dict[str, frozenset[str]] = {}
        self._wheels: frozenset[str] = frozenset()
        # Wheels whose pressure and temperature are old by the last state.
        self._old: frozenset[str] = frozenset()

    def open(self, stop: threading.Event) -> None:
        """Open the bus."""
        try:
            self._bus = can.Bus(channel=self._channel, interface=self._interface, **self._options)
        except Exception as error:  # each interface raises errors of its own
            raise SinkDownError(f"cannot open {self._interface}:{self._channel}: {error_text(error)}") from error

    def send(self, item: Item, stop: threading.Event) -> None:
        """Send the frames of an item."""
        frames: Iterator[Frame | None]
        if isinstance(item, PublishedRevolution):
            frames = self._revolution(item.result)
        elif isinstance(item, PublishedAlarm):
            change = item.change
            standing = self._alarms.get(change.alarm.position, frozenset())
            names = standing | {change.alarm.name} if change.is_raised else standing - {change.alarm.name}
            self._alarms[change.alarm.position] = frozenset(names)
            frames = iter([self._alarm_bits(change.alarm.position)] if change.alarm.position in self._wheels else [])
        else:
            frames = self._state(item.snapshot)
        for frame in frames:
            if frame is not None:
                self._send(frame, stop)

    def poll(self) -> None:
        """Empty the bus's own buffer: this output reads nothing."""
        if self._bus is None:
            return
        try:
            for _ in range(_DRAINED_PER_POLL):
                if self._bus.recv(0.0) is None:
                    break
        except Exception as error:  # likewise
            raise SinkDownError(f"the bus failed: {error_text(error)}") from error

    def close(self) -> None:
        """Release the bus."""
        if self._bus is not None:
            with suppress(Exception):  # of an adapter that is gone
                self._bus.shutdown()
            self._bus = None

    def _send(self, frame: Frame, stop: threading.Event) -> None:
        message = can.Message(arbitration_id=frame.can_id, is_extended_id=frame.is_extended, data=frame.data)
        assert self._bus is not None
        for attempt in range(1, _ATTEMPTS + 1):
            try:
                self._bus.send(message, _SEND_S)
            except can.CanError as error:
                # A full buffer empties, unless nothing on the bus acknowledges.
                if attempt == _ATTEMPTS or stop.wait(_SEND_S):
                    raise SinkDownError(f"the bus takes no frames: {error}") from error
            except Exception as error:  # likewise
                raise SinkDownError(f"the bus failed: {error_text(error)}") from error
            else:
                return

    def _revolution(self, result: RevolutionResult) -> Iterator[Frame | None]:
        estimates = {estimate.name: estimate for estimate in result.estimates}
        position, conditions = result.position, result.conditions
        self._wheels |= {position}
        physical_values = {"Load": conditions.load_n}
        if position not in self._old:
            physical_values |= {"Pressure": conditions.pressure_pa, "Temperature": conditions.temperature_degc}
        values: dict[str, float] = {
            "Revolution": result.revolution.index % 65536,
            "State": STATE_NUMBERS[WheelState.ROLLING],
        }
        for layout in LAYOUTS.values():
            if layout is not ALARMS:
                values |= _values(estimates, layout.estimates)
                yield self._encoder.wheel(position, layout, values | _known_signals(physical_values))

    def _state(self, snapshot: SessionSnapshot) -> Iterator[Frame | None]:
        self._wheels = frozenset(wheel.position for wheel in snapshot.wheels)
        self._old = frozenset(wheel.position for wheel in snapshot.wheels if not wheel.has_current_environment)
        for wheel in snapshot.wheels:
            self._alarms[wheel.position] = frozenset(
                alarm.name for alarm in snapshot.alarms if alarm.position == wheel.position
            )
            if wheel.state is not WheelState.ROLLING:
                yield from self._resting(wheel)
            yield self._alarm_bits(wheel.position)
        yield self._encoder.gateway(
            {
                "Uptime": int(snapshot.elapsed_s),
                "RollingWheels": min(sum(wheel.state is WheelState.ROLLING for wheel in snapshot.wheels), 15),
                "StandingAlarms": min(len(snapshot.alarms), 255),
                "LinksDown": min(sum(not link.connected for link in snapshot.links), 15),
                "Ended": int(snapshot.ended),
            }
        )

    def _resting(self, wheel: WheelSnapshot) -> Iterator[Frame | None]:
        """Yield the frames of a wheel that does not roll: no speed, and pressure and temperature as far as known."""
        revolution = wheel.last.revolution.index % 65536 if wheel.last is not None else 0
        yield self._encoder.wheel(
            wheel.position, MOTION, {"Revolution": revolution, "State": STATE_NUMBERS[wheel.state]}
        )
        values = {"Load": wheel.load_n if wheel.silence is None and "load_n" in wheel.stated else None}
        if wheel.has_current_environment:
            values |= {"Pressure": wheel.pressure_pa, "Temperature": wheel.temperature_degc}
        yield self._encoder.wheel(wheel.position, CONDITIONS, _known_signals(values))

    def _alarm_bits(self, position: str) -> Frame | None:
        names = self._alarms.get(position, frozenset())
        bits = (*(name in names for name in ALARM_BITS), bool(names.difference(ALARM_BITS)))
        values = {signal.name: bit for signal, bit in zip(ALARMS.signals, bits, strict=True)}
        return self._encoder.wheel(position, ALARMS, values)


def _values(estimates: Mapping[str, Estimate], names: Mapping[str, str]) -> dict[str, float]:
    """Return signals with value, error and status of estimates; an invalid one has no value."""
    values: dict[str, float] = {}
    for signal, name in names.items():
        estimate = estimates.get(name)
        if estimate is None:
            continue
        if math.isfinite(estimate.value):
            values[signal] = estimate.value
            values[f"{signal}Error"] = estimate.std
        values[f"{signal}Status"] = Availability[estimate.status.name]
    return values


def _known_signals(numbers: Mapping[str, float | None]) -> dict[str, float]:
    """Return signals of known numbers, with their status."""
    values: dict[str, float] = {}
    for signal, value in numbers.items():
        if value is not None:
            values[signal] = value
            values[f"{signal}Status"] = Availability.VALID
    return values
