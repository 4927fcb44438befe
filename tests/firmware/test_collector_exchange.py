"""Commands of the gateway to the reference collector, and what of them can be replayed."""

import threading
from collections.abc import Callable, Iterator

import pytest

from firmware_protocol.messages import SetStream
from gateway.clock import ManualClock
from gateway.errors import SourceError
from gateway.io.source import Chunk, LinkEvent, LinkEventKind, LinkItem
from gateway.security.cmac import Key
from gateway.security.key_file import hub_identity, sensor_identity
from gateway.session.commands import Executed, execute
from gateway.simulator.firmware import bench_records
from gateway.simulator.firmware.bench_records import Kind, record
from tests.testkit.collector_bench import HUB, HUB_KEY, SENSOR_KEY, SIGNING_HUB, SIGNING_WHEEL, WHEEL, started, tick

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
