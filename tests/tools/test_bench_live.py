"""The comparison of two versions of a live session."""

import threading
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace

import pytest

from tools import bench_live


def test_two_versions_take_turns_and_their_ratio_has_its_scatter(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    shares = {"then": iter([0.12, 0.10, 0.15] * 3), "now": iter([0.06, 0.05, 0.05] * 3)}
    measured: list[tuple[str, bool]] = []

    @contextmanager
    def trees(revision: str):  # type: ignore[no-untyped-def]
        yield {revision: Path("then"), "now": Path("now")}

    def share(_scenario: str, _seconds: float, *, tree: Path, record: bool = False, screen: bool = False):  # type: ignore[no-untyped-def]
        measured.append((tree.name, record or screen))
        return next(shares[tree.name]), "", [], [], 0.0

    monkeypatch.setattr(bench_live, "checked_out", trees)
    monkeypatch.setattr(bench_live, "commit_of", lambda revision: revision)
    monkeypatch.setattr(bench_live, "measure_process", share)
    bench_live.print_against("abc", "demo", 10.0, 3)
    lines = capsys.readouterr().out.splitlines()
    assert "abc against now" in lines[0]
    assert [line.split(":")[0].strip() for line in lines[1:]] == [
        f"{kind:22} 10.0 % to 5.0 % of one core" for kind in bench_live.KINDS
    ]
    assert "2.000 times as fast by the best; by round 2.000 in the median, 2.000 to 3.000" in lines[1]
    assert measured[:6] == [("then", False), ("now", False)] * 3
    assert all(is_more for _, is_more in measured[6:])


def test_a_session_that_does_not_read_does_not_hold_up_the_hub(monkeypatch: pytest.MonkeyPatch) -> None:
    clock_s = [100.0]

    def pass_time(wait_s: float) -> None:
        clock_s[0] += wait_s

    def write(_descriptor: int, piece: memoryview) -> int:
        pass_time(3.0)
        return len(piece)

    monkeypatch.setattr(bench_live, "time", SimpleNamespace(monotonic=lambda: clock_s[0]))
    monkeypatch.setattr(bench_live, "os", SimpleNamespace(write=write))
    stop = threading.Event()
    monkeypatch.setattr(stop, "wait", pass_time)
    written: bench_live.Timed = []
    lags_s: list[float] = []
    bench_live.feed(0, [(10.0, b"a"), (10.5, b"b"), (20.0, b"c")], stop, written, lags_s)
    assert written == [(100.0, b"a"), (100.5, b"b"), (110.0, b"c")]
    assert lags_s == [3.0, 5.5, 3.0]
