"""Error of the hub's clock against the host's, from delayed arrivals."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from gateway.diagnosis.campaign_clock import HubClockError, combined


def batch(ticks_us, hub=0):
    ticks = (np.asarray(ticks_us, np.int64) & 0xFFFFFFFF).astype(np.uint32)
    return SimpleNamespace(hub=np.full(len(ticks), hub, np.uint8), tick_us=ticks)


def watched(error, *, seconds=60.0, late_ms=1.0, seed=1, start_us=0, split=300):
    rng = np.random.default_rng(seed)
    host_s = np.arange(0.0, seconds, 0.01)
    ticks = start_us + np.round(host_s * (1 + error) * 1e6).astype(np.int64)
    arrivals = ((host_s + 1e-3 * late_ms * rng.exponential(size=len(host_s))) * 1e9).astype(np.int64) + 10**18
    arrivals = np.maximum.accumulate(arrivals)
    clock = HubClockError()
    for index in range(0, len(ticks), split):
        clock.take("link", batch(ticks[index : index + split]), arrivals[index : index + split])
    return clock.error(0)


@pytest.mark.parametrize("error", [0.0, 50e-6, -3e-3])
@pytest.mark.parametrize("start_us", [0, 2**32 - 5_000_000])
def test_error_is_estimated(error, start_us):
    result, std = watched(error, start_us=start_us)
    assert result == pytest.approx(error, abs=5 * std)
    assert std < 3e-6


@pytest.mark.parametrize("late_ms", [0.3, 5.0])
def test_standard_error_is_calibrated(late_ms):
    z = [(result - 2e-5) / std for result, std in (watched(2e-5, late_ms=late_ms, seed=seed) for seed in range(60))]
    assert 0.6 < math.sqrt(np.mean(np.square(z))) < 1.5


def test_blocks_do_not_matter():
    assert watched(1e-4, split=300) == pytest.approx(watched(1e-4, split=77), rel=1e-9)


def test_restart_resets_the_estimate():
    clock = HubClockError()
    rng = np.random.default_rng(1)
    for begin_s in (0.0, 100.0):
        host_s = np.arange(0.0, 40.0, 0.01)
        ticks = np.round(host_s * (1 + 80e-6) * 1e6).astype(np.int64)
        arrivals = ((begin_s + host_s + 1e-4 * rng.exponential(size=len(host_s))) * 1e9).astype(np.int64)
        clock.take("link", batch(ticks), arrivals)
    result, std = clock.error(0)
    assert result == pytest.approx(80e-6, abs=5 * std)


def test_short_recordings_give_nothing():
    assert all(map(math.isnan, watched(0.0, seconds=5.0)))
    clock = HubClockError()
    clock.take("link", batch(np.arange(0, 60_000_000, 10_000)), np.arange(0, 60_000_000, 10_000) * 1000)
    assert all(map(math.isnan, clock.error(1)))


def test_recordings_are_weighted():
    assert combined([(1e-5, 1e-6), (math.nan, math.nan)]) == (1e-5, 1e-6)
    value, std = combined([(1e-5, 1e-6), (3e-5, 1e-6)])
    assert value == pytest.approx(2e-5)
    assert std == pytest.approx(1e-5, rel=0.01)
    assert all(map(math.isnan, combined([])))


def slotted(error, frame_ms, *, seconds, seed=1):
    """Frames at uniform hub times, delivered by a link at the ends of 10 ms slots of host time."""
    rng = np.random.default_rng(seed)
    ticks_ms = np.arange(frame_ms, 1e3 * seconds, frame_ms)
    slots = np.ceil(ticks_ms / (1 + error) / 10.0)
    late = 0.3 * rng.exponential(size=int(slots.max()) + 1)
    arrivals = ((10.0 * slots + late[slots.astype(int)]) * 1e6).astype(np.int64)
    clock = HubClockError()
    clock.take("link", batch(np.round(1e3 * ticks_ms)), np.maximum.accumulate(arrivals))
    return clock.error(0)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("error", [-1e-3, -1.2e-4, 0.0, 4e-5, 1.2e-4, 3e-4])
def test_slotted_link_is_limited_by_its_slots(error, seed):
    # 3.75 ms and 10 ms have the common divisor 1.25 ms: in 8 s a clock error of 150 ppm is undetectable.
    result, std = slotted(error, 3.75, seconds=8.0, seed=seed)
    assert abs(result - error) < 2.5 * std
    assert 5e-5 < std < 3e-4
    result, std = slotted(error, 3.75, seconds=80.0, seed=seed)
    assert abs(result - error) < 2.5 * std
    assert std < 3e-5


def test_unslotted_arrivals_are_more_precise():
    result, std = slotted(1.2e-4, 3.77, seconds=20.0)
    assert result == pytest.approx(1.2e-4, abs=4 * std)
    assert std < 3e-5
