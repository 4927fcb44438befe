"""The collector on the emulated board: simulated tires in, frames out, and faults on the way."""

import contextlib
import re
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from firmware_protocol.codec import encode_raw
from firmware_protocol.decoder import FrameDecoder
from firmware_protocol.messages import (
    HUB_ITSELF,
    CommandResult,
    HubStatus,
    MessageType,
    Outcome,
    SampleBlock,
    SetStream,
    SetTime,
)
from gateway.core.clock import SystemClock
from gateway.core.config.vehicle import parse_vehicle
from gateway.core.links.source import Chunk, TwoWaySource, open_source
from gateway.core.session.core import SessionCore
from gateway.security.cmac import Key
from gateway.security.hub_commands import execute
from gateway.security.key_file import hub_identity, sensor_identity
from gateway.simulator.scenario import load_scenario, vehicle_toml
from gateway.simulator.simulation import simulate
from tests.testkit.collector_bench import (
    HUB,
    HUB_KEY,
    SENSOR_KEY,
    SIGNING_HUB,
    SIGNING_WHEEL,
    UNLIMITED,
    WHEEL,
    Delivery,
    block,
    blocks,
    command_bytes,
    delivered,
    number,
    rows_of,
    tick,
)
from tests.testkit.emulated_firmware import bench_records
from tests.testkit.emulated_firmware.bench_records import Kind
from tests.testkit.emulated_firmware.emulated_board import EmulatedBoard
from tests.testkit.emulated_firmware.sensor_feed import Played, SensorFeed, play

ROOT = Path(__file__).parents[3]
TREADLINK = [sys.executable, "-m", "gateway.core.cli"]
TIMEOUT_S = 30.0
# Programs start slowly on a busy computer.
PROGRAM_TIMEOUT_S = 120.0
NS = 1_000_000_000


@pytest.fixture
def board(board_image: Path) -> Iterator[EmulatedBoard]:
    with EmulatedBoard(board_image) as running:
        yield running


class DeliveryClock:
    """Clock of a feed: its time is that of the samples on the link, so that a busy computer overruns no buffer."""

    # Three records of 40 samples: less than the ring holds, more than a block of 36 of which a part waits.
    AHEAD_SAMPLES = 120

    def __init__(self, rate_hz: float) -> None:
        self._rate_hz = rate_hz
        self._delivered = 0
        self._changed = threading.Condition()

    def delivered(self, samples: int) -> None:
        with self._changed:
            self._delivered = samples
            self._changed.notify()

    def now_ns(self) -> int:
        return round(self._delivered / self._rate_hz * NS)

    def sleep_until_ns(self, deadline_ns: int, stop: threading.Event | None = None) -> bool:
        with self._changed:
            ahead_ns = round(self.AHEAD_SAMPLES / self._rate_hz * NS)
            assert self._changed.wait_for(lambda: self.now_ns() + ahead_ns >= deadline_ns, TIMEOUT_S)
        return stop is not None and stop.is_set()


class Link:
    """The gateway's end of the link: keeps what it reads."""

    def __init__(self, board: EmulatedBoard) -> None:
        host, port = board.address.split(":")
        self.socket = socket.create_connection((host, int(port)), TIMEOUT_S)
        self.data = b""
        self._decoder = FrameDecoder()
        self._frames: list = []
        self.samples = 0
        self.clock: DeliveryClock | None = None

    def replied(self, seq: int) -> bool:
        """Return whether one of the last frames says that a command was carried out."""
        return any(
            frame.message == CommandResult(seq, frame.message.command, Outcome.DONE)
            for frame in self._frames[-50:]
            if isinstance(frame.message, CommandResult)
        )

    def until(self, enough: Callable[[Delivery], bool]) -> Delivery:
        """Read until the delivery is enough."""
        while True:
            result = Delivery(self._frames, self._decoder.counters)
            if enough(result):
                return result
            received = self.socket.recv(1 << 16)
            assert received
            self.data += received
            fresh = self._decoder.feed(received)
            self._frames += fresh
            self.samples += sum(len(f.message.counts) for f in fresh if isinstance(f.message, SampleBlock))
            if self.clock is not None:
                self.clock.delivered(self.samples)


@pytest.fixture
def link(board: EmulatedBoard) -> Iterator[Link]:
    opened = Link(board)
    with contextlib.closing(opened.socket):
        yield opened


def chunks_of(data: bytes) -> Iterator[Chunk]:
    for count, begin in enumerate(range(0, len(data), 2000)):
        yield Chunk("tcp:board", NS + count * 20_000_000, data[begin : begin + 2000])


def test_simulated_tires_arrive_to_the_bit_with_their_estimates(board: EmulatedBoard, link: Link) -> None:
    scenario = load_scenario("lab")
    feed = SensorFeed(simulate(scenario, duration_s=3.0))
    board.provision(feed.hub, feed.wheels)
    played: list[Played] = []
    clock = link.clock = DeliveryClock(feed.wheels[0].rate_hz)
    thread = threading.Thread(target=lambda: played.append(play(feed, board, 1.0, clock, threading.Event())))
    thread.start()
    full = round(3.0 * feed.wheels[0].rate_hz) // 36 * 36
    got = link.until(lambda _: link.samples >= full)
    thread.join(TIMEOUT_S)
    assert played[0].samples // 36 * 36 == full
    simulated = b"".join(chunk.data for chunk in simulate(scenario, duration_s=3.0).chunks("x", 0))
    assert got.samples() == delivered(simulated).samples()
    assert len(got.samples()) == full > 28_000
    assert got.counters.lost == got.counters.crc_errors == got.counters.noise_bytes == 0

    def results(data: bytes) -> list:
        core = SessionCore(parse_vehicle(vehicle_toml(scenario), "test"))
        results = [result for chunk in chunks_of(data) for result in core.take(chunk)]
        return [*results, *core.finish()]

    framed, direct = results(link.data), results(simulated)
    assert len(framed) == len(direct) > 20
    for first, other in zip(framed, direct, strict=True):
        assert first.revolution.omega_radps == pytest.approx(other.revolution.omega_radps, rel=1e-6)
        for got_value, expected in zip(first.estimates, other.estimates, strict=True):
            assert (got_value.name, got_value.status) == (expected.name, expected.status)
            assert got_value.value == pytest.approx(expected.value, rel=1e-4, abs=1e-9, nan_ok=True), got_value.name
    names = {estimate.name for estimate in framed[-1].estimates if np.isfinite(estimate.value)}
    assert names >= {"Bs", "Cw", "Rs", "Ts", "speed_mps"}


def test_overrun_shows_as_gaps_in_seq(board: EmulatedBoard, link: Link) -> None:
    board.provision(HUB, [WHEEL])
    board.send(0, blocks(0, 10) + number(Kind.STALL, 500) + blocks(360, 60))
    board.send(0, number(Kind.STALL, UNLIMITED) + blocks(70 * 36, 30) + tick(2) + tick(3))
    last = 99 * 36

    def is_complete(result: Delivery) -> bool:
        return last in result.samples() and any(frame.tick_us == 3_000_000 for frame in result.of(HubStatus))

    got = link.until(is_complete)
    assert got.counters.lost == got.status.frames_dropped > 20
    # On a busy computer the ring of blocks may overflow before the queue of frames does.
    assert 36 * got.counters.lost <= got.status.samples_dropped == 100 * 36 - len(got.samples())
    assert got.samples().items() <= rows_of(0, 3600).items()


def test_power_cuts_and_resets_keep_the_boot_count(board: EmulatedBoard, link: Link) -> None:
    board.provision(HUB, [WHEEL])
    rng = np.random.default_rng(100)
    for step in rng.integers(1, 18, 100):
        board.send(0, number(Kind.CUT, int(step)))
        board.wait_for_starts(1)
    for done, cut in enumerate((1, 7, 100, 241), 1):
        board.send(0, blocks(0, 3))
        link.until(lambda _, done=done: link.samples >= 108 * done)  # type: ignore[misc]
        board.send(0, number(Kind.RESET_AT, cut) + block(108))
        board.wait_for_starts(1)
    board.send(0, blocks(0, 4))
    got = link.until(lambda _: link.samples >= 4 * 108 + 144)
    starts = got.boot_counts
    assert all(later > earlier for earlier, later in zip(starts, starts[1:], strict=False))
    assert starts[-1] >= 105
    assert got.samples() == rows_of(0, 144)


def test_hostile_commands_are_not_carried_out(board: EmulatedBoard, link: Link) -> None:
    board.provision(SIGNING_HUB, [SIGNING_WHEEL])
    rng = np.random.default_rng(9)
    good = [command_bytes(SetTime(k), 100 + k, key=HUB_KEY, boot_count=2) for k in range(10)]
    board.send(0, bench_records.record(Kind.START))
    board.wait_for_starts(1)
    older = [command_bytes(SetStream(False), k, key=HUB_KEY, boot_count=2) for k in range(99)]
    earlier = [command_bytes(SetStream(False), 20_000 + k, key=HUB_KEY, boot_count=1) for k in range(99)]
    hostile: list[bytes] = []
    stop = command_bytes(SetStream(False), 10_000, key=HUB_KEY, boot_count=2)
    for k in range(10_000):
        if k % 1000 == 0:
            hostile.append(good[k // 1000])
        match k % 5:
            case 0:
                tag = rng.bytes(8)
                hostile.append(encode_raw(MessageType.SET_STREAM, b"\0" + tag, 0, HUB_ITSELF, 10_000, 0, flags=1))
            case 1:
                hostile.append(good[int(rng.integers(k // 1000 + 1))])
            case 2:
                hostile.append(older[k % 99])
            case 3:
                hostile.append(earlier[k % 99])
            case _:
                payload = bytearray(stop[16:-4])
                payload[int(rng.integers(len(payload)))] ^= 1 << int(rng.integers(8))
                hostile.append(encode_raw(MessageType.SET_STREAM, bytes(payload), 0, HUB_ITSELF, 10_000, 0, flags=1))
    writer = threading.Thread(target=link.socket.sendall, args=(b"".join(hostile),))
    writer.start()
    last = 100 + len(good) - 1
    link.until(lambda _: link.replied(last))
    writer.join(TIMEOUT_S)
    end = command_bytes(SetTime(77), 500, key=HUB_KEY, boot_count=2)
    link.socket.sendall(end)
    got = link.until(lambda _: link.replied(500))
    assert [seq for seq, outcome in got.results if outcome == Outcome.DONE] == [*range(100, last + 1), 500]
    board.send(0, blocks(0, 5))
    assert link.until(lambda _: link.samples >= 175)


def test_commands_over_tcp_are_signed(board: EmulatedBoard) -> None:
    board.provision(SIGNING_HUB, [SIGNING_WHEEL])
    keys = {hub_identity(HUB.hub_id): Key(HUB_KEY), sensor_identity(WHEEL.sensor_id): Key(SENSOR_KEY)}
    stop = threading.Event()

    def time_passes() -> None:
        now = 0.0
        while not stop.wait(0.01):
            # The collector drops a command whose next byte does not come within 0.1 s of its time.
            now += 0.02
            board.send(0, tick(now))

    thread = threading.Thread(target=time_passes)
    thread.start()
    try:
        for _ in range(2):
            source = open_source(f"tcp://{board.address}", SystemClock())
            assert isinstance(source, TwoWaySource)
            done = execute(source, SetStream(True), SystemClock(), keys=keys, timeout_s=TIMEOUT_S)
            assert done == (0, True, "1.1")
    finally:
        stop.set()
        thread.join(TIMEOUT_S)


def started_program(*arguments: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [*TREADLINK, *arguments], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, cwd=ROOT
    )


def read_until(process: subprocess.Popen[str], pattern: str) -> re.Match[str]:
    """Return the first match in the output of a program; fails when it ends or takes long."""
    assert process.stdout is not None
    printed = ""
    impatience = threading.Timer(PROGRAM_TIMEOUT_S, process.kill)
    impatience.start()
    try:
        for line in process.stdout:
            printed += line
            match = re.search(pattern, printed, re.MULTILINE)
            if match is not None:
                return match
    finally:
        impatience.cancel()
    pytest.fail(f"no {pattern!r} in {printed[-2000:]}")


def test_user_watches_the_emulated_collector(board: EmulatedBoard, tmp_path: Path) -> None:
    vehicle, scenario = tmp_path / "lab.toml", load_scenario("lab")
    vehicle.write_text(vehicle_toml(scenario))
    feed = SensorFeed(simulate(scenario, duration_s=60.0), {})
    board.provision(feed.hub, feed.wheels)
    stop = threading.Event()
    player = threading.Thread(target=play, args=(feed, board, 0.5, SystemClock(), stop))
    uri = f"tcp://{board.address}"
    with contextlib.ExitStack() as stack:
        player.start()
        stack.callback(player.join, TIMEOUT_S)
        stack.callback(stop.set)
        live = stack.enter_context(started_program("live", uri, "--config", str(vehicle), "--plain"))
        stack.callback(live.kill)
        read_until(live, r"^W1 +\d+ +[\d.]+ +6[45]\.")
        live.send_signal(signal.SIGINT)
        read_until(live, r"tcp:\S+: \d+ frames, 0 lost")
        command = stack.enter_context(started_program("command", "time", uri))
        read_until(command, "hub 0 executed the command")
