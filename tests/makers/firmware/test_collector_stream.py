"""Samples, schedule, queue, rate, listener and watchdog of the reference collector."""

from collections.abc import Callable

import numpy as np
import pytest

from firmware_protocol.messages import (
    Environment,
    Hello,
    HubStatus,
    MessageType,
    Outcome,
    SampleBlock,
    SetRate,
    SetStream,
    SetTime,
    TimeSync,
)
from tests.testkit.collector_bench import (
    BLOCK,
    HUB,
    UNLIMITED,
    WHEEL,
    Counters,
    arriving,
    block,
    blocks,
    command_bytes,
    counters,
    counts_of,
    delivered,
    listening,
    number,
    rows_of,
    seconds,
    started,
    tick,
)
from tests.testkit.emulated_firmware import bench_records
from tests.testkit.emulated_firmware.bench_records import Kind, record

Run = Callable[..., bytes]
WRAP = 2**32


@pytest.mark.parametrize("axes", range(1, 8))
def test_every_sample_arrives_with_its_number(run: Run, axes: int) -> None:
    channels = axes.bit_count()
    wheels = [WHEEL._replace(wheel=index * 3, axes=axes) for index in range(4)]
    rng = np.random.default_rng(axes)
    records, firsts = [started(HUB, wheels)], [0] * 4
    for _ in range(200):
        position, n = int(rng.integers(4)), int(rng.integers(1, 120 // channels + 1))
        records.append(block(firsts[position], n, place=position, channels=channels))
        firsts[position] += n
    got = delivered(run(*records))
    assert got.counters.lost == got.counters.noise_bytes == got.counters.crc_errors == 0
    for position in range(4):
        rows = got.samples(wheel=3 * position)
        full = {1: 109, 2: 54, 3: 36}[channels]
        assert len(rows) == firsts[position] // full * full > 0
        assert rows == {k: v for k, v in rows_of(0, firsts[position], channels).items() if k in rows}


def test_samples_are_dated_by_their_first(run: Run) -> None:
    got = delivered(run(started(), *(block(first, 40) for first in range(0, 4000, 40))))
    for frame in got.of(SampleBlock):
        assert isinstance(frame.message, SampleBlock)
        assert frame.tick_us == pytest.approx(frame.message.first_sample / 9600.0 * 1e6, abs=1.0)


def test_messages_follow_their_schedule(run: Run) -> None:
    environment = bench_records.environment(0, 500_000, 235_000.0, 31.5, 2.987)
    got = delivered(run(started(), environment, seconds(1, 11)))
    assert [frame.type for frame in got.frames[:4]] == [
        MessageType.HELLO,
        MessageType.ENVIRONMENT,
        MessageType.HUB_STATUS,
        MessageType.TIME_SYNC,
    ]
    assert [len(got.of(kind)) for kind in (Hello, Environment, HubStatus, TimeSync)] == [6, 11, 11, 11]
    assert got.messages(Environment)[0] == Environment(None, None, None)
    assert got.messages(Environment)[1] == Environment(235_000.0, 31.5, 2.987)
    hello = got.messages(Hello)[0]
    assert (hello.protocol_major, hello.protocol_minor, hello.boot_count, hello.rate_hz) == (1, 1, 1, 9600.0)
    assert hello.scale_mps2 == WHEEL.scale_mps2
    assert got.status.uptime_s == 10
    assert got.status.supply_w == pytest.approx(0.08)


def test_missing_block_shows_in_the_sample_number(run: Run) -> None:
    """Blocks that find the ring full are counted, and their numbers are left out."""
    burst = blocks(0, 5)
    got = delivered(run(started(), burst, record(Kind.STALL, bytes(4)), blocks(180, 30)))
    assert got.samples() == rows_of(0, 180)


def test_overrun_is_exactly_the_gaps_in_seq(run: Run) -> None:
    stall = number(Kind.STALL, 1000)
    freed = number(Kind.STALL, UNLIMITED)
    data = run(started(), blocks(0, 10), stall, blocks(360, 40), freed, blocks(1800, 20), seconds(2, 4))
    got = delivered(data)
    seqs = sorted(frame.seq for frame in got.frames if frame.wheel == 0)
    missing = set(range(seqs[-1] + 1)) - set(seqs)
    sent_rows = got.samples()
    assert got.counters.lost == len(missing) == got.status.frames_dropped > 10
    assert got.status.samples_dropped == 70 * BLOCK - len(sent_rows) == BLOCK * len(missing)
    assert sent_rows == {k: v for k, v in rows_of(0, 70 * BLOCK).items() if k in sent_rows}
    last = next(k for k, frame in enumerate(got.frames) if frame.message is got.status)
    assert 0 <= last - got.status.frames_sent <= 3, "only frames of the same second were still in the queue"


def test_hello_and_reply_pass_during_an_overrun(run: Run) -> None:
    stall, freed = number(Kind.STALL, 0), number(Kind.STALL, UNLIMITED)
    command = arriving([command_bytes(SetTime(5), 3)])
    got = delivered(run(started(), stall, blocks(0, 60), *command, freed, blocks(60 * BLOCK, 2)))
    assert got.results == [(3, Outcome.DONE)]


def test_rate_changes_while_streaming(run: Run) -> None:
    wheels = [WHEEL._replace(rates_hz=(9600.0, 4800.0)), WHEEL._replace(wheel=1, rates_hz=(9600.0, 4800.0))]
    change = b"".join(arriving([command_bytes(SetRate(4700.0), 1)]))
    old = b"".join(block(first, 30, place=position) for first in range(0, 300, 30) for position in (0, 1))
    begin_us = 40_000
    new = b"".join(
        bench_records.samples(position, begin_us + round(k * 30 / 4800.0 * 1e6), counts_of(300 + 30 * k, 30))
        for k in range(12)
        for position in (0, 1)
    )
    got = delivered(run(started(HUB, wheels), old, change, new))
    for wheel in (0, 1):
        frames = [frame for frame in got.frames if frame.wheel == wheel and frame.type in (1, 2)]
        (turn,) = [k for k, f in enumerate(frames) if isinstance(f.message, Hello) and f.message.rate_hz == 4800.0]
        for part, first, n in ((frames[:turn], 0, 300), (frames[turn:], 300, 360)):
            blocks_of = [frame for frame in part if isinstance(frame.message, SampleBlock)]
            rows = np.concatenate([frame.message.counts for frame in blocks_of])
            np.testing.assert_array_equal(rows, counts_of(first, n))
            numbers = [frame.message.first_sample for frame in blocks_of]
            assert numbers == list(range(0, n, BLOCK)), "numbers begin again with the rate"
        ticks = [frame.tick_us for frame in blocks_of]
        assert ticks[0] == begin_us
        assert np.diff(ticks) == pytest.approx(BLOCK / 4800.0 * 1e6, abs=1.0)
    assert got.results == [(1, Outcome.DONE)]
    assert got.counters.lost == 0


def test_stream_stops_and_starts_by_wheel(run: Run) -> None:
    wheels = [WHEEL, WHEEL._replace(wheel=1)]
    both = b"".join(block(first, place=position) for first in range(0, 10 * BLOCK, BLOCK) for position in (0, 1))
    stop = b"".join(arriving([command_bytes(SetStream(False), 0, wheel=1)]))
    more = b"".join(
        block(first, place=position) for first in range(10 * BLOCK, 20 * BLOCK, BLOCK) for position in (0, 1)
    )
    got = delivered(run(started(HUB, wheels), both, stop, more, seconds(1, 3)))
    assert len(got.samples(0)) == 20 * BLOCK
    assert set(got.samples(1)) == set(range(10 * BLOCK))
    assert got.counters.lost == got.status.frames_dropped == got.status.samples_dropped == 0
    assert [frame.wheel for frame in got.of(Environment)].count(1) == 3


def test_nothing_is_sent_without_a_listener(run: Run) -> None:
    data = run(started(), listening(False), blocks(0, 20), listening(True), blocks(20 * BLOCK, 3))
    got = delivered(data)
    assert [frame.type for frame in got.of(Hello)] == [MessageType.HELLO] * 2
    assert set(got.samples()) == set(range(20 * BLOCK, 23 * BLOCK))
    assert got.counters.lost == 0
    order = [frame.type for frame in got.frames if frame.wheel == 0]
    assert order.index(MessageType.SAMPLES) > [k for k, t in enumerate(order) if t == MessageType.HELLO][1]


def test_time_is_echoed(run: Run) -> None:
    got = delivered(run(started(), *arriving([command_bytes(SetTime(2**63 + 5), 9)]), seconds(1, 3)))
    assert got.results == [(9, Outcome.DONE)]
    assert got.messages(TimeSync)[-1].host_ns == 2**63 + 5


def test_every_counter_wraps(run: Run) -> None:
    near = Counters(WRAP - 5, WRAP - 100, WRAP - 3, WRAP - 1, WRAP - 2, WRAP - 20_000)
    samples = [
        bench_records.samples(0, (WRAP - 10_000 + k * 3750) % WRAP, counts_of(k * BLOCK, BLOCK)) for k in range(20)
    ]
    end = b"".join(number(Kind.TIME, 1_000_000 * k) for k in range(1, 3))
    before = len(run(started()))
    got = delivered(run(started(), counters(near), *samples, end)[before:])
    assert got.counters.lost == got.counters.restarts == got.counters.duplicates == 0
    rows = got.samples()
    assert len(rows) == 20 * BLOCK
    assert {WRAP - 100, WRAP - 1, 0, 1} < rows.keys()
    seqs = [frame.seq for frame in got.frames if frame.wheel == 0]
    assert WRAP - 1 in seqs
    assert seqs[-1] < 100
    last = got.of(TimeSync)[-1]
    assert isinstance(last.message, TimeSync)
    assert last.message.hub_us == WRAP + 2_000_000
    assert last.tick_us == 2_000_000
    assert got.status.frames_sent < 100
    assert (got.status.frames_dropped, got.status.samples_dropped) == (WRAP - 1, WRAP - 2)
    assert got.status.uptime_s == (WRAP + 2_000_000) // 1_000_000


def test_watchdog_restarts_a_hanging_collector(run: Run) -> None:
    got = delivered(run(started(), blocks(0, 5), record(Kind.HANG), blocks(0, 5)))
    assert got.boot_counts == [1, 2]
    assert len([frame for frame in got.of(SampleBlock) if frame.seq < 7]) == 10


def test_damaged_records_change_nothing(run: Run) -> None:
    damaged = bytearray(block(0))
    damaged[20] ^= 1
    got = delivered(run(started(), b"noise", bytes(damaged), block(0), tick(1)))
    assert got.samples() == rows_of(0, BLOCK)
