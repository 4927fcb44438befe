"""Run of `treadlink estimate`: recordings to tables and summaries, in one process or several."""

from __future__ import annotations

import contextlib
import os
import tempfile
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Final

import click

from gateway.cli import exit_status
from gateway.cli.estimate_order import EstimateOrder, RecordingEstimated
from gateway.cli.logs import configure_logging
from gateway.cli.summary_output import SummaryOutput
from gateway.errors import TreadlinkError
from gateway.views.output_file import is_stdout

if TYPE_CHECKING:
    from gateway.views.progress import ProgressView
    from gateway.views.tables.result_table import TableFormat, TableWriter

# A process needs half a second to start, in which another estimates this much.
_BYTES_WORTH_A_PROCESS: Final = 8_000_000


def run_estimate(
    orders: Sequence[EstimateOrder],
    outputs: Mapping[TableFormat, Path],
    *,
    page: Path | None = None,
    force: bool,
    jobs: int | None,
) -> None:
    """Estimate recordings, write their tables and page and print their summaries, in order.

    Args:
        orders: one per recording, without spools.
        outputs: file of each table.
        page: HTML file for all of them, None for none.
        force: overwrite existing files.
        jobs: maximum number of processes; None to choose it.

    Raises:
        TreadlinkError: a recording cannot be read or has unreadable parts, a table cannot be written, or a process was
            terminated from outside.
        SystemExit: a recording has no frames, or a wheel that sent samples has no revolution.
    """
    from gateway.views.progress import progress_view
    from gateway.views.tables.result_table import open_table
    from gateway.views.wording import text

    # A table on standard output must not be mixed with other lines.
    written = [*outputs.values(), *([page] if page is not None else [])]
    say = SummaryOutput(err=any(map(is_stdout, written)))
    sizes = [order.path.stat().st_size if order.path.is_file() else 0 for order in orders]
    jobs = min(jobs or _default_jobs(sum(sizes)), len(orders))
    missing, damaged, drives = 0, [], []
    orders = [replace(order, is_drawn=page is not None) for order in orders]
    with contextlib.ExitStack() as stack:
        factor = orders[0].coverage_factor
        tables = {
            kind: stack.enter_context(open_table(path, kind, force=force, coverage_factor=factor))
            for kind, path in outputs.items()
        }
        view = stack.enter_context(progress_view())
        on_bytes = _bar(view, orders, sum(sizes))
        if jobs > 1:
            run = _in_parallel(orders, outputs, tables, jobs, on_bytes)
        else:
            run = _one_by_one(orders, tables, on_bytes)
        for estimated in stack.enter_context(contextlib.closing(run)):
            with view.hidden():
                for line in estimated.lines:
                    say(line)
            if not written:
                say.finish()
            missing += estimated.missing
            if estimated.drive is not None:
                drives.append(estimated.drive)
            if estimated.damage is not None:
                damaged.append(text(estimated.damage))
    if page is not None:
        from gateway.views.drive_page.drive_page import write_drive_page

        write_drive_page(drives, page, force=force)
    for path in written:
        if not is_stdout(path):
            say(f"written: {path}")
    if damaged:
        raise TreadlinkError("; ".join(damaged), "The readable part was estimated.")
    if missing:
        raise SystemExit(exit_status.NO_RESULT)
    say.finish()


def _default_jobs(size: int) -> int:
    processors = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min(processors, 1 + size // _BYTES_WORTH_A_PROCESS)


def _bar(view: ProgressView, orders: Sequence[EstimateOrder], size: int) -> Callable[[int], None]:
    """Return a function that adds a number of bytes to the progress."""
    bar = view.bar(orders[0].path.name if len(orders) == 1 else f"{len(orders)} recordings")
    read = 0

    def on_bytes(count: int) -> None:
        nonlocal read
        read += count
        bar.show(read / max(size, 1))

    return on_bytes


def _one_by_one(
    orders: Sequence[EstimateOrder], tables: Mapping[TableFormat, TableWriter], on_bytes: Callable[[int], None]
) -> Generator[RecordingEstimated]:
    from gateway.cli.recording_estimates import estimate_recording
    from gateway.worker_pool import Workers

    rows = list(tables.values())
    work = Workers().work_on(lambda order, on_position: estimate_recording(order, on_position, rows), orders, on_bytes)
    for _, estimated in work:
        yield estimated


def _in_parallel(
    orders: Sequence[EstimateOrder],
    outputs: Mapping[TableFormat, Path],
    tables: Mapping[TableFormat, TableWriter],
    jobs: int,
    on_bytes: Callable[[int], None],
) -> Generator[RecordingEstimated]:
    """Yield the recordings in the order given, their rows written.

    Raises:
        TreadlinkError: the error of the first recording that has one; the rows of those before it are written.
    """
    from gateway.worker_pool import Workers

    waiting: dict[int, RecordingEstimated | TreadlinkError] = {}
    turn = 0
    with contextlib.ExitStack() as stack:
        folder = stack.enter_context(_spool_folder(path for path in outputs.values() if not is_stdout(path)))
        workers = stack.enter_context(Workers(jobs - 1, ["gateway.cli.recording_estimates"]))
        from gateway.views.tables.row_spool import spooled_rows

        spools = [{kind: folder / f"{index}.{kind}" for kind in tables} for index in range(len(orders))]
        spooling = [replace(order, spools=order_spools) for order, order_spools in zip(orders, spools, strict=True)]
        run = workers.work_on(_estimate_in_process, spooling, on_bytes, _logging_of_this_process())
        for index, outcome in stack.enter_context(contextlib.closing(run)):
            waiting[index] = outcome
            while turn in waiting:
                estimated = waiting.pop(turn)
                if isinstance(estimated, TreadlinkError):
                    raise estimated
                for kind, table in tables.items():
                    for row in spooled_rows(spools[turn][kind]):
                        table.put(row)
                    spools[turn][kind].unlink()
                turn += 1
                yield estimated


def _estimate_in_process(
    order: EstimateOrder, on_position: Callable[[int], None]
) -> RecordingEstimated | TreadlinkError:
    """Estimate a recording; its error is returned, since those before it come first."""
    from gateway.cli.recording_estimates import estimate_to_spools

    try:
        return estimate_to_spools(order, on_position)
    except TreadlinkError as error:
        return error


@contextlib.contextmanager
def _spool_folder(outputs: Iterable[Path]) -> Iterator[Path]:
    """Yield a new folder for rows, on the disk of the first file; it is removed at the end."""
    beside = next((path.resolve().parent for path in outputs if path.is_file() or not path.exists()), None)
    with tempfile.TemporaryDirectory(prefix=".treadlink-", dir=beside, ignore_cleanup_errors=True) as made:
        yield Path(made)


def _logging_of_this_process() -> Callable[[], None] | None:
    """Return a function that gives another process the same log."""
    context = click.get_current_context(silent=True)
    chosen = context.find_root().params if context is not None else {}
    return partial(configure_logging, chosen.get("verbosity", 0), chosen.get("log_file"))
