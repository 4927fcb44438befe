"""Commands that write, killed at each of their calls: the quick ones; `tools/reliability/kill_sweep.py` has all."""

import shutil
import sys
from pathlib import Path

import pytest

from tools.reliability.kill_sweep import sweep

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(sys.platform != "linux" or shutil.which("cc") is None, reason="needs Linux and a C compiler"),
]

QUICK = (
    "repair",
    "compact",
    "compact --in-place",
    "note",
    "manifest",
    "import",
    "keys new",
    "calibrate load",
    "orders",
)


def test_no_kill_leaves_half_a_result_or_stops_the_next_run(tmp_path: Path) -> None:
    swept = list(sweep(tmp_path.resolve(), QUICK))
    assert [each.name for each in swept] == list(QUICK)
    for each in swept:
        assert each.faults == []
        assert each.kills >= each.calls > 1


def test_a_limit_of_time_kills_at_calls_of_the_whole_command(tmp_path: Path) -> None:
    for name in ("none", "some"):
        (tmp_path / name).mkdir()
    (none,) = sweep(tmp_path.resolve() / "none", ("note",), most_s=0.0)
    (some,) = sweep(tmp_path.resolve() / "some", ("note",), most_s=600.0)
    assert (none.kills, none.faults, some.faults) == (0, [], [])
    assert some.kills >= some.calls > 1
