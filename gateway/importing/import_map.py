"""Import map: the meaning of the columns of a measurement file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, Final, Literal

from pydantic import AwareDatetime, BeforeValidator, Field

from firmware_protocol.messages import Axis, Coupling
from gateway.config.validation import Fault, Section, nearest, parse_document, read_text, show
from gateway.config.vehicle import (
    ASSUMED_RADIUS_MM,
    ASSUMED_RADIUS_STD_MM,
    POSITION_PATTERN,
    Tire,
    Vehicle,
    VehicleConfig,
    Wheel,
)
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
    """Supported file formats."""

    CSV = "csv"
    HDF5 = "hdf5"
    MAT = "mat"
    MF4 = "mf4"
    PARQUET = "parquet"


SUFFIXES: Final[dict[str, FileFormat]] = {
    ".csv": FileFormat.CSV,
    ".txt": FileFormat.CSV,
    ".tsv": FileFormat.CSV,
    ".dat": FileFormat.CSV,
    ".h5": FileFormat.HDF5,
    ".hdf5": FileFormat.HDF5,
    ".mat": FileFormat.MAT,
    ".mdf": FileFormat.MF4,
    ".mf4": FileFormat.MF4,
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
    """`[file]`: layout of the file; all keys but `format` concern CSV only."""

    format: Annotated[FileFormat | None, BeforeValidator(_file_format)] = Field(
        default=None, description="file format; default: by the file's suffix"
    )
    delimiter: Annotated[str, _one_of(DELIMITERS)] = Field(default="comma", description="separator of the columns")
    decimal: Literal[".", ","] = Field(default=".", description="decimal separator")
    encoding: str = Field(default="utf-8", description="character encoding, such as utf-8 or latin-1")
    skip_rows: int = Field(default=0, ge=0, le=100_000, description="number of lines to skip before the header")
    header: bool = Field(default=True, description="whether a line names the columns; otherwise they are 1, 2, 3, ...")
    skip_rows_after_header: int = Field(
        default=0, ge=0, le=1000, description="number of lines to skip after the header, such as a line of units"
    )


class Sampling(Section):
    """`[sampling]`: sampling rate or time column, and start of the measurement."""

    rate_hz: float | None = Field(default=None, gt=0, le=1e7, description="sampling rate in Hz")
    time_column: str | None = Field(default=None, description="name of the time column, instead of rate_hz")
    time_unit: Annotated[str, _one_of(TIME_UNITS_S)] = Field(default="s", description="unit of the time column")
    start_s: float = Field(
        default=0.0, ge=0, le=1e7, description="time after the first row in s; earlier rows are left out"
    )
    start_utc: AwareDatetime | None = Field(
        default=None,
        description="start of the measurement: date and time with time zone, such as 2014-05-01T12:00:00Z; default: "
        "the modification time of the file",
    )


class AxisColumn(Section):
    """`[axis.radial]`, `[axis.lateral]`, `[axis.circumferential]`: column and scale of one axis."""

    column: str = Field(description="name of the column")
    unit: Annotated[str, _one_of(ACCELERATION_UNITS_MPS2)] = Field(description="unit of the column")
    sign: int = Field(default=1, description="1, or -1 if the column points against the protocol's direction")
    offset: float = Field(default=0.0, description="value of the column at zero acceleration, in its unit")
    full_scale: float | None = Field(
        default=None,
        gt=0,
        le=1e9,
        description="end of the sensor's range in the column's unit; values at or above it are saturated",
    )

    @property
    def factor_mps2(self) -> float:
        """Factor from (value - offset) to m/s^2 in the protocol's direction."""
        return self.sign * ACCELERATION_UNITS_MPS2[self.unit]

    @property
    def full_scale_mps2(self) -> float | None:
        """End of the sensor's range in m/s^2, None when not stated."""
        return None if self.full_scale is None else self.full_scale * ACCELERATION_UNITS_MPS2[self.unit]


class Axes(Section):
    """`[axis]`: the axes in the file; radial is positive toward the wheel centre."""

    circumferential: AxisColumn | None = Field(default=None, description="column of the circumferential axis")
    lateral: AxisColumn | None = Field(default=None, description="column of the lateral axis")
    radial: AxisColumn | None = Field(default=None, description="column of the radial axis, required")

    def present(self) -> dict[Axis, AxisColumn]:
        """Return the axes in the order of the protocol's channels."""
        named = {Axis.CIRCUMFERENTIAL: self.circumferential, Axis.LATERAL: self.lateral, Axis.RADIAL: self.radial}
        return {axis: column for axis, column in named.items() if column is not None}


class Sensor(Section):
    """`[sensor]`: the sensor of the measurement."""

    coupling: Literal["AC", "DC"] = Field(description="DC if the sensor passes the steady value, AC if not")
    highpass_hz: float = Field(
        default=0.0, ge=0, le=1000, description="corner frequency of the high-pass of an AC-coupled sensor in Hz"
    )
    sensor_id: str | None = Field(
        default=None, pattern=r"^[0-9a-fA-F]{1,8}$", description="serial number: 1 to 8 hexadecimal digits"
    )

    @property
    def protocol_coupling(self) -> Coupling:
        """Coupling in the protocol's terms."""
        return Coupling.AC if self.coupling == "AC" else Coupling.DC


class EnvironmentColumns(Section):
    """`[environment]`: columns of pressure and temperature."""

    pressure_column: str | None = Field(default=None, description="name of the column of the gauge pressure")
    pressure_unit: Annotated[str, _one_of(PRESSURE_UNITS_PA)] = Field(
        default="kPa", description="unit of the pressure column"
    )
    temperature_column: str | None = Field(
        default=None, description="name of the column of the inner liner's temperature in degrees Celsius"
    )


class StatedConditions(Section):
    """`[conditions]`: stated conditions of the test; a condition that is not stated stays unknown."""

    name: str = Field(default="", description="name of the vehicle or test rig")
    position: str = Field(
        default="W1",
        pattern=POSITION_PATTERN,
        description="name of the wheel: 1 to 24 letters, digits, '_', '.' or '-'",
    )
    tire: str | None = Field(default=None, description="tire size; for information only")
    radius_mm: float | None = Field(
        default=None,
        ge=100,
        le=1200,
        description=f"belt radius in mm: rolling circumference / (2 pi); {ASSUMED_RADIUS_MM:g} is assumed by default",
    )
    load_n: float | None = Field(default=None, ge=50, le=100_000, description="vertical load in N")
    load_std_n: float | None = Field(default=None, ge=0, le=50_000, description="standard error of load_n in N")
    pressure_kpa: float | None = Field(default=None, ge=10, le=1500, description="gauge pressure in kPa")
    pressure_std_kpa: float | None = Field(
        default=None, ge=0, le=500, description="standard error of pressure_kpa in kPa"
    )
    temperature_degc: float | None = Field(
        default=None, ge=-60, le=250, description="temperature of the inner liner in degrees Celsius"
    )
    ring_thickness_mm: float | None = Field(
        default=None, ge=1, le=80, description="thickness of belt and tread of the new tire in mm"
    )


class ImportMap(Section):
    """The import map of one measurement file, or of several with the same layout."""

    assumed: tuple[str, ...] = Field(
        default=(), strict=False, description="assumptions of this map, one text each; shown as notices"
    )
    file: FileLayout = Field(default=FileLayout(), description="layout of the file")
    sampling: Sampling = Field(description="sampling rate or time column, and start of the measurement")
    axis: Axes = Field(description="columns of the acceleration")
    sensor: Sensor = Field(description="the sensor of the measurement")
    environment: EnvironmentColumns = Field(
        default=EnvironmentColumns(), description="columns of pressure and temperature"
    )
    conditions: StatedConditions = Field(default=StatedConditions(), description="stated conditions of the test")

    def columns(self) -> tuple[str, ...]:
        """Return the columns named in the map, each once."""
        named = [column.column for column in self.axis.present().values()]
        others = (self.sampling.time_column, self.environment.pressure_column, self.environment.temperature_column)
        return tuple(dict.fromkeys([*named, *(name for name in others if name is not None)]))

    def assumptions(self) -> tuple[str, ...]:
        """Return the assumptions that the results rest on, as texts for the recording's configuration."""
        if self.conditions.radius_mm is None:
            return (*self.assumed, f"belt radius {ASSUMED_RADIUS_MM:g} mm (not stated in the map)")
        return self.assumed

    def vehicle(self) -> VehicleConfig:
        """Return the vehicle configuration for the recording."""
        stated = self.conditions
        tire = Tire(
            size=stated.tire,
            radius_mm=ASSUMED_RADIUS_MM if stated.radius_mm is None else stated.radius_mm,
            radius_std_mm=ASSUMED_RADIUS_STD_MM if stated.radius_mm is None else None,
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
        ConfigError: with one line for each fault.
    """
    return parse_document(ImportMap, text, origin, _cross_faults)


def _cross_faults(data: Mapping[str, Any]) -> Iterator[Fault]:
    sampling = _table(data, "sampling")
    if "rate_hz" in sampling and "time_column" in sampling:
        yield Fault("sampling", "both rate_hz and time_column", "keep only one")
    elif "rate_hz" not in sampling and "time_column" not in sampling:
        yield Fault("sampling.rate_hz", None, "rate_hz or time_column is required")
    axes = _table(data, "axis")
    if "axis" in data and "radial" not in axes:
        yield Fault("axis.radial", None, "the radial axis is required to find the revolutions")
    columns: dict[str, str] = {}
    for name, axis in axes.items():
        if not isinstance(axis, Mapping):
            continue
        sign, column = axis.get("sign", 1), axis.get("column")
        if isinstance(sign, int) and not isinstance(sign, bool) and sign not in (1, -1):
            yield Fault(f"axis.{name}.sign", show(sign), "allowed: 1 or -1")
        if isinstance(column, str):
            if column in columns:
                yield Fault(f"axis.{name}.column", show(column), f"axis.{columns[column]} has the same column")
            columns.setdefault(column, name)
    sensor = _table(data, "sensor")
    highpass_hz = sensor.get("highpass_hz", 0)
    if sensor.get("coupling") == "DC" and isinstance(highpass_hz, int | float) and highpass_hz > 0:
        yield Fault(
            "sensor.highpass_hz", show(highpass_hz), 'a DC-coupled sensor has no high-pass; is the coupling "AC"?'
        )
    layout = _table(data, "file")
    if layout.get("decimal") == "," and layout.get("delimiter", "comma") == "comma":
        yield Fault(
            "file.delimiter", show(layout.get("delimiter", "comma")), "a decimal comma requires another delimiter"
        )
    conditions = _table(data, "conditions")
    for error, value in (("load_std_n", "load_n"), ("pressure_std_kpa", "pressure_kpa")):
        if error in conditions and value not in conditions:
            yield Fault(f"conditions.{error}", show(conditions[error]), f"it needs {value} too")


def _table(data: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    value = data.get(key)
    return value if isinstance(value, Mapping) else {}
