"""Commands for Bluetooth, as a user calls them."""

import json
import os
import re
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from gateway.bench.commands.doctor_checks import Level, check_bluetooth, check_source
from gateway.core.clock import ManualClock
from gateway.simulator.bluez_thread import BluezStandIn
from gateway.simulator.dbus_daemon import PrivateBus
from gateway.simulator.peripheral import Peripheral
from tests.core.ble.conftest import ADDRESSES, require_dbus_daemon, settle
from tests.testkit.commands import invoked
from tests.testkit.hub_ends import TIMEOUT_S

ROOT = Path(__file__).parents[3]
TREADLINK = [sys.executable, "-m", "gateway.core.cli"]


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
    (seen,) = check_source("ble://Treadlink-FL?scan=0.2", ManualClock())
    assert seen.level is Level.OK
    assert f"Treadlink-FL at {ADDRESSES[0]} (-57 dBm)" in seen.text
    (missing,) = check_source("ble://Treadlink-RR?scan=0.2", ManualClock())
    assert missing.level is Level.FAULT
    assert "no hub named Treadlink-RR" in missing.text
    bluez.run(bluez.service.power(False))
    (off,) = check_bluetooth()
    assert off.level is Level.WARNING
    assert "switched off" in off.text


@pytest.fixture
def demo(tmp_path: Path) -> Iterator[tuple[subprocess.Popen[str], dict[str, str]]]:
    require_dbus_daemon()
    with subprocess.Popen(
        [*TREADLINK, "simulate", "lab", "--ble", "--duration", "120", "--vehicle", str(tmp_path / "lab.toml")],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        cwd=ROOT,
        start_new_session=True,
    ) as process:
        assert process.stdout is not None
        impatience = threading.Timer(60, process.kill)
        impatience.start()
        printed = ""
        while "Ctrl-C" not in printed:
            line = process.stdout.readline()
            assert line, printed
            printed += line
        impatience.cancel()
        address = re.search(r"export DBUS_SYSTEM_BUS_ADDRESS=(\S+)", printed)
        assert address is not None
        assert "treadlink live ble://Treadlink-W1 --config" in printed
        yield process, {**os.environ, "DBUS_SYSTEM_BUS_ADDRESS": address[1].strip("'")}
        if process.poll() is None:
            process.kill()


def run(environment: dict[str, str], *arguments: str) -> str:
    done = subprocess.run(
        [*TREADLINK, *arguments], capture_output=True, text=True, env=environment, cwd=ROOT, timeout=60, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_simulator_as_a_hub_on_bluetooth(demo: tuple[subprocess.Popen[str], dict[str, str]], tmp_path: Path) -> None:
    process, environment = demo
    assert "ble://Treadlink-W1" in run(environment, "scan", "--timeout", "0.5")
    uri = "ble://Treadlink-W1?scan=0.5"
    assert "hub 0 executed the command" in run(environment, "command", "time", uri)
    printed = run(environment, "live", uri, "--config", str(tmp_path / "lab.toml"), "--plain", "--duration", "4")
    assert "Treadlink-W1 at 00:00:5E:00:53:00 (-58 dBm), MTU 247" in printed
    assert re.search(r"^W1 +\d+ +[\d.]+ +6[45]\.", printed, re.MULTILINE), printed
    assert re.search(r"ble:Treadlink-W1: \d+ frames, 0 lost", printed)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does
    assert process.stdout is not None
    rest = process.stdout.read()
    assert process.wait(TIMEOUT_S) == 0, rest
    assert "Traceback" not in rest
    assert rest.count(": subscribed") == rest.count(": no longer subscribed") == 2


def test_interrupt_does_not_reach_the_bus(bus: PrivateBus) -> None:
    # The daemon would end before the hubs on it, which then fail to leave.
    daemon = bus._process.pid
    assert os.getpgid(daemon) != os.getpgid(0)


@pytest.mark.parametrize("arguments", [["--ble", "--pty"], ["--ble", "--fault", "flip:rate=0.01"], []])
def test_simulate_takes_one_output(arguments: list[str]) -> None:
    assert invoked("simulate", "lab", *arguments).exit_code == 2
