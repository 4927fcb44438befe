"""`treadlink estimate`: estimate recordings in one pass and write tables."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

import click
import numpy as np
from numpy.typing import NDArray

from firmware_protocol.block_decoder import FrameBatch
from gateway.cli import exit_status
from gateway.cli.options import config_option, effects_option, estimator_option, force_option, keys_option
from gateway.cli.session_setup import choose_vehicle, open_effects
from gateway.config.vehicle import ASSUMED_RADIUS_MM, VehicleConfig
from gateway.errors import TreadlinkError
from gateway.estimators.registry import DEFAULT_ESTIMATORS
from gateway.pipeline.results import AlarmRecord, RevolutionResult, WheelSnapshot
from gateway.pipeline.wheel_setup import CorrectionTable
from gateway.reasons import Code, Notice
from gateway.recording.reader import RecordingReader
from gateway.security.guard import Guard, open_guard
from gateway.security.key_file import default_key_file
from gateway.session.batch_alarms import BatchAlarms
from gateway.session.batch_estimation import estimate_items
from gateway.session.contradictions import ContradictionWatch
from gateway.session.missing_results import FrameCounts, missing_frames, missing_revolutions
from gateway.session.signal_decoding import SignalDecoder, open_decoder
from gateway.session.wheel_identity import SensorsHeard, positions
from gateway.views.output_file import check_outputs, is_stdout
from gateway.views.session_summary import ResultSummary, effects_line, summary_lines
from gateway.views.tables.result_table import TableFormat, open_table
from gateway.views.text import clean
from gateway.views.wording import notice_text, text


def _output_option(name: TableFormat, help_text: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    return click.option(f"--{name}", f"{name}_path", type=click.Path(path_type=Path), metavar="FILE", help=help_text)


@click.command()
@click.argument("recordings", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="RECORDING...")
@config_option
@_output_option(TableFormat.CSV, "Write a CSV table to this file, one row per revolution.")
@_output_option(TableFormat.JSON, "Write JSON lines to this file, one object per revolution.")
@_output_option(TableFormat.PARQUET, "Write a Parquet table to this file; needs treadlink[parquet].")
@force_option
@keys_option
@estimator_option
@effects_option
def estimate(
    recordings: tuple[Path, ...],
    config_path: Path | None,
    csv_path: Path | None,
    json_path: Path | None,
    parquet_path: Path | None,
    force: bool,
    key_file: Path | None,
    estimators: tuple[str, ...],
    effects_paths: tuple[Path, ...],
) -> None:
    """Estimate RECORDING... in one pass, with the same results as `treadlink live`.

    A summary of each recording is printed. Output files get one row per revolution and wheel: times, speed, contact
    edges and estimates with their standard errors and status. The recordings are estimated independently of each
    other, each with the vehicle configuration it contains, unless --config gives another.

    A FILE appears when it is complete, or not at all. A FILE of - is standard output; the summary is then printed to
    standard error. The exit status is 1 if a recording has no frames, or a wheel that sent samples has no revolution.
    """
    outputs = {TableFormat.CSV: csv_path, TableFormat.JSON: json_path, TableFormat.PARQUET: parquet_path}
    check_outputs(
        outputs.values(), (*recordings, config_path, *effects_paths, key_file or default_key_file()), force=force
    )
    damaged: list[str] = []
    # A table on standard output must not be mixed with other lines.
    say = partial(click.echo, err=any(map(is_stdout, outputs.values())))
    missing = 0
    with contextlib.ExitStack() as stack:
        tables = [
            stack.enter_context(open_table(path, kind, force=force))
            for kind, path in outputs.items()
            if path is not None
        ]
        for path in recordings:
            reader = RecordingReader(path)
            vehicle = choose_vehicle(config_path, [reader.vehicle_toml], str(path))
            summary = ResultSummary()

            def take(result: RevolutionResult, summary: ResultSummary = summary, name: str = path.name) -> None:
                summary.add(result)
                for table in tables:
                    table.write(result, name)

            def take_alarm(alarm: AlarmRecord, name: str = path.name) -> None:
                for table in tables:
                    table.write_alarm(alarm, name)

            guard = open_guard(vehicle, key_file, remembers=False)
            effects = open_effects(effects_paths, vehicle)
            signals = open_decoder(vehicle, config_path, (), [reader.dbc_text])
            for notice in _estimate_one(
                reader,
                vehicle,
                take,
                take_alarm,
                estimators or DEFAULT_ESTIMATORS,
                summary,
                guard,
                effects,
                signals,
                say,
            ):
                missing += 1
                say(f"  {clean(notice_text(notice))}")
                for table in tables:
                    if notice.reason.code is Code.NO_REVOLUTION:
                        table.write_missing(notice.subject, notice.reason, path.name)
            if reader.damage is not None:
                damaged.append(text(reader.damage))
    for path in filter(None, outputs.values()):
        if not is_stdout(path):
            say(f"written: {path}")
    if damaged:
        raise TreadlinkError("; ".join(damaged), "The readable part was estimated.")
    if missing:
        raise SystemExit(exit_status.NO_RESULT)


def _estimate_one(
    reader: RecordingReader,
    vehicle: VehicleConfig | None,
    take: Callable[[RevolutionResult], None],
    take_alarm: Callable[[AlarmRecord], None],
    estimators: tuple[str, ...],
    summary: ResultSummary,
    guard: Guard | None,
    effects: tuple[CorrectionTable, ...],
    signals: SignalDecoder | None,
    say: Callable[[str], None],
) -> tuple[Notice, ...]:
    """Estimate one recording and print its summary; return the warnings of what gave no result."""
    path = reader.info.path
    shown, sensors, alarms = sys.stderr.isatty(), SensorsHeard(), BatchAlarms(vehicle)
    watch = ContradictionWatch(positions(vehicle))
    states: list[WheelSnapshot] = []
    bar = click.progressbar(length=reader.info.size_bytes, label=path.name, file=sys.stderr, hidden=not shown)
    with bar as progress:
        done = 0

        def on_bytes(_: int) -> None:
            nonlocal done
            progress.update(reader.position - done)
            done = reader.position

        def on_batch(link: str, batch: FrameBatch, _: NDArray[np.int64]) -> None:
            sensors.take(batch)
            watch.batch(link, batch)

        counters = estimate_items(
            reader,
            vehicle,
            take,
            estimators=estimators,
            on_bytes=on_bytes,
            guard=guard,
            on_batch=on_batch,
            on_wheels=states.extend,
            effects=effects,
            alarms=alarms,
            signals=signals,
        )
    say(
        f"{path}"
        + ("" if vehicle is not None else f"  (no configuration: belt radius {ASSUMED_RADIUS_MM:g} mm assumed)")
    )
    wheels = summary.wheels()
    notices = guard.take_notices() if guard is not None else []
    # Where signatures are checked, the guard reports misplaced sensors, and what becomes of their frames.
    for notice in notices or sensors.mismatches(vehicle, [wheel.position for wheel in wheels]):
        say(f"  {clean(notice_text(notice))}")
    for link, counted in counters.items():
        watch.counters(link, counted)
    for notice in watch.found():
        say(f"  {clean(notice_text(notice))}")
    for table in effects:
        for wheel in wheels:
            if wheel.position == table.position:
                say(clean(f"  {effects_line(wheel, [effect.name for effect in table.effects])}"))
    found = alarms.finish()
    for alarm in found:
        take_alarm(alarm)
    for line in summary_lines(wheels, alarms=found):
        say(clean(f"  {line}".rstrip()))
    for link, counted in counters.items():
        say(
            f"  {clean(link)}: {counted.frames} frames, {counted.lost} lost, {counted.crc_errors} with a bad CRC, "
            f"{counted.duplicates} duplicate, {counted.reordered} late"
            + (f", {counted.bad_payload} with a bad payload" if counted.bad_payload else "")
            + (f", {counted.refused} rejected because not verified" if counted.refused else "")
        )
    links = {link: FrameCounts(counted.frames, counted.refused) for link, counted in counters.items()}
    return (*missing_frames(links), *missing_revolutions(states, links))
