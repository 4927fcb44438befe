"""Fixtures: a private D-Bus, a stand-in for BlueZ on it, and hubs in range of the bleak client."""

import os
import shutil
from collections.abc import Iterator
from unittest.mock import patch

import pytest

from gateway.core.links import ble_link
from gateway.core.links.ble_source import scan_devices
from tests.testkit.bluetooth.bluez_thread import BluezStandIn
from tests.testkit.bluetooth.dbus_daemon import PROGRAM, PrivateBus
from tests.testkit.bluetooth.peripheral import Peripheral

ADDRESSES = [f"C0:FF:EE:00:00:{number:02X}" for number in range(1, 9)]


def require_dbus_daemon() -> None:
    if shutil.which(PROGRAM) is None:
        if os.environ.get("CI"):
            pytest.fail(f"{PROGRAM} is missing; CI must have it")
        pytest.skip(f"{PROGRAM} is not installed")


def settle(wanted: str | None) -> None:
    """Wait until the radio has taken in what changed on the bus: a scan gives this fault, or none."""
    for _ in range(200):
        fault = scan_devices(0.01).fault
        if (None if fault is None else str(fault)) == wanted:
            return
    pytest.fail(f"a scan says '{fault}', not '{wanted}'")


@pytest.fixture(scope="session")
def bus() -> Iterator[PrivateBus]:
    """One for all tests of this process: the radio's thread keeps its connection as long as the process lives."""
    require_dbus_daemon()
    with PrivateBus() as bus, pytest.MonkeyPatch.context() as patch:
        patch.setenv("DBUS_SYSTEM_BUS_ADDRESS", bus.address)
        yield bus


@pytest.fixture
def bluez(bus: PrivateBus) -> Iterator[BluezStandIn]:
    # A scan of 20 s finds its hub on a computer of any load, and waits a fifth of a second for a second one.
    with (
        BluezStandIn(bus.address, advertising_interval_s=0.02) as stand_in,
        patch.object(ble_link, "_SETTLE_SHARE", 0.01),
    ):
        settle(None)
        yield stand_in


@pytest.fixture
def hub(bluez: BluezStandIn) -> Peripheral:
    return bluez.add(Peripheral(ADDRESSES[0], "Treadlink-FL", rssi_dbm=-57, battery_percent=83))
