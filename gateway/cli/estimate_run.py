"""Run of `treadlink estimate`: recordings, one after the other, to tables, a page and summaries."""

import contextlib
from collections.abc import Mapping, Sequence
from pathlib import Path

from gateway.cli import exit_status
from gateway.cli.recording_estimates import EstimateOrder, estimate_recording
from gateway.cli.summary_output import SummaryOutput
from gateway.errors import TreadlinkError
from gateway.recording.recorded_file import check_exist
from gateway.views.output_file import is_stdout
from gateway.views.progress import progress_view
from gateway.views.tables.result_table import TableFormat, open_table
from gateway.views.wording import text


def run_estimate(
    orders: Sequence[EstimateOrder],
    outputs: Mapping[TableFormat, Path],
    *,
    page: Path | None,
    force: bool,
    coverage_factor: float | None,
) -> None:
    """Estimate recordings, write their tables and page and print their summaries, in order.

    Args:
        orders: one per recording.
        outputs: file of each table.
        page: HTML file for all of them, None for none.
        force: overwrite existing files.
        coverage_factor: of expanded uncertainties in the tables, None for none.

    Raises:
        TreadlinkError: a recording cannot be read or has unreadable parts, or a table cannot be written.
        SystemExit: a recording has no frames, or a wheel that sent samples has no revolution.
    """
    # A table on standard output must not be mixed with other lines.
    written = [*outputs.values(), *([page] if page is not None else [])]
    say = SummaryOutput(err=any(map(is_stdout, written)))
    check_exist(order.path for order in orders)
    sizes = [order.path.stat().st_size if order.path.is_file() else 0 for order in orders]
    missing, damaged, drives = 0, [], []
    with contextlib.ExitStack() as stack:
        tables = [
            stack.enter_context(open_table(path, kind, force=force, coverage_factor=coverage_factor))
            for kind, path in outputs.items()
        ]
        view = stack.enter_context(progress_view())
        bar = view.bar(orders[0].path.name if len(orders) == 1 else f"{len(orders)} recordings")
        for index, order in enumerate(orders):
            before_bytes = sum(sizes[:index])

            def on_position(read_bytes: int, before_bytes: int = before_bytes) -> None:
                bar.show((before_bytes + read_bytes) / max(sum(sizes), 1))

            estimated = estimate_recording(order, on_position, tables)
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
