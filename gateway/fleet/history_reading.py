"""Histories of tires, read from the table of recordings of a dataset and an odometer file."""

import csv
import io
import json
import math
import re
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, Final, NamedTuple
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from gateway.core.clock import Clock, SystemClock
from gateway.core.config.validation import read_text
from gateway.core.errors import OutputError, RecordingError
from gateway.core.estimates.estimator import Status
from gateway.core.quantity import Statement
from gateway.core.quantity_catalogue import declared
from gateway.core.reasons import Reason
from gateway.core.recording.run_description import EVERY_RUN, RunDescription, RunFilter, TireIdentity, read_notes
from gateway.core.shown_units import ShownUnits
from gateway.core.types import FloatArray
from gateway.fleet.dataset import FAILURES, Key, is_identified, partition_name, read_description
from gateway.fleet.parquet_parts import read_rows
from gateway.fleet.reasons import FleetCode
from gateway.fleet.recording_estimation import AVERAGE_ORDERS, RECORDINGS
from gateway.fleet.trends.structure_trend import FIRST_ORDER, LAST_ORDER
from gateway.fleet.trends.tire_history import TireHistory

Odometer = Mapping[str, tuple[NDArray[np.int64], FloatArray]]
"""Vehicle -> times in ns and distances in km, both increasing."""

_PLAIN: Final = (
    "recording_id", "recording", "path", "position", "sensor_id", "start_utc", "begin_utc", "end_utc", "hub_zero_utc",
    "duration_s", "revolutions", "revolutions_valid", "distance_m", "stated_radius_m", "ring_thickness_m", "reference",
    "load_calibration", "faults", "alarms", "damage", AVERAGE_ORDERS.name,
    "speed_mean_mps", "load_n", "load_std_n", "pressure_pa", "pressure_std_pa", "pressure_measured",
    "temperature_degc", "noise_mps2", "samples", "samples_lost", "samples_saturated", "mounting_offset_m",
    "mounting_offset_std_m",
    "test", "driver", "comment", "tags", "tire_maker", "tire_dot", "shown_units",
)  # fmt: skip
_ESTIMATES: Final = tuple(quantity.column for quantity in declared() if quantity.watch is not None or quantity.compared)
_TIMES: Final = ("start_utc", "begin_utc", "end_utc", "hub_zero_utc")
_TEXT: Final = frozenset(
    {"recording_id", "recording", "path", "position", "sensor_id", "reference", "load_calibration", "faults", "alarms",
     "damage", AVERAGE_ORDERS.name, "test", "driver", "comment", "tags", "tire_maker", "tire_dot", "shown_units",
     *_TIMES}
)  # fmt: skip
# Columns without which a file is no table of recordings.
_NEEDED: Final = ("recording_id", "recording", "path", "position", "sensor_id", "start_utc")
_NAMED_REPEATS: Final = 5
_POSITION: Final = "wheel"  # of a row, which has one
# Other spellings that parsers of dates take, such as 20260101, may be meant as something else.
_DATE: Final = re.compile(
    r"\d{4}-\d{2}-\d{2}(?:[T ]\d{2}:\d{2}(?::\d{2}(?:\.\d{1,9})?)?(?:Z|[+-]\d{2}:\d{2})?)?", re.ASCII
)
_FIRST_YEAR, _LAST_YEAR = 1970, 2200
_MAX_ODOMETER_BYTES: Final = 64 << 20
_ODOMETER_COLUMNS: Final = ("vehicle", "utc", "km")
# Clocks that were not set begin in 1970, 1980 or 2000; there were no such sensors before.
_EARLIEST_NS: Final = int(np.datetime64("2000-03-01", "ns").astype(np.int64))
# Clocks of recorder and of this computer may differ.
_CLOCK_SLACK_NS: Final = 86_400 * 10**9
# Hosts estimate the zero of a hub's clock from arrival times; different drives differ by seconds at least.
_SAME_ZERO_NS: Final = 200_000_000
_OVERLAP: Final = 0.5
_NS: Final = 1_000_000_000

Row = Mapping[str, Any]


def without_repeats(rows: Sequence[Row]) -> tuple[list[Row], list[tuple[Row, Row]]]:
    """Return the rows of one tire that are of different drives, and pairs of a repeat and what it repeats.

    Two recordings are of one drive where they share more than half of the time of the shorter one, and the hub's clock
    was zero at the same time: a recorder that always begins at the same wrong date repeats its times only. Of several
    the one with the most valid revolutions is kept.
    """
    order = sorted(rows, key=_repeat_order)
    distinct: list[Row] = []
    by_zero: dict[int, list[Row]] = defaultdict(list)
    repeats: list[tuple[Row, Row]] = []
    for row in order:
        second = int(row.get("hub_zero_utc") or 0) // _NS
        candidates = (drive for zero_s in (second - 1, second, second + 1) for drive in by_zero.get(zero_s, ()))
        original = next((drive for drive in candidates if _is_same_drive(row, drive)), None)
        if original is None:
            distinct.append(row)
            by_zero[second].append(row)
        else:
            repeats.append((row, original))
    return distinct, repeats


def _repeat_order(row: Row) -> tuple[int, int, str]:
    """Return what orders recordings of one drive: valid revolutions first, then the shortest path, the original's."""
    path = str(row["path"])
    return -(row.get("revolutions_valid") or 0), len(path), path


def _is_same_drive(row: Row, other: Row) -> bool:
    names = ("begin_utc", "end_utc", "hub_zero_utc")
    if any(drive.get(name) is None for drive in (row, other) for name in names):
        return False
    overlap = min(row["end_utc"], other["end_utc"]) - max(row["begin_utc"], other["begin_utc"])
    shorter = min(row["end_utc"] - row["begin_utc"], other["end_utc"] - other["begin_utc"])
    return bool(overlap > _OVERLAP * shorter and abs(row["hub_zero_utc"] - other["hub_zero_utc"]) <= _SAME_ZERO_NS)


@dataclass(frozen=True, slots=True)
class DatasetHistories:
    """Content of a dataset for trends.

    Attributes:
        tires: one history for each vehicle, wheel and sensor.
        recordings: number of recordings with rows.
        failures: number of recordings without.
        notes: on files and the odometer.
    """

    tires: tuple[TireHistory, ...]
    recordings: int
    failures: int
    notes: tuple[Reason, ...]


def read_histories(
    root: Path, odometer: Odometer | None = None, *, clock: Clock | None = None, where: RunFilter = EVERY_RUN
) -> DatasetHistories:
    """Read the table of recordings.

    A recording whose clock cannot be right is left out: alone it would decide every trend over time and distance.

    Args:
        root: folder of the dataset.
        odometer: readings by vehicle.
        clock: tells the present time, after which no recording began.
        where: what the description of a run must be.

    Raises:
        OutputError: there is no dataset, or it has no recordings whose clock was right.
    """
    latest_ns = (clock or SystemClock()).now_ns() + _CLOCK_SLACK_NS
    description = read_description(root)
    estimates = [name for name in _ESTIMATES if name in description.estimates]
    dataset = _read_files(root, estimates, where, latest_ns)
    rows, notes = dataset.rows, dataset.notes
    if not rows:
        raise _without_rows(root, dataset, where)
    if odometer is not None:
        odometer = {partition_name(name): readings for name, readings in odometer.items()}
        notes += [
            Reason(FleetCode.TREND_VEHICLE_WITHOUT_ODOMETER, vehicle=vehicle_name)
            for vehicle_name in sorted({vehicle for vehicle, _, _ in rows})
            if vehicle_name not in odometer
        ]
    unknown = [tire_rows for (vehicle, _, sensor), tire_rows in rows.items() if not is_identified(vehicle, sensor)]
    if unknown:
        recordings = len({row["path"] for tire_rows in unknown for row in tire_rows})
        notes.append(Reason(FleetCode.TREND_TIRES_UNIDENTIFIED, recordings=recordings))
    omitted = _leave_out_repeats(dataset)
    tires = [_history(key, rows[key], estimates, odometer) for key in sorted(rows)]
    tires.sort(key=lambda tire: (tire.vehicle, tire.position, int(tire.time_ns[0])))
    failures = sum(1 for _ in (root / FAILURES).glob("*.parquet"))
    return DatasetHistories(tuple(tires), len(dataset.recording_ids - omitted), failures, tuple(notes))


class _Files(NamedTuple):
    """Rows of the files by vehicle, position and sensor; rows before the filter, and recordings of a wrong clock."""

    rows: dict[tuple[str, str, str], list[Row]]
    notes: list[Reason]
    recording_ids: set[str]
    rows_unfiltered: int
    of_wrong_clock: int


def _read_files(root: Path, estimates: Sequence[str], where: RunFilter, latest_ns: int) -> _Files:
    names = [*_PLAIN, *(name + part for name in estimates for part in ("", "_std", "_status", "_reason"))]
    rows: dict[tuple[str, str, str], list[Row]] = defaultdict(list)
    notes: list[Reason] = []
    recording_ids: set[str] = set()
    row_count = of_wrong_clock = 0
    for path in sorted((root / RECORDINGS).glob("*/*/*.parquet")):
        key = Key.of_name(path.name)
        if key is None or key.recording_id in recording_ids:
            notes.append(Reason(FleetCode.TREND_FILE_LEFT_OUT, why="foreign", path=str(path)))
            continue
        file_rows = read_rows(path, names, _NEEDED)
        if file_rows is None:
            notes.append(Reason(FleetCode.TREND_FILE_LEFT_OUT, why="unreadable", path=str(path)))
            continue
        row_count += len(file_rows)
        file_rows = [row for row in file_rows if not where.conditions or where.matches(_run(row), _POSITION)]
        if where.conditions and not file_rows:
            continue
        vehicle = unquote(path.parent.parent.name.removeprefix("vehicle="))
        recording_ids.add(key.recording_id)
        if file_rows and not _EARLIEST_NS <= file_rows[0]["start_utc"] <= latest_ns:
            date = str(np.datetime64(file_rows[0]["start_utc"], "ns").astype("datetime64[D]"))
            notes.append(Reason(FleetCode.TREND_CLOCK_WRONG, path=str(file_rows[0]["path"]), date=date))
            of_wrong_clock += 1
            continue
        for row in file_rows:
            rows[vehicle, str(row["position"]), str(row["sensor_id"] or "")].append(row)
    return _Files(rows, notes, recording_ids, row_count, of_wrong_clock)


def _without_rows(root: Path, dataset: _Files, where: RunFilter) -> OutputError:
    """Return why a dataset has no rows for trends."""
    count, of_wrong_clock = len(dataset.recording_ids), dataset.of_wrong_clock
    if where.conditions and dataset.rows_unfiltered and not of_wrong_clock:
        return OutputError(
            f"no recording of the dataset '{root}' fits {where}", "Its columns test, driver and tags say what there is."
        )
    if of_wrong_clock:
        others = f"; in the other {count - of_wrong_clock} no wheel sent samples" if of_wrong_clock < count else ""
        return OutputError(
            f"the clock was wrong in all recordings of the dataset '{root}' that have samples: {of_wrong_clock} began "
            f"before March 2000 or after now{others}",
            "Set the clock of the recorder, or of this computer.",
        )
    if count:
        return OutputError(
            f"in no recording of the dataset '{root}' has a wheel sent samples: {count} are without a row",
            "`treadlink inspect` shows what a recording contains.",
        )
    return OutputError(f"the dataset '{root}' has no recordings", "Add some: treadlink campaign PATH... --out DATASET")


def _leave_out_repeats(dataset: _Files) -> set[str]:
    """Leave out drives that several recordings hold, with a note; return the identities of recordings without a row."""
    repeated: dict[str, Reason] = {}
    distinct: set[str] = set()
    for tire, tire_rows in dataset.rows.items():
        if is_identified(tire[0], tire[2]):
            dataset.rows[tire], repeats = without_repeats(tire_rows)
            for repeat, original in repeats:
                pair = Reason(FleetCode.TREND_REPEATS, path=str(repeat["path"]), other=str(original["path"]))
                repeated.setdefault(str(repeat["recording_id"]), pair)
        distinct |= {str(row["recording_id"]) for row in dataset.rows[tire]}
    if repeated:
        pairs = tuple(repeated.values())[:_NAMED_REPEATS]
        dataset.notes.append(Reason(FleetCode.TREND_REPEATED, count=len(repeated), pairs=pairs))
    return repeated.keys() - distinct


def read_odometer(path: Path) -> Odometer:
    """Read a CSV file with the columns vehicle, utc and km; between two readings the distance is interpolated.

    Raises:
        ConfigError: the file cannot be read.
        RecordingError: a line is wrong.
    """
    points_by_vehicle: dict[str, list[tuple[int, float]]] = defaultdict(list)
    try:
        lines = csv.DictReader(
            io.StringIO(read_text(path, "the odometer file", max_bytes=_MAX_ODOMETER_BYTES), newline="")
        )
        missing = [name for name in _ODOMETER_COLUMNS if name not in (lines.fieldnames or ())]
        if missing:
            raise RecordingError(
                f"'{path}' has no column {', '.join(missing)}", f"Its header must be {','.join(_ODOMETER_COLUMNS)}."
            )
        for line in lines:
            try:
                time_ns = _odometer_ns(str(line["utc"] or "").strip())
                km = float(line["km"])
            except (ValueError, TypeError) as error:
                raise RecordingError(
                    f"'{path}', line {lines.line_num}: {error}",
                    "A line is such as: truck 7,2026-01-31T12:00:00Z,20450.5",
                ) from error
            if not math.isfinite(km):
                raise RecordingError(f"'{path}', line {lines.line_num}: km is not a number", "Correct the line.")
            points_by_vehicle[str(line["vehicle"]).strip()].append((time_ns, km))
    except csv.Error as error:
        raise RecordingError(f"'{path}' cannot be read: {error}", "Give a CSV file in UTF-8.") from error
    readings = {}
    for vehicle, points in points_by_vehicle.items():
        points.sort()
        times = np.array([time for time, _ in points], dtype=np.int64)
        km_read = np.array([km for _, km in points])
        if (np.diff(km_read) < 0.0).any():
            raise RecordingError(
                f"'{path}': the distance of vehicle '{vehicle}' decreases with time", "Correct the odometer's readings."
            )
        readings[vehicle] = times, km_read
    return readings


def _odometer_ns(text: str) -> int:
    """Return the time of a reading in ns since the epoch; without an offset it is UTC.

    Raises:
        ValueError: it is no date, as a number such as 20260101 or that of a day in a spreadsheet.
    """
    if not _DATE.fullmatch(text):
        raise ValueError(f"utc is '{text}', which is no date such as 2026-01-31 or 2026-01-31T12:00:00Z")
    time = datetime.fromisoformat(text)
    time = time.replace(tzinfo=UTC) if time.tzinfo is None else time
    if not _FIRST_YEAR <= time.year <= _LAST_YEAR:
        raise ValueError(f"utc is '{text}', but years are from {_FIRST_YEAR} to {_LAST_YEAR}")
    return (time - datetime(1970, 1, 1, tzinfo=UTC)) // timedelta(microseconds=1) * 1000


def _history(
    key: tuple[str, str, str], rows: list[Row], estimates: Sequence[str], odometer: Odometer | None
) -> TireHistory:
    rows.sort(key=lambda row: (row["start_utc"], row["path"]))
    time_ns = np.array([row["start_utc"] for row in rows], dtype=np.int64)
    columns = _number_columns(rows, estimates)
    vehicle, position, sensor_id = key
    readings = odometer.get(vehicle) if odometer is not None else None
    return TireHistory(
        vehicle=vehicle,
        position=position,
        sensor_id=sensor_id,
        recordings=tuple(str(row["recording"]) for row in rows),
        paths=tuple(str(row["path"]) for row in rows),
        time_ns=time_ns,
        km=_km(time_ns, readings, columns["distance_m"]),
        has_odometer=readings is not None,
        columns=columns,
        invalid={name: reason for name in estimates if (reason := _last_reason(rows, name))},
        is_identified=is_identified(vehicle, sensor_id),
        units=ShownUnits(units) if (units := rows[-1].get("shown_units")) in list(ShownUnits) else ShownUnits.SI,
        doubts={name: tuple(_doubt(row, name) for row in rows) for name in estimates},
        alarms=tuple(_alarms(row) for row in rows),
        faults=tuple(_commonest_fault(row) for row in rows),
        stated=_statements(rows),
    )


def _number_columns(rows: Sequence[Row], estimates: Sequence[str]) -> dict[str, FloatArray]:
    """Return the columns of numbers of a tire's rows, NaN where a row has none."""
    numbers = [name for name in _PLAIN if name not in _TEXT] + [
        name + part for name in estimates for part in ("", "_std")
    ]
    columns = {name: _numbers(rows, name) for name in numbers}
    columns["damaged"] = np.array([float(bool(row.get("damage"))) for row in rows])
    columns[AVERAGE_ORDERS.name] = _orders(rows)
    return columns


def _statements(rows: Sequence[Row]) -> dict[Statement, tuple[str, ...]]:
    """Return what was stated for each recording, as texts."""
    return {
        Statement.LOAD: tuple(_as_text(row.get("load_n")) for row in rows),
        Statement.RADIUS: tuple(_as_text(row.get("stated_radius_m")) for row in rows),
        Statement.THICKNESS: tuple(_as_text(row.get("ring_thickness_m")) for row in rows),
        Statement.REFERENCE: tuple(str(row.get("reference") or "") for row in rows),
        Statement.CALIBRATION: tuple(str(row.get("load_calibration") or "") for row in rows),
    }


def _orders(rows: Sequence[Row]) -> FloatArray:
    """Return (n, 2 k) cosines and sines of the averaged waveforms, NaN where there is none."""
    size = 2 * (LAST_ORDER - FIRST_ORDER + 1)
    lists = [_listed(row, AVERAGE_ORDERS.name, float) for row in rows]
    return np.array([values if len(values) == size else [math.nan] * size for values in lists], dtype=np.float64)


def _last_reason(rows: Sequence[Row], name: str) -> str:
    """Return the last reason why a quantity has no value; empty without one."""
    reasons = (row.get(f"{name}_reason") for row in reversed(rows) if row.get(name) is None)
    return str(next(filter(None, reasons), ""))


def _run(row: Row) -> RunDescription:
    """Return the description of a row's run; notes beside the recording may be later than the dataset."""
    run = RunDescription(
        test=str(row.get("test") or ""),
        driver=str(row.get("driver") or ""),
        comment=str(row.get("comment") or ""),
        tags=tuple(map(str, json.loads(row.get("tags") or "[]"))),
        tires={_POSITION: TireIdentity(str(row.get("tire_maker") or ""), str(row.get("tire_dot") or ""))},
    )
    return run.with_notes(read_notes(Path(str(row["path"]))))


def _doubt(row: Row, name: str) -> str:
    """Return why a value is provisional, empty where it is valid or missing."""
    if row.get(f"{name}_status") != Status.PROVISIONAL:
        return ""
    return str(row.get(f"{name}_reason") or Status.PROVISIONAL)


def _alarms(row: Row) -> tuple[tuple[str, str], ...]:
    """Return names and texts of the alarms of a row."""
    return tuple((str(alarm.get("name")), str(alarm.get("text", ""))) for alarm in _listed(row, "alarms"))


def _commonest_fault(row: Row) -> str:
    commonest: dict[str, Any] = max(_listed(row, "faults"), key=lambda fault: int(fault.get("count", 0)), default={})
    return str(commonest.get("text", ""))


def _listed(row: Row, name: str, kind: type = dict) -> list[Any]:
    """Return the entries of a kind of a cell in JSON."""
    try:
        entries = json.loads(row.get(name) or "[]")
    except ValueError:
        return []
    return [entry for entry in entries if isinstance(entry, kind)] if isinstance(entries, list) else []


def _as_text(value: float | None) -> str:
    """Return a stated value as a text that rounding does not change."""
    return "" if value is None else f"{value:.6g}"


def _km(
    time_ns: NDArray[np.int64], readings: tuple[NDArray[np.int64], FloatArray] | None, distance_m: FloatArray
) -> FloatArray:
    """Return the distance at the start of each recording; beyond the readings it goes on as between the last two."""
    if readings is None:
        driven = np.nan_to_num(distance_m)
        return np.asarray((np.cumsum(driven) - driven) * 1e-3, dtype=np.float64)
    times, km = readings
    origin_ns = int(times[0])
    query_ns, reading_ns = (time_ns - origin_ns).astype(np.float64), (times - origin_ns).astype(np.float64)
    km_at = np.interp(query_ns, reading_ns, km)
    if len(reading_ns) > 1:
        for edge, inner, is_outside in ((0, 1, query_ns < reading_ns[0]), (-1, -2, query_ns > reading_ns[-1])):
            step = reading_ns[edge] - reading_ns[inner]
            slope = (km[edge] - km[inner]) / step if step else 0.0
            km_at = np.where(is_outside, km[edge] + slope * (query_ns - reading_ns[edge]), km_at)
    return np.asarray(km_at, dtype=np.float64)


def _numbers(rows: Sequence[Mapping[str, Any]], name: str) -> FloatArray:
    return np.array([math.nan if row.get(name) is None else float(row[name]) for row in rows], dtype=np.float64)
