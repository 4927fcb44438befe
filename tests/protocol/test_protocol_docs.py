"""The specification repeats the declaration, and its promises are the code's."""

import re
from itertools import accumulate
from pathlib import Path
from zlib import crc32

import pytest

from firmware_protocol import wire
from firmware_protocol.decoder import FrameDecoder
from firmware_protocol.messages import MessageType, SampleBlock
from firmware_protocol.spec import updated

SPECIFICATION = (Path(__file__).parents[2] / "docs" / "reference" / "protocol.md").read_text("utf-8")


def test_generated_parts_are_current() -> None:
    assert updated(SPECIFICATION) == SPECIFICATION, "run `treadlink protocol tables docs/reference/protocol.md`"


def test_worked_example_decodes() -> None:
    lines = re.findall(r"^((?:[0-9A-F]{2} )+) +\w", SPECIFICATION, re.MULTILINE)
    (frame,) = FrameDecoder().feed(bytes.fromhex("".join(lines)))
    assert frame[1:5] == (0, 3, 7, 1_000_000)
    assert isinstance(frame.message, SampleBlock)
    assert frame.message.counts.tolist() == [[-2], [300]]


def test_numbers_in_the_text_match_the_code() -> None:
    assert f"Treadlink wire protocol {wire.VERSION_MAJOR}.{wire.VERSION_MINOR}" in SPECIFICATION
    assert f"{wire.CRC_CHECK_VALUE:08X}" in SPECIFICATION
    assert f"{wire.CRC_RESIDUE:08X}" in SPECIFICATION
    assert f"{wire.OVERHEAD_BYTES} to {wire.MAX_FRAME_BYTES} bytes" in SPECIFICATION
    assert f"length above {wire.MAX_PAYLOAD_BYTES}" in SPECIFICATION
    assert f"up to {wire.WINDOW_FRAMES - 1} behind" in SPECIFICATION
    assert f"again every {wire.HELLO_PERIOD_S:g} s" in SPECIFICATION


@pytest.mark.parametrize("payload_bytes", [1, 8])
def test_damaged_header_holds_short_frames_back_as_documented(payload_bytes: int) -> None:
    """A header of the greatest length, cut off after it; the page promises 239 bytes less the frame's own."""
    longest = wire.MAX_FRAME_BYTES - wire.LENGTH_OFFSET - 1
    assert f"at most {longest} - n bytes after its end" in SPECIFICATION
    damaged = wire.SYNC + bytes((wire.VERSION_BYTE, MessageType.SAMPLES, wire.MAX_PAYLOAD_BYTES))
    frames = [log_frame(seq, payload_bytes) for seq in range(40)]
    decoder, ends, delay = FrameDecoder(), list(accumulate(map(len, frames), initial=len(damaged)))[1:], 0
    for fed, byte in enumerate(damaged + b"".join(frames), start=1):
        for _ in decoder.feed(bytes((byte,))):
            delay = max(delay, fed - ends.pop(0))
    assert not ends
    assert delay == longest - len(frames[0])


def log_frame(seq: int, payload_bytes: int) -> bytes:
    payload = b"\x01" + b"x" * (payload_bytes - 1)
    header = bytes((wire.VERSION_BYTE, MessageType.LOG_TEXT, payload_bytes, 0, 0, 0))
    body = wire.SYNC + header + seq.to_bytes(4, "little") + bytes(4) + payload
    return body + crc32(body).to_bytes(4, "little")
