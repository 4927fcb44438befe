"""Test vectors and specification follow the declaration; `treadlink protocol` writes what the generators make."""

import json
import re
from itertools import accumulate
from pathlib import Path
from typing import Any
from zlib import crc32

import pytest

import firmware_protocol
from firmware_protocol import wire
from firmware_protocol.block_decoder import BatchDecoder
from firmware_protocol.cgen import c_encoder, c_header
from firmware_protocol.codec import decode_payload, encode_frame, encode_payload
from firmware_protocol.conformance import make_vectors
from firmware_protocol.decoder import FrameDecoder
from firmware_protocol.messages import MessageType, SampleBlock
from firmware_protocol.reference_frames import WireFrame
from firmware_protocol.spec import updated
from firmware_protocol.wireshark import wireshark_dissector
from gateway.core.errors import TreadlinkError
from tests.core.wire.declared_wire import parse_payload, to_frame, to_message
from tests.testkit.commands import invoked, run

VECTORS = Path(firmware_protocol.__file__).parent / "vectors"
FRAMES = json.loads((VECTORS / "frames.json").read_text("utf-8"))
STREAMS = json.loads((VECTORS / "streams.json").read_text("utf-8"))["streams"]


def name_of(vector: dict[str, Any]) -> str:
    return vector["name"].replace(" ", "_")


def test_committed_vectors_match_the_declaration() -> None:
    made = make_vectors()
    assert made == {path.name: path.read_text("utf-8") for path in VECTORS.iterdir()}, (
        "run `treadlink protocol vectors --out firmware_protocol/vectors --force`"
    )


def test_every_message_type_has_a_vector() -> None:
    assert {vector["type"] for vector in FRAMES["frames"]} == set(MessageType)


@pytest.mark.parametrize("vector", FRAMES["frames"], ids=name_of)
def test_frame(vector: dict[str, Any]) -> None:
    payload = vector["payload"]
    if "text" in payload:
        payload = payload | {"text": payload["text"].encode()}
    wire_frame = WireFrame(*(vector[name] for name in WireFrame._fields[:5]), payload)
    frame = to_frame(wire_frame)
    assert encode_frame(frame).hex() == vector["hex"]
    (decoded,) = FrameDecoder().feed(bytes.fromhex(vector["hex"]))
    assert decoded[:5] == frame[:5]
    assert repr(decoded.message) == repr(frame.message)


@pytest.mark.parametrize("vector", FRAMES["refused_payloads"], ids=name_of)
def test_refused_payload(vector: dict[str, Any]) -> None:
    with pytest.raises(ValueError):
        decode_payload(vector["type"], bytes.fromhex(vector["payload_hex"]))


@pytest.mark.parametrize("vector", FRAMES["tolerated_payloads"], ids=name_of)
def test_tolerated_payload_is_read_but_never_encoded(vector: dict[str, Any]) -> None:
    payload = bytes.fromhex(vector["payload_hex"])
    message = decode_payload(vector["type"], payload)
    assert message == to_message(vector["type"], parse_payload(vector["type"], payload))
    with pytest.raises(ValueError, match="scale_mps2|highpass_hz"):
        encode_payload(message)


@pytest.mark.parametrize("vector", STREAMS, ids=name_of)
@pytest.mark.parametrize("piece_bytes", [1, 7, 10_000])
def test_stream(vector: dict[str, Any], piece_bytes: int) -> None:
    data = bytes.fromhex(vector["hex"])
    pieces = [data[start : start + piece_bytes] for start in range(0, len(data), piece_bytes)]
    stream, batch = FrameDecoder(), BatchDecoder()
    streamed = [frame for piece in pieces for frame in stream.feed(piece)] + stream.finish()
    batched = [frame for piece in pieces for frame in batch.feed(piece).frames()] + list(batch.finish().frames())
    for frames, counters in ((streamed, stream.counters), (batched, batch.counters)):
        assert [dict(zip(WireFrame._fields[:5], frame[:5], strict=True)) for frame in frames] == vector["frames"]
        assert {name: getattr(counters, name) for name in vector["counters"]} == vector["counters"]


SPECIFICATION = (Path(__file__).parents[3] / "docs" / "reference" / "protocol.md").read_text("utf-8")


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


@pytest.mark.parametrize(
    ("command", "text"),
    [
        ("header", c_header),
        ("encoder", c_encoder),
        ("wireshark", wireshark_dissector),
    ],
)
def test_prints_without_a_directory(command: str, text) -> None:
    assert run("protocol", command) == text()


def test_writes_all_files_to_a_new_directory(tmp_path: Path) -> None:
    out = tmp_path / "firmware" / "protocol"
    for command in ("header", "encoder", "vectors"):
        run("protocol", command, "--out", str(out))
    written = {path.name: path.read_text("utf-8") for path in out.iterdir()}
    assert written == make_vectors() | {"treadlink_protocol.h": c_header(), "treadlink_protocol.c": c_encoder()}


def test_overwrites_only_with_force(tmp_path: Path) -> None:
    (tmp_path / "streams.json").write_text("mine")
    result = invoked("protocol", "vectors", "--out", tmp_path)
    assert isinstance(result.exception, TreadlinkError)
    assert "streams.json" in str(result.exception)
    assert "--force" in result.exception.remedy
    assert {path.name for path in tmp_path.iterdir()} == {"streams.json"}
    assert (tmp_path / "streams.json").read_text() == "mine"
    run("protocol", "vectors", "--out", str(tmp_path), "--force")
    assert (tmp_path / "streams.json").read_text("utf-8") == make_vectors()["streams.json"]


def test_directory_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    result = invoked("protocol", "header", "--out", tmp_path / "file" / "below")
    assert isinstance(result.exception, TreadlinkError)
    assert "below" in str(result.exception)


def test_tables_update_a_page(tmp_path: Path) -> None:
    page = tmp_path / "protocol.md"
    page.write_text("before\n<!-- generated: frame -->\nold\n<!-- end -->\nafter\n")
    run("protocol", "tables", str(page))
    text = page.read_text("utf-8")
    assert text.startswith("before\n<!-- generated: frame -->\n| offset |")
    assert "old" not in text
    assert text.endswith("<!-- end -->\nafter\n")
