"""Command reference, generated from click."""

import inspect
from collections.abc import Iterator
from typing import Final

import click

from gateway.core.cli import treadlink
from tools.docs_site.markdown import escaped, sentence

_HELP: Final = "Show this message and exit."


def commands_markdown() -> str:
    """Return the reference of every command, in the order of `treadlink --help`."""
    context = click.Context(treadlink, info_name="treadlink")
    lines = [
        "# Commands",
        "",
        f"{sentence(_first_line(treadlink.help or ''))} Help on a command: `treadlink COMMAND --help`.",
        "",
        *_options(treadlink, context),
    ]
    for name in treadlink.list_commands(context):
        command = treadlink.get_command(context, name)
        assert command is not None
        lines += _command(command, click.Context(command, info_name=name, parent=context), 2)
    return "\n".join(lines).rstrip() + "\n"


def _first_line(text: str) -> str:
    return text.strip().partition("\n\n")[0].replace("\n", " ")


def _command(command: click.Command, context: click.Context, level: int) -> Iterator[str]:
    yield from (f"{'#' * level} {context.command_path}", "")
    usage = " ".join([context.command_path, *command.collect_usage_pieces(context)])
    yield from ("```text", usage, "```", "")
    yield from _help_text(command.help or "")
    yield from _options(command, context)
    if isinstance(command, click.Group):
        for name in command.list_commands(context):
            inner = command.get_command(context, name)
            assert inner is not None
            yield from _command(inner, click.Context(inner, info_name=name, parent=context), level + 1)


def _help_text(text: str) -> Iterator[str]:
    """Yield the paragraphs of a help text; click's unwrapped blocks (after a backspace) become code."""
    for paragraph in inspect.cleandoc(text).split("\n\n"):
        if paragraph.startswith("\b"):
            lines = paragraph.removeprefix("\b\n").split("\n")
            if not lines[0].startswith(" "):
                yield from (escaped(lines.pop(0)), "")
            yield from ("```text", *(line.removeprefix("  ") for line in lines), "```", "")
        else:
            yield from (escaped(paragraph), "")


def _options(command: click.Command, context: click.Context) -> Iterator[str]:
    records = [parameter.get_help_record(context) for parameter in command.get_params(context)]
    for names, meaning in (record for record in records if record is not None and record[1]):
        if meaning == _HELP:
            continue
        yield from (f"`{names}`", f":   {escaped(meaning)}", "")
