"""A short soak of the program: nothing lost, nothing that grows, and a clock that is set."""

import shutil
import sys
from pathlib import Path

import pytest

from tools.reliability.live_soak import run_live_soak

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(sys.platform != "linux" or shutil.which("cc") is None, reason="needs /proc and a C compiler"),
]


def test_a_session_with_all_outputs_loses_nothing_while_its_clock_is_set(tmp_path: Path) -> None:
    soak = run_live_soak(0.5, tmp_path, readings=3, split_s=8.0)
    assert soak.status == 0, soak.summary
    assert soak.is_equal, (soak.sent_bytes, soak.recorded_bytes)
    assert soak.files >= 3
    assert soak.said_steps == soak.clock_steps == 3
    assert soak.lines > 100
    assert soak.messages in (0, soak.lines)  # without a broker none
    assert [(each.served > 0, each.refused) for each in soak.clients] == [(True, [])] * 3
    assert soak.strange > 96
    assert soak.tab_errors == []
    first, *_, last = soak.readings
    assert last.threads <= first.threads + 8  # clients that come while others go
    assert last.descriptors <= first.descriptors + 16
