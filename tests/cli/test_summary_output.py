"""Summaries whose reader leaves, as `| head` does, while files are still to be written."""

import subprocess
import sys
from pathlib import Path

import click
import pytest

from gateway.cli import exit_status
from gateway.cli.summary_output import SummaryOutput
from tests.testkit.campaign_recordings import write_recording


@pytest.fixture(scope="module")
def recordings(tmp_path_factory) -> list[Path]:
    folder = tmp_path_factory.mktemp("summary")
    return [
        write_recording(folder / f"{name}.mcap", "[sensor]\nrate_hz = 3200.0", duration_s=1.8) for name in ("a", "b")
    ]


def run_unread(*words: object) -> tuple[int, str]:
    """Run a command whose output nobody reads; return its status and what it says of errors."""
    command = [sys.executable, "-m", "gateway.cli", *map(str, words)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None and process.stderr is not None  # noqa: PT018
        process.stdout.close()
        errors = process.stderr.read().decode()
        return process.wait(60), errors


@pytest.mark.skipif(sys.platform == "win32", reason="no closed pipes")
def test_orders_writes_all_its_files(recordings, tmp_path: Path) -> None:
    outputs = {"--figure": tmp_path / "o.svg", "--csv": tmp_path / "o.csv", "--json": tmp_path / "o.json"}
    options = [word for pair in outputs.items() for word in pair]
    status, errors = run_unread("orders", recordings[0], *options)
    assert status == exit_status.CLOSED_PIPE
    assert "Traceback" not in errors
    assert all(path.stat().st_size > 100 for path in outputs.values())


@pytest.mark.skipif(sys.platform == "win32", reason="no closed pipes")
def test_estimate_writes_the_rows_of_all_recordings(recordings, tmp_path: Path) -> None:
    table = tmp_path / "t.csv"
    status, _ = run_unread("estimate", *recordings, "--csv", table)
    assert status == exit_status.CLOSED_PIPE
    rows = table.read_text(encoding="utf-8").splitlines()[1:]
    assert {name for path in recordings for name in [path.name] if any(path.name in row for row in rows)} == {
        "a.mcap",
        "b.mcap",
    }
    assert run_unread("estimate", *recordings)[0] == exit_status.CLOSED_PIPE


def test_lines_after_the_reader_left_are_dropped_and_the_end_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    printed: list[tuple[str, bool]] = []

    def echo(line: str, *, err: bool) -> None:
        if len(printed) == 2:
            raise BrokenPipeError
        printed.append((line, err))

    monkeypatch.setattr(click, "echo", echo)
    say = SummaryOutput(err=True)
    say.finish()
    for line in ("a", "b", "c"):
        say(line)
    printed.clear()
    say("d")
    assert printed == []
    with pytest.raises(BrokenPipeError):
        say.finish()
