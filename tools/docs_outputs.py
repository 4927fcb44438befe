"""Outputs quoted in the documentation: which command prints each, a check of the numbers, and an update in place.

A page marks what a command printed. Three marks, HTML comments on the line before a block, are understood:

    <!-- file: NAME -->              the fenced block is written to NAME before the page's commands run
    <!-- output: COMMAND -->         the fenced block shows `$ COMMAND` and its output; `...` stands for lines left out
    <!-- output(slow): COMMAND -->   the same, for commands of more than some seconds or with times in their output
    <!-- figures: COMMAND -->        the next block holds numbers that COMMAND prints, in another arrangement

`treadlink ...` runs in a folder of the page's own, `python ...` in the root of the repository.

    python -m tools.docs_outputs            # check the outputs of quick commands
    python -m tools.docs_outputs --slow     # and of the slow ones
    python -m tools.docs_outputs --update   # rewrite outputs shown in full
"""

import argparse
import os
import re
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).resolve().parents[1]
PAGES: Final = (ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md")))
SKIPPED: Final = "..."
"""A line of a quoted output that stands for lines left out."""

_MARK: Final = re.compile(
    r"^<!-- (?P<kind>file|output|figures)(?P<slow>\(slow\))?: (?P<text>.+?) -->\n"
    r"(?:```\w*\n(?P<body>.*?)^```$)?",
    re.MULTILINE | re.DOTALL,
)
_NUMBER: Final = re.compile(r"(?<![\w.])[-+\u2212]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")
# A last digit may turn over on another processor; no figure is quoted to more than this.
_RELATIVE_TOLERANCE: Final = 0.02


@dataclass(frozen=True, slots=True)
class Mark:
    """One marked block of a page.

    Attributes:
        page: the file.
        kind: "file", "output" or "figures".
        slow: whether only `--slow` runs the command.
        text: the command, or the name of the file.
        body: the fenced block, empty for figures.
        span: place of the body in the page's text.
    """

    page: Path
    kind: str
    slow: bool
    text: str
    body: str
    span: tuple[int, int]

    @property
    def name(self) -> str:
        """Path of the page from the root of the repository."""
        return self.page.relative_to(ROOT).as_posix()


def marks_of(page: Path) -> Iterator[Mark]:
    """Yield the marked blocks of a page in order."""
    for match in _MARK.finditer(page.read_text("utf-8")):
        body = match["body"] or ""
        span = match.span("body") if match["body"] is not None else (match.end(), match.end())
        yield Mark(page, match["kind"], match["slow"] is not None, match["text"], body, span)


def all_marks() -> list[Mark]:
    """Return the marked blocks of README and docs."""
    return [mark for page in PAGES for mark in marks_of(page)]


def unmarked_outputs(text: str) -> list[str]:
    """Return the first lines of fenced text blocks that no mark precedes."""
    return [
        match["first"]
        for match in re.finditer(r"(?P<before>[^\n]*)\n```text\n(?P<first>[^\n]*)", text)
        if not _MARK.match(match["before"] + "\n")
    ]


def run(command: str, folder: Path) -> str:
    """Run a command as the documentation states it and return what it prints.

    Raises:
        subprocess.CalledProcessError: it fails; status 1 is a finding, which a page may show.
    """
    words = shlex.split(command)
    if words[0] == "treadlink":
        resolved = [str((ROOT / word).resolve()) if word.startswith(("examples/", "../")) else word for word in words]
        arguments, where = [sys.executable, "-m", "gateway.core.cli", *resolved[1:]], folder
    else:
        arguments, where = [sys.executable, *words[1:]], ROOT
    path = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH", ""))))
    environment = {**os.environ, "PYTHONPATH": path, "COLUMNS": "80"}
    done = subprocess.run(
        arguments,
        cwd=where,
        env=environment,
        check=False,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
    )
    if done.returncode not in (0, 1):
        raise subprocess.CalledProcessError(done.returncode, arguments, done.stdout)
    return done.stdout


def numbers(text: str) -> list[float]:
    """Return the numbers in a text, in order."""
    return [float(digits.replace("\u2212", "-")) for digits in _NUMBER.findall(text)]


def disagreement(quoted: str, printed: str) -> str:
    """Return the first quoted line whose numbers are not in the output in this order, empty where all are."""
    result, position = numbers(printed), 0
    for line in quoted.splitlines():
        wanted = numbers(line)
        if not wanted or line.strip() == SKIPPED or line.startswith("$ "):
            continue
        while position + len(wanted) <= len(result) and not _alike(wanted, result[position : position + len(wanted)]):
            position += 1
        if position + len(wanted) > len(result):
            return line.strip()
        position += len(wanted)
    return ""


def _alike(first: Sequence[float], second: Sequence[float]) -> bool:
    return all(abs(a - b) <= _RELATIVE_TOLERANCE * max(abs(a), abs(b)) for a, b in zip(first, second, strict=True))


def check(marks: Sequence[Mark], *, slow: bool = False, update: bool = False) -> Iterator[str]:
    """Run the commands of the pages and yield one line for every output that is not as quoted."""
    for page, of_page in groupby(marks, key=lambda mark: mark.page):
        text = page.read_text("utf-8")
        written: list[tuple[tuple[int, int], str]] = []
        with tempfile.TemporaryDirectory() as folder:
            for mark in of_page:
                if mark.kind == "file":
                    (Path(folder) / mark.text).write_text(mark.body, "utf-8")
                elif mark.kind == "output" and not mark.body.startswith(f"$ {mark.text}\n"):
                    yield f"{mark.name}: the block does not begin with $ {mark.text}"
                elif mark.kind == "output" and (slow or not mark.slow):
                    printed = run(mark.text, Path(folder))
                    if missing := disagreement(mark.body, printed):
                        yield f"{mark.name}: `{mark.text}` does not print: {missing}"
                    if SKIPPED not in mark.body.split():
                        lines = (f"$ {mark.text}", *printed.splitlines())
                        written.append((mark.span, "".join(f"{line.rstrip()}\n" for line in lines)))
        if update:
            for (begin, end), body in reversed(written):
                text = text[:begin] + body + text[end:]
            page.write_text(text, "utf-8")


def table_of_commands(marks: Sequence[Mark]) -> str:
    """Return the table of commands and pages in docs/evidence/figures.md as Markdown."""
    rows = dict.fromkeys(
        (mark.text, mark.name, "test" if mark.kind == "output" and not mark.slow else "")
        for mark in marks
        if mark.kind != "file"
    )
    lines = ["| command | page | checked by |", "|---|---|---|"]
    for command, name, checked in sorted(rows, key=lambda row: (row[1], row[0])):
        target = name.removeprefix("docs/")
        link = f"[{target}](../{target})" if target != name else f"{name}"
        lines.append(f"| `{command}` | {link} | {checked} |")
    return "\n".join(lines)


def main() -> None:
    """Check, list or update the outputs."""
    parser = argparse.ArgumentParser(
        description=__doc__.partition("\n")[0], formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--slow", action="store_true", help="run the slow commands too")
    parser.add_argument("--update", action="store_true", help="write the outputs into the pages")
    parser.add_argument("pages", nargs="*", type=Path, help="these pages instead of all")
    options = parser.parse_args()
    chosen = {page.resolve() for page in options.pages}
    marks = [mark for mark in all_marks() if not chosen or mark.page in chosen]
    wrong = list(check(marks, slow=options.slow, update=options.update))
    print("\n".join(wrong) or "all outputs are as quoted")
    sys.exit(1 if wrong and not options.update else 0)


if __name__ == "__main__":
    main()
