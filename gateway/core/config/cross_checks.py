"""Consistency checks across the keys of a vehicle configuration, on the raw document."""

from collections.abc import Iterator, Mapping
from typing import Any, Final, TypeGuard

from gateway.core.config.validation import Fault, as_table, as_tables, key_of, show
from gateway.core.nearest_name import nearest

# Hubs times wheels of one hub are far fewer; the checks of names compare all with all.
_MAX_WHEELS: Final = 1000
# Belt and tread of large earthmover tires are a tenth of the radius, those of small industrial ones up to a quarter.
_MAX_RING_SHARE: Final = 0.3
# A value out of these is a fault of its own, of another unit as a rule, and says nothing about other keys.
_RADIUS_MM: Final = (100.0, 1200.0)
_LOADS: Final = (20.0, 100_000.0)


def cross_faults(data: Mapping[str, Any]) -> Iterator[Fault]:
    """Yield the inconsistencies between the keys of a document; any key may be missing or of a wrong type.

    The raw document is checked so that these faults are reported together with those of single keys.
    """
    wheels = as_tables(data.get("wheel"))
    if len(wheels) > _MAX_WHEELS:
        yield Fault("wheel", show(data["wheel"]), f"allowed: at most {_MAX_WHEELS} tables")
        return
    yield from _duplicates(data, wheels)
    yield from _axles(data, wheels)
    yield from _radii(data, wheels)
    yield from _rings(data, wheels)
    yield from _load_errors(data, wheels)
    for index, wheel in wheels:
        if "load_std_n" in wheel and "load_n" not in wheel:
            key = key_of(data, ("wheel", index, "load_std_n"))
            yield Fault(key, show(wheel["load_std_n"]), "it needs load_n too")
    yield from _calibrations(data, wheels)
    if as_table(data.get("security")).get("policy") == "require":
        for index, wheel in wheels:
            if "sensor_id" not in wheel:
                key = key_of(data, ("wheel", index, "sensor_id"))
                yield Fault(key, None, 'required by security.policy = "require"')
    yield from _bus_signals(data, wheels)
    thresholds = as_table(data.get("thresholds"))
    low, high = thresholds.get("pressure_min_kpa"), thresholds.get("pressure_max_kpa")
    if _is_number(low) and _is_number(high) and low >= high:
        yield Fault("thresholds.pressure_min_kpa", show(low), f"allowed: less than pressure_max_kpa = {show(high)}")


def _unknown_wheel(key: str, wheel: str, positions: list[str]) -> Fault:
    return Fault(key, show(wheel), f"no wheel has this position; known: {', '.join(positions)}")


def _bus_signals(data: Mapping[str, Any], wheels: list[tuple[int, Mapping[str, Any]]]) -> Iterator[Fault]:
    positions = [wheel["position"] for _, wheel in wheels if isinstance(wheel.get("position"), str)]
    sensor_indexes: dict[tuple[str, str], int] = {}
    for index, sensor in as_tables(as_table(data.get("tpms")).get("sensor")):
        if isinstance(wheel := sensor.get("wheel"), str) and wheel not in positions:
            yield _unknown_wheel(f"tpms.sensor[#{index + 1}].wheel", wheel, positions)
        for key, value in (("wheel", str(wheel)), ("id", str(sensor.get("id")).casefold())):
            first = sensor_indexes.setdefault((key, value), index)
            if first != index and key in sensor:
                allowed = f"tpms.sensor[#{first + 1}] has the same; each wheel has one sensor"
                yield Fault(f"tpms.sensor[#{index + 1}].{key}", show(sensor[key]), allowed)
    signal_indexes: dict[tuple[str, str], int] = {}
    for index, signal in as_tables(as_table(data.get("vehicle_signals")).get("signal")):
        key = f"vehicle_signals.signal[#{index + 1}]"
        quantity, wheel = signal.get("quantity"), signal.get("wheel")
        if _is_number(signal.get("factor")) and signal["factor"] == 0:
            yield Fault(f"{key}.factor", show(signal["factor"]), "allowed: any number but 0, which loses the value")
        if quantity == "wheel_speed" and wheel is None:
            yield Fault(f"{key}.wheel", None, "required for wheel_speed")
        if isinstance(wheel, str) and wheel not in positions:
            yield _unknown_wheel(f"{key}.wheel", wheel, positions)
        first = signal_indexes.setdefault((str(quantity), str(wheel)), index)
        if first != index:
            yield Fault(f"{key}.quantity", show(quantity), f"vehicle_signals.signal[#{first + 1}] is the same quantity")


def _calibrations(data: Mapping[str, Any], wheels: list[tuple[int, Mapping[str, Any]]]) -> Iterator[Fault]:
    tires = [("tire", data.get("tire"))]
    tires += [(key_of(data, ("wheel", index, "tire")), wheel.get("tire")) for index, wheel in wheels]
    for name, tire in tires:
        for kind in ("load_calibration", "slip_calibration", "side_force_calibration"):
            calibration = as_table(as_table(tire).get(kind))
            for low_key, high_key in (
                ("half_angle_min_rad", "half_angle_max_rad"),
                ("pressure_min_kpa", "pressure_max_kpa"),
                ("slip_min_deg", "slip_max_deg"),
            ):
                low, high = calibration.get(low_key), calibration.get(high_key)
                if _is_number(low) and _is_number(high) and low > high:
                    yield Fault(f"{name}.{kind}.{low_key}", show(low), f"allowed: up to {high_key} = {show(high)}")
        yield from _laminate(f"{name}.laminate", as_table(as_table(tire).get("laminate")))


def _laminate(name: str, laminate: Mapping[str, Any]) -> Iterator[Fault]:
    rubber = laminate.get("rubber_mpa")
    cords = [ply for _, ply in as_tables(laminate.get("ply")) if ply.get("cord_share_percent") != 0]
    if "ply" in laminate and len(cords) < 2:
        yield Fault(f"{name}.ply", show(laminate["ply"]), "at least two plies need cords (cord_share_percent above 0)")
    for index, ply in as_tables(laminate.get("ply")):
        cord = ply.get("cord_gpa")
        if _is_number(cord) and _is_number(rubber) and cord * 1e3 < rubber:
            allowed = f"at least {name}.rubber_mpa = {show(rubber)}, which is {rubber * 1e-3:g} GPa"
            yield Fault(f"{name}.ply[#{index + 1}].cord_gpa", show(cord), f"allowed: {allowed}")


def _duplicates(data: Mapping[str, Any], wheels: list[tuple[int, Mapping[str, Any]]]) -> Iterator[Fault]:
    positions: dict[str, int] = {}
    addresses: dict[tuple[int, int], str] = {}
    sensors: dict[int, str] = {}
    for index, wheel in wheels:
        number = f"wheel[#{index + 1}]"
        position = wheel.get("position")
        if isinstance(position, str):
            if position in positions:
                allowed = f"wheel[#{positions[position] + 1}] has the same position; positions must be unique"
                yield Fault(f"{number}.position", show(position), allowed)
            positions.setdefault(position, index)
        name = key_of(data, ("wheel", index))
        hub, channel = wheel.get("hub"), wheel.get("wheel")
        if _is_int(hub) and _is_int(channel):
            if (hub, channel) in addresses:
                allowed = f"{addresses[hub, channel]} has the same; they must be unique"
                yield Fault(f"{name}.wheel", f"hub = {hub}, wheel = {channel}", allowed)
            addresses.setdefault((hub, channel), name)
        sensor = _hex(wheel.get("sensor_id"))
        if sensor is not None:
            if sensor in sensors:
                yield Fault(f"{name}.sensor_id", show(wheel["sensor_id"]), f"{sensors[sensor]} has the same sensor")
            sensors.setdefault(sensor, name)


def _axles(data: Mapping[str, Any], wheels: list[tuple[int, Mapping[str, Any]]]) -> Iterator[Fault]:
    by_position = {wheel["position"]: wheel for _, wheel in wheels if isinstance(wheel.get("position"), str)}
    axles: dict[str, int] = {}
    for index, axle in as_tables(data.get("axle")):
        names = axle.get("wheels")
        key = f"axle[#{index + 1}].wheels"
        for name in names if isinstance(names, list | tuple) else ():
            if not isinstance(name, str):
                continue
            if name not in by_position:
                guess = nearest(name, by_position)
                positions = ", ".join(by_position) or "none"
                allowed = f"no wheel has this position; {f'did you mean {guess}?' if guess else f'known: {positions}'}"
                yield Fault(key, show(name), allowed)
            elif "load_n" in by_position[name] and "weight_kg" in axle:
                allowed = f"{key[:-7]} states its load too; keep only one"
                yield Fault(f"wheel[{name}].load_n", show(by_position[name]["load_n"]), allowed)
            if name in axles:
                yield Fault(
                    key, show(name), f"axle[#{axles[name] + 1}] lists this wheel too; a wheel belongs to one axle"
                )
            axles.setdefault(name, index)


def _radii(data: Mapping[str, Any], wheels: list[tuple[int, Mapping[str, Any]]]) -> Iterator[Fault]:
    if "radius_mm" in as_table(data.get("tire")):
        return
    for index, wheel in wheels:
        if "radius_mm" not in as_table(wheel.get("tire")):
            key = key_of(data, ("wheel", index, "tire", "radius_mm"))
            yield Fault(key, None, "the belt radius is required here or as tire.radius_mm")


def _rings(data: Mapping[str, Any], wheels: list[tuple[int, Mapping[str, Any]]]) -> Iterator[Fault]:
    """Yield rings that are too thick for their radius or thinner than their wear, as each wheel combines the keys."""
    common = as_table(data.get("tire"))
    tires = [("tire", common, common)]
    for index, wheel in wheels:
        table = as_table(wheel.get("tire"))
        tires.append((key_of(data, ("wheel", index, "tire")), table, {**common, **table}))
    for name, table, tire in tires:
        radius, thickness, wear = tire.get("radius_mm"), tire.get("ring_thickness_mm"), tire.get("wear_mm")
        if not _is_number(thickness):
            continue
        # A key that a wheel takes over from [tire] is compared there.
        is_compared = bool({"radius_mm", "ring_thickness_mm"} & table.keys())
        if is_compared and _is_within(radius, _RADIUS_MM) and thickness > _MAX_RING_SHARE * radius:
            key, problem = "ring_thickness_mm", f"up to {100.0 * _MAX_RING_SHARE:.0f} % of radius_mm = {show(radius)}"
            if key not in table:
                key = "radius_mm"
                problem = f"at most {100.0 * _MAX_RING_SHARE:.0f} % of it is ring_thickness_mm = {show(thickness)}"
            yield Fault(f"{name}.{key}", show(tire[key]), f"allowed: {problem}")
        if {"wear_mm", "ring_thickness_mm"} & table.keys() and _is_number(wear) and wear >= thickness:
            key, problem = "wear_mm", f"less than ring_thickness_mm = {show(thickness)}, that of the new ring"
            if key not in table:
                key, problem = "ring_thickness_mm", f"that of the new ring, more than wear_mm = {show(wear)}"
            yield Fault(f"{name}.{key}", show(tire[key]), f"allowed: {problem}")


def _load_errors(data: Mapping[str, Any], wheels: list[tuple[int, Mapping[str, Any]]]) -> Iterator[Fault]:
    """Yield standard errors of loads and weights that exceed the value itself."""
    tables = [(key_of(data, ("wheel", index)), wheel, "load_n", "load_std_n") for index, wheel in wheels]
    for index, axle in as_tables(data.get("axle")):
        tables.append((f"axle[#{index + 1}]", axle, "weight_kg", "weight_std_kg"))
        if not {"weight_kg", "track_width_mm"} & axle.keys():
            yield Fault(f"axle[#{index + 1}].weight_kg", None, "required, or track_width_mm")
    for name, table, key, std_key in tables:
        value, std = table.get(key), table.get(std_key)
        if _is_within(value, _LOADS) and _is_number(std) and std > value:
            yield Fault(f"{name}.{std_key}", show(std), f"allowed: up to {key} = {show(value)}")


def _is_int(value: object) -> TypeGuard[int]:
    return isinstance(value, int) and not isinstance(value, bool)


def _is_number(value: object) -> TypeGuard[float]:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _is_within(value: object, limits: tuple[float, float]) -> TypeGuard[float]:
    return _is_number(value) and limits[0] <= value <= limits[1]


def _hex(value: object) -> int | None:
    try:
        return int(value, 16) if isinstance(value, str) else None
    except ValueError:
        return None
