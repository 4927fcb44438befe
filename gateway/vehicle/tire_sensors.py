"""Pressure and temperature sensors of tires (TPMS) as a radio receiver hears them, in the JSON lines of rtl_433."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any, Final

from pydantic import Field

from firmware_protocol.messages import Environment
from gateway.core.config.validation import AddedKey, Section, above, within
from gateway.core.links.source import SensorLines, VehicleData
from gateway.core.reasons import Reason
from gateway.core.wheels.outside_readings import OutsideReading
from gateway.vehicle.reasons import VehicleCode

if TYPE_CHECKING:
    from gateway.core.config.vehicle import VehicleConfig

# Units in the keys of rtl_433's messages; `-C si` and `-C customary` change them.
_PRESSURE_PA: Final = {"kpa": 1e3, "psi": 6894.757, "bar": 1e5, "hpa": 100.0, "mbar": 100.0, "pa": 1.0}
_KEY: Final = re.compile(r"(pressure|temperature)_(\w+)")
# A sensor sends a message several times within a second or two, so that one is heard.
_REPEATED_NS: Final = 2_000_000_000
# Sensors of passing cars are heard too.
_MOST_NAMED: Final = 8


class TireSensor(Section):
    """`[[tpms.sensor]]`: the sensor of one wheel."""

    wheel: str = Field(description="position of its wheel")
    id: str = Field(min_length=1, max_length=64, description="its identity as rtl_433 prints it, such as 0f5476e8")
    std_kpa: float = above(5.8, 0, 100, "standard error of its pressure in kPa; default: of limits of ±10 kPa")
    offset_kpa: float = within(
        0.0, -200, 200, "added to its pressure in kPa: about -101 where it sends an absolute pressure"
    )


class TireSensors(Section):
    """`[tpms]`: sensors of pressure and temperature that a radio receiver beside the hub hears."""

    max_age_s: float = above(300.0, 0, 86_400, "a value is old from this age in s; sensors send every minute or so")
    sensor: tuple[TireSensor, ...] = Field(default=(), strict=False, description="a [[tpms.sensor]] table each")


TPMS: Final = AddedKey(
    TireSensors, "pressure and temperature from a radio receiver beside the hub", default=TireSensors()
)


def message_of(line: bytes) -> dict[str, Any] | None:
    """Return the message in a line, None where it is none."""
    try:
        message = json.loads(line)
    except (ValueError, RecursionError):
        return None
    return message if isinstance(message, dict) else None


class TireSensorDecoder:
    """Finds the readings of a vehicle's wheels in the lines of a receiver."""

    def __init__(self, sensors: TireSensors) -> None:
        """Take the sensors of the vehicle file."""
        self._sensors = {sensor.id.casefold(): sensor for sensor in sensors.sensor}
        self._max_age_s = sensors.max_age_s
        # Arrival and values of the latest message of each sensor, and the smallest step of its pressures so far.
        self._latest: dict[str, tuple[int, float | None, float | None]] = {}
        self._steps_pa: dict[str, float] = {}
        self._named: set[tuple[str, str]] = set()
        self._notices: list[tuple[str, Reason]] = []

    def take(self, item: VehicleData) -> Iterator[tuple[str, OutsideReading]]:
        """Yield position and reading of each message in lines that brings a new one."""
        if not isinstance(item, SensorLines):
            return
        for line in filter(bytes.strip, item.data.splitlines()):
            message = message_of(line)
            if message is None:
                self._unused(item.link, {}, "unread")
            elif (values := measured(message)) or message.get("type") == "TPMS":
                yield from self._readings(item, message, values)

    def take_notices(self) -> list[tuple[str, Reason]]:
        """Return what is to be said of messages that are not used since the last call, with their links."""
        notices, self._notices = self._notices, []
        return notices

    def _readings(
        self, item: SensorLines, message: Mapping[str, Any], values: Mapping[str, float]
    ) -> Iterator[tuple[str, OutsideReading]]:
        key = str(message.get("id")).casefold()
        sensor = self._sensors.get(key)
        if sensor is None:
            # Barometers and thermometers of the neighbourhood are no sensors of tires.
            if message.get("type") == "TPMS":
                self._unused(item.link, message, "unknown")
            return
        if "mic" not in message or not values:
            self._unused(item.link, message, "empty" if not values else "unchecked")
            return
        pressure_pa, temperature_degc = values.get("pressure"), values.get("temperature")
        before_ns, before_pa, _ = latest = self._latest.get(key, (-_REPEATED_NS, None, None))
        is_repeated = latest[1:] == (pressure_pa, temperature_degc)
        if is_repeated and 0 <= item.host_ns - before_ns < _REPEATED_NS:
            return
        self._latest[key] = item.host_ns, pressure_pa, temperature_degc
        if pressure_pa is not None and before_pa is not None and pressure_pa != before_pa:
            self._steps_pa[key] = min(self._steps_pa.get(key, math.inf), abs(pressure_pa - before_pa))
        # Rounded to a step, a value is anywhere within it; what is larger than its error is no step but a change.
        step_pa = self._steps_pa.get(key, 0.0)
        std_pa = sensor.std_kpa * 1e3
        std_pa = math.hypot(std_pa, step_pa / math.sqrt(12.0)) if step_pa < 4.0 * std_pa else std_pa
        gauge_pa = None if pressure_pa is None else pressure_pa + sensor.offset_kpa * 1e3
        reading = Environment(gauge_pa, temperature_degc, None)
        yield sensor.wheel, OutsideReading(item.host_ns, reading, std_pa, self._max_age_s)

    def _unused(self, link: str, message: Mapping[str, Any], reason: str) -> None:
        """Say once that messages of a sensor are not used."""
        identity, model = str(message.get("id", "")), str(message.get("model", ""))
        if (identity, reason) not in self._named and len(self._named) < _MOST_NAMED:
            self._named.add((identity, reason))
            self._notices.append((link, Reason(VehicleCode.TPMS_NOT_USED, model=model, id=identity, why=reason)))


def measured(message: Mapping[str, Any]) -> dict[str, float]:
    """Return the `pressure` in Pa and the `temperature` in degrees Celsius of a message, as far as it has them."""
    values: dict[str, float] = {}
    for key, value in message.items():
        match = _KEY.fullmatch(key)
        # math.isfinite would raise on an integer beyond all floats; NaN is not below either.
        if match is None or not isinstance(value, int | float) or isinstance(value, bool) or not abs(value) < 1e12:
            continue
        unit = match[2].lower()
        if match[1] == "pressure" and unit in _PRESSURE_PA:
            values.setdefault("pressure", value * _PRESSURE_PA[unit])
        elif match[1] == "temperature" and unit in ("c", "f"):
            values.setdefault("temperature", value if unit == "c" else (value - 32.0) / 1.8)
    return values


def open_tire_sensors(vehicle: VehicleConfig | None) -> TireSensorDecoder:
    """Return a new decoder of the sensors that a vehicle file names."""
    return TireSensorDecoder((vehicle.added(TireSensors) if vehicle is not None else None) or TireSensors())
