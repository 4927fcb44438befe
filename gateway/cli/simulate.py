"""`treadlink simulate`: simulate a scenario to a file, a pseudo-terminal, Bluetooth or emulated firmware."""

from __future__ import annotations

import contextlib
import shlex
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from urllib.parse import quote

import click

from gateway.cli.stop_signals import stop_request
from gateway.clock import Clock, SystemClock
from gateway.errors import OutputError, SourceError
from gateway.io.source import Chunk, LinkItem
from gateway.recording.writer import RecordingWriter
from gateway.simulator.link_faults import Fault, describe_faults, parse_faults
from gateway.simulator.pty_link import PtyPort
from gateway.simulator.scenario import builtin_scenarios, load_scenario, vehicle_toml
from gateway.simulator.scenario_model import Scenario
from gateway.simulator.simulation import Simulation
from gateway.simulator.simulation import simulate as make_simulation
from gateway.simulator.simulator_source import SimulatorSource, link_name, parse_speed
from gateway.views.output_file import write_whole

_TICKS_PER_S = 10


def _print_list(ctx: click.Context, _: click.Parameter, wanted: bool) -> None:
    if not wanted or ctx.resilient_parsing:
        return
    click.echo("Scenarios:")
    for name, text in builtin_scenarios().items():
        click.echo(f"  {name:20s} {text}")
    click.echo(f"Faults:\n  {describe_faults()}")
    ctx.exit()


@click.command()
@click.argument("scenario", metavar="SCENARIO")
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Write to this new file: a recording (.mcap) or the bytes of the link (.bin).",
)
@click.option("--pty", is_flag=True, help="Act as a hub on a serial port (pseudo-terminal) until Ctrl-C.")
@click.option("--ble", is_flag=True, help="Act as Bluetooth LE hubs on a private D-Bus (Linux) until Ctrl-C.")
@click.option(
    "--firmware",
    is_flag=True,
    help="Feed the samples to the reference firmware, which QEMU emulates; its link is a TCP port until Ctrl-C.",
)
@click.option(
    "--fault",
    "faults",
    multiple=True,
    metavar="KIND:OPTION=VALUE",
    help="Add a fault to the link; repeat for several. --list shows all kinds.",
)
@click.option("--seed", type=click.IntRange(min=0), help="Seed of the random numbers.  [default: the scenario's]")
@click.option(
    "--duration",
    "duration_s",
    type=click.FloatRange(min=0.01),
    metavar="SECONDS",
    help="Length.  [default: the scenario's]",
)
@click.option(
    "--speed", default="1", show_default=True, metavar="FACTOR", help="Times real time, or `max`; ignored for files."
)
@click.option(
    "--keys",
    "key_file",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Sign frames with the keys in this file.",
)
@click.option(
    "--vehicle",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Write the vehicle configuration to this new file.",
)
@click.option(
    "--list", is_flag=True, is_eager=True, expose_value=False, callback=_print_list, help="List scenarios and faults."
)
def simulate(
    scenario: str,
    out: Path | None,
    pty: bool,
    ble: bool,
    firmware: bool,
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
    """
    if (out is not None) + pty + ble + firmware != 1:
        raise click.UsageError("Give one of --out FILE, --pty, --ble and --firmware.")
    if firmware and faults:
        raise click.UsageError("--fault cannot be combined with --firmware, whose link is that of the emulated board.")
    if ble and faults:
        raise click.UsageError("--fault cannot be combined with --ble, which transmits only whole frames.")
    if ble and key_file is not None:
        raise click.UsageError("--keys cannot be combined with --ble, whose hub changes frames on command.")
    loaded = load_scenario(scenario)
    used_seed = loaded.scenario.seed if seed is None else seed
    simulation = make_simulation(
        loaded, seed=seed, duration_s=duration_s, faults=tuple(parse_faults(faults, used_seed)), key_file=key_file
    )
    toml, clock, link = vehicle_toml(loaded, signed=key_file is not None), SystemClock(), link_name(scenario)
    if vehicle is not None:
        write_whole(vehicle, toml)
    if out is not None:
        if simulation.duration_s is None:
            raise SourceError(f"scenario '{scenario}' is endless", "Give a length, for example --duration 30.")
        source = SimulatorSource(simulation, link, toml, parse_speed("max"), clock)
        uri = f"sim:{quote(scenario)}?seed={used_seed}"
        size = _to_file(source, simulation.duration_s, out, uri, clock)
        click.echo(f"written: {out} ({simulation.duration_s:g} s, {size / 1e6:.2f} MB)")
    elif firmware:
        _to_firmware(simulation, parse_speed(speed), clock, vehicle, key_file)
    elif ble:
        _to_ble(SimulatorSource(simulation, link, toml, parse_speed(speed), clock), loaded, vehicle)
    else:
        _to_pty(SimulatorSource(simulation, link, toml, parse_speed(speed), clock), vehicle)
    _report(simulation)


def _to_file(source: SimulatorSource, duration_s: float, out: Path, uri: str, clock: Clock) -> int:
    """Write all items of the source; return the size of the file.

    Raises:
        StopSignal: a signal asked to stop; the file is finished, but too short.
    """
    start_ns = clock.now_ns()
    with (
        stop_request() as stop,
        _output(out, start_ns, source.vehicle_toml, uri) as write,
        click.progressbar(length=round(duration_s * _TICKS_PER_S), label="simulating") as bar,
    ):
        for item in source.items(stop):
            write(item)
            bar.update(max(0, int((item.host_ns - start_ns) * 1e-9 * _TICKS_PER_S) - bar.pos))
    stop.raise_if_set()
    return out.stat().st_size


@contextlib.contextmanager
def _output(out: Path, start_ns: int, toml: str | None, uri: str) -> Iterator[Callable[[LinkItem], None]]:
    """Create the file in the format given by its suffix; yield a function that writes an item."""
    if out.suffix == ".mcap":
        writer = RecordingWriter(out, start_ns=start_ns, vehicle_toml=toml, sources=[uri])
        try:
            yield writer.write
        finally:
            writer.close()
    elif out.suffix == ".bin":
        try:
            file = out.open("xb")
        except OSError as error:
            raise OutputError(f"cannot create '{out}': {error.strerror}", "Give the name of a new file.") from error

        def write(item: LinkItem) -> None:
            if isinstance(item, Chunk):
                file.write(item.data)

        with file:
            yield write
    else:
        raise OutputError(f"'{out.name}' has an unknown suffix", "Give a name that ends in .mcap or .bin.")


def _to_pty(source: SimulatorSource, vehicle: Path | None) -> None:
    """Feed a pseudo-terminal until the scenario ends or a signal asks to stop."""
    with stop_request() as stop, contextlib.closing(PtyPort()) as port:
        click.echo(f"A simulated hub is sending on {port.path}. In another terminal run\n")
        config = f" --config {shlex.quote(str(vehicle))}" if vehicle is not None else ""
        click.echo(f"  treadlink live serial://{port.path}{config}\n\nCtrl-C stops the hub.")
        was_connected = False
        for item in source.items(stop):
            if not isinstance(item, Chunk):
                continue
            port.write(item.data)
            if port.connected != was_connected:
                was_connected = not was_connected
                click.echo("reader connected" if was_connected else "reader disconnected")
        if stop.is_set():
            click.echo("")
    lost = f", {port.dropped} lost because the reader is too slow" if port.dropped else ""
    click.echo(f"{port.sent} bytes read, {port.unread} sent without a reader{lost}")


def _to_firmware(
    simulation: Simulation, speed: float, clock: Clock, vehicle: Path | None, key_file: Path | None
) -> None:
    """Run the reference collector on an emulated board until the scenario ends or Ctrl-C.

    Raises:
        SourceError: QEMU or the compiler is missing, or the scenario does not fit one collector.
    """
    from gateway.security.key_file import KeyFile
    from gateway.simulator.firmware.emulated_board import EmulatedBoard
    from gateway.simulator.firmware.firmware_build import build_board, require_board_tools
    from gateway.simulator.firmware.sensor_feed import SensorFeed, play

    require_board_tools()
    feed = SensorFeed(simulation, KeyFile(key_file).keys if key_file is not None else {})
    with tempfile.TemporaryDirectory() as folder, EmulatedBoard(build_board(Path(folder))) as board:
        board.provision(feed.hub, feed.wheels)
        options = f" --config {shlex.quote(str(vehicle))}" if vehicle is not None else ""
        options += f" --keys {shlex.quote(str(key_file))}" if key_file is not None else ""
        with stop_request() as stop:
            click.echo("The reference firmware runs on an emulated Cortex-M4. In another terminal run\n")
            click.echo(f"  treadlink live tcp://{board.address}{options}\n\nCtrl-C stops the board.")
            played = play(feed, board, speed, clock, stop)
        if stop.is_set():
            click.echo("")
    click.echo(f"{played.samples} samples in {played.time_s:.1f} s, at most {played.late_s:.2f} s late")


def _to_ble(source: SimulatorSource, scenario: Scenario, vehicle: Path | None) -> None:
    """Advertise and stream as Bluetooth hubs until the scenario ends or a signal asks to stop.

    Raises:
        SourceError: this system has no D-Bus daemon, through which programs use Bluetooth on Linux.
    """
    try:
        from gateway.simulator.bluetooth.bluez_thread import BluezStandIn
        from gateway.simulator.bluetooth.dbus_daemon import PrivateBus
        from gateway.simulator.bluetooth.hubs import ble_hubs, broadcast
    except ImportError as error:
        raise SourceError("simulated Bluetooth requires Linux", "Use --pty or --out.") from error

    hubs = ble_hubs(scenario)
    with stop_request() as stop, PrivateBus() as bus, BluezStandIn(bus.address) as bluez:
        for hub in hubs.values():
            hub.on_listening = _listening_printer(hub.peripheral.name)
            bluez.add(hub.peripheral)
        uris = " ".join(f"ble://{hub.peripheral.name}" for hub in hubs.values())
        config = f" --config {shlex.quote(str(vehicle))}" if vehicle is not None else ""
        click.echo("Simulated hubs advertise on a private Bluetooth. In another terminal run\n")
        click.echo(f"  export DBUS_SYSTEM_BUS_ADDRESS={shlex.quote(bus.address)}")
        click.echo(f"  treadlink scan\n  treadlink live {uris}{config}\n\nCtrl-C stops the hubs.")
        sent = broadcast(source, hubs, bluez, stop)
        if stop.is_set():
            click.echo("")
        else:
            click.echo(f"sent {', '.join(f'{sent[n]} notifications of hub {n}' for n in sent)}")


def _listening_printer(name: str) -> Callable[[bool], None]:
    return lambda listening: click.echo(f"{name}: {'subscribed' if listening else 'no longer subscribed'}")


def _report(simulation: Simulation) -> None:
    """Print the true values of every wheel and the counts of the faults."""
    for position, truth in simulation.truth.items():
        numbers = truth.numbers(0.0)
        leading, trailing = truth.contact_edges_rad(0.0)
        click.echo(
            f"  {position}: {truth.load_n(0.0):.0f} N, {truth.pressure_pa(0.0) * 1e-3:.1f} kPa, contact "
            f"{leading:+.4f} to {trailing:+.4f} rad, Bs {numbers.Bs:.4e} Cw {numbers.Cw:.4f} "
            f"Rs {numbers.Rs:.3f} Ts {numbers.Ts:.3f}"
        )
    for fault in simulation.faults:
        click.echo(f"  fault {fault}: {_counts(fault)}")


def _counts(fault: Fault) -> str:
    found = [f"{value} {name.replace('_', ' ')}" for name, value in fault.counts.as_dict().items() if value]
    return ", ".join(found) or "no effect"
