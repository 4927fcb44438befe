"""Sessions with hubs on Bluetooth: from simulated tires to estimates, and commands to hubs."""

import queue
import threading
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from firmware_protocol.codec import encode_frame
from firmware_protocol.decoder import FrameDecoder
from firmware_protocol.messages import (
    HUB_ITSELF,
    Challenge,
    CommandResult,
    Frame,
    HubStatus,
    LogText,
    Message,
    MessageType,
    Outcome,
    SetRate,
    SetStream,
    SetTime,
    TimeSync,
)
from gateway.core.clock import ManualClock, SystemClock
from gateway.core.config.vehicle import parse_vehicle
from gateway.core.errors import SourceError
from gateway.core.estimates.results import RevolutionResult
from gateway.core.links.ble_source import BleSource
from gateway.core.links.reasons import LinkCode
from gateway.core.links.source import Chunk, LinkEvent, LinkEventKind, Source, TwoWaySource, open_source
from gateway.core.session.core import SessionCore
from gateway.core.session.hub_log import refusal
from gateway.core.session.live import LiveSession
from gateway.core.session.reasons import SessionCode
from gateway.core.text.wording import text
from gateway.security.command_signing import command_frame
from gateway.security.hub_commands import execute, with_commands
from gateway.simulator.scenario import parse_scenario, vehicle_toml
from gateway.simulator.simulation import simulate
from gateway.simulator.simulator_source import SimulatorSource
from tests.testkit.bluetooth.bluez_thread import BluezStandIn
from tests.testkit.bluetooth.hubs import BleHub, ble_hubs, broadcast
from tests.testkit.bluetooth.peripheral import Peripheral
from tests.testkit.hub_ends import TIMEOUT_S, Reader
from tests.testkit.waiting import until

Read = Callable[[Source], Reader]
NOW_NS = 1_700_000_000_000_000_000
# One hub a wheel, as collectors are mounted.
SCENARIO = Path(__file__).with_name("one_wheel.toml").read_text()


@contextmanager
def broadcasting(bluez: BluezStandIn) -> Iterator[dict[int, BleHub]]:
    scenario = parse_scenario(SCENARIO, "test")
    hubs = ble_hubs(scenario)
    for hub in hubs.values():
        bluez.add(hub.peripheral)
    source = SimulatorSource(simulate(scenario), "sim:test", vehicle_toml(scenario), 1.0, SystemClock())
    stop = threading.Event()
    thread = threading.Thread(target=broadcast, args=(source, hubs, bluez, stop))
    thread.start()
    try:
        yield hubs
    finally:
        stop.set()
        thread.join(TIMEOUT_S)
        assert not thread.is_alive()


def test_one_hub_per_wheel_gives_estimates(bluez: BluezStandIn) -> None:
    with broadcasting(bluez) as hubs:
        clock = SystemClock()
        uris = ["ble://Treadlink-FL?scan=20", "ble://Treadlink-FR?scan=20&rate=4800"]
        sources = [with_commands(open_source(uri, clock), clock) for uri in uris]
        vehicle = parse_vehicle(vehicle_toml(parse_scenario(SCENARIO, "test")), "test")
        live = LiveSession(sources, SessionCore(vehicle), clock, patient=[False, False])
        live.start()
        results: list[RevolutionResult] = []

        def have_rolled() -> bool:
            results.extend(live.results())
            counts = Counter(result.position for result in results)
            return min(counts["FL"], counts["FR"]) >= 3

        until(have_rolled)
        snapshot = live.close()
        assert {result.position for result in results} == {"FL", "FR"}
        assert all(result.revolution.omega_radps == pytest.approx(90 / 3.6 / 0.32, rel=0.05) for result in results)
        for link, battery in zip(snapshot.links, (61, 62), strict=True):
            assert link.frames_lost == link.crc_errors == link.noise_bytes == 0
            assert link.battery_percent == battery
            assert link.rssi_dbm == -62  # of the sensor link, from the hub's status
            assert not link.connected
            assert LinkCode.LINK_DISCONNECTED in [reason.code for reason in link.note]
        assert [hub._host_ns > NOW_NS for hub in hubs.values()] == [True, True]
        assert not any(hub.peripheral.connected for hub in hubs.values())


def test_commands_are_executed_with_a_reply(bluez: BluezStandIn) -> None:
    with broadcasting(bluez):

        def send(command: SetStream | SetRate | SetTime) -> int:
            source = open_source("ble://Treadlink-FR?scan=20", SystemClock())
            assert isinstance(source, TwoWaySource)
            return execute(source, command, SystemClock(), timeout_s=TIMEOUT_S).hub

        assert send(SetStream(False)) == 1
        assert send(SetRate(4790.0)) == 1
        with pytest.raises(SourceError, match="hub 1 did not execute SET_RATE: it refused the value"):
            send(SetRate(9600.0))
        types = set()
        source = open_source("ble://Treadlink-FR?scan=20", SystemClock())
        stop, decoder = threading.Event(), FrameDecoder()
        for item in source.items(stop):
            for frame in decoder.feed(item.data) if isinstance(item, Chunk) else ():
                types.add(frame.type)
            if MessageType.TIME_SYNC in types and MessageType.ENVIRONMENT in types:
                stop.set()
        assert MessageType.SAMPLES not in types
        assert decoder.counters.lost == 0, "frames that are not sent must not count as lost"
        assert send(SetStream(True)) == 1


class RecordingHub:
    """A hub that records its commands and sends no reply."""

    def __init__(self, peripheral: Peripheral) -> None:
        self.received: queue.Queue[Frame] = queue.Queue()
        self._decoder = FrameDecoder()
        peripheral.on_write = self._take
        peripheral.on_notifying = self._connection

    def _take(self, data: bytes) -> None:
        for frame in self._decoder.feed(data):
            self.received.put(frame)

    def _connection(self, listening: bool) -> None:
        self._decoder = FrameDecoder()

    def next(self) -> tuple[int, Message]:
        frame = self.received.get(timeout=TIMEOUT_S)
        return frame.seq, frame.message


def test_settings_are_sent_at_every_connection(bluez: BluezStandIn, hub: Peripheral, read: Read) -> None:
    clock = ManualClock(NOW_NS)
    recording = RecordingHub(hub)
    source = with_commands(open_source("ble://Treadlink-FL?scan=20&rate=9600", clock), clock)
    reader = read(source)
    reader.event(LinkEventKind.CONNECTED)
    assert [recording.next() for _ in range(3)] == [
        (0, SetTime(NOW_NS)),
        (1, SetRate(9600.0)),
        (2, SetStream(True)),
    ]
    bluez.run(bluez.service.lose(hub, advertising=True))
    reader.event(LinkEventKind.LOST)
    reader.event(LinkEventKind.RESTORED)
    commands = [recording.next() for _ in range(3)]
    assert [seq for seq, _ in commands] == [0, 1, 2]
    assert commands[1:] == [(1, SetRate(9600.0)), (2, SetStream(True))]
    assert isinstance(commands[0][1], SetTime)
    assert commands[0][1].host_ns > NOW_NS


def test_missing_reply_is_an_error(bluez: BluezStandIn, hub: Peripheral) -> None:
    RecordingHub(hub)
    source = open_source("ble://Treadlink-FL?scan=20", SystemClock())
    assert isinstance(source, BleSource)
    with pytest.raises(SourceError, match="did not reply"):
        execute(source, SetStream(True), SystemClock(), timeout_s=0.2)
    assert not hub.connected


def test_hub_lost_before_its_reply(bluez: BluezStandIn, hub: Peripheral) -> None:
    hub.on_write = lambda _: bluez.service._spawn(bluez.service.lose(hub))
    source = open_source("ble://Treadlink-FL?scan=20", SystemClock())
    assert isinstance(source, BleSource)
    with pytest.raises(SourceError, match="lost unexpectedly"):
        execute(source, SetStream(True), SystemClock(), timeout_s=TIMEOUT_S)


def test_read_only_sources_are_not_wrapped() -> None:
    source = open_source("sim:lab", ManualClock())
    assert with_commands(source, ManualClock()) is source


def test_commands_address_every_hub() -> None:
    (frame,) = FrameDecoder().feed(command_frame(SetTime(5), 7))
    assert frame == Frame(MessageType.SET_TIME, 255, 255, 7, 0, SetTime(5))


@pytest.mark.parametrize(
    ("result", "words"),
    [
        (CommandResult(1, MessageType.SET_RATE, Outcome.DONE), None),
        (
            CommandResult(1, MessageType.SET_RATE, Outcome.VALUE_REFUSED),
            "did not execute SET_RATE: it refused the value",
        ),
        (CommandResult(1, 99, Outcome.UNKNOWN_COMMAND), "did not execute command 99: it does not know the command"),
        (CommandResult(1, MessageType.HELLO, 200), "did not execute command 1: outcome 200"),
    ],
)
def test_refusals_have_a_reason(result: CommandResult, words: str | None) -> None:
    refused = refusal(result)
    assert (None if refused is None else text(refused)) == words


def test_refusal_and_signal_are_reported() -> None:
    core = SessionCore(None)
    core.take(LinkEvent("ble:x", NOW_NS, LinkEventKind.CONNECTED, rssi_dbm=-71))
    assert core.snapshot(0.0).links[0].rssi_dbm == -71
    refused = CommandResult(1, MessageType.SET_RATE, Outcome.VALUE_REFUSED)
    for seq, message in enumerate([refused, HubStatus(0, 5, 3.0, 0.1, None, 0, 0, 0, 0)]):
        type_ = MessageType.COMMAND_RESULT if isinstance(message, CommandResult) else MessageType.HUB_STATUS
        core.take(Chunk("ble:x", NOW_NS, encode_frame(Frame(type_, 3, HUB_ITSELF, seq, 0, message))))
    notice = core.take_notices()[-1]
    assert (notice.subject, notice.reason.code) == ("hub 3", SessionCode.COMMAND_REFUSED)
    assert core.snapshot(0.0).links[0].rssi_dbm == -71
    status = HubStatus(0, 5, 3.0, 0.1, -40, 0, 0, 0, 0)
    core.take(Chunk("ble:x", NOW_NS, encode_frame(Frame(MessageType.HUB_STATUS, 3, HUB_ITSELF, 2, 0, status))))
    assert core.snapshot(0.0).links[0].rssi_dbm == -40


def test_hub_counts_nothing_without_a_listener() -> None:
    hub = BleHub(0, Peripheral("00:00:5E:00:53:00", "X"))
    frames = [Frame(MessageType.LOG_TEXT, 0, HUB_ITSELF, seq, 0, LogText(1, "x")) for seq in range(5)]
    assert [list(hub.outgoing(frame)) for frame in frames[:3]] == [[], [], []]
    hub.peripheral.notifying = True
    (first,) = FrameDecoder().feed(b"".join(hub.outgoing(frames[3])))
    assert first.seq == 0
    hub.peripheral.on_write(command_frame(SetTime(77), 0))  # type: ignore[misc]
    sync = Frame(MessageType.TIME_SYNC, 0, HUB_ITSELF, 9, 0, TimeSync(5, 0))
    answer, echo = FrameDecoder().feed(b"".join(hub.outgoing(sync)))
    assert answer.message == CommandResult(0, MessageType.SET_TIME, Outcome.DONE)
    assert echo.message == TimeSync(5, 77)
    assert (answer.seq, echo.seq) == (1, 2)


def test_hub_without_a_key_refuses_a_challenge() -> None:
    hub = BleHub(0, Peripheral("00:00:5E:00:53:00", "X"))
    hub.peripheral.notifying = True
    hub.peripheral.on_write(command_frame(Challenge(7), 3))  # type: ignore[misc]
    sync = Frame(MessageType.TIME_SYNC, 0, HUB_ITSELF, 9, 0, TimeSync(5, 0))
    answer, _ = FrameDecoder().feed(b"".join(hub.outgoing(sync)))
    assert answer.message == CommandResult(3, MessageType.CHALLENGE, Outcome.UNKNOWN_COMMAND)
