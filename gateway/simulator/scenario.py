"""Reader of scenarios, built in or from files, and their vehicle configurations."""

import math
from collections.abc import Iterator, Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import Any, Final

from gateway.core.config.toml_writer import toml_text
from gateway.core.config.validation import Fault, as_table, as_tables, parse_document, read_text, show
from gateway.core.errors import SourceError
from gateway.core.nearest_name import nearest
from gateway.core.ring_quantities import RING_NUMBERS
from gateway.simulator.scenario_model import Scenario
from gateway.simulator.wheel_plan import wheel_plans

_SUFFIX = ".toml"


def scenario_faults(data: Mapping[str, Any]) -> Iterator[Fault]:
    """Yield the inconsistencies between keys."""
    wheels = [wheel for _, wheel in as_tables(data.get("wheel"))]
    duplicate = "another wheel has the same; they must be unique"
    yield from _repeated("wheel", "position", [show(wheel.get("position")) for wheel in wheels], duplicate)
    addresses = [f"hub = {show(wheel.get('hub', 0))}, wheel = {show(wheel.get('wheel'))}" for wheel in wheels]
    yield from _repeated("wheel", "wheel", addresses, duplicate)
    hubs = [show(hub.get("hub")) for _, hub in as_tables(data.get("hub"))]
    yield from _repeated("hub", "hub", hubs, "another table describes this hub too; keep only one")
    yield from _section_faults("", data, data)
    for number, wheel in enumerate(wheels, 1):
        yield from _section_faults(f"wheel[{wheel.get('position', f'#{number}')}].", wheel, data)


def _repeated(table: str, key: str, values: Sequence[str], allowed: str) -> Iterator[Fault]:
    for index, value in enumerate(values):
        if value in values[:index]:
            yield Fault(f"{table}[#{index + 1}].{key}", value, allowed)


def _section_faults(where: str, table: Mapping[str, Any], data: Mapping[str, Any]) -> Iterator[Fault]:
    overrides = {name: as_table(table.get(name)) for name in ("sensor", "tire", "motion", "defect")}
    merged = {name: {**as_table(data.get(name)), **items} for name, items in overrides.items()}
    yield from _rate_faults(where, overrides, merged)
    yield from _tire_faults(where, overrides["tire"], merged["tire"])
    yield from _motion_faults(where, overrides["motion"], merged["motion"])


def _rate_faults(
    where: str, overrides: Mapping[str, Mapping[str, Any]], merged: Mapping[str, Mapping[str, Any]]
) -> Iterator[Fault]:
    rate = _number(merged["sensor"].get("rate_hz", 9600.0))
    limited = {"sensor": ("bandwidth_hz", "; leave it out for full bandwidth"), "defect": ("loose_hz", "")}
    for section, (key, remedy) in limited.items():
        value = _number(merged[section].get(key))
        is_stated = _has_any(overrides["sensor"], "rate_hz") or _has_any(overrides[section], key)
        if is_stated and value > 0.45 * rate:
            yield Fault(
                f"{where}{section}.{key}", show(value), f"allowed: up to 0.45 of rate_hz, {0.45 * rate:g}{remedy}"
            )


def _tire_faults(where: str, overrides: Mapping[str, Any], tire: Mapping[str, Any]) -> Iterator[Fault]:
    wear, thickness = _number(tire.get("wear_mm", 0.0)), _number(tire.get("ring_thickness_mm", 15.0))
    if _has_any(overrides, "wear_mm", "ring_thickness_mm") and wear > 0.8 * thickness:
        allowed = f"allowed: up to 0.8 of ring_thickness_mm, {0.8 * thickness:g}"
        yield Fault(f"{where}tire.wear_mm", show(wear), allowed)
    drum, radius = _number(tire.get("drum_radius_mm")), _number(tire.get("radius_mm", 320.0))
    if _has_any(overrides, "drum_radius_mm", "radius_mm") and -radius <= drum <= 0.0:
        allowed = f"allowed: above 0, or below -radius_mm = {-radius:g} for an inner drum"
        yield Fault(f"{where}tire.drum_radius_mm", show(drum), allowed)


def _motion_faults(where: str, overrides: Mapping[str, Any], motion: Mapping[str, Any]) -> Iterator[Fault]:
    paths = [name for name in ("yaw_rate_degps", "curvature_pkm") if name in motion]
    repeats = motion.get("repeat") is True
    if paths and repeats and _has_any(overrides, "repeat", *paths):
        yield Fault(f"{where}motion.{paths[0]}", show(motion[paths[0]]), "a repeated speed has no path")
    if len(paths) > 1 and _has_any(overrides, *paths):
        yield Fault(f"{where}motion.curvature_pkm", show(motion["curvature_pkm"]), "state one: this or yaw_rate_degps")
    speed = motion.get("speed_kmh")
    if repeats and _has_any(overrides, "repeat", "speed_kmh") and isinstance(speed, list) and len(speed) > 1:
        ends = [point[1] for point in (speed[0], speed[-1]) if isinstance(point, list) and len(point) == 2]
        if len(ends) == 2 and ends[0] != ends[1]:
            allowed = "a repeated speed must end at the value it starts with"
            yield Fault(f"{where}motion.speed_kmh", show(speed), allowed)


def _has_any(table: Mapping[str, Any], *names: str) -> bool:
    return any(name in table for name in names)


def _number(value: object) -> float:
    """Return a number, or NaN for anything else, so that every comparison is false."""
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else math.nan


def builtin_scenarios() -> dict[str, str]:
    """Return the built-in scenarios: name and description, its first comment."""
    descriptions = {}
    for entry in sorted(resources.files("gateway.simulator").joinpath("scenarios").iterdir(), key=lambda e: e.name):
        if entry.name.endswith(_SUFFIX):
            first = entry.read_text(encoding="utf-8").partition("\n")[0]
            descriptions[entry.name.removesuffix(_SUFFIX)] = first.lstrip("# ")
    return descriptions


def load_scenario(name: str) -> Scenario:
    """Return a built-in scenario by name, or one from a file.

    Raises:
        SourceError: there is no such scenario.
        ConfigError: it has faults; the message lists all of them.
    """
    builtin = resources.files("gateway.simulator").joinpath("scenarios", name + _SUFFIX)
    if "/" not in name and not name.endswith(_SUFFIX) and builtin.is_file():
        return parse_scenario(builtin.read_text(encoding="utf-8"), f"scenario {name}")
    path = Path(name)
    if not path.is_file():
        scenarios = builtin_scenarios()
        guess = nearest(name, scenarios)
        hint = f"did you mean {guess}? " if guess else ""
        raise SourceError(
            f"there is no scenario '{name}', neither built in nor a file",
            f"{hint}Built in: {', '.join(scenarios)}. See `treadlink simulate --list`.",
        )
    return parse_scenario(read_text(path, "the scenario"), str(path))


# Relative standard error of a load from a scale and of a pressure from a calibrated sensor.
_MEASURED_STD: Final = 0.005


def parse_scenario(text: str, origin: str) -> Scenario:
    """Return the scenario in a TOML text; `origin` names it in messages.

    Raises:
        ConfigError: with one line for each fault, `origin: key: value found, problem`.
    """
    return parse_document(Scenario, text, origin, scenario_faults)


def vehicle_toml(scenario: Scenario, *, signed: bool = False) -> str:
    """Return the vehicle configuration that a user would write: the known values, not the simulated errors.

    Loads and pressures are the initial ones, as a scale and a calibrated sensor give them. The numbers are those of the
    new tire, without wear. Values that the scenario misstates are written as misstated. A sensor mounted upside down is
    not mentioned. Sensors that sign are required to.
    """
    wheels = []
    for wheel, plan in zip(scenario.wheels(), wheel_plans(scenario), strict=True):
        tire, sensor, stated = wheel.tire, wheel.sensor, wheel.stated
        load_n = _claimed(stated.load_n, wheel.load_n.at(0.0))
        pressure_kpa = _claimed(stated.pressure_kpa, wheel.pressure_kpa.at(0.0))
        wheels.append(
            {
                "position": wheel.position,
                "hub": wheel.hub,
                "wheel": wheel.wheel,
                "sensor_id": f"{plan.sensor_id:08x}",
                "load_n": load_n,
                "load_std_n": round(_MEASURED_STD * load_n, 3),
                "tire": {
                    **({"size": tire.size} if tire.size else {}),
                    "radius_mm": _claimed(stated.radius_mm, tire.radius_mm),
                    "pressure_kpa": pressure_kpa,
                    "pressure_std_kpa": round(_MEASURED_STD * pressure_kpa, 3),
                    "temperature_degc": wheel.temperature_degc.at(0.0),
                    "ring_thickness_mm": tire.ring_thickness_mm,
                    **(
                        {
                            "contact_half_angle_deg": tire.linear_half_angle_deg,
                            "contact_half_angle_std_deg": round(_MEASURED_STD * tire.linear_half_angle_deg, 6),
                            "linear_ring": True,
                        }
                        if tire.linear_half_angle_deg is not None
                        else {}
                    ),
                    "reference": {
                        **{name: getattr(tire, name) for name in RING_NUMBERS},
                        "pressure_kpa": tire.reference_pressure_kpa,
                    },
                },
                "mounting": {
                    "offset_mm": _claimed(stated.offset_mm, sensor.offset_mm),
                    "roll_deg": _claimed(stated.roll_deg, _meant(sensor.roll_deg)),
                    "pitch_deg": _claimed(stated.pitch_deg, _meant(sensor.pitch_deg)),
                },
            }
        )
    security = {"security": {"policy": "require"}} if signed else {}
    return toml_text({"vehicle": {"name": scenario.scenario.name}, "wheel": wheels, **security})


def _claimed(claim: float | None, true: float) -> float:
    return true if claim is None else claim


def _meant(angle_deg: float) -> float:
    """Return the intended mounting angle; an angle beyond 45 deg is a mounting error."""
    return angle_deg if abs(angle_deg) <= 45.0 else 0.0
