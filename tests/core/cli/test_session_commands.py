"""Sessions of live, record and replay: their length, and the files that they leave."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from websockets.sync.client import connect

from gateway.core.cli.session_setup import is_terminal
from gateway.core.errors import SourceError
from gateway.core.links.source import Chunk
from gateway.core.recording.reader import RecordingReader
from tests.testkit.commands import invoked
from tests.testkit.hub_ends import TcpHub


@pytest.mark.parametrize("line", ["live sim:lab?speed=max --plain --record x.mcap", "record sim:lab --out x.mcap"])
def test_duration_counts_seconds_of_data(line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    result = invoked(f"{line} --duration 0.7")
    times = [item.host_ns for item in RecordingReader(Path("x.mcap")).items() if isinstance(item, Chunk)]
    assert result.exception is None or isinstance(result.exception, SystemExit)
    assert 0.6e9 < times[-1] - times[0] <= 0.7e9


def test_duration_ends_a_silent_session(tcp_hub: TcpHub, tmp_path: Path) -> None:
    out = tmp_path / "x.mcap"
    invoked(f"record tcp://127.0.0.1:{tcp_hub.port} --out {out} --duration 0.3")
    assert RecordingReader(out).info.finished  # it has the connection, without a byte


@pytest.mark.parametrize(
    "line",
    [
        "record serial:/nosuch/port --out {}/new.mcap",
        "record serial:/nosuch/port --out {}",
        "live serial:/nosuch/port --plain --record {}/new.mcap",
        "live sim:nosuch --plain --record {}/new.mcap",
        "record tcp://127.0.0.1:1 --out {}/new.mcap",
    ],
)
def test_source_that_does_not_open_leaves_no_file(line: str, tmp_path: Path) -> None:
    result = invoked(line.format(tmp_path))
    assert isinstance(result.exception, SourceError)
    assert not re.search("^recording:", result.output, re.MULTILINE)  # as a session that has recorded ends
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("term", "has_screen"), [("dumb", False), ("unknown", False), ("", False), ("xterm-256color", True)]
)
def test_terminal_that_cannot_move_its_cursor_gets_plain_lines(
    term: str, has_screen: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TERM", term)
    for stream in (sys.stdin, sys.stdout):
        monkeypatch.setattr(stream, "isatty", lambda: True)
    if os.name == "posix" or term:
        assert is_terminal() is has_screen


@pytest.mark.parametrize("command", ["live sim:lab", "replay {}"])
def test_page_shows_the_session_while_it_runs(command: str, tmp_path: Path) -> None:
    drive = tmp_path / "drive.mcap"
    if "replay" in command:
        invoked(f"record sim:lab?speed=max --duration 20 --out {drive}")
    words = [sys.executable, "-m", "gateway.core.cli", *command.format(drive).split(), "--plain", "--publish"]
    with subprocess.Popen(
        [*words, "web://127.0.0.1:0"], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[3])},
    ) as process:  # fmt: skip
        assert process.stderr is not None
        printed: list[str] = []
        while not (printed and printed[-1].startswith("page: ")):
            printed.append(process.stderr.readline())
            assert printed[-1], printed
        line = printed[-1]
        address = line.removeprefix("page: ").strip()
        with connect(address.replace("http", "ws"), origin=address.rstrip("/"), open_timeout=20.0) as page:  # type: ignore[arg-type]
            # Ten a second, so that waiting ends after a minute.
            states = (json.loads(page.recv(20.0)) for _ in range(600))
            state = next(state for state in states if state["type"] == "state" and "1 of 1" in state["rolling"])
            assert state["may_record"] is ("live" in command)
            if state["may_record"]:
                page.send(json.dumps({"record": True}))
                recording = next(state["recording"] for state in states if state.get("recording"))
                page.send(json.dumps({"record": False}))
                next(state for state in states if state["type"] == "state" and not state["recording"])
                assert RecordingReader(tmp_path / recording).info.finished
        process.terminate()
        process.communicate(timeout=60.0)
