"""A folder that an ordinary user may only read: each command that writes names it, and leaves nothing."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
ORDINARY_USER = """
import ctypes, os, sys
if os.geteuid() == 0:
    # Without the capabilities that let root write everywhere (version 3 of the structure, this thread).
    assert ctypes.CDLL(None).capset((ctypes.c_uint32 * 2)(0x20080522, 0), (ctypes.c_uint32 * 6)()) == 0
from gateway.core.cli import main
sys.argv = ["treadlink", *sys.argv[1:]]
main()
"""
SOURCE = "sim:lab?speed=max&duration=1"


@pytest.mark.skipif(sys.platform != "linux", reason="gives up the rights of root by a call of Linux")
@pytest.mark.parametrize(
    ("command", "words"),
    [
        (("simulate", "lab", "--duration", "1", "--out", "r.mcap"), "no permission to write 'r.mcap'"),
        (("record", SOURCE, "--out", "r.mcap"), "no permission to write 'r.mcap'"),
        (("live", SOURCE, "--plain", "--record", "r.mcap"), "no permission to write 'r.mcap'"),
        (("live", SOURCE, "--plain", "--publish", "jsonl:lines.jsonl"), "Permission denied"),
        (("keys", "new", "0000a001", "--keys", "keys"), "'keys' cannot be locked: Permission denied"),
        (("--log", "x.log", "doctor"), "cannot write the log 'x.log': Permission denied"),
    ],
    ids=lambda value: "-".join(value[:1]) if isinstance(value, tuple) else "",
)
def test_folder_that_may_only_be_read_is_named(tmp_path: Path, command: tuple[str, ...], words: str) -> None:
    folder = tmp_path / "read-only"
    folder.mkdir(mode=0o555)
    done = subprocess.run(
        [sys.executable, "-c", ORDINARY_USER, *command],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    printed = done.stdout + done.stderr
    assert done.returncode == 1, printed
    assert "Traceback" not in printed
    assert words in printed
    assert list(folder.iterdir()) == []
