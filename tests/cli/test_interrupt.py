"""Ctrl-C ends a command without a traceback and with the exit status of an interrupted program."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from gateway.cli import LazyGroup, treadlink
from tests.testkit.campaign_recordings import START_NS, write_recording

TIMEOUT_S = 60
# Python runs this first: the first worker process presses Ctrl-C while it is still starting.
PRESSES = """
import os, signal, sys

if any("spawn_main" in word for word in sys.orig_argv):
    try:
        os.close(os.open({marker!r}, os.O_CREAT | os.O_EXCL))
    except FileExistsError:
        pass
    else:
        os.kill(os.getpid(), signal.SIGINT)  # itself first, before the others can end it
        os.killpg(0, signal.SIGINT)
"""


@pytest.mark.skipif(not hasattr(os, "killpg"), reason="this system has no process groups")
def test_interrupt_while_processes_start(tmp_path: Path) -> None:
    at_60 = "[motion]\nspeed_kmh = 60.0"
    recordings = [
        write_recording(tmp_path / f"{number}.mcap", at_60, duration_s=2.0, start_ns=START_NS + number * 10**10)
        for number in range(2)
    ]
    marker = tmp_path / "pressed"
    (tmp_path / "sitecustomize.py").write_text(PRESSES.format(marker=str(marker)))
    process = subprocess.Popen(
        [sys.executable, "-m", "gateway.cli", "diagnose", *recordings, "--jobs", "2"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), *sys.path])},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        printed, errors = process.communicate(timeout=TIMEOUT_S)
    finally:
        process.kill()
    assert marker.exists()
    assert errors.split() == ["Aborted!"]
    assert printed == ""
    assert sorted(tmp_path.glob("[!_]*")) == sorted([*recordings, marker, tmp_path / "sitecustomize.py"])
    # Where the signal comes again as the interpreter ends, it dies of it, which a shell shows as 130 too.
    assert process.returncode in (130, -signal.SIGINT)


def test_interrupt_sets_the_exit_status(monkeypatch: pytest.MonkeyPatch) -> None:
    def pressed() -> None:
        signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(LazyGroup, "get_command", lambda *_: click.Command("figures", callback=pressed))
    result = CliRunner().invoke(treadlink, ["figures"])
    assert result.exit_code == 130
    assert "Aborted!" in result.output
