"""Latency of a session: results come within the chosen time, and do not depend on it."""

from types import SimpleNamespace

import pytest

from gateway.constants import LATENCY_S, LONGEST_LATENCY_S
from gateway.session.core import SessionCore
from gateway.session.latency import Latency
from tests.testkit.agreement import assert_agree


@pytest.mark.parametrize("longest_s", [0.0, 0.05, LATENCY_S, LONGEST_LATENCY_S])
def test_waits_add_up_to_less_than_the_latency(longest_s: float) -> None:
    latency = Latency(longest_s)
    assert latency.read_s <= 0.02
    assert latency.round_s + latency.hold_s <= longest_s
    assert latency.read_s + latency.round_s + latency.hold_s <= max(longest_s, 0.004)


def test_results_come_in_time_and_are_the_same(demo: SimpleNamespace) -> None:
    items, vehicle = demo
    results, came_ns = {}, {}
    for latency_s in (0.0, 0.1, 0.5):
        core = SessionCore(vehicle, latency_s=latency_s)
        came = [(item.host_ns, result) for item in items for result in core.take(item)]
        results[latency_s] = [result for _, result in came] + core.finish()
        came_ns[latency_s] = {(result.position, result.revolution.index): time_ns for time_ns, result in came}
    longest_s = {
        latency_s: max(1e-9 * (time_ns - came_ns[0.0][key]) for key, time_ns in times_ns.items())
        for latency_s, times_ns in came_ns.items()
    }
    assert_agree(results[0.1], results[0.0])
    assert_agree(results[0.5], results[0.0])
    # The chunks of the scenario come every 10 ms, and one that is late or lost holds the hub's time back.
    assert all(wait_s <= latency_s + 0.03 for latency_s, wait_s in longest_s.items())
    assert longest_s[0.5] > longest_s[0.1] > 0.03
