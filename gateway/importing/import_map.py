"""Import map: the meaning of the columns of a measurement file."""

import math
import re
import zoneinfo
from collections.abc import Callable, Iterator, Mapping
from datetime import timedelta, timezone, tzinfo
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, Final, Literal

from pydantic import AwareDatetime, BeforeValidator, Field, ValidationError

from firmware_protocol.messages import Axis, Coupling
from gateway.core.config.validation import (
    Fault,
    Section,
    above,
    as_table,
    as_tables,
    parse_document,
    read_text,
    show,
    within,
)
from gateway.core.config.vehicle import (
    ASSUMED_RADIUS_MM,
    ASSUMED_RADIUS_STD_MM,
    CLOCK_STD_PERCENT,
    POSITION_PATTERN,
    STATED_RATE_STD_PERCENT,
    Mounting,
    Tire,
    Vehicle,
    VehicleConfig,
    Wheel,
)
from gateway.core.config.vehicle import Sensor as Accuracy
from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.errors import ConfigError
from gateway.core.nearest_name import nearest

ACCELERATION_UNITS_MPS2: Final[dict[str, float]] = {
    "m/s^2": 1.0,
    "m/s2": 1.0,
    "mps2": 1.0,
    "g": STANDARD_GRAVITY_MPS2,
    "mg": STANDARD_GRAVITY_MPS2 * 1e-3,
}
PRESSURE_UNITS_PA: Final[dict[str, float]] = {"Pa": 1.0, "hPa": 1e2, "kPa": 1e3, "bar": 1e5, "psi": 6894.757293168361}
TEMPERATURE_UNITS: Final = {"degC": 1.0, "C": 1.0}
ISO: Final = "iso"
TIME_UNITS_S: Final = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "d": 86400.0, ISO: 1.0}
REFERENCE_UNITS: Final[dict[str, dict[str, float]]] = {
    "speed": {"m/s": 1.0, "km/h": 1.0 / 3.6, "mph": 0.44704},
    "rotation": {"Hz": 1.0, "rpm": 1.0 / 60.0, "rad/s": 0.5 / math.pi, "deg/s": 1.0 / 360.0},
    "angle": {"turns": 1.0, "deg": 1.0 / 360.0, "rad": 0.5 / math.pi},
    "pulses": {},
    "load": {"N": 1.0, "kN": 1e3},
    "side_force": {"N": 1.0, "kN": 1e3},
    "slip_angle": {"deg": math.pi / 180.0, "rad": 1.0},
    "camber": {"deg": math.pi / 180.0, "rad": 1.0},
    "torque": {"N*m": 1.0, "Nm": 1.0, "kN*m": 1e3, "kNm": 1e3},
}
"""Units of each quantity of a reference: m/s, turns per second, turns, N, rad and N*m. A pulse has none."""
DELIMITERS: Final[dict[str, str]] = {"comma": ",", "semicolon": ";", "tab": "\t", "space": " ", "pipe": "|"}


class FileFormat(StrEnum):
    """Supported file formats."""

    CSV = "csv"
    FAMOS = "famos"
    HDF5 = "hdf5"
    IDE = "ide"
    IMU = "imu"
    MAT = "mat"
    MF4 = "mf4"
    NPZ = "npz"
    PARQUET = "parquet"
    TDMS = "tdms"
    TYDEX = "tydex"
    UFF = "uff"
    VBO = "vbo"
    WAV = "wav"
    XLSX = "xlsx"


SUFFIXES: Final[dict[str, FileFormat]] = {
    ".csv": FileFormat.CSV,
    ".txt": FileFormat.CSV,
    ".tsv": FileFormat.CSV,
    ".dat": FileFormat.CSV,
    ".lvm": FileFormat.CSV,
    ".raw": FileFormat.FAMOS,
    ".h5": FileFormat.HDF5,
    ".hdf5": FileFormat.HDF5,
    ".nc4": FileFormat.HDF5,
    ".ide": FileFormat.IDE,
    ".mat": FileFormat.MAT,
    ".mdf": FileFormat.MF4,
    ".mf4": FileFormat.MF4,
    ".npz": FileFormat.NPZ,
    ".npy": FileFormat.NPZ,
    ".parquet": FileFormat.PARQUET,
    ".pq": FileFormat.PARQUET,
    ".tdms": FileFormat.TDMS,
    ".tdx": FileFormat.TYDEX,
    ".uff": FileFormat.UFF,
    ".unv": FileFormat.UFF,
    ".vbo": FileFormat.VBO,
    ".wav": FileFormat.WAV,
    ".xlsm": FileFormat.XLSX,
    ".xlsx": FileFormat.XLSX,
}


def _choice_of(names: Mapping[str, object]) -> Any:
    def check(value: object) -> object:
        if isinstance(value, str) and value not in names:
            guess = nearest(value, names)
            raise ValueError(f"one of {', '.join(names)}" + (f"; did you mean {guess}?" if guess else ""))
        return value

    return BeforeValidator(check)


def _file_format(value: object) -> object:
    return FileFormat(value) if isinstance(value, str) and value in list(FileFormat) else value


# Of a session.
_MAX_WHEELS: Final = 64
# Standard errors, and what each is the error of.
_ERRORS: Final = (("load_std_n", "load_n"), ("pressure_std_kpa", "pressure_kpa"))
_OFFSET: Final = re.compile(r"([+-])(\d\d):?([0-5]\d)")


def zone_of(name: str) -> tzinfo:
    """Return a time zone by its IANA name or its offset, such as `+02:00`.

    Raises:
        ValueError: there is no such zone.
    """
    if match := _OFFSET.fullmatch(name):
        offset = timedelta(hours=int(match[2]), minutes=int(match[3]))
        return timezone(offset if match[1] == "+" else -offset)
    try:
        return zoneinfo.ZoneInfo(name)
    except (zoneinfo.ZoneInfoNotFoundError, ValueError, OSError) as error:
        raise ValueError(f"there is no time zone '{name}'") from error


def _time_zone(value: object) -> object:
    if isinstance(value, str):
        try:
            zone_of(value)
        except ValueError as error:
            guess = nearest(value, sorted(zoneinfo.available_timezones()))
            allowed = 'an IANA name such as "Europe/Berlin", "UTC", or an offset such as "+02:00"'
            raise ValueError(allowed + (f"; did you mean {guess}?" if guess else "")) from error
    return value


class FileLayout(Section):
    """`[file]`: layout of the file; all keys but `format` concern CSV only."""

    format: Annotated[FileFormat | None, BeforeValidator(_file_format)] = Field(
        default=None, description="file format; default: by its first bytes, or else its suffix"
    )
    delimiter: Annotated[str, _choice_of(DELIMITERS)] = Field(default="comma", description="separator of the columns")
    decimal: Literal[".", ","] = Field(default=".", description="decimal separator")
    encoding: str = Field(default="utf-8", description="character encoding, such as utf-8 or latin-1")
    skip_rows: int = within(0, 0, 100_000, "number of lines to skip before the header")
    unreadable: Literal["error", "missing"] = Field(
        default="error", description="what a cell that is no number is: an error, or a missing value (a gap)"
    )
    sensor_column: str | None = Field(
        default=None, description="column that states the sensor of each row; `sensor` of a wheel is its text there"
    )
    header: bool = Field(default=True, description="whether a line names the columns; otherwise they are 1, 2, 3, ...")
    skip_rows_after_header: int = within(
        0, 0, 1000, "number of lines to skip after the header, such as a line of units"
    )


class Sampling(Section):
    """`[sampling]`: sampling rate or time column, and start of the measurement."""

    rate_hz: float | None = above(None, 0, 1e7, "sampling rate in Hz")
    rate_std_percent: float | None = within(
        None,
        0,
        50,
        f"standard error of the rate in percent; default: {STATED_RATE_STD_PERCENT:g} of a stated rate, "
        f"{CLOCK_STD_PERCENT:g} of a time column",
    )
    time_column: str | None = Field(default=None, description="name of the time column, instead of rate_hz")
    time_unit: Annotated[str, _choice_of(TIME_UNITS_S)] = Field(
        default="s",
        description="unit of the time column; d for the day numbers of Excel and MATLAB, iso for dates with times "
        "(ISO 8601) or times of day",
    )
    time_zone: Annotated[str | None, BeforeValidator(_time_zone)] = Field(
        default=None,
        description="time zone of ISO times that state none: an IANA name such as Europe/Berlin, UTC, or an offset "
        "such as +02:00",
    )
    date_order: Literal["ymd", "dmy", "mdy"] = Field(
        default="ymd", description="order of year, month and day in the dates of a text file, such as dmy in 31.12.2024"
    )
    start_s: float = within(0.0, 0, 1e7, "time after the first row in s; earlier rows are left out")
    start_utc: AwareDatetime | None = Field(
        default=None,
        description="start of the measurement: date and time with time zone, such as 2014-05-01T12:00:00Z; default: "
        "as the file states it, or else its modification time",
    )

    def accuracy(self, rounding_std: float) -> Accuracy:
        """Return the error of the rate; that of a time column includes a relative one by the rounding of its times."""
        percent = self.rate_std_percent
        if percent is None:
            by_times = math.hypot(CLOCK_STD_PERCENT, 100.0 * rounding_std)
            percent = by_times if self.rate_hz is None else STATED_RATE_STD_PERCENT
        return Accuracy(rate_std_percent=percent)


class AxisColumn(Section):
    """`[axis.radial]`, `[axis.lateral]`, `[axis.circumferential]`: column and scale of one axis."""

    column: str = Field(description="name of the column")
    unit: Annotated[str, _choice_of(ACCELERATION_UNITS_MPS2)] = Field(description="unit of the column")
    scale: float = within(
        1.0, 1e-9, 1e9, "size of 1 in the column in that unit, where it holds counts or volts: 100 for V of 10 mV/g"
    )
    sign: int = Field(default=1, description="1, or -1 if the column points against the protocol's direction")
    offset: float = Field(default=0.0, description="value of the column at zero acceleration")
    full_scale: float | None = above(
        None, 0, 1e9, "end of the sensor's range above `offset`, as the column shows it; values there are saturated"
    )

    @property
    def factor_mps2(self) -> float:
        """Factor from (value - offset) to m/s^2 in the protocol's direction."""
        return self.sign * self._size_mps2

    @property
    def full_scale_mps2(self) -> float | None:
        """End of the sensor's range in m/s^2, None when not stated."""
        return None if self.full_scale is None else self.full_scale * self._size_mps2

    @property
    def _size_mps2(self) -> float:
        """Size of 1 in the column in m/s^2."""
        return self.scale * ACCELERATION_UNITS_MPS2[self.unit]


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
    highpass_hz: float = within(0.0, 0, 1000, "corner frequency of the high-pass of an AC-coupled sensor in Hz")
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
    pressure_unit: Annotated[str, _choice_of(PRESSURE_UNITS_PA)] = Field(
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
    radius_mm: float | None = within(
        None,
        100,
        1200,
        f"belt radius in mm: rolling circumference / (2 pi); {ASSUMED_RADIUS_MM:g} is assumed by default",
    )
    load_n: float | None = within(None, 50, 100_000, "vertical load in N")
    load_std_n: float | None = within(None, 0, 50_000, "standard error of load_n in N")
    pressure_kpa: float | None = within(None, 10, 1500, "gauge pressure in kPa")
    pressure_std_kpa: float | None = within(None, 0, 500, "standard error of pressure_kpa in kPa")
    temperature_degc: float | None = within(None, -60, 250, "temperature of the inner liner in degrees Celsius")
    ring_thickness_mm: float | None = within(None, 1, 80, "thickness of belt and tread of the new tire in mm")


class ImportedWheel(Section):
    """`[[wheel]]`: one of several wheels in the file; it replaces `[axis]`, `[environment]`, `[mounting]`, position."""

    position: str = Field(
        pattern=POSITION_PATTERN,
        description="name of the wheel: 1 to 24 letters, digits, '_', '.' or '-'",
    )
    sensor_id: str | None = Field(
        default=None, pattern=r"^[0-9a-fA-F]{1,8}$", description="serial number: 1 to 8 hexadecimal digits"
    )
    sensor: str | None = Field(default=None, description="text of [file] sensor_column in the rows of this wheel")
    load_n: float | None = within(None, 50, 100_000, "vertical load in N")
    load_std_n: float | None = within(None, 0, 50_000, "standard error of load_n in N")
    radius_mm: float | None = within(None, 100, 1200, "belt radius in mm, if it differs from that of [conditions]")
    radius_std_mm: float | None = within(None, 0, 200, "standard error of radius_mm in mm")
    pressure_kpa: float | None = within(
        None, 10, 1500, "gauge pressure in kPa, if it differs from that of [conditions]"
    )
    pressure_std_kpa: float | None = within(None, 0, 500, "standard error of pressure_kpa in kPa")
    axis: Axes = Field(description="columns of the acceleration")
    environment: EnvironmentColumns = Field(
        default=EnvironmentColumns(), description="columns of pressure and temperature"
    )
    mounting: Mounting = Field(default=Mounting(), description="mounting of the sensor, as in the vehicle file")

    @property
    def radial(self) -> AxisColumn:
        """Column of the radial axis, which every map has."""
        assert self.axis.radial is not None
        return self.axis.radial

    def slow_columns(self) -> tuple[str | None, str | None]:
        """Return the columns of pressure and temperature."""
        return self.environment.pressure_column, self.environment.temperature_column


class ReferenceColumn(Section):
    """`[[reference]]`: a measured speed, rotation or angle, kept in the recording and compared with the estimates."""

    name: str = Field(
        pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,39}$",
        description="name of the reference: 1 to 40 letters, digits, '_', '.' or '-'",
    )
    column: str = Field(description="name of the column")
    quantity: Annotated[str, _choice_of(REFERENCE_UNITS)] = Field(
        description="speed, rotation (a rate), angle (of an encoder), pulses (of a tachometer), or a channel of the "
        "rig, which may vary: load, side_force, slip_angle, camber, torque"
    )
    unit: str | None = Field(default=None, description="unit of the column; pulses have none")
    std: float = within(0.0, 0, 1e6, "standard error of the column, in its unit")
    pulses_per_turn: float = above(1.0, 0, 100_000, "number of pulses in one turn of the wheel")
    threshold: float | None = Field(
        default=None, description="level that a pulse crosses upward; default: midway between lowest and highest"
    )
    wheels: tuple[str, ...] = Field(
        default=(), strict=False, description="positions of the wheels that it belongs to; default: all"
    )

    @property
    def factor(self) -> float:
        """Factor from the column's unit to m/s, turns per second, turns, N, rad or N*m; for pulses, turns per pulse."""
        if self.quantity == "pulses":
            return 1.0 / self.pulses_per_turn
        return REFERENCE_UNITS[self.quantity][self.unit or ""]


class ImportMap(Section):
    """The import map of one measurement file, or of several with the same layout."""

    assumed: tuple[str, ...] = Field(
        default=(), strict=False, description="assumptions of this map, one text each; shown as notices"
    )
    file: FileLayout = Field(default=FileLayout(), description="layout of the file")
    sampling: Sampling = Field(description="sampling rate or time column, and start of the measurement")
    axis: Axes = Field(default=Axes(), description="columns of the acceleration of a single wheel")
    sensor: Sensor = Field(description="the sensor of the measurement")
    environment: EnvironmentColumns = Field(
        default=EnvironmentColumns(), description="columns of pressure and temperature of a single wheel"
    )
    mounting: Mounting = Field(
        default=Mounting(), description="mounting of the sensor of a single wheel, as in the vehicle file"
    )
    conditions: StatedConditions = Field(default=StatedConditions(), description="stated conditions of the test")
    wheel: tuple[ImportedWheel, ...] = Field(default=(), strict=False, description="the wheels, if there are several")
    reference: tuple[ReferenceColumn, ...] = Field(
        default=(), strict=False, description="measured speeds, rotations and angles to compare with"
    )

    def wheels(self) -> tuple[ImportedWheel, ...]:
        """Return the wheels in the file, also a single one."""
        if self.wheel:
            return self.wheel
        conditions = self.conditions
        return (
            ImportedWheel(
                position=conditions.position,
                sensor_id=self.sensor.sensor_id,
                load_n=conditions.load_n,
                load_std_n=conditions.load_std_n,
                axis=self.axis,
                environment=self.environment,
                mounting=self.mounting,
            ),
        )

    def axis_columns(self) -> tuple[AxisColumn, ...]:
        """Return the columns of all axes of all wheels, in the order of the protocol's channels."""
        return tuple(column for wheel in self.wheels() for column in wheel.axis.present().values())

    def columns(self) -> tuple[str, ...]:
        """Return the columns named in the map, each once; those of the axes come first, then that of the time."""
        slow = [name for wheel in self.wheels() for name in wheel.slow_columns()]
        named = [column.column for column in self.axis_columns()]
        others = (self.sampling.time_column, *slow, *(reference.column for reference in self.reference))
        return tuple(dict.fromkeys([*named, *(name for name in others if name is not None)]))

    def radius_mm(self, wheel: ImportedWheel) -> float | None:
        """Return the stated belt radius of a wheel."""
        return self.conditions.radius_mm if wheel.radius_mm is None else wheel.radius_mm

    def assumptions(self) -> tuple[str, ...]:
        """Return the assumptions that the results rest on, as texts for the recording's configuration."""
        assumed = self.assumed
        if any(self.radius_mm(wheel) is None for wheel in self.wheels()):
            assumed = (*assumed, f"belt radius {ASSUMED_RADIUS_MM:g} mm (not stated in the map)")
        if self.sampling.rate_hz is not None and self.sampling.rate_std_percent is None:
            assumed = (*assumed, f"error of the stated rate {STATED_RATE_STD_PERCENT:g} % (not stated in the map)")
        return assumed

    def vehicle(
        self,
        more_assumed: tuple[str, ...] = (),
        *,
        rounding_std: float = 0.0,
        loads_n: Mapping[str, tuple[float, float]] | None = None,
    ) -> VehicleConfig:
        """Return the vehicle configuration for the recording.

        Args:
            more_assumed: further assumptions.
            rounding_std: relative error of the rate by rounded times.
            loads_n: measured mean load of a wheel with its error, for wheels whose load is not stated.
        """
        conditions = self.conditions
        tire = Tire(
            size=conditions.tire,
            radius_mm=ASSUMED_RADIUS_MM if conditions.radius_mm is None else conditions.radius_mm,
            radius_std_mm=ASSUMED_RADIUS_STD_MM if conditions.radius_mm is None else None,
            pressure_kpa=conditions.pressure_kpa,
            pressure_std_kpa=conditions.pressure_std_kpa,
            temperature_degc=conditions.temperature_degc,
            ring_thickness_mm=conditions.ring_thickness_mm,
        )
        measured = {} if loads_n is None else loads_n
        wheels = tuple(
            Wheel(
                position=wheel.position,
                hub=0,
                wheel=number,
                sensor_id=wheel.sensor_id,
                load_n=measured[wheel.position][0] if wheel.position in measured else wheel.load_n,
                load_std_n=measured[wheel.position][1] if wheel.position in measured else wheel.load_std_n,
                mounting=wheel.mounting,
                sensor=self.sampling.accuracy(rounding_std),
                tire=_own_tire(wheel),
            )
            for number, wheel in enumerate(self.wheels())
        )
        assumed = (*self.assumptions(), *more_assumed)
        return VehicleConfig(vehicle=Vehicle(name=conditions.name, assumed=assumed), tire=tire, wheel=wheels)


def _own_tire(wheel: ImportedWheel) -> Tire:
    """Return the deviations of a wheel's tire from the others."""
    # A stated radius has the stated error, or the usual one; that of an assumed radius must not remain.
    radius_std_mm = wheel.radius_std_mm
    if wheel.radius_mm is not None and radius_std_mm is None:
        radius_std_mm = Tire(radius_mm=wheel.radius_mm).radius_std_m * 1e3
    return Tire(
        radius_mm=wheel.radius_mm,
        radius_std_mm=radius_std_mm,
        pressure_kpa=wheel.pressure_kpa,
        pressure_std_kpa=wheel.pressure_std_kpa,
    )


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
    parsed = parse_document(ImportMap, text, origin, _cross_faults)
    try:
        parsed.vehicle()
    except ValidationError as error:
        fault = error.errors()[0]["msg"].removeprefix("Value error, ")
        raise ConfigError(f"{origin}: {fault}", f"Correct it in {origin}.") from error
    return parsed


def _cross_faults(data: Mapping[str, Any]) -> Iterator[Fault]:
    sampling = as_table(data.get("sampling"))
    if "rate_hz" in sampling and "time_column" in sampling:
        yield Fault("sampling", "both rate_hz and time_column", "keep only one")
    elif "rate_hz" not in sampling and "time_column" not in sampling:
        yield Fault("sampling.rate_hz", None, "rate_hz or time_column is required")
    if "time_zone" in sampling and sampling.get("time_unit") != ISO:
        yield Fault("sampling.time_zone", show(sampling["time_zone"]), 'only for time_unit = "iso"')
    yield from _axis_faults(data)
    yield from _mounting_faults(data)
    sensor = as_table(data.get("sensor"))
    highpass_hz = sensor.get("highpass_hz", 0)
    if sensor.get("coupling") == "DC" and isinstance(highpass_hz, int | float) and highpass_hz > 0:
        yield Fault(
            "sensor.highpass_hz", show(highpass_hz), 'a DC-coupled sensor has no high-pass; is the coupling "AC"?'
        )
    layout = as_table(data.get("file"))
    if layout.get("decimal") == "," and layout.get("delimiter", "comma") == "comma":
        yield Fault(
            "file.delimiter", show(layout.get("delimiter", "comma")), "a decimal comma requires another delimiter"
        )
    conditions = as_table(data.get("conditions"))
    for error, value in _ERRORS:
        if error in conditions and value not in conditions:
            yield Fault(f"conditions.{error}", show(conditions[error]), f"it needs {value} too")
    yield from _reference_faults(data)


def _mounting_faults(data: Mapping[str, Any]) -> Iterator[Fault]:
    """Yield where the sensor's place in the tire is stated in another table."""
    mounting_table = "[wheel.mounting]" if "wheel" in data else "[mounting]"
    for table in ("sensor", "conditions"):
        for key in ("offset_mm", "offset_std_mm"):
            if key in as_table(data.get(table)):
                yield Fault(f"{table}.{key}", show(as_table(data.get(table))[key]), f"move it to {mounting_table}")


def _axis_faults(data: Mapping[str, Any]) -> Iterator[Fault]:
    """Yield faults of the wheels: missing or repeated columns, and a single wheel beside several."""
    wheels = [wheel for _, wheel in as_tables(data.get("wheel"))]
    yield from _single_wheel_faults(data, len(wheels))
    sections = {f"wheel[#{k}].": wheel for k, wheel in enumerate(wheels, 1)} or {"": data}
    columns: dict[str, dict[str, object]] = {}
    for prefix, section in sections.items():
        axes = as_table(section.get("axis"))
        if "axis" in section and "radial" not in axes:
            yield Fault(f"{prefix}axis.radial", None, "the radial axis is required to find the revolutions")
        tables = {f"{prefix}axis.{name}": axis for name, axis in axes.items() if isinstance(axis, Mapping)}
        for key, axis in tables.items():
            sign = axis.get("sign", 1)
            if isinstance(sign, int) and not isinstance(sign, bool) and sign not in (1, -1):
                yield Fault(f"{key}.sign", show(sign), "allowed: 1 or -1")
        # The rows of each sensor have the same columns.
        of_rows = columns.setdefault(prefix if "sensor" in section else "", {})
        of_rows.update({f"{key}.column": axis.get("column") for key, axis in tables.items()})
        yield from _wheel_faults(prefix, section, data) if prefix else ()
    for keys in columns.values():
        yield from _repeated(keys, lambda first: f"{first.removesuffix('.column')} has the same column")
    positions = {f"{prefix}position": section.get("position") for prefix, section in sections.items() if prefix}
    yield from _repeated(positions, lambda _: "another wheel has the same position")


def _single_wheel_faults(data: Mapping[str, Any], wheels: int) -> Iterator[Fault]:
    """Yield tables and keys of a single wheel beside several, and too many wheels or none."""
    if wheels:
        for key in ("axis", "environment", "mounting"):
            if key in data:
                yield Fault(key, "beside [[wheel]]", f"move it to [wheel.{key}] of each wheel")
        for key, table in (("position", "conditions"), ("load_n", "conditions"), ("sensor_id", "sensor")):
            if key in as_table(data.get(table)):
                yield Fault(f"{table}.{key}", "beside [[wheel]]", "move it to each wheel")
        if wheels > _MAX_WHEELS:
            yield Fault("wheel", f"{wheels} wheels", f"at most {_MAX_WHEELS}")
    elif "axis" not in data:
        yield Fault("axis", None, "[axis.radial] is required, or [[wheel]] for several wheels")


def _wheel_faults(prefix: str, wheel: Mapping[str, Any], data: Mapping[str, Any]) -> Iterator[Fault]:
    """Yield keys of one of several wheels without those that they need."""
    if ("sensor" in wheel) is not ("sensor_column" in as_table(data.get("file"))):
        yield Fault(
            f"{prefix}sensor",
            show(wheel["sensor"]) if "sensor" in wheel else None,
            "it goes with sensor_column in [file]: state both, or neither",
        )
    for error, value in (*_ERRORS, ("radius_std_mm", "radius_mm")):
        if error in wheel and value not in wheel:
            yield Fault(f"{prefix}{error}", show(wheel[error]), f"it needs {value} too")


def _repeated(texts: Mapping[str, object], describe: Callable[[str], str]) -> Iterator[Fault]:
    """Yield keys with the text of an earlier one, whose key `describe` gets."""
    first: dict[str, str] = {}
    for key, text in texts.items():
        if isinstance(text, str) and first.setdefault(text, key) != key:
            yield Fault(key, show(text), describe(first[text]))


def _reference_faults(data: Mapping[str, Any]) -> Iterator[Fault]:
    """Yield faults of the references: units, repeated names, and unknown wheels."""
    wheels = [wheel.get("position") for _, wheel in as_tables(data.get("wheel"))]
    positions = wheels or [as_table(data.get("conditions")).get("position", "W1")]
    names: dict[str, object] = {}
    for index, reference in as_tables(data.get("reference")):
        key, quantity, unit = f"reference[#{index + 1}]", reference.get("quantity"), reference.get("unit")
        units = REFERENCE_UNITS.get(quantity) if isinstance(quantity, str) else None
        if units and unit not in units:
            stated_unit = None if unit is None else show(unit)
            yield Fault(f"{key}.unit", stated_unit, f"one of {', '.join(units)}")
        if units == {} and unit is not None:
            yield Fault(f"{key}.unit", show(unit), "pulses have no unit")
        if units:
            for pulse_key in ("pulses_per_turn", "threshold"):
                if pulse_key in reference:
                    yield Fault(f"{key}.{pulse_key}", show(reference[pulse_key]), 'only for quantity = "pulses"')
        names[f"{key}.name"] = reference.get("name")
        named_wheels = reference.get("wheels", ())
        for wheel in named_wheels if isinstance(named_wheels, list) else ():
            if wheel not in positions:
                yield Fault(f"{key}.wheels", show(wheel), f"the wheels are {', '.join(map(str, positions))}")
    yield from _repeated(names, lambda _: "another reference has the same name")
