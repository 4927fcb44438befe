"""Every module is named for what it holds, and no two rooms use one name."""

from collections import defaultdict
from pathlib import Path

ROOT = Path(__file__).parents[1]


def test_no_two_modules_share_a_name():
    """Command modules are named for their command, which may be the name of the room that does the work."""
    found = defaultdict(list)
    for top in ("gateway", "firmware_protocol"):
        for path in sorted((ROOT / top).rglob("*.py")):
            if "cli" not in path.parts and path.stem != "__init__":
                found[path.stem].append(str(path.relative_to(ROOT)))
    assert {name: paths for name, paths in found.items() if len(paths) > 1} == {}


def test_no_module_is_a_catch_all():
    names = {path.stem for path in (ROOT / "gateway").rglob("*.py")}
    assert not names & {"utils", "util", "helpers", "misc", "common"}
