"""Link noise: which frames of a disturbed stream are intact is known byte by byte, and held against both decoders."""

from collections.abc import Iterator
from dataclasses import dataclass
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from firmware_protocol.block_decoder import BatchDecoder
from firmware_protocol.codec import encode_frame
from firmware_protocol.decoder import FrameDecoder
from firmware_protocol.messages import Frame, MessageType, SampleBlock

SAMPLES = 36
FRAME_BYTES = 242
FRAMES_AT_ONCE = 20_000
_PATTERNS = 4096
_SEQ = slice(8, 12)
_COUNTS = slice(22, 238)
_CRC = slice(238, 242)

Bytes = NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class Noise:
    """Disturbance of a link.

    Attributes:
        name: for the table.
        bit_errors: probability that a bit is flipped.
        byte_loss: probability that a byte is lost.
        duplicated: probability that a chunk arrives twice.
        reordered: probability that a chunk changes places with the next.
    """

    name: str
    bit_errors: float = 0.0
    byte_loss: float = 0.0
    duplicated: float = 0.0
    reordered: float = 0.0


NOISES = (
    Noise("bit errors 1e-6", bit_errors=1e-6),
    Noise("bit errors 1e-5", bit_errors=1e-5),
    Noise("bit errors 1e-4", bit_errors=1e-4),
    Noise("bit errors 1e-3", bit_errors=1e-3),
    Noise("bit errors 1e-2", bit_errors=1e-2),
    Noise("bytes lost 1e-5", byte_loss=1e-5),
    Noise("bytes lost 1e-3", byte_loss=1e-3),
    Noise("chunks duplicated 2 %", duplicated=0.02),
    Noise("chunks reordered 2 %", reordered=0.02),
    Noise("all of it", bit_errors=1e-4, byte_loss=1e-4, duplicated=0.02, reordered=0.02),
)


@dataclass(slots=True)
class Outcome:
    """Result of decoding a disturbed stream.

    Attributes:
        sent: frames sent.
        intact: frames that arrived with every byte in place, those that arrived twice counted twice.
        delivered: frames that the decoder delivered.
        duplicates: intact frames that it recognised as repeated.
        corrupt_accepted: delivered frames that are no intact frame, or whose content is not what was sent.
        intact_lost: intact frames neither delivered nor recognised as repeated.
        worst_delay_bytes: most bytes that had to follow an intact frame until it was delivered.
    """

    sent: int = 0
    intact: int = 0
    delivered: int = 0
    duplicates: int = 0
    corrupt_accepted: int = 0
    intact_lost: int = 0
    worst_delay_bytes: int = 0


class Sender:
    """Numbers frames through; what a frame holds follows from its number."""

    def __init__(self, seed: int) -> None:
        rng = np.random.default_rng([seed, 1])
        self.patterns = rng.integers(-32768, 32768, (_PATTERNS, SAMPLES, 3)).astype("<i2")
        block = SampleBlock(0, 7, self.patterns[0])
        self._template = np.frombuffer(encode_frame(Frame(MessageType.SAMPLES, 0, 1, 0, 0, block)), np.uint8)
        assert len(self._template) == FRAME_BYTES

    def frames(self, first: int, count: int) -> Bytes:
        """Return (count, FRAME_BYTES) frames numbered from `first`."""
        out = np.tile(self._template, (count, 1))
        numbers = np.arange(first, first + count)
        out[:, _SEQ] = numbers.astype("<u4").view(np.uint8).reshape(-1, 4)
        out[:, _COUNTS] = self.patterns[numbers % _PATTERNS].reshape(count, -1).view(np.uint8)
        raw = out.tobytes()
        view = memoryview(raw)
        end = _CRC.start
        crcs = [crc32(view[offset : offset + end]) for offset in range(0, len(raw), FRAME_BYTES)]
        out[:, _CRC] = np.array(crcs, "<u4").view(np.uint8).reshape(-1, 4)
        return out


def disturb(frames: Bytes, noise: Noise, rng: np.random.Generator) -> tuple[bytes, NDArray[np.int64]]:
    """Return the bytes that arrive, and for each the place it was sent at, -1 where it was changed."""
    data = frames.reshape(-1).copy()
    source = np.arange(len(data))
    if noise.bit_errors:
        bits = np.unique(rng.integers(0, 8 * len(data), rng.binomial(8 * len(data), noise.bit_errors)))
        np.bitwise_xor.at(data, bits >> 3, np.left_shift(1, bits & 7).astype(np.uint8))
        source[bits >> 3] = -1
    if noise.byte_loss:
        keep = rng.random(len(data)) >= noise.byte_loss
        data, source = data[keep], source[keep]
    if noise.duplicated or noise.reordered:
        cuts = np.concatenate(([0], np.cumsum(rng.integers(20, 2000, len(data) // 1000 + 1))))
        cuts = np.append(cuts[cuts < len(data)], len(data))
        order: list[int] = []
        for chunk in range(len(cuts) - 1):
            order += [chunk] * (1 + (rng.random() < noise.duplicated))
            if len(order) > 1 and rng.random() < noise.reordered:
                order[-1], order[-2] = order[-2], order[-1]
        pieces = [slice(cuts[chunk], cuts[chunk + 1]) for chunk in order]
        data = np.concatenate([data[piece] for piece in pieces])
        source = np.concatenate([source[piece] for piece in pieces])
    return data.tobytes(), source


def intact_frames(source: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the ends of the intact frames among the bytes that arrived, and their numbers from 0."""
    starts = np.flatnonzero((source >= 0) & (source % FRAME_BYTES == 0))
    starts = starts[starts + FRAME_BYTES <= len(source)]
    broken = np.concatenate(([0], np.cumsum((np.diff(source) != 1) | (source[1:] < 0))))
    starts = starts[broken[starts + FRAME_BYTES - 1] == broken[starts]]
    return starts + FRAME_BYTES, source[starts] // FRAME_BYTES


def by_coincidence(
    data: bytes, frames: Bytes, first: int, ends: NDArray[np.int64], numbers: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Add the frames that are whole though not all of their bytes are their own.

    Where a frame's last byte was lost and the next byte happens to equal it, the frame is there as it was sent.
    """
    arrived = np.frombuffer(data, np.uint8)
    room = len(arrived) - FRAME_BYTES
    starts = np.flatnonzero((arrived[: room + 1] == frames[0, 0]) & (arrived[1 : room + 2] == frames[0, 1]))
    starts = np.setdiff1d(starts, ends - FRAME_BYTES, assume_unique=True)
    counters = sum(arrived[starts + 8 + byte].astype(np.int64) << 8 * byte for byte in range(4)) - first
    possible = (counters >= 0) & (counters < len(frames))
    starts, counters = starts[possible], counters[possible]
    whole = [
        bool((arrived[offset : offset + FRAME_BYTES] == frames[number]).all())
        for offset, number in zip(starts.tolist(), counters.tolist(), strict=True)
    ]
    ends = np.concatenate([ends, starts[whole] + FRAME_BYTES])
    numbers = np.concatenate([numbers, counters[whole]])
    order = np.argsort(ends)
    ends, numbers = ends[order], numbers[order]
    keep = np.ones(len(ends), np.bool_)
    # A byte belongs to one frame only; of two that share one the first is taken.
    for offset in np.flatnonzero(np.diff(ends) < FRAME_BYTES).tolist():
        keep[offset + 1] = not keep[offset]
    return ends[keep], numbers[keep]


def _disturbed(
    sender: Sender, noise: Noise, count: int, rng: np.random.Generator
) -> Iterator[tuple[bytes, NDArray[np.int64], NDArray[np.int64]]]:
    """Yield bytes, and ends (in the whole stream) and numbers of the intact frames in them."""
    offset = 0
    for first in range(0, count, FRAMES_AT_ONCE):
        frames = sender.frames(first, min(FRAMES_AT_ONCE, count - first))
        data, source = disturb(frames, noise, rng)
        ends, numbers = by_coincidence(data, frames, first, *intact_frames(source))
        yield data, offset + ends, first + numbers
        offset += len(data)


def through_batch(noise: Noise, count: int, seed: int) -> Outcome:
    """Send `count` frames through the batch decoder."""
    sender, rng = Sender(seed), np.random.default_rng([seed, 2])
    decoder, outcome = BatchDecoder(), Outcome(sent=count)
    got: list[NDArray[np.int64]] = []
    sent: list[NDArray[np.int64]] = []

    def take(batch: object) -> None:
        got.append(np.stack([batch.end_offset, batch.seq.astype(np.int64)], 1))  # type: ignore[attr-defined]
        for group in batch.sample_groups():  # type: ignore[attr-defined]
            numbers = batch.seq[group.frame_index]  # type: ignore[attr-defined]
            same = (group.counts == sender.patterns[numbers % _PATTERNS]).all(axis=(1, 2))
            outcome.corrupt_accepted += int(np.count_nonzero(~same))

    for data, ends, numbers in _disturbed(sender, noise, count, rng):
        sent.append(np.stack([ends, numbers], 1))
        for offset in range(0, len(data), 1 << 20):
            take(decoder.feed(data[offset : offset + (1 << 20)]))
    take(decoder.finish())
    delivered, intact = np.concatenate(got), np.concatenate(sent)
    keys, reference = (rows[:, 0] << 32 | rows[:, 1] for rows in (delivered, intact))
    outcome.corrupt_accepted += int(np.count_nonzero(~np.isin(keys, reference)))
    outcome.intact, outcome.delivered = len(reference), len(keys)
    outcome.duplicates = decoder.counters.duplicates
    outcome.intact_lost = outcome.intact - outcome.delivered - outcome.duplicates
    return outcome


def through_stream(noise: Noise, count: int, seed: int, *, largest_chunk: int = 64) -> Outcome:
    """Send `count` frames through the streaming decoder in chunks of random size, and time each frame in bytes."""
    sender, rng = Sender(seed), np.random.default_rng([seed, 2])
    decoder, outcome = FrameDecoder(), Outcome(sent=count)
    ends_of: dict[int, list[int]] = {}
    fed = 0

    def take(frames: list[Frame]) -> None:
        for frame in frames:
            outcome.delivered += 1
            ends = ends_of.get(frame.seq)
            assert isinstance(frame.message, SampleBlock)
            if not ends or not np.array_equal(frame.message.counts, sender.patterns[frame.seq % _PATTERNS]):
                outcome.corrupt_accepted += 1
            else:
                outcome.worst_delay_bytes = max(outcome.worst_delay_bytes, fed - ends.pop(0))

    for data, ends, numbers in _disturbed(sender, noise, count, rng):
        outcome.intact += len(ends)
        for end, number in zip(ends.tolist(), numbers.tolist(), strict=True):
            ends_of.setdefault(number, []).append(end)
        offset = 0
        for size in rng.integers(1, largest_chunk + 1, 2 * len(data) // largest_chunk + 1).tolist():
            piece = data[offset : offset + size]
            offset += len(piece)
            fed += len(piece)
            take(decoder.feed(piece))
        fed += len(data) - offset
        take(decoder.feed(data[offset:]))
    take(decoder.finish())
    outcome.duplicates = decoder.counters.duplicates
    outcome.intact_lost = outcome.intact - outcome.delivered - outcome.duplicates
    return outcome
