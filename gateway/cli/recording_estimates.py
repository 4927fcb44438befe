"""Estimates of one recording: rows for the tables, and the lines of its summary."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

from firmware_protocol.counters import LinkCounters
from gateway.cli.estimate_order import EstimateOrder, RecordingEstimated
from gateway.config.vehicle import ASSUMED_RADIUS_MM
from gateway.reasons import Code
from gateway.recording.recorded_file import RawDump, open_recorded_file
from gateway.recording.reference_topic import ReferenceReader
from gateway.session.recording_pass import RecordingPass, open_recording
from gateway.session.reference_check import ReferenceCheck
from gateway.views.drive_page.drive import Drive
from gateway.views.reference_lines import reference_lines
from gateway.views.session_summary import ResultSummary, effects_line, removed_line, summary_lines
from gateway.views.tables.result_table import RowMaker
from gateway.views.tables.row_spool import open_spool
from gateway.views.text import clean
from gateway.views.wording import notice_text


def estimate_to_spools(order: EstimateOrder, on_position: Callable[[int], None]) -> RecordingEstimated:
    """Estimate one recording; its rows go to the files of the order.

    Args:
        order: recording, settings and files.
        on_position: called with the bytes of the file read so far.

    Raises:
        TreadlinkError: the recording, its configuration or the keys cannot be read, or a file cannot be written.
    """
    with contextlib.ExitStack() as stack:
        rows = [
            stack.enter_context(open_spool(path, kind, order.coverage_factor)) for kind, path in order.spools.items()
        ]
        return estimate_recording(order, on_position, rows)


def estimate_recording(
    order: EstimateOrder, on_position: Callable[[int], None], tables: Sequence[RowMaker]
) -> RecordingEstimated:
    """Estimate one recording; see `estimate_to_spools`.

    Args:
        order: recording and settings.
        on_position: called with the bytes of the file read so far.
        tables: take the rows.
    """
    reader = _opened(order.path)
    recording = open_recording(
        reader,
        order.config_path,
        effects_paths=order.effects_paths,
        key_file=order.key_file,
        on_position=on_position,
    )
    vehicle = recording.vehicle
    drive = Drive(order.path.name, reader.info.described_run().lines()) if order.is_drawn else None
    check = ReferenceCheck(reader, vehicle) if isinstance(reader, ReferenceReader) else None
    summary, name = ResultSummary(), order.path.name
    estimation = RecordingPass(recording, order.estimators, signals=recording.signals())
    for result in estimation:
        if check is not None:
            check.add(result)
        summary.add(result)
        if drive is not None:
            drive.add(result)
        for rows in tables:
            rows.write(result, name)
    on_position(reader.info.size_bytes)
    assumed = "" if vehicle is not None else f"  (no configuration: belt radius {ASSUMED_RADIUS_MM:g} mm assumed)"
    lines = [f"{order.path}{assumed}"]
    wheels = summary.wheels(estimation.wheels)
    notices = estimation.notices([wheel.position for wheel in wheels])
    lines += [f"  {clean(notice_text(notice))}" for notice in notices]
    for table in recording.effects:
        effect_names = [effect.name for effect in table.effects]
        for wheel_summary in wheels:
            if wheel_summary.position == table.position:
                lines.append(clean(f"  {effects_line(wheel_summary, effect_names)}"))
                lines += [clean(f"  {line}") for line in (removed_line(wheel_summary, table),) if line]
    comparisons = check.comparisons() if check is not None else ()
    alarms = estimation.alarms()
    for alarm in alarms:
        for rows in tables:
            rows.write_alarm(alarm, name)
    lines += [
        clean(f"  {line}".rstrip()) for line in (*summary_lines(wheels, alarms=alarms), *reference_lines(comparisons))
    ]
    lines += _link_lines(estimation.links)
    missing = estimation.missing()
    for notice in missing:
        lines.append(f"  {clean(notice_text(notice))}")
        if notice.reason.code is Code.NO_REVOLUTION:
            for rows in tables:
                rows.write_missing(notice.subject, notice.reason, name)
    if drive is not None:
        drive.finish(estimation.wheels, alarms, (*notices, *missing))
    return RecordingEstimated(tuple(lines), len(missing), reader.damage, drive)


def _opened(path: Path) -> ReferenceReader | RawDump:
    """Return the recording, or the dump of a link, which has no references."""
    dump = open_recorded_file(path) if path.suffix.lower() == ".bin" else None
    return dump if isinstance(dump, RawDump) else ReferenceReader(path)


def _link_lines(counters: Mapping[str, LinkCounters]) -> Iterator[str]:
    for link, counted in counters.items():
        yield (
            f"  {clean(link)}: {counted.frames} frames, {counted.lost} lost, {counted.crc_errors} with a bad CRC, "
            f"{counted.duplicates} duplicate, {counted.reordered} late"
            + (f", {counted.bad_payload} with a bad payload" if counted.bad_payload else "")
            + (f", {counted.refused} rejected because not verified" if counted.refused else "")
        )
