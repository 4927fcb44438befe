"""The map that says what the columns of a foreign measurement file mean."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, Final, Literal

from pydantic import AwareDatetime, BeforeValidator, Field

from firmware_protocol.messages import Axis, Coupling
from gateway.config.validation import Fault, Section, nearest, parse_document, read_text, show
from gateway.config.vehicle import ASSUMED_RADIUS_MM, POSITION_PATTERN, Tire, Vehicle, VehicleConfig, Wheel
from gateway.constants import STANDARD_GRAVITY_MPS2

ACCELERATION_UNITS_MPS2: Final[dict[str, float]] = {
    "m/s^2": 1.0,
    "m/s2": 1.0,
    "mps2": 1.0,
    "g": STANDARD_GRAVITY_MPS2,
    "mg": STANDARD_GRAVITY_MPS2 * 1e-3,
}
PRESSURE_UNITS_PA: Final[dict[str, float]] = {"Pa": 1.0, "hPa": 1e2, "kPa": 1e3, "bar": 1e5, "psi": 6894.757293168361}
TIME_UNITS_S: Final[dict[str, float]] = {"s": 1.0, "ms": 1e-3, "us": 1e-6}
DELIMITERS: Final[dict[str, str]] = {"comma": ",", "semicolon": ";", "tab": "\t", "space": " ", "pipe": "|"}


class FileFormat(StrEnum):
    """Formats that can be read."""

    CSV = "csv"
    MAT = "mat"
    PARQUET = "parquet"


SUFFIXES: Final[dict[str, FileFormat]] = {
    ".csv": FileFormat.CSV,
    ".txt": FileFormat.CSV,
    ".tsv": FileFormat.CSV,
    ".dat": FileFormat.CSV,
    ".mat": FileFormat.MAT,
    ".parquet": FileFormat.PARQUET,
    ".pq": FileFormat.PARQUET,
}


def _one_of(names: Mapping[str, object]) -> Any:
    def check(value: object) -> object:
        if isinstance(value, str) and value not in names:
            guess = nearest(value, names)
            raise ValueError(f"one of {', '.join(names)}" + (f"; did you mean {guess}?" if guess else ""))
        return value

    return BeforeValidator(check)


def _file_format(value: object) -> object:
    return FileFormat(value) if isinstance(value, str) and value in list(FileFormat) else value


class FileLayout(Section):
    """`[file]`: how the file is laid out; the text keys concern CSV only."""

    format: Annotated[FileFormat | None, BeforeValidator(_file_format)] = Field(
        default=None, description='"csv", "mat" or "parquet"'
    )
    delimiter: Annotated[str, _one_of(DELIMITERS)] = "comma"
    decimal: Literal[".", ","] = Field(default=".", description='"." or ","')
    encoding: str = "utf-8"
    skip_rows: int = Field(default=0, ge=0, le=100_000)
    header: bool = True
    skip_rows_after_header: int = Field(default=0, ge=0, le=1000)


class Sampling(Section):
    """`[sampling]`: the rate, or the column that tells the time; how much to leave out; when it began."""

    rate_hz: float | None = Field(default=None, gt=0, le=1e7)
    time_column: str | None = None
    time_unit: Annotated[str, _one_of(TIME_UNITS_S)] = "s"
    start_s: float = Field(default=0.0, ge=0, le=1e7)
    start_utc: AwareDatetime | None = Field(
        default=None, description="a date and time with zone, as 2014-05-01T12:00:00Z"
    )


class AxisColumn(Section):
    """`[axis.radial]` and its like: the column of one axis and how to read it."""

    column: str
    unit: Annotated[str, _one_of(ACCELERATION_UNITS_MPS2)]
    sign: int = Field(default=1, description="1, or -1 where the column points against the protocol's direction")
    offset: float = 0.0
    full_scale: float | None = Field(default=None, gt=0, le=1e9)

    @property
    def factor_mps2(self) -> float:
        """What (value - offset) is multiplied by to give m/s^2 in the protocol's direction."""
        return self.sign * ACCELERATION_UNITS_MPS2[self.unit]

    @property
    def full_scale_mps2(self) -> float | None:
        """End of the sensor's range in m/s^2, None when not stated."""
        return None if self.full_scale is None else self.full_scale * ACCELERATION_UNITS_MPS2[self.unit]


class Axes(Section):
    """`[axis]`: the axes that the file has; radial is positive toward the wheel centre."""

    circumferential: AxisColumn | None = None
    lateral: AxisColumn | None = None
    radial: AxisColumn | None = None

    def present(self) -> dict[Axis, AxisColumn]:
        """Return the axes in the order of the protocol's channels."""
        named = {Axis.CIRCUMFERENTIAL: self.circumferential, Axis.LATERAL: self.lateral, Axis.RADIAL: self.radial}
        return {axis: column for axis, column in named.items() if column is not None}


class Sensor(Section):
    """`[sensor]`: what made the measurement."""

    coupling: Literal["AC", "DC"] = Field(description='"AC" or "DC": whether the steady value is kept out or passed')
    highpass_hz: float = Field(default=0.0, ge=0, le=1000)
    sensor_id: str | None = Field(default=None, pattern=r"^[0-9a-fA-F]{1,8}$", description="1 to 8 hexadecimal digits")

    @property
    def protocol_coupling(self) -> Coupling:
        """Coupling as the protocol names it."""
        return Coupling.AC if self.coupling == "AC" else Coupling.DC


class Measured(Section):
    """`[environment]`: columns that were measured beside the acceleration."""

    pressure_column: str | None = None
    pressure_unit: Annotated[str, _one_of(PRESSURE_UNITS_PA)] = "kPa"
    temperature_column: str | None = None


class Conditions(Section):
    """`[conditions]`: what was stated about the test; what is left out stays unknown."""

    name: str = ""
    position: str = Field(
        default="W1", pattern=POSITION_PATTERN, description="1 to 24 letters, digits, '_', '.' or '-'"
    )
    tire: str | None = None
    radius_mm: float | None = Field(default=None, ge=100, le=1200)
    load_n: float | None = Field(default=None, ge=50, le=100_000)
    load_std_n: float | None = Field(default=None, ge=0, le=50_000)
    pressure_kpa: float | None = Field(default=None, ge=10, le=1500, description="gauge pressure")
    pressure_std_kpa: float | None = Field(default=None, ge=0, le=500)
    temperature_degc: float | None = Field(default=None, ge=-60, le=250)
    ring_thickness_mm: float | None = Field(default=None, ge=1, le=80)


class ImportMap(Section):
    """The whole map; `assumed` lists in plain words what nobody stated."""

    assumed: tuple[str, ...] = Field(default=(), strict=False)
    file: FileLayout = FileLayout()
    sampling: Sampling
    axis: Axes
    sensor: Sensor
    environment: Measured = Measured()
    conditions: Conditions = Conditions()

    def columns(self) -> tuple[str, ...]:
        """Return every column that the map names, each once."""
        named = [column.column for column in self.axis.present().values()]
        others = (self.sampling.time_column, self.environment.pressure_column, self.environment.temperature_column)
        return tuple(dict.fromkeys([*named, *(name for name in others if name is not None)]))

    def assumptions(self) -> tuple[str, ...]:
        """Return what results rest on though nobody measured it."""
        if self.conditions.radius_mm is None:
            return (*self.assumed, f"belt radius {ASSUMED_RADIUS_MM:g} mm (the map states none)")
        return self.assumed

    def vehicle(self) -> VehicleConfig:
        """Return the configuration that goes into the recording."""
        stated = self.conditions
        tire = Tire(
            size=stated.tire,
            radius_mm=ASSUMED_RADIUS_MM if stated.radius_mm is None else stated.radius_mm,
            pressure_kpa=stated.pressure_kpa,
            pressure_std_kpa=stated.pressure_std_kpa,
            temperature_degc=stated.temperature_degc,
            ring_thickness_mm=stated.ring_thickness_mm,
        )
        wheel = Wheel(
            position=stated.position,
            hub=0,
            wheel=0,
            sensor_id=self.sensor.sensor_id,
            load_n=stated.load_n,
            load_std_n=stated.load_std_n,
        )
        return VehicleConfig(vehicle=Vehicle(name=stated.name, assumed=self.assumptions()), tire=tire, wheel=(wheel,))


def load_map(path: Path) -> ImportMap:
    """Return the map in a file.

    Raises:
        ConfigError: the file cannot be read, or the map has faults; the message lists all of them.
    """
    return parse_map(read_text(path, "the import map"), str(path))


def parse_map(text: str, origin: str) -> ImportMap:
    """Return the map in a TOML text; `origin` names it in messages.

    Raises:
        ConfigError: naming every fault.
    """
    return parse_document(ImportMap, text, origin, _cross_faults)


def _cross_faults(data: Mapping[str, Any]) -> Iterator[Fault]:
    sampling = _table(data, "sampling")
    if ("rate_hz" in sampling) == ("time_column" in sampling):
        found = "rate_hz and time_column" if "rate_hz" in sampling else "neither rate_hz nor time_column"
        yield Fault("sampling", found, "allowed: one of the two")
    axes = _table(data, "axis")
    if "axis" in data and "radial" not in axes:
        yield Fault("axis.radial", "nothing", "the radial axis is required: revolutions are found in it")
    columns: dict[str, str] = {}
    for name, axis in axes.items():
        if not isinstance(axis, Mapping):
            continue
        sign, column = axis.get("sign", 1), axis.get("column")
        if isinstance(sign, int) and not isinstance(sign, bool) and sign not in (1, -1):
            yield Fault(f"axis.{name}.sign", show(sign), "allowed: 1 or -1")
        if isinstance(column, str):
            if column in columns:
                yield Fault(f"axis.{name}.column", show(column), f"axis.{columns[column]} has this column already")
            columns.setdefault(column, name)
    sensor = _table(data, "sensor")
    highpass_hz = sensor.get("highpass_hz", 0)
    if sensor.get("coupling") == "DC" and isinstance(highpass_hz, int | float) and highpass_hz > 0:
        yield Fault("sensor.highpass_hz", show(highpass_hz), 'a DC-coupled sensor has none; is the coupling "AC"?')
    layout = _table(data, "file")
    if layout.get("decimal") == "," and layout.get("delimiter", "comma") == "comma":
        yield Fault("file.delimiter", show(layout.get("delimiter", "comma")), "a decimal comma needs another delimiter")
    conditions = _table(data, "conditions")
    for error, value in (("load_std_n", "load_n"), ("pressure_std_kpa", "pressure_kpa")):
        if error in conditions and value not in conditions:
            yield Fault(f"conditions.{error}", show(conditions[error]), f"it needs {value} beside it")


def _table(data: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    value = data.get(key)
    return value if isinstance(value, Mapping) else {}
