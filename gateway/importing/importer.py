"""Import of a measurement file into a recording."""

import contextlib
import heapq
import logging
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from firmware_protocol.messages import Axis, Coupling
from gateway.core.config.vehicle import ASSUMED_RADIUS_MM, VehicleConfig
from gateway.core.errors import ImportDataError
from gateway.core.links.source import Chunk, LinkEvent, LinkEventKind
from gateway.core.reasons import Reason
from gateway.core.recording.container import refuse_existing
from gateway.core.recording.writer import RecordingWriter, whole_recording
from gateway.core.types import BoolArray, FloatArray, IntArray
from gateway.importing.column_names import unit_of
from gateway.importing.columns import BlockReader, FileFacts, require_columns
from gateway.importing.data_scan import Scan, WheelScan, scan
from gateway.importing.decimation import ATTENUATION_DB, RIPPLE_DB, Decimation
from gateway.importing.file_formats import open_columns
from gateway.importing.frames import FrameStream, Quantiser
from gateway.importing.import_map import (
    ACCELERATION_UNITS_MPS2,
    ISO,
    PRESSURE_UNITS_PA,
    REFERENCE_UNITS,
    TEMPERATURE_UNITS,
    TIME_UNITS_S,
    ImportedWheel,
    ImportMap,
)
from gateway.importing.joined_columns import JoinedColumns
from gateway.importing.missing_rows import GapFilledColumns
from gateway.importing.reader_process import ReaderProcesses
from gateway.importing.reasons import ImportCode
from gateway.importing.reference_channels import ReferenceChannel
from gateway.importing.reference_topic import reference_topic
from gateway.importing.sample_rows import SampleRows, WheelColumns, kept_rows
from gateway.importing.sensor_groups import require_one_sensor
from gateway.importing.unit_check import unlikely_unit

_logger = logging.getLogger(__name__)

# As the vehicle file allows them.
_LOADS_N: Final = (50.0, 100_000.0)
_MAX_LOAD_STD_N: Final = 50_000.0
# Hidden files, and the index that LabVIEW keeps beside each of its files.
_NO_PART: Final = re.compile(r"[._].*|.*\.tdms_index", re.IGNORECASE)
_EPOCH: Final = datetime(1970, 1, 1, tzinfo=UTC)


@dataclass(frozen=True, slots=True)
class AxisReport:
    """One imported axis.

    Attributes:
        axis: axis of the sensor.
        low_mps2: smallest value, in the protocol's direction.
        high_mps2: largest value.
        step_mps2: quantisation step.
        error_mps2: largest quantisation error that occurred.
    """

    axis: Axis
    low_mps2: float
    high_mps2: float
    step_mps2: float
    error_mps2: float


@dataclass(frozen=True, slots=True)
class WheelReport:
    """One imported wheel.

    Attributes:
        position: wheel position in the recording.
        gaps: samples in which an axis has no value.
        bridged: samples on straight lines that bridge gaps; they are left out.
        bridges: number of these lines.
        left_out: samples that the time column skips, which are gaps too.
        axes: one report per axis, in the protocol's order.
        environment_frames: pressure and temperature messages.
        findings: contradictions between the map and the measurement.
    """

    position: str
    gaps: int
    bridged: int
    bridges: int
    left_out: int
    axes: tuple[AxisReport, ...]
    environment_frames: int
    findings: tuple[Reason, ...]


@dataclass(frozen=True, slots=True)
class ImportReport:
    """Result of an import.

    Attributes:
        recording: the new file.
        size_bytes: its size.
        samples: number of samples of each wheel.
        skipped: rows left out before the start.
        left_out: samples that the time column skips in the rows of all wheels.
        unreadable: cells that are no numbers, taken for missing values as the map states.
        rate_hz: sampling rate of the recording.
        decimation: reduction of the file's rate, None where it is kept.
        rate_std_hz: standard error of the rate where the times are rounded, else None.
        rounding_s: step to which the times are rounded, None when they are not.
        duration_s: samples over rate.
        jitter_s: largest deviation of a step of the time column, None without a time column.
        wheels: one report per wheel.
        references: number of values of each reference, by its name.
        assumed: assumptions of the map that the results rest on, as kept in the recording's configuration.
        start_is_file_date: whether the file's modification time stands in for the start, which neither the map nor the
            file states.
    """

    recording: Path
    size_bytes: int
    samples: int
    skipped: int
    left_out: int
    unreadable: int
    rate_hz: float
    decimation: Decimation | None
    rate_std_hz: float | None
    rounding_s: float | None
    duration_s: float
    jitter_s: float | None
    wheels: tuple[WheelReport, ...]
    references: dict[str, int]
    assumed: tuple[str, ...]
    start_is_file_date: bool


def import_file(
    path: Path | Sequence[Path],
    import_map: ImportMap,
    out: Path,
    progress: Callable[[float], None] = lambda _: None,
    processes: ReaderProcesses | None = None,
) -> ImportReport:
    """Import `path` into the new recording `out`, reading it twice with constant memory.

    Args:
        path: measurement; or its files in the order of time, where several make up one.
        import_map: meaning of its columns.
        out: a new file; or a folder, in which the start time gives the name.
        progress: called with the share done, 0 to 1.
        processes: supply of reader processes, for many files; None for a new process.

    Raises:
        ImportDataError: the measurement does not match the map; nothing was written.
        RecordingError: the recording exists or cannot be written.
    """
    paths = (path,) if isinstance(path, Path) else tuple(path)
    paths = parts_of(paths[0]) if len(paths) == 1 else paths
    if import_map.file.sensor_column is not None:
        return _import_sensors(paths, import_map, out, progress)
    with contextlib.closing(_opened(paths, import_map, processes)) as reader:
        if not out.is_dir():
            refuse_existing(out)  # the writer would too, but only after the first pass
        return _import(paths, GapFilledColumns(paths[0], reader, import_map.sampling), import_map, out, progress)


def parts_of(path: Path) -> tuple[Path, ...]:
    """Return the files of a folder in the order of the numbers in their names, or the file itself.

    Raises:
        ImportDataError: the folder has no files, or files of several kinds.
    """
    if not path.is_dir():
        return (path,)
    files = [entry for entry in path.iterdir() if entry.is_file() and not _NO_PART.fullmatch(entry.name)]
    kinds = sorted({file.suffix.lower() for file in files})
    if len(kinds) != 1:
        kinds_text = ", ".join(kinds) or "nothing"
        raise ImportDataError(
            f"{path} is a folder of several kinds of files: {kinds_text}" if kinds else f"{path} is an empty folder",
            "Give the files of one measurement, in the order of time.",
        )
    return tuple(sorted(files, key=lambda file: [int(p) if p.isdigit() else p for p in re.split(r"(\d+)", file.name)]))


def _import_sensors(
    paths: Sequence[Path], import_map: ImportMap, out: Path, progress: Callable[[float], None]
) -> ImportReport:
    """Import a file whose rows are of the sensors that a column states."""
    path, time_column = paths[0], import_map.sampling.time_column
    if len(paths) > 1:
        raise ImportDataError(f"{path}: several files have a sensor_column", "Join their lines to one file.")
    with contextlib.ExitStack() as stack:
        starts: list[float] = []
        wheels = []
        for wheel in import_map.wheels():
            reader = open_columns(path, import_map, rows_of=(import_map.file.sensor_column or "", wheel.sensor or ""))
            stack.callback(reader.close)
            references = tuple(
                reference.model_copy(update={"wheels": (wheel.position,)})
                for reference in import_map.reference
                if not reference.wheels or wheel.position in reference.wheels
            )
            part = import_map.model_copy(update={"wheel": (wheel,), "reference": references})
            require_columns(reader, path, part.columns())
            first = reader.sample([time_column or wheel.radial.column])
            if first is None:
                raise ImportDataError(
                    f"{path}: no row has '{wheel.sensor}' in column '{import_map.file.sensor_column}'",
                    f"Check the sensor of wheel {wheel.position}.",
                )
            starts.append(_first_s(first.values[:, 0], import_map) + _dated_s(reader, import_map))
            wheels.append((reader, part))
        zero_s = min(starts)
        rows = [WheelRows(reader, part, start - zero_s) for (reader, part), start in zip(wheels, starts, strict=True)]
        facts = wheels[starts.index(zero_s)][0].facts
        start_ns, start_is_file_date = _stated_start_ns(path, facts, import_map)
        if not start_is_file_date and import_map.sampling.start_utc is None:
            start_ns += round(import_map.sampling.start_s * 1e9)
        return import_wheels(path, rows, import_map, start_ns, out, progress, start_is_file_date=start_is_file_date)


def _first_s(times: FloatArray, import_map: ImportMap) -> float:
    """Return the first time in s, 0 where rows have no times."""
    finite = times[np.isfinite(times)]
    if import_map.sampling.time_column is None or not len(finite):
        return 0.0
    return float(finite[0]) * TIME_UNITS_S[import_map.sampling.time_unit]


def _dated_s(reader: BlockReader, import_map: ImportMap) -> float:
    """Return the zero of a column of dates in s since 1970: each sensor counts from its own first row."""
    return (reader.facts.dates.get(import_map.sampling.time_column or "") or 0) * 1e-9


def _opened(paths: Sequence[Path], import_map: ImportMap, processes: ReaderProcesses | None) -> BlockReader:
    if len(paths) == 1:
        reader = open_columns(paths[0], import_map, processes)
        require_columns(reader, paths[0], import_map.columns())
        require_one_sensor(paths[0], reader.facts, import_map.wheels())
        return reader
    supply = processes or ReaderProcesses()
    return JoinedColumns(paths, lambda path: open_columns(path, import_map, supply), import_map)


class _WheelStream:
    """Frames of one wheel, and its report."""

    def __init__(
        self, import_map: ImportMap, wheel: ImportedWheel, number: int, file_scan: Scan, hub_wheel: int, begin_s: float
    ) -> None:
        self._wheel = wheel
        self._scan = file_scan.wheels[number]
        self._quantiser = Quantiser.of(wheel, self._scan)
        self._stream = FrameStream(import_map.sensor, wheel, hub_wheel, file_scan.rate_hz, self._quantiser, begin_s)
        self._errors_mps2 = np.zeros(len(self._quantiser.scale_mps2))
        self._lines, self._findings = _bridges(self._scan)
        self._findings += _unit_findings(import_map, wheel, self._scan, file_scan.rate_hz)
        self._findings += () if number else _rate_findings(import_map, file_scan)  # wheels share their times
        if (repeats := self._scan.held) is not None:
            names = [axis.name.lower() for axis in wheel.axis.present()]
            self._findings += (
                Reason(
                    ImportCode.VALUES_REPEATED,
                    samples=repeats.samples,
                    runs=repeats.runs,
                    axes=", ".join(names[index] for index in repeats.axes),
                    first_s=repeats.first / file_scan.source_rate_hz,
                ),
            )
        self._rows = 0

    @property
    def end_s(self) -> float:
        """End of the last sample, in s from the first."""
        return self._stream.end_s

    def chunks(self, rows: FloatArray, columns: WheelColumns, *, last: bool) -> Iterator[tuple[float, bytes]]:
        """Yield (end in s, bytes) of the chunks that n more rows complete."""
        values_mps2 = rows[:, columns.axes]
        present = np.asarray(np.isfinite(values_mps2).all(axis=1)) & ~self._is_bridged(len(rows))
        counts = np.zeros(values_mps2.shape, dtype=np.int16)
        if present.any():
            counts[present], block_errors_mps2 = self._quantiser.counts(values_mps2[present])
            self._errors_mps2 = np.maximum(self._errors_mps2, block_errors_mps2)
        slow = np.full((len(rows), 2), np.nan)
        for k, column in enumerate(columns.slow):
            if column is not None:
                slow[:, k] = rows[:, column]
        yield from self._stream.chunks(counts, present, slow, last=last)

    def _is_bridged(self, count: int) -> BoolArray:
        """Return (count,) which of the next rows lie on straight lines between samples."""
        result = np.zeros(count, dtype=np.bool_)
        begin = self._rows
        self._rows += count
        first = np.searchsorted(self._lines[:, 1], begin, side="right")
        last = np.searchsorted(self._lines[:, 0], self._rows, side="left")
        for start, stop in self._lines[first:last].tolist():
            result[max(start - begin, 0) : stop - begin] = True
        return result

    def report(self, left_out: int) -> WheelReport:
        """Return the report of the wheel, of whose rows some are left out."""
        wheel_scan = self._scan
        axes = zip(self._wheel.axis.present(), self._quantiser.scale_mps2, self._errors_mps2, strict=True)
        return WheelReport(
            position=self._wheel.position,
            gaps=wheel_scan.gaps,
            bridged=int((self._lines[:, 1] - self._lines[:, 0]).sum()),
            bridges=len(self._lines),
            left_out=left_out,
            axes=tuple(
                AxisReport(axis, wheel_scan.low_mps2[axis], wheel_scan.high_mps2[axis], float(step), float(error))
                for axis, step, error in axes
            ),
            environment_frames=self._stream.environment_frames,
            findings=self._findings,
        )


class WheelRows(NamedTuple):
    """A wheel with rows of its own.

    Attributes:
        reader: its rows.
        import_map: their meaning, for this wheel alone.
        begin_s: time of the first row from the start of the recording.
    """

    reader: BlockReader
    import_map: ImportMap
    begin_s: float


class _Part:
    """Wheels that share their rows, and the references beside them."""

    def __init__(
        self,
        path: Path,
        reader: GapFilledColumns,
        import_map: ImportMap,
        progress: Callable[[float], None],
        *,
        first_wheel: int = 0,
        begin_s: float = 0.0,
    ) -> None:
        """Read the rows once."""
        _check_dates(path, reader, import_map)
        self.reader, self.import_map, self.begin_s = reader, import_map, begin_s
        self.scan = scan(path, reader, import_map, progress)
        _logger.info(
            "%s: %d rows after the first %d, %g Hz", path, self.scan.samples, self.scan.skipped, self.scan.rate_hz
        )
        self.streams = [
            _WheelStream(import_map, wheel, number, self.scan, first_wheel + number, begin_s)
            for number, wheel in enumerate(import_map.wheels())
        ]
        self._channels = [
            ReferenceChannel(reference, self.scan.source_rate_hz, *map(float, limits))
            for reference, limits in zip(import_map.reference, self.scan.ranges, strict=True)
        ]
        self.values = dict.fromkeys((reference.name for reference in import_map.reference), 0)

    @property
    def end_s(self) -> float:
        """Time of the end of the last sample from the start of the recording."""
        return self.begin_s + max(stream.end_s for stream in self.streams)

    def writes(
        self, writer: RecordingWriter, link: str, progress: Callable[[float], None]
    ) -> Iterator[tuple[float, Callable[[int], None]]]:
        """Yield (time in s from the start of the recording, what writes it) of chunks and values, in order."""
        for values, rows, places, share, last in _selected(self.reader, self.import_map, self.scan):
            if not last:
                progress(share)
            parts: list[Iterator[tuple[float, Callable[[int], None]]]] = [
                _written(writer, link, stream.chunks(rows, columns, last=last))
                for stream, columns in zip(self.streams, places, strict=True)
            ]
            for channel in self._channels:
                column = values[:, self.import_map.columns().index(channel.reference.column)]
                positions = _positions(channel, self.import_map)
                parts.append(_written_values(writer, channel, positions, self.values, column, self.begin_s))
            for time_s, write in heapq.merge(*parts, key=lambda part: part[0]):
                yield self.begin_s + time_s, write


def _import(
    paths: Sequence[Path], reader: GapFilledColumns, import_map: ImportMap, out: Path, progress: Callable[[float], None]
) -> ImportReport:
    path = paths[0]
    part = _Part(path, reader, import_map, lambda share: progress(0.5 * share))
    start_ns, start_is_file_date = _start_ns(path, reader.facts, import_map, part.scan)
    suffix = f" and {len(paths) - 1} more" if len(paths) > 1 else ""
    return _recorded([part], import_map, path, suffix, start_ns, out, progress, start_is_file_date=start_is_file_date)


def import_wheels(
    path: Path,
    wheels: Sequence[WheelRows],
    whole: ImportMap,
    start_ns: int,
    out: Path,
    progress: Callable[[float], None] = lambda _: None,
    *,
    start_is_file_date: bool = False,
) -> ImportReport:
    """Import wheels that have rows of their own, at times of one clock, into the new recording `out`.

    Args:
        path: file, for messages.
        wheels: at least one.
        whole: map of all wheels, for the configuration.
        start_ns: start of the recording, ns since 1970.
        out: a new file, or a folder.
        progress: called with the share done, 0 to 1.
        start_is_file_date: whether the start is the modification time of the file.

    Raises:
        ImportDataError: the rows do not fit together.
        RecordingError: the recording exists or cannot be written.
    """
    if not out.is_dir():
        refuse_existing(out)
    count = len(wheels)
    parts = [
        _Part(
            path,
            GapFilledColumns(path, rows.reader, rows.import_map.sampling),
            rows.import_map,
            lambda share, number=number: progress(0.5 * (number + share) / count),  # type: ignore[misc]
            first_wheel=number,
            begin_s=rows.begin_s,
        )
        for number, rows in enumerate(wheels)
    ]
    return _recorded(parts, whole, path, "", start_ns, out, progress, start_is_file_date=start_is_file_date)


def _recorded(
    parts: Sequence[_Part],
    whole: ImportMap,
    path: Path,
    suffix: str,
    start_ns: int,
    out: Path,
    progress: Callable[[float], None],
    *,
    start_is_file_date: bool,
) -> ImportReport:
    """Write the recording, the second half of the work, and return the report."""
    link, vehicle = f"import:{path.name}", _vehicle(parts, whole)
    recording = RecordingWriter(out, start_ns=start_ns, vehicle_toml=vehicle.to_toml(), sources=(link,), in_part=True)
    with whole_recording(recording) as writer:
        writer.write(LinkEvent(link, start_ns, LinkEventKind.CONNECTED, f"imported from {path.name}{suffix}"))
        writes = [part.writes(writer, link, lambda share: progress(0.5 + 0.5 * share)) for part in parts]
        for time_s, write in heapq.merge(*writes, key=lambda timed_write: timed_write[0]):
            write(start_ns + round(time_s * 1e9))
        end_ns = start_ns + round(max(part.end_s for part in parts) * 1e9)
        writer.write(LinkEvent(link, end_ns, LinkEventKind.ENDED))
    longest_part = max(parts, key=lambda part: part.scan.samples / part.scan.rate_hz)
    file_scan = longest_part.scan
    return ImportReport(
        recording=writer.path,
        size_bytes=writer.path.stat().st_size,
        samples=file_scan.samples,
        skipped=file_scan.skipped,
        left_out=sum(part.reader.left_out for part in parts),
        unreadable=sum(part.reader.unreadable for part in parts),
        rate_std_hz=file_scan.rate_std_hz,
        rounding_s=file_scan.rounding_s,
        rate_hz=file_scan.rate_hz,
        decimation=file_scan.decimation,
        duration_s=file_scan.samples / file_scan.rate_hz,
        jitter_s=file_scan.jitter_s,
        wheels=tuple(stream.report(part.reader.left_out) for part in parts for stream in part.streams),
        references={
            reference.name: sum(part.values.get(reference.name, 0) for part in parts) for reference in whole.reference
        },
        assumed=vehicle.vehicle.assumed,
        start_is_file_date=start_is_file_date,
    )


def _vehicle(parts: Sequence[_Part], whole: ImportMap) -> VehicleConfig:
    """Return the configuration with what all parts show: shortcomings, the rounding of times, and mean loads."""
    assumed: list[str] = []
    loads_n: dict[str, tuple[float, float]] = {}
    for part in parts:
        assumed += _shortcomings(part.reader.facts, part.import_map)
        assumed += [] if part.scan.decimation is None else [_decimation_text(part.scan.decimation)]
        loads_n |= _measured_loads_n(part.import_map, part.scan)
    return whole.vehicle(
        tuple(dict.fromkeys(assumed)),
        rounding_std=max((part.scan.rate_std_hz or 0.0) / part.scan.rate_hz for part in parts),
        loads_n=loads_n,
    )


def _check_dates(path: Path, reader: BlockReader, import_map: ImportMap) -> None:
    """Check that a time column of dates is stated as such, and no other."""
    sampling, dates = import_map.sampling, reader.facts.dates
    name = sampling.time_column
    if name is None:
        return
    if name in dates and sampling.time_unit != ISO:
        raise ImportDataError(f"{path}: column '{name}' contains dates", 'State [sampling] time_unit = "iso".')
    if name not in dates and sampling.time_unit == ISO:
        raise ImportDataError(
            f"{path}: column '{name}' contains numbers, no dates",
            'State [sampling] time_unit = "s", "ms", "us" or "ns".',
        )


def _measured_loads_n(import_map: ImportMap, file_scan: Scan) -> dict[str, tuple[float, float]]:
    """Return the mean load of wheels by a column of the rig, with its error: that of the column and its variation."""
    loads = {}
    for reference, (mean, scatter) in zip(import_map.reference, file_scan.means.tolist(), strict=True):
        if reference.quantity != "load" or not np.isfinite(mean):
            continue
        for wheel in import_map.wheels():
            is_assigned = not reference.wheels or wheel.position in reference.wheels
            load_n = abs(mean) * reference.factor
            if is_assigned and wheel.load_n is None and _LOADS_N[0] <= load_n <= _LOADS_N[1]:
                load_std_n = float(np.hypot(scatter, reference.std)) * reference.factor
                loads[wheel.position] = load_n, min(load_std_n, load_n, _MAX_LOAD_STD_N)
    return loads


def _shortcomings(facts: FileFacts, import_map: ImportMap) -> tuple[str, ...]:
    """Return what a file lacks, as texts that are kept with the results."""
    cut = [
        f"the file is cut: '{name}' has {rows} of {expected} samples; only rows that all columns have are used"
        for name, (rows, expected) in facts.cut.items()
        if name in import_map.columns()
    ]
    units = [
        f"'{name}' is in {unit}, as the map says; the file says {file_unit}"
        for name, unit, sizes in _stated_units(import_map)
        if (file_unit := unit_of(name, facts.units.get(name, "")))
        and sizes.get(file_unit.replace("·", "*")) != sizes[unit]
    ]
    return (*cut, *units, *(f"warned when the file was read: {warning}" for warning in facts.warnings))


def _stated_units(import_map: ImportMap) -> Iterator[tuple[str, str, Mapping[str, float]]]:
    """Yield each column whose unit the map states, that unit, and the sizes of all units of its quantity."""
    for axis in import_map.axis_columns():
        if axis.scale == 1.0:
            yield axis.column, axis.unit, ACCELERATION_UNITS_MPS2
    for environment in (wheel.environment for wheel in import_map.wheels()):
        if environment.pressure_column is not None:
            yield environment.pressure_column, environment.pressure_unit, PRESSURE_UNITS_PA
        if environment.temperature_column is not None:
            yield environment.temperature_column, "degC", TEMPERATURE_UNITS
    for reference in import_map.reference:
        if reference.unit is not None:
            yield reference.column, reference.unit, REFERENCE_UNITS[reference.quantity]


def _decimation_text(decimation: Decimation) -> str:
    return (
        f"decimated {decimation.factor} times from {decimation.source_rate_hz:.8g} Hz: a symmetric low-pass of "
        f"{decimation.taps} coefficients, flat within {RIPPLE_DB:g} dB up to {decimation.passband_hz:.6g} Hz, "
        f"{ATTENUATION_DB:g} dB from {decimation.stopband_hz:.6g} Hz on, without delay"
    )


def _written(
    writer: RecordingWriter, link: str, chunks: Iterator[tuple[float, bytes]]
) -> Iterator[tuple[float, Callable[[int], None]]]:
    for end_s, data in chunks:
        yield end_s, lambda host_ns, data=data: writer.write(Chunk(link, host_ns, data))  # type: ignore[misc]


def _written_values(
    writer: RecordingWriter,
    channel: ReferenceChannel,
    positions: tuple[str, ...],
    value_counts: dict[str, int],
    column: FloatArray,
    begin_s: float,
) -> Iterator[tuple[float, Callable[[int], None]]]:
    reference = channel.reference

    def write(host_ns: int, hub_s: float, value: float) -> None:
        value_counts[reference.name] += 1
        for position in positions:
            payload = {"quantity": reference.quantity, "time_s": hub_s, "value": value, "value_std": channel.value_std}
            writer.write_topic(reference_topic(position, reference.name), host_ns, payload)

    for time_s, value in channel.feed(column):
        hub_s = begin_s + time_s
        yield time_s, lambda host_ns, hub_s=hub_s, value=value: write(host_ns, hub_s, value)  # type: ignore[misc]


def _positions(channel: ReferenceChannel, import_map: ImportMap) -> tuple[str, ...]:
    return channel.reference.wheels or tuple(wheel.position for wheel in import_map.wheels())


def _bridges(wheel_scan: WheelScan) -> tuple[IntArray, tuple[Reason, ...]]:
    """Return the (k, 2) lines to leave out, first sample and that after the last, and findings."""
    bridging = wheel_scan.bridging
    if bridging is None:
        return np.empty((0, 2), dtype=np.int64), ()
    if bridging.is_everywhere:
        # Without its lines nothing would remain.
        return np.empty((0, 2), dtype=np.int64), (Reason(ImportCode.SIGNAL_INTERPOLATED, share=bridging.share),)
    return bridging.lines, ()


def _unit_findings(
    import_map: ImportMap, wheel: ImportedWheel, wheel_scan: WheelScan, rate_hz: float
) -> tuple[Reason, ...]:
    radius_m = (import_map.radius_mm(wheel) or ASSUMED_RADIUS_MM) * 1e-3
    dc = import_map.sensor.protocol_coupling is Coupling.DC
    finding = unlikely_unit(wheel_scan.liveliest_mps2, rate_hz, radius_m, wheel.radial.unit, dc=dc)
    return () if finding is None else (finding,)


def _rate_findings(import_map: ImportMap, file_scan: Scan) -> tuple[Reason, ...]:
    """Return that the rate changes by more than the error that the recording states for it."""
    if file_scan.rate_change is None:
        return ()
    low_hz, high_hz, at_s = file_scan.rate_change
    accuracy = import_map.sampling.accuracy((file_scan.rate_std_hz or 0.0) / file_scan.rate_hz)
    if high_hz / low_hz - 1.0 <= 1e-2 * accuracy.rate_std_percent:
        return ()
    return (Reason(ImportCode.RATE_CHANGES, low_hz=low_hz, high_hz=high_hz, at_s=at_s),)


def _selected(
    reader: BlockReader, import_map: ImportMap, file_scan: Scan
) -> Iterator[tuple[FloatArray, FloatArray, list[WheelColumns], float, bool]]:
    """Yield consecutive rows: of the file, and in physical units at the rate of the recording.

    With them come the places of the wheels' columns, the progress, and whether they are the last.
    """
    names = import_map.columns()
    rows = SampleRows(import_map, file_scan.decimation.factor if file_scan.decimation else 1)
    for block in reader.blocks(names):
        values = kept_rows(block, file_scan.skipped)
        if len(values):
            yield values, rows.feed(values), rows.wheels, block.progress, False
    yield np.empty((0, len(names))), rows.finish(len(names)), rows.wheels, 1.0, True


def _start_ns(path: Path, facts: FileFacts, import_map: ImportMap, file_scan: Scan) -> tuple[int, bool]:
    """Return the time of the first sample, and whether it is the modification time of the file."""
    start_ns, is_file_date = _stated_start_ns(path, facts, import_map)
    sampling = import_map.sampling
    if is_file_date or sampling.start_utc is not None:
        return start_ns, is_file_date
    if facts.zero_ns(sampling.time_column) is not None:
        offset_s = file_scan.first_s
    else:
        # Channels of one step begin at the last of their starts.
        names = import_map.columns()
        step_s = facts.steps_s.get(names[0])
        offset_s = max(facts.starts_s.get(name, 0.0) for name in names if facts.steps_s.get(name) == step_s)
    return start_ns + round((file_scan.skipped / file_scan.source_rate_hz + offset_s) * 1e9), False


def _stated_start_ns(path: Path, facts: FileFacts, import_map: ImportMap) -> tuple[int, bool]:
    """Return the start that the map or the file states, or its modification time, and whether it is the latter."""
    sampling = import_map.sampling
    if sampling.start_utc is not None:
        return (sampling.start_utc - _EPOCH) // timedelta(microseconds=1) * 1000, False
    begin_ns = facts.dates.get(sampling.time_column or "", facts.start_ns)
    return (path.stat().st_mtime_ns, True) if begin_ns is None else (begin_ns, False)
