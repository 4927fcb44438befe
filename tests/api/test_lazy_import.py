"""`import gateway` is instant, complete, and says the same to people, programs and type checkers."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import gateway
from gateway.core import errors

FILE = Path(gateway.__file__)


def run(code):
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_import_loads_nothing_else():
    before = "import sys; before = set(sys.modules); import gateway; "
    assert run(before + "print(sorted(set(sys.modules) - before))").strip() == "['gateway']"


def test_errors_load_without_numpy():
    assert run("import sys, gateway; gateway.Error; print('numpy' in sys.modules)").strip() == "False"


def test_every_name_can_be_loaded():
    for name in gateway.names():
        assert getattr(gateway, name) is not None
    assert set(gateway.names()) <= set(dir(gateway))


def test_type_checkers_see_the_same_names():
    block = next(node for node in ast.parse(FILE.read_text("utf-8")).body if isinstance(node, ast.If)).body
    imported = {
        alias.name: (f"{node.module}:{alias.name}", alias.asname)
        for node in block
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    # A strict checker exports `name as name` and names that are assigned.
    typed = {name: position for name, (position, exported) in imported.items() if exported == name}
    for node in block:
        if isinstance(node, ast.Assign):
            typed[ast.unparse(node.targets[0])] = imported[ast.unparse(node.value)][0]
    assert typed == gateway._LAZY


def test_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="no attribute 'opne'"):
        _ = gateway.opne


def test_errors_are_one_family():
    for name in ("ConfigError", "OutputError", "RecordingError", "SourceError", "WheelNotFoundError"):
        assert issubclass(getattr(gateway, name), gateway.Error)
    assert gateway.Error is errors.TreadlinkError


def test_package_is_typed():
    assert (FILE.parent / "py.typed").exists()
