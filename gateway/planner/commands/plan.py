"""`treadlink plan`: what a sensor will be able to measure on a tire, before it is bought."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from gateway.core.cli.options import FiniteRange, force_option
from gateway.core.cli.path_option import path_option

if TYPE_CHECKING:
    from gateway.planner.accelerometer import Accelerometer

_SPEEDS_KMH = (60.0, 100.0, 150.0)


@click.command()
@click.argument("scenario", default="lab")
@click.option(
    "--sensor",
    "names",
    multiple=True,
    metavar="NAME",
    help="Part of the list, or the first letters of its name; repeat for several.  [default: all]",
)
@path_option("--sensors", "sensors_path", help="TOML file of accelerometers instead of the shipped list.")
@click.option(
    "--speed",
    "speeds_kmh",
    type=FiniteRange(min=5.0, max=400.0),
    multiple=True,
    default=_SPEEDS_KMH,
    show_default=True,
    metavar="KMH",
    help="Speed in km/h; repeat for several.",
)
@click.option(
    "--want",
    "want_texts",
    multiple=True,
    metavar="NAME=ERROR",
    help="Largest error of a quantity, as in wear=0.5mm or Ts=3%; repeat for several. The least sensor is searched "
    "that reaches them all; --sensor and --sensors are the parts compared with it.",
)
@click.option(
    "--at",
    "at_text",
    default="60..120km/h",
    show_default=True,
    metavar="SPEEDS",
    help="With --want, speeds at which the errors have to be reached: both ends and the middle are simulated.",
)
@click.option(
    "--after",
    type=click.Choice(["1", "10", "100"]),
    default="100",
    show_default=True,
    help="With --want, number of revolutions after which the errors have to be reached.",
)
@click.option(
    "--wheels",
    type=click.IntRange(min=8, max=1000),
    metavar="N",
    help="Simulated drives: 40 know a scatter within 11 %, 160 within 6 %.  [default: 40; 3 with --want]",
)
@click.option(
    "--seed", type=click.IntRange(min=0), default=0, show_default=True, metavar="N", help="Seed of the random numbers."
)
@path_option("--json", "json_path", allow_dash=True, help="Write everything to a JSON file.")
@force_option
def plan(
    scenario: str,
    names: tuple[str, ...],
    sensors_path: Path | None,
    speeds_kmh: tuple[float, ...],
    want_texts: tuple[str, ...],
    at_text: str,
    after: str,
    wheels: int | None,
    seed: int,
    json_path: Path | None,
    force: bool,
) -> None:
    """Say what accelerometers will be able to measure on the first tire of SCENARIO.

    For each speed: whether the sensor can be used and why not, its data rate, and the errors of every quantity after
    1, 10 and 100 revolutions. The errors are measured on simulated drives that go through the estimators: the scatter,
    which averaging reduces, and what stays. SCENARIO is one of `treadlink simulate` and gives tire, load, pressure and
    road. The exit status is 1 if no sensor can be used at any speed.

    The other way round, with --want: the least range and the largest noise, at each sampling rate, with which the
    errors are printed, the minutes of driving until then, and the statements to make better where no sensor reaches
    them with what is stated. The exit status is 1 if none does with these either.

    \b
    Examples:
      treadlink plan lab --sensor ADXL375
      treadlink plan lab --want wear=0.5mm --at 60..120km/h
    """
    from gateway.core.cli.summary_output import SummaryOutput
    from gateway.core.config.validation import read_text
    from gateway.core.text.aligned_table import terminal_columns
    from gateway.core.text.output_file import check_outputs, write_whole
    from gateway.core.text.progress import progress_view
    from gateway.planner.accelerometer import parse_accelerometers, shipped_accelerometers
    from gateway.planner.commands.wanted_errors import parse_speeds_mps, parse_want
    from gateway.planner.least_sensor import better_statements, drives_of, least_sensors, reaching_parts
    from gateway.planner.planned_errors import plan_sensor, tire_at
    from gateway.planner.views.sensor_plan import least_json, least_line, parts_line, plan_json, plan_lines
    from gateway.simulator.scenario import load_scenario

    source = click.get_current_context().get_parameter_source("speeds_kmh")
    if want_texts and source is click.core.ParameterSource.COMMANDLINE:
        raise click.UsageError("--want has its speeds by --at: leave out --speed.")
    check_outputs((json_path,), (sensors_path, Path(scenario)), force=force)
    if sensors_path is None:
        listed = shipped_accelerometers()
    else:
        listed = parse_accelerometers(read_text(sensors_path, "the accelerometers"), str(sensors_path))
    chosen = _parts_by_name(listed.sensor, names)
    loaded = load_scenario(scenario)
    output = SummaryOutput([json_path])
    if want_texts:
        speeds_mps = parse_speeds_mps(at_text)
        truths = tire_at(loaded, speeds_mps[0]).truths
        wants = [parse_want(text, truths) for text in want_texts]
        sensors = []
        improved, advice = better_statements(loaded, wants, speeds_mps, revolutions=int(after))
        drive = drives_of(loaded, revolutions=int(after), wheels=wheels or 3, seed=seed, better=improved)
        for line in advice:
            output(f"state better: {line}")
        with progress_view() as view:
            bar = view.bar("simulated drives")
            for sensor in least_sensors(
                loaded,
                wants,
                speeds_mps,
                revolutions=int(after),
                wheels=wheels or 3,
                seed=seed,
                better=improved,
                on_share=bar.show,
            ):
                sensors.append(sensor)
                parts = reaching_parts(sensor, chosen, wants, speeds_mps, int(after), drive)
                with view.hidden():
                    output(least_line(sensor))
                    if sensor.reached:
                        output(parts_line(parts))
        document, has_result = least_json(sensors), any(sensor.reached for sensor in sensors)
    else:
        plans = []
        cases = [(part, speed_kmh) for part in chosen for speed_kmh in speeds_kmh]
        with progress_view() as view:
            bar = view.bar("simulated drives")
            for index, (part, speed_kmh) in enumerate(cases):
                bar.show(index / len(cases), part.name)
                planned = plan_sensor(loaded, part, speed_kmh / 3.6, wheels=wheels or 40, seed=seed)
                plans.append(planned)
                with view.hidden():
                    for line in plan_lines(planned, listed.power, terminal_columns(on_err=output.err)):
                        output(line)
        document, has_result = plan_json(plans, listed.power), any(planned.usable for planned in plans)
    if json_path is not None:
        write_whole(json_path, document, force=force)
        output.written(json_path)
    output.finish()
    if not has_result:
        raise click.exceptions.Exit(1)


def _parts_by_name(parts: Sequence[Accelerometer], names: Sequence[str]) -> list[Accelerometer]:
    """Return the parts whose names begin as one of `names`; all without names."""
    from gateway.core.errors import ConfigError

    for name in names:
        if not any(part.name.lower().startswith(name.lower()) for part in parts):
            raise ConfigError(
                f"there is no accelerometer '{name}'", f"Known: {', '.join(part.name for part in parts)}."
            )
    return [part for part in parts if not names or part.name.lower().startswith(tuple(n.lower() for n in names))]
