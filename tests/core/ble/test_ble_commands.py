"""Commands for Bluetooth, as a user calls them."""

import json
import os
import re
from pathlib import Path

import pytest

from gateway.bench.commands.doctor_checks import Level, check_bluetooth, check_source
from gateway.core.clock import ManualClock
from gateway.simulator.scenario import parse_scenario, vehicle_toml
from tests.core.ble.conftest import ADDRESSES, settle
from tests.core.ble.test_ble_session import SCENARIO, broadcasting
from tests.testkit.bluetooth.bluez_thread import BluezStandIn
from tests.testkit.bluetooth.dbus_daemon import PrivateBus
from tests.testkit.bluetooth.peripheral import Peripheral
from tests.testkit.commands import invoked, run


@pytest.fixture
def no_serial_ports(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("serial.tools.list_ports.comports", list)


@pytest.mark.usefixtures("no_serial_ports")
def test_scan_lists_hubs_with_signal_and_battery(bluez: BluezStandIn, hub: Peripheral) -> None:
    bluez.add(Peripheral(ADDRESSES[1], "Hub 2", rssi_dbm=-70))
    bluez.add(Peripheral(ADDRESSES[2], "Scales", service="0000181d-0000-1000-8000-00805f9b34fb"))
    done = invoked("scan", "--timeout", "0.2")
    assert done.exit_code == 0
    lines = done.output.splitlines()
    assert [" ".join(line.split()) for line in lines] == [
        f"ble://Treadlink-FL -57 dBm battery 83 % Treadlink-FL at {ADDRESSES[0]}",
        f"ble://Hub%202 -70 dBm battery unknown Hub 2 at {ADDRESSES[1]}",
        "No serial port found.",
    ]
    assert "Scales" in invoked("scan", "--timeout", "0.2", "--all").output


@pytest.mark.usefixtures("no_serial_ports")
def test_scan_gives_addresses_for_equal_names(bluez: BluezStandIn, hub: Peripheral) -> None:
    bluez.add(Peripheral(ADDRESSES[1], "Treadlink-FL", rssi_dbm=-70))
    output = invoked("scan", "--timeout", "0.2").output
    assert f"ble://{ADDRESSES[0]} " in output
    assert "Several hubs are named 'Treadlink-FL'. Give the address." in output
    report = json.loads(invoked("scan", "--timeout", "0.2", "--json").output)
    assert report["bluetooth_fault"] is None
    assert report["serial_ports"] == []
    assert report["hubs"][0] == {
        "source": f"ble://{ADDRESSES[0]}",
        "name": "Treadlink-FL",
        "address": ADDRESSES[0],
        "rssi_dbm": -57,
        "battery_percent": 83,
        "is_hub": True,
    }


@pytest.mark.usefixtures("no_serial_ports")
def test_scan_without_adapter_continues(bus: PrivateBus) -> None:
    with BluezStandIn(bus.address, adapter=None):
        settle("this computer has no Bluetooth adapter")
        done = invoked("scan", "--timeout", "0.1")
    assert done.exit_code == 1  # nothing is found
    assert "Bluetooth: this computer has no Bluetooth adapter" in done.output
    assert "No serial port found." in done.output


def test_doctor_checks_bluetooth(bluez: BluezStandIn, hub: Peripheral) -> None:
    (result,) = check_bluetooth()
    assert result.level is Level.OK
    (seen,) = check_source("ble://Treadlink-FL?scan=20", ManualClock())
    assert seen.level is Level.OK
    assert f"Treadlink-FL at {ADDRESSES[0]} (-57 dBm)" in seen.text
    (missing,) = check_source("ble://Treadlink-RR?scan=0.2", ManualClock())
    assert missing.level is Level.FAULT
    assert "no hub named Treadlink-RR" in missing.text
    bluez.run(bluez.service.power(False))
    (off,) = check_bluetooth()
    assert off.level is Level.WARNING
    assert "switched off" in off.text


def test_commands_of_a_user_reach_a_simulated_hub(bluez: BluezStandIn, tmp_path: Path) -> None:
    vehicle = tmp_path / "two.toml"
    vehicle.write_text(vehicle_toml(parse_scenario(SCENARIO, "test")))
    uri = "ble://Treadlink-FL?scan=20"
    with broadcasting(bluez):
        assert "ble://Treadlink-FL" in run("scan", "--timeout", "0.5")
        assert "hub 0 executed the command" in run("command", "time", uri)
        printed = run("live", uri, "--config", vehicle, "--plain", "--duration", "4")
    assert re.search(r"^FL +\d+ +[\d.]+ +(89|90|91)\.", printed, re.MULTILINE), printed
    assert re.search(r"ble:Treadlink-FL: \d+ frames, 0 lost", printed)


def test_interrupt_does_not_reach_the_bus(bus: PrivateBus) -> None:
    # The daemon would end before the hubs on it, which then fail to leave.
    daemon = bus._process.pid
    assert os.getpgid(daemon) != os.getpgid(0)
