"""Provenance of a recording's conditions: which are stated, by what, and which are assumed."""

import math
import re
from collections.abc import Iterator, Sequence
from enum import StrEnum

from gateway.core.config.vehicle import ASSUMED_RADIUS_MM, Mounting, VehicleConfig, Wheel
from gateway.core.reasons import Code, CoreCode, Reason
from gateway.diagnosis.data.campaign_data import Group, Remark
from gateway.diagnosis.data.group_statistics import ASSUMED_LOAD_N, ASSUMED_PRESSURE_PA
from gateway.diagnosis.reasons import DiagnosisCode


class Quantity(StrEnum):
    """Quantities whose provenance is listed, as the list `assumed` of a vehicle file names them."""

    RADIUS = "belt radius"
    LOAD = "load"
    PRESSURE = "pressure"
    OFFSET = "mounting offset"
    ROLL = "mounting roll"
    PITCH = "mounting pitch"


def provenance_of(
    vehicle: VehicleConfig | None,
    wheel: Wheel | None,
    groups: Sequence[Group],
    source: Code,
    *,
    pressure_measured: bool,
) -> tuple[tuple[Reason, ...], tuple[Remark, ...]]:
    """Return what is stated of belt radius, load, pressure and mounting, each with its source, and what is assumed.

    Quantities that the configuration gives but lists as assumed are not stated.

    Args:
        vehicle: configuration of the recording.
        wheel: of the configuration; without one only a measured pressure is known.
        groups: of the recording; load and pressure are those of their conditions.
        source: of the configuration: FROM_CONFIGURATION or FROM_RECORDING.
        pressure_measured: whether the sensor sent a pressure, which then replaces the stated one.
    """
    conditions = _stated_conditions(vehicle, wheel, groups, Reason(source), pressure_measured=pressure_measured)
    assumed = tuple(_assumed(vehicle, wheel, groups))
    return tuple(reason for quantity, reason in conditions if not is_assumed(vehicle, quantity)), assumed


def is_assumed(vehicle: VehicleConfig | None, quantity: Quantity) -> bool:
    """Return whether a configuration lists a quantity as assumed."""
    return vehicle is not None and quantity in map(_quantity, vehicle.vehicle.assumed)


def _stated_conditions(
    vehicle: VehicleConfig | None,
    wheel: Wheel | None,
    groups: Sequence[Group],
    source: Reason,
    *,
    pressure_measured: bool,
) -> Iterator[tuple[Quantity, Reason]]:
    if vehicle is not None and wheel is not None:
        radius_m = vehicle.tire_of(wheel).radius_m
        if radius_m is not None:
            yield Quantity.RADIUS, Reason(DiagnosisCode.STATED, quantity="radius_m", value=radius_m, source=source)
        loads_n = [group.conditions.load_n for group in groups if group.load_known]
        if loads_n:
            yield Quantity.LOAD, _stated_load(loads_n, source)
    pressures_pa = [group.conditions.pressure_pa for group in groups if group.pressure_known]
    if pressures_pa:
        origin = Reason(CoreCode.FROM_SENSOR) if pressure_measured else source
        yield Quantity.PRESSURE, _stated_pressure(pressures_pa, origin)
    mounting = wheel.mounting if wheel is not None else Mounting()
    if mounting.offset_m is not None:
        yield Quantity.OFFSET, Reason(DiagnosisCode.STATED, quantity="offset_m", value=mounting.offset_m, source=source)
    elif measured_m := [group.declared_offset_m for group in groups if group.conditions.offset_known]:
        origin = Reason(CoreCode.FROM_SENSOR)
        yield (
            Quantity.OFFSET,
            Reason(DiagnosisCode.STATED, quantity="offset_m", value=sum(measured_m) / len(measured_m), source=origin),
        )
    if mounting.roll_deg:
        yield (
            Quantity.ROLL,
            Reason(DiagnosisCode.STATED, quantity="roll_rad", value=math.radians(mounting.roll_deg), source=source),
        )
    if mounting.pitch_deg:
        yield (
            Quantity.PITCH,
            Reason(DiagnosisCode.STATED, quantity="pitch_rad", value=math.radians(mounting.pitch_deg), source=source),
        )


def _stated_load(loads_n: Sequence[float], source: Reason) -> Reason:
    """Return the stated load to 1 N, so that recordings of one load agree whatever the rounding of their means."""
    low_n, high_n = float(round(min(loads_n))), float(round(max(loads_n)))
    if low_n == high_n:
        return Reason(DiagnosisCode.STATED, quantity="load_n", value=low_n, source=source)
    return Reason(DiagnosisCode.STATED_RANGE, quantity="load_n", low=low_n, high=high_n, source=source)


def _stated_pressure(pressures_pa: Sequence[float], source: Reason) -> Reason:
    """Return the pressure to 1 kPa, for the same reason."""
    low_pa, high_pa = round(min(pressures_pa) * 1e-3) * 1e3, round(max(pressures_pa) * 1e-3) * 1e3
    if low_pa == high_pa:
        return Reason(DiagnosisCode.STATED, quantity="pressure_pa", value=low_pa, source=source)
    return Reason(DiagnosisCode.STATED_RANGE, quantity="pressure_pa", low=low_pa, high=high_pa, source=source)


def _assumed(vehicle: VehicleConfig | None, wheel: Wheel | None, groups: Sequence[Group]) -> Iterator[Remark]:
    """Yield what is assumed of the recording: the list of its configuration, and values that nothing states."""
    yield from vehicle.vehicle.assumed if vehicle is not None else ()
    if wheel is None:
        yield Reason(CoreCode.ASSUMED_RADIUS, radius_m=ASSUMED_RADIUS_MM * 1e-3)
    if any(not group.load_known for group in groups):
        yield Reason(DiagnosisCode.ASSUMED, quantity="load_n", value=ASSUMED_LOAD_N)
    if any(not group.pressure_known for group in groups):
        yield Reason(DiagnosisCode.ASSUMED, quantity="pressure_pa", value=ASSUMED_PRESSURE_PA)
    # An offset that the configuration lists as assumed is in that list already.
    if any(not group.conditions.offset_known for group in groups) and not is_assumed(vehicle, Quantity.OFFSET):
        yield Reason(DiagnosisCode.ASSUMED, quantity="offset_m")
    if groups and not any(math.isfinite(group.conditions.temperature_degc) for group in groups):
        yield Reason(DiagnosisCode.ASSUMED, quantity="temperature_degc")


def _quantity(text: str) -> Quantity | None:
    """Return the quantity that an entry of a vehicle file's list `assumed` begins with, as in `belt radius 320 mm`."""
    name = re.split(r"[^A-Za-z ]", text, maxsplit=1)[0].strip().lower()
    return Quantity(name) if name in set(Quantity) else None
