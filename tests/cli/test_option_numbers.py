"""Numbers of the command line: every command refuses what is not a finite number within its range."""

from collections.abc import Iterator

import click
import pytest
from click.testing import CliRunner

from gateway.cli import COMMANDS, treadlink
from gateway.cli.options import FiniteRange


def commands_below(command: click.Command, words: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], click.Command]]:
    if not isinstance(command, click.Group):
        yield words, command
        return
    for name, other in command.commands.items():
        yield from commands_below(other, (*words, name))


def float_parameters() -> dict[str, click.Parameter]:
    context = click.Context(treadlink)
    results: dict[str, click.Parameter] = {}
    for name in COMMANDS:
        command = treadlink.get_command(context, name)
        assert command is not None
        for words, leaf in commands_below(command, (name,)):
            for parameter in leaf.params:
                if isinstance(parameter.type, click.types.FloatParamType):
                    results[f"{' '.join(words)} {parameter.name}"] = parameter
    return results


def test_every_float_refuses_nan_and_infinity() -> None:
    result = float_parameters()
    assert {"diagnose budget_s", "simulate duration_s", "command rate rate_hz"} <= result.keys()
    for name, parameter in result.items():
        assert isinstance(parameter.type, FiniteRange), name
        for text in ("nan", "-nan", "inf", "-inf", "1e999", "NaN", "Infinity"):
            with pytest.raises(click.BadParameter, match="not a finite number"):
                parameter.type.convert(text, parameter, None)


@pytest.mark.parametrize(
    "arguments",
    [
        ("diagnose", "a.mcap", "--budget", "nan"),
        ("simulate", "lab", "--duration", "inf"),
        ("live", "sim:lab", "--duration", "nan"),
        ("orders", "a.mcap", "--speed-step", "nan"),
        ("scan", "--timeout", "nan"),
        ("campaign", "folder", "--out", "x.dataset", "--memory", "nan"),
        ("command", "rate", "tcp://127.0.0.1:1", "nan"),
    ],
)
def test_nan_is_a_wrong_command_line(arguments: tuple[str, ...]) -> None:
    result = CliRunner().invoke(treadlink, arguments)
    assert result.exit_code == 2, result.output
    assert "is not a finite number" in result.output


def test_numbers_outside_the_range_are_refused_as_before() -> None:
    result = CliRunner().invoke(treadlink, ["scan", "--timeout", "1000"])
    assert result.exit_code == 2
    assert "0.1<=x<=120.0" in result.output
    assert "not a valid float" in CliRunner().invoke(treadlink, ["scan", "--timeout", "x"]).output
