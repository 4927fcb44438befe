"""Commands to the reference collector: signed, damaged, forged."""

import json
import subprocess
from collections.abc import Callable
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
    Outcome,
    SetRate,
    SetStream,
    SetTime,
    TimeSync,
)
from gateway.security.cmac import Key
from gateway.security.freshness import Ledger
from gateway.security.guard import ConfiguredWheel, Guard
from gateway.security.key_file import hub_identity, sensor_identity
from gateway.simulator.firmware import bench_records
from gateway.simulator.firmware.bench_records import Kind, record
from gateway.simulator.firmware.firmware_build import build_host
from tests.testkit.collector_bench import (
    HUB,
    HUB_KEY,
    SENSOR_KEY,
    SIGNING_HUB,
    SIGNING_WHEEL,
    WHEEL,
    arriving,
    blocks,
    command_bytes,
    delivered,
    seconds,
    started,
    tick,
)

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
    for number, frame in enumerate(damaged):
        records += [*arriving([frame]), tick(time_s)]
        # What a damaged header claims is given up after a while.
        time_s += 0.3
        records += [tick(time_s), tick(time_s + 0.01), tick(time_s + 0.2), tick(time_s + 0.4), tick(time_s + 0.6)]
        time_s += 0.7
        records += [*arriving([command_bytes(SetStream(True), number)]), tick(time_s)]
        expected.append((number, Outcome.DONE))
    got = delivered(run(*records))
    assert got.results == expected
    assert got.messages(TimeSync)[-1].host_ns == 0


def test_command_in_pieces_is_executed(run: Run) -> None:
    frame = command_bytes(SetTime(6), 2)
    pieces = b"".join(bench_records.from_gateway(bytes((byte,))) for byte in frame)
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
