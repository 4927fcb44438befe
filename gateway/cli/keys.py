"""`treadlink keys`: the keys with which sensors and hubs sign."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Final

import click

from gateway.security.cmac import SecurityError
from gateway.security.freshness import Ledger
from gateway.security.key_file import KeyFile, counters_file, default_key_file, parse_identity, parse_keys
from gateway.security.private_file import read_private

_MOST_BYTES: Final = 16 << 20
_FILE = click.option(
    "--file", "path", type=click.Path(path_type=Path), help="Key file; default: the one of this user, for all vehicles."
)
_REPLACE = click.option("--replace", is_flag=True, help="Also where there is another key; that one is lost.")


@click.group()
def keys() -> None:
    """Keep the keys with which sensors sign what they send.

    They lie in a file that only you can read, never in a configuration or a recording. Whether signatures matter is
    up to the vehicle: [security] policy = "warn" or "require" in its TOML.
    """


@keys.command()
@click.argument("identities", nargs=-1, required=True, metavar="SERIAL...")
@_FILE
@_REPLACE
@click.option(
    "--show", is_flag=True, help="Print the keys, to be put into the sensors; anybody who sees them can sign."
)
def new(identities: tuple[str, ...], path: Path | None, replace: bool, show: bool) -> None:
    """Make keys for sensors (serial numbers of up to 8 hexadecimal digits) and hubs (16 digits)."""
    file = _open(path)
    names = list(dict.fromkeys(map(parse_identity, identities)))
    made = {name: file.make(name, replace=replace) for name in names}
    _keep(file, names)
    for name, key in made.items():
        click.echo(f"{name} {key.secret.hex()}" if show else f"{name}  check value {key.check_value()}")


@keys.command("import")
@click.argument("origin", metavar="FILE")
@_FILE
@_REPLACE
def import_(origin: str, path: Path | None, replace: bool) -> None:
    """Take over the keys in FILE, or in standard input with -.

    A line holds a serial number and a key of 32 hexadecimal digits.
    """
    file = _open(path)
    if origin == "-":
        text: str | None = sys.stdin.read(_MOST_BYTES)
    else:
        text = read_private(Path(origin), _MOST_BYTES)
    if text is None:
        raise SecurityError(f"there is no file '{origin}'", "Check the path.")
    taken = dict(parse_keys(text, "standard input" if origin == "-" else f"'{origin}'"))
    changed = [name for name, key in taken.items() if name in file.keys and file.keys[name] != key]
    file.add(taken, replace=replace)
    _keep(file, changed)
    click.echo(f"{len(taken)} key{'' if len(taken) == 1 else 's'} in {file.path}")


@keys.command("list")
@_FILE
def list_(path: Path | None) -> None:
    """List whose keys there are; the check value tells equal keys without showing them."""
    file = _open(path)
    if not file.keys:
        click.echo(f"no key in {file.path}")
    for name, key in sorted(file.keys.items()):
        click.echo(f"{'hub   ' if len(name) > 8 else 'sensor'} {name:16s}  check value {key.check_value()}")


@keys.command()
@click.argument("identities", nargs=-1, required=True, metavar="SERIAL...")
@_FILE
def remove(identities: tuple[str, ...], path: Path | None) -> None:
    """Forget the keys of sensors or hubs."""
    file = _open(path)
    names = list(dict.fromkeys(map(parse_identity, identities)))
    for name in names:
        file.remove(name)
    _keep(file, names)
    click.echo(f"removed {', '.join(names)}")


def _open(path: Path | None) -> KeyFile:
    return KeyFile(default_key_file() if path is None else path)


def _keep(file: KeyFile, anew: list[str]) -> None:
    """Save; with a new key a sensor's counters begin anew, and the old frames do not fit the new key."""
    ledger = Ledger(counters_file(file.path))
    file.save()
    for name in anew:
        ledger.forget(name)
