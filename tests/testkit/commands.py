"""Run `treadlink` in this process: its commands, or the whole program on standard streams of its own."""

import io
import sys
from pathlib import Path
from typing import NamedTuple

import pytest
from click.testing import CliRunner, Result

from gateway.core.cli import main, treadlink


def invoked(*words: object, input: str | None = None) -> Result:
    """Run a command, given as words or as one line, and return how it ends; it raises nothing."""
    return CliRunner().invoke(treadlink, _line(words), input=input)


def _line(words: tuple[object, ...]) -> str | list[str]:
    return words[0] if len(words) == 1 and isinstance(words[0], str) else [str(word) for word in words]


def run(*words: object) -> str:
    """Run a command, given as words or as one line, and return what it prints; it must succeed."""
    result = CliRunner().invoke(treadlink, _line(words), catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.output


class Ended(NamedTuple):
    """How the program ended.

    Attributes:
        status: its exit status.
        stdout: what it printed.
        stderr: its messages.
    """

    status: int
    stdout: str
    stderr: str


def program(*words: object, folder: Path | None = None, encoding: str = "utf-8") -> Ended:
    """Run `main` as a process does, in a folder, on standard streams of an encoding.

    An error that it does not explain is raised.
    """
    streams = [io.TextIOWrapper(io.BytesIO(), encoding, newline="") for _ in range(2)]
    status: object = 0
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["treadlink", *map(str, words)])
        for name, stream in zip(("stdout", "stderr"), streams, strict=True):
            patch.setattr(sys, name, stream)
        # The handlers of signals are those of this process.
        patch.setattr("gateway.core.cli.stop_signals.install", lambda: None)
        if folder is not None:
            patch.chdir(folder)
        try:
            main()
        except SystemExit as ended:
            status = ended.code or 0
    assert isinstance(status, int)
    return Ended(status, *(stream.detach().getvalue().decode(encoding) for stream in streams))  # type: ignore[attr-defined]
