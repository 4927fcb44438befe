"""What a recording costs by wheels, rate and length, printed from a run of each."""

import sys
from pathlib import Path

import pytest

from tools.bench_throughput import LENGTHS_CASE, Case, print_scaling, ratios_line

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
