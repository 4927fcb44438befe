"""Build of the compiled core with the package, by whatever C compiler there is; without one the package is pure.

Run `python hatch_build.py` to build it into a source tree.
"""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from hatchling.builders.hooks.plugin.interface import BuildHookInterface
else:
    try:
        from hatchling.builders.hooks.plugin.interface import BuildHookInterface
    except ImportError:  # run without the back end
        BuildHookInterface = object

SOURCE: Final = Path("gateway", "core", "compiled", "core.c")
MODULE: Final = SOURCE.with_name("_core.abi3.so")
# No product and sum in one step, and no reordering: every compiler and processor gives the same bits.
OPTIONS: Final = (
    "-std=c11", "-O3", "-ffp-contract=off", "-fno-math-errno", "-fno-trapping-math", "-fPIC", "-Wall", "-Wextra",
)  # fmt: skip


def compiler() -> list[str] | None:
    """Return the command of a C compiler that takes gcc's options; None without one, or where none is wanted."""
    if os.name != "posix" or os.environ.get("TREADLINK_COMPILED") == "0":
        return None
    stated = shlex.split(os.environ.get("CC") or sysconfig.get_config_var("CC") or "")
    for command in (stated, ["cc"], ["gcc"], ["clang"]):
        if command and shutil.which(command[0]):
            return command
    return None


def build(root: Path, module: Path, options: tuple[str, ...] = ()) -> str:
    """Compile the core of a source tree; return why it could not be, empty when it is.

    Args:
        root: of the source tree.
        module: file to make, from the root on.
        options: further options of the compiler.
    """
    command = compiler()
    if command is None:
        return "no C compiler, or TREADLINK_COMPILED is 0"
    shared = ["-bundle", "-undefined", "dynamic_lookup"] if sys.platform == "darwin" else ["-shared"]
    include = f"-I{sysconfig.get_path('include')}"
    # Paths from the root on, so that two builds are equal.
    run = [*command, *shared, *OPTIONS, *options, include, str(SOURCE), "-o", str(module), "-lm"]
    done = subprocess.run(run, cwd=root, capture_output=True, text=True, check=False)
    return (done.stderr.strip() or f"{command[0]} failed") if done.returncode else ""


class CoreBuildHook(BuildHookInterface):  # type: ignore[type-arg]
    """Builds the core into the tree of an editable installation, or into a wheel for this platform."""

    PLUGIN_NAME = "custom"

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile the core."""
        root = Path(self.root)
        self._folder = tempfile.mkdtemp()
        module = MODULE if version == "editable" else Path(self._folder, MODULE.name)
        if failure := build(root, module):
            self.app.display_warning(f"treadlink gets no compiled core and is slower: {failure}")
        elif version != "editable":
            build_data["force_include"][str(module)] = str(MODULE)
            build_data["pure_python"] = False
            platform = sysconfig.get_platform().replace("-", "_").replace(".", "_")
            build_data["tag"] = f"cp311-abi3-{platform}"

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:  # noqa: ARG002
        """Remove what is in the wheel now."""
        shutil.rmtree(self._folder)


if __name__ == "__main__":
    sys.exit(build(Path(__file__).parent, MODULE) or 0)
