"""What a recording's results rest on: what was stated and by whom, and what is assumed because nobody stated it."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import Final

from gateway.closure.group_making import ASSUMED_LOAD_N, ASSUMED_PRESSURE_PA
from gateway.closure.observation import Group
from gateway.config.vehicle import ASSUMED_RADIUS_MM, VehicleConfig, Wheel

GIVEN: Final = "--config"
RECORDED: Final = "configuration recorded with it"
MEASURED: Final = "measured by the sensor"


def stated(
    vehicle: VehicleConfig | None, wheel: Wheel | None, groups: Sequence[Group], source: str, *, pressure_measured: bool
) -> tuple[str, ...]:
    """Return belt radius, load, pressure and how the sensor sits as stated, each with who states it.

    Args:
        vehicle: configuration of the recording.
        wheel: of it; None where it has none, and nothing is stated then but what the sensor measures.
        groups: of the recording, whose conditions are told.
        source: of the configuration.
        pressure_measured: whether the sensor told a pressure, which counts instead of the stated one.
    """
    told = []
    if vehicle is not None and wheel is not None:
        told.append(f"belt radius {vehicle.tire_of(wheel).radius_mm:g} mm ({source})")
        known = [group.conditions.load_n for group in groups if group.load_known]
        told += [f"load {_range(known)} N ({source})"] if known else []
    known = [group.conditions.pressure_pa * 1e-3 for group in groups if group.pressure_known]
    told += [f"pressure {_range(known)} kPa ({MEASURED if pressure_measured else source})"] if known else []
    if wheel is not None:
        here = wheel.mounting
        left = "" if "offset_mm" in here.model_fields_set else ", which leaves it out"
        told.append(f"mounting offset {here.offset_mm:g} mm below the neutral layer ({source}{left})")
        for name, value_deg in (("roll", here.roll_deg), ("pitch", here.pitch_deg)):
            told += [f"mounting {name} {value_deg:g} deg ({source})"] if value_deg else []
    # A configuration may hold a number and say that it is assumed, as that of an imported measurement does.
    doubted = vehicle.vehicle.assumed if vehicle is not None else ()
    return tuple(text for text in told if not any(_quantity(text) == _quantity(other) for other in doubted))


def assumed(vehicle: VehicleConfig | None, wheel: Wheel | None, groups: Sequence[Group]) -> tuple[str, ...]:
    """Return what nobody stated of the recording, and what is taken instead."""
    told = list(vehicle.vehicle.assumed) if vehicle is not None else []
    if wheel is None:
        told.append(f"belt radius {ASSUMED_RADIUS_MM:g} mm (no configuration states it)")
    if any(not group.load_known for group in groups):
        told.append(f"load {ASSUMED_LOAD_N:.0f} N (nobody states it)")
    if any(not group.pressure_known for group in groups):
        told.append(f"pressure {ASSUMED_PRESSURE_PA * 1e-3:.0f} kPa (neither stated nor measured)")
    if groups and not any(math.isfinite(group.conditions.temperature_degc) for group in groups):
        told.append("temperature steady (neither stated nor measured)")
    return tuple(told)


def _quantity(text: str) -> str:
    """Return the words before the first number, as `belt radius`."""
    return re.split(r"[^A-Za-z ]", text, maxsplit=1)[0].strip().lower()


def _range(values: Sequence[float]) -> str:
    low, high = f"{min(values):.0f}", f"{max(values):.0f}"
    return low if low == high else f"{low} to {high}"
