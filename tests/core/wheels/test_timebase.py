import numpy as np
import pytest

from gateway.core.wheels.timebase import HostClock, SampleClock


def test_sampling_rate_is_measured_by_hub_clock():
    clock = SampleClock(9600.0)
    true_hz = 9600.0 * 1.013
    rng = np.random.default_rng(1)
    for block in range(5000):
        index = 36 * block
        clock.stamp(index, round(index / true_hz * 1e6 + rng.normal(0, 20)))
    assert clock.rate_hz(4799) == 9600.0
    assert abs(clock.rate_hz(9600) / true_hz - 1) < 2e-4  # the stamps differ by 13 ms from the nominal rate
    assert abs(clock.rate_hz(179_000) / true_hz - 1) < 2e-6
    assert abs(clock.hub_us(179_000) - 179_000 / true_hz * 1e6) < 20


def test_nominal_rate_holds_while_a_hub_may_have_read_late():
    clock = SampleClock(9600.0)
    for block in range(500):
        index = 36 * block
        clock.stamp(index, round(index / 9600.0 * 1e6) + 1500 * (block % 2))
    assert clock.rate_hz(17_000) == 9600.0
    assert abs(clock.rate_hz(21_000) / 9600.0 - 1) < 1e-3


def test_implausible_rate_is_ignored():
    clock = SampleClock(9600.0)
    for index in range(0, 96000, 36):
        clock.stamp(index, round(index / 4800 * 1e6))
    assert clock.rate_hz(96000) == 9600.0


def test_time_does_not_change_with_later_stamps():
    first, other = SampleClock(9600.0), SampleClock(9600.0)
    stamps = [(index, round(index / 9612.0 * 1e6)) for index in range(0, 300_000, 36)]
    answers = []
    for index, tick in stamps:
        first.stamp(index, tick)
        answers.append(first.hub_us(index))
    for index, tick in stamps:
        other.stamp(index, tick)
    late = [other.hub_us(index) for index, _ in stamps[-3000:]]
    np.testing.assert_allclose(late, answers[-3000:], atol=1e-3)


def arrivals(seconds: int, drift: float, seed: int = 2) -> list[tuple[int, int]]:
    rng = np.random.default_rng(seed)
    ticks = np.arange(0, seconds * 1_000_000, 10_000)
    host = 1_700_000_000_000_000_000 + (ticks * 1000.0 * (1 + drift)).astype(np.int64)
    # A link only adds delay: 2 ms at least, bursts of 30 ms.
    return list(
        zip(ticks.tolist(), (host + (2e6 + rng.exponential(8e6, len(ticks)))).astype(np.int64).tolist(), strict=True)
    )


def test_host_time_follows_earliest_arrivals():
    clock = HostClock()
    for tick, host_ns in arrivals(120, 80e-6):
        clock.stamp(tick, host_ns)
    asked = 110_000_000
    true_ns = 1_700_000_000_000_000_000 + round(asked * 1000 * (1 + 80e-6)) + 2_000_000
    assert abs(clock.host_ns(asked) - true_ns) < 0.6e6


def test_host_time_does_not_depend_on_frame_order():
    stamps = arrivals(30, 0.0)
    step_by_step, at_once = HostClock(), HostClock()
    answers = []
    for tick, host_ns in stamps:
        step_by_step.stamp(tick, host_ns)
        answers.append(step_by_step.host_ns(tick - 3000))
    for tick, host_ns in stamps:
        at_once.stamp(tick, host_ns)
    assert [at_once.host_ns(tick - 3000) for tick, _ in stamps] == answers


def test_latency_is_relative_to_fastest_frames():
    clock = HostClock()
    stamps = arrivals(60, 0.0)
    for tick, host_ns in stamps:
        clock.stamp(tick, host_ns)
    tick = stamps[-1][0]
    clock.stamp(tick, clock.host_ns(tick) + 50_000_000)
    assert abs(clock.latency_s - 0.05) < 1e-3


def test_frames_that_arrive_together_count_as_one_by_one():
    first, other = HostClock(), HostClock()
    stamps = arrivals(12, 30e-6)
    for index in range(0, len(stamps), 7):
        together = [tick_us for tick_us, _ in stamps[index : index + 7]]
        host_ns = stamps[min(index + 6, len(stamps) - 1)][1]
        for tick_us in together:
            first.stamp(tick_us, host_ns)
        other.stamp_all(np.array(together), np.full(len(together), host_ns))
    times_us = range(stamps[0][0], stamps[-1][0], 500_000)
    assert [first.host_ns(time_us) for time_us in times_us] == [other.host_ns(time_us) for time_us in times_us]


def test_a_hub_200_ppm_fast_is_followed_for_a_day():
    clock, ppm = HostClock(), 200e-6
    rng = np.random.default_rng(5)
    begin_ns, step_us = 1_700_000_000_000_000_000, 250_000
    errors_s = []
    for minute in range(24 * 60):
        ticks_us = np.arange(minute * 60_000_000, (minute + 1) * 60_000_000, step_us)
        true_ns = begin_ns + np.round(ticks_us * 1000.0 / (1.0 + ppm)).astype(np.int64)
        clock.stamp_all(ticks_us, true_ns + (2e6 + rng.exponential(8e6, len(ticks_us))).astype(np.int64))
        errors_s.append((clock.host_ns(float(ticks_us[-1])) - int(true_ns[-1])) * 1e-9)
    # 17 s are gained in a day; a time is wrong by the quickest delay of the link, and by what a minute of drift leaves.
    assert np.max(np.abs(errors_s[3:])) < 0.02
    assert np.ptp(errors_s[-60:]) < 0.02


def stamped(
    ticks_us: np.ndarray, block: int = 80, lost: frozenset[int] = frozenset(), rate_hz: float = 9600.0
) -> tuple[SampleClock, int]:
    """Return a clock that has seen the blocks, those lost without a mark not numbered, and its last sample."""
    clock, index = SampleClock(rate_hz), 0
    for number, tick_us in enumerate(ticks_us):
        if number not in lost:
            clock.stamp(index, round(tick_us))
            index += block
    return clock, index - block


def block_times_us(seconds: float, block: int = 80, rate_hz: float = 9600.0) -> np.ndarray:
    return np.arange(round(seconds * rate_hz / block)) * block * 1e6 / rate_hz


@pytest.mark.parametrize("step_us", [300_000.0, -100_000.0, 8000.0, 2000.0])
def test_a_step_of_the_hubs_clock_does_not_change_the_rate(step_us: float) -> None:
    times_us = block_times_us(12.0) + np.where(np.arange(1440) >= 720, step_us, 0.0)
    clock, last = stamped(times_us)
    assert abs(clock.rate_hz(last) / 9600.0 - 1.0) < 1e-6
    assert clock.rate_std(last) < 1e-5
    assert abs(clock.hub_us(last) - times_us[-1]) < 20.0


def test_samples_lost_without_a_mark_do_not_change_the_rate() -> None:
    rng = np.random.default_rng(3)
    lost = frozenset(np.flatnonzero(rng.random(2400) < 0.004).tolist())
    clock, last = stamped(block_times_us(20.0), lost=lost)
    assert len(lost) > 5
    assert abs(clock.rate_hz(last) / 9600.0 - 1.0) < 1e-6


@pytest.mark.parametrize("seed", range(6))
def test_error_of_the_rate_covers_what_stamps_that_scatter_or_bend_leave(seed: int) -> None:
    rng = np.random.default_rng(seed)
    for seconds in (6.0, 12.0, 25.0):
        times_us = block_times_us(seconds)
        scattered, last = stamped(times_us + rng.normal(0.0, 700.0, len(times_us)))
        assert abs(scattered.rate_hz(last) / 9600.0 - 1.0) < 3.5 * scattered.rate_std(last)
        assert scattered.rate_std(last) < 1e-3
        # Samples come ever later: at the end, the rate is lower by 20 ppm for each second.
        drifting, last = stamped(times_us + 1e-5 * times_us * times_us * 1e-6)
        off = drifting.rate_hz(last) / 9600.0 * (1.0 + 2e-5 * seconds) - 1.0
        assert abs(off) < 3.0 * drifting.rate_std(last)
    assert stamped(times_us)[0].rate_std(last) == 0.0
