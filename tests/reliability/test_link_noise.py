"""Noise on the link: no corrupt frame accepted, no intact frame lost, resynchronised within one frame."""

import numpy as np
import pytest

from firmware_protocol import wire
from tools.reliability.noise import (
    FRAME_BYTES,
    NOISES,
    Noise,
    Sender,
    by_coincidence,
    disturb,
    intact_frames,
    through_batch,
)
from tools.reliability.noise import through_stream as stream

FRAMES = 3000


@pytest.mark.parametrize("noise", NOISES, ids=lambda noise: noise.name)
def test_decoders_deliver_exactly_the_intact_frames(noise: Noise) -> None:
    for outcome in (through_batch(noise, FRAMES, 11), stream(noise, FRAMES, 11)):
        assert outcome.corrupt_accepted == 0
        assert outcome.intact_lost == 0
        assert outcome.delivered + outcome.duplicates == outcome.intact
        # Resynchronised before another frame has passed.
        assert outcome.worst_delay_bytes <= wire.MAX_FRAME_BYTES
    if noise.duplicated:
        assert outcome.duplicates > 0
    if noise.bit_errors == 1e-2:
        assert outcome.delivered == 0
    else:
        assert outcome.delivered > 0.1 * FRAMES


def test_measure_separates_intact_from_damaged() -> None:
    frames = Sender(1).frames(0, 100)
    data, source = disturb(frames, Noise("none"), np.random.default_rng(1))
    ends, numbers = intact_frames(source)
    assert data == frames.tobytes()
    assert ends.tolist() == [FRAME_BYTES * (k + 1) for k in range(100)]
    source[FRAME_BYTES * 7 + 5] = -1
    shorter = np.delete(source, FRAME_BYTES * 20 + 241)
    _, numbers = intact_frames(shorter)
    assert sorted(set(range(100)) - set(numbers.tolist())) == [7, 20]


def test_frame_complete_by_coincidence_counts_as_intact() -> None:
    frames = Sender(1).frames(0, 400)
    number = int(np.flatnonzero(frames[:-1, -1] == 0xA5)[0])
    source = np.delete(np.arange(frames.size), FRAME_BYTES * (number + 1) - 1)
    data = frames.reshape(-1)[source].tobytes()
    ends, numbers = by_coincidence(data, frames, 0, *intact_frames(source))
    # Its last byte was lost, the first byte of the next frame replaces it, and that frame is lost.
    assert sorted(set(range(400)) - set(numbers.tolist())) == [number + 1]
    assert (np.diff(ends) >= FRAME_BYTES).all()


def test_decoder_that_drops_its_tail_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    from firmware_protocol.decoder import FrameDecoder

    feed = FrameDecoder.feed

    def forgetting(self: FrameDecoder, data: bytes) -> list:
        frames = feed(self, data)
        if len(self._tail) > 150:
            self._tail = b""
        return frames

    monkeypatch.setattr(FrameDecoder, "feed", forgetting)
    assert stream(Noise("none"), 300, 1).intact_lost > 0
