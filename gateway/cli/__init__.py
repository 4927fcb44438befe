"""The `treadlink` command. Subcommands are imported only when they run, so that `--help` is quick."""

from __future__ import annotations

import importlib
import os
from typing import Any, Final

import click

from gateway import __version__
from gateway.errors import TreadlinkError

# The matrices here are small: waking a thread for each product costs more than the product. Before numpy is imported;
# processes started from here inherit it.
for _variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

# name -> (module:function, one line for `treadlink --help`); the order is the order of a user's day.
COMMANDS: Final[dict[str, tuple[str, str]]] = {
    "live": ("gateway.cli.live:live", "Watch wheels being estimated, from a hub, the simulator or a recording."),
    "record": ("gateway.cli.record:record", "Record a source to a file without a console."),
    "replay": ("gateway.cli.replay:replay", "Play a recording through the console again."),
    "inspect": ("gateway.cli.inspect:inspect", "Show what is in a recording: links, losses, rates, a time line."),
    "estimate": ("gateway.cli.estimate:estimate", "Estimate recordings in one pass: one row a revolution and wheel."),
    "diagnose": ("gateway.cli.diagnose:diagnose", "Find what the model lacks in recordings, and name it."),
    "calibrate": ("gateway.cli.calibrate:calibrate", "Fit load and reference numbers of a tire to known loads."),
    "import": ("gateway.cli.import_measurement:import_", "Turn a CSV, MAT or Parquet measurement into a recording."),
    "repair": ("gateway.cli.repair:repair", "Rescue a recording that was cut off or damaged."),
    "compact": ("gateway.cli.repair:compact", "Compress a finished recording."),
    "simulate": ("gateway.cli.simulate:simulate", "Simulate hubs and tires to a file or a pseudo-terminal."),
    "figures": ("gateway.cli.figures:figures", "Redraw the papers' figures from simulated tires."),
    "scan": ("gateway.cli.scan:scan", "List the hubs and serial ports that there are, with signal and battery."),
    "command": ("gateway.cli.command:command", "Tell a hub to start, stop, change its rate, or the time."),
    "keys": ("gateway.cli.keys:keys", "Keep the keys with which sensors sign what they send."),
    "doctor": ("gateway.cli.doctor:doctor", "Check ports, permissions, configuration and optional packages."),
    "protocol": ("gateway.cli.protocol:protocol", "Generate the firmware's C header, encoder and test vectors."),
}

INTERRUPTED: Final = 130
"""Exit status after Ctrl-C: 128 and the number of the signal, as shells have it."""


class LazyGroup(click.Group):
    """A group that imports a subcommand when it is used, not when it is listed."""

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002 - click's signature
        """Return names in the order of COMMANDS."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:  # noqa: ARG002 - click's signature
        """Import and return the subcommand, or None when there is none of that name."""
        if cmd_name not in COMMANDS:
            return None
        module_name, attribute = COMMANDS[cmd_name][0].split(":")
        command: click.Command = getattr(importlib.import_module(module_name), attribute)
        return command

    def invoke(self, ctx: click.Context) -> Any:
        """Run the subcommand; Ctrl-C ends it with what a shell says of a program that it ended."""
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt:
            click.echo("\nAborted!", err=True)
            ctx.exit(INTERRUPTED)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:  # noqa: ARG002
        """List the commands from the table, importing none."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, text) for name, (_, text) in COMMANDS.items()])


@click.group(cls=LazyGroup, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="treadlink")
def treadlink() -> None:
    """Gateway for intelligent tires: decode, record, replay and estimate from inner-liner accelerometers."""


def main() -> None:
    """Run the command; faults the user can mend are shown as a message and a remedy, not a traceback."""
    try:
        treadlink(standalone_mode=True)
    except TreadlinkError as error:
        from gateway.views.text import clean

        # Messages repeat names and values from files; those must not be able to command the terminal.
        message, remedy = ("\n".join(map(clean, text.split("\n"))) for text in (str(error), error.remedy))
        click.secho(f"treadlink: {message}", fg="red", err=True)
        if remedy:
            click.echo(f"  {remedy}", err=True)
        raise SystemExit(1) from error
