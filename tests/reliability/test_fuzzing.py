"""Arbitrary input: no crash, bounded memory, clear errors. Coverage-guided: tools/fuzz_atheris.py."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tools.reliability.fuzz_targets import TARGETS, UnclearError

EXAMPLES = {"decoder": 150, "session": 60, "recording": 60, "table": 40, "map": 60, "vehicle": 60, "scenario": 60}
MOST_BYTES = 96 << 20

Edit = tuple[int, int, bytes]
EDITS = st.lists(
    st.tuples(st.integers(0, 1 << 16), st.integers(0, 40), st.one_of(st.binary(max_size=24), st.sampled_from(
        [b"\xff\xff\xff\xff", b"\0" * 8, b"\xff" * 8, b"\x7f\xff", b"nan", b"inf", b"1e999", b"-1", b"\n[[wheel]]\n",
         b'"', b"\x1b[2J", b"\xed\xa0\x80", b"[", b"=", b"0x", b"#"]
    ))),
    max_size=8,
)  # fmt: skip


def edited(seed: bytes, edits: list[Edit]) -> bytes:
    """Return a good input with pieces removed and inserted."""
    data = seed
    for place, cut, piece in edits:
        at = place % (len(data) + 1)
        data = data[:at] + piece + data[at + cut :]
    return data


@pytest.mark.parametrize("name", list(TARGETS))
def test_changed_input(name: str) -> None:
    target = TARGETS[name]
    seeds = target.seeds()

    @settings(max_examples=EXAMPLES[name], deadline=None, suppress_health_check=list(HealthCheck), derandomize=True)
    @given(st.sampled_from(seeds), EDITS)
    def run(seed: bytes, edits: list[Edit]) -> None:
        target.run(edited(seed, edits))

    run()


@pytest.mark.parametrize("name", list(TARGETS))
def test_any_input(name: str) -> None:
    target = TARGETS[name]

    @settings(
        max_examples=EXAMPLES[name] // 2, deadline=None, suppress_health_check=list(HealthCheck), derandomize=True
    )
    @given(st.binary(max_size=2000))
    def run(data: bytes) -> None:
        target.run(data)

    run()


@pytest.mark.parametrize("name", list(TARGETS))
def test_memory_is_bounded(name: str) -> None:
    target = TARGETS[name]
    seed = target.seeds()[0]
    inputs = [
        b"",
        seed,
        seed * 20,
        b"\0" * 100_000,
        b"\xff" * 100_000,
        b"\xa5\x5a" * 15_000,
        b"[" * 20_000,
        b"a=1\n" * 5000,
    ]
    inputs += [seed[:at] + b"\xff" * 8 + seed[at + 8 :] for at in range(0, len(seed), max(1, len(seed) // 20))]
    target.run(seed)
    tracemalloc.start()
    try:
        for data in inputs:
            target.run(data)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < MOST_BYTES


def test_targets_run_on_good_input() -> None:
    for target in TARGETS.values():
        for seed in target.seeds():
            target.run(seed)


def test_error_messages_are_present_and_escaped() -> None:
    from gateway.errors import TreadlinkError
    from tools.reliability import fuzz_targets

    with pytest.raises(UnclearError):
        fuzz_targets._explained(TreadlinkError(""))
    error = TreadlinkError("bad \x1b[2J name\r\0\nsecond line", "x" * 100_000)
    assert str(error) == "bad \\x1b[2J name\\r\\x00\nsecond line"
    assert len(error.remedy) < 2000
    fuzz_targets._explained(error)


def test_sample_numbers_jumping_back_twice() -> None:
    # Found by fuzzing: the restarted sample clock was left without its first stamp.
    from firmware_protocol.codec import encode_frame
    from firmware_protocol.messages import Coupling, Frame, Hello, MessageType, SampleBlock
    from gateway.io.source import Chunk
    from gateway.session.core import SessionCore

    hello = Hello(1, 0, 1, 2, (1, 0, 0), 1, 9600.0, 4, Coupling.DC, 0.0, (0, 0, 4e3), (0, 0, 0.125), (0, 0, 0), 32767)
    core = SessionCore(None)
    core.take(Chunk("x", 1, encode_frame(Frame(MessageType.HELLO, 0, 0, 0, 0, hello))))
    counts = np.zeros((36, 1), "<i2")
    for seq, first in enumerate((0, 36, 33_554_504, 2_097_260, 144, 180, 0), 1):
        frame = Frame(MessageType.SAMPLES, 0, 0, seq, 3750 * seq, SampleBlock(first, 4, counts))
        core.take(Chunk("x", seq, encode_frame(frame)))
    assert core.snapshot(0.0).wheels[0].counters.samples == 7 * 36
