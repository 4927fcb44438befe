"""Hubs on Bluetooth LE: bleak on a private D-Bus with a stand-in for BlueZ."""

import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from dbus_fast import Variant

from firmware_protocol.codec import encode_frame
from firmware_protocol.decoder import FrameDecoder
from firmware_protocol.messages import Frame, MessageType, SampleBlock
from gateway.core.clock import ManualClock
from gateway.core.errors import LinkLostError, SourceError
from gateway.core.links import ble_radio
from gateway.core.links.ble_link import BleLink, BleSettings
from gateway.core.links.ble_source import BleSource, scan_devices
from gateway.core.links.reasons import LinkCode
from gateway.core.links.source import LinkEventKind, Source, open_source
from gateway.core.reasons import Reason
from gateway.core.text.wording import text
from tests.core.ble.conftest import ADDRESSES
from tests.testkit.bluetooth.bluez_thread import BluezStandIn
from tests.testkit.bluetooth.peripheral import DEVICE, UART_FROM_HUB, UART_TO_HUB, Peripheral
from tests.testkit.hub_ends import TIMEOUT_S, Reader

Read = Callable[[Source], Reader]
SCAN = "scan=20"


def opened(target: str, options: str = SCAN, clock: ManualClock | None = None) -> BleSource:
    source = open_source(f"ble://{target}?{options}", clock or ManualClock())
    assert isinstance(source, BleSource)
    return source


def frames(count: int, start: int = 0) -> list[bytes]:
    counts = np.arange(36 * 3, dtype=np.int16).reshape(36, 3)
    return [
        encode_frame(Frame(MessageType.SAMPLES, 0, 0, seq, 0, SampleBlock(seq * 36, 0b111, counts)))
        for seq in range(start, start + count)
    ]


def data(reader: Reader, count: int) -> bytes:
    return b"".join(chunk.data for chunk in reader.bytes(count))


def send(bluez: BluezStandIn, hub: Peripheral, payloads: list[bytes]) -> None:
    assert bluez.run(bluez.service.notify(hub, payloads)) == len(payloads)


def test_links_that_are_opened_at_once_share_one_radio(monkeypatch: pytest.MonkeyPatch) -> None:
    both = threading.Barrier(2)

    def made() -> object:
        with suppress(threading.BrokenBarrierError):
            both.wait(0.1)  # until another thread also makes one
        return object()

    monkeypatch.setattr(ble_radio, "_made_radio", cache(made))
    with ThreadPoolExecutor(2) as threads:
        first, second = (threads.submit(ble_radio.radio) for _ in range(2))
    assert first.result() is second.result()


def test_scan_reports_signal_and_battery(bluez: BluezStandIn, hub: Peripheral) -> None:
    bluez.add(Peripheral(ADDRESSES[1], "Headphones", rssi_dbm=-40, service="0000110b-0000-1000-8000-00805f9b34fb"))
    around = scan_devices(0.2)
    assert around.fault is None
    assert [(s.name, s.rssi_dbm, s.battery_percent, s.is_hub) for s in around.sightings] == [
        ("Headphones", -40, None, False),
        ("Treadlink-FL", -57, 83, True),
    ]


@pytest.mark.parametrize("target", ["Treadlink-FL", "treadlink-fl", ADDRESSES[0], ADDRESSES[0].lower()])
def test_hub_is_found_by_name_and_address(bluez: BluezStandIn, hub: Peripheral, read: Read, target: str) -> None:
    reader = read(opened(target))
    connected = reader.event(LinkEventKind.CONNECTED)
    assert connected.rssi_dbm == -57
    for words in ("Treadlink-FL", ADDRESSES[0], "MTU 247", "battery 83 %"):
        assert words in text(connected.reason)
    send(bluez, hub, [b"hello"])
    assert data(reader, 5) == b"hello"


def test_twenty_thousand_notifications_arrive_in_order(bluez: BluezStandIn, hub: Peripheral, read: Read) -> None:
    payloads = [bytes(row) for row in np.random.default_rng(7).integers(0, 256, (20_000, 244), dtype=np.uint8)]
    reader = read(opened("Treadlink-FL"))
    reader.event(LinkEventKind.CONNECTED)
    send(bluez, hub, payloads)
    assert data(reader, 20_000 * 244) == b"".join(payloads)


def test_twenty_thousand_notifications_by_socket(bluez: BluezStandIn, hub: Peripheral, read: Read) -> None:
    payloads = [bytes(row) for row in np.random.default_rng(8).integers(0, 256, (20_000, 244), dtype=np.uint8)]
    reader = read(opened("Treadlink-FL", f"{SCAN}&notify=socket"))
    reader.event(LinkEventKind.CONNECTED)
    # The buffer of the socket holds 167 of them, and BlueZ drops the rest: no larger bursts.
    for index in range(0, len(payloads), 160):
        burst = payloads[index : index + 160]
        send(bluez, hub, burst)
        assert data(reader, 244 * len(burst)) == b"".join(burst)


def test_frames_split_over_notifications_and_merged_in_one(bluez: BluezStandIn, hub: Peripheral, read: Read) -> None:
    hub.mtu = 517
    sent = frames(40)
    stream = b"".join(sent)
    split = [stream[index : index + 20] for index in range(0, len(stream) // 2, 20)]
    merged = [stream[index : index + 514] for index in range(20 * len(split), len(stream), 514)]
    reader, decoder = read(opened("Treadlink-FL")), FrameDecoder()
    reader.event(LinkEventKind.CONNECTED)
    send(bluez, hub, split + merged)
    got = [frame.seq for chunk in reader.bytes(len(stream)) for frame in decoder.feed(chunk.data)]
    assert got == list(range(40))
    assert decoder.counters.crc_errors == decoder.counters.noise_bytes == 0


def test_link_lost_inside_a_frame_loses_that_frame(bluez: BluezStandIn, hub: Peripheral, read: Read) -> None:
    hub.mtu = 185  # a frame takes two notifications
    reader, decoder = read(opened("Treadlink-FL")), FrameDecoder()
    assert Reason(LinkCode.MTU_TOO_SMALL, mtu=185, needed=247) in reader.event(LinkEventKind.CONNECTED).details
    before, cut, after = frames(5), frames(1, 5), frames(5, 6)
    halves = [half for frame in before for half in (frame[:182], frame[182:])]
    send(bluez, hub, [*halves, cut[0][:182]])
    received = data(reader, 5 * 242 + 182)
    bluez.run(bluez.service.lose(hub, advertising=True))
    lost = reader.event(LinkEventKind.LOST)
    assert "lost unexpectedly" in lost.text
    reader.event(LinkEventKind.RESTORED)
    send(bluez, hub, [half for frame in after for half in (frame[:182], frame[182:])])
    received += data(reader, 5 * 242)
    got = [frame.seq for frame in decoder.feed(received) + decoder.finish()]
    assert got == [0, 1, 2, 3, 4, 6, 7, 8, 9, 10]
    assert decoder.counters.lost == 1


@pytest.mark.parametrize("forgotten", [False, True], ids=["known to BlueZ", "forgotten by BlueZ"])
def test_lost_hub_is_reconnected(bluez: BluezStandIn, hub: Peripheral, read: Read, forgotten: bool) -> None:
    reader = read(opened("Treadlink-FL", "scan=2"))
    reader.event(LinkEventKind.CONNECTED)
    bluez.run(bluez.service.lose(hub))
    if forgotten:
        bluez.run(bluez.service.forget(hub))
    reader.event(LinkEventKind.LOST)
    assert f"no hub at {ADDRESSES[0]} answers" in reader.event(LinkEventKind.RETRYING).text
    hub.advertising = True
    restored = reader.event(LinkEventKind.RESTORED)
    assert ADDRESSES[0] in text(restored.reason)
    assert restored.rssi_dbm == -57
    send(bluez, hub, [b"again"])
    assert data(reader, 5) == b"again"


def test_two_hubs_of_one_name_need_an_address(bluez: BluezStandIn, hub: Peripheral, read: Read) -> None:
    bluez.add(Peripheral(ADDRESSES[1], "treadlink-FL", rssi_dbm=-80))
    reader = read(opened("Treadlink-FL", "scan=100"))
    assert reader.next() is None
    error = reader.error
    assert isinstance(error, SourceError)
    assert str(error).startswith("2 hubs are named 'Treadlink-FL'")
    assert ADDRESSES[0] in str(error)
    assert ADDRESSES[1] in str(error)
    assert "ble://C0:FF:EE" in error.remedy
    by_address = read(opened(ADDRESSES[1]))
    assert ADDRESSES[1] in text(by_address.event(LinkEventKind.CONNECTED).reason)


def test_second_hub_of_the_name_is_not_connected(bluez: BluezStandIn, hub: Peripheral, read: Read) -> None:
    reader = read(opened("Treadlink-FL", "scan=2"))
    reader.event(LinkEventKind.CONNECTED)
    other = bluez.add(Peripheral(ADDRESSES[1], "Treadlink-FL"))
    bluez.run(bluez.service.lose(hub))
    reader.event(LinkEventKind.LOST)
    retrying = reader.event(LinkEventKind.RETRYING)
    assert f"no hub at {ADDRESSES[0]}" in retrying.text
    assert not other.connected
    hub.advertising = True
    assert ADDRESSES[0] in text(reader.event(LinkEventKind.RESTORED).reason)


def test_hub_that_is_renamed_stays_the_same_and_its_name_is_no_ticket(
    bluez: BluezStandIn, hub: Peripheral, read: Read
) -> None:
    reader = read(opened("Treadlink-FL"))
    reader.event(LinkEventKind.CONNECTED)
    bluez.run(bluez.service.lose(hub))
    bluez.run(bluez.service.forget(hub))
    reader.event(LinkEventKind.LOST)
    hub.name = "\x1b[2JFR"
    stranger = bluez.add(Peripheral(ADDRESSES[1], "Treadlink-FL"))
    hub.advertising = True
    restored = reader.event(LinkEventKind.RESTORED)
    assert ADDRESSES[0] in text(restored.reason)
    assert not stranger.connected
    send(bluez, hub, [b"again"])
    assert data(reader, 5) == b"again"


def test_hubs_that_take_each_others_name_are_not_mixed_up(bluez: BluezStandIn, hub: Peripheral, read: Read) -> None:
    other = bluez.add(Peripheral(ADDRESSES[1], "Treadlink-FR"))
    hubs, readers = (hub, other), [read(opened(name)) for name in ("Treadlink-FL", "Treadlink-FR")]
    for reader in readers:
        reader.event(LinkEventKind.CONNECTED)
    hub.name, other.name = other.name, hub.name
    for each in hubs:
        names = {"Name": Variant("s", each.name), "Alias": Variant("s", each.name)}
        bluez.run(bluez.service._changed(each.path(bluez.service.adapter), DEVICE, names))
        send(bluez, each, [each.address.encode()])
        bluez.run(bluez.service.lose(each, advertising=True))
    for each, reader in zip(hubs, readers, strict=True):
        assert data(reader, 17) == each.address.encode()
        assert reader.event(LinkEventKind.LOST).link.startswith("ble:Treadlink-F")
        assert each.address in text(reader.event(LinkEventKind.RESTORED).reason)
        send(bluez, each, [each.address.encode()])
        assert data(reader, 17) == each.address.encode()


def test_requested_disconnect_is_marked(bluez: BluezStandIn, hub: Peripheral, read: Read) -> None:
    reader = read(opened("Treadlink-FL"))
    reader.event(LinkEventKind.CONNECTED)
    reader.stop.set()
    assert reader.event(LinkEventKind.ENDED).details == (Reason(LinkCode.LINK_DISCONNECTED),)
    assert reader.next() is None
    assert not hub.connected


def test_several_hubs_at_once(bluez: BluezStandIn, read: Read) -> None:
    hubs = [bluez.add(Peripheral(address, f"Hub {i}")) for i, address in enumerate(ADDRESSES[:4])]
    readers = [read(opened(f"Hub%20{i}")) for i in range(4)]
    for reader in readers:
        reader.event(LinkEventKind.CONNECTED)
    for round_ in range(20):
        for i, each in enumerate(hubs):
            send(bluez, each, [bytes([i, round_]) * 122] * 10)
    for i, reader in enumerate(readers):
        assert data(reader, 20 * 2440) == b"".join(bytes([i, round_]) * 1220 for round_ in range(20))
    bluez.run(bluez.service.lose(hubs[2]))
    readers[2].event(LinkEventKind.LOST)
    send(bluez, hubs[3], [b"still here"])
    assert data(readers[3], 10) == b"still here"


def test_single_failure_is_retried(bluez: BluezStandIn, hub: Peripheral, read: Read) -> None:
    hub.failures = [("org.bluez.Error.InProgress", "busy"), ("org.bluez.Error.Failed", "Input/output error")]
    reader = read(opened("Treadlink-FL"))
    reader.event(LinkEventKind.CONNECTED)
    assert hub.failures == []


def test_lasting_failure_is_raised(bluez: BluezStandIn, hub: Peripheral, read: Read) -> None:
    hub.failures = [("org.bluez.Error.Failed", "Input/output error")] * 3
    reader = read(opened("Treadlink-FL"))
    assert reader.next() is None
    assert isinstance(reader.error, SourceError)
    assert "cannot connect to Treadlink-FL" in str(reader.error)
    assert "Input/output error" in str(reader.error)


def test_unknown_hub_lists_those_in_range(bluez: BluezStandIn, hub: Peripheral, read: Read) -> None:
    reader = read(opened("Treadlink-RR", "scan=2"))
    assert reader.next() is None
    assert isinstance(reader.error, SourceError)
    assert str(reader.error) == "no hub named Treadlink-RR answers"
    assert f"Treadlink-FL at {ADDRESSES[0]} (-57 dBm)" in reader.error.remedy


def test_characteristics_need_uuid_and_property(bluez: BluezStandIn, read: Read) -> None:
    written = threading.Event()
    swapped = Peripheral(
        ADDRESSES[0],
        "Swapped",
        characteristics=((UART_FROM_HUB, ("write",)), (UART_TO_HUB, ("notify",))),
        on_write=lambda _: written.set(),
    )
    bluez.add(swapped)
    mute = ((UART_TO_HUB, ("write",)), (UART_FROM_HUB, ("read",)))
    bluez.add(Peripheral(ADDRESSES[1], "Mute", characteristics=mute))
    deaf = bluez.add(Peripheral(ADDRESSES[2], "Deaf", characteristics=((UART_FROM_HUB, ("notify",)),)))
    source = opened("Swapped")
    reader = read(source)
    reader.event(LinkEventKind.CONNECTED)
    send(bluez, swapped, [b"x"])
    assert data(reader, 1) == b"x"
    source.send(b"y")
    assert written.wait(TIMEOUT_S)
    mute_reader = read(opened("Mute"))
    assert mute_reader.next() is None
    assert "is not a treadlink hub" in str(mute_reader.error)
    listening = opened("Deaf")
    read(listening).event(LinkEventKind.CONNECTED)
    assert deaf.connected
    with pytest.raises(SourceError, match="takes no commands"):
        listening.send(b"y")


@pytest.mark.parametrize(
    ("mtu", "reason"),
    [
        (None, Reason(LinkCode.MTU_UNKNOWN, needed=247)),
        (23, Reason(LinkCode.MTU_UNKNOWN, needed=247)),
        (100, Reason(LinkCode.MTU_TOO_SMALL, mtu=100, needed=247)),
    ],
)
def test_small_mtu_is_reported(
    bluez: BluezStandIn, hub: Peripheral, read: Read, mtu: int | None, reason: Reason
) -> None:
    hub.mtu = mtu
    assert reason in read(opened("Treadlink-FL")).event(LinkEventKind.CONNECTED).details


def test_hub_still_connected_is_found(bluez: BluezStandIn, hub: Peripheral, read: Read) -> None:
    # As a killed program leaves it: connected, so that it does not advertise.
    first = read(opened("Treadlink-FL"))
    first.event(LinkEventKind.CONNECTED)
    hub.advertising = False
    again = read(opened("Treadlink-FL"))
    again.event(LinkEventKind.CONNECTED)
    send(bluez, hub, [b"z"])
    assert data(again, 1) == b"z"


def test_silence_counts_as_a_lost_link(bluez: BluezStandIn, hub: Peripheral, read: Read) -> None:
    clock = ManualClock()
    reader = read(opened("Treadlink-FL", f"{SCAN}&silence=3", clock))
    reader.event(LinkEventKind.CONNECTED)
    clock.advance_ns(2_900_000_000)
    send(bluez, hub, [b"alive"])
    assert data(reader, 5) == b"alive"
    clock.advance_ns(3_000_000_000)
    assert "silent for 3 s" in reader.event(LinkEventKind.LOST).text
    reader.event(LinkEventKind.RESTORED)


def test_lost_links_leave_no_descriptor_open(bluez: BluezStandIn, hub: Peripheral, read: Read) -> None:
    descriptors = Path("/proc/self/fd")
    if not descriptors.exists():
        pytest.skip("counts descriptors in /proc")
    reader = read(opened("Treadlink-FL"))
    reader.event(LinkEventKind.CONNECTED)

    def cycle() -> int:
        bluez.run(bluez.service.lose(hub, advertising=True))
        reader.event(LinkEventKind.LOST)
        reader.event(LinkEventKind.RESTORED)
        send(bluez, hub, [b"z"])
        assert data(reader, 1) == b"z"
        return len(list(descriptors.iterdir()))

    first = cycle()
    assert [cycle() for _ in range(20)][-1] <= first


def test_write_without_connection_raises() -> None:
    with pytest.raises(LinkLostError, match="is not connected"):
        opened("Anything").send(b"x")
    with pytest.raises(LinkLostError, match="is not connected"):
        BleLink(BleSettings("Anything")).write(b"x")


def test_invalid_address_is_refused() -> None:
    with pytest.raises(SourceError, match="cannot be read"):
        open_source("ble://[hub", ManualClock())
