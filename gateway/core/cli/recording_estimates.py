"""Estimates of one recording: rows for the tables, and the lines of its summary."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from firmware_protocol.counters import LinkCounters
from gateway.core.cli.estimate_outputs import EstimateOutput
from gateway.core.config.vehicle import ASSUMED_RADIUS_MM, shown_units_of
from gateway.core.estimates.registry import DEFAULT_ESTIMATORS
from gateway.core.estimates.wheel_setup import CorrectionTable
from gateway.core.reasons import CoreCode, Reason
from gateway.core.recording.reader import RecordingReader
from gateway.core.recording.recorded_file import RawDump, open_recorded_file
from gateway.core.session.recording_pass import RecordingPass, open_recording
from gateway.core.shown_units import shown_in
from gateway.core.storable_text import storable
from gateway.core.text.result_table import ResultTable
from gateway.core.text.session_summary import (
    ResultSummary,
    WheelSummary,
    columns_of_terminal,
    effects_line,
    removed_line,
    summary_lines,
)
from gateway.core.text.text import clean
from gateway.core.text.wording import notice_text


@dataclass(frozen=True, slots=True)
class RecordingEstimated:
    """End of the work on one recording; its rows are written.

    Attributes:
        lines: summary.
        missing: number of links and wheels without a result.
        damage: unreadable parts, None without any.
    """

    lines: tuple[str, ...]
    missing: int
    damage: Reason | None


def estimate_recording(
    path: Path,
    on_position: Callable[[int], None],
    tables: Sequence[ResultTable] = (),
    *,
    config_path: Path | None,
    effects_paths: Sequence[Path],
    key_file: Path | None,
    estimators: Sequence[str],
    outputs: Sequence[EstimateOutput],
) -> RecordingEstimated:
    """Estimate one recording.

    Args:
        path: the recording.
        on_position: called with the bytes of the file read so far.
        tables: take the rows.
        config_path: vehicle configuration, None to use the recorded one.
        effects_paths: files of known effects.
        key_file: keys of signed frames, None for the user's.
        estimators: names from the registry, none for the default ones.
        outputs: of features, which collect what they need of the recording.

    Raises:
        TreadlinkError: the recording, its configuration or the keys cannot be read, or a table cannot be written.
    """
    reader = _opened(path)
    recording = open_recording(
        reader, config_path, effects_paths=effects_paths, key_file=key_file, on_position=on_position
    )
    vehicle = recording.vehicle
    collectors = [output.begin(reader, vehicle) for output in outputs]
    summary, name = ResultSummary(), storable(path.name)
    estimation = RecordingPass(recording, estimators or DEFAULT_ESTIMATORS, signals=recording.signals())
    for block in estimation.blocks():
        for result in block.results:
            summary.add(result)
            for collector in collectors:
                collector.add(result)
        for table in tables:
            table.write(block, name)
    on_position(reader.info.size_bytes)
    assumed = "" if vehicle is not None else f"  (no configuration: belt radius {ASSUMED_RADIUS_MM:g} mm assumed)"
    lines = [f"{path}{assumed}"]
    wheels = summary.wheels(estimation.wheels)
    notices = estimation.notices([wheel.position for wheel in wheels])
    alarms, missing = estimation.alarms(), estimation.missing()
    for table in tables:
        for alarm in alarms:
            table.write_alarm(alarm, name)
        for notice in missing:
            if notice.reason.code is CoreCode.NO_REVOLUTION:
                table.write_missing(notice.subject, notice.reason, name)
    with shown_in(shown_units_of(vehicle)):
        details = [notice_text(notice) for notice in notices]
        details += _effect_lines(recording.effects, wheels)
        details += summary_lines(wheels, alarms=alarms, columns=columns_of_terminal())
        for collector in collectors:
            details += collector.finish(estimation.wheels, alarms, (*notices, *missing))
        details += _link_lines(estimation.links)
        details += [notice_text(notice) for notice in missing]
    lines += [clean(f"  {line}".rstrip()) for line in details]
    return RecordingEstimated(tuple(lines), len(missing), reader.damage)


def _opened(path: Path) -> RecordingReader | RawDump:
    """Return the recording, or the dump of a link."""
    dump = open_recorded_file(path) if path.suffix.lower() == ".bin" else None
    return dump if isinstance(dump, RawDump) else RecordingReader(path)


def _effect_lines(effects: Sequence[CorrectionTable], wheels: Sequence[WheelSummary]) -> Iterator[str]:
    """Yield the known effects of each wheel, and what of them was not subtracted."""
    for corrections in effects:
        for wheel in wheels:
            if wheel.position == corrections.position:
                yield effects_line(wheel, [effect.name for effect in corrections.effects])
                yield from filter(None, (removed_line(wheel, corrections),))


def _link_lines(counters: Mapping[str, LinkCounters]) -> Iterator[str]:
    for link, counted in counters.items():
        yield (
            f"{link}: {counted.frames} frames, {counted.lost} lost, {counted.crc_errors} with a bad CRC, "
            f"{counted.duplicates} duplicate, {counted.reordered} late"
            + (f", {counted.bad_payload} with a bad payload" if counted.bad_payload else "")
            + (f", {counted.refused} rejected because not verified" if counted.refused else "")
        )
