"""`treadlink scan`: list hubs in range and serial ports as sources for `treadlink live`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from gateway.bench.commands.doctor_checks import Level, check_device
from gateway.core.cli import exit_status
from gateway.core.cli.options import FiniteRange
from gateway.core.text.text import json_text

if TYPE_CHECKING:
    from gateway.core.links.ble_hub import Sighting
    from gateway.core.links.ble_source import ScanResult


@click.command()
@click.option(
    "--timeout",
    "seconds",
    type=FiniteRange(0.1, 120.0),
    default=5.0,
    show_default=True,
    metavar="SECONDS",
    help="Scan for this many seconds.",
)
@click.option(
    "--adapter", default="", metavar="NAME", help="Bluetooth adapter on Linux, such as hci1.  [default: the first]"
)
@click.option("--all", "everything", is_flag=True, help="Also list Bluetooth devices that are not hubs.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def scan(seconds: float, adapter: str, everything: bool, as_json: bool) -> None:
    """List hubs on Bluetooth LE, with signal strength and battery, and serial ports.

    Without Bluetooth only serial ports are listed, with advice on what is missing. The exit status is 1 if nothing is
    found.
    """
    from gateway.core.links.ble_source import scan_devices

    around = scan_devices(seconds, adapter)
    hubs = [sighting for sighting in around.sightings if sighting.is_hub or everything]
    ports = _ports()
    if as_json:
        click.echo(json_text(_report(around, hubs, ports), indent=2))
    else:
        _print(around, hubs, ports, seconds)
    if not hubs and not ports:
        raise SystemExit(exit_status.NO_RESULT)


def _ports() -> list[dict[str, Any]]:
    from serial.tools import list_ports

    ports = []
    for port in sorted(list_ports.comports()):
        check = check_device(Path(port.device))
        description = port.description if port.description not in (None, "", "n/a") else ""
        ports.append(
            {
                "source": f"serial:{'//' if port.device.startswith('/') else ''}{port.device}",
                "device": port.device,
                "description": description,
                "usable": check.level is Level.OK,
                "remedy": check.remedy,
            }
        )
    return ports


def _report(around: ScanResult, hubs: list[Sighting], ports: list[dict[str, Any]]) -> dict[str, Any]:
    from gateway.core.text.plain_values import record

    fault = around.fault
    return {
        "bluetooth_fault": None if fault is None else {"text": str(fault), "remedy": fault.remedy},
        "hubs": [{"source": _source(hub, hubs), **record(hub, without=("device",))} for hub in hubs],
        "serial_ports": ports,
    }


def _print(around: ScanResult, hubs: list[Sighting], ports: list[dict[str, Any]], seconds: float) -> None:
    if around.fault is not None:
        click.secho(f"Bluetooth: {around.fault}", fg="yellow")
        click.echo(f"  {around.fault.remedy}")
    elif not hubs:
        others = len(around.sightings)
        click.echo(f"No hub found within {seconds:g} s" + (f". --all lists {others} other devices." if others else "."))
    width = max((len(_source(hub, hubs)) for hub in hubs), default=0)
    for hub in hubs:
        signal = f"{hub.rssi_dbm} dBm" if hub.rssi_dbm is not None else "connected"
        battery = f"battery {hub.battery_percent} %" if hub.battery_percent is not None else "battery unknown"
        name = f"{hub.name or 'unnamed'} at {hub.address}"
        click.echo(f"{_source(hub, hubs):<{width}}  {signal:>9}  {battery:<16}  {name}")
    twins = sorted({hub.name for hub in hubs if hub.name and _twins(hub, hubs)})
    for name in twins:
        click.secho(f"Several hubs are named '{name}'. Give the address.", fg="yellow")
    if not ports:
        click.echo("No serial port found.")
    for port in ports:
        note = "" if port["usable"] else f"  not usable: {port['remedy']}"
        click.echo(f"{port['source']}  {port['description']}{note}".rstrip())


def _source(hub: Sighting, hubs: list[Sighting]) -> str:
    """Return a URI that is unique among the hubs in range."""
    from urllib.parse import quote

    return f"ble://{hub.address if _twins(hub, hubs) or not hub.name else quote(hub.name)}"


def _twins(hub: Sighting, hubs: list[Sighting]) -> bool:
    return sum(peer.name.casefold() == hub.name.casefold() for peer in hubs) > 1
