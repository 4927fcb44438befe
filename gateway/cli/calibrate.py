"""`treadlink calibrate`: tire calibration from recordings with known loads."""

from __future__ import annotations

from pathlib import Path

import click

from gateway.cli.options import force_option
from gateway.errors import TreadlinkError
from gateway.views.output_file import check_outputs, is_stdout, write_whole


@click.command()
@click.argument("recordings", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="RECORDING...")
@click.option(
    "--config",
    "config_path",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Vehicle configuration (TOML) for recordings without one.",
)
@click.option(
    "--wheel", "positions", multiple=True, metavar="POSITION", help="Use only this wheel; repeat for several."
)
@click.option(
    "--out",
    "out_path",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Write the tables to this file; - is standard output.",
)
@force_option
def calibrate(
    recordings: tuple[Path, ...],
    config_path: Path | None,
    positions: tuple[str, ...],
    out_path: Path | None,
    force: bool,
) -> None:
    """Calibrate load and reference numbers of a tire from RECORDING... with known loads.

    The result is two tables for the vehicle configuration. [tire.load_calibration] lets the estimator `load` give the
    load of wheels whose load is not stated. [tire.reference] is the reference for wear; record it with new tires.
    Recordings of the same tires cold and warm, 20 K apart or more, also measure how their stiffness falls with the
    temperature, which makes wear and load more certain.

    All wheels are treated as tires of one kind unless --wheel selects some of them. The errors of the fit are printed,
    also with each recording left out in turn.
    """
    check_outputs((out_path,), (*recordings, config_path), force=force)
    from gateway.cli.calibration_points import ESTIMATOR, MIN_REVOLUTIONS, calibration_toml, fit_lines, recording_points
    from gateway.config.vehicle import load_vehicle
    from gateway.estimators.tire_fit import fit_load_calibration, reference_numbers

    fallback = load_vehicle(config_path) if config_path is not None else None
    points = [point for path in recordings for point in recording_points(path, fallback, positions)]
    if not points:
        raise TreadlinkError(
            "no wheel of these recordings can be used",
            f"A wheel needs a stated load, a pressure and {MIN_REVOLUTIONS} valid revolutions"
            + (f", and must be one of {', '.join(positions)}." if positions else "."),
        )
    fit = fit_load_calibration(points)
    reference = reference_numbers(points, ESTIMATOR)
    to_stdout = is_stdout(out_path)
    for line in fit_lines(points, fit, reference):
        click.echo(line, err=to_stdout)
    text = calibration_toml(fit.calibration, reference)
    if out_path is None:
        click.echo("\n" + text, nl=False)
        return
    write_whole(out_path, text, force=force)
    if to_stdout:
        return
    click.echo(f"written: {out_path} (copy its tables to the vehicle configuration, replacing those of the same name)")
