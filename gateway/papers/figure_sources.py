"""Measurements for the figures of the papers: recordings, datasets, and a table of conditions."""

import csv
import io
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np

from gateway.core.config.validation import read_text
from gateway.core.errors import ConfigError, RecordingError
from gateway.core.estimates.registry import DEFAULT_ESTIMATORS
from gateway.core.nearest_name import did_you_mean
from gateway.core.recording.recorded_file import open_recorded_file
from gateway.core.ring_quantities import RING_NUMBERS
from gateway.core.session.recording_pass import RecordingPass, open_recording
from gateway.core.text.numbers import MISSING, fixed, round_to_error
from gateway.core.text.progress import Bar, progress_bar
from gateway.core.text.table_sinks import CsvSink
from gateway.core.text.text import clean, pad, pad_left, width
from gateway.core.types import FloatArray
from gateway.fleet.dataset import read_description
from gateway.fleet.parquet_parts import read_rows, require_campaign_packages
from gateway.fleet.recording_estimation import RECORDINGS
from gateway.papers.measured_tires import SIDE_FORCE, SLOPES, GridConditions, MeasuredTire, MeasuredWheel
from gateway.papers.ring_data import ESTIMATORS

# Column of the table -> name in GridConditions, and factor from its unit.
_CONDITIONS: Final = {
    "load_n": ("load_n", 1.0),
    "pressure_kpa": ("pressure_pa", 1e3),
    "wear_mm": ("wear_mm", 1.0),
    "speed_kmh": ("speed_kmh", 1.0),
}
_COLUMNS: Final = ("recording", "wheel", *_CONDITIONS)
_PLAIN: Final = ("recording", "position", "load_n", "pressure_pa", "speed_mean_mps", "radius_m")
_WEAR: Final = "wear_mm"
_CONTACT: Final = "contact_fraction"
# Speeds that differ by more are not of the stated condition.
_SPEED_TOLERANCE: Final = 0.05


@dataclass(frozen=True, slots=True)
class FigureSource:
    """A recording or a dataset.

    Attributes:
        path: of it.
        wheel: position; None for all.
        stated: conditions that a table states.
    """

    path: Path
    wheel: str | None = None
    stated: GridConditions = field(default_factory=GridConditions)


def read_grid(path: Path) -> list[FigureSource]:
    """Return the recordings of a table of conditions: CSV with the column `recording`, by commas or semicolons.

    Raises:
        ConfigError: it cannot be read, has another column, no recording, a cell that is no positive number, or a
            wheel or conditions of a dataset.
    """
    table = read_text(path, "the table of conditions")
    delimiter = ";" if ";" in table.partition("\n")[0] else ","
    lines = csv.DictReader(io.StringIO(table), restkey="", delimiter=delimiter)
    try:
        rows = [(lines.line_num, line) for line in lines]
    except csv.Error as error:
        raise ConfigError(f"'{path}', line {lines.line_num}: {error}", "Give a CSV file.") from error
    columns = [name.strip() for name in lines.fieldnames or ()]
    for name in columns:
        if name not in _COLUMNS:
            raise ConfigError(
                f"'{path}' has a column '{name}'", f"{did_you_mean(name, _COLUMNS)}Columns are {', '.join(_COLUMNS)}."
            )
    if "recording" not in columns:
        raise ConfigError(f"'{path}' has no column 'recording'", f"Its first line names some of {', '.join(_COLUMNS)}.")
    sources = []
    for number, line in rows:
        cells = {name.strip(): (cell or "").strip() for name, cell in line.items() if name}
        origin = f"'{path}', line {number}"
        if "" in line or not cells["recording"]:
            raise ConfigError(f"{origin} does not fit the columns", f"Give a cell for each of {', '.join(columns)}.")
        values = {
            name: factor * _positive(cells[column], f"{origin}: {column}", zero=column == _WEAR)
            for column, (name, factor) in _CONDITIONS.items()
            if cells.get(column)
        }
        source = FigureSource(path.parent / cells["recording"], cells.get("wheel") or None, GridConditions(**values))
        if source.path.is_dir() and (source.wheel is not None or values):
            raise ConfigError(
                f"{origin}: '{source.path}' is a folder; wheel and conditions can be stated of recordings only",
                "Name the recordings in the table, or give the dataset with --from.",
            )
        sources.append(source)
    if not sources:
        raise ConfigError(f"'{path}' has no recording", "Give a line for each one.")
    return sources


def _positive(cell: str, origin: str, *, zero: bool) -> float:
    try:
        value = float(cell)
    except ValueError:
        value = math.nan
    if not (0.0 < value < math.inf or (zero and value == 0.0)):
        raise ConfigError(
            f"{origin} is '{clean(cell)}', which is no {'' if zero else 'positive '}number", "Mend the table."
        )
    return value


def measured_tires(
    sources: Sequence[FigureSource],
    config_path: Path | None,
    on_source: Callable[[Path], None],
    *,
    show_progress: bool = False,
) -> list[MeasuredTire]:
    """Return the wheels of recordings and datasets.

    Args:
        sources: recordings and datasets, in the order of the figures.
        config_path: vehicle configuration, None for the recorded one.
        on_source: called with each path before it is read.
        show_progress: whether a terminal shows how much of a recording is read.

    Raises:
        TreadlinkError: a source cannot be read, has not the wheel, or nothing has a usable revolution.
    """
    tires: list[MeasuredTire] = []
    for source in sources:
        on_source(source.path)
        if source.path.is_dir():
            tires += _of_dataset(source.path)
        else:
            tires += _of_recording(source, config_path, show_progress=show_progress)
    if not tires:
        raise RecordingError("no wheel has a usable revolution", "Look at the recordings with treadlink inspect.")
    return tires


def _of_recording(source: FigureSource, config_path: Path | None, *, show_progress: bool) -> list[MeasuredTire]:
    file = open_recorded_file(source.path)
    wheels: dict[str, MeasuredWheel] = {}
    progress = progress_bar(f"reading {source.path.name}") if show_progress else nullcontext(Bar(None, None))
    with progress as bar:
        size = max(file.info.size_bytes, 1)
        recording = open_recording(file, config_path, on_position=lambda position: bar.show(position / size))
        for result in RecordingPass(recording, (*DEFAULT_ESTIMATORS, "side-force"), signals=recording.signals()):
            if source.wheel in (None, result.position):
                if result.position not in wheels:
                    name = clean(f"{source.path.stem} {result.position}")
                    wheels[result.position] = MeasuredWheel(name, source.stated)
                wheels[result.position].add(result.revolution, result.conditions, result.estimates)
    if source.wheel is not None and source.wheel not in wheels:
        raise RecordingError(
            f"wheel '{source.wheel}' has no revolution in '{source.path}'",
            "Name another one, or look at the recording with treadlink inspect.",
        )
    return [tire for wheel in wheels.values() if (tire := wheel.tire()) is not None]


def _of_dataset(root: Path) -> list[MeasuredTire]:
    require_campaign_packages()
    description = read_description(root)
    estimator = next((name for name in reversed(ESTIMATORS) if name in description.estimators), None)
    quantities = [*RING_NUMBERS, *SLOPES.values(), SIDE_FORCE, _WEAR, _CONTACT]
    names = [*_PLAIN, *(name + part for name in quantities for part in ("", "_std", "_status"))]
    rows = [
        row
        for path in sorted((root / RECORDINGS).glob("*/*/*.parquet"))
        for row in read_rows(path, names, _PLAIN) or ()
    ]
    return [_of_row(row, estimator) for row in sorted(rows, key=lambda row: (row["recording"], row["position"]))]


def _of_row(row: Mapping[str, Any], estimator: str | None) -> MeasuredTire:
    def number(name: str) -> float:
        value = row.get(name)
        return math.nan if value is None or row.get(f"{name}_status") == "invalid" else float(value)

    def with_error(name: str) -> tuple[float, float]:
        value = number(name)
        return value, number(f"{name}_std") if math.isfinite(value) else math.nan

    half_rad = math.pi * number(_CONTACT)
    pairs = [with_error(name) for name in RING_NUMBERS]
    values: FloatArray = np.array([value for value, _ in pairs])
    stds: FloatArray = np.array([std for _, std in pairs])
    return MeasuredTire(
        name=clean(f"{Path(row['recording']).stem} {row['position']}"),
        load_n=number("load_n"),
        pressure_pa=number("pressure_pa"),
        wear_mm=number(_WEAR),
        speed_kmh=3.6 * number("speed_mean_mps"),
        stated_speed_kmh=math.nan,
        radius_m=number("radius_m"),
        edges_rad=(-half_rad, half_rad),
        numbers={estimator: (values, stds)} if estimator is not None else {},
        slopes_rad={definition: with_error(name) for definition, name in SLOPES.items()},
        side_force_n=with_error(SIDE_FORCE),
    )


_TABLE: Final = (*_CONDITIONS, "contact_half_angle_deg", "pressure_number")


def _conditions(tire: MeasuredTire) -> list[float]:
    half_deg = math.degrees(tire.half_angle_rad)
    return [tire.load_n, 1e-3 * tire.pressure_pa, tire.wear_mm, tire.speed_kmh, half_deg, tire.pressure_number]


def table_csv(tires: Sequence[MeasuredTire]) -> bytes:
    """Return conditions and numbers of every wheel as CSV; unknown is empty."""
    file = io.BytesIO()
    sink = CsvSink(file)
    parts = [f"{estimator}_{name}{part}" for estimator in ESTIMATORS for name in RING_NUMBERS for part in ("", "_std")]
    slopes = [f"{name}{part}" for name in (*SLOPES.values(), SIDE_FORCE) for part in ("", "_std")]
    sink.header(["name", *_TABLE, *parts, *slopes])
    for tire in tires:
        numbers = [value for pair in _numbers(tire) for value in pair]
        angles = [value for pair in (*map(tire.slopes_rad.__getitem__, SLOPES), tire.side_force_n) for value in pair]
        sink.row(
            [tire.name, *(value if math.isfinite(value) else None for value in (*_conditions(tire), *numbers, *angles))]
        )
    return file.getvalue()


def _numbers(tire: MeasuredTire) -> Iterator[tuple[float, float]]:
    for estimator in ESTIMATORS:
        if estimator in tire.numbers:
            values, stds = tire.numbers[estimator]
            yield from zip(values.tolist(), stds.tolist(), strict=True)
        else:
            yield from [(math.nan, math.nan)] * len(RING_NUMBERS)


def table_lines(tires: Sequence[MeasuredTire]) -> Iterator[str]:
    """Yield conditions and numbers of every wheel, aligned, and which speeds are not the stated ones."""
    heads = [
        "",
        "N",
        "kPa",
        "wear, mm",
        "km/h",
        "θr, deg",
        "Pn",
        *(f"{name}, {e}" for e in ESTIMATORS for name in RING_NUMBERS),
    ]
    rows = [heads]
    for tire in tires:
        decimals = (0, 1, 1, 1, 2, 3)
        texts = [fixed(value, places) for value, places in zip(_conditions(tire), decimals, strict=True)]
        rows.append([tire.name, *texts, *(round_to_error(*pair).joined() for pair in _numbers(tire))])
    columns = [column for column in range(len(heads)) if column == 0 or any(row[column] != MISSING for row in rows[1:])]
    widths = [max(width(row[column]) for row in rows) for column in columns]
    for row in rows:
        first, *others = (row[column] for column in columns)
        yield "  ".join((pad(first, widths[0]), *(pad_left(t, w) for t, w in zip(others, widths[1:], strict=True))))
    for tire in tires:
        if abs(tire.speed_kmh / tire.stated_speed_kmh - 1.0) > _SPEED_TOLERANCE:
            yield f"{tire.name}: the table states {tire.stated_speed_kmh:.1f} km/h, measured are {tire.speed_kmh:.1f}"
