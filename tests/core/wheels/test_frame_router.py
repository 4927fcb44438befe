"""Clocks of hubs: wraps of ticks that a silence hides, and another hub on a port."""

import numpy as np
import pytest

from firmware_protocol.frame_blocks import FrameList
from firmware_protocol.messages import Environment, Frame, Hello, MessageType, SampleBlock
from gateway.core.wheels.frame_router import FrameRouter, Hub
from gateway.core.wheels.timebase import HostClock
from tests.core.wheels.rolling_signals import hello

BEGIN_NS = 1_700_000_000_000_000_000
STEP_US = 100_000


class NotedTimes:
    """A wheel that notes the hub time of each frame, and the last clock."""

    def __init__(self) -> None:
        self.times_us: list[int] = []
        self.host = HostClock()
        self.restarts = 0

    def hello(self, _hello: Hello) -> None:
        """Take no notice."""

    def restart(self) -> None:
        self.restarts += 1

    def environment(self, tick_us: int, _environment: Environment) -> None:
        self.times_us.append(tick_us)

    def add(self, _first: int, ticks_us: list[int], _axes: int, _counts: np.ndarray, host: HostClock) -> None:
        self.times_us += ticks_us
        self.host = host


def noted(true_us: list[int], arrivals_ns: list[int], kind: MessageType, together: int) -> NotedTimes:
    """Return what a wheel has noted of frames of a kind, of which so many are taken at once."""
    wheel = NotedTimes()
    router = FrameRouter({}, lambda _position, _hub, _number, _clock: wheel)
    message = Environment(250e3, 20.0, 3.0)
    if kind is MessageType.SAMPLES:
        message = SampleBlock(0, 0b100, np.zeros((1, 1), np.int16))
    frames = [Frame(kind, 0, 0, seq, time_us & 0xFFFFFFFF, message) for seq, time_us in enumerate(true_us)]
    for begin in range(0, len(frames), together):
        cut = slice(begin, begin + together)
        router.take("link", FrameList(frames[cut]), np.array(arrivals_ns[cut]))
    return wheel


@pytest.mark.parametrize("away_min", [10, 40, 60, 71.6, 80, 1000])
@pytest.mark.parametrize("kind", [MessageType.SAMPLES, MessageType.ENVIRONMENT])
@pytest.mark.parametrize("together", [1, 60, 10_000])
def test_arrival_tells_the_wraps_of_a_silence(away_min: float, kind: MessageType, together: int) -> None:
    before_us = range(3_000_000_000, 3_000_000_000 + 100 * STEP_US, STEP_US)
    begin_us = before_us[-1] + round(away_min * 60e6)
    times_us = [*before_us, *range(begin_us, begin_us + 100 * STEP_US, STEP_US)]
    wheel = noted(times_us, [BEGIN_NS + time_us * 1000 for time_us in times_us], kind, together)
    assert wheel.times_us == times_us
    if kind is MessageType.SAMPLES:
        assert abs(wheel.host.host_ns(times_us[-1]) - BEGIN_NS - times_us[-1] * 1000) < 1_000_000
        assert wheel.host.latency_s < 1e-3


@pytest.mark.parametrize("step_min", [-5000, -40, -1, 1, 30])
def test_a_step_of_the_arrivals_hides_no_wrap(step_min: int) -> None:
    times_us = list(range(4_290_000_000, 4_300_000_000, STEP_US))
    arrivals_ns = [BEGIN_NS + time_us * 1000 for time_us in times_us]
    arrivals_ns[50:] = [arrival_ns + step_min * 60_000_000_000 for arrival_ns in arrivals_ns[50:]]
    for together in (1, 10_000):
        assert noted(times_us, arrivals_ns, MessageType.SAMPLES, together).times_us == times_us


def test_ticks_without_arrivals_are_unwrapped_to_the_nearest() -> None:
    hub = Hub()
    assert hub.stamp_all(np.array([2**32 - 10, 5], np.uint32), None).tolist() == [2**32 - 10, 2**32 + 5]
    assert hub.stamp(7, None) == 2**32 + 7


@pytest.mark.parametrize(("change", "restarts"), [({}, 0), ({"hub_id": 0xAC}, 1), ({"boot_count": 2}, 1)])
def test_another_hub_on_a_port_has_a_clock_of_its_own(change: dict[str, int], restarts: int) -> None:
    wheel = NotedTimes()
    router = FrameRouter({}, lambda _position, _hub, _number, _clock: wheel)
    for second in range(40):
        # The other hub has run for ten minutes less.
        said, tick_s = (hello(), 600 + second) if second < 20 or not restarts else (hello(**change), second)
        frame = Frame(MessageType.HELLO, 0, 0, second, tick_s * 1_000_000, said)
        arrival_ns = BEGIN_NS + second * 1_000_000_000
        router.take("link", FrameList([frame]), np.array([arrival_ns]))
        assert router.hub("link", 0).host.host_ns(tick_s * 1e6) == arrival_ns
    assert wheel.restarts == restarts
