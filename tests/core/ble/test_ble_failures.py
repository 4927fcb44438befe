"""Failures of Bluetooth: clear errors, and recovery when it returns."""

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from bleak.exc import (
    BleakBluetoothNotAvailableError,
    BleakBluetoothNotAvailableReason,
    BleakDBusError,
    BleakError,
)

from gateway.core.clock import ManualClock
from gateway.core.links.ble_radio import BLE_ERRORS, explain
from gateway.core.links.ble_source import scan_devices
from gateway.core.links.reasons import LinkCode
from gateway.core.links.source import LinkEventKind, Source, open_source
from gateway.core.reasons import Reason
from tests.core.ble.conftest import ADDRESSES, settle
from tests.testkit.bluetooth.bluez_thread import BluezStandIn
from tests.testkit.bluetooth.dbus_daemon import PrivateBus
from tests.testkit.bluetooth.peripheral import Peripheral
from tests.testkit.hub_ends import Reader

Read = Callable[[Source], Reader]


def test_no_adapter(bus: PrivateBus, read: Read) -> None:
    with BluezStandIn(bus.address, adapter=None):
        settle("this computer has no Bluetooth adapter")
        reader = read(open_source("ble://Treadlink", ManualClock()))
        assert reader.next() is None
        assert str(reader.error) == "this computer has no Bluetooth adapter"


def scan_in_a_new_process(address: str) -> dict[str, Any]:
    done = subprocess.run(
        [sys.executable, "-m", "gateway.core.cli", "scan", "--timeout", "0.1", "--json"],
        capture_output=True,
        text=True,
        env={**os.environ, "DBUS_SYSTEM_BUS_ADDRESS": address},
        cwd=Path(__file__).parents[3],
        check=True,
    )
    assert done.stderr == ""
    estimated_loads: dict[str, Any] = json.loads(done.stdout)
    return estimated_loads


def test_no_bluetooth_service(bus: PrivateBus) -> None:
    result = scan_in_a_new_process(bus.address)
    assert result["bluetooth_fault"]["text"] == "Bluetooth's service is not running"
    assert "systemctl start bluetooth" in result["bluetooth_fault"]["remedy"]


def test_no_d_bus(tmp_path: Path) -> None:
    result = scan_in_a_new_process(f"unix:path={tmp_path}/none")
    assert "no D-Bus here" in result["bluetooth_fault"]["text"]
    assert isinstance(result["serial_ports"], list)


def test_missing_adapter(bluez: BluezStandIn) -> None:
    fault = scan_devices(0.1, "hci7").fault
    assert fault is not None
    assert "adapter 'hci7' not found" in str(fault)


def test_bluetooth_switched_off_and_on_again(bluez: BluezStandIn, hub: Peripheral, read: Read) -> None:
    bluez.run(bluez.service.power(False))
    settle("Bluetooth is switched off")
    bluez.run(bluez.service.power(True))
    settle(None)
    reader = read(open_source("ble://Treadlink-FL?scan=20", ManualClock()))
    reader.event(LinkEventKind.CONNECTED)
    bluez.run(bluez.service.power(False))
    reader.event(LinkEventKind.LOST)
    assert "switched off" in reader.event(LinkEventKind.RETRYING).text
    bluez.run(bluez.service.power(True))
    reader.event(LinkEventKind.RESTORED)


@pytest.mark.parametrize("notify", ["", "&notify=socket"])
def test_a_hub_that_demands_pairing_is_named_with_the_remedy(hub: Peripheral, read: Read, notify: str) -> None:
    hub.demands_pairing = True
    reader = read(open_source(f"ble://Treadlink-FL?scan=20{notify}", ManualClock()))
    assert reader.next() is None
    assert reader.error is not None
    assert "demands pairing" in str(reader.error)
    assert f"bluetoothctl pair {ADDRESSES[0]}" in reader.error.remedy


def test_a_hub_that_is_paired_on_request_is_read(bluez: BluezStandIn, hub: Peripheral, read: Read) -> None:
    hub.demands_pairing = hub.agent_pairs = True
    reader = read(open_source("ble://Treadlink-FL?scan=20", ManualClock()))
    reader.event(LinkEventKind.CONNECTED)
    assert hub.paired
    bluez.run(bluez.service.notify(hub, [b"data"]))
    assert reader.bytes(4)[0].data == b"data"


def test_a_hub_that_has_forgotten_its_pairing_is_named(bluez: BluezStandIn, hub: Peripheral, read: Read) -> None:
    hub.demands_pairing = hub.paired = True
    reader = read(open_source("ble://Treadlink-FL?scan=20", ManualClock()))
    reader.event(LinkEventKind.CONNECTED)
    hub.has_key = False  # as after a reset of the hub
    bluez.run(bluez.service.lose(hub, advertising=True))
    reader.event(LinkEventKind.LOST)
    assert "although this computer is paired with it" in reader.event(LinkEventKind.RETRYING).text
    hub.paired, hub.agent_pairs = False, True  # the user follows the remedy
    while (item := reader.next()) is not None and getattr(item, "kind", None) is not LinkEventKind.RESTORED:
        assert getattr(item, "kind", None) is LinkEventKind.RETRYING
    assert hub.paired


def test_an_mtu_that_changes_is_stated_with_the_new_connection(
    bluez: BluezStandIn, hub: Peripheral, read: Read
) -> None:
    reader = read(open_source("ble://Treadlink-FL?scan=20", ManualClock()))
    assert Reason(LinkCode.MTU, mtu=247) in reader.event(LinkEventKind.CONNECTED).details
    hub.mtu = 185
    bluez.run(bluez.service.lose(hub, advertising=True))
    reader.event(LinkEventKind.LOST)
    assert Reason(LinkCode.MTU_TOO_SMALL, mtu=185, needed=247) in reader.event(LinkEventKind.RESTORED).details


def test_bluetooth_crashes_and_returns(bus: PrivateBus, read: Read) -> None:
    clock = ManualClock()
    with BluezStandIn(bus.address, advertising_interval_s=0.02) as before:
        settle(None)
        before.add(Peripheral(ADDRESSES[0], "Treadlink-FL"))
        reader = read(open_source("ble://Treadlink-FL?scan=20&silence=5", clock))
        reader.event(LinkEventKind.CONNECTED)
        before.close(crash=True)
    clock.advance_ns(5_000_000_000)
    assert "silent" in reader.event(LinkEventKind.LOST).text
    assert "not running" in reader.event(LinkEventKind.RETRYING).text
    with BluezStandIn(bus.address, advertising_interval_s=0.02) as after:
        hub = after.add(Peripheral(ADDRESSES[0], "Treadlink-FL"))
        # The messages until the adapter is back are those of the library; the last one counts.
        while (item := reader.next()) is not None and getattr(item, "kind", None) is not LinkEventKind.RESTORED:
            assert getattr(item, "kind", None) is LinkEventKind.RETRYING
        after.run(after.service.notify(hub, [b"back"]))
        assert reader.bytes(4)[0].data == b"back"


def test_d_bus_ends_and_returns(bus: PrivateBus) -> None:
    code = (
        "import os, sys, threading\n"
        "from gateway.core.clock import SystemClock\n"
        "from gateway.core.links.source import open_source\n"
        "stop = threading.Event()\n"
        "for item in open_source('ble://C0:FF:EE:00:00:01?scan=20', SystemClock()).items(stop):\n"
        "    print(item.kind.value, item.text, flush=True)\n"
        "    if item.kind.value == 'retrying':\n"
        "        os.environ['DBUS_SYSTEM_BUS_ADDRESS'] = sys.stdin.readline().strip()\n"
        "    if item.kind.value == 'restored':\n"
        "        stop.set()\n"
    )
    with PrivateBus() as doomed, PrivateBus() as next_bus:
        environment = {**os.environ, "DBUS_SYSTEM_BUS_ADDRESS": doomed.address}
        with BluezStandIn(doomed.address, advertising_interval_s=0.02) as stand_in:
            stand_in.add(Peripheral(ADDRESSES[0], "Treadlink-FL"))
            process = subprocess.Popen(
                [sys.executable, "-c", code],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
                env=environment,
                cwd=Path(__file__).parents[3],
            )
            with process:
                assert process.stdin is not None
                assert process.stdout is not None
                assert process.stdout.readline().startswith("connected")
                doomed.close()
                assert process.stdout.readline().startswith("lost")
                assert "no D-Bus" in process.stdout.readline()
                with BluezStandIn(next_bus.address, advertising_interval_s=0.02) as again:
                    again.add(Peripheral(ADDRESSES[0], "Treadlink-FL"))
                    process.stdin.write(next_bus.address + "\n")
                    process.stdin.flush()
                    assert process.stdout.readline().startswith("restored")
                    assert process.stdout.readline().startswith("ended")


@pytest.mark.parametrize(
    ("error", "says"),
    [
        (PermissionError(13, "Permission denied"), "no permission to use Bluetooth"),
        (
            BleakDBusError("org.freedesktop.DBus.Error.AccessDenied", ["rejected send"]),
            "no permission to use Bluetooth",
        ),
        (
            BleakBluetoothNotAvailableError("no", BleakBluetoothNotAvailableReason.DENIED_BY_SYSTEM),
            "no permission to use Bluetooth",
        ),
        (
            BleakBluetoothNotAvailableError("no", BleakBluetoothNotAvailableReason.NO_BLE_CENTRAL_ROLE),
            "the Bluetooth adapter does not support Bluetooth LE",
        ),
        (BleakDBusError("org.freedesktop.DBus.Error.Spawn.ChildExited", ["x"]), "Bluetooth's service is not running"),
        (BleakDBusError("org.bluez.Error.InProgress", ["x"]), "the Bluetooth adapter is busy with another connection"),
        (ConnectionRefusedError(111, "refused"), "there is no D-Bus here, through which Bluetooth is reached"),
        (TimeoutError(), "cannot connect to X: no answer in time"),
        (EOFError(), "cannot connect to X: EOFError"),
        (BleakError("strange"), "cannot connect to X: strange"),
    ],
)
def test_errors_are_explained(error: Exception, says: str) -> None:
    assert isinstance(error, BLE_ERRORS)
    explained = explain(error, "connect to X")
    assert str(explained) == says
    assert explained.remedy
