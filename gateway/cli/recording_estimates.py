"""Estimates of one recording: rows for the tables, and the lines of its summary."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from firmware_protocol.block_decoder import FrameBatch
from firmware_protocol.counters import LinkCounters
from gateway.cli.estimate_order import EstimateOrder, RecordingEstimated
from gateway.config.effects_file import effects_doubts
from gateway.config.vehicle import ASSUMED_RADIUS_MM, choose_vehicle
from gateway.pipeline.results import RevolutionResult, WheelSnapshot
from gateway.reasons import Code
from gateway.recording.reader import RecordingReader
from gateway.recording.reference_topic import ReferenceItems
from gateway.security.guard import open_guard
from gateway.session.batch_alarms import BatchAlarms
from gateway.session.batch_estimation import estimate_items
from gateway.session.effects_opening import open_effects
from gateway.session.missing_results import FrameCounts, missing_frames, missing_revolutions
from gateway.session.reference_check import ReferenceCheck
from gateway.session.signal_decoding import open_decoder
from gateway.session.statement_watch import StatementWatch
from gateway.session.wheel_identity import SensorsHeard, positions
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
        rows = [stack.enter_context(open_spool(path, kind)) for kind, path in order.spools.items()]
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
    reader = RecordingReader(order.path)
    vehicle = choose_vehicle(order.config_path, [reader.vehicle_toml], str(order.path))
    guard = open_guard(vehicle, order.key_file, remembers=False)
    effects = open_effects(order.effects_paths, vehicle)
    summary, sensors, alarms = ResultSummary(), SensorsHeard(), BatchAlarms(vehicle)
    watch = StatementWatch(positions(vehicle))
    states: list[WheelSnapshot] = []
    check = ReferenceCheck(ReferenceItems(reader), vehicle)
    name = order.path.name

    def take(result: RevolutionResult) -> None:
        check.add(result)
        summary.add(result)
        for table in tables:
            table.write(result, name)

    def on_batch(link: str, batch: FrameBatch, _: NDArray[np.int64]) -> None:
        sensors.take(batch)
        watch.batch(link, batch)

    counters = estimate_items(
        check,
        vehicle,
        take,
        estimators=order.estimators,
        on_bytes=lambda _: on_position(reader.position),
        guard=guard,
        on_batch=on_batch,
        on_wheels=states.extend,
        effects=effects,
        alarms=alarms,
        signals=open_decoder(vehicle, order.config_path, (), [reader.dbc_text]),
    )
    on_position(reader.info.size_bytes)
    assumed = "" if vehicle is not None else f"  (no configuration: belt radius {ASSUMED_RADIUS_MM:g} mm assumed)"
    lines = [f"{order.path}{assumed}"]
    wheels = summary.wheels(states)
    of_guard = guard.take_notices() if guard is not None else []
    for link, counted in counters.items():
        watch.counters(link, counted)
    # Where signatures are checked, the guard reports misplaced sensors, and what becomes of their frames.
    notices = of_guard or sensors.mismatches(vehicle, [wheel.position for wheel in wheels])
    doubts = effects_doubts(effects, vehicle)
    lines += [f"  {clean(notice_text(notice))}" for notice in (*notices, *watch.found(), *doubts)]
    for table in effects:
        effect_names = [effect.name for effect in table.effects]
        for one in wheels:
            if one.position == table.position:
                lines.append(clean(f"  {effects_line(one, effect_names)}"))
                lines += [clean(f"  {line}") for line in (removed_line(one, table),) if line]
    found = alarms.finish()
    for alarm in found:
        for rows in tables:
            rows.write_alarm(alarm, name)
    lines += [
        clean(f"  {line}".rstrip())
        for line in (*summary_lines(wheels, alarms=found), *reference_lines(check.comparisons()))
    ]
    lines += _link_lines(counters)
    links = {link: FrameCounts(counted.frames, counted.refused) for link, counted in counters.items()}
    missing = (*missing_frames(links), *missing_revolutions(states, links))
    for notice in missing:
        lines.append(f"  {clean(notice_text(notice))}")
        if notice.reason.code is Code.NO_REVOLUTION:
            for rows in tables:
                rows.write_missing(notice.subject, notice.reason, name)
    return RecordingEstimated(tuple(lines), len(missing), reader.damage)


def _link_lines(counters: Mapping[str, LinkCounters]) -> Iterator[str]:
    for link, counted in counters.items():
        yield (
            f"  {clean(link)}: {counted.frames} frames, {counted.lost} lost, {counted.crc_errors} with a bad CRC, "
            f"{counted.duplicates} duplicate, {counted.reordered} late"
            + (f", {counted.bad_payload} with a bad payload" if counted.bad_payload else "")
            + (f", {counted.refused} rejected because not verified" if counted.refused else "")
        )
