"""The specification repeats the declaration, and its promises are the code's."""

import re
from pathlib import Path

from firmware_protocol import wire
from firmware_protocol.decoder import FrameDecoder
from firmware_protocol.messages import SampleBlock
from firmware_protocol.spec import updated

SPECIFICATION = (Path(__file__).parents[2] / "docs" / "protocol.md").read_text("utf-8")


def test_generated_parts_are_current() -> None:
    assert updated(SPECIFICATION) == SPECIFICATION, "run `treadlink protocol tables docs/protocol.md`"


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
