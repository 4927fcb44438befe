"""Playback keeps the pace of its items and stops in a pause."""

import math
import threading

from gateway.core.clock import ManualClock
from gateway.core.links.playback import Playback

S = 1_000_000_000
STOP, CLOSED = threading.Event(), threading.Event()


def test_stream_time_follows_the_speed_up_to_the_next_item() -> None:
    clock = ManualClock(0)
    playback = Playback(clock, 10.0)
    assert playback.now_ns() is None
    assert playback.wait_until(500 * S, STOP, CLOSED)
    assert playback.now_ns() == 500 * S
    assert playback.wait_until(520 * S, STOP, CLOSED)
    assert clock.now_ns() == 2 * S
    clock.advance_ns(S)
    assert playback.now_ns() == 520 * S, "the next item may be due at any time"


def test_waiting_for_the_next_item_shows_time_passing() -> None:
    clock = ManualClock(0)
    playback = Playback(clock, 1.0)
    playback.wait_until(100 * S, STOP, CLOSED)
    seen = []

    class Watching(ManualClock):
        def sleep_until_ns(self, deadline_ns, stop=None):
            seen.append(playback.now_ns())
            return super().sleep_until_ns(deadline_ns, stop)

    playback._clock = Watching(0)
    assert playback.wait_until(103 * S, STOP, CLOSED)
    assert seen == [100 * S + n * S // 10 for n in range(30)]


def test_pause_stops_the_stream_and_resumes_where_it_stopped() -> None:
    clock = ManualClock(0)
    playback = Playback(clock, 2.0)
    playback.wait_until(0, STOP, CLOSED)
    clock.advance_ns(S)
    playback.pause(True)
    playback.pause(True)
    resumes_at_ns = 50 * S

    class Resuming(ManualClock):
        def sleep_until_ns(self, deadline_ns, stop=None):
            if self.now_ns() >= resumes_at_ns:
                playback.pause(False)
            return super().sleep_until_ns(deadline_ns, stop)

    playback._clock = Resuming(clock.now_ns())
    assert playback.wait_until(10 * S, STOP, CLOSED)
    # 1 s before the pause, 49 s of pause, and the remaining 4 s of 10 s at twice the pace.
    assert abs(playback._clock.now_ns() - 54 * S) <= 0.2 * S


def test_pause_holds_at_full_speed() -> None:
    playback = Playback(ManualClock(0), math.inf)
    assert playback.wait_until(0, STOP, CLOSED)
    playback.pause(True)
    stop = threading.Event()
    thread = threading.Thread(target=lambda: stop.set() if playback.wait_until(S, stop, CLOSED) else None)
    stop.set()
    thread.start()
    thread.join(5.0)
    assert playback.now_ns() == 0
    playback.pause(False)
    assert playback.wait_until(S, STOP, CLOSED)
