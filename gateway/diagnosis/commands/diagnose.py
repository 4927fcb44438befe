"""`treadlink diagnose`: identify the physical effects that the model lacks."""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Final

import click

from gateway.core.cli.options import FiniteRange, KnownName, config_option, force_option, given_command, keys_option
from gateway.core.cli.path_option import path_option
from gateway.core.cli.summary_output import SummaryOutput
from gateway.core.errors import TreadlinkError
from gateway.core.text.output_file import check_outputs, write_whole
from gateway.core.text.text import clean, json_text
from gateway.security.key_file import default_key_file

if TYPE_CHECKING:
    from gateway.core.config.vehicle import VehicleConfig
    from gateway.core.worker_pool import Workers
    from gateway.diagnosis.result import Diagnosis
    from gateway.diagnosis.transfer import Transfer

MODELS: Final = ("exact", "paper")

_LABEL_CELLS: Final = 36
_ALL_EFFECTS: Final = "all"


def _list_effects(context: click.Context, _: click.Parameter, chosen: str | None) -> None:
    """Print the effects of the catalogue and exit."""
    if chosen is None or context.resilient_parsing:
        return
    from gateway.diagnosis.views.effect_catalogue import effect_lines, effects_json, effects_markdown, find_effects

    if chosen == "markdown":
        click.echo(effects_markdown(), nl=False)
    elif chosen == "json":
        click.echo(json_text(effects_json(find_effects()), indent=2))
    else:
        effects = find_effects("" if chosen == _ALL_EFFECTS else chosen)
        if not effects:
            raise TreadlinkError(
                f"no effect has '{clean(chosen)}' in its name or summary", "List all: treadlink diagnose --list-effects"
            )
        for line in effect_lines(effects, shutil.get_terminal_size().columns):
            click.echo(line)
    context.exit()


@click.command()
@click.argument("recordings", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="RECORDING...")
@config_option
@click.option("--wheel", metavar="POSITION", help="Wheel to diagnose, if the recordings contain several.")
@click.option(
    "--model",
    type=KnownName(MODELS),
    default="exact",
    show_default=True,
    help="Model of the tire that effects are added to: the exact ring, or the series as printed in the ring paper.",
)
@path_option(
    "--reverse",
    multiple=True,
    metavar="RECORDING",
    help="A recording made rolling backwards, or with the tire reversed on its rim; repeat for several.",
)
@path_option("--json", "json_path", help="Write all results to this JSON file.")
@path_option("--html", "html_path", help="Write a report with figures to this HTML file; needs treadlink[plot].")
@click.option(
    "--empirical",
    is_flag=True,
    help="Also fit a free curve to what is left, and report how much smaller the error gets.",
)
@path_option(
    "--save-effects",
    "effects_path",
    help="Write the identified effects to this file, for --effects of live, record, replay and estimate.",
)
@path_option(
    "--effects",
    "known_path",
    help="Do not search: report the error with the effects of this file, exactly as found in other recordings.",
)
@click.option(
    "--folds",
    type=click.IntRange(2, 20),
    default=5,
    show_default=True,
    metavar="N",
    help="Divide the revolutions into N parts, and predict each from the others.",
)
@click.option(
    "--jobs",
    type=click.IntRange(1, 64),
    metavar="N",
    help="Processes that work at once.  [default: 2, or 1 on a single processor]",
)
@click.option(
    "--budget",
    "budget_s",
    type=FiniteRange(min=0.0, min_open=True),
    metavar="SECONDS",
    help="Time for reading and the search for effects; what is known by then is reported. The first fit and the errors "
    "on held-out revolutions are computed in any case; a note says how long each took.  [default: no limit]",
)
@click.option(
    "--self-test",
    "self_tests",
    type=click.IntRange(0, 1000),
    default=0,
    metavar="N",
    help="Simulate N times from the result and from what it leaves unexplained, diagnose again, and report how often "
    "an effect is identified that is not there, and how far numbers are off. Each takes as long as the diagnosis.",
)
@force_option
@click.option(
    "--list-effects",
    is_flag=False,
    flag_value=_ALL_EFFECTS,
    is_eager=True,
    expose_value=False,
    callback=_list_effects,
    metavar="[NAME|json|markdown]",
    help="List the effects of the catalogue and exit: all, those with NAME in their name or else their summary, or all "
    "as JSON or Markdown.",
)
@keys_option
def diagnose(
    recordings: tuple[Path, ...],
    config_path: Path | None,
    wheel: str | None,
    model: str,
    reverse: tuple[Path, ...],
    json_path: Path | None,
    html_path: Path | None,
    empirical: bool,
    effects_path: Path | None,
    known_path: Path | None,
    folds: int,
    jobs: int | None,
    budget_s: float | None,
    self_tests: int,
    force: bool,
    key_file: Path | None,
) -> None:
    """Find out from RECORDING... why the model does not fit a tire: which physical effects it lacks.

    The baseline model is fitted with sets of effects of a catalogue: mounting and errors of the sensor, and influences
    of tire, wheel and road. An effect is identified if its probability is at least 0.99, with plausible parameters. The
    rest is reported as unexplained, with its location, its size and its dependence on speed. The error before and after
    is that on revolutions held out of every fit.

    A recording of 30 s at constant speed is sufficient. Several speeds, loads and pressures separate effects that look
    alike under one condition. Load, pressure and mounting come from the configuration in each recording, unless
    --config gives one for all.

    A FILE appears when it is complete, or not at all. A FILE of - is standard output; the summary is then printed to
    standard error.

    With --effects, no search: the error on RECORDING... is reported with and without the effects of the file,
    parameters fixed. Only the tire's own parameters, the contact's centre and a measured depth are fitted again.

    --list-effects prints the catalogue: physics, equation, parameters and look-alikes of each effect.

    \b
    Examples:
      treadlink diagnose 40kmh.mcap 80kmh.mcap 120kmh.mcap --html report.html
      treadlink diagnose drive.mcap --wheel FL --save-effects fl.effects.json
      treadlink estimate drive.mcap --effects fl.effects.json
      treadlink diagnose other.mcap --effects fl.effects.json
      treadlink diagnose ahead.mcap back.mcap --reverse back.mcap
    """
    if known_path is not None and (effects_path or empirical):
        raise click.UsageError("--effects only compares: leave out --save-effects and --empirical.")
    if known_path is not None and (wheel is not None or budget_s is not None or self_tests):
        raise click.UsageError(
            "--effects states the wheel, and nothing is searched for: leave out --wheel, --budget and --self-test."
        )
    if effects_path is not None and model != "exact":
        raise TreadlinkError(
            "--save-effects requires --model exact",
            f"Leave out --model {model}: live and estimate already use the exact ring model.",
        )
    check_outputs(
        (json_path, html_path, effects_path),
        (*recordings, *reverse, config_path, known_path, key_file or default_key_file()),
        force=force,
    )
    _check_recordings(recordings)
    if html_path is not None:
        from gateway.core.text.page_figure import require_report_packages

        require_report_packages()
    others = (jobs or min(2, os.cpu_count() or 1)) - 1
    if known_path is not None:
        result = _transferred(recordings, known_path, config_path, model, folds, others, reverse, key_file)
        _report_transfer(result, known_path, json_path, html_path, force=force)
        return
    with _work(others) as (workers, on_progress):
        from gateway.diagnosis.campaign import reading_orders
        from gateway.diagnosis.campaign_diagnosis import diagnose_recordings
        from gateway.diagnosis.effects.effect import BaselineModel
        from gateway.diagnosis.views.diagnosis_json import write_json
        from gateway.diagnosis.views.html import write_html
        from gateway.diagnosis.views.terminal import closure_summary_lines

        orders = reading_orders(
            recordings,
            vehicle=_vehicle(config_path),
            wheel=wheel,
            folds=folds,
            reverse=reverse,
            key_file=key_file,
        )
        diagnosis = diagnose_recordings(
            orders,
            model=BaselineModel(model),
            empirical=empirical,
            workers=workers,
            budget_s=budget_s,
            self_tests=self_tests,
            on_progress=on_progress,
        )
    diagnosis = _by_command(diagnosis)
    summary = SummaryOutput((json_path, html_path, effects_path))
    on_terminal = (sys.stderr if summary.err else sys.stdout).isatty()
    columns = shutil.get_terminal_size().columns if on_terminal else 0
    for line in closure_summary_lines(diagnosis, columns, has_all_notes=not on_terminal):
        summary(clean(line))
    _write(
        summary,
        (json_path, partial(write_json, diagnosis, force=force)),
        (html_path, partial(write_html, diagnosis, force=force)),
        (effects_path, partial(_save_effects, diagnosis, force=force)),
    )


@contextmanager
def _work(others: int) -> Iterator[tuple[Workers, Callable[[float, str], None]]]:
    """Yield other processes, which import what a diagnosis needs while this one does, and the display of progress."""
    from gateway.core.text.progress import progress_bar
    from gateway.core.worker_pool import Workers

    with Workers(others, ["gateway.diagnosis.campaign_diagnosis"]) as workers, progress_bar(" " * _LABEL_CELLS) as bar:
        yield workers, lambda share, step: bar.show(share, f"{step:<{_LABEL_CELLS}}")


def _vehicle(config_path: Path | None) -> VehicleConfig | None:
    from gateway.core.config.vehicle import load_vehicle

    return load_vehicle(config_path) if config_path is not None else None


def _by_command(diagnosis: Diagnosis) -> Diagnosis:
    """Return a diagnosis that holds the command that made it."""
    if diagnosis.origin is None:
        return diagnosis
    return replace(diagnosis, origin=replace(diagnosis.origin, command=given_command()))


def _transferred(
    recordings: tuple[Path, ...],
    known_path: Path,
    config_path: Path | None,
    model: str,
    folds: int,
    others: int,
    reverse: tuple[Path, ...],
    key_file: Path | None,
) -> Transfer:
    """Return the error with the effects of a file, as found before."""
    with _work(min(others, len(recordings) - 1)) as (workers, on_progress):
        from gateway.diagnosis.campaign import reading_orders
        from gateway.diagnosis.campaign_diagnosis import transfer_effects
        from gateway.diagnosis.effects.effect import BaselineModel
        from gateway.diagnosis.effects_opening import open_effects_file

        table = open_effects_file(known_path)
        orders = reading_orders(
            recordings,
            vehicle=_vehicle(config_path),
            wheel=table.position,
            folds=folds,
            reverse=reverse,
            key_file=key_file,
        )
        return transfer_effects(
            orders,
            table,
            model=BaselineModel(model),
            workers=workers,
            origin=str(known_path),
            on_progress=on_progress,
        )


def _report_transfer(
    result: Transfer, known_path: Path, json_path: Path | None, html_path: Path | None, *, force: bool
) -> None:
    from gateway.diagnosis.views.html import write_html
    from gateway.diagnosis.views.transfer_report import transfer_json, transfer_lines

    summary = SummaryOutput((json_path, html_path))
    for line in transfer_lines(result, str(known_path)):
        summary(clean(line))
    text = json_text(transfer_json(result), indent=2) + "\n"
    _write(
        summary,
        (json_path, lambda path: write_whole(path, text, force=force)),
        (html_path, partial(write_html, _by_command(result.report), force=force)),
    )


def _write(summary: SummaryOutput, *outputs: tuple[Path | None, Callable[[Path], str | None]]) -> None:
    """Write all files, even if one of them fails, so that minutes of work are not lost.

    Args:
        summary: ends the summary.
        outputs: path of each, None where it is not wanted, and what writes it and returns a remark on it.

    Raises:
        TreadlinkError: of the first file that could not be written; further ones are printed before.
    """
    failed: list[TreadlinkError] = []
    for path, write in outputs:
        if path is None:
            continue
        try:
            summary.written(path, write(path) or "")
        except TreadlinkError as error:
            failed.append(error)
    for failure in failed[1:]:
        click.echo(clean(f"{failure}. {failure.remedy}"), err=True)
    if failed:
        raise failed[0]
    summary.finish()


def _save_effects(diagnosis: Diagnosis, path: Path, *, force: bool) -> str:
    from gateway.diagnosis.saved_effects import save_effects
    from gateway.diagnosis.views.phrases import saved_text

    save_effects(diagnosis, path, force=force)
    return f" with {saved_text(diagnosis)}"


def _check_recordings(recordings: tuple[Path, ...]) -> None:
    """Refuse folders, and recordings given twice: their revolutions would count twice."""
    from gateway.core.recording.file_content import check_distinct

    for path in recordings:
        if path.is_dir():
            raise TreadlinkError(f"'{path}' is a folder", f"Give the recordings in it: {path}/*.mcap")
    check_distinct(recordings)
