"""`treadlink doctor`: check the prerequisites of a session."""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Final

import click

from gateway.bench.commands import doctor_checks as checks
from gateway.bench.commands.doctor_checks import Check, Level
from gateway.core.cli import exit_status
from gateway.core.cli.path_option import path_option
from gateway.core.clock import SystemClock
from gateway.core.text.aligned_table import for_terminal
from gateway.core.text.text import escaped, json_text

_COLOURS: Final = {Level.OK: "green", Level.WARNING: "yellow", Level.FAULT: "red"}


@click.command()
@click.argument("sources", nargs=-1, metavar="[SOURCE]...")
@path_option("--config", "config_path", help="Vehicle configuration (TOML) to check.")
@path_option(
    "--recordings", default=Path("recordings"), show_default=True, metavar="DIR", help="Folder for recordings."
)
@click.option("--json", "as_json", is_flag=True, help="Print the checks as JSON.")
def doctor(sources: tuple[str, ...], config_path: Path | None, recordings: Path, as_json: bool) -> None:
    """Check packages, plug-ins, ports, Bluetooth, permissions, disk space, terminal, configuration and each SOURCE.

    Of a recording as SOURCE, whether its curves verify sign and gain of the lateral axis of each wheel.
    Of a configuration also the largest part of the errors of the main quantities, and the statement to make better.
    The exit status is 1 if there is a fault, and 0 if there are only warnings.

    Example: `treadlink doctor /dev/ttyUSB0:921600 --config car.toml`
    """
    done = list(_run(sources, config_path, recordings))
    if as_json:
        click.echo(json_text([asdict(check) for check in done], indent=2))
    else:
        _print(done)
    if any(check.level is Level.FAULT for check in done):
        raise SystemExit(exit_status.NO_RESULT)


def _run(sources: Sequence[str], config_path: Path | None, recordings: Path) -> Iterator[Check]:
    yield from checks.check_python()
    yield from checks.check_packages()
    yield from checks.check_core()
    yield from checks.check_plugins()
    yield from checks.check_ports()
    yield from checks.check_bluetooth()
    yield from checks.check_disk(recordings)
    yield from checks.check_terminal(
        sys.stdout.isatty(), shutil.get_terminal_size(), sys.stdout.encoding or "", os.environ
    )
    if config_path is not None:
        yield from checks.check_config(config_path)
        yield from checks.check_errors(config_path)
    clock = SystemClock()
    for uri in sources:
        if uri.endswith((".mcap", ".bin")) and Path(uri).is_file():
            yield from checks.check_lateral_axes(Path(uri), config_path)
        else:
            yield from checks.check_source(uri, clock)


def _print(done: Sequence[Check]) -> None:
    for index, check in enumerate(done):
        line = for_terminal(f"{check.level:<8} {escaped(check.name)}: {escaped(check.text)}")
        click.echo(click.style(line[:8], fg=_COLOURS[check.level]) + line[8:])
        # The faults of one file share a remedy, which is printed once, after the last of them.
        has_shared_remedy = index + 1 < len(done) and done[index + 1].remedy == check.remedy
        if check.remedy and not has_shared_remedy:
            click.echo(for_terminal(f"{'':8} -> {escaped(check.remedy)}"))
    count = {level: sum(check.level is level for check in done) for level in Level}
    faults, warnings = count[Level.FAULT], count[Level.WARNING]
    click.echo(
        f"{faults} {'fault' if faults == 1 else 'faults'}, {warnings} {'warning' if warnings == 1 else 'warnings'}"
    )
