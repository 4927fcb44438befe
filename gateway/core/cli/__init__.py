"""The `treadlink` command. Subcommands are imported only when they run, so that `--help` is quick."""

import errno
import gc
import logging
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Final, NoReturn

import click
from click.shell_completion import CompletionItem

from gateway import __version__
from gateway.core.cli.command_group import CommandGroup
from gateway.core.cli.path_option import path_option
from gateway.core.errors import OutputError, TreadlinkError
from gateway.core.feature import CommandLine, Registry, features, object_of
from gateway.core.nearest_name import did_you_mean
from gateway.core.reasons import CoreCode, Reason
from gateway.core.removed_names import replacement

# The matrices here are small, so waking a thread costs more than the product it computes, many times more on a busy
# computer, whatever the environment asks for. This must be set before numpy is imported; child processes inherit it.
for _variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[_variable] = "1"
# Results are freed without the collector. By default it takes 6 % of the time of an estimation, a pass over all objects
# 60 ms, which a live result would wait for.
gc.set_threshold(20_000, 20, 20)

# Answers of a disk or a device, not of the program's own doing.
_LIBRARY_WITHOUT_ROOM: Final = ("failed to map segment", "annot allocate memory")
_UNUSABLE: Final = (errno.ENAMETOOLONG, errno.ELOOP, errno.ENOTDIR, errno.EISDIR, errno.EACCES)
_REFUSALS: Final = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)

# name -> (module:function, line in `treadlink --help`), in the order in which a user meets them.
_OF_CORE: Final = {
    "live": CommandLine("gateway.core.cli.live:live", "Show live estimates from a hub, the simulator or a recording."),
    "record": CommandLine("gateway.core.cli.record:record", "Record a source to a file without a screen."),
    "replay": CommandLine("gateway.core.cli.replay:replay", "Replay a recording with live estimates."),
    "inspect": CommandLine(
        "gateway.core.cli.inspect:inspect", "Show the links, losses, rates and time line of recordings."
    ),
    "estimate": CommandLine("gateway.core.cli.estimate:estimate", "Estimate recordings in one pass and write tables."),
}
COMMANDS: Final = {**_OF_CORE, **{name: line for feature in features() for name, line in feature.commands.items()}}
"""Commands of the core, then those of the features; packages of others add theirs."""

_logger = logging.getLogger(__name__)


class LazyGroup(CommandGroup):
    """Command group that imports a subcommand only when it is used."""

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002 - click's signature
        """Return names in the order of COMMANDS, those of plug-ins last."""
        return [*COMMANDS, *_of_plugins()]

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:  # noqa: ARG002 - click's signature
        """Import and return the subcommand, or None for an unknown name."""
        if cmd_name not in COMMANDS:
            from gateway.core.plugins import load

            command = load(Registry.COMMANDS, cmd_name, COMMANDS, plugin_fault)
        else:
            command = object_of(COMMANDS[cmd_name].target)
        return command if isinstance(command, click.Command) else None

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find the subcommand; for an unknown name, propose the most similar one."""
        if (
            args
            and args[0] not in COMMANDS
            and not args[0].startswith("-")
            and args[0] not in _of_plugins()
            and not replacement(ctx.command_path, args[0])
        ):
            ctx.fail(f"No such command '{args[0]}'. {did_you_mean(args[0], self.list_commands(ctx))}".rstrip())
        return super().resolve_command(ctx, args)

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem]:
        """Complete the name of a subcommand without importing any."""
        options = click.Command.shell_complete(self, ctx, incomplete)
        commands = [CompletionItem(name, help=text) for name, text in _summaries() if name.startswith(incomplete)]
        return [*commands, *options]

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse the options before the subcommand; `--help` prints here."""
        with _ended_from_outside(ctx):
            return super().parse_args(ctx, args)

    def invoke(self, ctx: click.Context) -> Any:
        """Run the subcommand."""
        with _ended_from_outside(ctx):
            return super().invoke(ctx)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:  # noqa: ARG002
        """List the commands from the table without importing them."""
        with formatter.section("Commands"):
            formatter.write_dl(_summaries())


def _of_plugins() -> dict[str, str]:
    """Return the packages of the commands that plug-ins add, by name; nothing of them is imported."""
    from gateway.core.plugins import installed, names

    added = names(Registry.COMMANDS, COMMANDS)
    return {plugin.name: plugin.package for plugin in installed(Registry.COMMANDS) if plugin.name in added}


def _summaries() -> list[tuple[str, str]]:
    """Return every command with its line in the help."""
    of_plugins = [(name, f"Command of the package {package}.") for name, package in _of_plugins().items()]
    return [*((name, line.summary) for name, line in COMMANDS.items()), *of_plugins]


def plugin_fault(_plugin: object, command: object) -> Reason | None:
    """Return why the object of a plug-in is no command, None when it is one."""
    return (
        None
        if isinstance(command, click.Command)
        else Reason(CoreCode.PLUGIN_REFUSED, why="wrong_type", expected="a click.Command")
    )


@contextmanager
def _ended_from_outside(ctx: click.Context) -> Iterator[None]:
    """End a command quietly, with the exit status that shells give, upon a signal or when its output is closed."""
    from gateway.core.cli import exit_status

    try:
        yield
    except KeyboardInterrupt as error:
        with suppress(OSError):  # the terminal may be closed
            click.echo("\nAborted!", err=True)
        ctx.exit(exit_status.of_signal(error))
    except BrokenPipeError:
        ctx.exit(exit_status.CLOSED_PIPE)


def _flush_output() -> None:
    """Print what is left, or drop it where the output is closed.

    The interpreter would complain, and end with another status, when it flushes it.
    """
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except (OSError, ValueError):
            with suppress(OSError, ValueError):
                os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


@click.group(cls=LazyGroup, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="treadlink")
@click.option("-v", "--verbose", "verbosity", count=True, help="Log more to standard error; -vv for debugging.")
@path_option("--log", "log_file", help="Write the log to this file, not to standard error.")
def treadlink(verbosity: int, log_file: Path | None) -> None:
    """Know what a tire does while it rolls, by an accelerometer on its inner liner.

    \b
    First steps, without a sensor:
      treadlink live sim:demo                              watch a simulated car
      treadlink simulate lab --out lab.mcap --duration 20  make a recording
      treadlink estimate lab.mcap --html lab.html          its numbers, and a page
      treadlink explain provisional                        what a word means
    """
    from gateway.core.cli.logs import configure_logging

    configure_logging(verbosity, log_file)


def main() -> None:
    """Run the command; errors that the user can correct are shown as a message and a remedy, without a traceback."""
    from gateway.core.cli import stop_signals
    from gateway.core.cli.stream_encoding import shown_streams

    stop_signals.install()
    with shown_streams():
        _run()


def _run() -> None:
    try:
        with _explained_refusal():
            try:
                treadlink(prog_name="treadlink")
            except SystemExit as ended:
                if not ended.code:
                    # What is still buffered may be refused too, and a result that cannot be written is no success.
                    with suppress(BrokenPipeError, ValueError):
                        sys.stdout.flush()
                raise
    except TreadlinkError as error:
        _logger.debug("command failed", exc_info=True)
        _end_with(error)
    finally:
        _flush_output()


@contextmanager
def _explained_refusal() -> Iterator[None]:
    """Explain what the system refuses and no command handles itself: memory, a path, or as a rule standard output.

    Raises:
        OutputError: a disk or device refuses an output.
        TreadlinkError: there is not enough memory, or no file can have this path.
    """
    try:
        yield
    except (MemoryError, ImportError) as error:
        # A library that finds no room is an ImportError, whose text alone says why.
        if isinstance(error, ImportError) and not any(sign in str(error) for sign in _LIBRARY_WITHOUT_ROOM):
            raise
        raise _memory_error() from error
    except OSError as error:
        if error.errno == errno.ENOMEM:
            raise _memory_error() from error
        if error.errno in _UNUSABLE and error.filename is not None:
            raise TreadlinkError(
                f"'{error.filename}' cannot be used: {error.strerror}", "Give another path."
            ) from error
        if error.errno not in _REFUSALS:
            raise
        raise OutputError(
            f"the output cannot be written: {error.strerror}", "Free some space, or write to another disk."
        ) from error


def _memory_error() -> TreadlinkError:
    return TreadlinkError(
        "there is not enough memory", "Close other programs, raise the limit (ulimit -v), or process less at a time."
    )


def _end_with(error: TreadlinkError) -> NoReturn:
    from gateway.core.cli import exit_status
    from gateway.core.text.text import clean

    # Messages quote names and values from files, which must not control the terminal.
    message, remedy = ("\n".join(map(clean, text.split("\n"))) for text in (str(error), error.remedy))
    with suppress(OSError):  # standard error may be refused too
        click.secho(f"treadlink: {message}", fg="red", err=True)
        if remedy:
            click.echo(f"  {remedy}", err=True)
    raise SystemExit(exit_status.NO_RESULT) from error
