"""The committed test vectors are current, and Python passes them."""

import json
from pathlib import Path
from typing import Any

import pytest

import firmware_protocol
from firmware_protocol.block_decoder import BatchDecoder
from firmware_protocol.codec import decode_payload, encode_frame, encode_payload
from firmware_protocol.conformance import make_vectors
from firmware_protocol.declaration import WireFrame, parse_payload, to_frame, to_message
from firmware_protocol.decoder import FrameDecoder
from firmware_protocol.messages import MessageType

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
