"""Whether the wheels that speak are those of the configuration, told in the same words by every command."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping

import numpy as np

from firmware_protocol.batch import FrameBatch
from firmware_protocol.messages import Environment, Hello, MessageType
from gateway.config.vehicle import ASSUMED_RADIUS_MM, VehicleConfig, Wheel


def sensor_ids(vehicle: VehicleConfig | None) -> dict[str, str]:
    """Return the sensors that the configuration names, as hex text by position."""
    wheels = vehicle.wheel if vehicle is not None else ()
    return {wheel.position: f"{wheel.sensor_number:08x}" for wheel in wheels if wheel.sensor_number is not None}


def misplaced(position: str, sensor_id: str, wanted: Mapping[str, str]) -> str:
    """Return what is wrong with a sensor that speaks at a wheel, empty when nothing is.

    Args:
        position: of the wheel.
        sensor_id: hex text, empty when it is not known.
        wanted: as `sensor_ids` returns.
    """
    expected = wanted.get(position)
    if expected is None or not sensor_id or sensor_id == expected:
        return ""
    owner = next((name for name, one in wanted.items() if one == sensor_id), None)
    if owner is None:
        return f"sensor {sensor_id} speaks here, the configuration names {expected}: a new sensor or tire?"
    return f"sensor {sensor_id} of {owner} speaks here: wheels swapped? Estimates use load and tire of {position}"


def unconfigured(position: str, vehicle: VehicleConfig | None) -> str:
    """Return what is told of a wheel that the configuration does not have."""
    what = f"belt radius {ASSUMED_RADIUS_MM:g} mm assumed, load unknown"
    if vehicle is None:
        return f"{position} is not configured: {what}; give --config VEHICLE.toml"
    there = ", ".join(f"{wheel.position} (hub {wheel.hub}, wheel {wheel.wheel})" for wheel in vehicle.wheel)
    return f"{position} is not configured, the configuration has {there}: {what}"


def configured(vehicle: VehicleConfig | None, position: str) -> Wheel | None:
    """Return the wheel of a position, None where the configuration has none."""
    wheels = vehicle.wheel if vehicle is not None else ()
    return next((wheel for wheel in wheels if wheel.position == position), None)


def address(vehicle: VehicleConfig | None, position: str) -> tuple[int, int] | None:
    """Return hub and number of a wheel; the pipeline calls one that is not configured `hub0.wheel2`."""
    wheel = configured(vehicle, position)
    if wheel is not None:
        return wheel.hub, wheel.wheel
    found = re.match(r"hub(\d+)\.wheel(\d+)", position)
    return (int(found[1]), int(found[2])) if found else None


class SensorsHeard:
    """The sensors that said at which wheels they are, and whether they measure pressure."""

    def __init__(self) -> None:
        self._seen: dict[tuple[int, int], set[int]] = {}
        self._pressures: set[tuple[int, int]] = set()

    def take(self, batch: FrameBatch) -> None:
        """Look for hellos and readings of pressure."""
        for at in np.flatnonzero(batch.type == MessageType.HELLO).tolist():
            hello = batch.message(at)
            assert isinstance(hello, Hello)
            self._seen.setdefault((int(batch.hub[at]), int(batch.wheel[at])), set()).add(hello.sensor_id)

        for at in np.flatnonzero(batch.type == MessageType.ENVIRONMENT).tolist():
            where = int(batch.hub[at]), int(batch.wheel[at])
            if where not in self._pressures:
                reading = batch.message(at)
                assert isinstance(reading, Environment)
                if reading.pressure_pa is not None:
                    self._pressures.add(where)

    def measures_pressure(self, vehicle: VehicleConfig | None, position: str) -> bool:
        """Return whether a wheel's sensor told a pressure."""
        return address(vehicle, position) in self._pressures

    def at(self, vehicle: VehicleConfig | None, position: str) -> frozenset[int]:
        """Return the serial numbers of the sensors that were heard at a wheel."""
        where = address(vehicle, position)
        return frozenset(self._seen.get(where, ()) if where is not None else ())

    def strangers(self, vehicle: VehicleConfig | None, positions: Iterable[str]) -> Iterator[str]:
        """Yield a text for each sensor that is not where the configuration has it, and each wheel that it has not.

        Nothing is said where there is no configuration.
        """
        if vehicle is None:
            return
        wanted = sensor_ids(vehicle)
        for position in positions:
            if configured(vehicle, position) is None:
                yield unconfigured(position, vehicle)
            for sensor in sorted(self.at(vehicle, position)):
                if text := misplaced(position, f"{sensor:08x}", wanted):
                    yield f"{position}: {text}"
