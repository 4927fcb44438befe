"""From a vehicle's configuration and a key file to the guard of a session."""

from __future__ import annotations

from pathlib import Path

from gateway.config.vehicle import Policy, VehicleConfig
from gateway.security.cmac import start
from gateway.security.freshness import Ledger
from gateway.security.guard import Guard, Place
from gateway.security.key_file import KeyFile, counters_file, default_key_file, sensor_identity


def open_guard(vehicle: VehicleConfig | None, key_file: Path | None, *, remembers: bool) -> Guard | None:
    """Return the guard that the vehicle's policy asks for, None for policy `off`.

    Args:
        vehicle: configuration.
        key_file: keys; the user's own file when None.
        remembers: whether counters are kept across sessions. A link needs it; a recording is old by its nature.

    Raises:
        SecurityError: keys or counters cannot be read, or the package `cryptography` is missing.
    """
    if vehicle is None or vehicle.security.policy is Policy.OFF:
        return None
    path = default_key_file() if key_file is None else key_file
    keys = KeyFile(path).keys
    for key in keys.values():
        start(key)  # tells now, not at the first frame, that the package is missing
        break
    places = {
        (wheel.hub, wheel.wheel): Place(
            wheel.position, None if wheel.sensor_number is None else sensor_identity(wheel.sensor_number)
        )
        for wheel in vehicle.wheel
    }
    ledger = Ledger(counters_file(path) if remembers else None)
    return Guard(places, keys, ledger, requires=vehicle.security.policy is Policy.REQUIRE)
