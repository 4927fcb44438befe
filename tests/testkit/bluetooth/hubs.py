"""The hubs of a scenario as BLE peripherals: they stream to subscribers and execute commands."""

import queue
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from typing import Final

from firmware_protocol.codec import encode_frame
from firmware_protocol.decoder import FrameDecoder
from firmware_protocol.messages import (
    COMMANDS,
    EVERY_HUB,
    HUB_ITSELF,
    Command,
    CommandResult,
    Frame,
    Hello,
    HubStatus,
    Message,
    MessageType,
    Outcome,
    SampleBlock,
    SetRate,
    SetStream,
    SetTime,
    TimeSync,
)
from gateway.core.links.source import Chunk
from gateway.simulator.scenario_model import Scenario
from gateway.simulator.simulator_source import SimulatorSource
from tests.testkit.bluetooth.bluez_thread import BluezStandIn
from tests.testkit.bluetooth.peripheral import Peripheral

_MASK: Final = 0xFFFF_FFFF
_RATE_TOLERANCE: Final = 0.01
# Addresses reserved by IANA for documentation.
_ADDRESS: Final = "00:00:5E:00:53:{:02X}"
_RSSI_DBM: Final = -58


class BleHub:
    """One simulated hub: receives the frames of the simulation and yields those sent over Bluetooth.

    Without a listener nothing is sent or counted as sent. All methods may be called from any thread.

    Attributes:
        peripheral: its Bluetooth peripheral.
        number: of the hub.
        on_listening: called when a client subscribes or unsubscribes.
    """

    def __init__(self, number: int, peripheral: Peripheral) -> None:
        """Connect the hub with its peripheral."""
        self.number = number
        self.peripheral = peripheral
        peripheral.on_write = self._take_bytes
        peripheral.on_notifying = self._connection
        self.on_listening: Callable[[bool], None] | None = None
        self._commands: queue.SimpleQueue[Frame] = queue.SimpleQueue()
        self._decoder = FrameDecoder()
        self._seq: dict[int, int] = {}
        self._streaming: dict[int, bool] = {}
        self._rate_hz: float | None = None
        self._host_ns = 0
        self._sent = 0

    def outgoing(self, frame: Frame) -> Iterator[bytes]:
        """Yield the replies to received commands, then the frame itself unless the stream is stopped."""
        message = frame.message
        if isinstance(message, Hello):
            self._rate_hz = message.rate_hz
        with suppress(queue.Empty):
            while True:
                answer = self._carry_out(self._commands.get_nowait())
                if answer is not None and self.peripheral.notifying:
                    yield self._numbered(frame._replace(type=MessageType.COMMAND_RESULT, wheel=HUB_ITSELF), answer)
        if not self.peripheral.notifying:
            return
        if isinstance(message, SampleBlock) and not self._streaming.get(frame.wheel, True):
            return
        if isinstance(message, HubStatus):
            message = message._replace(frames_sent=self._sent & _MASK)
        elif isinstance(message, TimeSync):
            message = message._replace(host_ns=self._host_ns)
        yield self._numbered(frame, message)

    def _numbered(self, frame: Frame, message: Message) -> bytes:
        seq = self._seq.get(frame.wheel, 0)
        self._seq[frame.wheel] = (seq + 1) & _MASK
        self._sent += 1
        return encode_frame(frame._replace(seq=seq, message=message))

    def _connection(self, listening: bool) -> None:
        # Every connection counts its commands from 0.
        self._decoder = FrameDecoder()
        if self.on_listening is not None:
            self.on_listening(listening)

    def _take_bytes(self, data: bytes) -> None:
        for frame in self._decoder.feed(data):
            if frame.type in COMMANDS and frame.hub in (self.number, EVERY_HUB):
                self._commands.put(frame)

    def _carry_out(self, frame: Frame) -> CommandResult | None:
        command = frame.message
        if not isinstance(command, Command):
            return None
        outcome = Outcome.DONE
        if isinstance(command, SetStream):
            if frame.wheel == HUB_ITSELF:
                self._streaming = dict.fromkeys(range(HUB_ITSELF), command.running)
            else:
                self._streaming[frame.wheel] = command.running
        elif isinstance(command, SetTime):
            self._host_ns = command.host_ns
        elif isinstance(command, SetRate):
            # The scenario was solved for one rate, so the hub supports only that one.
            near = self._rate_hz is not None and abs(command.rate_hz - self._rate_hz) < _RATE_TOLERANCE * self._rate_hz
            outcome = Outcome.DONE if near else Outcome.VALUE_REFUSED
        else:
            outcome = Outcome.UNKNOWN_COMMAND  # without a key there is no answer to a challenge
        return CommandResult(frame.seq, frame.type, outcome)


def ble_hubs(scenario: Scenario) -> dict[int, BleHub]:
    """Return the scenario's hubs by number; one with a single wheel is named after it."""
    hubs: dict[int, BleHub] = {}
    for number, hub in enumerate(scenario.hubs()):
        wheels = [wheel.position for wheel in scenario.wheels() if wheel.hub == hub.hub]
        name = f"Treadlink-{wheels[0] if len(wheels) == 1 else hub.hub}"
        battery = None if hub.battery_percent is None else round(hub.battery_percent)
        peripheral = Peripheral(_ADDRESS.format(number), name, rssi_dbm=_RSSI_DBM, battery_percent=battery)
        hubs[hub.hub] = BleHub(hub.hub, peripheral)
    return hubs


def broadcast(
    source: SimulatorSource, hubs: Mapping[int, BleHub], bluez: BluezStandIn, stop: threading.Event
) -> Mapping[int, int]:
    """Send a simulation's frames until it ends or `stop` is set; return the number of notifications of each hub."""
    decoder = FrameDecoder()
    sent = dict.fromkeys(hubs, 0)
    for item in source.items(stop):
        if not isinstance(item, Chunk):
            continue
        waiting: dict[int, list[bytes]] = {}
        for frame in decoder.feed(item.data):
            if frame.hub in hubs:
                waiting.setdefault(frame.hub, []).extend(hubs[frame.hub].outgoing(frame))
        for number, payloads in waiting.items():
            if payloads:
                sent[number] += bluez.run(bluez.service.notify(hubs[number].peripheral, payloads))
    return sent
