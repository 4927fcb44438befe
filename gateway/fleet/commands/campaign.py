"""`treadlink campaign`: estimate many recordings into a dataset."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Final

import click

from gateway.core.cli import exit_status
from gateway.core.cli.options import FiniteRange, KnownName, config_option, effects_option, keys_option
from gateway.core.cli.run_options import where_option
from gateway.core.cli.stop_signals import StopRequest, StopSignal, stop_request
from gateway.core.clock import Clock, SystemClock
from gateway.core.estimates.registry import CAMPAIGN_ESTIMATORS, estimator_names, in_order
from gateway.core.text.aligned_table import for_terminal
from gateway.core.text.text import clean, counted, file_size
from gateway.core.text.wording import text

if TYPE_CHECKING:
    from gateway.core.recording.run_description import RunFilter
    from gateway.fleet.campaign_run import CampaignProgress
    from gateway.fleet.recording_estimation import Failure
    from gateway.fleet.tire_diagnoses import DiagnosisCounts

_LINE_EVERY_NS: Final = 30_000_000_000
_LISTED: Final = 20
_GB: Final = 1e9


@click.command()
@click.argument("paths", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="PATH...")
@click.option(
    "--out",
    "root",
    required=True,
    type=click.Path(path_type=Path, file_okay=False),
    metavar="DATASET",
    help="Folder of the dataset; made when it does not exist, continued when it does.",
)
@config_option
@click.option(
    "--estimator",
    "estimators",
    multiple=True,
    type=KnownName(estimator_names()),
    metavar="NAME",
    help=f"Estimator to run in place of the default ones, as for `treadlink estimate`; repeat for several.  "
    f"[default: {', '.join(CAMPAIGN_ESTIMATORS)}]",
)
@click.option(
    "--rows",
    type=click.Choice(["second", "all", "none"]),
    default="second",
    show_default=True,
    help="Revolutions to keep: the last one of each second and wheel, all, or none. Each recording always has one row "
    "per wheel with the means over its revolutions.",
)
@click.option("--diagnose", is_flag=True, help="Also diagnose every tire from its recordings; takes minutes per tire.")
@click.option(
    "--jobs",
    type=click.IntRange(1, 256),
    metavar="N",
    help="Processes that work at once.  [default: one per processor]",
)
@click.option(
    "--memory",
    "memory_gb",
    type=FiniteRange(min=0.3),
    default=2.0,
    show_default=True,
    metavar="GB",
    help="Memory in GB at which a process is ended, and its recording tried once more.",
)
@click.option(
    "--scheduler",
    metavar="ADDRESS",
    help="Use the workers of a dask scheduler instead, such as tls://10.0.0.5:8786. It can run programs as you.",
)
@click.option("--retry", is_flag=True, help="Try recordings again that failed before and have not changed.")
@where_option
@keys_option
@effects_option
def campaign(
    paths: tuple[Path, ...],
    root: Path,
    config_path: Path | None,
    estimators: tuple[str, ...],
    rows: str,
    diagnose: bool,
    jobs: int | None,
    memory_gb: float,
    scheduler: str | None,
    retry: bool,
    where: RunFilter,
    key_file: Path | None,
    effects_paths: tuple[Path, ...],
) -> None:
    """Estimate all recordings of PATH... into a dataset of Parquet files.

    A PATH is a recording, or a folder that is searched for .mcap files. The dataset has the tables recordings,
    revolutions, failures and, with --diagnose, diagnoses. They are partitioned by vehicle and day (UTC).

    \b
    Examples:
      treadlink campaign /data/fleet --out fleet.dataset
      duckdb -c "SELECT * FROM read_parquet('fleet.dataset/recordings/**/*.parquet')"
      treadlink trends fleet.dataset --html fleet.html

    The command can be stopped at any time and run again, also with more recordings: what is done is known by the
    content of the files, the options and the version of the estimators. Renamed and copied files are not estimated
    again; a changed file replaces its rows.

    A recording that cannot be estimated is a row of the table failures and does not stop the others. One whose worker
    process is killed, runs out of memory, or sends a scheduler nothing for a minute is tried once more. The exit
    status is 1 if there is a failure, a damaged recording, or a wheel that sent samples and has no revolution.
    """
    if scheduler is not None:
        _check_scheduler(scheduler, jobs)
    from gateway.fleet.parquet_parts import require_campaign_packages

    require_campaign_packages()
    from gateway.core.config.vehicle import load_vehicle
    from gateway.core.session.corrections import check_effects
    from gateway.diagnosis.effects_opening import open_effects_file
    from gateway.fleet.campaign_run import CampaignRun, find_recordings
    from gateway.fleet.content_keys import estimators_version
    from gateway.fleet.dataset import Description, opened
    from gateway.fleet.local_tasks import LocalTasks, WorkersNotStartedError
    from gateway.fleet.recording_estimation import EstimationSettings, RowsKept, estimate_names
    from gateway.fleet.scheduler_tasks import scheduler_tasks
    from gateway.fleet.worker_tasks import WorkerTasks

    recording_paths = find_recordings(paths, where)
    key_file = key_file.resolve() if key_file is not None else None  # workers have other working folders
    chosen = tuple(in_order(estimators or CAMPAIGN_ESTIMATORS))
    vehicle = load_vehicle(config_path) if config_path is not None else None
    effects = tuple(map(open_effects_file, effects_paths))
    if vehicle is not None:
        check_effects(effects, vehicle)
    settings = EstimationSettings(
        estimators=chosen,
        columns=estimate_names(chosen),
        rows=RowsKept(rows),
        vehicle=vehicle,
        effects=effects,
        key_file=key_file,
        code=estimators_version(),
    )
    description = Description(chosen, settings.columns, str(settings.rows))
    clock = SystemClock()
    memory_bytes = int(memory_gb * _GB)
    failures: list[tuple[Path, Failure]] = []
    counts: DiagnosisCounts | None = None
    with stop_request() as stop, ExitStack() as stack:
        try:
            dataset = stack.enter_context(opened(root, description, _waiting(clock, stop, root)))
        except TimeoutError:
            _stopped(stop)
            return

        pool: WorkerTasks | None = None

        def connect() -> WorkerTasks:
            nonlocal pool
            if pool is None:
                if scheduler is not None:
                    pool = stack.enter_context(scheduler_tasks(scheduler))
                else:
                    pool = stack.enter_context(LocalTasks(jobs or os.cpu_count() or 1, memory_bytes))
            return pool

        with _shown_progress(clock) as show:
            run = CampaignRun(
                dataset=dataset,
                settings=settings,
                connect=connect,
                clock=clock,
                stop=stop,
                on_progress=show,
                on_failure=lambda path, failure: failures.append((path, failure)),
                retries_failed=retry,
            )
            try:
                progress = run.run(recording_paths)
            except WorkersNotStartedError:
                if stop.is_set():  # by the signal that ended them
                    _stopped(stop)
                raise
        if diagnose:
            from gateway.fleet.tire_diagnoses import DiagnosisCounts, diagnose_tires

            counts = DiagnosisCounts()
            if not stop.is_set():
                counts = diagnose_tires(
                    dataset,
                    connect,
                    run.contents,
                    config=settings.vehicle,
                    key_file=key_file,
                    stop=stop,
                    on_tire=lambda done, total: click.echo(f"diagnosed {done} of {total} tires", err=True),
                )
    _report(progress, failures, root)
    if counts is not None:
        _report_diagnoses(counts)
    if stop.is_set():
        click.echo("stopped: run the same command to continue", err=True)
        _stopped(stop)
    undiagnosed = counts is not None and counts.failed
    if progress.failed or progress.failed_before or progress.standing or progress.damaged or undiagnosed:
        raise SystemExit(exit_status.NO_RESULT)


def _check_scheduler(scheduler: str, jobs: int | None) -> None:
    """Refuse worker processes of this machine beside a scheduler; warn of one that anybody can use."""
    if jobs is not None:
        raise click.UsageError("--jobs is for this machine; the workers of --scheduler are started elsewhere.")
    if not scheduler.startswith("tls://"):
        click.echo(
            f"--scheduler {clean(scheduler)} is neither encrypted nor authenticated: whoever reaches the scheduler can "
            "run programs as you, here and on the workers. Use tls:// with certificates, or a network of your own.",
            err=True,
        )


def _report_diagnoses(counts: DiagnosisCounts) -> None:
    """Print what was diagnosed, and why some tires and recordings were not."""
    click.echo(f"tires: {counts.made} diagnosed, {counts.made_before} done before, {counts.failed} without a diagnosis")
    _list(_tire_lines((tire, (reason,)) for tire, reason in counts.reasons), "table diagnoses")
    if counts.left_out:
        recordings = sum(len(reasons) for _, reasons in counts.left_out)
        click.echo(f"recordings left out of a diagnosis: {recordings}")
        _list(_tire_lines(counts.left_out), "table diagnoses")


def _list(lines: Sequence[str], where: str) -> None:
    """Print the first lines, and where in the dataset the others are."""
    for line in lines[:_LISTED]:
        click.echo(for_terminal(f"  {line}"))
    if len(lines) > _LISTED:
        click.echo(f"  and {len(lines) - _LISTED} more, in the {where}")


def _tire_lines(tires: Iterable[tuple[tuple[str, ...], Sequence[str]]]) -> list[str]:
    """Return what is stated of tires."""
    return [f"{clean(' '.join(filter(None, tire)))}: {clean(reason)}" for tire, reasons in tires for reason in reasons]


def _stopped(stop: StopRequest) -> None:
    """End with the exit status of the signal."""
    if stop.number is not None:
        raise SystemExit(exit_status.of_signal(StopSignal(stop.number)))


def _waiting(clock: Clock, stop: StopRequest, root: Path) -> Callable[[str], bool]:
    """Return what waits for another campaign on the dataset, and says so once."""
    is_reported = False

    def wait(holder: str) -> bool:
        nonlocal is_reported
        if not is_reported:
            is_reported = True
            holder_note = f" ({clean(holder)})" if holder else ""
            click.echo(f"waiting for another campaign on '{root}'{holder_note}", err=True)
        clock.sleep_until_ns(clock.now_ns() + 200_000_000)
        return not stop.is_set()

    return wait


@contextmanager
def _shown_progress(clock: Clock) -> Iterator[Callable[[CampaignProgress], None]]:
    """Yield what shows the progress: a bar on a terminal, else a line every half minute."""
    from gateway.core.text.progress import can_move_cursor, progress_bar

    if not (sys.stderr.isatty() and can_move_cursor(os.environ)):
        yield _lines(clock)
        return

    with progress_bar("starting workers") as bar:

        def show(progress: CampaignProgress) -> None:
            failed = f", {progress.failed} failed" if progress.failed else ""
            bar.show(progress.done_bytes / max(progress.total_bytes, 1), f"{_files_text(progress)}{failed}")

        yield show


def _lines(clock: Clock) -> Callable[[CampaignProgress], None]:
    due_ns = clock.now_ns() + _LINE_EVERY_NS

    def show(progress: CampaignProgress) -> None:
        nonlocal due_ns
        now_ns = clock.now_ns()
        if now_ns < due_ns:
            return
        due_ns = now_ns + _LINE_EVERY_NS
        failed = f", {progress.failed} failed" if progress.failed else ""
        share = 100.0 * progress.done_bytes / max(progress.total_bytes, 1)
        click.echo(f"{_files_text(progress)}, {share:.1f} % of the bytes{failed}, {_left_text(progress)}", err=True)

    return show


def _files_text(progress: CampaignProgress) -> str:
    return f"{progress.files - progress.files_left} of {counted(progress.files, 'recording')}"


def _left_text(progress: CampaignProgress) -> str:
    from gateway.core.text.numbers import duration

    left_s = progress.left_s
    return "time left not known yet" if left_s is None else f"{duration(left_s)} left"


def _troubles(progress: CampaignProgress) -> Iterator[str]:
    """Yield the counts of what a recording can lack although it has rows."""
    if progress.standing:
        yield f"{counted(len(progress.standing), 'wheel')} without a revolution"
    if progress.with_alarms:
        names = "; ".join(f"{name} in {count}" for name, count in progress.alarms.most_common())
        yield f"{counted(progress.with_alarms, 'recording')} with alarms: {clean(names)}"


def _report(progress: CampaignProgress, failures: list[tuple[Path, Failure]], root: Path) -> None:
    """Print what was done, and the failures."""
    from gateway.core.text.numbers import duration

    rate = progress.estimated / progress.elapsed_s if progress.elapsed_s > 0.0 else 0.0
    timing = f" in {duration(progress.elapsed_s)} ({rate:.2g} per second)" if progress.estimated else ""
    estimated = f"{counted(progress.estimated, 'recording')} estimated{timing}"
    click.echo(f"{estimated}, {counted(progress.revolutions, 'revolution')}")
    for count, description in (
        (progress.done_before, "done before"),
        (progress.copies, "with the content of another"),
        (progress.restored, "estimated again, because their file in the dataset was missing or damaged"),
        (progress.failed_before, "failed before and have not changed (--retry tries them again)"),
        (progress.failed, "failed"),
    ):
        if count:
            click.echo(f"{count} {description}")
    _list([f"{clean(str(path))}: {clean(text(failure.reason))}" for path, failure in failures], "table failures")
    if progress.damaged:
        click.echo(
            f"{len(progress.damaged)} damaged: only the readable part is estimated; `treadlink repair` recovers more"
        )
    _list([f"{clean(str(path))}: see treadlink inspect" for path in progress.damaged], "column damage")
    if progress.standing or progress.with_alarms:
        click.echo(for_terminal(", ".join(_troubles(progress))))
    _list(_tire_lines(((str(path), position), (note,)) for path, position, note in progress.standing), "column missing")
    if progress.peak_bytes:
        click.echo(f"largest worker process: {file_size(progress.peak_bytes)}")
    click.echo(f"dataset: {root}")
