"""Consistency checks between the keys of a scenario, on the raw document."""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from gateway.config.validation import Fault, show


def scenario_faults(data: Mapping[str, Any]) -> Iterator[Fault]:
    """Yield the inconsistencies between keys."""
    wheels = [item for item in _list(data.get("wheel")) if isinstance(item, Mapping)]
    taken = "another wheel has the same; they must be unique"
    yield from _repeated("wheel", "position", [show(wheel.get("position")) for wheel in wheels], taken)
    addresses = [f"hub = {show(wheel.get('hub', 0))}, wheel = {show(wheel.get('wheel'))}" for wheel in wheels]
    yield from _repeated("wheel", "wheel", addresses, taken)
    hubs = [show(hub.get("hub")) for hub in _list(data.get("hub")) if isinstance(hub, Mapping)]
    yield from _repeated("hub", "hub", hubs, "another table describes this hub too; keep only one")
    yield from _section_faults("", data, data)
    for number, wheel in enumerate(wheels, 1):
        yield from _section_faults(f"wheel[{wheel.get('position', f'#{number}')}].", wheel, data)


def _repeated(table: str, key: str, values: Sequence[str], allowed: str) -> Iterator[Fault]:
    for index, value in enumerate(values):
        if value in values[:index]:
            yield Fault(f"{table}[#{index + 1}].{key}", value, allowed)


def _section_faults(where: str, table: Mapping[str, Any], data: Mapping[str, Any]) -> Iterator[Fault]:
    overrides = {name: _table(table.get(name)) for name in ("sensor", "tire", "motion", "defect")}
    merged = {name: {**_table(data.get(name)), **items} for name, items in overrides.items()}
    sensor, tire, motion = merged["sensor"], merged["tire"], merged["motion"]
    bandwidth, rate = _number(sensor.get("bandwidth_hz")), _number(sensor.get("rate_hz", 9600.0))
    if _given(overrides["sensor"], "bandwidth_hz", "rate_hz") and bandwidth > 0.45 * rate:
        allowed = f"allowed: up to 0.45 of rate_hz, {0.45 * rate:g}; leave it out for full bandwidth"
        yield Fault(f"{where}sensor.bandwidth_hz", show(bandwidth), allowed)
    loose = _number(merged["defect"].get("loose_hz"))
    if (_given(overrides["sensor"], "rate_hz") or _given(overrides["defect"], "loose_hz")) and loose > 0.45 * rate:
        yield Fault(f"{where}defect.loose_hz", show(loose), f"allowed: up to 0.45 of rate_hz, {0.45 * rate:g}")
    wear, thickness = _number(tire.get("wear_mm", 0.0)), _number(tire.get("ring_thickness_mm", 15.0))
    if _given(overrides["tire"], "wear_mm", "ring_thickness_mm") and wear > 0.8 * thickness:
        allowed = f"allowed: up to 0.8 of ring_thickness_mm, {0.8 * thickness:g}"
        yield Fault(f"{where}tire.wear_mm", show(wear), allowed)
    drum, radius = _number(tire.get("drum_radius_mm")), _number(tire.get("radius_mm", 320.0))
    if _given(overrides["tire"], "drum_radius_mm", "radius_mm") and -radius <= drum <= 0.0:
        allowed = f"allowed: above 0, or below -radius_mm = {-radius:g} for an inner drum"
        yield Fault(f"{where}tire.drum_radius_mm", show(drum), allowed)
    speed = motion.get("speed_kmh")
    stated = _given(overrides["motion"], "repeat", "speed_kmh") and motion.get("repeat") is True
    if stated and isinstance(speed, list) and len(speed) > 1:
        ends = [point[1] for point in (speed[0], speed[-1]) if isinstance(point, list) and len(point) == 2]
        if len(ends) == 2 and ends[0] != ends[1]:
            yield Fault(
                f"{where}motion.speed_kmh", show(speed), "a repeated speed must end at the value it starts with"
            )


def _given(table: Mapping[str, Any], *names: str) -> bool:
    return any(name in table for name in names)


def _number(value: object) -> float:
    """Return a number, or NaN for anything else, so that every comparison is false."""
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else math.nan


def _list(value: object) -> list[Any]:
    return value if isinstance(value, list) else []


def _table(value: object) -> Mapping[str, Any]:
    return value if isinstance(value, Mapping) else {}
