"""The reference collector: commands, what of them can be replayed, and starts after resets or a failing flash."""

import threading
from collections.abc import Callable, Iterator

import numpy as np
import pytest

from firmware_protocol.messages import SampleBlock, SetStream
from gateway.clock import ManualClock
from gateway.errors import SourceError
from gateway.io.source import Chunk, LinkEvent, LinkEventKind, LinkItem
from gateway.security.cmac import Key
from gateway.security.key_file import hub_identity, sensor_identity
from gateway.session.commands import Executed, execute
from gateway.simulator.firmware import bench_records
from gateway.simulator.firmware.bench_records import Counters, Flash, Kind, counters, number, record
from tests.testkit.collector_bench import (
    BLOCK,
    HUB,
    HUB_KEY,
    SENSOR_KEY,
    SIGNING_HUB,
    SIGNING_WHEEL,
    WHEEL,
    block,
    blocks,
    delivered,
    rows_of,
    seconds,
    started,
    tick,
)

Run = Callable[..., bytes]
KEYS = {hub_identity(HUB.hub_id): Key(HUB_KEY), sensor_identity(WHEEL.sensor_id): Key(SENSOR_KEY)}


class CollectorLink:
    """A link to the collector: each frame sent is one more record, and the same records give the same bytes."""

    vehicle_toml = None
    link = "test:collector"
    rate_hz: float | None = None

    def __init__(self, run: Run) -> None:
        self._run = run
        self._records = [started(SIGNING_HUB, [SIGNING_WHEEL]), tick(1)]
        self._time_s = 1.0
        self._delivered = 0
        self.sent: list[bytes] = []
        self.heard: list[bytes] = []
        self.listens_to = lambda data: True

    def restart(self) -> None:
        self._records.append(record(Kind.START))
        self._time_s = 0.0
        self.later(1.0)

    def later(self, seconds: float) -> None:
        self._time_s += seconds
        self._records.append(tick(self._time_s))

    def items(self, stop: threading.Event) -> Iterator[LinkItem]:
        yield LinkEvent(self.link, 0, LinkEventKind.CONNECTED)
        while not stop.is_set():
            data = self._run(*self._records)[self._delivered :]
            if not data:
                return
            self._delivered += len(data)
            self.heard.append(data)
            yield Chunk(self.link, 0, data)

    def send(self, data: bytes) -> None:
        self.sent.append(data)
        if self.listens_to(data):
            self._records.append(bench_records.from_gateway(data))
            self.later(0.01)

    def close(self) -> None:
        pass


class Recorded(CollectorLink):
    """What a collector once sent, without the collector."""

    def __init__(self, chunks: list[bytes]) -> None:
        self.sent, self._chunks = [], chunks

    def items(self, stop: threading.Event) -> Iterator[LinkItem]:
        yield LinkEvent(self.link, 0, LinkEventKind.CONNECTED)
        for data in self._chunks:
            yield Chunk(self.link, 0, data)

    def send(self, data: bytes) -> None:
        self.sent.append(data)


def command(link: CollectorLink, running: bool) -> Executed:
    return execute(link, SetStream(running), ManualClock(0), keys=KEYS, timeout_s=60.0)


def test_collector_answers_challenge_and_command_in_every_start(run: Run) -> None:
    link = CollectorLink(run)
    for running in (False, True):
        link.later(2.0)
        assert command(link, running).signed
    link.restart()
    assert command(link, False).signed


def test_answers_of_the_collector_replayed_without_it_count_for_nothing(run: Run) -> None:
    link = CollectorLink(run)
    command(link, False)
    replayed = Recorded(link.heard * 3)
    with pytest.raises(SourceError, match="did not reply"):
        command(replayed, False)
    assert len(replayed.sent) == 1


def test_collector_refuses_a_command_kept_back_until_the_next_challenge(run: Run) -> None:
    link = CollectorLink(run)
    link.listens_to = lambda data: data[7] == 0  # the challenge arrives, the signed command does not
    with pytest.raises(SourceError, match="did not reply"):
        command(link, False)
    unanswered = link.sent[-1]
    link.listens_to = lambda data: True
    link.later(2.0)
    assert command(link, True).signed
    link.sent.clear()
    link.send(unanswered)
    link.later(1.0)
    refused = run(*link._records)
    assert bytes((32, 5)) in refused  # command 32, outcome 5


STEPS = 256 + 16 + 2
"""Steps of writing the flash in the longest start: erasing a page, then a record."""


def test_reset_in_the_middle_of_a_frame(run: Run) -> None:
    """After each number of bytes of a frame: that frame is lost, nothing false is read, all that follows is intact."""
    frame = len(run(started(), blocks(0, 4))) - len(run(started(), blocks(0, 3)))
    assert frame == 242
    cuts = [blocks(0, 3) + number(Kind.RESET_AT, cut) + block(108) for cut in range(1, frame + 1)]
    got = delivered(run(started(), *cuts, blocks(0, 3)))
    assert got.boot_counts == list(range(1, frame + 2))
    assert got.samples() == rows_of(0, 144)
    assert [f.seq for f in got.of(SampleBlock)] == [2, 3, 4] * frame + [5, 2, 3, 4]
    assert got.counters.bad_payload == got.counters.unknown_type == 0
    assert got.counters.noise_bytes == sum(range(1, frame))


def test_boot_count_survives_power_cuts_at_random_moments(run: Run) -> None:
    rng = np.random.default_rng(14)
    cuts = [number(Kind.CUT, int(step)) for step in rng.integers(1, STEPS, 1000)]
    got = delivered(run(started(), *(cut + tick(0.0) for cut in cuts)))
    starts = got.boot_counts
    assert len(starts) > 900
    assert all(later > earlier for earlier, later in zip(starts, starts[1:], strict=False))
    assert starts[-1] <= 2 * len(cuts) + 2


def test_boot_count_survives_a_power_cut_at_every_step(run: Run) -> None:
    """A page holds 16 records, so 16 starts bring each step to every kind of page: new, part full, full."""
    cuts = [number(Kind.CUT, step) + tick(0.0) + record(Kind.START) * 15 for step in range(1, STEPS)]
    starts = delivered(run(started(), *cuts, tick(0.0))).boot_counts
    assert starts == sorted(set(starts))
    assert len(starts) >= STEPS
    assert starts[-1] >= 16 * (STEPS - 1)


@pytest.mark.parametrize("change", [{"axes": 0}, {"axes": 8}, {"rate_hz": 0.0}, {"scale_mps2": (0.0, 0.0, 0.0)}])
def test_invalid_configuration_does_not_start(run: Run, change: dict[str, object]) -> None:
    assert run(started(HUB, [WHEEL._replace(**change)]), blocks(0, 5), seconds(1, 3)) == b""  # type: ignore[arg-type]


def test_repeated_cuts_in_one_start_lose_nothing(run: Run) -> None:
    data = run(started(), b"".join(number(Kind.CUT, step) for step in range(1, 200)), tick(0.0))
    (count,) = delivered(data).boot_counts[-1:]
    assert count >= 2


def test_hub_with_broken_flash_sends_unsigned_and_reports_it(run: Run) -> None:
    broken = record(Kind.FLASH, bytes((Flash.BROKEN,)))
    restart = record(Kind.START)
    data = run(started(SIGNING_HUB, [SIGNING_WHEEL]), broken, restart, seconds(1, 3), restart, seconds(1, 3))
    got = delivered(data)
    assert any("boot count not stored" in line for line in got.log)
    assert len(set(got.boot_counts)) == len(got.boot_counts) >= 2
    repaired = delivered(run(started(), broken, restart, record(Kind.FLASH, bytes((Flash.WORKS,))), restart, tick(0.0)))
    assert repaired.boot_counts[-1] == 2


def test_signing_hub_restarts_before_its_counter_wraps(run: Run) -> None:
    """(boot_count, seq) must not repeat under a key."""
    near = Counters(2**32 - 4100, 0, 0, 0, 0, 0)
    got = delivered(run(started(SIGNING_HUB, [SIGNING_WHEEL]), counters(near), blocks(0, 12), tick(0.1), blocks(0, 6)))
    assert got.boot_counts == [1, 2]
    highest = [frame.seq for frame in got.frames if frame.wheel == 0 and frame.seq > 2**31]
    assert highest
    assert max(highest) < 2**32 - 1
    assert [f.seq for f in got.of(SampleBlock)][-1] < BLOCK
