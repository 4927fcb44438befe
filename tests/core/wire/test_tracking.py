"""Restarts of sources and hubs, as the frames of a link tell them."""

import random

import pytest

from firmware_protocol.block_decoder import BatchDecoder
from firmware_protocol.codec import encode_frame, encode_raw
from firmware_protocol.counters import LinkCounters
from firmware_protocol.decoder import FrameDecoder
from firmware_protocol.messages import Coupling, Frame, Hello, MessageType

HELLO = Hello(1, 0, 1, 2, (1, 0, 0), 1, 9600.0, 7, Coupling.DC, 0.0, (1e3,) * 3, (0.1,) * 3, (0.0,) * 3, 32767)


def hello(boot_count: int, seq: int, wheel: int = 0, hub: int = 0) -> bytes:
    message = HELLO._replace(boot_count=boot_count)
    return encode_frame(Frame(MessageType.HELLO, hub, wheel, seq, 0, message))


def samples(*seqs: int, wheel: int = 0, hub: int = 0) -> bytes:
    return b"".join(
        encode_raw(MessageType.SAMPLES, bytes((0, 0, 0, 0, 4, 1, 0, 0)), hub, wheel, seq, 0) for seq in seqs
    )


def counted(stream: bytes) -> LinkCounters:
    decoder = FrameDecoder()
    decoder.feed(stream)
    return decoder.counters


def test_a_reboot_after_few_frames_loses_no_frame() -> None:
    counters = counted(hello(1, 0) + samples(1, 2, 3) + hello(2, 0) + samples(1, 2, 3))
    assert (counters.frames, counters.duplicates, counters.lost, counters.restarts) == (8, 0, 0, 1)


def test_reboot_restarts_only_its_hubs_sources() -> None:
    counters = counted(
        hello(1, 0)
        + samples(0, 1, wheel=1)
        + samples(0, 1, hub=1)
        + hello(2, 0)
        + samples(0, 1, wheel=1)
        + samples(2, hub=1)
    )
    assert counters.duplicates == 0
    assert {source: of.restarts for source, of in counters.sources.items()} == {(0, 0): 1, (0, 1): 1, (1, 0): 0}


def test_the_first_hello_restarts_nothing() -> None:
    counters = counted(samples(0, 1) + hello(7, 2) + samples(3))
    assert (counters.restarts, counters.lost, counters.frames) == (0, 0, 4)


def test_a_restart_is_counted_once() -> None:
    counters = counted(hello(1, 500) + samples(501) + samples(1, 2) + hello(2, 3) + samples(4, 2))
    assert (counters.restarts, counters.lost, counters.duplicates) == (1, 0, 1)


def test_an_old_restart_does_not_hide_the_next() -> None:
    counters = counted(hello(1, 500) + samples(0, 1) + hello(1, 2) + hello(2, 0) + samples(1, 2))
    assert (counters.restarts, counters.duplicates) == (2, 0)


def test_a_repeated_hello_is_a_duplicate() -> None:
    counters = counted(hello(1, 0) + hello(1, 0))
    assert (counters.frames, counters.duplicates, counters.restarts) == (1, 1, 0)


def sessions(seed: int) -> bytes:
    """Sessions of a hub with two wheels, some without their hello, with gaps, late frames and repetitions."""
    rng = random.Random(seed)
    parts = []
    for boot in range(1, 7):
        first = rng.choice([0, 0, 5, 300])
        seqs = list(range(first, first + rng.randrange(1, 150)))
        for _ in range(rng.choice([0, 0, 4])):
            current = rng.randrange(len(seqs))
            match rng.randrange(3):
                case 0:
                    seqs.insert(current, seqs[rng.randrange(len(seqs))])
                case 1:
                    seqs.insert(current, seqs.pop(max(current - rng.randrange(9), 0)))
                case _:
                    del seqs[current : current + rng.choice([1, 3, 70])]
                    seqs = seqs or [first]
        say = rng.random() < 0.7
        for seq in seqs:
            for wheel in (0, 1):
                if say and seq % 37 == wheel:
                    parts.append(hello(boot, seq, wheel))
                else:
                    parts.append(samples(seq, wheel=wheel))
    return b"".join(parts)


@pytest.mark.parametrize("seed", range(40))
def test_blocks_count_as_single_frames_do(seed: int) -> None:
    stream = sessions(seed)
    rng = random.Random(seed)
    decoder = FrameDecoder()
    expected = [frame[:5] for frame in decoder.feed(stream)]
    for block_bytes in (len(stream), rng.randrange(1000, 4000), rng.randrange(2000, 8000)):
        batch = BatchDecoder()
        results = [
            frame[:5]
            for start in range(0, len(stream), block_bytes)
            for frame in batch.feed(stream[start : start + block_bytes]).frames()
        ]
        assert results == expected
        assert batch.counters == decoder.counters


@pytest.mark.parametrize("seqs", [range(100, 130), [100, *range(102, 130)]], ids=["in order", "gap"])
def test_a_frame_before_the_first_is_not_lost(seqs: list[int]) -> None:
    decoder, batch = FrameDecoder(), BatchDecoder()
    for part in (samples(*seqs), samples(99, 98)):
        decoder.feed(part)
        batch.feed(part)
    assert batch.counters == decoder.counters
    assert (decoder.counters.lost, decoder.counters.reordered) == (30 - len(seqs), 2)
