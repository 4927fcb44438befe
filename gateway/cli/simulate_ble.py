"""`treadlink simulate --ble`: the scenario's hubs on a Bluetooth that is all software."""

from __future__ import annotations

import shlex
import threading
from collections.abc import Callable
from pathlib import Path

import click

from gateway.errors import SourceError
from gateway.simulator.scenario_model import Scenario
from gateway.simulator.simulator_source import SimulatorSource


def to_ble(source: SimulatorSource, scenario: Scenario, vehicle: Path | None) -> None:
    """Let the hubs advertise and stream until the scenario ends or Ctrl-C.

    Raises:
        SourceError: this system has no D-Bus daemon, by which programs reach Bluetooth on Linux.
    """
    try:
        from gateway.simulator.bluetooth.bluez_thread import BluezStandIn
        from gateway.simulator.bluetooth.dbus_daemon import PrivateBus
        from gateway.simulator.bluetooth.hubs import ble_hubs, broadcast
    except ImportError as error:
        raise SourceError("simulated Bluetooth works on Linux only", "Use --pty or --out.") from error

    stop = threading.Event()
    hubs = ble_hubs(scenario)
    with PrivateBus() as bus, BluezStandIn(bus.address) as bluez:
        for hub in hubs.values():
            hub.on_listening = _teller(hub.peripheral.name)
            bluez.add(hub.peripheral)
        uris = " ".join(f"ble://{hub.peripheral.name}" for hub in hubs.values())
        config = f" --config {shlex.quote(str(vehicle))}" if vehicle is not None else ""
        click.echo("The hubs advertise on a Bluetooth of their own. In another terminal run\n")
        click.echo(f"  export DBUS_SYSTEM_BUS_ADDRESS={shlex.quote(bus.address)}")
        click.echo(f"  treadlink scan\n  treadlink live {uris}{config}\n\nCtrl-C ends it.")
        try:
            sent = broadcast(source, hubs, bluez, stop)
        except KeyboardInterrupt:
            stop.set()
            click.echo("")
        else:
            click.echo(f"sent {', '.join(f'{sent[n]} notifications of hub {n}' for n in sent)}")


def _teller(name: str) -> Callable[[bool], None]:
    return lambda listening: click.echo(f"{name}: {'somebody listens' if listening else 'nobody listens any more'}")
