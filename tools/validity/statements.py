"""Statements about a tire and its sensor: what the configuration and the sensor's own messages say."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from gateway.core.config.toml_writer import toml_text
from gateway.core.config.vehicle import VehicleConfig, parse_vehicle
from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.estimates.tire_data import SOFTENING_PER_K, LoadCalibration
from gateway.core.ring_quantities import RING_NUMBERS
from validity.ranges import STATED, declared
from validity.tires import GAIN_STDS_PERCENT, REFERENCE_DEGC, World

DEFAULT_RADIUS_STD: Final = 0.01
STATED_RADIUS_STD: Final = 0.003
LOAD_STD: Final = 0.01
PRESSURE_STD: Final = 0.005
OFFSET_STD_MM: Final = 0.3
REFERENCE_STD: Final = 0.01
THICKNESS_STD_MM: Final = 0.2


@dataclass(frozen=True, slots=True)
class Statement:
    """What is stated of a world, and how well; in the configuration's units.

    Attributes:
        radius_mm: belt radius.
        radius_std_mm: its standard error; None for the default, 1 %.
        load_n: vertical load.
        load_std_n: its standard error; None for the default.
        pressure_factor: reading of the pressure over the truth.
        pressure_std_kpa: standard error of the reading; None for the default.
        offset_mm: sensor below the neutral layer; None when it is not stated.
        offset_std_mm: its standard error; None for the default.
        gain_std_percent: standard error of the sensor's gains; None for the default, 1.5 %.
        zero_g_std_mps2: standard error of its zero-g offsets; None for the default, 1 m/s^2.
        rate_factor: stated sampling rate over the true one; the stamps follow the stated one, as in an import.
        unit_factor: stated unit of the samples over the true one.
        thickness_mm: of the new ring.
        reference: numbers of the new tire; None for none.
        calibration: load from half angle and pressure; None for none.
        left_out: estimators that do not run.
        axes: channel that each of the three axes is taken from; two are swapped where they are not in order.
        late_s: delay of each axis.
        lost: share of the frames of samples that the link loses, and how many of them in a row.
        edits: of the vehicle file, as (path, way, size); a size `off` or in percent counts from what is stated, and
            from the truth where nothing is.
        told: edits of the hub's messages, as (`message:field`, size, axis).
        spoils: names of what the sensor does to its samples, with sizes.
        wander: relative size and frequency in Hz of slow changes of the sampling rate.
    """

    radius_mm: float
    load_n: float
    load_std_n: float | None
    pressure_std_kpa: float | None
    offset_mm: float | None
    thickness_mm: float
    radius_std_mm: float | None = None
    pressure_factor: float = 1.0
    offset_std_mm: float | None = OFFSET_STD_MM
    gain_std_percent: float | None = None
    zero_g_std_mps2: float | None = None
    rate_factor: float = 1.0
    unit_factor: float = 1.0
    reference: tuple[float, float, float, float] | None = None
    calibration: LoadCalibration | None = None
    left_out: tuple[str, ...] = ()
    axes: tuple[int, int, int] = (0, 1, 2)
    late_s: tuple[float, float, float] = (0.0, 0.0, 0.0)
    lost: tuple[float, int] = (0.0, 1)
    edits: tuple[tuple[str, str, Any], ...] = ()
    told: tuple[tuple[str, Any, int | None], ...] = ()
    spoils: tuple[tuple[str, float], ...] = ()
    wander: tuple[float, float] = (0.0, 1.0)

    def true_time_s(self, time_s: Any) -> Any:
        """Return the true time of a time by the sensor's samples."""
        size, frequency_hz = self.wander
        turning = 2.0 * math.pi * frequency_hz
        return time_s * self.rate_factor + size / turning * np.sin(turning * time_s * self.rate_factor)

    def vehicle(self, world: World) -> VehicleConfig:
        """Return the configuration; what is None is left out."""
        tire: dict[str, Any] = {
            "radius_mm": self.radius_mm,
            "radius_std_mm": self.radius_std_mm,
            "pressure_kpa": 1e-3 * world.pressure_pa * self.pressure_factor,
            "pressure_std_kpa": self.pressure_std_kpa,
            "ring_thickness_mm": self.thickness_mm,
            "ring_thickness_std_mm": THICKNESS_STD_MM,
            "runout_mm": 0.0,
        }
        if self.reference is not None:
            numbers = dict(zip(RING_NUMBERS, self.reference, strict=True))
            stds = {f"{name}_std": REFERENCE_STD * value for name, value in numbers.items()}
            tire["reference"] = {**numbers, **stds, "pressure_kpa": 1e-3 * world.reference_pa}
        if self.calibration is not None:
            tire["load_calibration"] = _calibration_table(self.calibration)
        mounting = {
            "offset_mm": self.offset_mm,
            "offset_std_mm": None if self.offset_mm is None else self.offset_std_mm,
        }
        sensor = {"gain_std_percent": self.gain_std_percent, "zero_g_std_mps2": self.zero_g_std_mps2}
        wheel: dict[str, Any] = {"position": "W", "hub": 0, "wheel": 0, "load_n": self.load_n}
        if self.load_std_n is not None:
            wheel["load_std_n"] = self.load_std_n
        wheel["mounting"] = _stated(mounting)
        wheel["sensor"] = _stated(sensor)
        document = {"tire": _stated(tire), "wheel": wheel}
        for path, way, size in self.edits:
            _edit(document, path, way, size, world)
        tables = {name: [table] if name in ("wheel", "axle") else table for name, table in document.items()}
        return parse_vehicle(toml_text(tables), "bench")


def draw_statement(world: World, rng: np.random.Generator) -> Statement:
    """Return a true statement: every value off by a random error of its stated or assumed standard error."""
    radius_std_mm = float(rng.choice([1.0, 0.0])) * STATED_RADIUS_STD * 1e3 * world.radius_m or None
    radius_mm = 1e3 * world.radius_m
    load_std_n = LOAD_STD * world.load_n
    pressure_std_pa = PRESSURE_STD * world.pressure_pa
    errors = rng.standard_normal(5)
    numbers = np.array(world.numbers) * (1.0 + REFERENCE_STD * rng.standard_normal(4))
    bs, cw, rs, ts = numbers.tolist()
    return Statement(
        radius_mm=radius_mm + float(errors[0]) * (radius_std_mm or DEFAULT_RADIUS_STD * radius_mm),
        radius_std_mm=radius_std_mm,
        load_n=world.load_n + float(errors[1]) * load_std_n,
        load_std_n=load_std_n,
        pressure_factor=1.0 + float(errors[2]) * PRESSURE_STD,
        pressure_std_kpa=1e-3 * pressure_std_pa,
        offset_mm=1e3 * world.offset_m + float(errors[3]) * OFFSET_STD_MM,
        thickness_mm=world.thickness_mm + float(errors[4]) * THICKNESS_STD_MM,
        gain_std_percent=None if world.gain_std_percent == GAIN_STDS_PERCENT[0] else world.gain_std_percent,
        reference=(bs, cw, rs, ts),
    )


def known_exactly(world: World, statement: Statement) -> Statement:
    """Return a statement without errors that says so: what is left are the errors of the data and the models."""
    return replace(
        statement,
        radius_mm=1e3 * world.radius_m,
        radius_std_mm=1e-2,
        load_n=world.load_n,
        load_std_n=1e-4 * world.load_n,
        pressure_factor=1.0,
        pressure_std_kpa=1e-7 * world.pressure_pa,
        offset_mm=1e3 * world.offset_m,
        offset_std_mm=0.02,
        gain_std_percent=0.01,
        zero_g_std_mps2=0.01,
        thickness_mm=world.thickness_mm,
        reference=world.numbers,
    )


def without_errors(statement: Statement) -> Statement:
    """Return a statement that says nothing of its errors, so that the defaults count."""
    return replace(
        statement, radius_std_mm=None, load_std_n=None, pressure_std_kpa=None, gain_std_percent=None, offset_std_mm=None
    )


def moved_to(statement: Statement, before: World, after: World) -> Statement:
    """Return a true statement of another world, with the same errors of load and depth."""
    depth = None if statement.offset_mm is None else statement.offset_mm + 1e3 * (after.offset_m - before.offset_m)
    scale = after.load_n / before.load_n
    load_std_n = None if statement.load_std_n is None else statement.load_std_n * scale
    return replace(statement, load_n=statement.load_n * scale, load_std_n=load_std_n, offset_mm=depth)


class NotApplicableError(Exception):
    """A statement is to be changed that is not made of this tire."""


# What is true of values that are usually not stated.
_TRUE: Final[dict[str, Callable[[World], float]]] = {
    "tire.temperature_degc": lambda world: world.temperature_degc,
    "tire.wear_mm": lambda world: world.wear_mm,
    "tire.reference.temperature_degc": lambda _: REFERENCE_DEGC,
    "tire.reference.softening_percent_per_k": lambda _: 100.0 * SOFTENING_PER_K,
    "tire.load_calibration.temperature_degc": lambda _: REFERENCE_DEGC,
    "axle.weight_kg": lambda world: world.load_n / STANDARD_GRAVITY_MPS2,
    "wheel.mounting.roll_deg": lambda world: world.tilt_deg[0],
    "wheel.mounting.pitch_deg": lambda world: world.tilt_deg[1],
    "wheel.mounting.offset_mm": lambda world: 1e3 * world.offset_m,
    "tire.radius_std_mm": lambda world: 1e3 * DEFAULT_RADIUS_STD * world.radius_m,
    "wheel.sensor.gain_std_percent": lambda world: world.gain_std_percent,
}


def _edit(document: dict[str, Any], path: str, way: str, size: Any, world: World) -> None:
    """Change one value of a vehicle file.

    Raises:
        NotApplicableError: it is not stated, nor has it a default, nor is the truth of it known.
    """
    *names, key = path.split(".")
    if names[0] == "axle":
        document["axle"] = {"wheels": ["W"]}
        document["wheel"] = {name: item for name, item in document["wheel"].items() if not name.startswith("load")}
    table = document
    for name in names:
        if name in ("reference", "load_calibration") and name not in table:
            raise NotApplicableError(path)
        table = table.setdefault(name, {})
    if way in ("is", "choice"):
        table[key] = size
    else:
        before = table.get(key, _TRUE[path](world) if path in _TRUE else dict(declared())[f"{STATED}{path}"].default)
        if not isinstance(before, int | float):
            raise NotApplicableError(path)
        table[key] = before + size if way == "off" else before * (1.0 + 0.01 * size)
    if table[key] is None:
        del table[key]


def _stated(table: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in table.items() if value is not None}


def _calibration_table(calibration: LoadCalibration) -> dict[str, float]:
    low, high = calibration.half_angle_range_rad
    least_pa, most_pa = calibration.pressure_range_pa
    return {
        "load_n": calibration.load_n,
        "half_angle_rad": calibration.half_angle_rad,
        "pressure_kpa": 1e-3 * calibration.pressure_pa,
        "angle_exponent": calibration.angle_exponent,
        "angle_curvature": calibration.angle_curvature,
        "pressure_exponent": calibration.pressure_exponent,
        "relative_std_percent": 100.0 * calibration.relative_std,
        "half_angle_min_rad": low,
        "half_angle_max_rad": high,
        "pressure_min_kpa": 1e-3 * least_pa,
        "pressure_max_kpa": 1e-3 * most_pa,
    }
