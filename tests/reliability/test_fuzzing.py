"""Changed and arbitrary input: no crash, bounded memory, clear errors. More cases: tools/fuzz_files.py."""

import tracemalloc

import numpy as np
import pytest

from tools import fuzz_files
from tools.reliability.fuzz_targets import TARGETS, UnclearError
from tools.reliability.mutations import mdf_content

# A process of their own reads these.
CASES = {"mat": 20, "parquet": 20, "hdf5": 20, "mf4": 20}
MOST_BYTES = 96 << 20


@pytest.mark.parametrize("name", list(TARGETS))
def test_changed_input_is_read_or_rejected(name: str) -> None:
    outcome = fuzz_files.run_cases(name, 1, 0, CASES.get(name, 60))
    assert outcome.failures == []
    assert outcome.cases == CASES.get(name, 60)


@pytest.mark.parametrize("name", list(TARGETS))
def test_any_input_is_read_or_rejected(name: str) -> None:
    rng = np.random.default_rng(1)
    for _ in range(CASES.get(name, 20) // 4):
        TARGETS[name].run(rng.bytes(int(rng.integers(0, 2000))))


def test_failures_of_a_case_are_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(data: bytes) -> bool:
        raise ZeroDivisionError(len(data))

    target = TARGETS["keys"]
    monkeypatch.setitem(TARGETS, "keys", type(target)(target.text, broken, target.seeds))
    outcome = fuzz_files.run_cases("keys", 1, 0, 3)
    assert [number for number, _ in outcome.failures] == [0, 1, 2]
    assert "ZeroDivisionError" in outcome.failures[0][1]


def test_cases_depend_on_kind_seed_and_number_only() -> None:
    assert fuzz_files.case("keys", 1, 5) == fuzz_files.case("keys", 1, 5)
    assert len({fuzz_files.case("keys", seed, number) for seed in (1, 2) for number in range(10)}) == 20


def test_empty_compressed_block_is_changed_elsewhere() -> None:
    block = b"##DZ" + bytes(4) + (48).to_bytes(8, "little") + bytes(48)
    assert mdf_content(np.random.default_rng(1), block) != block


# Another process reads the others, with a memory limit of its own.
@pytest.mark.parametrize("name", [name for name in TARGETS if name not in CASES])
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
    inputs += [seed[:index] + b"\xff" * 8 + seed[index + 8 :] for index in range(0, len(seed), max(1, len(seed) // 20))]
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
    for name, target in TARGETS.items():
        worked = [target.run(seed) for seed in target.seeds()]
        assert any(worked), name


def test_error_messages_are_present_and_escaped() -> None:
    from gateway.core.errors import TreadlinkError
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
    from gateway.core.links.source import Chunk
    from gateway.core.session.core import SessionCore

    hello = Hello(1, 0, 1, 2, (1, 0, 0), 1, 9600.0, 4, Coupling.DC, 0.0, (0, 0, 4e3), (0, 0, 0.125), (0, 0, 0), 32767)
    core = SessionCore(None)
    core.take(Chunk("x", 1, encode_frame(Frame(MessageType.HELLO, 0, 0, 0, 0, hello))))
    counts = np.zeros((36, 1), "<i2")
    for seq, first in enumerate((0, 36, 33_554_504, 2_097_260, 144, 180, 0), 1):
        frame = Frame(MessageType.SAMPLES, 0, 0, seq, 3750 * seq, SampleBlock(first, 4, counts))
        core.take(Chunk("x", seq, encode_frame(frame)))
    core.finish()
    assert core.snapshot(0.0).wheels[0].counters.samples == 7 * 36
