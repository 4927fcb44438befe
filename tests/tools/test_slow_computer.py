"""A process that is held to a share of a core gets no more, and is let go."""

import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path

import pytest

from tests.testkit.waiting import until

if sys.platform != "linux":
    pytest.skip("control groups exist on Linux only", allow_module_level=True)

from tools.bench_live import cpu_s
from tools.bench_slow_computer import held_to


def test_a_busy_process_gets_its_share_and_is_let_go() -> None:
    with ExitStack() as stack:
        busy = stack.enter_context(subprocess.Popen([sys.executable, "-c", "while True: pass"]))
        stack.callback(busy.kill)
        groups = Path(f"/proc/{busy.pid}/cgroup")
        before = groups.read_text()
        with ExitStack() as held:
            try:
                held.enter_context(held_to(0.1, busy.pid))
            except SystemExit as refused:
                pytest.skip(str(refused))
            assert groups.read_text() != before
            begin_s, used_s = time.monotonic(), cpu_s(busy.pid)
            until(lambda: cpu_s(busy.pid) >= used_s + 0.05)
            # Half the time that it needs: the clock of a process ticks every 10 ms.
            assert time.monotonic() - begin_s > 0.25
        assert groups.read_text() == before
