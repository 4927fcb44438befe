"""Throughput and CPU of Bluetooth LE: notifications of 244 bytes through D-Bus and bleak into a source.

The hubs are the BlueZ emulation in a separate process on a real dbus-daemon, without a radio. CPU is that of
the receiving process alone: bleak, the radio's thread and the reader.
"""

import multiprocessing
import os
import threading
import time
from multiprocessing.connection import Connection

from gateway.core.clock import SystemClock
from gateway.core.links.source import Chunk, open_source
from tests.testkit.bluetooth.bluez_thread import BluezStandIn
from tests.testkit.bluetooth.dbus_daemon import PrivateBus
from tests.testkit.bluetooth.peripheral import Peripheral

COUNT = 20_000
PACED = 3_000
HUBS = 4
BURST = 20
PAYLOAD = bytes(range(244))


def serve(address: str, orders: Connection) -> None:
    """Send as many notifications as ordered, (hub, count, how many a second; 0 for flat out)."""
    with BluezStandIn(address, advertising_interval_s=0.02) as bluez:
        hubs = [bluez.add(Peripheral(f"C0:FF:EE:00:00:{i:02X}", f"Hub-{i}")) for i in range(HUBS)]
        orders.send("ready")
        while (order := orders.recv()) is not None:
            hub, count, rate = order
            begin = time.perf_counter()
            for sent in range(0, count, BURST):
                if rate:
                    time.sleep(max(0.0, begin + sent / rate - time.perf_counter()))
                bluez.run(bluez.service.notify(hubs[hub], [PAYLOAD] * min(BURST, count - sent)))


def receive(source_items: object, count: int, seen: list[int]) -> None:
    total = 0
    for item in source_items:  # type: ignore[attr-defined]
        if isinstance(item, Chunk):
            total += len(item.data)
            if total >= count * len(PAYLOAD):
                break
    seen.append(total // len(PAYLOAD))


def measure(name: str, orders: Connection, hubs: int, count: int, rate: int) -> None:
    stop, seen = threading.Event(), []
    streams = [open_source(f"ble://Hub-{i}?scan=0.5&silence=0", SystemClock()).items(stop) for i in range(hubs)]
    for stream in streams:
        next(stream)
    threads = [threading.Thread(target=receive, args=(stream, count, seen)) for stream in streams]
    for thread in threads:
        thread.start()
    begin, cpu = time.perf_counter(), time.process_time()
    for _ in range(10):
        for hub in range(hubs):
            orders.send((hub, count // 10, rate))
    for thread in threads:
        thread.join()
    wall, used = time.perf_counter() - begin, time.process_time() - cpu
    total = sum(seen)
    lost = hubs * count - total
    print(
        f"{name:28s} {total:6d} received, {lost} lost, {total / wall:8.0f}/s, {total * 244 / wall * 1e-6:6.2f} MB/s, "
        f"CPU {used / total * 1e6:5.1f} us each, {100 * used / wall:5.1f} % of a core"
    )
    stop.set()
    for stream in streams:
        for _ in stream:
            pass


def main() -> None:
    with PrivateBus() as bus:
        os.environ["DBUS_SYSTEM_BUS_ADDRESS"] = bus.address
        ours, theirs = multiprocessing.Pipe()
        server = multiprocessing.get_context("spawn").Process(target=serve, args=(bus.address, theirs))
        server.start()
        ours.recv()
        measure("one hub, flat out", ours, 1, COUNT, 0)
        measure("one hub, 1000 a second", ours, 1, PACED, 1000)
        measure("four hubs, flat out", ours, HUBS, COUNT // HUBS, 0)
        ours.send(None)
        server.join()


if __name__ == "__main__":
    main()
