"""`treadlink setup`: from a plugged hub to a vehicle file, in a dialogue or by options."""

import shlex
from pathlib import Path

import click

from gateway.core.cli.options import FiniteRange
from gateway.core.cli.path_option import path_option
from gateway.core.errors import ConfigError


def _by_position(ctx: click.Context, param: click.Parameter, texts: tuple[str, ...]) -> dict[str, float]:
    """Return numbers by position; that of all wheels has the position ''."""
    del ctx, param
    values: dict[str, float] = {}
    for text in texts:
        position, _, number = text.rpartition("=")
        if position in values:
            wheels = f"wheel '{position}'" if position else "all wheels"
            raise click.BadParameter(f"Two numbers for {wheels}.")
        try:
            values[position] = float(number)
        except ValueError as error:
            raise click.BadParameter(f"'{text}' is neither a number nor POSITION=NUMBER.") from error
    return values


def _assigned(ctx: click.Context, param: click.Parameter, texts: tuple[str, ...]) -> dict[str, str]:
    del ctx, param
    pairs = [text.partition("=") for text in texts]
    wrong = next((position for position, _, sensor in pairs if not position or not sensor), None)
    if wrong is not None:
        raise click.BadParameter("Give POSITION=SENSOR, such as FL=0000a001 or FL=0.1.")
    sensors: dict[str, str] = {}
    for position, _, sensor in pairs:
        if position in sensors:
            raise click.BadParameter(f"'{position}' has two sensors: {sensors[position]} and {sensor}.")
        sensors[position] = sensor
    return sensors


@click.command()
@click.argument("sources", nargs=-1, required=True, metavar="SOURCE...")
@path_option("--out", default=Path("vehicle.toml"), show_default=True, help="Vehicle file to write.")
@click.option("--force", is_flag=True, help="Overwrite the file.")
@click.option("--name", metavar="TEXT", help="Name of the vehicle.")
@click.option("--positions", metavar="FL,FR,...", help="Positions of the wheels, in the order of tapping.")
@click.option(
    "--wheel",
    "assigned",
    multiple=True,
    callback=_assigned,
    metavar="POSITION=SENSOR",
    help="Sensor of a wheel: its serial number, or hub.wheel.",
)
@click.option(
    "--radius-mm",
    multiple=True,
    callback=_by_position,
    metavar="[POSITION=]MM",
    help="Belt radius in mm of all or one.",
)
@click.option(
    "--distance-m",
    type=FiniteRange(1.0, 1000.0),
    metavar="METERS",
    help="Measure the radius: roll the vehicle this far when asked.",
)
@click.option(
    "--pressure-kpa",
    multiple=True,
    callback=_by_position,
    metavar="[POSITION=]KPA",
    help="Gauge pressure in kPa of all or one.",
)
@click.option(
    "--load-n", multiple=True, callback=_by_position, metavar="[POSITION=]N", help="Vertical load in N of all or one."
)
@click.option(
    "--no-input", is_flag=True, help="Ask nothing: what no option states is left unknown. Needs --wheel, and a radius."
)
def setup(
    sources: tuple[str, ...],
    out: Path,
    force: bool,
    name: str | None,
    positions: str | None,
    assigned: dict[str, str],
    radius_mm: dict[str, float],
    distance_m: float | None,
    pressure_kpa: dict[str, float],
    load_n: dict[str, float],
    no_input: bool,
) -> None:
    """Write a vehicle file for the hubs at SOURCE...

    It lists the sensors, finds the wheel of each as you tap its tire or turn it, and asks for belt radius, pressure and
    load. The radius can be measured by rolling the vehicle slowly over a measured distance. Each answer is checked at
    once; Enter alone leaves it unknown. The file is written at the end, or not at all.

    \b
    Examples:
      treadlink setup /dev/ttyUSB0 --out car.toml
      treadlink setup COM3 --no-input --wheel W1=0.0 --radius-mm 320
    """
    from gateway.bench.commands.setup_dialogue import Answers, Dialogue
    from gateway.core.text.output_file import check_outputs, write_whole

    check_outputs([out], [], force=force)
    if no_input and not assigned:
        raise click.UsageError("--no-input needs --wheel POSITION=SENSOR for each wheel, such as FL=0.0.")
    without_radius = [position for position in assigned if not {position, ""} & radius_mm.keys()]
    if no_input and distance_m is None and without_radius:
        raise click.UsageError(
            f"--no-input needs --radius-mm or --distance-m: no radius for {', '.join(without_radius)}."
        )
    if radius_mm and distance_m is not None:
        raise click.UsageError("Give --radius-mm or --distance-m.")
    answers = Answers(
        name=name,
        positions=tuple(filter(None, positions.split(","))) if positions else tuple(assigned),
        assigned=assigned,
        radius_mm=radius_mm,
        distance_m=distance_m,
        pressure_kpa=pressure_kpa,
        load_n=load_n,
    )
    with Dialogue(sources, answers, asks=not no_input) as dialogue:
        vehicle = dialogue.run()
    if not vehicle.wheel:
        raise ConfigError("no wheel has a sensor, so that nothing was written", "Run setup again.")
    write_whole(out, dialogue.text(), force=force)
    live = shlex.join(["treadlink", "live", *sources, "--config", str(out), "--record", "curve.mcap"])
    click.echo(f"written: {out}\n  drive one curve, straights before and behind it: {live}")
    click.echo("  then see whether it shows the side of each lateral axis: treadlink doctor curve.mcap")
