import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.core.wheels.sample_buffer import SampleBuffer


def ramp(first: int, n: int) -> np.ndarray:
    return (np.arange(first, first + n) % 30000).astype(np.int16)[:, None]


@given(st.lists(st.integers(1, 150), min_size=1, max_size=60), st.integers(20, 100))
def test_buffer_holds_latest_samples(blocks, capacity):
    buffer = SampleBuffer(capacity, 1)
    total = 0
    for n in blocks:
        buffer.append(ramp(total, n))
        total += n
        assert buffer.head == total
        assert buffer.tail == max(0, total - capacity)
        np.testing.assert_array_equal(
            buffer.view(buffer.tail, buffer.head), ramp(buffer.tail, buffer.head - buffer.tail)
        )


@given(st.lists(st.integers(1, 150), min_size=1, max_size=40), st.integers(20, 100), st.integers(0, 200))
def test_overwritten_counts_unread_samples(blocks, capacity, lag):
    buffer = SampleBuffer(capacity, 1)
    total, lost = 0, set()
    for n in blocks:
        unread = max(0, total - lag)
        buffer.append(ramp(total, n), unread)
        total += n
        lost |= set(range(unread, max(unread, total - capacity)))
    assert buffer.overwritten == len(lost)


def test_gap_is_interpolated_and_counted():
    buffer = SampleBuffer(100, 1)
    buffer.append(np.array([[0], [10]], np.int16))
    buffer.bridge(4, np.array([60], np.int16))
    buffer.append(np.array([[60]], np.int16))
    assert buffer.view(0, 7)[:, 0].tolist() == [0, 10, 20, 30, 40, 50, 60]
    assert buffer.missing_between(0, 7) == 4
    assert buffer.missing_between(3, 5) == 2


def test_late_samples_fill_their_gap():
    buffer = SampleBuffer(100, 1)
    buffer.append(ramp(0, 10))
    buffer.bridge(10, np.array([20], np.int16))
    buffer.append(ramp(20, 5))
    assert buffer.patch(12, np.full((4, 1), 7, np.int16)) == 4
    assert buffer.patch(12, np.full((4, 1), 9, np.int16)) == 0
    assert buffer.view(11, 17)[:, 0].tolist() == [11, 7, 7, 7, 7, 16]
    assert buffer.missing_between(0, 25) == 6
    assert buffer.patch(2, np.full((3, 1), 9, np.int16)) == 0
    assert buffer.view(2, 5)[:, 0].tolist() == [2, 3, 4]


def test_view_outside_the_buffer_raises():
    buffer = SampleBuffer(10, 1)
    buffer.append(ramp(0, 25))
    for first, end in ((0, 20), (14, 16), (20, 26), (22, 21)):
        with pytest.raises(IndexError, match="not in 15..25"):
            buffer.view(first, end)


def test_gaps_are_those_that_reach_into_a_range():
    buffer = SampleBuffer(100, 1)
    buffer.append(ramp(0, 10))
    buffer.bridge(5, np.array([15], np.int16))
    buffer.append(ramp(15, 20))
    buffer.bridge(5, np.array([40], np.int16))
    buffer.append(ramp(40, 20))
    assert buffer.gaps_between(0, 60) == [(10, 15), (35, 40)]
    assert buffer.gaps_between(14, 36) == [(10, 15), (35, 40)]
    assert buffer.gaps_between(15, 35) == []


def test_mean_is_of_the_samples_that_were_measured() -> None:
    buffer = SampleBuffer(50, 1)
    buffer.append(np.full((4, 1), 10, np.int16))
    buffer.bridge(3, np.array([1000], np.int16))
    buffer.append(np.array([[1000], [10]], np.int16))
    assert buffer.measured_mean(0, 6, 0) == 10.0
    assert buffer.measured_mean(0, 9, 0) == pytest.approx((5 * 10 + 1000) / 6)
    assert math.isnan(buffer.measured_mean(4, 7, 0))
