"""`treadlink keys`: manage the signing keys of sensors and hubs."""

import sys
from pathlib import Path
from typing import Final

import click

from gateway.core.cli.path_option import path_option
from gateway.core.nearest_name import missing_path_remedy
from gateway.security.cmac import SecurityError
from gateway.security.freshness import Ledger
from gateway.security.key_file import (
    KeyFile,
    counters_file,
    default_key_file,
    key_file_to_change,
    parse_identity,
    parse_keys,
)
from gateway.security.private_file import read_private

_MAX_INPUT_BYTES: Final = 16 << 20
_KEYS = path_option("--keys", "path", help="Key file.  [default: the user's key file, for all vehicles]")
_REPLACE = click.option("--replace", is_flag=True, help="Replace existing keys, which are lost.")


@click.group()
def keys() -> None:
    """Make, list and remove the keys that sensors and hubs sign with.

    The keys are kept in a file that only you can read, never in a configuration or recording. The vehicle
    configuration decides whether signatures are checked: [security] policy = "warn" or "require".
    """


@keys.command()
@click.argument("identities", nargs=-1, required=True, metavar="SERIAL...")
@_KEYS
@_REPLACE
@click.option(
    "--show", is_flag=True, help="Print the keys for programming the sensors. Anyone who sees a key can sign with it."
)
def new(identities: tuple[str, ...], path: Path | None, replace: bool, show: bool) -> None:
    """Create keys for sensors and hubs.

    A SERIAL of up to 8 hexadecimal digits is a sensor, one of 16 digits a hub.

    Example: `treadlink keys new 0000b001 --show`
    """
    names = list(dict.fromkeys(map(parse_identity, identities)))
    with key_file_to_change(_path(path)) as file:
        new_keys = {name: file.make(name, replace=replace) for name in names}
        _save(file, names)
    for name, key in new_keys.items():
        click.echo(f"{name} {key.secret.hex()}" if show else f"{name}  check value {key.check_value()}")


@keys.command("import")
@click.argument("origin", metavar="FILE")
@_KEYS
@_REPLACE
def import_(origin: str, path: Path | None, replace: bool) -> None:
    """Import the keys in FILE, or from standard input if FILE is -.

    Each line contains a serial number and a key of 32 hexadecimal digits.

    Example: `treadlink keys import vendor-keys.txt`
    """
    if origin == "-":
        text: str | None = sys.stdin.read(_MAX_INPUT_BYTES)
    else:
        text = read_private(Path(origin), _MAX_INPUT_BYTES)
    if text is None:
        raise SecurityError(f"file '{origin}' does not exist", missing_path_remedy(Path(origin)))
    imported = dict(parse_keys(text, "standard input" if origin == "-" else f"'{origin}'"))
    with key_file_to_change(_path(path)) as file:
        changed = [name for name, key in imported.items() if name in file.keys and file.keys[name] != key]
        file.add(imported, replace=replace)
        _save(file, changed)
    click.echo(f"{len(imported)} key{'' if len(imported) == 1 else 's'} in {file.path}")


@keys.command("list")
@_KEYS
def list_(path: Path | None) -> None:
    """List the sensors and hubs with keys.

    Equal keys have equal check values; the keys themselves are not printed. The last boot count is the highest that was
    accepted under the key. A hub that takes over a sensor must begin above it, or the sensor needs a new key.
    """
    file = KeyFile(_path(path))
    ledger = Ledger(counters_file(file.path))
    if not file.keys:
        click.echo(f"no keys in {file.path}")
    for name, key in sorted(file.keys.items()):
        check_value = key.check_value()
        boot_count = ledger.counter(name, check_value).boot_count
        last_boot = f"last boot count {boot_count}" if boot_count >= 0 else "not heard yet"
        click.echo(f"{'hub   ' if len(name) > 8 else 'sensor'} {name:16s}  check value {check_value}  {last_boot}")


@keys.command()
@click.argument("identities", nargs=-1, required=True, metavar="SERIAL...")
@_KEYS
def remove(identities: tuple[str, ...], path: Path | None) -> None:
    """Remove the keys of sensors or hubs.

    Example: `treadlink keys remove 0000b001`
    """
    names = list(dict.fromkeys(map(parse_identity, identities)))
    with key_file_to_change(_path(path)) as file:
        for name in names:
            file.remove(name)
        _save(file, names)
    click.echo(f"removed {', '.join(names)}")


def _path(path: Path | None) -> Path:
    return default_key_file() if path is None else path


def _save(file: KeyFile, renewed: list[str]) -> None:
    """Save the keys and reset the counters of renewed ones; frames signed with their old keys no longer verify."""
    ledger = Ledger(counters_file(file.path))
    file.save()
    for name in renewed:
        ledger.forget(name)
