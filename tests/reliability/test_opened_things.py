"""Every listener, thread, child process, link and written file: its bound, its time limit, and what it says in trouble.

The rows are in opened_things.toml. A place of the code that opens one and stands in no row fails, so does a row whose
place or test is gone.
"""

import ast
import importlib
import re
import tomllib
from collections.abc import Iterator
from operator import attrgetter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
TESTS = ROOT / "tests"
# Names of what opens a thing, whatever stands before the name.
OPENERS = frozenset({
    "Thread", "Timer", "ThreadPoolExecutor", "ProcessPoolExecutor", "ThreadingMixIn", "Popen", "Process", "fork",
    "create_server", "start_server", "start_unix_server", "make_server", "serve", "bind", "listen",
    "create_connection", "Serial", "Bus", "Client", "BleakClient", "InfluxDBClient", "urlopen", "build_opener",
    "openpty", "mkfifo", "FileHandler", "FileIO", "ZipFile", "NamedTemporaryFile", "TemporaryFile", "mkstemp",
    "TemporaryDirectory", "mkdtemp", "write_text", "write_bytes",
})  # fmt: skip
# They have such a name and open nothing.
OTHERS = {
    "core/links/ble_link.py:find", "core/links/ble_source.py:_listen",  # listeners of advertisements
    "core/session/session_opening.py:open_session",  # hands over to the row of commands
    "fleet/local_tasks.py:LocalTasks._end_above_limit",  # looks at a process
}  # fmt: skip


ROWS = tomllib.loads(Path(__file__).with_name("opened_things.toml").read_text())
SENTENCES = ("bound", "limit", "stops", "floods", "lies", "gone")
STATEMENTS = {"places", *SENTENCES, "tests"}
# A number of a sentence that is not a status of HTTP, and its unit.
NUMBER = re.compile(r"\b(?!40[035]\b|503\b)(\d+(?:\.\d+)?)(?: (kB|MB|ms)\b)?")
SCALES = {"": 1.0, "kB": 1e3, "MB": 1e6, "ms": 1.0}


def writes(call: ast.Call) -> bool:
    """Return whether a call has a mode or flags that write."""
    values = [argument.value for argument in call.args[:2] if isinstance(argument, ast.Constant)]
    values += [
        word.value.value for word in call.keywords if isinstance(word.value, ast.Constant) and word.arg == "mode"
    ]
    modes = [value for value in values if isinstance(value, str) and 0 < len(value) <= 4]
    return any(set(mode) <= set("rwaxbt+") and set(mode) & set("wax+") for mode in modes)


def last_name(node: ast.AST) -> str:
    return ast.unparse(node).rpartition(".")[2]


def opens(call: ast.Call) -> bool:
    whole = ast.unparse(call.func)
    name = last_name(call.func)
    if whole == "os.open":  # read-only where it is not said that it writes
        return not ast.unparse(call.args[1]).startswith("os.O_RDONLY")
    return name in OPENERS or whole.startswith("subprocess.") or (name == "open" and writes(call))


def is_held(statement: ast.Assign) -> bool:
    """Return whether a descriptor stays open as an attribute, also where it is only read."""
    value = statement.value
    is_opened = isinstance(value, ast.Call) and ast.unparse(value.func) == "os.open"
    return is_opened and isinstance(statement.targets[0], ast.Attribute)


def openings(node: ast.AST, names: tuple[str, ...] = ()) -> Iterator[str]:
    """Yield the qualified names of functions and classes that open something."""
    for child in ast.iter_child_nodes(node):
        inner = names
        if isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            inner = (*names, child.name)
            if isinstance(child, ast.ClassDef) and OPENERS.intersection(map(last_name, child.bases)):
                yield ".".join(inner)
        elif (isinstance(child, ast.Call) and opens(child)) or (isinstance(child, ast.Assign) and is_held(child)):
            yield ".".join(names)
        yield from openings(child, inner)


def places_in(code: str, module: str) -> set[str]:
    return {f"{module}:{name}" for name in openings(ast.parse(code))}


def test_everything_that_is_opened_has_a_row() -> None:
    opened = set()
    for path in (ROOT / "gateway").rglob("*.py"):
        opened |= places_in(path.read_text(), path.relative_to(ROOT / "gateway").as_posix())
    listed = [place for row in ROWS.values() for place in row["places"]]
    assert len(listed) == len(set(listed)), "a place has one row"
    assert sorted(opened - OTHERS - set(listed)) == [], "give each a row: its bound, its time limit, its words"
    assert sorted({*listed, *OTHERS} - opened) == [], "these are gone"


@pytest.mark.parametrize("name", ROWS)
def test_each_row_is_complete_and_its_tests_exist(name: str) -> None:
    row = ROWS[name]
    assert row.keys() - {"figures"} == STATEMENTS
    assert all(row.values())
    for test in row["tests"]:
        path, _, function = test.partition("::")
        functions = [node.name for node in ast.parse((TESTS / path).read_text()).body if hasattr(node, "name")]
        assert function in functions, test


@pytest.mark.parametrize("name", ROWS)
def test_figures_of_a_row_are_those_of_the_code(name: str) -> None:
    row = ROWS[name]
    stated = [float(n) * SCALES[unit] for n, unit in NUMBER.findall("; ".join(row[each] for each in SENTENCES))]
    constants = []
    for figure in row.get("figures", ()):
        module, _, attribute = figure.partition(":")
        value = attrgetter(attribute)(importlib.import_module(f"gateway.{module}"))
        constants.append(value * 1e-9 if attribute.endswith("_NS") else value)
    assert stated == pytest.approx(constants, rel=0.03)


@pytest.mark.parametrize(
    "code",
    [
        "threading.Thread(target=f)", "socket.create_server(a)", "path.open('ab')", "open(path, mode='x')",
        "os.open(path, os.O_WRONLY)", "subprocess.run([])", "class _A(ProcessPoolExecutor): pass", "a.write_text('')",
        "self.a = os.open(path, os.O_RDONLY)",
    ],
)  # fmt: skip
def test_a_new_one_is_seen(code: str) -> None:
    assert places_in(code, "m")


@pytest.mark.parametrize(
    "code", ["path.open('rb')", "os.open(path, os.O_RDONLY)", "a.write(b)", "text.replace('+', '')"]
)
def test_what_only_reads_is_none(code: str) -> None:
    assert not places_in(code, "m")
