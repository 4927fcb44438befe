"""Link faults: each kind alone, all together, and against the decoder's counters."""

from collections.abc import Iterable
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_protocol.codec import encode_frame
from firmware_protocol.decoder import FrameDecoder
from firmware_protocol.messages import Coupling, Frame, Hello, MessageType, SampleBlock, TimeSync
from gateway.core.errors import SourceError
from gateway.core.links.source import Chunk
from gateway.simulator.link_faults import FAULTS, Fault, apply_faults, cut, frame_pieces, parse_fault, parse_faults

LINK = "sim:test"
START_NS = 1_700_000_000_000_000_000
# Faults that act at a time instead of at random.
TIMED = {"reboot": "reboot:at=0.1,gap=0.05", "silence": "silence:at=0.1,for=0.2"}
COUNTS = np.arange(36 * 3, dtype=np.int16).reshape(36, 3)
HELLO = Hello(1, 0, 7, 0xA001, (1, 0, 0), 3, 9600.0, 7, Coupling.DC, 0.0, (1e3,) * 3, (0.1,) * 3, (0.0,) * 3, 32767)


def stream(frames: int = 300, per_chunk: int = 7, wheels: int = 2) -> list[Chunk]:
    """Chunks of whole frames: a hello for each wheel, then sample blocks of the wheels in turn, 3.75 ms apart."""
    encoded = [encode_frame(Frame(MessageType.HELLO, 0, wheel, 0, 0, HELLO)) for wheel in range(wheels)]
    for number in range(frames):
        wheel, index = number % wheels, number // wheels
        block = SampleBlock(36 * index, 7, COUNTS)
        encoded.append(encode_frame(Frame(MessageType.SAMPLES, 0, wheel, index + 1, 3750 * index, block)))
    groups = [encoded[index : index + per_chunk] for index in range(0, len(encoded), per_chunk)]
    return [Chunk(LINK, START_NS + 10_000_000 * n, b"".join(group)) for n, group in enumerate(groups)]


def data_of(chunks: Iterable[Chunk]) -> bytes:
    return b"".join(chunk.data for chunk in chunks)


def decode(chunks: Iterable[Chunk]) -> tuple[list[Frame], FrameDecoder]:
    decoder = FrameDecoder()
    frames = [frame for chunk in chunks for frame in decoder.feed(chunk.data)]
    return frames + decoder.finish(), decoder


def keys(frames: Iterable[Frame]) -> list[tuple[int, int]]:
    return [(frame.wheel, frame.seq) for frame in frames]


def recut(chunks: list[Chunk], rng: np.random.Generator) -> list[Chunk]:
    """The same bytes at the same times, cut anywhere."""
    pieces = []
    for chunk in chunks:
        places = sorted({0, len(chunk.data), *rng.integers(0, len(chunk.data), 5).tolist()})
        pieces += [Chunk(LINK, chunk.host_ns, chunk.data[a:b]) for a, b in pairwise(places)]
    return pieces


@pytest.mark.parametrize("kind", FAULTS)
def test_every_kind_runs_counts_and_repeats(kind: str) -> None:
    text = TIMED.get(kind, f"{kind}:rate=0.2")
    first, second = parse_fault(text, 5), parse_fault(text, 5)
    result = list(first(stream()))
    assert result == list(second(stream()))
    assert first.counts == second.counts
    assert any(first.counts.as_dict().values())
    assert result != stream()
    assert all(a.host_ns <= b.host_ns for a, b in pairwise(result))
    other = list(parse_fault(text, 6)(stream()))
    assert (other == result) == (kind in TIMED)
    decode(result)


@pytest.mark.parametrize("kind", [kind for kind in FAULTS if "rate" in FAULTS[kind].options])
def test_zero_rate_changes_no_byte(kind: str) -> None:
    fault = parse_fault(f"{kind}:rate=0")
    assert data_of(fault(stream())) == data_of(stream())
    assert fault.counts.frames_hit == fault.counts.chunks_hit == 0


@pytest.mark.parametrize("kind", ["flip", "drop", "duplicate", "truncate", "insert", "reorder"])
def test_frame_faults_do_not_depend_on_the_chunks(kind: str) -> None:
    whole, cut_up = parse_fault(f"{kind}:rate=0.3", 2), parse_fault(f"{kind}:rate=0.3", 2)
    assert data_of(whole(stream())) == data_of(cut_up(recut(stream(), np.random.default_rng(3))))
    assert whole.counts == cut_up.counts


def test_decoder_counts_all_flips_and_drops() -> None:
    faults = parse_faults(["flip:rate=0.05", "drop:rate=0.05"], seed=4)
    sent, _ = decode(stream(frames=2000))
    received, decoder = decode(apply_faults(faults, stream(frames=2000)))
    flip, drop = faults
    assert flip.counts.frames_hit > 50
    assert drop.counts.frames_hit > 50
    # Every intact frame arrives, in order, and every other one is missing by its counter.
    assert set(keys(received)) < set(keys(sent))
    assert keys(received) == [key for key in keys(sent) if key in set(keys(received))]
    missing = set(keys(sent)) - set(keys(received))
    assert len(missing) == flip.counts.frames_hit + drop.counts.frames_hit
    newest = {wheel: max(seq for w, seq in keys(received) if w == wheel) for wheel in (0, 1)}
    oldest = {wheel: min(seq for w, seq in keys(received) if w == wheel) for wheel in (0, 1)}
    between = [key for key in missing if oldest[key[0]] < key[1] < newest[key[0]]]
    assert decoder.counters.lost == len(between)
    assert decoder.counters.crc_errors >= 1


def test_duplicates_and_late_frames_are_counted_without_loss() -> None:
    faults = parse_faults(["duplicate:rate=0.1", "reorder:rate=0.1,depth=5"], seed=1)
    sent, _ = decode(stream())
    received, decoder = decode(apply_faults(faults, stream()))
    assert sorted(keys(received)) == sorted(keys(sent))
    assert decoder.counters.duplicates == faults[0].counts.frames_hit > 10
    assert 0 < decoder.counters.reordered <= faults[1].counts.frames_hit
    assert decoder.counters.lost == 0


def test_drop_removes_stated_number_of_bytes() -> None:
    fault = parse_fault("drop:rate=0.1,bytes=3", 1)
    remaining = data_of(fault(stream()))
    assert fault.counts.bytes_dropped == 3 * fault.counts.frames_hit > 0
    assert len(remaining) == len(data_of(stream())) - fault.counts.bytes_dropped


def test_flip_changes_stated_number_of_bits() -> None:
    fault = parse_fault("flip:rate=1,bits=5", 1)
    before, after = data_of(stream()), data_of(fault(stream()))
    differing = int.from_bytes(before, "big") ^ int.from_bytes(after, "big")
    assert differing.bit_count() == 5 * fault.counts.frames_hit == 5 * fault.counts.frames_seen


def test_split_keeps_bytes_and_limits_sizes() -> None:
    pieces = list(parse_fault("split:size=10")(stream()))
    assert data_of(pieces) == data_of(stream())
    assert max(len(piece.data) for piece in pieces) == 10
    halves = list(parse_fault("split")(stream()))
    assert data_of(halves) == data_of(stream())
    assert len(halves) == 2 * len(stream())


def test_delay_keeps_order_and_bytes() -> None:
    fault = parse_fault("delay:rate=0.5,ms=100", 1)
    late = list(fault(stream()))
    assert [chunk.data for chunk in late] == [chunk.data for chunk in stream()]
    assert all(a.host_ns <= b.host_ns for a, b in pairwise(late))
    waits = [b.host_ns - a.host_ns for a, b in zip(stream(), late, strict=True)]
    assert min(waits) >= 0
    assert 10_000_000 < max(waits) <= 100_000_000
    assert fault.counts.chunks_hit > 0


def test_reboot_restarts_everything_once() -> None:
    fault = parse_fault("reboot:at=0.2,gap=0.1")
    received, decoder = decode(fault(stream(frames=600)))
    assert fault.counts.reboots == 1
    assert fault.counts.bytes_dropped > 0
    assert decoder.counters.noise_bytes == decoder.counters.lost == 0
    assert [counters.restarts for counters in decoder.counters.sources.values()] == [1, 1]
    hellos = [frame for frame in received if isinstance(frame.message, Hello)]
    assert [hello.message.boot_count for hello in hellos] == [3, 3, 4, 4]
    again = received[received.index(hellos[2]) :]
    for wheel in (0, 1):
        blocks = [frame for frame in again if frame.wheel == wheel and isinstance(frame.message, SampleBlock)]
        assert [frame.seq for frame in blocks] == list(range(1, len(blocks) + 1))
        assert [frame.message.first_sample for frame in blocks] == [36 * n for n in range(len(blocks))]
        assert np.diff([frame.tick_us for frame in blocks]) == pytest.approx(3750)
        assert blocks[0].tick_us < 200_000


def test_repeated_reboots_restart_the_hub_clock() -> None:
    stamps = [TimeSync(10**6 * n, 0) for n in range(60)]
    frames = [encode_frame(Frame(MessageType.TIME_SYNC, 2, 255, n, s.hub_us, s)) for n, s in enumerate(stamps)]
    frames[0] += encode_frame(Frame(MessageType.HELLO, 2, 0, 0, 0, HELLO))
    chunks = [Chunk(LINK, START_NS + 10**9 * n, frame) for n, frame in enumerate(frames)]
    fault = parse_fault("reboot:at=10,every=20,gap=2")
    received, _ = decode(fault(chunks))
    assert fault.counts.reboots == 3
    hub = [frame for frame in received if frame.wheel == 255]
    assert [frame.seq for frame in hub].count(0) == 4
    assert all(frame.message.hub_us == frame.tick_us for frame in hub)


def test_foreign_bytes_pass_a_reboot_unchanged() -> None:
    junk = [Chunk(LINK, START_NS + 10**8 * n, b"\xa5\x5a\xff junk %d " % n) for n in range(20)]
    assert data_of(parse_fault("reboot:at=0.5,gap=0")(junk)) == data_of(junk)


@pytest.mark.parametrize(("part", "left"), [(0, set()), (1, set()), (2, {MessageType.HELLO}), (3, set(MessageType))])
def test_silence_leaves_no_gap_in_the_counters(part: int, left: set[MessageType]) -> None:
    end = Chunk(LINK, START_NS + 10**9, encode_frame(Frame(MessageType.HELLO, 0, 0, 151, 0, HELLO)))  # after it
    fault = parse_fault(f"silence:part={part},wheel=0,at=0.2,for=0.5")
    received, decoder = decode(fault([*stream(), end]))
    silent = [frame for frame in received[141:-1] if frame.wheel == 0]
    assert {frame.type for frame in silent} <= left
    assert decoder.counters.lost == 0, "the sender has made fewer frames, none is lost"
    assert any(frame.wheel == 1 for frame in received[141:]) == (part != 0)


@settings(max_examples=40)
@given(
    st.lists(st.sampled_from(sorted(FAULTS)), max_size=5),
    st.integers(0, 2**32),
    st.floats(0.0, 1.0),
    st.binary(max_size=60),
)
def test_mixed_faults_keep_time_order(kinds: list[str], seed: int, rate: float, junk: bytes) -> None:
    texts = [kind + ("" if kind in TIMED else f":rate={rate}") for kind in kinds]
    chunks = [*stream(40), *([Chunk(LINK, START_NS + 10**9, junk)] if junk else [])]
    result = list(apply_faults(parse_faults(texts, seed), chunks))
    assert all(chunk.data and chunk.link == LINK for chunk in result)
    assert all(a.host_ns <= b.host_ns for a, b in pairwise(result))
    decode(result)


@settings(max_examples=60)
@given(st.lists(st.binary(min_size=1, max_size=40), max_size=12), st.randoms(use_true_random=False))
def test_cutting_at_frame_borders_keeps_every_byte(parts: list[bytes], random: object) -> None:
    frames = [data_of(stream(3, 1))[:262], b"\xa5", b"\xa5\x5a", b"\xa5\x5a\x10\x02\xe0"]
    data = [item for part in parts for item in (part, random.choice(frames))]  # type: ignore[attr-defined]
    chunks = [Chunk(LINK, START_NS + n, item) for n, item in enumerate(data)]
    pieces = [piece for _, _, result in frame_pieces(chunks) for piece in result]
    assert b"".join(piece.data for piece in pieces) == b"".join(data)
    whole, tail = cut(b"".join(data))
    # However cut into chunks, the same frames are whole, save those that only the end of the stream decides.
    results = [piece.data for piece in pieces if piece.whole]
    assert results == [piece.data for piece in whole if piece.whole]
    assert len(tail) <= 244


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("nonsense", "one of flip, drop"),
        ("flip:rat=1", "flip has the options rate, bits, not 'rat'"),
        ("flip:rate=2", "rate = 0 to 1"),
        ("flip:rate=", "not ''"),
        ("delay:ms=nan", "ms = 0 to 60000"),
        ("", "one of flip"),
    ],
)
def test_invalid_faults_name_the_allowed_values(text: str, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        parse_fault(text)
    with pytest.raises(SourceError, match="is invalid") as caught:
        parse_faults([text])
    assert "flip:rate=0.01" in caught.value.remedy


def test_fault_text_round_trips() -> None:
    fault = parse_fault(" drop:rate=0.5, bytes=2 ")
    assert isinstance(fault, Fault)
    assert parse_fault(str(fault)).options == fault.options == {"rate": 0.5, "bytes": 2}
