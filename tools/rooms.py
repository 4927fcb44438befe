"""Print the rooms of the code: lines, imports from the core to a feature, arrows between rooms, lines behind a command.

    python -m tools.rooms             the table
    python -m tools.rooms --modules   the room of every module
    python -m tools.rooms --arrows    the arrows between rooms with their imports

The core (`gateway.core`) has a room for each package in it; every other package of the gateway is a feature, and
`firmware_protocol` the wire's room. `tools/rooms.tsv` states the rooms of modules that are elsewhere: a module or a
package, and its room.
"""

import ast
import sys
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Final, NamedTuple

ROOT: Final = Path(__file__).parents[1]
CORE: Final = "core"
FRONT: Final = "gateway"
"""Names the interface for programs, which it loads on first use."""
COMMANDS: Final = ("record", "live", "estimate", "export")
_TABLE: Final = ROOT / "tools/rooms.tsv"


class Import(NamedTuple):
    """An import of a module of this project.

    Attributes:
        module: that imports.
        imported: module.
        is_in_function: whether it is made when a function runs.
        is_for_types: whether it is made by type checkers only.
    """

    module: str
    imported: str
    is_in_function: bool
    is_for_types: bool


@cache
def modules() -> Mapping[str, Path]:
    """Return the file of each module of the two packages by its name."""
    paths = {}
    for package in ("gateway", "firmware_protocol"):
        for path in sorted((ROOT / package).rglob("*.py")):
            paths[".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")] = path
    return paths


@cache
def _stated_rooms() -> Mapping[str, str]:
    if not _TABLE.exists():
        return {}
    return dict(line.split("\t") for line in _TABLE.read_text("utf-8").splitlines())  # type: ignore[misc]


@cache
def room_of(module: str) -> str:
    """Return the room of a module: `core`, a room of it such as `core/links`, or a feature."""
    stated, parts = _stated_rooms(), module.split(".")
    for count in range(len(parts), 1 if len(parts) > 1 else 0, -1):
        if room := stated.get(".".join(parts[:count])):
            return room
    if parts[0] != FRONT:
        return stated.get(parts[0], "core/wire")
    if parts[1:2] != [CORE]:
        return parts[1] if len(parts) > 1 else CORE
    is_package = len(parts) > 3 or modules().get(module, Path()).name == "__init__.py"
    return f"{CORE}/{parts[2]}" if len(parts) > 2 and is_package else CORE


def is_core(room: str) -> bool:
    """Return whether a room belongs to the core."""
    return room.split("/")[0] == CORE


@cache
def imports() -> tuple[Import, ...]:
    """Return the imports of all modules of this project, each once for each place."""
    return tuple(made for module, path in modules().items() for made in _imports_of(module, path))


def _imports_of(module: str, path: Path) -> Iterator[Import]:
    def walk(node: ast.AST, *, in_function: bool, for_types: bool) -> Iterator[Import]:
        for child in ast.iter_child_nodes(node):
            names: Iterable[str] = ()
            if isinstance(child, ast.Import):
                names = [alias.name for alias in child.names]
            elif isinstance(child, ast.ImportFrom):
                full = [f"{child.module}.{alias.name}" for alias in child.names]
                names = [name if name in modules() else str(child.module) for name in full]
            yield from (Import(module, name, in_function, for_types) for name in dict.fromkeys(names))
            is_function = isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef)
            is_guard = isinstance(child, ast.If) and ast.unparse(child.test).endswith("TYPE_CHECKING")
            yield from walk(child, in_function=in_function or is_function, for_types=for_types or is_guard)

    for made in walk(ast.parse(path.read_text("utf-8")), in_function=False, for_types=False):
        if made.imported in modules():
            yield made


def imports_of_features() -> list[str]:
    """Return the imports that run from the core to a feature, as `module -> module`."""
    wrong = {
        f"{made.module} -> {made.imported}"
        for made in imports()
        if made.module != FRONT and is_core(room_of(made.module)) and not is_core(room_of(made.imported))
    }
    return sorted(wrong)


def arrows() -> dict[tuple[str, str], list[Import]]:
    """Return the imports between two rooms, by the rooms that import and are imported.

    A feature sees the core as one room.
    """
    between = defaultdict(list)
    for made in imports():
        upper, lower = room_of(made.module), room_of(made.imported)
        if is_core(upper) != is_core(lower):
            upper, lower = (CORE if is_core(room) else room for room in (upper, lower))
        if upper != lower and made.module != FRONT:
            between[upper, lower].append(made)
    return dict(sorted(between.items()))


def floors(between: Iterable[tuple[str, str]]) -> tuple[list[list[str]], list[tuple[str, str]]]:
    """Return the rooms by floors, each over those that it imports, and the arrows that run back.

    An arrow runs back if its room is also reached from the room that it ends in.
    """
    below = defaultdict(set)
    for upper, lower in between:
        below[upper].add(lower)
    rooms = sorted({*below, *(room for lower in below.values() for room in lower)})
    reached = {room: _reached(room, below) for room in rooms}
    back = [(upper, lower) for upper in rooms for lower in sorted(below[upper]) if upper in reached[lower]]
    level: dict[str, int] = {}

    def of(room: str) -> int:
        if room not in level:
            over = [other for other in below[room] if room not in reached[other]]
            level[room] = 1 + max(map(of, over), default=-1)
        return level[room]

    highest = max(map(of, rooms), default=-1)
    return [[room for room in rooms if level[room] == floor] for floor in range(highest + 1)], back


def _reached(start: str, below: Mapping[str, Iterable[str]]) -> set[str]:
    seen: set[str] = set()
    waiting = list(below.get(start, ()))
    while waiting:
        room = waiting.pop()
        if room not in seen:
            seen.add(room)
            waiting += below.get(room, ())
    return seen


def modules_behind(start: str) -> set[str]:
    """Return the modules that a module needs, itself included, also those that it imports in functions."""
    needed = defaultdict(set)
    for made in imports():
        if not made.is_for_types:
            needed[made.module].add(made.imported)
    return {start, *_reached(start, needed)}


@cache
def lines_of(module: str) -> int:
    """Return the lines of a module."""
    return len(modules()[module].read_text("utf-8").splitlines())


def module_of_command(name: str) -> str:
    """Return the module of a command of the core or of the exports."""
    names = (f"gateway.core.cli.{name}", f"gateway.exporting.commands.{name}")
    return next(path for path in names if path in modules())


def main(arguments: Sequence[str]) -> None:
    """Print the table, or what an option asks for."""
    between = arrows()
    if "--modules" in arguments:
        for module, path in modules().items():
            print(f"{path.relative_to(ROOT)}\t{room_of(module)}")
        return
    if "--arrows" in arguments:
        for (upper, lower), those in between.items():
            print(f"{upper} -> {lower}")
            for made in those:
                print(f"    {made.module} -> {made.imported}")
        return
    lines: dict[str, list[int]] = defaultdict(list)
    for module in modules():
        lines[room_of(module)].append(lines_of(module))
    print("room                  modules   lines")
    for room in sorted(lines, key=lambda name: (not is_core(name), name)):
        print(f"{room:22}{len(lines[room]):7}{sum(lines[room]):8,}")
    of_core = sum(sum(counted) for room, counted in lines.items() if is_core(room))
    print(f"core {of_core:,} of {sum(map(lines_of, modules())):,} lines\n")
    wrong = imports_of_features()
    print(f"{len(wrong)} imports from the core to a feature")
    for text in wrong:
        print(f"    {text}")
    by_floor, back = floors(between)
    print(f"\n{len(between)} arrows between rooms, {len(back)} of them in circles, {len(by_floor)} floors")
    for upper, lower in back:
        print(f"    {upper} -> {lower}: {len(between[upper, lower])} imports")
    for number, rooms in reversed(list(enumerate(by_floor))):
        print(f"  floor {number}: {'  '.join(rooms)}")
    print("\nlines to read for a command, by its imports")
    for name in COMMANDS:
        behind = modules_behind(module_of_command(name))
        print(f"  {name:10}{sum(map(lines_of, behind)):8,} in {len(behind)} modules")


if __name__ == "__main__":
    main(sys.argv[1:])
