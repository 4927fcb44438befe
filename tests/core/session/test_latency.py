"""Latency of a session: results come within the chosen time, and do not depend on it."""

from types import SimpleNamespace

import pytest

from gateway.core.constants import LATENCY_S, LONGEST_LATENCY_S
from gateway.core.session.core import SessionCore
from gateway.core.session.latency import Latency
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


def test_late_session_lets_results_wait_up_to_the_longest_latency() -> None:
    waits = [Latency(0.0).while_late(late_s).longest_s for late_s in (-1.0, 0.0, 0.09, 0.35, 1.0, 60.0)]
    assert waits == pytest.approx([0.0, 0.0, 0.0, 0.3, 1.0, LONGEST_LATENCY_S])
    assert Latency(0.5).while_late(0.2) == Latency(0.5)


def test_late_session_gives_the_same_results_with_less_work(demo: SimpleNamespace) -> None:
    items, vehicle = demo
    results, rounds = {}, {}
    for late_s in (0.0, 3.0):
        core = SessionCore(vehicle, latency_s=0.0)
        by_item = []
        for index, item in enumerate(items):
            # Late for a while only, as a computer that has caught up.
            core.late(late_s if len(items) < 4 * index < 3 * len(items) else 0.0)
            by_item.append(core.take(item))
        results[late_s] = [result for of_item in by_item for result in of_item] + core.finish()
        rounds[late_s] = sum(1 for of_item in by_item if of_item)
    assert_agree(results[3.0], results[0.0])
    assert rounds[3.0] < 0.8 * rounds[0.0]
