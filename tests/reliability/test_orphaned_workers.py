"""A command that is killed leaves no process behind."""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]

PROGRAM = """
import os, signal, time
from gateway.core.worker_pool import Workers
with Workers(1) as workers:
    workers.each[0].submit(time.monotonic).result()  # it is up
    {work}
    os.kill(os.getpid(), signal.SIGKILL)
"""


def test_idle_and_busy_workers_end_with_a_killed_command():
    """The workers hold the standard output of the command: it is read to its end when they are gone."""
    for work in ("pass", "workers.each[0].submit(time.sleep, 600)"):
        command = [sys.executable, "-c", PROGRAM.format(work=work)]
        done = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, timeout=60, check=False)
        assert done.returncode == -9
