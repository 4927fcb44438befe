"""Print what the project promises and how large it is, each beside its ceiling.

    python -m tools.ceilings

A ceiling is what the count shall come down to. `LIMITS` are the counts of today, rounded up: they may only become
smaller, which `tests/tools/test_ceilings.py` holds. Rooms and arrows: `python -m tools.rooms`.
"""

import ast
import re
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path
from typing import Final, NamedTuple

import click

from tools import rooms
from tools.reason_codes import all_codes

ROOT: Final = Path(__file__).parents[1]
_MOST_COMPLEXITY: Final = 20
_MOST_PARAMETERS: Final = 8
_MOST_LINES: Final = 700
# What makes another path through a function.
_BRANCHES: Final = (
    ast.If, ast.For, ast.AsyncFor, ast.While, ast.ExceptHandler, ast.IfExp, ast.comprehension, ast.match_case,
    ast.Assert,
)  # fmt: skip


class Ceiling(NamedTuple):
    """A count with what it shall come down to, and what it may not exceed today."""

    wanted: int
    limit: int


CEILINGS: Final[dict[str, Ceiling]] = {
    "lines of the core": Ceiling(32_000, 40_212),
    "lines of gateway": Ceiling(95_000, 133_231),
    "lines of tests": Ceiling(58_000, 80_250),
    "lines of tools": Ceiling(17_000, 25_289),
    "words of docs": Ceiling(60_000, 60_000),
    "options": Ceiling(120, 91),
    "reason codes": Ceiling(430, 532),
    "functions over complexity 20": Ceiling(0, 0),
    "functions of more than eight parameters, commands aside": Ceiling(0, 3),
    "modules over 700 lines": Ceiling(0, 0),
    "imports of this project in functions, commands aside": Ceiling(0, 1),
    "arrows between rooms": Ceiling(110, 100),
}
"""What is counted, in the order in which it is printed."""


@cache
def _trees() -> dict[Path, ast.Module]:
    return {path: ast.parse(path.read_text("utf-8")) for path in rooms.modules().values()}


def _functions() -> Iterator[tuple[Path, ast.FunctionDef | ast.AsyncFunctionDef]]:
    for path, tree in _trees().items():
        for node in ast.walk(tree):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                yield path, node


def _is_of_command(path: Path) -> bool:
    return bool({"cli", "commands"} & set(path.parts))


def _complexity(function: ast.AST) -> int:
    """Return the cyclomatic complexity of a function (McCabe 1976), without the functions in it."""
    paths, waiting = 1, list(ast.iter_child_nodes(function))
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda | ast.ClassDef):
            continue
        paths += isinstance(node, _BRANCHES)
        if isinstance(node, ast.BoolOp):
            paths += len(node.values) - 1
        waiting += ast.iter_child_nodes(node)
    return paths


def _parameters(function: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    given = function.args
    names = [*given.posonlyargs, *given.args, *given.kwonlyargs]
    return sum(name.arg not in ("self", "cls") for name in names)


def _lines(paths: Iterable[Path]) -> int:
    return sum(len(path.read_text("utf-8").splitlines()) for path in paths)


def _options() -> int:
    """Return the number of different options of all commands."""
    from gateway.core.cli import treadlink

    def of(command: click.Command) -> Iterator[str]:
        for parameter in command.params:
            if isinstance(parameter, click.Option):
                yield max(parameter.opts, key=len)
        if isinstance(command, click.Group):
            for name in command.list_commands(click.Context(command)):
                inner = command.get_command(click.Context(command), name)
                if inner is not None:
                    yield from of(inner)

    return len(set(of(treadlink)))


def counts() -> dict[str, int]:
    """Return the count of each of `CEILINGS`."""
    in_functions = sum(
        made.is_in_function and not _is_of_command(rooms.modules()[made.module]) for made in rooms.imports()
    )
    pages = (ROOT / "docs").rglob("*.md")
    core = [path for name, path in rooms.modules().items() if rooms.is_core(rooms.room_of(name))]
    return {
        "lines of the core": _lines(core),
        "lines of gateway": _lines((ROOT / "gateway").rglob("*.py")),
        "lines of tests": _lines((ROOT / "tests").rglob("*.py")),
        "lines of tools": _lines((ROOT / "tools").rglob("*.py")),
        "words of docs": sum(len(re.findall(r"\S+", page.read_text("utf-8"))) for page in pages),
        "options": _options(),
        "reason codes": len(all_codes()),
        "functions over complexity 20": sum(_complexity(function) > _MOST_COMPLEXITY for _, function in _functions()),
        "functions of more than eight parameters, commands aside": sum(
            _parameters(function) > _MOST_PARAMETERS and not _is_of_command(path) for path, function in _functions()
        ),
        "modules over 700 lines": sum(_lines([path]) > _MOST_LINES for path in rooms.modules().values()),
        "imports of this project in functions, commands aside": in_functions,
        "arrows between rooms": len(rooms.arrows()),
    }


def main() -> None:
    """Print the table."""
    print(f"{'':58}{'now':>9}{'ceiling':>9}")
    for name, count in counts().items():
        print(f"{name:58}{count:9,}{CEILINGS[name].wanted:9,}")


if __name__ == "__main__":
    main()
