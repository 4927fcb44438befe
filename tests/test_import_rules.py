"""Imports run in one direction, one module reads the clock, and `--help` imports nothing heavy."""

import ast
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

from gateway.core.cli import COMMANDS
from gateway.core.feature import Registry, added
from gateway.core.plugins import installed
from tools import rooms

ROOT = Path(__file__).parents[1]

# Arrows between rooms, of which the core is one for a feature: the number may only become smaller.
ARROW_LIMIT = 101
# Rooms and single modules of the closed loop: each may import those before it.
CLOSURE_ORDER = (
    "reasons", "revision", "effects", "data", "model", "criteria", "result", "bayes", "angle", "remainder", "search",
    "checks", "spectrum", "report", "known_effects", "self_test", "transfer", "closed_loop", "effects_file",
    "campaign_clock", "provenance", "repeated_samples", "campaign_recording", "campaign", "effects_opening",
    "next_recording", "campaign_diagnosis", "views", "saved_effects", "feature", "commands",
)  # fmt: skip
# Standard modules that only some places may import.
ONLY_IN = {
    "time": {"gateway/core/clock.py"},
    "random": set(),
    "secrets": {
        "gateway/security/key_file.py",
        "gateway/publishing/origin_gate.py",
        "gateway/publishing/page_listener.py",
    },
}
UNSEEDED = ("datetime.now(", "np.random.seed(", "default_rng()", ".utcnow(")


def modules() -> Iterator[tuple[str, Path]]:
    """Yield each module of the two packages with its path from the root."""
    for top in ("gateway", "firmware_protocol"):
        for path in sorted((ROOT / top).rglob("*.py")):
            yield str(path.relative_to(ROOT)), path


def dotted(name: str) -> str:
    return name.removesuffix(".py").removesuffix("/__init__").replace("/", ".")


def imports(path: Path) -> Iterator[str]:
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            yield node.module or ""


def test_tools_import_no_tests():
    results = []
    for path in sorted((ROOT / "tools").rglob("*.py")):
        tests = [other for other in imports(path) if other.split(".")[0] == "tests"]
        results += [f"{path.relative_to(ROOT)} imports {other}" for other in tests]
    assert results == []


def test_the_core_imports_no_feature():
    assert rooms.imports_of_features() == []


def test_arrows_between_rooms_are_few_and_run_in_one_direction():
    between = rooms.arrows()
    assert len(between) <= ARROW_LIMIT
    assert rooms.floors(between)[1] == []


def closure_imports(path: Path) -> Iterator[str]:
    """Yield the rooms and single modules of the closed loop that a module imports."""
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module == "gateway.diagnosis":
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and (node.module or "").startswith("gateway.diagnosis."):
            yield str(node.module).split(".")[2]


def test_imports_between_rooms_of_the_closed_loop_run_in_one_direction():
    results = []
    for path in sorted((ROOT / "gateway/diagnosis").rglob("[!_]*.py")):
        room = path.relative_to(ROOT / "gateway/diagnosis").parts[0].removesuffix(".py")
        later = CLOSURE_ORDER[CLOSURE_ORDER.index(room) + 1 :]
        results += [f"{path.relative_to(ROOT)} imports {other}" for other in closure_imports(path) if other in later]
    assert results == []


def test_one_clock_and_no_unseeded_randomness():
    results = []
    for name, path in modules():
        results += [f"{name} imports {other}" for other in imports(path) if name not in ONLY_IN.get(other, {name})]
        text = path.read_text("utf-8")
        results += [f"{name} uses {call}" for call in UNSEEDED if call in text]
    assert results == []


# Runs the help of a command, or a completion, and fails with the heavy packages that it imported.
HELP = """
import contextlib, io, sys
from gateway.core.cli import treadlink

def printed_help(command, words):
    with contextlib.suppress(SystemExit):
        treadlink([*words, "--help"])
    heavy = {heavy!r} & set(sys.modules)
    if heavy:
        sys.exit(f"treadlink {{' '.join(words)}} --help imports {{heavy}}")
    for name in getattr(command, "commands", ()) or (command.list_commands(None) if command is treadlink else ()):
        printed_help(command.get_command(None, name), [*words, name])

printed_help(treadlink, [])
"""
HEAVY = {
    "asyncio", "bleak", "construct", "cryptography", "dask", "dbus_fast", "jinja2", "matplotlib", "mcap",
    "multiprocessing", "numpy", "pandas", "pyarrow", "pydantic", "rich", "scipy", "serial", "textual",
}  # fmt: skip


def test_help_imports_nothing_heavy():
    code = HELP.format(heavy=HEAVY)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT, check=False)
    assert done.returncode == 0, done.stderr
    assert "--estimator" in done.stdout
    assert "SOURCE HZ" in done.stdout
    assert "scan" in done.stdout


def imported(words: list[str], environment: dict[str, str]) -> tuple[set[str], str]:
    """Return the modules that a command imports, and what it prints."""
    command = [sys.executable, "-X", "importtime", "-m", "gateway.core.cli", *words]
    done = subprocess.run(
        command, capture_output=True, text=True, cwd=ROOT, check=False, env={**os.environ, **environment}
    )
    lines = [line for line in done.stderr.splitlines() if line.startswith("import time")]
    return {line.rsplit("|", 1)[1].strip() for line in lines}, done.stdout


def test_completion_of_commands_imports_no_command():
    modules, printed = imported(
        [], {"_TREADLINK_COMPLETE": "bash_complete", "COMP_WORDS": "treadlink ", "COMP_CWORD": "1"}
    )
    assert "plain,estimate" in printed
    assert "gateway.core.cli" in modules
    assert not modules & {*HEAVY, *(line.target.split(":")[0] for line in COMMANDS.values())}


def test_doctor_without_plug_ins_imports_no_effects_readers_or_outputs():
    modules, _ = imported(["doctor"], {})
    assert "gateway.bench.commands.doctor_checks" in modules
    checks = {Registry(group): target.split(":")[0] for group, target in added(Registry.PLUGIN_CHECKS).items()}
    assert len(checks) > 2
    assert not modules & {module for group, module in checks.items() if not installed(group)}
