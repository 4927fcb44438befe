"""What earlier versions had is refused with what replaces it."""

import pytest

from gateway.core.cli import COMMANDS
from gateway.core.cli.options import KnownName
from gateway.core.config.validation import parse_document
from gateway.core.errors import ConfigError
from gateway.core.estimates.registry import make_estimator
from gateway.core.removed_names import REMOVED
from gateway.simulator.scenario_model import Scenario
from tests.testkit.commands import invoked

TYPED = [name for name in REMOVED if name.startswith("treadlink ")]


@pytest.mark.parametrize("name", TYPED)
def test_a_removed_command_or_option_names_its_replacement(name: str) -> None:
    words = name.split()[1:]
    done = invoked(*words)
    assert done.exit_code == 2
    assert "was removed" in done.output
    assert REMOVED[name] in done.output


@pytest.mark.parametrize("name", [name for name in REMOVED if name.startswith("--")])
def test_a_removed_value_of_an_option_names_what_is_left(name: str) -> None:
    option, value = name.split()
    done = invoked("live" if option == "--estimator" else "diagnose", "x.mcap", option, value)
    assert done.exit_code == 2
    assert f"'{value}' was removed. {REMOVED[name]}" in done.output


def test_a_removed_estimator_is_refused_in_python_too() -> None:
    with pytest.raises(ConfigError, match="was removed"):
        make_estimator("water-wedge")


@pytest.mark.parametrize("name", [name for name in REMOVED if name.startswith("[")])
def test_a_removed_key_names_its_replacement(name: str) -> None:
    table, key = name.split()
    with pytest.raises(ConfigError, match="removed; ") as refused:
        parse_document(Scenario, f"{table}\n{key} = 1.0\n", "wheel.toml")
    assert REMOVED[name] in str(refused.value)


def test_no_command_is_both_removed_and_present() -> None:
    assert not [name for name in TYPED if len(name.split()) == 2 and name.split()[1] in COMMANDS]


def test_an_unknown_command_or_option_is_still_compared_with_the_known_ones() -> None:
    assert "Did you mean inspect" in invoked("inspct").output
    assert "Did you mean" in invoked("inspect", "--jsonn").output


def test_names_of_a_choice_are_still_compared() -> None:
    with pytest.raises(Exception, match="Did you mean exact"):
        KnownName(["exact", "paper"]).convert("exakt", None, None)
