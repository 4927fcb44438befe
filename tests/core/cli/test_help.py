"""Help of every command: 80 columns, each option explained, and an example that the command line takes."""

import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import click
import pytest

from gateway.core.cli import treadlink
from tests.testkit.commands import program

COLUMNS = 80


def commands(command: click.Command, context: click.Context) -> Iterator[click.Context]:
    yield context
    if isinstance(command, click.Group):
        for name in command.list_commands(context):
            inner = command.get_command(context, name)
            assert inner is not None
            yield from commands(inner, click.Context(inner, info_name=name, parent=context, terminal_width=COLUMNS))


TOP = click.Context(treadlink, info_name="treadlink", terminal_width=COLUMNS)
CONTEXTS = [pytest.param(context, id=context.command_path) for context in commands(treadlink, TOP)]


def parse(words: list[str]) -> None:
    """Parse a command line without running it; values are not looked at."""
    command: click.Command | None = treadlink
    while isinstance(command, click.Group):
        context = click.Context(command)
        _, command, words = command.resolve_command(context, words)
    assert command is not None
    _, _, order = command.make_parser(click.Context(command)).parse_args(list(words))
    required = {parameter for parameter in command.params if parameter.required}
    assert required <= set(order), f"{words} leaves out {required - set(order)}"


@pytest.mark.parametrize("context", CONTEXTS)
def test_help_fits_eighty_columns(context):
    # One part of a dataset is a path that DuckDB takes, one line a filter of jq: both are typed as they stand.
    quoted = ("duckdb", "jq '")
    lines = context.command.get_help(context).splitlines()
    assert [line for line in lines if len(line) > COLUMNS and not any(word in line for word in quoted)] == []


@pytest.mark.parametrize("context", CONTEXTS)
def test_every_option_is_explained_and_its_value_is_named(context):
    for option in context.command.params:
        if isinstance(option, click.Option):
            assert option.help, option.opts
            assert option.count or "RANGE" not in option.make_metavar(context), option.opts


@pytest.mark.parametrize("context", CONTEXTS)
def test_a_command_that_needs_arguments_shows_an_example_that_it_takes(context):
    command = context.command
    shown = command.get_help(context)
    alone = re.findall(r"Example: `(treadlink [^`]*)`", " ".join(shown.split()))
    examples = [*alone, *re.findall(r"^ {4,}(treadlink .*)$", shown, re.MULTILINE)]
    for example in examples:
        words = shlex.split(re.split(r" \| |  | > ", example)[0])
        parse(words[1:])
    needs = any(parameter.required and isinstance(parameter, click.Argument) for parameter in command.params)
    named = any(example.startswith(context.command_path) for example in examples)
    assert named or not needs or isinstance(command, click.Group)


def test_first_steps_run_one_after_another(tmp_path: Path) -> None:
    steps = re.findall(r"^ {4}treadlink (.*?)  ", treadlink.get_help(TOP), re.MULTILINE)
    files = [step for step in steps if not step.startswith("live ")]
    assert len(files) > 1
    for step in files:
        ended = program(*shlex.split(re.sub(r"(--duration) \d+", r"\1 1", step)), folder=tmp_path)
        assert ended.status == 0, ended.stderr
    assert {"lab.mcap", "lab.html"} <= {path.name for path in tmp_path.iterdir()}


@pytest.mark.parametrize(
    "words", [["liev"], ["live", "--recrod", "x"], ["estimate", "--estimator", "waer", "x"], ["keys", "nwe"]]
)
def test_a_misspelt_word_is_answered_with_the_nearest_one(words, capsys):
    with pytest.raises(SystemExit):
        treadlink(words, prog_name="treadlink")
    said = capsys.readouterr().err
    assert re.search(r"Did you mean|Possible options|did you mean", said), said
