"""Imports run in one direction; the layers are those of the README's picture."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]

# Each layer may import itself and the layers named; `clock` and `errors` are single modules.
ALLOWED: dict[str, set[str]] = {
    "firmware_protocol": set(),
    "gateway.errors": set(),
    "gateway.clock": set(),
    "gateway.physics": set(),
    "gateway.signal": {"gateway.physics"},
    "gateway.estimators": {"gateway.errors", "gateway.physics", "gateway.signal"},
    "gateway.pipeline": {"firmware_protocol", "gateway.estimators", "gateway.signal", "gateway.physics"},
    "gateway.closure": {"gateway.errors", "gateway.estimators", "gateway.physics", "gateway.signal"},
    "gateway.config": {"gateway.errors", "gateway.pipeline"},
    "gateway.io": {"gateway.clock", "gateway.errors"},
    "gateway.security": {"firmware_protocol", "gateway.config", "gateway.errors"},
    "gateway.recording": {"firmware_protocol", "gateway.clock", "gateway.errors", "gateway.io"},
    "gateway.simulator": {
        "firmware_protocol", "gateway.clock", "gateway.config", "gateway.errors", "gateway.io", "gateway.physics",
        "gateway.security",
    },
    "gateway.importing": {
        "firmware_protocol", "gateway.config", "gateway.errors", "gateway.io", "gateway.recording",
    },
    "gateway.views": {"gateway.closure", "gateway.errors", "gateway.estimators", "gateway.pipeline"},
    "gateway.session": {
        "firmware_protocol", "gateway.clock", "gateway.closure", "gateway.config", "gateway.errors",
        "gateway.estimators", "gateway.io", "gateway.pipeline", "gateway.recording", "gateway.security",
        "gateway.views",
    },
    "gateway.figures": {"gateway.errors", "gateway.estimators", "gateway.physics", "gateway.signal"},
    "gateway.cli": {"*"},
}  # fmt: skip
# Standard modules that only one place may import.
ONLY_IN = {"time": {"gateway/clock.py"}, "random": set(), "secrets": {"gateway/security/keys.py"}}
# Constants any layer may use.
ANYWHERE = {"gateway"}


def modules() -> list[Path]:
    return sorted(
        path
        for top in ("gateway", "firmware_protocol")
        for path in (ROOT / top).rglob("*.py")
        if "__pycache__" not in path.parts
    )


def layer_of(module: str) -> str | None:
    return next((layer for layer in ALLOWED if module == layer or module.startswith(layer + ".")), None)


def imports(path: Path) -> set[str]:
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            found.add(node.module or "")
    return found


@pytest.mark.parametrize("path", modules(), ids=lambda path: str(path.relative_to(ROOT)))
def test_imports_go_in_one_direction(path: Path):
    relative = path.relative_to(ROOT)
    own = layer_of(".".join(relative.with_suffix("").parts))
    if relative == Path("gateway/__init__.py"):
        assert not {name for name in imports(path) if name.startswith("gateway")}
        return
    assert own is not None, f"{relative} belongs to no layer: name its layer in this test and in the README"
    allowed = ALLOWED[own]
    for name in imports(path):
        if name.split(".")[0] not in ("gateway", "firmware_protocol") or name in ANYWHERE or "*" in allowed:
            continue
        target = layer_of(name)
        assert target == own or target in allowed, f"{relative} imports {name}: {own} may not import {target}"


@pytest.mark.parametrize("path", modules(), ids=lambda path: str(path.relative_to(ROOT)))
def test_one_clock_and_no_unseeded_randomness(path: Path):
    relative = str(path.relative_to(ROOT))
    for name in imports(path):
        if name in ONLY_IN:
            assert relative in ONLY_IN[name], f"{relative} imports {name}"
    text = path.read_text()
    for forbidden in ("datetime.now(", "np.random.seed(", "default_rng()", ".utcnow("):
        assert forbidden not in text, f"{relative} uses {forbidden}"


@pytest.mark.parametrize("path", modules(), ids=lambda path: str(path.relative_to(ROOT)))
def test_a_module_has_one_job(path: Path):
    assert len(path.read_text().splitlines()) <= 350
    assert path.stem != "utils"


def test_help_imports_nothing_heavy():
    code = (
        "import sys\nfrom gateway.cli import treadlink\n"
        "try:\n    treadlink(['--help'])\nexcept SystemExit:\n    pass\n"
        "heavy = {'numpy', 'scipy', 'textual', 'pydantic', 'mcap', 'serial', 'matplotlib'} & set(sys.modules)\n"
        "sys.exit(f'imported: {heavy}' if heavy else 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT, check=False)
    assert done.returncode == 0, done.stderr
    assert "live" in done.stdout
