"""Shells complete commands, options and values."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.testkit.commands import invoked, run

ROOT = Path(__file__).parents[3]


def script(shell: str) -> str:
    return run("completion", shell)


def completed(words: str, index: int) -> list[str]:
    """Return what the program answers to the script of bash."""
    environment = os.environ | {
        "_TREADLINK_COMPLETE": "bash_complete",
        "COMP_WORDS": words,
        "COMP_CWORD": str(index),
        "PYTHONPATH": str(ROOT),
    }
    command = [sys.executable, "-c", "from gateway.core.cli import main; main()"]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    return [line.partition(",")[2] for line in done.stdout.split()]


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_script_names_the_program(shell: str) -> None:
    assert "_TREADLINK_COMPLETE" in script(shell)


def test_bash_accepts_the_script() -> None:
    bash = shutil.which("bash")
    assert bash is not None
    subprocess.run([bash, "-n"], input=script("bash"), text=True, check=True)


def test_commands_options_and_values_are_completed() -> None:
    assert completed("treadlink es", 1) == ["estimate"]
    assert "--estimator" in completed("treadlink estimate --es", 2)
    assert "weak-form" in completed("treadlink estimate --estimator we", 3)


def test_unknown_shell_is_refused() -> None:
    done = invoked("completion", "tcsh")
    assert done.exit_code == 2
    assert "bash" in done.output
