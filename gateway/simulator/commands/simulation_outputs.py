"""Outputs of a simulation: a file or a pseudo-terminal; and its true values."""

import contextlib
import shlex
from collections.abc import Callable, Iterator
from pathlib import Path

import click

from gateway.core.cli.stop_signals import stop_request
from gateway.core.clock import Clock
from gateway.core.errors import OutputError
from gateway.core.links.source import Chunk, LinkItem
from gateway.core.recording.writer import RecordingWriter, whole_recording
from gateway.core.text.output_file import OutputFile
from gateway.core.text.progress import progress_bar
from gateway.simulator.link_faults import Fault
from gateway.simulator.pty_link import PtyPort
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
