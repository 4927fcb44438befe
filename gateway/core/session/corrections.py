"""Known effects that a session subtracts: their tables compared with the vehicle, and what is said of them."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

from gateway.core.config.vehicle import VehicleConfig
from gateway.core.errors import ConfigError
from gateway.core.estimates.wheel_setup import CorrectedSignal, CorrectionTable, WheelSetup
from gateway.core.reasons import Code, CoreCode, Level, Notice, Reason, Value
from gateway.core.session.reasons import SessionCode
from gateway.core.session.session_parts import open_effects_file

# Differences with which subtracting would be wrong, and what they are.
_REFUSED: Final[Mapping[Code, Callable[[Reason], str]]] = {
    CoreCode.EFFECTS_OF_OTHER_OFFSET: lambda reason: (
        f"were found with the sensor {_mm(reason['found_m'])} mm below the neutral layer, but the configuration states "
        f"{_mm(reason['offset_m'])} mm"
    ),
    CoreCode.EFFECTS_OF_OTHER_RADIUS: lambda reason: (
        f"were found with a belt radius of {_mm(reason['found_m'])} mm, but the configuration states "
        f"{_mm(reason['radius_m'])} mm"
    ),
    CoreCode.EFFECTS_OF_OTHER_SENSOR: lambda reason: (
        f"belong to sensor {reason['found_on']}, but the configuration names {reason['sensor']}"
    ),
}


def open_effects(paths: Sequence[Path], vehicle: VehicleConfig | None) -> tuple[CorrectionTable, ...]:
    """Return the tables of effects files.

    Raises:
        ConfigError: a file cannot be read, is not an effects file, was edited, or does not belong to the vehicle.
        TreadlinkError: an effect is not in the catalogue, or its parameters are not those of the catalogue or outside
            of their ranges.
    """
    tables = tuple(map(open_effects_file, paths))
    check_effects(tables, vehicle)
    return tables


def check_effects(tables: Sequence[CorrectionTable], vehicle: VehicleConfig | None) -> None:
    """Check that tables belong to the vehicle.

    Raises:
        ConfigError: there is no such wheel, two tables are of one wheel, or its radius, mounting or sensor differs.
    """
    wheels = {wheel.position: wheel for wheel in vehicle.wheel} if vehicle is not None else {}
    positions: set[str] = set()
    for table in tables:
        name = table.position
        if vehicle is None or name not in wheels:
            configured = f"the configuration has {', '.join(wheels)}" if wheels else "there is no configuration"
            raise ConfigError(
                f"the effects belong to wheel {name}, but {configured}",
                "Give the configuration of the diagnosis with --config.",
            )
        if name in positions:
            raise ConfigError(f"two effects files belong to wheel {name}", "Give one file per wheel.")
        positions.add(name)
        for difference in _differences(table, vehicle):
            if difference.code in _REFUSED:
                raise ConfigError(
                    f"the effects of wheel {name} {_REFUSED[difference.code](difference)}",
                    "Run `treadlink diagnose --save-effects` again with this configuration.",
                )


def _differences(table: CorrectionTable, vehicle: VehicleConfig) -> tuple[Reason, ...]:
    """Return what the configuration states of a table's wheel otherwise than the recordings of its diagnosis."""
    wheel = next(wheel for wheel in vehicle.wheel if wheel.position == table.position)
    tire = vehicle.tire_of(wheel)
    radius_m, offset_m = tire.radius_m, wheel.mounting.offset_m
    return table.differences(
        CorrectedSignal(
            sensor_id=wheel.sensor_number,
            vehicle=vehicle.vehicle.name,
            tire=tire.size or "",
            radii_m=() if radius_m is None else (radius_m,),
            offsets_m=() if offset_m is None else (offset_m,),
        )
    )


def with_effects(setups: Iterable[WheelSetup], tables: Sequence[CorrectionTable]) -> tuple[WheelSetup, ...]:
    """Return the wheels, each with the table of its effects where there is one."""
    by_position = {table.position: table for table in tables}
    return tuple(replace(setup, correction=by_position.get(setup.position)) for setup in setups)


def effects_doubts(tables: Sequence[CorrectionTable], vehicle: VehicleConfig | None) -> list[Notice]:
    """Return a notice for all that differs from the recordings of the diagnosis without being a reason to refuse."""
    return [
        Notice(table.position, difference, Level.WARNING)
        for table in tables
        for difference in (_differences(table, vehicle) if vehicle is not None else ())
    ]


def effects_notices(tables: Sequence[CorrectionTable], vehicle: VehicleConfig | None) -> list[Notice]:
    """Return notices on each wheel with known effects: which are subtracted, under which conditions, and doubts."""
    subtracted = [
        Notice(
            table.position,
            Reason(
                SessionCode.EFFECTS_SUBTRACTED,
                effects=tuple(effect.name for effect in table.effects),
                ranges=tuple(_ranges(table)),
            ),
        )
        for table in tables
    ]
    return [*subtracted, *effects_doubts(tables, vehicle)]


def _ranges(table: CorrectionTable) -> Iterator[Reason]:
    low, high = (omega_radps * table.radius_m for omega_radps in table.omega_range_radps)
    yield Reason(SessionCode.VALUE_RANGE, quantity="speed_mps", low=low, high=high)
    if table.load_range_n is not None:
        low, high = table.load_range_n
        yield Reason(SessionCode.VALUE_RANGE, quantity="load_n", low=low, high=high)
    if table.pressure_range_pa is not None:
        low, high = table.pressure_range_pa
        yield Reason(SessionCode.VALUE_RANGE, quantity="pressure_pa", low=low, high=high)


def _mm(length_m: Value) -> str:
    assert isinstance(length_m, float)
    return f"{length_m * 1e3:g}"
