"""Identity of wheels and sensors: those heard on the links against those of the configuration."""

import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Final

from firmware_protocol.frame_blocks import SampleRun
from firmware_protocol.messages import Environment, Frame, Hello
from gateway.core.config.vehicle import ASSUMED_RADIUS_MM, Tire, VehicleConfig, Wheel
from gateway.core.reasons import Level, Notice, Reason
from gateway.core.session.reasons import SessionCode
from gateway.core.wheels.possible_readings import possible_reading

_MAX_SENSORS: Final = 8


def sensor_ids(vehicle: VehicleConfig | None) -> dict[str, str]:
    """Return the configured sensors, as hex text by position."""
    wheels = vehicle.wheel if vehicle is not None else ()
    return {wheel.position: f"{wheel.sensor_number:08x}" for wheel in wheels if wheel.sensor_number is not None}


def positions(vehicle: VehicleConfig | None) -> dict[tuple[int, int], str]:
    """Return the configured positions by (hub, wheel)."""
    return {(wheel.hub, wheel.wheel): wheel.position for wheel in (vehicle.wheel if vehicle is not None else ())}


def misplaced_sensor(position: str, sensor_id: str, configured: Mapping[str, str]) -> Reason | None:
    """Return the fault when a wheel has another sensor than the configured one, None when it has not.

    Args:
        position: of the wheel.
        sensor_id: hex text of the sensor there, empty when unknown.
        configured: as `sensor_ids` returns.
    """
    expected = configured.get(position)
    if expected is None or not sensor_id or sensor_id == expected:
        return None
    owner = next((name for name, sensor in configured.items() if sensor == sensor_id), None)
    if owner is None:
        return Reason(SessionCode.OTHER_SENSOR, how="replaced", sensor=sensor_id, expected=expected)
    return Reason(SessionCode.OTHER_SENSOR, how="swapped", sensor=sensor_id, owner=owner, position=position)


def unconfigured_wheel(vehicle: VehicleConfig | None) -> Reason:
    """Return what is assumed of a wheel that the configuration does not have."""
    radius_m = ASSUMED_RADIUS_MM * 1e-3
    if vehicle is None:
        return Reason(SessionCode.WHEEL_NOT_CONFIGURED, vehicle_file="none", radius_m=radius_m)
    wheels = tuple(
        Reason(SessionCode.WHEEL_ADDRESS, position=wheel.position, hub=wheel.hub, wheel=wheel.wheel)
        for wheel in vehicle.wheel
    )
    return Reason(SessionCode.WHEEL_NOT_CONFIGURED, vehicle_file="others", configured=wheels, radius_m=radius_m)


def configured(vehicle: VehicleConfig | None, position: str) -> Wheel | None:
    """Return the configured wheel of a position, None when there is none."""
    wheels = vehicle.wheel if vehicle is not None else ()
    return next((wheel for wheel in wheels if wheel.position == position), None)


def configured_tire(vehicle: VehicleConfig | None, position: str) -> Tire | None:
    """Return the tire at a configured wheel, None when there is none."""
    wheel = configured(vehicle, position)
    return vehicle.tire_of(wheel) if vehicle is not None and wheel is not None else None


def wheel_address(vehicle: VehicleConfig | None, position: str) -> tuple[int, int] | None:
    """Return hub and number of a wheel; one that is not configured has a position such as `hub0.wheel2`.

    It is None for one that another link has too, as `hub0.wheel2 on b`.
    """
    wheel = configured(vehicle, position)
    if wheel is not None:
        return wheel.hub, wheel.wheel
    match = re.fullmatch(r"hub(\d+)\.wheel(\d+)", position)
    return (int(match[1]), int(match[2])) if match else None


class SensorsHeard:
    """Sensors heard at each wheel, and whether they measure pressure."""

    def __init__(self, vehicle: VehicleConfig | None) -> None:
        """Start without a frame; `vehicle` has the configured wheels."""
        self._vehicle = vehicle
        # A wheel has its position on the first link that has it.
        self._owners: dict[tuple[int, int], str] = {}
        self._sensors: dict[tuple[int, int], set[int]] = {}
        self._with_pressure: set[tuple[int, int]] = set()

    def samples(self, link: str, run: SampleRun) -> None:
        """Note the link of the wheel."""
        self._owners.setdefault((run.hub, run.wheel), link)

    def message(self, link: str, frame: Frame) -> None:
        """Take a hello or a pressure reading."""
        address, message = (frame.hub, frame.wheel), frame.message
        if self._owners.setdefault(address, link) != link:
            return
        if isinstance(message, Hello):
            sensors = self._sensors.setdefault(address, set())
            # A wheel has had few sensors; more are made up, and reported as changes of HELLO.
            if len(sensors) < _MAX_SENSORS:
                sensors.add(message.sensor_id)
        elif isinstance(message, Environment) and address not in self._with_pressure:
            possible = possible_reading(message)
            if possible is not None and possible.pressure_pa is not None:
                self._with_pressure.add(address)

    def hears_pressure(self, position: str) -> None:
        """Note that a receiver beside the hub has brought a pressure of a wheel."""
        if (address := wheel_address(self._vehicle, position)) is not None:
            self._with_pressure.add(address)

    def measures_pressure(self, position: str) -> bool:
        """Return whether the sensor of a wheel has sent a pressure."""
        return wheel_address(self._vehicle, position) in self._with_pressure

    def at(self, position: str) -> frozenset[int]:
        """Return the serial numbers of the sensors heard at a wheel."""
        address = wheel_address(self._vehicle, position)
        return frozenset(self._sensors.get(address, ()) if address is not None else ())

    def mismatches(self, positions: Iterable[str]) -> Iterator[Notice]:
        """Yield a notice for each sensor at another wheel than configured, and for each wheel not configured.

        Without a configuration there is none.
        """
        if self._vehicle is None:
            return
        expected = sensor_ids(self._vehicle)
        for position in positions:
            if configured(self._vehicle, position) is None:
                yield Notice(position, unconfigured_wheel(self._vehicle), Level.WARNING)
            for sensor in sorted(self.at(position)):
                reason = misplaced_sensor(position, f"{sensor:08x}", expected)
                if reason is not None:
                    yield Notice(position, reason, Level.WARNING)
