"""Import of samples that `treadlink export` has written to CSV or MF4: wheels, conditions and start come back.

Each wheel has rows of its own, at the times of the hub's clock. What its sensor measured on average of pressure and
temperature is repeated as messages of the sensor.
"""

import contextlib
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from pydantic import ValidationError

from gateway.core.config.vehicle import Mounting
from gateway.core.constants import AXIS_NAMES
from gateway.core.errors import ImportDataError
from gateway.importing.columns import Block, ColumnReader, FileFacts
from gateway.importing.csv_columns import CsvColumns
from gateway.importing.file_formats import open_columns, recognised_format
from gateway.importing.import_map import (
    Axes,
    AxisColumn,
    EnvironmentColumns,
    FileFormat,
    FileLayout,
    ImportedWheel,
    ImportMap,
    Sampling,
    Sensor,
    StatedConditions,
)
from gateway.importing.importer import ImportReport, WheelRows, import_wheels
from gateway.importing.reader_process import ReaderProcesses

Conditions = dict[str, tuple[str, str]]
"""Conditions of a wheel by name: value and source as text."""

_MARK: Final = "exported_by"
_BY_SENSOR: Final = "measured by the sensor"
_CONDITION: Final = re.compile(r"# (.+?) ([a-z][a-z0-9_]*): (.*?)(?: \(([^()]*)\))?\s*")
_COLUMN: Final = re.compile(r"# column ")
_MAX_LINES: Final = 10_000
_TIME: Final = "device_s"
_SLOW: Final = ("pressure_pa", "temperature_degc")
# Key of a wheel in an import map, the condition of an export, and the factor between them.
_WHEEL_NUMBERS: Final = (
    ("load_n", "load_n", 1.0),
    ("load_std_n", "load_std_n", 1.0),
    ("radius_mm", "radius_m", 1e3),
    ("radius_std_mm", "radius_std_m", 1e3),
    ("pressure_kpa", "pressure_pa", 1e-3),
)
_PROBE: Final = ImportMap(
    sampling=Sampling(rate_hz=1e4), axis=Axes(radial=AxisColumn(column="?", unit="g")), sensor=Sensor(coupling="DC")
)


def exported_wheels(path: Path, processes: ReaderProcesses | None = None) -> dict[str, Conditions]:
    """Return the conditions of every wheel of a file that treadlink has exported, nothing for any other file.

    Raises:
        ImportDataError: an MF4 file cannot be read.
    """
    kind = recognised_format(path)
    if kind is FileFormat.CSV and path.is_file():
        return _csv_conditions(path)[0]
    if kind is FileFormat.MF4 and path.is_file():
        with contextlib.closing(open_columns(path, _PROBE, processes)) as reader:
            return {
                wheel: _pairs(conditions)
                for wheel, conditions in reader.facts.conditions.items()
                if _MARK in conditions
            }
    return {}


def import_exported(path: Path, out: Path, progress: Callable[[float], None] = lambda _: None) -> ImportReport:
    """Import samples that treadlink has exported into the new recording `out`, without a map.

    Raises:
        ImportDataError: the file is no such export, holds no samples, or is damaged.
        RecordingError: the recording exists or cannot be written.
    """
    processes = ReaderProcesses()
    wheels = exported_wheels(path, processes)
    if not wheels:
        if recognised_format(path) is None:  # a recording, a configuration: says what to do with it
            open_columns(path, _PROBE, processes).close()
        raise ImportDataError(
            f"{path} is no CSV or MF4 file of `treadlink export`, so that its columns need an import map",
            f"Write a first one: treadlink import --guess {path}",
        )
    parts = []
    with contextlib.ExitStack() as stack:
        for position, conditions in wheels.items():
            reader = stack.enter_context(contextlib.closing(_wheel_reader(path, position, conditions, processes)))
            missing = [name for name in (_TIME, "radial_mps2") if name not in reader.facts.names]
            if missing:
                raise ImportDataError(
                    f"{path}: wheel {position} has no column '{missing[0]}'", "Export samples: --what samples."
                )
            parts.append(WheelRows(reader, _wheel_map(path, position, conditions, reader), reader.begin_s()))
        maps = [part.import_map for part in parts]
        # One error for the rates of all: the largest.
        sampling = max((entry.sampling for entry in maps), key=lambda sampling: sampling.rate_std_percent or 0.0)
        stated = maps[0].conditions
        if any(entry.conditions.temperature_degc != stated.temperature_degc for entry in maps):
            stated = stated.model_copy(update={"temperature_degc": None})
        wheel = tuple(entry.wheel[0] for entry in maps)
        merged = maps[0].model_copy(update={"wheel": wheel, "sampling": sampling, "conditions": stated})
        start_ns = _start_ns(next(iter(wheels.values()))) or path.stat().st_mtime_ns
        return import_wheels(path, parts, merged, start_ns, out, progress)


class _WheelReader:
    """Columns of one wheel by the names of an export, with the constant means of pressure and temperature."""

    def __init__(self, reader: ColumnReader, prefix: str, time: str, constants: Mapping[str, float]) -> None:
        self._reader, self._prefix, self._time_name, self._constants = reader, prefix, time, constants
        names = [name.removeprefix(prefix) for name in reader.facts.names if name.startswith(prefix)]
        self.facts = FileFacts((*names, *constants), start_ns=reader.facts.start_ns)

    def blocks(self, names: Sequence[str]) -> Iterator[Block]:
        """Yield the named columns."""
        measured_names = [name for name in names if name not in self._constants]
        for block in self._reader.blocks([f"{self._prefix}{name}" for name in measured_names]):
            columns = {name: block.values[:, k] for k, name in enumerate(measured_names)}
            rows = len(block.values)
            values = [columns[name] if name in columns else np.full(rows, self._constants[name]) for name in names]
            yield Block(block.first_row, np.column_stack(values), block.where, block.progress)

    def begin_s(self) -> float:
        """Return the time of the first sample from the start of the recording."""
        # A channel of the wheel tells an MF4 file whose time is meant.
        names = [f"{self._prefix}{_TIME}", self._time_name]
        block = self._reader.sample(names)
        return 0.0 if block is None or not len(block.values) else float(block.values[0, 1])

    def close(self) -> None:
        """Release the file."""
        self._reader.close()


def _wheel_reader(path: Path, position: str, conditions: Conditions, processes: ReaderProcesses) -> _WheelReader:
    constants = {}
    for name in _SLOW:
        value = _number(conditions, name)
        if value is not None and conditions[name][1] == _BY_SENSOR:
            constants[name] = value
    if recognised_format(path) is FileFormat.CSV:
        layout = FileLayout(skip_rows=_csv_conditions(path)[1])
        return _WheelReader(CsvColumns(path, layout, line_start=f"{position},"), "", "time_s", constants)
    return _WheelReader(open_columns(path, _PROBE, processes), f"{position}.", "time", constants)


def _wheel_map(path: Path, position: str, conditions: Conditions, reader: _WheelReader) -> ImportMap:
    present = (_text(conditions, "axes") or ", ".join(AXIS_NAMES)).split(", ")
    full_scales = dict(entry.rpartition(" ")[::2] for entry in _text(conditions, "ranges_mps2").split(", "))
    axes = {
        name: AxisColumn(column=f"{name}_mps2", unit="m/s^2", full_scale=_end(full_scales.get(name)))
        for name in AXIS_NAMES
        if name in present and f"{name}_mps2" in reader.facts.names
    }
    constants = [name if name in reader.facts.names else None for name in _SLOW]
    unstated = set() if constants[0] is None else {"pressure_kpa"}
    if "assumed" in conditions.get("radius_m", ("", ""))[1]:
        unstated |= {"radius_mm", "radius_std_mm"}
    numbers: dict[str, Any] = {
        key: number * factor
        for key, name, factor in _WHEEL_NUMBERS
        if key not in unstated and (number := _number(conditions, name)) is not None
    }
    for error, key in (("load_std_n", "load_n"), ("radius_std_mm", "radius_mm")):
        if key not in numbers:
            numbers.pop(error, None)
    offset_m, rate_std = _number(conditions, "mounting_offset_m"), _number(conditions, "relative_rate_std")
    try:
        sampling = Sampling(time_column=_TIME, rate_std_percent=None if rate_std is None else 100.0 * rate_std)
        wheel = ImportedWheel(
            position=position,
            sensor_id=_text(conditions, "sensor_id") or None,
            **numbers,
            axis=Axes(**axes),
            environment=EnvironmentColumns(
                pressure_column=constants[0], pressure_unit="Pa", temperature_column=constants[1]
            ),
            mounting=Mounting() if offset_m is None else Mounting(offset_mm=offset_m * 1e3),
        )
        stated = StatedConditions(
            name=_text(conditions, "vehicle"),
            tire=conditions.get("tire_size", (None,))[0],
            temperature_degc=None if constants[1] else _number(conditions, "temperature_degc"),
        )
    except ValidationError as error:
        first = error.errors()[0]
        raise ImportDataError(
            f"{path}: wheel '{position}': {'.'.join(map(str, first['loc']))}: {first['msg']}",
            "Import it with a map: treadlink import --guess writes a first one.",
        ) from error
    assumed = _text(conditions, "assumed")
    return ImportMap(
        assumed=(assumed,) if assumed else (),
        sampling=sampling,
        sensor=Sensor(coupling="AC" if _text(conditions, "coupling") == "ac" else "DC"),
        conditions=stated,
        wheel=(wheel,),
    )


def _csv_conditions(path: Path) -> tuple[dict[str, Conditions], int]:
    """Return the conditions in the comments of a CSV file, and the number of comment lines."""
    wheels: dict[str, Conditions] = {}
    count = 0
    with path.open(encoding="utf-8", errors="replace") as file:
        for line in file:
            if not line.startswith("# ") or count >= _MAX_LINES:
                break
            count += 1
            match = None if _COLUMN.match(line) else _CONDITION.fullmatch(line)
            if match is not None:
                wheels.setdefault(match[1], {})[match[2]] = match[3], match[4] or ""
    return {wheel: conditions for wheel, conditions in wheels.items() if _MARK in conditions}, count


def _pairs(properties: Mapping[str, Sequence[str]]) -> Conditions:
    return {name: (value, source) for name, (value, source) in properties.items()}


def _start_ns(conditions: Conditions) -> int | None:
    """Return the start of the recording, None where it is unknown. A double would round it to 0.2 us."""
    text = _text(conditions, "start_ns").split(" ")[0]
    return int(text) if text.isdecimal() and int(text) > 0 else None


def _text(conditions: Conditions, name: str) -> str:
    """Return the value of a condition, empty where there is none."""
    return conditions.get(name, ("", ""))[0]


def _end(text: str | None) -> float | None:
    """Return the end of a range, None without a positive number."""
    try:
        end = float(text or "")
    except ValueError:
        return None
    return end if 0.0 < end < math.inf else None


def _number(conditions: Conditions, name: str) -> float | None:
    """Return the number of a condition, whose unit may follow it; None where there is none."""
    try:
        return float(conditions[name][0].split(" ")[0])
    except (KeyError, ValueError):
        return None
