"""Numbers quoted in the documentation against the commands that print them."""

import re
import shlex
from importlib.util import find_spec
from itertools import groupby
from pathlib import Path

import click
import pytest

from gateway.core.cli import treadlink
from tools.docs_outputs import (
    PAGES,
    ROOT,
    Mark,
    all_marks,
    check,
    disagreement,
    marks_of,
    unmarked_outputs,
)
from tools.docs_site.filled_tables import filled

MARKS = [mark for mark in all_marks() if mark.kind != "file"]
QUICK_PAGES = [
    page
    for page, marks in groupby(MARKS, key=lambda mark: mark.page)
    if any(mark.kind == "output" and not mark.slow for mark in marks)
]


def name_of(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


def parse(words: list[str]) -> None:
    """Parse a treadlink command line without running it; values are not looked at."""
    command: click.Command | None = treadlink
    while isinstance(command, click.Group):
        command = command.get_command(click.Context(command), words[0])
        words = words[1:]
    assert command is not None
    command.make_parser(click.Context(command)).parse_args(list(words))


@pytest.mark.parametrize("mark", MARKS, ids=lambda mark: f"{mark.page.stem}: {mark.text}")
def test_quoted_command_exists(mark: Mark) -> None:
    program, *words = shlex.split(mark.text)
    if program == "python":
        module = words[1] if words[0] == "-m" else words[0]
        assert find_spec(module) if words[0] == "-m" else (ROOT / module).is_file()
        return
    assert program == "treadlink"
    parse(words)


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_shell_examples_name_existing_options(page: Path) -> None:
    for block in re.findall(r"^```sh\n(.*?)^```", page.read_text("utf-8"), re.MULTILINE | re.DOTALL):
        for line in block.replace("\\\n", " ").splitlines():
            words = shlex.split(line, comments=True)
            if words and words[0] == "treadlink":
                parse(words[1 : words.index("|") if "|" in words else None])


@pytest.mark.parametrize("page", QUICK_PAGES, ids=name_of)
def test_quick_command_prints_quoted_numbers(page: Path) -> None:
    assert not list(check(list(marks_of(page))))


@pytest.mark.parametrize("page", sorted((ROOT / "docs" / "evidence").glob("*.md")), ids=name_of)
def test_every_output_in_evidence_is_marked(page: Path) -> None:
    assert not unmarked_outputs(page.read_text("utf-8"))


def test_site_shows_the_command_above_its_numbers() -> None:
    command = "python tools/bench_budget.py"
    shown = filled(f"<!-- figures: {command} -->\n| a |\n|---|\n| 1 |\n")
    assert shown == f"Printed by `{command}`.\n\n| a |\n|---|\n| 1 |\n"
    itself = f"<!-- figures: {command} -->\n```text\n$ {command}\n```\n"
    assert filled(itself) == itself


def test_disagreement_names_the_line_that_is_not_printed() -> None:
    printed = "speed 65.0 ± 0.1\nload 5000 N\nBs 3.08e-3\n"
    assert disagreement("speed 65.0 ± 0.1\n...\nBs 3.08e-3\n", printed) == ""
    assert disagreement("load 5000 N\nspeed 65.0 ± 0.1\n", printed) == "speed 65.0 ± 0.1"
    assert disagreement("load 4000 N\n", printed) == "load 4000 N"
