"""Hubs on Bluetooth LE that flood: notifications faster than they are read, giant or tiny ones, and advertisements.

Memory is bounded, what is dropped is said, and what was taken is whole.
"""

import threading
import tracemalloc
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from dbus_fast import Variant

from firmware_protocol.codec import encode_frame
from firmware_protocol.decoder import FrameDecoder
from firmware_protocol.messages import Frame, MessageType, SampleBlock
from gateway.core.clock import ManualClock, SystemClock
from gateway.core.errors import SourceError
from gateway.core.links import ble_hub, ble_link
from gateway.core.links.ble_link import BleLink, BleSettings
from gateway.core.links.ble_source import BleSource, scan_devices
from gateway.core.links.reasons import LinkCode
from gateway.core.links.source import Chunk, LinkEvent, LinkEventKind, Source, open_source
from gateway.core.recording.reader import RecordingReader
from gateway.core.session.session_opening import SessionSettings, open_session
from gateway.core.text.wording import text
from tests.testkit.bluetooth.bluez_thread import BluezStandIn
from tests.testkit.bluetooth.peripheral import CHARACTERISTIC, Peripheral
from tests.testkit.hub_ends import Reader
from tests.testkit.waiting import until

Read = Callable[[Source], Reader]
HEADPHONES = "0000110b-0000-1000-8000-00805f9b34fb"


def frames(count: int, start: int = 0) -> list[bytes]:
    counts = np.arange(36 * 3, dtype=np.int16).reshape(36, 3)
    return [
        encode_frame(Frame(MessageType.SAMPLES, 0, 0, seq, 0, SampleBlock(seq * 36, 0b111, counts)))
        for seq in range(start, start + count)
    ]


def drops(items: list[object]) -> list[int]:
    details = [detail for item in items if isinstance(item, LinkEvent) for detail in item.details]
    return [detail["count"] for detail in details if detail.code is LinkCode.NOTIFICATIONS_DROPPED]


def seqs(items: list[object]) -> list[int]:
    decoder = FrameDecoder()
    return [frame.seq for item in items if isinstance(item, Chunk) for frame in decoder.feed(item.data)]


@pytest.fixture
def slow(bluez: BluezStandIn, hub: Peripheral) -> Iterator[tuple[Iterator[object], BleLink]]:
    """The items of a source that is read only when the test asks, and its link."""
    source = BleSource(BleSettings("Treadlink-FL", scan_s=0.2), ManualClock())
    items = source.items(threading.Event())
    next(items)
    assert isinstance(source._current, BleLink)
    yield items, source._current
    items.close()
    assert not hub.connected


def test_flood_is_bounded_and_its_drops_are_counted(
    bluez: BluezStandIn, hub: Peripheral, slow: tuple[Iterator[object], BleLink], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ble_link, "_PENDING_BYTES", 50_000)
    (items, link), sent = slow, frames(3000)
    bluez.run(bluez.service.notify(hub, sent))
    until(lambda: len(link._arrived) // len(sent[0]) + link._dropped == len(sent))
    assert len(link._arrived) <= 50_000
    got = [next(items), next(items)]
    assert seqs(got) == list(range(50_000 // len(sent[0]))), "what was taken is whole"
    assert drops(got) == [len(sent) - len(seqs(got))]
    assert "notifications" in text(got[1].reason)  # type: ignore[attr-defined]
    bluez.run(bluez.service.notify(hub, frames(100, 3000)))
    rest: list[object] = []
    while len(seqs(rest)) < 100:
        rest.append(next(items))
    assert drops(rest) == []


def test_session_records_a_flood_whole_and_says_what_was_dropped(
    bluez: BluezStandIn, hub: Peripheral, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ble_link, "_PENDING_BYTES", 20_000)
    count, path = 4000, tmp_path / "r.mcap"
    opened = open_session(
        ["ble://Treadlink-FL?scan=20"], lambda _: None, SessionSettings(record=path), clock=SystemClock()
    )
    try:
        until(lambda: hub.notifying)
        bluez.run(bluez.service.notify(hub, frames(count)))
        until(lambda: bluez.run(bluez.service.notify(hub, [b"end"])) and opened.live.snapshot().links[0].noise_bytes)
    finally:
        opened.live.close()
    recorded = list(RecordingReader(path).items())
    numbers = seqs(recorded)
    assert numbers == sorted(set(numbers))
    assert len(numbers) + sum(drops(recorded)) >= count - 1
    assert len(numbers) == count or drops(recorded)


@pytest.mark.parametrize(("bound_bytes", "dropped"), [(50_000, 0), (20_000, 1)])
def test_giant_notification_is_noise_or_dropped_and_frames_around_it_are_kept(
    bluez: BluezStandIn,
    hub: Peripheral,
    slow: tuple[Iterator[object], BleLink],
    monkeypatch: pytest.MonkeyPatch,
    bound_bytes: int,
    dropped: int,
) -> None:
    """A hundred times what Bluetooth can carry, as another program on the computer's bus could send it."""
    monkeypatch.setattr(ble_link, "_PENDING_BYTES", bound_bytes)
    items, (before, after), path = slow[0], frames(2), hub.notify_path(bluez.service.adapter)
    for data in (before, bytes(30_000), after):
        bluez.run(bluez.service._changed(path, CHARACTERISTIC, {"Value": Variant("ay", data)}))
    got: list[object] = []
    while len(seqs(got)) < 2 or len(drops(got)) < dropped:
        got.append(next(items))
    assert seqs(got) == [0, 1]
    assert sum(drops(got)) == dropped


def test_tiny_notifications_take_no_more_than_their_bytes() -> None:
    link = BleLink(BleSettings("Hub"))
    tracemalloc.start()
    try:
        for _ in range(200_000):
            link._on_notification(None, bytearray(b"x"))  # type: ignore[arg-type]
        peak_bytes = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert len(link.read(0.0)) == 200_000
    assert peak_bytes < 1_000_000


def test_hub_is_found_among_thousands_of_advertisements(
    bluez: BluezStandIn, read: Read, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ble_hub, "MAX_SIGHTINGS", 50)
    for k in range(300):
        service = {} if k % 2 else {"service": HEADPHONES}
        bluez.add(
            Peripheral(f"C0:FF:EE:01:{k // 256:02X}:{k % 256:02X}", f"Crowd {k}", rssi_dbm=-90 + k % 50, **service)
        )
    around = scan_devices(1.0).sightings
    assert len(around) == 50
    assert all(sighting.is_hub for sighting in around)
    absent = read(open_source("ble://Treadlink-FL?scan=1", ManualClock()))
    assert absent.next() is None
    assert isinstance(absent.error, SourceError)
    assert "and 42 more" in absent.error.remedy
    bluez.add(Peripheral("C0:FF:EE:00:00:01", "Treadlink-FL"))
    read(open_source("ble://Treadlink-FL?scan=20", ManualClock())).event(LinkEventKind.CONNECTED)
