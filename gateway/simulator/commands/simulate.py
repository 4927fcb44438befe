"""`treadlink simulate`: simulate a scenario to a file or a pseudo-terminal."""

from pathlib import Path
from urllib.parse import quote

import click

from gateway.core.cli.options import FiniteRange
from gateway.core.cli.path_option import path_option
from gateway.core.clock import SystemClock
from gateway.core.errors import SourceError


def _print_list(ctx: click.Context, _: click.Parameter, is_requested: bool) -> None:
    if not is_requested or ctx.resilient_parsing:
        return
    from gateway.simulator.link_faults import describe_faults
    from gateway.simulator.scenario import builtin_scenarios

    click.echo("Scenarios:")
    for name, text in builtin_scenarios().items():
        click.echo(f"  {name:20s} {text}")
    click.echo(f"Faults:\n  {describe_faults()}")
    ctx.exit()


@click.command()
@click.argument("scenario", metavar="SCENARIO")
@path_option("--out", help="Write to this new file: a recording (.mcap) or the bytes of the link (.bin).")
@click.option("--pty", is_flag=True, help="Act as a hub on a serial port (pseudo-terminal) until Ctrl-C.")
@click.option(
    "--fault",
    "faults",
    multiple=True,
    metavar="KIND:OPTION=VALUE",
    help="Add a fault to the link; repeat for several. --list shows all kinds.",
)
@click.option(
    "--seed", type=click.IntRange(min=0), metavar="N", help="Seed of the random numbers.  [default: the scenario's]"
)
@click.option(
    "--duration",
    "duration_s",
    type=FiniteRange(min=0.01),
    metavar="SECONDS",
    help="Length of the drive; a file of an endless scenario needs it.  [default: the scenario's]",
)
@click.option(
    "--speed", default="1", show_default=True, metavar="FACTOR", help="Times real time, or `max`; ignored for files."
)
@path_option("--keys", "key_file", help="Sign frames with the keys in this file.")
@path_option("--vehicle", help="Write the vehicle configuration to this new file.")
@click.option(
    "--list", is_flag=True, is_eager=True, expose_value=False, callback=_print_list, help="List scenarios and faults."
)
def simulate(
    scenario: str,
    out: Path | None,
    pty: bool,
    faults: tuple[str, ...],
    seed: int | None,
    duration_s: float | None,
    speed: str,
    key_file: Path | None,
    vehicle: Path | None,
) -> None:
    """Simulate the hubs and tires of SCENARIO, a built-in name or a TOML file.

    The simulated hubs send the same protocol as real ones. To show live estimates of a simulation, use `treadlink live
    sim:SCENARIO`.

    \b
    Examples:
      treadlink simulate lab --out lab.mcap --duration 20
      treadlink simulate demo --pty
    """
    if (out is not None) == pty:
        raise click.UsageError("Give one of --out FILE and --pty.")
    from gateway.core.bounded_input import read_bounded
    from gateway.core.text.output_file import write_whole
    from gateway.simulator.commands.simulation_outputs import to_file, to_pty, truth_lines
    from gateway.simulator.link_faults import parse_faults
    from gateway.simulator.scenario import load_scenario, vehicle_toml
    from gateway.simulator.simulation import simulate as make_simulation
    from gateway.simulator.simulator_source import SimulatorSource, link_name, parse_speed

    loaded = load_scenario(scenario)
    used_seed = loaded.scenario.seed if seed is None else seed
    simulation = make_simulation(
        loaded, seed=seed, duration_s=duration_s, faults=tuple(parse_faults(faults, used_seed)), key_file=key_file
    )
    toml, clock, link = vehicle_toml(loaded, signed=key_file is not None), SystemClock(), link_name(scenario)
    # After a kill the same command may come again: the same configuration need not be written twice.
    if vehicle is not None and not (vehicle.is_file() and read_bounded(vehicle, len(toml)) == toml.encode()):
        write_whole(vehicle, toml)
    if out is not None:
        if simulation.duration_s is None:
            raise SourceError(f"scenario '{scenario}' is endless", "Give a length, for example --duration 30.")
        source = SimulatorSource(simulation, link, toml, parse_speed("max"), clock)
        uri = f"sim:{quote(scenario)}?seed={used_seed}"
        size = to_file(source, simulation.duration_s, out, uri, clock)
        click.echo(f"written: {out} ({simulation.duration_s:g} s, {size / 1e6:.2f} MB)")
    else:
        to_pty(SimulatorSource(simulation, link, toml, parse_speed(speed), clock), vehicle)
    for line in truth_lines(simulation):
        click.echo(line)
