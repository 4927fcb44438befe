"""The reference collector: commands, signed, damaged, forged or replayed; starts after resets or a failing flash."""

import ctypes
import itertools
import json
import subprocess
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

import firmware_protocol
from firmware_protocol.codec import encode_payload
from firmware_protocol.decoder import FrameDecoder
from firmware_protocol.messages import (
    ChallengeAnswer,
    CommandResult,
    Hello,
    MessageType,
    Outcome,
    SampleBlock,
    SetRate,
    SetStream,
    SetTime,
    TimeSync,
)
from gateway.core.errors import SourceError
from gateway.core.links.source import Chunk, LinkEvent, LinkEventKind, LinkItem
from gateway.security.cmac import Key
from gateway.security.freshness import Ledger
from gateway.security.guard import ConfiguredWheel, Guard
from gateway.security.hub_commands import Executed, execute
from gateway.security.key_file import hub_identity, sensor_identity
from tests.makers.firmware.conftest import require
from tests.testkit.collector_bench import (
    BLOCK,
    HUB,
    HUB_KEY,
    SENSOR_KEY,
    SIGNING_HUB,
    SIGNING_WHEEL,
    WHEEL,
    Counters,
    Flash,
    arriving,
    block,
    blocks,
    command_bytes,
    counters,
    delivered,
    from_gateway,
    number,
    rows_of,
    seconds,
    started,
    tick,
)
from tests.testkit.emulated_firmware.bench_records import Kind, record
from tests.testkit.emulated_firmware.firmware_build import COLLECTOR, build_host, include_flags, write_protocol
from tests.testkit.waiting import TIMEOUT_S, HeldClock

Run = Callable[..., bytes]
VECTORS = Path(firmware_protocol.__file__).parent / "vectors"


def test_collector_passes_the_command_vectors(run: Run) -> None:
    vectors = json.loads((VECTORS / "signed.json").read_text("utf-8"))["commands"]
    wheel = SIGNING_WHEEL._replace(wheel=1)
    starts = record(Kind.START) * 40
    records = [started(SIGNING_HUB, [wheel]), starts]
    for second, vector in enumerate(vectors, 1):
        records += [tick(second), *arriving([bytes.fromhex(vector["hex"])]), tick(second)]
    got = delivered(run(*records))
    assert got.boot_counts[-1] == 41
    replies = [f for f in got.frames if isinstance(f.message, CommandResult | ChallengeAnswer)]
    assert [(f.type, encode_payload(f.message).hex()) for f in replies] == [
        (vector["reply_type"], vector["reply_payload"]) for vector in vectors
    ]


def test_signed_frames_pass_the_guard(run: Run) -> None:
    wheels = [SIGNING_WHEEL, SIGNING_WHEEL._replace(wheel=1, sensor_id=0xA002, key=bytes(16))]
    data = run(started(SIGNING_HUB, wheels), blocks(0, 50), blocks(0, 50, place=1), seconds(1, 4))
    keys = {
        hub_identity(HUB.hub_id): Key(HUB_KEY),
        sensor_identity(0xA001): Key(SENSOR_KEY),
        sensor_identity(0xA002): Key(bytes(16)),
    }
    places = {
        (0, 0): ConfiguredWheel("FL", sensor_identity(0xA001)),
        (0, 1): ConfiguredWheel("FR", sensor_identity(0xA002)),
    }
    guard = Guard(places, keys, Ledger(), requires=True)
    decoder = FrameDecoder(guard.gate("link"))
    frames = decoder.feed(data)
    assert len(frames) > 100
    assert decoder.counters.refused == 0
    assert guard.gate("link").counts == {"verified": len(frames)}


def test_signing_goes_off_and_on_with_the_keys(run: Run) -> None:
    data = run(
        started(SIGNING_HUB, [SIGNING_WHEEL]),
        blocks(0, 3),
        started(),
        blocks(0, 3),
        *arriving([command_bytes(SetTime(1), 0)]),
        started(SIGNING_HUB, [SIGNING_WHEEL]),
        *arriving([command_bytes(SetTime(2), 1)]),
        seconds(1, 3),
    )
    flags: list[int] = []
    FrameDecoder(lambda frame: flags.append(frame[7]) or True).feed(data)
    changes = [flag for k, flag in enumerate(flags) if k == 0 or flag != flags[k - 1]]
    assert changes == [1, 0, 1]
    got = delivered(data)
    assert got.results == [(0, Outcome.DONE), (1, Outcome.NOT_VERIFIED)]
    assert got.messages(TimeSync)[-1].host_ns == 0


def test_damaged_commands_are_dropped_and_intact_ones_executed(run: Run) -> None:
    """Every bit flipped, every length cut off, noise before and after; between them good commands."""
    good = command_bytes(SetTime(1), 7)
    damaged = [
        good[: bit // 8] + bytes((good[bit // 8] ^ 1 << bit % 8,)) + good[bit // 8 + 1 :]
        for bit in range(8 * len(good))
    ]
    damaged += [good[:cut] for cut in range(1, len(good))]
    damaged += [b"\xa5" * 7, b"\xa5\x5a\x10\x20\xff", bytes(300)]
    records, expected, time_s = [started()], [], 1.0
    for seq, frame in enumerate(damaged):
        records += [*arriving([frame]), tick(time_s)]
        # What a damaged header claims is given up after a while.
        time_s += 0.3
        records += [tick(time_s), tick(time_s + 0.01), tick(time_s + 0.2), tick(time_s + 0.4), tick(time_s + 0.6)]
        time_s += 0.7
        records += [*arriving([command_bytes(SetStream(True), seq)]), tick(time_s)]
        expected.append((seq, Outcome.DONE))
    got = delivered(run(*records))
    assert got.results == expected
    assert got.messages(TimeSync)[-1].host_ns == 0


def test_command_in_pieces_is_executed(run: Run) -> None:
    frame = command_bytes(SetTime(6), 2)
    pieces = b"".join(from_gateway(bytes((byte,))) for byte in frame)
    assert delivered(run(started(), pieces, seconds(1, 3))).results == [(2, Outcome.DONE)]


def test_values_out_of_range_and_other_addressees(run: Run) -> None:
    low = bytearray(command_bytes(SetRate(2000.0), 4))
    other_hub = command_bytes(SetTime(1), 5, hub=9)
    absent_wheel = command_bytes(SetStream(False), 6, wheel=8)
    every_hub = command_bytes(SetTime(1), 7, hub=255)
    no_rate = command_bytes(SetRate(5000.0), 8)
    wheels = [WHEEL._replace(rates_hz=())]
    data = run(started(HUB, wheels), *arriving([bytes(low), other_hub, absent_wheel, every_hub, no_rate]), tick(0.1))
    got = delivered(data)
    assert got.results == [(4, Outcome.FAILED), (6, Outcome.FAILED), (7, Outcome.DONE), (8, Outcome.FAILED)]
    assert {hello.rate_hz for hello in got.messages(Hello)} == {9600.0}


def test_refused_commands_are_reported_and_answers_limited(run: Run) -> None:
    burst = [command_bytes(SetStream(False), seq) for seq in range(50)]
    data = run(
        started(SIGNING_HUB, [SIGNING_WHEEL]),
        tick(1),
        *(r for f in burst for r in (*arriving([f]), tick(1))),
        seconds(2, 14),
    )
    got = delivered(data)
    assert len(got.results) == 10
    assert {outcome for _, outcome in got.results} == {Outcome.NOT_VERIFIED}
    assert [line for line in got.log if line.endswith(" 50")]


@pytest.mark.parametrize("attacks", [1_000_000])
def test_no_hostile_command_is_carried_out(host_folder: Path, attacks: int) -> None:
    program = build_host(host_folder / "attack", ("-O2",), main="attack.c")
    done = subprocess.run([program, str(attacks)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
    assert f"all of these {attacks:24d} sent    0 carried out" in done.stdout
    assert np.all([line.split()[-4] != "0" for line in done.stdout.splitlines()])


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
            self._records.append(from_gateway(data))
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
    return execute(link, SetStream(running), HeldClock(0), keys=KEYS, timeout_s=60.0)


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


class LossyLink(CollectorLink):
    """A link on which the first frame of a type to the collector, or the first from it, is lost.

    When nothing more comes, a second passes.
    """

    def __init__(self, run: Run, clock: HeldClock, *, signs: bool, to_hub: int = 0, from_hub: int = 0) -> None:
        super().__init__(run)
        hub, wheel = (SIGNING_HUB, SIGNING_WHEEL) if signs else (HUB, WHEEL)
        self._records[0] = started(hub, [wheel._replace(rates_hz=(9600.0, 4800.0))])
        self._clock = clock
        self._to_hub, self._from_hub = to_hub, from_hub
        self._changed = threading.Condition()

    def items(self, stop: threading.Event) -> Iterator[LinkItem]:
        yield LinkEvent(self.link, 0, LinkEventKind.CONNECTED)
        while not stop.is_set():
            data = self._run(*self._records)[self._delivered :]
            self._delivered += len(data)
            if not data:
                with self._changed:
                    self._clock.advance_ns(10**9)
                    assert self._changed.wait(TIMEOUT_S), "nothing is sent again"
            elif self._from_hub in [frame.type for frame in delivered(data).frames]:
                self._from_hub = 0
            else:
                yield Chunk(self.link, 0, data)

    def send(self, data: bytes) -> None:
        with self._changed:
            if data[3] == self._to_hub:
                self._to_hub = 0
            else:
                super().send(data)
            self._changed.notify()


LOSSES = {
    "command": {"to_hub": MessageType.SET_RATE},
    "reply": {"from_hub": MessageType.COMMAND_RESULT},
    "challenge": {"to_hub": MessageType.CHALLENGE},
    "answer": {"from_hub": MessageType.CHALLENGE_ANSWER},
}


@pytest.mark.parametrize(
    ("signs", "lost", "carried_out"),
    [
        (True, "command", [3]),
        (True, "reply", [2, 3]),
        (True, "challenge", [2]),
        (True, "answer", [3]),
        (False, "command", [1]),
        (False, "reply", [0, 1]),
    ],
)
def test_command_or_answer_that_is_lost_is_repeated(run: Run, signs: bool, lost: str, carried_out: list[int]) -> None:
    """The collector carries it out under these counters; twice changes nothing more than once."""
    clock = HeldClock()
    link = LossyLink(run, clock, signs=signs, **LOSSES[lost])
    done = execute(link, SetRate(4800.0), clock, keys=KEYS if signs else {}, timeout_s=60.0)
    assert done.signed == signs
    link.later(0.1)
    got = delivered(run(*link._records))
    assert got.results == [(seq, Outcome.DONE) for seq in carried_out]
    rates = [hello.rate_hz for hello in got.messages(Hello)]
    assert sum(before != after for before, after in itertools.pairwise(rates)) == 1


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


FLASH = """
#include "tl_boot_count.h"
#include "tl_port.h"
#include <string.h>
uint8_t flash[2 * TL_BOOT_PAGE_BYTES];
static uint8_t *page_at(unsigned page) { return flash + page * TL_BOOT_PAGE_BYTES; }
void tl_port_flash_read(unsigned page, size_t at, uint8_t *data, size_t size) {
    memcpy(data, page_at(page) + at, size);
}
bool tl_port_flash_write(unsigned page, size_t at, const uint8_t *data, size_t size) {
    memcpy(page_at(page) + at, data, size);
    return true;
}
bool tl_port_flash_erase(unsigned page) { return memset(page_at(page), 0xFF, TL_BOOT_PAGE_BYTES) != NULL; }
"""


def test_boot_count_survives_damage_to_its_latest_records(tmp_path: Path) -> None:
    """After each number of starts, which fill both pages and begin again: damage to up to a page of records."""
    require("gcc", "gcc")
    (tmp_path / "flash.c").write_text(FLASH, "utf-8")
    write_protocol(tmp_path)
    sources = [COLLECTOR / "tl_boot_count.c", tmp_path / "flash.c"]
    options = ["-DTL_BOOT_PAGE_BYTES=64", *include_flags(tmp_path), "-shared", "-fPIC"]
    subprocess.run(["gcc", *options, *sources, "-o", tmp_path / "counter.so"], check=True)
    counter = ctypes.CDLL(str(tmp_path / "counter.so"))
    flash = (ctypes.c_uint8 * 128).in_dll(counter, "flash")
    count = ctypes.c_uint32()
    for starts, damaged in itertools.product(range(1, 17), range(5)):
        ctypes.memset(flash, 0xFF, 128)
        for _ in range(starts):
            assert counter.tl_boot_count_next(ctypes.byref(count))
        assert count.value == starts
        for latest in range(max(starts - damaged, 0), starts):
            flash[16 * (latest % 8)] ^= 4
        for _ in range(10):
            before = count.value
            assert counter.tl_boot_count_next(ctypes.byref(count))
            assert count.value > before, (starts, damaged)


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
