"""Signals of the vehicle from what is recorded of it: frames of its bus, sentences of a positioning receiver."""

import math
from collections.abc import Iterator, Sequence
from pathlib import Path

from gateway.core.bounded_input import MAX_DBC_BYTES
from gateway.core.config.vehicle import VehicleConfig
from gateway.core.errors import ConfigError
from gateway.core.links.nmea_sentences import ReceiverClock, SentenceReader, can_read_sentences
from gateway.core.links.source import BusFrames, Sentences, VehicleData
from gateway.core.reasons import CoreCode, Reason
from gateway.vehicle.bus_decoding import BusDecoder
from gateway.vehicle.bus_signals import VehicleSignals
from gateway.vehicle.dbc_file import read_dbc
from gateway.vehicle.vehicle_signals import RECEIVER_SIGNALS, SignalHistory, SignalValue
from gateway.vehicle.vehicle_witness import VehicleJoin


class ReceiverDecoder:
    """Reads position, ground speed, course and time from the sentences of a receiver."""

    def __init__(self) -> None:
        """Start without a sentence."""
        self._reader = SentenceReader()
        self._clock = ReceiverClock()
        self._is_clock_told = self._is_missing_told = False

    def values(self, item: Sentences) -> Iterator[SignalValue]:
        """Yield the values in sentences, at their arrival."""
        for fix in self._reader.read(item.data):
            self._clock.take(fix, item.host_ns)
            if fix.has_position:
                measured = (fix.latitude_deg, fix.longitude_deg, fix.ground_speed_mps, fix.course_rad)
                for signal, value in zip(RECEIVER_SIGNALS, measured, strict=True):
                    if math.isfinite(value):
                        yield SignalValue(signal.key, item.host_ns, value)

    def take_notices(self) -> Iterator[Reason]:
        """Yield what is to be said of the receiver, each once."""
        if not self._is_missing_told and self._reader.sentences and not can_read_sentences():
            self._is_missing_told = True
            yield Reason(CoreCode.SENTENCES_UNREAD)
        ahead_s = self._clock.ahead_s
        if not self._is_clock_told and ahead_s is not None:
            self._is_clock_told = True
            yield Reason(CoreCode.RECEIVER_TIME, ahead_s=ahead_s)


class SignalDecoder:
    """Decodes what is recorded of the vehicle into the history of its signals.

    Attributes:
        history: of the signals.
        dbc_text: the DBC file in use, None without one.
        maps_bus: whether signals of the bus are mapped.
    """

    def __init__(self, bus: BusDecoder | None = None) -> None:
        """Start with the decoder of the bus; None where its frames are not decoded."""
        self._bus = bus
        self._receivers: dict[str, ReceiverDecoder] = {}
        of_bus = bus.signals if bus is not None else ()
        keys = {signal.key for signal in of_bus}
        # A logger on the bus may be the better receiver, as whoever has mapped it knows.
        self.history = SignalHistory((*of_bus, *(signal for signal in RECEIVER_SIGNALS if signal.key not in keys)))
        self._keys_of_bus = keys
        self.dbc_text = bus.dbc_text if bus is not None else None
        self.maps_bus = bus is not None
        self._joins: list[VehicleJoin] = []
        self._outside: list[tuple[str, Reason]] = []

    def witness(self) -> VehicleJoin:
        """Return what compares revolutions with the signals, as far as they are decoded."""
        self._joins.append(VehicleJoin(self.history))
        return self._joins[-1]

    def take(self, item: VehicleData) -> dict[str, float]:
        """Decode an item into the history; return the latest value of each signal in it."""
        latest: dict[str, float] = {}
        for key, host_ns, value in self._values(item):
            self.history.add(key, host_ns, value)
            latest[key] = value
        if latest:
            reasons = (join.take_outside() for join in self._joins)
            self._outside += [(item.link, reason) for reason in reasons if reason is not None]
        return latest

    def take_notices(self) -> list[tuple[str, Reason]]:
        """Return what is to be said of receivers and buses since the last call, with their links."""
        of_receivers = [(link, reason) for link, feed in self._receivers.items() for reason in feed.take_notices()]
        outside, self._outside = self._outside, []
        return [*of_receivers, *outside, *(self._bus.take_notices() if self._bus is not None else ())]

    def _values(self, item: VehicleData) -> Iterator[SignalValue]:
        if isinstance(item, BusFrames):
            if self._bus is not None:
                yield from self._bus.values(item)
            return
        receiver = self._receivers.setdefault(item.link, ReceiverDecoder())
        yield from (value for value in receiver.values(item) if value.key not in self._keys_of_bus)


def open_decoder(
    vehicle: VehicleConfig | None, config_path: Path | None, given: Sequence[str | None], recorded: Sequence[str | None]
) -> SignalDecoder:
    """Return the decoder of a vehicle's signals.

    Its bus is not decoded where the vehicle file maps no signal or no DBC file is known.

    Args:
        vehicle: its configuration.
        config_path: file of the configuration where the user gave one; its `dbc` is relative to it.
        given: texts of DBC files given with sources.
        recorded: texts of DBC files in recordings.

    Raises:
        ConfigError: the DBC file cannot be read, or does not fit the configuration.
    """
    mapping = vehicle.added(VehicleSignals) if vehicle is not None else None
    if mapping is None or not mapping.signal:
        return SignalDecoder()
    text, origin = next((text for text in given if text), None), "the DBC file of the source"
    if text is None and config_path is not None and mapping.dbc is not None:
        path = config_path.parent / mapping.dbc
        origin = str(path)
        try:
            text = read_dbc(path)
        except OSError as error:
            raise ConfigError(
                f"cannot read the DBC file '{path}': {error.strerror}",
                "Correct vehicle_signals.dbc in the vehicle file.",
            ) from error
        if text is None:
            raise ConfigError(
                f"the DBC file '{path}' is larger than {MAX_DBC_BYTES >> 20} MiB",
                "Correct vehicle_signals.dbc in the vehicle file.",
            )
    if text is None:
        text, origin = next((text for text in recorded if text), None), "the DBC file in the recording"
    if text is None:
        return SignalDecoder()
    return SignalDecoder(BusDecoder(mapping.setups(), mapping.max_age_s, text, origin, is_j1939=mapping.j1939))
