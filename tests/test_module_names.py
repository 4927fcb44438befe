"""Every module is named for what it holds, no two rooms use one name, and identifiers say what things are."""

import ast
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


# What a room declares, a module of this name in each.
DECLARATIONS = {"feature", "reasons", "quantities"}


def test_no_two_modules_share_a_name():
    """Command modules are named for their command, which may be the name of the room that does the work."""
    result = defaultdict(list)
    for top in ("gateway", "firmware_protocol"):
        for path in sorted((ROOT / top).rglob("*.py")):
            if not {"cli", "commands"} & set(path.parts) and path.stem not in {"__init__", *DECLARATIONS}:
                result[path.stem].append(str(path.relative_to(ROOT)))
    assert {name: paths for name, paths in result.items() if len(paths) > 1} == {}


def test_no_module_is_a_catch_all():
    names = {path.stem for path in (ROOT / "gateway").rglob("*.py")}
    assert not names & {"utils", "util", "helpers", "misc", "common"}


# Words that say how a thing came about or where it is, not what it is.
VAGUE = {"found", "one", "at", "known", "place", "left", "own", "here", "kept"}
MOST_PER_1000_LINES = 2.0


def _identifiers(tree: ast.AST) -> Iterator[str]:
    for node in ast.walk(tree):
        match node:
            case ast.Name(id=name) | ast.arg(arg=name) | ast.Attribute(attr=name):
                yield name
            case ast.keyword(arg=str(name)) | ast.FunctionDef(name=name) | ast.ClassDef(name=name):
                yield name


@pytest.mark.parametrize("room", ["gateway", "firmware_protocol", "tests", "tools"])
def test_identifiers_say_what_things_are(room: str):
    texts = {path: path.read_text("utf-8") for path in sorted((ROOT / room).rglob("*.py"))}
    vague = {
        path: sum(n.strip("_").lower() in VAGUE for n in _identifiers(ast.parse(text))) for path, text in texts.items()
    }
    lines = sum(text.count("\n") for text in texts.values())
    worst = sorted(vague, key=lambda path: -vague[path])[:5]
    assert 1000.0 * sum(vague.values()) < MOST_PER_1000_LINES * lines, [f"{path}: {vague[path]}" for path in worst]
