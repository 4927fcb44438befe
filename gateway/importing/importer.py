"""Import of a measurement file into a recording."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Final

import numpy as np

from firmware_protocol.messages import Axis, Coupling
from gateway.config.vehicle import ASSUMED_RADIUS_MM
from gateway.errors import RecordingError
from gateway.importing.columns import Block, ColumnReader, require_columns
from gateway.importing.data_scan import Scan, scan
from gateway.importing.file_formats import open_columns
from gateway.importing.frames import FrameStream, Quantiser
from gateway.importing.import_map import ImportMap
from gateway.importing.reader_process import ReaderProcesses
from gateway.importing.unit_check import unlikely_unit
from gateway.io.source import Chunk, LinkEvent, LinkEventKind
from gateway.reasons import Reason
from gateway.recording.writer import RecordingWriter
from gateway.types import FloatArray

_logger = logging.getLogger(__name__)

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
class ImportReport:
    """Result of an import.

    Attributes:
        recording: the new file.
        size_bytes: its size.
        position: wheel position in it.
        samples: number of samples imported.
        skipped: rows left out before the start.
        gaps: rows in which an axis has no value, which are gaps between samples.
        rate_hz: sampling rate.
        rate_std_hz: its standard error where the times are rounded, else None.
        rounding_s: step to which the times are rounded, None when they are not.
        duration_s: samples over rate.
        jitter_s: largest deviation of a step of the time column, None without a time column.
        axes: one report per axis, in the protocol's order.
        environment_frames: pressure and temperature messages.
        assumed: assumptions of the map that the results rest on, as kept in the recording's configuration.
        start_is_file_date: whether the file's modification time stands in for the start, which the map does not state.
        findings: contradictions between the map and the measurement.
    """

    recording: Path
    size_bytes: int
    position: str
    samples: int
    skipped: int
    gaps: int
    rate_hz: float
    rate_std_hz: float | None
    rounding_s: float | None
    duration_s: float
    jitter_s: float | None
    axes: tuple[AxisReport, ...]
    environment_frames: int
    assumed: tuple[str, ...]
    start_is_file_date: bool
    findings: tuple[Reason, ...]


def import_file(
    path: Path,
    import_map: ImportMap,
    out: Path,
    progress: Callable[[float], None] = lambda _: None,
    processes: ReaderProcesses | None = None,
) -> ImportReport:
    """Import `path` into the new recording `out`, reading it twice with constant memory.

    Args:
        path: measurement.
        import_map: meaning of its columns.
        out: a new file; or a folder, in which the start time gives the name.
        progress: called with the share done, 0 to 1.
        processes: supply of reader processes, for many files; None for a new process.

    Raises:
        ImportDataError: the measurement does not match the map; nothing was written.
        RecordingError: the recording exists or cannot be written.
    """
    with contextlib.closing(open_columns(path, import_map.file, processes)) as reader:
        require_columns(reader, path, import_map.columns())
        if out.is_file():
            # The writer would reject it too, but only after the first pass.
            raise RecordingError(
                f"'{out}' already exists", "Recordings are never overwritten. Choose another name with --out."
            )
        return _import(path, reader, import_map, out, progress)


def _import(
    path: Path, reader: ColumnReader, import_map: ImportMap, out: Path, progress: Callable[[float], None]
) -> ImportReport:
    found = scan(path, reader, import_map, lambda share: progress(0.5 * share))
    _logger.info("%s: %d rows after the first %d, %g Hz", path, found.samples, found.skipped, found.rate_hz)
    quantiser = Quantiser.of(import_map, found)
    stream = FrameStream(import_map, found, quantiser)
    start_ns = _start_ns(path, import_map)
    link = f"import:{path.name}"
    writer = RecordingWriter(out, start_ns=start_ns, vehicle_toml=import_map.vehicle().to_toml(), sources=(link,))
    try:
        writer.write(LinkEvent(link, start_ns, LinkEventKind.CONNECTED, f"imported from {path.name}"))
        errors_mps2 = np.zeros(len(quantiser.scale_mps2))
        for columns, slow, share in _selected(reader, import_map, found):
            progress(0.5 + 0.5 * share)
            present = np.asarray(np.isfinite(columns).all(axis=1))
            counts = np.zeros(columns.shape, dtype=np.int16)
            if present.any():
                counts[present], block_errors_mps2 = quantiser.counts(columns[present])
                errors_mps2 = np.maximum(errors_mps2, block_errors_mps2)
            for end_s, data in stream.chunks(counts, present, slow):
                writer.write(Chunk(link, start_ns + round(end_s * 1e9), data))
        no_counts = np.empty((0, len(quantiser.scale_mps2)), dtype=np.int16)
        for end_s, data in stream.chunks(no_counts, np.empty(0, dtype=np.bool_), np.empty((0, 2)), last=True):
            writer.write(Chunk(link, start_ns + round(end_s * 1e9), data))
        end_ns = start_ns + round(stream.end_s * 1e9)
        writer.write(LinkEvent(link, end_ns, LinkEventKind.ENDED))
        writer.close()
    except BaseException:
        # A partial import is useless, and the measurement still exists.
        writer.close()
        writer.path.unlink(missing_ok=True)
        raise
    axes = tuple(
        AxisReport(axis, found.low_mps2[axis], found.high_mps2[axis], float(step), float(error))
        for axis, step, error in zip(import_map.axis.present(), quantiser.scale_mps2, errors_mps2, strict=True)
    )
    return ImportReport(
        recording=writer.path,
        size_bytes=writer.path.stat().st_size,
        position=import_map.conditions.position,
        samples=found.samples,
        skipped=found.skipped,
        gaps=found.gaps,
        rate_std_hz=found.rate_std_hz,
        rounding_s=found.rounding_s,
        rate_hz=found.rate_hz,
        duration_s=found.samples / found.rate_hz,
        jitter_s=found.jitter_s,
        axes=axes,
        environment_frames=stream.environment_frames,
        assumed=import_map.assumptions(),
        start_is_file_date=import_map.sampling.start_utc is None,
        findings=_findings(import_map, found),
    )


def _findings(import_map: ImportMap, found: Scan) -> tuple[Reason, ...]:
    radial = import_map.axis.radial
    radius_m = (import_map.conditions.radius_mm or ASSUMED_RADIUS_MM) * 1e-3
    assert radial is not None  # the map requires it
    dc = import_map.sensor.protocol_coupling is Coupling.DC
    finding = unlikely_unit(found.liveliest_mps2, found.rate_hz, radius_m, radial.unit, dc=dc)
    return () if finding is None else (finding,)


def _selected(
    reader: ColumnReader, import_map: ImportMap, found: Scan
) -> Iterator[tuple[FloatArray, FloatArray, float]]:
    """Yield (axis columns, pressure and temperature columns, progress) from the first row to keep."""
    names = import_map.columns()
    use = [names.index(column.column) for column in import_map.axis.present().values()]
    measured = (import_map.environment.pressure_column, import_map.environment.temperature_column)
    for block in reader.blocks(names):
        kept = _rows_to_keep(block, found.skipped)
        if not len(kept):
            continue
        slow = np.full((len(kept), 2), np.nan)
        for k, name in enumerate(measured):
            if name is not None:
                slow[:, k] = kept[:, names.index(name)]
        yield kept[:, use], slow, block.progress


def _rows_to_keep(block: Block, skipped: int) -> FloatArray:
    return block.values[max(skipped - block.first_row, 0) :]


def _start_ns(path: Path, import_map: ImportMap) -> int:
    stated = import_map.sampling.start_utc
    if stated is None:
        return path.stat().st_mtime_ns
    return (stated - _EPOCH) // timedelta(microseconds=1) * 1000
