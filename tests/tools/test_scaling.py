"""What a recording costs by wheels, rate and length, printed from a run of each."""

import sys
from pathlib import Path

import pytest

from tools.bench_throughput import LENGTHS_CASE, Case, gated, print_cases, print_scaling, ratios_line

ROOT = Path(__file__).parents[2]


@pytest.mark.skipif(sys.platform != "linux", reason="needs /proc")
def test_a_row_for_each_case_and_length(tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(ROOT)
    cases = (Case("batch", 1, 2000, "none"), LENGTHS_CASE)
    print_scaling({"now": ROOT}, tmp_path, cases, (3.0,), seconds=1.5, rounds=1)
    first, short, last = (line.split() for line in capsys.readouterr().out.splitlines() if line.startswith("batch"))
    assert first[:5] == ["batch", "1", "x", "2000", "Hz"]
    assert short[:5] == last[:5] == ["batch", "4", "x", "2000", "Hz"]
    assert 1 <= int(first[-1]) <= 15
    # Four wheels with some ten revolutions a second each; the first ones are the search for the period.
    assert int(short[-1]) + 20 <= int(last[-1]) <= 111


def test_ratios_of_versions_have_their_scatter() -> None:
    before, now = ([{"cpu_s": spent_s} for spent_s in of_rounds] for of_rounds in ((3.0, 2.2, 4.0), (1.5, 2.0, 2.5)))
    assert ratios_line(before, now) == ("1.467 times as fast by the best; by round 1.600 in the median, 1.100 to 2.000")


def test_the_gate_fails_where_a_version_costs_more(tmp_path: Path, monkeypatch) -> None:
    """By the median of rounds, so that one disturbed round does not count."""
    spent_s = {"old": [1.0, 1.0, 9.0], "now": [1.04, 1.06, 1.05]}

    def run_child(tree: Path, case: Case, path: Path, *, by_stage: bool) -> dict[str, float]:
        return {"cpu_s": spent_s[tree.name].pop(0), "revolutions": 10, "peak_mb": 1.0}

    monkeypatch.setattr("tools.bench_throughput.run_child", run_child)
    case = Case("live", 4, 9600, "default")
    (ratio,) = print_cases({"old": Path("old"), "now": Path("now")}, {(4, 9600): tmp_path}, (case,), 1.0, 3)
    assert ratio == 1.0 / 1.04
    assert gated(ratio, 5.0) == ""
    assert gated(ratio, 3.5) == "costs 4.0 % more CPU; 3.5 % are allowed"
    assert gated(0.0, 5.0) == "--gate needs --against"
