"""Revolutions that are worked on in blocks: the size of the blocks changes neither results nor memory."""

import random
import tracemalloc

import numpy as np
import pytest

from firmware_protocol.messages import Environment, Hello, SampleBlock
from gateway.core.estimates.wheel_setup import WheelSetup
from gateway.core.wheels.timebase import HostClock
from gateway.core.wheels.wheel_pipeline import WheelPipeline
from tests.testkit.agreement import assert_agree

SETUP = WheelSetup("FL", 0, 0, 0.32, load_n=5000.0, load_std_n=50.0)
BLOCK = 36


def prepared(frames, estimators=("kinematic", "weak-form", "ply-steer")):
    """Return a wheel that knows its sensor, its clock, and all samples of the frames."""
    wheel, host = WheelPipeline(SETUP, estimators), HostClock()
    wheel.hello(next(frame.message for frame in frames if isinstance(frame.message, Hello)))
    blocks = [frame.message for frame in frames if isinstance(frame.message, SampleBlock)]
    counts = np.concatenate([block.counts for block in blocks if len(block.counts) == BLOCK])
    return wheel, host, blocks[0].axes, counts


def add(wheel, host, axes, counts, first, end):
    """Add blocks `first` to `end` (exclusive)."""
    ticks = [round(block * BLOCK * 1e6 / 9600.0) for block in range(first, end)]
    wheel.add(first * BLOCK, ticks, axes, counts[first * BLOCK : end * BLOCK], host)


def whole(frames, sizes):
    """Return the results when blocks of samples come `sizes()` at a time, each completed at once."""
    wheel, host, axes, counts = prepared(frames)
    results, position, last = [], 0, len(counts) // BLOCK
    while position < last:
        end = min(position + sizes(), last)
        add(wheel, host, axes, counts, position, end)
        results += wheel.complete()
        position = end
    return results + wheel.finish(host)


@pytest.fixture(scope="module")
def frames(roll, to_frames):
    return to_frames(roll(lambda t: 55.0 + 15.0 * np.sin(0.4 * t), 11.0, seed=3).radial_mps2)


def test_results_do_not_depend_on_the_blocks(frames) -> None:
    one_at_a_time = whole(frames, lambda: 1)
    assert len(one_at_a_time) > 70
    rng = random.Random(4)
    for sizes in (lambda: 10**6, lambda: 1000, lambda: rng.randrange(1, 900)):
        assert_agree(whole(frames, sizes), one_at_a_time)


def test_late_reading_is_not_used_by_revolutions_before_it(frames) -> None:
    late = Environment(300e3, 40.0, 3.0)

    def run(*, complete):
        wheel, host, axes, counts = prepared(frames, ("kinematic",))
        wheel.environment(0, Environment(210e3, 30.0, 3.0))
        add(wheel, host, axes, counts, 0, 1000)
        results = wheel.complete() if complete else []
        wheel.environment(1_500_000, late)  # of a time at which revolutions ended that wait
        add(wheel, host, axes, counts, 1000, 1400)
        return results + wheel.finish(host)

    at_once, waiting = run(complete=True), run(complete=False)
    assert_agree(waiting, at_once)
    assert {result.conditions.pressure_pa for result in waiting} == {210e3, 300e3}


def test_waiting_revolutions_keep_their_samples(frames) -> None:
    wheel, host, axes, counts = prepared(frames, ("kinematic",))
    add(wheel, host, axes, counts, 0, len(counts) // BLOCK)  # longer than the buffer, in one piece
    results = wheel.complete()
    assert len(results) > 70
    assert all(result.revolution.missing_fraction == 0.0 for result in results)
    assert np.isfinite([result.revolution.leading_edge_rad for result in results]).all()
    assert wheel.snapshot().counters.samples_overwritten == 0


def test_memory_does_not_grow_with_the_recording(frames) -> None:
    wheel, host, axes, counts = prepared(frames, ("kinematic",))
    held, step = [], 150
    for index in range(0, len(counts) // BLOCK - step, step):
        add(wheel, host, axes, counts, index, index + step)
        if index == 8 * step:  # the average and most lists are full
            tracemalloc.start()
        wheel.complete()
        if tracemalloc.is_tracing():
            held.append(tracemalloc.get_traced_memory()[0])
    tracemalloc.stop()
    assert len(held) > 6
    # What is held of a revolution in angle is 37 kB, and up to six come at a time.
    assert max(held[len(held) // 2 :]) - max(held[: len(held) // 2]) < 250_000
