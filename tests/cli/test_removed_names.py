"""What earlier versions had is refused with what replaces it."""

import pytest

from gateway.cli import COMMANDS
from gateway.cli.options import KnownName
from gateway.removed_names import REMOVED
from tests.testkit.commands import invoked

TYPED = [name for name in REMOVED if name.startswith("treadlink ")]


@pytest.mark.parametrize("name", TYPED)
def test_a_removed_command_or_option_names_its_replacement(name: str) -> None:
    words = name.split()[1:]
    done = invoked(*words)
    assert done.exit_code == 2
    assert "was removed" in done.output
    # click breaks no line of an error
    assert REMOVED[name] in done.output


def test_no_command_is_both_removed_and_present() -> None:
    assert not [name for name in TYPED if len(name.split()) == 2 and name.split()[1] in COMMANDS]


def test_an_unknown_command_or_option_is_still_compared_with_the_known_ones() -> None:
    assert "Did you mean inspect" in invoked("inspct").output
    assert "Did you mean" in invoked("inspect", "--jsonn").output


def test_names_of_a_choice_are_still_compared() -> None:
    with pytest.raises(Exception, match="Did you mean exact"):
        KnownName(["exact", "paper"]).convert("exakt", None, None)
