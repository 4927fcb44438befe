"""`treadlink calibrate`: tire calibration from recordings with known loads, slip angles or side forces."""

import math
from collections.abc import Callable, Iterable
from pathlib import Path

import click

from gateway.core.cli.options import force_option
from gateway.core.cli.path_option import path_option
from gateway.core.cli.summary_output import SummaryOutput
from gateway.core.text.output_file import check_outputs, write_whole


class _LoadUnlessNamed(click.Group):
    """Group whose arguments are those of `load` unless the first one names a subcommand."""

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Return the subcommand and its arguments."""
        if args[0] in self.commands:
            return super().resolve_command(ctx, args)
        return "load", self.commands["load"], args


@click.group(cls=_LoadUnlessNamed, context_settings={"ignore_unknown_options": True})
def calibrate() -> None:
    """Calibrate a tire from recordings with known loads, slip angles or side forces.

    `treadlink calibrate RECORDING...` is short for `treadlink calibrate load RECORDING...`.
    """


@calibrate.command(short_help="Calibrate load and reference numbers at known loads.")
@click.argument("recordings", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="RECORDING...")
@path_option("--config", "config_path", help="Vehicle configuration (TOML) for recordings without one.")
@click.option(
    "--wheel", "positions", multiple=True, metavar="POSITION", help="Use only this wheel; repeat for several."
)
@path_option("--out", "out_path", help="Write the tables to this file; - is standard output.")
@force_option
def load(
    recordings: tuple[Path, ...],
    config_path: Path | None,
    positions: tuple[str, ...],
    out_path: Path | None,
    force: bool,
) -> None:
    """Calibrate load and reference numbers from recordings with known loads.

    The result is two tables for the vehicle configuration. [tire.load_calibration] lets the estimator `load` give the
    load of wheels whose load is not stated. [tire.reference] is the reference for wear; record it with new tires.
    Recordings of the same tires cold and warm, 20 K apart or more, also measure how their stiffness falls with the
    temperature, which makes wear and load more certain.

    All wheels are treated as tires of one kind unless --wheel selects some of them. The errors of the fit are printed,
    also with each recording left out in turn.

    Example: `treadlink calibrate load 3000N.mcap 5000N.mcap --out tire.toml`
    """
    check_outputs((out_path,), (*recordings, config_path), force=force)
    from gateway.forces.calibration_points import fit_lines
    from gateway.forces.tire_calibration import calibrate as calibrated

    result = calibrated(
        recordings,
        config=config_path,
        wheels=positions,
        on_left_out=lambda reason: click.echo(f"left out: {reason}", err=True),
    )
    _write(fit_lines(result.points, result.fit, result.reference), result.toml, out_path, force=force)


def _of_runs(command: Callable[..., None]) -> Callable[..., None]:
    """Add argument and options of a calibration from runs."""
    for option in (
        force_option,
        path_option("--out", "out_path", help="Write the table to this file; - is standard output."),
        path_option(
            "--config", "config_path", help="Vehicle configuration (TOML) to use instead of those in the recordings."
        ),
        click.argument("runs_path", type=click.Path(path_type=Path), metavar="RUNS"),
    ):
        command = option(command)
    return command


@calibrate.command()
@_of_runs
def slip(runs_path: Path, config_path: Path | None, out_path: Path | None, force: bool) -> None:
    """Calibrate slip from runs at known slip angles.

    RUNS is a TOML file that lists the runs: [[run]] tables with recording, slip_deg and, where the tire rolls
    backwards, direction = "reverse". Three runs at one load and pressure, such as at -1, 0 and 1 deg, determine and
    check the calibration. A reverse run separates ply steer from conicity.

    The result is the table [tire.slip_calibration] for the vehicle configuration. With it the estimator `slip-angle`
    gives the slip angle itself, constant slip included. Runs that do not determine it, or contradict each other, are
    refused with the reason.

    Example: `treadlink calibrate slip runs.toml --out tire.toml`
    """
    from gateway.core.recording.file_content import check_distinct
    from gateway.forces.known_runs import SlipRunsFile, load_runs, run_recordings

    runs_file = load_runs(SlipRunsFile, runs_path)
    recordings = run_recordings(runs_path, runs_file.run)
    check_outputs((out_path,), (runs_path, config_path, *recordings), force=force)
    check_distinct(recordings)
    from gateway.forces.commands.slip_runs import measured_runs, slip_lines, slip_toml
    from gateway.forces.slip_fit import fit_slip_calibration

    runs = measured_runs(runs_path, runs_file, config_path)
    fit = fit_slip_calibration(runs, math.radians(runs_file.slip_zero_std_deg))
    _write(slip_lines(runs, fit), slip_toml(fit.calibration), out_path, force=force)


@calibrate.command(name="side-force", short_help="Calibrate side force and aligning moment.")
@_of_runs
def side_force(runs_path: Path, config_path: Path | None, out_path: Path | None, force: bool) -> None:
    """Calibrate side force and aligning moment from runs at known forces.

    RUNS is a TOML file that lists the runs: [[run]] tables with recording, side_force_n and, where it is known,
    aligning_moment_nm, positive to the left. Three runs at one load, such as at -1000, 0 and 1000 N, determine and
    check the calibration.

    The result is the table [tire.side_force_calibration] for the vehicle configuration. With it the estimator
    `side-force` gives side force and aligning moment. Runs that do not determine it are refused with the reason.

    Example: `treadlink calibrate side-force runs.toml --out tire.toml`
    """
    from gateway.core.recording.file_content import check_distinct
    from gateway.forces.known_runs import ForceRunsFile, load_runs, run_recordings

    runs_file = load_runs(ForceRunsFile, runs_path)
    recordings = run_recordings(runs_path, runs_file.run)
    check_outputs((out_path,), (runs_path, config_path, *recordings), force=force)
    check_distinct(recordings)
    from gateway.forces.commands.force_runs import fit_side_force, force_lines, force_toml, measured_force_runs

    runs = measured_force_runs(runs_path, runs_file, config_path)
    calibration = fit_side_force(runs, runs_file)
    _write(force_lines(runs, calibration), force_toml(calibration), out_path, force=force)


def _write(lines: Iterable[str], text: str, out_path: Path | None, *, force: bool) -> None:
    """Print the lines of the fit, and print its tables or write them to a file."""
    output = SummaryOutput([out_path])
    for line in lines:
        output(line)
    if out_path is None:
        for line in ("", *text.splitlines()):
            output(line)
    else:
        write_whole(out_path, text, force=force)
        output.written(out_path, " (copy its tables to the vehicle configuration, replacing those of the same name)")
    output.finish()
