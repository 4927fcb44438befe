"""Imports run in one direction, one module reads the clock, and `--help` imports nothing heavy."""

import ast
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

from gateway.cli import COMMANDS
from tools import rooms

ROOT = Path(__file__).parents[1]

# Single modules at the bottom: every layer of the gateway may import them.
FOUNDATION = {
    "gateway", "gateway.types", "gateway.constants", "gateway.errors", "gateway.clock", "gateway.reasons",
    "gateway.feature",
    "gateway.plugins", "gateway.quantity", "gateway.quantity_catalogue", "gateway.table_columns", "gateway.worker_pool",
    "gateway.bounded_input", "gateway.nearest_name", "gateway.removed_names", "gateway.optional_packages",
    "gateway.uri_parts",
    "gateway.compiled", "gateway.wheel_position",
    "gateway.writing_lock", "gateway.revision",
}  # fmt: skip
# Imports from the core to a feature that are still to be cut: the list may only become shorter.
UNCUT = {
    "gateway.cli.estimate -> gateway.security.key_file",
    "gateway.cli.estimate -> gateway.views.drive_page.drive_page",
    "gateway.cli.live -> gateway.views.console.screen",
    "gateway.cli.recording_estimates -> gateway.recording.reference_topic",
    "gateway.cli.recording_estimates -> gateway.session.reference_check",
    "gateway.cli.recording_estimates -> gateway.views.drive_page.drive",
    "gateway.cli.recording_estimates -> gateway.views.reference_lines",
    "gateway.cli.session_setup -> gateway.publishing.publisher",
    "gateway.cli.session_setup -> gateway.publishing.sink",
    "gateway.cli.session_setup -> gateway.security.key_file",
    "gateway.config.vehicle -> gateway.config.bus_signals",
    "gateway.config.vehicle -> gateway.config.tire_tables",
    "gateway.estimators.tire_data -> gateway.estimators.belt_laminate",
    "gateway.estimators.tire_data -> gateway.estimators.side_force_calibration",
    "gateway.estimators.tire_data -> gateway.estimators.slip_calibration",
    "gateway.physics.ring_series -> gateway.physics.contact_pressure",
    "gateway.pipeline.wheel_pairs -> gateway.pipeline.vehicle_witness",
    "gateway.pipeline.wheel_setup -> gateway.estimators.belt_laminate",
    "gateway.pipeline.wheel_setup -> gateway.estimators.side_force_calibration",
    "gateway.pipeline.wheel_setup -> gateway.estimators.slip_calibration",
    "gateway.session.alarms -> gateway.security.guard",
    "gateway.session.core -> gateway.config.effects_file",
    "gateway.session.core -> gateway.pipeline.vehicle_witness",
    "gateway.session.core -> gateway.security.guard",
    "gateway.session.core -> gateway.session.security_watch",
    "gateway.session.core -> gateway.session.signal_decoding",
    "gateway.session.hub_log -> gateway.session.commands",
    "gateway.session.live -> gateway.security.guard",
    "gateway.session.live -> gateway.session.control_socket",
    "gateway.session.live -> gateway.session.signal_decoding",
    "gateway.session.recording_pass -> gateway.config.effects_file",
    "gateway.session.recording_pass -> gateway.pipeline.vehicle_witness",
    "gateway.session.recording_pass -> gateway.recording.set_clock",
    "gateway.session.recording_pass -> gateway.security.guard",
    "gateway.session.recording_pass -> gateway.session.effects_opening",
    "gateway.session.recording_pass -> gateway.session.signal_decoding",
    "gateway.session.session_opening -> gateway.security.guard",
    "gateway.session.session_opening -> gateway.security.key_file",
    "gateway.session.session_opening -> gateway.session.commands",
    "gateway.session.session_opening -> gateway.session.control_socket",
    "gateway.session.session_opening -> gateway.session.effects_opening",
    "gateway.session.session_opening -> gateway.session.signal_decoding",
    "gateway.views.readout -> gateway.pipeline.vehicle_signals",
    "gateway.views.trend_history -> gateway.pipeline.vehicle_signals",
    "gateway.views.wording -> gateway.trends.watched_series",
}
# Arrows between rooms, and those of them that are in circles: the numbers may only become smaller.
ARROW_LIMIT = 113
CIRCLE_LIMIT = 58
# What each layer may import besides itself and the foundation; docs/contributing/architecture.md draws it.
ALLOWED: dict[str, set[str]] = {
    "firmware_protocol": set(),
    "gateway.physics": set(),
    "gateway.signal": {"gateway.physics"},
    "gateway.estimators": {"gateway.physics", "gateway.signal"},
    "gateway.pipeline": {"firmware_protocol", "gateway.estimators", "gateway.signal", "gateway.physics"},
    "gateway.closure": {"gateway.estimators", "gateway.physics", "gateway.signal"},
    "gateway.config": {"gateway.pipeline"},
    "gateway.io": set(),
    "gateway.security": {"firmware_protocol", "gateway.config"},
    "gateway.recording": {"firmware_protocol", "gateway.io"},
    "gateway.simulator": {
        "firmware_protocol", "gateway.config", "gateway.io", "gateway.physics", "gateway.security",
    },
    "gateway.importing": {
        "firmware_protocol", "gateway.config", "gateway.io", "gateway.recording", "gateway.signal",
    },
    "gateway.views": {
        "firmware_protocol", "gateway.closure", "gateway.estimators", "gateway.pipeline", "gateway.planning",
        "gateway.signal", "gateway.trends",
    },
    "gateway.session": {
        "firmware_protocol", "gateway.closure", "gateway.config", "gateway.estimators", "gateway.io",
        "gateway.pipeline", "gateway.recording", "gateway.security", "gateway.signal", "gateway.views",
    },
    "gateway.exporting": {
        "firmware_protocol", "gateway.config", "gateway.pipeline", "gateway.recording", "gateway.security",
        "gateway.session", "gateway.signal", "gateway.views",
    },
    "gateway.publishing": {
        "gateway.estimators", "gateway.io", "gateway.pipeline", "gateway.recording", "gateway.session", "gateway.views",
    },
    "gateway.trends": {"gateway.estimators"},
    "gateway.fleet": {
        "firmware_protocol", "gateway.config", "gateway.estimators", "gateway.pipeline", "gateway.recording",
        "gateway.security", "gateway.session", "gateway.signal", "gateway.trends", "gateway.views",
    },
    "gateway.papers": {"gateway.estimators", "gateway.physics", "gateway.signal"},
    "gateway.api": {
        "firmware_protocol", "gateway.closure", "gateway.config", "gateway.estimators", "gateway.exporting",
        "gateway.fleet", "gateway.importing", "gateway.io", "gateway.papers", "gateway.pipeline",
        "gateway.recording", "gateway.security", "gateway.session", "gateway.signal", "gateway.simulator",
        "gateway.trends", "gateway.views",
    },
    "gateway.planning": {
        "firmware_protocol", "gateway.closure", "gateway.config", "gateway.estimators", "gateway.physics",
        "gateway.pipeline", "gateway.simulator",
    },
    "gateway.cli": {"*"},
}  # fmt: skip
# Rooms and single modules of the closed loop: each may import those before it.
CLOSURE_ORDER = (
    "effects", "data", "model", "criteria", "result", "bayes", "angle", "remainder", "search", "checks", "spectrum",
    "report", "laws", "known_effects", "self_test", "transfer", "closed_loop",
)  # fmt: skip
# The top package names the interface for programs, and loads it on first use.
FRONT: dict[str, set[str]] = {"gateway": {"gateway.api"}}
# Standard modules that only some places may import.
ONLY_IN = {
    "time": {"gateway/clock.py"},
    "random": set(),
    "secrets": {
        "gateway/security/key_file.py",
        "gateway/publishing/origin_gate.py",
        "gateway/publishing/page_server.py",
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


def layer_of(module: str) -> str | None:
    if module in FOUNDATION:
        return "foundation"
    return next((layer for layer in ALLOWED if module == layer or module.startswith(layer + ".")), None)


def imports(path: Path) -> Iterator[str]:
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            yield node.module or ""


def forbidden_imports(name: str, path: Path) -> Iterator[str]:
    """Yield the imports of a layer that it may not make. Features that are in one room have no layer."""
    layer = layer_of(dotted(name))
    if layer is None:
        return
    allowed = ALLOWED.get(layer, set()) | FRONT.get(dotted(name), set())
    for imported in imports(path):
        target = layer_of(imported)
        if target is not None and "*" not in allowed and target not in {layer, "foundation", *allowed}:
            yield f"{name} imports {imported}: {layer} may not import {target}"


def test_imports_run_in_one_direction():
    results = [line for name, path in modules() for line in forbidden_imports(name, path)]
    for path in sorted((ROOT / "tools").rglob("*.py")):
        tests = [other for other in imports(path) if other.split(".")[0] == "tests"]
        results += [f"{path.relative_to(ROOT)} imports {other}: tools may not import tests" for other in tests]
    assert results == []


def test_the_core_imports_no_feature():
    assert set(rooms.imports_of_features()) == UNCUT


def test_arrows_between_rooms_are_few_and_run_in_one_direction():
    between = rooms.arrows()
    assert len(between) <= ARROW_LIMIT
    assert len(rooms.floors(between)[1]) <= CIRCLE_LIMIT
    assert rooms.floors(arrow for arrow in between if all(map(rooms.is_core, arrow)))[1] == []


def closure_imports(path: Path) -> Iterator[str]:
    """Yield the rooms and single modules of the closed loop that a module imports."""
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module == "gateway.closure":
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and (node.module or "").startswith("gateway.closure."):
            yield str(node.module).split(".")[2]


def test_imports_between_rooms_of_the_closed_loop_run_in_one_direction():
    results = []
    for path in sorted((ROOT / "gateway/closure").rglob("[!_]*.py")):
        room = path.relative_to(ROOT / "gateway/closure").parts[0].removesuffix(".py")
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
from gateway.cli import treadlink

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


def test_completion_of_commands_imports_no_command():
    environment = {**os.environ, "_TREADLINK_COMPLETE": "bash_complete", "COMP_WORDS": "treadlink ", "COMP_CWORD": "1"}
    command = [sys.executable, "-X", "importtime", "-m", "gateway.cli"]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=False, env=environment)
    assert "plain,estimate" in done.stdout
    imported = {line.rsplit("|", 1)[1].strip() for line in done.stderr.splitlines() if line.startswith("import time")}
    assert "gateway.cli" in imported
    assert not imported & {*HEAVY, *(line.target.split(":")[0] for line in COMMANDS.values())}
