"""Outputs of a simulation: a file, a pseudo-terminal, Bluetooth or emulated firmware; and its true values."""

import contextlib
import shlex
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import click

from gateway.core.cli.stop_signals import stop_request
from gateway.core.clock import Clock
from gateway.core.errors import OutputError, SourceError
from gateway.core.links.source import Chunk, LinkItem
from gateway.core.recording.writer import RecordingWriter, whole_recording
from gateway.core.text.output_file import OutputFile
from gateway.core.text.progress import progress_bar
from gateway.simulator.link_faults import Fault
from gateway.simulator.pty_link import PtyPort
from gateway.simulator.scenario_model import Scenario
from gateway.simulator.simulation import Simulation
from gateway.simulator.simulator_source import SimulatorSource


def to_file(source: SimulatorSource, duration_s: float, out: Path, uri: str, clock: Clock) -> int:
    """Write all items of the source; return the size of the file.

    Raises:
        StopSignal: a signal asked to stop; the file is finished, but too short.
    """
    start_ns = clock.now_ns()
    with (
        stop_request() as stop,
        _output(out, start_ns, source.vehicle_toml, uri) as write,
        progress_bar("simulating") as bar,
    ):
        for item in source.items(stop):
            write(item)
            bar.show((item.host_ns - start_ns) * 1e-9 / duration_s)
    stop.raise_if_set()
    return out.stat().st_size


@contextlib.contextmanager
def _output(out: Path, start_ns: int, toml: str | None, uri: str) -> Iterator[Callable[[LinkItem], object]]:
    """Create the file in the format given by its suffix; yield a function that writes an item."""
    if out.suffix == ".mcap":
        part = RecordingWriter(out, start_ns=start_ns, vehicle_toml=toml, sources=[uri], in_part=True)
        with whole_recording(part) as writer:
            yield writer.write
    elif out.suffix == ".bin":
        if out.exists():
            raise OutputError(f"'{out}' already exists", "Give the name of a new file.")
        with OutputFile(out) as output, output.explained():
            yield lambda item: output.file.write(item.data) if isinstance(item, Chunk) else None
    else:
        raise OutputError(f"'{out.name}' has an unknown suffix", "Give a name that ends in .mcap or .bin.")


def to_pty(source: SimulatorSource, vehicle: Path | None) -> None:
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


def to_firmware(
    simulation: Simulation, speed: float, clock: Clock, vehicle: Path | None, key_file: Path | None
) -> None:
    """Run the reference collector on an emulated board until the scenario ends or Ctrl-C.

    Raises:
        SourceError: QEMU or the compiler is missing, or the scenario does not fit one collector.
    """
    from gateway.makers.emulated_board import EmulatedBoard
    from gateway.makers.firmware_build import build_board, require_board_tools
    from gateway.makers.sensor_feed import SensorFeed, play
    from gateway.security.key_file import KeyFile

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


def to_ble(source: SimulatorSource, scenario: Scenario, vehicle: Path | None) -> None:
    """Advertise and stream as Bluetooth hubs until the scenario ends or a signal asks to stop.

    Raises:
        SourceError: this system has no D-Bus daemon, through which programs use Bluetooth on Linux.
    """
    try:
        from gateway.simulator.bluez_thread import BluezStandIn
        from gateway.simulator.dbus_daemon import PrivateBus
        from gateway.simulator.hubs import ble_hubs, broadcast
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


def truth_lines(simulation: Simulation) -> Iterator[str]:
    """Yield the true values of every wheel and the counts of the faults."""
    for position, truth in simulation.truth.items():
        numbers = truth.numbers(0.0)
        leading, trailing = truth.contact_edges_rad(0.0)
        yield (
            f"  {position}: {truth.load_n(0.0):.0f} N, {truth.pressure_pa(0.0) * 1e-3:.1f} kPa, contact "
            f"{leading:+.4f} to {trailing:+.4f} rad, Bs {numbers.Bs:.4e} Cw {numbers.Cw:.4f} "
            f"Rs {numbers.Rs:.3f} Ts {numbers.Ts:.3f}"
        )
    for fault in simulation.faults:
        yield f"  fault {fault}: {_counts(fault)}"


def _counts(fault: Fault) -> str:
    counts = [f"{value} {name.replace('_', ' ')}" for name, value in fault.counts.as_dict().items() if value]
    return ", ".join(counts) or "no effect"
